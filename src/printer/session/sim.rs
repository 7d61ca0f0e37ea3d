//! A strict firmware on a virtual clock, and noise on the wire, for the session's
//! tests alone. It shares no code with the sender: own line check, own checksum.
//!
//! Modelled on what Marlin 2.1.2.1 does: lines are checked when they move from
//! the receive buffer to the command queue; a refused line empties the receive
//! buffer; the `ok` of the refusal comes before those of the queue.
use super::*;
use crate::printer::window::Limit;
use proptest::prelude::*;
use std::collections::VecDeque;

mod breaks;

/// How this firmware differs from others.
#[derive(Debug, Clone, Copy)]
struct Habits {
    advanced_ok: bool,
    resend_ok: bool,
    m105_brings_temperatures: bool,
    rx_bytes: usize,
    exec_ms: u64,
}

const MARLIN: Habits =
    Habits { advanced_ok: false, resend_ok: true, m105_brings_temperatures: true, rx_bytes: 128, exec_ms: 1 };

#[derive(Debug)]
struct Firmware {
    habits: Habits,
    /// Each byte with the count of the line that it was sent in.
    rx: VecDeque<(u8, u64)>,
    received: u64,
    overflow: usize,
    line: Vec<u8>,
    /// Whether the line holds bytes of two.
    spliced: bool,
    line_of: Option<u64>,
    queue: VecDeque<(Option<u32>, String)>,
    last: u32,
    free_ms: u64,
    accepted: Vec<String>,
    replies: Vec<String>,
}

impl Firmware {
    fn new(habits: Habits) -> Self {
        Self {
            habits,
            rx: VecDeque::new(),
            received: 0,
            overflow: 0,
            line: Vec::new(),
            spliced: false,
            line_of: None,
            queue: VecDeque::new(),
            last: 0,
            free_ms: 0,
            accepted: Vec::new(),
            replies: vec!["start".into()],
        }
    }

    /// The board starts anew: what it had and knew is gone.
    fn reset(&mut self) {
        let accepted = std::mem::take(&mut self.accepted);
        *self = Self { accepted, overflow: self.overflow, ..Self::new(self.habits) };
    }

    /// Takes the bytes of one line.
    fn receive(&mut self, bytes: &[u8]) {
        self.received += 1;
        for byte in bytes {
            if self.rx.len() < self.habits.rx_bytes {
                self.rx.push_back((*byte, self.received));
            } else {
                self.overflow += 1;
            }
        }
    }

    fn step(&mut self, now_ms: u64) -> Vec<String> {
        while self.queue.len() < 4
            && let Some((byte, of)) = self.rx.pop_front()
        {
            if byte != b'\n' {
                self.spliced |= self.line_of.is_some_and(|line| line != of);
                self.line_of = Some(of);
                self.line.push(byte);
                continue;
            }
            self.line_of = None;
            let line = std::mem::take(&mut self.line);
            if !line.is_empty() {
                self.take(&line);
            }
        }
        while now_ms >= self.free_ms
            && let Some((n, command)) = self.queue.pop_front()
        {
            self.free_ms = now_ms + self.habits.exec_ms;
            self.run(n, &command);
            if self.habits.exec_ms > 0 {
                break;
            }
        }
        std::mem::take(&mut self.replies)
    }

    /// Checks one line as `GCodeQueue::get_serial_commands` does.
    fn take(&mut self, line: &[u8]) {
        let spliced = std::mem::take(&mut self.spliced);
        let Some(rest) = line.strip_prefix(b"N") else {
            let text = String::from_utf8_lossy(line).into_owned();
            self.queue.push_back((None, text));
            return;
        };
        let digits = rest.iter().take_while(|b| b.is_ascii_digit()).count();
        let n: u32 = String::from_utf8_lossy(&rest[..digits]).parse().unwrap_or(0);
        let star = line.iter().rposition(|b| *b == b'*');
        let command = &rest[digits..star.map_or(rest.len(), |s| s - 1).max(digits)];
        let command = String::from_utf8_lossy(command).trim().to_owned();
        let m110 = command.strip_prefix("M110 N").and_then(|n| n.parse::<u32>().ok());
        if n != self.last + 1 && m110.is_none() {
            // A repeat of the last two lines is dropped without a word.
            if n == self.last || n + 1 == self.last {
                return;
            }
            return self.refuse("Line Number is not Last Line Number+1");
        }
        let Some(star) = star else {
            return self.refuse("No Checksum with line number");
        };
        let sum = line[..star].iter().fold(0_u8, |s, b| s ^ b);
        let digits: String =
            line[star + 1..].iter().map(|b| char::from(*b)).take_while(char::is_ascii_digit).collect();
        // Two lines that a lost line feed or an overflow has made one pass the
        // check of real firmware once in 256 times, whatever the sender does. Not
        // here: the subject is the sender.
        if digits.parse() != Ok(sum) || spliced {
            return self.refuse("checksum mismatch");
        }
        self.last = m110.unwrap_or(n);
        self.queue.push_back((Some(n), command));
    }

    fn refuse(&mut self, why: &str) {
        self.rx.clear();
        let last = self.last;
        self.replies.push(format!("Error:{why}, Last Line: {last}"));
        self.replies.push(format!("Resend: {}", last + 1));
        if self.habits.resend_ok {
            self.replies.push("ok".into());
        }
    }

    fn run(&mut self, n: Option<u32>, command: &str) {
        let known = n.is_some() || command.starts_with(['G', 'M']);
        if command == "M105" && self.habits.m105_brings_temperatures {
            self.replies.push("ok T:20.0 /0.0 B:20.0 /0.0 @:0 B@:0".into());
            return;
        }
        if !known {
            self.replies.push(format!("echo:Unknown command: \"{command}\""));
        } else if n.is_some() {
            self.accepted.push(command.to_owned());
        }
        if command == "M115" {
            self.replies.push("FIRMWARE_NAME:Sim".into());
            self.replies.push("Cap:AUTOREPORT_TEMP:1".into());
        }
        let free = 4 - self.queue.len();
        self.replies.push(match n {
            Some(n) if self.habits.advanced_ok => format!("ok N{n} P15 B{free}"),
            _ => "ok".into(),
        });
    }
}

/// Chances in a thousand, a line.
#[derive(Debug, Clone, Copy)]
struct Noise {
    damage_out: u64,
    damage_in: u64,
    lose_in: u64,
}

const QUIET: Noise = Noise { damage_out: 0, damage_in: 0, lose_in: 0 };

/// A small generator, so that a run depends on its seed alone.
struct Dice {
    state: u64,
    /// Hits in a row, out and in.
    hits: [u32; 2],
}

impl Dice {
    /// Whether this line is hit. Noise never lasts longer than the retries do:
    /// five losses in a row rightly end a job.
    fn hits(&mut self, way: usize, of_thousand: u64) -> bool {
        let hit = self.roll(1000) < of_thousand && self.hits[way] < 3;
        self.hits[way] = if hit { self.hits[way] + 1 } else { 0 };
        hit
    }

    fn roll(&mut self, below: u64) -> u64 {
        self.state =
            self.state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.state >> 33) % below
    }

    /// One byte of the line becomes another, vanishes or is doubled.
    fn damage(&mut self, line: &mut Vec<u8>) {
        let at = self.roll(line.len() as u64) as usize;
        match self.roll(4) {
            0 => {
                line.remove(at);
            }
            1 => line.insert(at, b'!' + self.roll(90) as u8),
            _ => line[at] ^= 1 << self.roll(7),
        }
    }
}

struct Run {
    outcome: Option<Outcome>,
    accepted: Vec<String>,
    overflow: usize,
    took_ms: u64,
    events: Vec<Event>,
}

/// One print: who takes part and what happens.
#[derive(Debug, Clone, Copy)]
struct Trial {
    habits: Habits,
    limit: Limit,
    noise: Noise,
    seed: u64,
    lines: u64,
    /// The user cancels when so many lines were fed.
    cancel_at: Option<u64>,
}

/// Session, firmware and the wire between them.
struct Wire {
    session: Session,
    firmware: Firmware,
    dice: Dice,
    noise: Noise,
    now_ms: u64,
}

impl Wire {
    /// What the session has to say goes to the firmware, line by line.
    fn carry_out(&mut self) {
        let out = self.session.output().to_vec();
        self.session.written(out.len());
        for line in out.split_inclusive(|b| *b == b'\n') {
            let mut line = line.to_vec();
            if self.dice.hits(0, self.noise.damage_out) {
                self.dice.damage(&mut line);
            }
            self.firmware.receive(&line);
        }
    }

    /// What the firmware answers goes back, in two pieces a line.
    fn carry_back(&mut self) {
        let (lose, damage) = (self.noise.lose_in, self.noise.damage_in);
        for reply in self.firmware.step(self.now_ms) {
            let mut line = format!("{reply}\n").into_bytes();
            if self.dice.hits(1, lose + damage) {
                if self.dice.roll(lose + damage) < lose {
                    continue;
                }
                self.dice.damage(&mut line);
            }
            let cut = self.dice.roll(line.len() as u64 + 1) as usize;
            self.session.on_bytes(&line[..cut], self.now_ms);
            self.session.on_bytes(&line[cut..], self.now_ms);
        }
    }
}

/// Prints as the trial says, at most for a day.
fn print(trial: Trial) -> Run {
    let settings = Settings {
        window: trial.limit,
        boot_wait_ms: 10,
        cancel_macro: SAFE.map(String::from).to_vec(),
        ..Settings::default()
    };
    let mut wire = Wire {
        session: Session::new(settings, 0),
        firmware: Firmware::new(trial.habits),
        dice: Dice { state: trial.seed, hits: [0; 2] },
        noise: trial.noise,
        now_ms: 0,
    };
    let (mut fed, mut events, mut outcome) = (0, Vec::new(), None);
    while outcome.is_none() && wire.now_ms < 24 * 3_600_000 {
        wire.now_ms += 1;
        wire.carry_out();
        wire.carry_back();
        let (session, now_ms) = (&mut wire.session, wire.now_ms);
        while session.wants_line() {
            if fed == trial.lines {
                session.finish_job(now_ms);
                break;
            }
            fed += 1;
            session.feed(command(fed).as_bytes(), fed, now_ms);
            if trial.cancel_at == Some(fed) {
                session.cancel(now_ms);
            }
        }
        if session.deadline().is_some_and(|at| at <= now_ms) {
            session.on_tick(now_ms);
        }
        while let Some(event) = session.poll_event() {
            if let Event::Ended(how) = &event {
                outcome = Some(how.clone());
            }
            events.push(event);
        }
    }
    Run {
        outcome,
        accepted: wire.firmware.accepted,
        overflow: wire.firmware.overflow,
        took_ms: wire.now_ms,
        events,
    }
}

/// What the safe sequence sends.
const SAFE: [&str; 2] = ["M104 S0", "M107"];

fn command(n: u64) -> String {
    format!("G1 X{n} Y{}", n * 7 % 100)
}

fn moves(run: &Run) -> Vec<&String> {
    let is_move = |c: &&String| c.starts_with("G1 ");
    run.accepted.iter().filter(is_move).collect()
}

/// Whether the accepted moves are the first of the job, each once, in order.
fn first_of_job(run: &Run) -> Result<usize, String> {
    let moves = moves(run);
    for (at, got) in moves.iter().enumerate() {
        let expect = command(at as u64 + 1);
        if **got != expect {
            return Err(format!("{got} where {expect} belongs"));
        }
    }
    Ok(moves.len())
}

#[test]
fn a_quiet_wire_needs_no_resend() {
    for habits in [
        MARLIN,
        Habits { advanced_ok: true, ..MARLIN },
        Habits { m105_brings_temperatures: false, ..MARLIN },
        Habits { exec_ms: 30, ..MARLIN },
    ] {
        for limit in [Limit::Bytes(120), Limit::Lines(1)] {
            let run = print(Trial { habits, limit, ..TRIAL });
            assert_eq!(run.outcome, Some(Outcome::Finished));
            assert_eq!(first_of_job(&run), Ok(300));
            assert_eq!(run.overflow, 0, "{habits:?}");
            let upset = |e: &&Event| matches!(e, Event::Resend { .. } | Event::Probed { .. });
            assert_eq!(run.events.iter().filter(upset).count(), 0);
        }
    }
}

#[test]
fn a_lost_ok_costs_seconds_not_the_job() {
    let noise = Noise { lose_in: 20, ..QUIET };
    for m105_brings_temperatures in [true, false] {
        let habits = Habits { m105_brings_temperatures, ..MARLIN };
        let run = print(Trial { habits, limit: Limit::Lines(1), noise, ..TRIAL });
        assert_eq!(run.outcome, Some(Outcome::Finished));
        assert_eq!(first_of_job(&run), Ok(300));
        assert!(run.took_ms > 3_000, "some ok was lost");
    }
}

const TRIAL: Trial =
    Trial { habits: MARLIN, limit: Limit::Bytes(120), noise: QUIET, seed: 7, lines: 300, cancel_at: None };

/// Any firmware, any window, noise that retries can survive.
fn trials() -> impl Strategy<Value = Trial> {
    let habits = (
        any::<bool>(),
        any::<bool>(),
        0_u64..12,
        // A buffer smaller than the window loses bytes all the time.
        prop::sample::select(vec![64_usize, 128, 1024]),
    );
    let noise = (0_u64..60, 0_u64..30, 0_u64..30);
    (habits, noise, any::<u64>(), any::<bool>()).prop_map(|(habits, noise, seed, one_line)| {
        let (advanced_ok, resend_ok, exec_ms, rx_bytes) = habits;
        let (damage_out, damage_in, lose_in) = noise;
        Trial {
            habits: Habits { advanced_ok, resend_ok, exec_ms, rx_bytes, ..MARLIN },
            noise: Noise { damage_out, damage_in, lose_in },
            limit: if one_line { Limit::Lines(1) } else { Limit::Bytes(120) },
            seed,
            ..TRIAL
        }
    })
}

/// Few enough for every day; `PROPTEST_CASES` asks for more.
fn cases() -> ProptestConfig {
    let default = ProptestConfig::default();
    match std::env::var_os("PROPTEST_CASES") {
        Some(_) => default,
        None => ProptestConfig { cases: 64, ..default },
    }
}

proptest! {
    #![proptest_config(cases())]

    /// The sentence that matters: whatever the wire does, every line is accepted
    /// exactly once and in order.
    #[test]
    fn every_line_arrives_once_and_in_order(trial in trials()) {
        let run = print(trial);
        let last: Vec<_> = run.events.iter().rev().take(30).collect();
        prop_assert_eq!(&run.outcome, &Some(Outcome::Finished), "{:?}", last);
        prop_assert_eq!(first_of_job(&run), Ok(300));
    }

    /// After a cancel nothing of the job follows, and "the heaters are off" is
    /// never said of a printer that was not told so.
    #[test]
    fn a_cancelled_job_ends_safely(trial in trials(), cancel_at in 1_u64..300) {
        let run = print(Trial { cancel_at: Some(cancel_at), ..trial });
        let Some(Outcome::Stopped { ending, safety }) = &run.outcome else {
            return Err(TestCaseError::fail(format!("{:?}", run.outcome)));
        };
        prop_assert_eq!(ending, &Ending::Cancelled);
        prop_assert_eq!(*safety, Safety::Acknowledged);
        prop_assert!(first_of_job(&run).is_ok_and(|n| n as u64 <= cancel_at));
        let last_move = run.accepted.iter().rposition(|c| c.starts_with("G1 "));
        let off = run.accepted.iter().rposition(|c| c == SAFE[0]);
        prop_assert!(off.is_some() && off > last_move);
        prop_assert!(run.accepted.iter().any(|c| c == SAFE[1]));
    }
}
