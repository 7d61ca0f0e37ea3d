//! A job beside the printer that would print it: `outrigger check --printer NAME`.
use crate::causes;
use crate::printer::job_file::{self, JobError};
use crate::printer::preflight::{Bears, Finding, Melts, Preflight, Volume};
use crate::profile::material::{MaterialKind, TemperatureRange};
use crate::profile::printer::{BedShape, Origin};
use crate::profile::{Fdm, Profile, load_material, load_printer};
use crate::report::check::{Amiss, Printer};
use crate::resin::job::Job;
use crate::station::resin::told;
use anyhow::ensure;
use std::io::{Read, Seek};

/// What a printer could not do of a job, in this material where it is known.
///
/// # Errors
/// There is no such profile, or it is a resin printer's.
pub(super) fn beside(name: &str, material: Option<&str>, job: impl Read) -> anyhow::Result<Printer> {
    let profile = load_printer(name)?;
    let bears = bears(&profile, profile.want_fdm()?, material)?;
    let mut preflight = Preflight::new(bears);
    let max_line = profile.serial.max_line.map(|bytes| bytes as usize);
    let checked = job_file::check(job, max_line, |number, line| preflight.line(number, line));
    let mut findings: Vec<Amiss> = checked.err().iter().map(refused).collect();
    // Where the rest was not read, nothing can be said of its end.
    let whole = findings.is_empty();
    let of_whole = |f: &Finding| whole || !f.kind.is_of_the_end();
    let told = |f: Finding| Amiss {
        kind: f.kind.key(),
        line: f.line,
        lines: f.lines,
        worst: f.worst,
        words: f.words(&bears),
    };
    findings.extend(preflight.finish().into_iter().filter(of_whole).map(told));
    Ok(Printer { name: profile.name, findings })
}

/// The same of a resin job: its pictures and exposures beside this printer's panel, light and plate.
///
/// # Errors
/// There is no such profile, or it is one of filament.
pub(super) fn beside_resin<R: Read + Seek>(name: &str, job: &Job<R>) -> anyhow::Result<Printer> {
    let profile = load_printer(name)?;
    ensure!(profile.msla().is_some(), "{} prints filament, and this is a resin job", profile.name);
    let unfit = |why: anyhow::Error| Amiss {
        kind: "unfit",
        line: 0,
        lines: 0,
        worst: 0.0,
        words: causes::line(&why),
    };
    let findings = told(job, &profile).err().map(unfit).into_iter().collect();
    Ok(Printer { name: profile.name, findings })
}

/// A job that would not be sent at all.
fn refused(error: &JobError) -> Amiss {
    let (kind, line) = match error {
        JobError::LineTooLong { line, .. } | JobError::LineTooBig { line } => ("line_too_long", *line),
        JobError::Binary { line } | JobError::Read { line, .. } => ("unreadable", *line),
        JobError::NotGcode { .. } | JobError::Empty => ("unreadable", 0),
    };
    Amiss { kind, line, lines: 1, worst: 0.0, words: error.to_string() }
}

fn bears(profile: &Profile, fdm: &Fdm, material: Option<&str>) -> anyhow::Result<Bears> {
    let bed = profile.bed;
    let [x, y, z] = [bed.x_mm, bed.y_mm, bed.z_mm].map(|mm| mm.0);
    let (low_mm, high) = match bed.origin {
        Origin::Corner => ([0.0; 2], [x, y]),
        Origin::Centre => ([-x / 2.0, -y / 2.0], [x / 2.0, y / 2.0]),
    };
    let range = |r: TemperatureRange| [r.min.0, r.max.0];
    let material = match material.map(load_material).transpose()?.map(|m| m.kind) {
        Some(MaterialKind::Filament(f)) => Some(Melts { nozzle_c: range(f.nozzle_c), bed_c: range(f.bed_c) }),
        Some(MaterialKind::Resin) | None => None,
    };
    Ok(Bears {
        volume: Volume { low_mm, high_mm: [high[0], high[1], z], round: bed.shape == BedShape::Circle },
        nozzle_max_c: fdm.limits.nozzle_c.0,
        bed_max_c: fdm.limits.bed_c.0,
        material,
        ends_jobs: !profile.macros.end.0.trim().is_empty(),
    })
}
