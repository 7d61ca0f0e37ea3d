//! The journal's disk: records become durable after a while, or not at all.
//!
//! Takes records as the host gives them, in batches as the program's writer does: all that
//! wait, one sync. Gives how many are durable, and what a later process reads back.
use outrigger::job::record::Record;
use std::collections::VecDeque;

/// What the disk is like.
#[derive(Debug, Clone, Copy)]
pub struct DiskPlan {
    /// Time of a write and its sync, ns.
    pub sync_ns: u64,
}

/// The disk and the writer before it.
#[derive(Debug)]
pub struct Disk {
    sync_ns: u64,
    fails_until_ns: u64,
    waiting: VecDeque<Record>,
    /// Records being written, and when their sync returns.
    writing: Option<(Vec<Record>, u64)>,
    kept: Vec<Record>,
    /// Records of this process that are durable.
    durable: u64,
}

impl Disk {
    /// An empty journal.
    pub fn new(plan: DiskPlan) -> Self {
        Self {
            sync_ns: plan.sync_ns,
            fails_until_ns: 0,
            waiting: VecDeque::new(),
            writing: None,
            kept: Vec::new(),
            durable: 0,
        }
    }

    /// Every sync takes so long from now on.
    pub fn slow(&mut self, sync_ns: u64) {
        self.sync_ns = sync_ns;
    }

    /// Nothing is written until then.
    pub fn fail(&mut self, until_ns: u64) {
        self.fails_until_ns = until_ns;
    }

    /// A record of the host.
    pub fn append(&mut self, record: Record) {
        self.waiting.push_back(record);
    }

    /// Begins to write what waits. Call when something was appended.
    pub fn begin(&mut self, now_ns: u64) {
        if self.writing.is_none() && !self.waiting.is_empty() {
            let at_ns = (now_ns + self.sync_ns).max(self.fails_until_ns);
            self.writing = Some((self.waiting.drain(..).collect(), at_ns));
        }
    }

    /// When a sync returns.
    pub fn next_ns(&self) -> Option<u64> {
        self.writing.as_ref().map(|(_, at_ns)| *at_ns)
    }

    /// How many records of this process are durable, when that has changed.
    pub fn synced(&mut self, now_ns: u64) -> Option<u64> {
        if self.next_ns().is_none_or(|at_ns| at_ns > now_ns) {
            return None;
        }
        let (records, _) = self.writing.take()?;
        self.durable += records.len() as u64;
        self.kept.extend(records);
        self.begin(now_ns);
        Some(self.durable)
    }

    /// The process is killed: what was being written is there in part.
    pub fn process_dies(&mut self, survive: impl FnOnce(usize) -> usize) {
        if let Some((mut records, _)) = self.writing.take() {
            records.truncate(survive(records.len()));
            self.kept.extend(records);
        }
        self.waiting.clear();
        self.durable = 0;
    }

    /// What a new process reads.
    pub fn kept(&self) -> &[Record] {
        &self.kept
    }
}
