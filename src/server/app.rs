//! What every route may reach: the view, the printers, the foreman's inbox, users and limits.
//!
//! Built once, shared by all connections. Nothing in it waits for a disk on the network's thread.
use super::actor::Handle;
use super::auth_desk::AuthDesk;
use super::config::{self, Config};
use super::foreman::view::View;
use super::foreman::{Answer, Message};
use super::model::{Bed, Limits, Link, Printer, PrinterKind};
use super::problem::Problem;
use super::shelf::Shelf;
use crate::profile::Profile;
use crate::profile::printer::{BedShape, Origin};
use crate::station::settings;
use std::sync::{Arc, mpsc};
use std::time::Instant;
use tokio::sync::oneshot;

/// A printer as the routes know it.
pub(crate) struct Station {
    pub(crate) config: config::Printer,
    pub(crate) profile: Profile,
    pub(crate) handle: Handle,
}

impl Station {
    /// What it prints with.
    pub(crate) fn kind(&self) -> PrinterKind {
        if self.profile.msla().is_some() { PrinterKind::Msla } else { PrinterKind::Fdm }
    }
}

/// See the module's text.
pub(crate) struct App {
    pub(crate) config: Config,
    pub(crate) shelf: Shelf,
    pub(crate) view: Arc<View>,
    pub(crate) stations: Vec<Station>,
    pub(crate) foreman: mpsc::Sender<Message>,
    pub(crate) auth: AuthDesk,
    pub(crate) again: super::again::Again,
    pub(crate) started: Instant,
    /// Names of files that OctoPrint's clients have selected, by printer.
    pub(crate) selected: std::sync::Mutex<std::collections::BTreeMap<String, String>>,
    /// What opens a Moonraker client's socket, once.
    pub(crate) oneshots: super::moonraker::oneshot::Oneshots,
}

impl App {
    /// A printer by its short name.
    ///
    /// # Errors
    /// There is none.
    pub(crate) fn station(&self, id: &str) -> Result<&Station, Problem> {
        self.stations.iter().find(|s| s.config.id == id).ok_or_else(|| Problem::no_such("printer"))
    }

    /// Has the foreman do something, and waits for what comes of it.
    ///
    /// # Errors
    /// What the foreman says.
    pub(crate) async fn ask<T>(&self, message: impl FnOnce(Answer<T>) -> Message) -> Result<T, Problem> {
        let (answer, told) = oneshot::channel();
        let gone = || Problem::internal("the foreman is gone: restart the daemon");
        self.foreman.send(message(answer)).map_err(|_| gone())?;
        Ok(told.await.map_err(|_| gone())??)
    }

    /// All printers as they are.
    pub(crate) fn printers(&self) -> Vec<Printer> {
        self.stations.iter().map(|station| self.printer(station)).collect()
    }

    /// A printer as it is.
    pub(crate) fn printer(&self, station: &Station) -> Printer {
        let Station { config, profile, handle } = station;
        let now = handle.board.picture();
        let place = self.view.place(&config.id);
        let words = match (now.link, now.words) {
            (Link::Busy, Some(words)) => words,
            (Link::Offline, _) => "let go, by a person's wish",
            (Link::Connecting, _) => "looking for the printer",
            (Link::Ready, _) => "ready",
            (Link::Busy, None) => "getting ready",
            (Link::Failed, _) => "broken down",
        };
        Printer {
            id: config.id.clone(),
            name: config.name.clone().unwrap_or_else(|| profile.title.clone()),
            profile: config.profile.clone(),
            kind: station.kind(),
            before: settings::asks(profile).into_iter().map(str::to_owned).collect(),
            state: now.link,
            state_words: words.to_owned(),
            error: now.error,
            firmware: now.firmware,
            temperatures: now.heat,
            // Nothing of a resin printer is heated.
            limits: profile.fdm().map_or(Limits { nozzle_c: 0.0, bed_c: 0.0 }, |fdm| Limits {
                nozzle_c: fdm.limits.nozzle_c.0,
                bed_c: fdm.limits.bed_c.0,
            }),
            bed_mm: Bed {
                x: profile.bed.x_mm.0,
                y: profile.bed.y_mm.0,
                z: profile.bed.z_mm.0,
                round: profile.bed.shape == BedShape::Circle,
                centred: profile.bed.origin == Origin::Centre,
            },
            bed_clear: place.bed_clear,
            job: now.job,
            progress: now.progress,
            question: now.question,
            waits_for_user: now.waits_for_user,
            plan: now.plan,
            on_findings: config.on_findings,
            webcam_url: config.webcam_url.clone(),
            queue: place.queue,
            messages: handle.board.messages(),
        }
    }
}
