//! A model beside jobs that print it where it lies, elsewhere, otherwise, or not at all.
use super::*;
use crate::layers::polygon::union;
use crate::support::look::look;
use crate::support::rules::Rules;
use crate::support::testing::{Given, OWN, layers, mesh, region};

/// A foot, and a tongue on one side of it.
const LAMP: [[[f64; 3]; 2]; 2] =
    [[[-2.0, -2.0, 0.0], [2.0, 2.0, 9.0]], [[-2.0, -2.0, 7.0], [9.0, 5.0, 12.0]]];

/// What the job prints at a height: boxes of the part moved by `by`.
fn section(boxes: &[[[f64; 3]; 2]], by: [f64; 3], z_mm: f64) -> Region {
    let there = boxes.iter().filter(|[low, high]| (low[2]..high[2]).contains(&(z_mm - by[2])));
    let at = |[low, high]: &[[f64; 3]; 2]| [low[0] + by[0], low[1] + by[1], high[0] + by[0], high[1] + by[1]];
    region(&there.map(at).collect::<Vec<_>>())
}

/// What is kept of a job of 0.2 mm layers.
fn outlines(process: Process, job: impl Fn(f64) -> Region) -> Outlines {
    let layers = layers(100, 0.2, job);
    let bounds = layers.iter().fold(Bounds::EMPTY, |b, l| b.joined(l.part.bounds()));
    let mut outlines = Outlines::default();
    let rules = Rules::usual(process, 0.2);
    let Ok(_) = look(&mut Given(layers), (bounds, 20.0), &Region::default(), OWN, &rules, &mut outlines);
    outlines
}

#[track_caller]
fn check(process: Process, job: impl Fn(f64) -> Region, align: bool, expect: Result<[f64; 3], &str>) {
    let found = shift_mm(&mesh(&LAMP), &outlines(process, job), process, align);
    match (&found, expect) {
        (Ok(by), Ok(expect)) => {
            assert!(by.iter().zip(expect).all(|(a, b)| (a - b).abs() < 0.03), "{by:?}, not {expect:?}");
        }
        (Err(fault), Err(words)) => assert!(fault.to_string().contains(words), "{fault}, not {words}"),
        _ => panic!("{found:?}, not {expect:?}"),
    }
}

#[test]
fn a_model_that_lies_there_stays() {
    for process in [Process::Filament, Process::Resin] {
        for align in [false, true] {
            for by in [[0.0; 3], [0.15, -0.1, 0.0]] {
                check(process, |z| section(&LAMP, by, z), align, Ok([0.0; 3]));
            }
        }
    }
}

#[test]
fn a_model_elsewhere_is_told_or_moved() {
    for process in [Process::Filament, Process::Resin] {
        for by in [[100.0, 90.0, 0.0], [3.0, 0.0, 0.0], [0.0, -40.5, 0.4], [0.0, 0.0, 5.0]] {
            check(process, |z| section(&LAMP, by, z), true, Ok(by));
            let told = format!("X {:+.2} Y {:+.2} Z {:+.2}", by[0], by[1], by[2]);
            check(process, |z| section(&LAMP, by, z), false, Err(&told));
        }
    }
}

#[test]
fn supports_in_pictures_are_no_part_of_the_model() {
    let by = [30.0, 40.0, 5.0];
    let pad = |z: f64| match z {
        z if z < 2.0 => region(&[[20.0, 30.0, 50.0, 45.0]]),
        z if z < 12.0 => {
            region(&[[35.0, 41.0, 36.0, 42.0], [26.0, 37.0, 26.5, 37.5], [30.0, 40.0, 31.0, 41.0]])
        }
        _ => Region::default(),
    };
    let job = |z: f64| union(&section(&LAMP, by, z), &pad(z));
    check(Process::Resin, job, true, Ok(by));
    check(Process::Resin, job, false, Err("X +30.00 Y +40.00 Z +5.00"));
}

#[test]
fn what_is_not_the_jobs_model_is_told() {
    let scaled = |by: f64| LAMP.map(|b| b.map(|corner| corner.map(|c| c * by)));
    let turned = LAMP.map(|[low, high]| [[low[1], low[0], low[2]], [high[1], high[0], high[2]]]);
    // As large, but the tongue is lower.
    let other = [LAMP[0], [[-2.0, -2.0, 3.0], [9.0, 5.0, 8.0]], [[-2.0, -2.0, 8.0], [2.0, 2.0, 12.0]]];
    for align in [false, true] {
        let filament = Process::Filament;
        check(
            filament,
            |z| section(&scaled(1.25), [0.0; 3], z),
            align,
            Err("13.8 × 8.8 × 15.0 mm and the model"),
        );
        check(filament, |z| section(&scaled(0.8), [9.0; 3], z), align, Err("model is 11.0 × 7.0 × 12.0 mm"));
        check(Process::Resin, |z| section(&scaled(0.8), [0.0; 3], z), align, Err("model is 11.0"));
        check(filament, |z| section(&turned, [0.0; 3], z), align, Err("model is 11.0"));
        check(filament, |z| section(&other, [0.0; 3], z), align, Err("another shape"));
        check(Process::Resin, |z| section(&other, [0.0; 3], z), align, Err("another shape"));
        check(filament, |_| Region::default(), align, Err("nothing that could be the model"));
        // Two of them.
        let twice = |z: f64| union(&section(&LAMP, [0.0; 3], z), &section(&LAMP, [40.0, 0.0, 0.0], z));
        check(filament, twice, align, Err("all that lies on the plate"));
    }
}

#[test]
fn a_long_job_keeps_some_outlines() {
    let by = [0.0, 0.0, 3.0];
    let kept = outlines(Process::Filament, |z| section(&LAMP, by, z)).kept;
    assert_eq!(kept.iter().map(|(number, _)| *number).collect::<Vec<u32>>(), (15..75).collect::<Vec<u32>>());
    let mut outlines = Outlines::default();
    let long = layers(1000, 0.01, |_| region(&[[0.0, 0.0, 9.0, 9.0]]));
    let bounds = long[0].part.bounds();
    let rules = Rules::usual(Process::Resin, 0.05);
    let Ok(_) = look(&mut Given(long), (bounds, 10.0), &Region::default(), OWN, &rules, &mut outlines);
    let numbers: Vec<u32> = outlines.kept.iter().map(|(number, _)| *number).collect();
    assert_eq!(numbers, (0..1000).step_by(8).collect::<Vec<u32>>());
    assert_eq!((outlines.heights.len(), outlines.span), (1000, Some([0, 999])));
}
