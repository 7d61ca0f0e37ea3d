//! How a file goes from bead to bead: learned from its own links, to make new ones like them.
use super::layer::{Channel, Layer, Row, What};
use outrigger_gcode::state::{Kind, Move};

/// Filament pulled back and pushed that differs by less is meant to be the same, mm.
const ROUNDING_MM: f64 = 5e-4;

/// The bytes of a line.
pub(crate) type Text = Vec<u8>;

/// A line to make others like it from.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Sample {
    /// The line.
    pub(crate) text: Text,
    /// The feed rate in force, mm/min.
    pub(crate) feed: f64,
}

/// A plain travel.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Travel {
    /// The line.
    pub(crate) line: Sample,
    /// The texts of the [`Channel::OF_TRAVEL`] in force, empty where none is.
    pub(crate) channels: [Text; Channel::OF_TRAVEL.len()],
}

/// Filament pulled back while the nozzle goes back over the bead.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Wipe {
    /// A wiping line.
    pub(crate) line: Sample,
    /// Filament pulled back, mm, positive.
    pub(crate) e: f64,
    /// Way gone, mm.
    pub(crate) length_mm: f64,
    /// The comments before and after, or empty.
    pub(crate) marks: [Text; 2],
}

/// How the filament is pulled back and pushed again around a travel.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Retraction {
    /// `G10` and `G11`.
    pub(crate) firmware: Option<[Text; 2]>,
    /// Before the wipe, or all of it: line and mm, positive.
    pub(crate) before: Option<(Sample, f64)>,
    pub(crate) wipe: Option<Wipe>,
    /// After the wipe.
    pub(crate) after: Option<(Sample, f64)>,
    /// Line and height, mm.
    pub(crate) up: Option<(Sample, f64)>,
    pub(crate) down: Option<Sample>,
    /// Lines and mm.
    pub(crate) unretract: Vec<(Sample, f64)>,
}

impl Retraction {
    /// Filament pulled back in all, mm. Where that differs from what is pushed again
    /// by no more than rounding, it is what is pushed: copied a thousand times,
    /// the slicer's rounding would add up.
    pub(crate) fn depth_mm(&self) -> f64 {
        let part = |p: &Option<(Sample, f64)>| p.as_ref().map_or(0.0, |p| p.1);
        let pulled = part(&self.before) + self.wipe.as_ref().map_or(0.0, |w| w.e) + part(&self.after);
        let pushed: f64 = self.unretract.iter().map(|u| u.1).sum();
        if (pulled - pushed).abs() < ROUNDING_MM { pushed } else { pulled }
    }

    /// What the wipe pulls back when nothing is left for a line after it, mm.
    pub(crate) fn wipe_e_mm(&self, wipe: &Wipe) -> f64 {
        match self.after {
            Some(_) => wipe.e,
            None => self.depth_mm() - self.before.as_ref().map_or(0.0, |b| b.1),
        }
    }

    fn wipe_mm(&self) -> f64 {
        self.wipe.as_ref().map_or(0.0, |w| w.length_mm)
    }
}

/// A link taken apart.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Link {
    pub(crate) travel: Travel,
    pub(crate) retraction: Option<Retraction>,
}

/// The habits to make new links by.
#[derive(Clone, Debug, Default)]
pub(crate) struct Habits {
    /// The last plain travel seen.
    pub(crate) travel: Option<Travel>,
    /// A retraction, and the travel that goes with it.
    pub(crate) retracted: Option<(Retraction, Travel)>,
}

impl Habits {
    /// Takes the rows between two beads into account. Within a section the link
    /// with the longest wipe is kept: a short bead cuts the wipe after it short.
    pub(crate) fn learn(&mut self, layer: &Layer, rows: &[Row]) {
        let Some(link) = take_apart(layer, rows) else { return };
        match link.retraction {
            None => self.travel = Some(link.travel),
            Some(new) => {
                let keep = self.retracted.as_ref().is_some_and(|(old, _)| {
                    old.wipe_mm() > new.wipe_mm() && (old.depth_mm() - new.depth_mm()).abs() < 1e-6
                });
                if !keep {
                    self.retracted = Some((new, link.travel));
                }
            }
        }
    }

    /// The travel for a link without a retraction.
    pub(crate) fn plain(&self) -> Option<&Travel> {
        self.travel.as_ref().or(self.retracted.as_ref().map(|(_, travel)| travel))
    }
}

#[derive(Clone, Copy, PartialEq, PartialOrd)]
enum Stage {
    Before,
    Wipe,
    After,
    Up,
    Travel,
    Down,
    Unretract,
}

/// Whether a link can be left out or made anew: nothing but travel, or a whole
/// retraction around one. Filament moved for its own sake must stay where it is.
pub(crate) fn is_regular(layer: &Layer, rows: &[Row]) -> bool {
    let moves = |row: &Row| match row.what {
        What::Move(_, kind) => kind != Kind::Still,
        What::Retract | What::Unretract => true,
        _ => false,
    };
    !rows.iter().any(moves) || take_apart(layer, rows).is_some()
}

/// Takes a link apart; `None` where it is of a form that cannot be made anew
/// (ways down on a slope, several tools' primes, travels at other heights).
fn take_apart(layer: &Layer, rows: &[Row]) -> Option<Link> {
    let mut parts = Parts::default();
    for row in rows {
        let text = || layer.bytes(row.span).to_vec();
        match row.what {
            What::Move(m, kind) => {
                let sample = || Sample { text: text(), feed: m.feed };
                match kind {
                    Kind::Still | Kind::Deposit => {}
                    Kind::Filament if m.e < 0.0 => parts.pull(sample(), -m.e)?,
                    Kind::Filament => parts.push(sample(), m.e)?,
                    Kind::Wipe if m.from[2] != m.to[2] => return None,
                    Kind::Wipe => {
                        parts.leave_wall();
                        parts.at(Stage::Wipe)?;
                        let wipe = parts.wipe.get_or_insert(Wipe {
                            line: sample(),
                            e: 0.0,
                            length_mm: 0.0,
                            marks: Default::default(),
                        });
                        wipe.e -= m.e;
                        wipe.length_mm += m.length_mm();
                    }
                    Kind::Travel => parts.travel(&m, sample(), travel_channels(layer, row))?,
                }
            }
            What::Retract => {
                parts.leave_wall();
                parts.at(Stage::After)?;
                parts.firmware[0] = text();
            }
            What::Unretract => {
                parts.at(Stage::Unretract)?;
                parts.firmware[1] = text();
            }
            What::WipeMark => {
                let end = usize::from(parts.wipe.is_some());
                parts.marks[end] = text();
            }
            _ => {}
        }
    }
    parts.link()
}

fn travel_channels(layer: &Layer, row: &Row) -> [Text; Channel::OF_TRAVEL.len()] {
    Channel::OF_TRAVEL.map(|c| layer.bytes(layer.state(row).channels[c as usize]).to_vec())
}

struct Parts {
    stage: Stage,
    before: Option<(Sample, f64)>,
    wipe: Option<Wipe>,
    marks: [Text; 2],
    after: Option<(Sample, f64)>,
    up: Option<Sample>,
    /// How far up in all, mm.
    height_mm: f64,
    travel: Option<Travel>,
    down: Option<Sample>,
    unretract: Vec<(Sample, f64)>,
    firmware: [Text; 2],
}

impl Default for Parts {
    fn default() -> Self {
        Parts {
            stage: Stage::Before,
            before: None,
            wipe: None,
            marks: Default::default(),
            after: None,
            up: None,
            height_mm: 0.0,
            travel: None,
            down: None,
            unretract: Vec::new(),
            firmware: Default::default(),
        }
    }
}

impl Parts {
    /// Goes on to a stage; there is no way back.
    fn at(&mut self, stage: Stage) -> Option<()> {
        let on = self.stage <= stage;
        self.stage = stage;
        on.then_some(())
    }

    /// A travel before the filament is pulled back is no travel yet: PrusaSlicer
    /// first moves inwards from a wall.
    fn leave_wall(&mut self) {
        let pulled = self.before.is_some() || self.wipe.is_some() || self.after.is_some();
        if self.stage == Stage::Travel && !pulled && self.height_mm == 0.0 {
            self.stage = Stage::Before;
            self.travel = None;
        }
    }

    fn pull(&mut self, line: Sample, e: f64) -> Option<()> {
        self.leave_wall();
        let part = if self.stage == Stage::Before {
            &mut self.before
        } else {
            self.at(Stage::After)?;
            &mut self.after
        };
        part.get_or_insert((line, 0.0)).1 += e;
        Some(())
    }

    fn travel(&mut self, m: &Move, line: Sample, channels: [Text; Channel::OF_TRAVEL.len()]) -> Option<()> {
        let dz = m.to[2] - m.from[2];
        let sloped = m.moves_xy() || m.arc.is_some();
        if m.e != 0.0 {
            return None;
        }
        if self.stage == Stage::Unretract && dz == 0.0 && self.travel.is_some() {
            // Cura's combing: pushed again just inside, then on to the bead.
            return Some(());
        }
        if dz > 0.0 {
            // Sloped and spiral hops (OrcaSlicer, PrusaSlicer's ramps) become upright
            // ones of the same height, made like the way down.
            self.at(Stage::Up)?;
            self.height_mm += dz;
            self.up = (!sloped && self.up.is_none()).then_some(line.clone());
        } else if dz < 0.0 {
            self.at(Stage::Down)?;
            let first = self.down.replace(line.clone()).is_none();
            return (!sloped && first).then_some(());
        } else {
            self.at(Stage::Travel)?;
        }
        match (m.moves_xy(), m.arc) {
            (true, None) => self.travel = Some(Travel { line, channels }),
            (true, Some(_)) => return None,
            _ => {}
        }
        Some(())
    }

    fn push(&mut self, line: Sample, e: f64) -> Option<()> {
        self.at(Stage::Unretract)?;
        self.unretract.push((line, e));
        Some(())
    }

    fn link(self) -> Option<Link> {
        let [retract, unretract] = self.firmware;
        let firmware = match (retract.is_empty(), unretract.is_empty()) {
            (false, false) => Some([retract, unretract]),
            (true, true) => None,
            _ => return None,
        };
        let wipe = self.wipe.map(|wipe| Wipe { marks: self.marks, ..wipe });
        let pulled = self.before.is_some() || wipe.is_some() || self.after.is_some();
        let retracts = firmware.is_some() || pulled;
        let hops = self.height_mm > 0.0;
        if hops != self.down.is_some() || (hops && !retracts) || pulled == self.unretract.is_empty() {
            return None;
        }
        let up = self.up.or_else(|| self.down.clone()).filter(|_| hops).map(|line| (line, self.height_mm));
        let retraction = retracts.then_some(Retraction {
            firmware,
            before: self.before,
            wipe,
            after: self.after,
            up,
            down: self.down,
            unretract: self.unretract,
        });
        Some(Link { travel: self.travel?, retraction })
    }
}

#[cfg(test)]
mod tests {
    use super::super::annotate::Layers;
    use super::*;
    use outrigger_gcode::dialect::Dialect;

    fn link(text: &str) -> Option<Link> {
        let job = format!("M83\nG1 X1 Y1 Z1 F600 E1\n{text}");
        let layer = Layers::new(job.as_bytes(), Dialect::Prusa).next_layer().unwrap().unwrap();
        take_apart(&layer, &layer.rows[2..])
    }

    #[test]
    fn takes_links_apart() {
        let plain = link("G1 X5 Y5 F9000\nG1 F600\n").unwrap();
        assert_eq!(plain.retraction, None);
        assert_eq!(plain.travel.line, Sample { text: b"G1 X5 Y5 F9000\n".to_vec(), feed: 9000.0 });

        let full = "G1 E-2.24 F4200\n;WIPE_START\nG1 F7200\nG1 X0 E-.5\nG1 Y0 E-.4\n;WIPE_END\nG1 E-.06 F4200\nG1 Z2 F720\nG1 X9 Y9 F9000\nG1 Z1 F720\nG1 E3.2 F2400\n";
        let retraction = link(full).unwrap().retraction.unwrap();
        assert!((retraction.depth_mm() - 3.2).abs() < 1e-9);
        let wipe = retraction.wipe.unwrap();
        assert_eq!((wipe.line.feed, wipe.length_mm), (7200.0, 2.0));
        assert_eq!(wipe.marks, [b";WIPE_START\n".to_vec(), b";WIPE_END\n".to_vec()]);
        assert_eq!(retraction.up.unwrap().1, 1.0);

        // A slope up, a spiral up: upright hops as high, at the feed rate of the way down.
        for hop in ["G1 X2 Y2 Z1.4 F9000\n", "G2 Z1.4 I1 J0 P1 F9000\n"] {
            let text = format!("G1 E-1 F2400\n{hop}G1 X9 Y9 F9000\nG1 Z1 F720\nG1 E1 F2400\n");
            let retraction = link(&text).unwrap().retraction.unwrap();
            let (sample, height_mm) = retraction.up.unwrap();
            assert!((height_mm - 0.4).abs() < 1e-9);
            assert_eq!(sample, Sample { text: b"G1 Z1 F720\n".to_vec(), feed: 720.0 });
        }

        // In from the wall, back, over, forth, and on to the bead.
        let inwards = link("G1 X2\nG1 E-1\nG1 X5\nG1 E1\nG1 X6\n").unwrap();
        assert_eq!(inwards.travel.line.text, b"G1 X5\n");
        assert_eq!(inwards.retraction.unwrap().depth_mm(), 1.0);

        let firmware = link("G10\nG1 X5\nG11\n").unwrap().retraction.unwrap();
        assert_eq!(firmware.firmware, Some([b"G10\n".to_vec(), b"G11\n".to_vec()]));
        assert_eq!(firmware.depth_mm(), 0.0);
    }

    #[test]
    fn forms_that_cannot_be_made_anew_are_left_alone() {
        for text in [
            "G1 E-1\nG1 X5 Y5 Z2\nG1 X6 Z1\nG1 E1\n",
            "G1 E-1\nG1 Z2\nG1 X5\nG1 E1\n",
            "G1 E-1\nG1 X5\n",
            "G1 E-1\nG1 X5\nG1 E-1\nG1 X6\nG1 E2\n",
            "G1 Z2\nG1 X5\nG1 Z1\n",
            "G10\nG1 X5\n",
            "G1 E-1\nG1 E1\n",
        ] {
            assert_eq!(link(text), None, "{text}");
        }
    }

    #[test]
    fn the_longest_wipe_is_kept() {
        let link = |mm: f64| format!(";WIPE_START\nG1 X{} E-1\n;WIPE_END\nG1 X9 F9000\nG1 E1\n", 1.0 - mm);
        let mut habits = Habits::default();
        for mm in [0.25, 1.0, 0.5] {
            let job = format!("M83\nG1 X1 Y1 Z1 F600 E1\n{}", link(mm));
            let layer = Layers::new(job.as_bytes(), Dialect::Prusa).next_layer().unwrap().unwrap();
            habits.learn(&layer, &layer.rows[2..]);
        }
        assert_eq!(habits.retracted.unwrap().0.wipe_mm(), 1.0);
    }
}
