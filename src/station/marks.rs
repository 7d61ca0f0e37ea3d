//! Layers and times that a file tells about itself, for the progress display.
//!
//! Takes lines of the file, gives how many layers there are ([`Facts`]) and, once
//! a line is printed, which layer that is and how long the rest takes
//! ([`Marks`]). Only for show: nothing that is sent depends on it.
use outrigger_gcode::dialect::{LayerMark, layer_mark};
use std::collections::VecDeque;

/// Marks kept between reading and printing. The window holds some ten lines, but
/// a file may put any number of comments between two of them; what is beyond
/// this would be seconds at most.
const MAX_AHEAD: usize = 1024;

/// What one line says.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Mark {
    /// A layer begins, by this kind of comment.
    Layer(LayerMark),
    /// So much is left, in s (M73 R).
    Left(f64),
    /// The whole takes so long, in s (Cura's `;TIME:`).
    Total(f64),
    /// So much is printed, in s (Cura's `;TIME_ELAPSED:`).
    Elapsed(f64),
}

fn mark(line: &[u8]) -> Option<Mark> {
    // The first byte decides for nearly every line.
    match line.trim_ascii_start() {
        [b';', comment @ ..] => comment_mark(comment.trim_ascii()),
        [b'M', b'7', b'3', rest @ ..] if !rest.first().is_some_and(u8::is_ascii_digit) => remaining(rest),
        _ => None,
    }
}

fn comment_mark(comment: &[u8]) -> Option<Mark> {
    if let Some(s) = comment.strip_prefix(b"TIME_ELAPSED:") {
        return number(s).map(Mark::Elapsed);
    }
    if let Some(s) = comment.strip_prefix(b"TIME:") {
        return number(s).map(Mark::Total);
    }
    layer_mark(comment).map(Mark::Layer)
}

/// `M73 P12 R34`: 34 minutes are left.
fn remaining(rest: &[u8]) -> Option<Mark> {
    let code = rest.split(|b| *b == b';').next()?;
    let minutes = code.split(u8::is_ascii_whitespace).find_map(|word| word.strip_prefix(b"R"))?;
    number(minutes).map(|m| Mark::Left(m * 60.0))
}

fn number(text: &[u8]) -> Option<f64> {
    let value: f64 = std::str::from_utf8(text.trim_ascii()).ok()?.parse().ok()?;
    value.is_finite().then_some(value)
}

/// What a whole file says.
#[derive(Debug, Default, Clone, Copy, PartialEq)]
pub(crate) struct Facts {
    kind: Option<LayerMark>,
    /// Layers; 0 where the file does not mark them.
    pub(crate) layers: u64,
    /// How long the job takes by the slicer's estimate, in s.
    pub(crate) total_s: Option<f64>,
}

impl Facts {
    /// Of a job that is known to have so many layers and to take so long, s.
    pub(crate) fn of(layers: u64, total_s: Option<f64>) -> Self {
        Self { kind: None, layers, total_s }
    }

    /// Takes the next line of the file.
    pub(crate) fn see(&mut self, line: &[u8]) {
        match mark(line) {
            Some(Mark::Layer(kind)) if *self.kind.get_or_insert(kind) == kind => self.layers += 1,
            Some(Mark::Total(s)) => self.total_s = Some(s),
            Some(Mark::Left(s)) if self.total_s.is_none() => self.total_s = Some(s),
            _ => {}
        }
    }
}

/// Marks that were read, and those that were reached.
#[derive(Debug, Default)]
pub(crate) struct Marks {
    ahead: VecDeque<(u64, Mark)>,
    kind: Option<LayerMark>,
    total_s: Option<f64>,
    /// The kind of marks that counts while reading, and the layers begun so far.
    read_kind: Option<LayerMark>,
    pub(crate) read: u32,
    /// The layer that is printed, from 1; 0 before the first.
    pub(crate) layer: u64,
    /// How much is left at the last mark by the slicer's estimate, in s.
    pub(crate) left_s: Option<f64>,
}

impl Marks {
    /// Line `number` of the file was read.
    pub(crate) fn see(&mut self, number: u64, line: &[u8]) {
        let Some(mark) = mark(line) else { return };
        if let Mark::Layer(kind) = mark
            && *self.read_kind.get_or_insert(kind) == kind
        {
            self.read = self.read.saturating_add(1);
        }
        if self.ahead.len() >= MAX_AHEAD
            && let Some((_, oldest)) = self.ahead.pop_front()
        {
            // Many without a command between, or a file that is read up to where it broke off.
            self.apply(oldest);
        }
        self.ahead.push_back((number, mark));
    }

    /// The printer has all lines up to `number`.
    pub(crate) fn reach(&mut self, number: u64) {
        while let Some((at, mark)) = self.ahead.front().copied()
            && at <= number
        {
            self.ahead.pop_front();
            self.apply(mark);
        }
    }

    fn apply(&mut self, mark: Mark) {
        match mark {
            Mark::Layer(kind) if *self.kind.get_or_insert(kind) == kind => self.layer += 1,
            Mark::Layer(_) => {}
            Mark::Left(s) => self.left_s = Some(s),
            Mark::Total(s) => self.total_s = Some(s),
            Mark::Elapsed(s) => self.left_s = self.total_s.map(|total| total - s),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_marks() {
        let check = |line: &str, expect| assert_eq!(mark(line.as_bytes()), expect, "{line}");
        check(";LAYER_CHANGE", Some(Mark::Layer(LayerMark::Change)));
        check("; CHANGE_LAYER", Some(Mark::Layer(LayerMark::Change)));
        check(";BEFORE_LAYER_CHANGE", None);
        check(";LAYER:-2", Some(Mark::Layer(LayerMark::Cura)));
        check(";LAYER_COUNT:20", None);
        check("; layer 3, Z = 0.600", Some(Mark::Layer(LayerMark::Other)));
        check(";--- layer 3 (0.2)", Some(Mark::Layer(LayerMark::Other)));
        check("; layer height 0.2", None);
        check("M73 P12 R34", Some(Mark::Left(2040.0)));
        check("M73 P12 ; R5", None);
        check("M730 R1", None);
        check(";TIME:90", Some(Mark::Total(90.0)));
        check(";TIME_ELAPSED:30.5", Some(Mark::Elapsed(30.5)));
        check(";TIME:nan", None);
        check("G1 X1", None);
    }

    #[test]
    fn layers_count_when_reached() {
        let file = ";TIME:100\n;LAYER:0\nG1\n; layer 0\n;TIME_ELAPSED:40\n;LAYER:1\nG1";
        let (mut facts, mut marks) = (Facts::default(), Marks::default());
        for (at, line) in file.lines().enumerate() {
            facts.see(line.as_bytes());
            marks.see(at as u64 + 1, line.as_bytes());
        }
        assert_eq!((facts.layers, facts.total_s), (2, Some(100.0)));
        marks.reach(3);
        assert_eq!((marks.layer, marks.left_s, marks.read), (1, None, 2));
        marks.reach(7);
        assert_eq!((marks.layer, marks.left_s), (2, Some(60.0)));
    }

    #[test]
    fn no_layer_is_lost_to_a_file_read_far_ahead() {
        let mut marks = Marks::default();
        for number in 0..5000 {
            marks.see(number, b";LAYER_CHANGE");
        }
        assert!(marks.ahead.len() <= MAX_AHEAD);
        marks.reach(4999);
        assert_eq!((marks.layer, marks.read), (5000, 5000));
    }
}
