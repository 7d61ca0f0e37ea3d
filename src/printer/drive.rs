//! Where a session meets a port and a clock: bytes and job lines go between them
//! until the job is over.
//!
//! Takes a [`Port`], a [`Session`] and a source of lines, tells every event to
//! the caller. Owns the clock; knows no protocol, no file and no terminal.
use super::port::{Moved, Port};
use super::session::{Event, Outcome, Session};
use super::source::Source;
use std::future::Future;
use std::pin::pin;
use std::time::Duration;
use tokio::time::{Instant, sleep_until};

/// Bytes read at once; replies are short, so this holds many.
const READ_BYTES: usize = 4096;

/// Longest sleep when the session has no deadline; any value would do.
const IDLE: Duration = Duration::from_secs(60);

/// Who watches a job.
pub trait Watcher {
    /// Something happened.
    fn event(&mut self, event: &Event);
    /// Lines of the file up to this one are acknowledged. Called after every
    /// exchange with the printer, so it must cost next to nothing.
    fn acknowledged(&mut self, job_line: u64);
}

/// Runs a session to its end. `cancel` is awaited beside it; when it completes,
/// the job is cancelled (once) and runs on to its safe end.
///
/// Dropping the future abandons the job where it is: the caller then tells that
/// heaters may be on.
pub async fn drive(
    port: &mut Port,
    session: &mut Session,
    source: &mut impl Source,
    watcher: &mut impl Watcher,
    started: Instant,
    cancel: impl Future<Output = ()>,
) -> Outcome {
    let mut input = [0_u8; READ_BYTES];
    let mut cancel = pin!(cancel);
    let mut cancelled = false;
    let mut timer = pin!(sleep_until(started));
    loop {
        feed(session, source, started);
        watcher.acknowledged(session.job_acked());
        while let Some(event) = session.poll_event() {
            watcher.event(&event);
            if let Event::Ended(outcome) = event {
                return outcome;
            }
        }
        let due = match session.deadline() {
            Some(at_ms) => started + Duration::from_millis(at_ms),
            None => Instant::now() + IDLE,
        };
        // Deadlines mostly move away with every answer. Setting the timer costs
        // more than waking once too often, so only an earlier one sets it.
        if due < timer.deadline() || timer.is_elapsed() {
            timer.as_mut().reset(due);
        }
        tokio::select! {
            biased;
            () = &mut cancel, if !cancelled => {
                cancelled = true;
                session.cancel(now_ms(started));
            }
            moved = port.exchange(&mut input, session.output()) => match moved {
                Ok(Moved::Wrote(len)) => session.written(len),
                Ok(Moved::Read(len)) => session.on_bytes(&input[..len], now_ms(started)),
                Err(e) => session.port_lost(e.to_string()),
            },
            () = &mut timer => {}
        }
        // Also after an exchange: a printer that never falls silent must not keep
        // the session from its deadlines.
        let now_ms = now_ms(started);
        if session.deadline().is_some_and(|at_ms| at_ms <= now_ms) {
            session.on_tick(now_ms);
        }
    }
}

/// Gives the session what it wants.
fn feed(session: &mut Session, source: &mut impl Source, started: Instant) {
    if !session.wants_line() {
        return;
    }
    let now_ms = now_ms(started);
    while session.wants_line() {
        match source.advance() {
            Ok(true) => {
                let line = source.line();
                session.feed(line.command, line.number, now_ms);
            }
            Ok(false) => session.finish_job(now_ms),
            Err(e) => session.source_failed(e.line, e.reason, now_ms),
        }
    }
}

/// Milliseconds since `started`, as a session counts them.
pub fn now_ms(started: Instant) -> u64 {
    u64::try_from(started.elapsed().as_millis()).unwrap_or(u64::MAX)
}
