//! What a pass is.
use super::layer::Layer;
use super::section::Neighbours;

/// Rewrites layers, one after the other. Passes are values in one registry
/// ([`super::passes::all`]); they exchange types, never comments in the text.
pub trait Pass: Send {
    /// For the report.
    fn name(&self) -> &'static str;

    /// Rewrites the rows of a layer, or leaves them as they are.
    fn layer(&mut self, layer: &mut Layer, neighbours: Neighbours<'_>);

    /// What it did so far.
    fn tally(&self) -> Tally;
}

/// What a pass did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Sections that it could have changed.
    pub sections: u64,
    /// Sections that it did change.
    pub changed: u64,
}
