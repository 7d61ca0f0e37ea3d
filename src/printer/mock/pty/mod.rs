//! The mock printer on a pseudo-terminal: the only place here that does I/O.
//!
//! One thread moves bytes between the terminal and the [`Firmware`] and tells
//! it the time. It sleeps until bytes come, the port is opened, or the board
//! has something due; it never spins. The thread keeps the slave side open
//! itself, so that its raw mode outlives the host's closing it, and learns
//! from inotify when a host opens it: that is the rising DTR of a real port.
use super::config::Config;
use super::faults::{Fault, Faults};
use super::firmware::{Executed, Firmware};
use super::light::Pulse;
use super::stats::Stats;
use device::Device;
use link::Link;
use log::Log;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::fs;
use std::io::{self, Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

mod device;
mod link;
mod log;

/// Between two writes of the statistics file.
const STATS_EVERY: Duration = Duration::from_secs(1);

/// Bytes read from the terminal at a time: its own buffer's size.
const READ_BYTES: usize = 4096;

/// Reply bytes kept while the terminal is full because the host does not read.
const UNWRITTEN_BYTES_MAX: usize = 64 * 1024;

/// Wakes the thread to look at the board; any other byte ends it.
const LOOK: u8 = b'?';

/// How a mock is started.
#[derive(Debug, Default)]
pub struct Options {
    /// A symbolic link to the terminal, made now and removed at the end.
    pub link: Option<PathBuf>,
    /// Where the statistics go, as JSON, every second and at the end.
    pub stats: Option<PathBuf>,
    /// Where every command that was executed goes, a line each.
    pub log: Option<PathBuf>,
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
    /// The record of commands cannot be written.
    #[error("log {}: {source}", path.display())]
    Log {
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

    /// Somebody took the part off the bed.
    pub fn remove_part(&self) {
        lock(&self.board).remove_part();
    }

    /// A fault that nobody knew of beforehand happens now, or to the line that it names.
    pub fn inject(&self, fault: Fault) {
        lock(&self.board).inject(elapsed_ns(self.started), fault);
        // What it leads to may be due before anything else is. A thread that has ended
        // does not read it; that is fine.
        let _ = (&self.wake).write_all(&[LOOK]);
    }

    /// What was executed since the last call: with [`Config::record`] and without a log only.
    pub fn take_executed(&self) -> Vec<Executed> {
        let mut board = lock(&self.board);
        board.advance(elapsed_ns(self.started));
        board.take_executed()
    }

    /// When the board began to start, each time, ns since the mock was started.
    pub fn starts_ns(&self) -> Vec<u64> {
        lock(&self.board).starts_ns().to_vec()
    }

    /// Every interval in which the light of a resin printer was on, as of now: see
    /// [`Firmware::light`].
    pub fn light(&self) -> Vec<Pulse> {
        let mut board = lock(&self.board);
        board.advance(elapsed_ns(self.started));
        board.light().to_vec()
    }

    /// When the board's clock was 0: the times of [`Self::light`] and [`Self::starts_ns`] and
    /// of what was executed are counted from here.
    pub fn started(&self) -> Instant {
        self.started
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
    let log = options.log.map(Log::create).transpose()?;
    let record = options.config.record || log.is_some();
    let config = Config { record, ..options.config };
    let board = Arc::new(Mutex::new(Firmware::new(config, options.faults)));
    let started = Instant::now();
    let mut server = Server {
        board: Arc::clone(&board),
        started,
        device: Some(device),
        gone_until_ns: 0,
        stats: options.stats,
        log,
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

/// What the thread owns.
struct Server {
    board: Arc<Mutex<Firmware>>,
    started: Instant,
    /// `None` while a fault has the port gone.
    device: Option<Device>,
    gone_until_ns: u64,
    stats: Option<PathBuf>,
    log: Option<Log>,
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
        let logged = match &mut self.log {
            Some(log) => log.write(&lock(&self.board).take_executed()),
            None => Ok(()),
        };
        let written = self.write_stats();
        done.and(logged).and(written)
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
            if let Some(rose) = device.connected()? {
                self.unwritten.clear();
                if rose || !board.keeps_dtr() {
                    board.connect(now_ns);
                } else {
                    board.reconnect(now_ns);
                }
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
        let executed = if self.log.is_some() { board.take_executed() } else { Vec::new() };
        drop(board);
        if let Some(log) = &mut self.log {
            log.write(&executed)?;
        }
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
        if fds[0].revents().is_empty() {
            return Ok(false);
        }
        // Any other byte, or the other end gone: the handle wants the end.
        let mut byte = [0];
        Ok((&self.woken).read(&mut byte).is_err() || byte != [LOOK])
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
