//! What a job comes in, text or binary G-code, and how the result goes back into the same.
//!
//! Takes the input and the output; gives the text to work on, and takes the text
//! that was made. Of binary G-code only the G-code blocks are made anew, packed as
//! they were; all other blocks go over byte for byte. Knows nothing of what the
//! text says.
use super::{BUFFER_BYTES, Failure};
use outrigger_gcode::bgcode::{Encoding, MAGIC, Survey, Text, Writer, bare_text, survey, text};
use std::borrow::Cow;
use std::io::{BufReader, BufWriter, Read, Result, Seek, SeekFrom, Write};

/// What a job comes in.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Container {
    /// Text.
    Text,
    /// Binary G-code, every block of which has been checked.
    Binary(Survey),
}

impl Container {
    /// Tells it by the first bytes.
    ///
    /// # Errors
    /// The reader's, or that the binary G-code is damaged.
    pub(crate) fn of(input: &mut (impl Read + Seek)) -> Result<Container> {
        input.seek(SeekFrom::Start(0))?;
        let mut first = Vec::new();
        input.take(MAGIC.len() as u64).read_to_end(&mut first)?;
        if first != MAGIC {
            return Ok(Container::Text);
        }
        input.seek(SeekFrom::Start(0))?;
        Ok(Container::Binary(survey(BufReader::with_capacity(BUFFER_BYTES, input))?))
    }

    /// Why the text of such a container is not to be changed.
    pub(crate) fn refusal(&self) -> Option<&'static str> {
        let Container::Binary(survey) = self else { return None };
        if survey.gcode_blocks == 0 {
            Some("there is no G-code in this binary G-code")
        } else if survey.packing.encoding == Encoding::MeatPack {
            Some(
                "this binary G-code is packed without comments (MeatPack), and nothing else tells infill from walls",
            )
        } else if !survey.uniform {
            Some("the blocks of this binary G-code are not all packed in one way")
        } else if survey.interrupted {
            Some("other blocks stand between those of G-code in this binary G-code")
        } else {
            None
        }
    }

    /// What comes before the G-code, byte for byte; then what takes the G-code.
    ///
    /// # Errors
    /// The reader's or the writer's.
    pub(crate) fn begin<W: Write>(
        &self,
        input: &mut (impl Read + Seek),
        mut output: W,
    ) -> std::result::Result<Output<W>, Failure> {
        if let Container::Binary(survey) = self {
            copy(input, 0, survey.gcode_from, &mut output)?;
        }
        let output = BufWriter::with_capacity(BUFFER_BYTES, output);
        Ok(match self {
            Container::Text => Output::Text(output),
            Container::Binary(survey) => Output::Binary(Box::new(Writer::new(output, survey.packing))),
        })
    }

    /// What comes behind the G-code, byte for byte.
    ///
    /// # Errors
    /// The reader's or the writer's.
    pub(crate) fn end(
        &self,
        input: &mut (impl Read + Seek),
        output: &mut impl Write,
    ) -> std::result::Result<(), Failure> {
        match self {
            Container::Text => Ok(()),
            Container::Binary(survey) => copy(input, survey.gcode_to, survey.bytes - survey.gcode_to, output),
        }
    }
}

/// Copies a stretch of the input; tells which side fails.
fn copy(
    input: &mut (impl Read + Seek),
    from: u64,
    count: u64,
    output: &mut impl Write,
) -> std::result::Result<(), Failure> {
    input.seek(SeekFrom::Start(from)).map_err(Failure::Read)?;
    let mut left = count;
    let mut piece = Vec::new();
    while left > 0 {
        piece.clear();
        let read = input.by_ref().take(left.min(BUFFER_BYTES as u64)).read_to_end(&mut piece);
        if read.map_err(Failure::Read)? == 0 {
            return Err(Failure::Read(std::io::ErrorKind::UnexpectedEof.into()));
        }
        output.write_all(&piece).map_err(Failure::Write)?;
        left -= piece.len() as u64;
    }
    Ok(())
}

/// The text of a job from where the input stands, in binary G-code what is in its G-code blocks.
pub(crate) fn gcode<R: Read>(input: R) -> Text<BufReader<R>> {
    bare_text(BufReader::with_capacity(BUFFER_BYTES, input))
}

/// The beginning of a job's text, at most `count` bytes; the metadata of binary
/// G-code are comments in it.
///
/// # Errors
/// The reader's, or that the binary G-code is damaged.
pub(crate) fn beginning(input: &mut (impl Read + Seek), count: u64) -> Result<Vec<u8>> {
    input.seek(SeekFrom::Start(0))?;
    let mut bytes = Vec::new();
    text(BufReader::with_capacity(BUFFER_BYTES, input)).take(count).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Takes the text that was made, layer by layer.
pub(crate) enum Output<W: Write> {
    /// As it is.
    Text(BufWriter<W>),
    /// Into blocks.
    Binary(Box<Writer<BufWriter<W>>>),
}

impl<W: Write> Output<W> {
    /// Writes a layer, `changed` or as the input has it; gives what a reader will
    /// find, `None` where that is the input. A binary block is read back from its
    /// own bytes and compared with this before it is written (see [`Writer`]), so
    /// that whoever looks at what is given looks at what is in the file.
    ///
    /// # Errors
    /// The writer's, or that the text does not fit into the container.
    pub(crate) fn put(&mut self, changed: Option<Vec<u8>>, input: &[u8]) -> Result<Option<Vec<u8>>> {
        let text = changed.as_deref().unwrap_or(input);
        match self {
            Output::Text(output) => {
                output.write_all(text)?;
                Ok(changed)
            }
            Output::Binary(writer) => {
                let found = writer.put(text)?;
                Ok(match found {
                    _ if *found == *input => None,
                    Cow::Owned(found) => Some(found),
                    Cow::Borrowed(_) => changed,
                })
            }
        }
    }

    /// After the last layer.
    ///
    /// # Errors
    /// As [`Output::put`].
    pub(crate) fn finish(self) -> Result<()> {
        match self {
            Output::Text(mut output) => output.flush(),
            Output::Binary(writer) => writer.finish().map(drop),
        }
    }
}

/// Tells how far a reader has come.
pub(crate) struct Counted<'a, R> {
    inner: R,
    bytes: u64,
    progress: &'a (dyn Fn(u64) + Sync),
}

impl<R: Read> Counted<'_, R> {
    pub(crate) fn new(inner: R, progress: &(dyn Fn(u64) + Sync)) -> Counted<'_, R> {
        Counted { inner, bytes: 0, progress }
    }
}

impl<R: Read> Read for Counted<'_, R> {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize> {
        let count = self.inner.read(buffer)?;
        self.bytes += count as u64;
        (self.progress)(self.bytes);
        Ok(count)
    }
}
