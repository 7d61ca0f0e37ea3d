//! The prompt: line editing and history, in a thread of its own.
//!
//! The only file that names `rustyline`. The printer's words go above the prompt,
//! whatever the user is typing.
use super::keys::Keys;
use super::talk::Shown;
use super::{Screen, Typed};
use crate::causes;
use crate::job::disk;
use crate::printer::lines::MAX_REPLY_LEN;
use crate::station::escape::printable_to;
use anyhow::Context;
use rustyline::error::ReadlineError;
use rustyline::history::{FileHistory, History};
use rustyline::{Config, Editor, ExternalPrinter};
use std::io::ErrorKind;
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::mpsc::{Receiver, Sender, channel};

/// Lines of history kept.
const MAX_HISTORY: usize = 1000;

/// What is typed ahead of the loop.
const AHEAD: usize = 64;

type Prompt = Editor<(), FileHistory>;

/// What stands above the prompt.
pub(super) struct Above {
    printer: Box<dyn FnMut(String) -> rustyline::Result<()> + Send>,
    colours: bool,
    /// The terminal is as it was when this is dropped.
    _keys: Keys,
}

impl Screen for Above {
    fn show(&mut self, shown: &Shown) -> std::io::Result<()> {
        let colours = self.colours;
        let painted = |text: &str, code: &str| match colours {
            true => format!("\u{1b}[{code}m{text}\u{1b}[0m\n"),
            false => format!("{text}\n"),
        };
        let clean = |text: &str| printable_to(text, MAX_REPLY_LEN);
        let text = match shown {
            Shown::Said(text) => format!("{}\n", clean(text)),
            Shown::Aside(text) => painted(&clean(text), "2"),
            Shown::Note(text) => {
                text.lines().map(|line| painted(&format!("- {}", clean(line)), "33")).collect()
            }
        };
        (self.printer)(text).map_err(std::io::Error::other)
    }
}

/// The screen, and what is typed.
///
/// # Errors
/// The terminal cannot be used.
pub(super) fn start() -> anyhow::Result<(Above, Receiver<Typed>)> {
    let keys = Keys::take().context("cannot use this terminal; use a pipe")?;
    let config = Config::builder()
        .max_history_size(MAX_HISTORY)
        .and_then(|config| config.history_ignore_dups(true))
        .context("cannot set up the prompt")?
        .auto_add_history(true)
        .build();
    let mut prompt = Prompt::with_config(config).context("cannot use this terminal; use a pipe")?;
    let history = disk::folder(None, |name| std::env::var_os(name))
        .ok()
        .and_then(|folder| load(&mut prompt, &folder).inspect_err(tell).ok());
    let mut printer = prompt.create_external_printer().context("cannot use this terminal; use a pipe")?;
    let (to, from) = channel(AHEAD);
    end_on_signal(to.clone())?;
    std::thread::Builder::new()
        .name("prompt".to_owned())
        .spawn(move || read(prompt, history.as_deref(), &to))
        .context("cannot start the prompt")?;
    let above = Above {
        printer: Box::new(move |text| printer.print(text)),
        colours: std::env::var_os("NO_COLOR").is_none_or(|no| no.is_empty()),
        _keys: keys,
    };
    Ok((above, from))
}

/// Whoever ends the program from outside gets the terminal back, too.
fn end_on_signal(to: Sender<Typed>) -> anyhow::Result<()> {
    let mut signals = [signal(SignalKind::terminate())?, signal(SignalKind::hangup())?];
    tokio::spawn(async move {
        let [terminate, hangup] = &mut signals;
        tokio::select! {
            _ = terminate.recv() => {}
            _ = hangup.recv() => {}
        }
        let _ = to.send(Typed::End).await;
    });
    Ok(())
}

fn tell(error: &anyhow::Error) {
    eprintln!("outrigger: no history: {}", causes::line(error));
}

/// Reads lines until the user ends, or nobody listens.
fn read(mut prompt: Prompt, history: Option<&Path>, to: &Sender<Typed>) {
    loop {
        let typed = match prompt.readline("> ") {
            Ok(line) => {
                if let Some(file) = history {
                    // A history that cannot be kept is no reason to stop talking.
                    let _ = prompt.append_history(file);
                }
                Typed::Line(line)
            }
            Err(ReadlineError::Interrupted) => Typed::Interrupt,
            Err(_) => Typed::End,
        };
        let over = matches!(&typed, Typed::End)
            || matches!(&typed, Typed::Line(line) if matches!(line.trim(), "/quit" | "/exit"));
        if to.blocking_send(typed).is_err() || over {
            return;
        }
    }
}

/// Loads the history; makes its file, for its owner only.
fn load<H: History>(prompt: &mut Editor<(), H>, folder: &Path) -> anyhow::Result<PathBuf> {
    let file = private_file(folder)?;
    prompt.load_history(&file).with_context(|| file.display().to_string())?;
    Ok(file)
}

/// The history's file, made if it is not there, readable by its owner only: what
/// is typed to a printer may hold the network's password.
fn private_file(folder: &Path) -> anyhow::Result<PathBuf> {
    let file = folder.join("console-history");
    let told = || file.display().to_string();
    std::fs::DirBuilder::new().recursive(true).mode(0o700).create(folder).with_context(told)?;
    match std::fs::OpenOptions::new().write(true).create_new(true).mode(0o600).open(&file) {
        Ok(_) => {}
        Err(e) if e.kind() == ErrorKind::AlreadyExists => {
            std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o600)).with_context(told)?;
        }
        Err(e) => return Err(e).with_context(told),
    }
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_history_is_its_owners_alone() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("state/outrigger");
        let mode = |path: &Path| path.metadata().unwrap().permissions().mode() & 0o777;
        let file = private_file(&folder).unwrap();
        assert_eq!((mode(&folder), mode(&file)), (0o700, 0o600));
        // One that is there keeps its lines, and loses what others may do.
        std::fs::write(&file, "M115\n").unwrap();
        std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o644)).unwrap();
        assert_eq!(private_file(&folder).unwrap(), file);
        assert_eq!((mode(&file), std::fs::read_to_string(&file).unwrap()), (0o600, "M115\n".to_owned()));
    }
}
