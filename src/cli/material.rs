//! Which material a job is for, and what that bears.
use crate::detect::overhang::SelfSupport;
use crate::profile::material::MaterialKind;
use crate::profile::{load_material, material_names};
use crate::support::rules::Process;
use outrigger_gcode::dialect::settings::setting;
use outrigger_gcode::line::parse;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};

/// Bytes at each end of G-code in which a filament may be named: slicers write their
/// settings there.
const END_BYTES: u64 = 256 << 10;

/// What of a material matters before a job is printed.
pub(super) struct Printed {
    /// What holds itself.
    pub(super) own: SelfSupport,
    /// How it is made solid.
    pub(super) process: Process,
    /// The word for that: `filament` or `resin`.
    pub(super) kind: &'static str,
}

/// A material by its profile's name.
///
/// # Errors
/// There is no such profile, or it is wrong.
pub(super) fn printed(name: &str) -> anyhow::Result<Printed> {
    let material = load_material(name)?;
    let of = material.self_support;
    let process = match material.kind {
        MaterialKind::Filament(_) => Process::Filament,
        MaterialKind::Resin => Process::Resin,
    };
    Ok(Printed {
        own: SelfSupport { angle_deg: of.angle_deg, bridge_mm: of.bridge_mm, min_area_mm2: of.min_area_mm2 },
        process,
        kind: material.kind.word(),
    })
}

/// The profile of the filament that G-code names, if there is one.
pub(super) fn of_gcode(file: &mut (impl Read + Seek)) -> std::io::Result<Option<&'static str>> {
    file.seek(SeekFrom::Start(0))?;
    // Binary G-code has its settings at the beginning, and this makes them comments.
    let text = outrigger_gcode::bgcode::text(BufReader::new(&mut *file));
    let mut found = in_lines(text.take(END_BYTES));
    if found.is_none() {
        let length = file.seek(SeekFrom::End(0))?;
        file.seek(SeekFrom::Start(length.saturating_sub(END_BYTES)))?;
        found = in_lines(BufReader::new(&mut *file));
    }
    file.seek(SeekFrom::Start(0))?;
    Ok(found)
}

/// The first filament named that has a profile. Damage is left to the reader of the job.
fn in_lines(text: impl BufRead) -> Option<&'static str> {
    for line in text.split(b'\n') {
        let line = line.ok()?;
        let line = line.trim_ascii_end();
        let prusa = setting(&parse(line)).filter(|(key, _)| *key == "filament_type").map(|(_, value)| value);
        let cura = line.strip_prefix(b";MATERIAL_TYPE:").and_then(|v| std::str::from_utf8(v).ok());
        if let Some(name) = prusa.or(cura).and_then(profile_of) {
            return Some(name);
        }
    }
    None
}

/// The profile of a filament's type: `PETG;PETG`, `"PLA"`, `Nylon`.
fn profile_of(value: &str) -> Option<&'static str> {
    let first = value.split([';', ',']).next().unwrap_or_default();
    let word = first.trim().trim_matches('"').to_ascii_lowercase();
    let word = match word.as_str() {
        "nylon" => "pa",
        "flex" => "tpu",
        "pet" => "petg",
        other => other,
    };
    material_names().find(|name| *name == word)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    #[test]
    fn filaments_are_found_at_both_ends() {
        let check = |text: &str, expect: Option<&str>| {
            assert_eq!(of_gcode(&mut Cursor::new(text)).unwrap(), expect, "{}", &text[..text.len().min(40)]);
        };
        check("G28\n; filament_type = PETG\n", Some("petg"));
        check("G28\n; filament_type = ABS;PLA\n", Some("abs"));
        check("; filament_type = Nylon\n", Some("pa"));
        check("; filament_type = UNOBTAINIUM\n", None);
        check("G28\n", None);
        check(&format!("G28\n{}; filament_type = TPU\n", "G1 X1\n".repeat(200_000)), Some("tpu"));
    }
}
