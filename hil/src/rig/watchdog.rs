//! A process of its own that makes the printer safe when the runner dies, hangs, or passes a limit.
//!
//! Takes the runner's beats on its standard input: `beat`, `heat NOZZLE BED` (measured, °C) and
//! `done`. Whatever else happens (the end of the input without `done`, silence, time, heat) is
//! a reason to act: the runner is killed, so that nobody else talks to the printer, M112 goes
//! out, a board that does not say that it halted is reset where the rig can, heaters are switched
//! off, and at last the power is cut where the rig can. Knows no scenario.
use super::tty;
use super::{Limits, Rig};
use std::io::{BufRead, Write};
use std::os::fd::OwnedFd;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// Between two beats of the runner.
pub const BEAT: Duration = Duration::from_millis(500);

/// Silence after which the runner is taken to hang: many beats.
const SILENCE: Duration = Duration::from_secs(5);

/// Time for a board to say that M112 halted it, or that it has started.
const ANSWER: Duration = Duration::from_secs(1);

/// Time for a boot loader after a reset.
const BOOT: Duration = Duration::from_secs(3);

/// How often heaters are switched off: bytes are lost while a board starts.
const OFF_TIMES: u32 = 5;

/// What switches heaters off, unnumbered, after whatever half a line stands in the board.
const OFF: &[u8] = b"\nM104 S0\nM140 S0\nM107\n";

/// The exit code of a watchdog that had to act.
pub const ACTED: u8 = 3;

/// Why the watchdog acts.
#[derive(Debug, Clone, PartialEq)]
pub enum Reason {
    /// The input ended without `done`.
    Died,
    /// No beat for [`SILENCE`].
    Hangs,
    /// The time is over.
    Late,
    /// So hot, and at most so hot, °C.
    Hot(f64, f64),
}

impl std::fmt::Display for Reason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Reason::Died => write!(f, "the runner died"),
            Reason::Hangs => write!(f, "the runner hangs"),
            Reason::Late => write!(f, "the scenario's time is over"),
            Reason::Hot(is, most) => write!(f, "{is} °C measured, {most} °C at most are allowed"),
        }
    }
}

/// What a runner keeps of its watchdog.
#[derive(Debug)]
pub struct Leash {
    child: Child,
    input: ChildStdin,
    beaten: Instant,
}

impl Leash {
    /// Starts a watchdog for one scenario: `program` is outrigger-hil, `rig` a file, none for the mock's.
    ///
    /// # Errors
    /// The system starts no process.
    pub fn start(program: &Path, device: &Path, baud: u32, rig: Option<&Path>) -> std::io::Result<Self> {
        let mut command = Command::new(program);
        command.arg("watchdog").arg("--port").arg(device).arg("--baud").arg(baud.to_string());
        command.arg("--runner").arg(std::process::id().to_string());
        if let Some(rig) = rig {
            command.arg("--rig").arg(rig);
        }
        // Its own group: what ends the runner's must not end it.
        let mut child = command.stdin(Stdio::piped()).process_group(0).spawn()?;
        let input = child.stdin.take().ok_or(std::io::ErrorKind::BrokenPipe)?;
        Ok(Self { child, input, beaten: Instant::now() })
    }

    /// Call often; sends a beat when it is time for one.
    ///
    /// # Errors
    /// The watchdog is gone: without it nothing may go on.
    pub fn beat(&mut self, heat: Option<(f64, f64)>) -> std::io::Result<()> {
        if let Some((nozzle_c, bed_c)) = heat {
            writeln!(self.input, "heat {nozzle_c:.1} {bed_c:.1}")?;
        }
        if self.beaten.elapsed() >= BEAT {
            self.beaten = Instant::now();
            writeln!(self.input, "beat")?;
        }
        Ok(())
    }

    /// Nobody knows what the printer does: the watchdog makes it safe now, and is waited for.
    ///
    /// # Errors
    /// It could not: HEATERS MAY BE ON.
    pub fn act(mut self) -> std::io::Result<()> {
        drop(self.input);
        let status = self.child.wait()?;
        match status.code() == Some(i32::from(ACTED)) {
            true => Ok(()),
            false => Err(std::io::Error::other(format!(
                "the watchdog could not make the printer safe ({status}): HEATERS MAY BE ON"
            ))),
        }
    }

    /// All is well: it ends.
    ///
    /// # Errors
    /// It had gone or acted before.
    pub fn done(mut self) -> std::io::Result<()> {
        writeln!(self.input, "done")?;
        drop(self.input);
        let status = self.child.wait()?;
        if status.success() {
            return Ok(());
        }
        Err(std::io::Error::other(format!("the watchdog had to act ({status})")))
    }
}

/// The watchdog's own process: waits, and acts if it must. Whether it did.
///
/// # Errors
/// It could not reach the printer: said as loudly as can be.
pub fn watch(device: &Path, baud: u32, rig: &Rig, runner: u32) -> anyhow::Result<bool> {
    let (tell, told) = channel();
    std::thread::spawn(move || {
        for line in std::io::stdin().lock().lines() {
            if line.is_err() || tell.send(line.unwrap_or_default()).is_err() {
                return;
            }
        }
    });
    let Some(reason) = wait(&told, rig.limits) else {
        return Ok(false);
    };
    eprintln!("watchdog: {reason}: making the printer on {} safe", device.display());
    if reason != Reason::Died
        && let Some(pid) = i32::try_from(runner).ok().and_then(rustix::process::Pid::from_raw)
    {
        // It hangs or is late: nobody else may talk to the printer now.
        let _ = rustix::process::kill_process(pid, rustix::process::Signal::KILL);
    }
    let done = make_safe(device, baud, rig);
    if let Some(command) = &rig.power_off {
        eprintln!("watchdog: cutting the power: {command}");
        Command::new("sh").arg("-c").arg(command).status()?;
    }
    match done {
        Ok(how) => eprintln!("watchdog: {how}"),
        Err(e) if rig.power_off.is_some() => eprintln!("watchdog: {}: {e}", device.display()),
        Err(e) => {
            anyhow::bail!("{}: {e}: HEATERS MAY BE ON, switch the printer off by hand", device.display())
        }
    }
    Ok(true)
}

/// Waits for a reason to act; `None`: all went well.
fn wait(told: &Receiver<String>, limits: Limits) -> Option<Reason> {
    let until = Instant::now() + Duration::from_secs_f64(limits.scenario_s);
    let mut silent = Instant::now() + SILENCE;
    loop {
        let now = Instant::now();
        if now >= until {
            return Some(Reason::Late);
        }
        match told.recv_timeout(silent.min(until).saturating_duration_since(now)) {
            Err(RecvTimeoutError::Disconnected) => return Some(Reason::Died),
            Err(RecvTimeoutError::Timeout) if Instant::now() >= silent => return Some(Reason::Hangs),
            Err(RecvTimeoutError::Timeout) => {}
            Ok(line) => match judge(&line, limits) {
                Ok(true) => return None,
                Ok(false) => silent = Instant::now() + SILENCE,
                Err(reason) => return Some(reason),
            },
        }
    }
}

/// One line of the runner: whether it is done.
fn judge(line: &str, limits: Limits) -> Result<bool, Reason> {
    let mut words = line.split_whitespace();
    match words.next() {
        Some("done") => Ok(true),
        Some("heat") => {
            let mut next = || words.next().and_then(|w| w.parse::<f64>().ok()).unwrap_or(0.0);
            for (is, most) in [(next(), limits.nozzle_c), (next(), limits.bed_c)] {
                // A reading that is no number is too hot.
                if is.is_nan() || is > most {
                    return Err(Reason::Hot(is, most));
                }
            }
            Ok(false)
        }
        _ => Ok(false),
    }
}

/// M112, the reset, and heaters off, whatever works; what was done.
fn make_safe(device: &Path, baud: u32, rig: &Rig) -> std::io::Result<&'static str> {
    let fd = open_patiently(device, baud)?;
    put(&fd, b"\nM112\n")?;
    if hears(&fd, ANSWER, &[b"halted", b"kill"]) {
        return Ok("the firmware has halted: heaters are off");
    }
    let mut how = "heaters were switched off (M104, M140), without an answer to M112";
    if rig.dtr_reset {
        tty::reset_board(&fd, baud)?;
        how = "the board was reset, which switches heaters off";
        hears(&fd, BOOT, &[b"start"]);
    }
    switch_off(&fd)?;
    Ok(how)
}

/// Tells the printer to switch its heaters off, several times over.
///
/// # Errors
/// The port takes nothing.
pub fn switch_off(fd: &OwnedFd) -> std::io::Result<()> {
    for _ in 0..OFF_TIMES {
        put(fd, OFF)?;
        std::thread::sleep(ANSWER / 5);
    }
    Ok(())
}

/// A port that has just been left may take a moment.
fn open_patiently(device: &Path, baud: u32) -> std::io::Result<OwnedFd> {
    let until = Instant::now() + SILENCE;
    loop {
        match tty::open_device(device, baud) {
            Ok(fd) => return Ok(fd),
            Err(e) if Instant::now() >= until => return Err(e),
            Err(_) => std::thread::sleep(Duration::from_millis(50)),
        }
    }
}

fn put(fd: &OwnedFd, mut bytes: &[u8]) -> std::io::Result<()> {
    let until = Instant::now() + ANSWER;
    while !bytes.is_empty() {
        let written = tty::write(fd, bytes)?;
        bytes = &bytes[written..];
        if written == 0 {
            if Instant::now() >= until {
                return Err(std::io::ErrorKind::TimedOut.into());
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }
    Ok(())
}

/// Whether one of these words comes in time.
fn hears(fd: &OwnedFd, within: Duration, words: &[&[u8]]) -> bool {
    let until = Instant::now() + within;
    let mut heard = Vec::new();
    let mut buffer = [0; 512];
    while Instant::now() < until {
        match tty::read(fd, &mut buffer) {
            Ok(0) => std::thread::sleep(Duration::from_millis(2)),
            Ok(n) => {
                heard.extend_from_slice(&buffer[..n]);
                if words.iter().any(|word| heard.windows(word.len()).any(|w| w == *word)) {
                    return true;
                }
                // Only the end can hold a word that is not complete yet.
                let keep = heard.len().min(16);
                heard.drain(..heard.len() - keep);
            }
            Err(_) => return false,
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_a_beat_an_end_or_too_hot() {
        let limits = Limits { nozzle_c: 230.0, bed_c: 70.0, scenario_s: 1.0 };
        let check = |line: &str, expect| assert_eq!(judge(line, limits), expect, "{line}");
        check("beat", Ok(false));
        check("done", Ok(true));
        check("heat 229.9 70.0", Ok(false));
        check("heat 230.1 20", Err(Reason::Hot(230.1, 230.0)));
        check("heat 20 70.5", Err(Reason::Hot(70.5, 70.0)));
        assert!(judge("heat NaN 20", limits).is_err());
        check("", Ok(false));
    }
}
