//! Jobs for the figures: short moves to and fro, to any number or size.
use outrigger::printer::mock::stats::Digest;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// Speed of all moves: what a planner of 16 blocks still reaches in moves of 0.05 mm
/// at the machine's 2500 mm/s².
const FEED_MM_S: f64 = 50.0;

/// A job on disk, and what the printer should have got of it at the end.
pub(crate) struct Job {
    pub(crate) path: PathBuf,
    pub(crate) bytes: u64,
    pub(crate) digest: String,
    pub(crate) commands: u64,
}

/// How long a job is.
#[derive(Clone, Copy)]
pub(crate) enum Length {
    Moves(u64),
    Bytes(u64),
}

impl Job {
    /// Moves that take `1 / moves_s` each, or somewhat more at the turns.
    pub(crate) fn write(folder: &Path, length: Length, moves_s: f64) -> std::io::Result<Job> {
        let path = folder.join("job.gcode");
        let mut file = BufWriter::new(File::create(&path)?);
        let (mut digest, mut bytes, mut line) = (Digest::default(), 0, Vec::new());
        let mut put = |line: &[u8]| {
            digest.add(line);
            bytes += line.len() as u64 + 1;
            file.write_all(line)?;
            file.write_all(b"\n")?;
            std::io::Result::Ok(bytes)
        };
        for start in ["G28", "M83", "G1 X1 Y1 Z0.2 F3000"] {
            put(start.as_bytes())?;
        }
        // A long job climbs again and again: Y stays on the bed.
        let (mut x_mm, mut step_mm) = (1.0, FEED_MM_S / moves_s);
        for n in 0_u64.. {
            x_mm += step_mm;
            if !(1.0..170.0).contains(&x_mm) {
                step_mm = -step_mm;
            }
            line.clear();
            write!(line, "G1 X{x_mm:.3} Y{:.4}", 1.0 + (n % 1_000_000) as f64 / 10_000.0)?;
            let bytes = put(&line)?;
            let done = match length {
                Length::Moves(moves) => n + 1 >= moves,
                Length::Bytes(least) => bytes >= least,
            };
            if done {
                break;
            }
        }
        file.flush()?;
        Ok(Job { path, bytes, digest: digest.hex(), commands: digest.lines() })
    }
}
