//! The folder of the jobs' records, as a print needs it: no job is printed over the part
//! of another.
use super::job::now_unix_s;
use crate::job::disk::{Entry, JobId, Store, StoreError, folder};
use crate::job::record::{Log, Numbers, Record};
use crate::job::state::State;
use crate::printer::find::{Places, Wanted, scan};
use anyhow::{Context, bail};
use std::path::Path;

/// The folder of the jobs' records.
pub(crate) struct Folder {
    /// The jobs.
    pub(crate) store: Store,
}

/// A profile's name that finds it from anywhere: files by their absolute path.
pub(crate) fn lasting_name(profile: &str) -> anyhow::Result<String> {
    if !(profile.ends_with(".toml") || profile.contains('/')) {
        return Ok(profile.to_owned());
    }
    let path = std::fs::canonicalize(profile).with_context(|| profile.to_owned())?;
    Ok(path.to_string_lossy().into_owned())
}

/// What finds a printer again that was found at `path`: a link as it was given, else its
/// USB number, else the path.
pub(crate) fn lasting_port(wanted: &Wanted, path: &str) -> String {
    let link = Path::new(path).is_symlink() || matches!(wanted, Wanted::Usb(_));
    let all = scan(&Places::default());
    match all.iter().find(|port| port.path == path) {
        Some(port) if !link => port.handle(&all),
        _ => match wanted {
            Wanted::Path(_) => std::path::absolute(path)
                .map_or_else(|_| path.to_owned(), |p| p.to_string_lossy().into_owned()),
            Wanted::Usb(_) | Wanted::Auto => wanted.to_string(),
        },
    }
}

impl Folder {
    /// The folder that is named, or that the environment names.
    ///
    /// # Errors
    /// There is none, or it cannot be made.
    pub(crate) fn open(named: Option<&Path>) -> Result<Self, StoreError> {
        let path = folder(named, |name| std::env::var_os(name))?;
        Ok(Self { store: Store::open(&path)? })
    }

    /// Sees to it that no broken-off job stands on this port's bed; `removed` says that a person has
    /// cleared it.
    ///
    /// # Errors
    /// One stands there: what to do about it.
    pub(crate) fn clear_bed(&self, port: &str, removed: bool) -> anyhow::Result<()> {
        // A folder that cannot be read is told when the job is accepted.
        let Ok(entries) = self.store.list() else { return Ok(()) };
        for entry in entries {
            let Some(standing) = standing(&entry, port) else { continue };
            let id = entry.id;
            if entry.live {
                bail!("{port} is taken: `outrigger jobs show {id}` tells what is printed there");
            }
            if standing && !removed {
                bail!(
                    "job {id} was broken off on {port}, and its part may be on the bed: \
                     `outrigger jobs resume {id}` goes on with it; `outrigger jobs forget {id}` (or \
                     --part-removed here) once the part is removed"
                );
            }
            let words = format!("given up: another job was started on the same printer at {}", now_unix_s());
            self.give_up(id, &words)?;
        }
        Ok(())
    }

    /// Nobody shall resume a job or make it safe any more; `words` say why.
    ///
    /// # Errors
    /// There is no such job, somebody holds it, or it cannot be written down.
    pub(crate) fn give_up(&self, id: JobId, words: &str) -> anyhow::Result<()> {
        let mut held = self.store.hold_job(id)?;
        held.journal.append(&Record::Note(words.to_owned()));
        held.journal.append(&Record::State(State::Cancelled));
        held.journal.sync().with_context(|| format!("job {id} cannot be given up"))
    }
}

/// Whether a job that is not over was last printed on this port, and if so, whether some of it may
/// stand on the bed.
fn standing(entry: &Entry, port: &str) -> Option<bool> {
    let log = &entry.picture.as_ref().ok()?.log;
    let (there, _, _) = log.opened.as_ref()?;
    let waits = log.state == State::Accepted && log.starts == 0;
    let open = !log.state.is_over() && !waits && same_port(there, port);
    open.then(|| begun(log))
}

/// Whether a line of the file may have been sent.
fn begun(log: &Log) -> bool {
    log.numbers != Numbers::Nothing { after: 0 } || log.checkpoint.commands > 0
}

/// Two names of one device: by the same link, or by links to the same device.
fn same_port(one: &str, other: &str) -> bool {
    let device = |name: &str| std::fs::canonicalize(name).ok();
    one == other || device(one).is_some_and(|there| Some(there) == device(other))
}
