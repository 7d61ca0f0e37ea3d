//! Both ways of the wire, and what was scripted to happen to them.
//!
//! Takes lines and replies as they are written and the time in ns; gives what has arrived.
//! The virtual world and the rig's proxy use the same one, on their own clocks.
use super::wire::{Chances, Mishap, Way};
use crate::dice::Dice;
use crate::scenario::{Fault, Kind};
use std::collections::VecDeque;

/// The link between host and board.
#[derive(Debug)]
pub struct Link {
    /// To the board.
    pub out: Way,
    /// To the host.
    pub back: Way,
    /// The plug is out until then, ns.
    pub gone_until_ns: u64,
    /// The port takes no bytes until then, ns.
    pub blocked_until_ns: u64,
    /// What happens to the next lines and replies.
    next_lines: VecDeque<Mishap>,
    next_replies: VecDeque<Mishap>,
    /// Bytes that come before the next reply.
    inserted: Vec<u8>,
}

/// Seconds of a scenario as ns.
pub fn ns(seconds: f64) -> u64 {
    (seconds * 1e9) as u64
}

impl Link {
    /// A link with this noise.
    pub fn new(out: Chances, back: Chances) -> Self {
        Self {
            out: Way::new(out),
            back: Way::new(back),
            gone_until_ns: 0,
            blocked_until_ns: 0,
            next_lines: VecDeque::new(),
            next_replies: VecDeque::new(),
            inserted: Vec::new(),
        }
    }

    /// Something happens to the bytes. Unplugging does not belong here: the host must be told.
    pub fn happen(&mut self, fault: &Fault, now_ns: u64) {
        let until_ns = now_ns + ns(fault.for_s.unwrap_or_default());
        let times = fault.times.unwrap_or(1) as usize;
        let lines = |mishap| std::iter::repeat_n(mishap, times);
        match fault.kind {
            Kind::CorruptLine => self.next_lines.extend(lines(Mishap::Corrupt(fault.byte.or(Some(5))))),
            Kind::LoseLine => self.next_lines.extend(lines(Mishap::Lose)),
            Kind::LoseEnd => self.next_lines.extend(lines(Mishap::LoseEnd)),
            Kind::CorruptReply => {
                self.next_replies.extend(lines(Mishap::Corrupt(fault.byte.or(Some(1)))));
            }
            Kind::LoseReply => self.next_replies.extend(lines(Mishap::Lose)),
            Kind::HoldLines => self.out.hold(until_ns),
            Kind::HoldReplies => self.back.hold(until_ns),
            Kind::Insert => {
                self.inserted.extend_from_slice(fault.text.as_deref().unwrap_or_default().as_bytes());
            }
            Kind::Block => self.blocked_until_ns = until_ns,
            _ => {}
        }
    }

    /// A line of the host goes on its way.
    pub fn send(&mut self, line: Vec<u8>, now_ns: u64, dice: &mut Dice) {
        let mishap = self.next_lines.pop_front();
        self.out.send(line, mishap, now_ns, dice);
    }

    /// Replies of the board go on their way; `each` sees every line before anything happens to it.
    pub fn reply(&mut self, mut bytes: &[u8], now_ns: u64, dice: &mut Dice, mut each: impl FnMut(&[u8])) {
        while let Some(line) = self.back.take(&mut bytes) {
            each(&line);
            if !self.inserted.is_empty() {
                self.back.arrive(std::mem::take(&mut self.inserted), now_ns, dice);
            }
            let mishap = match line.starts_with(b"ok") {
                true => self.next_replies.pop_front(),
                false => None,
            };
            self.back.send(line, mishap, now_ns, dice);
        }
    }

    /// The plug is out until then: all that is under way is lost.
    pub fn unplug(&mut self, until_ns: u64) {
        self.gone_until_ns = self.gone_until_ns.max(until_ns);
        self.out.cut();
        self.back.cut();
    }
}
