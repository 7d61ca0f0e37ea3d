//! `outrigger guard`: watches over printers whose host may die.
//!
//! A guardian looks at the job's record about once a second. It holds neither the job
//! nor the port while it waits, so anybody may take the job up. When the host is dead
//! and nobody has taken it up for the profile's `orphan_timeout_s`, the guardian runs
//! the safe sequence: heaters off, Z up, the job stays resumable.
mod safe;
mod watch;

use crate::causes;
use crate::job::disk::{Entry, JobId, Store, StoreError};
use crate::job::record::Log;
use crate::job::state::State;
use crate::profile::load_printer;
use crate::station::{Folder, guardian};
use safe::Done;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant, SystemTime};
use watch::{Look, Step, Watch};

/// Between two looks.
const POLL: Duration = Duration::from_secs(1);

/// Between two tries of a printer that could not be made safe: a port that is not
/// there, or a printer that does not answer.
const RETRY: Duration = Duration::from_secs(10);

/// When a profile cannot be read any more.
const DEFAULT_TIMEOUT_S: u64 = 300;

/// Switch a printer's heaters off when the program that printed on it has died
///
/// Waits beside a job (or all jobs) without touching job or printer. When the program that
/// printed the job is dead and nobody has resumed the job for the profile's
/// orphan_timeout_s, it runs the profile's cancel macro: heaters and fan off, Z raised. The
/// job can still be resumed then. `outrigger print` and `outrigger jobs resume` each start
/// one by themselves. It outlives a killed print, but not the end of a systemd unit that
/// both belong to: there, run `outrigger guard --all --stay` as a unit of its own
/// (contrib/outrigger-guard.service).
#[derive(clap::Args)]
#[command(group(clap::ArgGroup::new("which").required(true)))]
pub(super) struct Args {
    /// Guard this job, and end when it is over.
    #[arg(long, value_name = "ID", group = "which")]
    job: Option<JobId>,
    /// Guard all jobs that are being printed, and end when none is.
    #[arg(long, group = "which")]
    all: bool,
    /// With --all: never end; guard jobs that begin later, too.
    #[arg(long, requires = "all")]
    stay: bool,
    /// Wait so many seconds for somebody to resume; the profile's time if not given.
    #[arg(long, value_name = "S")]
    timeout: Option<u64>,
    /// Return at once and go on in the background, in a session of its own.
    #[arg(long)]
    detach: bool,
    /// The folder of the jobs' records; by itself $OUTRIGGER_STATE, else $STATE_DIRECTORY
    /// (systemd), else $XDG_STATE_HOME/outrigger, else ~/.local/state/outrigger.
    #[arg(long, value_name = "DIR")]
    state: Option<PathBuf>,
}

/// Runs the verb. See [`Args`].
pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let store = Folder::open(args.state.as_deref())?.store;
    if let Some(id) = args.job {
        // A job that is not there is told now, also by one that detaches.
        store.look(id)?;
    }
    if args.detach {
        detach(&store, args)?;
        return Ok(ExitCode::SUCCESS);
    }
    // The end of the terminal or of the process group that started us shall not end us.
    // Who leads a group already cannot leave it; an interactive shell's job is such.
    let _ = rustix::process::setsid();
    let mut guard = Guard { args, store, jobs: BTreeMap::new(), listed: None, started: Instant::now() };
    guard.watch_all()?;
    Ok(ExitCode::SUCCESS)
}

/// Starts a guardian for a job that this process prints. One that cannot be started is
/// told; the job goes on.
pub(super) fn start(store: &Store, id: JobId) {
    if let Err(why) = guardian::start(store, id) {
        eprintln!(
            "outrigger: warning: no guardian ({}): if this process dies, heaters stay on",
            causes::line(&why)
        );
    }
}

fn detach(store: &Store, args: &Args) -> anyhow::Result<()> {
    let mut arguments: Vec<OsString> = vec!["guard".into()];
    match args.job {
        Some(id) => arguments.extend(["--job".into(), id.to_string().into()]),
        None => arguments.push("--all".into()),
    }
    if args.stay {
        arguments.push("--stay".into());
    }
    if let Some(s) = args.timeout {
        arguments.extend(["--timeout".into(), s.to_string().into()]);
    }
    guardian::spawn(store, arguments)
}

struct Guard<'a> {
    args: &'a Args,
    store: Store,
    /// Jobs to look at, and when the guardian tries again what failed.
    jobs: BTreeMap<JobId, (Watch, Instant)>,
    /// When the folder had last changed, as of the last listing.
    listed: Option<SystemTime>,
    started: Instant,
}

impl Guard<'_> {
    fn watch_all(&mut self) -> anyhow::Result<()> {
        loop {
            self.list()?;
            let ids: Vec<_> = self.jobs.keys().copied().collect();
            for id in ids {
                self.watch(id)?;
            }
            if self.jobs.is_empty() && !self.args.stay {
                return Ok(());
            }
            std::thread::sleep(POLL);
        }
    }

    /// Finds jobs that are not watched yet. Whoever begins a job, or takes one up, makes
    /// or replaces a file; nothing is read while nobody does.
    fn list(&mut self) -> anyhow::Result<()> {
        if let Some(id) = self.args.job {
            if self.listed.replace(SystemTime::UNIX_EPOCH).is_none() {
                let entry = self.store.look(id)?;
                self.add(&entry);
            }
            return Ok(());
        }
        let changed = std::fs::metadata(self.store.path().join("jobs")).and_then(|meta| meta.modified());
        let changed = changed.unwrap_or_else(|_| SystemTime::now());
        if self.listed.replace(changed) == Some(changed) {
            return Ok(());
        }
        for entry in self.store.list()? {
            // A job that waits is live while a host begins it: look again then.
            if entry.live || look(&entry) != Look::Safe {
                self.add(&entry);
            }
        }
        Ok(())
    }

    fn add(&mut self, entry: &Entry) {
        if self.jobs.contains_key(&entry.id) {
            return;
        }
        let profile = entry.picture.as_ref().ok().map(|p| p.log.accepted.profile.as_str());
        let by_profile = || {
            let profile = load_printer(profile?).ok()?;
            Some(u64::from(profile.orphan_timeout_s))
        };
        let timeout_s = self.args.timeout.or_else(by_profile).unwrap_or(DEFAULT_TIMEOUT_S);
        let watch = Watch::new(timeout_s.saturating_mul(1000));
        self.jobs.insert(entry.id, (watch, self.started));
    }

    fn watch(&mut self, id: JobId) -> anyhow::Result<()> {
        let found = match self.store.is_live(id) {
            Ok(true) => Look::Alive,
            Ok(false) => match self.store.look(id) {
                Ok(entry) => look(&entry),
                Err(StoreError::NoJob(_)) => Look::Safe,
                Err(why) => return Err(why.into()),
            },
            Err(StoreError::NoJob(_)) => Look::Safe,
            Err(why) => return Err(why.into()),
        };
        let now = Instant::now();
        let now_ms = u64::try_from((now - self.started).as_millis()).unwrap_or(u64::MAX);
        let Some((watch, again)) = self.jobs.get_mut(&id) else { return Ok(()) };
        match watch.look(found, now_ms) {
            Step::Wait => {}
            Step::Leave => drop(self.jobs.remove(&id)),
            Step::Act if now < *again => {}
            Step::Act => match safe::make_safe(&self.store, id) {
                Ok(Done::Safe) => {
                    super::say(&format!("job {id}: its host is dead; the printer was made safe"));
                    self.jobs.remove(&id);
                }
                Ok(Done::NotNeeded) => {}
                Err(why) => {
                    *again = now + RETRY;
                    eprintln!("outrigger: job {id}: not made safe: {}; trying again", causes::line(&why));
                }
            },
        }
        Ok(())
    }
}

/// What a look at a job tells a guardian.
fn look(entry: &Entry) -> Look {
    match &entry.picture {
        _ if entry.live => Look::Alive,
        Ok(picture) if orphaned(&picture.log) => Look::Orphan,
        // Where its printer is nobody knows; `jobs list` tells of it.
        Ok(_) | Err(_) => Look::Safe,
    }
}

/// Whether a printer may be hot for this job, whose host is dead.
fn orphaned(log: &Log) -> bool {
    log.state.is_active() || (log.state == State::Accepted && log.starts > 0)
}
