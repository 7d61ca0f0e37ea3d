//! `outrigger.toml`: what the daemon is to do, as plain valid data.
//!
//! Takes the file's text; gives a [`Config`], or the first fault with its line and, for a key
//! that nobody reads, the nearest right one. The keys stand in [`KEYS`], the one place from which
//! checks and `--print-config` are made. Knows no socket and no printer's port; profiles are
//! loaded by their name.
use crate::profile::keys::{Key, Takes};
use crate::profile::{Located, Profile, ProfileError, check, line_of, load_printer};
use serde::{Deserialize, Serialize};
use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;
use std::time::Duration;

/// Largest configuration file, bytes; anything larger is something else.
pub(crate) const FILE_BYTES_MAX: u64 = 256 * 1024;

/// Printers of one daemon at most: a Pi has four USB ports, and hubs exist.
const MAX_PRINTERS: usize = 16;

/// Longest path, port or address, bytes.
const LINE_BYTES: usize = 1024;

/// Why there is no configuration.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ConfigError {
    /// The file's content.
    #[error("line {}: {}", .0.line, .0.fault)]
    Content(Located),
    /// What the keys alone do not say.
    #[error("{0}")]
    Meaning(String),
    /// A printer's profile.
    #[error("printer {id:?}: {source}")]
    Profile {
        /// The printer.
        id: String,
        /// What is wrong.
        source: ProfileError,
    },
}

const fn key(path: &'static str, takes: Takes, doc: &'static str) -> Key {
    Key { path, takes, required: false, doc }
}

const fn must(path: &'static str, takes: Takes, doc: &'static str) -> Key {
    Key { path, takes, required: true, doc }
}

use Takes::{Flag, Line, OneOf, Table, Tables, Text, Texts, Whole};

/// Every key, in the order in which `--print-config` prints them.
pub(crate) const KEYS: &[Key] = &[
    key("server", Table, "Who can reach the daemon, and how"),
    key(
        "server.listen",
        Texts(8),
        "Addresses and ports; before the first user is made (outrigger user add) only the loopback is listened on, whatever stands here",
    ),
    key("server.name", Text, "What the page and the network's discovery call this host"),
    key(
        "server.mdns",
        Flag,
        "Announce the daemon in the local network (_octoprint._tcp), so that slicers find it",
    ),
    key(
        "server.tls_cert",
        Line(LINE_BYTES),
        "Certificate chain, PEM; with tls_key all connections are HTTPS",
    ),
    key("server.tls_key", Line(LINE_BYTES), "The certificate's private key, PEM"),
    key(
        "server.trusted_proxies",
        Texts(8),
        "Addresses of reverse proxies whose X-Forwarded-For is believed; nobody else's is",
    ),
    key("server.max_upload_mb", Whole(1, 65_536), "Largest file that is taken, MB"),
    key("storage", Table, "Files, jobs and users"),
    key(
        "storage.folder",
        Line(LINE_BYTES),
        "The data folder; left out: $STATE_DIRECTORY (systemd), else $OUTRIGGER_STATE, else ~/.local/state/outrigger",
    ),
    key(
        "storage.keep_mb",
        Whole(10, 10_000_000),
        "Uploaded files are kept up to so many MB; then the oldest that no job needs go",
    ),
    key(
        "storage.min_free_mb",
        Whole(0, 1_000_000),
        "Uploads are refused when less would be free on the disk, MB",
    ),
    key("check", Table, "How uploads are looked at; each in a process of its own"),
    key("check.memory_mb", Whole(64, 65_536), "Most memory that a check or a mending may take, MB"),
    key("check.timeout_s", Whole(5, 86_400), "Longest time that it may take, s"),
    key("log", Table, "What is written to the log (standard error; journald under systemd)"),
    key("log.level", OneOf(&["error", "warn", "info", "debug"]), "The least serious that is written"),
    key("printer", Tables(MAX_PRINTERS), "A printer; one such table for each"),
    must("printer.id", Line(32), "Short name in addresses: letters, digits, - and _"),
    key("printer.name", Text, "What people call it; left out: its profile's title"),
    must(
        "printer.profile",
        Line(LINE_BYTES),
        "Its profile: a name of `outrigger profile list`, or the path of a file",
    ),
    must(
        "printer.port",
        Line(LINE_BYTES),
        "Its serial port: usb:SERIAL (see `outrigger ports`), a path such as /dev/serial/by-id/…, or auto",
    ),
    key("printer.baud", Whole(1200, 4_000_000), "Speed, bits per second; left out: the profile's"),
    key(
        "printer.on_findings",
        OneOf(&["hold", "warn", "mend"]),
        "What happens to a job in which the check finds something: hold waits for a person, warn prints and tells, mend grows supports and waits for a yes on the picture",
    ),
    key(
        "printer.reorder",
        Flag,
        "Put the infill of each clean job into the order in which the head lifts least (proved to print the same)",
    ),
    key(
        "printer.clear_bed",
        OneOf(&["ask", "assume"]),
        "ask: the next job waits until somebody has said that the bed is clear; assume: it starts at once (where the profile has [[before]], a person is asked all the same)",
    ),
    key(
        "printer.material",
        Line(LINE_BYTES),
        "The material in it, where jobs do not name theirs: a name of `outrigger profile list`",
    ),
    key("printer.macros", Flag, "Send the profile's start and end macros around each job"),
    key(
        "printer.idle_heater_timeout_s",
        Whole(10, 86_400),
        "Heaters that are on without a job go off after so long, s",
    ),
    key("printer.webcam_url", Line(LINE_BYTES), "A webcam's picture or stream, http(s)"),
];

/// What happens to a job in which something was found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum OnFindings {
    /// It waits for a person.
    #[default]
    Hold,
    /// It is printed, and the findings are told.
    Warn,
    /// Supports are grown; the mended job waits for a yes.
    Mend,
}

/// Whether a job may start where an earlier one's part may lie.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum ClearBed {
    /// Somebody says that the bed is clear.
    #[default]
    Ask,
    /// It is taken to be.
    Assume,
}

/// The whole file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Config {
    pub(crate) server: Server,
    pub(crate) storage: Storage,
    pub(crate) check: Check,
    pub(crate) log: Log,
    #[serde(rename = "printer")]
    pub(crate) printers: Vec<Printer>,
}

/// Who can reach the daemon.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Server {
    pub(crate) listen: Vec<SocketAddr>,
    pub(crate) name: String,
    pub(crate) mdns: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) tls_cert: Option<PathBuf>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) tls_key: Option<PathBuf>,
    pub(crate) trusted_proxies: Vec<IpAddr>,
    pub(crate) max_upload_mb: u64,
}

impl Default for Server {
    fn default() -> Self {
        Self {
            listen: vec![SocketAddr::from(([0, 0, 0, 0], 8080)), SocketAddr::from(([0_u16; 8], 8080))],
            name: "outrigger".to_owned(),
            mdns: true,
            tls_cert: None,
            tls_key: None,
            trusted_proxies: Vec::new(),
            max_upload_mb: 512,
        }
    }
}

impl Server {
    /// Largest upload, bytes.
    pub(crate) fn max_upload_bytes(&self) -> u64 {
        self.max_upload_mb * 1_000_000
    }
}

/// Where things are kept.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Storage {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) folder: Option<PathBuf>,
    pub(crate) keep_mb: u64,
    pub(crate) min_free_mb: u64,
}

impl Default for Storage {
    fn default() -> Self {
        Self { folder: None, keep_mb: 4096, min_free_mb: 200 }
    }
}

/// How uploads are looked at.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Check {
    pub(crate) memory_mb: u64,
    pub(crate) timeout_s: u64,
}

impl Default for Check {
    fn default() -> Self {
        Self { memory_mb: 700, timeout_s: 1800 }
    }
}

impl Check {
    /// Longest time of one look.
    pub(crate) fn timeout(&self) -> Duration {
        Duration::from_secs(self.timeout_s)
    }
}

/// What is written to the log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Log {
    pub(crate) level: String,
}

impl Default for Log {
    fn default() -> Self {
        Self { level: "info".to_owned() }
    }
}

/// One printer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Printer {
    pub(crate) id: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) name: Option<String>,
    pub(crate) profile: String,
    pub(crate) port: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) baud: Option<u32>,
    #[serde(default)]
    pub(crate) on_findings: OnFindings,
    #[serde(default = "yes")]
    pub(crate) reorder: bool,
    #[serde(default)]
    pub(crate) clear_bed: ClearBed,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) material: Option<String>,
    #[serde(default = "yes")]
    pub(crate) macros: bool,
    #[serde(default = "idle_heater_timeout_s")]
    pub(crate) idle_heater_timeout_s: u64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) webcam_url: Option<String>,
}

fn yes() -> bool {
    true
}

/// Long enough to change the filament and short for an empty house.
fn idle_heater_timeout_s() -> u64 {
    1800
}

impl Printer {
    /// A printer with nothing but what must be said.
    pub(crate) fn new(id: &str, profile: &str, port: &str) -> Self {
        Self {
            id: id.to_owned(),
            name: None,
            profile: profile.to_owned(),
            port: port.to_owned(),
            baud: None,
            on_findings: OnFindings::default(),
            reorder: true,
            clear_bed: ClearBed::default(),
            material: None,
            macros: true,
            idle_heater_timeout_s: idle_heater_timeout_s(),
            webcam_url: None,
        }
    }

    /// Its profile.
    ///
    /// # Errors
    /// [`ConfigError::Profile`].
    pub(crate) fn load(&self) -> Result<Profile, ConfigError> {
        load_printer(&self.profile).map_err(|source| ConfigError::Profile { id: self.id.clone(), source })
    }
}

impl Config {
    /// Reads the file's text.
    ///
    /// # Errors
    /// The first fault.
    pub(crate) fn parse(text: &str) -> Result<Self, ConfigError> {
        check(text, KEYS).map_err(ConfigError::Content)?;
        let config: Self = toml::from_str(text).map_err(|e| {
            let line = e.span().map_or(1, |span| line_of(text, span.start));
            ConfigError::Meaning(format!("line {line}: {}", e.message()))
        })?;
        config.sound()?;
        Ok(config)
    }

    /// What the keys alone do not say.
    fn sound(&self) -> Result<(), ConfigError> {
        let wrong = |words: String| Err(ConfigError::Meaning(words));
        if self.server.tls_cert.is_some() != self.server.tls_key.is_some() {
            return wrong(
                "server.tls_cert and server.tls_key go together: one of them is missing".to_owned(),
            );
        }
        for (at, printer) in self.printers.iter().enumerate() {
            let id = &printer.id;
            if !id.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_') {
                return wrong(format!("printer.id {id:?} must have letters, digits, - and _ only"));
            }
            if self.printers[..at].iter().any(|other| other.id.eq_ignore_ascii_case(id)) {
                return wrong(format!("two printers have the id {id:?}"));
            }
            let same = |other: &&Printer| other.port == printer.port;
            if let Some(other) = self.printers[..at].iter().find(same) {
                return wrong(format!("printers {:?} and {id:?} have the same port", other.id));
            }
            if printer.webcam_url.as_ref().is_some_and(|url| webcam_origin(url).is_none()) {
                return wrong(format!("printer {id:?}: webcam_url must begin with http:// or https://"));
            }
            printer.load()?;
        }
        Ok(())
    }

    /// All keys with their values and what they mean; text that loads as the same.
    pub(crate) fn explain(&self) -> String {
        let mut out = String::from(
            "# outrigger.toml: all keys. Those behind a # are not set; what stands there is an example.\n",
        );
        let value = toml::Value::try_from(self).unwrap_or_else(|_| toml::Value::Table(toml::Table::new()));
        for key in KEYS.iter().filter(|key| !key.path.starts_with("printer")) {
            match (key.path.split_once('.'), &key.takes) {
                (None, _) => out += &format!("\n# {}\n[{}]\n", key.doc, key.path),
                (Some((table, name)), _) => {
                    let found = value.get(table).and_then(|t| t.get(name));
                    out += &match found {
                        Some(value) => format!("# {}\n{name} = {value}\n", key.doc),
                        None => format!("# {}\n# {name} = {}\n", key.doc, example(key.path)),
                    };
                }
            }
        }
        let example = [Printer::new("prusa", "prusa-mk3s", "usb:SERIAL")];
        let (printers, mark) = match self.printers.is_empty() {
            true => (&example[..], "# "),
            false => (&self.printers[..], ""),
        };
        for printer in printers {
            let value =
                toml::Value::try_from(printer).unwrap_or_else(|_| toml::Value::Table(toml::Table::new()));
            for key in KEYS {
                match key.path.split_once('.') {
                    None if key.path == "printer" => out += &format!("\n# {}\n{mark}[[printer]]\n", key.doc),
                    Some(("printer", name)) => {
                        out += &match value.get(name) {
                            Some(value) => format!("# {}\n{mark}{name} = {value}\n", key.doc),
                            None => format!("# {}\n# {name} = {}\n", key.doc, self::example(key.path)),
                        };
                    }
                    _ => {}
                }
            }
        }
        out
    }
}

/// What a key that is not set could be.
fn example(path: &str) -> &'static str {
    match path {
        "server.tls_cert" => "\"/etc/outrigger/cert.pem\"",
        "server.tls_key" => "\"/etc/outrigger/key.pem\"",
        "storage.folder" => "\"/var/lib/outrigger\"",
        "printer.name" => "\"The Prusa in the cellar\"",
        "printer.baud" => "115200",
        "printer.material" => "\"pla\"",
        "printer.webcam_url" => "\"http://192.168.1.20/stream\"",
        _ => "\"\"",
    }
}

/// Scheme, host and port of a webcam's address, for the page's content security policy; nothing
/// that could end a directive.
pub(crate) fn webcam_origin(url: &str) -> Option<&str> {
    let host_at = ["http://", "https://"].iter().find(|scheme| url.starts_with(**scheme))?.len();
    let end = url[host_at..].find(['/', '?', '#']).map_or(url.len(), |at| host_at + at);
    let origin = &url[..end];
    let plain = |c: char| c.is_ascii_alphanumeric() || ".:-[]/".contains(c);
    (end > host_at && origin.chars().all(plain)).then_some(origin)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PRINTER: &str = "[[printer]]\nid='a'\nprofile='ender-3'\nport='/dev/ttyUSB0'\n";

    /// `expect`: a part of what is said; empty: it is valid.
    fn check(text: &str, expect: &str) {
        match Config::parse(text) {
            Ok(_) => assert_eq!(expect, "", "{text:?} passed"),
            Err(found) => {
                let said = found.to_string();
                assert!(!expect.is_empty() && said.contains(expect), "{text:?}: {said}");
            }
        }
    }

    #[test]
    fn a_fault_is_told_with_its_line_and_the_nearest_name() {
        check("", "");
        check(PRINTER, "");
        check(
            "[server]\nlistne=['127.0.0.1:1']",
            "line 2: unknown key server.listne; did you mean server.listen?",
        );
        check("[servr]\n", "did you mean server?");
        check("[server]\nlisten=['localhost']", "line 2");
        check("[server]\ntls_cert='a'", "tls_key");
        check("[log]\nlevel='inof'", "did you mean \"info\"?");
        check("[[printer]]\nid='a'\nprofile='ender-3'", "printer.port is missing");
        check("[[printer]]\nid='a'\nprofile='endr-3'\nport='auto'", "did you mean ender-3?");
        check("[[printer]]\nid='a/b'\nprofile='ender-3'\nport='auto'", "letters, digits");
        check(&format!("{PRINTER}{PRINTER}"), "two printers have the id");
        let second = PRINTER.replace("id='a'", "id='b'");
        check(&format!("{PRINTER}{second}"), "the same port");
        check(&format!("{PRINTER}webcam_url='ftp://x'"), "http://");
        check(&format!("{PRINTER}on_findings='held'"), "did you mean \"hold\"?");
        check("?", "line 1");
    }

    #[test]
    fn what_is_printed_loads_as_the_same() {
        let full =
            "[server]\nlisten=['127.0.0.1:1']\ntls_cert='/c'\ntls_key='/k'\ntrusted_proxies=['10.0.0.1']\n";
        for text in ["", PRINTER, full, &format!("{full}{PRINTER}baud=250000\nwebcam_url='http://c/x'\n")] {
            let config = Config::parse(text).unwrap();
            let printed = config.explain();
            assert_eq!(
                Config::parse(&printed).unwrap_or_else(|e| panic!("{e}\n{printed}")),
                config,
                "{printed}"
            );
            for key in KEYS.iter().filter(|key| key.path.contains('.')) {
                let name = key.path.rsplit('.').next().unwrap();
                assert!(printed.contains(&format!("{name} = ")), "{name} in\n{printed}");
            }
        }
    }

    #[test]
    fn only_an_origin_enters_the_pages_policy() {
        let check = |url, expect: Option<&str>| assert_eq!(webcam_origin(url), expect, "{url}");
        check("http://cam.local:8080/stream?x", Some("http://cam.local:8080"));
        check("https://[::1]/", Some("https://[::1]"));
        check("http://a;script-src *", None);
        check("javascript:alert(1)", None);
        check("http://", None);
    }

    proptest::proptest! {
        #[test]
        fn no_text_makes_it_panic(text in "(\\[{1,2}(printer|server|log|x)\\]{1,2}\n)?([a-z_]{1,9}=(['\\[{]?[a-z0-9.:']{0,9}[\\]}]?)\n){0,4}") {
            let _ = Config::parse(&text);
        }
    }
}
