//! `outrigger jobs list`: all jobs, a line each.
use super::facts::{Json, file_name, json, percent, state_words};
use super::when::ago;
use crate::cli::say;
use crate::job::disk::{Entry, Store};
use crate::station::escape::printable;
use serde::Serialize;
use std::process::ExitCode;
use std::time::{SystemTime, UNIX_EPOCH};

/// What stands above the table.
const HEAD: [&str; 7] = ["id", "state", "done", "layer", "accepted", "port", "file"];

/// All jobs as JSON.
#[derive(Serialize)]
struct List {
    jobs: Vec<Json>,
}

pub(super) fn run(store: Option<&Store>, as_json: bool) -> anyhow::Result<ExitCode> {
    let entries = store.map_or(Ok(Vec::new()), Store::list)?;
    if as_json {
        let jobs = entries.iter().map(json).collect();
        say(&serde_json::to_string_pretty(&List { jobs })?);
    } else if entries.is_empty() {
        say("there are no jobs");
    } else {
        let now = now_unix_s();
        let rows: Vec<_> = entries.iter().map(|entry| row(entry, now)).collect();
        say(&table(&rows));
    }
    Ok(ExitCode::SUCCESS)
}

pub(super) fn now_unix_s() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs())
}

fn row(entry: &Entry, now_unix_s: u64) -> [String; 7] {
    let id = entry.id.to_string();
    let picture = match &entry.picture {
        Ok(picture) => picture,
        Err(error) => {
            let mut row = [const { String::new() }; 7];
            row[0] = id;
            row[1] = "unreadable".to_owned();
            row[6] = printable(&error.to_string());
            return row;
        }
    };
    let log = &picture.log;
    let layer = match log.checkpoint.layer {
        0 => "-".to_owned(),
        layer => layer.to_string(),
    };
    let port = log.opened.as_ref().map_or("-".to_owned(), |(port, ..)| printable(port));
    [
        id,
        state_words(log, entry.live),
        format!("{:.0} %", percent(log).floor()),
        layer,
        ago(log.accepted.at_unix_s, now_unix_s),
        port,
        file_name(log),
    ]
}

/// Columns as wide as what stands in them; the last has no end.
fn table(rows: &[[String; 7]]) -> String {
    let head = HEAD.map(str::to_owned);
    let all = || std::iter::once(&head).chain(rows);
    let wide = |column: usize| all().map(|row| row[column].chars().count()).max().unwrap_or(0);
    let widths: [usize; 7] = std::array::from_fn(wide);
    let line = |row: &[String; 7]| {
        let cells = row.iter().zip(widths).enumerate().map(|(column, (cell, width))| match column {
            0 | 2 | 3 => format!("{cell:>width$}"),
            6 => cell.clone(),
            _ => format!("{cell:width$}"),
        });
        cells.collect::<Vec<_>>().join("  ").trim_end().to_owned()
    };
    all().map(line).collect::<Vec<_>>().join("\n")
}
