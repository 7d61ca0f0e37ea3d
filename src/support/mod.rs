//! The least that holds: what needs support, where tips stand, and the trees below them.
//!
//! Takes what [`crate::detect`] finds in a job's layers, gives a forest of branches and
//! what cannot be held, with place and reason. The planner knows clearance and its rules,
//! not files: what becomes of the forest is [`crate::merge`]'s matter.
//!
//! # Layout
//! ```text
//! detect::walk ─► demand ─► points ─► skeleton (vanek | grow, improve) ─► tree ─► section
//!      └────────► clearance ─► site ──────┘
//! ```
//! - [`demand`]: what must be held
//! - [`clearance`]: where branches may go, and from where to the plate; [`site`]: with the rules put upon it
//! - [`points`]: where tips stand; [`scar`]: where they leave the least of a mark
//! - `skeleton`: branches that are still laid out; `vanek`, `grow` and `improve` lay them
//! - `ranked`: which of many comes next; `cells`: places in cubic cells
//! - [`tree`]: what comes out; [`rules`]: what it must be like
//! - [`look`] and [`plan`]: from layers to needs, from needs to trees; [`model`]: a job's model beside it; [`proof`]: whether it is so
//! - [`section`]: what of it lies in a layer; [`cut`]: a forest as such
mod cells;
pub mod clearance;
pub mod cut;
pub mod demand;
mod grow;
mod improve;
pub mod look;
pub mod model;
pub mod plan;
pub mod points;
pub mod proof;
mod ranked;
pub mod rules;
pub mod scar;
pub mod section;
pub mod site;
mod skeleton;
#[cfg(test)]
pub(crate) mod testing;
pub mod tree;
mod vanek;
