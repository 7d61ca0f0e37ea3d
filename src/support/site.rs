//! Where a tip can stand and how its branch comes down: the rules put upon the space.
use super::clearance::Clearance;
use super::clearance::reach::Reach;
use super::rules::Rules;
use super::tree::{frustum_mm3, leans_within};
use crate::mesh::vector::distance;
use std::f64::consts::TAU;

/// A tip's gap shrinks where else less than this would be left above the plate, mm.
const LEAST_TIP_MM: f64 = 0.2;

/// Distance that a tip keeps from walls beside it, mm.
const TIP_CLEARANCE_MM: f64 = 0.1;

/// A tip in a corner has so much of the usual radius.
const SLIM: f64 = 0.5;

/// Directions in which a head is tried to lean.
const DIRECTIONS: u32 = 12;

/// Why something cannot be held.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Reason {
    /// No tip and its cone fit between the part's surfaces and the plate's border.
    NoRoom,
    /// The part lies all around below, and feet on it are not allowed.
    Enclosed,
    /// The part lies all around, with no floor that a foot could stand on.
    NoFloor,
}

impl Reason {
    /// For people, and in reports.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Reason::NoRoom => {
                "no room for a tip and its branch between the surfaces of the part, or up to the border of the plate"
            }
            Reason::Enclosed => {
                "enclosed by the part: no way to the plate, and feet on the part are not allowed"
            }
            Reason::NoFloor => {
                "enclosed by the part: neither a way to the plate nor room for a foot on the part"
            }
        }
    }
}

/// What a branch stands on in the end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Floor {
    /// The plate.
    Plate,
    /// The part.
    Model,
}

/// A tip with its cone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Head {
    /// Where it touches, or would but for the gap, mm.
    pub contact_mm: [f64; 3],
    /// Radius there, mm: half of what the rules say where walls are near.
    pub contact_radius_mm: f64,
    /// Where the cone ends in a branch, mm.
    pub end_mm: [f64; 3],
    /// Radius there, mm: less than a branch has where there is no more room.
    pub end_radius_mm: f64,
    /// It is as thick as the rules say, at both ends.
    pub is_whole: bool,
    /// Where its branch can stand.
    pub floor: Floor,
}

impl Head {
    /// Where its axis is at a height, mm, or at the end that is the nearer.
    #[must_use]
    pub fn axis_mm(&self, z_mm: f64) -> [f64; 2] {
        let high_mm = self.contact_mm[2] - self.end_mm[2];
        let down = ((self.contact_mm[2] - z_mm) / high_mm).clamp(0.0, 1.0);
        let down = if high_mm > 0.0 { down } else { 0.0 };
        [0, 1].map(|k| self.contact_mm[k] + (self.end_mm[k] - self.contact_mm[k]) * down)
    }
}

/// A way from a place down to what it stands on.
#[derive(Clone, Debug, PartialEq)]
pub struct Way {
    /// Bends, and last the place that it stands on, mm.
    pub points_mm: Vec<[f64; 3]>,
    /// What that is.
    pub floor: Floor,
    /// Length, mm.
    pub length_mm: f64,
}

impl Way {
    /// The way that leads from a place through these points, mm.
    #[must_use]
    pub fn new(from_mm: [f64; 3], points_mm: Vec<[f64; 3]>, floor: Floor) -> Way {
        let starts = std::iter::once(&from_mm).chain(&points_mm);
        let length_mm = starts.zip(&points_mm).map(|(a, b)| distance(*a, *b)).sum();
        Way { points_mm, floor, length_mm }
    }
}

/// A part's space with the rules of its supports.
#[derive(Debug)]
pub struct Site<'a> {
    /// The space.
    pub space: &'a Clearance,
    /// The rules.
    pub rules: &'a Rules,
    /// Sideways a mm down, at most.
    pub slope: f64,
    reach: Reach,
}

impl<'a> Site<'a> {
    /// A part's space with these rules.
    #[must_use]
    pub fn new(space: &'a Clearance, rules: &'a Rules) -> Site<'a> {
        let slope = rules.slope();
        Site { space, rules, slope, reach: space.reach(rules.free_mm(), slope) }
    }

    /// The tip that holds a place, mm.
    ///
    /// # Errors
    /// Why there is none.
    pub fn head(&self, at_mm: [f64; 3]) -> Result<Head, Reason> {
        let rules = self.rules;
        let contact_z = (at_mm[2] - rules.gap_mm).max(at_mm[2].min(LEAST_TIP_MM));
        let contact_mm = [at_mm[0], at_mm[1], contact_z];
        let thin = (rules.tip_mm / 2.0, rules.tip_mm / 2.0 + rules.clearance_mm / 2.0);
        let usual = (rules.branch_mm / 2.0, rules.free_mm());
        let mut reason = Reason::NoRoom;
        // The better one first: a whole branch to the plate, a thin end of the head, then
        // feet on the part.
        for floor in [Floor::Plate, Floor::Model] {
            for ((end_radius_mm, free_mm), share) in [(usual, 1.0), (thin, 1.0), (thin, SLIM)] {
                let contact_radius_mm = rules.tip_mm / 2.0 * share;
                for end_mm in self.ends(at_mm, contact_mm) {
                    let thin_mm = contact_radius_mm + TIP_CLEARANCE_MM * share;
                    // A foot under a tip close to the plate is as wide as it is, and no more.
                    let wide_mm = if end_mm[2] <= 0.0 { thin_mm.max(end_radius_mm) } else { free_mm };
                    if !self.head_fits(at_mm, end_mm, thin_mm, wide_mm) {
                        continue;
                    }
                    let is_whole = end_radius_mm >= usual.0 && share == 1.0;
                    let head = Head { contact_mm, contact_radius_mm, end_mm, end_radius_mm, is_whole, floor };
                    match floor {
                        Floor::Plate if end_mm[2] <= 0.0 || self.reach.way(end_mm, 0.0).is_some() => {
                            return Ok(head);
                        }
                        Floor::Plate => {}
                        Floor::Model => match self.column(end_mm).map(|way| way.floor) {
                            Some(floor) if floor == Floor::Plate || rules.on_model => {
                                return Ok(Head { floor, ..head });
                            }
                            Some(_) => reason = Reason::Enclosed,
                            None => reason = Reason::NoFloor,
                        },
                    }
                }
            }
        }
        Err(reason)
    }

    /// Where a head may end: straight down, then leaning, the least lean first.
    fn ends(&self, at_mm: [f64; 3], contact_mm: [f64; 3]) -> impl Iterator<Item = [f64; 3]> + use<> {
        let head_mm = self.rules.head_mm;
        let low = self.rules.foot_height_mm;
        let slope = self.slope;
        let lengths = [1.0, 1.7, 0.6].map(|k| k * head_mm);
        let leans = [0.0, 0.5, 1.0].map(|k| k * slope);
        let directions = move |lean: f64| if lean == 0.0 { 1 } else { DIRECTIONS };
        leans.into_iter().flat_map(move |lean| {
            lengths.into_iter().flat_map(move |long| {
                (0..directions(lean)).map(move |k| {
                    let down = long / (1.0 + lean * lean).sqrt();
                    let z = contact_mm[2].min(at_mm[2]) - down;
                    // One that comes close to the plate stands on it.
                    let z = if z < low { 0.0 } else { z };
                    let turn = TAU * f64::from(k) / f64::from(DIRECTIONS);
                    let aside = lean * (contact_mm[2] - z).min(down).max(0.0);
                    [at_mm[0] + aside * turn.cos(), at_mm[1] + aside * turn.sin(), z]
                })
            })
        })
    }

    /// Whether a head fits: looked at from just below the slab that holds the overhang.
    fn head_fits(&self, at_mm: [f64; 3], end_mm: [f64; 3], thin: f64, wide: f64) -> bool {
        let slab = self.space.slab_mm();
        let from_z = ((at_mm[2] - 1e-6) / slab).floor() * slab;
        if from_z <= 0.0 && end_mm[2] <= 0.0 {
            // So low that its slab is the part's own: as thick as the tip, it fits.
            return end_mm[0] == at_mm[0] && end_mm[1] == at_mm[1];
        }
        if end_mm[2] >= from_z {
            return false;
        }
        let along = |z: f64| {
            let t = (at_mm[2] - z) / (at_mm[2] - end_mm[2]);
            ([0, 1, 2].map(|k| at_mm[k] + (end_mm[k] - at_mm[k]) * t), t)
        };
        let (from, t) = along(from_z - 1e-6);
        self.space.is_clear(from, end_mm, [thin + (wide - thin) * t, wide])
    }

    /// A way down for a branch.
    #[must_use]
    pub fn way(&self, from_mm: [f64; 3]) -> Option<Way> {
        if from_mm[2] <= 0.0 {
            return Some(Way::new(from_mm, Vec::new(), Floor::Plate));
        }
        let low = self.rules.foot_height_mm.min(from_mm[2]);
        let mut points_mm = match self.reach.way(from_mm, low) {
            Some(way) => self.straighten(from_mm, way),
            None => return self.column(from_mm).filter(|w| w.floor == Floor::Plate || self.rules.on_model),
        };
        points_mm.retain(|p| p[2] < from_mm[2] - 1e-9);
        let last = points_mm.last().copied().unwrap_or(from_mm);
        points_mm.push([last[0], last[1], 0.0]);
        Some(Way::new(from_mm, points_mm, Floor::Plate))
    }

    /// Straight down, past walls as close as a tip may be: onto the part, or onto the plate
    /// where nothing is between.
    fn column(&self, from_mm: [f64; 3]) -> Option<Way> {
        let slab = self.space.slab_mm();
        let thin = self.rules.tip_mm / 2.0 + TIP_CLEARANCE_MM;
        let wide = self.rules.tip_mm / 2.0 + self.rules.clearance_mm / 2.0;
        let down = |z: f64| [from_mm[0], from_mm[1], z];
        let Some(floor_mm) = self.space.floor_mm(from_mm) else {
            let fits = self.space.is_clear(from_mm, down(0.0), [wide; 2]);
            let low = self.rules.foot_height_mm.min(from_mm[2] / 2.0);
            let points_mm = vec![down(low), down(0.0)];
            return fits.then(|| Way::new(from_mm, points_mm, Floor::Plate));
        };
        // The slab that holds the floor itself is not looked at.
        let above = ((floor_mm / slab - 1e-6).floor() + 1.0) * slab + 1e-6;
        let long = from_mm[2] - floor_mm;
        if from_mm[2] <= above || !self.space.is_floor(from_mm) {
            return None;
        }
        let cone_mm = self.rules.head_mm.min(long / 2.0);
        let top = down((floor_mm + cone_mm).max(above));
        let fits = self.space.is_clear(from_mm, top, [wide; 2]);
        let fits = fits && self.space.is_clear(top, down(above), [wide, thin]);
        // The floor is the highest of its cell: a foot on a slope stands a cell deeper.
        let foot_mm = (floor_mm - self.space.cell_mm()).max(0.0);
        let points_mm = vec![top, down(foot_mm)];
        fits.then(|| Way::new(from_mm, points_mm, Floor::Model))
    }

    /// Leaves out bends that a straight branch can pass by.
    fn straighten(&self, from_mm: [f64; 3], way: Vec<[f64; 3]>) -> Vec<[f64; 3]> {
        let mut kept: Vec<[f64; 3]> = Vec::new();
        let mut at = 0;
        while at < way.len() {
            let last = kept.last().copied().unwrap_or(from_mm);
            let end = (at..way.len())
                .rev()
                .find(|k| leans_within(last, way[*k], self.slope) && self.branch_fits(last, way[*k]))
                .unwrap_or(at);
            kept.push(way[end]);
            at = end + 1;
        }
        kept
    }

    /// Whether a branch as thin as may be fits between two places, leaning no more than
    /// allowed.
    #[must_use]
    pub fn branch_fits(&self, from_mm: [f64; 3], to_mm: [f64; 3]) -> bool {
        self.space.is_clear(from_mm, to_mm, [self.rules.free_mm(); 2])
    }

    /// Radius that there is room for all along a way, mm.
    #[must_use]
    pub fn room_mm(&self, from_mm: [f64; 3], to_mm: [f64; 3]) -> f64 {
        self.space.away_along_mm(from_mm, to_mm) - self.rules.clearance_mm
    }

    /// What a way costs for so many tips, the farthest of them `length_mm` above its
    /// beginning: mm³ of material and what else is paid for.
    #[must_use]
    pub fn cost(&self, way: &Way, tips: u32, length_mm: f64) -> f64 {
        let rules = self.rules;
        let top = rules.radius_mm(tips, length_mm);
        match way.floor {
            Floor::Plate => {
                let low = rules.trunk_radius_mm(tips, length_mm + way.length_mm);
                let foot = rules.foot_mm.max(2.0 * low) / 2.0;
                let body = frustum_mm3((way.length_mm - rules.foot_height_mm).max(0.0), [top, low]);
                body + frustum_mm3(rules.foot_height_mm, [low, foot])
            }
            Floor::Model => frustum_mm3(way.length_mm, [top; 2]) + rules.landing_mm3,
        }
    }
}
