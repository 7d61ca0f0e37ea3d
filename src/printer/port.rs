//! The serial port: with its folder, the only place that names `serialport`.
//!
//! Takes a device path, gives non-blocking reads and writes on a tokio runtime.
//! A port that is gone (unplugged, or a pseudo-terminal whose other side closed)
//! is one error, [`PortError::Gone`], however the system words it. Knows nothing
//! of what is sent.
//!
//! # Opening, closing and the board's reset
//! On most boards with a USB bridge the line DTR resets the processor when it
//! goes up. The kernel raises it whenever a port that nobody holds is opened, and
//! no program can prevent that: the first opening after the cable was plugged in
//! resets such a board. What follows is ours: HUPCL is cleared, so that DTR stays
//! up when we end, die, or are killed, and the next opening finds it up and resets
//! nothing. A reset that is wanted is made on purpose: [`OpenMode::Fresh`],
//! [`Port::reset_board`].
mod device;
#[cfg(test)]
mod tests;

use device::Device;
use std::future::poll_fn;
use std::io;
use std::os::fd::OwnedFd;
use std::task::{Context, Poll};
use std::time::Duration;
use thiserror::Error;

/// DTR stays down so long for a reset. Boards react to its edge; the capacitor
/// behind it needs some milliseconds, a slow opto-coupler some tens.
const DTR_LOW: Duration = Duration::from_millis(250);

/// Writes that may follow one another while there is something to read: whoever
/// has endless output shall still hear the printer. A job's window never comes
/// near it, so that it costs no system call there.
const WRITES_IN_A_ROW: u32 = 16;

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
        io::ErrorKind::ResourceBusy => "; another program holds it (a job that runs?)",
        _ => "",
    }
}

/// With what intent a port is opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OpenMode {
    /// A new start: nothing on the other side is to be kept.
    Fresh {
        /// Reset the board by DTR even if it was up already. Set it where the
        /// profile says that the board resets, so that each start finds the same
        /// board. A pseudo-terminal has no DTR; there opening is all.
        reset: bool,
    },
    /// The firmware may be in the middle of a job: nothing but what opening does
    /// by itself.
    TakeOver,
}

/// What [`Port::exchange`] did.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Moved {
    /// So many bytes of the output were written.
    Wrote(usize),
    /// So many bytes of the input are filled.
    Read(usize),
}

/// An open port, held exclusively.
#[derive(Debug)]
pub struct Port {
    /// `None` once it was closed, or could not be opened again for a reset.
    device: Option<Device>,
    path: String,
    baud: u32,
    writes: u32,
}

impl Port {
    /// Opens `path` raw, 8N1, without flow control, at any `baud` that the
    /// hardware takes, 250,000 included; no other program may open it meanwhile.
    /// Call within a tokio runtime that drives I/O.
    ///
    /// What opening does to the board stands in the module's text.
    ///
    /// # Errors
    /// [`PortError::Open`].
    pub fn open(path: &str, baud: u32) -> Result<Self, PortError> {
        let device = Device::open(path, baud)?;
        Ok(Self { device: Some(device), path: path.to_owned(), baud, writes: 0 })
    }

    /// [`Self::open`], and what `mode` asks for besides.
    ///
    /// # Errors
    /// As [`Self::open`] and [`Self::reset_board`].
    pub async fn open_as(path: &str, baud: u32, mode: OpenMode) -> Result<Self, PortError> {
        let mut port = Self::open(path, baud)?;
        // A pseudo-terminal's opening is its reset already.
        if mode == (OpenMode::Fresh { reset: true }) && port.has_dtr() {
            port.reset_board().await?;
        }
        Ok(port)
    }

    /// The device, as it was named.
    pub fn path(&self) -> &str {
        &self.path
    }

    /// Bits per second.
    pub fn baud(&self) -> u32 {
        self.baud
    }

    /// Another speed, without closing the port (which could reset the board).
    ///
    /// # Errors
    /// The hardware or the driver does not take it.
    pub fn set_baud(&mut self, baud: u32) -> Result<(), PortError> {
        let done = self.device_mut().and_then(|device| device.set_baud(baud));
        done.map_err(|e| self.error(e))?;
        self.baud = baud;
        Ok(())
    }

    /// Drops the bytes that were written and not yet sent, for an emergency stop
    /// that must not wait behind them; a write that was blocked can go on at once.
    ///
    /// What the device on the other side has taken stays with it. The drivers of
    /// UARTs, CDC-ACM and pseudo-terminals drop what they hold; those of most USB
    /// bridges (`ttyUSB`) hold to it, but send it on at the line's speed. So the
    /// bytes in flight must be few anyway, and a command after this one begins with
    /// a line feed: the last line may be cut anywhere.
    ///
    /// # Errors
    /// The port is gone, or the system refuses.
    pub fn flush_output(&mut self) -> Result<(), PortError> {
        let done = self.device_mut().and_then(|device| device.flush(true, false));
        done.map_err(|e| self.error(e))
    }

    /// Drops the bytes that came and were not read: after another speed they are noise.
    ///
    /// # Errors
    /// The port is gone, or the system refuses.
    pub fn flush_input(&mut self) -> Result<(), PortError> {
        let done = self.device_mut().and_then(|device| device.flush(false, true));
        done.map_err(|e| self.error(e))
    }

    /// Resets the board: DTR goes down for 250 ms and up again; what was not sent
    /// and not read is dropped. A pseudo-terminal, which has no DTR, is closed and
    /// opened again.
    ///
    /// Whether DTR is wired to the reset nobody can ask; a board that was reset
    /// says `start`. When the future is dropped midway, DTR goes up nevertheless.
    ///
    /// # Errors
    /// The port is gone, its driver has no DTR, or it cannot be opened again.
    pub async fn reset_board(&mut self) -> Result<(), PortError> {
        if !self.has_dtr() {
            // Closed first: it is held exclusively.
            self.device = None;
            self.device = Some(Device::open(&self.path, self.baud)?);
            return Ok(());
        }
        let done = async {
            let device = self.device_mut()?;
            let mut low = device.lower_dtr()?;
            tokio::time::sleep(DTR_LOW).await;
            // The board runs until the line goes up: its last words are no answer.
            low.device().flush(true, true)?;
            low.raise()
        };
        done.await.map_err(|e| self.error(e))
    }

    /// Whether there is a line that could reset the board: not on a pseudo-terminal.
    pub fn has_dtr(&self) -> bool {
        self.device.as_ref().is_some_and(Device::has_dtr)
    }

    /// Another descriptor of the open device, for a process that must be able to write to it when we are
    /// dead. It keeps the device open; what it writes comes between our own bytes.
    ///
    /// # Errors
    /// The port is gone, or the system has no descriptor left.
    pub fn another(&self) -> io::Result<OwnedFd> {
        match &self.device {
            Some(device) => device.another(),
            None => Err(io::ErrorKind::NotConnected.into()),
        }
    }

    /// Lets go of the device, which is gone from then on. A device that vanished and
    /// comes back gets its old name only if nobody holds that any more.
    pub fn close(&mut self) {
        self.device = None;
    }

    /// Waits until some of `output` can be written or something can be read into
    /// `input`, and does it. Neither waits for the other: a printer that takes no
    /// more bytes may still have much to say, and is heard even if there is always
    /// more to write.
    ///
    /// Nothing is lost when the returned future is dropped.
    ///
    /// # Errors
    /// The port is gone, or the system refuses.
    pub async fn exchange(&mut self, input: &mut [u8], output: &[u8]) -> Result<Moved, PortError> {
        let reads_first = self.writes >= WRITES_IN_A_ROW;
        if reads_first {
            // The runtime looks for input only when nothing else can go on.
            tokio::task::yield_now().await;
        }
        let moved = poll_fn(|cx| self.poll_exchange(cx, input, output, reads_first)).await;
        match moved {
            Ok(Moved::Read(0)) => Err(self.gone()),
            other => other.map_err(|e| self.error(e)),
        }
    }

    fn poll_exchange(
        &mut self,
        cx: &mut Context<'_>,
        input: &mut [u8],
        output: &[u8],
        reads_first: bool,
    ) -> Poll<io::Result<Moved>> {
        let Some(device) = &mut self.device else {
            return Poll::Ready(Err(io::ErrorKind::NotConnected.into()));
        };
        let write = |device: &mut Device, cx: &mut Context<'_>| match output.is_empty() {
            true => Poll::Pending,
            false => device.poll_write(cx, output),
        };
        if !reads_first && let Poll::Ready(done) = write(device, cx) {
            self.writes += 1;
            return Poll::Ready(done.map(Moved::Wrote));
        }
        self.writes = 0;
        if let Poll::Ready(done) = device.poll_read(cx, input) {
            return Poll::Ready(done.map(Moved::Read));
        }
        match reads_first {
            true => write(device, cx).map_ok(Moved::Wrote),
            false => Poll::Pending,
        }
    }

    fn device_mut(&mut self) -> io::Result<&mut Device> {
        self.device.as_mut().ok_or_else(|| io::ErrorKind::NotConnected.into())
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
