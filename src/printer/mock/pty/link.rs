//! The symbolic link under which hosts find the terminal.
//!
//! Made and turned in one step, removed at the end if it is still ours; never
//! in the place of anything but a link to a terminal.
use super::{MockError, terminal};
use std::fs;
use std::path::{Path, PathBuf};

/// The name under which hosts find the terminal.
#[derive(Debug)]
pub(super) struct Link {
    pub(super) path: PathBuf,
    target: Option<PathBuf>,
    /// Where a link without a name of its own lives.
    _folder: Option<tempfile::TempDir>,
}

impl Link {
    pub(super) fn new(path: Option<PathBuf>, target: &Path) -> Result<Self, MockError> {
        let (path, folder) = match path {
            Some(path) => (path, None),
            None => {
                let folder = tempfile::Builder::new()
                    .prefix("outrigger-mock-")
                    .tempdir()
                    .map_err(|e| terminal("temporary folder", e))?;
                (folder.path().join("tty"), Some(folder))
            }
        };
        let mut link = Self { path, target: None, _folder: folder };
        link.point_to(target)?;
        Ok(link)
    }

    /// Makes the link or turns it, in one step.
    pub(super) fn point_to(&mut self, target: &Path) -> Result<(), MockError> {
        let failed = |source| MockError::Link { path: self.path.clone(), source };
        if let Ok(there) = fs::symlink_metadata(&self.path) {
            // A mock that was killed leaves its link; anything else is not ours.
            let stale =
                there.is_symlink() && fs::read_link(&self.path).is_ok_and(|to| to.starts_with("/dev/pts"));
            if !stale {
                return Err(MockError::LinkTaken { path: self.path.clone() });
            }
        }
        let mut name = self.path.file_name().unwrap_or_default().to_owned();
        name.push(format!(".{}.new", std::process::id()));
        let new = self.path.with_file_name(name);
        std::os::unix::fs::symlink(target, &new).map_err(failed)?;
        if let Err(e) = fs::rename(&new, &self.path) {
            let _ = fs::remove_file(&new);
            return Err(failed(e));
        }
        self.target = Some(target.to_owned());
        Ok(())
    }

    /// Removes the link if it is still ours.
    pub(super) fn remove(&mut self) {
        if let Some(target) = self.target.take()
            && fs::read_link(&self.path).is_ok_and(|to| to == target)
        {
            let _ = fs::remove_file(&self.path);
        }
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        self.remove();
    }
}
