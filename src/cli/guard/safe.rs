//! Making a printer safe whose host is dead.
use crate::cli::print::{letters, runtime};
use crate::job::disk::{JobId, Store, StoreError};
use crate::job::host::{Begin, Host, HostEvent};
use crate::job::record::Checkpoint;
use crate::job::record::{Log, Record};
use crate::job::run::{End, Watcher, Wires, run};
use crate::job::scribe::Scribe;
use crate::printer::find::{Places, Rate, Wanted, connect};
use crate::printer::port::OpenMode;
use crate::printer::session::{Outcome, Safety};
use crate::printer::source::{JobLine, Source, SourceError};
use crate::profile::printer::HardStop;
use crate::profile::{Profile, load_printer};
use crate::station::{Job, settings};
use anyhow::bail;
use std::rc::Rc;
use std::time::Duration;
use tokio::time::Instant;

/// The profile of a job whose own cannot be read any more: its cancel macro is what
/// every Marlin understands.
const FALLBACK_PROFILE: &str = "generic-marlin";

/// A printer in the middle of heating or homing may take this long to answer. Meanwhile nobody can
/// take the job up.
const LONGEST: Duration = Duration::from_secs(20 * 60);

/// What was done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Done {
    /// The safe sequence ran, or the firmware had switched off.
    Safe,
    /// Somebody has taken the job up, or it is over.
    NotNeeded,
}

/// Runs the safe sequence on the job's printer and writes it down.
///
/// # Errors
/// The printer is out of reach, or does not confirm.
pub(super) fn make_safe(store: &Store, id: JobId) -> anyhow::Result<Done> {
    let log = store.look(id)?.picture?.log;
    let Some((device, baud, _)) = &log.opened else {
        bail!("no port is recorded");
    };
    let profile = load_printer(&log.accepted.profile).or_else(|_| load_printer(FALLBACK_PROFILE))?;
    runtime()?.block_on(async {
        // First the port: a printer that is not there costs no write to the journal.
        let places = Places::default();
        let wanted: Wanted = device.parse()?;
        let connection = connect(&wanted, Rate::Given(*baud), OpenMode::TakeOver, 0, &places).await?;
        let started = Instant::now();
        let mut held = match store.hold_job(id) {
            Err(StoreError::Busy(_)) => return Ok(Done::NotNeeded),
            held => held?,
        };
        if !super::orphaned(held.journal.log()) {
            return Ok(Done::NotNeeded);
        }
        let words = "its host died and nobody resumed it in time: the guardian switched the heaters off";
        held.journal.append(&Record::Note(words.to_owned()));
        let letters = letters()?;
        let begin = Begin::MakeSafe { log: Box::new(held.journal.log().clone()) };
        let scribe = Scribe::start(held, letters.post.clone())?;
        let mut host = Host::new(settings::of(&profile, false), lines(&log, &profile), &begin, 0);
        let wires = Wires {
            port: connection.port,
            hard_stop: profile.serial.hard_stop() == HardStop::Dtr,
            identity: connection.identity,
            scribe: Some(scribe),
            mail: letters.mail,
            watcher: &mut Nobody,
            on_port: None,
            started,
        };
        let Ok(ended) = tokio::time::timeout(LONGEST, run(&mut host, wires)).await else {
            bail!("the printer does not come to an end; HEATERS MAY BE ON");
        };
        match ended.end {
            End::Over(Outcome::Stopped { safety: Safety::Unknown, .. }) => {
                bail!("the printer does not confirm; HEATERS MAY BE ON")
            }
            // Left: it has lost its state, and its heaters are off.
            End::Over(_) | End::Left => Ok(Done::Safe),
            End::Quit => bail!("a signal ended it"),
        }
    })
}

/// The job's lines, where its file is still the same: they tell how high the nozzle is.
fn lines(log: &Log, profile: &Profile) -> Lines<impl Source + use<>> {
    let job = Job::again(&log.accepted, profile).ok();
    Lines(job.and_then(|job| job.lines(Rc::default(), None).ok()))
}

/// Lines of a file that may be gone.
struct Lines<S>(Option<S>);

impl<S: Source> Source for Lines<S> {
    fn advance(&mut self) -> Result<bool, SourceError> {
        match &mut self.0 {
            Some(lines) => lines.advance(),
            None => Err(SourceError { line: 0, reason: "the file is gone, or was changed".to_owned() }),
        }
    }

    fn line(&self) -> JobLine<'_> {
        self.0.as_ref().map_or(JobLine { command: b"", number: 0 }, Source::line)
    }

    fn layer(&self) -> u32 {
        self.0.as_ref().map_or(0, Source::layer)
    }
}

/// Nobody looks on.
struct Nobody;

impl Watcher for Nobody {
    fn event(&mut self, _: &HostEvent) {}
    fn acknowledged(&mut self, _: &Checkpoint) {}
}
