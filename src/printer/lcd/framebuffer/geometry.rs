//! What the kernel says of a display, in the files of `/sys/class/graphics/fbN`.
//!
//! Gives sizes and depth. Of a size that the kernel does not say outright, what follows from
//! the rest.
use super::OpenError;
use std::fs::{self, File};
use std::io::{self, ErrorKind, Read};
use std::path::Path;
use std::str::FromStr;

/// Most that such a file has: the kernel gives a page.
const MAX_BYTES: u64 = 65_536;

/// See the module.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Geometry {
    /// The folder's name with the driver's: `fb0 (vc4drmfb)`.
    pub(super) name: String,
    /// Columns and rows of its memory; with double buffering more than are seen.
    memory_px: [u32; 2],
    /// Bits of a pixel.
    pub(super) bits: u32,
    /// Bytes from row to row.
    pub(super) stride_bytes: u32,
    /// First column and row that are seen.
    pub(super) pan_px: [u32; 2],
    /// The mode it is in, where that is told, or else those that it can have.
    modes_px: Vec<[u32; 2]>,
}

impl Geometry {
    /// # Errors
    /// There is no such display, or the kernel's words are not understood.
    pub(super) fn read(folder: &Path) -> Result<Geometry, OpenError> {
        if !folder.is_dir() {
            let there = siblings(folder);
            return Err(OpenError::NoDisplay { path: folder.to_owned(), there });
        }
        let mut modes_px = modes(&text(folder, "mode")?.unwrap_or_default());
        if modes_px.is_empty() {
            modes_px = modes(&text(folder, "modes")?.unwrap_or_default());
        }
        let pan_px = match text(folder, "pan")? {
            Some(pan) if !pan.is_empty() => pair(folder, "pan", &pan)?,
            _ => [0, 0],
        };
        Ok(Geometry {
            name: called(folder),
            memory_px: pair(folder, "virtual_size", &needed(folder, "virtual_size")?)?,
            bits: number(folder, "bits_per_pixel", &needed(folder, "bits_per_pixel")?)?,
            stride_bytes: number(folder, "stride", &needed(folder, "stride")?)?,
            pan_px,
            modes_px,
        })
    }

    /// Columns and rows that are seen.
    ///
    /// No file says so without doubt. The kernel keeps the mode that a display is in among its
    /// modes, so it is the largest of these for which there is memory. A driver without
    /// modes shows all its memory; only if that holds the wanted size two or more times, one
    /// below the other, it is taken for the buffers of that size.
    pub(super) fn visible_px(&self, wanted: [u32; 2]) -> [u32; 2] {
        let [width, height] = self.memory_px;
        let fit = self.modes_px.iter().copied().filter(|&[w, h]| w <= width && h <= height);
        let largest = fit.max_by_key(|&[w, h]| u64::from(w) * u64::from(h));
        let buffers = self.modes_px.is_empty() && wanted[0] == width && height.is_multiple_of(wanted[1]);
        match largest {
            Some(mode) => mode,
            None if buffers && height > 0 => wanted,
            None => self.memory_px,
        }
    }
}

/// The lines `U:1024x768p-60` of a file of modes; others are left out.
fn modes(text: &str) -> Vec<[u32; 2]> {
    let mode = |line: &str| {
        let (_, size) = line.trim().split_once(':')?;
        let (width, rest) = size.split_once('x')?;
        let height = rest.split(|c: char| !c.is_ascii_digit()).next()?;
        Some([width.parse().ok()?, height.parse().ok()?])
    };
    text.lines().filter_map(mode).collect()
}

/// What a file says; `None` where it is not there.
fn text(folder: &Path, name: &str) -> Result<Option<String>, OpenError> {
    let path = folder.join(name);
    let read = File::open(&path).and_then(|file| {
        let mut text = String::new();
        file.take(MAX_BYTES).read_to_string(&mut text)?;
        Ok(text)
    });
    match read {
        Ok(text) => Ok(Some(text.trim().to_owned())),
        Err(e) if e.kind() == ErrorKind::NotFound => Ok(None),
        Err(e) => Err(OpenError::Unclear { path, reason: e.to_string() }),
    }
}

fn needed(folder: &Path, name: &str) -> Result<String, OpenError> {
    let missing = || {
        let reason = io::Error::from(ErrorKind::NotFound).to_string();
        OpenError::Unclear { path: folder.join(name), reason }
    };
    text(folder, name)?.ok_or_else(missing)
}

fn number<T: FromStr>(folder: &Path, name: &str, text: &str) -> Result<T, OpenError> {
    let unclear = |_| OpenError::Unclear { path: folder.join(name), reason: format!("it says {text:?}") };
    text.trim().parse().map_err(unclear)
}

/// Two numbers with a comma between.
fn pair(folder: &Path, name: &str, text: &str) -> Result<[u32; 2], OpenError> {
    let (first, second) = text.split_once(',').unwrap_or((text, ""));
    Ok([number(folder, name, first)?, number(folder, name, second)?])
}

fn called(folder: &Path) -> String {
    let own = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
    match text(folder, "name") {
        Ok(Some(driver)) if !driver.is_empty() => format!("{own} ({driver})"),
        _ => own,
    }
}

/// The displays that stand beside where one was looked for.
fn siblings(folder: &Path) -> Vec<String> {
    let entries = folder.parent().and_then(|graphics| fs::read_dir(graphics).ok());
    let paths = entries.into_iter().flatten().filter_map(|entry| Some(entry.ok()?.path()));
    // `fbcon` stands there too, and is a console.
    let mut there: Vec<String> =
        paths.filter(|path| path.join("virtual_size").exists()).map(|path| called(&path)).collect();
    there.sort();
    there
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modes_are_read() {
        let check = |text: &str, expect: &[[u32; 2]]| assert_eq!(modes(text), expect, "{text:?}");
        check("U:1024x768p-60\nD:854x1440p-0\n", &[[1024, 768], [854, 1440]]);
        check("V:640x480i-50", &[[640, 480]]);
        check("S:720x576", &[[720, 576]]);
        check("", &[]);
        check("1024x768", &[]);
        check("U:x768p\nU:10x\nU:99999999999x1p", &[]);
    }

    #[test]
    fn what_is_seen_is_told_by_memory_and_modes() {
        let check = |memory_px, modes_px: &[[u32; 2]], wanted, expect| {
            let geometry = Geometry {
                name: String::new(),
                memory_px,
                bits: 32,
                stride_bytes: 0,
                pan_px: [0, 0],
                modes_px: modes_px.to_vec(),
            };
            assert_eq!(geometry.visible_px(wanted), expect, "{memory_px:?} {modes_px:?} {wanted:?}");
        };
        check([854, 1440], &[], [854, 1440], [854, 1440]);
        check([854, 1440], &[[854, 1440]], [854, 1440], [854, 1440]);
        // Two buffers, with and without a mode that says so.
        check([854, 2880], &[], [854, 1440], [854, 1440]);
        check([854, 2880], &[[854, 1440]], [854, 1440], [854, 1440]);
        check([1024, 2880], &[[854, 1440]], [854, 1440], [854, 1440]);
        // All that the plug can do: the largest is taken.
        check([1920, 1080], &[[640, 480], [1920, 1080], [3840, 2160]], [1920, 1080], [1920, 1080]);
        // A higher display is no two buffers when its mode says that all is seen.
        check([1920, 1080], &[[1920, 1080]], [1920, 540], [1920, 1080]);
        check([854, 1441], &[], [854, 1440], [854, 1441]);
        check([1708, 1440], &[], [854, 1440], [1708, 1440]);
        check([0, 0], &[], [854, 1440], [0, 0]);
        check([854, 0], &[], [854, 1440], [854, 0]);
    }
}
