//! `outrigger print FILE --port DEV`: one job in the foreground.
//!
//! The whole file is checked before the first line goes out. Ctrl-C (or SIGTERM,
//! or the terminal's end) cancels: what the printer has is awaited and the
//! profile's cancel macro makes it safe; a second one quits at once.
mod cases;
mod escape;
mod job;
mod keys;
mod letters;
mod marks;
pub(super) mod settings;
mod show;
mod verdict;
mod words;

pub(super) use job::Job;
pub(super) use letters::{Letters, letters};

use crate::job::host::{Begin, Host};
use crate::job::run::{Reopen, Wires, run as run_host};
use crate::printer::job_file::Reader;
use crate::printer::mock;
use crate::printer::port::Port;
use crate::profile::printer::HardStop;
use crate::profile::{Profile, load_printer};
use anyhow::Context;
use keys::Keys;
use marks::Marks;
use show::Show;
use std::cell::RefCell;
use std::future::Future;
use std::path::PathBuf;
use std::pin::Pin;
use std::process::ExitCode;
use std::rc::Rc;
use std::time::Duration;
use tokio::runtime::Runtime;
use tokio::time::Instant;

/// The profile when none is named: the buffers and limits that every Marlin keeps.
const DEFAULT_PROFILE: &str = "generic-marlin";

/// Print a file: stream it to a printer and watch it.
///
/// The file is checked first: nothing is sent if a line is too long for the
/// firmware. Ctrl-C cancels the job, waits for what the printer has, and sends
/// the profile's cancel macro (heaters off); a second Ctrl-C quits at once and
/// leaves the printer as it is.
#[derive(clap::Args)]
pub(super) struct Args {
    /// The G-code file, text or binary (.bgcode).
    file: PathBuf,
    /// The printer's serial port, such as /dev/ttyUSB0; `mock` prints to a mock
    /// printer that is started for it.
    #[arg(long, value_name = "DEV|mock")]
    port: String,
    /// Bits per second; the profile's if not given.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    baud: Option<u32>,
    /// The printer's profile: a name from `outrigger profile list`, or a file.
    #[arg(long, value_name = "NAME", default_value = DEFAULT_PROFILE)]
    profile: String,
    /// Do not send the profile's start and end macros around the file.
    #[arg(long)]
    no_macros: bool,
    /// With `--port mock`: how many times faster than life it is.
    #[arg(long, value_name = "K", default_value_t = 10.0, value_parser = super::mock::speed)]
    mock_speed: f64,
    /// Read requests from standard input, a line each: pause, resume, cancel, stop,
    /// answer N, send GCODE.
    #[arg(long)]
    commands: bool,
    /// Show every note of the printer, resend and probe.
    #[arg(long, short)]
    verbose: bool,
}

/// Runs the verb. See [`Args`].
pub(super) fn run(args: Args) -> anyhow::Result<ExitCode> {
    let profile = load_printer(&args.profile)?;
    let job = Job::open(&args.file, &profile)?;
    let baud = args.baud.unwrap_or(profile.serial.baud);
    runtime()?.block_on(async {
        let letters = letters()?;
        let mock = match args.port.as_str() {
            "mock" => Some(start_mock(&profile, baud, args.mock_speed)?),
            _ => None,
        };
        let printing = Printing {
            job,
            name: args.file.display().to_string(),
            profile: &profile,
            device: mock.as_ref().map_or_else(|| args.port.clone(), |m| m.path().display().to_string()),
            baud,
            macros: !args.no_macros,
            verbose: args.verbose,
            speed: mock.as_ref().map_or(1.0, |_| args.mock_speed),
        };
        let listening = Listening::start(args.commands, &letters)?;
        print(printing, letters, listening.hint()).await?;
        Ok(ExitCode::SUCCESS)
    })
}

/// How the user may speak while a job runs.
enum Listening {
    /// The terminal's keys.
    Keys { _restore: Keys },
    /// Lines on standard input.
    Words,
    /// By signals alone.
    No,
}

impl Listening {
    fn start(commands: bool, letters: &Letters) -> anyhow::Result<Self> {
        let post = letters.post.clone();
        if commands {
            words::listen(post).context("cannot read commands")?;
            return Ok(Listening::Words);
        }
        Ok(Keys::listen(post).map_or(Listening::No, |keys| Listening::Keys { _restore: keys }))
    }

    fn hint(&self) -> Option<&'static str> {
        match self {
            Listening::Keys { .. } => Some(keys::HELP),
            Listening::Words | Listening::No => None,
        }
    }
}

/// The event loop that a job is printed in.
///
/// # Errors
/// The system has no resources for one.
pub(super) fn runtime() -> anyhow::Result<Runtime> {
    tokio::runtime::Builder::new_current_thread().enable_all().build().context("cannot start the event loop")
}

/// One job, and what it is printed on.
pub(super) struct Printing<'a> {
    /// The job.
    pub(super) job: Job,
    /// What people know it by.
    pub(super) name: String,
    /// The printer's profile.
    pub(super) profile: &'a Profile,
    /// The serial port.
    pub(super) device: String,
    /// Bits per second.
    pub(super) baud: u32,
    /// Whether the profile's start and end macros go around the file.
    pub(super) macros: bool,
    /// Whether every note, resend and probe is shown.
    pub(super) verbose: bool,
    /// How many times faster than life the printer is: 1 but for a mock.
    pub(super) speed: f64,
}

/// Where the printer was found, to find it again.
struct Place {
    device: String,
    baud: u32,
}

/// Between two looks for a port that is gone.
const LOOK_EVERY: Duration = Duration::from_millis(250);

impl Reopen for Place {
    fn reopen(&self) -> Pin<Box<dyn Future<Output = Port>>> {
        let (device, baud) = (self.device.clone(), self.baud);
        Box::pin(async move {
            loop {
                tokio::time::sleep(LOOK_EVERY).await;
                if let Ok(port) = Port::open(&device, baud) {
                    return port;
                }
            }
        })
    }
}

/// Prints a job to its end, or until its mail ends it; `hint` is shown at the start.
///
/// # Errors
/// The job was not printed to its end: why, and what state the printer is in.
pub(super) async fn print(
    printing: Printing<'_>,
    letters: Letters,
    hint: Option<&str>,
) -> anyhow::Result<()> {
    let Printing { mut job, profile, .. } = printing;
    job.rewind()?;
    let port = Port::open(&printing.device, printing.baud)?;
    let started = Instant::now();
    let marks = Rc::new(RefCell::new(Marks::default()));
    let read_marks = Rc::clone(&marks);
    let file = Reader::new(&job.file, job.checked, move |number, line: &[u8]| {
        read_marks.borrow_mut().see(number, line);
    });
    let mut show = Show::new(printing.verbose, job.checked, job.facts, marks, printing.speed);
    if let Some(hint) = hint {
        show.hint(hint);
    }
    let place = Place { device: printing.device, baud: printing.baud };
    let mut host = Host::new(settings::of(profile, printing.macros), file, &Begin::Fresh, 0);
    let hard_stop = profile.serial.hard_stop() == HardStop::Dtr;
    let wires = Wires {
        port,
        hard_stop,
        reopen: &place,
        scribe: None,
        mail: letters.mail,
        watcher: &mut show,
        started,
    };
    let end = run_host(&mut host, wires).await;
    show.finish();
    verdict::verdict(&printing.name, end, &show)
}

/// The printer behind `--port mock`: the profile's machine.
fn start_mock(profile: &Profile, baud: u32, speed: f64) -> anyhow::Result<mock::Handle> {
    let config = mock::Config {
        baud,
        speed,
        dtr_reset: profile.serial.dtr_reset,
        machine: super::mock::machine(profile),
        ..mock::Config::default()
    };
    Ok(mock::spawn(mock::Options { config, ..mock::Options::default() })?)
}
