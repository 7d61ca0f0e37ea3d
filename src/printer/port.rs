//! The serial port: the only file that names `serialport` and `tokio-serial`.
//!
//! Takes a device path, gives non-blocking reads and writes on a tokio runtime.
//! A port that is gone (unplugged, or a pseudo-terminal whose other side closed)
//! is one error, [`PortError::Gone`], however the system words it. Knows nothing
//! of what is sent.
use std::future::poll_fn;
use std::io;
use std::pin::Pin;
use std::task::Poll;
use thiserror::Error;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio_serial::SerialStream;

/// Why there is no port, or none any more.
#[derive(Debug, Error)]
pub enum PortError {
    /// The port cannot be opened.
    #[error("cannot open {path} at {baud} baud: {reason}{}", advice(*.kind))]
    Open {
        /// The device.
        path: String,
        /// Bits per second.
        baud: u32,
        /// What went wrong.
        reason: String,
        /// The system's class of it.
        kind: io::ErrorKind,
    },
    /// The other side has hung up.
    #[error("{path} is gone (unplugged or switched off?)")]
    Gone {
        /// The device.
        path: String,
    },
    /// The system refuses to read or write.
    #[error("{path}: {source}")]
    Io {
        /// The device.
        path: String,
        /// What the system said.
        source: io::Error,
    },
}

fn advice(kind: io::ErrorKind) -> &'static str {
    match kind {
        io::ErrorKind::NotFound => "; is the printer plugged in and switched on?",
        io::ErrorKind::PermissionDenied => {
            "; on most systems your user must be in the group that owns it (dialout or uucp)"
        }
        io::ErrorKind::ResourceBusy => "; another program holds it",
        _ => "",
    }
}

/// An open port, held exclusively.
#[derive(Debug)]
pub struct Port {
    stream: SerialStream,
    path: String,
}

/// What [`Port::exchange`] did.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Moved {
    /// So many bytes of the output were written.
    Wrote(usize),
    /// So many bytes of the input are filled.
    Read(usize),
}

impl Port {
    /// Opens `path` raw, 8N1, without flow control, at any `baud` that the
    /// hardware takes, 250,000 included; no other program may open it meanwhile.
    ///
    /// Opening raises DTR, which resets many boards. Call within a tokio runtime
    /// that drives I/O.
    pub fn open(path: &str, baud: u32) -> Result<Self, PortError> {
        let stream = SerialStream::open(&tokio_serial::new(path, baud)).map_err(|e| {
            let kind = match e.kind {
                tokio_serial::ErrorKind::NoDevice if !std::path::Path::new(path).exists() => {
                    io::ErrorKind::NotFound
                }
                tokio_serial::ErrorKind::NoDevice => io::ErrorKind::ResourceBusy,
                tokio_serial::ErrorKind::Io(kind) => kind,
                _ => io::ErrorKind::Other,
            };
            PortError::Open { path: path.to_owned(), baud, reason: e.description, kind }
        })?;
        Ok(Self { stream, path: path.to_owned() })
    }

    /// Waits until some of `output` can be written or something can be read into
    /// `input`, and does it. Neither waits for the other: a printer that takes no
    /// more bytes may still have much to say.
    ///
    /// Nothing is lost when the returned future is dropped.
    pub async fn exchange(&mut self, input: &mut [u8], output: &[u8]) -> Result<Moved, PortError> {
        let stream = &mut self.stream;
        let moved = poll_fn(|cx| {
            if !output.is_empty()
                && let Poll::Ready(done) = Pin::new(&mut *stream).poll_write(cx, output)
            {
                return Poll::Ready(done.map(Moved::Wrote));
            }
            let mut buffer = ReadBuf::new(input);
            Pin::new(&mut *stream).poll_read(cx, &mut buffer).map_ok(|()| Moved::Read(buffer.filled().len()))
        })
        .await;
        match moved {
            Ok(Moved::Read(0)) => Err(self.gone()),
            other => other.map_err(|e| self.error(e)),
        }
    }

    fn error(&self, source: io::Error) -> PortError {
        // A hung-up terminal reads EIO, an unplugged adapter ENXIO or ENODEV.
        let hung_up = matches!(source.raw_os_error(), Some(5 | 6 | 19))
            || matches!(source.kind(), io::ErrorKind::BrokenPipe | io::ErrorKind::NotConnected);
        match hung_up {
            true => self.gone(),
            false => PortError::Io { path: self.path.clone(), source },
        }
    }

    fn gone(&self) -> PortError {
        PortError::Gone { path: self.path.clone() }
    }
}
