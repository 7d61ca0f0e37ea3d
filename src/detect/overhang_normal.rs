//! Overhangs by the normals of a mesh's faces (paper 001, section 2.1).
//!
//! Takes a mesh, gives the faces that look down and lean farther from the vertical than
//! the material bears, joined over their edges to regions. Faces on the plate are none.
//! Fast, and blind to what lies around: it reports each face that its neighbours would
//! carry (paper 001, Fig. 1). Bridges are no concern of faces. Knows no polygon.
use super::overhang::{MAX_REGIONS, Method, OverhangRegion, Overhangs, SelfSupport};
use crate::mesh::{Mesh, OPEN};

/// A face none of whose corners is higher than this lies on the plate, mm.
pub const ON_PLATE_MM: f64 = 1e-3;

/// A face leans too far only if it does by this much more, degrees: so that one at
/// exactly the steepest angle holds itself although its corners are rounded to `f32`.
const SLACK_DEG: f64 = 0.01;

/// Finds the faces that lean too far. `layer_of` tells the layer that holds a height (mm).
#[must_use]
pub fn overhangs(mesh: &Mesh, rules: &SelfSupport, layer_of: impl Fn(f64) -> u32) -> Overhangs {
    let faces: Vec<Option<Face>> =
        mesh.triangles.iter().map(|t| Face::leaning(mesh, *t, rules.angle_deg)).collect();
    let mut seen = vec![false; faces.len()];
    let mut found = Overhangs {
        method: Method::Normal,
        regions: Vec::new(),
        small: Vec::new(),
        unlisted: 0,
        area_mm2: 0.0,
        small_area_mm2: 0.0,
    };
    let mut open: Vec<usize> = Vec::new();
    for first in 0..faces.len() {
        if seen[first] || faces[first].is_none() {
            continue;
        }
        let mut region = Sum::default();
        seen[first] = true;
        open.push(first);
        while let Some(t) = open.pop() {
            if let Some(face) = &faces[t] {
                region.add(face);
            }
            for twin in mesh.twins[3 * t..3 * t + 3].iter().filter(|h| **h != OPEN) {
                let next = *twin as usize / 3;
                if !seen[next] && faces[next].is_some() {
                    seen[next] = true;
                    open.push(next);
                }
            }
        }
        put(&mut found, region.region(&layer_of), rules.min_area_mm2);
    }
    let order = |a: &OverhangRegion, b: &OverhangRegion| {
        let (p, q) = (a.bbox_mm[0], b.bbox_mm[0]);
        a.z_mm.total_cmp(&b.z_mm).then(p[0].total_cmp(&q[0])).then(p[1].total_cmp(&q[1]))
    };
    found.regions.sort_by(order);
    found.small.sort_by(order);
    found
}

fn put(found: &mut Overhangs, region: OverhangRegion, min_area_mm2: f64) {
    let small = region.area_mm2 < min_area_mm2;
    let total = if small { &mut found.small_area_mm2 } else { &mut found.area_mm2 };
    *total += region.area_mm2;
    if found.regions.len() + found.small.len() >= MAX_REGIONS {
        found.unlisted += 1;
    } else if small {
        found.small.push(region);
    } else {
        found.regions.push(region);
    }
}

/// A face that leans too far.
struct Face {
    corners: [[f64; 3]; 3],
    area_mm2: f64,
    /// Seen from below.
    projected_mm2: f64,
}

impl Face {
    fn leaning(mesh: &Mesh, triangle: [u32; 3], angle_deg: f64) -> Option<Face> {
        let corners = triangle.map(|v| mesh.vertices[v as usize]);
        let [a, b, c] = corners;
        let side = |p: [f64; 3]| [p[0] - a[0], p[1] - a[1], p[2] - a[2]];
        let (u, v) = (side(b), side(c));
        let normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        let length = normal.iter().map(|n| n * n).sum::<f64>().sqrt();
        let on_plate = corners.iter().all(|p| p[2] <= ON_PLATE_MM);
        // The face leans from the vertical by the angle of its normal from the horizontal.
        let steepest = (angle_deg.clamp(0.0, 90.0) + SLACK_DEG).to_radians().min(std::f64::consts::FRAC_PI_2);
        let leans = length > 0.0 && -normal[2] / length > steepest.sin();
        (leans && !on_plate).then(|| Face {
            corners,
            area_mm2: length / 2.0,
            projected_mm2: -normal[2] / 2.0,
        })
    }
}

/// Faces added up.
#[derive(Default)]
struct Sum {
    area: f64,
    projected: f64,
    moment: [f64; 2],
    /// Lowest and highest x, y and z.
    ends: Option<[[f64; 3]; 2]>,
}

impl Sum {
    fn add(&mut self, face: &Face) {
        self.area += face.area_mm2;
        self.projected += face.projected_mm2;
        for k in 0..2 {
            let middle = face.corners.iter().map(|p| p[k]).sum::<f64>() / 3.0;
            self.moment[k] += middle * face.projected_mm2;
        }
        for p in &face.corners {
            let ends = self.ends.get_or_insert([*p, *p]);
            for k in 0..3 {
                ends[0][k] = ends[0][k].min(p[k]);
                ends[1][k] = ends[1][k].max(p[k]);
            }
        }
    }

    fn region(self, layer_of: impl Fn(f64) -> u32) -> OverhangRegion {
        let [low, high] = self.ends.unwrap_or_default();
        OverhangRegion {
            layer: layer_of(low[2]),
            z_mm: low[2],
            end_layer: layer_of(high[2]),
            end_z_mm: high[2],
            area_mm2: self.projected,
            surface_mm2: self.area,
            centroid_mm: self.moment.map(|m| m / self.projected.max(f64::MIN_POSITIVE)),
            bbox_mm: [[low[0], low[1]], [high[0], high[1]]],
            island: false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A block on the plate with one side that leans out at this angle from the vertical.
    fn leaning_block(angle_deg: f64) -> Mesh {
        let out = 10.0 * angle_deg.to_radians().tan();
        let vertices = vec![
            [0.0, 0.0, 0.0],
            [10.0, 0.0, 0.0],
            [10.0, 5.0, 0.0],
            [0.0, 5.0, 0.0],
            [0.0, 0.0, 10.0],
            [10.0 + out, 0.0, 10.0],
            [10.0 + out, 5.0, 10.0],
            [0.0, 5.0, 10.0],
        ];
        let quads = [[3, 2, 1, 0], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]];
        let triangles: Vec<[u32; 3]> =
            quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
        let ends = |h: usize| (triangles[h / 3][h % 3], triangles[h / 3][(h % 3 + 1) % 3]);
        let twin = |h: usize| {
            let (a, b) = ends(h);
            (0..3 * triangles.len()).find(|&g| ends(g) == (b, a)).map_or(OPEN, |g| g as u32)
        };
        let twins = (0..3 * triangles.len()).map(twin).collect();
        Mesh { vertices, triangles, twins }
    }

    #[test]
    fn faces_that_lean_too_far_are_one_region() {
        let check = |lean: f64, angle_deg: f64, regions: usize| {
            let rules = SelfSupport { angle_deg, bridge_mm: 0.0, min_area_mm2: 0.0 };
            let found = overhangs(&leaning_block(lean), &rules, |z| (z * 10.0) as u32);
            assert_eq!(found.regions.len(), regions, "{lean} {angle_deg}");
            if let [region] = found.regions.as_slice() {
                let out = 10.0 * lean.to_radians().tan();
                assert!((region.area_mm2 - 5.0 * out).abs() < 1e-9);
                assert!((region.surface_mm2 - 5.0 * (100.0 + out * out).sqrt()).abs() < 1e-9);
                assert_eq!((region.layer, region.end_layer), (0, 100));
                assert!((region.bbox_mm[1][0] - 10.0 - out).abs() < 1e-12);
                assert!((region.centroid_mm[0] - 10.0 - out / 2.0).abs() < 1e-9);
            }
        };
        check(44.0, 45.0, 0);
        check(45.0, 45.0, 0);
        check(46.0, 45.0, 1);
        check(0.0, 0.0, 0);
        check(-20.0, 0.0, 0);
        check(80.0, 90.0, 0);
        check(30.0, 29.0, 1);
    }

    #[test]
    fn what_lies_on_the_plate_is_no_overhang_but_what_hangs_above_is() {
        let mut mesh = leaning_block(0.0);
        let rules = SelfSupport { angle_deg: 45.0, bridge_mm: 0.0, min_area_mm2: 0.0 };
        assert_eq!(overhangs(&mesh, &rules, |_| 0).regions, []);
        mesh.vertices.iter_mut().for_each(|v| v[2] += 1.0);
        let found = overhangs(&mesh, &rules, |_| 0);
        assert!((found.area_mm2 - 50.0).abs() < 1e-9 && found.regions.len() == 1);
        let all_small = overhangs(&mesh, &SelfSupport { min_area_mm2: 51.0, ..rules }, |_| 0);
        assert!((all_small.small_area_mm2 - 50.0).abs() < 1e-9 && all_small.regions.is_empty());
    }
}
