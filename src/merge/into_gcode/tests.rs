use super::*;
use crate::layers::from_gcode::{self, Facts};
use crate::layers::polygon::{difference, stroke, union_all};
use crate::layers::shape::Point as Grid;
use crate::layers::stack::{Layer as Slab, Layers as _};
use crate::support::section::Section;
use outrigger_gcode::line::{parse, split_lines};
use outrigger_gcode::state::{Effect, Kind, Machine};
use std::io::Cursor;

/// A round column, or a cone: place, radius at the plate and at the top, mm.
#[derive(Clone, Copy)]
struct Column {
    at: [f64; 2],
    radii_mm: [f64; 2],
    top_mm: f64,
    /// How much of it is interface, from the top.
    interface_mm: f64,
}

fn column(x: f64, y: f64, radius: f64, top_mm: f64) -> Column {
    Column { at: [x, y], radii_mm: [radius; 2], top_mm, interface_mm: 0.0 }
}

struct Columns(Vec<Column>);

impl Sections for Columns {
    fn top_mm(&self) -> f64 {
        self.0.iter().map(|c| c.top_mm).fold(0.0, f64::max)
    }

    fn section(&self, bottom_mm: f64, top_mm: f64) -> Section {
        let middle = f64::midpoint(bottom_mm, top_mm);
        let discs = |interface: bool| {
            let own = self.0.iter().filter(|c| middle < c.top_mm);
            let own = own.filter(|c| (middle > c.top_mm - c.interface_mm) == interface);
            let discs: Vec<Region> = own
                .map(|c| {
                    let t = middle / c.top_mm;
                    let radius = c.radii_mm[0] + t * (c.radii_mm[1] - c.radii_mm[0]);
                    stroke(&[vec![Grid::from_mm(c.at[0], c.at[1])]], radius)
                })
                .collect();
            union_all(&discs)
        };
        Section { body: discs(false), interface: discs(true) }
    }
}

/// Two columns beside the bench, a cone with an interface, and a column between its feet.
fn around_the_bench() -> Columns {
    let mut between = column(110.0, 110.0, 1.5, 2.5);
    between.interface_mm = 0.5;
    let cone = Column { at: [110.0, 85.0], radii_mm: [4.0, 0.3], top_mm: 4.5, interface_mm: 0.0 };
    Columns(vec![column(85.0, 110.0, 2.0, 4.5), column(136.0, 112.0, 0.9, 4.5), cone, between])
}

fn corpus(name: &str) -> Vec<u8> {
    std::fs::read(std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("gcode/corpus").join(name)).unwrap()
}

fn merged(input: &[u8], sections: &dyn Sections, options: &Options) -> Result<(Vec<u8>, MergeReport), Failure> {
    let mut output = Vec::new();
    let report = into_gcode(&mut Cursor::new(input), &mut output, sections, options, &|_, _| {})?;
    Ok((output, report))
}

fn slabs(text: &[u8]) -> (Vec<Slab>, Facts) {
    let mut layers = from_gcode::read(outrigger_gcode::bgcode::text(text), &from_gcode::Options::default()).unwrap();
    let mut all = Vec::new();
    while let Some(batch) = layers.next_batch().unwrap() {
        all.extend(batch);
    }
    (all, layers.facts().clone())
}

/// Moves of the part and what they push, by a reader of its own; and all pushing, mm.
fn part_beads(text: &[u8]) -> (Vec<([f64; 3], [f64; 3], f64, f64)>, f64) {
    let mut machine = Machine::default();
    let (mut beads, mut all, mut support) = (Vec::new(), 0.0, false);
    for bytes in split_lines(text) {
        let line = parse(bytes);
        let comment = String::from_utf8_lossy(line.comment).to_lowercase();
        if comment.starts_with(";type:") || comment.starts_with("; feature:") {
            support = comment.contains("support");
        }
        if let Effect::Motion(m) = machine.apply(&line) {
            all += m.e;
            if m.kind() == Kind::Deposit && !support && !comment.contains("support material") {
                beads.push((m.from, m.to, m.e, m.feed));
            }
        }
    }
    (beads, all)
}

/// The supports appear where they were planned, the part is what it was, and the filament adds up.
fn check(name: &str) {
    let input = corpus(name);
    let sections = around_the_bench();
    let options = Options::default();
    let (output, report) = merged(&input, &sections, &options).unwrap_or_else(|e| panic!("{name}: {e}"));
    let (before, facts) = slabs(&input);
    let (after, facts_after) = slabs(&output);
    assert_eq!(before.len(), after.len(), "{name}");
    for (old, new) in before.iter().zip(&after) {
        assert_eq!(old.part, new.part, "{name}: the part at {}", old.top_mm);
        let planned = sections.section(old.bottom_mm, old.top_mm);
        let planned = union_all([&planned.body, &planned.interface]);
        // Beads are read back a little wider than they are; the fill is sparse.
        let added = difference(&new.aid, &old.aid);
        let beyond = difference(&added, &crate::layers::polygon::grow(&planned, 0.06));
        assert!(beyond.area_mm2() < 0.02, "{name}: {} mm² beyond at {}", beyond.area_mm2(), old.top_mm);
        let rim = difference(&planned, &crate::layers::polygon::grow(&planned, -0.6));
        let bare = difference(&rim, &union_all([&new.aid]));
        assert!(bare.area_mm2() < 0.1 * rim.area_mm2(), "{name}: {} of {} bare at {}", bare.area_mm2(), rim.area_mm2(), old.top_mm);
    }
    let (text, text_after) = (plain(&input), plain(&output));
    let ((own, all), (own_after, all_after)) = (part_beads(&text), part_beads(&text_after));
    assert_eq!(own.len(), own_after.len(), "{name}");
    for (a, b) in own.iter().zip(&own_after) {
        let near = |p: [f64; 3], q: [f64; 3]| (0..3).all(|k| (p[k] - q[k]).abs() < 1e-9);
        assert!(near(a.0, b.0) && near(a.1, b.1) && (a.2 - b.2).abs() < 1e-6 && a.3 == b.3, "{name}: {a:?} {b:?}");
    }
    assert!((all_after - all - report.filament_mm).abs() < 0.01, "{name}: {all_after} {all} {}", report.filament_mm);
    let more = facts_after.extruded_mm3 - facts.extruded_mm3;
    assert!((more / report.volume_mm3 - 1.0).abs() < 0.01, "{name}: {more} {}", report.volume_mm3);
    let longest = split_lines(&text_after).map(|l| memchr::memchr(b';', l).unwrap_or(l.len())).max();
    let longest_before = split_lines(&text).map(|l| memchr::memchr(b';', l).unwrap_or(l.len())).max();
    assert!(longest.unwrap_or(0) <= longest_before.unwrap_or(0).max(81), "{name}");
    assert_eq!(report.layers_supported, before.iter().filter(|l| l.bottom_mm < 4.5 - 0.15).count() as u32, "{name}");
    assert_eq!(report.clipped_by_part.layers, 0, "{name}: {:?}", report.clipped_by_part);
    assert_eq!(report.missing_top_mm, 0.0, "{name}");
}

fn plain(job: &[u8]) -> Vec<u8> {
    let mut text = Vec::new();
    std::io::Read::read_to_end(&mut outrigger_gcode::bgcode::bare_text(job), &mut text).unwrap();
    text
}

#[test]
fn prusaslicer_with_relative_e() {
    check("ps25-marlin-rel-triangles.gcode");
}

#[test]
fn prusaslicer_with_absolute_e() {
    check("ps25-marlin-abs-grid.gcode");
}

#[test]
fn prusaslicer_with_wipes_and_z_hops() {
    check("ps25-marlin-wipe-zhop-honeycomb.gcode");
}

#[test]
fn prusaslicer_with_firmware_retraction() {
    check("ps25-marlin2-fwretract-rectilinear.gcode");
}

#[test]
fn prusaslicer_with_comments_on_every_move() {
    check("ps25-marlin-comments.gcode");
}

#[test]
fn klipper_with_macros() {
    check("ps25-klipper-gyroid.gcode");
}

#[test]
fn cura_with_absolute_and_relative_e() {
    check("cura413-marlin-zhop-triangles.gcode");
    check("cura413-marlin-rel-cubic.gcode");
}

#[test]
fn slic3r_with_inline_comments() {
    check("slic3r13-rel-comments.gcode");
}

#[test]
fn bambus_dialect() {
    check("remarked-bambu.gcode");
}

#[test]
fn binary_stays_binary() {
    check("ps25-marlin-abs-grid.bgcode");
}
