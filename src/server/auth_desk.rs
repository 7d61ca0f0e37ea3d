//! Users and keys between their rules ([`auth`](super::auth)), the clock and the disk.
//!
//! Takes requests' words; gives [`Who`]. What changes is written to `auth.json` before it is
//! acknowledged, by a blocking thread, one after the other; what another process has written there
//! (`outrigger user add`) is read anew.
use super::auth::{Auth, Kept, Source};
use super::problem::Problem;
use super::shelf::{read_text, write_text};
use crate::causes;
use crate::job::disk::stamp;
use crate::station::now_unix_s;
use anyhow::Context;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;
use tokio::sync::watch;

/// See the module's text.
pub(crate) struct AuthDesk {
    path: PathBuf,
    auth: Mutex<Auth>,
    /// One change after the other.
    turn: tokio::sync::Mutex<()>,
    /// One write after the other; in it what the file looked like when it was last read or written.
    seen: tokio::sync::Mutex<u64>,
    started: Instant,
    /// Whether there is a user: then more than the loopback is listened on.
    has_users: watch::Sender<bool>,
}

impl AuthDesk {
    /// Reads users and keys.
    ///
    /// # Errors
    /// The file is there and cannot be used: nobody is let in by a damaged one.
    pub(crate) fn open(path: &Path) -> anyhow::Result<Self> {
        let kept = match read_text(path)? {
            Some(text) => Kept::from_json(&text).with_context(|| path.display().to_string())?,
            None => Kept::default(),
        };
        let auth = Auth::new(kept);
        let has_users = watch::channel(!auth.needs_first_user()).0;
        Ok(Self {
            path: path.to_owned(),
            auth: Mutex::new(auth),
            turn: tokio::sync::Mutex::default(),
            seen: tokio::sync::Mutex::new(stamp_of(path)),
            started: Instant::now(),
            has_users,
        })
    }

    fn lock(&self) -> MutexGuard<'_, Auth> {
        // Lists that are changed whole: nothing a panic could leave half-way.
        self.auth.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Does something with the rules; nothing in it may wait.
    pub(crate) fn with<T>(&self, this: impl FnOnce(&mut Auth, u64) -> T) -> T {
        this(&mut self.lock(), now_unix_s())
    }

    /// Milliseconds of a clock that nobody sets.
    pub(crate) fn now_ms(&self) -> u64 {
        u64::try_from(self.started.elapsed().as_millis()).unwrap_or(u64::MAX)
    }

    /// Counts a request.
    ///
    /// # Errors
    /// Too many.
    pub(crate) fn admit(&self, source: Source) -> Result<(), Problem> {
        let now_ms = self.now_ms();
        self.lock().admit(source, now_ms).map_err(|limited| Problem::rate_limited(limited.retry_after_s))
    }

    /// Whether there is a user, now and whenever that changes.
    pub(crate) fn has_users(&self) -> watch::Receiver<bool> {
        self.has_users.subscribe()
    }

    /// Changes users or keys: what cannot be written down has not happened.
    ///
    /// # Errors
    /// The change's own, or the disk's.
    pub(crate) async fn change<T, E: Into<Problem>>(
        &self,
        change: impl FnOnce(&mut Auth, u64) -> Result<T, E>,
    ) -> Result<T, Problem> {
        // One change after the other: between this and the writing nobody else's goes lost.
        let _turn = self.turn.lock().await;
        let (before, done) = {
            let mut auth = self.lock();
            (auth.kept().clone(), change(&mut auth, now_unix_s()))
        };
        let done = done.map_err(Into::into)?;
        if let Err(problem) = self.keep().await {
            self.lock().reload(before);
            return Err(problem);
        }
        Ok(done)
    }

    /// Writes down what has changed, if anything has.
    ///
    /// # Errors
    /// The disk refuses; it is tried again with the next change.
    pub(crate) async fn keep(&self) -> Result<(), Problem> {
        let mut seen = self.seen.lock().await;
        let Some(kept) = self.lock().take_change() else { return Ok(()) };
        let path = self.path.clone();
        let text = kept.to_json().map_err(|e| Problem::internal(e.to_string()))?;
        let written = tokio::task::spawn_blocking(move || {
            write_text(&path, &text)?;
            Ok::<_, super::shelf::ShelfError>(stamp_of(&path))
        })
        .await;
        match written {
            Ok(Ok(stamp)) => *seen = stamp,
            Ok(Err(why)) => {
                self.lock().change_not_kept();
                return Err(Problem::from(super::foreman::Refusal::Shelf(why)));
            }
            Err(_) => {
                self.lock().change_not_kept();
                return Err(Problem::internal("the thread that writes users and keys is gone"));
            }
        }
        self.tell();
        Ok(())
    }

    fn tell(&self) {
        let has = !self.lock().needs_first_user();
        self.has_users.send_if_modified(|now| std::mem::replace(now, has) != has);
    }

    /// Reads the file anew if somebody else has written it. Called now and then.
    pub(crate) async fn look(&self) {
        let mut seen = self.seen.lock().await;
        let path = self.path.clone();
        let was = *seen;
        let read = tokio::task::spawn_blocking(move || {
            let now = stamp_of(&path);
            let read = || -> anyhow::Result<Kept> {
                Ok(read_text(&path)?.map(|text| Kept::from_json(&text)).transpose()?.unwrap_or_default())
            };
            (now != was).then(|| (now, read()))
        })
        .await;
        match read {
            Ok(Some((now, Ok(kept)))) => {
                *seen = now;
                self.lock().reload(kept);
                tracing::info!("users and keys were changed by another process");
            }
            Ok(Some((now, Err(why)))) => {
                *seen = now;
                tracing::error!("{}; users and keys stay as they were", causes::line(&why));
            }
            Ok(None) | Err(_) => return,
        }
        drop(seen);
        self.tell();
    }
}

fn stamp_of(path: &Path) -> u64 {
    std::fs::metadata(path).map_or(0, |meta| stamp(&meta))
}
