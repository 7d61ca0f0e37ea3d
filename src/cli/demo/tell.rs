//! The demo's words: what was gained, what arrived.
//!
//! Takes figures, gives text of at most 80 columns. Prints nothing.
use crate::post::report::Report;
use crate::printer::mock::Stats;
use crate::printer::mock::stats::Digest;
use crate::report::check;
use anyhow::ensure;
use std::fmt::Write;
use std::path::Path;

/// What the printer got, beside what is in the file.
pub(super) struct Arrived {
    stats: Stats,
    /// Of the commands in the file.
    expected: Digest,
}

impl Arrived {
    pub(super) fn new(stats: Stats, file: &[u8]) -> Arrived {
        let mut expected = Digest::default();
        // Apart from the sender on purpose: a mistake in its reading of the file shows here.
        for line in file.split(|&b| b == b'\n') {
            let command = line.split(|&b| b == b';').next().unwrap_or_default().trim_ascii();
            if !command.is_empty() {
                expected.add(command);
            }
        }
        Arrived { stats, expected }
    }

    /// Commands of the file that did not arrive.
    fn lost(&self) -> u64 {
        self.expected.lines().saturating_sub(self.stats.digest_lines).max(self.stats.lines_lost)
    }

    pub(super) fn table(&self) -> String {
        let s = &self.stats;
        let own = format!("{} of the job, the rest are the host's own", s.digest_lines);
        let damaged = s.checksum_errors + s.checksums_missing + s.unknown_commands;
        let rows = [
            ("lines accepted", s.lines_accepted.to_string(), own.as_str()),
            ("lost", self.lost().to_string(), ""),
            ("repeated", s.lines_repeated.to_string(), "twice accepted"),
            ("damaged", damaged.to_string(), "noticed by checksum, or not understood"),
            ("out of order", s.lines_out_of_order.to_string(), "refused: the line before was damaged"),
            ("asked again", s.resends_asked.to_string(), "by the printer, and sent again"),
            (
                "planner empty",
                format!("{:.1} %", s.planner_empty_share * 100.0),
                "of the time that the head should move",
            ),
        ];
        let mut out = String::new();
        for (name, value, note) in rows {
            let row = format!("   {name:<15}{value:>8}   {note}");
            let _ = writeln!(out, "{}", row.trim_end());
        }
        out.truncate(out.trim_end().len());
        out
    }

    /// # Errors
    /// What was executed is not what the file says.
    pub(super) fn verdict(&self) -> anyhow::Result<()> {
        let s = &self.stats;
        let (executed, file) = (&s.digest, self.expected.hex());
        ensure!(
            *executed == file && s.digest_lines == self.expected.lines() && s.lines_repeated == 0,
            "the printer did not execute the job as it is in the file: {} of {} commands, lost {}, \
             repeated {}, digest {executed} instead of {file}; please report this",
            s.digest_lines,
            self.expected.lines(),
            self.lost(),
            s.lines_repeated,
        );
        super::say(&format!(
            "   What the printer executed and what is in the file have one digest,\n   \
             {file}: every line arrived, once, and in its order."
        ));
        Ok(())
    }
}

/// What post-processing gained, as a table.
pub(super) fn reordered(r: &Report) -> String {
    let count = |n: u64| n.to_string();
    let metres = |mm: f64| format!("{:.2} m", mm / 1e3);
    let rows = [
        (
            "beads",
            [count(r.beads_before), count(r.beads_after)],
            [r.beads_before as f64, r.beads_after as f64],
        ),
        (
            "retractions",
            [count(r.retractions_before), count(r.retractions_after)],
            [r.retractions_before as f64, r.retractions_after as f64],
        ),
        (
            "lifts of the head",
            [count(r.lifts_before), count(r.lifts_after)],
            [r.lifts_before as f64, r.lifts_after as f64],
        ),
        (
            "travel",
            [metres(r.travel_mm_before), metres(r.travel_mm_after)],
            [r.travel_mm_before, r.travel_mm_after],
        ),
        (
            "printing time",
            [minutes(r.time_s_before), minutes(r.time_s_after)],
            [r.time_s_before, r.time_s_after],
        ),
    ];
    let mut out = format!(
        "   {} of {} infill sections have a better order. The result was read again:\n   \
         it prints the same plastic in the same places.\n\n   {:<18}{:>14}{:>14}{:>10}\n",
        r.sections_changed, r.sections, "", "before", "after", "change"
    );
    for (name, [before, after], [b, a]) in rows {
        let _ = writeln!(out, "   {name:<18}{before:>14}{after:>14}{:>10}", change(b, a));
    }
    out
}

/// What a check found.
pub(super) fn checked(r: &check::Report) -> String {
    let regions: u64 = r.overhangs_by_method.values().map(|found| found.regions).sum();
    let of = |n: u64, what: &str| if n == 0 { format!("no {what}") } else { format!("{n} {what}") };
    format!(
        "   {} layers: {}, {}. The page shows them one by one,\n   with a slider, in any web browser.",
        r.layers,
        of(r.islands.len() as u64, "islands"),
        of(regions, "overhangs"),
    )
}

/// `-5.1 %`, or nothing where all is the same.
fn change(before: f64, after: f64) -> String {
    match (after / before - 1.0) * 100.0 {
        p if before == after || !p.is_finite() => "-".to_owned(),
        p => format!("{p:+.1} %"),
    }
}

fn minutes(seconds: f64) -> String {
    // A float cast saturates: no estimate is too wild.
    let s = seconds.round().max(0.0) as u64;
    format!("{} min {:02} s", s / 60, s % 60)
}

/// Where everything is, and what to do next.
pub(super) fn closing(folder: &Path, seconds: f64) -> String {
    format!(
        "\nDone in {seconds:.0} s. The files stay in {}\n\n\
         With a printer of your own:\n  \
         outrigger post JOB.gcode --picture LAYER.svg   reorder a sliced job\n  \
         outrigger profile list                         find your printer's profile\n  \
         outrigger print JOB.gcode --port DEV --profile NAME",
        folder.display()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &[u8] = b"; a comment\nG28 ; home\n\nM105\r\nG1 X1 E.5\r\n";

    fn stats(commands: &[&str]) -> Stats {
        let mut digest = Digest::default();
        commands.iter().for_each(|c| digest.add(c.as_bytes()));
        Stats { digest: digest.hex(), digest_lines: digest.lines(), ..Stats::default() }
    }

    #[test]
    fn only_the_whole_job_in_its_order_will_do() {
        let check = |stats: Stats, lost: u64, good: bool| {
            let arrived = Arrived::new(stats, FILE);
            let verdict = arrived.verdict();
            assert_eq!((arrived.lost(), verdict.is_ok()), (lost, good), "{verdict:?}");
        };
        check(stats(&["G28", "G1 X1 E.5"]), 0, true);
        check(stats(&["M115", "G28", "M105", "G1 X1 E.5", "M400"]), 0, true);
        check(stats(&["G1 X1 E.5", "G28"]), 0, false);
        check(stats(&["G28"]), 1, false);
        check(stats(&[]), 2, false);
        check(stats(&["G28", "G1 X1 E.5", "G1 X1 E.5"]), 0, false);
        check(stats(&["G28", "G1 X1 E.6"]), 0, false);
        check(Stats { lines_repeated: 1, ..stats(&["G28", "G1 X1 E.5"]) }, 0, false);
    }

    #[test]
    fn nothing_is_wider_than_a_terminal() {
        let stats = Stats {
            lines_accepted: 1_234_567,
            digest_lines: 1_234_567,
            planner_empty_share: 1.0,
            ..Stats::default()
        };
        let report = Report { travel_mm_before: 4e6, travel_mm_after: 3.9e6, ..Report::default() };
        let texts =
            [Arrived::new(stats, FILE).table(), reordered(&report), closing(Path::new("/tmp/a"), 30.0)];
        for line in texts.iter().flat_map(|t| t.lines()) {
            assert!(line.chars().count() <= 79, "{line}");
        }
    }

    #[test]
    fn changes() {
        let check = |before, after, expect: &str| assert_eq!(change(before, after), expect);
        check(100.0, 94.9, "-5.1 %");
        check(100.0, 100.0, "-");
        check(0.0, 0.0, "-");
        check(0.0, 1.0, "-");
        assert_eq!(minutes(951.06), "15 min 51 s");
    }
}
