//! Post-processes every job in a folder and prints a table of what changed.
//!
//! `cargo run --release --example reorder_table -- [--markdown] DIR [DIR…]`
//!
//! Takes folders, searched with their subfolders for `.gcode`, `.gco` and `.g`, also with
//! `.gz` after it, or single files; changes none of them. Each row is one job: what the
//! report of `post` says, before and after. A row is marked `WORSE` when the
//! output has more lifts, retractions, travel or estimated time than the slicer's
//! own order; then, and when a file cannot be read
//! or `post` fails, the exit status is 1.
use anyhow::{Context, bail, ensure};
use flate2::read::MultiGzDecoder;
use outrigger::post::report::Report;
use outrigger::post::{Options, post};
use std::fs::File;
use std::io::{Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

/// Rounding of sums over a whole file, mm and s.
const ROUNDING: f64 = 1e-6;

/// Largest job after decompression, bytes: a small archive may hold anything.
const MAX_JOB_BYTES: u64 = 2 << 30;

/// Folders are searched this deep: a link that leads back to its folder ends somewhere.
const MAX_DEPTH: usize = 16;

const ENDINGS: [&str; 3] = [".gcode", ".gco", ".g"];

/// One job, done.
struct Row {
    name: String,
    bytes: u64,
    report: Report,
}

fn main() -> anyhow::Result<ExitCode> {
    let mut markdown = false;
    let mut roots = Vec::new();
    for arg in std::env::args_os().skip(1) {
        match arg.to_str() {
            Some("--markdown") => markdown = true,
            Some(flag) if flag.starts_with('-') => {
                bail!("unknown flag {flag}; usage: [--markdown] DIR [DIR…]")
            }
            _ => roots.push(PathBuf::from(arg)),
        }
    }
    ensure!(!roots.is_empty(), "no folder named; usage: [--markdown] DIR [DIR…]");
    let mut rows = Vec::new();
    let mut failed = false;
    for root in &roots {
        let mut files = Vec::new();
        find(root, 0, &mut files).with_context(|| format!("cannot search {}", root.display()))?;
        files.sort();
        ensure!(!files.is_empty(), "{}: no {} (or .gz of one)", root.display(), ENDINGS.join(", "));
        for path in files {
            match process(&path) {
                Ok(row) => rows.push(row),
                Err(error) => {
                    eprintln!("{}: {error:#}", path.display());
                    failed = true;
                }
            }
        }
    }
    let worse = rows.iter().any(|row| !row.faults().is_empty());
    let table = Table::of(&rows);
    let printed = if markdown { table.markdown() } else { table.aligned() };
    let mut out = std::io::stdout().lock();
    // A reader that has gone away is no error of ours.
    let _ = out.write_all(printed.as_bytes()).and_then(|()| out.write_all(verdict(&rows).as_bytes()));
    Ok(ExitCode::from(u8::from(worse || failed)))
}

fn find(path: &Path, depth: usize, files: &mut Vec<PathBuf>) -> std::io::Result<()> {
    if !path.is_dir() {
        files.push(path.to_owned());
        return Ok(());
    }
    if depth > MAX_DEPTH {
        return Ok(());
    }
    for entry in std::fs::read_dir(path)? {
        let path = entry?.path();
        let name = path.file_name().map(|n| n.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        let plain = name.strip_suffix(".gz").unwrap_or(&name);
        if path.is_dir() || ENDINGS.iter().any(|ending| plain.ends_with(ending)) {
            find(&path, depth + 1, files)?;
        }
    }
    Ok(())
}

fn process(path: &Path) -> anyhow::Result<Row> {
    let mut input = open(path)?;
    let bytes = input.metadata()?.len();
    let mut output = tempfile::tempfile().context("no temporary file for the result")?;
    let started = Instant::now();
    let mut report = post(&mut input, &mut output, Options::default(), &|_| ())?;
    report.seconds = started.elapsed().as_secs_f64();
    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let name =
        ENDINGS.iter().fold(name.trim_end_matches(".gz"), |name, e| name.strip_suffix(e).unwrap_or(name));
    Ok(Row { name: name.to_owned(), bytes, report })
}

/// The job as a file that can be read twice; a compressed one is unpacked beside the road.
fn open(path: &Path) -> anyhow::Result<File> {
    let file = File::open(path)?;
    if path.extension().is_none_or(|ending| !ending.eq_ignore_ascii_case("gz")) {
        return Ok(file);
    }
    let mut plain = tempfile::tempfile().context("no temporary file to unpack into")?;
    let mut unpacked = MultiGzDecoder::new(file).take(MAX_JOB_BYTES + 1);
    let bytes = std::io::copy(&mut unpacked, &mut plain).context("cannot unpack")?;
    ensure!(bytes <= MAX_JOB_BYTES, "more than {MAX_JOB_BYTES} bytes when unpacked");
    plain.rewind()?;
    Ok(plain)
}

impl Row {
    /// What got worse; nothing must.
    fn faults(&self) -> Vec<&'static str> {
        let r = &self.report;
        let more = |before: f64, after: f64| after > before + ROUNDING || after.is_nan();
        [
            ("lifts", r.lifts_after > r.lifts_before),
            ("retractions", r.retractions_after > r.retractions_before),
            ("travel", more(r.travel_mm_before, r.travel_mm_after)),
            ("time", more(r.time_s_before, r.time_s_after)),
        ]
        .into_iter()
        .filter_map(|(what, worse)| worse.then_some(what))
        .collect()
    }

    /// Verified, or why the file stays as it is.
    fn result(&self) -> String {
        let faults = self.faults();
        match &self.report.unchanged_reason {
            _ if !faults.is_empty() => format!("WORSE: {}", faults.join(", ")),
            Some(why) => why.clone(),
            None => "verified".to_owned(),
        }
    }
}

/// The sum of all rows, as a row.
fn total(rows: &[Row]) -> Row {
    let mut sum = Report::default();
    for Row { report: r, .. } in rows {
        sum.sections += r.sections;
        sum.sections_changed += r.sections_changed;
        sum.beads_before += r.beads_before;
        sum.beads_after += r.beads_after;
        sum.jumps_before += r.jumps_before;
        sum.jumps_after += r.jumps_after;
        sum.retractions_before += r.retractions_before;
        sum.retractions_after += r.retractions_after;
        sum.lifts_before += r.lifts_before;
        sum.lifts_after += r.lifts_after;
        sum.travel_mm_before += r.travel_mm_before;
        sum.travel_mm_after += r.travel_mm_after;
        sum.time_s_before += r.time_s_before;
        sum.time_s_after += r.time_s_after;
        sum.seconds += r.seconds;
    }
    Row { name: "total".to_owned(), bytes: rows.iter().map(|r| r.bytes).sum(), report: sum }
}

fn verdict(rows: &[Row]) -> String {
    let changed = rows.iter().filter(|r| r.report.unchanged_reason.is_none()).count();
    let worse: Vec<&str> = rows.iter().filter(|r| !r.faults().is_empty()).map(|r| r.name.as_str()).collect();
    let nothing_worse = if worse.is_empty() {
        "none has more lifts, retractions, travel or time than the slicer's own order".to_owned()
    } else {
        format!("WORSE than the slicer's own order: {}", worse.join(", "))
    };
    format!(
        "\n{} files: {changed} reordered and verified, {} left as they were; {nothing_worse}.\n",
        rows.len(),
        rows.len() - changed
    )
}

// ------------------------------------------------------------------- table

/// Heads of the columns; the first and the last are text, the others numbers.
const HEADS: [&str; 12] = [
    "file",
    "sections",
    "beads",
    "jumps",
    "retractions",
    "lifts",
    "travel, m",
    "%",
    "time, s",
    "took, s",
    "MB/s",
    "result",
];

/// Longest file name shown, so that a row stays within 160 columns.
const NAME_CHARS: usize = 34;

/// Longest result shown in the aligned table.
const RESULT_CHARS: usize = 28;

struct Table {
    cells: Vec<[String; HEADS.len()]>,
}

/// `before→after`, or the one number where nothing changed.
fn change(before: impl ToString, after: impl ToString) -> String {
    let (before, after) = (before.to_string(), after.to_string());
    if before == after { before } else { format!("{before}→{after}") }
}

fn cells(row: &Row) -> [String; HEADS.len()] {
    let r = &row.report;
    let metres = |mm: f64| format!("{:.2}", mm / 1e3);
    let percent =
        if r.travel_mm_before > 0.0 { (r.travel_mm_after / r.travel_mm_before - 1.0) * 100.0 } else { 0.0 };
    [
        row.name.clone(),
        format!("{}/{}", r.sections_changed, r.sections),
        change(r.beads_before, r.beads_after),
        change(r.jumps_before, r.jumps_after),
        change(r.retractions_before, r.retractions_after),
        change(r.lifts_before, r.lifts_after),
        change(metres(r.travel_mm_before), metres(r.travel_mm_after)),
        // Adding zero takes the sign from a rounded -0.0.
        format!("{:.1}", (percent * 10.0).round() / 10.0 + 0.0),
        change(format!("{:.0}", r.time_s_before), format!("{:.0}", r.time_s_after)),
        format!("{:.2}", r.seconds),
        format!("{:.0}", row.bytes as f64 / 1e6 / r.seconds.max(1e-9)),
        row.result(),
    ]
}

impl Table {
    fn of(rows: &[Row]) -> Table {
        let sum = total(rows);
        let mut cells: Vec<_> = rows.iter().map(cells).collect();
        let mut last = self::cells(&sum);
        last[HEADS.len() - 1] = String::new();
        cells.push(last);
        Table { cells }
    }

    /// In columns, names and reasons cut short.
    fn aligned(&self) -> String {
        let heads = HEADS.map(str::to_owned);
        let rows: Vec<[String; HEADS.len()]> = std::iter::once(&heads)
            .chain(&self.cells)
            .map(|row| {
                let mut row = row.clone();
                row[0] = shortened(&row[0], NAME_CHARS);
                row[HEADS.len() - 1] = shortened(&row[HEADS.len() - 1], RESULT_CHARS);
                row
            })
            .collect();
        let mut widths = [0; HEADS.len()];
        for row in &rows {
            for (width, cell) in widths.iter_mut().zip(row) {
                *width = (*width).max(cell.chars().count());
            }
        }
        let rule = "─".repeat(widths.iter().sum::<usize>() + HEADS.len() - 1) + "\n";
        let mut out = String::new();
        for (k, row) in rows.iter().enumerate() {
            let cell = |(k, cell): (usize, &String)| {
                let width = widths[k];
                if k == 0 || k == HEADS.len() - 1 {
                    format!("{cell:<width$}")
                } else {
                    format!("{cell:>width$}")
                }
            };
            let line: Vec<String> = row.iter().enumerate().map(cell).collect();
            if k == 1 || k + 1 == rows.len() {
                out += &rule;
            }
            out += line.join(" ").trim_end();
            out.push('\n');
        }
        out
    }

    fn markdown(&self) -> String {
        let line = |row: &[String]| {
            let cells: Vec<String> = row.iter().map(|cell| cell.replace('|', "\\|")).collect();
            format!("| {} |\n", cells.join(" | "))
        };
        let mut out = line(&HEADS.map(str::to_owned));
        out += &format!("|---|{}---|\n", "--:|".repeat(HEADS.len() - 2));
        for row in &self.cells {
            out += &line(row);
        }
        out
    }
}

fn shortened(text: &str, chars: usize) -> String {
    if text.chars().count() <= chars {
        return text.to_owned();
    }
    text.chars().take(chars - 1).chain(['…']).collect()
}
