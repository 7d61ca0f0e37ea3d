//! Proves that a result is the same job without its supports and nothing else.
//!
//! Takes both texts, layer by layer as they come, and reads both again. It shares with what
//! made them the language; none of their reasoning.
//!
//! What must hold:
//! - the result has no bead of supports
//! - all other beads are the same in their order: from and to, filament, feed rate, tool, what
//!   they are, width and height, the filament pushed again before them as far
//! - all other lines but moves of the head and of filament, and but what is said of beads, are
//!   the same in their order among those beads; those that may depend on where the nozzle is
//!   find it in the same place, the filament pulled back as far
//! - no move is faster than the file's fastest, no retraction deeper than its deepest, and the
//!   end is the same
use crate::merge::gcode::side::{Context, PULLED_MM, Side, UNIT_MM, near};
use outrigger_gcode::dialect::{Dialect, Mark};
use outrigger_gcode::line::{Command, Line, parse, split_lines};
use outrigger_gcode::state::{Effect, Kind, Move};
use std::collections::VecDeque;

/// Where the proof fails.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("by layer {layer}: {what}")]
pub struct Difference {
    /// Number of the layer that was read when it showed.
    pub layer: u32,
    /// What differs.
    pub what: What,
}

/// What differs.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum What {
    /// A bead of supports in the result.
    #[error("a bead of supports at {0:.3} {1:.3} is still there")]
    Support(f64, f64),
    /// A bead that is not the file's.
    #[error("a bead to {0:.3} {1:.3} would differ in {2}")]
    Bead(f64, f64, &'static str),
    /// A line that is not the file's.
    #[error("{0:?} would be lost, moved or new")]
    Line(String),
    /// A line that finds the machine elsewhere.
    #[error("{0:?} would find the nozzle elsewhere")]
    Elsewhere(String),
    /// A move that the file would not make.
    #[error("a move would go {0}")]
    Move(&'static str),
    /// The machine at the end.
    #[error("the end would not be as the file leaves it")]
    End,
}

/// What must come in the result.
enum Due {
    Bead(Move, Context, u16, f64),
    /// A line, and where it finds the nozzle if that may matter.
    Line(Vec<u8>, Option<Stand>),
}

/// Where the nozzle is, and how far the filament is pulled back, mm; by firmware as well.
type Stand = ([f64; 3], f64, bool);

/// Classic M commands that do not care where the nozzle is.
const ANYWHERE: [u16; 23] = [
    73, 82, 83, 104, 105, 106, 107, 108, 117, 118, 140, 141, 201, 203, 204, 205, 220, 221, 400, 486, 566,
    572, 900,
];

/// Compares two jobs layer by layer.
pub(super) struct Verifier {
    dialect: Dialect,
    before: Side,
    after: Side,
    due: VecDeque<Due>,
}

impl Verifier {
    pub(super) fn new(dialect: Dialect) -> Verifier {
        Verifier { dialect, before: Side::new(), after: Side::new(), due: VecDeque::new() }
    }

    /// Reads on in both; the result may be behind.
    ///
    /// # Errors
    /// What differs.
    pub(super) fn layer(&mut self, layer: u32, input: &[u8], result: &[u8]) -> Result<(), Difference> {
        for bytes in split_lines(input) {
            let read = read(&mut self.before, bytes, self.dialect);
            self.due.extend(read.filter(|due| !is_support(due)));
        }
        for bytes in split_lines(result) {
            let Some(found) = read(&mut self.after, bytes, self.dialect) else { continue };
            self.compare(&found).map_err(|what| Difference { layer, what })?;
        }
        Ok(())
    }

    fn compare(&mut self, found: &Due) -> Result<(), What> {
        if let (Due::Bead(m, ..), true) = (found, is_support(found)) {
            return Err(What::Support(m.to[0], m.to[1]));
        }
        match (self.due.pop_front(), found) {
            (Some(Due::Bead(a, was, tool, depth_mm)), Due::Bead(b, is, other, now_mm)) => {
                let checks = [
                    ("where it leads", near(a.from, b.from) && near(a.to, b.to)),
                    ("its arc", a.arc == b.arc),
                    ("its filament", (a.e - b.e).abs() < UNIT_MM),
                    ("its feed rate", a.feed == b.feed),
                    ("what it is", was == *is && tool == *other),
                    ("the filament before it", (depth_mm - now_mm).abs() < PULLED_MM),
                ];
                let fails = checks.iter().find(|(_, holds)| !holds);
                fails.map_or(Ok(()), |(what, _)| Err(What::Bead(b.to[0], b.to[1], what)))
            }
            (Some(Due::Line(a, was)), Due::Line(b, is)) if a == *b => match (was, is) {
                (Some(was), Some(is)) if !same(was, *is) => Err(What::Elsewhere(words(b))),
                _ => Ok(()),
            },
            (Some(Due::Line(a, _)), _) => Err(What::Line(words(&a))),
            (_, Due::Line(b, _)) => Err(What::Line(words(b))),
            (None, Due::Bead(b, ..)) => Err(What::Bead(b.to[0], b.to[1], "being there")),
        }
    }

    /// What holds for the jobs as wholes.
    ///
    /// # Errors
    /// What differs.
    pub(super) fn finish(self, layer: u32) -> Result<(), Difference> {
        let fails = |what| Err(Difference { layer, what });
        if let Some(due) = self.due.front() {
            return fails(match due {
                Due::Bead(m, ..) => What::Bead(m.to[0], m.to[1], "being there"),
                Due::Line(text, _) => What::Line(words(text)),
            });
        }
        let (a, b) = (&self.before, &self.after);
        if b.deepest_mm > a.deepest_mm + PULLED_MM {
            return fails(What::Move("with the filament pulled back deeper than the file does"));
        }
        if b.fastest > a.fastest {
            return fails(What::Move("faster than the file's own"));
        }
        let modes = |side: &Side| {
            let m = &side.machine;
            (m.absolute, m.e_is_absolute(), m.inches, m.tool, m.offset)
        };
        if !same(stand(a), stand(b)) || modes(a) != modes(b) {
            return fails(What::End);
        }
        Ok(())
    }
}

fn stand(side: &Side) -> Stand {
    (side.machine.position, side.depth_mm, side.machine.firmware_retracted)
}

fn same(a: Stand, b: Stand) -> bool {
    near(a.0, b.0) && (a.1 - b.1).abs() < PULLED_MM && a.2 == b.2
}

fn words(text: &[u8]) -> String {
    String::from_utf8_lossy(text).into_owned()
}

fn is_support(due: &Due) -> bool {
    matches!(due, Due::Bead(_, c, ..) if c.feature.is_support())
}

/// What a line must find again in the other text; `None` for what may differ.
fn read(side: &mut Side, bytes: &[u8], dialect: Dialect) -> Option<Due> {
    let line = parse(bytes);
    let before = stand(side);
    let own = side.context.feature;
    let mark = dialect.mark(&line);
    let effect = side.read(&line, dialect);
    let context = side.context;
    if let Some(Mark::Inline(_)) = mark {
        // What is said of one move holds for that one.
        side.context.feature = own;
    }
    match effect {
        Effect::Motion(m) if m.kind() == Kind::Deposit => {
            Some(Due::Bead(m, context, side.machine.tool, before.1))
        }
        Effect::Motion(_) | Effect::SetE | Effect::FirmwareRetract | Effect::FirmwareUnretract => None,
        Effect::Other if line.command == Command::None => match mark {
            Some(Mark::Feature(_) | Mark::Width(_) | Mark::Height(_) | Mark::WipeStart | Mark::WipeEnd) => {
                None
            }
            _ => said(bytes).map(|text| Due::Line(text, None)),
        },
        _ => said(bytes).map(|text| Due::Line(text, depends(&line).then_some(before))),
    }
}

fn said(bytes: &[u8]) -> Option<Vec<u8>> {
    let text = bytes.trim_ascii_end();
    (!text.is_empty()).then(|| text.to_vec())
}

fn depends(line: &Line<'_>) -> bool {
    match line.command {
        Command::Classic { letter: b'M', number, sub: None } => !ANYWHERE.contains(&number),
        Command::Named(name) => name != b"SET_VELOCITY_LIMIT" && name != b"SET_PRESSURE_ADVANCE",
        _ => true,
    }
}
