//! The passes, one a file, and their registry.
mod reorder_infill;

use super::habits::FileHabits;
use super::pass::Pass;

/// What the passes are asked to do.
#[derive(Clone, Copy, Debug, Default)]
pub struct Wishes {
    /// Reorder the first layer too.
    pub first_layer: bool,
}

/// Every pass, in the order in which they run.
#[must_use]
pub fn all(wishes: Wishes, habits: &FileHabits) -> Vec<Box<dyn Pass>> {
    vec![Box::new(reorder_infill::ReorderInfill::new(wishes, habits.clone()))]
}
