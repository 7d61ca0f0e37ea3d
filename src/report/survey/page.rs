//! The page: a single HTML file with a layer slider, that needs no network.
//!
//! Takes a [`Report`] and a [`Survey`] with its stack, gives the text of the page:
//! the sources in `web/viewer/` with the data in their midst. The page holds at
//! most [`stack::BYTES_MAX`](super::stack::BYTES_MAX) bytes of layers before they
//! are compressed, and lists of bounded length. What comes from the file (its name,
//! words in warnings) is text there whatever it holds.
use super::Survey;
use super::class::ALL;
use super::pack::STEP_MM;
use super::stack::{Kind, Stack};
use crate::report::check::{Island, Report};
use crate::report::embed::{base64, deflated, filled, json};
use crate::report::svg::escaped;
use serde::Serialize;

/// Most findings of a kind that the page lists, the largest.
const LISTED_MAX: usize = 500;

const PAGE: &str = include_str!("../../../web/viewer/page.html");
const STYLE: &str = include_str!("../../../web/viewer/page.css");
const SCRIPTS: [&str; 7] = [
    include_str!("../../../web/viewer/decode.js"),
    include_str!("../../../web/viewer/words.js"),
    include_str!("../../../web/viewer/page.js"),
    include_str!("../../../web/viewer/view.js"),
    include_str!("../../../web/viewer/strip.js"),
    include_str!("../../../web/viewer/findings.js"),
    include_str!("../../../web/viewer/main.js"),
];

/// The page's data but for the layers: `web/viewer/README.md` documents it.
#[derive(Serialize)]
struct Job<'a> {
    format: u32,
    step_mm: f64,
    classes: Vec<ClassOf>,
    kept: Kind,
    totals: Totals,
    report: &'a Report,
}

#[derive(Serialize)]
struct ClassOf {
    name: &'static str,
    title: &'static str,
}

#[derive(Serialize)]
struct Totals {
    islands: usize,
    small_islands: usize,
}

/// The text of the page.
///
/// # Errors
/// The encoder's own; none is expected.
pub fn html(report: &Report, survey: &Survey) -> std::io::Result<String> {
    let empty = Stack::default();
    let stack = survey.stack.as_ref().unwrap_or(&empty);
    let totals = Totals { islands: report.islands.len(), small_islands: report.small_islands.len() };
    let shown = Report {
        islands: largest(&report.islands),
        small_islands: largest(&report.small_islands),
        resin: report.resin.as_ref().map(|resin| resin.shown(LISTED_MAX)),
        ..report.clone()
    };
    let classes = ALL.map(|c| ClassOf { name: c.name(), title: c.title() }).into();
    let job = Job { format: 1, step_mm: STEP_MM, classes, kept: stack.kind(), totals, report: &shown };
    let scripts = SCRIPTS.map(|s| format!("<script>\n{s}</script>\n")).concat();
    Ok(filled(
        PAGE,
        &[
            ("@TITLE@", &escaped(report.name())),
            ("@STYLE@", STYLE),
            ("@JOB@", &json(&job)?),
            ("@LAYERS@", &base64(&deflated(&stack.bytes())?)),
            ("@SCRIPTS@", &scripts),
        ],
    ))
}

fn largest(islands: &[Island]) -> Vec<Island> {
    let mut islands = islands.to_vec();
    islands.sort_by(|a, b| b.area_mm2.total_cmp(&a.area_mm2).then(a.layer.cmp(&b.layer)));
    islands.truncate(LISTED_MAX);
    islands
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::check::testing::island;
    use crate::report::embed::testing::{inside, is_whole_and_alone, unpacked};

    fn page(report: &Report) -> String {
        html(report, &Survey::new(true)).expect("a page")
    }

    #[test]
    fn the_page_is_whole_and_alone() {
        let page = page(&Report { file: "a.stl".into(), ..Report::default() });
        is_whole_and_alone(
            &page,
            &["@TITLE@", "@STYLE@", "@JOB@", "@LAYERS@", "@SCRIPTS@"],
            2,
            SCRIPTS.len(),
        );
    }

    #[test]
    fn names_are_only_text() {
        let name = "</script><script>alert(1)</script><!-- @LAYERS@ \u{2028}\".stl";
        let page = page(&Report { file: name.into(), warnings: vec![name.into()], ..Report::default() });
        assert_eq!(page.matches("<script").count(), 2 + SCRIPTS.len());
        assert!(!page.contains("<!-- @LAYERS@"));
        let job: serde_json::Value = serde_json::from_str(inside(&page, "job")).expect("JSON");
        assert_eq!(job["report"]["file"], name);
        assert_eq!(job["report"]["warnings"][0], name);
    }

    #[test]
    fn long_lists_are_cut_to_the_largest() {
        let islands = (0..2000).map(|k| island(k, f64::from(k % 700))).collect();
        let page = page(&Report { islands, ..Report::default() });
        let job: serde_json::Value = serde_json::from_str(inside(&page, "job")).expect("JSON");
        assert_eq!(job["totals"]["islands"], 2000);
        let shown = job["report"]["islands"].as_array().expect("a list");
        assert_eq!((shown.len(), shown[0]["layer"].as_u64()), (LISTED_MAX, Some(699)));
    }

    #[test]
    fn layers_come_back_from_the_page() {
        use crate::layers::shape::{Point, Polygon, Region};
        use crate::layers::stack::Layer;
        let ring = [(0.0, 0.0), (4.0, 0.0), (4.0, 3.0)].map(|(x, y)| Point::from_mm(x, y)).to_vec();
        let part = Region { polygons: vec![Polygon { rings: vec![ring] }] };
        let layer = Layer { number: 5, bottom_mm: 0.5, top_mm: 0.7, part, ..Layer::default() };
        let mut survey = Survey::new(true);
        survey.add(super::super::Seen { layer: &layer, standings: &[], overhangs: &[] });
        let page = html(&Report::default(), &survey).expect("a page");
        let plain = unpacked(inside(&page, "layers"));
        // Layer 5 from 500 to 700 µm (each two bytes), 13 bytes: one group of the class 1 …
        assert_eq!(plain[..5], [5, 0xf4, 3, 0xbc, 5]);
        assert_eq!(plain[6..11], [1, 1, 1, 1, 3]);
    }
}
