//! Announces the daemon in the local network (mDNS), so that slicers and apps find it: the one file
//! that names mdns-sd.
use mdns_sd::{ServiceDaemon, ServiceInfo};

/// What OctoPrint's clients look for.
const SERVICE: &str = "_octoprint._tcp.local.";

/// An announcement that lasts until it is dropped.
pub(crate) struct Announced {
    daemon: ServiceDaemon,
    name: String,
}

/// Announces a port under a name. `uuid` stays the same over restarts.
///
/// # Errors
/// The network's or the system's, in words.
pub(crate) fn announce(name: &str, port: u16, uuid: &str, model: &str) -> Result<Announced, String> {
    let told = |e: mdns_sd::Error| e.to_string();
    let daemon = ServiceDaemon::new().map_err(told)?;
    let label: String =
        name.chars().map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' }).collect();
    let host = format!("{}.local.", label.trim_matches('-'));
    let txt = [("path", "/"), ("version", "1.9.0"), ("api", "0.1"), ("model", model), ("uuid", uuid)];
    let info = ServiceInfo::new(SERVICE, name, &host, "", port, &txt[..]).map_err(told)?.enable_addr_auto();
    let full = info.get_fullname().to_owned();
    daemon.register(info).map_err(told)?;
    Ok(Announced { daemon, name: full })
}

impl Drop for Announced {
    fn drop(&mut self) {
        // Others forget us at once instead of after an hour.
        if let Ok(done) = self.daemon.unregister(&self.name) {
            let _ = done.recv_timeout(std::time::Duration::from_millis(200));
        }
        let _ = self.daemon.shutdown();
    }
}
