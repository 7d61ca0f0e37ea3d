//! Leaves out the beads of supports, and closes the way where they were.
//!
//! Takes typed lines in their order; gives the lines that stay and those that are put in.
//! What stands between two beads is held until the second one tells whether it is a
//! support's: before the first travel and after the last the file's own lines stay (they
//! pull the filament back, lift, come down, push), between these one travel is put in.
use super::Taken;
use crate::merge::gcode::Refusal;
use crate::merge::gcode::pen::{At, Pen};
use crate::merge::gcode::side::UNIT_MM;
use crate::merge::gcode::survey::Survey;
use crate::post::layer::{Layer, Style, What};
use crate::post::measure::RETRACTED_MM;
use outrigger_gcode::dialect::Mark;
use outrigger_gcode::line::parse;
use outrigger_gcode::state::{Kind, Machine};

/// A way that is shorter than this is gone without pulling the filament back, mm.
const SHORT_MM: f64 = 1.0;

/// Filament that differs by less is rounded, mm.
const ROUNDING_MM: f64 = 1e-3;

/// The part's first bead may lie so much higher than those of supports, mm; more is a raft.
const RAFT_MM: f64 = 0.05;

/// Type, width, height: what is said of beads.
const SAID: usize = 3;

/// The machine with the filament that is pulled back.
#[derive(Clone, Debug)]
struct Stand {
    machine: Machine,
    depth_mm: f64,
}

impl Stand {
    fn at(&self) -> At {
        let m = &self.machine;
        At { position: m.position, offset: m.offset, e: m.e, absolute_e: m.e_is_absolute(), feed: m.feed }
    }

    fn is_back(&self) -> bool {
        self.machine.firmware_retracted || self.depth_mm > RETRACTED_MM
    }

    fn flat(&self) -> [f64; 2] {
        [self.machine.position[0], self.machine.position[1]]
    }
}

/// A line that may stay or go.
struct Held {
    text: Vec<u8>,
    what: What,
    /// Which of [`SAID`] it says.
    says: Option<usize>,
    /// Before it.
    stand: Stand,
}

impl Held {
    fn travels(&self) -> bool {
        matches!(self.what, What::Move(m, Kind::Travel) if m.moves_xy())
    }

    /// Whether it moves something, or is about how.
    fn moves(&self) -> bool {
        matches!(self.what, What::Move(..) | What::Retract | What::Unretract | What::SetE(_) | What::WipeMark)
    }
}

/// See the module.
pub(super) struct Taker<'a> {
    survey: &'a Survey,
    stand: Stand,
    style: Style,
    layer: u32,
    /// Lines since the last bead, or since what may depend on where the nozzle is.
    held: Vec<Held>,
    /// Where the way begins that leads past supports which were taken out.
    gap: Option<Stand>,
    /// What the file says, and what the result does.
    said: [[Vec<u8>; SAID]; 2],
    out: Vec<u8>,
    taken: Taken,
    /// Height of the last bead, mm.
    top_mm: f64,
    /// Of the lowest of supports, mm.
    lowest_mm: f64,
    part: bool,
    /// Tools of supports and of the part, a bit each.
    tools: [u64; 2],
}

impl<'a> Taker<'a> {
    pub(super) fn new(survey: &'a Survey) -> Taker<'a> {
        Taker {
            survey,
            stand: Stand { machine: Machine::default(), depth_mm: 0.0 },
            style: Style::default(),
            layer: 0,
            held: Vec::new(),
            gap: None,
            said: Default::default(),
            out: Vec::new(),
            taken: Taken::default(),
            top_mm: 0.0,
            lowest_mm: f64::INFINITY,
            part: false,
            tools: [0; 2],
        }
    }

    /// # Errors
    /// What makes the job one that supports cannot be taken out of.
    pub(super) fn layer(&mut self, layer: &Layer) -> Result<(), Refusal> {
        (self.layer, self.style) = (layer.number, layer.style);
        for row in &layer.rows {
            let text = layer.bytes(row.span);
            let state = layer.state(row);
            match row.what {
                What::Move(m, Kind::Deposit) => {
                    let own = state.feature.is_support();
                    self.tools[usize::from(!own)] |=
                        u64::from(own || state.feature.is_part()) << (state.tool % 64);
                    self.top_mm = m.to[2];
                    if own {
                        self.lowest_mm = self.lowest_mm.min(m.to[2]);
                        self.skip();
                        self.follow(text, row.what);
                        self.taken.beads += 1;
                        self.taken.filament_mm += m.e;
                        continue;
                    }
                    if state.feature.is_part() && !std::mem::replace(&mut self.part, true) {
                        self.refuse_raft(m.to[2])?;
                    }
                    self.come_to()?;
                    self.say_again();
                    self.say(text);
                }
                // These find the nozzle where the file has it.
                What::Anchor | What::Mode(_) => {
                    self.come_to()?;
                    self.say(text);
                }
                what => {
                    let says = self.says(text);
                    if let Some(k) = says {
                        self.said[0][k] = text.trim_ascii_end().to_vec();
                    }
                    self.held.push(Held { text: text.to_vec(), what, says, stand: self.stand.clone() });
                }
            }
            self.follow(text, row.what);
        }
        Ok(())
    }

    /// The text since the last time.
    pub(super) fn written(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.out)
    }

    /// # Errors
    /// As [`Taker::layer`].
    pub(super) fn finish(&mut self) -> Result<Taken, Refusal> {
        self.come_to()?;
        let [own, part] = self.tools;
        if own & !part != 0 {
            return Err(Refusal::SupportTool);
        }
        self.taken.volume_mm3 = self.taken.filament_mm * self.survey.filament_mm2;
        Ok(self.taken)
    }

    fn refuse_raft(&self, z_mm: f64) -> Result<(), Refusal> {
        if self.lowest_mm < z_mm - RAFT_MM {
            return Err(Refusal::Raft { support_mm: self.lowest_mm, part_mm: z_mm });
        }
        Ok(())
    }

    fn says(&self, text: &[u8]) -> Option<usize> {
        match self.survey.dialect.mark(&parse(text)) {
            Some(Mark::Feature(_)) => Some(0),
            Some(Mark::Width(_)) => Some(1),
            Some(Mark::Height(_)) => Some(2),
            _ => None,
        }
    }

    fn follow(&mut self, text: &[u8], what: What) {
        self.stand.machine.apply(&parse(text));
        if let What::Move(m, kind) = what {
            let depth = &mut self.stand.depth_mm;
            *depth = if kind == Kind::Deposit { 0.0 } else { (*depth - m.e).max(0.0) };
        }
    }

    fn say(&mut self, text: &[u8]) {
        self.out.extend_from_slice(text);
    }

    /// Comes to a bead of supports. What is said of it is not said.
    fn skip(&mut self) {
        let held = std::mem::take(&mut self.held);
        let way = held.iter().position(Held::travels).unwrap_or(held.len());
        let first = self.gap.is_none();
        for (k, held) in held.iter().enumerate() {
            if held.says.is_none() && (!held.moves() || first && k < way) {
                self.say(&held.text);
            }
        }
        self.gap.get_or_insert_with(|| held.get(way).map_or(&self.stand, |held| &held.stand).clone());
    }

    /// Comes to what stays.
    fn come_to(&mut self) -> Result<(), Refusal> {
        let mut held = std::mem::take(&mut self.held);
        let Some(from) = self.gap.take() else {
            for held in held {
                if let Some(k) = held.says {
                    self.said[1][k] = held.text.trim_ascii_end().to_vec();
                }
                self.say(&held.text);
            }
            return Ok(());
        };
        let last = held.iter().rposition(Held::travels).map_or(0, |last| last + 1);
        let tail = held.split_off(last);
        let to = tail.first().map_or(&self.stand, |held| &held.stand).clone();
        // What is said of beads is said again before the next one.
        for held in held.iter().filter(|held| held.says.is_none() && !held.moves()) {
            self.say(&held.text);
        }
        self.close(&from, &to)?;
        for held in tail.iter().filter(|held| held.says.is_none()) {
            self.say(&held.text);
        }
        Ok(())
    }

    /// Says of the next bead what the result has not said yet.
    fn say_again(&mut self) {
        for k in 0..SAID {
            if self.said[0][k] != self.said[1][k] {
                let text = self.said[0][k].clone();
                self.say(&text);
                self.say(self.style.ending());
                self.said[1][k] = text;
            }
        }
    }

    /// The way from where the supports were left to where the file goes on.
    fn close(&mut self, from: &Stand, to: &Stand) -> Result<(), Refusal> {
        if !from.machine.absolute || !to.machine.absolute || from.machine.offset != to.machine.offset {
            return Err(Refusal::Relative { layer: self.layer });
        }
        self.taken.ways += 1;
        let mut pen = Pen::new(self.survey, self.style, from.at());
        let (mut depth_mm, mut firmware) = (from.depth_mm, from.machine.firmware_retracted);
        let [a, b] = [from.flat(), to.flat()];
        let way_mm = (b[0] - a[0]).hypot(b[1] - a[1]);
        let [low, high] = [from.machine.position[2], to.machine.position[2]];
        if way_mm > SHORT_MM && !from.is_back() {
            pen.pull();
            if let Some(retraction) = &self.survey.retraction {
                depth_mm += retraction.depth_mm();
                firmware |= retraction.firmware.is_some();
            }
        }
        // One end of the way may be lifted already.
        let flat = (low - high).abs() < UNIT_MM && low < self.top_mm + UNIT_MM;
        let lift = if way_mm > SHORT_MM && flat { self.survey.hop_mm } else { 0.0 };
        let top = low.max(high) + lift;
        if top > low {
            pen.rise(top);
        }
        if a != b {
            pen.go(b);
        }
        if top > high {
            pen.rise(high);
        }
        if firmware != to.machine.firmware_retracted {
            self.switch(&mut pen, to.machine.firmware_retracted);
        }
        if (depth_mm - to.depth_mm).abs() > ROUNDING_MM {
            let push = self.survey.retraction.as_ref().and_then(|r| r.unretract.first());
            let feed = push.map_or(self.survey.z_feed, |(line, _)| line.feed);
            pen.filament(depth_mm - to.depth_mm, feed);
        }
        pen.feed(to.machine.feed);
        pen.restore_e(to.machine.e);
        self.out.append(&mut pen.out);
        Ok(())
    }

    fn switch(&self, pen: &mut Pen<'_>, back: bool) {
        let own = self.survey.retraction.as_ref().and_then(|r| r.firmware.as_ref());
        match (own, back) {
            (Some([retract, _]), true) => pen.out.extend_from_slice(retract),
            (Some([_, unretract]), false) => pen.out.extend_from_slice(unretract),
            (None, true) => pen.text(b"G10"),
            (None, false) => pen.text(b"G11"),
        }
    }
}
