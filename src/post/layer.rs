//! One layer of a job as typed lines: what passes read and rewrite.
//!
//! A [`Layer`] owns its text. Its rows are the lines in the order in which they
//! will be written; a pass drops, reorders and adds rows and never touches the
//! text that other rows stand on.
use crate::toolpath::cover::Cover;
use outrigger_gcode::dialect::Feature;
use outrigger_gcode::state::{Kind, Machine, Move};

/// A stretch of a layer's text.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Span {
    /// First byte.
    pub start: u32,
    /// One past the last byte.
    pub end: u32,
}

/// Modal settings that go with a bead wherever it is moved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channel {
    /// `;TYPE:` and its like.
    Type,
    /// `;WIDTH:` and its like.
    Width,
    /// `;HEIGHT:` and its like.
    Height,
    /// `M201`, `M203`, `M205`, `M566`.
    Limits,
    /// `M204 S`, or with several letters; `SET_VELOCITY_LIMIT`.
    Acceleration,
    /// `M204 P` alone.
    PrintAcceleration,
    /// `M204 T` alone.
    TravelAcceleration,
    /// `M900`, `M572`, `SET_PRESSURE_ADVANCE`.
    PressureAdvance,
    /// `M106`, `M107`.
    Fan,
}

impl Channel {
    /// How many there are.
    pub const COUNT: usize = 9;
    /// All, in the order in which they are written before a bead.
    pub const ALL: [Channel; Channel::COUNT] = [
        Channel::Type,
        Channel::Width,
        Channel::Height,
        Channel::Limits,
        Channel::Acceleration,
        Channel::PrintAcceleration,
        Channel::TravelAcceleration,
        Channel::PressureAdvance,
        Channel::Fan,
    ];
    /// Those that slicers change for a travel.
    pub const OF_TRAVEL: [Channel; 4] =
        [Channel::Limits, Channel::Acceleration, Channel::PrintAcceleration, Channel::TravelAcceleration];
}

/// What is in force: the text of the line that last set each channel (empty:
/// none did), and what is being printed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// By `Channel as usize`.
    pub channels: [Span; Channel::COUNT],
    /// What is printed.
    pub feature: Feature,
    /// Width of the bead, mm; 0 when not said.
    pub width_mm: f64,
    /// A number for each object, 0 outside all.
    pub object: u32,
    /// The tool.
    pub tool: u16,
}

/// What a line is to a pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum What {
    /// `G0` to `G3`, with the kind of the move.
    Move(Move, Kind),
    /// `G10`.
    Retract,
    /// `G11`.
    Unretract,
    /// `G92 E…`; the value set, mm.
    SetE(f64),
    /// Sets a channel.
    Channel(Channel),
    /// `;WIPE_START`, `;WIPE_END`.
    WipeMark,
    /// `M73`: goes with the time, not with a bead.
    Progress,
    /// Blank, or a comment that says nothing of the moves.
    Quiet,
    /// `G90`, `G91`, `M82`, `M83`, `G20`, `G21`: what holds after it.
    Mode(Modes),
    /// Never crossed by a moved bead, and does not care where the nozzle is.
    Barrier,
    /// Never crossed, and may depend on where the nozzle is (macros, tool changes, unknown commands).
    Anchor,
}

/// How coordinates are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Modes {
    /// `G90`.
    pub absolute: bool,
    /// E words are positions.
    pub absolute_e: bool,
    /// `G20`.
    pub inches: bool,
}

impl From<&Machine> for Modes {
    fn from(machine: &Machine) -> Self {
        Modes { absolute: machine.absolute, absolute_e: machine.e_is_absolute(), inches: machine.inches }
    }
}

/// One line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Its text in [`Layer::text`], line ending included.
    pub span: Span,
    /// What it is.
    pub what: What,
    /// Index into [`Layer::states`] of what is in force when it runs.
    pub state: u32,
}

/// From one layer's first deposit to the next one's; the first also has what comes before.
#[derive(Clone, Debug)]
pub struct Layer {
    /// 0 for what stands before the first layer mark, then counted from 1.
    pub number: u32,
    /// The text of what is in force at the beginning, then the input, then what passes add.
    pub text: Vec<u8>,
    /// Where the input stands in `text`.
    pub input: Span,
    /// The lines.
    pub rows: Vec<Row>,
    /// What is in force, by index.
    pub states: Vec<State>,
    /// The machine before the first row, of the file as it was read.
    pub start: Machine,
    /// The machine after the last row.
    pub end: Machine,
    /// Whether this is a first layer on the plate.
    pub is_first: bool,
    /// Where the part is printed in this layer.
    pub cover: Option<Cover>,
    /// How this file writes its numbers.
    pub style: Style,
}

/// How a file writes its numbers, as far as it has been read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Style {
    /// Most decimals of X, Y, Z, I, J.
    pub xyz_decimals: u8,
    /// Most decimals of E.
    pub e_decimals: u8,
    /// `.5`, not `0.5`.
    pub bare_point: bool,
    /// Lines end in `\r\n`.
    pub crlf: bool,
}

impl Style {
    /// How a line ends.
    #[must_use]
    pub fn ending(self) -> &'static [u8] {
        if self.crlf { b"\r\n" } else { b"\n" }
    }
}

impl Layer {
    /// The text of a span.
    #[must_use]
    pub fn bytes(&self, span: Span) -> &[u8] {
        &self.text[span.start as usize..span.end as usize]
    }

    /// The layer as it was read.
    #[must_use]
    pub fn input(&self) -> &[u8] {
        self.bytes(self.input)
    }

    /// Appends the layer as it is now.
    pub fn write(&self, out: &mut Vec<u8>) {
        for row in &self.rows {
            out.extend_from_slice(self.bytes(row.span));
        }
    }

    /// What is in force at a row.
    #[must_use]
    pub fn state(&self, row: &Row) -> &State {
        &self.states[row.state as usize]
    }
}
