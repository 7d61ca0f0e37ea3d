//! A display made of files: a folder for the kernel's words, a file for the device.
use super::*;
use crate::printer::lcd::layout::{Order, Pixels};
use proptest::prelude::*;
use std::fs;
use tempfile::TempDir;

/// 5 × 4 pixels, of which three are one: 2 × 4 of the display.
const PANEL: Layout = Layout { width_px: 5, height_px: 4, pixels: Pixels::Packed { order: Order::Rgb } };

/// What the files of a display say unless a test says otherwise.
const FILES: [(&str, &str); 6] = [
    ("name", "testfb\n"),
    ("virtual_size", "2,4\n"),
    ("bits_per_pixel", "32\n"),
    ("stride", "12\n"),
    ("pan", "0,0\n"),
    ("modes", "U:2x4p-0\n"),
];

struct Display {
    _root: TempDir,
    place: Place,
}

impl Display {
    /// With these files otherwise; an empty text is a file that is not there.
    fn new(other: &[(&str, &str)]) -> Display {
        let root = tempfile::tempdir().unwrap();
        let place = Place { sysfs: root.path().join("fb7"), device: root.path().join("device") };
        fs::create_dir(&place.sysfs).unwrap();
        for (name, text) in FILES.iter().chain(other) {
            let path = place.sysfs.join(name);
            if text.is_empty() { fs::remove_file(path).unwrap() } else { fs::write(path, text).unwrap() }
        }
        fs::write(&place.device, []).unwrap();
        Display { _root: root, place }
    }

    fn open(&self) -> Framebuffer {
        Framebuffer::open(PANEL, &self.place).expect("opened")
    }

    fn bytes(&self) -> Vec<u8> {
        fs::read(&self.place.device).unwrap()
    }

    /// Fills the device with what nobody wrote.
    fn mark(&self) {
        fs::write(&self.place.device, [0xaa; 48]).unwrap();
    }

    /// Which rows were written since [`Display::mark`].
    fn written(&self) -> Vec<bool> {
        self.bytes().chunks(12).map(|row| row != [0xaa; 12]).collect()
    }
}

fn frame(painter: &mut Painter, rows: [u8; 4]) -> Frame {
    rows.iter().for_each(|brightness| painter.row(&[*brightness; 5]).expect("a row"));
    painter.finish().expect("a frame")
}

#[test]
fn the_bytes_lie_at_the_displays_stride() {
    let display = Display::new(&[]);
    let mut framebuffer = display.open();
    assert!(display.bytes().is_empty(), "opening shows nothing");
    let mut painter = framebuffer.painter();
    for row in [[1, 2, 3, 4, 5], [6, 7, 8, 9, 10], [0; 5], [255; 5]] {
        painter.row(&row).unwrap();
    }
    framebuffer.show(&painter.finish().unwrap()).unwrap();
    let expect = [
        [3, 2, 1, 255, 0, 5, 4, 255, 0, 0, 0, 0],
        [8, 7, 6, 255, 0, 10, 9, 255, 0, 0, 0, 0],
        [0, 0, 0, 255, 0, 0, 0, 255, 0, 0, 0, 0],
        [255, 255, 255, 255, 0, 255, 255, 255, 0, 0, 0, 0],
    ];
    assert_eq!(display.bytes(), expect.as_flattened());
    framebuffer.blank().unwrap();
    assert_eq!(display.bytes(), expect[2].repeat(4));
}

#[test]
fn only_rows_that_differ_are_written() {
    let display = Display::new(&[]);
    let mut framebuffer = display.open();
    let mut painter = framebuffer.painter();
    let mut check = |rows: Option<[u8; 4]>, expect: [bool; 4]| {
        display.mark();
        match rows {
            Some(rows) => framebuffer.show(&frame(&mut painter, rows)).unwrap(),
            None => framebuffer.blank().unwrap(),
        }
        assert_eq!(display.written(), expect, "{rows:?}");
    };
    let (yes, no) = (true, false);
    check(None, [yes; 4]);
    check(None, [no; 4]);
    check(Some([0, 9, 0, 9]), [no, yes, no, yes]);
    check(Some([0, 9, 0, 9]), [no; 4]);
    check(Some([1, 2, 3, 9]), [yes, yes, yes, no]);
    check(Some([1, 2, 3, 0]), [no, no, no, yes]);
    check(None, [yes, yes, yes, no]);
    check(Some([0; 4]), [no; 4]);
}

#[test]
fn after_an_error_all_is_written() {
    let display = Display::new(&[]);
    let mut framebuffer = display.open();
    let mut painter = framebuffer.painter();
    let first = frame(&mut painter, [1, 2, 3, 4]);
    framebuffer.show(&first).unwrap();
    // A device that cannot be written any more.
    let whole = std::mem::replace(&mut framebuffer.device, File::open(&display.place.device).unwrap());
    let said = framebuffer.show(&frame(&mut painter, [1, 2, 3, 5])).expect_err("refused").to_string();
    assert!(said.starts_with("cannot write ") && said.contains("/device: "), "{said}");
    framebuffer.device = whole;
    display.mark();
    framebuffer.show(&first).unwrap();
    assert_eq!(display.written(), [true; 4]);
    assert_eq!(display.bytes(), first.bytes());
}

#[test]
fn frames_of_others_are_refused() {
    let (wide, tight) = (Display::new(&[]), Display::new(&[("stride", "8")]));
    let frame = frame(&mut tight.open().painter(), [1; 4]);
    assert!(matches!(wide.open().show(&frame), Err(LcdError::Foreign)));
    assert!(wide.bytes().is_empty());
}

#[test]
fn displays_that_do_not_fit_are_refused_with_words() {
    let check = |other: &[(&str, &str)], expect: &[&str]| {
        let display = Display::new(other);
        let said =
            Framebuffer::open(PANEL, &display.place).map_or_else(|e| e.to_string(), |_| "opened".into());
        for part in expect {
            assert!(said.contains(part), "{other:?}: {said}");
        }
    };
    check(&[], &["opened"]);
    check(&[("modes", ""), ("name", ""), ("pan", "")], &["opened"]);
    check(&[("virtual_size", "2,8")], &["opened"]);
    check(&[("virtual_size", "2,8"), ("modes", "")], &["opened"]);
    let both = ["fb7 (testfb)", "panel of 5 × 4 px needs 2 × 4", "lcd.width_px", "lcd.pixels", "video=…:2x4"];
    check(&[("virtual_size", "5,4"), ("modes", "U:5x4p-0")], &[&both[..], &["shows 5 × 4 px"]].concat());
    check(&[("virtual_size", "1,4"), ("modes", "")], &[&both[..], &["shows 1 × 4 px"]].concat());
    check(&[("virtual_size", "2,8"), ("modes", "U:2x8p-0")], &["shows 2 × 8 px"]);
    check(&[("virtual_size", "2,8"), ("mode", "U:2x3p-0")], &["shows 2 × 3 px"]);
    check(&[("virtual_size", "2,8"), ("pan", "0,4")], &["from column 0, row 4", "another program"]);
    check(&[("bits_per_pixel", "1")], &["fb7 (testfb) has 1 bits a pixel", "8, 16, 24 and 32"]);
    check(&[("bits_per_pixel", "8"), ("stride", "2")], &["no colours", "lcd.pixels"]);
    check(&[("stride", "7")], &["rows of 7 bytes"]);
    check(&[("stride", "4294967295")], &["rows of 4294967295 bytes"]);
    check(&[("stride", "")], &["/fb7/stride cannot be understood"]);
    check(&[("stride", "-8")], &["/fb7/stride cannot be understood: it says \"-8\""]);
    check(&[("virtual_size", "2x4")], &["/fb7/virtual_size cannot be understood: it says \"2x4\""]);
    check(&[("virtual_size", "2,")], &["it says \"\""]);
}

#[test]
fn a_display_that_is_not_there_is_told_with_those_that_are() {
    let display = Display::new(&[]);
    let missing = Place { sysfs: display.place.sysfs.with_file_name("fb8"), ..display.place.clone() };
    let said = Framebuffer::open(PANEL, &missing).expect_err("refused").to_string();
    assert!(said.contains("/fb8 (there is fb7 (testfb)); is its driver loaded"), "{said}");
    let nowhere = Place { sysfs: "/nowhere/fb0".into(), ..display.place.clone() };
    let said = Framebuffer::open(PANEL, &nowhere).expect_err("refused").to_string();
    assert!(said.contains("no display /nowhere/fb0, nor any other; is its driver"), "{said}");
    fs::remove_file(&display.place.device).unwrap();
    let said = Framebuffer::open(PANEL, &display.place).expect_err("refused").to_string();
    assert!(said.contains("/device: ") && said.contains("udev has made no device"), "{said}");
    let denied = OpenError::Device { path: "/dev/fb0".into(), source: ErrorKind::PermissionDenied.into() };
    assert!(denied.to_string().contains("(video)"), "{denied}");
}

#[test]
fn a_display_is_named_as_linux_names_it() {
    let expect = Place { sysfs: "/sys/class/graphics/fb1".into(), device: "/dev/fb1".into() };
    assert_eq!(Place::named("fb1"), expect);
    assert_eq!(Place::named("/dev/fb1"), expect);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    /// Whatever comes after whatever: the device has the bytes of what was shown last.
    #[test]
    fn what_is_shown_is_the_last_frame(
        pictures in proptest::collection::vec(proptest::option::of([0_u8..3, 0..3, 0..3, 0..3]), 1..12),
    ) {
        let display = Display::new(&[]);
        let mut framebuffer = display.open();
        let mut painter = framebuffer.painter();
        for rows in pictures {
            let expect = frame(&mut painter, rows.unwrap_or_default());
            match rows {
                Some(_) => framebuffer.show(&expect).unwrap(),
                None => framebuffer.blank().unwrap(),
            }
            prop_assert_eq!(display.bytes(), expect.bytes());
            painter.take_back(expect);
        }
    }
}
