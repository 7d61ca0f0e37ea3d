//! How much of a mark a tip leaves: on an edge, on fine detail, where it is seen.
//!
//! Takes a place of an underside where a tip can stand, and the space around the part; gives
//! 0 for a smooth place that nobody sees and up to 1 for an edge in the open. Knows nothing of
//! what a tip holds.
//!
//! - *Edge*: how much of a small ball about the place is part. It is a half on anything smooth,
//!   a quarter on a right-angled edge, less on a corner, and more in a hollow (an integral
//!   invariant: Manay, Hong, Yezzi and Soatto, "Integral invariant signatures", 2004).
//! - *Detail*: how long the outlines of the slabs in that ball are. A smooth surface or an edge
//!   crosses a slab once; letters, scales and fins do so several times.
//! - *Seen*: how much one sees of the place from beside it, along the plate.
//!
//! The part is looked at as it was drawn: relief that is less deep than a slab may go unseen,
//! and edges blunter than [`SMOOTH`] are told from slopes by nobody.
use super::clearance::Clearance;
use std::f64::consts::{SQRT_2, TAU};

/// Radius of the ball, mm.
const BALL_MM: f64 = 1.6;

/// Cells in the radius of the ball at least, where cells are wide.
const BALL_CELLS: f64 = 4.0;

/// Share of the ball on an edge of 144°. From here on a place is smooth: a slope that was
/// drawn into slabs reads as little.
const SMOOTH: f64 = 0.4;

/// Share of the ball on an edge of 90°, and from here down a place is as sharp as can be.
const SHARP: f64 = 0.25;

/// Directions in which the place is looked at.
const DIRECTIONS: u32 = 16;

/// So many cells beside the place a look at it begins.
const BESIDE_CELLS: f64 = 2.0;

/// From so many of these one sees a place that lies outside: the part itself hides the rest.
const OUTSIDE: f64 = 0.5;

/// What being seen weighs against edge and detail: it decides where these are about equal.
const SEEN_WEIGHT: f64 = 0.2;

/// What makes a mark matter at a place: each from 0, not at all, to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Scar {
    /// It lies on an edge or a corner.
    pub edge: f64,
    /// It lies among fine detail.
    pub detail: f64,
    /// It lies where one sees it.
    pub seen: f64,
}

impl Scar {
    /// How much a tip there scars in all, 0 to 1.
    #[must_use]
    pub fn weight(&self) -> f64 {
        (1.0 - SEEN_WEIGHT) * self.edge.max(self.detail) + SEEN_WEIGHT * self.seen
    }
}

/// Looks at places of a part.
#[derive(Debug)]
pub struct Eye<'a> {
    space: &'a Clearance,
    /// The ball, a slab each from the lowest up: its height from the middle, mm, and how far
    /// each of its rows of cells reaches, from the first row on.
    ball: Vec<(f64, Vec<i32>)>,
    radius_mm: f64,
}

impl<'a> Eye<'a> {
    /// For places of the part in this space.
    #[must_use]
    pub fn new(space: &'a Clearance) -> Eye<'a> {
        let (cell, slab) = (space.cell_mm(), space.slab_mm());
        let radius_mm = BALL_MM.max(BALL_CELLS * cell);
        let slabs = (radius_mm / slab).round() as i32;
        let rows = |up_mm: f64| {
            let half = |y_mm: f64| (radius_mm * radius_mm - up_mm * up_mm - y_mm * y_mm).max(0.0).sqrt();
            let deep = (half(0.0) / cell) as i32;
            (-deep..=deep).map(|y| (half(f64::from(y) * cell) / cell) as i32).collect()
        };
        let ball = (-slabs..slabs).map(|k| (f64::from(k) + 0.5) * slab).map(|up| (up, rows(up))).collect();
        Eye { space, ball, radius_mm }
    }

    /// What a tip leaves at a place of an underside that has some room below it, mm.
    #[must_use]
    pub fn scar(&self, at_mm: [f64; 3]) -> Scar {
        let (share, outline_mm) = self.ball(at_mm);
        // A straight line through the middle of the ball, and no shorter for its steps.
        let line_mm = 2.0 * SQRT_2 * self.radius_mm;
        Scar {
            edge: ((SMOOTH - share) / (SMOOTH - SHARP)).clamp(0.0, 1.0),
            detail: (outline_mm / line_mm - 1.0).clamp(0.0, 1.0),
            seen: (self.open(at_mm) / OUTSIDE).min(1.0),
        }
    }

    /// Which share of the ball about a place is part, and the length of outline in that slab
    /// of it that has the most, mm.
    fn ball(&self, at_mm: [f64; 3]) -> (f64, f64) {
        let (cell, slab) = (self.space.cell_mm(), self.space.slab_mm());
        // What begins anywhere in a slab was drawn from its bottom on.
        let bottom_mm = (at_mm[2] / slab + 1e-6).floor() * slab;
        let (mut part, mut all, mut most) = (0_u32, 0_u32, 0_u32);
        for (up_mm, rows) in &self.ball {
            let deep = rows.len() as i32 / 2;
            let is_part = |x: i32, y: i32| {
                let aside = [x, y].map(|c| f64::from(c) * cell);
                self.space.is_part([at_mm[0] + aside[0], at_mm[1] + aside[1], bottom_mm + up_mm])
            };
            // Borders between a cell and the next along its row, and across.
            let mut borders = 0;
            for (k, half) in rows.iter().enumerate() {
                let (y, next) = (k as i32 - deep, rows.get(k + 1).copied().unwrap_or(-1));
                for x in -half..=*half {
                    let here = is_part(x, y);
                    part += u32::from(here);
                    all += 1;
                    borders += u32::from(x < *half && is_part(x + 1, y) != here);
                    borders += u32::from(x.abs() <= next && is_part(x, y + 1) != here);
                }
            }
            most = most.max(borders);
        }
        (f64::from(part) / f64::from(all.max(1)), f64::from(most) * cell)
    }

    /// In which share of all directions one looks past the part from just under a place.
    fn open(&self, at_mm: [f64; 3]) -> f64 {
        let slab = self.space.slab_mm();
        // The slab below the one that holds the underside: a tip there has room around it.
        let below_mm = (((at_mm[2] - 1e-6) / slab).floor() * slab - slab / 2.0).max(0.0);
        // A steep slope is drawn over the place itself, so that the look begins beside it.
        let aside_mm = BESIDE_CELLS * self.space.cell_mm();
        let turns = (0..DIRECTIONS).map(|k| TAU * f64::from(k) / f64::from(DIRECTIONS));
        let sees = |turn: &f64| {
            let [x, y] = [turn.cos(), turn.sin()];
            self.space.sees_past([at_mm[0] + x * aside_mm, at_mm[1] + y * aside_mm, below_mm], [x, y])
        };
        let open = turns.filter(sees).count();
        open as f64 / f64::from(DIRECTIONS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layers::shape::Region;
    use crate::support::rules::{Process, Rules};
    use crate::support::testing::{layers, region, seen};

    /// Each of these is between 0 and 1: at least, at most.
    type Within = [f64; 2];
    const NONE: Within = [0.0, 0.1];
    const SOME: Within = [0.3, 0.75];
    const MUCH: Within = [0.8, 1.0];
    const ANY: Within = [0.0, 1.0];

    fn check(part: impl Fn(f64) -> Region, at_mm: [f64; 3], [edge, detail, seen_at]: [Within; 3]) {
        let space = seen(layers(120, 0.1, part), &Rules::usual(Process::Resin, 0.1)).space;
        let scar = Eye::new(&space).scar(at_mm);
        for (what, got, [least, most]) in
            [("edge", scar.edge, edge), ("detail", scar.detail, detail), ("seen", scar.seen, seen_at)]
        {
            assert!((least..=most).contains(&got), "{what} at {at_mm:?}: {got}, not {least} to {most}");
        }
    }

    /// A plate on a thin leg.
    fn table(z_mm: f64) -> Region {
        region(&[if z_mm < 6.0 { [0.0, 0.0, 2.0, 2.0] } else { [0.0, 0.0, 20.0, 20.0] }])
    }

    #[test]
    fn edges_and_corners_of_a_plate() {
        for (x, y, edge) in [
            (10.0, 10.0, NONE),
            (18.0, 10.0, NONE),
            (20.0, 10.0, MUCH),
            (19.8, 10.0, SOME),
            (20.0, 20.0, MUCH),
            (19.4, 19.4, SOME),
            // Where the leg begins is a hollow.
            (2.2, 1.0, NONE),
        ] {
            check(table, [x, y, 6.0], [edge, NONE, ANY]);
        }
    }

    #[test]
    fn slopes_are_smooth_however_steep() {
        for degrees in [5.0_f64, 10.0, 20.0, 30.0, 45.0, 60.0] {
            let over = |z_mm: f64| z_mm / degrees.to_radians().tan();
            for z_mm in [5.0, 5.3, 6.1] {
                let place = [5.0 + over(z_mm + 0.05), 10.0, z_mm];
                check(|z| region(&[[0.0, 0.0, 5.0 + over(z), 20.0]]), place, [NONE, NONE, MUCH]);
            }
        }
    }

    #[test]
    fn ribs_are_detail() {
        let ribs = |z_mm: f64| {
            let rib = |k: u32| [10.0 + f64::from(k), 0.0, 10.5 + f64::from(k), 20.0];
            let below: Vec<[f64; 4]> = [[0.0, 0.0, 2.0, 20.0]].into_iter().chain((0..8).map(rib)).collect();
            match z_mm {
                z if z < 6.0 => region(&below[..1]),
                z if z < 7.0 => region(&below),
                _ => region(&[[0.0, 0.0, 20.0, 20.0]]),
            }
        };
        check(ribs, [14.2, 10.0, 6.0], [ANY, MUCH, MUCH]);
        check(ribs, [6.0, 10.0, 7.0], [NONE, NONE, ANY]);
    }

    #[test]
    fn inside_is_seen_less_than_outside() {
        let walls =
            [[0.0, 0.0, 20.0, 1.0], [0.0, 19.0, 20.0, 20.0], [0.0, 0.0, 1.0, 20.0], [19.0, 0.0, 20.0, 20.0]];
        let hood = |z_mm: f64| if z_mm < 6.0 { region(&walls) } else { region(&[[0.0, 0.0, 24.0, 20.0]]) };
        check(hood, [10.0, 10.0, 6.0], [NONE, NONE, NONE]);
        check(hood, [22.0, 10.0, 6.0], [NONE, NONE, [0.9, 1.0]]);
        // A wall on three sides.
        check(|z| if z < 6.0 { region(&walls[..3]) } else { hood(z) }, [12.0, 10.0, 6.0], [NONE, NONE, SOME]);
    }
}
