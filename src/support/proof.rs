//! The proof: detection again, on the result.
//!
//! Takes the layers of what will be printed, part and supports together, and what was
//! promised of them. Looks with the same detectors as before, at other polygons: those of
//! the result, read anew. Nothing of the plan is believed but where its tips should be.
//!
//! It holds when
//! - no island of the part is left but those that were told as not to be held,
//! - no support is itself an island (paper 003, section 4.3), specks aside as with the part,
//!   and what the slicer itself began in the air,
//! - each tip is there under what it holds, within its own diameter,
//! - each place that hung and still overhangs is within the spacing of a tip, or was told as
//!   not to be held.
use super::cells::{around as touching, cell};
use super::demand::{Demand, Gather, Need, ask};
use super::plan::Plan;
use super::rules::Rules;
use super::tree::Kind;
use crate::detect::island::Island;
use crate::detect::overhang::SelfSupport;
use crate::detect::walk::{Seen, Watch, walk};
use crate::layers::shape::{Place, Point};
use crate::layers::stack::Layers;
use crate::mesh::vector::distance;
use rustc_hash::{FxHashMap, FxHashSet};
use std::f64::consts::TAU;

/// A place that a cell of the demand stands for may lie a cell off, and another one in the
/// result.
const CELLS_OFF: f64 = 2.0;

/// What does not hold.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Proof {
    /// Islands that are left and were not told, mm.
    pub islands_mm: Vec<[f64; 3]>,
    /// Supports that begin in the air, mm.
    pub floating_mm: Vec<[f64; 3]>,
    /// Tips that are not there, mm.
    pub missing_tips_mm: Vec<[f64; 3]>,
    /// Overhanging places too far from every tip that were not told, mm.
    pub far_mm: Vec<[f64; 3]>,
    /// Area of these, mm².
    pub far_mm2: f64,
}

impl Proof {
    /// Whether all holds.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.islands_mm.is_empty()
            && self.floating_mm.is_empty()
            && self.missing_tips_mm.is_empty()
            && self.far_mm.is_empty()
    }

    /// What does not hold, for people; empty where all does.
    #[must_use]
    pub fn words(&self) -> Vec<String> {
        let told = |what: &str, places: &[[f64; 3]]| {
            let at = places.first()?;
            let more =
                if places.len() > 1 { format!(" and {} more", places.len() - 1) } else { String::new() };
            Some(format!("{what} at X {:.1} Y {:.1} Z {:.2}{more}", at[0], at[1], at[2]))
        };
        [
            ("an island is left", &self.islands_mm),
            ("a support begins in the air", &self.floating_mm),
            ("a tip is missing", &self.missing_tips_mm),
            ("an overhang is too far from every tip", &self.far_mm),
        ]
        .into_iter()
        .filter_map(|(what, places)| told(what, places))
        .collect()
    }
}

/// Tips that are looked for while layers pass, the lowest first.
struct Tips {
    left: Vec<[f64; 3]>,
    at: usize,
    missing: Vec<[f64; 3]>,
    gather: Gather,
    wide_mm: f64,
}

/// A place, and some around it within a tip's diameter: what is merged gives way to walls.
fn around(at: [f64; 3], wide_mm: f64) -> impl Iterator<Item = [f64; 2]> {
    let ring = move |radius: f64| {
        (0..8).map(move |k| {
            let turn = TAU * f64::from(k) / 8.0;
            [at[0] + radius * turn.cos(), at[1] + radius * turn.sin()]
        })
    };
    std::iter::once([at[0], at[1]]).chain(ring(wide_mm / 2.0)).chain(ring(wide_mm))
}

impl Watch for Tips {
    fn layer(&mut self, seen: &Seen<'_>) {
        let layer = seen.layer;
        while let Some(tip) = self.left.get(self.at).filter(|t| t[2] < layer.top_mm - 1e-9) {
            let there = around(*tip, self.wide_mm)
                .any(|[x, y]| layer.aid.place(Point::from_mm(x, y)) != Place::Outside);
            if !there {
                self.missing.push(*tip);
            }
            self.at += 1;
        }
        self.gather.layer(seen);
    }
}

/// What was promised of a result, and what was there before.
#[derive(Clone, Copy, Debug)]
pub struct Promise<'a> {
    /// What was planned.
    pub plan: &'a Plan,
    /// What was to be held.
    pub demand: &'a Demand,
    /// What began in the air of the slicer's own supports, brims and towers.
    pub floating: &'a [Island],
    /// The rules of the plan.
    pub rules: &'a Rules,
    /// What the material holds itself.
    pub own: SelfSupport,
    /// Height of a layer, mm.
    pub layer_mm: f64,
}

impl Promise<'_> {
    /// Whether an island was there before, of the slicer's own.
    fn was_floating(&self, island: &Island) -> bool {
        let meet = |other: &Island| {
            let [low, high] = island.bbox_mm;
            let [from, to] = other.bbox_mm;
            (0..2).all(|k| low[k] <= to[k] && from[k] <= high[k])
        };
        self.floating.iter().any(|f| f.layer == island.layer && meet(f))
    }
}

/// Cells in which something is.
struct Around {
    cell_mm: f64,
    cells: FxHashSet<[i32; 3]>,
}

impl Around {
    fn new(places: impl Iterator<Item = [f64; 3]>, cell_mm: f64) -> Around {
        Around { cell_mm, cells: places.map(|at| cell(at, cell_mm)).collect() }
    }

    /// Whether something is in the cell of a place or one that it touches.
    fn has(&self, at: [f64; 3]) -> bool {
        touching(cell(at, self.cell_mm)).any(|near| self.cells.contains(&near))
    }
}

/// Looks at the result. `layers` have the supports as their aid, so that a tip meets what it
/// holds: `raised_mm` says by how much all of them were raised for that; 0 where only what
/// ends below the part was lengthened.
///
/// Support takes no hold away: where nothing hung before, what hangs now is what the search
/// for bridges, which lays all of a piece in one direction, found otherwise.
///
/// # Errors
/// Those of the layers' source.
pub fn prove<L: Layers>(layers: &mut L, promise: &Promise<'_>, raised_mm: f64) -> Result<Proof, L::Error> {
    let Promise { plan, demand, rules, own, layer_mm, .. } = *promise;
    let gap_mm = rules.gap_mm.max(0.0);
    let contacts: Vec<[f64; 3]> =
        plan.forest.nodes.iter().filter(|n| n.kind == Kind::Tip).map(|n| n.at_mm).collect();
    // A tip is looked for a layer below where it ends, or in resin below the underside.
    let mut left: Vec<[f64; 3]> = contacts
        .iter()
        .map(|t| [t[0], t[1], (t[2] + rules.gap_mm.min(0.0) + raised_mm - layer_mm).max(0.0)])
        .collect();
    left.sort_by(|a, b| a[2].total_cmp(&b[2]));
    let gather = Gather::new(rules.cell_mm());
    let mut tips = Tips { left, at: 0, missing: Vec::new(), gather, wide_mm: rules.tip_mm };
    let found = walk(layers, &ask(own), &mut tips)?;
    let off = CELLS_OFF * rules.cell_mm();
    let told = |at: [f64; 3]| plan.points.unheld_mm.iter().any(|u| distance(*u, at) <= off);
    let place = |i: &Island| [i.centroid_mm[0], i.centroid_mm[1], i.z_mm];
    let left = tips.gather.finish(&found.islands.islands, own.min_area_mm2, rules.caught_mm);
    let reach = rules.spacing_mm + off;
    let hung = Around::new(demand.needs.iter().map(|n| n.at_mm), off);
    let mut far: Vec<&Need> = left
        .needs
        .iter()
        .filter(|n| !n.island && hung.has(n.at_mm) && !told(n.at_mm))
        .filter(|n| {
            let held = |t: &[f64; 3]| distance([t[0], t[1], t[2] + gap_mm], n.at_mm) <= reach;
            !contacts.iter().any(held)
        })
        .collect();
    // What of an overhang is too far counts where it would as an overhang of its own.
    let mut area: FxHashMap<u32, f64> = FxHashMap::default();
    far.iter().for_each(|n| *area.entry(n.region).or_default() += n.area_mm2);
    far.retain(|n| area.get(&n.region).is_some_and(|area| *area >= own.min_area_mm2));
    // In pictures part and supports are one, and so are the specks of both.
    let floating = found.islands.floating_aid.iter();
    let floating = floating.filter(|i| i.own_area_mm2 >= own.min_area_mm2 && !promise.was_floating(i));
    Ok(Proof {
        islands_mm: found.islands.islands.iter().map(place).filter(|at| !told(*at)).collect(),
        floating_mm: floating.map(place).filter(|at| !told(*at)).collect(),
        missing_tips_mm: tips.missing,
        far_mm2: far.iter().map(|n| n.area_mm2).sum(),
        far_mm: far.into_iter().map(|n| n.at_mm).collect(),
    })
}
