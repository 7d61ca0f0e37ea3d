//! What would go wrong with a resin job, for machines and for people.
use super::{Island, Tops, height_words};
use crate::detect::resin::exposure::{self, Wrong};
use crate::detect::resin::{Issue, Issues, Kind};
use serde::Serialize;
use std::cmp::Ordering;

/// What would go wrong with a resin job.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Resin {
    /// By kind, then from the plate up.
    pub issues: Vec<ResinIssue>,
    /// Issues that are in no list because there are too many; usually 0.
    pub unlisted: u64,
}

/// How bad it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// It fails, or what comes out is not the part.
    Error,
    /// It may fail, or leaves something to do.
    Warning,
}

/// Something that would go wrong.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ResinIssue {
    /// `island`, `overhang`, `resin_trap`, `suction_cup`, `touching_bounds`, `empty_layer` or `exposure`.
    pub kind: &'static str,
    /// How bad it is.
    pub severity: Severity,
    /// Its lowest layer.
    pub layer: u32,
    /// Z at which that layer is printed.
    pub top_mm: f64,
    /// Its highest layer.
    pub end_layer: u32,
    /// Z at which that layer is printed.
    pub end_top_mm: f64,
    /// Area in the layer where it is largest; 0 where it has no place.
    pub area_mm2: f64,
    /// Resin that a hollow holds; 0 for what is none.
    pub volume_mm3: f64,
    /// Centre of gravity in the layer where it is largest; `null` where it has no place.
    pub centroid_mm: Option<[f64; 2]>,
    /// Lowest and highest x, y; `null` where it has no place.
    pub bbox_mm: Option<[[f64; 2]; 2]>,
    /// Which of the report's lists has this island as well: `islands` or `small_islands`; `null`: none.
    pub listed: Option<&'static str>,
    /// The shortest way out of a hollow, in a layer near its lowest; `null` for what is none, and for
    /// small ones. A hole there drains it: nobody cuts it here.
    pub hole: Option<Hole>,
    /// In words, with what to do.
    pub words: String,
}

/// A way through the wall, along one layer.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Hole {
    /// The layer.
    pub layer: u32,
    /// Z at which it is printed.
    pub top_mm: f64,
    /// Its end in the hollow.
    pub from_mm: [f64; 2],
    /// Its end outside.
    pub to_mm: [f64; 2],
    /// From the one to the other.
    pub length_mm: f64,
}

/// How pixels lie over the plate.
pub struct Ground<'a> {
    /// Where a place in a picture, column and row, lies over the plate, mm.
    pub plate_mm: &'a dyn Fn([f64; 2]) -> [f64; 2],
    /// Area of a pixel, mm².
    pub pixel_mm2: f64,
}

impl Resin {
    /// What was found in the pictures and in the layers' exposures.
    #[must_use]
    pub fn new(found: &Issues, exposures: &[exposure::Amiss], ground: &Ground, tops: &Tops) -> Resin {
        let seen = found.list.iter().map(|issue| of_picture(issue, ground, tops));
        let set = exposures.iter().map(|amiss| of_exposure(amiss, tops));
        Resin { issues: seen.chain(set).collect(), unlisted: found.unlisted }
    }

    /// Notes which islands a list of that name has as well: in the same layer, with its middle in ours.
    pub fn note_listed(&mut self, list: &'static str, islands: &[Island]) {
        for issue in self.issues.iter_mut().filter(|issue| issue.kind == "island") {
            let Some([low, high]) = issue.bbox_mm else { continue };
            let same = |island: &Island| {
                let [x, y] = island.centroid_mm;
                let within = low[0] <= x && x <= high[0] && low[1] <= y && y <= high[1];
                island.layer == issue.layer && within
            };
            if issue.listed.is_none() && islands.iter().any(same) {
                issue.listed = Some(list);
            }
        }
    }

    /// The same with so many of each kind at the most: the largest; the others are unlisted.
    #[must_use]
    pub fn shown(&self, most: usize) -> Resin {
        let mut shown = Resin { issues: Vec::new(), unlisted: self.unlisted };
        for of_kind in self.issues.chunk_by(|a, b| a.kind == b.kind) {
            let mut of_kind = of_kind.to_vec();
            of_kind.sort_by(ResinIssue::largest_first);
            shown.unlisted += of_kind.len().saturating_sub(most) as u64;
            of_kind.truncate(most);
            shown.issues.extend(of_kind);
        }
        shown
    }

    /// Kinds and how many of each, in order.
    #[must_use]
    pub fn counts(&self) -> Vec<(&'static str, u64)> {
        let mut counts: Vec<(&'static str, u64)> = Vec::new();
        for issue in &self.issues {
            match counts.last_mut() {
                Some((kind, count)) if *kind == issue.kind => *count += 1,
                _ => counts.push((issue.kind, 1)),
            }
        }
        counts
    }
}

impl ResinIssue {
    /// The order of lists: by what it holds, then by its area.
    #[must_use]
    pub fn largest_first(&self, other: &ResinIssue) -> Ordering {
        other.volume_mm3.total_cmp(&self.volume_mm3).then(other.area_mm2.total_cmp(&self.area_mm2))
    }
}

fn of_picture(issue: &Issue, ground: &Ground, tops: &Tops) -> ResinIssue {
    let placed = issue.kind != Kind::EmptyLayer;
    let [low, high] = issue.box_px.map(|corner| (ground.plate_mm)(corner.map(f64::from)));
    let bbox_mm = [[low[0].min(high[0]), low[1].min(high[1])], [low[0].max(high[0]), low[1].max(high[1])]];
    let (kind, severity, words) = told(issue.kind);
    ResinIssue {
        kind,
        severity,
        layer: issue.layer,
        top_mm: tops.of(issue.layer),
        end_layer: issue.end_layer,
        end_top_mm: tops.of(issue.end_layer),
        area_mm2: issue.pixels as f64 * ground.pixel_mm2,
        volume_mm3: issue.volume_px_mm * ground.pixel_mm2,
        centroid_mm: placed.then(|| (ground.plate_mm)(issue.centroid_px)),
        bbox_mm: placed.then_some(bbox_mm),
        listed: None,
        hole: None,
        words: words.to_owned(),
    }
}

/// Name, severity and words of a kind.
fn told(kind: Kind) -> (&'static str, Severity, &'static str) {
    match kind {
        Kind::Island => (
            "island",
            Severity::Error,
            "less than a quarter of it is held by the layer below: support it (outrigger post --supports auto)",
        ),
        Kind::Overhang => (
            "overhang",
            Severity::Warning,
            "far from what the layer below holds: support it (outrigger post --supports auto)",
        ),
        Kind::ResinTrap => (
            "resin_trap",
            Severity::Warning,
            "closed all around, it stays full of liquid resin: give the model a drain hole",
        ),
        Kind::SuctionCup => (
            "suction_cup",
            Severity::Warning,
            "closed towards the plate, it sucks at the film at each peel: give the model a vent near its lowest layer, or tilt it",
        ),
        Kind::TouchingBounds => (
            "touching_bounds",
            Severity::Warning,
            "within 5 px of the panel's edge, where it may be cut off: move the model inwards",
        ),
        Kind::EmptyLayer => (
            "empty_layer",
            Severity::Error,
            "what comes above holds to nothing: let the model down onto the plate, or export the job again",
        ),
    }
}

fn of_exposure(amiss: &exposure::Amiss, tops: &Tops) -> ResinIssue {
    let seconds = height_words(amiss.exposure_s);
    let (severity, words) = match amiss.wrong {
        Wrong::Dark => (Severity::Error, "not exposed at all".to_owned()),
        Wrong::TooShort => (
            Severity::Error,
            format!(
                "exposed for {seconds} s, shorter than any resin takes ({} s)",
                exposure::USUAL_S.start()
            ),
        ),
        Wrong::TooLong => (
            Severity::Warning,
            format!(
                "exposed for {seconds} s, longer than any layer takes ({} s; {} s near the plate)",
                exposure::USUAL_S.end(),
                exposure::LONGEST_S
            ),
        ),
        Wrong::BottomShort => (
            Severity::Warning,
            format!("exposed for {seconds} s, shorter than the layers above: it may not stick to the plate"),
        ),
    };
    ResinIssue {
        kind: "exposure",
        severity,
        layer: amiss.layer,
        top_mm: tops.of(amiss.layer),
        end_layer: amiss.end_layer,
        end_top_mm: tops.of(amiss.end_layer),
        area_mm2: 0.0,
        volume_mm3: 0.0,
        centroid_mm: None,
        bbox_mm: None,
        listed: None,
        hole: None,
        words: format!("{words}; look at the exposure times in the slicer"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_over_the_plate() {
        let issue = |kind, layer| Issue {
            kind,
            layer,
            end_layer: layer + 1,
            pixels: 50,
            volume_px_mm: 10.0,
            centroid_px: [4.0, 1.5],
            box_px: [[2, 1], [6, 2]],
        };
        let list = vec![issue(Kind::ResinTrap, 1), issue(Kind::ResinTrap, 5), issue(Kind::EmptyLayer, 2)];
        let found = Issues { list, unlisted: 3 };
        // A panel of 100 px a side, upright.
        let ground = Ground { plate_mm: &|[u, v]| [u * 0.1, (100.0 - v) * 0.1], pixel_mm2: 0.01 };
        let set = [exposure::Amiss { wrong: Wrong::Dark, layer: 0, end_layer: 3, exposure_s: 0.0 }];
        let tops = Tops((1..10).map(|k| f64::from(k) * 0.05).collect());
        let resin = Resin::new(&found, &set, &ground, &tops);
        assert_eq!(resin.counts(), [("resin_trap", 2), ("empty_layer", 1), ("exposure", 1)]);
        let trap = &resin.issues[0];
        assert!((trap.area_mm2 - 0.5).abs() < 1e-9 && (trap.volume_mm3 - 0.1).abs() < 1e-9);
        assert!((trap.top_mm - 0.1).abs() < 1e-9 && (trap.end_top_mm - 0.15).abs() < 1e-9);
        let [low, high] = trap.bbox_mm.unwrap();
        let near = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).abs() + (a[1] - b[1]).abs() < 1e-9;
        assert!(
            near(low, [0.2, 9.8]) && near(high, [0.6, 9.9]) && near(trap.centroid_mm.unwrap(), [0.4, 9.85])
        );
        assert!(resin.issues[2].bbox_mm.is_none() && resin.issues[3].centroid_mm.is_none());
        assert_eq!(resin.unlisted, 3);
        let shown = resin.shown(1);
        assert_eq!((shown.issues.len(), shown.unlisted), (3, 4));
    }
}
