//! `outrigger jobs resume ID`: a job that was broken off goes on.
//!
//! The printer is asked where it is; nothing moves before that is known. A printer that
//! kept its state goes on at once. One that lost it waits for a person's word that part
//! and nozzle are clear, and is told in advance what will be done.
use crate::cli::guard;
use crate::cli::print::{Listening, Person, Printing, letters, print, runtime};
use crate::cli::say;
use crate::cli::serial::{Baud, rate};
use crate::job::disk::{HeldJob, JobId, Store, StoreError};
use crate::job::host::Begin;
use crate::job::record::Log;
use crate::job::state::State;
use crate::printer::find::{FindError, Places, Wanted, connect};
use crate::printer::port::{OpenMode, PortError};
use crate::profile::{Profile, load_printer};
use crate::station::{Job, display, lasting_port};
use anyhow::{Context, bail};
use std::io::ErrorKind;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// A guardian or `jobs list` holds a job for a moment when it looks at it.
const BUSY_FOR: Duration = Duration::from_millis(500);

/// Between two tries of a port that a watchdog still has.
const BUSY_PAUSE: Duration = Duration::from_millis(100);

/// How long a watchdog takes to switch the light off and end.
const WATCHDOG_ENDS: Duration = Duration::from_secs(5);

/// Flags of the verb.
#[derive(clap::Args)]
pub(super) struct Args {
    /// The job's number.
    id: JobId,
    /// The printer's port, if it is another than before: a path, `usb:` and a serial
    /// number, or `auto`.
    #[arg(long, value_name = "DEV|usb:N|auto")]
    port: Option<String>,
    /// Bits per second, if others than before; `auto` tries the usual ones.
    #[arg(long, value_name = "N|auto")]
    baud: Option<Baud>,
    /// The word that is otherwise asked for when the printer was reset: the part is still
    /// in its place, and nothing stands in the way of the nozzle. Of a resin printer: the part
    /// still hangs on the plate, and nothing lies in the vat or stands in the plate's way.
    #[arg(long, visible_alias = "yes-part-and-plate-are-clear")]
    yes_part_and_nozzle_are_clear: bool,
    /// Of a resin job: show the pictures in this folder of PNGs instead of on the profile's display.
    #[arg(long, value_name = "DIR")]
    lcd_folder: Option<PathBuf>,
    /// Do not send the profile's end macro after the file.
    #[arg(long)]
    no_macros: bool,
    /// Start no guardian (see `outrigger guard`).
    #[arg(long)]
    no_guard: bool,
    /// Read requests from standard input, a line each, as `outrigger print` does.
    #[arg(long)]
    commands: bool,
    /// Show every note of the printer, resend and probe.
    #[arg(long, short)]
    verbose: bool,
}

/// Runs the verb.
///
/// # Errors
/// The job cannot be resumed, and why; or it was not printed to its end.
pub(super) fn run(store: Option<&Store>, args: &Args) -> anyhow::Result<ExitCode> {
    let id = args.id;
    let store = store.ok_or(StoreError::NoJob(id))?;
    let held = hold(store, id)?;
    let log = held.journal.log().clone();
    refuse_over(id, &log)?;
    let profile = load_printer(&log.accepted.profile)
        .with_context(|| format!("job {id} was printed with a profile that is not to be had now"))?;
    let job = Job::again(&log.accepted, &profile)
        .with_context(|| format!("job {id} cannot be resumed; `outrigger jobs forget {id}` gives it up"))?;
    say(&format!("job {id}: {}, {}", job.accepted.path.display(), how_far(&log)));
    resume(store, held, &log, job, &profile, args)
}

/// How long a watchdog may have the port of a printer whose host has died: until the light is off.
fn watched_for(profile: &Profile) -> Duration {
    match profile.msla() {
        Some(msla) => {
            Duration::from_millis(u64::from(msla.light.most_ms() + msla.lcd.settle_ms)) + WATCHDOG_ENDS
        }
        None => Duration::ZERO,
    }
}

/// The job, for this process.
fn hold(store: &Store, id: JobId) -> Result<HeldJob, StoreError> {
    let start = Instant::now();
    loop {
        match store.hold_job(id) {
            Err(StoreError::Busy(_)) if start.elapsed() < BUSY_FOR => {
                std::thread::sleep(Duration::from_millis(50));
            }
            held => return held,
        }
    }
}

/// # Errors
/// There is nothing to resume.
fn refuse_over(id: JobId, log: &Log) -> anyhow::Result<()> {
    if log.state.is_over() {
        bail!("job {id} is {}: there is nothing to resume", log.state.words());
    }
    if log.state == State::Accepted && log.starts == 0 {
        bail!("job {id} was never begun: `outrigger print` prints its file");
    }
    Ok(())
}

fn how_far(log: &Log) -> String {
    let at = &log.checkpoint;
    let layer = match at.layer {
        0 => String::new(),
        n => format!(" in layer {n}, Z {:.2} mm", at.z_mm),
    };
    format!("{} of {} commands known to be done{layer}", at.commands, log.accepted.commands)
}

fn resume(
    store: &Store,
    held: HeldJob,
    log: &Log,
    job: Job,
    profile: &Profile,
    args: &Args,
) -> anyhow::Result<ExitCode> {
    let Some((device, baud, _)) = &log.opened else {
        bail!("job {} has no port on record", held.id);
    };
    let wanted: Wanted = args.port.as_ref().unwrap_or(device).parse()?;
    let rate = rate(args.baud, *baud);
    let begin = Begin::TakeOver { log: Box::new(log.clone()) };
    let sink = profile.msla().map(|msla| display::open(msla, args.lcd_folder.as_deref())).transpose()?;
    let began = Instant::now();
    runtime()?.block_on(async {
        let letters = letters()?;
        // Boards that opening resets say `start`; that is heard by the host.
        let boot_ms = crate::station::settings::boot_wait_ms(profile);
        let connection = loop {
            match connect(&wanted, rate, OpenMode::TakeOver, boot_ms, &Places::default()).await {
                Err(FindError::Port(PortError::Open { kind: ErrorKind::ResourceBusy, .. }))
                    if began.elapsed() < watched_for(profile) =>
                {
                    tokio::time::sleep(BUSY_PAUSE).await;
                }
                connected => break connected?,
            }
        };
        let started = tokio::time::Instant::now();
        let device = lasting_port(&wanted, connection.port.path());
        if !args.no_guard {
            guard::start(store, held.id);
        }
        let listening = Listening::start(args.commands, &letters)?;
        let person = match args.yes_part_and_nozzle_are_clear {
            true => Person::Sure,
            false => listening.person(),
        };
        let printing = Printing {
            name: job.accepted.path.display().to_string(),
            job,
            profile,
            connection,
            started,
            device,
            held: Some(held),
            begin,
            macros: !args.no_macros,
            person,
            verbose: args.verbose,
            speed: 1.0,
            sink,
        };
        print(printing, letters, listening.hint()).await?;
        Ok(ExitCode::SUCCESS)
    })
}
