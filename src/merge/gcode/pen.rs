//! Writes lines as the file writes them, and knows what they did.
//!
//! Takes where the machine is; gives lines for lifts, travels and beads by the file's
//! own habits, in its own number format. E is kept exact: what one line rounds off,
//! the next one makes good.
use super::survey::Survey;
use crate::post::layer::Style;
use crate::toolpath::bead::{Point, distance_mm};
use outrigger_gcode::number::{Format, write_decimal};

/// Fewest decimals of X, Y, Z and of E, whatever the file has.
const DECIMALS: [u8; 2] = [3, 5];

/// Most of them: more makes lines longer and nothing better.
const MAX_DECIMALS: u8 = 6;

/// How feed rates are written.
const FEED: Format = Format { decimals: 6, bare_point: false };

/// Where the machine is, as far as lines depend on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::merge) struct At {
    pub(in crate::merge) position: [f64; 3],
    /// Machine coordinate = the file's + offset, mm.
    pub(in crate::merge) offset: [f64; 3],
    pub(in crate::merge) e: f64,
    pub(in crate::merge) absolute_e: bool,
    pub(in crate::merge) feed: f64,
}

/// See the module.
pub(in crate::merge) struct Pen<'a> {
    survey: &'a Survey,
    style: Style,
    pub(in crate::merge) out: Vec<u8>,
    pub(in crate::merge) at: At,
    /// Filament due that no line has pushed yet, mm.
    owed: f64,
    pulled: bool,
    pub(in crate::merge) lifts: u64,
    pub(in crate::merge) pushed_mm: f64,
}

impl<'a> Pen<'a> {
    pub(in crate::merge) fn new(survey: &'a Survey, style: Style, at: At) -> Pen<'a> {
        Pen { survey, style, out: Vec::new(), at, owed: 0.0, pulled: false, lifts: 0, pushed_mm: 0.0 }
    }

    fn format(&self, e: bool) -> Format {
        let own = if e { self.style.e_decimals } else { self.style.xyz_decimals };
        Format {
            decimals: own.clamp(DECIMALS[usize::from(e)], MAX_DECIMALS),
            bare_point: self.style.bare_point,
        }
    }

    fn word(&mut self, letter: u8, value: f64, format: Format) {
        self.out.push(b' ');
        self.out.push(letter);
        write_decimal(&mut self.out, value, format);
    }

    /// Where a position lies that is written as one.
    fn rounded(&self, k: usize, position: f64) -> f64 {
        let unit = 10f64.powi(i32::from(self.format(false).decimals));
        ((position - self.at.offset[k]) * unit).round() / unit + self.at.offset[k]
    }

    fn axis(&mut self, k: usize, position: f64) {
        self.word(b"XYZ"[k], position - self.at.offset[k], self.format(false));
        self.at.position[k] = self.rounded(k, position);
    }

    fn feed_word(&mut self, feed: f64) {
        if feed > 0.0 && feed != self.at.feed {
            self.word(b'F', feed, FEED);
            self.at.feed = feed;
        }
    }

    /// Moves E by about `e` mm; gives by how much.
    fn e_word(&mut self, e: f64) -> f64 {
        let format = self.format(true);
        let unit = 10f64.powi(i32::from(format.decimals));
        let base = if self.at.absolute_e { self.at.e } else { 0.0 };
        let value = ((base + e) * unit).round() / unit;
        self.word(b'E', value, format);
        self.at.e += value - base;
        if self.at.absolute_e {
            self.at.e = value;
        }
        value - base
    }

    fn end(&mut self) {
        self.out.extend_from_slice(self.style.ending());
    }

    /// A line of its own, without its ending.
    pub(in crate::merge) fn text(&mut self, text: &[u8]) {
        self.out.extend_from_slice(text);
        self.end();
    }

    /// Sets the feed rate where it differs.
    pub(in crate::merge) fn feed(&mut self, feed: f64) {
        if feed > 0.0 && feed != self.at.feed {
            self.out.extend_from_slice(b"G1");
            self.feed_word(feed);
            self.end();
        }
    }

    /// Straight up or down.
    pub(in crate::merge) fn rise(&mut self, z: f64) {
        self.out.extend_from_slice(b"G1");
        self.axis(2, z);
        self.feed_word(self.survey.z_feed);
        self.end();
    }

    /// A travel at the height where the nozzle is.
    pub(in crate::merge) fn go(&mut self, to: Point) {
        self.out.extend_from_slice(&self.survey.travel_head);
        self.axis(0, to[0]);
        self.axis(1, to[1]);
        self.feed_word(self.survey.travel_feed);
        self.end();
    }

    /// Filament alone, mm; negative: pulled back.
    pub(in crate::merge) fn filament(&mut self, e: f64, feed: f64) {
        self.out.extend_from_slice(b"G1");
        self.e_word(e);
        self.feed_word(feed);
        self.end();
    }

    /// Pulls the filament back as the file does, all of it where the nozzle stands.
    pub(in crate::merge) fn pull(&mut self) {
        let Some(retraction) = &self.survey.retraction else { return };
        let depth = retraction.depth_mm();
        if depth > 0.0 {
            let own = retraction.before.as_ref().or(retraction.after.as_ref()).map(|(line, _)| line.feed);
            let feed = own.or(retraction.unretract.first().map(|(line, _)| line.feed));
            self.filament(-depth, feed.unwrap_or(self.at.feed));
        }
        if let Some([retract, _]) = &retraction.firmware {
            self.out.extend_from_slice(retract);
        }
        self.pulled = true;
    }

    /// Pushes it again.
    pub(in crate::merge) fn push(&mut self) {
        let (Some(retraction), true) = (&self.survey.retraction, self.pulled) else { return };
        self.pulled = false;
        if let Some([_, unretract]) = &retraction.firmware {
            self.out.extend_from_slice(unretract);
        }
        let depth = retraction.depth_mm();
        if depth > 0.0 {
            let feed = retraction.unretract.first().map(|(line, _)| line.feed);
            self.filament(depth, feed.unwrap_or(self.at.feed));
        }
    }

    /// Pulled back, up, over, down, pushed again.
    pub(in crate::merge) fn lift(&mut self, to: Point) {
        let z = self.at.position[2];
        self.lifts += 1;
        self.pull();
        self.rise(z + self.survey.hop_mm);
        self.go(to);
        self.rise(z);
        self.push();
    }

    /// A bead to a point, of a cross-section in mm², with a comment at its end where the
    /// dialect wants one.
    pub(in crate::merge) fn bead(&mut self, to: Point, area_mm2: f64, comment: &[u8]) {
        let to = [self.rounded(0, to[0]), self.rounded(1, to[1])];
        let way = distance_mm([self.at.position[0], self.at.position[1]], to);
        if way == 0.0 {
            return;
        }
        let due = way * area_mm2 * self.survey.e_per_mm3 + self.owed;
        self.out.extend_from_slice(b"G1");
        self.axis(0, to[0]);
        self.axis(1, to[1]);
        let e = self.e_word(due);
        self.owed = due - e;
        self.pushed_mm += e;
        self.out.extend_from_slice(comment);
        self.end();
    }

    /// Gives E the value that it had.
    pub(in crate::merge) fn restore_e(&mut self, e: f64) {
        if self.at.absolute_e && self.at.e != e {
            self.out.extend_from_slice(b"G92");
            self.word(b'E', e, self.format(true));
            self.at.e = e;
            self.end();
        }
    }
}
