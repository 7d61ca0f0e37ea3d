//! What a verifier may find to differ.
use outrigger_gcode::dialect::Feature;

/// What differs, and where.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("layer {layer}: {what}")]
pub struct Difference {
    /// Number of the layer.
    pub layer: u32,
    /// What differs.
    pub what: What,
}

/// What differs.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum What {
    /// A run of one feature begins or ends elsewhere.
    #[error("{0:?} would be printed in another place of the order")]
    Runs(Feature),
    /// Segments of infill.
    #[error("other segments of {0:?} would be printed")]
    Segments(Feature),
    /// Segments whose order must stay.
    #[error("the order or direction of {0:?} would change")]
    Order(Feature),
    /// Number of segments.
    #[error("{1} segments would be printed instead of {0}")]
    Count(usize, usize),
    /// Filament adds up to more or less.
    #[error("the filament differs by {0:.6} mm in all")]
    Filament(f64),
    /// Lines that are no motion.
    #[error("a command or comment would change or move: {0:?}")]
    Others(String),
    /// Deposits while pulled back.
    #[error("{0} deposits would begin with the filament pulled back")]
    Retracted(u64),
    /// Filament moved between deposits.
    #[error("{0:+.5} mm of filament would be moved between the deposits")]
    Primed(f64),
    /// Retraction depth.
    #[error("the filament would be pulled back {0:.5} mm, deeper than the file does")]
    Deeper(f64),
    /// Travel height.
    #[error("a travel would go at {0} mm, below the layer's own")]
    Low(f64),
    /// Travel bounds.
    #[error("a travel would leave the bounds of the file's own moves")]
    Outside,
    /// Travel speed.
    #[error("a travel would go at {0} mm/min, faster than the file's own")]
    Fast(f64),
    /// A line that Marlin would cut.
    #[error("a line would be longer than the firmware takes: {0:?}")]
    Long(String),
    /// The state at the end.
    #[error("{0} would not be as the file leaves it")]
    End(&'static str),
}
