//! `outrigger demo`: everything with no hardware: mock printer, daemon, page, a job printed to its end.
//!
//! A job that is part of the program, in which something begins in the air, goes the way of every
//! upload: the daemon's check finds the island and holds the job, it is mended, somebody says yes,
//! it is printed on a mock printer; then the mock is asked what it got. Every step is what the
//! daemon does for anybody; nothing here knows how. A resin job goes a way of its own, without
//! the daemon: [`resin`].
mod resin;
mod tell;

use super::mock as mock_verb;
use super::{print, say};
use crate::printer::mock::{self, Faults};
use crate::profile::{Profile, load_printer};
use crate::server::app::App;
use crate::server::auth::{Name, PasswordHash, Role};
use crate::server::config::{self, ClearBed, Config, OnFindings};
use crate::server::daemon::{Daemon, Options};
use crate::server::foreman::Message;
use crate::server::model::{Can, CheckState, File, Job, Link, Stage};
use crate::server::shelf::{new_id, random_hex};
use crate::server::upload::{hex, sha256};
use crate::station::now_unix_s;
use anyhow::{Context, bail, ensure};
use indicatif::{ProgressBar, ProgressStyle};
use std::future::Future;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tell::Arrived;
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::watch;

/// The job: a model of the project's own, as PrusaSlicer sliced it without supports.
const JOB: &[u8] = include_bytes!("../../gcode/corpus/lamp.gcode");

/// Its name.
const NAME: &str = "lamp.gcode";

/// The job was sliced for a bed of 220 mm and for no maker's machine.
const PROFILE: &str = "generic-marlin";

/// The printer's name in the daemon.
const PRINTER: &str = "demo";

/// 13 minutes of printing in less than half of one.
const SPEED: f64 = 40.0;

/// What goes wrong on purpose, at lines in the first, second and third quarter
/// of the job: damage that only the checksum shows, damage to the line's number
/// (the firmware then takes the rest for an unknown command and says `ok`), and
/// an older Marlin's request to send again.
const FAULTS: &str = "
[[fault]]
at_line = 1500
do = \"corrupt_line\"
[[fault]]
at_line = 3000
do = \"corrupt_line\"
byte = 0
[[fault]]
at_line = 4500
do = \"resend_without_ok\"
";

/// Entries in [`FAULTS`].
const FAULTS_COUNT: u32 = 3;

/// Between two looks at what the daemon does.
const POLL: Duration = Duration::from_millis(100);

/// What takes longer than this hangs; printing is not among it.
const PATIENCE: Duration = Duration::from_secs(120);

/// Without a terminal the print is told of so often, percent.
const TELL_PERCENT: u64 = 20;

/// Show everything with no hardware: daemon, page, a job checked, mended and printed
///
/// Starts a mock printer (a strict Marlin that is many times faster than life) and the daemon
/// with its page at an address that is printed, and has a sample job go all the way: its check
/// finds a piece that would begin in the air, supports are grown under it, its infill is
/// reordered, and it is printed to its end. At the end the mock printer says what it received.
/// On a terminal the page then stays open until Ctrl-C, for you to try. It takes about half a
/// minute; Ctrl-C cancels it as it would cancel a print.
///
/// With --resin it is a job of a resin printer, without daemon and page: its pictures are checked,
/// a piece that would begin in the air is found, supports are drawn under it, and it is printed as
/// `outrigger print` does it, on a mock printer with plate, light and display. At the end the light
/// of every layer is held against what the job asks: how long it was on, which picture it shone
/// through, how high the plate was. That takes about half a minute too, and ends by itself.
#[derive(clap::Args, Debug)]
pub(super) struct Args {
    /// A resin job on a resin printer instead, without daemon and page
    #[arg(long, conflicts_with_all = ["no_faults", "no_stay"])]
    resin: bool,
    /// The folder of the daemon's data, or of the resin job [default: a new temporary one, which stays]
    #[arg(long, value_name = "DIR")]
    dir: Option<PathBuf>,
    /// How many times faster than life the mock printer is
    #[arg(long, value_name = "K", default_value_t = SPEED, value_parser = mock_verb::speed)]
    speed: f64,
    /// Print over a perfect cable: without this, three lines are damaged on purpose
    #[arg(long)]
    no_faults: bool,
    /// End when the job is printed, on a terminal too
    #[arg(long)]
    no_stay: bool,
}

/// Runs the verb.
///
/// # Errors
/// The folder cannot be written to; the print was cancelled; or the printer did
/// not get what is in the file.
pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    super::serve::log("warn");
    if args.resin {
        return resin::run(args);
    }
    let folder = folder(args.dir.as_deref())?;
    say(
        "The whole way of a job: from the slicer's file to the last line printed.\nNo hardware is needed; Ctrl-C cancels.",
    );
    let profile = load_printer(PROFILE)?;
    let printer = printer(args, &profile)?;
    let config = configuration(&printer.path().display().to_string(), &profile);
    let runtime = print::runtime()?;
    let done = runtime.block_on(async {
        let (end, stop) = watch::channel(false);
        let interrupted = interrupts().context("cannot wait for signals")?;
        let options = Options { folder: Some(folder.clone()), guards: false, speed: Some(args.speed) };
        let daemon = Daemon::start(config, &options)?;
        let app = Arc::clone(&daemon.app);
        // There is somebody to log in before anything is listened on.
        let password = user(&app).await?;
        let (address, at) = watch::channel(String::new());
        let serving = daemon.run(stop, |addresses, _| {
            if let Some(first) = addresses.first() {
                let _ = address.send(format!("http://{first}/"));
            }
        });
        let script = async {
            let shown = show(args, &app, at, &password, &folder, interrupted).await;
            drop(app);
            let _ = end.send(true);
            shown
        };
        let (served, shown) = tokio::join!(serving, script);
        served?;
        shown
    });
    runtime.shutdown_background();
    let printed = done?;
    heading(5, "What the printer received");
    let arrived = Arrived::new(printer.stop()?, &printed);
    say(&arrived.table());
    say("");
    arrived.verdict()?;
    say(&tell::closing(&folder));
    Ok(ExitCode::SUCCESS)
}

/// The daemon's data folder.
fn folder(dir: Option<&Path>) -> anyhow::Result<PathBuf> {
    match dir {
        Some(dir) => {
            std::fs::create_dir_all(dir).with_context(|| format!("cannot make {}", dir.display()))?;
            Ok(std::path::absolute(dir)?)
        }
        None => Ok(tempfile::Builder::new()
            .prefix("outrigger-demo-")
            .tempdir()
            .context("cannot make a temporary folder; name one with --dir")?
            .keep()),
    }
}

fn heading(number: u32, words: &str) {
    say(&format!("\n{number}. {words}"));
}

/// `outrigger mock` within this process.
fn printer(args: &Args, profile: &Profile) -> anyhow::Result<mock::Handle> {
    heading(1, "A mock printer (outrigger mock) and the daemon (outrigger serve)");
    say(&format!(
        "   The printer is a strict Marlin on a pseudo-terminal, {} times faster than\n   \
         life: it checks every line's number and checksum, warms up, and moves.",
        args.speed
    ));
    let faults = match args.no_faults {
        true => Faults::default(),
        false => {
            say(&format!(
                "   On purpose, {FAULTS_COUNT} lines will be damaged on their way; the printer may take what\n   \
                 is left of them for unknown commands (--no-faults leaves them whole)."
            ));
            Faults::parse(FAULTS)?
        }
    };
    let config = mock::Config {
        baud: baud(profile, args.speed),
        speed: args.speed,
        dtr_reset: profile.serial.dtr_reset,
        machine: mock_verb::machine(profile),
        ..mock::Config::default()
    };
    Ok(mock::spawn(mock::Options { config, faults, ..mock::Options::default() })?)
}

/// The line is as much faster as the machine; a float cast saturates.
fn baud(profile: &Profile, speed: f64) -> u32 {
    (f64::from(profile.serial.baud) * speed) as u32
}

fn configuration(port: &str, profile: &Profile) -> Config {
    let mut config = Config::default();
    config.server.listen = vec![([127, 0, 0, 1], 0).into()];
    config.server.mdns = false;
    config.storage.min_free_mb = 0;
    config.printers = vec![config::Printer {
        name: Some("The demo's mock printer".to_owned()),
        baud: Some(profile.serial.baud),
        // The job brings its own start and end, and nothing else is to be compared.
        macros: false,
        on_findings: OnFindings::Hold,
        // What an earlier demo has printed in the same folder went with its mock printer.
        clear_bed: ClearBed::Assume,
        ..config::Printer::new(PRINTER, PROFILE, port)
    }];
    config
}

/// Somebody who can log in, with a password that nobody knows yet.
async fn user(app: &App) -> anyhow::Result<String> {
    let password = random_hex().context("no password can be made")?;
    let hash = PasswordHash::of(&password)?;
    let name = Name::new(PRINTER)?;
    app.auth.with(|auth, now| match auth.needs_first_user() {
        true => auth.add_user(name, Role::Admin, hash, now),
        false => auth.set_password(&name, hash),
    })?;
    app.auth.keep().await.map_err(|problem| anyhow::anyhow!(problem.detail))?;
    Ok(password)
}

/// Whether somebody wants it to end.
fn interrupts() -> std::io::Result<watch::Receiver<bool>> {
    let (tell, told) = watch::channel(false);
    let mut signals = [SignalKind::interrupt(), SignalKind::terminate(), SignalKind::hangup()]
        .into_iter()
        .map(signal)
        .collect::<std::io::Result<Vec<_>>>()?;
    tokio::spawn(async move {
        let mut asked = false;
        loop {
            let [interrupt, terminate, hang_up] = &mut signals[..] else { return };
            tokio::select! {
                _ = interrupt.recv() => {}
                _ = terminate.recv() => {}
                _ = hang_up.recv() => {}
            }
            if std::mem::replace(&mut asked, true) {
                std::process::exit(1);
            }
            let _ = tell.send(true);
        }
    });
    Ok(told)
}

/// Has the job go its way, and gives the bytes that were printed.
///
/// # Errors
/// It did not come to its end.
async fn show(
    args: &Args,
    app: &Arc<App>,
    mut at: watch::Receiver<String>,
    password: &str,
    folder: &Path,
    mut interrupted: watch::Receiver<bool>,
) -> anyhow::Result<Vec<u8>> {
    at.wait_for(|address| !address.is_empty()).await.context("the daemon does not listen")?;
    let address = at.borrow().clone();
    say(&format!("\n   The page      {address}\n   log in as     {PRINTER}\n   password      {password}"));
    let began = Instant::now();
    let printed = tokio::select! {
        printed = go(app, folder) => printed?,
        _ = interrupted.wait_for(|it| *it) => {
            cancel(app).await;
            bail!("cancelled; heaters are off");
        }
    };
    say(&format!("   Done in {:.0} s.", began.elapsed().as_secs_f64()));
    if std::io::stdout().is_terminal() && !args.no_stay {
        say(&format!(
            "\n   The page stays open: {address} ({PRINTER}, {password}).\n   Ctrl-C ends it, and shows what the printer received."
        ));
        let _ = interrupted.wait_for(|it| *it).await;
    }
    Ok(printed)
}

/// A running job is ended, and its printer made safe.
async fn cancel(app: &Arc<App>) {
    let running = app.view.jobs().into_iter().find(|job| !job.state.is_over());
    if let Some(job) = running
        && act(app, &job.id, Can::Cancel).await.is_ok()
    {
        let _ = until("the cancelled job", || app.view.job(&job.id).filter(|job| job.state.is_over())).await;
    }
}

/// The way of the job.
async fn go(app: &Arc<App>, folder: &Path) -> anyhow::Result<Vec<u8>> {
    let board = &app.station(PRINTER).map_err(|p| anyhow::anyhow!(p.detail))?.handle.board;
    until("the mock printer", || (board.picture().link == Link::Ready).then_some(())).await?;

    heading(2, "A sliced job is uploaded, and looked at before anything moves");
    let file = upload(app, folder).await?;
    let job = app
        .ask(|answer| Message::Queue {
            file: file.id.clone(),
            printer: PRINTER.to_owned(),
            hold: false,
            by: PRINTER.to_owned(),
            answer,
        })
        .await
        .map_err(|problem| anyhow::anyhow!(problem.detail))?;
    let checked = until("the check", || {
        let checks = app.view.file(&file.id)?.checks;
        checks.get(PRINTER).filter(|check| check.state >= CheckState::Clean).cloned()
    })
    .await?;
    let held = stands(app, &job.id, Stage::Held).await?;
    say(&tell::checked(&checked));
    say(&format!("   The job is {}.", held.state_words));

    heading(3, "It is mended: supports under what would print in the air");
    act(app, &job.id, Can::Mend).await?;
    let mended = stands(app, &job.id, Stage::Mended).await?;
    let mend = mended.mend.unwrap_or_default();
    say(&tell::mended(&mend.words));
    say(
        "   What was made was read again and holds; the page shows it. A person says yes\n   before the first print of a mended job: here the demo does.",
    );

    heading(4, "It is printed");
    act(app, &job.id, Can::Approve).await?;
    watch_print(app, &job.id).await?;
    let path = app.shelf.of_job(&job.id, "mended");
    std::fs::read(&path).with_context(|| format!("cannot read {}", path.display()))
}

async fn upload(app: &Arc<App>, folder: &Path) -> anyhow::Result<File> {
    let mut upload = app.shelf.upload()?;
    upload.write_all(JOB).with_context(|| format!("cannot write in {}", folder.display()))?;
    let file = File {
        id: new_id('F')?,
        name: NAME.to_owned(),
        bytes: JOB.len() as u64,
        sha256: hex(&sha256(JOB)),
        uploaded_unix_s: now_unix_s(),
        by: PRINTER.to_owned(),
        ..File::default()
    };
    say(&format!(
        "   {NAME}: a gate with a lamp under its beam, as PrusaSlicer sliced it,\n   without supports ({:.0} kB).",
        JOB.len() as f64 / 1e3
    ));
    let message = |answer| Message::Uploaded { upload, file: Box::new(file), printer: None, answer };
    app.ask(message).await.map_err(|problem| anyhow::anyhow!(problem.detail))
}

async fn act(app: &Arc<App>, job: &str, what: Can) -> anyhow::Result<Job> {
    let message = |answer| Message::Act { job: job.to_owned(), what, by: PRINTER.to_owned(), answer };
    app.ask(message).await.map_err(|problem| anyhow::anyhow!(problem.detail))
}

/// Waits until a job stands somewhere.
async fn stands(app: &Arc<App>, job: &str, stage: Stage) -> anyhow::Result<Job> {
    let stood = until("the job", || {
        app.view.job(job).filter(|job| job.state == stage || job.state.is_over() || is_stuck(job, stage))
    })
    .await?;
    ensure!(stood.state == stage, "the job is {}: {}", stood.state_words, why(&stood));
    Ok(stood)
}

/// A mending that failed leaves the job held.
fn is_stuck(job: &Job, wanted: Stage) -> bool {
    wanted == Stage::Mended && job.state == Stage::Held
}

fn why(job: &Job) -> String {
    let mend = job.mend.as_ref().map(|mend| mend.words.clone());
    job.error.clone().or(mend).unwrap_or_else(|| "nothing says why".to_owned())
}

/// Waits for something that does not take long.
async fn until<T>(what: &str, mut there: impl FnMut() -> Option<T>) -> anyhow::Result<T> {
    let began = Instant::now();
    loop {
        if let Some(there) = there() {
            return Ok(there);
        }
        ensure!(began.elapsed() < PATIENCE, "still waiting for {what} after {} s", PATIENCE.as_secs());
        tokio::time::sleep(POLL).await;
    }
}

/// A bar on a terminal, a few lines elsewhere.
fn watch_print(app: &Arc<App>, id: &str) -> impl Future<Output = anyhow::Result<()>> {
    let terminal = std::io::stderr().is_terminal();
    let bar = if terminal { ProgressBar::new(100) } else { ProgressBar::hidden() };
    if let Ok(style) = ProgressStyle::with_template("   {bar:40} {pos} %  {msg}") {
        bar.set_style(style);
    }
    let (app, id) = (Arc::clone(app), id.to_owned());
    async move {
        let (mut told, began) = (0, Instant::now());
        loop {
            tokio::time::sleep(POLL).await;
            let Some(job) = app.view.job(&id) else { bail!("the job is gone") };
            let waits = job.state == Stage::Queued && began.elapsed() > PATIENCE;
            ensure!(!waits, "the job does not begin: it waits for {}", job.waits_for.unwrap_or_default());
            let printer = app.printer(app.station(PRINTER).map_err(|p| anyhow::anyhow!(p.detail))?);
            if let Some(at) = printer.progress {
                // Between 0 and 100.
                let percent = (at.fraction * 100.0) as u64;
                let heat = printer.temperatures.nozzle.map(|h| format!(", nozzle {:.0} °C", h.actual_c));
                let words = format!("layer {}/{}{}", at.layer, at.layers, heat.unwrap_or_default());
                if !terminal && percent >= told + TELL_PERCENT {
                    told = percent - percent % TELL_PERCENT;
                    say(&format!("   {told:>3} %  {words}"));
                }
                bar.set_position(percent);
                bar.set_message(words);
            }
            if job.state.is_over() || job.state == Stage::Interrupted {
                bar.finish_and_clear();
                ensure!(job.state == Stage::Finished, "the job is {}: {}", job.state_words, why(&job));
                return Ok(());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_faults_are_as_many_as_is_said() {
        assert!(Faults::parse(FAULTS).is_ok());
        assert_eq!(FAULTS.matches("[[fault]]").count(), FAULTS_COUNT as usize);
    }
}
