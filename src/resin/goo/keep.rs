//! A GOO file written anew from another, with some pictures changed.
//!
//! Takes the open file and a writer; head, previews, definitions and what stands behind
//! the end are copied byte for byte. Only the length in front of a changed picture
//! changes with it. Knows no picture's content.
use super::{DEFINITION_BYTES, DELIMITER, Goo, GooError};
use std::io::{self, Read, Seek, SeekFrom, Write};

/// Bytes that are copied at a time.
const COPY_BYTES: usize = 64 << 10;

/// Where the length of the picture stands in a definition: its last field.
const LENGTH_AT: usize = DEFINITION_BYTES - 4;

/// Why a file cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum KeepError {
    /// The file that is copied.
    #[error(transparent)]
    Read(#[from] GooError),
    /// The writer refused.
    #[error("{0}")]
    Write(io::Error),
}

/// A file under construction.
#[derive(Debug)]
pub(in crate::resin) struct Keeper<W> {
    out: W,
}

impl<W: Write> Keeper<W> {
    /// Copies all that stands before the first layer.
    ///
    /// # Errors
    /// Reading or writing fails.
    pub(in crate::resin) fn begin<R: Read + Seek>(goo: &mut Goo<R>, out: W) -> Result<Keeper<W>, KeepError> {
        let mut keeper = Keeper { out };
        let layers_at = goo.layers_at;
        keeper.copy(goo, 0, layers_at)?;
        Ok(keeper)
    }

    /// Writes the next layer: as it is, or with another picture.
    ///
    /// # Errors
    /// Reading or writing fails.
    pub(in crate::resin) fn layer<R: Read + Seek>(
        &mut self,
        goo: &mut Goo<R>,
        entry: usize,
        picture: Option<&[u8]>,
    ) -> Result<(), KeepError> {
        let Some(&place) = goo.places.get(entry) else { return Ok(()) };
        let Some(picture) = picture else { return self.copy(goo, place.at, place.end()) };
        self.copy(goo, place.at, place.at + LENGTH_AT as u64)?;
        let length = (picture.len() as u32).to_be_bytes();
        for bytes in [&length[..], picture, &DELIMITER] {
            self.out.write_all(bytes).map_err(KeepError::Write)?;
        }
        Ok(())
    }

    /// Copies what stands behind the last layer.
    ///
    /// # Errors
    /// Reading or writing fails.
    pub(in crate::resin) fn finish<R: Read + Seek>(mut self, goo: &mut Goo<R>) -> Result<(), KeepError> {
        let (from, to) = (goo.layers_end, goo.length);
        self.copy(goo, from, to)?;
        self.out.flush().map_err(KeepError::Write)
    }

    fn copy<R: Read + Seek>(&mut self, goo: &mut Goo<R>, from: u64, to: u64) -> Result<(), KeepError> {
        let cut = || GooError::Cut { at: from, what: "what is copied".to_owned() };
        goo.reader.seek(SeekFrom::Start(from)).map_err(GooError::Io)?;
        let mut left = to.saturating_sub(from);
        let mut buffer = vec![0; COPY_BYTES.min(left as usize)];
        while left > 0 {
            let some = buffer.len().min(usize::try_from(left).unwrap_or(usize::MAX));
            goo.reader.read_exact(&mut buffer[..some]).map_err(|e| match e.kind() {
                io::ErrorKind::UnexpectedEof => cut(),
                _ => GooError::Io(e),
            })?;
            self.out.write_all(&buffer[..some]).map_err(KeepError::Write)?;
            left -= some as u64;
        }
        Ok(())
    }
}
