//! How far a job is, and how long the rest takes.
//!
//! Takes the lines and marks that were reached and the time since the first line; gives a part
//! done and seconds left. Owns no clock.
use super::marks::{Facts, Marks};
use crate::printer::job_file::Checked;

/// Part of the job that must be done before its own pace tells what is left…
const PACE_FRACTION: f64 = 0.02;

/// …and how long it must have run.
const PACE_S: f64 = 20.0;

/// The part of the job's lines that is done, 0 to 1.
pub(crate) fn fraction(line: u64, checked: &Checked) -> f64 {
    line as f64 / checked.last_command.max(1) as f64
}

/// Seconds that the rest takes: at the pace so far once that tells, by the slicer's own estimate
/// before, on a printer that is `speed` times faster than life. The slicer's marks also tell best
/// how far the job is: lines are of very different length.
pub(crate) fn left_s(
    elapsed_s: f64,
    line: u64,
    checked: &Checked,
    facts: Facts,
    marks: &Marks,
    speed: f64,
) -> Option<f64> {
    let marked_s = marks.left_s;
    let done = match (marked_s, facts.total_s) {
        (Some(left), Some(total)) if total > 0.0 => (1.0 - left / total).clamp(0.0, 1.0),
        _ => fraction(line, checked),
    };
    if done >= PACE_FRACTION && elapsed_s >= PACE_S {
        return Some(elapsed_s * (1.0 - done) / done);
    }
    marked_s.or(facts.total_s).map(|s| s / speed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[allow(clippy::field_reassign_with_default)]
    #[test]
    fn the_slicers_word_until_the_pace_tells() {
        let checked = Checked { last_command: 100, ..Checked::default() };
        let mut facts = Facts::default();
        facts.total_s = Some(1000.0);
        let check = |elapsed_s, line, marked: Option<f64>, speed, expect: Option<f64>| {
            let mut marks = Marks::default();
            marks.left_s = marked;
            assert_eq!(left_s(elapsed_s, line, &checked, facts, &marks, speed), expect);
        };
        check(1.0, 1, None, 1.0, Some(1000.0));
        check(1.0, 1, Some(900.0), 10.0, Some(90.0));
        check(100.0, 50, None, 1.0, Some(100.0));
        check(100.0, 1, Some(500.0), 1.0, Some(100.0));
        let unknown = left_s(1.0, 1, &checked, Facts::default(), &Marks::default(), 1.0);
        assert_eq!(unknown, None);
    }
}
