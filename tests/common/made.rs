//! Files made for tests: boxes as STL, pictures and archives of resin jobs.
use std::io::{Cursor, Write};

/// Corners, mm.
pub(crate) type Triangle = [[f32; 3]; 3];

/// A closed box from corner to corner, mm.
pub(crate) fn cuboid(low: [f32; 3], high: [f32; 3]) -> Vec<Triangle> {
    let at = |k: usize| {
        let pick = |axis: usize| if k >> axis & 1 == 0 { low[axis] } else { high[axis] };
        [pick(0), pick(1), pick(2)]
    };
    // Each face counter-clockwise seen from outside; bit 0 is x, 1 y, 2 z.
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    faces.iter().flat_map(|&[a, b, c, d]| [[at(a), at(b), at(c)], [at(a), at(c), at(d)]]).collect()
}

/// A binary STL file.
pub(crate) fn binary_stl(triangles: &[Triangle]) -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for triangle in triangles {
        bytes.extend([0; 12]);
        bytes.extend(triangle.iter().flatten().flat_map(|c| c.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

/// A zip of these entries.
pub(crate) fn archive<N: AsRef<str>, B: AsRef<[u8]>>(entries: &[(N, B)]) -> Vec<u8> {
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in entries {
        zip.start_file(name.as_ref(), zip::write::SimpleFileOptions::default()).expect("an entry");
        zip.write_all(bytes.as_ref()).expect("its bytes");
    }
    zip.finish().expect("an archive").into_inner()
}

/// A grey picture of some pixels with bright rectangles `[left, top, right, bottom]`.
pub(crate) fn png([wide, high]: [usize; 2], bright: &[[usize; 4]]) -> Vec<u8> {
    let mut pixels = vec![0_u8; wide * high];
    for &[left, top, right, bottom] in bright {
        for y in top..bottom {
            pixels[y * wide + left..y * wide + right].fill(255);
        }
    }
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, wide as u32, high as u32);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.write_header().and_then(|mut w| w.write_image_data(&pixels)).expect("a picture");
    bytes
}
