//! What would go wrong with a resin job, as a part of the table.
use super::{ROWS_MAX, capital, count, more, place};
use crate::report::check::{Resin, ResinIssue, Severity, height_words};

/// Resin traps that hold less are counted only: pores between beads of pixels.
const DROP_MM3: f64 = 0.1;

/// What a kind is called, once.
fn name(kind: &str) -> &'static str {
    match kind {
        "island" => "weakly held island",
        "overhang" => "far overhang",
        "resin_trap" => "resin trap",
        "suction_cup" => "suction cup",
        "touching_bounds" => "place at the panel's edge",
        "empty_layer" => "stretch of empty layers",
        _ => "odd exposure",
    }
}

/// Adds each kind with its rows. Islands that stand in the list of islands already are not told again.
pub(super) fn table(lines: &mut Vec<String>, resin: &Resin) {
    let mut nothing = true;
    for (kind, _) in resin.counts() {
        let told = |issue: &&ResinIssue| issue.kind == kind && issue.listed.is_none();
        let mut issues: Vec<&ResinIssue> = resin.issues.iter().filter(told).collect();
        issues.sort_by(|a, b| a.largest_first(b));
        let Some(first) = issues.first() else { continue };
        nothing = false;
        lines.push(String::new());
        let how_bad = if first.severity == Severity::Error { "" } else { " (warning)" };
        let drops = issues.iter().filter(|issue| kind == "resin_trap" && issue.volume_mm3 < DROP_MM3).count();
        let shown = issues.len() - drops;
        lines.push(format!("{}{how_bad}: {}", capital(&count(shown as u64, name(kind))), first.words));
        lines.extend(issues[..shown].iter().take(ROWS_MAX).map(|issue| row(issue)));
        more(lines, shown as u64);
        if drops > 0 {
            lines.push(format!("Besides {} below {DROP_MM3} mm³", count(drops as u64, name(kind))));
        }
    }
    if resin.unlisted > 0 {
        lines.push(format!("And {} more that are not listed", resin.unlisted));
    }
    if nothing {
        lines.push(String::new());
        lines.push(
            "No resin trap, suction cup, empty layer or odd exposure; nothing at the panel's edge".to_owned(),
        );
    }
}

/// `layer 26 (Z 5.20 mm): 5.61 mm² at X 8.5 Y -8.5, up to Z 24.00, 12.3 mm³`
fn row(issue: &ResinIssue) -> String {
    let mut row = match issue.centroid_mm {
        Some(centroid) => place(issue.layer, issue.top_mm, issue.area_mm2, centroid),
        None => format!("  layer {:>5} (Z {:>7} mm)", issue.layer, height_words(issue.top_mm)),
    };
    if issue.end_layer > issue.layer {
        row += &format!(", up to layer {} (Z {})", issue.end_layer, height_words(issue.end_top_mm));
    }
    if issue.volume_mm3 > 0.0 {
        row += &format!(", {:.1} mm³", issue.volume_mm3);
    }
    if let Some(hole) = issue.hole {
        let ([x, y], [to_x, to_y]) = (hole.from_mm, hole.to_mm);
        row += &format!(
            "; a hole {:.1} mm long at Z {} from X {x:.1} Y {y:.1} to X {to_x:.1} Y {to_y:.1} would drain it",
            hole.length_mm,
            height_words(hole.top_mm)
        );
    }
    row
}
