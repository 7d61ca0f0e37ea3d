//! `outrigger print FILE --port DEV`: one job in the foreground.
//!
//! The whole file is checked before the first line goes out. Ctrl-C (or SIGTERM,
//! or the terminal's end) cancels: what the printer has is awaited and the
//! profile's cancel macro makes it safe; a second one quits at once.
mod escape;
mod marks;
mod show;

use crate::printer::drive::drive;
use crate::printer::job_file::{Checked, Reader, check};
use crate::printer::mock;
use crate::printer::port::Port;
use crate::printer::session::{DEFAULT_BOOT_WAIT_MS, Ending, Outcome, Safety, Session, Settings};
use crate::printer::source::{JobLine, Source, SourceError};
use crate::printer::window::Limit;
use crate::profile::{Macro, Profile, load_printer, printer::Window};
use anyhow::{Context, bail};
use marks::{Facts, Marks};
use outrigger_gcode::checksum::sendable;
use show::Show;
use std::cell::RefCell;
use std::collections::VecDeque;
use std::fs::{File, Metadata};
use std::future::Future;
use std::io::{Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::rc::Rc;
use tokio::runtime::Runtime;
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::oneshot;
use tokio::time::Instant;

/// The profile when none is named: the buffers and limits that every Marlin keeps.
const DEFAULT_PROFILE: &str = "generic-marlin";

/// A board that opening the port does not reset may still say `start` when it was
/// just switched on.
const NO_RESET_WAIT_MS: u64 = 300;

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
        let stops = stops()?;
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
        print(printing, stops).await?;
        Ok(ExitCode::SUCCESS)
    })
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

/// What a session needs of a profile.
fn settings(profile: &Profile) -> Settings {
    let serial = &profile.serial;
    let size = |n: u32| usize::try_from(n).unwrap_or(usize::MAX);
    Settings {
        window: match serial.window {
            Window::Bytes(bytes) => Limit::Bytes(size(bytes)),
            Window::Lines(lines) => Limit::Lines(size(lines)),
        },
        max_line: serial.max_line.map(size),
        boot_wait_ms: match serial.dtr_reset {
            true => DEFAULT_BOOT_WAIT_MS,
            false => NO_RESET_WAIT_MS,
        },
        asks: false,
        waits_for_link: false,
        cancel_macro: profile.macros.cancel.lines().map(str::to_owned).collect(),
    }
}

/// A file that was checked and can be sent.
pub(super) struct Job {
    path: PathBuf,
    file: File,
    stamp: Stamp,
    checked: Checked,
    facts: Facts,
}

/// What tells a file that was written to since.
#[derive(PartialEq)]
struct Stamp {
    bytes: u64,
    modified: Option<std::time::SystemTime>,
}

impl Stamp {
    fn of(meta: &Metadata) -> Self {
        Self { bytes: meta.len(), modified: meta.modified().ok() }
    }
}

impl Job {
    /// Checks a file from its first line to its last.
    ///
    /// # Errors
    /// It cannot be read, or not be printed by this printer; which line, and why.
    pub(super) fn open(path: &Path, profile: &Profile) -> anyhow::Result<Self> {
        Self::check(path, settings(profile).max_line).with_context(|| path.display().to_string())
    }

    fn check(path: &Path, max_line: Option<usize>) -> anyhow::Result<Self> {
        // Asked before opening: to open a pipe would wait for its writer.
        let meta = std::fs::metadata(path)?;
        if meta.is_dir() {
            bail!("this is a directory: name a G-code file");
        }
        if !meta.is_file() {
            bail!("this is no regular file: it is read twice, so save it as one first");
        }
        let file = File::open(path)?;
        let stamp = Stamp::of(&file.metadata()?);
        let mut facts = Facts::default();
        let checked = check(&file, max_line, |_, line| facts.see(line))?;
        Ok(Self { path: path.to_owned(), file, stamp, checked, facts })
    }

    /// From the first line again, if the file is still the one that was checked.
    fn rewind(&mut self) -> anyhow::Result<()> {
        if Stamp::of(&self.file.metadata()?) != self.stamp {
            bail!("the file was changed while it was checked: start again when it is finished");
        }
        self.file.seek(SeekFrom::Start(0))?;
        Ok(())
    }
}

/// The lines of the profile's start macro, of the file, of the end macro.
struct Whole<S> {
    before: VecDeque<Vec<u8>>,
    file: S,
    after: VecDeque<Vec<u8>>,
    /// A macro's line; `None` while the file gives the lines.
    current: Option<Vec<u8>>,
    file_over: bool,
}

impl<S: Source> Whole<S> {
    fn new(file: S, profile: &Profile, macros: bool) -> Self {
        let lines = |text: &Macro| {
            let mut scratch = Vec::new();
            let line = |l: &str| sendable(l.as_bytes(), &mut scratch).map(<[u8]>::to_vec);
            match macros {
                true => text.lines().filter_map(line).collect(),
                false => VecDeque::new(),
            }
        };
        Self {
            before: lines(&profile.macros.start),
            file,
            after: lines(&profile.macros.end),
            current: None,
            file_over: false,
        }
    }
}

impl<S: Source> Source for Whole<S> {
    fn advance(&mut self) -> Result<bool, SourceError> {
        self.current = self.before.pop_front();
        if self.current.is_none() && !self.file_over {
            self.file_over = !self.file.advance()?;
        }
        if self.file_over {
            self.current = self.after.pop_front();
            return Ok(self.current.is_some());
        }
        Ok(true)
    }

    fn line(&self) -> JobLine<'_> {
        match &self.current {
            Some(command) => JobLine { command, number: 0 },
            None => self.file.line(),
        }
    }
}

/// Prints a job to its end, or until the first of the two futures asks to stop;
/// the second quits at once.
///
/// # Errors
/// The job was not printed to its end: why, and what state the printer is in.
pub(super) async fn print(
    printing: Printing<'_>,
    (first, second): (impl Future<Output = ()>, impl Future<Output = ()>),
) -> anyhow::Result<()> {
    let Printing { mut job, profile, .. } = printing;
    job.rewind().with_context(|| job.path.display().to_string())?;
    let mut port = Port::open(&printing.device, printing.baud)?;
    let marks = Rc::new(RefCell::new(Marks::default()));
    let read_marks = Rc::clone(&marks);
    let file = Reader::new(&job.file, job.checked, move |number, line: &[u8]| {
        read_marks.borrow_mut().see(number, line);
    });
    let mut source = Whole::new(file, profile, printing.macros);
    let mut show = Show::new(printing.verbose, job.checked, job.facts, marks, printing.speed);
    let mut session = Session::new(settings(profile), 0);
    let started = Instant::now();
    let outcome = tokio::select! {
        biased;
        () = second => None,
        outcome = drive(&mut port, &mut session, &mut source, &mut show, started, first) => Some(outcome),
    };
    show.finish();
    verdict(&printing.name, outcome, &show)
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

/// Two futures: the first request to stop (Ctrl-C, SIGTERM, the terminal's end),
/// and the second. Call within a runtime; from then on the signals end nothing by
/// themselves.
///
/// # Errors
/// The system refuses to tell of signals.
pub(super) fn stops() -> anyhow::Result<(impl Future<Output = ()>, impl Future<Output = ()>)> {
    let (tell, told) = oneshot::channel();
    let mut signals =
        [signal(SignalKind::interrupt())?, signal(SignalKind::terminate())?, signal(SignalKind::hangup())?];
    let second = async move {
        let [interrupt, terminate, hangup] = &mut signals;
        let mut tell = Some(tell);
        loop {
            tokio::select! {
                _ = interrupt.recv() => {}
                _ = terminate.recv() => {}
                _ = hangup.recv() => {}
            }
            match tell.take() {
                Some(tell) => drop(tell.send(())),
                None => return,
            }
        }
    };
    let first = async move {
        if told.await.is_err() {
            // Nobody is left who could ask.
            std::future::pending::<()>().await;
        }
    };
    Ok((first, second))
}

/// The last words.
fn verdict(name: &str, outcome: Option<Outcome>, show: &Show) -> anyhow::Result<()> {
    let name = escape::printable(name);
    let after = |safety| match safety {
        Safety::Untouched => "nothing of it was sent",
        Safety::Acknowledged => "the printer has run the cancel macro: heaters are off",
        Safety::ByFirmware => "the firmware has switched its heaters off",
        Safety::Unknown => {
            "the printer did not confirm the cancel macro: HEATERS MAY BE ON, switch it off by hand"
        }
    };
    match outcome {
        Some(Outcome::Finished) => {
            show.summary(&name);
            Ok(())
        }
        Some(Outcome::Stopped { ending, safety }) => match ending {
            Ending::Cancelled => bail!("{name}: cancelled; {}", after(safety)),
            Ending::EmergencyStop => bail!("{name}: emergency stop; {}", after(safety)),
            Ending::Failed(failure) => {
                let failure = escape::printable(&failure.to_string());
                bail!("{name}: {failure}; {}", after(safety))
            }
        },
        None => bail!(
            "{name}: quit at once; the printer goes on with what it has, and HEATERS AND MOTORS \
             STAY AS THEY ARE: switch it off by hand"
        ),
    }
}
