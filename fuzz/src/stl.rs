//! STL files: no file makes the reader, the mends or the placing panic, and every
//! mesh that comes out has neighbours that agree.
//!
//! Takes the fuzzer's bytes as a file, or (first byte odd) as the corners of
//! triangles on a coarse grid, where surfaces touch, fold and cross all the time.
#![no_main]
use libfuzzer_sys::fuzz_target;
use outrigger::mesh::place::{COORDINATE_MAX_MM, Placing, place};
use outrigger::mesh::{OPEN, read};
use std::io::Cursor;

/// Places along an axis: whole steps, a rounding beside them, and some far away.
const PLACES: [f32; 16] =
    [0.0, 1.0, 2.0, 3.0, 4.0, 0.5, 1.5, -0.0, 1.000_000_1, 2.000_001, 1.0 / 3.0, 1e-30, -7.0, 100.0, 1e9, 3e38];

fuzz_target!(|data: &[u8]| {
    let file = match data.split_first() {
        Some((kind, corners)) if kind % 2 == 1 => file_of(corners),
        _ => data.to_vec(),
    };
    let Ok((mut mesh, report)) = read(&mut Cursor::new(&file)) else { return };
    assert_eq!(mesh.twins.len(), mesh.triangles.len() * 3);
    let ends = |h: usize| [mesh.triangles[h / 3][h % 3], mesh.triangles[h / 3][(h + 1) % 3]];
    for (h, &twin) in mesh.twins.iter().enumerate().filter(|t| *t.1 != OPEN) {
        let ([a, b], [c, d]) = (ends(h), ends(twin as usize));
        assert!(mesh.twins[twin as usize] as usize == h && a == d && b == c && a != b);
    }
    let open = mesh.twins.iter().filter(|&&t| t == OPEN).count() as u64;
    assert_eq!(open, report.mended.open_edges);
    let _ = (report.mended.to_string(), report.warnings());
    let placing = Placing { rotate_deg: [30.0, -90.0, 400.0], height_mm: (file[0] % 3 == 0).then_some(12.5) };
    if place(&mut mesh, &placing).is_ok() {
        let [low, high] = mesh.bounds_mm();
        assert!(low[2] == 0.0 && low.iter().chain(&high).all(|c| c.abs() <= COORDINATE_MAX_MM));
    }
});

/// A binary STL: two bytes a corner, four bits a coordinate and four to spare.
fn file_of(bytes: &[u8]) -> Vec<u8> {
    let corners: Vec<[f32; 3]> = bytes
        .chunks_exact(2)
        .map(|b| [b[0] & 15, b[0] >> 4, b[1] & 15].map(|k| PLACES[usize::from(k)]))
        .collect();
    let triangles = corners.chunks_exact(3);
    let mut file = vec![0; 80];
    file.extend((triangles.len() as u32).to_le_bytes());
    for t in triangles {
        file.extend([0; 12]);
        t.as_flattened().iter().for_each(|c| file.extend(c.to_le_bytes()));
        file.extend([0; 2]);
    }
    file
}
