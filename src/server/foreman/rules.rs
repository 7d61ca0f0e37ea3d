//! What may be wanted of a job, and what it waits for: pure.
use crate::server::model::{Can, Job, MendState, Stage};

/// What may be wanted of a job now.
pub(super) fn can(job: &Job) -> Vec<Can> {
    let mended = job.mend.as_ref().is_some_and(|mend| mend.state == MendState::Done);
    match job.state {
        Stage::Checking | Stage::Mending => vec![Can::Cancel],
        Stage::Held if mended => vec![Can::Approve, Can::Cancel],
        Stage::Held => vec![Can::Approve, Can::Mend, Can::Cancel],
        Stage::Mended => vec![Can::Approve, Can::Original, Can::Cancel],
        Stage::Queued if job.start_anyway => vec![Can::Cancel],
        Stage::Queued => vec![Can::Start, Can::Mend, Can::Cancel],
        Stage::Starting | Stage::Printing => vec![Can::Pause, Can::Cancel],
        Stage::Pausing | Stage::Paused | Stage::Asking => vec![Can::Resume, Can::Cancel],
        Stage::Resuming | Stage::Lost | Stage::TakingOver | Stage::Recovering | Stage::Ending => {
            vec![Can::Cancel]
        }
        Stage::Cancelling | Stage::Failing => Vec::new(),
        Stage::Interrupted => vec![Can::Resume, Can::Confirm, Can::Cancel, Can::Forget],
        Stage::Finished | Stage::Cancelled | Stage::Failed => vec![Can::Again, Can::Forget],
    }
}

/// Whether some of a job may lie on its printer's bed.
pub(super) fn lies_on(job: &Job, printer: &str) -> bool {
    job.printer == printer && job.started_unix_s.is_some() && !job.cleared && !job.state.is_running()
}

/// Whether a person's word is still wanted before a job may start. `before`: what must be seen to.
pub(super) fn wants_word(job: &Job, bed_clear: bool, before: &[String]) -> bool {
    !job.start_anyway && (!bed_clear || (!before.is_empty() && !job.prepared))
}

/// What stands around a job.
#[derive(Clone, Copy, Debug)]
pub(super) struct Around<'a> {
    /// It is the next of those that wait.
    pub(super) first: bool,
    /// A broken-off job has the bed.
    pub(super) broken_off: bool,
    /// A job has the printer.
    pub(super) busy: bool,
    /// Nothing is known to lie on the bed.
    pub(super) bed_clear: bool,
    /// The printer can take a job.
    pub(super) ready: bool,
    /// The printer is in the configuration.
    pub(super) there: bool,
    /// It cures resin.
    pub(super) resin: bool,
    /// What a person must have seen to before each print.
    pub(super) before: &'a [String],
}

/// What a job waits for, for people.
pub(super) fn waits_for(job: &Job, around: &Around<'_>) -> Option<String> {
    let words = match job.state {
        Stage::Held => "you: look at what was found, then mend it or print it anyway",
        Stage::Mended => "your yes on the picture of the mended job",
        Stage::Interrupted => "you: go on with it, or forget it",
        Stage::Paused => "you: resume it when you like",
        Stage::Asking => "you, at the printer",
        Stage::Lost => "the printer's port to come back",
        Stage::Queued if !around.there => "a printer that is no longer in the configuration",
        Stage::Queued if around.busy => "the job that is printed",
        Stage::Queued if around.broken_off => "the broken-off job: resume or forget it",
        Stage::Queued if !around.first => "the jobs before it",
        Stage::Queued if wants_word(job, around.bed_clear, around.before) => return Some(word(around)),
        Stage::Queued if !around.ready => "the printer to be connected",
        _ => return None,
    };
    Some(words.to_owned())
}

/// The word that a person is asked for.
fn word(around: &Around<'_>) -> String {
    match (around.before, around.resin) {
        ([], true) => "your word that the plate is empty".to_owned(),
        ([], false) => "your word that the bed is clear".to_owned(),
        (before, _) => format!("your word that {}", before.join("; ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Stage; 21] = [
        Stage::Checking,
        Stage::Held,
        Stage::Mending,
        Stage::Mended,
        Stage::Queued,
        Stage::Starting,
        Stage::Printing,
        Stage::Pausing,
        Stage::Paused,
        Stage::Resuming,
        Stage::Asking,
        Stage::Lost,
        Stage::TakingOver,
        Stage::Recovering,
        Stage::Ending,
        Stage::Cancelling,
        Stage::Failing,
        Stage::Interrupted,
        Stage::Finished,
        Stage::Cancelled,
        Stage::Failed,
    ];

    #[test]
    fn every_job_that_is_not_over_can_be_got_rid_of() {
        for state in ALL {
            let can = can(&Job { state, ..Job::default() });
            let ends = can.contains(&Can::Cancel) || can.contains(&Can::Forget);
            assert_eq!(ends, !matches!(state, Stage::Cancelling | Stage::Failing), "{state:?}");
            let kinds = [state.is_before(), state.is_over(), state.is_running(), state == Stage::Interrupted];
            assert_eq!(kinds.iter().filter(|kind| **kind).count(), 1, "{state:?}");
        }
    }

    #[test]
    fn a_waiting_job_says_what_for() {
        let clear = Around {
            first: true,
            broken_off: false,
            busy: false,
            bed_clear: true,
            ready: true,
            there: true,
            resin: false,
            before: &[],
        };
        let job = Job { state: Stage::Queued, ..Job::default() };
        let check = |around: Around<'_>, expect: Option<&str>| {
            let words = waits_for(&job, &around);
            assert_eq!(words.is_some(), expect.is_some(), "{around:?}");
            assert!(words.unwrap_or_default().contains(expect.unwrap_or_default()), "{around:?}");
        };
        check(clear, None);
        check(Around { busy: true, ..clear }, Some("the job that is printed"));
        check(Around { first: false, ..clear }, Some("before it"));
        check(Around { bed_clear: false, ..clear }, Some("bed is clear"));
        check(Around { ready: false, ..clear }, Some("connected"));
        check(Around { broken_off: true, ..clear }, Some("broken-off"));
        check(Around { bed_clear: false, resin: true, ..clear }, Some("plate is empty"));
        let before = ["the plate is empty".to_owned(), "the cover is closed".to_owned()];
        check(Around { before: &before, ..clear }, Some("the plate is empty; the cover is closed"));
    }

    #[test]
    fn a_word_holds_for_what_it_was_given_for() {
        let before = ["the vat is full".to_owned()];
        let check = |bed_clear, before: &[String], [prepared, start_anyway]: [bool; 2], expect| {
            let job = Job { prepared, start_anyway, ..Job::default() };
            assert_eq!(wants_word(&job, bed_clear, before), expect, "{bed_clear} {before:?} {job:?}");
        };
        check(true, &[], [false, false], false);
        check(false, &[], [false, false], true);
        check(false, &[], [false, true], false);
        check(true, &before, [false, false], true);
        check(true, &before, [true, false], false);
        check(false, &before, [true, false], true);
        check(false, &before, [false, true], false);
    }

    #[test]
    fn what_was_begun_lies_on_the_bed_until_somebody_says_otherwise() {
        let job = |state, started, cleared| Job {
            printer: "a".to_owned(),
            state,
            started_unix_s: started,
            cleared,
            ..Job::default()
        };
        let check = |state, started, cleared, expect| {
            assert_eq!(lies_on(&job(state, started, cleared), "a"), expect, "{state:?}");
        };
        check(Stage::Finished, Some(1), false, true);
        check(Stage::Finished, Some(1), true, false);
        check(Stage::Cancelled, None, false, false);
        check(Stage::Interrupted, Some(1), false, true);
        check(Stage::Printing, Some(1), false, false);
        assert!(!lies_on(&job(Stage::Finished, Some(1), false), "b"));
    }
}
