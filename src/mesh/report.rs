//! What was mended in a mesh, and what is left.
//!
//! Takes counts, gives them as a line or a table for people; as a value it
//! serialises to JSON. Knows no file.
use serde::Serialize;

/// What was done to a mesh, and what it is now.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Mended {
    /// Triangles left out because they are points or lines.
    pub degenerate_triangles: u64,
    /// Triangles left out because another has the same corners and faces the same way.
    pub duplicate_triangles: u64,
    /// Triangles left out in pairs that face opposite ways: walls between bodies side by side.
    pub opposite_triangles: u64,
    /// Vertices of rims that went to another within the tolerance.
    pub welded_vertices: u64,
    /// Vertices at which an edge of a neighbour was split, since they lay on it (T-junctions).
    pub split_edges: u64,
    /// Triangles turned to face as their neighbours do.
    pub flipped_triangles: u64,
    /// Holes filled.
    pub filled_holes: u64,
    /// Triangles added to fill them.
    pub filling_triangles: u64,
    /// Shells that were inside out.
    pub turned_shells: u64,
    /// Connected pieces of surface.
    pub shells: u64,
    /// Those of them that have a rim.
    pub open_shells: u64,
    /// Closed shells that are hollows in another.
    pub cavities: u64,
    /// Half-edges without a neighbour: the length of all rims in edges.
    pub open_edges: u64,
    /// Edges that more than two triangles share.
    pub crowded_edges: u64,
}
