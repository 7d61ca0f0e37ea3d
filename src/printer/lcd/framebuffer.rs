//! A display that Linux drives: its framebuffer device, written like a file.
//!
//! Takes frames, writes the rows that are not shown yet. What is shown is kept in memory, so that
//! nothing is read back and nothing mapped: the device takes `write` at any offset, and its geometry
//! stands in `/sys` (kernel: `Documentation/fb/api.rst`, `drivers/video/fbdev/core/fbsysfs.c`).
//!
//! # What cannot be seen from here
//! - A text console on the same display writes into it as well: its cursor would be light. The
//!   kernel must be told to keep off (`fbcon=map:9`, or `vt.global_cursor_default=0 consoleblank=0`
//!   with no getty on it).
//! - The write returns when the picture is in the display's memory. The panel shows it with its next
//!   scan, up to two periods of its refresh later, and its crystals take some milliseconds more.
//! - 8 bits a pixel are taken for brightness; a driver may have a palette there instead.
mod geometry;

use super::layout::{Depth, Format, Layout};
use super::pack::Packer;
use super::painter::Painter;
use super::{Frame, LcdError, Sink, io_error};
use geometry::Geometry;
use std::fs::File;
use std::io::{self, ErrorKind};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Where a display's device and the kernel's words on it are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// The folder with `virtual_size`, `bits_per_pixel` and `stride`.
    pub sysfs: PathBuf,
    /// What is written to.
    pub device: PathBuf,
}

impl Place {
    /// Where both are on Linux for a name like `fb0`; a path's last part is its name.
    #[must_use]
    pub fn named(name: &str) -> Place {
        let name = name.rsplit('/').next().unwrap_or_default();
        Place { sysfs: Path::new("/sys/class/graphics").join(name), device: Path::new("/dev").join(name) }
    }
}

/// Why a display cannot be used.
#[derive(Debug, Error)]
pub enum OpenError {
    /// The kernel has no such display.
    #[error(
        "there is no display {}{}; is its driver loaded (dtoverlay=vc4-kms-v3d, or the panel's own, in config.txt), and was it connected when the system started?",
        path.display(), others(there)
    )]
    NoDisplay {
        /// The folder that would tell of it.
        path: PathBuf,
        /// Displays that are there.
        there: Vec<String>,
    },
    /// The kernel's words on it cannot be read or understood.
    #[error("{} cannot be understood: {reason}", path.display())]
    Unclear {
        /// Which file.
        path: PathBuf,
        /// What it says, or the system.
        reason: String,
    },
    /// No depth that is known here.
    #[error(
        "the display {name} has {bits} bits a pixel, 8, 16, 24 and 32 can be shown: set the kernel's depth (video=…-32, or framebuffer_depth=32 in config.txt)"
    )]
    Depth {
        /// What the driver calls it.
        name: String,
        /// Bits of a pixel.
        bits: u32,
    },
    /// The display is not of the size that the panel needs.
    #[error(
        "the display {name} shows {width} × {height} px, but the panel of {panel_width} × {panel_height} px needs {needs_width} × {needs_height}: set lcd.width_px, lcd.height_px and lcd.pixels in the printer's profile as the panel is, or the kernel's video mode (video=…:{needs_width}x{needs_height} in cmdline.txt)"
    )]
    Size {
        /// What the driver calls it.
        name: String,
        /// Pixels along a row.
        width: u32,
        /// Rows.
        height: u32,
        /// The panel's pixels along a row.
        panel_width: u32,
        /// The panel's rows.
        panel_height: u32,
        /// Pixels along a row that it should have.
        needs_width: u32,
        /// Rows that it should have.
        needs_height: u32,
    },
    /// Another program has scrolled it, and may do so again.
    #[error(
        "the display {name} shows its memory from column {column}, row {row}: another program draws on it; end that (a desktop, a splash screen)"
    )]
    Panned {
        /// What the driver calls it.
        name: String,
        /// First column that is seen.
        column: u32,
        /// First row that is seen.
        row: u32,
    },
    /// The device cannot be written.
    #[error("cannot open {}: {source}{}", path.display(), advice(source))]
    Device {
        /// The device.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

fn others(there: &[String]) -> String {
    if there.is_empty() { ", nor any other".to_owned() } else { format!(" (there is {})", there.join(", ")) }
}

fn advice(source: &io::Error) -> &'static str {
    match source.kind() {
        ErrorKind::PermissionDenied => {
            "; on most systems your user must be in the group that owns it (video)"
        }
        ErrorKind::NotFound => "; its driver is there, but udev has made no device",
        _ => "",
    }
}

/// See the module.
#[derive(Debug)]
pub struct Framebuffer {
    packer: Packer,
    device: File,
    path: PathBuf,
    /// The bytes of all rows as they were written last.
    shown: Vec<u8>,
    /// Whether that is so: not until all was written once, nor after an error.
    known: bool,
    /// A dark row.
    dark: Vec<u8>,
}

impl Framebuffer {
    /// Opens the display of a panel. Shows nothing: what is on it stays until the first call.
    ///
    /// # Errors
    /// [`LcdError::Open`] if there is no such display, it cannot be written, or it is not as the
    /// panel needs it; also what [`Layout::fits`] refuses.
    pub fn open(layout: Layout, place: &Place) -> Result<Framebuffer, LcdError> {
        let needs = layout.checked()?.display_px();
        let geometry = Geometry::read(&place.sysfs)?;
        let depth = geometry.usable(layout)?;
        let [width_px, height_px] = needs;
        let format = Format { width_px, height_px, stride_bytes: geometry.stride_bytes, depth };
        let packer = Packer::new(layout, format)?;
        let path = place.device.clone();
        let device = File::options().write(true).open(&path);
        let device = device.map_err(|source| OpenError::Device { path: path.clone(), source })?;
        let dark = packer.dark();
        let shown = vec![0; dark.len() * height_px as usize];
        Ok(Framebuffer { packer, device, path, shown, known: false, dark })
    }

    /// Writes the rows that differ from what is shown, each run of them at once.
    fn put<'a>(&mut self, rows: impl Iterator<Item = &'a [u8]>) -> Result<(), LcdError> {
        let stride = self.packer.format().stride_bytes as usize;
        // Only where all goes well is it known what is shown.
        let known = std::mem::take(&mut self.known);
        let mut changed: Vec<std::ops::Range<usize>> = Vec::new();
        for (y, (row, shown)) in rows.zip(self.shown.chunks_exact_mut(stride)).enumerate() {
            if known && row == shown {
                continue;
            }
            shown.copy_from_slice(row);
            match changed.last_mut() {
                Some(run) if run.end == y => run.end = y + 1,
                _ => changed.push(y..y + 1),
            }
        }
        for run in changed {
            let (first, end) = (run.start * stride, run.end * stride);
            let bytes = self.shown.get(first..end).unwrap_or_default();
            self.device.write_all_at(bytes, first as u64).map_err(io_error("write", &self.path))?;
        }
        self.known = true;
        Ok(())
    }
}

impl Sink for Framebuffer {
    fn layout(&self) -> Layout {
        self.packer.layout()
    }

    fn format(&self) -> Format {
        self.packer.format()
    }

    fn painter(&self) -> Painter {
        Painter::with(self.packer, None)
    }

    fn show(&mut self, frame: &Frame) -> Result<(), LcdError> {
        if !frame.is_of(self.layout(), self.format()) {
            return Err(LcdError::Foreign);
        }
        let stride = self.packer.format().stride_bytes as usize;
        self.put(frame.bytes().chunks_exact(stride))
    }

    fn blank(&mut self) -> Result<(), LcdError> {
        let dark = std::mem::take(&mut self.dark);
        let done = self.put(std::iter::repeat(&dark[..]));
        self.dark = dark;
        done
    }
}

impl Geometry {
    /// Whether the panel can be shown on it from its first row on, and with which depth.
    fn usable(&self, layout: Layout) -> Result<Depth, OpenError> {
        let name = self.name.clone();
        let Layout { width_px: panel_width, height_px: panel_height, .. } = layout;
        let needs @ [needs_width, needs_height] = layout.display_px();
        let shows @ [width, height] = self.visible_px(needs);
        if shows != needs {
            return Err(OpenError::Size {
                name,
                width,
                height,
                panel_width,
                panel_height,
                needs_width,
                needs_height,
            });
        }
        let [column, row] = self.pan_px;
        if column > 0 || row > 0 {
            return Err(OpenError::Panned { name, column, row });
        }
        Depth::of_bits(self.bits).ok_or(OpenError::Depth { name, bits: self.bits })
    }
}

#[cfg(test)]
mod tests;
