//! `outrigger post --picture` through the real binary.
mod common;

use common::{corpus, deposits, folder_with, outrigger};
use std::fs;

/// The number of the layer that the picture shows.
fn layer(svg: &str) -> usize {
    let at = svg.find("Layer ").expect("a layer is named") + "Layer ".len();
    svg[at..].split(',').next().unwrap().parse().unwrap()
}

/// A layer's lines, from its mark to the next one.
fn layer_text(job: &[u8], number: usize) -> String {
    let job = String::from_utf8_lossy(job).into_owned();
    job.split(";LAYER_CHANGE").nth(number).unwrap().to_owned()
}

#[test]
fn the_picture_shows_every_deposit_of_a_layer_that_was_changed() {
    let before = corpus("demo.gcode");
    let (folder, job) = folder_with(&before);
    outrigger(folder.path(), ["post", "job.gcode", "--picture", "layer.svg"]).ends(0);
    let svg = fs::read_to_string(folder.path().join("layer.svg")).unwrap();
    let number = layer(&svg);
    let after = fs::read(&job).unwrap();
    assert_ne!(layer_text(&before, number), layer_text(&after, number));
    // The oracle counts deposits. Within a bead each is one `L`; points that lie
    // closer than can be seen are left out, so there may be fewer, not many.
    let drawn: usize = svg
        .lines()
        .filter(|l| l.starts_with("<path class=\"bead"))
        .map(|l| l.split(" d=").nth(1).unwrap().matches('L').count())
        .sum();
    let own = deposits(format!("M83\n{}", layer_text(&before, number)).as_bytes()).len();
    assert!(drawn <= 2 * own && drawn * 10 >= 2 * own * 9, "{drawn} of twice {own}");
}

#[test]
fn no_picture_fails_no_export() {
    let (folder, job) = folder_with(&corpus("demo.gcode"));
    let run = outrigger(folder.path(), ["post", "job.gcode", "--picture", "none/layer.svg"]);
    run.ends(0).says("cannot write the picture none/layer.svg");
    assert_ne!(fs::read(&job).unwrap(), corpus("demo.gcode"));
}

#[test]
fn with_an_output_it_is_an_error() {
    let (folder, _) = folder_with(&corpus("demo.gcode"));
    let args = ["post", "job.gcode", "-o", "out.gcode", "--picture", "none/layer.svg"];
    outrigger(folder.path(), args).ends(1).says("cannot write the picture none/layer.svg");
}

#[test]
fn what_is_left_as_it_was_has_no_picture() {
    let (folder, _) = folder_with(b"G28\nG1 X1\n");
    outrigger(folder.path(), ["post", "job.gcode", "--picture", "layer.svg"]).ends(0).says("no picture");
    assert!(!folder.path().join("layer.svg").exists());
}

#[test]
fn standard_output_takes_a_picture() {
    let (folder, _) = folder_with(&corpus("demo.gcode"));
    let run = outrigger(folder.path(), ["post", "job.gcode", "--quiet", "--picture", "-"]);
    assert!(run.ends(0).stdout.starts_with("<svg ") && run.stdout.trim_end().ends_with("</svg>"));
}
