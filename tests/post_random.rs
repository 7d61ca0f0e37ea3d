//! `post` on jobs made up at random: every habit that a slicer may have, in every mixture.
//!
//! The jobs are written by a small slicer of the test's own. What must hold is
//! judged by the oracle in `common`, which shares no code with the project: the
//! same segments with the same filament, the same other commands in the same
//! order, and nothing worse. The verifier must never have had to step in: what
//! it refuses would be a mistake of the pass.
mod common;

use common::{deposits, same_deposits};
use outrigger::post::{Options, post};
use proptest::prelude::*;
use std::fmt::Write;
use std::io::Cursor;

/// How the made-up slicer writes.
#[derive(Clone, Copy, Debug)]
struct Manner {
    cura: bool,
    relative: bool,
    firmware_retraction: bool,
    hop_mm: f64,
    wipe: bool,
    inward: bool,
    slope: bool,
    feed_in_line: bool,
    travel_acceleration: bool,
    bare_point: bool,
    crlf: bool,
    reset_e: bool,
    extra_mm: f64,
    arcs: bool,
    settings: bool,
    retract_across_layers: bool,
}

fn manner() -> impl Strategy<Value = Manner> {
    let flags = proptest::array::uniform14(any::<bool>());
    (flags, prop_oneof![Just(0.0), Just(0.3)], prop_oneof![3 => Just(0.0), 1 => Just(0.02), 1 => Just(-0.01)])
        .prop_map(|(f, hop_mm, extra_mm)| Manner {
            cura: f[0],
            relative: f[1],
            firmware_retraction: f[2],
            hop_mm,
            wipe: f[3],
            inward: f[4],
            slope: f[5],
            feed_in_line: f[6],
            travel_acceleration: f[7],
            bare_point: f[8],
            crlf: f[9],
            reset_e: f[10],
            extra_mm,
            arcs: f[11],
            settings: f[12],
            retract_across_layers: f[13],
        })
}

/// Numbers from a seed; the same on every machine.
struct Dice(u64);

impl Dice {
    fn roll(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    fn one_in(&mut self, n: u64) -> bool {
        self.roll().is_multiple_of(n)
    }

    /// A coordinate with three decimals.
    fn mm(&mut self, from: f64, to: f64) -> f64 {
        let steps = ((to - from) * 1000.0) as u64;
        from + (self.roll() % steps.max(1)) as f64 / 1000.0
    }
}

/// The made-up slicer.
struct Slicer {
    manner: Manner,
    dice: Dice,
    text: String,
    at: [f64; 2],
    z: f64,
    e: f64,
    feed: f64,
    retracted: bool,
    acceleration: u32,
    /// The bead printed last, for the wipe.
    last: Vec<[f64; 2]>,
}

impl Slicer {
    fn number(&self, value: f64, decimals: usize) -> String {
        let mut text = format!("{value:.decimals$}");
        if text.contains('.') {
            text = text.trim_end_matches('0').trim_end_matches('.').to_owned();
        }
        if self.manner.bare_point {
            text = text.replacen("0.", ".", usize::from(text.starts_with("0.") || text.starts_with("-0.")));
        }
        text
    }

    fn line(&mut self, text: &str) {
        self.text.push_str(text);
        self.text.push_str(if self.manner.crlf { "\r\n" } else { "\n" });
    }

    fn e_word(&mut self, push: f64) -> String {
        self.e += push;
        let value = if self.manner.relative { push } else { self.e };
        format!(" E{}", self.number(value, 5))
    }

    fn xy(&self, to: [f64; 2]) -> String {
        format!(" X{} Y{}", self.number(to[0], 3), self.number(to[1], 3))
    }

    fn feed(&mut self, feed: f64) -> String {
        if self.feed == feed {
            return String::new();
        }
        self.feed = feed;
        format!(" F{}", self.number(feed, 3))
    }

    fn accelerate(&mut self, to: u32) {
        if self.manner.travel_acceleration && self.acceleration != to {
            self.acceleration = to;
            self.line(&format!("M204 S{to}"));
        }
    }

    fn retract(&mut self) {
        if std::mem::replace(&mut self.retracted, true) {
            return;
        }
        if self.manner.firmware_retraction {
            return self.line("G10");
        }
        let mut left = 0.8;
        if self.manner.wipe && self.last.len() > 1 {
            self.line(";WIPE_START");
            let feed = self.feed(7200.0);
            if !feed.is_empty() {
                self.line(&format!("G1{feed}"));
            }
            let mut way = 2.0;
            for to in self.last.iter().rev().skip(1).take(2).copied().collect::<Vec<_>>() {
                let length = (self.at[0] - to[0]).hypot(self.at[1] - to[1]);
                let part = f64::min(way / length, 1.0);
                way -= length * part;
                let part_of = |k: usize| ((self.at[k] + part * (to[k] - self.at[k])) * 1e3).round() / 1e3;
                let to = [part_of(0), part_of(1)];
                let pulled = (0.3 * length * part * 1e5).round() / 1e5;
                let e = self.e_word(-pulled);
                left -= pulled;
                let xy = self.xy(to);
                if self.manner.arcs && self.dice.one_in(3) {
                    let half = |k: usize| (to[k] - self.at[k]) / 2.0;
                    let (i, j) = (self.number(half(0), 4), self.number(half(1), 4));
                    self.line(&format!("G2{xy} I{i} J{j}{e}"));
                } else {
                    self.line(&format!("G1{xy}{e}"));
                }
                self.at = to;
                if way < 0.01 {
                    break;
                }
            }
            self.line(";WIPE_END");
        }
        let (e, feed) = (self.e_word(-left), self.feed(2100.0));
        self.line(&format!("G1{e}{feed}"));
        if self.manner.reset_e {
            self.line("G92 E0");
            self.e = 0.0;
        }
    }

    fn unretract(&mut self) {
        if !std::mem::replace(&mut self.retracted, false) {
            return;
        }
        if self.manner.firmware_retraction {
            return self.line("G11");
        }
        let (e, feed) = (self.e_word(0.8 + self.manner.extra_mm), self.feed(2100.0));
        self.line(&format!("G1{e}{feed}"));
    }

    fn travel(&mut self, to: [f64; 2], wall: bool) {
        if self.at == to {
            return self.unretract();
        }
        let long = (self.at[0] - to[0]).hypot(self.at[1] - to[1]) > 1.5;
        self.accelerate(3000);
        if wall && self.manner.inward && long && !self.retracted {
            let inside = [self.at[0] - 0.2, self.at[1]];
            let (xy, feed) = (self.xy(inside), self.feed(9000.0));
            self.line(&format!("G1{xy}{feed}"));
            self.at = inside;
        }
        let retracts = long && !self.dice.one_in(6);
        if retracts {
            self.retract();
        }
        let hop = retracts && self.manner.hop_mm > 0.0;
        let (up, down) = (self.number(self.z + self.manner.hop_mm, 3), self.number(self.z, 3));
        let slope = hop && self.manner.slope;
        if hop && !slope {
            let feed = self.feed(720.0);
            self.line(&format!("G1 Z{up}{feed}"));
        }
        let (xy, feed) = (self.xy(to), self.feed(9000.0));
        let z = if slope { format!(" Z{up}") } else { String::new() };
        let text = if self.manner.cura { format!("G0{feed}{xy}{z}") } else { format!("G1{xy}{z}{feed}") };
        self.line(&text);
        if hop {
            let feed = self.feed(720.0);
            self.line(&format!("G1 Z{down}{feed}"));
        }
        self.unretract();
        self.at = to;
    }

    fn bead(&mut self, path: &[[f64; 2]], feed: f64, wall: bool) {
        self.travel(path[0], wall);
        self.accelerate(1000);
        for (k, &to) in path[1..].iter().enumerate() {
            if k == 0 && !self.manner.feed_in_line {
                let feed = self.feed(feed);
                if !feed.is_empty() {
                    self.line(&format!("G1{feed}"));
                }
            }
            let feed = self.feed(feed);
            let length = (to[0] - self.at[0]).hypot(to[1] - self.at[1]);
            let e = self.e_word((length * 3326.0).round() / 1e5 + 1e-5);
            let xy = self.xy(to);
            let arc = self.manner.arcs && self.dice.one_in(5) && length > 0.5;
            if arc {
                // A half circle: the centre is the middle of the chord.
                let half = |k: usize| (to[k] - self.at[k]) / 2.0;
                let (i, j) = (self.number(half(0), 4), self.number(half(1), 4));
                let head = if self.dice.one_in(2) { "G2" } else { "G3" };
                self.line(&format!("{head}{xy} I{i} J{j}{e}{feed}"));
            } else if self.manner.cura {
                self.line(&format!("G1{feed}{xy}{e}"));
            } else {
                self.line(&format!("G1{xy}{e}{feed}"));
            }
            self.at = to;
            if self.dice.one_in(30) {
                self.aside(true);
            }
        }
        self.last = path.to_vec();
    }

    /// Something between two moves.
    fn aside(&mut self, within_a_bead: bool) {
        let fan = self.dice.roll() % 255;
        match self.dice.roll() % if within_a_bead { 3 } else { 9 } {
            0 => self.line(&format!("M73 P{}", fan % 100)),
            1 if !self.manner.cura => {
                let width = 0.4 + (fan % 10) as f64 / 100.0;
                let width = self.number(width, 2);
                self.line(&format!(";WIDTH:{width}"));
            }
            2 => self.line(&format!("M106 S{fan}")),
            3 => self.line(&format!("M117 {fan}; of 255")),
            4 => self.line("; a note"),
            5 => self.line("SOME_MACRO A=1"),
            6 => self.line("M104 S210"),
            7 => self.line(""),
            8 if !self.manner.firmware_retraction && !self.retracted => {
                let (e, feed) = (self.e_word(0.01), self.feed(2100.0));
                self.line(&format!("G1{e}{feed}"));
            }
            _ => {}
        }
    }

    fn feature(&mut self, prusa: &str, cura: &str) {
        let name = if self.manner.cura { cura } else { prusa };
        self.line(&format!(";TYPE:{name}"));
    }

    fn square(&mut self, low: f64, high: f64) {
        let path = [[low, low], [high, low], [high, high], [low, high], [low, low]];
        self.bead(&path, 1500.0, true);
    }

    fn layer(&mut self, number: u32) {
        self.z = 0.2 * f64::from(number + 1);
        let z = self.number(self.z, 3);
        if self.manner.retract_across_layers && number > 0 {
            self.retract();
        }
        if self.manner.cura {
            self.line(&format!(";LAYER:{number}"));
            if number == 0 {
                self.line(";MESH:part.stl");
            }
        } else {
            self.line(&format!(";LAYER_CHANGE\n;Z:{z}\n;HEIGHT:0.2\nG92 E0").replace("\nG92 E0", ""));
            if !self.manner.relative && self.dice.one_in(2) {
                self.line("G92 E0");
                self.e = 0.0;
            }
        }
        let feed = self.feed(9000.0);
        self.line(&format!("G1 Z{z}{feed}"));
        self.feature("External perimeter", "WALL-OUTER");
        self.square(0.0, 40.0);
        self.feature("Perimeter", "WALL-INNER");
        self.square(15.0, 25.0);
        self.feature("Internal infill", "FILL");
        for _ in 0..self.dice.roll() % 14 {
            let count = 2 + self.dice.roll() % 3;
            let path: Vec<[f64; 2]> =
                (0..count).map(|_| [self.dice.mm(1.0, 39.0), self.dice.mm(1.0, 39.0)]).collect();
            self.bead(&path, 4800.0, false);
            if self.dice.one_in(20) {
                self.aside(false);
            }
        }
        self.feature("Solid infill", "SKIN");
        let offset = self.dice.mm(0.0, 3.0);
        for k in 0..12u32 {
            let y = 1.0 + f64::from(if self.dice.one_in(3) { 23 - k } else { k }) * 0.45;
            self.bead(&[[offset, y], [offset + 8.0, y]], 3000.0, false);
        }
        if !self.manner.cura && self.dice.one_in(2) {
            self.feature("Gap fill", "");
            for _ in 0..3 {
                let x = self.dice.mm(26.0, 38.0);
                self.bead(&[[x, 30.0], [x, 31.5]], 1200.0, false);
            }
        }
    }

    fn job(manner: Manner, seed: u64) -> Vec<u8> {
        let mut slicer = Slicer {
            manner,
            dice: Dice(seed | 1),
            text: String::new(),
            at: [0.0; 2],
            z: 0.0,
            e: 0.0,
            feed: 0.0,
            retracted: false,
            acceleration: 0,
            last: Vec::new(),
        };
        let signature = if manner.cura {
            ";Generated with Cura_SteamEngine 4.13.0"
        } else {
            "; generated by PrusaSlicer 2.5.0"
        };
        slicer.line(signature);
        slicer.line(if manner.relative { "M83" } else { "M82" });
        for setting in ["M204 S3000", "M204 S1000", "M106 S0", "M107", "G92 E0", "G1 X0 Y0 Z.2 F9000"] {
            slicer.line(setting);
        }
        slicer.acceleration = 1000;
        slicer.feed = 9000.0;
        for number in 0..4 {
            slicer.layer(number);
        }
        slicer.retract();
        slicer.line("M107");
        slicer.line("M104 S0");
        if manner.settings {
            slicer.line("; retract_before_travel = 1.5");
        }
        slicer.text.into_bytes()
    }
}

/// Lines that neither move nor go with a bead, in order.
fn others(job: &[u8]) -> Vec<String> {
    let text = String::from_utf8_lossy(job).into_owned();
    let goes_along =
        ["G0", "G1", "G2", "G3", "G10", "G11", "G92", "M106", "M107", "M204", ";WIDTH", ";TYPE", ";WIPE"];
    text.lines().filter(|line| !goes_along.iter().any(|g| line.starts_with(g))).map(str::to_owned).collect()
}

/// Filament in all, mm: what goes through the extruder, deposits and retractions.
fn filament_mm(job: &[u8]) -> f64 {
    deposits(job).iter().map(|d| d.2).sum()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]
    #[test]
    fn the_same_is_printed_and_nothing_is_worse(manner in manner(), seed: u64) {
        let job = Slicer::job(manner, seed);
        let mut out = Vec::new();
        let report = post(&mut Cursor::new(&job), &mut out, Options::default(), &|_| {}).unwrap();
        if let Some(reason) = &report.unchanged_reason {
            prop_assert_eq!(reason, "no order is better than the slicer's own");
            return Ok(());
        }
        same_deposits("the job", &job, &out);
        prop_assert!((filament_mm(&job) - filament_mm(&out)).abs() < 1e-3);
        prop_assert_eq!(others(&job), others(&out));
        prop_assert!(report.retractions_after <= report.retractions_before);
        prop_assert!(report.lifts_after <= report.lifts_before);
        prop_assert!(report.jumps_after <= report.jumps_before);
        prop_assert!(report.travel_mm_after <= report.travel_mm_before);
        // The estimate looks ahead across a section's ends, the choice does not.
        prop_assert!(report.time_s_after <= report.time_s_before * 1.0005 + 0.05);
    }
}

/// The jobs do give the pass something to do: most of them are changed.
#[test]
fn most_jobs_are_changed() {
    let mut changed = 0;
    let mut told = String::new();
    let plain = Manner {
        cura: false,
        relative: true,
        firmware_retraction: false,
        hop_mm: 0.3,
        wipe: true,
        inward: false,
        slope: false,
        feed_in_line: false,
        travel_acceleration: true,
        bare_point: true,
        crlf: false,
        reset_e: false,
        extra_mm: 0.0,
        arcs: false,
        settings: true,
        retract_across_layers: true,
    };
    for seed in 1..=20u64 {
        let job = Slicer::job(plain, seed.wrapping_mul(0x9e37_79b9_7f4a_7c15));
        let report = post(&mut Cursor::new(&job), &mut Vec::new(), Options::default(), &|_| {}).unwrap();
        changed += u32::from(report.unchanged_reason.is_none());
        let _ = writeln!(told, "{:?}", report.unchanged_reason);
    }
    assert!(changed >= 15, "{told}");
}
