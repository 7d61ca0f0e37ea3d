//! A window that grows where the printer starves behind it.
//!
//! With ADVANCED_OK each `ok` brings `P`, the free blocks of the planner, and `B`, the
//! free slots of the command queue, both at the moment when the `ok` was written. Neither
//! tells bytes of the receive buffer, nor what is on its way: `B` at its most says
//! only that the firmware had read all that had arrived. If the planner is nearly empty
//! then as well, while a line waits for room here, the printer waits for the link, and
//! more may be on its way than the receive buffer holds: it is read as fast as it comes.
//!
//! That ends when the planner fills, and when a command takes its time: so the extra
//! room is there only while the planner is nearly empty and nothing but quick commands
//! is in flight. By the time the planner is full, the extra lines are through:
//!
//! ```text
//!  planner   nearly empty │ fills: at least 3/4 of its blocks │ full: reading stops
//!  window    base + extra │ base: the extra lines drain       │ base fits the buffer
//! ```
//!
//! A resend after growth takes the last step back for good.
use crate::printer::reply::Ack;
use crate::printer::window::Limit;

/// Steps at most, each a quarter of the base: the window at most doubles, so that its
/// extra lines (of 15 bytes or more) drain while a planner of 16 blocks fills.
const MAX_STEPS: usize = 4;

/// `ok`s in a row from a starving printer before a step: more than a planner takes
/// to fill at the start of a job.
const STARVED_OKS: u32 = 48;

/// A planner of fewer blocks tells too little.
const MIN_PLANNER: u32 = 8;

/// No planner and no queue has more free places than this.
const MOST_FREE: u32 = 256;

/// What is known of the printer's buffers, and how far the window has grown.
#[derive(Debug)]
pub(super) struct Growth {
    /// Bytes that are safe whatever the printer does; `None`: lines are counted.
    base: Option<usize>,
    most_planner: u32,
    most_slots: u32,
    /// The most free blocks and slots that two `ok`s have told: noise seldom says the
    /// same twice.
    seen_twice: [u32; 2],
    /// The last `ok` was that of a printer that starves.
    starves: bool,
    starved_oks: u32,
    steps: usize,
    most_steps: usize,
}

impl Growth {
    pub(super) fn new(limit: Limit) -> Self {
        let base = match limit {
            Limit::Bytes(bytes) => Some(bytes),
            Limit::Lines(_) => None,
        };
        Self {
            base,
            most_planner: 0,
            most_slots: 0,
            seen_twice: [0; 2],
            starves: false,
            starved_oks: 0,
            steps: 0,
            most_steps: MAX_STEPS,
        }
    }

    /// An `ok`; `line_waits`: a line had no room.
    pub(super) fn on_ok(&mut self, ack: &Ack, line_waits: bool) {
        let (Some(planner), Some(slots)) = (ack.planner_free, ack.buffer_free) else {
            return;
        };
        // Noise in a number must not become the measure: no planner has more.
        let told = [planner.min(MOST_FREE), slots.min(MOST_FREE)];
        let most = [&mut self.most_planner, &mut self.most_slots];
        for ((twice, most), told) in self.seen_twice.iter_mut().zip(most).zip(told) {
            *twice = (*twice).max(told.min(*most));
            *most = (*most).max(told);
        }
        self.starves = self.most_planner >= MIN_PLANNER
            && planner.saturating_mul(4) >= self.most_planner * 3
            && slots >= self.most_slots;
        if !self.starves {
            self.starved_oks = 0;
        } else if line_waits {
            self.starved_oks += 1;
            if self.starved_oks >= STARVED_OKS && self.steps < self.most_steps {
                self.steps += 1;
                self.starved_oks = 0;
            }
        }
    }

    /// Moves that the printer may have accepted and not made: the blocks of its planner
    /// and the slots of its queue; 0: it does not tell. Marlin keeps one block free, and
    /// the command that is answered is still in its slot.
    pub(super) fn depth(&self) -> u32 {
        match self.seen_twice {
            [0, _] => 0,
            [planner, slots] => planner + 1 + slots + 1,
        }
    }

    /// The printer asked for lines again: perhaps they had no room.
    pub(super) fn on_resend(&mut self) {
        if self.steps > 0 {
            self.steps -= 1;
            self.most_steps = self.steps;
        }
        self.starves = false;
        self.starved_oks = 0;
    }

    /// Bytes beyond the base that may be in flight now, as long as only quick commands
    /// are.
    pub(super) fn extra_bytes(&self) -> usize {
        match self.base {
            Some(base) if self.starves => base / MAX_STEPS * self.steps,
            _ => 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ok(planner: u32, slots: u32) -> Ack {
        Ack { planner_free: Some(planner), buffer_free: Some(slots), ..Ack::default() }
    }

    fn starved(oks: u32) -> Growth {
        let mut growth = Growth::new(Limit::Bytes(120));
        (0..oks).for_each(|_| growth.on_ok(&ok(15, 3), true));
        growth
    }

    #[test]
    fn grows_in_steps_up_to_twice() {
        for (oks, extra) in [(0, 0), (47, 0), (48, 30), (96, 60), (192, 120), (10_000, 120)] {
            assert_eq!(starved(oks).extra_bytes(), extra, "after {oks}");
        }
    }

    #[test]
    fn the_extra_is_there_only_while_the_printer_starves() {
        let mut growth = starved(192);
        growth.on_ok(&ok(10, 3), true);
        assert_eq!(growth.extra_bytes(), 0, "the planner fills");
        growth.on_ok(&ok(15, 2), true);
        assert_eq!(growth.extra_bytes(), 0, "commands wait");
        growth.on_ok(&ok(15, 3), true);
        assert_eq!(growth.extra_bytes(), 120);
    }

    #[test]
    fn a_resend_takes_a_step_back_for_good() {
        let mut growth = starved(100);
        growth.on_resend();
        assert_eq!(growth.extra_bytes(), 0);
        (0..10_000).for_each(|_| growth.on_ok(&ok(15, 3), true));
        assert_eq!(growth.extra_bytes(), 30);
        growth.on_resend();
        (0..10_000).for_each(|_| growth.on_ok(&ok(15, 3), true));
        assert_eq!(growth.extra_bytes(), 0);
    }

    #[test]
    fn does_not_grow_without_reason() {
        let mut growth = Growth::new(Limit::Bytes(120));
        (0..1000).for_each(|_| growth.on_ok(&ok(15, 3), false));
        (0..1000).for_each(|_| growth.on_ok(&Ack::default(), true));
        assert_eq!(growth.extra_bytes(), 0, "no line waits, or nothing is said");
        let mut growth = Growth::new(Limit::Lines(1));
        (0..1000).for_each(|_| growth.on_ok(&ok(15, 3), true));
        assert_eq!(growth.extra_bytes(), 0, "lines are counted");
    }

    #[test]
    fn the_depth_of_the_buffers_is_learned() {
        let check = |oks: &[(u32, u32)], expect: u32| {
            let mut growth = Growth::new(Limit::Lines(1));
            oks.iter().for_each(|(planner, slots)| growth.on_ok(&ok(*planner, *slots), false));
            assert_eq!(growth.depth(), expect, "{oks:?}");
        };
        check(&[], 0);
        check(&[(15, 3)], 0);
        check(&[(15, 3), (15, 3)], 20);
        check(&[(63, 7), (40, 2), (63, 7), (0, 0)], 72);
        check(&[(15, 3), (150, 3), (15, 3)], 20);
        check(&[(999, 999), (999, 999)], 514);
    }
}
