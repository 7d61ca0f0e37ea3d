//! What systemd is told: ready, alive, stopping. Without it nothing happens.
use super::app::App;
use sd_notify::NotifyState;
use std::sync::Arc;

/// The daemon answers.
pub(crate) fn ready() {
    let _ = sd_notify::notify(&[NotifyState::Ready]);
}

/// The daemon ends.
pub(crate) fn stopping() {
    let _ = sd_notify::notify(&[NotifyState::Stopping]);
}

/// Tells the watchdog that the daemon lives, as long as the network's side runs and the foreman
/// answers: a daemon that only looks alive is restarted.
pub(crate) async fn watchdog(app: Arc<App>) {
    let Some(within) = sd_notify::watchdog_enabled() else { return };
    loop {
        tokio::time::sleep(within / 3).await;
        let asked = app.ask(|answer| super::foreman::Message::Ping { answer });
        if tokio::time::timeout(within / 3, asked).await.is_ok_and(|answer| answer.is_ok()) {
            let _ = sd_notify::notify(&[NotifyState::Watchdog]);
        }
    }
}
