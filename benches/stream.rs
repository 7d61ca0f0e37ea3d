//! What a session costs a line, without port and clock.
//!
//! `cargo bench --bench stream`
//!
//! A job of short moves goes through a [`Session`] to a printer in memory that answers
//! each exchange at once: all that is in the window at a time, or (as where the
//! printer is the slow part) one line at a time. After criterion's own figures it prints
//! ratios to a peer timed in the same run that does the least: numbers, checksums, a
//! byte window, a count of `ok`s; the same as `benches/peer_sender.c`.
#[path = "../gcode/benches/common/mod.rs"]
mod common;

use common::ratio::Ratios;
use common::run::run;
use criterion::{Criterion, Throughput};
use outrigger::printer::session::{DEFAULT_WINDOW_BYTES, Event, Outcome, Session, Settings};
use outrigger_gcode::checksum::frame;
use outrigger_gcode::line::split_lines;
use std::collections::VecDeque;
use std::fmt::Write;
use std::hint::black_box;

/// Lines of the job.
const LINES: u32 = 100_000;

/// Most that a session may cost a line, ns: a twentieth of what 1.2 s for 100,000 lines
/// leave, since most of it goes to the system for moving the bytes.
const TARGET_NS: f64 = 600.0;

fn job() -> Vec<u8> {
    let mut text = String::new();
    for n in 0..LINES {
        let (x_mm, y_mm) = (f64::from(n % 900) * 0.2, 50.0 + f64::from(n) * 0.0001);
        writeln!(text, "G1 X{x_mm:.3} Y{y_mm:.4}").expect("a string takes all");
    }
    text.into_bytes()
}

/// How much a printer answers at a time.
#[derive(Clone, Copy)]
enum Answers {
    All,
    OneByOne,
}

/// A printer that takes every line.
#[derive(Default)]
struct Printer {
    /// Answers to lines that came and were not answered yet.
    due: VecDeque<&'static [u8]>,
}

impl Printer {
    fn receive(&mut self, bytes: &[u8]) {
        for line in split_lines(bytes).filter(|line| line.starts_with(b"N")) {
            // Only a host's own questions have an M.
            let asks = |code: &[u8]| line.windows(code.len()).any(|part| part == code);
            self.due.push_back(match memchr::memchr(b'M', line) {
                Some(_) if asks(b"M105") => b"ok T:20.0 /0.0 B:20.0 /0.0 @:0 B@:0\n",
                Some(_) if asks(b"M115") => b"Cap:AUTOREPORT_TEMP:1\nok\n",
                _ => b"ok\n",
            });
        }
    }

    fn answer(&mut self, how: Answers, to: &mut Vec<u8>) {
        to.clear();
        let count = match how {
            Answers::All => self.due.len(),
            Answers::OneByOne => self.due.len().min(1),
        };
        self.due.drain(..count).for_each(|ok| to.extend_from_slice(ok));
    }
}

/// The job through a session; how many bytes went out.
fn session(job: &[u8], how: Answers) -> usize {
    let mut session = Session::new(Settings { boot_wait_ms: 0, ..Settings::default() }, 0);
    let (mut printer, mut input) = (Printer::default(), Vec::new());
    let mut lines = split_lines(job).zip(1..);
    let (mut now_ms, mut sent) = (0, 0);
    loop {
        while session.wants_line() {
            match lines.next() {
                Some((line, number)) => session.feed(line.trim_ascii_end(), number, now_ms),
                None => session.finish_job(now_ms),
            }
        }
        while let Some(event) = session.poll_event() {
            if let Event::Ended(outcome) = event {
                assert_eq!(outcome, Outcome::Finished);
                return sent;
            }
        }
        printer.receive(session.output());
        sent += session.output().len();
        session.written(session.output().len());
        printer.answer(how, &mut input);
        if input.is_empty() {
            // Only the start waits for time.
            now_ms += 1;
            session.on_tick(now_ms);
        } else {
            session.on_bytes(&input, now_ms);
        }
    }
}

/// The job by a sender that does the least; how many bytes went out.
fn least(job: &[u8], how: Answers) -> usize {
    let (mut printer, mut input, mut out) = (Printer::default(), Vec::new(), Vec::new());
    let mut flying = VecDeque::new();
    let (mut flying_bytes, mut sent, mut framed) = (0, 0, Vec::new());
    let mut lines = split_lines(job).zip(1..);
    let mut next = lines.next();
    while next.is_some() || !flying.is_empty() {
        out.clear();
        while let Some((line, number)) = next {
            framed.clear();
            frame(number, line.trim_ascii_end(), &mut framed);
            if !flying.is_empty() && flying_bytes + framed.len() > DEFAULT_WINDOW_BYTES {
                break;
            }
            out.extend_from_slice(&framed);
            flying.push_back(framed.len());
            flying_bytes += framed.len();
            next = lines.next();
        }
        sent += out.len();
        printer.receive(&out);
        printer.answer(how, &mut input);
        for line in split_lines(&input).filter(|line| line.starts_with(b"ok")) {
            black_box(line);
            flying_bytes -= flying.pop_front().unwrap_or(0);
        }
    }
    sent
}

const WAYS: [(&str, Answers); 2] = [("window by window", Answers::All), ("ok by ok", Answers::OneByOne)];

fn benches(c: &mut Criterion) {
    let job = job();
    let mut group = c.benchmark_group("session");
    group.throughput(Throughput::Elements(LINES.into()));
    for (name, how) in WAYS {
        group.bench_function(name, |b| b.iter(|| session(black_box(&job), how)));
    }
    group.finish();
}

fn ratios(ratios: &Ratios) {
    let job = job();
    eprintln!("\n{LINES} lines, session against a sender that does the least, the printer's part in both:");
    for (name, how) in WAYS {
        let timed =
            ratios.compare(job.len(), (name, || session(&job, how)), ("the least", || least(&job, how)));
        let ns = timed.seconds * 1e9 / f64::from(LINES);
        let verdict = if ns <= TARGET_NS { "met" } else { "MISSED" };
        eprintln!("{name:<34} {ns:>9.1} ns a line   target {TARGET_NS:>24.1} ns a line   {verdict}");
    }
}

fn main() {
    run(benches, ratios);
}
