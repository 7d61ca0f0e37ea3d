//! Reads a job line by line and gives it layer by layer, each line typed.
//!
//! Takes a reader and the dialect; gives [`Layer`]s in turn. A layer ends just
//! before the first deposit of the next one, so that the way from layer to layer
//! belongs to the one that is left: a pass that ends a layer elsewhere can mend
//! that way. Memory is bounded by the largest layer; sizes are checked before
//! anything grows.
use super::layer::{Layer, Modes, Row, Span, Style, What};
use super::settings::Settings;
use crate::toolpath::cover::{Cover, Stroke};
use outrigger_gcode::dialect::{Dialect, Mark};
use outrigger_gcode::line::{Line, Words, parse};
use outrigger_gcode::state::{Effect, Kind, Machine};
use std::io::{BufRead, Read};

/// Longest line, bytes. Slicers' longest are configuration lines (start macros) of some kilobytes.
pub const MAX_LINE_BYTES: usize = 1 << 20;

/// Largest layer, bytes: some 60,000 moves, twice what a full plate of fine parts
/// has. Half a dozen layers are in work at once, each with its typed rows beside
/// its text: some 20 times this in all, which a Pi of 1 GB has room for.
pub const MAX_LAYER_BYTES: usize = 2 << 20;

/// Coordinates beyond this are no printer's, mm.
const MAX_COORDINATE_MM: f64 = 10_000.0;

/// A bead's width where the file does not say it, mm: that of a 0.4 mm nozzle.
const DEFAULT_WIDTH_MM: f64 = 0.45;

/// After so many deposits it shows whether E words are positions.
const TELLING_DEPOSITS: u64 = 100;

/// Why a file is left alone.
#[derive(Debug, thiserror::Error)]
pub enum Unfit {
    /// The reader failed.
    #[error("cannot read on after byte {byte}: {source}")]
    Read {
        /// Where.
        byte: u64,
        /// Why.
        source: std::io::Error,
    },
    /// A line longer than [`MAX_LINE_BYTES`].
    #[error("line {line} (byte {byte}) is longer than {MAX_LINE_BYTES} bytes: not G-code text")]
    LongLine {
        /// Counted from 1.
        line: u64,
        /// Where it begins.
        byte: u64,
    },
    /// A layer larger than [`MAX_LAYER_BYTES`].
    #[error("layer {layer} (from byte {byte}) is larger than {MAX_LAYER_BYTES} bytes")]
    LargeLayer {
        /// Number of the layer.
        layer: u32,
        /// Where it begins.
        byte: u64,
    },
    /// Control bytes that no text has.
    #[error("line {line} (byte {byte}) holds a zero byte: not G-code text")]
    Binary {
        /// Counted from 1.
        line: u64,
        /// Where it begins.
        byte: u64,
    },
    /// A position that no printer reaches.
    #[error("line {line} (byte {byte}) moves beyond {MAX_COORDINATE_MM} mm: no printer's coordinates")]
    Beyond {
        /// Counted from 1.
        line: u64,
        /// Where it begins.
        byte: u64,
    },
    /// E words that cannot be positions, as they are said to be.
    #[error(
        "by line {line} E fell and rose again within {falls} of {deposits} extrusions: it is not what M82 and M83 in the file say"
    )]
    Backwards {
        /// Counted from 1.
        line: u64,
        /// Deposits right after a move that pulled filament back.
        falls: u64,
        /// Deposits in all.
        deposits: u64,
    },
    /// A motion that cannot be read for sure: firmware and we might differ.
    #[error("line {line} moves, but cannot be read for sure: damaged, or a word without a number, or twice")]
    Garbled {
        /// Counted from 1.
        line: u64,
    },
    /// Lines that carry numbers and checksums already.
    #[error("line {line} carries a line number; numbered files are passed through")]
    Numbered {
        /// Counted from 1.
        line: u64,
    },
    /// A layer mark of another dialect.
    #[error("line {line} marks a layer as {other} does, the file is {dialect}'s: mixed dialects")]
    Mixed {
        /// Counted from 1.
        line: u64,
        /// The file's.
        dialect: &'static str,
        /// The line's.
        other: &'static str,
    },
}

/// Gives the layers of a job.
pub struct Layers<R> {
    reader: R,
    dialect: Dialect,
    machine: Machine,
    settings: Settings,
    style: Style,
    line: u64,
    byte: u64,
    number: u32,
    /// A layer mark was read, and no deposit since.
    marked: bool,
    first_z: Option<f64>,
    /// Deposits, and those right after a move that pulled filament back.
    deposits: u64,
    falls: u64,
    fell: bool,
    /// Room for the next layer: bytes and rows.
    usual: (usize, usize),
    /// The first deposit of the next layer, read already.
    held: Vec<u8>,
    done: bool,
    /// Layers know where they are printed.
    covers: bool,
}

impl<R: BufRead> Layers<R> {
    /// Reads from the beginning of a job.
    pub fn new(reader: R, dialect: Dialect) -> Layers<R> {
        Layers {
            reader,
            dialect,
            machine: Machine::default(),
            settings: Settings::default(),
            style: Style::default(),
            line: 0,
            byte: 0,
            number: 0,
            marked: false,
            first_z: None,
            deposits: 0,
            falls: 0,
            fell: false,
            usual: (0, 0),
            held: Vec::new(),
            done: false,
            covers: true,
        }
    }

    /// The same, for whoever asks no layer for its cover: that takes a third of the time.
    #[must_use]
    pub fn without_covers(self) -> Layers<R> {
        Layers { covers: false, ..self }
    }

    /// The next layer, `None` after the last.
    ///
    /// # Errors
    /// What makes the file unfit, see [`Unfit`].
    pub fn next_layer(&mut self) -> Result<Option<Layer>, Unfit> {
        if self.done && self.held.is_empty() {
            return Ok(None);
        }
        let from_byte = self.byte;
        let mut layer = self.begin();
        let held = std::mem::take(&mut self.held);
        if !held.is_empty() {
            let at = layer.text.len();
            layer.text.extend_from_slice(&held);
            self.read_row(&mut layer, at)?;
        }
        while !self.done {
            let at = layer.text.len();
            if !self.read_line(&mut layer.text)? {
                self.done = true;
                break;
            }
            if layer.text.len() > MAX_LAYER_BYTES {
                return Err(Unfit::LargeLayer { layer: self.number, byte: from_byte });
            }
            if self.marked && self.deposits(&layer.text[at..]) {
                self.marked = false;
                self.number += 1;
                self.held = layer.text.split_off(at);
                break;
            }
            self.read_row(&mut layer, at)?;
        }
        self.finish(&mut layer);
        Ok(Some(layer))
    }

    fn begin(&self) -> Layer {
        let (usual_text, usual_rows) = self.usual;
        let mut text = Vec::with_capacity(usual_text);
        let state = self.settings.state(&mut text, self.machine.tool);
        let start = text.len() as u32;
        Layer {
            number: self.number,
            text,
            input: Span { start, end: start },
            rows: Vec::with_capacity(usual_rows),
            states: vec![state],
            start: self.machine.clone(),
            end: self.machine.clone(),
            is_first: false,
            cover: None,
            style: self.style,
        }
    }

    fn finish(&mut self, layer: &mut Layer) {
        // Layers are much alike: the next one needs about as much room.
        self.usual = (layer.text.len() * 9 / 8, layer.rows.len() * 9 / 8);
        layer.input.end = layer.text.len() as u32;
        layer.end = self.machine.clone();
        layer.style = self.style;
        let z = layer.rows.iter().find_map(|row| match row.what {
            What::Move(m, Kind::Deposit) => Some(m.to[2]),
            _ => None,
        });
        if let Some(z) = z.filter(|_| layer.number > 0) {
            // One object after another: each begins on the plate again.
            layer.is_first = z <= *self.first_z.get_or_insert(z) + 1e-6;
        }
        layer.cover = if self.covers { cover(layer) } else { None };
    }

    fn read_line(&mut self, text: &mut Vec<u8>) -> Result<bool, Unfit> {
        let at = text.len();
        let read = (&mut self.reader)
            .take(MAX_LINE_BYTES as u64 + 1)
            .read_until(b'\n', text)
            .map_err(|source| Unfit::Read { byte: self.byte, source })?;
        if read == 0 {
            return Ok(false);
        }
        self.line += 1;
        if text.len() - at > MAX_LINE_BYTES {
            return Err(Unfit::LongLine { line: self.line, byte: self.byte });
        }
        if memchr::memchr(0, &text[at..]).is_some() {
            return Err(Unfit::Binary { line: self.line, byte: self.byte });
        }
        self.byte += read as u64;
        Ok(true)
    }

    fn deposits(&self, bytes: &[u8]) -> bool {
        let effect = self.machine.clone().apply(&parse(bytes));
        matches!(effect, Effect::Motion(m) if m.kind() == Kind::Deposit)
    }

    /// Types the line at `at`, the last of the layer's text.
    fn read_row(&mut self, layer: &mut Layer, at: usize) -> Result<(), Unfit> {
        let Layer { text, states, rows, .. } = layer;
        let span = Span { start: at as u32, end: text.len() as u32 };
        let line = parse(&text[at..]);
        if !line.number.is_empty() {
            return Err(Unfit::Numbered { line: self.line });
        }
        self.learn_style(&line);
        let effect = self.machine.apply(&line);
        if self.machine.position.iter().any(|p| !p.is_finite() || p.abs() > MAX_COORDINATE_MM) {
            return Err(Unfit::Beyond { line: self.line, byte: self.byte - (text.len() - at) as u64 });
        }
        let moves = matches!(effect, Effect::Motion(_) | Effect::SetE | Effect::SetPosition);
        if moves && !is_plain(line.words) {
            return Err(Unfit::Garbled { line: self.line });
        }
        self.refuse_backwards(effect)?;
        let mark = self.mark(&line)?;
        let mut state = *states.last().unwrap_or_else(|| unreachable!("a layer begins with a state"));
        let before = state;
        let what = match effect {
            Effect::Motion(m) => {
                if let Some(Mark::Inline(feature)) = mark {
                    self.settings.feature = feature;
                    state.feature = feature;
                }
                What::Move(m, m.kind())
            }
            Effect::FirmwareRetract => What::Retract,
            Effect::FirmwareUnretract => What::Unretract,
            Effect::SetE => What::SetE(self.machine.e),
            Effect::Mode => What::Mode(Modes::from(&self.machine)),
            Effect::SetPosition | Effect::Home | Effect::Tool(_) => What::Anchor,
            Effect::Other => self.settings.what(&line, mark, span, &mut state),
        };
        state.tool = self.machine.tool;
        // A setting line runs under what was in force before it, a move under its own inline mark.
        if state != before && matches!(what, What::Move(..)) {
            states.push(state);
        }
        rows.push(Row { span, what, state: states.len() as u32 - 1 });
        if state != before && !matches!(what, What::Move(..)) {
            states.push(state);
        }
        Ok(())
    }

    /// What the line says, and whether a layer begins.
    fn mark<'a>(&mut self, line: &Line<'a>) -> Result<Option<Mark<'a>>, Unfit> {
        let mark = self.dialect.mark(line);
        if mark == Some(Mark::Layer) {
            self.marked = true;
        } else if mark.is_none() && line.is_comment() {
            self.refuse_other_dialects(line)?;
        }
        Ok(mark)
    }

    fn refuse_other_dialects(&self, line: &Line<'_>) -> Result<(), Unfit> {
        let other = [Dialect::Prusa, Dialect::Bambu, Dialect::Cura]
            .into_iter()
            .find(|other| other.mark(line) == Some(Mark::Layer));
        match other {
            Some(other) => {
                Err(Unfit::Mixed { line: self.line, dialect: self.dialect.name(), other: other.name() })
            }
            None => Ok(()),
        }
    }

    /// A start macro may hide an `M83`: the file's E words are distances then, and
    /// read as positions they fall and rise from move to move. In honest files
    /// what a wipe pulled back is pushed again before the next extrusion.
    fn refuse_backwards(&mut self, effect: Effect) -> Result<(), Unfit> {
        let Effect::Motion(m) = effect else { return Ok(()) };
        match m.kind() {
            Kind::Deposit => {
                self.deposits += 1;
                self.falls += u64::from(std::mem::replace(&mut self.fell, false));
            }
            Kind::Wipe => self.fell = true,
            Kind::Filament => self.fell &= m.e < 0.0,
            Kind::Travel | Kind::Still => {}
        }
        let (deposits, falls) = (self.deposits, self.falls);
        if self.machine.e_is_absolute() && deposits >= TELLING_DEPOSITS && falls * 10 > deposits {
            return Err(Unfit::Backwards { line: self.line, falls, deposits });
        }
        Ok(())
    }

    fn learn_style(&mut self, line: &Line<'_>) {
        self.style.crlf = line.ending == b"\r\n";
        for word in line.words.as_slice() {
            match word.letter {
                b'X' | b'Y' | b'Z' | b'I' | b'J' => {
                    self.style.xyz_decimals = self.style.xyz_decimals.max(word.decimals);
                }
                b'E' => self.style.e_decimals = self.style.e_decimals.max(word.decimals),
                _ => continue,
            }
            self.style.bare_point |= word.bare_point;
        }
    }
}

/// Whether every word has a number, and no letter comes twice.
fn is_plain(words: Words) -> bool {
    let list = words.as_slice();
    let once = |k: usize| list[..k].iter().all(|w| w.letter != list[k].letter);
    words.complete && (0..list.len()).all(|k| list[k].value.is_some() && once(k))
}

/// Where the part is printed in a layer.
fn cover(layer: &Layer) -> Option<Cover> {
    let mut strokes: Vec<Stroke> = Vec::new();
    for row in &layer.rows {
        let What::Move(m, Kind::Deposit) = row.what else { continue };
        let state = layer.state(row);
        if !state.feature.is_part() {
            continue;
        }
        let width = if state.width_mm > 0.0 { state.width_mm } else { DEFAULT_WIDTH_MM };
        m.chords(|a, b| strokes.push((a, b, width)));
    }
    Cover::new(&strokes)
}

#[cfg(test)]
mod tests {
    use super::super::layer::Channel;
    use super::*;
    use outrigger_gcode::dialect::Feature;

    fn layers(text: &str) -> Vec<Layer> {
        let mut reader = Layers::new(text.as_bytes(), Dialect::Prusa);
        let mut layers = Vec::new();
        while let Some(layer) = reader.next_layer().unwrap() {
            layers.push(layer);
        }
        layers
    }

    fn refusal(text: &[u8]) -> Unfit {
        let mut reader = Layers::new(text, Dialect::Prusa);
        loop {
            match reader.next_layer() {
                Ok(Some(_)) => {}
                Ok(None) => panic!("fit"),
                Err(unfit) => return unfit,
            }
        }
    }

    const TWO: &str = "M83\nG1 X1 E1\n;LAYER_CHANGE\n;Z:.2\nG1 Z.2\nG1 X0 Y0\n;TYPE:Perimeter\n;WIDTH:0.5\nG1 X9 E.5\n;LAYER_CHANGE\nG1 Z.4\nG1 X5 E.25\n;TYPE:Internal infill\nG1 X6 E.1";

    #[test]
    fn layers_end_before_the_next_first_deposit() {
        let layers = layers(TWO);
        let inputs: Vec<String> =
            layers.iter().map(|l| String::from_utf8(l.input().to_vec()).unwrap()).collect();
        assert_eq!(inputs.concat(), TWO);
        assert!(inputs[1].starts_with("G1 X9 E.5") && inputs[2].starts_with("G1 X5 E.25"));
        assert_eq!(layers.iter().map(|l| l.number).collect::<Vec<_>>(), [0, 1, 2]);
        assert_eq!(layers.iter().map(|l| l.is_first).collect::<Vec<_>>(), [false, true, false]);
        assert_eq!(layers[1].end, layers[2].start);
        assert_eq!(layers[2].style, Style { xyz_decimals: 1, e_decimals: 2, bare_point: true, crlf: false });
        for layer in &layers {
            let mut out = Vec::new();
            layer.write(&mut out);
            assert_eq!(out, layer.input());
        }
    }

    #[test]
    fn what_is_in_force_is_carried_into_the_next_layer() {
        let layers = layers(TWO);
        let layer = &layers[2];
        let at_first = layer.state(&layer.rows[0]);
        assert_eq!(layer.bytes(at_first.channels[Channel::Type as usize]), b";TYPE:Perimeter\n");
        assert_eq!(layer.bytes(at_first.channels[Channel::Width as usize]), b";WIDTH:0.5\n");
        assert_eq!((at_first.feature, at_first.width_mm), (Feature::Perimeter, 0.5));
        assert_eq!(layer.state(&layer.rows[2]).feature, Feature::Infill);
    }

    #[test]
    fn unfit_files_are_told_apart() {
        let long = [vec![b'G'; MAX_LINE_BYTES + 1], b"\n".to_vec()].concat();
        let check = |text: &[u8], expect: &str| {
            let got = refusal(text).to_string();
            assert!(got.contains(expect), "{got}");
        };
        check(&long, "line 1 (byte 0) is longer");
        check(b"G1 X1\nG1\0\n", "line 2 (byte 6) holds a zero byte");
        check(b"G1 X99999999\n", "line 1 (byte 0) moves beyond");
        let hidden = (1..=150).map(|k| format!("G1 X{k} E.5\nG1 Y{k} E.25\n")).collect::<String>();
        check(hidden.as_bytes(), "by line 199 E fell and rose again within 99 of 100 extrusions");
        for garbled in ["G1 X1<2 E1\n", "G1 X Y1\n", "G1 X1 X2\n", "G92 E\n"] {
            check(garbled.as_bytes(), "line 1 moves, but cannot be read for sure");
        }
        check(b"N1 G1 X1*97\n", "line 1 carries a line number");
        check(b";LAYER_CHANGE\n;LAYER:3\n", "line 2 marks a layer as Cura");
        check(&b"G1 X1 ; padding padding padding\n".repeat(MAX_LAYER_BYTES / 32 + 1), "is larger than");
    }
}
