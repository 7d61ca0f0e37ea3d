//! What reaches a running job from outside: signals, as letters in its mailbox.
//!
//! SIGINT (Ctrl-C), SIGTERM and SIGHUP (the terminal's end) cancel; a second one
//! quits at once. SIGUSR1 pauses, SIGUSR2 resumes.
use crate::job::host::Request;
use crate::job::run::{Mail, mailbox};
use anyhow::Context;
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::mpsc;

/// A job's mailbox; signals fall into it.
pub(in crate::cli) struct Letters {
    /// Who else may write.
    pub(in crate::cli) post: mpsc::Sender<Mail>,
    /// What the job reads.
    pub(in crate::cli) mail: mpsc::Receiver<Mail>,
}

/// From now on signals end nothing by themselves. Call within a runtime.
///
/// # Errors
/// The system refuses to tell of signals.
pub(in crate::cli) fn letters() -> anyhow::Result<Letters> {
    let (post, mail) = mailbox();
    signals(post.clone()).context("cannot wait for signals")?;
    Ok(Letters { post, mail })
}

fn signals(post: mpsc::Sender<Mail>) -> std::io::Result<()> {
    let mut interrupt = signal(SignalKind::interrupt())?;
    let mut terminate = signal(SignalKind::terminate())?;
    let mut hang_up = signal(SignalKind::hangup())?;
    let mut pause = signal(SignalKind::user_defined1())?;
    let mut resume = signal(SignalKind::user_defined2())?;
    tokio::spawn(async move {
        let mut asked = false;
        loop {
            let letter = tokio::select! {
                _ = interrupt.recv() => stop(&mut asked),
                _ = terminate.recv() => stop(&mut asked),
                _ = hang_up.recv() => stop(&mut asked),
                _ = pause.recv() => Mail::Ask(Request::Pause),
                _ = resume.recv() => Mail::Ask(Request::Resume),
            };
            if post.send(letter).await.is_err() {
                return;
            }
        }
    });
    Ok(())
}

/// The first time a cancel, the second time the end.
fn stop(asked: &mut bool) -> Mail {
    match std::mem::replace(asked, true) {
        false => Mail::Ask(Request::Cancel),
        true => Mail::Quit,
    }
}
