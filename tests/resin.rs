//! Real resin jobs, where the samples are at hand: their pictures become the shapes of
//! the model that they were sliced from.
//!
//! The oracles share no code with the project: bright pixels are counted, and the
//! model's triangles are cut here.
use outrigger::layers::from_images::FromImages;
use outrigger::layers::shape::Region;
use outrigger::layers::stack::Layers;
use outrigger::resin;
use outrigger::resin::archive::Archive;
use outrigger::resin::job::Format;
use std::io::{Cursor, Write};
use std::path::Path;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

/// A sample, and how many layers it has.
const SAMPLES: [(&str, u32); 2] = [("calib-supporttest-bare", 200), ("calib-supporttest-supports-pad", 260)];

/// Length of a pixel of the SL1's panel, and the panel's middle, mm.
const PIXEL_MM: f64 = 0.047_25;
const MIDDLE_MM: [f64; 2] = [60.48, 34.02];

type Edge = [[f64; 2]; 2];

fn shared(path: &str) -> Option<Vec<u8>> {
    std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared").join(path)).ok()
}

/// The job with some of its layers only, numbered anew: pictures are slow to unpack
/// without optimisation.
fn with_layers(job: &[u8], name: &str, layers: &[u32]) -> Vec<u8> {
    let mut archive = Archive::open(Cursor::new(job)).expect("an archive");
    let mut read = |entry: &str| archive.read_named(entry, 1 << 20).expect("an entry");
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    let mut put = |name: &str, bytes: &[u8]| {
        zip.start_file(name, SimpleFileOptions::default()).expect("a new entry");
        zip.write_all(bytes).expect("written");
    };
    let config = String::from_utf8(read("config.ini")).expect("text");
    let kept: Vec<&str> = config.lines().filter(|l| !l.starts_with("numFast")).collect();
    put("config.ini", format!("{}\nnumFast = {}\n", kept.join("\n"), layers.len()).as_bytes());
    put("prusaslicer.ini", &read("prusaslicer.ini"));
    for (i, layer) in layers.iter().enumerate() {
        put(&format!("{name}{i:05}.png"), &read(&format!("{name}{layer:05}.png")));
    }
    zip.finish().expect("an archive").into_inner()
}

/// Polygons of all layers of a job.
fn parts(job: &[u8]) -> Vec<Region> {
    let mut layers = FromImages::new(resin::open(Cursor::new(job)).expect("a job"));
    let mut parts = Vec::new();
    while let Some(batch) = layers.next_batch().expect("layers") {
        parts.extend(batch.into_iter().map(|l| l.part));
    }
    parts
}

#[test]
fn layers_have_the_area_of_their_bright_pixels() {
    for (name, number) in SAMPLES {
        let Some(whole) = shared(&format!("gcode-samples/sla/{name}.sl1")) else { continue };
        let job = resin::open(Cursor::new(&whole)).expect("a job");
        assert_eq!(job.format(), Format::Sl1);
        assert_eq!([job.panel().width_px, job.panel().height_px], [1440, 2560]);
        assert_eq!(job.layers().len() as u32, number);
        assert!((job.layers()[number as usize - 1].top_mm - f64::from(number) * 0.1).abs() < 1e-9);
        assert_eq!([job.layers()[0].exposure_s, job.layers()[5].exposure_s], [45.0, 28.5]);

        let picked: Vec<u32> = (0..number).step_by(43).collect();
        let some = with_layers(&whole, name, &picked);
        let mut job = resin::open(Cursor::new(&some)).expect("a job");
        for (i, part) in parts(&some).iter().enumerate() {
            let pixels = job.image(i as u32).expect("a picture").pixels;
            let bright = pixels.iter().filter(|&&p| p >= 128).count();
            let expect = bright as f64 * PIXEL_MM * PIXEL_MM;
            assert!(bright > 0 && (part.area_mm2() - expect).abs() < expect * 1e-4, "{name}, layer {i}");
        }
    }
}

/// Where a binary STL file's triangles cross a height.
fn cut(stl: &[u8], z: f64) -> Vec<Edge> {
    let number = |b: &[u8]| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let triangle = |t: &[u8]| -> Option<Edge> {
        let corner = |k: usize| [0, 4, 8].map(|o| number(&t[12 + 12 * k + o..]));
        let crossing = |k: usize| {
            let [a, b] = [corner(k), corner((k + 1) % 3)];
            let s = (z - a[2]) / (b[2] - a[2]);
            ((a[2] < z) != (b[2] < z)).then(|| [0, 1].map(|i| a[i] + s * (b[i] - a[i])))
        };
        let mut crossings = (0..3).filter_map(crossing);
        Some([crossings.next()?, crossings.next()?])
    };
    stl[84..].chunks_exact(50).filter_map(triangle).collect()
}

fn inside([x, y]: [f64; 2], edges: &[Edge]) -> bool {
    let left =
        |[a, b]: &&Edge| (a[1] <= y) != (b[1] <= y) && a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]) < x;
    edges.iter().filter(left).count() % 2 == 1
}

#[test]
fn a_job_lies_over_the_plate_as_its_model_does() {
    let name = SAMPLES[0].0;
    let model = shared("models/calib-supporttest.stl");
    let job = shared(&format!("gcode-samples/sla/{name}.sl1"));
    let (Some(model), Some(job)) = (model, job) else { return };
    let picked = [0, 77, 150, 199];
    for (layer, part) in picked.into_iter().zip(parts(&with_layers(&job, name, &picked))) {
        // PrusaSlicer cuts in the middle of a layer.
        let model = cut(&model, f64::from(layer) * 0.1 + 0.05);
        let ring = |r: &Vec<_>| (0..r.len()).map(|i| [r[i], r[(i + 1) % r.len()]]).collect::<Vec<_>>();
        let edges: Vec<Edge> = part.rings().flat_map(ring).map(|e| e.map(|p| p.mm())).collect();
        let (mut alike, mut mirrored, all) = (0, 0, 4000);
        for k in 0..all {
            // It puts the middle of the model, which is its origin, onto that of the panel.
            let [x, y] = [f64::from(k % 80) * 0.53 - 21.0, f64::from(k / 80) * 0.83 - 21.0];
            let solid = inside([x, y], &model);
            let over = |x: f64| inside([MIDDLE_MM[0] + x, MIDDLE_MM[1] + y], &edges);
            alike += i32::from(solid == over(x));
            mirrored += i32::from(solid == over(-x));
        }
        assert!(alike * 1000 >= all * 995, "layer {layer}: {alike} of {all}");
        assert!(mirrored * 100 < all * 98, "layer {layer} would look the same mirrored");
    }
}
