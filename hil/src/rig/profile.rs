//! Profile and job as a scenario needs them on a rig.
//!
//! Takes names and texts, gives texts. The program's port is a pseudo-terminal, which has no
//! DTR, so no profile may wait for what DTR does; and on a real printer the moves are lifted.
use super::{Rig, Sort};
use crate::play::DEFAULT_PROFILE;
use crate::scenario::Scenario;
use anyhow::Context;
use std::path::{Path, PathBuf};

/// The file of the profile that the scenario is printed with. `root` is the repository.
pub fn file(scenario: &Scenario, sort: Sort, rig: &Rig, root: &Path) -> PathBuf {
    let name = match sort {
        Sort::Real => &rig.profile,
        Sort::Mock | Sort::Virtual => scenario.printer.profile.as_ref().unwrap_or(&rig.profile),
    };
    let name = if name.is_empty() { DEFAULT_PROFILE } else { name };
    match name.ends_with(".toml") || name.contains('/') {
        true => PathBuf::from(name),
        false => root.join("profiles/printers").join(format!("{name}.toml")),
    }
}

/// A profile's text, changed to what the pseudo-terminal and the scenario want.
///
/// # Errors
/// It is no profile.
pub fn adapted(text: &str, window_lines: Option<usize>) -> anyhow::Result<String> {
    let mut profile: toml::Table = text.parse().context("the profile")?;
    let serial = profile.get_mut("serial").and_then(toml::Value::as_table_mut);
    let serial = serial.context("the profile has no [serial]")?;
    serial.insert("dtr_reset".to_owned(), false.into());
    if let Some(lines) = window_lines {
        let lines = i64::try_from(lines).context("window_lines")?;
        serial
            .insert("window".to_owned(), toml::Table::from_iter([("lines".to_owned(), lines.into())]).into());
    }
    Ok(profile.to_string())
}

/// A job's text with all its moves so much higher.
pub fn lifted(text: &str, lift_mm: f64) -> String {
    let word = |word: &str| match word.strip_prefix('Z').and_then(|z| z.parse::<f64>().ok()) {
        Some(z_mm) => format!("Z{:.2}", z_mm + lift_mm),
        None => word.to_owned(),
    };
    let line = |line: &str| match line.starts_with("G0 ") || line.starts_with("G1 ") {
        true => line.split(' ').map(word).collect::<Vec<_>>().join(" "),
        false => line.to_owned(),
    };
    text.lines().map(|l| line(l) + "\n").collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use outrigger::profile::load_printer;

    #[test]
    fn every_profile_can_be_adapted() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["ender-3", "generic-marlin", "anycubic-kossel-plus"] {
            let path =
                Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../profiles/printers/{name}.toml"));
            let text = adapted(&std::fs::read_to_string(path).unwrap(), Some(1)).unwrap();
            let path = folder.path().join("adapted.toml");
            std::fs::write(&path, text).unwrap();
            let profile = load_printer(&path.display().to_string()).unwrap();
            assert!(!profile.serial.dtr_reset);
        }
    }

    #[test]
    fn moves_are_lifted_and_nothing_else() {
        let text = "G28\nG1 X1.0 Y2.0 Z0.2 E0.05 F3000\nG1 X1.0 E0.1\nM117 Z3\n";
        let expect = "G28\nG1 X1.0 Y2.0 Z50.20 E0.05 F3000\nG1 X1.0 E0.1\nM117 Z3\n";
        assert_eq!(lifted(text, 50.0), expect);
    }
}
