//! A mesh put where it is printed: turned, scaled, set down on the plate.
//!
//! Takes a [`Mesh`] and a [`Placing`], gives the mesh in millimetres with its lowest
//! point at z = 0, and a [`Doubt`] where its size looks like another unit's. Never
//! scales of its own accord.
use super::Mesh;
use serde::Serialize;

/// Largest coordinate that fits the slicing grid of 0.1 µm in 30 bits, mm.
pub const COORDINATE_MAX_MM: f64 = ((1 << 29) - 1) as f64 / 10_000.0;

/// Smallest height that is sliced, mm: a step of the slicing grid.
pub const HEIGHT_MIN_MM: f64 = 1e-4;

/// Below this in all directions a part was drawn in metres: 0.5 m at most, mm.
const METRES_BELOW_MM: f64 = 0.5;

/// Below this in all directions a part was drawn in inches: 5 inches at most, mm.
const INCHES_BELOW_MM: f64 = 5.0;

/// Above this in any direction a part was drawn in micrometres: no printer here is as large, mm.
const MICROMETRES_ABOVE_MM: f64 = 2000.0;

/// What to do with a mesh before it is sliced.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Placing {
    /// Degrees about the x, the y and the z axis, one after the other in this order, each
    /// counter-clockwise seen from the axis's positive end; the axes stay with the plate.
    pub rotate_deg: [f64; 3],
    /// Scale evenly to this height after turning, mm.
    pub height_mm: Option<f64>,
}

/// Another unit than millimetres.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Unit {
    /// 1000 mm.
    Metre,
    /// 25.4 mm.
    Inch,
    /// 0.001 mm.
    Micrometre,
}

impl Unit {
    /// Millimetres in one.
    #[must_use]
    pub fn mm(self) -> f64 {
        match self {
            Unit::Metre => 1000.0,
            Unit::Inch => 25.4,
            Unit::Micrometre => 0.001,
        }
    }

    fn plural(self) -> &'static str {
        match self {
            Unit::Metre => "metres",
            Unit::Inch => "inches",
            Unit::Micrometre => "micrometres",
        }
    }
}

/// A size that looks like another unit's.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Doubt {
    /// The unit that the file is likely in.
    pub unit: Unit,
    /// What the part measures if its numbers are millimetres, mm.
    pub size_mm: [f64; 3],
    /// Its height if the numbers are of that unit, mm.
    pub height_mm: f64,
}

impl std::fmt::Display for Doubt {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let ([x, y, z], unit) = (self.size_mm, self.unit.plural());
        let (x, y, z) = (figure(x), figure(y), figure(z));
        write!(
            f,
            "the part measures {x} × {y} × {z} mm; its file is likely in {unit}: if so, give --height-mm {}",
            figure(self.height_mm)
        )
    }
}

/// Three significant digits and more where there is a whole part, without an exponent.
fn figure(value: f64) -> String {
    let digits = if value >= 100.0 || value <= 0.0 {
        1
    } else {
        (2.0 - value.log10().floor()).clamp(1.0, 9.0) as usize
    };
    let text = format!("{value:.digits$}");
    text.trim_end_matches('0').trim_end_matches('.').to_string()
}

/// Why a mesh cannot be placed.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum PlaceError {
    /// The wished height is none.
    #[error(
        "--height-mm {height_mm}: the height must be more than {HEIGHT_MIN_MM} mm and at most {COORDINATE_MAX_MM} mm"
    )]
    Height {
        /// As wished.
        height_mm: f64,
    },
    /// An angle is no number.
    #[error("--rotate: an angle must be a finite number of degrees")]
    Angle,
    /// There is no height to slice or to scale.
    #[error(
        "the part is flat: it is {height_mm} mm high, so there is nothing to slice; give it a thickness, or turn it with --rotate"
    )]
    Flat {
        /// Its height.
        height_mm: f64,
    },
    /// A coordinate lies beyond the slicing grid.
    #[error(
        "the part reaches to {coordinate_mm:.0} mm, at most {COORDINATE_MAX_MM:.0} mm can be sliced; {}",
        advice(*doubt)
    )]
    TooLarge {
        /// The largest coordinate.
        coordinate_mm: f64,
        /// The unit that it may be in, where the part itself is as large.
        doubt: Option<Doubt>,
    },
}

/// What to do about a part that is too large.
fn advice(doubt: Option<Doubt>) -> String {
    match doubt {
        Some(doubt) => doubt.to_string(),
        None => "move it to the origin in the program that made it".to_string(),
    }
}

/// Turns, scales and sets a mesh down: the lowest point at z = 0, x and y about the
/// origin that the file has. Gives a doubt about the unit where no height was wished.
///
/// # Errors
/// A wish is out of range, the part has no height, or lies beyond the slicing grid;
/// the mesh is then as it was.
pub fn place(mesh: &mut Mesh, placing: &Placing) -> Result<Option<Doubt>, PlaceError> {
    if !placing.rotate_deg.iter().all(|a| a.is_finite()) {
        return Err(PlaceError::Angle);
    }
    if let Some(height_mm) = placing.height_mm
        && !(height_mm > HEIGHT_MIN_MM && height_mm <= COORDINATE_MAX_MM)
    {
        return Err(PlaceError::Height { height_mm });
    }
    let turn = turning(placing.rotate_deg);
    let vertices = mesh.vertices.iter().map(|v| turn.map(|row| super::vector::dot(row, *v)));
    let mut vertices: Vec<[f64; 3]> = vertices.collect();
    let [low, high] = super::bounds(&vertices);
    let height_mm = high[2] - low[2];
    if !(height_mm >= HEIGHT_MIN_MM || placing.height_mm.is_some() && height_mm > 0.0) {
        return Err(PlaceError::Flat { height_mm: height_mm.max(0.0) });
    }
    let scale = placing.height_mm.map_or(1.0, |wished| wished / height_mm);
    for v in &mut vertices {
        *v = [v[0] * scale, v[1] * scale, (v[2] - low[2]) * scale];
    }
    let [low, high] = super::bounds(&vertices);
    let largest = low.iter().chain(&high).fold(0.0_f64, |m, c| m.max(c.abs()));
    let doubt = doubt(super::vector::sub(high, low));
    if largest > COORDINATE_MAX_MM {
        return Err(PlaceError::TooLarge { coordinate_mm: largest, doubt });
    }
    mesh.vertices = vertices;
    Ok(doubt.filter(|_| placing.height_mm.is_none()))
}

/// The rows of the matrix that turns about x, then y, then z; exact for quarter turns.
fn turning(deg: [f64; 3]) -> [[f64; 3]; 3] {
    let quarter = |d: f64| match d.rem_euclid(360.0) {
        0.0 => (0.0, 1.0),
        90.0 => (1.0, 0.0),
        180.0 => (0.0, -1.0),
        270.0 => (-1.0, 0.0),
        other => other.to_radians().sin_cos(),
    };
    let [(sx, cx), (sy, cy), (sz, cz)] = deg.map(quarter);
    [
        [cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx],
        [sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx],
        [-sy, cy * sx, cy * cx],
    ]
}

/// Whether a size looks like another unit's.
fn doubt(size_mm: [f64; 3]) -> Option<Doubt> {
    let largest = size_mm.iter().fold(0.0_f64, |m, &c| m.max(c));
    let unit = if largest < METRES_BELOW_MM {
        Unit::Metre
    } else if largest < INCHES_BELOW_MM {
        Unit::Inch
    } else if largest > MICROMETRES_ABOVE_MM {
        Unit::Micrometre
    } else {
        return None;
    };
    Some(Doubt { unit, size_mm, height_mm: size_mm[2] * unit.mm() })
}

#[cfg(test)]
mod tests {
    use super::super::sample::block;
    use super::*;

    /// A block of 10 × 20 × 30 mm with its lowest corner at (1, 2, 3).
    fn part() -> Mesh {
        block([1.0, 2.0, 3.0], [10.0, 20.0, 30.0]).mesh()
    }

    fn near(found: [[f64; 3]; 2], expect: [[f64; 3]; 2]) {
        for (f, e) in found.as_flattened().iter().zip(expect.as_flattened()) {
            assert!((f - e).abs() < 1e-9, "{found:?}, not {expect:?}");
        }
    }

    #[test]
    fn parts_are_turned_scaled_and_set_down() {
        let check = |rotate_deg: [f64; 3], height_mm: Option<f64>, expect: [[f64; 3]; 2]| {
            let mut mesh = part();
            let volume = mesh.volume_mm3();
            assert_eq!(place(&mut mesh, &Placing { rotate_deg, height_mm }), Ok(None));
            near(mesh.bounds_mm(), expect);
            let size = [0, 1, 2].map(|k| expect[1][k] - expect[0][k]);
            assert!((mesh.volume_mm3() - size.iter().product::<f64>()).abs() < 1e-6 && volume > 0.0);
        };
        check([0.0; 3], None, [[1.0, 2.0, 0.0], [11.0, 22.0, 30.0]]);
        check([0.0; 3], Some(60.0), [[2.0, 4.0, 0.0], [22.0, 44.0, 60.0]]);
        // About x: y goes to z, z to −y.
        check([90.0, 0.0, 0.0], None, [[1.0, -33.0, 0.0], [11.0, -3.0, 20.0]]);
        // About y: z goes to x, x to −z.
        check([0.0, 90.0, 0.0], None, [[3.0, 2.0, 0.0], [33.0, 22.0, 10.0]]);
        // About z: x goes to y, y to −x.
        check([0.0, 0.0, 90.0], None, [[-22.0, 1.0, 0.0], [-2.0, 11.0, 30.0]]);
        // First about x (y to z), then about z (x to y, y to −x).
        check([90.0, 0.0, 90.0], None, [[3.0, 1.0, 0.0], [33.0, 11.0, 20.0]]);
        check([-270.0, 360.0, 450.0], Some(10.0), [[1.5, 0.5, 0.0], [16.5, 5.5, 10.0]]);
    }

    #[test]
    fn other_angles_keep_lengths() {
        let mut mesh = part();
        let [before, area] = [mesh.volume_mm3(), mesh.area_mm2()];
        place(&mut mesh, &Placing { rotate_deg: [33.0, -71.5, 12.25], height_mm: None }).expect("placed");
        assert!((mesh.volume_mm3() - before).abs() < 1e-8 && (mesh.area_mm2() - area).abs() < 1e-8);
        assert!(mesh.bounds_mm()[0][2].abs() < 1e-12);
    }

    #[test]
    fn sizes_of_other_units_are_doubted() {
        let check = |size: [f64; 3], expect: Option<(Unit, &str)>| {
            let doubt = place(&mut block([0.0; 3], size).mesh(), &Placing::default()).expect("placed");
            assert_eq!(doubt.map(|d| d.unit), expect.map(|e| e.0), "{size:?}");
            if let (Some(doubt), Some((_, text))) = (doubt, expect) {
                assert!(doubt.to_string().contains(text), "{doubt}");
            }
        };
        check([0.06, 0.03, 0.048], Some((Unit::Metre, "likely in metres: if so, give --height-mm 48")));
        check(
            [2.5, 1.0, 1.5],
            Some((
                Unit::Inch,
                "2.5 × 1 × 1.5 mm; its file is likely in inches: if so, give --height-mm 38.1",
            )),
        );
        check([50_000.0, 31_000.0, 48_000.0], Some((Unit::Micrometre, "50000 × 31000 × 48000 mm")));
        check([5.5, 5.5, 10.0], None);
        check([300.0, 300.0, 400.0], None);
    }

    #[test]
    fn what_cannot_be_placed_stays_as_it_was() {
        let check = |size: [f64; 3], placing: Placing, expect: &str| {
            let mut mesh = block([0.0; 3], size).mesh();
            let before = mesh.clone();
            let error = place(&mut mesh, &placing).expect_err("refused").to_string();
            assert!(error.contains(expect), "{error}");
            assert_eq!(mesh, before);
        };
        let height = |h: f64| Placing { height_mm: Some(h), ..Placing::default() };
        let ten = [10.0; 3];
        check(ten, height(0.0), "--height-mm 0:");
        check(ten, height(-5.0), "--height-mm -5:");
        check(ten, height(f64::NAN), "--height-mm NaN");
        check(ten, height(f64::INFINITY), "--height-mm inf");
        check(ten, Placing { rotate_deg: [0.0, f64::NAN, 0.0], height_mm: None }, "--rotate");
        check([10.0, 10.0, 1e-5], Placing::default(), "flat");
        check([60_000.0, 10.0, 20_000.0], Placing::default(), "reaches to 60000 mm, at most 53687 mm");
        check([60_000.0, 10.0, 20_000.0], Placing::default(), "in micrometres: if so, give --height-mm 20");
        let far = place(&mut block([1e5; 3], ten).mesh(), &Placing::default()).expect_err("far").to_string();
        assert!(far.contains("reaches to 100010 mm") && far.contains("move it to the origin"), "{far}");
        check([10_000.0, 10.0, 10.0], height(10_000.0), "reaches to");
        check([1e30, 1e30, 1e30], Placing::default(), "reaches to");
    }
}
