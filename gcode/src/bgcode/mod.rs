//! Binary G-code (`.bgcode`): the container that PrusaSlicer writes by default.
//!
//! Takes bytes, gives blocks, or the G-code text that lies in them; and back.
//! By the specification of libbgcode (`doc/specifications.md`, version 1): a file
//! header, then blocks of metadata, thumbnails and G-code, each with its own
//! compression and checksum. Knows no file system, and nothing of what the text
//! means.
//!
//! # Layout
//! ```text
//! bytes ─ reader ─► Block ─ compress ─► data ─ meatpack ─► text
//! bytes ◄ writer ─────────── compress ◄────── meatpack ◄── text
//! ```
//! [`text`] is what most callers want: the text of a job, whatever its container.
//! [`survey`] tells where the G-code lies in a file, for who wants to put other
//! G-code in its place.
mod compress;
mod error;
mod header;
mod heatshrink;
mod meatpack;
mod reader;
mod survey;
mod text;
mod writer;

pub use error::{Error, Fault, damage};
pub use header::{BlockHeader, Checksum, Compression, Encoding, FileHeader, Kind, MAGIC};
pub use reader::{Block, Pairs, Reader};
pub use survey::{Survey, survey};
pub use text::{Text, bare_text, text};
pub use writer::{BLOCK_TEXT_BYTES, Packing, Writer, block, file_header};
