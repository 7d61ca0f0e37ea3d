//! The lines of a resin job: down, expose, up, layer after layer.
//!
//! Takes what each layer needs and how the printer's light and plate are told, as plain values;
//! gives lines one at a time, and for any count of them where in which layer that is. The same job
//! and profile give the same lines: a count of lines is a place in the job, as it is in a file.
//! Knows no time and nothing of what is acknowledged.

/// A way of the plate.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Way {
    /// How far, mm.
    pub mm: f64,
    /// How fast, mm/min.
    pub mm_min: f64,
}

/// What one layer needs.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Layer {
    /// Height of the plate while it is exposed, mm.
    pub z_mm: f64,
    /// How long it is exposed, ms.
    pub exposure_ms: u32,
    /// Power of the light, 0 to 255.
    pub power: u8,
    /// Up after the exposure: slowly until it comes off, then faster. Of no length: left out.
    pub lift: [Way; 2],
    /// Down before it: the last `mm` of the second slowly, before that fast.
    pub retract: [Way; 2],
    /// After the move, before the picture, ms.
    pub settle_ms: u32,
    /// After the light, before the lift, ms.
    pub rest_ms: u32,
    /// At the top, ms.
    pub top_ms: u32,
}

/// Who keeps an exposure's time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Timing {
    /// The controller: on, a dwell and off, sent together behind a dwell.
    Controller,
    /// The controller, by a line that ends by itself.
    Pulse,
    /// The host.
    Host,
}

/// How a printer is told.
#[derive(Debug, Clone, PartialEq)]
pub struct Rules {
    /// Who keeps the time.
    pub timing: Timing,
    /// Light on; `{power}` is 0 to 255.
    pub on: Vec<String>,
    /// Light off.
    pub off: Vec<String>,
    /// Lines of which the last lights for `{ms}` at `{power}`: of [`Timing::Pulse`].
    pub pulse: Vec<String>,
    /// Waits for `{ms}`.
    pub dwell: String,
    /// How long a picture is shown before the light goes on, ms.
    pub lead_ms: u32,
    /// Lines after which the printer says `{word}` once the plate stands.
    pub done: Vec<String>,
    /// Homes the plate, before the first layer.
    pub home: Vec<String>,
    /// What must be so before anything moves.
    pub checks: Vec<Check>,
}

/// A question to the firmware that must be answered well before anything moves.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Check {
    /// What shall be so, for a person.
    pub what: String,
    /// Asks the firmware.
    pub send: String,
    /// What some line of its answer must contain.
    pub wants: String,
}

/// A part of a layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// A question before anything moves, from 0; all of them belong to the first layer, as homing does.
    Check(u32),
    /// The plate finds its height.
    Home,
    /// Down to it, and the question whether it is there.
    Lower,
    /// The light, and the question whether it is off.
    Expose,
    /// Up from it.
    Lift,
}

/// Where in the script something is: before which line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    /// Lines before it.
    pub lines: u64,
    /// The layer of the line behind it, from 0; their number at the end.
    pub layer: u32,
    /// What that line belongs to.
    pub step: Step,
    /// It is the first of that.
    pub first: bool,
    /// It is the first that switches the light off.
    pub light_ends: bool,
}

/// Where a job stands whose printer has lost its state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Standing {
    /// Lines before the layer with which it goes on.
    pub from: u64,
    /// That layer, from 0; their number where all are done.
    pub layer: u32,
    /// That layer may have been exposed already, in part or wholly.
    pub exposed: bool,
    /// Where the plate stands, mm, if it cannot have been moving.
    pub at_mm: Option<f64>,
}

/// What the printer is asked to say at the end of a step.
pub fn word(step: Step, layer: u32) -> String {
    match step {
        Step::Check(check) => format!("checked {check}"),
        Step::Home | Step::Lower => format!("Z_move_comp {layer}"),
        Step::Expose | Step::Lift => format!("light_off {layer}"),
    }
}

/// A job's lines. Stands before its first.
#[derive(Debug, Clone)]
pub struct Script {
    rules: Rules,
    layers: std::sync::Arc<[Layer]>,
    layer: u32,
    /// The lines of that layer, and how many of them are behind.
    lines: Vec<(Step, String)>,
    at: usize,
    /// Lines before that layer.
    before: u64,
    last: String,
}

impl Script {
    /// The lines of these layers, from the plate up.
    pub fn new(rules: Rules, layers: Vec<Layer>) -> Self {
        let mut script = Self {
            rules,
            layers: layers.into(),
            layer: 0,
            lines: Vec::new(),
            at: 0,
            before: 0,
            last: String::new(),
        };
        script.lines = script.lines_of(0);
        script
    }

    /// Layers.
    pub fn layers(&self) -> u32 {
        self.layers.len() as u32
    }

    /// What a layer needs; nothing beyond the last.
    pub fn needs(&self, layer: u32) -> Layer {
        self.layers.get(layer as usize).copied().unwrap_or_default()
    }

    /// Lines in all.
    pub fn len(&self) -> u64 {
        (0..self.layers()).map(|layer| self.lines_of(layer).len() as u64).sum()
    }

    /// No layer at all.
    pub fn is_empty(&self) -> bool {
        self.layers.is_empty()
    }

    /// Who keeps an exposure's time.
    pub fn timing(&self) -> Timing {
        self.rules.timing
    }

    /// How long the layer that it stands at is exposed, ms.
    pub fn exposure_ms(&self) -> u32 {
        self.needs(self.layer).exposure_ms
    }

    /// How long its picture is shown before the light, ms.
    pub fn lead_ms(&self) -> u32 {
        self.rules.lead_ms
    }

    /// How long it is waited before its picture, ms.
    pub fn settle_ms(&self) -> u32 {
        self.needs(self.layer).settle_ms
    }

    /// How long it is waited after its light, ms.
    pub fn rest_ms(&self) -> u32 {
        self.needs(self.layer).rest_ms
    }

    /// What is asked before anything moves.
    pub fn check(&self, n: u32) -> Option<&Check> {
        self.rules.checks.get(n as usize)
    }

    /// The lines, counted from 1, between whose acknowledgements the light of the layer is on.
    pub fn lit_between(&self) -> Option<[u64; 2]> {
        let of_light = |at: &usize| self.lines.get(*at).is_some_and(|l| l.0 == Step::Expose);
        let first = (0..self.lines.len()).find(of_light)?;
        let last = (0..self.lines.len()).rfind(of_light)?;
        let off = match self.rules.timing {
            Timing::Pulse => last - 1,
            Timing::Controller | Timing::Host => last - self.rules.off.len(),
        };
        let on = match self.rules.timing {
            Timing::Pulse => off.checked_sub(1)?,
            Timing::Controller => off.checked_sub(2)?,
            Timing::Host => off.checked_sub(1)?,
        };
        let count = |at: usize| self.before + at as u64 + 1;
        (on >= first).then(|| [count(on), count(off)])
    }

    /// Where it stands.
    pub fn place(&self) -> Place {
        let lines = self.before + self.at as u64;
        let Some((step, line)) = self.lines.get(self.at) else {
            let layer = self.layers();
            return Place { lines, layer, step: Step::Lower, first: true, light_ends: false };
        };
        let first = self.at == 0 || self.lines[self.at - 1].0 != *step;
        let off = self.rules.off.first().is_some_and(|off| off == line);
        Place { lines, layer: self.layer, step: *step, first, light_ends: off && *step == Step::Expose }
    }

    /// Goes to the next line; `false` after the last.
    pub fn advance(&mut self) -> bool {
        let Some((_, line)) = self.lines.get_mut(self.at) else { return false };
        self.last = std::mem::take(line);
        self.at += 1;
        if self.at == self.lines.len() {
            self.before += self.at as u64;
            self.layer += 1;
            self.at = 0;
            self.lines = self.lines_of(self.layer);
        }
        true
    }

    /// The line that [`Script::advance`] went over.
    pub fn line(&self) -> &str {
        &self.last
    }

    /// Goes to before the line with so many before it, at most to the end.
    pub fn go_to(&mut self, lines: u64) {
        let mut before = 0;
        let mut layer = 0;
        loop {
            let of_layer = self.lines_of(layer);
            let len = of_layer.len() as u64;
            if len == 0 || before + len > lines {
                (self.layer, self.lines, self.before) = (layer, of_layer, before);
                self.at = (lines - before).min(len) as usize;
                return;
            }
            before += len;
            layer += 1;
        }
    }

    /// The printer has accepted what it stands behind, and that is light on without light off: how
    /// long it was on nobody knows. A pulse ends by itself.
    pub fn is_torn(&self) -> bool {
        let lines = self.place().lines;
        self.rules.timing != Timing::Pulse
            && self.lit_between().is_some_and(|[on, off]| (on..off).contains(&lines))
    }

    /// It stands within an exposure, before the line that switches the light on.
    pub fn is_dark_yet(&self) -> bool {
        let place = self.place();
        let [on, off] = self.lit_between().unwrap_or_default();
        let lights = if self.rules.timing == Timing::Pulse { off } else { on };
        place.step == Step::Expose && place.lines < lights
    }

    /// Where a job stands of which so many lines are written down as acknowledged: the light of a
    /// layer goes on, and the plate up from it, only after that is written down of all before.
    pub fn standing(&self, lines: u64) -> Standing {
        let mut script = self.clone();
        script.go_to(lines);
        let place = script.place();
        // It is homed once.
        let moved = |line: &(Step, String)| !matches!(line.0, Step::Check(_) | Step::Home);
        let start = script.before + script.lines.iter().position(moved).unwrap_or(0) as u64;
        let end = script.before + script.lines.len() as u64;
        let z_mm = self.needs(place.layer).z_mm;
        match place.step {
            // On the way, or still up where the layer before has left it.
            Step::Check(_) | Step::Home | Step::Lower => {
                Standing { from: start, layer: place.layer, exposed: false, at_mm: None }
            }
            Step::Expose => Standing { from: start, layer: place.layer, exposed: true, at_mm: Some(z_mm) },
            Step::Lift => Standing { from: end, layer: place.layer + 1, exposed: false, at_mm: None },
        }
    }

    fn lines_of(&self, at: u32) -> Vec<(Step, String)> {
        let Some(layer) = self.layers.get(at as usize) else { return Vec::new() };
        let mut lines = Vec::with_capacity(16);
        let mut put = |step: Step, line: String| lines.push((step, line));
        if at == 0 {
            for (n, check) in (0..).zip(&self.rules.checks) {
                put(Step::Check(n), check.send.clone());
                put(Step::Check(n), format!("M118 {}", word(Step::Check(n), 0)));
            }
            let modes = ["G21".to_owned(), "G90".to_owned()];
            self.rules.home.iter().cloned().chain(modes).for_each(|line| put(Step::Home, line));
        }
        let [fast, slow] = layer.retract;
        if slow.mm > 0.0 && fast.mm_min > 0.0 {
            put(Step::Lower, go(layer.z_mm + slow.mm, fast.mm_min));
        }
        put(Step::Lower, go(layer.z_mm, if slow.mm_min > 0.0 { slow.mm_min } else { fast.mm_min }));
        let with = |line: &str, step: Step| {
            line.replace("{power}", &layer.power.to_string())
                .replace("{ms}", &layer.exposure_ms.to_string())
                .replace("{word}", &word(step, at))
        };
        for line in &self.rules.done {
            put(Step::Lower, with(line, Step::Lower));
        }
        let lead = self.rules.dwell.replace("{ms}", &self.rules.lead_ms.to_string());
        put(Step::Expose, lead);
        match self.rules.timing {
            Timing::Pulse => {
                self.rules.pulse.iter().for_each(|line| put(Step::Expose, with(line, Step::Expose)));
            }
            Timing::Controller => {
                self.rules.on.iter().for_each(|line| put(Step::Expose, with(line, Step::Expose)));
                put(Step::Expose, with(&self.rules.dwell, Step::Expose));
                self.rules.off.iter().for_each(|line| put(Step::Expose, line.clone()));
            }
            Timing::Host => {
                self.rules.on.iter().for_each(|line| put(Step::Expose, with(line, Step::Expose)));
                self.rules.off.iter().for_each(|line| put(Step::Expose, line.clone()));
            }
        }
        put(Step::Expose, format!("M118 {}", word(Step::Expose, at)));
        let mut z_mm = layer.z_mm;
        for way in layer.lift.iter().filter(|way| way.mm > 0.0) {
            z_mm += way.mm;
            put(Step::Lift, go(z_mm, way.mm_min));
        }
        if layer.top_ms > 0 {
            put(Step::Lift, self.rules.dwell.replace("{ms}", &layer.top_ms.to_string()));
        }
        lines
    }
}

/// A move of the plate. Coordinates to 0.1 µm, as firmware has them.
fn go(z_mm: f64, mm_min: f64) -> String {
    let short = |text: String| text.trim_end_matches('0').trim_end_matches('.').to_owned();
    format!("G1 Z{} F{}", short(format!("{z_mm:.4}")), short(format!("{mm_min:.2}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(crate) fn rules(timing: Timing) -> Rules {
        let lines = |text: &str| text.split('\n').map(str::to_owned).collect::<Vec<_>>();
        Rules {
            timing,
            on: lines("M106 S{power}"),
            off: lines("M107"),
            pulse: lines("M810 M106 S{power}|G4 P{ms}|M107\nM810"),
            dwell: "G4 P{ms}".to_owned(),
            lead_ms: 100,
            done: lines("M400\nM118 {word}"),
            home: Vec::new(),
            checks: Vec::new(),
        }
    }

    fn layer(z_mm: f64) -> Layer {
        Layer {
            z_mm,
            exposure_ms: 2500,
            power: 255,
            lift: [Way { mm: 3.0, mm_min: 60.0 }, Way { mm: 4.0, mm_min: 180.0 }],
            retract: [Way { mm: 4.0, mm_min: 200.0 }, Way { mm: 3.0, mm_min: 90.0 }],
            settle_ms: 500,
            rest_ms: 200,
            top_ms: 0,
        }
    }

    fn lines(mut script: Script) -> Vec<String> {
        let mut all = Vec::new();
        while script.advance() {
            all.push(script.line().to_owned());
        }
        all
    }

    #[test]
    fn a_layer_goes_down_lights_and_goes_up() {
        let check = |timing: Timing, expect: &str| {
            let got = lines(Script::new(rules(timing), vec![layer(0.05)])).join("; ");
            assert_eq!(got, expect);
        };
        let down = "G21; G90; G1 Z3.05 F200; G1 Z0.05 F90; M400; M118 Z_move_comp 0; G4 P100; ";
        let up = "; M118 light_off 0; G1 Z3.05 F60; G1 Z7.05 F180";
        check(Timing::Controller, &format!("{down}M106 S255; G4 P2500; M107{up}"));
        check(Timing::Pulse, &format!("{down}M810 M106 S255|G4 P2500|M107; M810{up}"));
        check(Timing::Host, &format!("{down}M106 S255; M107{up}"));
    }

    #[test]
    fn waits_and_ways_of_no_length_are_left_out() {
        let one = Layer {
            lift: [Way { mm: 5.0, mm_min: 60.0 }, Way::default()],
            retract: [Way { mm: 5.0, mm_min: 150.0 }, Way::default()],
            top_ms: 300,
            ..layer(10.0)
        };
        let mut script = Script::new(rules(Timing::Controller), vec![layer(9.95), one]);
        script.go_to(13);
        let rest = lines(script).join("; ");
        assert_eq!(
            rest,
            "G1 Z10 F150; M400; M118 Z_move_comp 1; G4 P100; M106 S255; G4 P2500; M107; M118 light_off 1; \
             G1 Z15 F60; G4 P300"
        );
    }

    #[test]
    fn any_count_of_lines_is_a_place() {
        let layers: Vec<_> = (1..=7).map(|n| layer(f64::from(n) * 0.05)).collect();
        for timing in [Timing::Controller, Timing::Pulse, Timing::Host] {
            let script = Script::new(rules(timing), layers.clone());
            let all = lines(script.clone());
            assert_eq!(script.len(), all.len() as u64);
            let mut walked = script.clone();
            for at in 0..=all.len() {
                let mut jumped = script.clone();
                jumped.go_to(at as u64);
                assert_eq!(jumped.place(), walked.place());
                assert_eq!(lines(jumped), all[at..]);
                walked.advance();
            }
            let mut beyond = script.clone();
            beyond.go_to(u64::MAX);
            assert_eq!((beyond.place().layer, beyond.place().lines), (7, all.len() as u64));
        }
    }

    #[test]
    fn what_is_written_down_tells_where_the_plate_stands() {
        let layers: Vec<_> = (1..=3).map(|n| layer(f64::from(n) * 0.05)).collect();
        let script = Script::new(rules(Timing::Controller), layers);
        let check = |lines: u64, from: u64, layer: u32, exposed: bool, at_mm: Option<f64>| {
            assert_eq!(script.standing(lines), Standing { from, layer, exposed, at_mm }, "{lines}");
        };
        check(0, 2, 0, false, None);
        check(5, 2, 0, false, None);
        // Down, and written down: its light may have been on.
        check(6, 2, 0, true, Some(0.05));
        check(10, 2, 0, true, Some(0.05));
        check(11, 13, 1, false, None);
        check(13, 13, 1, false, None);
        check(17, 13, 1, true, Some(0.1));
        check(22, 24, 2, false, None);
        check(34, 35, 3, false, None);
        check(35, 35, 3, false, None);
    }

    #[test]
    fn the_light_is_on_between_two_acknowledgements() {
        let check = |timing: Timing, expect: [&str; 2]| {
            let script = Script::new(rules(timing), vec![layer(0.05), layer(0.1)]);
            let all = lines(script.clone());
            let [on, off] = script.lit_between().unwrap();
            assert_eq!([on, off].map(|n| all[n as usize - 1].as_str()), expect);
        };
        check(Timing::Controller, ["M106 S255", "M107"]);
        check(Timing::Host, ["M106 S255", "M107"]);
        check(Timing::Pulse, ["M810 M106 S255|G4 P2500|M107", "M810"]);
    }

    #[test]
    fn questions_and_homing_come_once_and_first() {
        let asks = Check { what: "closed".into(), send: "M119".into(), wants: "open".into() };
        let rules = Rules { home: vec!["G28 Z".into()], checks: vec![asks], ..rules(Timing::Controller) };
        let script = Script::new(rules, vec![layer(0.05), layer(0.1)]);
        let all = lines(script.clone());
        assert_eq!(all[..6], ["M119", "M118 checked 0", "G28 Z", "G21", "G90", "G1 Z3.05 F200"]);
        assert_eq!(all.iter().filter(|l| *l == "G28 Z").count(), 1);
        for lines in 0..script.len() {
            assert!(script.standing(lines).from >= 5, "homed again over a part");
        }
    }

    #[test]
    fn an_exposure_that_was_accepted_in_part_is_torn() {
        let check = |timing: Timing, torn: &[u64], dark: &[u64]| {
            let script = Script::new(rules(timing), vec![layer(0.05), layer(0.1)]);
            let at = |is: fn(&Script) -> bool| -> Vec<u64> {
                let at = |lines: u64| {
                    let mut script = script.clone();
                    script.go_to(lines);
                    script
                };
                (0..=script.len()).filter(|lines| is(&at(*lines))).collect()
            };
            assert_eq!((at(Script::is_torn), at(Script::is_dark_yet)), (torn.to_vec(), dark.to_vec()));
        };
        check(Timing::Controller, &[8, 9, 19, 20], &[6, 7, 17, 18]);
        check(Timing::Host, &[8, 18], &[6, 7, 16, 17]);
        check(Timing::Pulse, &[], &[6, 7, 8, 16, 17, 18]);
    }
}
