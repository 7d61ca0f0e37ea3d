//! `outrigger print FILE --port DEV`: one job in the foreground.
//!
//! The whole file is checked before the first line goes out. Ctrl-C (or SIGTERM,
//! or the terminal's end) cancels: what the printer has is awaited and the
//! profile's cancel macro makes it safe; a second one quits at once.
mod keys;
mod letters;
mod ready;
mod show;
mod verdict;
mod words;

pub(super) use letters::{Letters, letters};

use super::guard;
use super::progress;
use super::serial::{Baud, rate};
use crate::job::disk::HeldJob;
use crate::job::host::{Begin, Host};
use crate::job::record::Record;
use crate::job::run::{Mail, Wires, run as run_host};
use crate::job::scribe::Scribe;
use crate::printer::find::{Connection, Places, Wanted, connect};
use crate::printer::lcd::Sink;
use crate::printer::lcd::recorder::Recorder;
use crate::printer::mock;
use crate::printer::port::OpenMode;
use crate::profile::msla::TimedBy;
use crate::profile::printer::HardStop;
use crate::profile::{Msla, Profile, load_printer};
use crate::station::job::Display;
use crate::station::marks::Marks;
use crate::station::plate::Exposures;
use crate::station::realtime::first_in_line;
use crate::station::watchdog::LightWatch;
use crate::station::{Folder, Job, display, lasting_name, lasting_port, now_unix_s, settings};
use anyhow::Context;
use keys::Keys;
use show::Show;
use std::cell::RefCell;
use std::path::PathBuf;
use std::process::ExitCode;
use std::rc::Rc;
use tokio::runtime::Runtime;
use tokio::time::Instant;

/// The profile when none is named: the buffers and limits that every Marlin keeps.
const DEFAULT_PROFILE: &str = "generic-marlin";

/// Print a file: stream it to a printer and watch it.
///
/// G-code goes to a printer of filament; a resin job (SL1, NanoDLP, GOO) to a printer whose plate and
/// light are driven over the same kind of port, while its pictures are shown from here. The file is checked first: nothing is sent if a line is too long for the
/// firmware. In a terminal the keys are: p pause, r resume, 0-9 answer the printer's
/// question, c cancel, ! emergency stop. Ctrl-C cancels the job too: it waits for what the
/// printer has, and sends the profile's cancel macro (heaters off); a second Ctrl-C quits at
/// once and leaves the printer as it is. A job that was broken off is in `outrigger jobs list`.
#[derive(clap::Args)]
pub(super) struct Args {
    /// The job: G-code, text or binary (.bgcode), or a resin job (.sl1, .nanodlp, .goo).
    file: PathBuf,
    /// The printer's serial port: a path such as /dev/ttyUSB0, `usb:` and its serial
    /// number (see `outrigger ports`), `auto` for the only one that answers, or `mock`
    /// for a mock printer that is started for it.
    #[arg(long, value_name = "DEV|usb:N|auto|mock")]
    port: String,
    /// Bits per second; the profile's if not given. `auto` tries the usual ones.
    #[arg(long, value_name = "N|auto")]
    baud: Option<Baud>,
    /// The printer's profile: a name from `outrigger profile list`, or a file.
    #[arg(long, value_name = "NAME", default_value = DEFAULT_PROFILE)]
    profile: String,
    /// Of a resin job: show the pictures in this folder of PNGs instead of on the profile's display.
    #[arg(long, value_name = "DIR")]
    lcd_folder: Option<PathBuf>,
    /// What the printer's profile wants seen to before a print (the vat, the cover) is so.
    #[arg(long)]
    ready: bool,
    /// Do not send the profile's start and end macros around the file.
    #[arg(long)]
    no_macros: bool,
    /// With `--port mock`: how many times faster than life it is.
    #[arg(long, value_name = "K", default_value_t = 10.0, value_parser = super::mock::speed)]
    mock_speed: f64,
    /// The folder of the jobs' records; by itself $OUTRIGGER_STATE, else $STATE_DIRECTORY
    /// (systemd), else $XDG_STATE_HOME/outrigger, else ~/.local/state/outrigger.
    #[arg(long, value_name = "DIR")]
    state: Option<PathBuf>,
    /// Nothing of an earlier job that was broken off here is on the bed: that job is given up.
    #[arg(long)]
    part_removed: bool,
    /// Start no guardian, which switches the printer's heaters off if this process dies
    /// and nobody resumes the job (see `outrigger guard`).
    #[arg(long)]
    no_guard: bool,
    /// Read requests from standard input, a line each: pause, resume, confirm, cancel, stop
    /// (emergency), answer N, send GCODE.
    #[arg(long)]
    commands: bool,
    /// Show every note of the printer, resend and probe.
    #[arg(long, short)]
    verbose: bool,
}

/// Runs the verb. See [`Args`].
pub(super) fn run(args: Args) -> anyhow::Result<ExitCode> {
    let profile = load_printer(&args.profile)?;
    let is_mock = args.port == "mock";
    // A mock's job ends with its printer: it is written down for who wants to look at that.
    let folder = match Folder::open(args.state.as_deref()) {
        _ if is_mock && args.state.is_none() => None,
        Ok(folder) => Some(folder),
        Err(why) => {
            not_recorded(&why);
            None
        }
    };
    let wanted: Wanted = args.port.parse()?;
    let name = lasting_name(&args.profile)?;
    let job = open(&args, &profile, &name, folder.as_ref())?;
    let sink = match profile.msla() {
        Some(msla) if is_mock && args.lcd_folder.is_none() => Some(in_memory(msla)?),
        Some(msla) => Some(display::open(msla, args.lcd_folder.as_deref())?),
        None => None,
    };
    if !is_mock {
        ready::ask(&profile, args.ready)?;
    }
    let rate = rate(args.baud, profile.serial.baud);
    runtime()?.block_on(async {
        let letters = letters()?;
        let mock = if is_mock { Some(start_mock(&profile, rate.first(), args.mock_speed)?) } else { None };
        let wanted = mock.as_ref().map_or(wanted, |m| Wanted::Path(m.path().display().to_string()));
        // Before the job is accepted: one that has no printer is none. And before the printer's port
        // is opened, which may reset it, as far as it is known already.
        let clear = |port: &str| match folder.as_ref().filter(|_| !is_mock) {
            Some(folder) => folder.clear_bed(port, args.part_removed),
            None => Ok(()),
        };
        clear(&wanted.to_string())?;
        let mode = OpenMode::Fresh { reset: profile.serial.dtr_reset };
        let boot_ms = settings::boot_wait_ms(&profile);
        let connection = connect(&wanted, rate, mode, boot_ms, &Places::default()).await?;
        let started = Instant::now();
        let device = lasting_port(&wanted, connection.port.path());
        clear(&device)?;
        let held = folder
            .as_ref()
            .and_then(|folder| folder.store.accept(&job.accepted).inspect_err(|why| not_recorded(why)).ok());
        if let (Some(folder), Some(held)) = (&folder, &held)
            && !args.no_guard
            && mock.is_none()
        {
            guard::start(&folder.store, held.id);
        }
        let printing = Printing {
            job,
            name: args.file.display().to_string(),
            profile: &profile,
            connection,
            started,
            device,
            held,
            begin: Begin::Fresh,
            macros: !args.no_macros,
            person: Person::Away,
            verbose: args.verbose,
            speed: mock.as_ref().map_or(1.0, |_| args.mock_speed),
            sink,
        };
        let listening = Listening::start(args.commands, &letters)?;
        print(printing, letters, listening.hint()).await?;
        Ok(ExitCode::SUCCESS)
    })
}

/// The job, checked; a resin job's pictures take a while.
fn open(args: &Args, profile: &Profile, name: &str, folder: Option<&Folder>) -> anyhow::Result<Job> {
    let bar = progress::layers(Some(0), profile.msla().is_none());
    let watch = |done: u32, of: u32| {
        bar.set_length(u64::from(of));
        bar.set_position(u64::from(done));
    };
    let job = Job::open(&args.file, profile, name, folder.map(|f| &f.store), watch);
    bar.finish_and_clear();
    job
}

/// The display of a printer that is none.
fn in_memory(msla: &Msla) -> anyhow::Result<Box<dyn Sink>> {
    let began = std::time::Instant::now();
    let clock = move || u64::try_from(began.elapsed().as_nanos()).unwrap_or(u64::MAX);
    Ok(Box::new(Recorder::new(display::layout(&msla.lcd), clock)?))
}

/// A job that cannot be written down is printed nevertheless: nobody waits for a disk
/// with a printer at hand, but they must know.
fn not_recorded(why: &dyn std::fmt::Display) {
    eprintln!(
        "outrigger: warning: {why}; the job is printed, but cannot be resumed after a crash or a power cut"
    );
}

/// Who says that part and nozzle are clear before the way back into a job runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Person {
    /// Nobody: the job ends there, to be resumed later.
    Away,
    /// Somebody who is asked.
    Asked,
    /// Somebody who has said so.
    Sure,
}

/// How the user may speak while a job runs.
pub(super) enum Listening {
    /// The terminal's keys.
    Keys { _restore: Keys },
    /// Lines on standard input.
    Words,
    /// By signals alone.
    No,
}

impl Listening {
    /// Begins to listen: to words on standard input, or to keys where it is a terminal.
    ///
    /// # Errors
    /// The system has no thread left.
    pub(super) fn start(commands: bool, letters: &Letters) -> anyhow::Result<Self> {
        let post = letters.post.clone();
        if commands {
            words::listen(post).context("cannot read commands")?;
            return Ok(Listening::Words);
        }
        Ok(Keys::listen(post).map_or(Listening::No, |keys| Listening::Keys { _restore: keys }))
    }

    /// Who can be asked.
    pub(super) fn person(&self) -> Person {
        match self {
            Listening::Keys { .. } | Listening::Words => Person::Asked,
            Listening::No => Person::Away,
        }
    }

    /// What a person may do, to be told at the start.
    pub(super) fn hint(&self) -> Option<&'static str> {
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
    /// The printer…
    pub(super) connection: Connection,
    /// …and when its port was opened.
    pub(super) started: Instant,
    /// What names it in the job's records.
    pub(super) device: String,
    /// The job's records; `None`: it is not written down.
    pub(super) held: Option<HeldJob>,
    /// How it begins.
    pub(super) begin: Begin,
    /// Whether the profile's start and end macros go around the file.
    pub(super) macros: bool,
    /// Who says that part and nozzle are clear, if the printer has lost its state.
    pub(super) person: Person,
    /// Whether every note, resend and probe is shown.
    pub(super) verbose: bool,
    /// How many times faster than life the printer is: 1 but for a mock.
    pub(super) speed: f64,
    /// Where the pictures of a resin job go.
    pub(super) sink: Option<Box<dyn Sink>>,
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
    let Printing { job, profile, started, connection, .. } = printing;
    let marks = Rc::new(RefCell::new(Marks::default()));
    let measured = Rc::new(RefCell::new(Exposures::default()));
    let post = letters.post.clone();
    if job.is_resin() && !first_in_line() && profile.msla().is_some_and(|m| m.light.timed_by == TimedBy::Host)
    {
        eprintln!(
            "outrigger: warning: the system allows no real-time priority (RLIMIT_RTPRIO), and this printer's \
             exposures are timed from here: a busy machine makes them longer by some ms"
        );
    }
    let watch = LightWatch::default();
    let on_port = printing.sink.is_some().then(|| watch.on_port(profile));
    let display = printing.sink.map(|sink| Display {
        sink,
        watch,
        // Whoever is gone wants no word.
        wake: Box::new(move || _ = post.blocking_send(Mail::Look)),
        speed: printing.speed,
        measured: Rc::clone(&measured),
    });
    let lines = job.lines(Rc::clone(&marks), display).with_context(|| printing.name.clone())?;
    let mut show = Show::new(printing.verbose, job.checked, job.facts, marks, printing.speed);
    show.answer_plans(printing.person, letters.post.clone());
    if let Some(hint) = hint {
        show.hint(hint);
    }
    let id = printing.held.as_ref().map(|held| held.id);
    let opened = Record::Opened {
        port: printing.device.clone(),
        baud: connection.port.baud(),
        at_unix_s: now_unix_s(),
    };
    let start = |mut held: HeldJob| {
        held.journal.append(&opened);
        Scribe::start(held, letters.post.clone()).context("cannot start the journal's thread")
    };
    let scribe = printing.held.map(start).transpose()?;
    let mut settings = settings::of(profile, printing.macros);
    settings.waits_for_person = printing.person != Person::Away;
    if connection.awake {
        settings.session.boot_wait_ms = 0;
    }
    let mut host = Host::new(settings, lines, &printing.begin, 0);
    let wires = Wires {
        port: connection.port,
        hard_stop: profile.serial.hard_stop() == HardStop::Dtr,
        identity: connection.identity,
        scribe,
        mail: letters.mail,
        watcher: &mut show,
        on_port,
        started,
    };
    let end = run_host(&mut host, wires).await.end;
    show.finish();
    if let Some(words) = measured.borrow().words() {
        show.hint(&words);
    }
    verdict::verdict(&printing.name, id, &end, host.state(), &show)
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
