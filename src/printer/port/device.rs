//! One open device: the descriptor that bytes go through, and the handle that
//! holds it: lock, speed, DTR.
//!
//! Takes a path and a speed, gives polls that never block. Two descriptors on one
//! device: ours carries the bytes, `serialport`'s has the modem lines and any
//! speed without `unsafe`. Does not know what an error means to a user.
//!
//! Where the system lacks the calls that set any speed (`TCSETS2`: user-mode
//! emulators), a pseudo-terminal, which has no speed, is opened without them.
use super::PortError;
use nix::sys::termios::{self, ControlFlags, FlushArg, SetArg};
use rustix::fs::{FlockOperation, Mode, OFlags};
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
    /// `None` for a pseudo-terminal on a system without `TCSETS2`.
    lines: Option<TTYPort>,
    has_dtr: bool,
}

impl Device {
    /// Opens and locks `path`, raw and without hanging up at the end.
    pub(super) fn open(path: &str, baud: u32) -> Result<Self, PortError> {
        let failed = |kind, reason| PortError::Open { path: path.to_owned(), baud, reason, kind };
        let system = |e: io::Error| failed(e.kind(), e.to_string());
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC | OFlags::NONBLOCK;
        // Before the lock: it is for one descriptor only. Nothing is changed yet.
        let data = rustix::fs::open(path, flags, Mode::empty()).map_err(|e| system(e.into()))?;
        if !rustix::termios::isatty(&data) {
            return Err(failed(io::ErrorKind::InvalidInput, "this is no serial port".to_owned()));
        }
        let lines = match serialport::new(path, baud).open_native() {
            Ok(lines) => Some(lines),
            // The crate has no class for ENOSYS.
            Err(e) if e.kind == serialport::ErrorKind::Unknown && is_pseudo_terminal(path) => {
                hold(&data).map_err(|_| failed(io::ErrorKind::ResourceBusy, e.description))?;
                None
            }
            Err(e) => return Err(failed(class(&e), e.description)),
        };
        Self::new(data, lines).map_err(system)
    }

    /// Makes the descriptors ours: DTR stays up at the end.
    pub(super) fn new(data: OwnedFd, mut lines: Option<TTYPort>) -> io::Result<Self> {
        match &lines {
            // By the calls that keep speeds which have no name.
            Some(_) => {
                let mut modes = rustix::termios::tcgetattr(&data)?;
                modes.control_modes -= rustix::termios::ControlModes::HUPCL;
                rustix::termios::tcsetattr(&data, rustix::termios::OptionalActions::Now, &modes)?;
            }
            None => {
                let mut modes = termios::tcgetattr(&data)?;
                termios::cfmakeraw(&mut modes);
                modes.control_flags -= ControlFlags::HUPCL;
                termios::tcsetattr(&data, SetArg::TCSANOW, &modes)?;
            }
        }
        // Asking for a line that comes in tells whether there are lines at all.
        let has_dtr = lines.as_mut().is_some_and(|lines| lines.read_data_set_ready().is_ok());
        let data = pipe::Receiver::from_owned_fd_unchecked(data)?;
        Ok(Self { data, full: None, lines, has_dtr })
    }

    pub(super) fn has_dtr(&self) -> bool {
        self.has_dtr
    }

    pub(super) fn set_baud(&mut self, baud: u32) -> io::Result<()> {
        match &mut self.lines {
            Some(lines) => Ok(lines.set_baud_rate(baud)?),
            None => Ok(()),
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

/// What the crate's class means.
fn class(e: &serialport::Error) -> io::ErrorKind {
    match e.kind {
        // The path could be opened a moment ago: a lock is what is left.
        serialport::ErrorKind::NoDevice => io::ErrorKind::ResourceBusy,
        serialport::ErrorKind::Io(kind) => kind,
        _ => io::ErrorKind::Other,
    }
}

/// Takes the locks that `serialport` takes.
fn hold(data: &OwnedFd) -> io::Result<()> {
    rustix::fs::flock(data, FlockOperation::NonBlockingLockExclusive)?;
    Ok(rustix::termios::ioctl_tiocexcl(data)?)
}

/// Whether the path, links followed, is a pseudo-terminal.
pub(super) fn is_pseudo_terminal(path: &str) -> bool {
    std::fs::canonicalize(path).is_ok_and(|device| device.starts_with("/dev/pts"))
}
