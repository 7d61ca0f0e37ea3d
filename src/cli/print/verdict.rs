//! The last words on a job.
use super::show::Show;
use crate::job::disk::JobId;
use crate::job::run::End;
use crate::job::state::State;
use crate::printer::session::{Ending, Outcome};
use crate::station::escape::printable;
use crate::station::news;
use anyhow::bail;

/// The last words: good ones are shown, bad ones are the error.
///
/// # Errors
/// The job was not printed to its end: why, and what state the printer is in.
pub(super) fn verdict(
    name: &str,
    id: Option<JobId>,
    end: &End,
    state: State,
    show: &Show,
) -> anyhow::Result<()> {
    let name = printable(name);
    match end {
        End::Over(Outcome::Finished) => {
            show.summary(&name);
            Ok(())
        }
        End::Over(Outcome::Stopped { ending, safety }) => {
            let why = match ending {
                Ending::Cancelled => "cancelled".to_owned(),
                Ending::EmergencyStop => "emergency stop".to_owned(),
                Ending::Failed(failure) => printable(&failure.to_string()),
            };
            bail!("{name}: {why}; {}{}", news::after(*safety), next(id, state))
        }
        End::Left => bail!("{name}: the job is {}{}", state.words(), next(id, state)),
        End::Quit if state == State::Interrupted => {
            bail!("{name}: nothing was done to the printer{}", next(id, state))
        }
        End::Quit => bail!(
            "{name}: quit at once; the printer goes on with what it has, and HEATERS, LIGHT \
             AND MOTORS STAY AS THEY ARE: switch it off by hand{}",
            next(id, State::Interrupted)
        ),
    }
}

/// What a person can do with a job that was broken off.
fn next(id: Option<JobId>, state: State) -> String {
    match id {
        Some(id) if !state.is_over() => {
            format!(
                "; `outrigger jobs resume {id}` goes on with it, `outrigger jobs forget {id}` gives it up"
            )
        }
        _ => String::new(),
    }
}
