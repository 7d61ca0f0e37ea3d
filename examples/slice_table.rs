//! scratch
use outrigger::layers::from_mesh::{FromMesh, LayerHeights};
use outrigger::layers::stack::Layers;
use std::time::Instant;
fn main() {
    let h: f64 = std::env::args().nth(1).unwrap().parse().unwrap();
    for path in std::env::args().skip(2) {
        let bytes = std::fs::read(&path).unwrap();
        let t0 = Instant::now();
        let (mesh, _) = match outrigger::mesh::read(&mut std::io::Cursor::new(&bytes)) {
            Ok(x) => x,
            Err(e) => {
                eprintln!("{path} {e}");
                continue;
            }
        };
        let t1 = Instant::now();
        let mut s = match FromMesh::new(&mesh, LayerHeights::even(h)) {
            Ok(x) => x,
            Err(e) => {
                eprintln!("{path} {e}");
                continue;
            }
        };
        let t2 = Instant::now();
        let (mut n, mut v, mut polys, mut vol) = (0, 0, 0, 0.0);
        while let Some(b) = s.next_batch().unwrap() {
            for l in &b {
                n += 1;
                v += l.part.len();
                polys += l.part.polygons.len();
                vol += l.part.area_mm2() * l.thickness_mm();
            }
        }
        let t3 = Instant::now();
        let name = path.rsplit('/').next().unwrap();
        let ms = |a: Instant, b: Instant| (b - a).as_secs_f64() * 1e3;
        eprintln!(
            "{name:36} tri {:7} read {:6.1} new {:5.1} slice {:6.1} ms  layers {n} verts {v} polys {polys} vol {:.3} cm3 {:?}",
            mesh.triangles.len(),
            ms(t0, t1),
            ms(t1, t2),
            ms(t2, t3),
            vol / 1000.0,
            s.sliced()
        );
    }
}
