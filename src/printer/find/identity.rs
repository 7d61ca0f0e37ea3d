//! What stays the same of a printer when its port goes and comes back.
//!
//! A cable that is pulled and put back may come as `ttyUSB1` instead of `ttyUSB0`,
//! and `ttyUSB0` may then be another printer. So a path alone is the last resort.
use super::scan::{Found, Places, Usb, scan};
use crate::printer::port::{OpenMode, Port, PortError};
use std::io::ErrorKind;
use std::path::Path;
use std::time::Duration;
use tokio::time::{Instant, sleep};

/// Between two looks for a port: soon enough for a person, nothing for the machine.
const LOOK_EVERY: Duration = Duration::from_millis(250);

/// A new node belongs to root until udev has given it to its group; and whoever
/// looks at new ports (ModemManager) lets go of them again.
const SETTLES: Duration = Duration::from_secs(10);

/// What finds the same printer again.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Identity {
    path: String,
    /// The path is a link: whoever made it turns it to the right device.
    link: bool,
    usb: Option<Usb>,
}

impl Identity {
    /// The identity of the printer that is at `path` now.
    pub fn of(path: &str, places: &Places) -> Self {
        let link = Path::new(path).is_symlink();
        let usb = match link {
            true => None,
            false => scan(places).into_iter().find(|port| port.path == path).and_then(|port| port.usb),
        };
        Self { path: path.to_owned(), link, usb }
    }

    /// Where the printer is now, if it is there.
    ///
    /// A USB device is known by its serial number wherever it is plugged in; one
    /// without, or with one that others have too, by its socket.
    pub fn path_now(&self, places: &Places) -> Option<String> {
        let Some(usb) = &self.usb else {
            return Path::new(&self.path).exists().then(|| self.path.clone());
        };
        let all = scan(places);
        let same: Vec<(&Found, &Usb)> = all
            .iter()
            .filter_map(|port| Some((port, port.usb.as_ref()?)))
            .filter(|(_, other)| {
                (other.vendor, other.product, &other.serial, &other.interface)
                    == (usb.vendor, usb.product, &usb.serial, &usb.interface)
            })
            .collect();
        match same[..] {
            [(port, _)] if usb.serial.is_some() => Some(port.path.clone()),
            _ => same.iter().find(|(_, u)| u.location == usb.location).map(|(port, _)| port.path.clone()),
        }
    }

    /// What a user should plug in.
    pub fn words(&self) -> String {
        match &self.usb {
            Some(Usb { serial: Some(serial), .. }) => format!("{} (USB serial number {serial})", self.path),
            Some(usb) => format!("{} (in the same USB socket, {})", self.path, usb.location),
            None => self.path.clone(),
        }
    }
}

/// Waits until the printer is there, for ever; gives its path. Dropping the future
/// ends the wait.
pub async fn wait_for(identity: &Identity, places: &Places) -> String {
    loop {
        if let Some(path) = identity.path_now(places) {
            return path;
        }
        sleep(LOOK_EVERY).await;
    }
}

/// Waits until the printer is there, for ever, and opens it without a reset of our
/// making. A port that has just come and cannot be opened yet is tried for some
/// seconds.
///
/// # Errors
/// It is there and cannot be opened.
pub async fn reopen(identity: &Identity, baud: u32, places: &Places) -> Result<Port, PortError> {
    let mut refused: Option<Instant> = None;
    loop {
        let path = wait_for(identity, places).await;
        let error = match Port::open_as(&path, baud, OpenMode::TakeOver).await {
            Ok(port) => return Ok(port),
            Err(error) => error,
        };
        match &error {
            // Gone again between looking and opening.
            PortError::Open { kind: ErrorKind::NotFound, .. } | PortError::Gone { .. } => refused = None,
            _ if refused.get_or_insert_with(Instant::now).elapsed() > SETTLES => return Err(error),
            _ => {}
        }
        sleep(LOOK_EVERY).await;
    }
}
