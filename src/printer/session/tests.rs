//! Transcripts of the wire, one for each thing that real firmware does.
//!
//! A transcript is played against a session on a virtual clock. Its lines:
//! ```text
//! job 3          the job is G1 X1, G1 X2, G1 X3
//! job M109 S200  the job has this line next
//! < ok           the printer says this
//! > N4 G1 X1     the session has sent exactly this next (checksum left out)
//! >> M108        … without a number
//! > QUESTION     … the line with the number that must be refused
//! > M110         … the line that resets the numbers
//! > nothing      … nothing more
//! + 20           so many ms pass
//! ! Resend       an event whose debug text contains this came by now
//! ! nothing      no event came
//! cancel         the user cancels
//! stop           … wants an emergency stop
//! say M300       … says a command
//! answer 1       … answers a prompt
//! hold           no more is fed for now
//! own M17        this line of our own is run while held
//! release        the job goes on
//! lost           the port is gone
//! back           it is opened again
//! go 5           the job goes on after the printer's line 5
//! no go 5        … which cannot be
//! anew           the printer is to begin anew
//! ? Own { n: 5 } the session asks for this; `? nothing` for nothing
//! allow          what it asks for is allowed
//! reset true     the board was reset (or could not be)
//! flush true     whether the system's bytes are to be dropped
//! broken         the job cannot be read on
//! ```
use super::*;
use crate::printer::window::Limit;

mod asks;
mod ends;
mod person;
mod properties;
mod stop;
mod take_over;
mod wire;

/// A transcript's start: the printer is there and in step, the job is next.
const CONNECT: &str = "
    + 250
    > M110
    < ok
    > N1 M115
    < FIRMWARE_NAME:Test 1.0
    < Cap:AUTOREPORT_TEMP:1
    < Cap:EMERGENCY_PARSER:1
    < ok
    > N2 M155 S2
    < ok
    > N3 M105
    < ok T:20.0 /0.0 B:20.0 /0.0
    ! Connected
";

fn settings() -> Settings {
    Settings {
        boot_wait_ms: 250,
        cancel_macro: vec!["M104 S0".into(), "M107 ; fan".into()],
        ..Settings::default()
    }
}

struct Player {
    session: Session,
    now_ms: u64,
    job: VecDeque<String>,
    fed: u64,
    sent: VecDeque<String>,
    events: VecDeque<Event>,
}

impl Player {
    fn new(settings: Settings) -> Self {
        Self {
            session: Session::new(settings, 0),
            now_ms: 0,
            job: VecDeque::new(),
            fed: 0,
            sent: VecDeque::new(),
            events: VecDeque::new(),
        }
    }

    fn of(session: Session) -> Self {
        Self { session, ..Self::new(settings()) }
    }

    fn settle(&mut self) {
        while self.session.wants_line() {
            match self.job.pop_front() {
                Some(line) => {
                    self.fed += 1;
                    self.session.feed(line.as_bytes(), self.fed, self.now_ms);
                }
                None => self.session.finish_job(self.now_ms),
            }
        }
        let out = String::from_utf8(self.session.output().to_vec()).unwrap();
        self.session.written(out.len());
        self.sent.extend(out.lines().filter(|l| !l.is_empty()).map(str::to_owned));
        self.events.extend(std::iter::from_fn(|| self.session.poll_event()));
    }

    fn pass(&mut self, ms: u64) {
        let until = self.now_ms + ms;
        while let Some(due) = self.session.deadline().filter(|due| *due <= until) {
            // What became due by what was heard since the last tick is done at once.
            let at = due.max(self.now_ms);
            self.now_ms = at;
            self.session.on_tick(at);
            self.settle();
            assert!(self.session.deadline().is_none_or(|next| next > at), "the session spins at {at}");
        }
        self.now_ms = until;
    }

    fn play(&mut self, step: &str, whole: &str) {
        let (verb, rest) = step.split_once(' ').unwrap_or((step, ""));
        match (verb, rest.trim()) {
            ("job", what) => match what.parse::<u32>() {
                Ok(n) => self.job.extend((1..=n).map(|n| format!("G1 X{n}"))),
                Err(_) => self.job.push_back(what.to_owned()),
            },
            ("<", line) => {
                let line = format!("{line}\r\n");
                self.session.on_bytes(line.as_bytes(), self.now_ms);
            }
            ("+", ms) => self.pass(ms.parse().unwrap()),
            (">", "nothing") => assert_eq!(self.sent, [""; 0], "after {step:?} of {whole}"),
            (">>", line) => assert_eq!(self.sent.pop_front().as_deref(), Some(line), "in {whole}"),
            (">", line) => {
                let expect = match line {
                    "QUESTION" => "N2000000000 M105*21".to_owned(),
                    "M110" => "N0 M110 N0*125".to_owned(),
                    line => {
                        let sum = line.bytes().fold(0, |sum, byte| sum ^ byte);
                        format!("{line}*{sum}")
                    }
                };
                assert_eq!(self.sent.pop_front(), Some(expect), "in {whole}");
            }
            ("!", "nothing") => {
                self.events.retain(|e| !matches!(e, Event::Temperatures(_)));
                assert_eq!(self.events, [], "in {whole}");
            }
            ("!", text) => loop {
                let Some(event) = self.events.pop_front() else {
                    panic!("no event {text:?} in {whole}");
                };
                if format!("{event:?}").contains(text) {
                    break;
                }
            },
            ("cancel", _) => self.session.cancel(self.now_ms),
            ("lost", _) => self.session.link_lost("unplugged".into()),
            ("back", _) => self.session.link_back(self.now_ms),
            ("go", n) => assert!(self.session.go_on(n.parse().unwrap(), self.now_ms), "{step} in {whole}"),
            ("no", rest) => {
                let n = rest.strip_prefix("go ").unwrap().parse().unwrap();
                assert!(!self.session.go_on(n, self.now_ms), "{step} in {whole}");
            }
            ("anew", _) => self.session.begin_anew(self.now_ms),
            ("stop", _) => self.session.emergency_stop(self.now_ms),
            ("reset", done) => {
                assert!(self.session.wants_hard_stop(), "{step} in {whole}");
                self.session.hard_stopped(done == "true", self.now_ms);
            }
            ("flush", wanted) => assert_eq!(self.session.wants_flush(), wanted == "true", "in {whole}"),
            ("say", line) => assert!(self.session.command(line, self.now_ms), "{step} in {whole}"),
            ("answer", n) => assert!(self.session.answer(n.parse().unwrap(), self.now_ms), "{step}"),
            ("hold", _) => self.session.hold(self.now_ms),
            ("own", line) => self.session.run_own([line], self.now_ms),
            ("release", _) => self.session.release(self.now_ms),
            ("?", "nothing") => assert_eq!(self.session.asks(), None, "in {whole}"),
            ("?", ask) => {
                assert_eq!(self.session.asks().map(|a| format!("{a:?}")).as_deref(), Some(ask), "{whole}");
            }
            ("allow", _) => self.session.allow(self.now_ms),
            ("broken", _) => {
                self.session.source_failed(7, "cut".into(), self.now_ms);
            }
            other => panic!("what is {other:?}?"),
        }
        if !matches!(verb, "job" | "flush" | "?") {
            self.settle();
        }
    }
}

fn check_with(settings: Settings, transcript: &str) {
    play(Player::new(settings), transcript);
}

fn play(mut player: Player, transcript: &str) {
    for step in transcript.lines().map(str::trim).filter(|l| !l.is_empty()) {
        player.play(step, transcript);
    }
    // What is not written down did not happen.
    assert_eq!(player.sent, [""; 0], "sent beyond {transcript}");
}

/// Plays a job after the handshake.
fn check(job: &str, transcript: &str) {
    check_with(settings(), &format!("{job}\n{CONNECT}\n{transcript}"));
}
