//! What shows or bridges keeps its order and direction: judged by the beads alone.
//!
//! After `post`, every solid bead that was printed at another time or the other
//! way round must lie, all along, over a bead of the layer below and under one
//! of the layer above. Distances to beads are reckoned here, not looked up in the
//! project's bitmap.
mod common;

use common::corpus;
use outrigger::post::{Options, post};
use outrigger_gcode::dialect::{Detection, Dialect, Feature, Mark, detect};
use outrigger_gcode::line::{parse, split_lines};
use outrigger_gcode::state::{Effect, Kind, Machine};
use std::io::Cursor;

#[derive(Clone, Copy, Debug)]
struct Stroke {
    from: [f64; 2],
    to: [f64; 2],
    width_mm: f64,
    feature: Feature,
}

/// The deposits of the part, layer by layer, in order.
fn layers(job: &[u8], dialect: Dialect) -> Vec<Vec<Stroke>> {
    let mut machine = Machine::default();
    let mut layers = vec![Vec::new()];
    let (mut feature, mut width_mm) = (Feature::Unknown, 0.45);
    for bytes in split_lines(job) {
        let line = parse(bytes);
        match dialect.mark(&line) {
            Some(Mark::Layer) => layers.push(Vec::new()),
            Some(Mark::Feature(f) | Mark::Inline(f)) => feature = f,
            Some(Mark::Width(mm)) => width_mm = mm,
            _ => {}
        }
        if let Effect::Motion(m) = machine.apply(&line)
            && m.kind() == Kind::Deposit
            && feature.is_part()
        {
            let flat = |p: [f64; 3]| [p[0], p[1]];
            let stroke = Stroke { from: flat(m.from), to: flat(m.to), width_mm, feature };
            layers.last_mut().expect("one").push(stroke);
        }
    }
    layers
}

/// Whether the spot lies under a bead, a tenth of a millimetre for the rounded flanks.
fn is_printed(spot: [f64; 2], layer: &[Stroke]) -> bool {
    layer.iter().any(|s| {
        let (dx, dy) = (s.to[0] - s.from[0], s.to[1] - s.from[1]);
        let along = (spot[0] - s.from[0]) * dx + (spot[1] - s.from[1]) * dy;
        let t = (along / (dx * dx + dy * dy).max(1e-12)).clamp(0.0, 1.0);
        let gap = (spot[0] - s.from[0] - t * dx).hypot(spot[1] - s.from[1] - t * dy);
        // Half a cell's diagonal of the project's bitmap, and its allowance for flanks.
        gap <= s.width_mm / 2.0 + 0.06 + 0.18
    })
}

fn is_between_beads(s: &Stroke, below: &[Stroke], above: &[Stroke]) -> bool {
    let steps = ((s.to[0] - s.from[0]).hypot(s.to[1] - s.from[1]) / 0.2).ceil().max(1.0) as u32;
    (0..=steps).all(|k| {
        let t = f64::from(k) / f64::from(steps);
        let spot = [s.from[0] + t * (s.to[0] - s.from[0]), s.from[1] + t * (s.to[1] - s.from[1])];
        is_printed(spot, below) && is_printed(spot, above)
    })
}

fn is_same(a: &Stroke, b: &Stroke) -> bool {
    (a.from, a.to) == (b.from, b.to)
}

/// Checks a job; gives how many solid beads were moved.
fn check(name: &str, job: &[u8]) -> u32 {
    let Detection::One(dialect) = detect(job) else { return 0 };
    let mut out = Vec::new();
    let report = post(&mut Cursor::new(job), &mut out, Options::default(), &|_| {}).expect("readable");
    if report.unchanged_reason.is_some() {
        return 0;
    }
    let (before, after) = (layers(job, dialect), layers(&out, dialect));
    assert_eq!(before.len(), after.len(), "{name}");
    let mut moved = 0;
    for (k, (old, new)) in before.iter().zip(&after).enumerate() {
        for (was, is) in old.iter().zip(new) {
            if is_same(was, is) {
                continue;
            }
            // Another bead is printed at this place in time: both were moved.
            let solid = [Feature::SolidInfill, Feature::Skin, Feature::AnyInfill];
            let loose = [Feature::Infill, Feature::GapFill];
            for stroke in [was, is] {
                assert!(
                    solid.contains(&stroke.feature) || loose.contains(&stroke.feature),
                    "{name}, layer {k}: {stroke:?} was moved"
                );
            }
            if solid.contains(&was.feature) {
                moved += 1;
                let below = k.checked_sub(1).map_or(&[][..], |j| &before[j]);
                let above = before.get(k + 1).map_or(&[][..], Vec::as_slice);
                assert!(is_between_beads(was, below, above), "{name}, layer {k}: {was:?} shows or bridges");
            }
        }
    }
    moved
}

#[test]
fn solid_beads_are_moved_only_between_beads() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("gcode/corpus");
    let mut moved = 0;
    for entry in std::fs::read_dir(folder).expect("the corpus") {
        let name = entry.expect("an entry").file_name().into_string().expect("ASCII");
        if name.ends_with(".gcode") {
            moved += check(&name, &corpus(&name));
        }
    }
    assert!(moved > 20, "the corpus gives the test something to judge: {moved}");
}
