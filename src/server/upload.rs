//! From a request's bytes to an upload on the disk: streamed, counted, digested, bounded.
//!
//! Takes pieces as they come; gives a temporary file in the data folder with its length and
//! SHA-256. Memory: a few pieces. A medium that is slow holds up this client alone: the writing is
//! a blocking thread's. What is not finished is gone with its handle.
use super::problem::{Kind, Problem};
use super::shelf::Shelf;
use axum::body::{Body, Bytes};
use futures_util::StreamExt;
use sha2::{Digest, Sha256};
use std::io::Write;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use tempfile::NamedTempFile;
use tokio::sync::{mpsc, oneshot};

/// Pieces on their way to the disk at most.
const MAX_PIECES: usize = 4;

/// Longest name that is kept of a file, bytes: what file systems take.
const MAX_NAME_BYTES: usize = 200;

/// Bytes of a form that are read before its reader has something of them: some pieces of the
/// network's, and far more than a part's head has.
const MAX_AHEAD_BYTES: usize = 1 << 20;

/// How much is written between two looks at the free space.
const LOOK_BYTES: u64 = 8 << 20;

/// What was uploaded.
#[derive(Debug)]
pub(crate) struct Upload {
    /// Its bytes.
    pub(crate) file: NamedTempFile,
    /// How many.
    pub(crate) bytes: u64,
    /// Their SHA-256.
    pub(crate) sha256: [u8; 32],
}

/// How much may be taken.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounds {
    /// Bytes of one upload.
    pub(crate) max_bytes: u64,
    /// Bytes that stay free on the disk.
    pub(crate) min_free_bytes: u64,
}

/// An upload on its way.
pub(crate) struct Incoming {
    pieces: mpsc::Sender<Bytes>,
    done: oneshot::Receiver<Result<Upload, Problem>>,
    max_bytes: u64,
    bytes: u64,
}

impl Incoming {
    /// Begins an upload of `announced` bytes, if that is known.
    ///
    /// # Errors
    /// It is too large, or the disk too full.
    pub(crate) async fn begin(
        shelf: &Shelf,
        bounds: Bounds,
        announced: Option<u64>,
    ) -> Result<Self, Problem> {
        if announced.is_some_and(|bytes| bytes > bounds.max_bytes) {
            return Err(too_large(bounds.max_bytes));
        }
        let (pieces, inbox) = mpsc::channel(MAX_PIECES);
        let (tell, done) = oneshot::channel();
        let (opened, is_open) = oneshot::channel();
        let shelf = shelf.clone();
        tokio::task::spawn_blocking(move || {
            let begun = room(&shelf, announced.unwrap_or(0), bounds.min_free_bytes)
                .and_then(|()| shelf.upload().map_err(|e| Problem::from(super::foreman::Refusal::Shelf(e))));
            match begun {
                Err(problem) => drop(opened.send(Err(problem))),
                Ok(file) => {
                    let _ = opened.send(Ok(()));
                    let _ = tell.send(write(&shelf, bounds, file, inbox));
                }
            }
        });
        is_open.await.map_err(|_| Problem::internal("the upload's thread is gone"))??;
        Ok(Self { pieces, done, max_bytes: bounds.max_bytes, bytes: 0 })
    }

    /// The next piece.
    ///
    /// # Errors
    /// It is one too many, or the disk refuses: then [`Incoming::end`] says why.
    pub(crate) async fn piece(&mut self, piece: Bytes) -> Result<(), Problem> {
        self.bytes += piece.len() as u64;
        if self.bytes > self.max_bytes {
            return Err(too_large(self.max_bytes));
        }
        if self.pieces.send(piece).await.is_err() {
            let why = (&mut self.done).await.map_err(|_| Problem::internal("the upload's thread is gone"))?;
            return Err(why.err().unwrap_or_else(|| Problem::internal("the upload ended early")));
        }
        Ok(())
    }

    /// All pieces have come.
    ///
    /// # Errors
    /// The disk refuses.
    pub(crate) async fn end(self) -> Result<Upload, Problem> {
        drop(self.pieces);
        self.done.await.map_err(|_| Problem::internal("the upload's thread is gone"))?
    }
}

fn too_large(max_bytes: u64) -> Problem {
    let words = format!("files of at most {} MB are taken (server.max_upload_mb)", max_bytes / 1_000_000);
    Problem::new(Kind::TooLarge, words)
}

/// Whether so many bytes more leave enough free.
fn room(shelf: &Shelf, bytes: u64, min_free_bytes: u64) -> Result<(), Problem> {
    // Where the system does not tell, writing will.
    let Ok(free) = shelf.free_bytes() else { return Ok(()) };
    match free >= bytes.saturating_add(min_free_bytes) {
        true => Ok(()),
        false => Err(Problem::new(
            Kind::NoSpace,
            format!(
                "{} MB are free on the disk, and {} MB shall stay so (storage.min_free_mb): delete files",
                free / 1_000_000,
                min_free_bytes / 1_000_000
            ),
        )),
    }
}

fn write(
    shelf: &Shelf,
    bounds: Bounds,
    mut file: NamedTempFile,
    mut pieces: mpsc::Receiver<Bytes>,
) -> Result<Upload, Problem> {
    let mut sum = Sha256::new();
    let (mut bytes, mut looked) = (0_u64, 0_u64);
    while let Some(piece) = pieces.blocking_recv() {
        if bytes - looked >= LOOK_BYTES {
            looked = bytes;
            room(shelf, 0, bounds.min_free_bytes)?;
        }
        file.write_all(&piece).map_err(|e| match e.kind() {
            std::io::ErrorKind::StorageFull | std::io::ErrorKind::QuotaExceeded => {
                tracing::warn!("an upload was refused: {e}");
                Problem::new(Kind::NoSpace, "the disk is full: delete files")
            }
            _ => Problem::internal(format!("cannot write the upload: {e}")),
        })?;
        sum.update(&piece);
        bytes += piece.len() as u64;
    }
    Ok(Upload { file, bytes, sha256: sum.finalize().into() })
}

/// A body of a form, for who reads it part by part: what is read ahead is bounded. Without that a
/// part whose head never ends would be kept in memory.
pub(crate) fn read_ahead(body: Body) -> (Body, ReadAhead) {
    let ahead = ReadAhead::default();
    let counted = ahead.clone();
    let pieces = body.into_data_stream().map(move |piece| {
        let piece = piece?;
        match counted.0.fetch_add(piece.len(), Ordering::Relaxed) + piece.len() {
            ..=MAX_AHEAD_BYTES => Ok(piece),
            _ => Err(axum::Error::new("a part's head is too long")),
        }
    });
    (Body::from_stream(pieces), ahead)
}

/// How much of a form was read since its reader last had something of it.
#[derive(Clone, Debug, Default)]
pub(crate) struct ReadAhead(Arc<AtomicUsize>);

impl ReadAhead {
    /// Its reader has got something.
    pub(crate) fn got(&self) {
        self.0.store(0, Ordering::Relaxed);
    }
}

/// A file's name as it may be shown: the last part of what was said, without control characters
/// and those that reorder a text, not too long. Never a path.
///
/// # Errors
/// Nothing is left.
pub(crate) fn shown_name(said: &str) -> Result<String, Problem> {
    let last = said.rsplit(['/', '\\']).next().unwrap_or_default();
    let odd = |c: char| {
        c.is_control()
            || matches!(c, '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}')
    };
    let plain: String = last.chars().filter(|c| !odd(*c)).collect();
    let plain = plain.trim();
    let kept = &plain[..plain.floor_char_boundary(MAX_NAME_BYTES)];
    match kept {
        "" | "." | ".." => Err(Problem::bad("the file has no name: say one with ?name=")),
        kept => Ok(kept.to_owned()),
    }
}

/// The SHA-256 that a `Content-Digest` (RFC 9530) announces, if it does.
///
/// # Errors
/// It is none.
pub(crate) fn announced_digest(header: &str) -> Result<Option<[u8; 32]>, Problem> {
    use base64::Engine;
    let bad = || Problem::bad("Content-Digest must be sha-256=:BASE64:");
    for field in header.split(',') {
        let Some(value) = field.trim().strip_prefix("sha-256=") else { continue };
        let value = value.strip_prefix(':').and_then(|v| v.strip_suffix(':')).ok_or_else(bad)?;
        let bytes = base64::engine::general_purpose::STANDARD.decode(value).map_err(|_| bad())?;
        return bytes.try_into().map(Some).map_err(|_| bad());
    }
    Ok(None)
}

/// The SHA-256 of bytes that are in memory.
pub(crate) fn sha256(bytes: &[u8]) -> [u8; 32] {
    Sha256::digest(bytes).into()
}

/// Lower-case hexadecimal digits.
pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_never_a_path() {
        let check = |said: &str, expect: Option<&str>| {
            assert_eq!(shown_name(said).ok().as_deref(), expect, "{said:?}");
        };
        check("part.gcode", Some("part.gcode"));
        check("../../etc/passwd", Some("passwd"));
        check("C:\\prints\\part.gcode", Some("part.gcode"));
        check("a\0b\n\u{202e}c.gcode", Some("abc.gcode"));
        check("<script>alert(1)</script>", Some("script>"));
        check("..", None);
        check("folder/", None);
        check("  ", None);
        assert_eq!(shown_name(&"ä".repeat(300)).unwrap().len(), MAX_NAME_BYTES);
    }

    #[test]
    fn a_digest_is_announced_in_one_way() {
        let check = |header: &str, expect: Option<Option<u8>>| {
            let told = announced_digest(header).ok().map(|sum| sum.map(|sum| sum[0]));
            assert_eq!(told, expect, "{header}");
        };
        check("sha-256=:47DEQpj8HBSa+/TImW+5JCeuQeRkm5NMpJWZG3hSuFU=:", Some(Some(0xe3)));
        check("md5=:AAAA:", Some(None));
        check("sha-256=abc", None);
        check("sha-256=:AAAA:", None);
    }

    #[tokio::test]
    async fn an_upload_is_counted_digested_and_bounded() {
        let folder = tempfile::tempdir().unwrap();
        let shelf = Shelf::open(folder.path()).unwrap();
        let bounds = Bounds { max_bytes: 8, min_free_bytes: 0 };
        let mut incoming = Incoming::begin(&shelf, bounds, None).await.unwrap();
        for piece in ["G2", "8\n"] {
            incoming.piece(Bytes::from_static(piece.as_bytes())).await.unwrap();
        }
        let upload = incoming.end().await.unwrap();
        assert_eq!((upload.bytes, std::fs::read(upload.file.path()).unwrap()), (4, b"G28\n".to_vec()));
        assert_eq!(upload.sha256, <[u8; 32]>::from(Sha256::digest(b"G28\n")));

        assert_eq!(
            Incoming::begin(&shelf, bounds, Some(9)).await.err().map(|p| p.kind),
            Some(Kind::TooLarge)
        );
        let mut incoming = Incoming::begin(&shelf, bounds, None).await.unwrap();
        let much = incoming.piece(Bytes::from_static(&[0; 9])).await;
        assert_eq!(much.err().map(|p| p.kind), Some(Kind::TooLarge));

        let full = Bounds { min_free_bytes: u64::MAX, ..bounds };
        assert_eq!(Incoming::begin(&shelf, full, None).await.err().map(|p| p.kind), Some(Kind::NoSpace));
    }
}
