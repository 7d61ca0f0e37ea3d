//! `post` on real jobs with lines lost, doubled, swapped, damaged and put in.
//!
//! Whatever comes of it: no panic, and a job that is changed deposits what it
//! deposited before, by the oracle in `common`. The verifier may refuse; the pass
//! may not need it to on most jobs.
mod common;

use common::{corpus, same_deposits};
use outrigger::post::{Options, post};
use proptest::prelude::*;
use std::io::Cursor;

const JOBS: [&str; 6] = [
    "ps25-marlin-rel-triangles.gcode",
    "ps25-marlin-abs-grid.gcode",
    "ps25-marlin-wipe-zhop-honeycomb.gcode",
    "ps25-marlin2-fwretract-rectilinear.gcode",
    "cura413-marlin-zhop-triangles.gcode",
    "remarked-orca.gcode",
];

/// Lines that a person or a plug-in may put anywhere.
const ODD: [&str; 24] = [
    "G91",
    "G90",
    "M82",
    "M83",
    "G92 E0",
    "G92 E5",
    "G1 E1",
    "G1 E-1",
    "G1 Z5",
    "G1 F600",
    "G10",
    "G11",
    "T1",
    "M106 S50",
    "M107",
    "M204 S500",
    "M204 P500 T900",
    ";TYPE:Perimeter",
    ";TYPE:Internal infill",
    ";LAYER_CHANGE",
    "; a note",
    "M600",
    "G1 X10 Y10 E1",
    "G4 P100",
];

#[derive(Clone, Copy, Debug)]
enum Edit {
    Lose,
    Double,
    Swap(usize),
    Put(usize),
    Damage(u8),
}

fn edit() -> impl Strategy<Value = Edit> {
    prop_oneof![
        Just(Edit::Lose),
        Just(Edit::Double),
        (0usize..50).prop_map(Edit::Swap),
        (0..ODD.len()).prop_map(Edit::Put),
        (b' '..b'~').prop_map(Edit::Damage),
    ]
}

fn mutate(job: &[u8], edits: &[(usize, Edit)]) -> Vec<u8> {
    let mut lines: Vec<Vec<u8>> = job.split_inclusive(|&b| b == b'\n').map(<[u8]>::to_vec).collect();
    for &(at, edit) in edits {
        let at = at % lines.len();
        match edit {
            Edit::Lose => drop(lines.remove(at)),
            Edit::Double => lines.insert(at, lines[at].clone()),
            Edit::Swap(by) => {
                let other = (at + by) % lines.len();
                lines.swap(at, other);
            }
            Edit::Put(odd) => lines.insert(at, format!("{}\n", ODD[odd]).into_bytes()),
            Edit::Damage(byte) => {
                let place = usize::from(byte) % lines[at].len().max(1);
                if let Some(b) = lines[at].get_mut(place).filter(|b| **b != b'\n') {
                    *b = byte;
                }
            }
        }
    }
    lines.concat()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]
    #[test]
    fn a_changed_job_deposits_the_same(
        job in 0..JOBS.len(),
        edits in prop::collection::vec((any::<usize>(), edit()), 1..40),
    ) {
        let job = mutate(&corpus(JOBS[job]), &edits);
        let mut out = Vec::new();
        let report = post(&mut Cursor::new(&job), &mut out, Options::default(), &|_| {}).unwrap();
        if report.unchanged_reason.is_none() {
            same_deposits("the job", &job, &out);
            prop_assert!(report.retractions_after <= report.retractions_before);
            prop_assert!(report.lifts_after <= report.lifts_before);
            prop_assert!(report.travel_mm_after <= report.travel_mm_before);
        }
    }
}
