//! Where tips stand: the fewest that hold the demand, or one each fixed distance.
//!
//! A tip holds the needs of its region that are no farther from it than the spacing.
//! - [`fixed`] is the peers' way, and the baseline of paper 000: a square lattice with the
//!   pitch spacing × √2, so that no place of a cell is farther from its middle than the
//!   spacing, and the need nearest to the middle in each region.
//! - [`cover()`] is ours: islands first; then again and again the place that holds the most
//!   of what is left (Chvátal's greedy cover, at most ln n from the best); then every tip
//!   that has become needless is taken away, pairs are replaced by one, and each tip that
//!   stands under no island moves to where it scars the least ([`super::scar`]) among the
//!   places that hold all that it alone holds.
//!
//! No choice of tips can hold needs of which each two are farther apart than twice the
//! spacing, or belong to two regions, with fewer tips than there are of these: their number
//! is the lower bound.
mod cover;
mod field;

pub use self::cover::cover;

use self::field::Field;
use super::cells::cell;
use super::demand::Demand;
use super::rules::Rules;
use super::site::{Head, Reason, Site};
use rustc_hash::FxHashMap;

/// A place with a tip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tip {
    /// Which need it stands under.
    pub need: u32,
    /// How.
    pub head: Head,
    /// Area that is nearer to it than to other tips, mm².
    pub area_mm2: f64,
}

/// Something that no tip holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unheld {
    /// Its lowest place, mm.
    pub place_mm: [f64; 3],
    /// Area, mm².
    pub area_mm2: f64,
    /// An island is among it.
    pub island: bool,
    /// Why.
    pub reason: Reason,
}

/// Tips, and what they do not hold.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Points {
    /// The tips, in the order of their needs.
    pub tips: Vec<Tip>,
    /// What cannot be held, a region each.
    pub unheld: Vec<Unheld>,
    /// Every place of these, mm.
    pub unheld_mm: Vec<[f64; 3]>,
    /// No choice of tips would be smaller than this.
    pub at_least: u32,
}

/// One tip a fixed distance.
#[must_use]
pub fn fixed(demand: &Demand, site: &Site<'_>, rules: &Rules) -> Points {
    let field = Field::new(demand, site, rules);
    let mut chosen = lattice(&field);
    chosen.extend(islands(&field));
    chosen.sort_unstable();
    chosen.dedup();
    field.points(&chosen)
}

/// The needs nearest to the middles of a lattice's cells, one a cell and region.
fn lattice(field: &Field<'_>) -> Vec<u32> {
    let pitch_mm = field.spacing_mm * std::f64::consts::SQRT_2;
    let mut best: FxHashMap<(u32, [i32; 3]), (f64, u32)> = FxHashMap::default();
    for (k, need) in field.demand.needs.iter().enumerate() {
        if field.price(k as u32).is_none() {
            continue;
        }
        let cell = cell(need.at_mm, pitch_mm);
        let off = [0, 1].map(|c| need.at_mm[c] - (f64::from(cell[c]) + 0.5) * pitch_mm);
        let off = off[0].hypot(off[1]);
        let of = best.entry((need.region, cell)).or_insert((f64::INFINITY, 0));
        if off < of.0 {
            *of = (off, k as u32);
        }
    }
    let mut chosen: Vec<u32> = best.into_values().map(|(_, need)| need).collect();
    chosen.sort_unstable();
    chosen
}

/// Where the tips of islands stand.
fn islands(field: &Field<'_>) -> Vec<u32> {
    let needs = field.demand.needs.iter().enumerate();
    let mut found: Vec<u32> =
        needs.filter(|(_, n)| n.island).filter_map(|(k, _)| field.under_island(k as u32)).collect();
    found.sort_unstable();
    found.dedup();
    found
}
