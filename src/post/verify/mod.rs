//! Proves that a rewritten job prints what the original prints.
//!
//! Takes the original's and the output's bytes layer by layer, reads both again
//! from the text, and compares. Written apart from the passes: it shares with
//! them the language (lines, machine, dialect) and none of their reasoning.
//!
//! What must hold in every layer:
//! - the same undirected segments with the same E, Z, feature, width, height, tool,
//!   speed, acceleration, limits, pressure advance and fan; what is neither infill
//!   nor gap fill in the file's order and direction too
//! - every other line byte for byte, in order, after the same number of deposits
//! - between deposits as much filament pulled back and pushed, for each retraction
//! - no more deposits with the filament pulled back than the file has, none pulled
//!   back deeper; no travel lower, further out or faster than the file's own
//! - at the layer's end the same position, modes, settings and retraction
mod difference;
mod side;

use super::measure::Totals;
use super::time::Accelerations;
pub use difference::{Difference, What};
use outrigger_gcode::dialect::{Dialect, Feature};
use outrigger_gcode::line::split_lines;
use outrigger_gcode::state::Machine;
use side::{Reading, Segment, Side, hash};
use std::borrow::Cow;

/// Lengths are compared in this unit, mm.
const UNIT_MM: f64 = 1e-6;

/// Filament of one segment may differ by this, mm.
const E_MM: f64 = 1e-6;

/// Filament of all segments together may differ by this, mm.
const E_SUM_MM: f64 = 1e-3;

/// Filament moved between the deposits of one layer may differ by this, mm.
const PRIMED_MM: f64 = 1e-3;

/// And by this for each retraction: slicers' own sums are rounded to 0.00001 mm.
const ROUNDING_MM: f64 = 1e-5;

/// Travels may leave the file's bounds by this, mm: an arc walked from its other
/// end has its centre rounded another way, and its bulge with it.
const BOUNDS_MM: f64 = 0.01;

/// Marlin takes 95 bytes of a framed line; `N12345678 ` and `*255` are 14 of them.
const MAX_CODE_BYTES: usize = 81;

/// What both files measure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figures {
    /// Of the original.
    pub before: Totals,
    /// Of the output.
    pub after: Totals,
    /// Estimated printing time of the original, s.
    pub time_s_before: f64,
    /// Of the output, s.
    pub time_s_after: f64,
    /// Layer marks.
    pub layers: u64,
}

/// Compares two files layer by layer.
pub struct Verifier {
    before: Side,
    after: Side,
    e_sum_mm: f64,
    /// Longest line of the input where it was compared, bytes, without its comment.
    longest: usize,
}

impl Verifier {
    /// At the beginning of both. Without a dialect nothing is known of features,
    /// and nothing may be reordered.
    #[must_use]
    pub fn new(dialect: Option<Dialect>, accelerations: Accelerations) -> Verifier {
        Verifier {
            before: Side::new(dialect, accelerations),
            after: Side::new(dialect, accelerations),
            e_sum_mm: 0.0,
            longest: 0,
        }
    }

    /// Compares a layer; `output` is `None` where it is the input itself.
    ///
    /// # Errors
    /// What differs.
    pub fn layer(&mut self, number: u32, input: &[u8], output: Option<&[u8]>) -> Result<(), Difference> {
        let output = output.unwrap_or(input);
        if input == output && self.before.stands_like(&self.after) {
            self.same(input);
            return Ok(());
        }
        let absolute = self.before.machine.e_is_absolute();
        let old = self.before.read(input);
        let new = self.after.read(output);
        self.compare(&old, &new, input, output)
            .and_then(|()| self.ends(absolute))
            .map_err(|what| Difference { layer: number, what })
    }

    /// The same bytes from the same state: read once for both.
    fn same(&mut self, input: &[u8]) {
        let (measure, seconds) = (self.before.measure.clone(), self.before.clock.rest());
        self.before.read(input);
        let gained = self.before.clock.rest() - seconds;
        self.after.measure.follow(&measure, &self.before.measure);
        self.after.clock.dwell(gained);
        let (before, after) = (&self.before, &mut self.after);
        after.clock.accelerations = before.clock.accelerations;
        after.machine.clone_from(&before.machine);
        after.context = before.context;
        after.feature_name = before.feature_name;
        after.settings.clone_from(&before.settings);
        after.layers = before.layers;
        after.fastest = after.fastest.max(before.fastest);
    }

    fn compare(&mut self, old: &Reading, new: &Reading, input: &[u8], output: &[u8]) -> Result<(), What> {
        self.segments(old, new)?;
        if old.others != new.others {
            return Err(What::Others(first_other(&old.others, &new.others, output)));
        }
        let more = new.extras_mm.len() as f64 - old.extras_mm.len() as f64;
        let due_mm = old.primed_mm + old.extra_mm() * more;
        let rounding_mm = PRIMED_MM + ROUNDING_MM * new.extras_mm.len().max(old.extras_mm.len()) as f64;
        if (new.primed_mm - due_mm).abs() > rounding_mm {
            return Err(What::Primed(new.primed_mm - due_mm));
        }
        let (before, after) = (&self.before, &self.after);
        if after.measure.retracted_deposits > before.measure.retracted_deposits {
            return Err(What::Retracted(after.measure.retracted_deposits));
        }
        if after.measure.deepest_mm > before.measure.deepest_mm + E_MM {
            return Err(What::Deeper(after.measure.deepest_mm));
        }
        let layer_z = old.segments.iter().map(|s| s.place[2].min(s.place[5])).min();
        let floor_mm = layer_z.map_or(f64::INFINITY, |z| z as f64 * UNIT_MM).min(old.lowest_travel);
        if new.lowest_travel < floor_mm - UNIT_MM {
            return Err(What::Low(new.lowest_travel));
        }
        self.lengths(input, output)
    }

    /// Marlin cuts what is longer, and no line may be that was not.
    fn lengths(&mut self, input: &[u8], output: &[u8]) -> Result<(), What> {
        let code = |bytes: &&[u8]| memchr::memchr(b';', bytes).unwrap_or(bytes.len());
        let longest = |text: &[u8]| split_lines(text).map(|l| code(&l)).max().unwrap_or(0);
        self.longest = self.longest.max(longest(input));
        let most = self.longest.max(MAX_CODE_BYTES);
        match split_lines(output).find(|line| code(line) > most) {
            Some(line) => Err(What::Long(String::from_utf8_lossy(line).trim().to_owned())),
            None => Ok(()),
        }
    }

    fn segments(&mut self, old: &Reading, new: &Reading) -> Result<(), What> {
        if old.segments.len() != new.segments.len() {
            return Err(What::Count(old.segments.len(), new.segments.len()));
        }
        let run_of = |r: &Reading, k: usize| {
            let c = r.contexts[r.segments[k].context as usize];
            (c.feature, c.tool, c.object)
        };
        let mut from = 0;
        while from < old.segments.len() {
            let run = run_of(old, from);
            let mut to = from;
            while to < old.segments.len() && run_of(old, to) == run {
                if run_of(new, to) != run {
                    return Err(What::Runs(run.0));
                }
                to += 1;
            }
            self.run(run.0, old, new, from..to)?;
            from = to;
        }
        if self.e_sum_mm > E_SUM_MM { Err(What::Filament(self.e_sum_mm)) } else { Ok(()) }
    }

    fn run(
        &mut self,
        feature: Feature,
        old: &Reading,
        new: &Reading,
        range: std::ops::Range<usize>,
    ) -> Result<(), What> {
        let free = matches!(
            feature,
            Feature::Infill | Feature::GapFill | Feature::SolidInfill | Feature::Skin | Feature::AnyInfill
        );
        let (a, b) = (&old.segments[range.clone()], &new.segments[range]);
        // Sorted, infill printed in any order is the same; most of it was not touched at all.
        let sorted = |segments: &[Segment]| {
            let mut segments = segments.to_vec();
            segments.sort_unstable_by_key(Segment::key);
            segments
        };
        let touched = free && a.iter().zip(b).any(|(a, b)| a.key() != b.key());
        let (a, b) =
            if touched { (sorted(a).into(), sorted(b).into()) } else { (Cow::from(a), Cow::from(b)) };
        for (a, b) in a.iter().zip(b.iter()) {
            let alike = a.place == b.place
                && a.arc == b.arc
                && a.feed == b.feed
                && (a.e - b.e).abs() <= E_MM
                && old.contexts[a.context as usize] == new.contexts[b.context as usize];
            if !alike && free {
                return Err(What::Segments(feature));
            }
            if !alike || (!free && a.reversed != b.reversed) {
                return Err(What::Order(feature));
            }
            self.e_sum_mm += (a.e - b.e).abs();
        }
        Ok(())
    }

    /// `absolute`: E words were positions when the layer began. Where they become so
    /// only later, what E is called then depends on all that went before, and every
    /// move that it makes a difference to is compared as a move.
    fn ends(&self, absolute: bool) -> Result<(), What> {
        let (before, after) = (&self.before, &self.after);
        let (a, b) = (&before.machine, &after.machine);
        let near = |x: f64, y: f64| (x - y).abs() <= UNIT_MM;
        let checks = [
            ("the position", (0..3).all(|k| near(a.position[k], b.position[k]))),
            ("the feed rate", a.feed == b.feed),
            ("E", !(absolute && a.e_is_absolute()) || near(a.e, b.e)),
            ("a mode", {
                let modes = |m: &Machine| (m.absolute, m.e_is_absolute(), m.inches, m.tool, m.offset);
                modes(a) == modes(b)
            }),
            ("a setting", before.context == after.context),
            (
                "the retraction",
                a.firmware_retracted == b.firmware_retracted
                    && near(before.measure.depth_mm(), after.measure.depth_mm()),
            ),
        ];
        match checks.iter().find(|(_, holds)| !holds) {
            Some((what, _)) => Err(What::End(what)),
            None => Ok(()),
        }
    }

    /// What holds for the files as wholes.
    ///
    /// # Errors
    /// What differs.
    pub fn finish(mut self, last_layer: u32) -> Result<Figures, Difference> {
        let (before, after) = (&self.before, &self.after);
        let outside = (0..2)
            .any(|k| after.low[k] < before.low[k] - BOUNDS_MM || after.high[k] > before.high[k] + BOUNDS_MM);
        if outside {
            return Err(Difference { layer: last_layer, what: What::Outside });
        }
        if after.fastest > before.fastest {
            return Err(Difference { layer: last_layer, what: What::Fast(after.fastest) });
        }
        Ok(Figures {
            before: self.before.measure.totals(),
            after: self.after.measure.totals(),
            time_s_before: self.before.clock.rest(),
            time_s_after: self.after.clock.rest(),
            layers: self.before.layers,
        })
    }
}

/// The first line of the output that is not where the file has it, for people.
fn first_other(old: &[(u32, u64)], new: &[(u32, u64)], output: &[u8]) -> String {
    let differs = old.iter().zip(new).find(|(a, b)| a != b).map(|(_, b)| b.1);
    let line = differs.and_then(|h| split_lines(output).find(|bytes| hash(bytes) == h));
    String::from_utf8_lossy(line.unwrap_or(b"(at the layer's end)")).trim().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str =
        "M83\nM204 S1000\nM106 S100\n;TYPE:Internal infill\n;WIDTH:0.45\nG1 X0 Y0 Z.2 F9000\nG1 F1200\n";
    const BEAD_A: &str = "G1 X10 E1\n";
    const TRAVEL: &str = "G1 Y1 F9000\nG1 F1200\n";
    const BEAD_B: &str = "G1 X0 E1\n";
    const END: &str = "G1 X0 Y0 F9000\nM107\n";

    fn check(input: &str, output: &str, expect: Option<&str>) {
        let mut verifier = Verifier::new(Some(Dialect::Prusa), Accelerations::default());
        let got = verifier
            .layer(1, input.as_bytes(), Some(output.as_bytes()))
            .and_then(|()| verifier.finish(1).map(|_| ()));
        match (got, expect) {
            (Ok(()), None) => {}
            (Err(difference), Some(expect)) => {
                let text = difference.to_string();
                assert!(text.contains(expect), "{text} / {expect}\n{output}");
            }
            (got, _) => panic!("{got:?} instead of {expect:?}\n{output}"),
        }
    }

    #[test]
    fn a_reordered_and_reversed_section_is_the_same() {
        let input = [HEAD, BEAD_A, TRAVEL, BEAD_B, END].concat();
        let output =
            [HEAD, "G1 X0 Y1 F9000\nG1 F1200\nG1 X10 E1\nG1 Y0 F9000\nG1 F1200\nG1 X0 E1\n", END].concat();
        check(&input, &input, None);
        check(&input, &output, None);
    }

    #[test]
    fn every_other_change_is_found() {
        let input = [HEAD, BEAD_A, TRAVEL, BEAD_B, END].concat();
        let cases: &[(&str, &str, &str)] = &[
            ("G1 X10 E1", "G1 X10 E1.00001", "other segments"),
            ("G1 X10 E1", "G1 X10.001 E1", "other segments"),
            ("G1 X10 E1", "G1 X5 E.5\nG1 X10 E.5", "3 segments"),
            ("G1 X0 E1", "G1 X0 Z.21 E1", "other segments"),
            ("G1 F1200\nG1 X10", "G1 F1201\nG1 X10", "other segments"),
            ("G1 X10 E1", "M204 S900\nG1 X10 E1", "other segments"),
            ("G1 X10 E1", "M106 S99\nG1 X10 E1", "other segments"),
            ("G1 X10 E1", "M900 K1\nG1 X10 E1", "other segments"),
            ("G1 X10 E1", ";WIDTH:0.5\nG1 X10 E1", "other segments"),
            ("G1 X10 E1", ";TYPE:Perimeter\nG1 X10 E1", "another place"),
            ("G1 X10 E1", "M104 S0\nG1 X10 E1", "command or comment"),
            ("G1 Y1 F9000", "G1 E-1\nG1 Y1 F9000", "between the deposits"),
            ("G1 Y1 F9000", "G1 E.01\nG1 Y1 F9000", "between the deposits"),
            (
                "G1 Y1 F9000\nG1 F1200\nG1 X0 E1\n",
                "G1 E-1\nG1 Y1 F9000\nG1 F1200\nG1 X0 E1\nG1 E1\n",
                "pulled back",
            ),
            ("G1 Y1 F9000", "G1 Z.1\nG1 Y1 F9000\nG1 Z.2", "below the layer"),
            ("G1 Y1 F9000", "G1 Y30 F9000\nG1 Y1", "leave the bounds"),
            ("G1 Y1 F9000", "G1 Y1 F12000", "faster"),
            ("G1 Y1 F9000", &format!("G1 Y1{} F9000", " ".repeat(80)), "longer than the firmware takes"),
            ("G1 X0 Y0 F9000\nM107", "G1 X0 Y.5 F9000\nM107", "the position"),
            ("G1 X0 Y0 F9000\nM107", "G1 X0 Y0 F9000\nG1 E-1\nG1 E1\nM107", "deeper"),
            (
                "G1 Y1 F9000\nG1 F1200\nG1 X0 E1\n",
                "G1 Y1 F9000\nG1 F1200\nG1 Z.3 E.0001\nG1 Z.2\nG1 X0 E1\n",
                "command or comment",
            ),
            ("\nM107", "\nM106 S1", "a setting"),
            ("\nM107", "\nM107\nM82", "command or comment"),
        ];
        for (old, new, expect) in cases {
            assert!(input.contains(old), "{old}");
            check(&input, &input.replacen(old, new, 1), Some(expect));
        }
    }

    #[test]
    fn a_wipe_over_an_arc_goes_where_the_arc_went() {
        let arc = "M83\n;TYPE:Internal infill\nG1 X0 Y0 F600\nG3 X10 Y0 I5 J0 E1\n";
        check(
            &[arc, "G1 E-1\nG1 E1\nG1 X0 Y0\n"].concat(),
            &[arc, "G1 X5 Y-5 E-1\nG1 E1\nG1 X0 Y0\n"].concat(),
            None,
        );
        check(
            &[arc, "G1 E-1\nG1 E1\nG1 X0 Y0\n"].concat(),
            &[arc, "G1 X5 Y-5.1 E-1\nG1 E1\nG1 X0 Y0\n"].concat(),
            Some("leave the bounds"),
        );
    }

    #[test]
    fn an_absolute_end_of_a_relative_job_may_call_e_otherwise() {
        let again = "G1 E-1\nG1 E1.05\n";
        let run = |end: &str| {
            let job = |second| ["G1 E-1\nG1 E1.05\n", BEAD_A, second, TRAVEL, BEAD_B, "M82\n", end].concat();
            let mut verifier = Verifier::new(Some(Dialect::Prusa), Accelerations::default());
            verifier.layer(0, HEAD.as_bytes(), None).unwrap();
            verifier.layer(1, job(again).as_bytes(), Some(job("").as_bytes())).map_err(|d| d.what)
        };
        assert_eq!(run("G1 X0 Y0\n"), Ok(()));
        assert!(matches!(run("G1 X0 Y0 E9\n"), Err(What::Segments(_))));
    }

    #[test]
    fn walls_keep_order_and_direction() {
        let input = [HEAD, BEAD_A, TRAVEL, BEAD_B, END].concat().replace("Internal infill", "Perimeter");
        let output =
            [HEAD, "G1 X0 Y1 F9000\nG1 F1200\nG1 X10 E1\nG1 Y0 F9000\nG1 F1200\nG1 X0 E1\n", END].concat();
        check(&input, &output.replace("Internal infill", "Perimeter"), Some("order or direction"));
        let other_way = "M83\n;TYPE:Perimeter\nG1 X10 F600\nG1 X0 E1\nG1 X0\n";
        check("M83\n;TYPE:Perimeter\nG1 X0 F600\nG1 X10 E1\nG1 X0\n", other_way, Some("order or direction"));
    }

    #[test]
    fn what_moves_through_time_keeps_its_place() {
        let input = [HEAD, BEAD_A, "M73 P5\n", TRAVEL, BEAD_B, END].concat();
        check(&input, &[HEAD, "M73 P5\n", BEAD_A, TRAVEL, BEAD_B, END].concat(), Some("M73 P5"));
    }

    #[test]
    fn an_unchanged_layer_counts_for_both() {
        let text = [HEAD, BEAD_A, TRAVEL, BEAD_B, END].concat();
        let mut verifier = Verifier::new(Some(Dialect::Prusa), Accelerations::default());
        for number in 0..3 {
            verifier.layer(number, text.as_bytes(), None).unwrap();
        }
        let figures = verifier.finish(3).unwrap();
        assert_eq!(figures.before, figures.after);
        assert!((figures.time_s_before - figures.time_s_after).abs() < 1e-9 && figures.time_s_before > 0.0);
        assert_eq!(figures.before.beads, 6);
    }
}
