//! What slicers say in their comments, as types.
//!
//! Takes parsed lines, gives [`Mark`]s. One dialect a file; [`Dialect::ALL`]
//! lists them. Knows no machine state: what a mark means for the moves after it
//! is the reader's business.
mod bambu;
mod cura;
mod layer;
mod object;
mod orca;
mod prusa;
pub mod settings;
mod slic3r;

use crate::line::{Command, Line, parse, split_lines};
pub use layer::{LayerMark, layer_mark};
pub use object::{ObjectMark, object};

/// What a stretch of the print is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Feature {
    /// Nothing said so far.
    Unknown,
    /// The outermost wall, which shows.
    ExternalPerimeter,
    /// Any other wall.
    Perimeter,
    /// A wall over air.
    OverhangPerimeter,
    /// Sparse infill.
    Infill,
    /// Solid infill; bottoms that show are among it (PrusaSlicer).
    SolidInfill,
    /// Solid infill that shows from above.
    TopSolidInfill,
    /// Solid infill that shows from below.
    BottomSurface,
    /// Cura's `SKIN`: solid infill, tops and bottoms alike.
    Skin,
    /// Slic3r's inline `infill`: sparse, solid and top alike.
    AnyInfill,
    /// Solid infill over air.
    Bridge,
    /// Solid infill over sparse infill.
    InternalBridge,
    /// Thin beads between walls.
    GapFill,
    /// A second pass over a top.
    Ironing,
    /// Support and raft.
    Support,
    /// What touches the part.
    SupportInterface,
    /// Skirt and brim.
    Skirt,
    /// Wipe or prime tower.
    Tower,
    /// Start, end and other macros.
    Custom,
}

impl Feature {
    /// A wall of the part.
    #[must_use]
    pub fn is_perimeter(self) -> bool {
        matches!(self, Feature::ExternalPerimeter | Feature::Perimeter | Feature::OverhangPerimeter)
    }

    /// Holds the part, and is taken away.
    #[must_use]
    pub fn is_support(self) -> bool {
        matches!(self, Feature::Support | Feature::SupportInterface)
    }

    /// Belongs to the part, and stays when supports are taken away.
    #[must_use]
    pub fn is_part(self) -> bool {
        !matches!(
            self,
            Feature::Unknown
                | Feature::Support
                | Feature::SupportInterface
                | Feature::Skirt
                | Feature::Tower
                | Feature::Custom
        )
    }
}

/// What a line says beside what it does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mark<'a> {
    /// A layer begins.
    Layer,
    /// The layer's height above the bed, mm.
    Z(f64),
    /// The thickness of what follows, mm.
    Height(f64),
    /// The width of what follows, mm.
    Width(f64),
    /// What follows is this.
    Feature(Feature),
    /// The move on this line alone is this (Slic3r's inline comments).
    Inline(Feature),
    /// A wipe begins.
    WipeStart,
    /// A wipe ends.
    WipeEnd,
    /// An object begins or ends.
    Object(ObjectMark<'a>),
    /// A wipe tower begins or ends.
    Tower,
    /// Known, and says nothing of the moves (times, notes).
    Note,
}

/// A family of slicers that comment alike.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dialect {
    /// PrusaSlicer, SuperSlicer.
    Prusa,
    /// OrcaSlicer.
    Orca,
    /// Bambu Studio, and OrcaSlicer for Bambu printers.
    Bambu,
    /// Cura.
    Cura,
    /// Slic3r 1.3 with verbose G-code.
    Slic3r,
}

/// What [`detect`] found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Detection {
    /// One dialect.
    One(Dialect),
    /// None that is known.
    Unknown,
    /// Layer marks of two dialects.
    Mixed(Dialect, Dialect),
}

impl Dialect {
    /// Every dialect.
    pub const ALL: [Dialect; 5] =
        [Dialect::Prusa, Dialect::Orca, Dialect::Bambu, Dialect::Cura, Dialect::Slic3r];

    /// The name for people.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Dialect::Prusa => "PrusaSlicer",
            Dialect::Orca => "OrcaSlicer",
            Dialect::Bambu => "Bambu Studio",
            Dialect::Cura => "Cura",
            Dialect::Slic3r => "Slic3r",
        }
    }

    /// What the line says in this dialect; `None` when it says nothing known.
    #[must_use]
    pub fn mark<'a>(self, line: &Line<'a>) -> Option<Mark<'a>> {
        // Nearly every line is a bare motion, which says nothing.
        let mute = line.comment.is_empty()
            && !matches!(line.command, Command::Named(_) | Command::Classic { letter: b'M', .. });
        if mute {
            return None;
        }
        if let Some(object) = object(line) {
            return Some(Mark::Object(object));
        }
        match self {
            Dialect::Prusa => prusa::mark(line),
            Dialect::Orca => orca::mark(line),
            Dialect::Bambu => bambu::mark(line),
            Dialect::Cura => cura::mark(line),
            Dialect::Slic3r => slic3r::mark(line),
        }
    }

    /// Whether the line names this dialect's slicer as the one that made the file.
    fn signed(self, line: &Line<'_>) -> bool {
        let says = |text: &[u8]| contains(line.comment, text);
        match self {
            Dialect::Prusa => says(b"generated by PrusaSlicer") || says(b"generated by SuperSlicer"),
            Dialect::Orca => says(b"generated by OrcaSlicer"),
            Dialect::Bambu => says(b"BambuStudio"),
            Dialect::Cura => says(b"Cura_SteamEngine"),
            Dialect::Slic3r => says(b"generated by Slic3r 1."),
        }
    }

    /// Whether layers are marked as this dialect marks them, whoever signed.
    fn layers_like(self, other: Dialect) -> bool {
        let group = |d: Dialect| match d {
            Dialect::Prusa | Dialect::Orca => 0,
            Dialect::Bambu => 1,
            Dialect::Cura => 2,
            Dialect::Slic3r => 3,
        };
        group(self) == group(other)
    }
}

/// Tells the dialect of a file by its beginning: the slicer's signature first,
/// the layer marks where there is none. Layer marks that contradict the
/// signature, or each other, are [`Detection::Mixed`].
#[must_use]
pub fn detect(beginning: &[u8]) -> Detection {
    let mut signed = None;
    let mut layered = None;
    for bytes in split_lines(beginning) {
        // Only comments tell; most of a megabyte of moves need not be parsed.
        if memchr::memchr(b';', bytes).is_none() {
            continue;
        }
        let line = parse(bytes);
        if signed.is_none() {
            signed = Dialect::ALL.into_iter().find(|d| d.signed(&line));
        }
        for dialect in [Dialect::Prusa, Dialect::Bambu, Dialect::Cura, Dialect::Slic3r] {
            if dialect.mark(&line) != Some(Mark::Layer) {
                continue;
            }
            layered = match layered {
                // With verbose comments Slic3r's descendants write its inline marks besides their own.
                Some(own @ (Dialect::Prusa | Dialect::Bambu)) if dialect == Dialect::Slic3r => Some(own),
                Some(Dialect::Slic3r) if matches!(dialect, Dialect::Prusa | Dialect::Bambu) => Some(dialect),
                Some(before) if before != dialect => return Detection::Mixed(before, dialect),
                _ => Some(dialect),
            };
        }
    }
    match (signed, layered) {
        (Some(s), Some(l)) if s.layers_like(l) => Detection::One(s),
        // OrcaSlicer comments like Bambu Studio when the printer is a Bambu.
        (Some(Dialect::Orca), Some(Dialect::Bambu)) => Detection::One(Dialect::Bambu),
        (Some(Dialect::Bambu), Some(Dialect::Prusa)) => Detection::One(Dialect::Orca),
        (Some(s), Some(l)) => Detection::Mixed(s, l),
        // Cura's layer mark is other slicers' too (ideaMaker); alone it proves nothing.
        (None, Some(Dialect::Cura)) | (_, None) => Detection::Unknown,
        (None, Some(l)) => Detection::One(l),
    }
}

/// The number after `prefix`, when the comment line is just that.
fn number_after(line: &Line<'_>, prefix: &[u8]) -> Option<f64> {
    let rest = line.comment.strip_prefix(prefix)?.trim_ascii();
    let (left, number) = crate::number::decimal(rest).ok()?;
    left.is_empty().then_some(number.value)
}

fn contains(haystack: &[u8], needle: &[u8]) -> bool {
    memchr::memmem::find(haystack, needle).is_some()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn detects() {
        let check = |file: &str, expect: Detection| assert_eq!(detect(file.as_bytes()), expect, "{file}");
        check("; generated by PrusaSlicer 2.5.0\n;LAYER_CHANGE\n", Detection::One(Dialect::Prusa));
        check("; generated by OrcaSlicer 2.1\n;LAYER_CHANGE\n", Detection::One(Dialect::Orca));
        check("; generated by OrcaSlicer 2.1\n; CHANGE_LAYER\n", Detection::One(Dialect::Bambu));
        check(";LAYER_CHANGE\n;Z:.2\n", Detection::One(Dialect::Prusa));
        let verbose = "G1 Z.25 F9000 ; move to next layer (0)\n";
        check(&format!(";LAYER_CHANGE\n{verbose}"), Detection::One(Dialect::Prusa));
        check(&format!("{verbose};LAYER_CHANGE\n"), Detection::One(Dialect::Prusa));
        check("; BambuStudio 01.09\n; CHANGE_LAYER\n", Detection::One(Dialect::Bambu));
        check(";Generated with Cura_SteamEngine 4.13\n;LAYER:0\n", Detection::One(Dialect::Cura));
        check(";Sliced by ideaMaker\n;LAYER:0\n", Detection::Unknown);
        check(
            "; generated by Slic3r 1.3.0\nG1 Z.3 ; move to next layer (0)\n",
            Detection::One(Dialect::Slic3r),
        );
        check("; generated by Slic3r 1.3.0\nG1 Z.3\n", Detection::Unknown);
        check(";LAYER_CHANGE\n;LAYER:1\n", Detection::Mixed(Dialect::Prusa, Dialect::Cura));
        check(
            ";Generated with Cura_SteamEngine 4.13\n;LAYER_CHANGE\n",
            Detection::Mixed(Dialect::Cura, Dialect::Prusa),
        );
        check("G1 X1\n", Detection::Unknown);
        check("", Detection::Unknown);
    }
}
