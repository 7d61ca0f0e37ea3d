//! The beads of a layer, and the sections in which they may be visited in another order.
//!
//! A section is a run of beads of one feature, tool, object and height with
//! nothing between them that must not be crossed. Sparse infill and gap fill are
//! free; solid infill is free where the layers below and above have printed beads
//! all along it (Cura's `SKIN`, PrusaSlicer's bottoms and Slic3r's `infill` hold
//! parts that show or bridge: those keep their order and direction).
use super::layer::{Layer, Modes, What};
use super::link::is_regular;
use crate::toolpath::bead::{Bead, Point};
use crate::toolpath::cover::Cover;
use outrigger_gcode::dialect::Feature;
use outrigger_gcode::state::Kind;
use std::ops::Range;

/// A maximal run of deposits of one feature with nothing between that moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct BeadRows {
    /// Row of the first deposit.
    pub(super) first: usize,
    /// Row of the last deposit.
    pub(super) last: usize,
    /// As printed.
    pub(super) bead: Bead,
    /// Height, mm.
    pub(super) z: f64,
    /// What it is.
    pub(super) feature: Feature,
    /// May be moved and reversed.
    pub(super) free: bool,
    tool: u16,
    object: u32,
}

/// The layers on both sides, as far as they are known.
#[derive(Clone, Copy, Debug, Default)]
pub struct Neighbours<'a> {
    /// Where the layer below is printed.
    pub below: Option<&'a Cover>,
    /// Where the layer above is printed.
    pub above: Option<&'a Cover>,
}

/// The beads of a layer, in its order.
pub(super) fn beads(layer: &Layer, neighbours: Neighbours<'_>) -> Vec<BeadRows> {
    let mut beads: Vec<BeadRows> = Vec::new();
    let mut open = false;
    let mut modes = Modes::from(&layer.start);
    for (k, row) in layer.rows.iter().enumerate() {
        match row.what {
            What::Move(m, Kind::Deposit) => {
                let state = layer.state(row);
                let flat = m.from[2] == m.to[2] && modes.absolute && !modes.inches;
                let end = [m.to[0], m.to[1]];
                let same = |b: &BeadRows| {
                    (b.feature, b.tool, b.object, b.z) == (state.feature, state.tool, state.object, m.to[2])
                };
                match beads.last_mut().filter(|b| open && same(b)) {
                    Some(bead) => {
                        bead.last = k;
                        bead.bead.ends[1] = end;
                        bead.free &= flat;
                    }
                    None => beads.push(BeadRows {
                        first: k,
                        last: k,
                        bead: Bead { ends: [[m.from[0], m.from[1]], end] },
                        z: m.to[2],
                        feature: state.feature,
                        free: flat,
                        tool: state.tool,
                        object: state.object,
                    }),
                }
                open = true;
            }
            What::Move(_, Kind::Still) | What::Channel(_) | What::Progress => {}
            What::Mode(after) => {
                modes = after;
                open = false;
            }
            _ => open = false,
        }
    }
    for bead in &mut beads {
        bead.free = bead.free && may_move(layer, bead, neighbours);
    }
    beads
}

fn may_move(layer: &Layer, bead: &BeadRows, neighbours: Neighbours<'_>) -> bool {
    match bead.feature {
        Feature::Infill | Feature::GapFill => true,
        Feature::SolidInfill | Feature::Skin | Feature::AnyInfill => {
            let covered = |cover: Option<&Cover>| cover.is_some_and(|c| is_over(layer, bead, c));
            covered(neighbours.below) && covered(neighbours.above)
        }
        _ => false,
    }
}

/// Whether printed spots lie all along the bead.
fn is_over(layer: &Layer, bead: &BeadRows, cover: &Cover) -> bool {
    let mut over = true;
    for row in &layer.rows[bead.first..=bead.last] {
        if let What::Move(m, Kind::Deposit) = row.what {
            m.chords(|a: Point, b: Point| over = over && cover.along(a, b));
        }
    }
    over
}

/// Runs of free beads that may be visited in any order, as ranges of beads.
pub(super) fn sections(layer: &Layer, beads: &[BeadRows]) -> Vec<Range<usize>> {
    let mut sections: Vec<Range<usize>> = Vec::new();
    for (k, bead) in beads.iter().enumerate() {
        if !bead.free {
            continue;
        }
        let joined = k > 0 && {
            let before = &beads[k - 1];
            let alike = (before.feature, before.tool, before.object, before.z)
                == (bead.feature, bead.tool, bead.object, bead.z);
            let between = &layer.rows[before.last + 1..bead.first];
            before.free && alike && between.iter().all(|r| is_link(r.what)) && is_regular(layer, between)
        };
        match sections.last_mut().filter(|s| joined && s.end == k) {
            Some(section) => section.end = k + 1,
            None => sections.push(k..k + 1),
        }
    }
    sections
}

/// Whether a row may stand between two beads that are moved apart.
pub(super) fn is_link(what: What) -> bool {
    !matches!(what, What::Barrier | What::Anchor | What::Mode(_)) && !pushes_upwards(what)
}

/// Whether the row pushes filament while it moves in Z alone: no bead, and yet
/// something is laid down where it stands.
pub(super) fn pushes_upwards(what: What) -> bool {
    matches!(what, What::Move(m, Kind::Travel) if m.e != 0.0)
}

#[cfg(test)]
mod tests {
    use super::super::annotate::Layers;
    use super::*;
    use outrigger_gcode::dialect::Dialect;

    /// The last layer of a job, with the covers of the two before it as neighbours.
    fn check(text: &str, expect: &[(usize, usize)]) {
        let mut reader = Layers::new(text.as_bytes(), Dialect::Prusa);
        let mut layers = Vec::new();
        while let Some(layer) = reader.next_layer().unwrap() {
            layers.push(layer);
        }
        let layer = layers.last().unwrap();
        let neighbours = Neighbours {
            below: layers.iter().rev().nth(1).and_then(|l| l.cover.as_ref()),
            above: layers.iter().rev().nth(2).and_then(|l| l.cover.as_ref()),
        };
        let found = sections(layer, &beads(layer, neighbours));
        let found: Vec<_> = found.iter().map(|s| (s.start, s.end)).collect();
        assert_eq!(found, expect, "{text}");
    }

    fn layer(feature: &str, body: &str) -> String {
        format!("M83\n;LAYER_CHANGE\nG1 Z.2\nG1 X0 Y0\n;TYPE:{feature}\n{body}")
    }

    #[test]
    fn beads_of_sparse_infill_are_one_section() {
        check(&layer("Internal infill", "G1 X9 E1\nG1 Y1\nG1 X0 E1\nG1 Y2\nG1 X9 E1\n"), &[(0, 3)]);
        check(&layer("Internal infill", "G1 X9 E1\nG1 Y1\nM104 S200\nG1 X0 E1\n"), &[(0, 1), (1, 2)]);
        check(&layer("Internal infill", "G1 X9 E1\nG1 Z1 E1\nG1 Z.2\nG1 Y1\nG1 X0 E1\n"), &[(0, 1), (1, 2)]);
        check(&layer("Internal infill", "G1 X9 E1\nG1 E1\nG1 Y1\nG1 X0 E1\n"), &[(0, 1), (1, 2)]);
        check(&layer("Internal infill", "G1 X9 E1\nG1 E-1\nG1 Y1\nG1 E1\nG1 X0 E1\n"), &[(0, 2)]);
        check(&layer("Internal infill", "G1 X9 E1\nG1 Y1\nM73 P3\nG1 X0 E1\n"), &[(0, 2)]);
        check(&layer("Perimeter", "G1 X9 E1\nG1 Y1\nG1 X0 E1\n"), &[]);
        check(&layer("Internal infill", "G1 X9 Z.3 E1\nG1 Y1\nG1 X0 E1\n"), &[(1, 2)]);
        check(&layer("Internal infill", "G91\nG1 X9 E1\nG1 Y1\nG1 X-9 E1\n"), &[]);
        check(
            &layer(
                "Internal infill",
                "G1 X9 E1\nG1 Y1\n;TYPE:Gap fill\nG1 X0 E1\nG1 Y2\n;TYPE:Perimeter\nG1 X9 E1\n",
            ),
            &[(0, 1), (1, 2)],
        );
    }

    #[test]
    fn solid_infill_is_free_only_between_printed_beads() {
        let solid: String = (0..20)
            .map(|k| {
                format!(
                    "G1 X{} Y{} E1\nG1 Y{:.1}\n",
                    if k % 2 == 0 { 9 } else { 0 },
                    f64::from(k) * 0.4,
                    f64::from(k + 1) * 0.4
                )
            })
            .collect();
        let narrow = solid.lines().take(8).map(|l| format!("{l}\n")).collect::<String>();
        let job = |below: &str, above: &str| {
            // The test's `above` is simply printed first.
            let part = |body: &str| format!(";LAYER_CHANGE\nG1 X0 Y0\n;TYPE:Solid infill\n{body}");
            format!(
                "M83\n{}{}{}",
                part(above),
                part(below),
                part("G1 X9 E1\nG1 Y4\nG1 X0 E1\nG1 Y1\nG1 X9 E1\n")
            )
        };
        check(&job(&solid, &solid), &[(0, 3)]);
        check(&job(&solid, &narrow), &[(0, 1), (2, 3)]);
        check(&job(&narrow, &solid), &[(0, 1), (2, 3)]);
    }
}
