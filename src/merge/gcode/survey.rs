//! What a job tells before anything is put into it: its heights, its habits, and
//! whether supports can go into it at all.
//!
//! Takes the layers in turn, gives a [`Survey`]. Memory: a height a layer, some
//! thousand beads, the beads of the start macro.
use super::Refusal;
use super::flow::Shape;
use super::told::Told;
use crate::post::layer::{Layer, Modes, Row, What};
use crate::post::link::{Habits, Retraction};
use crate::toolpath::bead::Point;
use outrigger_gcode::dialect::{Dialect, Feature};
use outrigger_gcode::line::{Command, parse, split_lines};
use outrigger_gcode::state::{Kind, Move};

/// Most layers: a metre at 0.025 mm.
const MAX_LAYERS: usize = 40_000;

/// Beads and links that are learned from; a job repeats its habits in every layer.
const SAMPLES: usize = 1 << 15;

/// Shorter beads tell their flow too coarsely, mm.
const TELLING_MM: f64 = 1.5;

/// A layer lower than the one before by more than this: another object begins, mm.
const FALL_MM: f64 = 0.03;

/// Layers thinner than this get no supports; the next one gets them as much thicker, mm.
const THIN_MM: f64 = 0.04;

/// Filament, mm, where nothing tells.
const USUAL_MM: f64 = 1.75;

/// The other one, mm.
const OTHER_MM: f64 = 2.85;

/// Beads of 1.75 mm filament that would be thinner than this are of the other one, mm.
const LEAST_WIDTH_MM: f64 = 0.22;

/// Widths that nozzles of 0.2 to 1.2 mm print, mm.
const WIDTHS_MM: [f64; 2] = [0.2, 1.6];

/// The lift where the file has none of its own, mm.
const USUAL_HOP_MM: f64 = 0.4;

/// A bead of the start macro.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::merge) struct Purge {
    pub(in crate::merge) ends: [Point; 2],
    /// Height of the nozzle, mm.
    pub(in crate::merge) z_mm: f64,
}

/// What was learned.
#[derive(Clone, Debug)]
pub(in crate::merge) struct Survey {
    pub(in crate::merge) dialect: Dialect,
    /// For each layer by its number: between which heights supports are printed in it, mm.
    pub(in crate::merge) slices: Vec<Option<[f64; 2]>>,
    /// Where the lowest begins, mm.
    pub(in crate::merge) ground_mm: f64,
    /// Filament for a mm³, mm.
    pub(in crate::merge) e_per_mm3: f64,
    /// Of the diameter that the file tells or makes likely, mm².
    pub(in crate::merge) filament_mm2: f64,
    pub(in crate::merge) width_mm: f64,
    /// Of bodies and interfaces, mm/min.
    pub(in crate::merge) feeds: [f64; 2],
    /// Of the part in the first layer, mm/min.
    pub(in crate::merge) first_feed: f64,
    pub(in crate::merge) travel_feed: f64,
    pub(in crate::merge) z_feed: f64,
    /// `G0` or `G1`.
    pub(in crate::merge) travel_head: Vec<u8>,
    pub(in crate::merge) retraction: Option<Retraction>,
    pub(in crate::merge) hop_mm: f64,
    pub(in crate::merge) bed: crate::layers::shape::Region,
    pub(in crate::merge) purge: Vec<Purge>,
}

/// The row before which supports are printed: the first bead that is neither tower nor
/// skirt nor macro, else of the skirt. `None`: no place for them in this layer.
pub(in crate::merge) fn entry(layer: &Layer) -> Option<usize> {
    if layer.number == 0 {
        return None;
    }
    let first = |fits: &dyn Fn(Feature) -> bool| {
        layer.rows.iter().position(|row| {
            matches!(row.what, What::Move(m, Kind::Deposit) if m.from[2] == m.to[2])
                && fits(layer.state(row).feature)
        })
    };
    first(&|f| !matches!(f, Feature::Tower | Feature::Skirt | Feature::Custom | Feature::Unknown))
        .or_else(|| first(&|f| f == Feature::Skirt))
}

/// Weighted values, of which the middle one is asked.
#[derive(Clone, Debug, Default)]
struct Middle(Vec<(f64, f64)>);

impl Middle {
    fn put(&mut self, value: f64, weight: f64) {
        if self.0.len() < SAMPLES && value.is_finite() {
            self.0.push((value, weight));
        }
    }

    fn get(mut self) -> Option<f64> {
        self.0.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let half = self.0.iter().map(|v| v.1).sum::<f64>() / 2.0;
        let mut sum = 0.0;
        self.0
            .iter()
            .find(|v| {
                sum += v.1;
                sum >= half
            })
            .map(|v| v.0)
    }
}

/// Looks at layer after layer.
pub(in crate::merge) struct Surveyor {
    dialect: Dialect,
    told: Told,
    /// Height at which supports are entered, by layer.
    tops: Vec<Option<f64>>,
    ground_mm: f64,
    highest: f64,
    rising_layers: u32,
    habits: Habits,
    links: usize,
    /// Filament for a mm³, of beads whose width is told.
    ratio: Middle,
    /// Filament for a mm² of a millimetre's way by height, of the others.
    flow: Middle,
    width: Middle,
    wall_feed: Middle,
    other_feed: Middle,
    support_feed: Middle,
    first_feed: Middle,
    travel_feed: Middle,
    z_feed: Middle,
    purge: Vec<Purge>,
}

impl Surveyor {
    pub(in crate::merge) fn new(dialect: Dialect, told: Told) -> Result<Surveyor, Refusal> {
        if told.spiral {
            return Err(Refusal::Spiral);
        }
        if told.volumetric {
            return Err(Refusal::Volumetric);
        }
        Ok(Surveyor {
            dialect,
            told,
            tops: Vec::new(),
            ground_mm: 0.0,
            highest: f64::NEG_INFINITY,
            rising_layers: 0,
            habits: Habits::default(),
            links: 0,
            ratio: Middle::default(),
            flow: Middle::default(),
            width: Middle::default(),
            wall_feed: Middle::default(),
            other_feed: Middle::default(),
            support_feed: Middle::default(),
            first_feed: Middle::default(),
            travel_feed: Middle::default(),
            z_feed: Middle::default(),
            purge: Vec::new(),
        })
    }

    /// # Errors
    /// What makes the job one that supports cannot go into.
    pub(in crate::merge) fn layer(&mut self, layer: &Layer) -> Result<(), Refusal> {
        self.refuse_units(layer)?;
        if layer.number as usize >= MAX_LAYERS {
            return Err(Refusal::ManyLayers);
        }
        let top = entry(layer).and_then(|k| match layer.rows[k].what {
            What::Move(m, _) => Some(m.to[2]),
            _ => None,
        });
        if let Some(z) = top {
            if z < self.highest - FALL_MM {
                return Err(Refusal::OneByOne { layer: layer.number, from_mm: self.highest, to_mm: z });
            }
            if self.highest == f64::NEG_INFINITY {
                self.ground_mm = z - first_height(layer, self.dialect).unwrap_or(z);
            }
            self.refuse_spiral(layer)?;
            self.learn(layer, z, z - self.highest.max(self.ground_mm));
            self.highest = self.highest.max(z);
        } else if layer.number == 0 {
            self.purge(layer);
        }
        self.tops.resize(layer.number as usize, None);
        self.tops.push(top);
        Ok(())
    }

    fn refuse_units(&self, layer: &Layer) -> Result<(), Refusal> {
        let inches = |row: &Row| matches!(row.what, What::Mode(Modes { inches: true, .. }));
        if layer.start.inches || layer.rows.iter().any(inches) {
            return Err(Refusal::Inches);
        }
        if memchr::memmem::find(layer.input(), b"M200").is_some() {
            let volumetric = split_lines(layer.input()).map(parse).any(|line| {
                line.command == Command::classic(b'M', 200) && line.words.get(b'D').is_some_and(|d| d > 0.0)
            });
            if volumetric {
                return Err(Refusal::Volumetric);
            }
        }
        Ok(())
    }

    /// Layers most of which is printed while Z rises.
    fn refuse_spiral(&mut self, layer: &Layer) -> Result<(), Refusal> {
        let (mut rising, mut all) = (0.0, 0.0);
        for row in &layer.rows {
            if let What::Move(m, Kind::Deposit) = row.what {
                all += m.length_mm();
                if m.to[2] > m.from[2] {
                    rising += m.length_mm();
                }
            }
        }
        self.rising_layers += u32::from(rising > all / 2.0);
        if self.rising_layers > 1 { Err(Refusal::Spiral) } else { Ok(()) }
    }

    fn purge(&mut self, layer: &Layer) {
        for row in &layer.rows {
            if let What::Move(m, Kind::Deposit) = row.what {
                m.chords(|a, b| self.purge.push(Purge { ends: [a, b], z_mm: m.to[2] }));
            }
        }
    }

    fn learn(&mut self, layer: &Layer, z_mm: f64, height_mm: f64) {
        let mut last = None;
        for (k, row) in layer.rows.iter().enumerate() {
            match row.what {
                What::Move(m, Kind::Deposit) => {
                    self.bead(layer, row, &m, z_mm, height_mm);
                    if let Some(from) = last.filter(|&from| from < k && self.links < SAMPLES) {
                        self.links += 1;
                        self.habits.learn(layer, &layer.rows[from..k]);
                    }
                    last = Some(k + 1);
                }
                What::Move(m, Kind::Travel) => {
                    let way = m.length_mm();
                    if !m.moves_xy() {
                        self.z_feed.put(m.feed, way);
                    } else if m.from[2] == m.to[2] {
                        self.travel_feed.put(m.feed, way);
                    }
                }
                _ => {}
            }
        }
    }

    fn bead(&mut self, layer: &Layer, row: &Row, m: &Move, z_mm: f64, height_mm: f64) {
        let state = layer.state(row);
        let way = m.length_mm();
        match state.feature {
            Feature::Perimeter | Feature::ExternalPerimeter => self.wall_feed.put(m.feed, way),
            Feature::Support => self.support_feed.put(m.feed, way),
            feature if feature.is_part() => self.other_feed.put(m.feed, way),
            _ => {}
        }
        if layer.is_first && state.feature.is_part() {
            self.first_feed.put(m.feed, way);
        }
        let telling = matches!(
            state.feature,
            Feature::Perimeter
                | Feature::ExternalPerimeter
                | Feature::Infill
                | Feature::SolidInfill
                | Feature::AnyInfill
                | Feature::Skin
        );
        if !telling || way < TELLING_MM || m.to[2] != z_mm || !(0.02..3.0).contains(&height_mm) {
            return;
        }
        if state.width_mm > 0.0 {
            let area = Shape::of(self.dialect).area_mm2(state.width_mm, height_mm);
            self.ratio.put(m.e / (way * area), way);
            self.width.put(state.width_mm, way);
        } else {
            self.flow.put(m.e / (way * height_mm), way);
        }
    }

    /// # Errors
    /// There is nothing to put supports to, or nothing tells how.
    pub(in crate::merge) fn finish(self) -> Result<Survey, Refusal> {
        if self.highest == f64::NEG_INFINITY {
            return Err(Refusal::NoPart);
        }
        let filament_mm = self.told.filament_mm.unwrap_or(USUAL_MM);
        let multiplier = self.told.multiplier.unwrap_or(1.0);
        let mut filament_mm2 = circle_mm2(filament_mm);
        let (e_per_mm3, width) = match (self.ratio.get(), self.flow.get()) {
            (Some(ratio), _) => (ratio, self.width.get()),
            (None, Some(flow)) => {
                // Cura tells no widths: as if its beads were rectangles of this filament.
                if self.told.filament_mm.is_none() && flow * filament_mm2 < LEAST_WIDTH_MM {
                    filament_mm2 = circle_mm2(OTHER_MM);
                }
                (multiplier / filament_mm2, Some(flow * filament_mm2 / multiplier))
            }
            (None, None) => return Err(Refusal::NoFlow),
        };
        let width_mm = width.ok_or(Refusal::NoFlow)?.clamp(WIDTHS_MM[0], WIDTHS_MM[1]);
        let wall = self.wall_feed.get().or(self.other_feed.get()).ok_or(Refusal::NoFlow)?;
        let told = |mm_s: Option<f64>| mm_s.map(|v| v * 60.0);
        let body = told(self.told.support_mm_s).or(self.support_feed.get()).unwrap_or(wall);
        let interface = told(self.told.interface_mm_s).unwrap_or(body).min(body);
        let travel = self.habits.plain().ok_or(Refusal::NoTravel)?;
        let travel_feed = self.travel_feed.get().filter(|f| *f > 0.0).unwrap_or(travel.line.feed);
        let retraction = self.habits.retracted.as_ref().map(|(retraction, _)| retraction.clone());
        let hop = retraction.as_ref().and_then(|r| r.up.as_ref()).map(|up| up.1);
        let head = parse(&travel.line.text).head;
        let plain = matches!(head, b"G0" | b"G1");
        Ok(Survey {
            dialect: self.dialect,
            slices: slices(&self.tops, self.ground_mm),
            ground_mm: self.ground_mm,
            e_per_mm3,
            filament_mm2,
            width_mm,
            feeds: [body, interface],
            first_feed: self.first_feed.get().unwrap_or(body).min(body),
            travel_feed,
            z_feed: self.z_feed.get().filter(|f| *f > 0.0).unwrap_or(travel_feed),
            travel_head: if plain { head.to_vec() } else { b"G1".to_vec() },
            hop_mm: hop.unwrap_or(USUAL_HOP_MM).max(USUAL_HOP_MM / 2.0),
            retraction,
            bed: self.told.bed,
            purge: self.purge,
        })
    }
}

fn circle_mm2(diameter_mm: f64) -> f64 {
    std::f64::consts::FRAC_PI_4 * diameter_mm * diameter_mm
}

/// What the file says of the first layer's thickness, mm.
fn first_height(layer: &Layer, dialect: Dialect) -> Option<f64> {
    use crate::post::layer::Channel;
    use outrigger_gcode::dialect::Mark;
    let row = &layer.rows[entry(layer)?];
    let text = layer.bytes(layer.state(row).channels[Channel::Height as usize]);
    match dialect.mark(&parse(text)) {
        Some(Mark::Height(mm)) if mm > 0.0 && mm < 3.0 => Some(mm),
        _ => None,
    }
}

/// Between which heights supports are printed in each layer.
fn slices(tops: &[Option<f64>], ground_mm: f64) -> Vec<Option<[f64; 2]>> {
    let mut last = ground_mm;
    tops.iter()
        .map(|top| {
            let top = top.filter(|top| top - last >= THIN_MM)?;
            Some([std::mem::replace(&mut last, top), top])
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::post::annotate::Layers;

    fn survey(text: &str, dialect: Dialect) -> Result<Survey, Refusal> {
        let mut told = Told::default();
        told.read(text.as_bytes());
        let mut surveyor = Surveyor::new(dialect, told)?;
        let mut layers = Layers::new(text.as_bytes(), dialect).without_covers();
        while let Some(layer) = layers.next_layer().unwrap() {
            surveyor.layer(&layer)?;
        }
        surveyor.finish()
    }

    fn corpus(name: &str) -> String {
        String::from_utf8(crate::merge::testing::corpus(name)).unwrap()
    }

    #[test]
    fn real_jobs_tell_their_habits() {
        let check = |name: &str, dialect: Dialect, heights: [f64; 2], width: f64, depth: f64, hop: f64| {
            let got = survey(&corpus(name), dialect).unwrap();
            let own: Vec<[f64; 2]> = got.slices.iter().flatten().copied().collect();
            assert!((own[0][0], own[0][1]) == (0.0, heights[0]), "{name}: {:?}", own[0]);
            assert!((own[1][1] - own[1][0] - heights[1]).abs() < 1e-9, "{name}: {:?}", own[1]);
            assert!((got.width_mm - width).abs() < 0.01, "{name}: {}", got.width_mm);
            let e_per_mm3 = 1.0 / circle_mm2(1.75);
            assert!((got.e_per_mm3 / e_per_mm3 - 1.0).abs() < 0.02, "{name}: {}", got.e_per_mm3);
            let retraction = got.retraction.unwrap();
            assert!((retraction.depth_mm() - depth).abs() < 1e-3, "{name}: {}", retraction.depth_mm());
            assert!((got.hop_mm - hop).abs() < 1e-6, "{name}: {}", got.hop_mm);
        };
        check("ps25-marlin-abs-grid.gcode", Dialect::Prusa, [0.2, 0.2], 0.45, 5.0, 0.4);
        check("ps25-klipper-gyroid.gcode", Dialect::Prusa, [0.3, 0.3], 0.45, 5.0, 0.4);
        check("ps25-marlin-wipe-zhop-honeycomb.gcode", Dialect::Prusa, [0.25, 0.25], 0.45, 2.0, 0.4);
        check("ps25-marlin2-fwretract-rectilinear.gcode", Dialect::Prusa, [0.2, 0.2], 0.45, 0.0, 0.4);
        check("cura413-marlin-zhop-triangles.gcode", Dialect::Cura, [0.25, 0.25], 0.4, 5.0, 0.2);
    }

    #[test]
    fn what_cannot_take_supports_is_refused() {
        let check = |name: &str, dialect: Dialect, expect: &str| {
            let got = survey(&corpus(name), dialect).unwrap_err().to_string();
            assert!(got.contains(expect), "{name}: {got}");
        };
        check("ps25-marlin-sequential.gcode", Dialect::Prusa, "one after the other");
        check("ps25-marlin-vase.gcode", Dialect::Prusa, "spiral");
        let head = "M83\n;LAYER_CHANGE\n;TYPE:Perimeter\n;WIDTH:0.4\nG1 X0 Y0 Z.2 F9000\nG1 X9 E.5 F1200\n";
        let refusal = |text: String| survey(&text, Dialect::Prusa).unwrap_err().to_string();
        assert!(refusal(format!("M200 D1.75\n{head}")).contains("mm³"));
        assert!(refusal(format!("; use_volumetric_e = 1\n{head}")).contains("mm³"));
        assert!(refusal(format!("G20\n{head}")).contains("inches"));
        assert!(refusal("M83\n;LAYER_CHANGE\n".to_owned()).contains("no part"));
        let spiral: String = (1..40)
            .map(|k| format!(";LAYER_CHANGE\nG1 X0 Y0 Z{k}\nG1 X9 E1\nG1 X0 Y9 Z{k}.5 E3\n"))
            .collect();
        assert!(refusal(format!("{head}{spiral}")).contains("spiral"));
    }

    #[test]
    fn thin_layers_wait_for_the_next() {
        let tops = [None, Some(0.2), Some(0.21), None, Some(0.4)];
        assert_eq!(slices(&tops, 0.0), [None, Some([0.0, 0.2]), None, None, Some([0.2, 0.4])]);
    }
}
