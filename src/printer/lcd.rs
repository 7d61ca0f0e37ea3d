//! The display of a resin printer: a monochrome LCD that masks the light of a UV lamp.
//!
//! Takes a picture's rows of 8-bit brightness, as any decoder gives them, and puts the picture in
//! front of the lamp. A picture is made ready first and shown later, in three steps that three
//! threads may do:
//!
//! ```text
//! rows ──► Painter ──► Frame ──► Sink::show ──► light
//!             ▲  (all that takes time)   │ (a write, a rename)
//!             └───────── take_back ◄─────┘
//! ```
//!
//! # Layout
//! - [`layout`]: how the panel's pixels lie in the display's bytes.
//! - [`painter`]: rows into a [`Frame`], whose memory is used again.
//! - [`sum`]: a number for a picture, to tell whether what was shown is what the job holds.
//! - [`framebuffer`]: a display that Linux drives.
//! - [`folder`]: a folder of PNG files, for who shows them by other means, and for trying.
//! - [`recorder`]: in memory, for tests and the demo.
//!
//! Knows no job, no lamp and no motion: when to show and when to be dark is the caller's.
//! Brightness is handed on as it is: 0 lets no light through, 255 all that the panel can.
pub mod folder;
pub mod framebuffer;
pub mod layout;
mod pack;
pub mod painter;
pub mod recorder;
pub mod sum;

use folder::Staged;
use framebuffer::OpenError;
use layout::{Format, Layout, MAX_SIDE_PX};
use painter::Painter;
use std::io;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Where pictures are shown.
pub trait Sink: Send {
    /// The panel, and how its pixels lie in the bytes of this sink's frames.
    fn layout(&self) -> Layout;

    /// The size and depth of this sink's frames.
    fn format(&self) -> Format;

    /// Makes frames for this sink. It may go to another thread, and a sink may have many.
    fn painter(&self) -> Painter;

    /// Shows a frame that one of its painters made. All that takes time was done when the
    /// frame was made; the same frame may be shown again.
    ///
    /// # Errors
    /// The frame is not of this sink, or the system refuses. Then it is not known what is
    /// shown, and the next call makes it good whatever it was.
    fn show(&mut self, frame: &Frame) -> Result<(), LcdError>;

    /// Makes the whole panel dark.
    ///
    /// # Errors
    /// As [`Sink::show`].
    fn blank(&mut self) -> Result<(), LcdError>;
}

/// A picture, ready to be shown by the sink whose painter made it.
#[derive(Debug)]
pub struct Frame {
    layout: Layout,
    format: Format,
    /// Rows from the top at the format's stride.
    bytes: Vec<u8>,
    sum: u64,
    /// The file that was written ahead, where the sink is a folder.
    staged: Option<Staged>,
}

impl Frame {
    /// The display's bytes, row by row from the top at [`Format::stride_bytes`].
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// [`sum::Sum`] of the picture's rows as they were given: before mirroring and packing.
    #[must_use]
    pub fn sum(&self) -> u64 {
        self.sum
    }

    fn is_of(&self, layout: Layout, format: Format) -> bool {
        self.layout == layout && self.format == format
    }
}

/// Why a picture cannot be made ready or shown.
#[derive(Debug, Error)]
pub enum LcdError {
    /// The panel has no pixels, or more than any that is sold.
    #[error(
        "a panel of {width} × {height} px: each side must have 1 to {MAX_SIDE_PX}; set lcd.width_px and lcd.height_px in the printer's profile"
    )]
    Panel {
        /// Pixels along a row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// The display is not of the size that the panel needs.
    #[error("the display has {width} × {height} px, the panel needs {needs_width} × {needs_height}")]
    Size {
        /// The display's pixels along a row.
        width: u32,
        /// The display's rows.
        height: u32,
        /// Display pixels along a row that the panel needs.
        needs_width: u32,
        /// Rows that the panel needs.
        needs_height: u32,
    },
    /// Three neighbours shall be red, green and blue of a display that has no colours.
    #[error(
        "a display of 8 bits a pixel has no colours that three pixels of the panel could be: set lcd.pixels in the printer's profile to grey, or the kernel's depth to 16, 24 or 32 bits"
    )]
    NoColours,
    /// The bytes between the beginnings of two rows cannot be.
    #[error("rows of {stride} bytes, while their pixels take {least}; {most} at most are taken")]
    Stride {
        /// What the display says.
        stride: u32,
        /// Bytes of a row's pixels.
        least: u32,
        /// The most that is taken.
        most: u32,
    },
    /// A row of the picture is not as wide as the panel.
    #[error("row {row} of the picture has {got} px, the panel {wanted}")]
    RowLength {
        /// From 0 at the top.
        row: u32,
        /// Its pixels.
        got: usize,
        /// The panel's.
        wanted: u32,
    },
    /// More or fewer rows than the panel has.
    #[error("the picture has {got}{} rows, the panel {wanted}", if got > wanted { " or more" } else { "" })]
    RowCount {
        /// Rows that came.
        got: u32,
        /// The panel's.
        wanted: u32,
    },
    /// A row was refused, and the picture taken for whole nevertheless.
    #[error("the picture was broken off by a wrong row: this is a mistake in the program")]
    Broken,
    /// Another sink's painter made the frame.
    #[error("the picture was made ready for another display: this is a mistake in the program")]
    Foreign,
    /// The display cannot be used.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The system refuses.
    #[error("cannot {what} {}: {source}", path.display())]
    Io {
        /// What was tried: "write", "make the folder".
        what: &'static str,
        /// With which file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A [`recorder::Recorder`] was told to fail here.
    #[error("the display fails as it was told to")]
    Told,
}

/// For `map_err`: what was tried with which file.
fn io_error(what: &'static str, path: &Path) -> impl FnOnce(io::Error) -> LcdError {
    move |source| LcdError::Io { what, path: path.to_owned(), source }
}
