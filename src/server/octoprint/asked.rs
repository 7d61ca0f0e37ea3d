//! Which printer an address means, and what that printer does, in the few words that other makers'
//! hosts have for it.
//!
//! Takes a request's path and headers; gives [`At`], and from it [`Now`]. The first printer of the
//! configuration lives at the root, each one also under `/p/ID`, so that `http://host/p/ID` is a
//! host of its own for a client. Knows no reply of any API.
use crate::server::app::{App, Station};
use crate::server::asker::Who;
use crate::server::foreman::Message;
use crate::server::http::Peer;
use crate::server::model::{File, Job, Link, Printer, Stage};
use crate::server::problem::Problem;
use axum::extract::{FromRequestParts, RawPathParams};
use axum::http::header;
use axum::http::request::Parts;
use std::sync::Arc;

/// A printer, as an address means it.
#[derive(Clone)]
pub(crate) struct At {
    pub(crate) app: Arc<App>,
    /// Its place in the configuration.
    pub(crate) index: usize,
    /// Whether the address says which.
    named: bool,
    /// `http://HOST` as the client wrote it; empty where it did not say any.
    pub(crate) origin: String,
}

/// Somebody who may, and the printer.
#[derive(Clone)]
pub(crate) struct Asked {
    pub(crate) at: At,
    pub(crate) who: Who,
}

impl At {
    /// The printer of a request.
    ///
    /// # Errors
    /// There is none of that name, or none at all.
    pub(crate) async fn of(parts: &mut Parts, app: &Arc<App>) -> Result<Self, Problem> {
        let params = RawPathParams::from_request_parts(parts, app).await;
        let params = params.map_err(|_| Problem::bad("the path is no text"))?;
        let name = params.iter().find_map(|(key, value)| (key == "printer").then_some(value));
        let index = match name {
            Some(name) => app.stations.iter().position(|station| station.config.id == name),
            None => (!app.stations.is_empty()).then_some(0),
        };
        let index = index.ok_or_else(|| Problem::no_such("printer"))?;
        Ok(Self { app: Arc::clone(app), index, named: name.is_some(), origin: origin(parts, app) })
    }

    pub(crate) fn station(&self) -> &Station {
        &self.app.stations[self.index]
    }

    pub(crate) fn id(&self) -> &str {
        &self.station().config.id
    }

    /// Where the client's API begins.
    pub(crate) fn base(&self) -> String {
        match self.named {
            true => format!("{}/p/{}", self.origin, self.id()),
            false => self.origin.clone(),
        }
    }

    /// What the printer does.
    pub(crate) fn now(&self) -> Now {
        Now::of(&self.app, self.app.printer(self.station()))
    }

    /// The newest file of a name; of a path, the last part counts, as it does in uploads.
    ///
    /// # Errors
    /// There is none.
    pub(crate) fn file(&self, path: &str) -> Result<File, Problem> {
        let name = path.rsplit('/').next().unwrap_or_default();
        self.app.view.file_named(name).ok_or_else(|| Problem::no_such("file"))
    }

    /// Refuses a name that the running job's file has. Nothing would be overwritten, for each upload
    /// is a file of its own; but clients know a host whose names are its files, and what they
    /// would show of the running job from then on would be of another file. Another printer's job
    /// is no reason: the same file goes to several printers.
    ///
    /// # Errors
    /// It has.
    pub(crate) fn free_name(&self, name: &str) -> Result<(), Problem> {
        match self.now().job {
            Some(job) if job.name == name => {
                Err(Problem::conflict(format!("{name} is being printed: wait, or upload it by another name")))
            }
            _ => Ok(()),
        }
    }

    /// Queues a file. One that waits already is not queued a second time: a start that is pressed
    /// again means the same one.
    ///
    /// # Errors
    /// It waits for a person, who must look first; or the foreman refuses.
    pub(crate) async fn print(&self, file: &File, who: &Who) -> Result<Job, Problem> {
        let waits = |job: &Job| job.printer == self.id() && job.file == file.id && job.state.is_before();
        match self.app.view.jobs().into_iter().find(waits) {
            Some(job) if matches!(job.state, Stage::Held | Stage::Mended) => {
                Err(Problem::conflict(format!("{} is {}", job.name, job.state.words())))
            }
            Some(job) => Ok(job),
            None => self.queue(file.id.clone(), who).await,
        }
    }

    /// Queues a file.
    ///
    /// # Errors
    /// What the foreman says.
    pub(crate) async fn queue(&self, file: String, who: &Who) -> Result<Job, Problem> {
        let (printer, by) = (self.id().to_owned(), who.name().to_owned());
        let job = self.app.ask(|answer| Message::Queue { file, printer, hold: false, by, answer }).await?;
        tracing::info!(job = job.id, name = job.name, printer = job.printer, by = job.by, "queued");
        Ok(job)
    }

    /// Removes a name: all files that have it, for an older one would come to light else.
    ///
    /// # Errors
    /// There is none, or a job needs one of them.
    pub(crate) async fn remove(&self, path: &str) -> Result<File, Problem> {
        let newest = self.file(path)?;
        let files = self.app.view.files().into_iter().filter(|file| file.name == newest.name);
        for file in files {
            self.app.ask(|answer| Message::Remove { file: file.id, answer }).await?;
        }
        Ok(newest)
    }
}

/// `http://HOST` of a request. Only a configured proxy is believed that it was asked by HTTPS.
fn origin(parts: &Parts, app: &App) -> String {
    let peer: Option<&Peer> = parts.extensions.get();
    let proxied = || {
        let trusted = peer.is_some_and(|peer| app.config.server.trusted_proxies.contains(&peer.address.ip()));
        trusted && parts.headers.get("x-forwarded-proto").is_some_and(|proto| proto.as_bytes() == b"https")
    };
    let scheme = if peer.is_some_and(|peer| peer.encrypted) || proxied() { "https" } else { "http" };
    let host = parts.headers.get(header::HOST).and_then(|host| host.to_str().ok()).unwrap_or_default();
    let plain = |c: char| c.is_ascii_alphanumeric() || ".-:[]_".contains(c);
    match !host.is_empty() && host.chars().all(plain) {
        true => format!("{scheme}://{host}"),
        false => String::new(),
    }
}

/// What a printer does, as far as other hosts have words for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Doing {
    Offline,
    Connecting,
    Failed,
    Ready,
    Starting,
    Printing,
    Pausing,
    Paused,
    Cancelling,
}

impl Doing {
    fn of(link: Link, running: Option<Stage>, last: Option<Stage>) -> Self {
        match (link, running) {
            (Link::Offline, _) => Doing::Offline,
            (Link::Connecting, _) => Doing::Connecting,
            (Link::Failed, _) => Doing::Failed,
            (_, Some(Stage::Starting)) => Doing::Starting,
            (_, Some(Stage::Pausing)) => Doing::Pausing,
            (_, Some(Stage::Paused | Stage::Asking | Stage::Lost | Stage::Interrupted)) => Doing::Paused,
            (_, Some(Stage::Cancelling | Stage::Failing)) => Doing::Cancelling,
            (_, Some(_)) => Doing::Printing,
            (Link::Ready, None) => Doing::Ready,
            // The job is over, and the printer is not given back yet.
            (Link::Busy, None) if last == Some(Stage::Finished) => Doing::Printing,
            (Link::Busy, None) => Doing::Cancelling,
        }
    }

    /// The printer answers.
    pub(crate) fn is_operational(self) -> bool {
        !matches!(self, Doing::Offline | Doing::Connecting | Doing::Failed)
    }
}

/// A printer and its jobs.
#[derive(Clone, Debug)]
pub(crate) struct Now {
    pub(crate) printer: Printer,
    pub(crate) doing: Doing,
    /// The one that has the printer, or was broken off on it.
    pub(crate) job: Option<Job>,
    /// The next that waits.
    pub(crate) next: Option<Job>,
    /// The last that was over.
    pub(crate) last: Option<Job>,
}

impl Now {
    fn of(app: &App, printer: Printer) -> Self {
        let jobs = app.view.jobs();
        let mine = || jobs.iter().filter(|job| job.printer == printer.id);
        let job = mine().find(|job| job.state.is_running() || job.state == Stage::Interrupted).cloned();
        let next = mine().filter(|job| job.state.is_before()).min_by_key(|job| job.place).cloned();
        let over = mine().filter(|job| job.state.is_over() && job.started_unix_s.is_some());
        let last = over.max_by_key(|job| (job.ended_unix_s, job.place)).cloned();
        let stage = |job: &Option<Job>| job.as_ref().map(|job| job.state);
        let doing = Doing::of(printer.state, stage(&job), stage(&last));
        Self { printer, doing, job, next, last }
    }

    /// Why nothing can be done with the printer, for people.
    pub(crate) fn words(&self) -> &str {
        self.printer.error.as_deref().unwrap_or(&self.printer.state_words)
    }

    /// Refuses while the printer is not there or has a job.
    ///
    /// # Errors
    /// It is so.
    pub(crate) fn is_idle(&self) -> Result<(), Problem> {
        match self.doing {
            Doing::Ready => Ok(()),
            doing if doing.is_operational() => Err(Problem::conflict("a job has the printer")),
            _ => Err(Problem::conflict(format!("the printer is not operational: {}", self.words()))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_printer_does_has_one_word() {
        let check = |link, running, last, expect| assert_eq!(Doing::of(link, running, last), expect);
        check(Link::Ready, None, None, Doing::Ready);
        check(Link::Ready, Some(Stage::Starting), None, Doing::Starting);
        check(Link::Busy, Some(Stage::Recovering), None, Doing::Printing);
        check(Link::Busy, Some(Stage::Lost), None, Doing::Paused);
        check(Link::Ready, Some(Stage::Interrupted), None, Doing::Paused);
        check(Link::Connecting, Some(Stage::Interrupted), None, Doing::Connecting);
        check(Link::Busy, None, Some(Stage::Cancelled), Doing::Cancelling);
        check(Link::Busy, None, Some(Stage::Finished), Doing::Printing);
    }
}
