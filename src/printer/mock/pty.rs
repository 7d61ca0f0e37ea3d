//! The mock printer on a pseudo-terminal: the only place here that does I/O.
//!
//! One thread moves bytes between the terminal and the [`Firmware`] and tells
//! it the time. It sleeps until bytes come, the port is opened, or the board
//! has something due; it never spins. The thread keeps the slave side open
//! itself, so that its raw mode outlives the host's closing it, and learns
//! from inotify when a host opens it: that is the rising DTR of a real port.
use super::faults::Faults;
use super::firmware::{Config, Firmware};
use super::stats::Stats;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags, inotify};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{self, OptionalActions, QueueSelector};
use std::fs;
use std::io::{self, Write};
use std::mem::MaybeUninit;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Between two writes of the statistics file.
const STATS_EVERY: Duration = Duration::from_secs(1);

/// Bytes read from the terminal at a time: its own buffer's size.
const READ_BYTES: usize = 4096;

/// Reply bytes kept while the terminal is full because the host does not read.
const UNWRITTEN_BYTES_MAX: usize = 64 * 1024;

/// How a mock is started.
#[derive(Debug, Default)]
pub struct Options {
    /// A symbolic link to the terminal, made now and removed at the end.
    pub link: Option<PathBuf>,
    /// Where the statistics go, as JSON, every second and at the end.
    pub stats: Option<PathBuf>,
    /// What goes wrong.
    pub faults: Faults,
    /// The board.
    pub config: Config,
}

/// Why there is no mock, or no longer.
#[derive(Debug, thiserror::Error)]
pub enum MockError {
    /// The system gives no pseudo-terminal, or it failed later.
    #[error("pseudo-terminal: {step}: {source}")]
    Terminal {
        /// What was being done.
        step: &'static str,
        /// The system's word.
        source: io::Error,
    },
    /// The link cannot be made.
    #[error("link {}: {source}", path.display())]
    Link {
        /// The link.
        path: PathBuf,
        /// The system's word.
        source: io::Error,
    },
    /// Something else has the link's name.
    #[error("link {}: is there already and is no link to a terminal; choose another name", path.display())]
    LinkTaken {
        /// The link.
        path: PathBuf,
    },
    /// The statistics cannot be written.
    #[error("statistics {}: {source}", path.display())]
    Stats {
        /// The file.
        path: PathBuf,
        /// The system's word.
        source: io::Error,
    },
    /// The thread could not be started, or broke down.
    #[error("the mock printer's thread broke down")]
    Thread,
}

/// A running mock; dropping it stops it.
#[derive(Debug)]
pub struct Handle {
    path: PathBuf,
    board: Arc<Mutex<Firmware>>,
    started: Instant,
    wake: UnixStream,
    thread: Option<JoinHandle<Result<(), MockError>>>,
}

impl Handle {
    /// What a host opens. It stays the same over hang-ups.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The counts as of now.
    pub fn stats(&self) -> Stats {
        let mut board = lock(&self.board);
        board.advance(elapsed_ns(self.started));
        board.stats()
    }

    /// False once the mock has ended by an error; [`Self::stop`] says which.
    pub fn is_running(&self) -> bool {
        self.thread.as_ref().is_some_and(|t| !t.is_finished())
    }

    /// Stops it: writes the statistics, removes the link.
    ///
    /// # Errors
    /// What had ended it before, or the last write of the statistics.
    pub fn stop(mut self) -> Result<Stats, MockError> {
        self.end()?;
        Ok(lock(&self.board).stats())
    }

    fn end(&mut self) -> Result<(), MockError> {
        let Some(thread) = self.thread.take() else {
            return Ok(());
        };
        // A thread that has ended already does not read it; that is fine.
        let _ = self.wake.write_all(b"x");
        thread.join().map_err(|_| MockError::Thread)?
    }
}

impl Drop for Handle {
    fn drop(&mut self) {
        // Whoever wants to know of an error calls `stop`.
        let _ = self.end();
    }
}

/// Starts a mock printer in a thread of its own.
///
/// # Errors
/// [`MockError`]: no terminal, no link, no statistics file.
pub fn spawn(options: Options) -> Result<Handle, MockError> {
    let device = Device::open()?;
    let link = Link::new(options.link, &device.path)?;
    let (wake, woken) = UnixStream::pair().map_err(|e| terminal("wake", e))?;
    let board = Arc::new(Mutex::new(Firmware::new(options.config, options.faults)));
    let started = Instant::now();
    let mut server = Server {
        board: Arc::clone(&board),
        started,
        device: Some(device),
        gone_until_ns: 0,
        stats: options.stats,
        stats_next: started,
        unwritten: Vec::new(),
        woken,
        link,
    };
    // A file that cannot be written is told at once, not at the end.
    server.write_stats()?;
    let path = server.link.path.clone();
    let thread = std::thread::Builder::new()
        .name("mock-printer".to_owned())
        .spawn(move || server.run())
        .map_err(|_| MockError::Thread)?;
    Ok(Handle { path, board, started, wake, thread: Some(thread) })
}

/// Both sides of the terminal, and the watch on its being opened.
#[derive(Debug)]
struct Device {
    master: OwnedFd,
    slave: OwnedFd,
    watch: OwnedFd,
    path: PathBuf,
    opens: u32,
}

impl Device {
    fn open() -> Result<Self, MockError> {
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
        let device = Self { master, slave, watch, path, opens: 0 };
        device.make_raw()?;
        Ok(device)
    }

    fn make_raw(&self) -> Result<(), MockError> {
        let mut modes = termios::tcgetattr(&self.slave).map_err(|e| terminal("modes", e))?;
        modes.make_raw();
        termios::tcsetattr(&self.slave, OptionalActions::Now, &modes).map_err(|e| terminal("raw mode", e))
    }

    /// Reads who opened and closed the port since the last call; true when a
    /// host opened it that was not open before.
    fn connected(&mut self) -> Result<bool, MockError> {
        let mut buffer = [MaybeUninit::uninit(); 512];
        let mut new = false;
        let mut reader = inotify::Reader::new(self.watch.as_fd(), &mut buffer);
        let mut closed = false;
        loop {
            match reader.next() {
                Ok(event) if event.events().contains(inotify::ReadFlags::OPEN) => {
                    self.opens += 1;
                    new |= self.opens == 1;
                }
                Ok(_) => {
                    self.opens = self.opens.saturating_sub(1);
                    closed |= self.opens == 0;
                }
                Err(rustix::io::Errno::AGAIN) => break,
                Err(rustix::io::Errno::INTR) => {}
                Err(e) => return Err(terminal("watch", e)),
            }
        }
        if closed || new {
            // What the last host did not read is not for the next one. A lock
            // that a host left (TIOCEXCL) goes with the host, as on a port
            // that is closed for good; so do the modes it set.
            let _ = termios::tcflush(&self.slave, QueueSelector::IFlush);
        }
        if closed {
            let _ = termios::ioctl_tiocnxcl(&self.slave);
            self.make_raw()?;
        }
        Ok(new)
    }

    fn read(&self, buffer: &mut [u8]) -> Result<usize, MockError> {
        match rustix::io::read(&self.master, buffer) {
            Ok(bytes) => Ok(bytes),
            Err(rustix::io::Errno::AGAIN | rustix::io::Errno::INTR) => Ok(0),
            Err(e) => Err(terminal("read", e)),
        }
    }

    /// Writes what the terminal takes now and removes it from `bytes`.
    fn write(&self, bytes: &mut Vec<u8>) -> Result<(), MockError> {
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

/// The name under which hosts find the terminal.
#[derive(Debug)]
struct Link {
    path: PathBuf,
    target: Option<PathBuf>,
    /// Where a link without a name of its own lives.
    _folder: Option<tempfile::TempDir>,
}

impl Link {
    fn new(path: Option<PathBuf>, target: &Path) -> Result<Self, MockError> {
        let (path, folder) = match path {
            Some(path) => (path, None),
            None => {
                let folder = tempfile::Builder::new()
                    .prefix("outrigger-mock-")
                    .tempdir()
                    .map_err(|e| terminal("temporary folder", e))?;
                (folder.path().join("tty"), Some(folder))
            }
        };
        let mut link = Self { path, target: None, _folder: folder };
        link.point_to(target)?;
        Ok(link)
    }

    /// Makes the link or turns it, in one step.
    fn point_to(&mut self, target: &Path) -> Result<(), MockError> {
        let failed = |source| MockError::Link { path: self.path.clone(), source };
        if let Ok(there) = fs::symlink_metadata(&self.path) {
            // A mock that was killed leaves its link; anything else is not ours.
            let stale =
                there.is_symlink() && fs::read_link(&self.path).is_ok_and(|to| to.starts_with("/dev/pts"));
            if !stale {
                return Err(MockError::LinkTaken { path: self.path.clone() });
            }
        }
        let mut name = self.path.file_name().unwrap_or_default().to_owned();
        name.push(format!(".{}.new", std::process::id()));
        let new = self.path.with_file_name(name);
        std::os::unix::fs::symlink(target, &new).map_err(failed)?;
        if let Err(e) = fs::rename(&new, &self.path) {
            let _ = fs::remove_file(&new);
            return Err(failed(e));
        }
        self.target = Some(target.to_owned());
        Ok(())
    }

    /// Removes the link if it is still ours.
    fn remove(&mut self) {
        if let Some(target) = self.target.take()
            && fs::read_link(&self.path).is_ok_and(|to| to == target)
        {
            let _ = fs::remove_file(&self.path);
        }
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        self.remove();
    }
}

/// What the thread owns.
struct Server {
    board: Arc<Mutex<Firmware>>,
    started: Instant,
    /// `None` while a fault has the port gone.
    device: Option<Device>,
    gone_until_ns: u64,
    stats: Option<PathBuf>,
    stats_next: Instant,
    unwritten: Vec<u8>,
    woken: UnixStream,
    link: Link,
}

impl Server {
    fn run(mut self) -> Result<(), MockError> {
        let done = self.serve();
        self.link.remove();
        lock(&self.board).advance(elapsed_ns(self.started));
        let written = self.write_stats();
        done.and(written)
    }

    fn serve(&mut self) -> Result<(), MockError> {
        let mut buffer = vec![0; READ_BYTES];
        loop {
            let now_ns = elapsed_ns(self.started);
            self.come_back(now_ns)?;
            let (deadline_ns, room, hang_up_ns) = self.exchange(now_ns, &mut buffer)?;
            if let Some(for_ns) = hang_up_ns {
                self.device = None;
                self.link.remove();
                self.unwritten.clear();
                self.gone_until_ns = now_ns + for_ns;
                continue;
            }
            if self.stats.is_some() && Instant::now() >= self.stats_next {
                self.write_stats()?;
            }
            if self.sleep(deadline_ns, room)? {
                return Ok(());
            }
        }
    }

    /// After a hang-up: a new terminal under the old link.
    fn come_back(&mut self, now_ns: u64) -> Result<(), MockError> {
        if self.device.is_none() && now_ns >= self.gone_until_ns {
            let device = Device::open()?;
            self.link.point_to(&device.path)?;
            self.device = Some(device);
        }
        Ok(())
    }

    /// Bytes in, time, bytes out. Gives the board's next deadline, whether it
    /// takes more bytes, and a hang-up if one is due.
    fn exchange(
        &mut self,
        now_ns: u64,
        buffer: &mut [u8],
    ) -> Result<(Option<u64>, bool, Option<u64>), MockError> {
        let mut board = lock(&self.board);
        if let Some(device) = &mut self.device {
            if device.connected()? {
                self.unwritten.clear();
                board.connect(now_ns);
            }
            let room = board.room().min(buffer.len());
            if room > 0 {
                let bytes = device.read(&mut buffer[..room])?;
                board.receive(now_ns, &buffer[..bytes]);
            }
        }
        board.advance(now_ns);
        board.take_output(&mut self.unwritten);
        let next = (board.deadline_ns(), board.room() > 0, board.take_hang_up());
        drop(board);
        match &self.device {
            Some(device) => device.write(&mut self.unwritten)?,
            None => self.unwritten.clear(),
        }
        self.unwritten.truncate(UNWRITTEN_BYTES_MAX);
        Ok(next)
    }

    /// Sleeps until something is to be done; true when the mock is to end.
    fn sleep(&mut self, deadline_ns: Option<u64>, room: bool) -> Result<bool, MockError> {
        let now_ns = elapsed_ns(self.started);
        let stats_ns = self.stats.as_ref().map(|_| {
            let left = self.stats_next.saturating_duration_since(self.started);
            u64::try_from(left.as_nanos()).unwrap_or(u64::MAX)
        });
        let back_ns = self.device.is_none().then_some(self.gone_until_ns);
        let timeout = [deadline_ns, stats_ns, back_ns].into_iter().flatten().min().map(|at_ns| {
            let left = Duration::from_nanos(at_ns.saturating_sub(now_ns));
            Timespec {
                tv_sec: i64::try_from(left.as_secs()).unwrap_or(i64::MAX),
                tv_nsec: left.subsec_nanos().into(),
            }
        });
        let mut fds = vec![PollFd::new(&self.woken, PollFlags::IN)];
        if let Some(device) = &self.device {
            let mut wanted = PollFlags::empty();
            wanted.set(PollFlags::IN, room);
            wanted.set(PollFlags::OUT, !self.unwritten.is_empty());
            fds.push(PollFd::new(&device.watch, PollFlags::IN));
            fds.push(PollFd::new(&device.master, wanted));
        }
        match poll(&mut fds, timeout.as_ref()) {
            Ok(_) | Err(rustix::io::Errno::INTR) => {}
            Err(e) => return Err(terminal("poll", e)),
        }
        // Any byte, or the other end gone: the handle wants the end.
        Ok(!fds[0].revents().is_empty())
    }

    fn write_stats(&mut self) -> Result<(), MockError> {
        self.stats_next = Instant::now() + STATS_EVERY;
        let Some(path) = &self.stats else {
            return Ok(());
        };
        let stats = lock(&self.board).stats();
        write_json(path, &stats).map_err(|source| MockError::Stats { path: path.clone(), source })
    }
}

/// Writes a file so that a reader sees the old content or the new, never half.
fn write_json(path: &Path, stats: &Stats) -> io::Result<()> {
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let mut file = tempfile::Builder::new()
        .permissions(fs::Permissions::from_mode(0o666)) // less the umask
        .tempfile_in(folder)?;
    serde_json::to_writer_pretty(&mut file, stats)?;
    file.write_all(b"\n")?;
    file.persist(path).map_err(|e| e.error)?;
    Ok(())
}

fn lock(board: &Mutex<Firmware>) -> MutexGuard<'_, Firmware> {
    // The board has no invariant that a panic elsewhere could break half-way.
    board.lock().unwrap_or_else(PoisonError::into_inner)
}

fn elapsed_ns(since: Instant) -> u64 {
    u64::try_from(since.elapsed().as_nanos()).unwrap_or(u64::MAX)
}

fn terminal(step: &'static str, source: impl Into<io::Error>) -> MockError {
    MockError::Terminal { step, source: source.into() }
}
