//! A GOO file: no bytes make its reader panic, hang or take memory; what it reads is
//! written again the same, and survives the way through another format.
//!
//! Takes the fuzzer's bytes as what stands behind the previews, so that it need not
//! make 195,310 bytes of head; an odd first byte has the layers' lengths, ends and
//! checksums made right, so that the runs are reached. Fails by panic, by time and by
//! memory.
#![no_main]
use libfuzzer_sys::fuzz_target;
use outrigger::resin;
use outrigger::resin::job::Format;
use outrigger::resin::rewrite::{Untouched, rewrite};
use std::io::Cursor;

const SETTINGS_AT: usize = 195_310;
const SETTINGS_BYTES: usize = 167;
const LAYERS_AT: usize = SETTINGS_AT + SETTINGS_BYTES;
/// A definition without the length of the picture.
const DEFINITION_BYTES: usize = 66;
const END: &[u8] = b"\0\0\0\x07\0\0\0DLP\0";

fuzz_target!(|data: &[u8]| {
    let Some((&how, data)) = data.split_first() else { return };
    let mut file = vec![0; SETTINGS_AT];
    file[..12].copy_from_slice(b"V3.0\x07\0\0\0DLP\0");
    if how & 1 == 0 {
        file.extend_from_slice(data);
    } else {
        framed(data, &mut file);
    }
    read(&file);
});

/// Settings, then for each layer a definition, a length of two bytes, and so many bytes of runs.
fn framed(data: &[u8], file: &mut Vec<u8>) {
    let Some((settings, mut rest)) = data.split_at_checked(SETTINGS_BYTES) else { return };
    file.extend_from_slice(settings);
    let mut layers = 0_u32;
    while let Some((definition, later)) = rest.split_at_checked(DEFINITION_BYTES) {
        let [low, high, later @ ..] = later else { break };
        let length = usize::from(u16::from_le_bytes([*low, *high])).min(later.len());
        let (runs, later) = later.split_at(length);
        rest = later;
        file.extend_from_slice(definition);
        let at = file.len();
        file[at - 2..].copy_from_slice(b"\r\n");
        file.extend((runs.len() as u32 + 2).to_be_bytes());
        file.push(0x55);
        file.extend_from_slice(runs);
        file.push(!runs.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte)));
        file.extend(b"\r\n");
        layers += 1;
    }
    file.extend(END);
    file[SETTINGS_AT..SETTINGS_AT + 4].copy_from_slice(&layers.to_be_bytes());
    file[SETTINGS_AT + 160..SETTINGS_AT + 164].copy_from_slice(&(LAYERS_AT as u32).to_be_bytes());
}

fn read(bytes: &[u8]) {
    let Ok(mut job) = resin::open(Cursor::new(bytes)) else { return };
    let panel = job.panel();
    let mut top_mm = 0.0;
    for layer in job.layers() {
        assert!(layer.top_mm > top_mm && layer.height_mm > 0.0 && layer.exposure_s >= 0.0);
        top_mm = layer.top_mm;
    }
    let mut same = Cursor::new(Vec::new());
    rewrite(&mut job, &mut same, Format::Goo, &Untouched, &mut |_| ()).expect("nothing refuses");
    assert!(same.into_inner() == bytes, "a file that nobody touches is the same");
    // A few bytes can be a whole panel: true, and slow with the fuzzer's counters.
    if u64::from(panel.width_px) * u64::from(panel.height_px) > 1 << 18 || job.layers().len() > 16 {
        return;
    }
    for target in [Format::Sl1, Format::NanoDlp] {
        let mut made = Cursor::new(Vec::new());
        if rewrite(&mut job, &mut made, target, &Untouched, &mut |_| ()).is_err() {
            continue;
        }
        let mut made = resin::open(Cursor::new(made.into_inner())).expect("what is written is read");
        for layer in 0..job.layers().len() as u32 {
            let (before, after) = (job.image(layer), made.image(layer));
            assert!(before.expect("it was read") == after.expect("it was written"), "layer {layer}");
        }
    }
}
