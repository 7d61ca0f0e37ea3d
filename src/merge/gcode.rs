//! A sliced job that supports go into or come out of: how it is opened, what it tells of
//! itself, why it may be refused.
//!
//! # Layout
//! - `told`: what its settings say; `survey`: heights, habits and flow, from all its beads
//! - `flow`: width and cross-section of beads; `pen`: writes lines as the file does
//! - `side`: reads a text as its proof does
pub(super) mod flow;
pub(super) mod pen;
pub(super) mod side;
pub(super) mod survey;
pub(super) mod told;

use super::{into_gcode, out_of_gcode};
use crate::layers::shape::Region;
use crate::post::annotate::{Layers, Unfit};
use crate::post::container::{Container, beginning, gcode};
use crate::post::{BEGINNING_BYTES, END_BYTES, Failure as Io, not_for_us, read_at};
use outrigger_gcode::bgcode::damage;
use outrigger_gcode::dialect::{Detection, Dialect, detect};
use std::io::{Read, Seek, SeekFrom};
use survey::{Survey, Surveyor};
use told::Told;

/// Why there is no result.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// The input cannot be read, or the output not written.
    #[error(transparent)]
    Io(#[from] Io),
    /// Supports cannot go into this job.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// The result would not be what it should be.
    #[error("the result would not be the same job with supports: {0}")]
    Different(#[from] into_gcode::Difference),
    /// The result would not be the same job without its supports.
    #[error("the result would not be the same job without its supports: {0}")]
    Changed(#[from] out_of_gcode::Difference),
}

/// Why supports cannot go into a job.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// No G-code text that can be worked on.
    #[error("{0}")]
    Unfit(String),
    /// Objects one after the other.
    #[error(
        "objects are printed one after the other (Z falls from {from_mm} to {to_mm} mm at layer {layer}): slice them to be printed together"
    )]
    OneByOne {
        /// Number of the layer.
        layer: u32,
        /// Height before, mm.
        from_mm: f64,
        /// Height after, mm.
        to_mm: f64,
    },
    /// Z rises all along.
    #[error("this is a spiral vase, which has no layers to print supports in: slice it without")]
    Spiral,
    /// E counts volume.
    #[error("E counts mm³ here (volumetric extrusion), and it must count mm of filament: slice it without")]
    Volumetric,
    /// Coordinates in inches.
    #[error("this job is in inches (G20): slice it in millimetres")]
    Inches,
    /// More layers than any job has.
    #[error("there are more layers than any print has")]
    ManyLayers,
    /// No layer with a bead of a part.
    #[error("there is no part in this job: no layer mark with beads after it")]
    NoPart,
    /// No telling bead.
    #[error("nothing in this job tells how much filament its beads take: it has no walls and no infill")]
    NoFlow,
    /// No travel.
    #[error("this job has no travel to make others like it")]
    NoTravel,
    /// Nothing says what is printed.
    #[error("layer {layer} does not say what is printed in it, so nothing could tell supports from the part")]
    NoFeature {
        /// Number of the layer.
        layer: u32,
    },
    /// Relative coordinates, or another origin, where supports would go.
    #[error("layer {layer} has relative coordinates (G91) or sets its origin anew (G92, G28)")]
    Relative {
        /// Number of the layer.
        layer: u32,
    },
    /// Supports of a tool that prints nothing else.
    #[error(
        "supports have a tool of their own here, which would change with nothing to print: slice it without supports"
    )]
    SupportTool,
    /// The part stands on supports.
    #[error(
        "the part begins at Z {part_mm} mm on supports from Z {support_mm} mm on (a raft?), which cannot be taken away: slice it without"
    )]
    Raft {
        /// Top of the lowest bead of supports, mm.
        support_mm: f64,
        /// Of the part's first one, mm.
        part_mm: f64,
    },
    /// Too thick a layer.
    #[error(
        "the job prints nothing between Z {from_mm} and {to_mm} mm (layer {layer}), where supports would have to grow"
    )]
    Gap {
        /// Number of the layer.
        layer: u32,
        /// Top of the last layer, mm.
        from_mm: f64,
        /// Top of this one, mm.
        to_mm: f64,
    },
}

/// Tells what a job comes in and what it is like.
///
/// # Errors
/// It cannot be read, or supports can neither go into it nor come out.
pub(super) fn open(input: &mut (impl Read + Seek)) -> Result<(Container, Survey), Failure> {
    let container = Container::of(input).map_err(Io::Read)?;
    if let Some(reason) = container.refusal() {
        return Err(Refusal::Unfit(reason.to_owned()).into());
    }
    let start = beginning(input, BEGINNING_BYTES).map_err(Io::Read)?;
    if let Some(reason) = not_for_us(&start) {
        return Err(Refusal::Unfit(reason).into());
    }
    let survey = survey(input, container, &start, known(&start)?)?;
    Ok((container, survey))
}

/// A damaged container is no failure of the reader.
pub(super) fn of_damage(failure: Failure) -> Failure {
    match failure {
        Failure::Io(Io::Read(error) | Io::Write(error)) if damage(&error).is_some() => {
            Refusal::Unfit(error.to_string()).into()
        }
        failure => failure,
    }
}

pub(super) fn of_unfit(unfit: Unfit) -> Failure {
    match unfit {
        Unfit::Read { source, .. } => Io::Read(source).into(),
        unfit => Refusal::Unfit(unfit.to_string()).into(),
    }
}

fn known(start: &[u8]) -> Result<Dialect, Refusal> {
    match detect(start) {
        Detection::One(dialect) => Ok(dialect),
        Detection::Mixed(a, b) => Err(Refusal::Unfit(format!(
            "layers are marked as {} and as {} do: mixed dialects",
            a.name(),
            b.name()
        ))),
        Detection::Unknown => Err(Refusal::Unfit("no slicer's layer comments that are known".to_owned())),
    }
}

/// The plate that a job tells of, or nothing.
///
/// # Errors
/// It cannot be read.
pub fn plate(input: &mut (impl Read + Seek)) -> Result<Region, Failure> {
    let container = Container::of(input).map_err(Io::Read)?;
    let start = beginning(input, BEGINNING_BYTES).map_err(Io::Read)?;
    Ok(settings(input, container, &start)?.bed)
}

/// What the settings at a job's beginning and end tell.
fn settings(input: &mut (impl Read + Seek), container: Container, start: &[u8]) -> Result<Told, Failure> {
    let mut told = Told::default();
    told.read(start);
    if let Container::Text = container {
        let length = input.seek(SeekFrom::End(0)).map_err(Io::Read)?;
        let end = read_at(input, length.saturating_sub(END_BYTES), END_BYTES).map_err(Io::Read)?;
        let whole = memchr::memchr(b'\n', &end).map_or(end.len(), |at| at + 1);
        told.read(&end[whole.min(end.len())..]);
    }
    Ok(told)
}

/// Reads the whole job once, before anything is written.
fn survey(
    input: &mut (impl Read + Seek),
    container: Container,
    start: &[u8],
    dialect: Dialect,
) -> Result<Survey, Failure> {
    let told = settings(input, container, start)?;
    let mut surveyor = Surveyor::new(dialect, told)?;
    input.seek(SeekFrom::Start(0)).map_err(Io::Read)?;
    let mut layers = Layers::new(gcode(input), dialect).without_covers();
    while let Some(layer) = layers.next_layer().map_err(of_unfit)? {
        surveyor.layer(&layer)?;
    }
    Ok(surveyor.finish()?)
}
