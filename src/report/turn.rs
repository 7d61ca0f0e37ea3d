//! The page that turns a part with its supports: a single HTML file, without a network.
//!
//! Takes a [`Scene`]: the part's triangles, what must be held, and forests with what they
//! do not hold and figures. Gives the text of the page: sources of `web/viewer/` with the
//! data in their midst. The page stays below some 8 MB whatever the part: at most 400,000
//! triangles in 3.5 MiB, 60,000 places to hold, [`NODES_MAX`] nodes and lists of bounded
//! length; it says where something was made coarser or left out. What comes from the file
//! is text there whatever it holds.
//!
//! # Layout
//! - [`hull()`]: a surface where a job has no mesh
//! - `pack`: shapes as bytes
//! - `thin`: a part with too many triangles
mod hull;
mod pack;
mod thin;

pub use self::hull::{Hull, hull};

use super::embed::{base64, deflated, filled, json};
use super::svg::escaped;
use crate::support::demand::Need;
use crate::support::points::Unheld;
use crate::support::tree::Forest;
use pack::Grid;
use serde::Serialize;
use serde_json::Value;

/// Most places that cannot be held which the page lists: islands, then the largest.
const LISTED_MAX: usize = 500;

/// Most methods that the page shows; what is beyond is left out.
pub const METHODS_MAX: usize = 8;

/// Most nodes of all forests: some ten thousand tips.
pub const NODES_MAX: usize = 100_000;

/// Most bytes of a method's figures as JSON, and of all notes; more are left out.
const WORDS_MAX: usize = 1 << 15;

const PAGE: &str = include_str!("../../web/viewer/turn.html");
const STYLES: [&str; 2] =
    [include_str!("../../web/viewer/page.css"), include_str!("../../web/viewer/turn.css")];
const SCRIPTS: [&str; 7] = [
    include_str!("../../web/viewer/decode.js"),
    include_str!("../../web/viewer/words.js"),
    include_str!("../../web/viewer/page.js"),
    include_str!("../../web/viewer/scene.js"),
    include_str!("../../web/viewer/camera.js"),
    include_str!("../../web/viewer/paint.js"),
    include_str!("../../web/viewer/turn.js"),
];

/// What the page shows.
#[derive(Clone, Copy, Debug)]
pub struct Scene<'a> {
    /// The page's title: the name of the part.
    pub title: &'a str,
    /// Corners of the part's triangles, mm, placed as it was planned for.
    pub vertices: &'a [[f64; 3]],
    /// Three indices into `vertices` each, counter-clockwise seen from outside.
    pub triangles: &'a [[u32; 3]],
    /// What must be held.
    pub needs: &'a [Need],
    /// Supports by one or more methods; the first is shown at first.
    pub methods: &'a [Method<'a>],
    /// Sentences for the head of the page: warnings, what was mended.
    pub notes: &'a [String],
}

/// Supports by one method.
#[derive(Clone, Debug)]
pub struct Method<'a> {
    /// Its name.
    pub name: &'a str,
    /// The supports.
    pub forest: &'a Forest,
    /// What they do not hold.
    pub unheld: &'a [Unheld],
    /// What it amounts to: an object of numbers and words, or of such objects. The page
    /// shows each entry by its key; an ending as `_mm`, `_mm3` or `_s` is its unit.
    pub figures: Value,
}

/// The page's data but for the shapes: `web/viewer/README.md` documents it.
#[derive(Serialize)]
struct Data<'a> {
    format: u32,
    title: &'a str,
    notes: &'a [String],
    step_mm: f64,
    origin_mm: [f64; 3],
    bounds_mm: [[f64; 3]; 2],
    part: pack::Kept,
    demand: pack::Kept,
    methods: Vec<Shown<'a>>,
}

#[derive(Serialize)]
struct Shown<'a> {
    name: &'a str,
    nodes: usize,
    of: usize,
    totals: Totals,
    unheld: Vec<Place>,
    figures: &'a Value,
}

#[derive(Serialize)]
struct Totals {
    unheld: usize,
    unheld_area_mm2: f64,
}

#[derive(Serialize)]
struct Place {
    place_mm: [f64; 3],
    area_mm2: f64,
    island: bool,
    reason: &'static str,
}

/// The text of the page.
///
/// # Errors
/// The encoder's own; none is expected.
pub fn html(scene: &Scene<'_>) -> std::io::Result<String> {
    let methods = &scene.methods[..scene.methods.len().min(METHODS_MAX)];
    let grid = Grid::around(places(scene, methods));
    let (mut bytes, part) = pack::part(&grid, scene.vertices, scene.triangles, pack::MOST)?;
    let demand = pack::needs(&mut bytes, &grid, scene.needs);
    let none = Value::Null;
    let mut shown = Vec::new();
    let mut room = NODES_MAX;
    for method in methods {
        let nodes = pack::forest(&mut bytes, &grid, method.forest, room);
        room -= nodes;
        shown.push(Shown {
            name: method.name,
            nodes,
            of: method.forest.nodes.len(),
            totals: Totals {
                unheld: method.unheld.len(),
                unheld_area_mm2: method.unheld.iter().map(|u| u.area_mm2).sum(),
            },
            unheld: worst(method.unheld),
            figures: if json(&method.figures)?.len() > WORDS_MAX { &none } else { &method.figures },
        });
    }
    let fits = scene.notes.iter().map(String::len).sum::<usize>() <= WORDS_MAX;
    let [low, high] = grid.bounds_mm();
    let data = Data {
        format: 1,
        title: scene.title,
        notes: if fits { scene.notes } else { &[] },
        step_mm: grid.step_mm,
        origin_mm: grid.origin_mm,
        bounds_mm: [low, high],
        part,
        demand,
        methods: shown,
    };
    let scripts = SCRIPTS.map(|s| format!("<script>\n{s}</script>\n")).concat();
    Ok(filled(
        PAGE,
        &[
            ("@TITLE@", &escaped(scene.title)),
            ("@STYLE@", &STYLES.concat()),
            ("@SCENE@", &json(&data)?),
            ("@SHAPES@", &base64(&deflated(&bytes)?)),
            ("@SCRIPTS@", &scripts),
        ],
    ))
}

/// All places that the page shows.
fn places<'a>(scene: &'a Scene<'_>, methods: &'a [Method<'_>]) -> impl Iterator<Item = [f64; 3]> + 'a {
    let needs = scene.needs.iter().map(|n| n.at_mm);
    let nodes = methods.iter().flat_map(|m| &m.forest.nodes);
    // A foot is as wide as its radius.
    let around = nodes.flat_map(|n| [-1.0, 1.0].map(|k| [0, 1].map(|c| n.at_mm[c] + k * n.radius_mm)));
    let heights = methods.iter().flat_map(|m| &m.forest.nodes).map(|n| n.at_mm[2]);
    let around = around.zip(heights.flat_map(|z| [z, z])).map(|([x, y], z)| [x, y, z]);
    scene.vertices.iter().copied().chain(needs).chain(around)
}

fn worst(unheld: &[Unheld]) -> Vec<Place> {
    let mut unheld: Vec<&Unheld> = unheld.iter().collect();
    unheld.sort_by(|a, b| b.island.cmp(&a.island).then(b.area_mm2.total_cmp(&a.area_mm2)));
    unheld.truncate(LISTED_MAX);
    let place = |u: &Unheld| Place {
        place_mm: u.place_mm,
        area_mm2: u.area_mm2,
        island: u.island,
        reason: u.reason.words(),
    };
    unheld.into_iter().map(place).collect()
}

#[cfg(test)]
mod tests;
