//! A resin job: no bytes make the reader of archives panic, hang or take memory, and
//! what it reads is what it says.
//!
//! Takes the fuzzer's bytes as a file; where they are no archive, as the entries of one
//! (a byte names the entry, two its length), so that the formats are reached without
//! their zip being guessed. Fails by panic, by time and by memory.
#![no_main]
use libfuzzer_sys::fuzz_target;
use outrigger::detect::resin::Kind;
use outrigger::detect::walk::{Ask, walk};
use outrigger::layers::from_images::FromImages;
use outrigger::layers::stack::Layers;
use outrigger::resin;
use std::io::Cursor;

/// What the entries of a made archive may be called.
const NAMES: [&str; 12] = [
    "config.ini", "prusaslicer.ini", "j00000.png", "j00001.png", "plate.json", "options.json", "slicer.json",
    "profile.json", "override.json", "0.png", "1.png", "2.png",
];

fuzz_target!(|data: &[u8]| {
    read(data);
    if !resin::archive::is_zip(data) {
        read(&zipped(data));
    }
});

fn read(bytes: &[u8]) {
    let Ok(mut job) = resin::open(Cursor::new(bytes)) else { return };
    let panel = job.panel();
    let pixels = u64::from(panel.width_px) * u64::from(panel.height_px);
    assert!(!job.layers().is_empty());
    let mut top_mm = 0.0;
    for layer in job.layers() {
        assert!(layer.top_mm > top_mm && layer.height_mm > 0.0 && layer.exposure_s >= 0.0);
        top_mm = layer.top_mm;
    }
    // A few hundred bytes can be a whole panel of one brightness: true, and slow with
    // the fuzzer's counters.
    if pixels > 1 << 20 {
        return;
    }
    let bright = job.image(0).ok().map(|image| {
        assert_eq!(image.pixels.len() as u64, pixels);
        image.pixels.iter().filter(|&&p| p >= 128).count()
    });
    let [along, across] = job.placement().pixel_mm;
    let mut layers = FromImages::new(job);
    let mut first = true;
    while let Ok(Some(batch)) = layers.next_batch() {
        for layer in batch {
            if std::mem::take(&mut first) {
                // The finest pixel has ten grid steps a side, of which rounding moves one.
                let expect = bright.expect("it was read before") as f64 * along * across;
                let off = (layer.part.area_mm2() - expect).abs();
                assert!(off <= expect * 0.22 + 1e-9, "{off} of {expect}");
            }
        }
    }
    search(bytes, [panel.width_px, panel.height_px]);
}

/// What is found in the pictures lies in them.
fn search(bytes: &[u8], size: [u32; 2]) {
    let Ok(job) = resin::open(Cursor::new(bytes)) else { return };
    let count = job.layers().len() as u32;
    let mut layers = FromImages::new(job).keeping_pictures();
    let Ok(found) = walk(&mut layers, &Ask { resin: true, ..Ask::default() }, &mut ()) else { return };
    for issue in found.resin.expect("was asked for").list {
        assert!(issue.layer <= issue.end_layer && issue.end_layer < count, "{issue:?}");
        let [low, high] = issue.box_px;
        let placed = issue.kind != Kind::EmptyLayer;
        assert!((0..2).all(|axis| high[axis] <= size[axis] && (low[axis] < high[axis]) == placed), "{issue:?}");
    }
}

/// An archive of entries that are not packed.
fn zipped(mut data: &[u8]) -> Vec<u8> {
    let (mut file, mut directory, mut number) = (Vec::new(), Vec::new(), 0_u16);
    while let [name, low, high, rest @ ..] = data {
        let name = NAMES[usize::from(*name) % NAMES.len()].as_bytes();
        let (content, later) = rest.split_at(rest.len().min(usize::from(u16::from_le_bytes([*low, *high]))));
        data = later;
        let mut crc = flate2::Crc::new();
        crc.update(content);
        let mut head = vec![20, 0, 0, 0, 0, 0, 0, 0, 0, 0];
        head.extend(crc.sum().to_le_bytes());
        head.extend([(content.len() as u32).to_le_bytes(); 2].concat());
        head.extend((name.len() as u16).to_le_bytes());
        head.extend([0, 0]);
        directory.extend(b"PK\x01\x02\x14\x00");
        directory.extend(&head);
        directory.extend([0; 10]);
        directory.extend((file.len() as u32).to_le_bytes());
        directory.extend(name);
        file.extend(b"PK\x03\x04");
        file.extend(&head);
        file.extend(name);
        file.extend(content);
        number += 1;
    }
    let at = file.len() as u32;
    file.extend(&directory);
    file.extend(b"PK\x05\x06\0\0\0\0");
    file.extend([number.to_le_bytes(); 2].concat());
    file.extend((directory.len() as u32).to_le_bytes());
    file.extend(at.to_le_bytes());
    file.extend([0, 0]);
    file
}
