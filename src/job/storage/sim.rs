//! A medium in memory whose power can be cut: test support, used by our own tests and
//! by the simulator in `hil`.
//!
//! Takes what a [`Storage`] takes, counts it, and forgets at a power cut what a disk may
//! forget: of writes that no sync came after, any sectors, each of them whole, in part
//! or not; of a replacement that was not over, the old file or the new. Also fails
//! where it is told to. Owns no clock and no randomness but its seed.
use super::Storage;
use std::io;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A disk writes so many bytes at once or not at all; tears are made within them too.
pub const SECTOR_BYTES: usize = 512;

/// What was done to a disk so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Calls of [`Storage::write`].
    pub writes: u64,
    /// Calls of [`Storage::sync`].
    pub syncs: u64,
    /// Calls of [`Storage::replace`].
    pub replaces: u64,
    /// Bytes of all writes and replacements.
    pub bytes: u64,
    /// Pages of 4 KiB that syncs and replacements had to write: what a file system with
    /// such pages writes of the file itself.
    pub pages: u64,
}

impl Counts {
    /// Writes, syncs and replacements: the places where the power can be cut.
    pub fn operations(&self) -> u64 {
        self.writes + self.syncs + self.replaces
    }
}

/// What goes wrong at an operation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trouble {
    /// The power goes in the midst of it: it and all after it fail.
    Cut,
    /// It fails once. Of a write any part is done; after a failed sync nobody knows
    /// what is on the medium, and the next sync does not make it good; a replacement is
    /// or is not.
    Fail,
}

/// A file on a disk, and the disk's view of it. Clones are the same disk.
#[derive(Debug, Clone, Default)]
pub struct SimDisk(Arc<Mutex<Disk>>);

#[derive(Debug, Default)]
struct Disk {
    /// What is surely there.
    durable: Option<Vec<u8>>,
    /// What is there if the power goes now, or else.
    written: Vec<Write>,
    /// A file that was replaced without a sign that this is durable.
    uncertain: Option<Option<Vec<u8>>>,
    counts: Counts,
    troubles: Vec<(u64, Trouble)>,
    seed: u64,
    cut: bool,
}

#[derive(Debug)]
struct Write {
    offset: usize,
    bytes: Vec<u8>,
    /// A sync failed after it: no later sync makes it durable.
    lost_sync: bool,
}

impl SimDisk {
    /// An empty disk; `seed` decides what survives.
    pub fn new(seed: u64) -> Self {
        let disk = Self::default();
        disk.lock().seed = seed;
        disk
    }

    /// A disk with a file on it.
    pub fn with_file(bytes: Vec<u8>, seed: u64) -> Self {
        let disk = Self::new(seed);
        disk.lock().durable = Some(bytes);
        disk
    }

    /// Has the operation numbered `operation` (from 0) go wrong.
    pub fn trouble_at(&self, operation: u64, trouble: Trouble) {
        self.lock().troubles.push((operation, trouble));
    }

    /// Has the next operation go wrong.
    pub fn trouble_next(&self, trouble: Trouble) {
        let operation = self.counts().operations();
        self.trouble_at(operation, trouble);
    }

    /// What was done so far.
    pub fn counts(&self) -> Counts {
        self.lock().counts
    }

    /// Whether the power is cut.
    pub fn is_cut(&self) -> bool {
        self.lock().cut
    }

    /// The power goes, if it is not gone, and comes back: what was not durable is there
    /// or not, as the seed has it.
    pub fn power_cycle(&self) {
        self.lock().survive();
    }

    /// The file as a reader sees it now.
    pub fn bytes(&self) -> Option<Vec<u8>> {
        self.lock().view()
    }

    fn lock(&self) -> MutexGuard<'_, Disk> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Disk {
    /// splitmix64: any seed is a good one.
    fn random(&mut self) -> u64 {
        self.seed = self.seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.seed;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, limit: usize) -> usize {
        (self.random() % limit.max(1) as u64) as usize
    }

    /// The trouble of the operation that begins, which is counted by the caller after.
    fn begin(&mut self) -> io::Result<Option<Trouble>> {
        if self.cut {
            return Err(no_power());
        }
        let now = self.counts.operations();
        let at = self.troubles.iter().position(|(operation, _)| *operation == now);
        let trouble = at.map(|at| self.troubles.swap_remove(at).1);
        self.cut = trouble == Some(Trouble::Cut);
        Ok(trouble)
    }

    fn view(&self) -> Option<Vec<u8>> {
        let mut file = self.durable.clone();
        for write in &self.written {
            put(file.get_or_insert_default(), write.offset, &write.bytes);
        }
        file
    }

    fn pages(&mut self) {
        let mut pages: Vec<usize> = self
            .written
            .iter()
            .filter(|write| !write.bytes.is_empty() && !write.lost_sync)
            .flat_map(|write| write.offset / 4096..=(write.offset + write.bytes.len() - 1) / 4096)
            .collect();
        pages.sort_unstable();
        pages.dedup();
        self.counts.pages += pages.len() as u64;
    }

    fn survive(&mut self) {
        self.cut = false;
        if let Some(old) = self.uncertain.take()
            && self.below(2) == 0
        {
            // What was written since went to the file that is gone.
            self.durable = old;
            self.written.clear();
        }
        self.settle();
    }

    /// Decides which sectors of what was written are there.
    fn settle(&mut self) {
        for write in std::mem::take(&mut self.written) {
            let durable_len = self.durable.as_ref().map_or(0, Vec::len);
            let mut from = 0;
            while from < write.bytes.len() {
                let at = write.offset + from;
                let to = write.bytes.len().min(from + SECTOR_BYTES - at % SECTOR_BYTES);
                let sector = &write.bytes[from..to];
                match self.below(4) {
                    0 => {}
                    1 => {
                        let torn = self.below(sector.len() + 1);
                        put(self.durable.get_or_insert_default(), at, &sector[..torn]);
                    }
                    2 if at >= durable_len => {
                        // The file grew, and its sector was never written: anything.
                        let noise: Vec<u8> = sector.iter().map(|_| self.random() as u8).collect();
                        put(self.durable.get_or_insert_default(), at, &noise);
                    }
                    _ => put(self.durable.get_or_insert_default(), at, sector),
                }
                from = to;
            }
        }
    }
}

impl Storage for SimDisk {
    fn read(&mut self, max: usize) -> io::Result<Option<Vec<u8>>> {
        let disk = self.lock();
        if disk.cut {
            return Err(no_power());
        }
        match disk.view() {
            Some(bytes) if bytes.len() > max => Err(io::Error::other("larger than may be read")),
            file => Ok(file),
        }
    }

    fn write(&mut self, offset: u64, bytes: &[u8]) -> io::Result<()> {
        let mut disk = self.lock();
        let trouble = disk.begin()?;
        disk.counts.writes += 1;
        disk.counts.bytes += bytes.len() as u64;
        let done = match trouble {
            Some(Trouble::Fail) => disk.below(bytes.len() + 1),
            _ => bytes.len(),
        };
        let offset = usize::try_from(offset).map_err(io::Error::other)?;
        disk.written.push(Write { offset, bytes: bytes[..done].to_vec(), lost_sync: false });
        outcome(trouble)
    }

    fn sync(&mut self) -> io::Result<()> {
        let mut disk = self.lock();
        let trouble = disk.begin()?;
        disk.counts.syncs += 1;
        match trouble {
            None => {
                disk.pages();
                let (lost, good): (Vec<_>, Vec<_>) =
                    std::mem::take(&mut disk.written).into_iter().partition(|write| write.lost_sync);
                disk.written = lost;
                for write in good {
                    put(disk.durable.get_or_insert_default(), write.offset, &write.bytes);
                }
            }
            Some(Trouble::Fail) => disk.written.iter_mut().for_each(|write| write.lost_sync = true),
            Some(Trouble::Cut) => {}
        }
        outcome(trouble)
    }

    fn replace(&mut self, bytes: &[u8]) -> io::Result<()> {
        let mut disk = self.lock();
        let trouble = disk.begin()?;
        disk.counts.replaces += 1;
        disk.counts.bytes += bytes.len() as u64;
        disk.counts.pages += bytes.len().div_ceil(4096) as u64;
        let happens = trouble.is_none() || disk.below(2) == 0;
        if happens {
            disk.settle();
            let old = disk.durable.replace(bytes.to_vec());
            // An earlier replacement may be undone as well: the oldest file that may
            // come back is kept.
            disk.uncertain = trouble.map(|_| disk.uncertain.take().unwrap_or(old));
        }
        outcome(trouble)
    }
}

fn put(file: &mut Vec<u8>, offset: usize, bytes: &[u8]) {
    let end = offset + bytes.len();
    if file.len() < end {
        file.resize(end, 0);
    }
    file[offset..end].copy_from_slice(bytes);
}

fn outcome(trouble: Option<Trouble>) -> io::Result<()> {
    match trouble {
        None => Ok(()),
        Some(Trouble::Cut) => Err(no_power()),
        Some(Trouble::Fail) => Err(io::Error::other("the simulated disk fails")),
    }
}

fn no_power() -> io::Error {
    io::Error::other("the simulated power is cut")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_synced_stays_and_the_rest_may_go() {
        let mut outcomes = std::collections::BTreeSet::new();
        for seed in 0..200 {
            let mut disk = SimDisk::new(seed);
            disk.replace(b"0000").unwrap();
            disk.write(4, b"1111").unwrap();
            disk.sync().unwrap();
            disk.write(8, b"2222").unwrap();
            disk.trouble_next(Trouble::Cut);
            disk.sync().unwrap_err();
            disk.write(0, b"x").unwrap_err();
            disk.power_cycle();
            let bytes = disk.bytes().unwrap();
            assert!(bytes.starts_with(b"00001111"), "{seed}");
            outcomes.insert(bytes[8..].to_vec());
        }
        for expect in ["", "22", "2222"] {
            assert!(outcomes.contains(expect.as_bytes()), "{expect}");
        }
    }

    #[test]
    fn a_failed_sync_is_not_made_good_by_the_next() {
        let lost = (0..200).any(|seed| {
            let mut disk = SimDisk::with_file(vec![0; 4], seed);
            disk.write(0, b"1111").unwrap();
            disk.trouble_next(Trouble::Fail);
            disk.sync().unwrap_err();
            disk.sync().unwrap();
            assert_eq!(disk.bytes().unwrap(), b"1111", "it is still read back");
            disk.power_cycle();
            disk.bytes().unwrap() == vec![0; 4]
        });
        assert!(lost);
    }

    #[test]
    fn a_replacement_is_whole_or_not() {
        let mut outcomes = std::collections::BTreeSet::new();
        for seed in 0..50 {
            let mut disk = SimDisk::with_file(b"old".to_vec(), seed);
            disk.trouble_next(Trouble::Cut);
            disk.replace(b"new!").unwrap_err();
            disk.power_cycle();
            outcomes.insert(disk.bytes().unwrap());
        }
        assert_eq!(outcomes.into_iter().collect::<Vec<_>>(), [b"new!".to_vec(), b"old".to_vec()]);
    }
}
