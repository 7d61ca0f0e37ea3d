//! Uploaded files: kept, looked at, removed, and which of them give way.
use super::{Foreman, Refusal};
use crate::server::inspect::{For, Work};
use crate::server::model::{Check, CheckState, File};
use std::collections::BTreeMap;

impl Foreman {
    pub(super) fn uploaded(
        &mut self,
        upload: tempfile::NamedTempFile,
        file: File,
        printer: Option<&str>,
    ) -> Result<File, Refusal> {
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
        let config = &self.places.get(printer)?.config;
        Some(For {
            printer: printer.to_owned(),
            profile: config.profile.clone(),
            material: config.material.clone(),
            reorder: config.reorder,
        })
    }
}
