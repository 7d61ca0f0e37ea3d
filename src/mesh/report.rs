//! What was mended in a mesh, and what is left.
//!
//! Takes counts, gives them as a line or a table for people; as a value it
//! serialises to JSON, each field named with its unit. Knows no file.
use super::stl::{Format, Source};
use serde::Serialize;
use std::fmt::{Display, Formatter, Result};

/// What a file was, and what was mended in it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Report {
    /// What the file was.
    pub source: Source,
    /// What was mended, and what is left.
    pub mended: Mended,
}

/// What was done to a mesh, and what it is now.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
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
    /// Edges that more than two triangles share: surfaces touch there, and two triangles
    /// with solid between them are taken for neighbours.
    pub crowded_edges: u64,
    /// Area of all triangles, mm², before it was placed.
    pub area_mm2: f64,
    /// Volume, mm³, before it was placed; bodies that overlap count twice. None where the mesh is open.
    pub volume_mm3: Option<f64>,
}

impl Mended {
    /// What was done, each kind with its number: "3 small holes filled"; only what was.
    #[must_use]
    pub fn done(&self) -> Vec<String> {
        let all = [
            (self.degenerate_triangles, "triangle", "triangles", "without area left out"),
            (self.duplicate_triangles, "duplicate triangle", "duplicate triangles", "left out"),
            (self.opposite_triangles, "triangle", "triangles", "between bodies side by side left out"),
            (self.welded_vertices, "rim vertex", "rim vertices", "joined to others"),
            (self.split_edges, "edge", "edges", "split where vertices lie on it"),
            (self.flipped_triangles, "triangle", "triangles", "turned to face as the neighbours do"),
            (self.filled_holes, "small hole", "small holes", "filled"),
            (self.turned_shells, "inside-out shell", "inside-out shells", "turned"),
        ];
        let told = all.into_iter().filter(|a| a.0 > 0);
        told.map(|(count, one, many, what)| format!("{} {what}", counted(count, one, many))).collect()
    }

    /// What could not be mended and may print wrong; only what is there.
    #[must_use]
    pub fn left(&self) -> Vec<String> {
        let open = (self.open_edges > 0).then(|| counted(self.open_edges, "open edge", "open edges"));
        open.map(|edges| format!("{edges} left")).into_iter().collect()
    }

    /// Whether the surface has no rim.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.open_edges == 0
    }
}

/// A number with its noun.
fn counted(count: u64, one: &str, many: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { many })
}

/// One line: what was done; what is left.
impl Display for Mended {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        let (done, left) = (self.done().join(", "), self.left().join(", "));
        match (done.is_empty(), left.is_empty()) {
            (true, true) => write!(f, "nothing to mend"),
            (false, true) => write!(f, "mended: {done}"),
            (true, false) => write!(f, "not mended: {left}"),
            (false, false) => write!(f, "mended: {done}; not mended: {left}"),
        }
    }
}

impl Report {
    /// What people should know before they print: sentences.
    #[must_use]
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if self.mended.open_edges > 0 {
            warnings.push(format!(
                "the surface is open: {} of {} without a neighbour; what is inside may be told wrong there",
                counted(self.mended.open_edges, "edge", "edges"),
                counted(self.mended.open_shells, "shell", "shells"),
            ));
        }
        if self.source.endsolid_missing {
            warnings.push("the file ends without \"endsolid\": it may be cut short".to_string());
        }
        if self.source.trailing > 0 {
            let [one, many] = match self.source.format {
                Format::Binary => ["byte", "bytes"],
                Format::Ascii => ["line", "lines"],
            };
            let what = counted(self.source.trailing, one, many);
            warnings.push(format!("after the last triangle {what} were not read"));
        }
        warnings
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn people_read_what_was_done_and_what_is_left() {
        let check = |mended: Mended, expect: &str| assert_eq!(mended.to_string(), expect);
        let done = Mended { welded_vertices: 3, filled_holes: 1, ..Mended::default() };
        check(Mended::default(), "nothing to mend");
        check(done, "mended: 3 rim vertices joined to others, 1 small hole filled");
        check(Mended { open_edges: 4, ..Mended::default() }, "not mended: 4 open edges left");
        check(
            Mended { open_edges: 4, filled_holes: 2, ..Mended::default() },
            "mended: 2 small holes filled; not mended: 4 open edges left",
        );
    }

    #[test]
    fn warnings_have_what_there_is() {
        let source = Source { format: Format::Ascii, triangles: 12, trailing: 2, endsolid_missing: true };
        let mended = Mended { shells: 2, open_shells: 1, open_edges: 4, ..Mended::default() };
        let report = Report { source, mended };
        assert_eq!(report.warnings().len(), 3);
        assert!(report.warnings()[0].contains("4 edges of 1 shell "));
        let json = serde_json::to_value(report).expect("JSON");
        assert_eq!(json["source"]["format"], "ascii");
        assert_eq!(json["mended"]["open_edges"], 4);
        assert!(json["mended"]["volume_mm3"].is_null());
    }
}
