//! Uploaded files: kept, looked at, removed, and which of them give way.
use super::{Foreman, Place, Refusal};
use crate::server::inspect::{For, Work, is_resin};
use crate::server::model::{Check, CheckState, File};
use std::collections::BTreeMap;
use std::path::Path;

impl Foreman {
    pub(super) fn uploaded(
        &mut self,
        upload: tempfile::NamedTempFile,
        file: File,
        printer: Option<&str>,
    ) -> Result<File, Refusal> {
        if let Some(printer) = printer {
            self.fits(upload.path(), &file.name, printer)?;
        }
        self.make_room(file.bytes);
        self.means.shelf.keep(upload, &file)?;
        let id = file.id.clone();
        self.means.view.show_file(file.clone());
        self.files.insert(id.clone(), file);
        if let Some(printer) = printer {
            self.look(&id, printer);
        }
        Ok(self.files[&id].clone())
    }

    /// The oldest files that no job needs give way.
    pub(super) fn make_room(&mut self, bytes: u64) {
        let total = |files: &BTreeMap<String, File>| files.values().map(|f| f.bytes).sum::<u64>();
        let mut by_age: Vec<_> = self.files.values().map(|f| (f.uploaded_unix_s, f.id.clone())).collect();
        by_age.sort();
        for (_, id) in by_age {
            if total(&self.files).saturating_add(bytes) <= self.means.keep_bytes {
                return;
            }
            let _ = self.remove(&id);
        }
    }

    pub(super) fn remove(&mut self, id: &str) -> Result<(), Refusal> {
        if !self.files.contains_key(id) {
            return Err(Refusal::NoSuch("file"));
        }
        if let Some(job) = self.jobs.values().find(|job| job.file == id && !job.state.is_over()) {
            let words = format!("job {} needs it ({}): cancel that first", job.id, job.state.words());
            return Err(Refusal::Conflict(words));
        }
        self.means.shelf.remove_file(id)?;
        self.files.remove(id);
        self.means.view.gone("file", id);
        Ok(())
    }

    /// Refuses a file of the other kind: pictures for a nozzle, or lines for a display.
    pub(super) fn fits(&self, content: &Path, name: &str, printer: &str) -> Result<(), Refusal> {
        let Some(place) = self.places.get(printer) else { return Ok(()) };
        let shown = place.config.name.as_deref().unwrap_or(printer);
        let words = match (is_resin(content), place.wants.resin) {
            (true, false) => {
                format!("{name} is a resin job, and {shown} prints filament: send it to a resin printer")
            }
            (false, true) => format!(
                "{name} is no resin job (SL1, NanoDLP, GOO), and {shown} is a resin printer: its jobs are pictures. \
                 Slice the part for resin"
            ),
            _ => return Ok(()),
        };
        Err(Refusal::Unfit(words))
    }

    /// Has a file looked at for a printer, unless that is done or on its way.
    pub(super) fn look(&mut self, id: &str, printer: &str) {
        let Some(of) = self.of(printer) else { return };
        let Some(file) = self.files.get_mut(id) else { return };
        let known = file.checks.get(printer).is_some_and(|check| check.state != CheckState::Waiting);
        if known {
            return;
        }
        file.checks.insert(printer.to_owned(), Check { state: CheckState::Checking, ..Check::default() });
        let work = Work::Look { file: id.to_owned(), name: file.name.clone(), of };
        self.means.view.show_file(file.clone());
        let _ = self.means.work.send(work);
    }

    pub(super) fn of(&self, printer: &str) -> Option<For> {
        let Place { config, wants, .. } = self.places.get(printer)?;
        Some(For {
            resin: wants.resin,
            printer: printer.to_owned(),
            profile: config.profile.clone(),
            material: config.material.clone(),
            reorder: config.reorder,
        })
    }
}
