//! Finding a printer: by what a user says, and again after its port vanished.
//!
//! Takes [`Wanted`] (a path, a USB number, `auto`), gives an open [`Port`] and the
//! [`Identity`] by which [`wait_for`] finds the same printer again, under whatever
//! name it comes back. Errors name what is there instead. Knows no job, no profile
//! and no terminal.
//!
//! - [`scan`]: the ports that there are, without opening any.
//! - [`baud`]: at which speed one talks; no I/O, no clock.
//! - [`probe`]: that, on a port.
pub mod baud;
pub mod identity;
pub mod probe;
pub mod scan;
#[cfg(test)]
mod tests;

pub use identity::{Identity, reopen, wait_for};
pub use probe::{Probed, probe};
pub use scan::{Found, Places, Usb, scan};

use super::port::{OpenMode, Port, PortError};
use baud::Verdict;
use std::fmt;
use std::str::FromStr;
use thiserror::Error;

/// Which printer a user wants.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Wanted {
    /// The device at this path.
    Path(String),
    /// The USB device with this serial number, or the only one whose number
    /// contains this; or with this `VENDOR:PRODUCT`, in hexadecimal digits.
    Usb(String),
    /// The only printer that answers.
    Auto,
}

impl FromStr for Wanted {
    type Err = FindError;

    fn from_str(text: &str) -> Result<Self, FindError> {
        match text.strip_prefix("usb:") {
            Some("") => Err(FindError::NoNumber),
            Some(number) => Ok(Self::Usb(number.to_owned())),
            None if text == "auto" => Ok(Self::Auto),
            None => Ok(Self::Path(text.to_owned())),
        }
    }
}

impl fmt::Display for Wanted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Path(path) => f.write_str(path),
            Self::Usb(number) => write!(f, "usb:{number}"),
            Self::Auto => f.write_str("auto"),
        }
    }
}

/// How fast the line is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rate {
    /// This many bits per second.
    Given(u32),
    /// To be found; this one is tried first.
    Auto {
        /// The profile's.
        first: u32,
    },
}

impl Rate {
    /// What is tried first.
    pub fn first(self) -> u32 {
        match self {
            Self::Given(baud) | Self::Auto { first: baud } => baud,
        }
    }

    fn all(self) -> Vec<u32> {
        match self {
            Self::Given(baud) => vec![baud],
            Self::Auto { first } => baud::rates(first),
        }
    }
}

/// Why no printer was found. What ports say of themselves is unescaped.
#[derive(Debug, Error)]
pub enum FindError {
    /// `usb:` and nothing behind it.
    #[error("usb: wants a serial number behind it (`outrigger ports` lists them), or VENDOR:PRODUCT")]
    NoNumber,
    /// Nothing there is what was asked for.
    #[error("no printer is {wanted}{}", instead(.there))]
    Missing {
        /// What was asked for.
        wanted: Wanted,
        /// What there is.
        there: Vec<String>,
    },
    /// More than one is.
    #[error("{wanted} is more than one: say which of {}", .which.join(", "))]
    Several {
        /// What was asked for.
        wanted: Wanted,
        /// What fits.
        which: Vec<String>,
    },
    /// None answered.
    #[error("no printer answers: {}", .told.join("; "))]
    Mute {
        /// Each port, and what came of it.
        told: Vec<String>,
    },
    /// The port itself.
    #[error(transparent)]
    Port(#[from] PortError),
}

fn instead(ports: &[String]) -> String {
    match ports.is_empty() {
        true => "; there is no USB serial port at all: is it plugged in and switched on?".to_owned(),
        false => format!("; there are: {}", ports.join(", ")),
    }
}

/// A printer that was found.
#[derive(Debug)]
pub struct Connection {
    /// Its port, open.
    pub port: Port,
    /// What finds it again.
    pub identity: Identity,
    /// What the firmware calls itself where it was asked; unescaped.
    pub firmware: Option<String>,
    /// True where it has answered already: it is not booting.
    pub awake: bool,
}

/// Finds and opens the printer that is wanted. Nothing is asked of it where path or
/// USB number and speed are given; otherwise [`baud`] says what asking does.
/// `boot_ms`: how long a board that opening resets needs to boot.
///
/// # Errors
/// [`FindError`]; in it what is there instead.
pub async fn connect(
    wanted: &Wanted,
    rate: Rate,
    mode: OpenMode,
    boot_ms: u64,
    places: &Places,
) -> Result<Connection, FindError> {
    let mut paths = match wanted {
        Wanted::Path(path) => vec![path.clone()],
        Wanted::Usb(number) => vec![by_number(number, &scan(places))?.path.clone()],
        Wanted::Auto => candidates(&scan(places))?,
    };
    match (rate, paths.len()) {
        (Rate::Given(baud), 1) => {
            let port = Port::open_as(&paths.remove(0), baud, mode).await?;
            let identity = Identity::of(port.path(), places);
            Ok(Connection { port, identity, firmware: None, awake: false })
        }
        _ => {
            // Nobody's board is reset on purpose before it is known to be the one.
            let several = paths.len() > 1;
            let asked = if several { OpenMode::TakeOver } else { mode };
            let (mut port, firmware) = only_one(wanted, paths, rate, asked, boot_ms).await?;
            let reset = several && mode == (OpenMode::Fresh { reset: true }) && port.has_dtr();
            if reset {
                port.reset_board().await?;
            }
            let identity = Identity::of(port.path(), places);
            Ok(Connection { port, identity, firmware, awake: !reset })
        }
    }
}

/// The ports that a printer may be behind.
fn candidates(all: &[Found]) -> Result<Vec<String>, FindError> {
    let paths: Vec<String> = all.iter().filter(|p| p.may_be_printer()).map(|p| p.path.clone()).collect();
    match paths.is_empty() {
        true => Err(FindError::Missing { wanted: Wanted::Auto, there: handles(all, all.iter()) }),
        false => Ok(paths),
    }
}

/// The one USB port that a user means by `number`.
///
/// # Errors
/// There is none, or more than one.
pub fn by_number<'a>(number: &str, all: &'a [Found]) -> Result<&'a Found, FindError> {
    let usb: Vec<&Found> = all.iter().filter(|port| port.usb.is_some()).collect();
    let of = |fits: &dyn Fn(&Usb) -> bool| -> Vec<&'a Found> {
        usb.iter().copied().filter(|port| port.usb.as_ref().is_some_and(fits)).collect()
    };
    let lower = number.to_ascii_lowercase();
    let serial = |usb: &Usb| usb.serial.as_ref().map(|serial| serial.to_ascii_lowercase());
    let mut fit = of(&|usb| serial(usb).is_some_and(|s| s == lower));
    if fit.is_empty() {
        fit = of(&|usb| format!("{:04x}:{:04x}", usb.vendor, usb.product) == lower);
    }
    if fit.is_empty() {
        fit = of(&|usb| serial(usb).is_some_and(|s| s.contains(&lower)));
    }
    let wanted = Wanted::Usb(number.to_owned());
    match fit[..] {
        [one] => Ok(one),
        [] => Err(FindError::Missing { wanted, there: handles(all, usb.into_iter()) }),
        _ => Err(FindError::Several { wanted, which: handles(all, fit.into_iter()) }),
    }
}

fn handles<'a>(all: &[Found], some: impl Iterator<Item = &'a Found>) -> Vec<String> {
    some.map(|port| port.handle(all)).collect()
}

/// Asks all of `paths` at once; gives the only one that answers.
async fn only_one(
    wanted: &Wanted,
    paths: Vec<String>,
    rate: Rate,
    mode: OpenMode,
    boot_ms: u64,
) -> Result<(Port, Option<String>), FindError> {
    let asks_name = paths.len() > 1;
    let mut asked = tokio::task::JoinSet::new();
    for path in paths {
        asked.spawn(async move { (probe(&path, rate.all(), mode, boot_ms, asks_name).await, path) });
    }
    let (mut answered, mut told) = (Vec::new(), Vec::new());
    while let Some(done) = asked.join_next().await {
        // A task that broke down has said nothing.
        let Ok((probed, path)) = done else { continue };
        match probed {
            Ok(Probed { port, verdict: Verdict::Speaks { firmware, .. } }) => answered.push((port, firmware)),
            Ok(Probed { verdict: Verdict::Noise, .. }) => {
                told.push(format!("{path} sends bytes that cannot be read at {}", speeds(rate)));
            }
            Ok(Probed { .. }) => told.push(format!("{path} is silent at {}", speeds(rate))),
            Err(e) => told.push(e.to_string()),
        }
    }
    told.sort();
    match answered.len() {
        0 => Err(FindError::Mute { told }),
        1 => Ok(answered.remove(0)),
        _ => {
            let mut which: Vec<String> = answered.iter().map(|(port, _)| port.path().to_owned()).collect();
            which.sort();
            Err(FindError::Several { wanted: wanted.clone(), which })
        }
    }
}

fn speeds(rate: Rate) -> String {
    match rate {
        Rate::Given(baud) => format!("{baud} baud"),
        Rate::Auto { .. } => "any likely speed".to_owned(),
    }
}
