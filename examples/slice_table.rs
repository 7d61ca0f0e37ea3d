//! How the time and memory of slicing grow with triangles and layers.
//!
//! `cargo run --release --example slice_table -- [FILE.stl …]`
//!
//! For each file (a made mesh of 160,000 triangles when none is named) a table of four
//! layer heights by four numbers of triangles: the file's own, and the same body with
//! edges halved up to 7 times as many. What slicing is asked for is the number of
//! triangles that planes cross: triangles × their mean height / layer height. The time
//! that all cores work beyond reading is divided by that number, and by it and the
//! triangles, each of which must be looked at once even where no plane crosses it. The
//! latter may fall as the work grows, but not rise.
//!
//! Work is the scheduler's count of all threads (`/proc/self/task/*/schedstat`), so that
//! what else runs on the machine lengthens the times but hardly the work. The peak is
//! the kernel's own count for this process (`VmHWM`, reset before each row through
//! `/proc/self/clear_refs`), the file in memory included: Linux only.
//! Below each table it says whether the peak meets its target; the exit status is 1
//! when one does not, or a file cannot be read or sliced.
#[path = "../benches/common/meshes.rs"]
mod meshes;

use anyhow::{Context, ensure};
use outrigger::layers::from_mesh::{FromMesh, LayerHeights};
use outrigger::layers::stack::Layers;
use outrigger::mesh::place::{self, Placing};
use std::io::{Cursor, Write};
use std::path::Path;
use std::time::Instant;

/// Layer heights of the table, mm.
const LAYERS_MM: [f64; 4] = [0.1, 0.05, 0.025, 0.0125];

/// How many times as many triangles.
const TIMES: [f64; 4] = [1.0, 2.0, 4.0, 7.022];

/// Each row is the best of this many runs: what else the machine does only slows.
const RUNS: usize = 5;

/// Squared and doubled, the triangles of the made mesh.
const FINENESS: u32 = 283;

/// Most memory at once, MiB.
const TARGET_MIB: f64 = 400.0;

fn main() -> anyhow::Result<()> {
    let files: Vec<_> = std::env::args_os().skip(1).collect();
    if files.is_empty() {
        return table("made", &meshes::lumpy_ring(FINENESS));
    }
    for path in files {
        let bytes =
            std::fs::read(&path).with_context(|| format!("cannot read {}", Path::new(&path).display()))?;
        table(&Path::new(&path).display().to_string(), &bytes)?;
    }
    Ok(())
}

fn table(name: &str, file: &[u8]) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{name}")?;
    writeln!(
        out,
        "triangles layer_mm layers   crossings  read_ms  slice_ms  work_ms  ns/crossing  ns/both  peak_mib"
    )?;
    let own = meshes::read(file).triangles.len();
    let mut worst = 0.0_f64;
    for times in TIMES {
        let fine =
            if times > 1.0 { meshes::finer(file, (own as f64 * times) as usize) } else { file.to_vec() };
        for layer_mm in LAYERS_MM {
            let row = best(&fine, layer_mm)?;
            worst = worst.max(row.peak_mib);
            writeln!(
                out,
                "{:>9} {layer_mm:>8} {:>6} {:>11} {:>8.1} {:>9.1} {:>8.1} {:>12.1} {:>8.1} {:>9.0}",
                row.triangles,
                row.layers,
                row.crossings,
                row.read_s * 1e3,
                row.slice_s * 1e3,
                row.work_s * 1e3,
                row.work_s * 1e9 / row.crossings as f64,
                row.work_s * 1e9 / (row.crossings + row.triangles as u64) as f64,
                row.peak_mib,
            )?;
        }
    }
    let verdict = if worst <= TARGET_MIB { "met" } else { "MISSED" };
    writeln!(out, "peak {worst:.0} MiB; target {TARGET_MIB} MiB: {verdict}\n")?;
    ensure!(worst <= TARGET_MIB, "{name}: more memory than {TARGET_MIB} MiB");
    Ok(())
}

struct Row {
    triangles: usize,
    layers: usize,
    crossings: u64,
    read_s: f64,
    slice_s: f64,
    work_s: f64,
    peak_mib: f64,
}

fn best(file: &[u8], layer_mm: f64) -> anyhow::Result<Row> {
    let mut best = run(file, layer_mm)?;
    for _ in 1..RUNS {
        let row = run(file, layer_mm)?;
        best.read_s = best.read_s.min(row.read_s);
        best.slice_s = best.slice_s.min(row.slice_s);
        best.work_s = best.work_s.min(row.work_s);
        best.peak_mib = best.peak_mib.max(row.peak_mib);
    }
    Ok(best)
}

fn run(file: &[u8], layer_mm: f64) -> anyhow::Result<Row> {
    // "5" sets the peak back to what is held now.
    std::fs::write("/proc/self/clear_refs", "5").context("cannot reset the peak: not Linux?")?;
    let started = Instant::now();
    let (mut mesh, _) = outrigger::mesh::read(&mut Cursor::new(file))?;
    place::place(&mut mesh, &Placing::default())?;
    let read_s = started.elapsed().as_secs_f64();
    let before = work_s()?;
    let mut source = FromMesh::new(&mesh, LayerHeights::even(layer_mm))?;
    let crossings = source.crossings();
    let mut layers = 0;
    while let Some(batch) = source.next_batch()? {
        layers += batch.len();
    }
    let slice_s = started.elapsed().as_secs_f64() - read_s;
    let work_s = work_s()? - before;
    ensure!(Some(layers as u32) == source.count(), "layers are missing");
    let triangles = mesh.triangles.len();
    Ok(Row { triangles, layers, crossings, read_s, slice_s, work_s, peak_mib: peak_mib()? })
}

/// What all threads of this process have worked so far, s.
fn work_s() -> anyhow::Result<f64> {
    let mut nanoseconds = 0.0;
    for task in std::fs::read_dir("/proc/self/task").context("no /proc/self/task: not Linux?")? {
        let text = std::fs::read_to_string(task?.path().join("schedstat"))?;
        nanoseconds += text.split(' ').next().unwrap_or_default().parse::<f64>().context("schedstat")?;
    }
    Ok(nanoseconds / 1e9)
}

/// The most memory that this process has held since the peak was reset, MiB.
fn peak_mib() -> anyhow::Result<f64> {
    let status = std::fs::read_to_string("/proc/self/status").context("no /proc/self/status: not Linux?")?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).context("no VmHWM in it")?;
    let kib: f64 = line.trim().trim_end_matches("kB").trim().parse().context("VmHWM is no number")?;
    Ok(kib / 1024.0)
}
