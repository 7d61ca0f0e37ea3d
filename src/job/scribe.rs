//! The thread that writes a job's records down, so that a slow disk holds up nothing.
//!
//! Takes records in order, appends all that wait, syncs once for all of them, and tells
//! how many are kept. A medium that refuses is tried again and again;
//! nothing is left out. Knows no host and no port.
use super::disk::HeldJob;
use super::record::Record;
use super::run::Mail;
use std::io;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::mpsc;

/// Between two tries of a medium that refuses: soon enough for one who has just made room.
const RETRY: Duration = Duration::from_secs(2);

/// Where records go.
pub trait Keep: Send + 'static {
    /// Takes a record; it is kept only after a [`Keep::sync`].
    fn append(&mut self, record: &Record);

    /// Returns once all that was appended is on the medium.
    ///
    /// # Errors
    /// The medium's, in words. Called again until it succeeds; nothing is appended anew.
    fn sync(&mut self) -> Result<(), String>;
}

impl Keep for HeldJob {
    fn append(&mut self, record: &Record) {
        self.journal.append(record);
    }

    fn sync(&mut self) -> Result<(), String> {
        self.journal.sync().map_err(|e| e.to_string())
    }
}

/// The thread's handle. Dropped, the thread ends after what it was given.
#[derive(Debug)]
pub struct Scribe {
    desk: Arc<Desk>,
}

#[derive(Debug, Default)]
struct Desk {
    tray: Mutex<Tray>,
    filled: Condvar,
}

#[derive(Debug, Default)]
struct Tray {
    waiting: Vec<Record>,
    closed: bool,
}

impl Desk {
    fn lock(&self) -> MutexGuard<'_, Tray> {
        // A list of records has no invariant that a panic could break half-way.
        self.tray.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Scribe {
    /// Starts the thread. What is kept is told by `tell`.
    ///
    /// # Errors
    /// The system has no thread left.
    pub fn start(keep: impl Keep, tell: mpsc::Sender<Mail>) -> io::Result<Self> {
        Self::with_retry(keep, tell, RETRY)
    }

    fn with_retry(keep: impl Keep, tell: mpsc::Sender<Mail>, retry: Duration) -> io::Result<Self> {
        let desk = Arc::<Desk>::default();
        let own = Arc::clone(&desk);
        std::thread::Builder::new()
            .name("journal".to_owned())
            .spawn(move || write_all(keep, &own, &tell, retry))?;
        Ok(Self { desk })
    }

    /// One more record.
    pub fn write(&self, record: Record) {
        self.desk.lock().waiting.push(record);
        self.desk.filled.notify_one();
    }
}

impl Drop for Scribe {
    fn drop(&mut self) {
        self.desk.lock().closed = true;
        self.desk.filled.notify_one();
    }
}

fn write_all(mut keep: impl Keep, desk: &Desk, tell: &mpsc::Sender<Mail>, retry: Duration) {
    let mut kept = 0_u64;
    loop {
        let batch = {
            let mut tray = desk.lock();
            while tray.waiting.is_empty() && !tray.closed {
                tray = desk.filled.wait(tray).unwrap_or_else(PoisonError::into_inner);
            }
            if tray.waiting.is_empty() {
                return;
            }
            std::mem::take(&mut tray.waiting)
        };
        batch.iter().for_each(|record| keep.append(record));
        while let Err(reason) = keep.sync() {
            // Nobody is left who would wait for it.
            if desk.lock().closed || tell.blocking_send(Mail::Unkept(reason)).is_err() {
                return;
            }
            let tray = desk.lock();
            drop(desk.filled.wait_timeout_while(tray, retry, |t| !t.closed));
        }
        kept += batch.len() as u64;
        if tell.blocking_send(Mail::Kept(kept)).is_err() {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::job::run::mailbox;

    /// A medium that refuses the first so many syncs.
    struct Stubborn {
        refusals: usize,
        appended: Vec<Record>,
        shown: std::sync::mpsc::Sender<Vec<Record>>,
    }

    impl Keep for Stubborn {
        fn append(&mut self, record: &Record) {
            self.appended.push(record.clone());
        }

        fn sync(&mut self) -> Result<(), String> {
            if self.refusals > 0 {
                self.refusals -= 1;
                return Err("full".to_owned());
            }
            let _ = self.shown.send(self.appended.clone());
            Ok(())
        }
    }

    fn note(n: u32) -> Record {
        Record::Note(n.to_string())
    }

    /// Every record is kept once and in order, whatever the medium refuses; what is told
    /// as kept is what was synced.
    fn check(refusals: usize) {
        let (tell, mut told) = mailbox();
        let (shown, show) = std::sync::mpsc::channel();
        let keep = Stubborn { refusals, appended: Vec::new(), shown };
        let scribe = Scribe::with_retry(keep, tell, Duration::from_millis(1)).unwrap();
        for n in 0..10 {
            scribe.write(note(n));
        }
        let mut unkept = 0;
        let mut kept = 0;
        while kept < 10 {
            match told.blocking_recv().unwrap() {
                Mail::Kept(n) => {
                    assert!(n > kept);
                    kept = n;
                    assert_eq!(show.recv().unwrap().len() as u64, n);
                }
                Mail::Unkept(why) => {
                    assert_eq!(why, "full");
                    unkept += 1;
                }
                other => panic!("{other:?}"),
            }
        }
        assert_eq!(unkept, refusals);
        scribe.write(note(10));
        drop(scribe);
        assert_eq!(told.blocking_recv(), Some(Mail::Kept(11)));
        let all: Vec<_> = (0..11).map(note).collect();
        assert_eq!(show.recv().unwrap(), all);
        assert_eq!(told.blocking_recv(), None);
    }

    #[test]
    fn every_record_is_kept_once() {
        check(0);
    }

    #[test]
    fn a_medium_that_refuses_is_tried_again() {
        (1..20).for_each(check);
    }
}
