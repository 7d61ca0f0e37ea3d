//! A folder of PNG files in place of a display: for who shows them by other means (a program of
//! their own, another machine), for trying a job without a printer, and for tests.
//!
//! # Files
//! - `current.png`: what is shown now. Always whole: it is replaced by a rename. Nothing is synced
//!   to the medium, since what a display showed before the power went is of no use after.
//! - `shown.jsonl`: a line for each call that showed a picture or made dark, in order, also of
//!   earlier runs: `{"at_unix_ns":1,"picture":"000123","sum":"00c0ffee00c0ffee","count":123}`.
//!   `picture` is `blank` or the number of the picture, `sum` is [`Sum`] of the picture as it was
//!   given, `count` how many pictures were shown until then.
//! - `000123.png`: each picture by its number, where all are kept.
//! - names that begin with a dot: pictures that were written ahead. They are removed when they are
//!   no more needed, at the latest by the next opening; so one process a folder.
//!
//! # Pictures
//! 8 bits of grey, a pixel of the file for each of the panel,
//! whatever [`Layout::pixels`] says: packing is the business of who shows them. The painter writes
//! the file (that takes milliseconds), on whichever thread it is; [`Sink::show`] only links and
//! renames.
//!
//! Here alone of this room is the PNG crate named. Asks the system's clock, for `shown.jsonl`.
use super::layout::{Format, Layout};
use super::pack::Packer;
use super::painter::Painter;
use super::sum::Sum;
use super::{Frame, LcdError, Sink, io_error};
use png::{BitDepth, ColorType, DeflateCompression, Encoder, EncodingError, Filter};
use serde::{Deserialize, Serialize};
use std::fs::{self, File};
use std::io::{self, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

const CURRENT: &str = "current.png";
const SHOWN: &str = "shown.jsonl";
/// What begins the names of pictures that were written ahead.
const AHEAD: &str = ".ahead-";
/// What becomes [`CURRENT`] by a rename.
const FRESH: &str = ".current.png";

/// So much of the end of `shown.jsonl` is read when the folder is opened: more than a line takes.
const TAIL_BYTES: u64 = 1024;

/// A line of `shown.jsonl`.
#[derive(Serialize, Deserialize)]
struct Line {
    at_unix_ns: u64,
    picture: String,
    sum: String,
    count: u64,
}

/// See the module.
#[derive(Debug)]
pub struct Folder {
    packer: Packer,
    path: PathBuf,
    keep: bool,
    ahead: Ahead,
    /// The dark picture, and its sum.
    dark: (Staged, u64),
    record: File,
    /// Pictures shown so far.
    count: u64,
}

impl Folder {
    /// Opens the folder, which is made where there is none, and goes on counting where its
    /// `shown.jsonl` ends. Shows nothing yet. With `keep` every picture stays as a file of its own.
    ///
    /// # Errors
    /// [`LcdError::Panel`], or files cannot be made in the folder ([`LcdError::Io`]).
    pub fn open(panel: Layout, path: &Path, keep: bool) -> Result<Folder, LcdError> {
        let (layout, format) = panel.checked()?.plain();
        fs::create_dir_all(path).map_err(io_error("make the folder", path))?;
        sweep(path).map_err(io_error("tidy up in", path))?;
        let ahead = Ahead { folder: Arc::from(path), next: Arc::default() };
        let [width, height] = [layout.width_px, layout.height_px];
        let dark = ahead.write(&vec![0; width as usize * height as usize], format)?;
        let shown = path.join(SHOWN);
        let (record, count) = record(&shown).map_err(io_error("write", &shown))?;
        Ok(Folder {
            packer: Packer::new(layout, format)?,
            path: path.to_owned(),
            keep,
            ahead,
            dark: (dark, Sum::dark([width, height])),
            record,
            count,
        })
    }

    /// Puts a file in the place of `current.png`, and notes it down.
    fn put(&mut self, file: &Path, picture: String, sum: u64, count: u64) -> Result<(), LcdError> {
        let (fresh, current) = (self.path.join(FRESH), self.path.join(CURRENT));
        twin(file, &fresh).map_err(io_error("write", &fresh))?;
        fs::rename(&fresh, &current).map_err(io_error("replace", &current))?;
        // Dark after dark: where both are links to one file, a rename does nothing and leaves both.
        let _ = fs::remove_file(&fresh);
        self.count = count;
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let at_unix_ns = u64::try_from(since.as_nanos()).unwrap_or(u64::MAX);
        let line = Line { at_unix_ns, picture, sum: format!("{sum:016x}"), count };
        // One write, so that who reads along sees whole lines.
        let written = serde_json::to_string(&line)
            .map_err(io::Error::from)
            .and_then(|line| self.record.write_all(format!("{line}\n").as_bytes()));
        written.map_err(io_error("write", &self.path.join(SHOWN)))
    }
}

impl Sink for Folder {
    fn layout(&self) -> Layout {
        self.packer.layout()
    }

    fn format(&self) -> Format {
        self.packer.format()
    }

    fn painter(&self) -> Painter {
        Painter::with(self.packer, Some(self.ahead.clone()))
    }

    fn show(&mut self, frame: &Frame) -> Result<(), LcdError> {
        let staged = match &frame.staged {
            Some(staged) if frame.is_of(self.layout(), self.format()) => staged,
            _ => return Err(LcdError::Foreign),
        };
        if staged.path.parent() != Some(&self.path) {
            return Err(LcdError::Foreign);
        }
        let count = self.count + 1;
        let name = format!("{count:06}");
        if self.keep {
            let kept = self.path.join(format!("{name}.png"));
            twin(&staged.path, &kept).map_err(io_error("write", &kept))?;
        }
        self.put(&staged.path, name, frame.sum(), count)
    }

    fn blank(&mut self) -> Result<(), LcdError> {
        let (path, sum) = (self.dark.0.path.clone(), self.dark.1);
        self.put(&path, "blank".to_owned(), sum, self.count)
    }
}

/// Writes pictures ahead, for one folder, from any thread.
#[derive(Clone, Debug)]
pub(super) struct Ahead {
    folder: Arc<Path>,
    /// The number of the next file, of all painters.
    next: Arc<AtomicU64>,
}

/// A picture that was written ahead; its file goes when it is dropped.
#[derive(Debug)]
pub(super) struct Staged {
    path: PathBuf,
}

impl Drop for Staged {
    fn drop(&mut self) {
        // What cannot be removed is swept by the next opening.
        let _ = fs::remove_file(&self.path);
    }
}

impl Ahead {
    /// Writes the file of a plain frame's bytes.
    pub(super) fn write(&self, bytes: &[u8], format: Format) -> Result<Staged, LcdError> {
        let number = self.next.fetch_add(1, Ordering::Relaxed);
        let staged = Staged { path: self.folder.join(format!("{AHEAD}{number}.png")) };
        packed(bytes, [format.width_px, format.height_px])
            .map_err(io::Error::from)
            .and_then(|packed| fs::write(&staged.path, packed))
            .map_err(io_error("write", &staged.path))?;
        Ok(staged)
    }
}

/// A PNG file's bytes.
fn packed(bytes: &[u8], [width, height]: [u32; 2]) -> Result<Vec<u8>, EncodingError> {
    let mut packed = Vec::new();
    let mut encoder = Encoder::new(&mut packed, width, height);
    encoder.set_color(ColorType::Grayscale);
    encoder.set_depth(BitDepth::Eight);
    // Quick rather than small. Most rows are the row above: zeros, once that is taken off.
    encoder.set_filter(Filter::Up);
    encoder.set_deflate_compression(DeflateCompression::FdeflateUltraFast);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(bytes)?;
    writer.finish()?;
    Ok(packed)
}

/// Makes `to` the same file as `from`, or of the same content where the file system has no
/// links (FAT). What was there before is gone first: a link is never written over, and a rename
/// of one name of a file over another would do nothing.
fn twin(from: &Path, to: &Path) -> io::Result<()> {
    match fs::remove_file(to) {
        Err(e) if e.kind() != ErrorKind::NotFound => return Err(e),
        _ => {}
    }
    fs::hard_link(from, to).or_else(|_| fs::copy(from, to).map(drop))
}

/// Removes what a process that was killed has left.
fn sweep(folder: &Path) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_name().to_string_lossy().starts_with(AHEAD) {
            fs::remove_file(entry.path())?;
        }
    }
    Ok(())
}

/// Opens the record to go on with it, and tells how many pictures it has.
fn record(path: &Path) -> io::Result<(File, u64)> {
    let mut file = File::options().read(true).append(true).create(true).open(path)?;
    let length = file.seek(SeekFrom::End(0))?;
    file.seek(SeekFrom::Start(length.saturating_sub(TAIL_BYTES)))?;
    let mut tail = Vec::new();
    (&mut file).take(TAIL_BYTES).read_to_end(&mut tail)?;
    if tail.last().is_some_and(|byte| *byte != b'\n') {
        // A line that was cut off shall not spoil the next.
        file.write_all(b"\n")?;
    }
    let lines = tail.split(|byte| *byte == b'\n').rev();
    let last = lines.filter_map(|line| serde_json::from_slice::<Line>(line).ok()).next();
    Ok((file, last.map_or(0, |line| line.count)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::printer::lcd::layout::{Order, Pixels};

    const PANEL: Layout = Layout { width_px: 4, height_px: 2, pixels: Pixels::Packed { order: Order::Rgb } };
    const ROWS: [[u8; 4]; 2] = [[1, 2, 3, 4], [0, 0, 128, 255]];

    fn frame(painter: &mut Painter, rows: [[u8; 4]; 2]) -> Frame {
        rows.iter().for_each(|row| painter.row(row).expect("a row"));
        painter.finish().expect("a frame")
    }

    fn pixels(path: &Path) -> Vec<u8> {
        let mut reader =
            png::Decoder::new(io::BufReader::new(File::open(path).unwrap())).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut bytes).unwrap();
        assert_eq!((info.color_type, info.bit_depth), (ColorType::Grayscale, BitDepth::Eight));
        assert_eq!([info.width, info.height], [4, 2]);
        bytes
    }

    fn names(folder: &Path) -> Vec<String> {
        let name = |entry: io::Result<fs::DirEntry>| entry.unwrap().file_name().into_string().unwrap();
        let mut names: Vec<String> = fs::read_dir(folder).unwrap().map(name).collect();
        names.sort();
        names
    }

    fn lines(folder: &Path) -> Vec<(String, String, u64)> {
        let text = fs::read_to_string(folder.join(SHOWN)).unwrap();
        let line = |line| serde_json::from_str::<Line>(line).unwrap();
        text.lines().map(line).map(|l| (l.picture, l.sum, l.count)).collect()
    }

    #[test]
    fn pictures_are_shown_kept_and_noted_down() {
        let root = tempfile::tempdir().unwrap();
        let path = root.path().join("a/panel");
        let mut folder = Folder::open(PANEL, &path, true).unwrap();
        assert_eq!(names(&path), [".ahead-0.png", SHOWN], "nothing is shown by opening");
        let mut painter = folder.painter();
        let picture = frame(&mut painter, ROWS);
        let dim = frame(&mut painter, [[7; 4]; 2]);

        folder.blank().unwrap();
        assert_eq!(pixels(&path.join(CURRENT)), [0; 8]);
        folder.show(&picture).unwrap();
        assert_eq!(pixels(&path.join(CURRENT)), ROWS.as_flattened());
        // The same again, as a rename between two names of one file would not.
        folder.show(&picture).unwrap();
        folder.show(&dim).unwrap();
        assert_eq!(pixels(&path.join(CURRENT)), [7; 8]);
        folder.blank().unwrap();
        assert_eq!(pixels(&path.join(CURRENT)), [0; 8]);

        let hex = |sum: u64| format!("{sum:016x}");
        let dark = hex(Sum::dark([4, 2]));
        let expect = [
            ("blank", dark.clone(), 0),
            ("000001", hex(picture.sum()), 1),
            ("000002", hex(picture.sum()), 2),
            ("000003", hex(dim.sum()), 3),
            ("blank", dark, 3),
        ];
        assert_eq!(lines(&path), expect.map(|(picture, sum, count)| (picture.to_owned(), sum, count)));
        assert_eq!(pixels(&path.join("000002.png")), ROWS.as_flattened());
        assert_eq!(pixels(&path.join("000003.png")), [7; 8]);

        painter.take_back(picture);
        painter.take_back(dim);
        drop(folder);
        let left = ["000001.png", "000002.png", "000003.png", CURRENT, SHOWN];
        assert_eq!(names(&path), left, "what was written ahead is gone");
    }

    #[test]
    fn counting_goes_on_where_the_record_ends() {
        let check = |record: String, expect: &str| {
            let root = tempfile::tempdir().unwrap();
            fs::write(root.path().join(SHOWN), &record).unwrap();
            fs::write(root.path().join(".ahead-77.png"), "of a process that was killed").unwrap();
            let mut folder = Folder::open(PANEL, root.path(), false).unwrap();
            folder.show(&frame(&mut folder.painter(), ROWS)).unwrap();
            let text = fs::read_to_string(root.path().join(SHOWN)).unwrap();
            let last: Line = serde_json::from_str(text.lines().last().unwrap()).unwrap();
            assert_eq!(last.picture, expect, "{record}");
            assert!(text.starts_with(&record));
            assert_eq!(names(root.path()), [".ahead-0.png", CURRENT, SHOWN]);
        };
        let line = |picture, count| {
            format!(
                "{{\"at_unix_ns\":5,\"picture\":\"{picture}\",\"sum\":\"00c0ffee00c0ffee\",\"count\":{count}}}\n"
            )
        };
        check(String::new(), "000001");
        check(line("000041", 41), "000042");
        check(line("000041", 41) + &line("blank", 41).repeat(1000), "000042");
        check(line("999999", 999_999), "1000000");
        check(line("000041", 41) + "{\"at_unix_ns\":17,\"pic", "000042");
        check("?".repeat(5000), "000001");
    }

    #[test]
    fn frames_of_others_are_refused() {
        let root = tempfile::tempdir().unwrap();
        let open = |name: &str| Folder::open(PANEL, &root.path().join(name), false).unwrap();
        let (mut one, other) = (open("one"), open("other"));
        let (layout, format) = PANEL.plain();
        for mut painter in [other.painter(), Painter::new(layout, format).unwrap()] {
            assert!(matches!(one.show(&frame(&mut painter, ROWS)), Err(LcdError::Foreign)));
        }
        assert!(lines(&root.path().join("one")).is_empty());
    }

    #[test]
    fn a_folder_that_cannot_be_is_told_with_its_name() {
        let root = tempfile::tempdir().unwrap();
        let file = root.path().join("file");
        fs::write(&file, "").unwrap();
        let said = Folder::open(PANEL, &file, false).expect_err("refused").to_string();
        assert!(said.starts_with("cannot make the folder") && said.contains("/file: "), "{said}");
    }

    #[test]
    fn a_folder_that_is_gone_is_an_error() {
        let root = tempfile::tempdir().unwrap();
        let path = root.path().join("panel");
        let mut folder = Folder::open(PANEL, &path, false).unwrap();
        let mut painter = folder.painter();
        let picture = frame(&mut painter, ROWS);
        fs::remove_dir_all(&path).unwrap();
        ROWS.iter().for_each(|row| painter.row(row).unwrap());
        assert!(matches!(painter.finish(), Err(LcdError::Io { what: "write", .. })));
        assert!(matches!(folder.show(&picture), Err(LcdError::Io { .. })));
        assert!(matches!(folder.blank(), Err(LcdError::Io { .. })));
    }
}
