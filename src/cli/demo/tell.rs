//! The demo's words: what was found, what was made, what arrived.
//!
//! Takes figures, gives text of at most 80 columns. Prints nothing.
use crate::printer::mock::Stats;
use crate::printer::mock::stats::Digest;
use crate::server::model::Check;
use anyhow::ensure;
use std::fmt::Write;
use std::path::Path;

/// Columns of a terminal.
const WIDTH: usize = 79;

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
        self.expected.lines().saturating_sub(self.stats.all_digest_lines).max(self.stats.lines_lost)
    }

    pub(super) fn table(&self) -> String {
        let s = &self.stats;
        let own = format!("{} of the job, the rest are the host's own", s.all_digest_lines);
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
        let (executed, file) = (&s.all_digest, self.expected.hex());
        ensure!(
            *executed == file && s.all_digest_lines == self.expected.lines() && s.lines_repeated == 0,
            "the printer did not execute the job as it is in the file: {} of {} commands, lost {}, \
             repeated {}, digest {executed} instead of {file}; please report this",
            s.all_digest_lines,
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

/// What a check found, the worst first.
pub(super) fn checked(check: &Check) -> String {
    let count = |n: u64, one: &str, many: &str| match n {
        1 => format!("1 {one}"),
        n => format!("{n} {many}"),
    };
    let mut out = format!(
        "   The check found {} and {} in {:.1} s:\n",
        count(check.islands, "island", "islands"),
        count(check.overhangs, "overhang", "overhangs"),
        check.seconds
    );
    for finding in check.findings.iter().take(3) {
        out += &wrapped(&format!("- {}", finding.words));
    }
    out.truncate(out.trim_end().len());
    out
}

/// What mending did.
pub(super) fn mended(words: &str) -> String {
    wrapped(words).trim_end().to_owned()
}

/// Words in lines of a terminal's width, each behind three blanks.
fn wrapped(words: &str) -> String {
    let mut out = String::from("  ");
    let mut width = 2;
    for word in words.split_whitespace() {
        if width + 1 + word.chars().count() > WIDTH {
            out.push_str("\n    ");
            width = 4;
        }
        out.push(' ');
        out.push_str(word);
        width += 1 + word.chars().count();
    }
    out.push('\n');
    out
}

/// Where everything is, and what to do next.
pub(super) fn closing(folder: &Path) -> String {
    format!(
        "\nThe daemon's data stay in {}\n\n\
         With a printer of your own:\n  \
         outrigger serve --print-config > outrigger.toml   name your printer there\n  \
         outrigger user add NAME                           who may use the page\n  \
         outrigger serve                                   and open the page",
        folder.display()
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::server::model::Finding;

    const FILE: &[u8] = b"; a comment\nG28 ; home\n\nM105\r\nG1 X1 E.5\r\n";

    fn stats(commands: &[&str]) -> Stats {
        let mut digest = Digest::default();
        commands.iter().for_each(|c| digest.add(c.as_bytes()));
        Stats { all_digest: digest.hex(), all_digest_lines: digest.lines(), ..Stats::default() }
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
            all_digest_lines: 1_234_567,
            planner_empty_share: 1.0,
            ..Stats::default()
        };
        let finding = Finding { words: "a piece begins in the air ".repeat(9), ..Finding::default() };
        let check = Check { findings: vec![finding], islands: 1, ..Check::default() };
        let texts = [
            Arrived::new(stats, FILE).table(),
            checked(&check),
            mended(&"word ".repeat(60)),
            closing(Path::new("/tmp/a")),
        ];
        for line in texts.iter().flat_map(|t| t.lines()) {
            assert!(line.chars().count() <= 79, "{line}");
        }
    }
}
