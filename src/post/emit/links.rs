//! The way from bead to bead: as it was, led elsewhere, or made anew by the file's habits.
use super::super::layer::{Channel, Row, What};
use super::super::link::{Habits, Retraction, Sample, Travel, Wipe, is_regular};
use super::super::rewrite::{Change, rewrite};
use super::super::section::{is_link, pushes_upwards};
use super::{Emitter, FEED, Refusal, SAME_MM};
use crate::toolpath::bead::{LiftRule, Point, distance_mm};
use outrigger_gcode::line::{Command, parse};
use outrigger_gcode::state::{Kind, Move};
use std::ops::Range;

/// Longest wipe that is made, mm: slicers wipe some millimetres, and a file that
/// claims kilometres must not make as many turns over a short bead.
const MAX_WIPE_MM: f64 = 100.0;

impl Emitter<'_> {
    /// Goes to where a bead starts, over the rows that stood before it in the file.
    /// `old` is where the file went from and to.
    pub(in crate::post) fn link(
        &mut self,
        rows: Range<usize>,
        old: [Point; 2],
        to: Point,
        rule: &impl LiftRule,
        habits: &Habits,
    ) -> Result<(), Refusal> {
        let same = distance_mm(self.at(), old[0]) < SAME_MM && distance_mm(to, old[1]) < SAME_MM;
        // Another bead may have been printed last than in the file.
        self.cursor.e_in_step = false;
        let layer = self.layer;
        if same {
            self.copy_all(rows);
            Ok(())
        } else if layer.rows[rows.clone()].iter().all(|r| is_link(r.what)) {
            let own = &layer.rows[rows.clone()];
            let regular = is_regular(layer, own);
            let pulls = own.iter().any(|row| match row.what {
                What::Move(m, _) => m.e < 0.0,
                what => what == What::Retract,
            });
            let from_there = distance_mm(self.at(), old[0]) < SAME_MM;
            // The file's own way of retracting where it stands (with PrusaSlicer's move
            // inwards from a wall, say) is the best one, and where that is needed it stays.
            if from_there && pulls && (!regular || rule.needs_lift(self.at(), to)) {
                return self.led_elsewhere(rows, old[0], to, rule);
            }
            if !regular {
                return Err(Refusal::Irregular);
            }
            for row in &layer.rows[rows.clone()] {
                if matches!(row.what, What::Quiet | What::Progress) {
                    self.push(*row);
                }
            }
            self.jump(to, rows.end, rule, habits)
        } else {
            self.led_elsewhere(rows, old[0], to, rule)
        }
    }

    /// A link made anew, to the bead that begins at row `first`.
    pub(in crate::post) fn jump(
        &mut self,
        to: Point,
        first: usize,
        rule: &impl LiftRule,
        habits: &Habits,
    ) -> Result<(), Refusal> {
        let state = self.layer.rows.get(first).map_or(0, |r| r.state);
        // What comes next is out of step with the file's own E words.
        self.cursor.e_in_step = false;
        if distance_mm(self.at(), to) < SAME_MM {
            return Ok(());
        }
        if !rule.needs_lift(self.at(), to) {
            let travel = habits.plain().ok_or(Refusal::NoTravel)?.clone();
            self.travel(to, &travel, state);
            return Ok(());
        }
        let (retraction, travel) = habits.retracted.as_ref().ok_or(Refusal::NoRetraction)?.clone();
        let z = self.cursor.position[2];
        self.retract(&retraction, state);
        if let Some((sample, height_mm)) = &retraction.up {
            self.vertical(sample, z + height_mm, state);
        }
        self.travel(to, &travel, state);
        if let Some(sample) = &retraction.down {
            self.vertical(sample, z, state);
        }
        if let Some([_, unretract]) = &retraction.firmware {
            self.add(What::Unretract, state, |out| out.extend_from_slice(unretract));
        }
        for (sample, e) in &retraction.unretract {
            self.filament(sample, *e, state);
        }
        Ok(())
    }

    fn travel(&mut self, to: Point, travel: &Travel, state: u32) {
        for (k, channel) in Channel::OF_TRAVEL.into_iter().enumerate() {
            let text = &travel.channels[k];
            if !text.is_empty() && self.bytes(self.cursor.channels[channel as usize]) != text.as_slice() {
                self.add(What::Channel(channel), state, |out| out.extend_from_slice(text));
            }
        }
        let changes = [self.set(0, to[0]), self.set(1, to[1]), (b'Z', Change::Drop), (b'E', Change::Drop)];
        let to = [to[0], to[1], self.cursor.position[2]];
        self.like(&travel.line, to, 0.0, &changes, state);
    }

    fn vertical(&mut self, sample: &Sample, z: f64, state: u32) {
        let at = self.cursor.position;
        let mut changes = vec![self.set(2, z), (b'E', Change::Drop)];
        let line = parse(&sample.text);
        changes.extend((0..2).filter(|&k| line.words.has(b"XY"[k])).map(|k| self.set(k, at[k])));
        self.like(sample, [at[0], at[1], z], 0.0, &changes, state);
    }

    fn filament(&mut self, sample: &Sample, e: f64, state: u32) {
        let changes = [self.set_e(e), (b'X', Change::Drop), (b'Y', Change::Drop), (b'Z', Change::Drop)];
        self.like(sample, self.cursor.position, e, &changes, state);
    }

    /// A move like the sample, to another place.
    fn like(&mut self, sample: &Sample, to: [f64; 3], e: f64, changes: &[(u8, Change)], state: u32) {
        let line = parse(&sample.text);
        let mut changes = changes.to_vec();
        if line.words.has(b'F') || self.cursor.feed != sample.feed {
            changes.push((b'F', Change::Set(sample.feed, FEED)));
        }
        // A wipe may have gone along an arc; what is made like it is straight.
        let is_arc = matches!(line.command, Command::Classic { letter: b'G', number: 2 | 3, .. });
        let head: &[u8] = if is_arc { b"G1" } else { line.head };
        if is_arc {
            changes.extend(b"IJRP".map(|letter| (letter, Change::Drop)));
        }
        let m = Move { from: self.cursor.position, to, e, feed: sample.feed, arc: None };
        self.add(What::Move(m, m.kind()), state, |out| rewrite(&line, head, &changes, out));
    }

    /// Pulls the filament back as the file does, wiping over the bead printed last.
    fn retract(&mut self, retraction: &Retraction, state: u32) {
        let mut left = retraction.depth_mm();
        let mut sample = None;
        if let Some((line, e)) = &retraction.before {
            let alone = retraction.wipe.is_none() && retraction.after.is_none();
            let e = if alone { left } else { *e };
            self.filament(line, -e, state);
            left -= e;
            sample = Some(line);
        }
        if let Some(wipe) = &retraction.wipe {
            let wipe = Wipe { e: retraction.wipe_e_mm(wipe), ..wipe.clone() };
            left -= self.wipe(&wipe, state);
            sample = sample.or(retraction.unretract.first().map(|u| &u.0));
        }
        let unit = 10f64.powi(-i32::from(self.layer.style.e_decimals));
        if left > unit / 2.0 {
            let line = retraction.after.as_ref().map(|a| &a.0).or(sample);
            if let Some(line) = line {
                self.filament(&line.clone(), -left, state);
            }
        }
        if let Some([retract, _]) = &retraction.firmware {
            self.add(What::Retract, state, |out| out.extend_from_slice(retract));
        }
    }

    /// Wipes back over the last bead, and forth again where it is shorter than the
    /// wipe. Gives the filament pulled back, mm.
    fn wipe(&mut self, wipe: &Wipe, state: u32) -> f64 {
        let points = self.wipe_points(wipe.length_mm);
        let length: f64 = points.windows(2).map(|p| distance_mm(p[0], p[1])).sum();
        if points.len() < 2 || wipe.length_mm <= 0.0 {
            return 0.0;
        }
        let [begin, end] = &wipe.marks;
        if !begin.is_empty() {
            self.add(What::WipeMark, state, |out| out.extend_from_slice(begin));
        }
        self.feed_for(&parse(&wipe.line.text), wipe.line.feed, state);
        let unit = 10f64.powi(i32::from(self.layer.style.e_decimals));
        let total = wipe.e * (length / wipe.length_mm).min(1.0);
        let (mut gone, mut pulled) = (0.0, 0.0);
        for pair in points.windows(2) {
            gone += distance_mm(pair[0], pair[1]);
            // Rounded as a sum, so that rounding does not add up.
            let due = (total * gone / length * unit).round() / unit;
            let e = due - pulled;
            pulled = due;
            let to = [pair[1][0], pair[1][1], self.cursor.position[2]];
            let changes = [self.set(0, to[0]), self.set(1, to[1]), self.set_e(-e), (b'Z', Change::Drop)];
            self.like(&wipe.line, to, -e, &changes, state);
        }
        if !end.is_empty() {
            self.add(What::WipeMark, state, |out| out.extend_from_slice(end));
        }
        pulled
    }

    /// From the nozzle back over the last bead, `length_mm` in all, turning at its ends.
    fn wipe_points(&self, length_mm: f64) -> Vec<Point> {
        let mut path: Vec<Point> = vec![self.at()];
        let Some((bead, reversed)) = self.cursor.last else { return path };
        let mut forward: Vec<Point> = vec![bead.bead.ends[0]];
        for row in &self.layer.rows[bead.first..=bead.last] {
            if let What::Move(m, Kind::Deposit) = row.what {
                m.chords(|_, b| forward.push(b));
            }
        }
        if !reversed {
            forward.reverse();
        }
        let whole: f64 = forward.windows(2).map(|p| distance_mm(p[0], p[1])).sum();
        // A nozzle that is not where the bead ended does not wipe.
        if whole < 0.05 || distance_mm(forward[0], self.at()) > SAME_MM {
            return path;
        }
        let mut left = length_mm.min(MAX_WIPE_MM);
        let mut back = false;
        while left > SAME_MM {
            let stops: Vec<Point> =
                if back { forward.iter().rev().copied().collect() } else { forward.clone() };
            for pair in stops.windows(2) {
                let step = distance_mm(pair[0], pair[1]);
                if step < SAME_MM {
                    continue;
                }
                let t = (left / step).min(1.0);
                path.push([
                    pair[0][0] + t * (pair[1][0] - pair[0][0]),
                    pair[0][1] + t * (pair[1][1] - pair[0][1]),
                ]);
                left -= step * t;
                if left <= SAME_MM {
                    break;
                }
            }
            back = !back;
        }
        path
    }

    /// The rows of a link as they are, barriers included, but that the wipe goes over
    /// the bead printed last and the last travel to `to`, straight.
    fn led_elsewhere(
        &mut self,
        rows: Range<usize>,
        from: Point,
        to: Point,
        rule: &impl LiftRule,
    ) -> Result<(), Refusal> {
        let layer = self.layer;
        let is_travel = |row: &Row| matches!(row.what, What::Move(m, Kind::Travel) if m.moves_xy());
        let last_travel = rows.clone().rev().find(|&k| is_travel(&layer.rows[k]));
        // The travels right before the last one are corners on the old way.
        let is_corner = |row: &Row| match row.what {
            What::Move(m, kind) => kind == Kind::Still || (is_travel(row) && m.from[2] == m.to[2]),
            what => matches!(what, What::Channel(_) | What::Progress | What::Quiet),
        };
        let way = last_travel.map_or(rows.end, |last| {
            (rows.start..last).rev().take_while(|&k| is_corner(&layer.rows[k])).last().unwrap_or(last)
        });
        let left_from = self.at();
        let mut was = from;
        let mut k = rows.start;
        while k < rows.end {
            let row = layer.rows[k];
            let moved = distance_mm(self.at(), was) > SAME_MM;
            if let What::Move(m, _) = row.what {
                was = [m.to[0], m.to[1]];
            }
            match row.what {
                What::Anchor | What::Mode(_) if moved => return Err(Refusal::Anchored),
                what if moved && pushes_upwards(what) => return Err(Refusal::Anchored),
                What::Move(_, Kind::Wipe) if moved => {
                    k = self.wipe_anew(k, rows.end, &mut was);
                    continue;
                }
                What::Move(m, _) if Some(k) == last_travel => {
                    if !self.is_retracted() && rule.needs_lift(left_from, to) {
                        return Err(Refusal::Unretracted);
                    }
                    self.copy_to(&row, m, to);
                }
                What::Move(..) if is_travel(&row) && k >= way && Some(k) < last_travel => {}
                _ => self.copy(&row),
            }
            k += 1;
        }
        // Which bead comes next is the caller's choice.
        self.cursor.e_in_step = false;
        if distance_mm(self.at(), to) > SAME_MM { Err(Refusal::NoWay) } else { Ok(()) }
    }

    /// Replaces the wiping moves from row `k` on by as much wiping over the last
    /// bead; gives the row after them.
    fn wipe_anew(&mut self, k: usize, end: usize, was: &mut Point) -> usize {
        let rows = &self.layer.rows[k..end];
        let count =
            rows.iter().take_while(|r| matches!(r.what, What::Move(_, Kind::Wipe | Kind::Still))).count();
        let mut wipe: Option<Wipe> = None;
        let state = rows[0].state;
        for row in &rows[..count] {
            let What::Move(m, Kind::Wipe) = row.what else { continue };
            *was = [m.to[0], m.to[1]];
            let sample = Sample { text: self.layer.bytes(row.span).to_vec(), feed: m.feed };
            let wipe =
                wipe.get_or_insert(Wipe { line: sample, e: 0.0, length_mm: 0.0, marks: Default::default() });
            wipe.e -= m.e;
            wipe.length_mm += m.length_mm();
        }
        if let Some(wipe) = wipe {
            self.cursor.e_in_step = false;
            let pulled = self.wipe(&wipe, state);
            let left = wipe.e - pulled;
            if left > SAME_MM {
                self.filament(&wipe.line.clone(), -left, state);
            }
        }
        k + count
    }

    /// A travel of the file, led to another place.
    fn copy_to(&mut self, row: &Row, m: Move, to: Point) {
        let line = parse(self.layer.bytes(row.span));
        self.feed_for(&line, m.feed, row.state);
        let changes = [self.set(0, to[0]), self.set(1, to[1])];
        let led = Move { from: self.cursor.position, to: [to[0], to[1], m.to[2]], ..m };
        self.add(What::Move(led, Kind::Travel), row.state, |out| rewrite(&line, line.head, &changes, out));
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::annotate::Layers;
    use super::super::super::section::{Neighbours, beads};
    use super::*;
    use outrigger_gcode::dialect::Dialect;

    #[test]
    fn a_wipe_goes_back_and_forth_and_no_further_than_any_slicers() {
        let job = "M83\n;TYPE:Internal infill\nG1 X1 Y1 F600\nG1 X2 E1\n";
        let layer = Layers::new(job.as_bytes(), Dialect::Prusa).next_layer().unwrap().unwrap();
        let bead = beads(&layer, Neighbours::default())[0];
        let mut emitter = Emitter::new(&layer);
        emitter.copy_all(0..bead.first);
        emitter.fixed_bead(&bead);
        let check = |length_mm: f64, points: usize, end: Point| {
            let path = emitter.wipe_points(length_mm);
            assert_eq!((path.len(), path[path.len() - 1]), (points, end), "{length_mm}");
        };
        check(0.5, 2, [1.5, 1.0]);
        check(1.5, 3, [1.5, 1.0]);
        check(1e9, 101, [2.0, 1.0]);
    }
}
