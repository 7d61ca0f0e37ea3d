//! The terminal's keys, handed on one byte at a time.
//!
//! `rustyline` reads what it can get and then sleeps until more comes: of a line
//! that arrives at once (a paste, a slow network) it sees the first letter only.
//! So it is given a pseudo-terminal for its standard input, and each byte after it
//! has taken the one before. Takes the terminal, gives it back as it was.
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, Termios, tcgetattr, tcsetattr};
use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::time::Duration;

/// Between two looks whether a byte was taken: nobody types faster.
const LOOK_EVERY: Duration = Duration::from_micros(200);

/// Bytes read at once.
const READ_BYTES: usize = 256;

/// The terminal in raw mode, until this is dropped.
#[derive(Debug)]
pub(super) struct Keys {
    terminal: OwnedFd,
    before: Termios,
}

impl Keys {
    /// Puts itself between standard input and whoever reads it from now on.
    ///
    /// # Errors
    /// Standard input is no terminal, or the system has no other for us.
    pub(super) fn take() -> io::Result<Self> {
        let terminal = io::stdin().as_fd().try_clone_to_owned()?;
        let before = tcgetattr(&terminal)?;
        let far = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
        grantpt(&far)?;
        unlockpt(&far)?;
        let path = ptsname(&far, Vec::new())?;
        let near = rustix::fs::open(path, OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC, Mode::empty())?;
        // Nothing that is typed ahead is echoed, or waits for the line's end.
        let mut modes = tcgetattr(&near)?;
        modes.make_raw();
        tcsetattr(&near, OptionalActions::Now, &modes)?;
        rustix::stdio::dup2_stdin(&near)?;

        let keys = Self { terminal: terminal.try_clone()?, before: before.clone() };
        let mut modes = before;
        let output = modes.output_modes;
        modes.make_raw();
        // A line feed of ours still begins a new line.
        modes.output_modes = output;
        tcsetattr(&terminal, OptionalActions::Now, &modes)?;
        std::thread::Builder::new().name("keys".to_owned()).spawn(move || hand_on(&terminal, &far, &near))?;
        Ok(keys)
    }
}

impl Drop for Keys {
    fn drop(&mut self) {
        let _ = tcsetattr(&self.terminal, OptionalActions::Now, &self.before);
    }
}

/// Ends when the terminal does; closing the far side tells whoever reads.
fn hand_on(terminal: &OwnedFd, far: &OwnedFd, near: &OwnedFd) {
    let mut some = [0; READ_BYTES];
    loop {
        let read = match rustix::io::read(terminal, &mut some) {
            Ok(read @ 1..) => read,
            Err(rustix::io::Errno::INTR) => continue,
            _ => break,
        };
        for byte in &some[..read] {
            if rustix::io::write(far, &[*byte]).is_err() {
                return;
            }
            while waits(near) {
                std::thread::sleep(LOOK_EVERY);
            }
        }
    }
    // The end itself would not come through: we hold the near side, too.
    let _ = rustix::io::write(far, END);
}

/// What ends the prompt, whatever stands in it: to the line's end (Ctrl-E), away with
/// the line (Ctrl-U), the end (Ctrl-D).
const END: &[u8] = b"\x05\x15\x04";

/// Whether a byte is there that nobody has read.
fn waits(near: &OwnedFd) -> bool {
    let mut fds = [PollFd::new(near, PollFlags::IN)];
    poll(&mut fds, Some(&Timespec::default())).is_ok_and(|ready| ready > 0)
}
