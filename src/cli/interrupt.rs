//! Ctrl-C in a verb that works on files: nothing half-written stays behind.
use super::files;
use std::process::exit;
use tokio::signal::unix::{SignalKind, signal};

/// Exit status of a program that a signal ended, by the shells' custom.
const SIGNALLED: i32 = 128;

/// From now on an interrupt (or SIGTERM, or the terminal's end) removes the
/// unfinished temporary files and ends the program. Without a runtime to wait in
/// the signals keep their usual effect, which ends the program too.
pub(super) fn clean_up_on_signal() {
    let _ = std::thread::Builder::new().name("signals".into()).spawn(|| {
        let Ok(runtime) = tokio::runtime::Builder::new_current_thread().enable_all().build() else { return };
        runtime.block_on(async {
            let kinds = [SignalKind::interrupt(), SignalKind::terminate(), SignalKind::hangup()];
            let (Ok(mut a), Ok(mut b), Ok(mut c)) = (signal(kinds[0]), signal(kinds[1]), signal(kinds[2]))
            else {
                return;
            };
            let kind = tokio::select! {
                _ = a.recv() => kinds[0],
                _ = b.recv() => kinds[1],
                _ = c.recv() => kinds[2],
            };
            files::remove_unfinished();
            eprintln!("outrigger: interrupted; nothing was changed");
            exit(SIGNALLED + kind.as_raw_value());
        });
    });
}
