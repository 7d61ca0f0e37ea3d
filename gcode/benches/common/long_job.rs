//! A long job made of a short one: its layers, printed over and over.
//!
//! Takes a sliced job, gives one of any length: what comes before the second
//! layer, the layers from the second to the last as often as needed, and the rest.
//! At each seam the nozzle goes to where the layers begin, and absolute E is set
//! to what it was there, so that every repetition deposits what the original does.
//! Knows no file system.
use outrigger_gcode::dialect::{Detection, Dialect, Mark, detect};
use outrigger_gcode::line::{parse, split_lines};
use outrigger_gcode::state::{Effect, Machine};
use std::io::{self, Write};

/// How alike the filament must be pulled back at both ends of what is repeated, mm.
const SAME_DEPTH_MM: f64 = 1e-3;

/// See the module.
pub(crate) struct LongJob {
    head: Vec<u8>,
    layers: Vec<u8>,
    seam: Vec<u8>,
    tail: Vec<u8>,
    /// The slicer's.
    pub(crate) dialect: Dialect,
}

/// A layer mark, and the machine before it.
struct Place {
    byte: usize,
    machine: Machine,
    /// Filament pulled back, mm.
    depth_mm: f64,
}

impl LongJob {
    /// Finds what can be repeated; `None` where there are no two layers that begin alike.
    pub(crate) fn of(job: &[u8]) -> Option<LongJob> {
        let Detection::One(dialect) = detect(job) else { return None };
        let places = places(job, dialect);
        // The first layer is unlike the others: skirt, slower, its own settings.
        let (first, last) = places.iter().skip(1).enumerate().find_map(|(k, first)| {
            let last = places[k + 2..].iter().rev().find(|last| begins_like(first, last))?;
            Some((first, last))
        })?;
        let Machine { position: [x, y, z], offset, e, feed, .. } = first.machine;
        let mut seam = Vec::new();
        // Writing to a Vec cannot fail.
        let _ = writeln!(seam, "G0 F9000 X{:.3} Y{:.3}", x - offset[0], y - offset[1]);
        let _ = writeln!(seam, "G0 Z{:.3}", z - offset[2]);
        let _ = writeln!(seam, "G1 F{feed}");
        if first.machine.e_is_absolute() {
            let _ = writeln!(seam, "G92 E{e:.5}");
        }
        Some(LongJob {
            head: job[..first.byte].to_vec(),
            layers: job[first.byte..last.byte].to_vec(),
            seam,
            tail: job[last.byte..].to_vec(),
            dialect,
        })
    }

    /// Writes at least `bytes` bytes of job, by whole repetitions; gives how many it wrote.
    ///
    /// # Errors
    /// The writer's.
    pub(crate) fn write(&self, bytes: u64, mut out: impl Write) -> io::Result<u64> {
        out.write_all(&self.head)?;
        out.write_all(&self.layers)?;
        let mut written = (self.head.len() + self.layers.len()) as u64;
        while written + (self.tail.len() as u64) < bytes {
            out.write_all(&self.seam)?;
            out.write_all(&self.layers)?;
            written += (self.seam.len() + self.layers.len()) as u64;
        }
        out.write_all(&self.tail)?;
        out.flush()?;
        Ok(written + self.tail.len() as u64)
    }

    /// At least `bytes` bytes of job.
    pub(crate) fn bytes(&self, bytes: usize) -> Vec<u8> {
        let mut job = Vec::with_capacity(bytes + self.layers.len() + self.tail.len());
        // Writing to a Vec cannot fail.
        let _ = self.write(bytes as u64, &mut job);
        job
    }
}

fn begins_like(a: &Place, b: &Place) -> bool {
    let modes =
        |m: &Machine| (m.absolute, m.e_is_absolute(), m.inches, m.tool, m.firmware_retracted, m.offset);
    modes(&a.machine) == modes(&b.machine)
        && a.machine.absolute
        && !a.machine.inches
        && (a.depth_mm - b.depth_mm).abs() < SAME_DEPTH_MM
}

fn places(job: &[u8], dialect: Dialect) -> Vec<Place> {
    let mut places = Vec::new();
    let mut machine = Machine::default();
    let (mut filament, mut furthest) = (0.0f64, 0.0f64);
    let mut byte = 0;
    for bytes in split_lines(job) {
        let line = parse(bytes);
        if dialect.mark(&line) == Some(Mark::Layer) {
            places.push(Place { byte, machine: machine.clone(), depth_mm: furthest - filament });
        }
        if let Effect::Motion(m) = machine.apply(&line) {
            filament += m.e;
            furthest = furthest.max(filament);
        }
        byte += bytes.len();
    }
    places
}
