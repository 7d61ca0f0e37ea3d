//! The record of executed commands as a file, a line each.
//!
//! ```text
//! seconds  number  X Y Z  ran  command
//! 12.345678 17 10.000 20.000 0.200 whole G1 X10 Y20 E1
//! 12.400000 - 10.000 20.000 0.200 broken G1 X50 E3
//! ```
//! X, Y and Z say where the nozzle really was at its end, in mm; `-` stands for a line
//! without a number. Written as it happens, so that a reader can follow.
use super::super::Executed;
use super::MockError;
use std::fs::File;
use std::io::Write;
use std::path::PathBuf;

/// The file, and its name for errors.
#[derive(Debug)]
pub(super) struct Log {
    path: PathBuf,
    file: File,
}

impl Log {
    /// Makes the file anew.
    pub(super) fn create(path: PathBuf) -> Result<Self, MockError> {
        match File::create(&path) {
            Ok(file) => Ok(Self { path, file }),
            Err(source) => Err(MockError::Log { path, source }),
        }
    }

    pub(super) fn write(&mut self, executed: &[Executed]) -> Result<(), MockError> {
        if executed.is_empty() {
            return Ok(());
        }
        let text: String = executed.iter().map(line).collect();
        let failed = |source| MockError::Log { path: self.path.clone(), source };
        self.file.write_all(text.as_bytes()).map_err(failed)
    }
}

fn line(executed: &Executed) -> String {
    let number = executed.number.map_or_else(|| "-".to_owned(), |n| n.to_string());
    let [x, y, z] = executed.at_mm;
    let ran = if executed.whole { "whole" } else { "broken" };
    let seconds = executed.at_ns as f64 / 1e9;
    format!("{seconds:.6} {number} {x:.3} {y:.3} {z:.3} {ran} {}\n", executed.command)
}
