//! Terminals: the pseudo-terminal that the program opens, and the device behind the proxy.
//!
//! Takes paths, gives descriptors that never block.
use rustix::fs::{FlockOperation, Mode, OFlags, flock, inotify};
use rustix::io::Errno;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{ControlModes, OptionalActions, QueueSelector, tcflush, tcgetattr, tcsetattr};
use std::io;
use std::mem::MaybeUninit;
use std::os::fd::{AsFd, OwnedFd};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// How long DTR is low for a reset: boards have a capacitor of 100 nF in the way.
const DTR_LOW: Duration = Duration::from_millis(100);

/// Opens a device raw at so many bits per second; closing it later does not lower DTR, so
/// the printer does not notice.
///
/// # Errors
/// The system's.
pub fn open_device(path: &Path, baud: u32) -> io::Result<OwnedFd> {
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC | OFlags::NONBLOCK;
    let fd = rustix::fs::open(path, flags, Mode::empty())?;
    let mut modes = tcgetattr(&fd)?;
    modes.make_raw();
    modes.control_modes.remove(ControlModes::HUPCL);
    modes.control_modes |= ControlModes::CLOCAL | ControlModes::CREAD;
    // A pseudo-terminal has no speed and takes any.
    modes.set_speed(baud)?;
    tcsetattr(&fd, OptionalActions::Now, &modes)?;
    Ok(fd)
}

/// Takes a device for ourselves: no other host may talk to the printer meanwhile. The lock
/// goes with the process that has it, however it ends.
///
/// # Errors
/// Another process has it.
pub fn lock(fd: &OwnedFd) -> io::Result<()> {
    Ok(flock(fd, FlockOperation::NonBlockingLockExclusive)?)
}

/// Toggles DTR: a speed of 0 is a hang-up of the line, which lowers it.
///
/// # Errors
/// The system's; a pseudo-terminal has no DTR, and nothing happens.
pub fn reset_board(fd: &OwnedFd, baud: u32) -> io::Result<()> {
    let mut modes = tcgetattr(fd)?;
    modes.set_speed(0)?;
    tcsetattr(fd, OptionalActions::Now, &modes)?;
    std::thread::sleep(DTR_LOW);
    modes.set_speed(baud)?;
    tcsetattr(fd, OptionalActions::Now, &modes)?;
    Ok(())
}

/// A pseudo-terminal under a link that outlives it.
#[derive(Debug)]
pub struct Pty {
    /// Our end.
    pub master: OwnedFd,
    /// Kept open, so that the program's closing it does not hang it up.
    slave: OwnedFd,
    /// Tells who opens and closes it.
    pub watch: OwnedFd,
    opens: u32,
    link: PathBuf,
}

impl Pty {
    /// A new one; `link` points to it from now on.
    ///
    /// # Errors
    /// The system's.
    pub fn under(link: &Path) -> io::Result<Self> {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
        grantpt(&master)?;
        unlockpt(&master)?;
        rustix::io::ioctl_fionbio(&master, true)?;
        let name = ptsname(&master, Vec::new())?;
        let path = PathBuf::from(name.to_string_lossy().into_owned());
        let slave = open_device(&path, 115_200)?;
        let watch = inotify::init(inotify::CreateFlags::CLOEXEC | inotify::CreateFlags::NONBLOCK)?;
        let events =
            inotify::WatchFlags::OPEN | inotify::WatchFlags::CLOSE_WRITE | inotify::WatchFlags::CLOSE_NOWRITE;
        inotify::add_watch(&watch, &path, events)?;
        let beside = link.with_extension("new");
        let _ = std::fs::remove_file(&beside);
        std::os::unix::fs::symlink(&path, &beside)?;
        std::fs::rename(&beside, link)?;
        Ok(Self { master, slave, watch, opens: 0, link: link.to_owned() })
    }

    /// Whether a program has it open.
    ///
    /// # Errors
    /// The system's.
    pub fn is_open(&mut self) -> io::Result<bool> {
        let was = self.opens;
        let mut buffer = [MaybeUninit::uninit(); 512];
        let mut reader = inotify::Reader::new(self.watch.as_fd(), &mut buffer);
        loop {
            match reader.next() {
                Ok(event) if event.events().contains(inotify::ReadFlags::OPEN) => self.opens += 1,
                Ok(_) => self.opens = self.opens.saturating_sub(1),
                Err(Errno::AGAIN) => break,
                Err(Errno::INTR) => {}
                Err(e) => return Err(e.into()),
            }
        }
        if was > 0 && self.opens == 0 {
            // What one program did not read is not for the next.
            drop_unread(&self.slave);
        }
        Ok(self.opens > 0)
    }
}

impl Drop for Pty {
    /// The link goes first: the next terminal of anybody has this one's name, and a program that
    /// waits for its port would find that one.
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.link);
    }
}

/// Forgets what came and was not read.
pub fn drop_unread(fd: &OwnedFd) {
    let _ = tcflush(fd, QueueSelector::IFlush);
}

/// Reads what is there; `Ok(0)`: nothing now.
///
/// # Errors
/// The other end is gone.
pub fn read(fd: &OwnedFd, buffer: &mut [u8]) -> io::Result<usize> {
    match rustix::io::read(fd, buffer) {
        Ok(0) => Err(io::ErrorKind::UnexpectedEof.into()),
        Ok(n) => Ok(n),
        Err(Errno::AGAIN | Errno::INTR) => Ok(0),
        Err(e) => Err(e.into()),
    }
}

/// Writes what can be written now; how much that was.
///
/// # Errors
/// The other end is gone.
pub fn write(fd: &OwnedFd, bytes: &[u8]) -> io::Result<usize> {
    match rustix::io::write(fd, bytes) {
        Ok(n) => Ok(n),
        Err(Errno::AGAIN | Errno::INTR) => Ok(0),
        Err(e) => Err(e.into()),
    }
}
