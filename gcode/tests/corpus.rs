//! The library on real slicer output: the files of `corpus/`, each against the
//! figures that its README gives, which another program counted.
use outrigger_gcode::dialect::{Detection, Dialect, Mark, detect};
use outrigger_gcode::line::{parse, split_lines, write};
use outrigger_gcode::state::{Effect, Kind, Machine};
use std::path::{Path, PathBuf};

fn corpus() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus")
}

/// A row of the README's table of figures.
struct Row {
    name: String,
    lines: u64,
    layers: u64,
    filament_mm: f64,
}

fn rows() -> Vec<Row> {
    let readme = std::fs::read_to_string(corpus().join("README.md")).expect("the README");
    let (_, figures) = readme.split_once("## Figures").expect("the figures");
    let table = figures.lines().filter(|line| line.starts_with("| ")).skip(1);
    table
        .map(|line| {
            let cells: Vec<String> = line.split('|').map(|cell| cell.trim().replace(',', "")).collect();
            let number = |at: usize| cells[at].parse::<u32>().expect("a number");
            Row {
                name: cells[1].clone(),
                lines: number(2).into(),
                layers: number(3).into(),
                filament_mm: number(12).into(),
            }
        })
        .collect()
}

fn dialect_of(name: &str) -> Detection {
    match name {
        // Nothing in it says what a move is.
        "slic3r13-abs" => Detection::Unknown,
        "remarked-orca" => Detection::One(Dialect::Orca),
        "remarked-bambu" => Detection::One(Dialect::Bambu),
        _ if name.starts_with("ps25-") || ["demo", "lamp"].contains(&name) => Detection::One(Dialect::Prusa),
        _ if name.starts_with("slic3r13-") => Detection::One(Dialect::Slic3r),
        _ if name.starts_with("cura413-") => Detection::One(Dialect::Cura),
        _ => panic!("{name}: by which slicer?"),
    }
}

#[test]
fn every_file_has_a_row() {
    let mut named: Vec<String> = rows().into_iter().map(|row| row.name + ".gcode").collect();
    let files = std::fs::read_dir(corpus()).expect("the corpus");
    let mut there: Vec<String> = files
        .map(|entry| entry.expect("an entry").file_name().into_string().expect("ASCII"))
        .filter(|name| name.ends_with(".gcode"))
        .collect();
    named.sort();
    there.sort();
    assert_eq!(named, there);
}

#[test]
fn files_come_back_byte_for_byte() {
    for row in rows() {
        let job = std::fs::read(corpus().join(row.name + ".gcode")).expect("the file");
        let mut out = Vec::with_capacity(job.len());
        for line in split_lines(&job) {
            write(&parse(line), &mut out);
        }
        assert!(out == job);
    }
}

#[test]
fn figures_are_the_readmes() {
    for row in rows() {
        let name = &row.name;
        let job = std::fs::read(corpus().join(format!("{name}.gcode"))).expect("the file");
        let found = detect(&job);
        assert_eq!(found, dialect_of(name), "{name}");

        let mut machine = Machine::default();
        let (mut lines, mut layers, mut filament_mm) = (0, 0, 0.0);
        for piece in split_lines(&job) {
            lines += 1;
            let line = parse(piece);
            if let Detection::One(dialect) = found {
                layers += u64::from(dialect.mark(&line) == Some(Mark::Layer));
            }
            let Effect::Motion(step) = machine.apply(&line) else { continue };
            if step.kind() == Kind::Deposit {
                filament_mm += step.e;
            }
        }
        assert_eq!(lines, row.lines, "{name}: lines");
        // Where nothing marks the layers the table counts heights.
        if found != Detection::Unknown {
            assert_eq!(layers, row.layers, "{name}: layers");
        }
        assert!((filament_mm - row.filament_mm).abs() <= 0.5, "{name}: filament {filament_mm} mm");
    }
}
