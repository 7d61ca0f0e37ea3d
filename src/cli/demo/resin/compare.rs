//! What a resin job asks for, and what the mock printer and its display have seen.
//!
//! Takes layers, pulses of light and changes of the display, all times of one clock; gives figures
//! and a table. Reads no file, prints nothing.
use crate::printer::lcd::recorder::Change;
use crate::printer::mock::Pulse;
use anyhow::ensure;
use std::fmt::Write;

/// An exposure may differ by this share at most, percent.
const MOST_PERCENT: f64 = 1.0;

/// The plate's height may differ by this, mm: less than a step of most drives.
const MOST_MM: f64 = 0.002;

/// Layers that the table shows: the first, where the times change, and the last.
const SHOWN_FIRST: usize = 6;

/// A layer of the job.
#[derive(Clone, Copy, Debug)]
pub(super) struct Asked {
    pub(super) exposure_s: f64,
    pub(super) top_mm: f64,
    /// Of its picture.
    pub(super) sum: u64,
}

/// What a layer got.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Got {
    lit_s: f64,
    z_mm: f64,
    /// Of what was shown when the light came on; nothing had been shown before.
    sum: Option<u64>,
    /// The display changed while the light was on.
    changed: bool,
    /// The light's power changed, or it is still on.
    uneven: bool,
}

/// The one beside the other.
#[derive(Debug)]
pub(super) struct Compared {
    asked: Vec<Asked>,
    got: Vec<Got>,
}

impl Compared {
    /// `speed`: how many times faster than life the machine was; times are of one clock.
    pub(super) fn new(asked: Vec<Asked>, pulses: &[Pulse], changes: &[Change], speed: f64) -> Self {
        let got = pulses.iter().map(|pulse| {
            let begin_ns = pulse.begin.at_ns;
            let end_ns = pulse.end.map_or(u64::MAX, |end| end.at_ns);
            let before = changes.iter().take_while(|change| change.at_ns <= begin_ns).last();
            Got {
                lit_s: pulse.machine_s(speed).unwrap_or(f64::INFINITY),
                z_mm: pulse.begin.z_mm,
                sum: before.map(|change| change.sum),
                changed: changes.iter().any(|change| change.at_ns > begin_ns && change.at_ns < end_ns),
                uneven: pulse.power != u8::MAX || pulse.end.is_none(),
            }
        });
        Self { got: got.collect(), asked }
    }

    fn pairs(&self) -> impl Iterator<Item = (&Asked, &Got)> {
        self.asked.iter().zip(&self.got)
    }

    /// Exposures that were made of those that were asked for: missing ones, and too many.
    fn missing_and_too_many(&self) -> [usize; 2] {
        let (asked, got) = (self.asked.len(), self.got.len());
        [asked.saturating_sub(got), got.saturating_sub(asked)]
    }

    /// Exposures that showed another picture than that of the layer whose turn it was.
    fn out_of_order(&self) -> usize {
        self.pairs().filter(|(asked, got)| got.sum != Some(asked.sum)).count()
    }

    fn changed(&self) -> usize {
        self.got.iter().filter(|got| got.changed || got.uneven).count()
    }

    /// By how much an exposure differs at most, percent.
    fn worst_percent(&self) -> f64 {
        self.pairs().map(|(asked, got)| percent(asked, got).abs()).fold(0.0, f64::max)
    }

    /// By how much the plate's height differs at most, mm.
    fn worst_mm(&self) -> f64 {
        self.pairs().map(|(asked, got)| (got.z_mm - asked.top_mm).abs()).fold(0.0, f64::max)
    }

    /// Some layers, and the figures of all.
    pub(super) fn table(&self) -> String {
        let mut out = String::from(
            "   layer   plate, mm          light on, s\n           asked    was       asked      was\n",
        );
        let last = self.asked.len().saturating_sub(1);
        for (at, (asked, got)) in self.pairs().enumerate() {
            if at >= SHOWN_FIRST && at != last {
                continue;
            }
            if at == last && last > SHOWN_FIRST {
                out += "     …\n";
            }
            let _ = writeln!(
                out,
                "   {at:>5} {:>7.3} {:>6.3}   {:>9.3} {:>8.4}   {:+.2} %",
                asked.top_mm,
                got.z_mm,
                asked.exposure_s,
                got.lit_s,
                percent(asked, got)
            );
        }
        let [missing, too_many] = self.missing_and_too_many();
        let asked_s: f64 = self.asked.iter().map(|asked| asked.exposure_s).sum();
        let lit_s: f64 = self.got.iter().map(|got| got.lit_s).sum();
        let rows = [
            ("exposures", format!("{} of {}", self.got.len(), self.asked.len()), ""),
            ("missing, too many", format!("{missing}, {too_many}"), ""),
            ("out of order", self.out_of_order().to_string(), "with another picture than the layer's own"),
            ("changed in light", self.changed().to_string(), "picture or power, while the light was on"),
            ("plate off by", format!("{:.4} mm", self.worst_mm()), "at most"),
            ("light asked", format!("{asked_s:.2} s"), "in all"),
            ("light measured", format!("{lit_s:.2} s"), "in all"),
            ("light off by", format!("{:.2} %", self.worst_percent()), "of a layer's time, at most"),
        ];
        out.push('\n');
        for (name, value, note) in rows {
            let row = format!("   {name:<19}{value:>10}   {note}");
            let _ = writeln!(out, "{}", row.trim_end());
        }
        out.truncate(out.trim_end().len());
        out
    }

    /// # Errors
    /// Something was exposed otherwise than the job says.
    pub(super) fn verdict(&self) -> anyhow::Result<()> {
        let [missing, too_many] = self.missing_and_too_many();
        ensure!(
            missing + too_many + self.out_of_order() + self.changed() == 0,
            "{missing} exposures are missing, {too_many} too many, {} with another picture than their own, {} \
             with a picture or power that changed: please report this",
            self.out_of_order(),
            self.changed()
        );
        ensure!(
            self.worst_mm() <= MOST_MM,
            "the plate was {:.4} mm off, more than {MOST_MM} mm: please report this",
            self.worst_mm()
        );
        ensure!(
            self.worst_percent() <= MOST_PERCENT,
            "an exposure differs by {:.2} % from what the job says, more than {MOST_PERCENT} %: on a machine \
             that is busy with other things, --speed 10 gives its threads more time",
            self.worst_percent()
        );
        Ok(())
    }
}

/// By how much an exposure differs, percent.
fn percent(asked: &Asked, got: &Got) -> f64 {
    (got.lit_s / asked.exposure_s - 1.0) * 100.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::printer::lcd::recorder::Shown;
    use crate::printer::mock::Moment;

    const MS: u64 = 1_000_000;

    /// Light from and to, ms, at a height; pictures at times, ms, by their sums. Two layers of 2 s,
    /// printed ten times faster than life.
    #[track_caller]
    fn check(light: &[(u64, u64, f64)], shown: &[(u64, u64)], expect: Result<(), &str>) {
        let asked = [(0.1, 7), (0.2, 8)].map(|(top_mm, sum)| Asked { exposure_s: 2.0, top_mm, sum });
        let moment = |ms: u64, z_mm| Moment { at_ns: ms * MS, z_mm };
        let pulse = |&(from, to, z_mm): &(u64, u64, f64)| Pulse {
            begin: moment(from, z_mm),
            end: Some(moment(to, z_mm)),
            power: 255,
        };
        let change = |&(ms, sum): &(u64, u64)| Change { at_ns: ms * MS, shown: Shown::Blank, sum };
        let pulses: Vec<_> = light.iter().map(pulse).collect();
        let changes: Vec<_> = shown.iter().map(change).collect();
        let compared = Compared::new(asked.to_vec(), &pulses, &changes, 10.0);
        for line in compared.table().lines() {
            assert!(line.chars().count() < 80, "{line}");
        }
        match (compared.verdict(), expect) {
            (Ok(()), Ok(())) => {}
            (Err(why), Err(words)) => assert!(why.to_string().contains(words), "{why}"),
            (got, expect) => panic!("{got:?} instead of {expect:?}"),
        }
    }

    #[test]
    fn only_the_whole_job_in_its_order_will_do() {
        let light = [(100, 300, 0.1), (500, 701, 0.2)];
        let shown = [(0, 0), (90, 7), (310, 0), (490, 8), (710, 0)];
        check(&light, &shown, Ok(()));
        check(&light[..1], &shown, Err("1 exposures are missing"));
        check(&[light[0], light[1], (900, 1100, 0.3)], &shown, Err("1 too many"));
        check(&light, &[(0, 0), (90, 8), (310, 0), (490, 7), (710, 0)], Err("2 with another picture"));
        check(&light, &[(90, 7), (310, 0)], Err("1 with another picture"));
        check(&light, &[], Err("2 with another picture"));
        check(&light, &[(0, 0), (90, 7), (299, 0), (490, 8), (710, 0)], Err("1 with a picture or power"));
        check(&[light[0], (500, 703, 0.2)], &shown, Err("1.50 %"));
        check(&[light[0], (500, 690, 0.2)], &shown, Err("5.00 %"));
        check(&[light[0], (500, 700, 0.21)], &shown, Err("0.0100 mm off"));
    }
}
