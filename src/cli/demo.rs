//! `outrigger demo`: the whole way of a job, with no hardware.
//!
//! A job that is part of the program is post-processed, drawn, checked, and printed
//! on a mock printer to the end; then the mock is asked what it got. Every step is
//! what the other verbs do: nothing here knows how.
mod tell;

use super::{check, files, mock as mock_verb, picture, post, print, say};
use crate::job::host::Begin;
use crate::printer::find::{Places, Rate, Wanted, connect};
use crate::printer::mock::{self, Faults, Stats};
use crate::printer::port::OpenMode;
use crate::profile::{Profile, load_printer};
use crate::station;
use anyhow::{Context, bail};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;
use tell::Arrived;
use tokio::runtime::Runtime;

/// The job: a model of the project's own, as PrusaSlicer sliced it.
const JOB: &[u8] = include_bytes!("../../gcode/corpus/demo.gcode");

/// The job was sliced for a bed of 220 mm and for no maker's machine.
const PROFILE: &str = "generic-marlin";

/// 16 minutes of printing in less than half of one.
const SPEED: f64 = 40.0;

/// What goes wrong on purpose, at lines in the first, second and third quarter
/// of the job: damage that only the checksum shows, damage to the line's number
/// (the firmware then takes the rest for an unknown command and says `ok`), and
/// an older Marlin's request to send again.
const FAULTS: &str = "
[[fault]]
at_line = 3000
do = \"corrupt_line\"
[[fault]]
at_line = 6000
do = \"corrupt_line\"
byte = 0
[[fault]]
at_line = 9000
do = \"resend_without_ok\"
";

/// Entries in [`FAULTS`].
const FAULTS_COUNT: u32 = 3;

/// Show everything with no hardware: post-process a job, print it on a mock printer
///
/// Takes a sample job through all that Outrigger does: reorders its infill,
/// verifies the result, draws a layer before and after, looks for what would
/// print in the air, and prints the result on a mock printer, a strict Marlin that executes it many times faster than
/// life. At the end the mock printer says what it received. It takes about
/// half a minute; Ctrl-C cancels it as it would cancel a print.
#[derive(clap::Args, Debug)]
pub(super) struct Args {
    /// Folder for the files [default: a new temporary one, which stays]
    #[arg(long, value_name = "DIR")]
    dir: Option<PathBuf>,
    /// How many times faster than life the mock printer is
    #[arg(long, value_name = "K", default_value_t = SPEED, value_parser = mock_verb::speed)]
    speed: f64,
    /// Print over a perfect cable: without this, three lines are damaged on purpose
    #[arg(long)]
    no_faults: bool,
}

/// Runs the verb.
///
/// # Errors
/// The folder cannot be written to; the print was cancelled; or the printer did
/// not get what is in the file.
pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let started = Instant::now();
    let runtime = print::runtime()?;
    // From here on a signal leaves no half-written file: it waits for the print, which ends in safety.
    let letters = {
        let _inside = runtime.enter();
        print::letters()?
    };
    let paths = Paths::new(args.dir.as_deref())?;
    sample(&paths)?;
    let done = reorder(&paths)?;
    draw(&paths, &done)?;
    look(&paths)?;
    let profile = load_printer(PROFILE)?;
    let printer = printer(args, &profile)?;
    let stats = stream(&runtime, &paths, &profile, printer, args.speed, letters)?;
    let printed = std::fs::read(&paths.reordered)
        .with_context(|| format!("cannot read {}", paths.reordered.display()))?;
    let arrived = Arrived::new(stats, &printed);
    heading(7, "What the printer received");
    say(&arrived.table());
    arrived.verdict()?;
    say(&tell::closing(&paths.folder, started.elapsed().as_secs_f64()));
    Ok(ExitCode::SUCCESS)
}

/// The demo's files.
struct Paths {
    folder: PathBuf,
    job: PathBuf,
    reordered: PathBuf,
    picture: PathBuf,
    page: PathBuf,
    report: PathBuf,
}

impl Paths {
    fn new(dir: Option<&Path>) -> anyhow::Result<Paths> {
        let folder = match dir {
            Some(dir) => {
                std::fs::create_dir_all(dir).with_context(|| format!("cannot make {}", dir.display()))?;
                dir.to_owned()
            }
            None => tempfile::Builder::new()
                .prefix("outrigger-demo-")
                .tempdir()
                .context("cannot make a temporary folder; name one with --dir")?
                .keep(),
        };
        let file = |name: &str| folder.join(name);
        Ok(Paths {
            job: file("demo.gcode"),
            reordered: file("demo-reordered.gcode"),
            picture: file("demo-layer.svg"),
            page: file("demo-layers.html"),
            report: file("demo-report.json"),
            folder,
        })
    }
}

fn heading(number: u32, words: &str) {
    say(&format!("\n{number}. {words}"));
}

/// A file of the demo, on a line of its own: paths may be long.
fn file(what: &str, path: &Path) {
    say(&format!("   {what:<9} {}", path.display()));
}

fn sample(paths: &Paths) -> anyhow::Result<()> {
    say(
        "The whole way of a job, from the slicer's file to the last line printed.\nNo hardware is needed; Ctrl-C cancels.",
    );
    heading(1, "A sliced job");
    match std::fs::read(&paths.job) {
        Ok(there) if there != JOB => bail!(
            "{} is there already and is another job: name another folder with --dir",
            paths.job.display()
        ),
        Err(e) if e.kind() != ErrorKind::NotFound => {
            return Err(e).with_context(|| format!("cannot read {}", paths.job.display()));
        }
        _ => {}
    }
    std::fs::write(&paths.job, JOB).with_context(|| format!("cannot write {}", paths.job.display()))?;
    say("   A float, 42 mm long, as PrusaSlicer sliced it for a printer with Marlin.");
    file("job", &paths.job);
    Ok(())
}

/// `outrigger post` with `--output` and `--report`.
fn reorder(paths: &Paths) -> anyhow::Result<post::Done> {
    heading(2, "Reorder its infill (outrigger post)");
    let done = post::post_file(&post::Args::of(paths.job.clone(), paths.reordered.clone()))?;
    if let Some(reason) = &done.report.unchanged_reason {
        bail!("the sample job was left as it was: {reason}");
    }
    post::write_report(&done.report, &paths.report)?;
    say(&tell::reordered(&done.report));
    file("job", &paths.reordered);
    file("report", &paths.report);
    Ok(done)
}

/// `outrigger post --picture`.
fn draw(paths: &Paths, done: &post::Done) -> anyhow::Result<()> {
    heading(3, "The most improved layer, before and after");
    let Some(shown) = picture::write(&files::file_name(&paths.job), done, &paths.picture)? else {
        bail!("the sample job was left as it was: there is nothing to draw");
    };
    let [before, after] = shown.retractions;
    say(&format!(
        "   In layer {} the filament is pulled back {before} times before, {after} times after.\n   \
         The picture opens in any web browser.",
        shown.layer
    ));
    file("picture", &paths.picture);
    Ok(())
}

/// `outrigger check --picture`.
fn look(paths: &Paths) -> anyhow::Result<()> {
    heading(4, "What would print in the air (outrigger check)");
    let found = check::with_page(&paths.reordered, &paths.page)?;
    say(&tell::checked(&found));
    file("page", &paths.page);
    Ok(())
}

/// `outrigger mock` within this process.
fn printer(args: &Args, profile: &Profile) -> anyhow::Result<mock::Handle> {
    heading(5, "A mock printer (outrigger mock)");
    say(&format!(
        "   A strict Marlin on a pseudo-terminal, {} times faster than life: it checks\n   \
         every line's number and checksum, warms up, and moves as a printer does.",
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
        // The line is as much faster as the machine; a float cast saturates.
        baud: (f64::from(profile.serial.baud) * args.speed) as u32,
        speed: args.speed,
        dtr_reset: profile.serial.dtr_reset,
        machine: mock_verb::machine(profile),
        ..mock::Config::default()
    };
    Ok(mock::spawn(mock::Options { config, faults, ..mock::Options::default() })?)
}

/// `outrigger print`, to the end; then what the printer counted.
fn stream(
    runtime: &Runtime,
    paths: &Paths,
    profile: &Profile,
    printer: mock::Handle,
    speed: f64,
    letters: print::Letters,
) -> anyhow::Result<Stats> {
    heading(6, "Print it (outrigger print)");
    // What the demo prints is nobody's job: its records go with it.
    let records = tempfile::tempdir().context("cannot make a temporary folder")?;
    let folder = station::Folder::open(Some(records.path()))?;
    let job = station::Job::open(&paths.reordered, profile, PROFILE, Some(&folder.store))?;
    let wanted = Wanted::Path(printer.path().display().to_string());
    let fresh = OpenMode::Fresh { reset: false };
    let baud = profile.serial.baud;
    let held = Some(folder.store.accept(&job.accepted)?);
    let printed = runtime.block_on(async {
        let printing = print::Printing {
            job,
            name: files::file_name(&paths.reordered),
            profile,
            connection: connect(&wanted, Rate::Given(baud), fresh, 0, &Places::default()).await?,
            started: tokio::time::Instant::now(),
            device: wanted.to_string(),
            held,
            begin: Begin::Fresh,
            // The job brings its own start and end, and nothing else is to be compared.
            macros: false,
            person: print::Person::Away,
            verbose: false,
            speed,
        };
        print::print(printing, letters, None).await
    });
    printed?;
    Ok(printer.stop()?)
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
