//! Transcripts of the wire, one for each thing that real firmware does.
//!
//! A transcript is played against a session on a virtual clock. Its lines:
//! ```text
//! job 3          the job is G1 X1, G1 X2, G1 X3
//! job M109 S200  the job has this line next
//! < ok           the printer says this
//! > N4 G1 X1     the session has sent exactly this next (checksum left out)
//! > M110         … the line that resets the numbers
//! > nothing      … nothing more
//! + 20           so many ms pass
//! ! Resend       an event whose debug text contains this came by now
//! ! nothing      no event came
//! cancel         the user cancels
//! lost           the port is gone
//! ```
use super::*;
use crate::printer::reply::{Reply, parse};
use crate::printer::window::Limit;
use proptest::prelude::*;

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

/// After the last job line at number `n` of this text.
const FINISH: &str = "
    < ok
    > N{n} M400
    < ok
    > N{m} M105
    ! nothing
    < ok T:20.0 /0.0
    ! Ended(Finished)
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
        while let Some(at) = self.session.deadline().filter(|at| *at <= until) {
            assert!(self.now_ms <= at, "a deadline that has passed stays due");
            self.now_ms = at;
            self.session.on_tick(at);
            self.settle();
            assert!(self.session.deadline() != Some(at), "the session spins at {at}");
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
            (">", line) => {
                let expect = match line {
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
            ("lost", _) => self.session.port_lost("unplugged".into()),
            other => panic!("what is {other:?}?"),
        }
        if verb != "job" {
            self.settle();
        }
    }
}

fn check_with(settings: Settings, transcript: &str) {
    let mut player = Player::new(settings);
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

fn finish(last: u32) -> String {
    FINISH.replace("{n}", &(last + 1).to_string()).replace("{m}", &(last + 2).to_string())
}

#[test]
fn prints_and_proves_the_end() {
    check(
        "job 2",
        &format!(
            "> N4 G1 X1
             > N5 G1 X2
             > N6 M400
             < ok
             > nothing
             < ok
             > nothing
             < ok
             > N7 M105
             < ok T:20.0 /0.0
             ! Ended(Finished)"
        ),
    );
}

#[test]
fn the_window_counts_bytes() {
    // `N4 G1 X1*44` and its line feed are 12 bytes: ten of 12 or 13 are beyond 120.
    let sent: String = (1..=9).map(|n| format!("> N{} G1 X{n}\n", n + 3)).collect();
    check("job 20", &format!("{sent} > nothing\n < ok\n > N13 G1 X10\n > nothing"));
}

/// Wire fact 1: the `ok` of a resend comes before those of the queue, and what
/// followed the damaged line is gone.
#[test]
fn a_damaged_line_in_a_burst() {
    let burst = "> N4 G1 X1\n> N5 G1 X2\n> N6 G1 X3\n> N7 G1 X4\n> N8 M400\n";
    for (name, answers) in
        [("plain", "< ok\n< ok\n< ok"), ("advanced", "< ok\n< ok N4 P15 B3\n< ok N5 P15 B3")]
    {
        check(
            "job 4",
            &format!(
                "{burst}
                 < Error:checksum mismatch, Last Line: 5
                 < Resend: 6
                 {answers}
                 > nothing
                 ! Resend {{ n: 6 }}
                 + 19
                 > nothing
                 + 1
                 > N6 G1 X3
                 > N7 G1 X4
                 > N8 M400
                 < ok
                 < ok
                 < ok
                 > N9 M105
                 < ok T:1 /0
                 ! Ended(Finished)"
            ),
        );
        assert!(!name.is_empty());
    }
}

#[test]
fn a_resend_without_its_ok() {
    check(
        "job 2",
        &format!(
            "> N4 G1 X1
             > N5 G1 X2
             > N6 M400
             < ok
             < rs 5
             + 20
             > N5 G1 X2
             > N6 M400
             < ok
             < ok
             > N7 M105
             < ok T:1 /0
             ! Ended(Finished)"
        ),
    );
}

/// Dialects: an error without a resend request (and without an `ok`) is one too.
#[test]
fn an_error_alone_asks_for_lines() {
    check(
        "job 1",
        &format!(
            "> N4 G1 X1
             > N5 M400
             < Error:No Line Number with checksum, Last Line: 3
             + 20
             > N4 G1 X1
             > N5 M400
             < ok
             < ok
             > N6 M105
             < ok T:1 /0
             ! Ended(Finished)"
        ),
    );
}

/// Wire fact 2: after a lost `ok` the line is never sent again; a new line tells.
#[test]
fn a_lost_ok_is_found_by_a_probe() {
    let one_line = Settings { window: Limit::Lines(1), ..settings() };
    let play = |rest: &str| {
        check_with(one_line.clone(), &format!("job 2\n{CONNECT}\n{rest}"));
    };
    play(
        "> N4 G1 X1
         + 2999
         > nothing
         + 1
         > N5 M105
         ! Probed
         < ok T:20.0 /0.0
         > N6 G1 X2",
    );
    // The printer's own reports go on and are no sign of progress.
    play(
        "> N4 G1 X1
         + 2000
         < T:20.0 /0.0 B:20.0 /0.0
         + 1000
         > N5 M105",
    );
    // It was the line that was lost: the probe makes the printer ask for it.
    play(
        "> N4 G1 X1
         + 3000
         > N5 M105
         < Error:Line Number is not Last Line Number+1, Last Line: 3
         < Resend: 4
         < ok
         + 20
         > N4 G1 X1
         < ok
         > N5 M105
         < ok T:20.0 /0.0
         > N6 G1 X2",
    );
    // Repetier says that it waits: no need to let 3 s pass.
    play(
        "> N4 G1 X1
         + 500
         < wait
         > N5 M105
         < wait
         > nothing
         < ok T:20.0 /0.0
         > N6 G1 X2",
    );
}

/// Wire fact 3: an acknowledged line may be asked for again.
#[test]
fn an_ok_does_not_prove_acceptance() {
    check(
        "job 2",
        &format!(
            "> N4 G1 X1
             > N5 G1 X2
             > N6 M400
             < echo:Unknown command: \"X4 G1 X1\"
             < ok
             ! UnknownCommand
             < Error:Line Number is not Last Line Number+1, Last Line: 3
             < Resend: 4
             < ok
             + 20
             > N4 G1 X1
             > N5 G1 X2
             > N6 M400
             < ok
             < ok
             < ok
             > N7 M105
             < ok T:1 /0
             ! Ended(Finished)"
        ),
    );
}

/// Wire fact 4 and 5: M105's `ok` has no number; with it all before is done.
#[test]
fn numbers_and_temperatures_acknowledge_what_came_before() {
    check(
        "job 2",
        &format!(
            "> N4 G1 X1
             > N5 G1 X2
             > N6 M400
             < ok N6 P15 B3
             > N7 M105
             < ok N5 P15 B3
             ! nothing
             < ok T:1 /0
             ! Ended(Finished)"
        ),
    );
}

/// Wire fact 6: what comes at boot; `start` shortens the wait.
#[test]
fn a_boot_is_waited_for() {
    let slow = Settings { boot_wait_ms: 2500, ..settings() };
    let transcript = "
        + 1000
        < start
        < PowerUp
        < Marlin 2.1.2.1
        + 200
        < echo:SD card ok
        > nothing
        + 250
        > M110";
    check_with(slow.clone(), transcript);
    check_with(slow, "+ 2499\n > nothing\n + 1\n > M110");
}

#[test]
fn a_late_boot_starts_over() {
    check_with(settings(), &format!("+ 250\n > M110\n < start\n > nothing\n {CONNECT} > N4 M400"));
    check_with(settings(), &format!("+ 250\n > M110\n < ok\n > N1 M115\n < start\n {CONNECT} > N4 M400"));
}

#[test]
fn silence_is_no_printer() {
    let tries = "> M110\n + 2000\n".repeat(10);
    check_with(
        settings(),
        &format!("+ 250\n {tries} ! NoAnswer {{ bytes: 0, lines: 0 }}), safety: Untouched"),
    );
}

/// Wire fact 7: M999 asks for the next line; nothing is missing.
#[test]
fn a_request_for_the_next_line_resends_nothing() {
    check(
        "job M999",
        &format!(
            "> N4 M999
             > N5 M400
             < Resend: 6
             < ok
             < ok
             < ok
             > nothing
             + 20
             > N6 M105
             < ok T:1 /0
             ! Ended(Finished)"
        ),
    );
}

#[test]
fn a_reset_in_mid_job_ends_it() {
    check(
        "job 2",
        "> N4 G1 X1
         > N5 G1 X2
         > N6 M400
         < ok
         < start
         ! Failed(Reset { job_line: 1 }), safety: ByFirmware
         + 100000
         > nothing",
    );
}

#[test]
fn fatal_errors_end_the_job() {
    let job = "> N4 G1 X1\n> N5 M400\n";
    check(
        "job 1",
        &format!(
            "{job}
             < Error:Thermal Runaway, system stopped! Heater_ID: 0
             ! Fatal
             > nothing"
        ),
    );
    // Klipper refuses a command so, and leaves the heaters on.
    check(
        "job 1",
        &format!(
            "{job}
             < !! Move out of range
             ! Stopping
             > M110
             < ok
             > N1 M104 S0
             > N2 M107
             < ok
             < ok
             > N3 M105
             < ok T:20.0 /0.0
             ! safety: Acknowledged"
        ),
    );
}

#[test]
fn busy_notes_extend_the_wait() {
    check(
        "job G28",
        "> N4 G28
         > N5 M400
         + 2000
         < echo:busy: processing
         + 2000
         < echo:busy: processing
         + 5999
         > nothing
         + 1
         > N6 M105",
    );
}

#[test]
fn a_long_command_is_probed_once_and_then_has_its_time() {
    check(
        "job M190 S60",
        "> N4 M190 S60
         > N5 M400
         + 3000
         > N6 M105
         + 590000
         > nothing
         < ok
         < ok
         < ok T:60.0 /60.0
         > nothing
         ! Ended(Finished)",
    );
}

#[test]
fn five_timeouts_end_the_job() {
    check(
        "job 1",
        "> N4 G1 X1
         > N5 M400
         < ok
         < ok
         > N6 M105
         + 3000
         > N7 M105
         + 6000
         > N8 M105
         + 12000
         > N9 M105
         + 24000
         > N10 M105
         + 47999
         > nothing
         + 1
         ! Stopping(Failed(Timeouts { job_line: 1, timeouts: 5 }))
         > M110
         + 2000
         > M110
         < ok
         + 20
         > N1 M104 S0
         > N2 M107
         < ok
         < ok
         > N3 M105
         < ok T:20.0 /0.0
         ! safety: Acknowledged",
    );
}

#[test]
fn ten_resends_of_one_line_end_the_job() {
    let again = "
        < Error:checksum mismatch, Last Line: 3
        < Resend: 4
        < ok
        + 20
        > N4 G1 X1
        > N5 M400"
        .repeat(10);
    check(
        "job 1",
        &format!(
            "> N4 G1 X1
             > N5 M400
             {again}
             < Resend: 4
             ! Failed(Resends {{ n: 4, text: \"N4 G1 X1*101\", resends: 10 }})
             > M110"
        ),
    );
}

#[test]
fn a_request_beyond_the_history_must_be_repeated_to_count() {
    let open = "> N4 G1 X1\n> N5 M400\n";
    // Garbled: the probe brings the true one.
    check(
        "job 1",
        &format!(
            "{open}
             < Resend: 41
             < ok
             + 20
             > N6 M105
             < Error:Line Number is not Last Line Number+1, Last Line: 3
             < Resend: 4
             + 20
             > N4 G1 X1
             > N5 M400
             > N6 M105"
        ),
    );
    check(
        "job 1",
        &format!(
            "{open}
             < Resend: 41
             + 20
             > N6 M105
             < Resend: 41
             + 20
             > N7 M105
             < Resend: 41
             ! Failed(OddRequest {{ n: 41, first: 1, last: 7 }})
             > M110"
        ),
    );
}

#[test]
fn a_cancel_waits_for_the_printer_and_makes_it_safe() {
    check(
        "job 30",
        "> N4 G1 X1\n> N5 G1 X2\n> N6 G1 X3\n> N7 G1 X4\n> N8 G1 X5
         > N9 G1 X6\n> N10 G1 X7\n> N11 G1 X8\n> N12 G1 X9
         cancel
         ! Stopping(Cancelled)
         < ok\n< ok\n< ok\n< ok\n< ok\n< ok\n< ok\n< ok
         > nothing
         < ok
         > M110
         < ok
         > N1 M104 S0
         > N2 M107
         < ok
         < ok
         > N3 M105
         < ok T:20.0 /0.0
         ! Ended(Stopped { ending: Cancelled, safety: Acknowledged })",
    );
}

#[test]
fn a_cancel_while_heating_ends_the_wait() {
    check(
        "job M109 S200",
        "> N4 M109 S200
         > N5 M400
         cancel
         > N6 M108
         < ok
         < ok
         < ok
         > M110",
    );
}

#[test]
fn a_cancel_drops_what_was_asked_for_again() {
    check(
        "job 2",
        "> N4 G1 X1\n> N5 G1 X2\n> N6 M400
         < ok
         < Resend: 5
         cancel
         + 20
         > M110",
    );
    // The request comes after the cancel.
    check(
        "job 2",
        "> N4 G1 X1\n> N5 G1 X2\n> N6 M400
         cancel
         < ok
         < Resend: 5
         + 20
         > M110",
    );
}

#[test]
fn a_cancel_that_nobody_answers_says_so() {
    check(
        "job 30",
        "> N4 G1 X1\n> N5 G1 X2\n> N6 G1 X3\n> N7 G1 X4\n> N8 G1 X5
         > N9 G1 X6\n> N10 G1 X7\n> N11 G1 X8\n> N12 G1 X9
         cancel
         + 3000
         > N13 M105
         + 90000
         > N14 M105\n> N15 M105\n> N16 M105
         > M110
         + 120000
         > M110\n> M110\n> M110\n> M110\n> M110\n> M110\n> M110\n> M110\n> M110
         ! Ended(Stopped { ending: Cancelled, safety: Unknown })",
    );
}

#[test]
fn a_printer_that_keeps_alive_and_falls_silent_has_less_time() {
    let job = "> N4 G28\n> N5 M400\n < busy: processing\n + 3000\n > N6 M105\n";
    check("job G28", &format!("{job} + 29999\n > nothing\n + 1\n > N7 M105"));
}

#[test]
fn a_cancel_before_the_first_line_touches_nothing() {
    check_with(
        settings(),
        "+ 250
         > M110
         cancel
         ! Ended(Stopped { ending: Cancelled, safety: Untouched })
         + 100000
         > nothing",
    );
}

#[test]
fn a_lost_port_ends_the_job() {
    check(
        "job 1",
        "> N4 G1 X1
         > N5 M400
         lost
         ! Failed(PortLost { reason: \"unplugged\" }), safety: Unknown",
    );
}

#[test]
fn an_empty_job_finishes() {
    check("", "> N4 M400\n < ok\n > N5 M105\n < ok T:1 /0\n ! Ended(Finished)");
}

#[test]
fn the_jobs_own_line_numbers_are_left_out() {
    check(
        "job M110 N0\njob G1 X1",
        &format!("! Skipped {{ job_line: 1 }}\n> N4 G1 X1\n> N5 M400\n < ok\n < ok\n > N6 M105"),
    );
}

#[test]
fn long_messages_are_shortened_on_the_wire() {
    let text = "x".repeat(200);
    let cut = "x".repeat(88 - 5);
    check(&format!("job M117 {text}"), &format!("> N4 M117 {cut}\n> N5 M400"));
}

#[test]
fn numbers_that_grew_too_long_begin_anew() {
    // A line of exactly 95 characters as N9, but a probe has taken that number.
    let long = format!("G1 X{}", "1".repeat(84));
    let one_line = Settings { window: Limit::Lines(1), ..settings() };
    let run: String = (1..=5).map(|n| format!("> N{} G1 X{n}\n + 1\n < ok\n", n + 3)).collect();
    check_with(
        one_line,
        &format!(
            "job 6
             job {long}
             {CONNECT}
             {run}
             > N9 G1 X6
             + 3000
             > N10 M105
             < ok T:20.0 /0.0
             > M110
             < ok
             > N1 {long}"
        ),
    );
}

#[test]
fn temperatures_are_asked_for_where_they_do_not_come() {
    check_with(
        settings(),
        "job 3
         + 250
         > M110
         < ok
         > N1 M115
         < ok
         > N2 M105
         < ok T:20.0 /0.0
         > N3 M105
         > N4 G1 X1
         > N5 G1 X2
         > N6 G1 X3
         > N7 M400
         < ok T:20.0 /0.0
         ! Temperatures
         < ok
         < ok
         < ok
         < ok
         > N8 M105
         < ok T:20.0 /0.0
         ! Ended(Finished)",
    );
}

/// What the printer may say, true to form or not.
fn chatter() -> impl Strategy<Value = Vec<u8>> {
    let line = |text: &'static str| Just(text.as_bytes().to_vec());
    prop_oneof![
        8 => line("ok\n"),
        2 => line("ok T:20.0 /0.0 B:20.0 /0.0\n"),
        2 => (0_u32..40).prop_map(|n| format!("ok N{n} P15 B3\n").into_bytes()),
        3 => (0_u32..40).prop_map(|n| format!("Resend: {n}\n").into_bytes()),
        2 => (0_u32..40).prop_map(|n| format!("Error:checksum mismatch, Last Line: {n}\n").into_bytes()),
        1 => line("wait\n"),
        1 => line("echo:busy: processing\n"),
        1 => line("!! shutdown\n"),
        1 => line("start\n"),
        2 => prop::collection::vec(any::<u8>(), 0..30),
    ]
}

/// What a session did with some bytes: what it sent, what it told.
fn listen(chunks: &[(Vec<u8>, u64)]) -> (Vec<String>, Vec<Event>) {
    let mut player = Player::new(settings());
    player.job = (1..=200).map(|n| format!("G1 X{n}")).collect();
    for step in CONNECT.lines().map(str::trim).filter(|l| !l.is_empty()) {
        player.play(step, CONNECT);
    }
    for (bytes, wait_ms) in chunks {
        player.session.on_bytes(bytes, player.now_ms);
        player.settle();
        player.pass(*wait_ms);
    }
    (player.sent.into(), player.events.into())
}

proptest! {
    /// Whatever the printer says, a line is sent in its turn or because it was
    /// asked for.
    #[test]
    fn no_line_goes_out_of_turn(
        chunks in prop::collection::vec((chatter(), prop_oneof![Just(0), Just(25), 0_u64..5000]), 0..80),
    ) {
        let mut asked: Vec<u64> = Vec::new();
        for (bytes, _) in &chunks {
            for line in bytes.split(|b| matches!(b, b'\n' | b'\r')) {
                match parse(line) {
                    Reply::Resend(n) => asked.push(n.into()),
                    Reply::Refused { last_line, .. } => asked.push(u64::from(last_line) + 1),
                    _ => {}
                }
            }
        }
        let (sent, _) = listen(&chunks);
        let mut expect = 4_u64;
        for line in sent {
            if line.starts_with("N0 M110") {
                expect = 1;
                continue;
            }
            let n: u64 = line[1..].split(' ').next().unwrap().parse().unwrap();
            prop_assert!(n == expect || asked.contains(&n), "{} after {}", line, expect);
            expect = n + 1;
        }
    }

    /// The pieces in which a line arrives change nothing.
    #[test]
    fn pieces_do_not_matter(
        lines in prop::collection::vec(chatter(), 0..40),
        cuts in prop::collection::vec(0_usize..20, 1..60),
    ) {
        let whole: Vec<_> = lines.iter().map(|line| (line.clone(), 0)).collect();
        let mut pieces = Vec::new();
        for (line, cut) in lines.iter().zip(cuts.iter().cycle()) {
            let (head, tail) = line.split_at(*cut.min(&line.len()));
            pieces.push((head.to_vec(), 0));
            pieces.push((tail.to_vec(), 0));
        }
        prop_assert_eq!(listen(&pieces), listen(&whole));
    }
}
