//! The journal on a simulated medium: records become durable after a while, or not at all.
//!
//! Takes records as the host gives them, in batches as the program's writer does: all that
//! wait, one sync. Gives how many are durable, and what a later process reads back. The journal
//! and the medium are the project's own; only their time is made here.
use outrigger::job::journal::Journal;
use outrigger::job::record::{Accepted, Log, Record};
use outrigger::job::storage::sim::{SimDisk, Trouble};
use std::collections::VecDeque;

/// From a failed write to the next try, ns: as the program's writer does.
const RETRY_NS: u64 = 2_000_000_000;

/// What the disk is like.
#[derive(Debug, Clone, Copy)]
pub struct DiskPlan {
    /// Time of a write and its sync, ns.
    pub sync_ns: u64,
}

/// The medium, and the writer before it.
#[derive(Debug)]
pub struct Disk {
    medium: SimDisk,
    journal: Option<Journal<SimDisk>>,
    sync_ns: u64,
    fails_until_ns: u64,
    waiting: VecDeque<Record>,
    /// Records being written, and when their sync returns.
    writing: Option<(Vec<Record>, u64)>,
    /// Records of this process that are durable.
    durable: u64,
}

/// What came of a write.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Synced {
    /// So many records of this process are durable.
    Durable(u64),
    /// The medium refuses; it is tried again.
    Refused,
}

impl Disk {
    /// A medium on which the job has just been accepted.
    pub fn new(plan: DiskPlan, accepted: Accepted, seed: u64) -> Self {
        let medium = SimDisk::new(seed);
        // An empty medium without trouble takes the job.
        let journal = Journal::create(medium.clone(), accepted).ok();
        Self {
            medium,
            journal,
            sync_ns: plan.sync_ns,
            fails_until_ns: 0,
            waiting: VecDeque::new(),
            writing: None,
            durable: 0,
        }
    }

    /// Every sync takes so long from now on.
    pub fn slow(&mut self, sync_ns: u64) {
        self.sync_ns = sync_ns;
    }

    /// Every write fails until then.
    pub fn fail(&mut self, until_ns: u64) {
        self.fails_until_ns = until_ns;
    }

    /// What a process that opens the port writes first; it waits for it. The job as the
    /// journal has it.
    pub fn open(&mut self, opened: &Record) -> Option<Log> {
        if self.journal.is_none() {
            self.journal = Journal::open(self.medium.clone()).ok().map(|(journal, _)| journal);
        }
        let journal = self.journal.as_mut()?;
        let log = journal.log().clone();
        journal.append(opened);
        // Where this fails, the next write of this process puts all of it there.
        let _ = journal.sync();
        Some(log)
    }

    /// A record of the host.
    pub fn append(&mut self, record: Record) {
        self.waiting.push_back(record);
    }

    /// Begins to write what waits. Call when something was appended.
    pub fn begin(&mut self, now_ns: u64) {
        if self.writing.is_none() && !self.waiting.is_empty() {
            self.writing = Some((self.waiting.drain(..).collect(), now_ns + self.sync_ns));
        }
    }

    /// When a sync returns.
    pub fn next_ns(&self) -> Option<u64> {
        self.writing.as_ref().map(|(_, at_ns)| *at_ns)
    }

    /// What a write came to, once it is over.
    pub fn synced(&mut self, now_ns: u64) -> Option<Synced> {
        let (records, _) = self.writing.take_if(|(_, at_ns)| *at_ns <= now_ns)?;
        let count = records.len() as u64;
        if self.put(&records, now_ns < self.fails_until_ns) {
            self.durable += count;
            self.begin(now_ns);
            return Some(Synced::Durable(self.durable));
        }
        // They are in the journal's picture, which the next try writes.
        self.durable += count;
        self.writing = Some((Vec::new(), now_ns + RETRY_NS));
        Some(Synced::Refused)
    }

    fn put(&mut self, records: &[Record], fails: bool) -> bool {
        let Some(journal) = &mut self.journal else {
            return false;
        };
        if fails {
            self.medium.trouble_next(Trouble::Fail);
        }
        records.iter().for_each(|record| journal.append(record));
        journal.sync().is_ok()
    }

    /// The process is killed: of what was being written, some is there.
    pub fn process_dies(&mut self, survive: impl FnOnce(usize) -> usize) {
        if let Some((records, _)) = self.writing.take() {
            let there = survive(records.len());
            self.put(&records[..there], false);
        }
        self.journal = None;
        self.waiting.clear();
        self.durable = 0;
    }

    /// A process ends by itself, after a last try to write what waits.
    pub fn process_ends(&mut self, now_ns: u64) {
        let mut records = self.writing.take().map(|(records, _)| records).unwrap_or_default();
        records.extend(self.waiting.drain(..));
        self.put(&records, now_ns < self.fails_until_ns);
        self.journal = None;
        self.durable = 0;
    }
}
