//! What of the supports lies in a layer.
use crate::layers::shape::Region;

/// What of the supports is printed in a layer, as polygons over the plate.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Section {
    /// Branches, trunks and pads.
    pub body: Region,
    /// The layers just under the part that touch it: interface.
    pub interface: Region,
}

/// Supports that can be cut at any height.
pub trait Sections: Sync {
    /// Height of their highest point, mm above the plate.
    fn top_mm(&self) -> f64;
    /// What lies in the layer that is printed between these heights, mm.
    fn section(&self, bottom_mm: f64, top_mm: f64) -> Section;
}
