//! Finding the printer again whose port has vanished.
use crate::job::run::Reopen;
use crate::printer::port::Port;
use std::future::Future;
use std::pin::Pin;
use std::time::Duration;

/// Where the printer was found, to find it again.
pub(in crate::cli) struct Place {
    /// The device.
    pub(in crate::cli) device: String,
    /// Bits per second.
    pub(in crate::cli) baud: u32,
}

/// Between two looks for a port that is gone.
const LOOK_EVERY: Duration = Duration::from_millis(250);

impl Reopen for Place {
    fn reopen(&self) -> Pin<Box<dyn Future<Output = Port>>> {
        let (device, baud) = (self.device.clone(), self.baud);
        Box::pin(async move {
            loop {
                tokio::time::sleep(LOOK_EVERY).await;
                if let Ok(port) = Port::open(&device, baud) {
                    return port;
                }
            }
        })
    }
}
