//! Whoever switches a resin printer's light off when we are dead.
//!
//! A process of its own that has the printer's port too. We tell it each time that the light may go on
//! and when it is proved to be off. Should we die in between (or, where we keep the exposure's time, fall
//! behind it), it writes the lines that switch the light off. It also keeps the port open until then: a
//! serial adapter whose last user is gone throws away what it has not sent yet, and that may be the line
//! that ends an exposure.
//!
//! Takes a descriptor of the port and the lines; its words come over a pipe whose end is our death.
//! What it writes has no number: a firmware takes such a line whatever it counts.
use super::guardian::program;
use super::settings;
use crate::causes;
use crate::job::run::OnPort;
use crate::profile::Profile;
use anyhow::Context;
use std::cell::RefCell;
use std::io::{self, Write};
use std::os::fd::OwnedFd;
use std::os::unix::process::CommandExt;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::rc::Rc;
use std::time::{Duration, Instant};

/// The verb that is the watchdog.
pub(crate) const VERB: &str = "light-watch";

/// How often the light is switched off: a line may be lost, or the board busy refusing half of one.
const TIMES: u32 = 3;

/// Between two of these.
const PAUSE: Duration = Duration::from_millis(200);

/// How often it is looked whether one that has nothing to do is gone, and the pause between: the port is
/// free again then.
const GOING_TRIES: u32 = 25;
const GOING_PAUSE: Duration = Duration::from_millis(2);

/// Words of one line at most.
const WORDS_BYTES: usize = 64;

/// Who keeps an exposure's time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Keeper {
    /// The controller: the light ends by itself, and our death is no hurry.
    Controller,
    /// We: the light is switched off at once.
    Host,
}

/// Our side of it.
#[derive(Debug)]
pub(crate) struct Watchdog {
    child: Child,
    words: Option<ChildStdin>,
}

impl Watchdog {
    /// Starts one over a port; `off` are the lines that switch the light off.
    ///
    /// # Errors
    /// It cannot be started; somebody should be told.
    pub(crate) fn start(port: OwnedFd, off: &[String]) -> anyhow::Result<Self> {
        let mut child = Command::new(program())
            .arg(VERB)
            .args(off)
            .current_dir("/")
            .stdin(Stdio::piped())
            .stdout(Stdio::from(port))
            .stderr(Stdio::null())
            // What ends us at the terminal shall not end it.
            .process_group(0)
            .spawn()
            .context("cannot start the light's watchdog")?;
        let words = child.stdin.take();
        Ok(Self { child, words })
    }

    /// The light may be on from now, for so long at most.
    pub(crate) fn lit(&mut self, most: Duration, keeper: Keeper) {
        let keeper = if keeper == Keeper::Host { "host" } else { "controller" };
        self.say(&format!("lit {} {keeper}\n", most.as_millis()));
    }

    /// It is proved to be off.
    pub(crate) fn dark(&mut self) {
        self.say("dark\n");
    }

    fn say(&mut self, words: &str) {
        // One that is gone cannot be helped: the exposure itself does not need it.
        if let Some(pipe) = &mut self.words
            && pipe.write_all(words.as_bytes()).is_err()
        {
            self.words = None;
        }
    }
}

impl Drop for Watchdog {
    fn drop(&mut self) {
        // It ends when its pipe does. One that still switches off is not waited for: whoever inherits
        // it collects it.
        self.words = None;
        for _ in 0..GOING_TRIES {
            if !matches!(self.child.try_wait(), Ok(None)) {
                return;
            }
            std::thread::sleep(GOING_PAUSE);
        }
    }
}

/// The watchdog over whatever port is open, if there is one. Clones are the same.
#[derive(Debug, Clone, Default)]
pub(crate) struct LightWatch(Rc<RefCell<Option<Watchdog>>>);

impl LightWatch {
    /// Has a watchdog over each port that is opened, of this profile's light.
    pub(crate) fn on_port(&self, profile: &Profile) -> OnPort {
        let off = profile.msla().map(|msla| settings::lines(&msla.light.off)).unwrap_or_default();
        let watch = self.clone();
        Box::new(move |port| {
            // Over a port that is gone it can do nothing, and must not hold its name.
            watch.dark();
            drop(watch.0.borrow_mut().take());
            let Some(port) = port else { return };
            match port.another().map_err(Into::into).and_then(|fd| Watchdog::start(fd, &off)) {
                Ok(one) => *watch.0.borrow_mut() = Some(one),
                Err(why) => tracing::warn!("nobody switches the light off if we die: {}", causes::line(&why)),
            }
        })
    }

    /// The light may be on from now, for so long at most.
    pub(crate) fn lit(&self, most: Duration, keeper: Keeper) {
        if let Some(dog) = &mut *self.0.borrow_mut() {
            dog.lit(most, keeper);
        }
    }

    /// It is proved to be off.
    pub(crate) fn dark(&self) {
        if let Some(dog) = &mut *self.0.borrow_mut() {
            dog.dark();
        }
    }
}

/// What the watchdog knows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Light {
    Dark,
    /// It may be on until then.
    Lit(Instant, Keeper),
}

/// What a line of words says.
fn heard(line: &str, now: Instant) -> Option<Light> {
    let mut words = line.split_whitespace();
    match (words.next()?, words.next(), words.next()) {
        ("dark", None, None) => Some(Light::Dark),
        ("lit", Some(ms), Some(keeper)) => {
            let ms: u32 = ms.parse().ok()?;
            let keeper = match keeper {
                "host" => Keeper::Host,
                "controller" => Keeper::Controller,
                _ => return None,
            };
            Some(Light::Lit(now + Duration::from_millis(ms.into()), keeper))
        }
        _ => None,
    }
}

/// What the other side of the pipe does next.
enum Next {
    /// A line of words.
    Words(String),
    /// Nothing until then.
    Silence,
    /// It is dead.
    Dead,
}

/// The watchdog itself: returns when the light is off and its master dead.
///
/// # Errors
/// The port takes no bytes: it is gone.
pub(crate) fn watch(off: &[String]) -> io::Result<()> {
    let mut text = String::from("\n");
    for line in off {
        text += line;
        text.push('\n');
    }
    let mut light = Light::Dark;
    let mut words = Words::default();
    loop {
        let until = match light {
            // A controller keeps its time itself.
            Light::Lit(until, Keeper::Host) => Some(until),
            _ => None,
        };
        match (words.next(until), light) {
            (Next::Words(line), _) => light = heard(&line, Instant::now()).unwrap_or(light),
            (Next::Silence, _) => {
                switch_off(&text)?;
                light = Light::Dark;
            }
            (Next::Dead, Light::Dark) => return Ok(()),
            (Next::Dead, Light::Lit(_, Keeper::Host)) => return switch_off(&text),
            (Next::Dead, Light::Lit(until, Keeper::Controller)) => {
                std::thread::sleep(until.saturating_duration_since(Instant::now()));
                return switch_off(&text);
            }
        }
    }
}

/// Writes the lines some times, and waits until they are out.
fn switch_off(text: &str) -> io::Result<()> {
    let mut done = Ok(());
    for _ in 0..TIMES {
        done = rustix::io::write(rustix::stdio::stdout(), text.as_bytes()).map(|_| ()).map_err(Into::into);
        std::thread::sleep(PAUSE);
    }
    done
}

/// Lines from standard input, with patience.
#[derive(Default)]
struct Words {
    bytes: Vec<u8>,
}

impl Words {
    fn next(&mut self, until: Option<Instant>) -> Next {
        use rustix::event::{PollFd, PollFlags, Timespec, poll};
        loop {
            if let Some(end) = self.bytes.iter().position(|b| *b == b'\n') {
                let line: Vec<u8> = self.bytes.drain(..=end).collect();
                return Next::Words(String::from_utf8_lossy(&line).into_owned());
            }
            if self.bytes.len() > WORDS_BYTES {
                self.bytes.clear();
            }
            let left = until.map(|at| at.saturating_duration_since(Instant::now()));
            if left.is_some_and(|left| left.is_zero()) {
                return Next::Silence;
            }
            let timeout = left.and_then(|left| Timespec::try_from(left).ok());
            let stdin = rustix::stdio::stdin();
            let mut fds = [PollFd::new(&stdin, PollFlags::IN)];
            match poll(&mut fds, timeout.as_ref()) {
                Ok(0) | Err(rustix::io::Errno::INTR) => continue,
                Ok(_) => {}
                Err(_) => return Next::Dead,
            }
            let mut piece = [0; WORDS_BYTES];
            match rustix::io::read(stdin, &mut piece) {
                Ok(0) => return Next::Dead,
                Ok(len) => self.bytes.extend_from_slice(&piece[..len]),
                Err(rustix::io::Errno::INTR | rustix::io::Errno::AGAIN) => {}
                Err(_) => return Next::Dead,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_tell_the_light() {
        let now = Instant::now();
        let check = |line: &str, expect: Option<Light>| assert_eq!(heard(line, now), expect, "{line:?}");
        let at = |ms| now + Duration::from_millis(ms);
        check("dark\n", Some(Light::Dark));
        check("lit 2100 host\n", Some(Light::Lit(at(2100), Keeper::Host)));
        check("lit 0 controller", Some(Light::Lit(at(0), Keeper::Controller)));
        for wrong in ["", "lit", "lit x host", "lit -1 host", "lit 5", "lit 5 moon", "dark now", "on"] {
            check(wrong, None);
        }
    }
}
