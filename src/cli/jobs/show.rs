//! `outrigger jobs show ID`: all that is known of a job, and what can be done.
use super::facts::{Next, hex, is_orphan, json, next, percent, state_words};
use super::list::now_unix_s;
use super::when::{ago, date};
use crate::cli::say;
use crate::job::disk::{Entry, JobId, Store, StoreError};
use crate::job::journal::Picture;
use crate::job::record::{Checkpoint, Log};
use crate::station::escape::printable;
use anyhow::bail;
use std::process::ExitCode;

pub(super) fn run(store: Option<&Store>, id: JobId, as_json: bool) -> anyhow::Result<ExitCode> {
    let store = store.ok_or(StoreError::NoJob(id))?;
    let entry = store.look(id)?;
    if as_json {
        say(&serde_json::to_string_pretty(&json(&entry))?);
        return Ok(ExitCode::SUCCESS);
    }
    match &entry.picture {
        Ok(picture) => say(&text(&entry, picture, now_unix_s())),
        Err(error) => bail!(
            "job {id}: {}. Its records are in {}: keep a copy if you want somebody to look at them, then \
             `outrigger jobs forget {id} --yes`. If a part is on the bed, it cannot be resumed",
            printable(&error.to_string()),
            printable(&store.path().join("jobs").join(format!("{id}.journal")).display().to_string()),
        ),
    }
    Ok(ExitCode::SUCCESS)
}

fn text(entry: &Entry, picture: &Picture, now_unix_s: u64) -> String {
    let log = &picture.log;
    let accepted = &log.accepted;
    let time = |at| format!("{}, {}", date(at), ago(at, now_unix_s));
    let mut rows = vec![
        ("state", state_words(log, entry.live)),
        ("file", printable(&accepted.path.to_string_lossy())),
        ("holds", format!("{} bytes, {} commands", accepted.bytes, accepted.commands)),
        ("SHA-256", hex(&accepted.digest)),
        ("profile", printable(&accepted.profile)),
        ("accepted", time(accepted.at_unix_s)),
    ];
    if let Some((port, baud, at)) = &log.opened {
        let times = match log.starts {
            1 => String::new(),
            n => format!(" (the {n}th time)"),
        };
        rows.push(("port", format!("{} at {baud} baud", printable(port))));
        rows.push(("opened", time(*at) + &times));
    }
    if log.checkpoint.commands > 0 {
        rows.push(("done", done(log)));
        rows.extend(temperatures(&log.checkpoint).map(|text| ("measured", text)));
    }
    if let Some(z_mm) = log.made_safe {
        let at = z_mm.map_or(String::new(), |z| format!("; the nozzle is at Z {z:.2} mm"));
        rows.push(("made safe", format!("the cancel macro has run{at}")));
    }
    rows.extend(log.note.as_ref().map(|note| ("note", printable(note))));
    let width = rows.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
    let mut text = format!("job {}\n", entry.id);
    for (name, value) in rows {
        text += &format!("  {name:width$}  {value}\n");
    }
    text += "\n";
    text + &advice(entry, picture)
}

fn done(log: &Log) -> String {
    let at = &log.checkpoint;
    let layer = match at.layer {
        0 => String::new(),
        layer => format!(", layer {layer}"),
    };
    format!(
        "{:.0} %: {} commands, to line {} of the file{layer}, Z {:.2} mm",
        percent(log).floor(),
        at.commands,
        at.line,
        at.z_mm,
    )
}

/// As the printer told them at the last checkpoint; a printer that tells none has zeros.
fn temperatures(at: &Checkpoint) -> Option<String> {
    let heater = |name, [is, wanted]: [f32; 2]| format!("{name} {is:.0} of {wanted:.0} °C");
    let told = [at.nozzle_c, at.bed_c].iter().flatten().any(|c| *c != 0.0);
    told.then(|| format!("{}, {}", heater("nozzle", at.nozzle_c), heater("bed", at.bed_c)))
}

/// What is certain of a job that is not what it should be, and what to do.
fn advice(entry: &Entry, picture: &Picture) -> String {
    let (id, log) = (entry.id, &picture.log);
    let mut lines = Vec::new();
    if log.damaged {
        lines.push(
            "Its records were damaged in their middle, so it may be further than they say: the disk or card \
             loses what was written."
                .to_owned(),
        );
    } else if let Some(cut) = picture.cut
        && !entry.live
    {
        lines.push(format!(
            "The last {} bytes of its records were being written when the power went.",
            cut.bytes
        ));
    }
    if entry.live {
        lines.push("An outrigger is at work on it now.".to_owned());
    }
    if is_orphan(log, entry.live) {
        lines.push(match log.made_safe {
            Some(_) => "Whoever printed it is gone; the printer was made safe.".to_owned(),
            None => "Whoever printed it is gone without a word: HEATERS MAY BE ON.".to_owned(),
        });
    }
    for next in next(log, entry.live) {
        lines.push(match next {
            Next::Resume => format!("`outrigger jobs resume {id}` asks the printer where it is and goes on."),
            Next::Print => "`outrigger print` with this file and profile starts it.".to_owned(),
            Next::Forget if log.state.is_over() || log.starts == 0 => {
                format!("`outrigger jobs forget {id}` removes it from the list.")
            }
            Next::Forget => format!("`outrigger jobs forget {id} --yes` gives it up."),
        });
    }
    lines.join("\n")
}
