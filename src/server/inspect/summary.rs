//! What people should know of a report of `outrigger check`: findings in words, the worst first.
//!
//! Takes the verb's JSON, which is a documented interface, and trusts none of its fields to be there.
use crate::server::model::{Check, CheckState, Finding, Severity};
use serde_json::Value;

/// Findings that are listed one by one: nobody reads more.
const MAX_FINDINGS: usize = 50;

/// A region that reaches out too far is worth a person's look from this area on, mm²: smaller ones
/// droop by a bead or two, which nearly every part has somewhere.
const LOOK_MM2: f64 = 25.0;

/// The same of a hollow that stays full of resin, mm³: what such a part sweats later.
const LOOK_MM3: f64 = 100.0;

/// What people should know of a report of `outrigger check`.
pub(super) fn summary(told: &Value) -> Check {
    let list = |key: &str| told[key].as_array().map_or(&[][..], Vec::as_slice);
    let mut findings = Vec::new();
    for island in list("islands") {
        findings.push(piece(island, Severity::Stop, "island", "a piece begins in the air"));
    }
    for island in list("floating_supports") {
        findings.push(piece(
            island,
            Severity::Look,
            "floating_support",
            "one of the slicer's own supports begins in the air",
        ));
    }
    for amiss in told["printer"]["findings"].as_array().map_or(&[][..], Vec::as_slice) {
        let kind = amiss["kind"].as_str().unwrap_or("printer").to_owned();
        findings.push(Finding {
            severity: severity(&kind),
            words: amiss["words"].as_str().unwrap_or_default().to_owned(),
            line: amiss["line"].as_u64().filter(|line| *line > 0),
            kind,
            ..Finding::default()
        });
    }
    for issue in told["resin"]["issues"].as_array().map_or(&[][..], Vec::as_slice) {
        // The others were told as islands already.
        if issue["listed"].as_str() != Some("islands") {
            findings.push(resin_issue(issue, issue["kind"].as_str().unwrap_or("resin")));
        }
    }
    let printer_findings = list_len(&told["printer"]["findings"]);
    for region in told["overhangs"]["largest"].as_array().map_or(&[][..], Vec::as_slice) {
        if region["island"].as_bool() == Some(true) {
            continue;
        }
        let area = region["area_mm2"].as_f64().unwrap_or_default();
        let severity = if area >= LOOK_MM2 { Severity::Look } else { Severity::Note };
        findings.push(piece(region, severity, "overhang", "material reaches out too far over nothing"));
    }
    for warning in list("warnings").iter().filter_map(Value::as_str) {
        findings.push(Finding {
            kind: "warning".to_owned(),
            words: warning.to_owned(),
            ..Finding::default()
        });
    }
    findings.sort_by_key(|finding| finding.severity);
    // An island's first layer is an overhang as well: it is counted as what it is.
    let regions = told["overhangs"]["largest"].as_array().map_or(&[][..], Vec::as_slice);
    let islands = regions.iter().filter(|region| region["island"].as_bool() == Some(true)).count() as u64;
    let found = findings.iter().any(|finding| finding.severity != Severity::Note);
    let notes = findings.iter().filter(|finding| finding.severity == Severity::Note).count() as u64;
    findings.truncate(MAX_FINDINGS);
    Check {
        state: if found { CheckState::Found } else { CheckState::Clean },
        islands: list("islands").len() as u64 + told["unlisted_islands"].as_u64().unwrap_or_default(),
        overhangs: told["overhangs"]["regions"].as_u64().unwrap_or_default().saturating_sub(islands),
        printer_findings,
        notes,
        findings,
        ..Check::default()
    }
}

fn list_len(value: &Value) -> u64 {
    value.as_array().map_or(0, Vec::len) as u64
}

/// How serious it is that a printer could not do something.
fn severity(kind: &str) -> Severity {
    match kind {
        // Printed colder or hotter than usual: a person's choice, mostly.
        "nozzle_above_material" | "bed_above_material" | "nozzle_below_material" | "heaters_left_on" => {
            Severity::Look
        }
        _ => Severity::Stop,
    }
}

/// Something that would go wrong with a resin job. What may be meant, or costs resin only, is a note.
fn resin_issue(told: &Value, kind: &str) -> Finding {
    let severity = match (kind, told["severity"].as_str()) {
        (_, Some("error")) => Severity::Stop,
        ("suction_cup" | "touching_bounds" | "exposure", _) => Severity::Look,
        ("resin_trap", _) if told["volume_mm3"].as_f64().unwrap_or_default() >= LOOK_MM3 => Severity::Look,
        _ => Severity::Note,
    };
    let words = told["words"].as_str().unwrap_or_default();
    let what = format!("{}: {words}", kind.replace('_', " "));
    if told["centroid_mm"].is_null() {
        return Finding {
            kind: kind.to_owned(),
            severity,
            words: what,
            layer: told["layer"].as_u64(),
            ..Finding::default()
        };
    }
    piece(told, severity, kind, &what)
}

/// Something with a place.
fn piece(told: &Value, severity: Severity, kind: &str, what: &str) -> Finding {
    let layer = told["layer"].as_u64();
    let z_mm = told["top_mm"].as_f64();
    let area_mm2 = told["max_area_mm2"].as_f64().or(told["area_mm2"].as_f64());
    let place = |k: usize| told["centroid_mm"][k].as_f64().unwrap_or_default();
    Finding {
        kind: kind.to_owned(),
        severity,
        words: format!(
            "{what} at Z {:.2} mm (layer {}, X {:.0} Y {:.0}): {:.1} mm²",
            z_mm.unwrap_or_default(),
            layer.unwrap_or_default(),
            place(0),
            place(1),
            area_mm2.unwrap_or_default()
        ),
        layer,
        z_mm,
        line: None,
        area_mm2,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    /// `expect`: the state, and each finding's kind, the worst first.
    fn check(told: &Value, state: CheckState, expect: &[&str]) {
        let found = summary(told);
        let kinds: Vec<_> = found.findings.iter().map(|f| f.kind.as_str()).collect();
        assert_eq!((found.state, kinds.as_slice()), (state, expect), "{told}");
    }

    #[test]
    fn what_should_stop_a_job_is_told_from_what_is_good_to_know() {
        check(&json!({}), CheckState::Clean, &[]);
        let region = |area: f64| json!({"layer": 3, "top_mm": 0.8, "area_mm2": area, "centroid_mm": [1, 2]});
        let overhangs = |areas: &[f64]| {
            let largest: Vec<_> = areas.iter().map(|a| region(*a)).collect();
            json!({"overhangs": {"regions": areas.len(), "largest": largest}})
        };
        check(&overhangs(&[3.0]), CheckState::Clean, &["overhang"]);
        check(&overhangs(&[3.0, 30.0]), CheckState::Found, &["overhang", "overhang"]);
        let island = json!({"islands": [region(1.0)], "warnings": ["x"]});
        check(&island, CheckState::Found, &["island", "warning"]);
        let printer =
            |kind: &str| json!({"printer": {"findings": [{"kind": kind, "words": "w", "line": 7}]}});
        check(&printer("outside_bed"), CheckState::Found, &["outside_bed"]);
        let resin = |kind: &str, severity: &str, volume_mm3: f64| {
            let place = json!(if kind == "empty_layer" { json!(null) } else { json!([1, 2]) });
            json!({"islands": [region(1.0)], "resin": {"issues": [{"kind": kind, "severity": severity,
                "layer": 3, "listed": if kind == "island" { "islands" } else { "" }, "centroid_mm": place, "volume_mm3": volume_mm3}]}})
        };
        check(&resin("island", "error", 0.0), CheckState::Found, &["island"]);
        let clean = |told: &Value| {
            let mut told = json!({"resin": told["resin"]});
            told["resin"]["issues"][0]["listed"] = json!(null);
            told
        };
        check(&clean(&resin("island", "error", 0.0)), CheckState::Found, &["island"]);
        check(&clean(&resin("empty_layer", "error", 0.0)), CheckState::Found, &["empty_layer"]);
        check(&clean(&resin("resin_trap", "warning", 9.0)), CheckState::Clean, &["resin_trap"]);
        check(&clean(&resin("resin_trap", "warning", 900.0)), CheckState::Found, &["resin_trap"]);
        check(&clean(&resin("suction_cup", "warning", 9.0)), CheckState::Found, &["suction_cup"]);
        assert_eq!(summary(&printer("outside_bed")).findings[0].line, Some(7));
        assert_eq!(
            summary(&overhangs(&[30.0])).findings[0].words.matches("Z 0.80 mm (layer 3, X 1 Y 2)").count(),
            1
        );
    }

    #[test]
    fn no_report_makes_it_panic() {
        for odd in
            [json!(null), json!([]), json!({"islands": 3, "printer": [], "overhangs": "x", "warnings": [1]})]
        {
            check(&odd, CheckState::Clean, &[]);
        }
    }
}
