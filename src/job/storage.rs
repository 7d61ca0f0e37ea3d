//! The medium of a journal, as an interface: the seam at which tests cut the power.
pub mod sim;

use std::io;

/// One append-only file with a whole-file replacement, as file systems promise them:
/// what was written is there after a crash only if a sync came after it, and
/// otherwise may be there in any part.
pub trait Storage {
    /// All bytes of the file, at most `max`; `None`: there is no such file.
    ///
    /// # Errors
    /// The medium's, or there are more bytes.
    fn read(&mut self, max: usize) -> io::Result<Option<Vec<u8>>>;

    /// Writes bytes at an offset, which may lie inside the file (a tail that was
    /// allocated ahead) or at its end.
    ///
    /// # Errors
    /// The medium's; any part of the bytes may then be there.
    fn write(&mut self, offset: u64, bytes: &[u8]) -> io::Result<()>;

    /// Returns once all that was written is on the medium.
    ///
    /// # Errors
    /// The medium's; what was written since the last sync may or may not be there.
    fn sync(&mut self) -> io::Result<()>;

    /// Replaces the whole file in one step that a crash does or does not survive as a
    /// whole: temporary file, sync, rename, sync of the folder. Also makes the file.
    ///
    /// # Errors
    /// The medium's; either file may then be there, whole: nothing but another
    /// replacement makes it certain.
    fn replace(&mut self, bytes: &[u8]) -> io::Result<()>;
}
