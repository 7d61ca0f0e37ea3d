//! One open device: the descriptor that bytes go through, and the handle that
//! holds it: lock, speed, DTR.
//!
//! Takes a path and a speed, gives polls that never block. Two descriptors on one
//! device: ours carries the bytes, `serialport`'s has the modem lines and any
//! speed without `unsafe`. A pseudo-terminal, which has neither, needs one only,
//! and none of the calls that user-mode emulators lack (`TCSETS2`). Does not know
//! what an error means to a user.
use super::PortError;
use nix::sys::termios::{self, ControlFlags, FlushArg, SetArg};
use rustix::fs::{FlockOperation, Mode, OFlags};
use rustix::termios::OptionalActions;
use serialport::{SerialPort, TTYPort};
use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::pin::Pin;
use std::task::{Context, Poll};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::unix::pipe;

/// An open device. See the module's text.
#[derive(Debug)]
pub(super) struct Device {
    /// Watched for input only: who watches for room wakes at every byte that leaves.
    /// (To the runtime a terminal is as good as a pipe.)
    data: pipe::Receiver,
    /// Watches for room, while a write is blocked.
    full: Option<pipe::Sender>,
    /// `None` for a pseudo-terminal.
    lines: Option<TTYPort>,
    has_dtr: bool,
}

impl Device {
    /// Opens and locks `path`, raw and without hanging up at the end.
    pub(super) fn open(path: &str, baud: u32) -> Result<Self, PortError> {
        let refused = |e: Refused| PortError::Open { path: path.to_owned(), baud, reason: e.0, kind: e.1 };
        let device = match is_pseudo_terminal(path) {
            true => Self::terminal(path, baud),
            false => Self::serial(path, baud),
        };
        device.map_err(refused)
    }

    /// A port with modem lines.
    pub(super) fn serial(path: &str, baud: u32) -> Result<Self, Refused> {
        // Before the lock: it is for one descriptor only. Nothing is changed yet.
        let data = opened(path)?;
        let mut lines = serialport::new(path, baud).open_native()?;
        // By the calls that keep speeds which have no name.
        let mut modes = rustix::termios::tcgetattr(&data)?;
        modes.control_modes -= rustix::termios::ControlModes::HUPCL;
        rustix::termios::tcsetattr(&data, OptionalActions::Now, &modes)?;
        // Asking for a line that comes in tells whether there are lines at all.
        let has_dtr = lines.read_data_set_ready().is_ok();
        Ok(Self {
            data: pipe::Receiver::from_owned_fd_unchecked(data)?,
            full: None,
            lines: Some(lines),
            has_dtr,
        })
    }

    /// A pseudo-terminal. It is opened once only: who watches it counts.
    pub(super) fn terminal(path: &str, baud: u32) -> Result<Self, Refused> {
        let data = opened(path)?;
        // TIOCEXCL would outlive a host that is killed: whoever made the terminal
        // (Klipper) holds it open, so that nobody but root could ever open it again.
        rustix::fs::flock(&data, FlockOperation::NonBlockingLockExclusive)?;
        // By the C library's calls: emulators lack the kernel's newer ones.
        let mut modes = termios::tcgetattr(&data)?;
        termios::cfmakeraw(&mut modes);
        modes.control_flags -= ControlFlags::HUPCL;
        termios::tcsetattr(&data, SetArg::TCSANOW, &modes)?;
        let data = pipe::Receiver::from_owned_fd_unchecked(data)?;
        let mut device = Self { data, full: None, lines: None, has_dtr: false };
        device.set_baud(baud)?;
        Ok(device)
    }

    /// A second descriptor of the same opening, which shares its lock.
    pub(super) fn another(&self) -> io::Result<OwnedFd> {
        self.data.as_fd().try_clone_to_owned()
    }

    pub(super) fn has_dtr(&self) -> bool {
        self.has_dtr
    }

    pub(super) fn set_baud(&mut self, baud: u32) -> io::Result<()> {
        match &mut self.lines {
            Some(lines) => Ok(lines.set_baud_rate(baud)?),
            None => {
                // It has no speed; whoever is on the other side may want to see one.
                if let Ok(mut modes) = rustix::termios::tcgetattr(&self.data)
                    && modes.set_speed(baud).is_ok()
                {
                    let _ = rustix::termios::tcsetattr(&self.data, OptionalActions::Now, &modes);
                }
                Ok(())
            }
        }
    }

    /// Drops bytes that were not sent, bytes that were not read.
    pub(super) fn flush(&mut self, output: bool, input: bool) -> io::Result<()> {
        let queue = match (output, input) {
            (true, true) => FlushArg::TCIOFLUSH,
            (true, false) => FlushArg::TCOFLUSH,
            (false, true) => FlushArg::TCIFLUSH,
            (false, false) => return Ok(()),
        };
        if output {
            // There is room: the next write is tried at once.
            self.full = None;
        }
        Ok(termios::tcflush(&self.data, queue)?)
    }

    /// Takes DTR down until the returned value raises it or is dropped.
    pub(super) fn lower_dtr(&mut self) -> io::Result<Low<'_>> {
        set_dtr(self, false)?;
        Ok(Low { device: self })
    }

    pub(super) fn poll_read(&mut self, cx: &mut Context<'_>, input: &mut [u8]) -> Poll<io::Result<usize>> {
        let mut buffer = ReadBuf::new(input);
        let read = Pin::new(&mut self.data).poll_read(cx, &mut buffer);
        read.map_ok(|()| buffer.filled().len())
    }

    pub(super) fn poll_write(&mut self, cx: &mut Context<'_>, output: &[u8]) -> Poll<io::Result<usize>> {
        loop {
            if let Some(full) = &mut self.full {
                let written = Pin::new(full).poll_write(cx, output);
                if written.is_ready() {
                    self.full = None;
                }
                return written;
            }
            match rustix::io::write(&self.data, output) {
                // Some drivers say 0 where others say EAGAIN.
                Ok(0) | Err(rustix::io::Errno::AGAIN) => {
                    let fd = self.data.as_fd().try_clone_to_owned()?;
                    self.full = Some(pipe::Sender::from_owned_fd_unchecked(fd)?);
                }
                Err(rustix::io::Errno::INTR) => {}
                written => return Poll::Ready(Ok(written?)),
            }
        }
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        if self.full.is_some() {
            // The system would wait up to 30 s at closing for a printer that takes nothing.
            let _ = self.flush(true, false);
        }
    }
}

/// A device whose DTR is down.
pub(super) struct Low<'a> {
    device: &'a mut Device,
}

impl Low<'_> {
    pub(super) fn device(&mut self) -> &mut Device {
        self.device
    }

    pub(super) fn raise(self) -> io::Result<()> {
        // Dropping raises it once more, which changes nothing.
        set_dtr(self.device, true)
    }
}

impl Drop for Low<'_> {
    fn drop(&mut self) {
        let _ = set_dtr(self.device, true);
    }
}

fn set_dtr(device: &mut Device, up: bool) -> io::Result<()> {
    let lines = device.lines.as_mut().ok_or(io::ErrorKind::Unsupported)?;
    Ok(lines.write_data_terminal_ready(up)?)
}

/// Why a device is not opened: the words, and the system's class.
#[derive(Debug)]
pub(super) struct Refused(String, io::ErrorKind);

impl From<io::Error> for Refused {
    fn from(e: io::Error) -> Self {
        match e.kind() {
            // What a lock says.
            io::ErrorKind::WouldBlock => Self("it is locked".to_owned(), io::ErrorKind::ResourceBusy),
            kind => Self(e.to_string(), kind),
        }
    }
}

impl From<rustix::io::Errno> for Refused {
    fn from(e: rustix::io::Errno) -> Self {
        io::Error::from(e).into()
    }
}

impl From<nix::Error> for Refused {
    fn from(e: nix::Error) -> Self {
        io::Error::from(e).into()
    }
}

impl From<serialport::Error> for Refused {
    fn from(e: serialport::Error) -> Self {
        let kind = match e.kind {
            // The path could be opened a moment ago: a lock is what is left.
            serialport::ErrorKind::NoDevice => io::ErrorKind::ResourceBusy,
            serialport::ErrorKind::Io(kind) => kind,
            _ => io::ErrorKind::Other,
        };
        Self(e.description, kind)
    }
}

/// The device at `path`, if it is a terminal. Never waits.
fn opened(path: &str) -> Result<OwnedFd, Refused> {
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC | OFlags::NONBLOCK;
    let fd = rustix::fs::open(path, flags, Mode::empty())?;
    match rustix::termios::isatty(&fd) {
        true => Ok(fd),
        false => Err(Refused("this is no serial port".to_owned(), io::ErrorKind::InvalidInput)),
    }
}

/// Whether the path, links followed, is a pseudo-terminal.
pub(super) fn is_pseudo_terminal(path: &str) -> bool {
    std::fs::canonicalize(path).is_ok_and(|device| device.starts_with("/dev/pts"))
}
