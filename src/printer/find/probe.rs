//! A port is opened and asked: [`Detect`] with a port and a clock.
//!
//! What asking does to a printer, and how long it takes, stands in [`super::baud`].
use super::baud::{Detect, Verdict};
use crate::printer::port::{Moved, OpenMode, Port, PortError};
use std::time::Duration;
use tokio::time::{Instant, sleep_until};

/// Bytes read at once.
const READ_BYTES: usize = 1024;

/// A port that was asked.
#[derive(Debug)]
pub struct Probed {
    /// Open, at the speed that was found.
    pub port: Port,
    /// What came of it.
    pub verdict: Verdict,
}

/// Opens `path` and asks at which of `rates` it talks; with `asks_name` also what
/// its firmware is. `boot_ms`: how long a board that opening resets needs to boot.
///
/// # Errors
/// The port cannot be opened, or goes away.
pub async fn probe(
    path: &str,
    rates: Vec<u32>,
    mode: OpenMode,
    boot_ms: u64,
    asks_name: bool,
) -> Result<Probed, PortError> {
    let first = rates.first().copied().unwrap_or(super::baud::LIKELY[0]);
    let mut port = Port::open_as(path, first, mode).await?;
    let started = Instant::now();
    let now_ms = || u64::try_from(started.elapsed().as_millis()).unwrap_or(u64::MAX);
    let mut detect = Detect::new(rates, boot_ms, asks_name, now_ms());
    let mut input = [0; READ_BYTES];
    loop {
        if let Some(verdict) = detect.verdict() {
            return Ok(Probed { verdict: verdict.clone(), port });
        }
        if port.baud() != detect.baud() {
            if port.set_baud(detect.baud()).is_err() {
                detect.refused(now_ms());
                continue;
            }
            port.flush_input()?;
        }
        tokio::select! {
            moved = port.exchange(&mut input, detect.output()) => match moved? {
                Moved::Wrote(len) => detect.written(len),
                Moved::Read(len) => detect.on_bytes(&input[..len], now_ms()),
            },
            () = sleep_until(started + Duration::from_millis(detect.deadline())) => {}
        }
        detect.on_tick(now_ms());
    }
}
