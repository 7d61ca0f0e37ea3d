//! What it takes to make a resin printer's picture ready, and to show it.
//!
//! `cargo bench --bench lcd`
//!
//! A picture of 2560 × 1440 px with anti-aliased pillars, as a slicer draws supports, is painted for
//! each kind of display, and shown: on files in a temporary folder (put it on a memory disk by
//! `TMPDIR`) that stand for a framebuffer, and in a folder of PNG files. The peer in the same run is
//! the least that showing a picture can be: a copy of the display's bytes in memory. Painting is
//! work beside the print; what stands between the move and the light is `show`, which shall take less
//! than 5 ms.
#[path = "../gcode/benches/common/mod.rs"]
mod common;

use common::ratio::{Ratios, Timed};
use common::run::run;
use criterion::{Criterion, SamplingMode, Throughput};
use outrigger::printer::lcd::folder::Folder;
use outrigger::printer::lcd::framebuffer::{Framebuffer, Place};
use outrigger::printer::lcd::layout::{Depth, Format, Layout, Order, Pixels};
use outrigger::printer::lcd::painter::Painter;
use outrigger::printer::lcd::sum::Sum;
use outrigger::printer::lcd::{Frame, Sink};
use std::path::Path;

const WIDTH_PX: u32 = 2560;
const HEIGHT_PX: u32 = 1440;

/// The most that showing may take, ms.
const TARGET_MS: f64 = 5.0;

const PACKED: Pixels = Pixels::Packed { order: Order::Rgb };

fn picture() -> Vec<u8> {
    let inside = |x: u32, y: u32| {
        let centre = |c: u32| f64::from(c % 51) - 25.0;
        ((9.0 - centre(x).hypot(centre(y))).clamp(0.0, 1.0) * 255.0) as u8
    };
    (0..HEIGHT_PX).flat_map(|y| (0..WIDTH_PX).map(move |x| inside(x, y))).collect()
}

fn layout(pixels: Pixels) -> Layout {
    Layout { width_px: WIDTH_PX, height_px: HEIGHT_PX, pixels }
}

fn painter(pixels: Pixels, depth: Depth) -> Painter {
    let layout = layout(pixels);
    let [width_px, height_px] = layout.display_px();
    let format = Format { width_px, height_px, stride_bytes: width_px * depth.bytes(), depth };
    Painter::new(layout, format).expect("it fits")
}

fn painters() -> Vec<(&'static str, Painter)> {
    vec![
        ("paint grey 8", painter(Pixels::Grey, Depth::Eight)),
        ("paint grey 32", painter(Pixels::Grey, Depth::ThirtyTwo)),
        ("paint packed 16", painter(PACKED, Depth::Sixteen)),
        ("paint packed 24", painter(PACKED, Depth::TwentyFour)),
        ("paint packed 32", painter(PACKED, Depth::ThirtyTwo)),
    ]
}

fn paint(painter: &mut Painter, picture: &[u8]) -> Frame {
    for row in picture.chunks_exact(WIDTH_PX as usize) {
        painter.row(row).expect("a row");
    }
    painter.finish().expect("a frame")
}

/// A painted picture's memory is used for the next, as in a print.
fn paint_again(painter: &mut Painter, picture: &[u8]) {
    let frame = paint(painter, picture);
    painter.take_back(frame);
}

fn framebuffer(root: &Path) -> Framebuffer {
    let layout = layout(PACKED);
    let [width, height] = layout.display_px();
    let place = Place { sysfs: root.join("fb0"), device: root.join("device") };
    std::fs::create_dir_all(&place.sysfs).expect("a folder");
    let said = [
        ("virtual_size", format!("{width},{height}")),
        ("bits_per_pixel", "32".to_owned()),
        ("stride", (4 * width).to_string()),
    ];
    for (name, text) in said {
        std::fs::write(place.sysfs.join(name), text).expect("a file");
    }
    std::fs::write(&place.device, []).expect("a file");
    Framebuffer::open(layout, &place).expect("a display")
}

fn summed(picture: &[u8]) -> u64 {
    let mut sum = Sum::new();
    picture.chunks_exact(WIDTH_PX as usize).for_each(|row| sum.row(row));
    sum.finish()
}

/// Dark and light in turn, as in a print: half of it is one picture.
fn show(sink: &mut dyn Sink, frame: &Frame) {
    sink.blank().expect("dark");
    sink.show(frame).expect("shown");
}

fn benches(c: &mut Criterion) {
    let picture = picture();
    let mut group = c.benchmark_group("lcd/2560x1440");
    group.sampling_mode(SamplingMode::Flat).throughput(Throughput::Bytes(picture.len() as u64));
    for (name, mut painter) in painters() {
        group.bench_function(name, |b| b.iter(|| paint_again(&mut painter, &picture)));
    }
    group.bench_function("sum alone", |b| b.iter(|| summed(&picture)));
}

fn ratios(ratios: &Ratios) {
    let picture = picture();
    for (name, mut painter) in painters() {
        let bytes = paint(&mut painter, &picture).bytes().to_vec();
        let mut to = bytes.clone();
        let copy = || to.copy_from_slice(&bytes);
        let paint = || paint_again(&mut painter, &picture);
        ratios.compare(bytes.len(), (name, paint), ("copying its bytes", copy));
    }
    let root = tempfile::tempdir().expect("a folder");
    let mut screen = framebuffer(root.path());
    let mut folder = Folder::open(layout(PACKED), &root.path().join("panel"), false).expect("a folder");
    let sinks: [(&str, &mut dyn Sink); 2] =
        [("dark and shown, framebuffer", &mut screen), ("dark and shown, folder", &mut folder)];
    for (name, sink) in sinks {
        let mut painter = sink.painter();
        let frame = paint(&mut painter, &picture);
        let bytes = frame.bytes().to_vec();
        let mut to = bytes.clone();
        let copy = || {
            to.copy_from_slice(&bytes);
            std::hint::black_box(&mut to).copy_from_slice(&bytes);
        };
        let timed = ratios.compare(2 * bytes.len(), (name, || show(sink, &frame)), ("copying twice", copy));
        told(&timed);
    }
    let mut painter = folder.painter();
    let mut to = picture.clone();
    let write = || paint_again(&mut painter, &picture);
    let copy = || to.copy_from_slice(&picture);
    ratios.compare(picture.len(), ("paint and write ahead, folder", write), ("copying its bytes", copy));
}

fn told(both: &Timed) {
    let ms = both.seconds * 500.0;
    let verdict = if ms < TARGET_MS { "met" } else { "MISSED" };
    eprintln!("{:<34} {ms:>9.3} ms     target {TARGET_MS:>27.1} ms     {verdict}", "  of which one");
}

fn main() {
    run(benches, ratios);
}
