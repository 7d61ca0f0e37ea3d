//! The page that turns a part with its supports, whichever verb planned them.
use super::files;
use crate::report::support::Report;
use crate::report::turn;
use crate::support::demand::Demand;
use crate::support::plan::Plan;
use crate::support::points::Unheld;
use anyhow::Context;
use std::path::{Path, PathBuf};

/// What the report says that the page shows elsewhere.
const SHOWN_ELSEWHERE: [&str; 6] = ["file", "method", "unroutable", "warnings", "amiss", "negligible"];

/// A page's name.
pub(super) fn name(text: &str) -> Result<PathBuf, String> {
    if is_page(Path::new(text)) { Ok(text.into()) } else { Err("its name must end in .html".to_owned()) }
}

/// Whether a name is a page's.
pub(super) fn is_page(path: &Path) -> bool {
    let ending = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    matches!(ending.as_deref(), Some("html" | "htm"))
}

/// A part's corners, mm, and its triangles as indices into these.
pub(super) struct Surface<'a> {
    pub(super) vertices: &'a [[f64; 3]],
    pub(super) triangles: &'a [[u32; 3]],
}

/// Writes the page of a plan for a part.
///
/// # Errors
/// The page cannot be written.
pub(super) fn write(
    to: &Path,
    part: &Path,
    surface: &Surface<'_>,
    demand: &Demand,
    made: &Plan,
    report: &Report,
) -> anyhow::Result<()> {
    let mut figures = serde_json::to_value(report).context("cannot make the page")?;
    if let Some(fields) = figures.as_object_mut() {
        fields.retain(|key, value| !SHOWN_ELSEWHERE.contains(&key.as_str()) && *value != 0.0);
    }
    // What is smaller than a tip is no finding here either.
    let is_told = |u: &&Unheld| report.unroutable.iter().any(|told| told.place_mm == u.place_mm);
    let unheld: Vec<Unheld> = made.points.unheld.iter().filter(is_told).copied().collect();
    let method = turn::Method { name: report.method, forest: &made.forest, unheld: &unheld, figures };
    // What people know it by, without the folders before it.
    let name = files::display_name(part);
    let title = name.rsplit('/').next().unwrap_or_default();
    let scene = turn::Scene {
        title,
        vertices: surface.vertices,
        triangles: surface.triangles,
        needs: &demand.needs,
        methods: &[method],
        notes: &report.warnings,
    };
    let page = turn::html(&scene).context("cannot make the page")?;
    files::write_whole(page.as_bytes(), to, "picture")
}
