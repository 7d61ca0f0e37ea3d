//! Real models: what the list beside them says of each is what is read.
//!
//! The models are not part of the repository; without them there is nothing to hold.
use flate2::read::GzDecoder;
use outrigger::mesh::report::Mended;
use outrigger::mesh::{Mesh, OPEN, read};
use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};

fn folder() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/models");
    folder.is_dir().then_some(folder)
}

/// A line of the list.
struct Model {
    file: String,
    triangles: u64,
    size_mm: Vec<f64>,
    closed: bool,
    bodies: u64,
    volume_cm3: Option<f64>,
}

/// `| file | triangles | size, mm | closed | bodies | volume, cm³ | source |`
fn listed(list: &str) -> Vec<Model> {
    let rows = list.lines().filter_map(|line| {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        let &[_, file, triangles, size, closed, bodies, volume, ..] = cells.as_slice() else { return None };
        Some(Model {
            file: file.to_string(),
            triangles: triangles.replace(',', "").parse().ok()?,
            size_mm: size.split('×').filter_map(|c| c.trim().parse().ok()).collect(),
            closed: closed == "yes",
            bodies: bodies.parse().ok()?,
            volume_cm3: volume.parse().ok(),
        })
    });
    rows.collect()
}

fn load(path: &Path) -> Vec<u8> {
    let bytes = std::fs::read(path).expect("a model");
    if path.extension().is_some_and(|e| e == "gz") {
        let mut plain = Vec::new();
        GzDecoder::new(&bytes[..]).read_to_end(&mut plain).expect("gzip");
        return plain;
    }
    bytes
}

fn assert_twins(mesh: &Mesh, mended: &Mended) {
    let ends = |h: usize| [mesh.triangles[h / 3][h % 3], mesh.triangles[h / 3][(h + 1) % 3]];
    for (h, &twin) in mesh.twins.iter().enumerate().filter(|t| *t.1 != OPEN) {
        assert_eq!(mesh.twins[twin as usize] as usize, h);
        let ([a, b], [c, d]) = (ends(h), ends(twin as usize));
        assert!(a == d && b == c);
    }
    assert_eq!(mesh.twins.iter().filter(|&&t| t == OPEN).count() as u64, mended.open_edges);
}

#[test]
fn models_are_what_their_list_says() {
    let Some(folder) = folder() else { return };
    let models = listed(&std::fs::read_to_string(folder.join("README.md")).expect("the list"));
    assert!(models.len() >= 30, "{} models", models.len());
    for model in models {
        let (mesh, report) = read(&mut Cursor::new(load(&folder.join(&model.file)))).expect(&model.file);
        let (name, mended) = (&model.file, report.mended);
        assert_twins(&mesh, &mended);
        assert_eq!(report.source.triangles, model.triangles, "{name}");
        let [low, high] = mesh.bounds_mm();
        for k in 0..3 {
            assert!((high[k] - low[k] - model.size_mm[k]).abs() < 0.0051, "{name}: {low:?} to {high:?}");
        }
        if model.closed {
            assert!(mended.done().is_empty() && mended.left().is_empty(), "{name}: {mended}");
            assert_eq!(mended.shells, model.bodies, "{name}");
        }
        if let Some(expect) = model.volume_cm3 {
            assert!(
                (mesh.volume_mm3() / 1000.0 - expect).abs() < 0.0051,
                "{name}: {} mm³",
                mesh.volume_mm3()
            );
        }
    }
}

#[test]
fn models_that_are_not_closed_are_mended_where_that_is_sure() {
    let Some(folder) = folder() else { return };
    let check = |file: &str, expect: &str| {
        let (_, report) = read(&mut Cursor::new(load(&folder.join(file)))).expect(file);
        assert_eq!(report.mended.to_string(), expect, "{file}");
    };
    check("3dbenchy.stl.gz", "mended: 8 triangles without area left out");
    check("prusa-einsy-base.stl", "mended: 6 triangles between bodies side by side left out");
    check("calib-bridgetest.stl", "mended: 22 triangles between bodies side by side left out");
    check("calib-retracttower.stl", "nothing to mend");
    check("teapot-open.stl", "not mended: 160 open edges left");
}
