//! The journal: any bytes give a picture or words, and a picture that was read can be
//! written, read again, and lived on with.
//!
//! Takes the fuzzer's bytes twice: as a file as it is, and as changes to a good one, whose
//! checksums are mended, so that the decoder behind them sees all kinds of payloads.
//! Fails by panic.
#![no_main]
use libfuzzer_sys::fuzz_target;
use outrigger::job::journal::{Journal, MAGIC, read};
use outrigger::job::record::{Checkpoint, Log, Record};
use outrigger::job::storage::sim::SimDisk;

fuzz_target!(|data: &[u8]| {
    look(data.to_vec());
    look(framed(data));
});

/// What is read is written, and is the same when it is read again.
fn look(bytes: Vec<u8>) {
    let Ok(picture) = read(&bytes) else { return };
    let disk = SimDisk::with_file(bytes, 0);
    let (mut journal, cut) = Journal::open(disk.clone()).expect("what can be read can be opened");
    assert_eq!(cut, picture.cut);
    assert_eq!(text(journal.log()), text(&picture.log));
    journal.append(&Record::Own { n: 7 });
    journal.append(&Record::Checkpoint(Checkpoint { commands: 9, ..Checkpoint::default() }));
    journal.sync().expect("a disk in memory");
    let again = read(&disk.bytes().expect("a file")).expect("what was written can be read");
    assert_eq!(again.cut, None);
    assert_eq!(text(&again.log), text(journal.log()));
}

/// A NaN equals itself as text.
fn text(log: &Log) -> String {
    format!("{log:?}")
}

/// The bytes as payloads, each after its length (u16), framed as a journal frames them.
fn framed(mut data: &[u8]) -> Vec<u8> {
    let mut file = MAGIC.to_vec();
    file.extend_from_slice(&[1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8]);
    let sum = crc32fast::hash(&file);
    file.extend_from_slice(&sum.to_le_bytes());
    while let Some((len, rest)) = data.split_first_chunk::<2>() {
        let len = usize::from(u16::from_le_bytes(*len)).min(rest.len());
        let (payload, rest) = rest.split_at(len);
        let mut summed = file[12..20].to_vec();
        summed.extend_from_slice(&(file.len() as u32).to_le_bytes());
        summed.extend_from_slice(&(len as u32).to_le_bytes());
        file.extend_from_slice(&(len as u32).to_le_bytes());
        summed.extend_from_slice(payload);
        file.extend_from_slice(&crc32fast::hash(&summed).to_le_bytes());
        file.extend_from_slice(payload);
        data = rest;
    }
    file
}
