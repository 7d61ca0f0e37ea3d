//! What a piece of a layer is, and its colours.
use super::super::svg::Rgb;

/// What a piece of a layer is, in the order of drawing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Class {
    /// Printed besides and taken away later: supports, brim, wipe tower.
    Aid,
    /// The part, joined to the plate.
    Body,
    /// An island on its way up.
    Island,
    /// An island where it first appears.
    Appears,
    /// What has too little below it.
    Overhang,
}

/// All of them, in the order of drawing; a class's place is its number in the page's data.
pub const ALL: [Class; 5] = [Class::Aid, Class::Body, Class::Island, Class::Appears, Class::Overhang];

impl Class {
    /// Its name in the page's data.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Class::Aid => "aid",
            Class::Body => "body",
            Class::Island => "island",
            Class::Appears => "appears",
            Class::Overhang => "overhang",
        }
    }

    /// What people call it.
    #[must_use]
    pub fn title(self) -> &'static str {
        match self {
            Class::Aid => "supports, brim, tower",
            Class::Body => "part",
            Class::Island => "island, until it joins the part",
            Class::Appears => "island, where it first appears",
            Class::Overhang => "overhang",
        }
    }

    /// Its colour in pictures. Islands are light blue, and dark blue where they
    /// first appear (paper 003, Figs. 8 and 10).
    pub(in super::super) fn colour(self) -> Rgb {
        match self {
            Class::Aid => [0xbc, 0xd9, 0xb6],
            Class::Body => [0xc3, 0xcc, 0xd8],
            Class::Island => [0x7d, 0xc4, 0xf5],
            Class::Appears => [0x0b, 0x3a, 0x9c],
            Class::Overhang => [0xf2, 0x9a, 0x2e],
        }
    }
}
