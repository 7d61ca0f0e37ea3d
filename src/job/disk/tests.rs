use super::*;
use crate::job::record::Record;
use std::collections::HashMap;

fn job(name: &str) -> Accepted {
    Accepted {
        path: PathBuf::from(name),
        digest: [name.len() as u8; 32],
        bytes: 10,
        commands: 3,
        profile: "ender-3".to_owned(),
        stamp: 5,
        ..Accepted::default()
    }
}

fn store() -> (tempfile::TempDir, Store) {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(&folder.path().join("a/state")).unwrap();
    (folder, store)
}

/// Accepts a job and writes states down.
fn lived(store: &Store, name: &str, states: &[State]) -> JobId {
    let mut held = store.accept(&job(name)).unwrap();
    held.journal.append(&Record::Opened { port: "/dev/ttyUSB0".to_owned(), baud: 115_200, at_unix_s: 1 });
    states.iter().for_each(|state| held.journal.append(&Record::State(*state)));
    held.journal.sync().unwrap();
    held.id
}

fn state(store: &Store, id: JobId) -> State {
    store.look(id).unwrap().picture.unwrap().log.state
}

#[test]
fn the_folder_is_where_it_is_said() {
    let check = |named: Option<&str>, variables: &[(&str, &str)], expect: &str| {
        let variables: HashMap<_, _> = variables.iter().copied().collect();
        let found = folder(named.map(Path::new), |name| variables.get(name).map(OsString::from));
        assert_eq!(found.map_or(String::new(), |f| f.display().to_string()), expect, "{variables:?}");
    };
    let all = [
        ("OUTRIGGER_STATE", "/own"),
        ("STATE_DIRECTORY", "/var/lib/outrigger:/var/lib/other"),
        ("XDG_STATE_HOME", "/xdg"),
        ("HOME", "/home/me"),
    ];
    check(Some("here"), &all, "here");
    check(None, &all, "/own");
    check(None, &all[1..], "/var/lib/outrigger");
    check(None, &all[2..], "/xdg/outrigger");
    check(None, &all[3..], "/home/me/.local/state/outrigger");
    check(
        None,
        &[("OUTRIGGER_STATE", ""), ("XDG_STATE_HOME", "not/absolute"), ("HOME", "/h")],
        "/h/.local/state/outrigger",
    );
    check(None, &[], "");
}

#[test]
fn jobs_are_accepted_numbered_and_found_again() {
    let (_folder, store) = store();
    let first = lived(&store, "/a.gcode", &[State::Printing]);
    let second = lived(&store, "/bb.gcode", &[State::Printing, State::Finished]);
    assert_eq!((first, second), (1, 2));
    let entries = store.list().unwrap();
    assert_eq!(entries.iter().map(|e| (e.id, e.live)).collect::<Vec<_>>(), [(1, false), (2, false)]);
    assert_eq!(state(&store, 1), State::Printing);
    // A number is never given twice, even if its job is forgotten.
    store.forget(2, false).unwrap();
    assert_eq!(lived(&store, "/c.gcode", &[]), 3);
    std::fs::remove_file(store.path().join("next-id")).unwrap();
    assert_eq!(lived(&store, "/d.gcode", &[]), 4);
    std::fs::write(store.path().join("next-id"), "many").unwrap();
    assert_eq!(lived(&store, "/e.gcode", &[]), 5);
    std::fs::write(store.path().join("next-id"), "4294967295").unwrap();
    assert!(matches!(store.accept(&job("/f")), Err(StoreError::NoNumber(_))));
}

#[test]
fn one_host_holds_a_job() {
    let (_folder, store) = store();
    let held = store.accept(&job("/a.gcode")).unwrap();
    let id = held.id;
    assert!(store.look(id).unwrap().live);
    assert!(matches!(store.hold_job(id), Err(StoreError::Busy(1))));
    assert!(matches!(store.forget(id, true), Err(StoreError::Busy(1))));
    drop(held);
    assert!(!store.look(id).unwrap().live);
    assert_eq!(store.hold_job(id).unwrap().journal.log().accepted, job("/a.gcode"));
    assert!(matches!(store.hold_job(9), Err(StoreError::NoJob(9))));
    assert!(matches!(store.look(9), Err(StoreError::NoJob(9))));
    assert!(!store.lock_path(9).exists(), "no lock is made for a job that is not there");
}

#[test]
fn a_job_that_never_began_is_taken_again() {
    let (_folder, store) = store();
    let held = store.accept(&job("/a.gcode")).unwrap();
    // Not while another has it.
    assert_eq!(store.accept(&job("/a.gcode")).unwrap().id, 2);
    drop(held);
    assert_eq!(store.accept(&job("/bb.gcode")).unwrap().id, 3);
    assert_eq!(store.accept(&job("/a.gcode")).unwrap().id, 2);
    store.forget(2, false).unwrap();
    let mut held = store.accept(&job("/a.gcode")).unwrap();
    assert_eq!(held.id, 1);
    held.journal.append(&Record::Opened { port: "p".to_owned(), baud: 1, at_unix_s: 1 });
    held.journal.sync().unwrap();
    drop(held);
    // Once a port was opened for it, it is another job.
    assert_eq!(store.accept(&job("/a.gcode")).unwrap().id, 4);
}

#[test]
fn what_is_known_of_a_file_needs_no_second_sum() {
    let (_folder, store) = store();
    lived(&store, "/a.gcode", &[State::Finished]);
    let known = |path: &str, stamp, profile| store.known(Path::new(path), stamp, profile).unwrap();
    assert_eq!(known("/a.gcode", 5, "ender-3"), Some(job("/a.gcode")));
    assert_eq!(known("/a.gcode", 6, "ender-3"), None);
    assert_eq!(known("/a.gcode", 5, "prusa-mk3s"), None);
    assert_eq!(known("/b.gcode", 5, "ender-3"), None);
    assert_eq!(known("/a.gcode", 0, "ender-3"), None);
}

#[test]
fn a_file_that_is_written_to_has_another_stamp() {
    let file = tempfile::NamedTempFile::new().unwrap();
    let now = || stamp(&file.path().metadata().unwrap());
    std::fs::write(file.path(), "G28\n").unwrap();
    let before = now();
    assert_eq!(before, now());
    std::fs::write(file.path(), "G28 X\n").unwrap();
    assert_ne!(before, now());
}

#[test]
fn forgetting_needs_a_word_where_something_could_be_lost() {
    let (_folder, store) = store();
    let check = |name: &str, states: &[State], easy: bool| {
        let id = lived(&store, name, states);
        let forgot = store.forget(id, false);
        assert_eq!(forgot.is_ok(), easy, "{states:?}");
        if !easy {
            assert!(matches!(forgot, Err(StoreError::Interrupted(_))));
            store.forget(id, true).unwrap();
        }
        assert!(matches!(store.forget(id, true), Err(StoreError::NoJob(_))));
        assert!(!store.lock_path(id).exists());
    };
    check("/a", &[State::Finished], true);
    check("/b", &[State::Failed], true);
    check("/c", &[State::Cancelled], true);
    check("/d", &[State::Printing], false);
    check("/e", &[State::Interrupted], false);
    check("/f", &[State::Accepted], false);
    drop(store.accept(&job("/g")).unwrap());
    store.forget(7, false).unwrap();
}

#[test]
fn a_damaged_journal_is_shown_and_never_dropped() {
    let (_folder, store) = store();
    let id = lived(&store, "/a.gcode", &[State::Finished]);
    std::fs::write(store.journal_path(id), b"noise").unwrap();
    let entries = store.list().unwrap();
    assert!(matches!(entries[0].picture, Err(JournalError::Unreadable(_))));
    assert!(matches!(store.hold_job(id), Err(StoreError::Journal { id: 1, .. })));
    assert!(matches!(store.forget(id, false), Err(StoreError::Interrupted(1))));
    std::fs::write(store.journal_path(id), vec![0; MAX_JOURNAL_BYTES + 1]).unwrap();
    assert!(matches!(store.list().unwrap()[0].picture, Err(JournalError::Medium { .. })));
    store.forget(id, true).unwrap();
    assert!(store.list().unwrap().is_empty());
}

#[test]
fn the_oldest_jobs_that_are_over_give_way() {
    let (_folder, store) = store();
    let interrupted = lived(&store, "/kept", &[State::Printing]);
    for n in 0..MAX_OVER {
        lived(&store, &format!("/{n}"), &[State::Finished]);
    }
    assert_eq!(store.list().unwrap().len(), MAX_OVER + 1);
    // A host that has not let go yet keeps its job.
    let held = store.hold_job(2).unwrap();
    lived(&store, "/one more", &[State::Finished]);
    let kept = |gone: JobId| {
        let ids: Vec<JobId> = store.list().unwrap().iter().map(|e| e.id).collect();
        assert!(ids.contains(&interrupted) && !ids.contains(&gone), "{ids:?}");
        ids.contains(&2)
    };
    lived(&store, "/and one", &[State::Finished]);
    assert!(kept(3));
    drop(held);
    lived(&store, "/and another", &[State::Finished]);
    assert!(!kept(3));
}

#[test]
fn strangers_files_are_left_alone() {
    let (_folder, store) = store();
    for name in ["readme", "x.journal", "01.journal", "+1.journal", "0.journal", "7.journal.bak", ".journal"]
    {
        std::fs::write(store.jobs().join(name), "mine").unwrap();
    }
    assert!(store.list().unwrap().is_empty());
    assert_eq!(lived(&store, "/a", &[]), 1);
    assert!(store.jobs().join("x.journal").exists());
}

/// A real file keeps the same promises as the simulated disk, as far as can be seen
/// without cutting the power.
#[test]
fn a_file_is_a_storage() {
    let folder = tempfile::tempdir().unwrap();
    let mut storage = FileStorage::new(folder.path().join("1.journal"));
    assert_eq!(storage.read(100).unwrap(), None);
    assert!(storage.write(0, b"x").is_err(), "only a replacement makes a file");
    storage.replace(b"0123456789").unwrap();
    storage.write(4, b"abcd").unwrap();
    storage.write(10, b"ef").unwrap();
    storage.sync().unwrap();
    assert_eq!(storage.read(100).unwrap().unwrap(), b"0123abcd89ef");
    assert!(storage.read(11).is_err());
    storage.replace(b"new").unwrap();
    storage.write(3, b"er").unwrap();
    assert_eq!(storage.read(5).unwrap().unwrap(), b"newer");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file stays");
}
