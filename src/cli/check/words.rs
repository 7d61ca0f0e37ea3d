//! What was found, as a table for people who print.
mod resin;

use crate::report::check::{Island, Overhangs, Region, Report, height_words};

/// Rows of a list; the others are counted.
const ROWS_MAX: usize = 20;

/// The table.
pub(super) fn table(report: &Report, mended: &str) -> String {
    let mut lines = vec![head(report)];
    let rules = &report.rules;
    lines.push(format!(
        "Rules: {}: holds itself up to {}° from the vertical, bridges {} mm; smallest area {} mm²",
        rules.material, rules.angle_deg, rules.bridge_mm, rules.min_area_mm2
    ));
    if !mended.is_empty() {
        lines.push(capital(mended));
    }
    lines.extend(report.warnings.iter().map(|warning| format!("Warning: {warning}")));
    lines.push(String::new());
    islands(&mut lines, report);
    for found in report.overhangs_by_method.values() {
        overhangs(&mut lines, found, report.rules.min_area_mm2);
    }
    if let Some(resin) = &report.resin {
        resin::table(&mut lines, resin);
    }
    if let Some(printer) = &report.printer {
        lines.push(String::new());
        lines.push(match printer.findings.len() {
            0 => format!("{} can print it", printer.name),
            n => format!("{}: {} amiss", printer.name, count(n as u64, "thing")),
        });
        lines.extend(printer.findings.iter().map(|amiss| format!("  {}", amiss.words)));
    }
    lines.push(String::new());
    lines.push(seconds(report));
    lines.join("\n")
}

fn head(report: &Report) -> String {
    let mut facts = vec![report.kind.to_owned()];
    facts.extend(report.triangles.map(|n| count(n, "triangle")));
    facts.push(count(u64::from(report.layers), "layer"));
    facts.push(format!("{:.2} mm high", report.height_mm));
    format!("{}: {}", report.file, facts.join(", "))
}

/// `no layers`, `1 layer`, `2 layers`.
fn count(n: u64, one: &str) -> String {
    match n {
        0 => format!("no {one}s"),
        1 => format!("1 {one}"),
        n => format!("{n} {one}s"),
    }
}

fn capital(words: &str) -> String {
    let mut letters = words.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

fn islands(lines: &mut Vec<String>, report: &Report) {
    let all = report.islands.len() as u64 + report.unlisted_islands;
    let order = if all > 1 { ", the largest first" } else { "" };
    lines.push(format!("{}{order}", capital(&count(all, "island"))));
    lines.extend(report.largest_islands().into_iter().take(ROWS_MAX).map(island));
    more(lines, all);
    if let small @ 1.. = report.small_islands.len() as u64 {
        let lowest = report.small_islands.iter().map(|i| i.layer).min().unwrap_or_default();
        lines.push(format!(
            "Besides {} below {} mm², the lowest in layer {lowest}; --json lists all",
            count(small, "island"),
            report.rules.min_area_mm2
        ));
    }
    if let floating @ 1.. = report.floating_supports.len() as u64 {
        let what = match floating {
            1 => "1 piece of support, brim or tower begins".to_owned(),
            n => format!("{n} pieces of support, brim or tower begin"),
        };
        lines.push(format!("{what} with nothing right below (slicers leave a gap over the part):"));
        lines.extend(report.floating_supports.iter().take(ROWS_MAX).map(island));
        more(lines, floating);
    }
}

fn more(lines: &mut Vec<String>, all: u64) {
    if all > ROWS_MAX as u64 {
        lines.push(format!("  and {} more: see --json", all - ROWS_MAX as u64));
    }
}

/// `layer 26 (Z 5.20 mm): 5.61 mm² at X 8.5 Y -8.5, joins the part at Z 24.00`
fn island(island: &Island) -> String {
    let end = if island.joins {
        format!("joins the part at Z {}", height_words(island.end_top_mm))
    } else {
        "never joins the part".to_owned()
    };
    let grows = if island.max_area_mm2 > 2.0 * island.area_mm2 {
        format!(", grows to {:.2} mm²", island.max_area_mm2)
    } else {
        String::new()
    };
    format!("{}{grows}, {end}", place(island.layer, island.top_mm, island.area_mm2, island.centroid_mm))
}

fn place(layer: u32, top_mm: f64, area_mm2: f64, [x, y]: [f64; 2]) -> String {
    let area = if area_mm2 < 0.1 { format!("{area_mm2:.4}") } else { format!("{area_mm2:.2}") };
    // Away with the sign of −0.
    let tenths = |mm: f64| (mm * 10.0).round() / 10.0 + 0.0;
    format!(
        "  layer {layer:>5} (Z {:>7} mm): {area:>9} mm² at X {:>6.1} Y {:>6.1}",
        height_words(top_mm),
        tenths(x),
        tenths(y)
    )
}

fn overhangs(lines: &mut Vec<String>, found: &Overhangs, min_area_mm2: f64) {
    let how = match found.method {
        "normal" => "by the slope of the faces",
        "image" => "layer against layer, in pixels",
        _ => "layer against layer",
    };
    let area = if found.regions > 0 {
        format!(", {:.2} mm² seen from below", found.area_mm2)
    } else {
        String::new()
    };
    lines.push(String::new());
    lines.push(format!("{} ({how}){area}", capital(&count(found.regions, "overhang"))));
    lines.extend(found.largest.iter().take(ROWS_MAX).map(region));
    more(lines, found.regions);
    if found.small_regions > 0 {
        let small = count(found.small_regions, "overhang");
        lines.push(format!("Besides {small} below {min_area_mm2} mm²"));
    }
}

fn region(region: &Region) -> String {
    let mut end = String::new();
    if region.end_layer > region.layer {
        end += &format!(", up to Z {}", height_words(region.end_top_mm));
    }
    if region.island {
        end += ", with an island";
    }
    format!("{}{end}", place(region.layer, region.top_mm, region.area_mm2, region.centroid_mm))
}

fn seconds(report: &Report) -> String {
    let s = &report.seconds;
    let mut parts = vec![
        format!("reading {:.2}", s.read),
        format!("layers {:.2}", s.slice),
        format!("islands {:.2}", s.islands),
    ];
    if !report.overhangs_by_method.is_empty() {
        parts.push(format!("overhangs {:.2}", s.overhangs));
    }
    if report.resin.is_some() {
        parts.push(format!("resin {:.2}", s.resin));
    }
    format!("{:.2} s: {}", s.total, parts.join(", "))
}
