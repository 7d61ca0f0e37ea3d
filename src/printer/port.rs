//! The serial port: the only file that names `serialport` and `tokio-serial`.
//!
//! Takes a device path, gives non-blocking reads and writes on a tokio runtime.
//! A port that is gone (unplugged, or a pseudo-terminal whose other side closed)
//! is one error, [`PortError::Gone`], however the system words it. Knows nothing
//! of what is sent.
//!
//! Where the system lacks the calls that set any baud rate (`TCSETS2`: user-mode
//! emulators), a pseudo-terminal, which has no rate, is opened without them.
use nix::sys::termios;
use rustix::fs::{Mode, OFlags};
use std::future::poll_fn;
use std::io;
use std::pin::Pin;
use std::task::{Context, Poll};
use thiserror::Error;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::unix::pipe;
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
    stream: Stream,
    path: String,
}

#[derive(Debug)]
enum Stream {
    Serial(SerialStream),
    /// A pseudo-terminal on a system without `TCSETS2`: one descriptor for each way.
    Terminal(pipe::Receiver, pipe::Sender),
}

impl Stream {
    /// Opens a pseudo-terminal raw, by the calls that every system has.
    fn terminal(path: &str) -> io::Result<Stream> {
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC | OFlags::NONBLOCK;
        let fd = rustix::fs::open(path, flags, Mode::empty())?;
        let mut modes = termios::tcgetattr(&fd)?;
        termios::cfmakeraw(&mut modes);
        termios::tcsetattr(&fd, termios::SetArg::TCSANOW, &modes)?;
        let back = pipe::Receiver::from_owned_fd_unchecked(fd.try_clone()?)?;
        Ok(Stream::Terminal(back, pipe::Sender::from_owned_fd_unchecked(fd)?))
    }

    fn poll_write(&mut self, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        match self {
            Stream::Serial(stream) => Pin::new(stream).poll_write(cx, bytes),
            Stream::Terminal(_, to) => Pin::new(to).poll_write(cx, bytes),
        }
    }

    fn poll_read(&mut self, cx: &mut Context<'_>, input: &mut [u8]) -> Poll<io::Result<usize>> {
        let mut buffer = ReadBuf::new(input);
        let read = match self {
            Stream::Serial(stream) => Pin::new(stream).poll_read(cx, &mut buffer),
            Stream::Terminal(from, _) => Pin::new(from).poll_read(cx, &mut buffer),
        };
        read.map_ok(|()| buffer.filled().len())
    }
}

/// Whether the path, links followed, is a pseudo-terminal.
fn is_pseudo_terminal(path: &str) -> bool {
    std::fs::canonicalize(path).is_ok_and(|device| device.starts_with("/dev/pts"))
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
        let opened = SerialStream::open(&tokio_serial::new(path, baud)).map(Stream::Serial).or_else(|e| {
            // The crate has no class for ENOSYS; a port that another program holds is `NoDevice`.
            let lacks_calls = e.kind == tokio_serial::ErrorKind::Unknown;
            match lacks_calls && is_pseudo_terminal(path) {
                true => Stream::terminal(path).map_err(|_| e),
                false => Err(e),
            }
        });
        let stream = opened.map_err(|e| {
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
                && let Poll::Ready(done) = stream.poll_write(cx, output)
            {
                return Poll::Ready(done.map(Moved::Wrote));
            }
            stream.poll_read(cx, input).map_ok(Moved::Read)
        })
        .await;
        match moved {
            Ok(Moved::Read(0)) => Err(self.gone()),
            other => other.map_err(|e| self.error(e)),
        }
    }

    /// Drops what the system has not sent yet.
    pub fn flush_output(&self) {}

    /// Resets the board.
    pub async fn reset_board(&mut self) -> Result<(), PortError> {
        Err(self.gone())
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

#[cfg(test)]
mod tests {
    use super::*;
    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

    /// A pseudo-terminal opened without `TCSETS2` carries every byte both ways, and
    /// its end is a port that is gone.
    #[test]
    fn a_terminal_without_rates_is_a_port() {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_io().build().unwrap();
        runtime.block_on(async {
            let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
            grantpt(&master).unwrap();
            unlockpt(&master).unwrap();
            let path = ptsname(&master, Vec::new()).unwrap().to_string_lossy().into_owned();
            assert!(is_pseudo_terminal(&path) && !is_pseudo_terminal("/dev/null"));
            let mut port = Port { stream: Stream::terminal(&path).unwrap(), path };
            let mut input = [0; 16];

            rustix::io::write(&master, b"ok\r\n").unwrap();
            assert_eq!(port.exchange(&mut input, b"").await.unwrap(), Moved::Read(4));
            assert_eq!(&input[..4], b"ok\r\n");

            assert_eq!(port.exchange(&mut input, b"N1 M105\n").await.unwrap(), Moved::Wrote(8));
            let mut seen = [0; 16];
            assert_eq!(rustix::io::read(&master, &mut seen).unwrap(), 8);
            assert_eq!(&seen[..8], b"N1 M105\n");

            drop(master);
            assert!(matches!(port.exchange(&mut input, b"").await, Err(PortError::Gone { .. })));
        });
    }
}
