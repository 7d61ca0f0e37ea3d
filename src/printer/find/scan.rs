//! Which serial ports the system has, and what is known of each without opening it.
//!
//! Takes the folders where Linux tells it, gives a list. Opens no port. Texts are
//! what the USB device says of itself: anybody can make one that says anything, so
//! they are kept short and must be escaped before they are shown.
use std::collections::HashMap;
use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

/// Ports listed; a machine with more has another trouble.
pub const MAX_PORTS: usize = 256;

/// Bytes of one text; a USB string has at most 126 characters.
const MAX_TEXT_BYTES: u64 = 512;

/// Folders between a port and its USB device; two are usual.
const MAX_CLIMB: usize = 4;

/// Where the system tells of its ports.
#[derive(Debug, Clone)]
pub struct Places {
    /// `/sys/class/tty`.
    pub classes: PathBuf,
    /// `/dev`.
    pub devices: PathBuf,
}

impl Default for Places {
    fn default() -> Self {
        Self { classes: "/sys/class/tty".into(), devices: "/dev".into() }
    }
}

/// A port that can be opened.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Found {
    /// `/dev/ttyUSB0`: as long as the cable stays.
    pub path: String,
    /// `/dev/serial/by-id/…`: as long as the device is the same.
    pub by_id: Option<String>,
    /// What is known of it where it is a USB device.
    pub usb: Option<Usb>,
}

/// A USB device, as it describes itself.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Usb {
    /// Maker's number.
    pub vendor: u16,
    /// Product's number.
    pub product: u16,
    /// Serial number; many cheap bridges have none, or all the same.
    pub serial: Option<String>,
    /// Maker's name.
    pub manufacturer: Option<String>,
    /// Product's name.
    pub product_name: Option<String>,
    /// The socket: `1-1.2`.
    pub location: String,
    /// Which of the device's ports: its interface, and the port of a bridge with
    /// several.
    pub interface: String,
}

impl Found {
    /// Whether a printer may be behind it: a USB serial port, or the UART of a
    /// board computer's pins.
    pub fn may_be_printer(&self) -> bool {
        self.usb.is_some() || self.name().starts_with("ttyAMA")
    }

    /// `ttyUSB0`.
    pub fn name(&self) -> &str {
        self.path.rsplit('/').next().unwrap_or_default()
    }

    /// What to say for it on a command line so that it is found again wherever it
    /// is plugged in, among the ports that there are.
    pub fn handle(&self, all: &[Found]) -> String {
        let told = self.usb.as_ref().and_then(|usb| usb.serial.as_deref()).filter(|serial| {
            let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
            let same =
                |other: &&Found| other.usb.as_ref().is_some_and(|usb| usb.serial.as_deref() == Some(serial));
            serial.len() >= 4 && serial.chars().all(plain) && all.iter().filter(same).count() == 1
        });
        match (told, &self.by_id) {
            (Some(serial), _) => format!("usb:{serial}"),
            (None, Some(link)) => link.clone(),
            (None, None) => self.path.clone(),
        }
    }
}

/// All ports, in the order of their names. A folder that cannot be read is empty.
pub fn scan(places: &Places) -> Vec<Found> {
    let links = by_id(&places.devices);
    let Ok(entries) = fs::read_dir(&places.classes) else {
        return Vec::new();
    };
    let mut found: Vec<Found> = entries
        .flatten()
        .filter_map(|entry| {
            let device = fs::canonicalize(entry.path().join("device")).ok()?;
            // A UART that the board has no chip for says so.
            if text(&entry.path().join("type")).is_some_and(|kind| kind == "0") {
                return None;
            }
            let path = places.devices.join(entry.file_name());
            let path = path.exists().then(|| path.to_string_lossy().into_owned())?;
            Some(Found { by_id: links.get(&path).cloned(), usb: usb(&device), path })
        })
        .take(MAX_PORTS)
        .collect();
    found.sort_by_key(|port| (port.usb.is_none(), natural(port.name())));
    found
}

/// The word and the number, so that 10 comes behind 9.
fn natural(name: &str) -> (String, u64) {
    let word = name.trim_end_matches(|c: char| c.is_ascii_digit());
    (word.to_owned(), name[word.len()..].parse().unwrap_or(0))
}

/// The links that udev makes for devices with a name of their own.
fn by_id(devices: &Path) -> HashMap<String, String> {
    let Ok(entries) = fs::read_dir(devices.join("serial/by-id")) else {
        return HashMap::new();
    };
    let link = |entry: fs::DirEntry| {
        let target = fs::canonicalize(entry.path()).ok()?;
        Some((target.to_str()?.to_owned(), entry.path().to_str()?.to_owned()))
    };
    entries.flatten().take(MAX_PORTS).filter_map(link).collect()
}

/// The USB device above a port's own folder.
fn usb(device: &Path) -> Option<Usb> {
    let above: Vec<&Path> = device.ancestors().take(MAX_CLIMB).collect();
    let at = above.iter().position(|folder| folder.join("idVendor").is_file())?;
    let root = above[at];
    let number = |name: &str| u16::from_str_radix(&text(&root.join(name))?, 16).ok();
    let interface = above[..at].iter().find_map(|folder| text(&folder.join("bInterfaceNumber")));
    let port = text(&device.join("port_number"));
    Some(Usb {
        vendor: number("idVendor")?,
        product: number("idProduct")?,
        serial: text(&root.join("serial")),
        manufacturer: text(&root.join("manufacturer")),
        product_name: text(&root.join("product")),
        location: root.file_name()?.to_string_lossy().into_owned(),
        interface: format!("{}/{}", interface.unwrap_or_default(), port.unwrap_or_default()),
    })
}

/// A short file's text, if there is any.
fn text(path: &Path) -> Option<String> {
    let mut bytes = Vec::new();
    File::open(path).ok()?.take(MAX_TEXT_BYTES).read_to_end(&mut bytes).ok()?;
    let text = String::from_utf8_lossy(&bytes).trim().to_owned();
    (!text.is_empty()).then_some(text)
}
