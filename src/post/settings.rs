//! The modal settings in force, and what the line that sets one is to a pass.
//!
//! A moved bead takes its settings along, by the text of the line that set each.
//! That works only while a channel is always set by lines of one form: after
//! `M204 S800` the line `M204 T3000` is no replacement. So a line is a
//! [`What::Channel`] when the channel was set before by a line that sets the
//! same letters, else a barrier (and the text to go by from then on).
use super::layer::{Channel, Span, State, What};
use outrigger_gcode::dialect::{Feature, Mark, ObjectMark};
use outrigger_gcode::line::{Command, Line, key_value};

/// Most objects told apart by name; all later ones count as one. A plate holds some hundred at most.
const MAX_OBJECTS: usize = 10_000;

/// What is in force after the lines read so far.
#[derive(Clone, Debug)]
pub(super) struct Settings {
    channels: [Vec<u8>; Channel::COUNT],
    /// Which letters the channel's text sets.
    forms: [Vec<u8>; Channel::COUNT],
    pub(super) feature: Feature,
    width_mm: f64,
    object: u32,
    objects: Vec<Vec<u8>>,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            channels: Default::default(),
            forms: Default::default(),
            feature: Feature::Unknown,
            width_mm: 0.0,
            object: 0,
            objects: Vec::new(),
        }
    }
}

impl Settings {
    /// The state at the beginning of a layer; the channels' texts go into the layer's.
    pub(super) fn state(&self, text: &mut Vec<u8>, tool: u16) -> State {
        let channels = std::array::from_fn(|k| {
            let start = text.len() as u32;
            text.extend_from_slice(&self.channels[k]);
            Span { start, end: text.len() as u32 }
        });
        State { channels, feature: self.feature, width_mm: self.width_mm, object: self.object, tool }
    }

    /// What a line that moves nothing is; `state` becomes what is in force after it.
    pub(super) fn what(
        &mut self,
        line: &Line<'_>,
        mark: Option<Mark<'_>>,
        span: Span,
        state: &mut State,
    ) -> What {
        if let Some(mark) = mark {
            return self.marked(line, mark, span, state);
        }
        match line.command {
            Command::None if line.comment.is_empty() => What::Quiet,
            Command::None => What::Barrier,
            Command::Classic { letter: b'M', number: 73, .. } => What::Progress,
            Command::Classic { letter: b'M', number, sub: None } => match channel(line, number) {
                Some(channel) => self.set(channel, line, span, state),
                None if INDIFFERENT.contains(&number) => What::Barrier,
                None => What::Anchor,
            },
            Command::Named(b"SET_VELOCITY_LIMIT") => self.set(Channel::Acceleration, line, span, state),
            Command::Named(b"SET_PRESSURE_ADVANCE") => self.set(Channel::PressureAdvance, line, span, state),
            _ => What::Anchor,
        }
    }

    fn marked(&mut self, line: &Line<'_>, mark: Mark<'_>, span: Span, state: &mut State) -> What {
        match mark {
            Mark::Feature(feature) => {
                self.feature = feature;
                state.feature = feature;
                self.set(Channel::Type, line, span, state)
            }
            Mark::Width(width_mm) => {
                self.width_mm = width_mm;
                state.width_mm = width_mm;
                self.set(Channel::Width, line, span, state)
            }
            Mark::Height(_) => self.set(Channel::Height, line, span, state),
            Mark::WipeStart | Mark::WipeEnd => What::WipeMark,
            Mark::Note => What::Quiet,
            Mark::Object(object) => {
                self.object(object);
                state.object = self.object;
                What::Barrier
            }
            Mark::Layer | Mark::Z(_) | Mark::Tower | Mark::Inline(_) => What::Barrier,
        }
    }

    fn object(&mut self, mark: ObjectMark<'_>) {
        match mark {
            ObjectMark::Begin(name) => {
                let known = self.objects.iter().position(|o| o == name);
                let index = known.unwrap_or_else(|| {
                    if self.objects.len() < MAX_OBJECTS {
                        self.objects.push(name.to_vec());
                    }
                    self.objects.len() - 1
                });
                self.object = index as u32 + 1;
            }
            ObjectMark::End => self.object = 0,
            ObjectMark::Define => {}
        }
    }

    fn set(&mut self, channel: Channel, line: &Line<'_>, span: Span, state: &mut State) -> What {
        let k = channel as usize;
        let form = form(line);
        let replaces = !self.channels[k].is_empty() && self.forms[k] == form;
        self.channels[k].clear();
        outrigger_gcode::line::write(line, &mut self.channels[k]);
        self.forms[k] = form;
        state.channels[k] = span;
        for &other in clears(channel) {
            self.channels[other as usize].clear();
            state.channels[other as usize] = Span::default();
        }
        if replaces { What::Channel(channel) } else { What::Barrier }
    }
}

/// Commands after which it does not matter where the nozzle is.
const INDIFFERENT: [u16; 13] = [82, 83, 104, 105, 108, 117, 118, 140, 141, 220, 221, 400, 486];

fn channel(line: &Line<'_>, number: u16) -> Option<Channel> {
    match number {
        106 | 107 => Some(Channel::Fan),
        201 | 203 | 205 | 566 => Some(Channel::Limits),
        204 => Some(match line.words.as_slice() {
            [only] if only.letter == b'P' => Channel::PrintAcceleration,
            [only] if only.letter == b'T' => Channel::TravelAcceleration,
            _ => Channel::Acceleration,
        }),
        572 | 900 => Some(Channel::PressureAdvance),
        _ => None,
    }
}

/// Setting one of these makes the text of the others worthless.
fn clears(channel: Channel) -> &'static [Channel] {
    match channel {
        Channel::Acceleration => &[Channel::PrintAcceleration, Channel::TravelAcceleration],
        Channel::PrintAcceleration | Channel::TravelAcceleration => &[Channel::Acceleration],
        _ => &[],
    }
}

/// Which letters or keys a line sets, and for which fan, tool or extruder.
fn form(line: &Line<'_>) -> Vec<u8> {
    let mut form = Vec::new();
    match line.command {
        // M107 is M106 S0.
        Command::Classic { letter: b'M', number: 106 | 107, .. } => {
            form.extend_from_slice(b"fan");
            if let Some(word) = line.words.as_slice().iter().find(|w| w.letter == b'P')
                && word.value != Some(0.0)
            {
                form.extend_from_slice(line.written(word));
            }
        }
        Command::Classic { number, .. } => {
            form.extend_from_slice(&number.to_le_bytes());
            for word in line.words.as_slice() {
                form.push(word.letter);
                if word.letter == b'D' || (number != 204 && word.letter == b'T') {
                    form.extend_from_slice(line.written(word));
                }
            }
        }
        Command::Named(name) => {
            form.extend_from_slice(name);
            let mut rest = line.args;
            while let Ok((left, (key, value))) = key_value(rest) {
                form.extend_from_slice(key);
                if key == b"EXTRUDER" {
                    form.extend_from_slice(value);
                }
                rest = left;
            }
        }
        Command::None | Command::Unknown => {}
    }
    form
}

#[cfg(test)]
mod tests {
    use super::*;
    use outrigger_gcode::dialect::Dialect;
    use outrigger_gcode::line::parse;

    /// What each of the lines is, one after the other.
    fn check(lines: &[(&str, What)]) {
        let mut settings = Settings::default();
        let mut state = settings.state(&mut Vec::new(), 0);
        for (k, (text, expect)) in lines.iter().enumerate() {
            let line = parse(text.as_bytes());
            let mark = Dialect::Prusa.mark(&line);
            let span = Span { start: k as u32, end: k as u32 + 1 };
            assert_eq!(settings.what(&line, mark, span, &mut state), *expect, "line {k}: {text}");
        }
    }

    #[test]
    fn a_channel_is_one_only_when_it_replaces_its_like() {
        use What::{Anchor, Barrier, Channel as Set, Progress, Quiet, WipeMark};
        check(&[
            ("M204 S800", Barrier),
            ("M204 S1000", Set(Channel::Acceleration)),
            ("M204 T3000", Barrier),
            ("M204 P1000", Barrier),
            ("M204 P800", Set(Channel::PrintAcceleration)),
            ("M204 T4000", Set(Channel::TravelAcceleration)),
            ("M204 S1000", Barrier),
            ("M204 P800", Barrier),
        ]);
        check(&[
            ("M106 S100", Barrier),
            ("M107", Set(Channel::Fan)),
            ("M106 P0 S10", Set(Channel::Fan)),
            ("M106 P1 S10", Barrier),
            ("M106 S10", Barrier),
        ]);
        check(&[
            ("SET_PRESSURE_ADVANCE ADVANCE=0.05 EXTRUDER=extruder", Barrier),
            ("SET_PRESSURE_ADVANCE ADVANCE=0.04 EXTRUDER=extruder", Set(Channel::PressureAdvance)),
            ("SET_PRESSURE_ADVANCE ADVANCE=0.04 EXTRUDER=extruder1", Barrier),
        ]);
        check(&[
            ("", Quiet),
            ("; a note", Barrier),
            (";AFTER_LAYER_CHANGE", Quiet),
            (";WIPE_START", WipeMark),
            ("M73 P5", Progress),
            ("M104 S200", Barrier),
            ("M600", Anchor),
            ("TIMELAPSE_TAKE_FRAME", Anchor),
            ("%", Anchor),
            ("M862.3 P \"MK3S\"", Anchor),
        ]);
    }

    #[test]
    fn objects_are_numbered_by_name() {
        let mut settings = Settings::default();
        let mut state = settings.state(&mut Vec::new(), 0);
        let mut numbers = Vec::new();
        for text in ["M486 S0", "M486 S1", "M486 S-1", "M486 S0", "M486 T3"] {
            let line = parse(text.as_bytes());
            settings.what(&line, Dialect::Prusa.mark(&line), Span::default(), &mut state);
            numbers.push(state.object);
        }
        assert_eq!(numbers, [1, 2, 0, 1, 1]);
    }
}
