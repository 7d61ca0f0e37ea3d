//! One direction of the wire, on the host's side: lines in, pieces with their time of arrival out.
//!
//! Takes bytes as they are written and the time in ns; damages, loses, holds and cuts
//! whole lines; gives what has arrived. Knows no protocol beyond where a line ends.
use crate::dice::Dice;
use std::collections::VecDeque;

/// Way of a byte through drivers and USB, ns.
const LATENCY_NS: u64 = 1_000_000;

/// Longest line that is waited for before it travels on unfinished: what is
/// longer is no line of a printer.
const LINE_BYTES_MAX: usize = 4096;

/// What happens to lines all the time, in thousandths.
#[derive(Debug, Clone, Copy, Default)]
pub struct Chances {
    /// A byte is damaged.
    pub corrupt: u64,
    /// The line is lost.
    pub lose: u64,
    /// Whether lines travel in two pieces.
    pub split: bool,
    /// Most ns that a piece takes longer.
    pub delay_ns: u64,
}

/// What happens to one line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mishap {
    /// This byte of it, or any, is damaged.
    Corrupt(Option<usize>),
    /// It is lost.
    Lose,
    /// Its line end is lost.
    LoseEnd,
}

/// Hits in a row that noise may land: what lasts longer than the sender's retries
/// rightly ends a job.
const HITS_MAX: u32 = 2;

/// One direction.
#[derive(Debug)]
pub struct Way {
    chances: Chances,
    /// The line that is not complete yet.
    line: Vec<u8>,
    pieces: VecDeque<(u64, Vec<u8>)>,
    /// Nothing arrives before.
    hold_until_ns: u64,
    last_ns: u64,
    hits: u32,
    /// Lines that something happened to.
    pub mishaps: u64,
}

impl Way {
    /// A way on which these things happen.
    pub fn new(chances: Chances) -> Self {
        Self {
            chances,
            line: Vec::new(),
            pieces: VecDeque::new(),
            hold_until_ns: 0,
            last_ns: 0,
            hits: 0,
            mishaps: 0,
        }
    }

    /// Takes bytes up to the next line end; the line, if it is complete now.
    pub fn take(&mut self, bytes: &mut &[u8]) -> Option<Vec<u8>> {
        let end = bytes.iter().position(|b| *b == b'\n');
        let room = LINE_BYTES_MAX - self.line.len();
        let take = end.map_or(bytes.len(), |at| at + 1).min(room);
        self.line.extend_from_slice(&bytes[..take]);
        *bytes = &bytes[take..];
        let whole = self.line.ends_with(b"\n") || self.line.len() == LINE_BYTES_MAX;
        whole.then(|| std::mem::take(&mut self.line))
    }

    /// Sends a line on its way.
    pub fn send(&mut self, mut line: Vec<u8>, mishap: Option<Mishap>, now_ns: u64, dice: &mut Dice) {
        let mishap = mishap.or_else(|| self.noise(dice));
        self.mishaps += u64::from(mishap.is_some());
        match mishap {
            Some(Mishap::Lose) => return,
            Some(Mishap::LoseEnd) => drop(line.pop()),
            Some(Mishap::Corrupt(Some(at))) => {
                let at = at.min(line.len().saturating_sub(2));
                line[at] ^= 1;
            }
            Some(Mishap::Corrupt(None)) => dice.damage(&mut line),
            None => {}
        }
        if self.chances.split && line.len() > 1 {
            let cut = dice.between(1, line.len() as u64 - 1) as usize;
            let rest = line.split_off(cut);
            self.arrive(line, now_ns, dice);
            self.arrive(rest, now_ns, dice);
        } else {
            self.arrive(line, now_ns, dice);
        }
    }

    fn noise(&mut self, dice: &mut Dice) -> Option<Mishap> {
        let Chances { corrupt, lose, .. } = self.chances;
        if corrupt + lose == 0 {
            return None;
        }
        let roll = dice.below(1000);
        let hit = roll < corrupt + lose && self.hits < HITS_MAX;
        self.hits = if hit { self.hits + 1 } else { 0 };
        hit.then_some(if roll < lose { Mishap::Lose } else { Mishap::Corrupt(None) })
    }

    /// Puts bytes on the way as they are.
    pub fn arrive(&mut self, bytes: Vec<u8>, now_ns: u64, dice: &mut Dice) {
        let late_ns = dice.below(self.chances.delay_ns + 1);
        let at_ns = (now_ns + LATENCY_NS + late_ns).max(self.hold_until_ns).max(self.last_ns);
        self.last_ns = at_ns;
        self.pieces.push_back((at_ns, bytes));
    }

    /// Nothing arrives before this time.
    pub fn hold(&mut self, until_ns: u64) {
        self.hold_until_ns = self.hold_until_ns.max(until_ns);
        for (at_ns, _) in &mut self.pieces {
            *at_ns = (*at_ns).max(until_ns);
        }
        self.last_ns = self.last_ns.max(until_ns);
    }

    /// When the next piece arrives.
    pub fn next_ns(&self) -> Option<u64> {
        self.pieces.front().map(|(at_ns, _)| *at_ns)
    }

    /// The oldest piece that has arrived by now, `room` bytes of it at most.
    pub fn arrived(&mut self, now_ns: u64, room: usize) -> Option<Vec<u8>> {
        let (at_ns, bytes) = self.pieces.front_mut()?;
        if *at_ns > now_ns || room == 0 {
            return None;
        }
        if bytes.len() > room {
            let rest = bytes.split_off(room);
            return Some(std::mem::replace(bytes, rest));
        }
        self.pieces.pop_front().map(|(_, bytes)| bytes)
    }

    /// The plug is out: all that is under way is lost.
    pub fn cut(&mut self) {
        self.line.clear();
        self.pieces.clear();
        self.hold_until_ns = 0;
    }
}
