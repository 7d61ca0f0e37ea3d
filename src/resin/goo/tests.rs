//! GOO files against a writer and a reader of bytes by their offsets, written from the
//! specification alone and sharing no code with the room.
use super::*;
use crate::resin;
use crate::resin::rewrite::{Edit, Edits, Untouched, rewrite};
use std::io::Cursor;

/// A layer of 4 × 3 px: its top, its exposure, its runs.
type Layer = (f32, f32, Vec<u8>);

/// The head of a file of this many layers of 4 × 3 px.
fn head(layers: u32) -> Vec<u8> {
    let mut head = vec![0; 195_477];
    let mut put = |at: usize, bytes: &[u8]| head[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, b"V3.0\x07\0\0\0DLP\0slicer\0garbage");
    put(68, b"2026-09-06 16:27:32");
    put(92, b"A printer");
    put(156, b"Grey resin");
    put(27_106, b"\r\n");
    put(195_308, b"\r\n");
    put(195_310, &layers.to_be_bytes());
    put(195_314, &[0, 4, 0, 3, 1, 0]);
    for (at, value) in [
        (195_320, 0.2_f32),
        (195_324, 0.15),
        (195_328, 165.0),
        (195_332, 0.05),
        (195_336, 3.25),
        (195_345, 1.5),
        (195_369, 35.0),
        (195_377, 5.0),
        (195_381, 60.0),
        (195_385, 4.0),
        (195_401, 4.5),
        (195_405, 150.0),
        (195_421, f32::NAN),
        (195_450, 1234.5),
    ] {
        put(at, &value.to_be_bytes());
    }
    put(195_373, &2_u32.to_be_bytes());
    put(195_441, &[0, 255, 0, 51, 1]);
    put(195_446, &3600_u32.to_be_bytes());
    put(195_470, &[0, 2, 0xfb, 0x95, 1, 0, 1]);
    head
}

fn layer((top_mm, exposure_s, runs): &Layer) -> Vec<u8> {
    let mut bytes = vec![0; 70];
    bytes[6..10].copy_from_slice(&top_mm.to_be_bytes());
    bytes[10..14].copy_from_slice(&exposure_s.to_be_bytes());
    bytes[64..66].copy_from_slice(b"\r\n");
    bytes[66..].copy_from_slice(&(runs.len() as u32 + 2).to_be_bytes());
    bytes.push(0x55);
    bytes.extend(runs);
    bytes.push(!runs.iter().fold(0_u8, |sum, b| sum.wrapping_add(*b)));
    bytes.extend(b"\r\n");
    bytes
}

fn layers() -> Vec<Layer> {
    vec![
        (0.05, 35.0, vec![0x0c]),
        (0.1, 35.0, vec![0xc1, 0x42, 100, 0x02, 0xc7]),
        (0.15, 19.125, vec![0xcc]),
        (0.25, 3.25, vec![0x4c, 7]),
    ]
}

fn file(layers: &[Layer]) -> Vec<u8> {
    let mut bytes = head(layers.len() as u32);
    bytes.extend(layers.iter().flat_map(layer));
    bytes.extend(b"\0\0\0\x07\0\0\0DLP\0");
    bytes
}

/// The pictures of a whole file, and the bytes before each layer's length.
pub(in crate::resin) fn decoded(bytes: &[u8]) -> Vec<(Vec<u8>, Vec<u8>)> {
    let number = |at: usize, length: usize| {
        bytes[at..at + length].iter().fold(0_usize, |n, byte| n * 256 + usize::from(*byte))
    };
    let pixels = number(195_314, 2) * number(195_316, 2);
    let mut at = number(195_470, 4);
    let mut found = Vec::new();
    for _ in 0..number(195_310, 4) {
        let length = number(at + 66, 4);
        let (from, to) = (at + 70, at + 70 + length);
        assert_eq!(
            (bytes[from], &bytes[at + 64..at + 66], &bytes[to..to + 2]),
            (0x55, &b"\r\n"[..], &b"\r\n"[..])
        );
        let runs = &bytes[from + 1..to - 1];
        let sum: usize = runs.iter().map(|b| usize::from(*b)).sum();
        assert_eq!(usize::from(bytes[to - 1]), 255 - sum % 256);
        let (mut i, mut picture, mut colour) = (0, Vec::new(), 0_i32);
        while i < runs.len() {
            let first = usize::from(runs[i]);
            i += 1;
            let mut run = first % 16;
            if first / 64 == 2 {
                colour += if first & 32 == 0 { run as i32 } else { -(run as i32) };
                run = 1;
                if first & 16 != 0 {
                    run = usize::from(runs[i]);
                    i += 1;
                }
            } else {
                colour = [0, -1, -1, 255][first / 64];
                if colour < 0 {
                    colour = runs[i].into();
                    i += 1;
                }
                let more = first / 16 % 4;
                let high = runs[i..i + more].iter().fold(0, |n, byte| n * 256 + usize::from(*byte));
                run += 16 * high;
                i += more;
            }
            picture.resize(picture.len() + run, u8::try_from(colour).expect("a brightness"));
        }
        assert_eq!(picture.len(), pixels);
        found.push((picture, bytes[at..at + 66].to_vec()));
        at = to + 2;
    }
    assert!(bytes[at..].starts_with(b"\0\0\0\x07\0\0\0DLP\0"));
    found
}

fn pictures() -> [[u8; 12]; 4] {
    let second = [255, 100, 100, 0, 0, 255, 255, 255, 255, 255, 255, 255];
    [[0; 12], second, [255; 12], [7; 12]]
}

type Made = Job<Cursor<Vec<u8>>>;

fn open(bytes: &[u8]) -> Result<Made, JobError> {
    resin::open(Cursor::new(bytes.to_vec()))
}

#[test]
fn a_file_is_read() {
    let mut job = open(&file(&layers())).expect("a job");
    assert_eq!(job.format(), Format::Goo);
    assert_eq!(job.panel(), Panel { width_px: 4, height_px: 3, packing: Packing::Runs });
    let placement = job.placement();
    assert!(placement.pixel_mm.iter().all(|mm| (mm - 0.05).abs() < 1e-12), "{placement:?}");
    assert_eq!([placement.reverse_u, placement.reverse_v, placement.swap], [true, true, false]);
    let expect = [(0.05, 35.0), (0.1, 35.0), (0.15, 19.125), (0.25, 3.25)];
    for (layer, (top_mm, exposure_s)) in job.layers().iter().zip(expect) {
        assert_eq!((layer.top_mm, layer.exposure_s), (top_mm, exposure_s));
    }
    assert!((job.layers()[3].height_mm - 0.1).abs() < 1e-12);
    for (n, expect) in (0..).zip(pictures()) {
        assert_eq!(job.image(n).expect("a picture").pixels, expect);
    }
    assert_eq!((job.entry_name(0), job.packed_bytes(0)), ("byte 195477".into(), 3));
    assert!(matches!(job.image(4), Err(JobError::LayerMissing { layer: 4, .. })));
}

#[test]
fn the_head_tells_how_it_is_printed() {
    let job = open(&file(&layers())).expect("a job");
    let recipe = job.recipe();
    assert_eq!((recipe.bottom_layers, recipe.transition_layers), (2, 1));
    for (n, layer) in (0..).zip(job.layers()) {
        assert_eq!(recipe.exposure_s(n), layer.exposure_s);
    }
    let way = |mm, mm_min| Way { mm, mm_min };
    assert_eq!(recipe.bottom.lift, [way(Some(5.0), Some(60.0)), way(Some(0.0), Some(0.0))]);
    assert_eq!(recipe.usual.lift, [way(Some(4.0), Some(0.0)), way(Some(0.0), None)]);
    assert_eq!(recipe.usual.retract[0], way(Some(4.5), Some(150.0)));
    assert_eq!(recipe.bottom.waits_s, [Some(1.5), Some(0.0), Some(0.0)]);
    assert_eq!([recipe.bottom.light, recipe.usual.light], [Some(1.0), Some(0.2)]);
    assert_eq!([recipe.print_time_s, recipe.resin_mm3], [Some(3600.0), Some(1234.5)]);
    assert_eq!(recipe.machine_z_mm, Some(165.0));
    assert_eq!((recipe.printer.as_str(), recipe.resin.as_str()), ("A printer", "Grey resin"));
    assert_eq!(recipe.created.as_deref(), Some("2026-09-06 16:27:32"));
}

/// What is said of a file: when it is opened, or when its pictures are read.
fn says(bytes: &[u8]) -> Option<String> {
    let read = open(bytes).and_then(|mut job| {
        let count = job.layers().len() as u32;
        (0..count).try_for_each(|n| job.image(n).map(drop))
    });
    read.err().map(|e| e.to_string())
}

#[test]
fn what_is_wrong_is_named() {
    let good = file(&layers());
    let check = |change: &dyn Fn(&mut Vec<u8>), words: &[&str]| {
        let mut bad = good.clone();
        change(&mut bad);
        let said = says(&bad).expect("refused");
        assert!(words.iter().all(|w| said.contains(w)), "{said}");
    };
    let set = |at: usize, bytes: &'static [u8]| {
        move |f: &mut Vec<u8>| f[at..at + bytes.len()].copy_from_slice(bytes)
    };
    let first = 195_477;
    check(&set(0, b"V5.1"), &["version \"V5.1\"", "only \"V3.0\""]);
    check(&|f| f.truncate(1000), &["cut off", "the head"]);
    check(&set(195_470, &[0; 4]), &["byte 195470", "not at 0"]);
    check(&set(195_470, &[255; 4]), &["not at 4294967295"]);
    check(&set(195_310, &[0, 1, 0x86, 0xa1]), &["100001 layers"]);
    check(&set(195_310, &[0; 4]), &["number of layers = 0"]);
    check(&set(195_310, &[0, 0, 0, 3]), &["the mark of the end, behind 3 layers"]);
    check(&set(195_310, &[0, 0, 0, 5]), &["cut off", "layer 4"]);
    check(&set(195_314, &[0, 0]), &["a side of the panel in px = 0"]);
    check(&set(195_314, &[0xff, 0xff]), &["65535", "16384"]);
    check(&set(195_316, &[0, 4]), &["layer 0 (\"byte 195477\")", "hold 12 px, the panel 16"]);
    check(&set(195_320, &[0x7f, 0xc0, 0, 0]), &["a side of the panel in mm = NaN"]);
    check(&set(195_320, &[0x47, 0, 0, 0]), &["a side of the panel in mm = 32768"]);
    check(&set(first + 6, &[0; 4]), &["\"layer 0\" says its Z in mm = 0"]);
    check(&set(first + 75 + 6, &[0x3d, 0x4c, 0xcc, 0xcd]), &["\"layer 1\" says its Z in mm = 0.05"]);
    check(&set(first + 10, &[0xbf, 0x80, 0, 0]), &["\"layer 0\" says its exposure in s = -1"]);
    check(&set(first + 64, b"\n"), &["byte 195541", "a line end in layer 0"]);
    check(&set(first + 66, &[255; 4]), &["layer 0", "cut off"]);
    check(&set(first + 71, &[0x0d]), &["layer 0", "checksum"]);
    check(&set(first + 70, &[0x54]), &["layer 0", "begins with 0x54"]);
    check(&|f| f.truncate(f.len() - 1), &["the mark of the end"]);
}

/// Bytes whose damage matters: all but most of the previews.
fn telling(length: usize) -> impl Iterator<Item = usize> {
    (0..length).filter(|at| !(200..195_300).contains(at) || at % 4999 == 0)
}

#[test]
fn any_damaged_byte_is_read_or_refused() {
    let good = file(&layers());
    let mut bad = good.clone();
    for at in telling(good.len()) {
        for flip in [1, 0x80, 0xff] {
            bad[at] ^= flip;
            says(&bad);
            bad[at] = good[at];
        }
    }
}

#[test]
fn any_cut_is_refused() {
    let good = file(&layers());
    for cut in telling(good.len()) {
        assert!(says(&good[..cut]).is_some(), "{cut}");
    }
}

#[test]
fn a_picture_beyond_all_bounds_is_refused_before_it_is_read() {
    struct Endless(u64, Vec<u8>);
    impl Read for Endless {
        fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
            let from = (self.0 as usize).min(self.1.len());
            let some = bytes.len().min(self.1.len() - from);
            bytes[..some].copy_from_slice(&self.1[from..from + some]);
            self.0 += some as u64;
            Ok(some)
        }
    }
    impl Seek for Endless {
        fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
            self.0 = match to {
                SeekFrom::Start(at) => at,
                SeekFrom::Current(by) => self.0.saturating_add_signed(by),
                SeekFrom::End(_) => u64::MAX,
            };
            Ok(self.0)
        }
    }
    // The second layer announces 4 GB; the file claims to hold them.
    let mut bytes = head(1);
    let mut first = layer(&layers()[0]);
    first[66..70].fill(0xff);
    bytes.extend(first);
    let goo = Goo {
        reader: Endless(0, bytes),
        length: u64::MAX,
        places: Vec::new(),
        layers_at: 195_477,
        layers_end: 0,
    };
    let mut goo = Goo { places: vec![Place { at: 195_477, bytes: u32::MAX }], ..goo };
    let said = goo.packed(0).expect_err("refused").to_string();
    assert!(said.contains("announces a picture of 4294967295 bytes"), "{said}");
}

/// Makes some layers' pictures dark.
struct Dark(Vec<u32>);

impl Edits for Dark {
    fn touches(&self, layer: u32) -> bool {
        self.0.contains(&layer)
    }

    fn edit(&self, _: u32, image: &mut resin::image::Image) -> Edit {
        image.pixels.fill(0);
        Edit::Changed
    }
}

fn rewritten(bytes: &[u8], edits: &impl Edits) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    rewrite(&mut open(bytes).expect("a job"), &mut out, Format::Goo, edits, &mut |_| ()).expect("written");
    out.into_inner()
}

#[test]
fn all_but_changed_pictures_is_kept_byte_for_byte() {
    // A head that is longer than the specification's, and bytes behind the end.
    let mut odd = file(&layers());
    odd.splice(195_477..195_477, [1, 2, 3]);
    odd[195_473] += 3;
    odd.extend(b"more");
    for good in [file(&layers()), odd] {
        assert_eq!(decoded(&good).into_iter().map(|l| l.0).collect::<Vec<_>>(), pictures());
        assert!(rewritten(&good, &Untouched) == good);
        let out = rewritten(&good, &Dark(vec![1, 3]));
        let at = usize::from(good[195_473]) + 0x2fb00;
        assert!(out[..at] == good[..at], "the head");
        for (n, (before, after)) in decoded(&good).into_iter().zip(decoded(&out)).enumerate() {
            assert_eq!(before.1, after.1, "the definition of layer {n}");
            assert_eq!(after.0, if n % 2 == 1 { vec![0; 12] } else { before.0 }, "layer {n}");
        }
        assert!(good.ends_with(&out[out.len() - 11..]), "what is behind");
    }
}

#[test]
fn an_older_head_without_its_last_fields_is_read() {
    let mut old = file(&layers());
    old.drain(195_474..195_477);
    old[195_473] -= 3;
    let job = open(&old).expect("a job");
    assert_eq!((job.layers().len(), job.recipe().transition_layers), (4, 0));
}
