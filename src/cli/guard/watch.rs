//! When a guardian acts: pure, so that tests need no waiting.
//!
//! Takes what a look at the journal found, and the time; says whether to wait, to act
//! or to leave.

/// What a look at a job finds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Look {
    /// A host prints it.
    Alive,
    /// No host has it, and the printer may be hot.
    Orphan,
    /// Nobody needs to guard it: it is over, broken off in safety, or not begun.
    Safe,
}

/// What the guardian does next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Step {
    /// Looks again later.
    Wait,
    /// Makes the printer safe.
    Act,
    /// Leaves.
    Leave,
}

/// One job under guard.
#[derive(Debug)]
pub(super) struct Watch {
    timeout_ms: u64,
    orphan_since_ms: Option<u64>,
}

impl Watch {
    /// A job whose host may be dead for `timeout_ms` before the guardian acts.
    pub(super) fn new(timeout_ms: u64) -> Self {
        Self { timeout_ms, orphan_since_ms: None }
    }

    /// One more look, at `now_ms` of any steady clock.
    pub(super) fn look(&mut self, look: Look, now_ms: u64) -> Step {
        match look {
            Look::Safe => Step::Leave,
            Look::Alive => {
                // Taken up in time; the next death is waited for anew.
                self.orphan_since_ms = None;
                Step::Wait
            }
            Look::Orphan => {
                let since_ms = *self.orphan_since_ms.get_or_insert(now_ms);
                match now_ms.saturating_sub(since_ms) >= self.timeout_ms {
                    true => Step::Act,
                    false => Step::Wait,
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_acts_on_orphans_only_and_not_too_soon() {
        use Look::{Alive, Orphan, Safe};
        use Step::{Act, Leave, Wait};
        let check = |looks: &[(u64, Look, Step)]| {
            let mut watch = Watch::new(300);
            for &(now_ms, look, expect) in looks {
                assert_eq!(watch.look(look, now_ms), expect, "{now_ms} {look:?}");
            }
        };
        check(&[(0, Alive, Wait), (1000, Alive, Wait), (2000, Safe, Leave)]);
        check(&[(0, Safe, Leave)]);
        check(&[(0, Orphan, Wait), (299, Orphan, Wait), (300, Orphan, Act)]);
        // Not taken up, then taken up, then dead again: the whole time anew.
        check(&[(0, Alive, Wait), (50, Orphan, Wait), (200, Alive, Wait), (400, Orphan, Wait)]);
        check(&[(0, Orphan, Wait), (299, Alive, Wait), (301, Orphan, Wait), (600, Orphan, Wait)]);
        check(&[(0, Orphan, Wait), (299, Alive, Wait), (301, Orphan, Wait), (601, Orphan, Act)]);
        // What could not be done is tried again.
        check(&[(0, Orphan, Wait), (300, Orphan, Act), (1300, Orphan, Act), (2300, Safe, Leave)]);
    }
}
