//! What the journal writes in an hour of printing: what wears an SD card out.
//!
//! `cargo run --release --example journal_wear`
//!
//! Writes the records of an hour, at the pace of the host, to a simulated disk that
//! counts: a checkpoint every 512 commands or 5 s, whichever is first; for a printer
//! that does not report temperatures by itself also a number on the wire every 2 s
//! that is not the file's, each with a sync of its own. Bytes are the journal's own;
//! pages are the 4 KiB that a file system writes for them, its own metadata apart
//! (`docs/journal.md` says what comes upon that). Exit status 1 when an hour takes more
//! than the target.
use outrigger::job::journal::Journal;
use outrigger::job::record::{Accepted, Checkpoint, Record};
use outrigger::job::storage::sim::SimDisk;
use std::io::Write;
use std::process::ExitCode;

/// Most that an hour may write, MB (10⁶ bytes) of pages: a card of 16 GB that bears 300
/// times its size bears 240,000 such hours.
const TARGET_MB: f64 = 20.0;

/// Between two checkpoints at most, in ms and in commands.
const CHECKPOINT_MS: u64 = 5000;
const CHECKPOINT_COMMANDS: u64 = 512;

/// An hour, ms.
const HOUR_MS: u64 = 3_600_000;

/// A kind of job and of printer.
struct Case {
    name: &'static str,
    commands_per_s: u64,
    /// Between two questions for temperatures; none for a printer that reports by itself.
    poll_ms: Option<u64>,
}

const CASES: [Case; 4] = [
    Case { name: "large part, 10 moves/s", commands_per_s: 10, poll_ms: None },
    Case { name: "usual part, 60 moves/s", commands_per_s: 60, poll_ms: None },
    Case { name: "curves, 500 moves/s", commands_per_s: 500, poll_ms: None },
    Case { name: "60 moves/s, temperatures asked for", commands_per_s: 60, poll_ms: Some(2000) },
];

fn main() -> anyhow::Result<ExitCode> {
    let mut out = std::io::stdout();
    let mut missed = false;
    writeln!(
        out,
        "{:36} {:>6} {:>8} {:>10} {:>10}",
        "an hour of", "syncs", "rewrites", "own bytes", "pages, MB"
    )?;
    for case in &CASES {
        let disk = SimDisk::new(0);
        hour(case, &disk)?;
        let counts = disk.counts();
        let mb = (counts.pages * 4096) as f64 / 1e6;
        let mark = if mb > TARGET_MB { "MISSED" } else { "" };
        missed |= mb > TARGET_MB;
        let (syncs, rewrites) = (counts.syncs, counts.replaces);
        writeln!(out, "{:36} {syncs:>6} {rewrites:>8} {:>10} {mb:>10.2} {mark}", case.name, counts.bytes)?;
    }
    writeln!(out, "target: {TARGET_MB} MB of pages an hour")?;
    Ok(ExitCode::from(u8::from(missed)))
}

/// Writes an hour's records.
fn hour(case: &Case, disk: &SimDisk) -> anyhow::Result<()> {
    // A file of 20 MB: its digests are in every rewriting.
    let accepted = Accepted { chunks: vec![[0; 16]; 320], commands: u64::MAX, ..Accepted::default() };
    let mut journal = Journal::create(disk.clone(), accepted)?;
    journal.append(&Record::Numbers { first: 4, after: 0 });
    journal.sync()?;
    let (mut commands, mut told, mut told_ms, mut own) = (0, 0, 0, 0);
    for now_ms in (0..HOUR_MS).step_by(100) {
        commands += case.commands_per_s / 10;
        if case.poll_ms.is_some_and(|poll| now_ms % poll == 0) {
            own += 1;
            journal.append(&Record::Own { n: u32::try_from(4 + commands + own)? });
            journal.sync()?;
        }
        if commands - told >= CHECKPOINT_COMMANDS || now_ms - told_ms >= CHECKPOINT_MS {
            (told, told_ms) = (commands, now_ms);
            let at = Checkpoint { commands, line: commands, layer: 1, z_mm: 0.2, ..Checkpoint::default() };
            journal.append(&Record::Checkpoint(at));
            journal.sync()?;
        }
    }
    Ok(())
}
