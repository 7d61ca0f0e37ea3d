//! Jobs and supports for the tests of this room.
use super::gcode::Failure;
use super::into_gcode::{MergeReport, Options, into_gcode};
use crate::layers::polygon::{stroke, union_all};
use crate::layers::shape::{Point as Grid, Region};
use crate::support::section::{Section, Sections};
use outrigger_gcode::line::{parse, split_lines};
use outrigger_gcode::state::{Effect, Kind, Machine};
use std::io::Cursor;

pub(super) fn corpus(name: &str) -> Vec<u8> {
    std::fs::read(std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("gcode/corpus").join(name)).unwrap()
}

/// A round column, or a cone: place, radius at the plate and at the top, mm.
#[derive(Clone, Copy)]
pub(super) struct Column {
    pub(super) at: [f64; 2],
    pub(super) radii_mm: [f64; 2],
    pub(super) top_mm: f64,
    /// How much of it is interface, from the top.
    pub(super) interface_mm: f64,
}

pub(super) fn column(x: f64, y: f64, radius: f64, top_mm: f64) -> Column {
    Column { at: [x, y], radii_mm: [radius; 2], top_mm, interface_mm: 0.0 }
}

pub(super) struct Columns(pub(super) Vec<Column>);

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
pub(super) fn around_the_bench() -> Columns {
    let mut between = column(110.0, 110.0, 1.5, 2.5);
    between.interface_mm = 0.5;
    let cone = Column { at: [110.0, 85.0], radii_mm: [4.0, 0.3], top_mm: 4.5, interface_mm: 0.0 };
    Columns(vec![column(85.0, 110.0, 2.0, 4.5), column(136.0, 112.0, 0.9, 4.5), cone, between])
}

pub(super) fn merged(
    input: &[u8],
    sections: &dyn Sections,
    options: &Options,
) -> Result<(Vec<u8>, MergeReport), Failure> {
    let mut output = Vec::new();
    let report = into_gcode(&mut Cursor::new(input), &mut output, sections, options, &|_, _| {})?;
    Ok((output, report))
}

/// From, to, filament, feed rate.
pub(super) type OwnBead = ([f64; 3], [f64; 3], f64, f64);

/// Moves of the part and what they push, by a reader of its own; and all pushing, mm.
pub(super) fn part_beads(text: &[u8]) -> (Vec<OwnBead>, f64) {
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

pub(super) fn plain(job: &[u8]) -> Vec<u8> {
    let mut text = Vec::new();
    std::io::Read::read_to_end(&mut outrigger_gcode::bgcode::bare_text(job), &mut text).unwrap();
    text
}

/// The same beads in the same order.
pub(super) fn same_beads(name: &str, before: &[OwnBead], after: &[OwnBead]) {
    assert_eq!(before.len(), after.len(), "{name}");
    for (a, b) in before.iter().zip(after) {
        let near = |p: [f64; 3], q: [f64; 3]| (0..3).all(|k| (p[k] - q[k]).abs() < 1e-9);
        assert!(
            near(a.0, b.0) && near(a.1, b.1) && (a.2 - b.2).abs() < 1e-6 && a.3 == b.3,
            "{name}: {a:?} {b:?}"
        );
    }
}
