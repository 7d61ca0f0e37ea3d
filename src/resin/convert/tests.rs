//! Every format to every other: what is carried over, and what is said where it is not.
use super::*;
use crate::resin;
use crate::resin::goo::tests::decoded;
use crate::resin::image::Image;
use crate::resin::rewrite::{Untouched, rewrite};
use crate::resin::testing::{BitDepth, ColorType, archive, grey, picture, sl1_config, sl1_settings};
use std::io::Cursor;

const ALL: [Format; 3] = [Format::Sl1, Format::NanoDlp, Format::Goo];

type Entries = Vec<(String, Vec<u8>)>;

/// An SL1 job of six layers of 5 × 3 px, on a panel that is 2.5 × 1.2 mm large.
fn entries() -> Entries {
    let config = sl1_config(6)
        + "printTime = 321.5\nusedMaterial = 1.5\nprinterModel = SL1\nmaterialName = Grey\n"
        + "fileCreationTimestamp = 2026-11-22 at 04:39:04 UTC\n";
    let settings = sl1_settings(5, 3)
        .replace("display_width = 5", "display_width = 2.5")
        .replace("display_height = 3", "display_height = 1.2")
        .replace("initial_layer_height = 0.1", "initial_layer_height = 0.05")
        + "max_print_height = 150\n";
    let thumbnail = picture(2, 2, ColorType::Rgba, BitDepth::Eight, &[255; 16]);
    let mut entries = vec![
        ("config.ini".to_owned(), config.into_bytes()),
        ("prusaslicer.ini".to_owned(), settings.into_bytes()),
        ("thumbnail/thumbnail400x400.png".to_owned(), thumbnail),
    ];
    entries.extend((0..6).map(|n| (format!("job{n:05}.png"), grey(5, 3, &pixels(n)))));
    entries
}

fn pixels(layer: u32) -> Vec<u8> {
    (0..15).map(|i| [0, 255, 128, 255, 7][(i * (layer as usize + 1) / 4) % 5]).collect()
}

fn replaced(entries: &mut Entries, name: &str, from: &str, to: &str) {
    let entry = entries.iter_mut().find(|e| e.0 == name).expect("such an entry");
    let text = String::from_utf8(entry.1.clone()).expect("text");
    assert!(text.contains(from), "{from}");
    entry.1 = text.replace(from, to).into_bytes();
}

fn to(bytes: &[u8], target: Format) -> (Vec<u8>, Vec<String>) {
    let mut out = Cursor::new(Vec::new());
    let mut job = resin::open(Cursor::new(bytes)).expect("a job");
    let written = rewrite(&mut job, &mut out, target, &Untouched, &mut |_| ()).expect("written");
    assert_eq!((written.layers as usize, written.changed), (job.layers().len(), 0));
    (out.into_inner(), written.notes)
}

type Open<'a> = Job<Cursor<&'a [u8]>>;

fn open(bytes: &[u8]) -> Open<'_> {
    resin::open(Cursor::new(bytes)).expect("a job")
}

/// The same pictures, at the same heights, for as long, on the same pixels, mirrored alike.
#[track_caller]
fn same(before: &mut Open<'_>, after: &mut Open<'_>) {
    assert_eq!(before.layers().len(), after.layers().len());
    assert_eq!(before.placement().mirrored(), after.placement().mirrored());
    for (b, a) in before.placement().pixel_mm.iter().zip(after.placement().pixel_mm) {
        assert!((b - a).abs() < 1e-6, "{b} and {a} mm");
    }
    for n in 0..before.layers().len() {
        let (b, a) = (before.layers()[n], after.layers()[n]);
        assert!(
            (b.top_mm - a.top_mm).abs() < 1e-5 && (b.height_mm - a.height_mm).abs() < 1e-5,
            "{b:?} {a:?}"
        );
        assert!((b.exposure_s - a.exposure_s).abs() < 1e-4, "{b:?} {a:?}");
        let picture = |job: &mut Open<'_>| job.image(n as u32).expect("a picture");
        assert!(picture(before) == picture(after), "layer {n}");
    }
}

#[test]
fn every_pair_of_formats_holds_the_same_job() {
    let first = archive(&entries());
    for from in ALL {
        let (start, _) = to(&first, from);
        for target in ALL {
            let (made, notes) = to(&start, target);
            assert!(from != target || notes.is_empty(), "{notes:?}");
            assert_eq!(open(&made).format(), target);
            same(&mut open(&start), &mut open(&made));
            same(&mut open(&first), &mut open(&made));
            assert!(to(&start, target).0 == made, "{from} to {target} twice");
            let (back, _) = to(&made, from);
            same(&mut open(&start), &mut open(&back));
        }
    }
}

#[test]
fn a_goo_file_holds_what_the_specification_wants() {
    let (made, notes) = to(&archive(&entries()), Format::Goo);
    let layers = decoded(&made);
    let single = |at: usize| f32::from_be_bytes([made[at], made[at + 1], made[at + 2], made[at + 3]]);
    for (n, (picture, definition)) in (0..).zip(&layers) {
        assert_eq!(*picture, pixels(n));
        let at = |at: usize| f32::from_be_bytes([0, 1, 2, 3].map(|i| definition[at + i]));
        assert!((at(6) - 0.05 * (n + 1) as f32).abs() < 1e-6);
        assert_eq!(at(10), [25.0, 20.0, 15.0, 10.0, 5.0, 5.0][n as usize]);
        assert_eq!([at(30), at(34), at(46), at(50), at(26)], [5.0, 60.0, 5.0, 150.0, 0.5]);
        assert_eq!(definition[62..64], [0, 255]);
    }
    let check = |at: usize, expect: &[u8]| assert_eq!(&made[at..at + expect.len()], expect, "byte {at}");
    check(0, b"V3.0\x07\0\0\0DLP\0Outrigger\0");
    check(68, b"2026-11-22 04:39:04\0");
    check(92, b"SL1\0");
    check(156, b"Grey\0");
    // The white thumbnail fills both previews.
    check(194, &[255; 26_912]);
    check(27_106, b"\r\n");
    check(27_108, &[255; 168_200]);
    check(195_308, &[0x0d, 0x0a, 0, 0, 0, 6, 0, 5, 0, 3, 0, 0]);
    check(195_373, &[0, 0, 0, 1]);
    check(195_441, &[0, 255, 0, 255, 0, 0, 0, 1, 65]);
    check(195_470, &[0, 2, 0xfb, 0x95, 1, 0, 3]);
    for (at, expect) in [
        (195_320, 2.5),
        (195_324, 1.2),
        (195_328, 150.0),
        (195_332, 0.05),
        (195_336, 5.0),
        (195_369, 25.0),
        (195_450, 1500.0),
    ] {
        assert_eq!(single(at), expect, "byte {at}");
    }
    assert!(made.ends_with(b"\0\0\0\x07\0\0\0DLP\0"));
    assert_eq!(notes, ["lift: not told; 5 mm at 60 mm/min and back at 150 mm/min is written"]);
}

/// What is said on the way from an SL1 job that was changed somewhat.
#[track_caller]
fn notes(change: impl Fn(&mut Entries), through: &[Format], expect: &[&str]) -> Vec<u8> {
    let mut entries = entries();
    change(&mut entries);
    let (mut bytes, mut notes) = (archive(&entries), Vec::new());
    for target in through {
        (bytes, notes) = to(&bytes, *target);
    }
    assert_eq!(notes.len(), expect.len(), "{notes:?}");
    for (note, expect) in notes.iter().zip(expect) {
        assert!(note.contains(expect), "{note}");
    }
    bytes
}

#[test]
fn what_is_lost_is_said() {
    use Format::{Goo, NanoDlp, Sl1};
    let nothing = |_: &mut Entries| ();
    notes(nothing, &[NanoDlp], &["lift: not told; 5 mm is written"]);
    notes(nothing, &[Goo, NanoDlp], &["speeds and second stages"]);
    notes(nothing, &[Goo, Sl1], &["lift, waits and light power"]);
    notes(
        nothing,
        &[NanoDlp, Goo],
        &["lift: not told; 5 mm at 60", "height of the printer: not told; 200 mm"],
    );
    let others = |e: &mut Entries| e.extend((0..7).map(|n| (format!("other{n}"), vec![])));
    notes(others, &[Goo], &["\"other0\", \"other1\", \"other2\", \"other3\", \"other4\" and 2 more", "lift"]);
    let no_thumbnail = |e: &mut Entries| drop(e.remove(2));
    notes(no_thumbnail, &[Goo], &["lift", "the previews are black"]);
    let bad_thumbnail = |e: &mut Entries| e[2].1.truncate(50);
    notes(
        bad_thumbnail,
        &[Goo],
        &["thumbnail: the picture cannot be read", "lift", "the previews are black"],
    );
    let high = |e: &mut Entries| replaced(e, "prusaslicer.ini", "height = 0.05", "height = 0.1");
    notes(high, &[NanoDlp], &["the first layer is 0.05 mm high as all others are, not 0.1 mm", "lift"]);
    let made = notes(high, &[Goo], &["lift"]);
    assert_eq!((made[195_445], open(&made).layers()[0].top_mm), (1, 0.1), "the layers' own heights count");
    same(&mut open(&made), &mut open(&to(&made, Sl1).0));
}

#[test]
fn bottom_layers_that_sl1_does_not_know_are_said() {
    let (goo, _) = to(&archive(&entries()), Format::Goo);
    let mut three = goo.clone();
    three[195_376] = 3;
    three[195_476] = 1;
    let exposures = [25.0_f32, 25.0, 25.0, 15.0, 5.0, 5.0];
    let mut at = 195_477;
    for exposure_s in exposures {
        three[at + 10..at + 14].copy_from_slice(&exposure_s.to_be_bytes());
        let length = usize::from(three[at + 69]);
        at += 72 + length;
    }
    three[195_477..195_479].copy_from_slice(&[0, 1]);
    let (made, notes) = to(&three, Format::NanoDlp);
    same(&mut open(&three), &mut open(&made));
    assert!(notes[0].contains("pauses: 1 are left out, the first at layer 0"), "{notes:?}");
    let (made, notes) = to(&three, Format::Sl1);
    let words = "exposure: 3 of 6 layers differ; layer 1 has 20.00 s instead of 25.00 s";
    assert!(notes.iter().any(|n| n == words), "{notes:?}");
    let exposures: Vec<f64> = open(&made).layers().iter().map(|l| l.exposure_s).collect();
    assert_eq!(exposures, [25.0, 20.0, 15.0, 10.0, 5.0, 5.0]);
}

#[test]
fn more_bottom_layers_than_layers_are_all() {
    // Found by the fuzzer: what was written could not be read.
    let (mut goo, _) = to(&archive(&entries()), Format::Goo);
    goo[195_373..195_377].fill(0xff);
    for target in [Format::Sl1, Format::NanoDlp] {
        let (made, notes) = to(&goo, target);
        assert_eq!(open(&made).layers().len(), 6);
        assert!(notes.iter().any(|n| n.starts_with("exposure: ")), "{notes:?}");
    }
}

#[test]
fn heights_that_no_archive_can_say_are_refused() {
    let (mut goo, _) = to(&archive(&entries()), Format::Goo);
    let z = 0.3_f32.to_be_bytes();
    let found = (195_477..goo.len() - 4).rev().find(|&i| goo[i..i + 4] == z).expect("the last layer's Z");
    goo[found..found + 4].copy_from_slice(&0.33_f32.to_be_bytes());
    for target in [Format::Sl1, Format::NanoDlp] {
        let mut job = open(&goo);
        let refused = rewrite(&mut job, Cursor::new(Vec::new()), target, &Untouched, &mut |_| ());
        let said = refused.expect_err("refused").to_string();
        assert!(
            said.contains("layer 5 is 0.08 mm high and others 0.05 mm") && said.contains(".goo"),
            "{said}"
        );
    }
}

#[test]
fn a_turned_panel_turns_the_part_and_never_mirrors_it() {
    use Format::{Goo, NanoDlp, Sl1};
    for mirror in ["0", "1"] {
        for portrait in [false, true] {
            let turn = |e: &mut Entries| {
                replaced(e, "prusaslicer.ini", "mirror_y = 0", &format!("mirror_y = {mirror}"));
                if portrait {
                    replaced(e, "prusaslicer.ini", "= landscape", "= portrait");
                    e[3..].iter_mut().zip(0..).for_each(|(e, n)| e.1 = grey(3, 5, &pixels(n)));
                }
            };
            let mut expect = vec!["lift"];
            if portrait {
                expect.insert(0, "turned by 90°");
            }
            let mut job = entries();
            turn(&mut job);
            let job = archive(&job);
            let made = notes(turn, &[Goo], &expect);
            same(&mut open(&job), &mut open(&made));
            same(&mut open(&job), &mut open(&to(&made, Sl1).0));
            expect.truncate(usize::from(portrait));
            if mirror == "1" && !portrait {
                expect = vec!["turned by 180°"];
            }
            expect.push("lift");
            same(&mut open(&job), &mut open(&notes(turn, &[NanoDlp], &expect)));
        }
    }
}

#[test]
fn pictures_are_changed_on_the_way() {
    struct Dark;
    impl Edits for Dark {
        fn touches(&self, layer: u32) -> bool {
            layer > 2
        }
        fn edit(&self, layer: u32, image: &mut Image) -> Edit {
            if layer == 4 {
                return Edit::Kept;
            }
            image.pixels.fill(0);
            Edit::Changed
        }
    }
    let job = archive(&entries());
    for target in ALL {
        let mut out = Cursor::new(Vec::new());
        let mut progress = Vec::new();
        let written =
            rewrite(&mut open(&job), &mut out, target, &Dark, &mut |n| progress.push(n)).expect("written");
        assert_eq!((written.layers, written.changed), (6, 2), "{target}");
        assert!(progress.is_sorted() && progress.last() == Some(&6));
        let mut made = resin::open(Cursor::new(out.into_inner())).expect("a job");
        for n in 0..6 {
            let expect = if [3, 5].contains(&n) { vec![0; 15] } else { pixels(n) };
            assert_eq!(made.image(n).expect("a picture").pixels, expect, "{target}, layer {n}");
        }
    }
}

#[test]
fn subpixels_become_pixels() {
    let options = r#"{"PWidth": 5, "PHeight": 1, "XPixelSize": 0.019, "YPixelSize": 0.024, "Thickness": 50}"#;
    let rgb = picture(2, 1, ColorType::Rgb, BitDepth::Eight, &[1, 2, 3, 4, 5, 6]);
    let job = archive(&[("options.json", options.as_bytes().to_vec()), ("1.png", rgb)]);
    for target in [Format::Sl1, Format::Goo] {
        let (made, _) = to(&job, target);
        assert_eq!(open(&made).image(0).expect("a picture").pixels, [1, 2, 3, 4, 5]);
    }
}

#[test]
fn names_are_no_settings() {
    let (goo, _) = to(&archive(&entries()), Format::Goo);
    let mut evil = goo.clone();
    evil[92..112].copy_from_slice(b"a\nexpTime = 99\njobDi");
    let (made, _) = to(&evil, Format::Sl1);
    same(&mut open(&goo), &mut open(&made));
}
