//! The last words on a job.
use super::escape::printable;
use super::show::Show;
use crate::job::run::End;
use crate::printer::session::{Ending, Outcome, Safety};
use anyhow::bail;

/// What the printer's heaters are after a job that ended early.
pub(in crate::cli) fn after(safety: Safety) -> &'static str {
    match safety {
        Safety::Untouched => "nothing of it was sent",
        Safety::Acknowledged => "the printer has run the cancel macro: heaters are off",
        Safety::ByFirmware => "the firmware has switched its heaters off",
        Safety::Unknown => {
            "the printer did not confirm the cancel macro: HEATERS MAY BE ON, switch it off by hand"
        }
    }
}

/// The last words: good ones are shown, bad ones are the error.
///
/// # Errors
/// The job was not printed to its end: why, and what state the printer is in.
pub(super) fn verdict(name: &str, end: End, show: &Show) -> anyhow::Result<()> {
    let name = printable(name);
    match end {
        End::Over(Outcome::Finished) => {
            show.summary(&name);
            Ok(())
        }
        End::Over(Outcome::Stopped { ending, safety }) => match ending {
            Ending::Cancelled => bail!("{name}: cancelled; {}", after(safety)),
            Ending::EmergencyStop => bail!("{name}: emergency stop; {}", after(safety)),
            Ending::Failed(failure) => {
                let failure = printable(&failure.to_string());
                bail!("{name}: {failure}; {}", after(safety))
            }
        },
        End::Quit => bail!(
            "{name}: quit at once; the printer goes on with what it has, and HEATERS AND MOTORS \
             STAY AS THEY ARE: switch it off by hand"
        ),
    }
}
