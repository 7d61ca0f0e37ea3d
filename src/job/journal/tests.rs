use super::*;
use crate::job::record::{Checkpoint, Numbers};
use crate::job::state::State;
use crate::job::storage::sim::{SimDisk, Trouble};
use proptest::prelude::*;
use std::path::PathBuf;

fn accepted(chunks: usize) -> Accepted {
    Accepted {
        path: PathBuf::from("/jobs/benchy.gcode"),
        digest: [7; 32],
        bytes: 1_000_000,
        commands: 30_000,
        last_line: 41_234,
        chunk_bytes: 65_536,
        chunks: (0..chunks).map(|n| [n as u8; 16]).collect(),
        profile: "ender-3".to_owned(),
        at_unix_s: 1_790_000_000,
        stamp: 99,
    }
}

fn checkpoint(commands: u64) -> Record {
    Record::Checkpoint(Checkpoint {
        commands,
        line: commands + 11,
        layer: (commands / 500) as u32,
        z_mm: 0.2 * (commands / 500) as f64,
        nozzle_c: [209.6, 210.0],
        bed_c: [60.1, 60.0],
    })
}

/// A job's life as a host writes it down: each item is what one sync promises.
fn life() -> Vec<Vec<Record>> {
    let state = |state| vec![Record::State(state)];
    let port = "usb:1A2B".to_owned();
    let mut life = vec![
        vec![Record::Opened { port, baud: 250_000, at_unix_s: 1_790_000_100 }],
        state(State::Starting),
        vec![Record::Numbers { first: 17, after: 0 }, Record::State(State::Printing)],
    ];
    for n in 1..12 {
        life.push(vec![checkpoint(n * 300)]);
        life.push((0..n % 4).map(|k| Record::Own { n: (17 + n * 303 + k) as u32 }).collect());
    }
    life.push(state(State::Pausing));
    life.push(vec![Record::Unnumbered { after: 3500 }, Record::State(State::Paused)]);
    life.push(vec![Record::Note("n".repeat(6000))]);
    life.push(state(State::Resuming));
    life.push(vec![Record::Numbers { first: 3700, after: 3500 }, Record::State(State::Printing)]);
    life.extend((8..14).map(|n| vec![checkpoint(n * 500), Record::Own { n: 3700 + n as u32 }]));
    life.push(state(State::Failing));
    life.push(vec![Record::MadeSafe { z_mm: Some(31.2) }, Record::State(State::Failed)]);
    life
}

/// What a journal promised, and the pictures that it may give after a crash.
struct Promises {
    /// The picture after each record; the first is that of the acceptance.
    pictures: Vec<Log>,
    /// Of these, the last that a sync promised; `None`: not even the acceptance.
    synced: Option<usize>,
}

/// Lives on from the picture after `from` records (`None`: not accepted yet) until the
/// life or the power ends. `compacts`: after every so many batches. A disk that merely
/// fails is tried again.
fn live(disk: &SimDisk, from: Option<usize>, compacts: usize, promises: &mut Promises) {
    let journal = match from {
        None => Journal::create(disk.clone(), accepted(3)),
        Some(_) => Journal::open(disk.clone()).map(|(journal, _)| journal),
    };
    // Another try is another run of the program.
    let Ok(mut journal) = journal else { return };
    let mut done = from.unwrap_or(0);
    promises.pictures.truncate(done);
    promises.pictures.push(journal.log().clone());
    promises.synced = Some(done);
    let mut passed = 0;
    for (n, batch) in life().iter().enumerate() {
        for record in batch {
            passed += 1;
            if passed > done {
                journal.append(record);
                promises.pictures.push(journal.log().clone());
                done = passed;
            }
        }
        let tries = if n % 5 == 4 { 1 } else { 3 };
        for _ in 0..tries {
            let synced = match n % compacts {
                0 => journal.compact(),
                _ => journal.sync(),
            };
            if synced.is_ok() {
                promises.synced = Some(done);
                break;
            }
        }
        if disk.is_cut() {
            return;
        }
    }
    let log = journal.log();
    assert_eq!(log.state, State::Failed, "it lived to its end");
}

/// Which of the promised pictures the disk holds.
fn survived(disk: &SimDisk, promises: &Promises, what: &str) -> Option<usize> {
    let Some(synced) = promises.synced else {
        // Not accepted: it may be there or not, but if so then whole.
        let picture = disk.bytes().map(|bytes| read(&bytes).expect(what))?;
        assert_eq!(picture.log, Log::new(accepted(3)), "{what}");
        return None;
    };
    let bytes = disk.bytes().expect(what);
    let picture = read(&bytes).expect(what);
    let cut = picture.cut;
    assert!(!cut.is_some_and(|cut| cut.middle), "{what}: a power cut is no damage: {cut:?}");
    let found = promises.pictures.iter().rposition(|log| *log == picture.log);
    let found = found.unwrap_or_else(|| panic!("{what}: a picture that never was: {:?}", picture.log));
    assert!(found >= synced, "{what}: promised {synced}, found {found}");
    Some(found)
}

fn operations(compacts: usize) -> u64 {
    let disk = SimDisk::new(0);
    let mut promises = Promises { pictures: Vec::new(), synced: None };
    live(&disk, None, compacts, &mut promises);
    assert_eq!(promises.synced, Some(promises.pictures.len() - 1));
    disk.counts().operations()
}

#[test]
fn nothing_promised_is_lost_whenever_the_power_goes() {
    for compacts in [1000, 7] {
        for at in 0..operations(compacts) {
            for seed in 0..12 {
                let what = format!("compacts {compacts}, cut at {at}, seed {seed}");
                let disk = SimDisk::new(seed * 1000 + at);
                disk.trouble_at(at, Trouble::Cut);
                let mut promises = Promises { pictures: Vec::new(), synced: None };
                live(&disk, None, compacts, &mut promises);
                assert!(disk.is_cut(), "{what}");
                disk.power_cycle();
                let found = survived(&disk, &promises, &what);
                // Another life upon what is left, and another cut in it: nothing of
                // the first may come back.
                let Some(found) = found else { continue };
                disk.trouble_at(disk.counts().operations() + seed % 6, Trouble::Cut);
                live(&disk, Some(found), compacts, &mut promises);
                disk.power_cycle();
                survived(&disk, &promises, &format!("{what}, again"));
            }
        }
    }
}

#[test]
fn a_disk_that_fails_once_breaks_no_promise() {
    for compacts in [1000, 7] {
        for at in 0..operations(compacts) {
            for seed in 0..8 {
                let what = format!("compacts {compacts}, fails at {at}, seed {seed}");
                let disk = SimDisk::new(seed * 1000 + at);
                disk.trouble_at(at, Trouble::Fail);
                // And the power goes some time after.
                disk.trouble_at(at + 1 + seed * seed, Trouble::Cut);
                let mut promises = Promises { pictures: Vec::new(), synced: None };
                live(&disk, None, compacts, &mut promises);
                disk.power_cycle();
                survived(&disk, &promises, &what);
            }
        }
    }
}

/// A failed sync must not be retried: the next one would succeed and prove nothing.
#[test]
fn a_failed_sync_is_followed_by_a_replacement() {
    let disk = SimDisk::new(1);
    let mut journal = Journal::create(disk.clone(), accepted(1)).unwrap();
    journal.append(&Record::State(State::Starting));
    disk.trouble_at(disk.counts().operations() + 1, Trouble::Fail);
    journal.sync().unwrap_err();
    assert!(journal.is_broken());
    let before = disk.counts();
    journal.append(&Record::Own { n: 1 });
    journal.sync().unwrap();
    assert_eq!(disk.counts().syncs, before.syncs);
    assert_eq!(disk.counts().replaces, before.replaces + 1);
    assert_eq!(read(&disk.bytes().unwrap()).unwrap().log, *journal.log());
}

#[test]
fn bytes_that_are_no_journal_are_told() {
    let check = |bytes: &[u8], expect: Unreadable| assert_eq!(read(bytes).unwrap_err(), expect);
    let disk = SimDisk::new(0);
    Journal::create(disk.clone(), accepted(2)).unwrap();
    let good = disk.bytes().unwrap();
    check(b"", Unreadable::NotAJournal);
    check(&good[..20], Unreadable::NotAJournal);
    check(&good[..24], Unreadable::NoPicture);
    check(&good[..100], Unreadable::NoPicture);
    let mut damaged = good.clone();
    damaged[50] ^= 1;
    check(&damaged, Unreadable::NoPicture);
    damaged[9] ^= 1;
    check(&damaged, Unreadable::NotAJournal);
    let mut newer = good.clone();
    newer[8] = 2;
    let sum = crc32fast::hash(&newer[..20]);
    newer[20..24].copy_from_slice(&sum.to_le_bytes());
    check(&newer, Unreadable::Version(2));
    assert!(matches!(Journal::open(SimDisk::new(0)), Err(JournalError::Missing)));
    let long = Accepted { path: PathBuf::from("x".repeat(5000)), ..accepted(1) };
    assert!(matches!(Journal::create(SimDisk::new(0), long), Err(JournalError::PathTooLong)));
}

/// The bytes of a journal with a few batches, and the pictures after each.
fn batches() -> (Vec<u8>, Vec<Log>) {
    let disk = SimDisk::new(0);
    let mut journal = Journal::create(disk.clone(), accepted(2)).unwrap();
    let mut pictures = vec![journal.log().clone()];
    for batch in life().iter().take(9).filter(|batch| !batch.is_empty()) {
        batch.iter().for_each(|record| journal.append(record));
        journal.sync().unwrap();
        pictures.push(journal.log().clone());
    }
    (disk.bytes().unwrap(), pictures)
}

#[test]
fn a_damaged_middle_is_told_from_a_torn_end() {
    let (good, pictures) = batches();
    let end = good.iter().rposition(|b| *b != 0).unwrap() + 1;
    assert!(end > PAGE_BYTES + 100, "what is appended is not on the picture's page");
    for at in PAGE_BYTES..end {
        let mut bytes = good.clone();
        bytes[at] ^= 0x10;
        let picture = read(&bytes).unwrap();
        let cut = picture.cut.expect("a batch is damaged");
        assert!(cut.at <= at as u64 && cut.at + cut.bytes == end as u64, "{at}: {cut:?}");
        if cut.middle {
            assert!(picture.log.damaged && picture.log.state == State::Interrupted, "{at}");
            assert_eq!(picture.log.numbers, Numbers::unknown(), "{at}");
        } else {
            assert_eq!(picture.log, pictures[pictures.len() - 2], "{at}: only the last batch is lost");
        }
    }
    for len in PAGE_BYTES..end {
        let picture = read(&good[..len]).unwrap();
        assert!(pictures.contains(&picture.log), "cut to {len}");
    }
}

/// The distrust outlives the next writing of the file.
#[test]
fn a_damaged_journal_stays_distrusted() {
    let (mut bytes, _) = batches();
    bytes[PAGE_BYTES + 9] ^= 1;
    let disk = SimDisk::with_file(bytes, 0);
    let (mut journal, cut) = Journal::open(disk.clone()).unwrap();
    assert!(cut.unwrap().middle);
    journal.append(&checkpoint(5));
    journal.sync().unwrap();
    let picture = read(&disk.bytes().unwrap()).unwrap();
    assert!(picture.cut.is_none() && picture.log.damaged);
}

/// A job of a day: the file stays small, and so does what is kept of numbers.
#[test]
fn a_long_job_stays_small() {
    let disk = SimDisk::new(0);
    let mut journal = Journal::create(disk.clone(), accepted(4096)).unwrap();
    journal.append(&Record::Numbers { first: 5, after: 0 });
    let (mut n, mut largest) = (5, 0);
    for step in 1..=17_280_u64 {
        // Every 5 s, with two questions in between.
        n += 512;
        journal.append(&Record::Own { n });
        journal.append(&Record::Own { n: n + 1 });
        n += 2;
        journal.append(&checkpoint(step * 512));
        journal.sync().unwrap();
        if step % 100 == 0 {
            largest = largest.max(disk.bytes().unwrap().len());
        }
    }
    assert!(largest < 400 * 1024, "{largest} bytes");
    let Numbers::Job { own, .. } = &journal.log().numbers else { panic!("numbers") };
    assert!(own.len() < 10, "{}", own.len());
    let counts = disk.counts();
    assert!(counts.replaces < 10 && counts.bytes < 6 << 20, "{counts:?}");
}

fn record() -> impl Strategy<Value = Record> {
    let heat = || any::<[f32; 2]>().prop_map(|[a, b]| [a.abs(), b.abs()]);
    prop_oneof![
        (".{0,20}", any::<u32>(), any::<u64>()).prop_map(|(port, baud, at_unix_s)| Record::Opened {
            port,
            baud,
            at_unix_s
        }),
        prop::sample::select(vec![State::Starting, State::Printing, State::Paused, State::Finished])
            .prop_map(Record::State),
        (0..50_000u32, 0..50_000u64).prop_map(|(first, after)| Record::Numbers { first, after }),
        (0..60_000u32).prop_map(|n| Record::Own { n }),
        any::<u64>().prop_map(|after| Record::Unnumbered { after }),
        (0..60_000u64, any::<u32>(), any::<i32>(), heat(), heat()).prop_map(
            |(commands, layer, z, nozzle_c, bed_c)| Record::Checkpoint(Checkpoint {
                commands,
                line: commands,
                layer,
                z_mm: f64::from(z) / 1000.0,
                nozzle_c,
                bed_c,
            })
        ),
        any::<Option<i32>>().prop_map(|z| Record::MadeSafe { z_mm: z.map(f64::from) }),
        any::<u32>().prop_map(Record::Depth),
        ".{0,40}".prop_map(Record::Note),
    ]
}

proptest! {
    /// However records are put into batches, compacted and opened again, they add up to
    /// the same.
    #[test]
    fn records_add_up(records in prop::collection::vec((record(), 0..6u8), 0..60)) {
        let disk = SimDisk::new(0);
        let mut journal = Journal::create(disk.clone(), accepted(2)).unwrap();
        let mut log = journal.log().clone();
        for (record, then) in &records {
            log.apply(record);
            journal.append(record);
            match then {
                0 => journal.sync().unwrap(),
                1 => journal.compact().unwrap(),
                2 => {
                    journal.sync().unwrap();
                    let (again, cut) = Journal::open(disk.clone()).unwrap();
                    prop_assert_eq!(cut, None);
                    journal = again;
                }
                _ => {}
            }
        }
        journal.sync().unwrap();
        let picture = read(&disk.bytes().unwrap()).unwrap();
        // As text: a NaN is equal to itself there.
        prop_assert_eq!(format!("{:?}", picture.log), format!("{log:?}"));
        prop_assert_eq!(picture.cut, None);
    }

    #[test]
    fn no_bytes_panic(bytes: Vec<u8>, at: prop::sample::Index, with: Vec<u8>) {
        let _ = read(&bytes);
        let (mut good, pictures) = batches();
        let at = at.index(good.len());
        for (place, byte) in good[at..].iter_mut().zip(&with) {
            *place = *byte;
        }
        if let Ok(picture) = read(&good) {
            prop_assert!(picture.log.damaged || pictures.contains(&picture.log));
        }
    }
}
