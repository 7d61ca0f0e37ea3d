//! Both sides of a pseudo-terminal, and the watch on its being opened.
//!
//! Raw mode from the beginning and over every host that comes and goes; who
//! opens it is known from inotify. A pseudo-terminal has no DTR; its HUPCL, which
//! says what becomes of DTR at the close, it keeps like any other, and so one can
//! tell what a real port would have done. Knows neither the board nor the link.
use super::{MockError, terminal};
use nix::sys::termios::{self, ControlFlags, FlushArg, SetArg};
use rustix::fs::{Mode, OFlags, inotify};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use std::mem::MaybeUninit;
use std::os::fd::{AsFd, OwnedFd};
use std::path::PathBuf;

/// Both sides of the terminal, and the watch on its being opened.
#[derive(Debug)]
pub(super) struct Device {
    pub(super) master: OwnedFd,
    slave: OwnedFd,
    pub(super) watch: OwnedFd,
    pub(super) path: PathBuf,
    opens: u32,
    /// Whether a real port's DTR would be up although nobody has it open.
    dtr_stays_up: bool,
}

impl Device {
    pub(super) fn open() -> Result<Self, MockError> {
        let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
        let master = openpt(flags).map_err(|e| terminal("open", e))?;
        grantpt(&master).map_err(|e| terminal("grant", e))?;
        unlockpt(&master).map_err(|e| terminal("unlock", e))?;
        let name = ptsname(&master, Vec::new()).map_err(|e| terminal("name", e))?;
        let path = PathBuf::from(name.to_string_lossy().into_owned());
        let slave_flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
        let slave =
            rustix::fs::open(&path, slave_flags, Mode::empty()).map_err(|e| terminal("open the slave", e))?;
        rustix::io::ioctl_fionbio(&master, true).map_err(|e| terminal("non-blocking", e))?;
        let watch = inotify::init(inotify::CreateFlags::CLOEXEC | inotify::CreateFlags::NONBLOCK)
            .map_err(|e| terminal("inotify", e))?;
        let events =
            inotify::WatchFlags::OPEN | inotify::WatchFlags::CLOSE_WRITE | inotify::WatchFlags::CLOSE_NOWRITE;
        inotify::add_watch(&watch, &path, events).map_err(|e| terminal("watch", e))?;
        let device = Self { master, slave, watch, path, opens: 0, dtr_stays_up: false };
        device.make_raw()?;
        // As a real port has it from the start.
        device.set_hupcl()?;
        Ok(device)
    }

    pub(super) fn make_raw(&self) -> Result<(), MockError> {
        // By the C library's calls: emulators lack the kernel's newer ones.
        let mut modes = termios::tcgetattr(&self.slave).map_err(|e| terminal("modes", e))?;
        termios::cfmakeraw(&mut modes);
        termios::tcsetattr(&self.slave, SetArg::TCSANOW, &modes).map_err(|e| terminal("raw mode", e))
    }

    fn set_hupcl(&self) -> Result<(), MockError> {
        let mut modes = termios::tcgetattr(&self.slave).map_err(|e| terminal("modes", e))?;
        modes.control_flags.insert(ControlFlags::HUPCL);
        termios::tcsetattr(&self.slave, SetArg::TCSANOW, &modes).map_err(|e| terminal("HUPCL", e))
    }

    /// Reads who opened and closed the port since the last call; when a host opened
    /// it that was not open before, whether DTR rose with it. A host that clears HUPCL
    /// in the very moment after another has closed the port is taken for that one.
    pub(super) fn connected(&mut self) -> Result<Option<bool>, MockError> {
        let mut buffer = [MaybeUninit::uninit(); 512];
        let mut new = None;
        let mut reader = inotify::Reader::new(self.watch.as_fd(), &mut buffer);
        let mut closed = false;
        loop {
            match reader.next() {
                Ok(event) if event.events().contains(inotify::ReadFlags::OPEN) => {
                    self.opens += 1;
                    if self.opens == 1 {
                        new = Some(!self.dtr_stays_up);
                    }
                }
                Ok(_) => {
                    self.opens = self.opens.saturating_sub(1);
                    if self.opens == 0 {
                        closed = true;
                        let modes = termios::tcgetattr(&self.slave).map_err(|e| terminal("modes", e))?;
                        self.dtr_stays_up = !modes.control_flags.contains(ControlFlags::HUPCL);
                    }
                }
                Err(rustix::io::Errno::AGAIN) => break,
                Err(rustix::io::Errno::INTR) => {}
                Err(e) => return Err(terminal("watch", e)),
            }
        }
        if closed || new.is_some() {
            // What the last host did not read is not for the next one. A lock
            // that a host left (TIOCEXCL) goes with the host, as on a port
            // that is closed for good; so do the modes it set.
            let _ = termios::tcflush(&self.slave, FlushArg::TCIFLUSH);
        }
        if closed {
            let _ = rustix::termios::ioctl_tiocnxcl(&self.slave);
            self.make_raw()?;
        }
        Ok(new)
    }

    pub(super) fn read(&self, buffer: &mut [u8]) -> Result<usize, MockError> {
        match rustix::io::read(&self.master, buffer) {
            Ok(bytes) => Ok(bytes),
            Err(rustix::io::Errno::AGAIN | rustix::io::Errno::INTR) => Ok(0),
            Err(e) => Err(terminal("read", e)),
        }
    }

    /// Writes what the terminal takes now and removes it from `bytes`.
    pub(super) fn write(&self, bytes: &mut Vec<u8>) -> Result<(), MockError> {
        while !bytes.is_empty() {
            match rustix::io::write(&self.master, bytes) {
                Ok(written) => drop(bytes.drain(..written)),
                Err(rustix::io::Errno::INTR) => {}
                Err(rustix::io::Errno::AGAIN) => break,
                Err(e) => return Err(terminal("write", e)),
            }
        }
        Ok(())
    }
}
