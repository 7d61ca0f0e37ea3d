//! `--raw`: bytes both ways between the port and the standard streams, unchanged.
use super::boot::Boot;
use super::{IDLE, READ_BYTES, stdin};
use crate::printer::lines::LineSplitter;
use crate::printer::port::{Moved, Port};
use crate::printer::reply;
use std::io::Write;
use std::process::ExitCode;
use std::time::Duration;
use tokio::time::{Instant, sleep_until};

/// A printer that reports by itself is never quiet: the end comes after so many
/// times the wait nevertheless.
const MAX_WAITS: u32 = 10;

/// Passes bytes until the input has ended and the printer was quiet for `wait`.
/// Nothing is sent while the board boots: `boot_ms` at the longest.
///
/// # Errors
/// The port is gone.
pub(super) async fn pump(mut port: Port, boot_ms: u64, wait: Duration) -> anyhow::Result<ExitCode> {
    let started = Instant::now();
    let now_ms = || u64::try_from(started.elapsed().as_millis()).unwrap_or(u64::MAX);
    let (mut boot, mut lines) = (Boot::new(boot_ms, 0), LineSplitter::default());
    let mut from = stdin::bytes();
    let (mut input, mut output) = ([0; READ_BYTES], Vec::new());
    let mut ended: Option<Instant> = None;
    let mut quiet_since = started;
    loop {
        boot.tick(now_ms());
        let boots = boot.until_ms().map(|at_ms| started + Duration::from_millis(at_ms));
        let end = match ended {
            Some(at) if output.is_empty() => Some((quiet_since.max(at) + wait).min(at + wait * MAX_WAITS)),
            _ => None,
        };
        if end.is_some_and(|end| end <= Instant::now()) {
            return Ok(ExitCode::SUCCESS);
        }
        let wake = [boots, end].into_iter().flatten().min().unwrap_or_else(|| Instant::now() + IDLE);
        let sendable: &[u8] = if boots.is_some() { &[] } else { &output };
        tokio::select! {
            moved = port.exchange(&mut input, sendable) => {
                quiet_since = Instant::now();
                match moved? {
                    Moved::Wrote(len) => drop(output.drain(..len)),
                    Moved::Read(len) => {
                        lines.push(&input[..len], |line| boot.hear(&reply::parse(line), now_ms()));
                        let mut out = std::io::stdout();
                        if out.write_all(&input[..len]).and_then(|()| out.flush()).is_err() {
                            // Whoever read the answers has gone.
                            return Ok(ExitCode::SUCCESS);
                        }
                    }
                }
            }
            bytes = from.recv(), if ended.is_none() && output.is_empty() => match bytes {
                Some(bytes) => output = bytes,
                None => ended = Some(Instant::now()),
            },
            () = sleep_until(wake) => {}
        }
    }
}
