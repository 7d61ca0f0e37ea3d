//! Whole jobs on a virtual clock, against a printer that is a machine of its own behind the
//! plainest protocol there is: each line in its order is executed at once and answered.
//!
//! What is wrong on the wire is the session's matter and tested there; crashes, disks and
//! clocks together are the rig's (`hil`). Here: what is sent, in which order, after which
//! record.
use super::*;
use crate::job::record::Accepted;
use crate::job::reference::Reference;
use crate::printer::source::{JobLine, SourceError};

/// Lines of a file; from `changed_at` on they are others.
#[derive(Debug, Clone)]
struct Lines {
    lines: Vec<String>,
    at: usize,
    changed_at: usize,
}

impl Source for Lines {
    fn advance(&mut self) -> Result<bool, SourceError> {
        if self.at >= self.changed_at {
            return Err(SourceError { line: self.at as u64, reason: "the file was changed".to_owned() });
        }
        self.at += 1;
        Ok(self.at <= self.lines.len())
    }

    fn line(&self) -> JobLine<'_> {
        JobLine { command: self.lines[self.at - 1].as_bytes(), number: self.at as u64 }
    }
}

/// The board: counts lines, executes them, answers.
#[derive(Debug)]
struct Board {
    machine: Reference,
    last: u32,
    replies: String,
    /// What each `ok` tells of its buffers.
    buffers: &'static str,
    /// All that was executed, but for what a host sends to see whether it lives.
    executed: Vec<String>,
}

impl Board {
    fn new() -> Self {
        Self {
            machine: Reference::new(true),
            last: 0,
            replies: String::new(),
            buffers: "",
            executed: Vec::new(),
        }
    }

    fn line(&mut self, line: &str) {
        let Some((number, rest)) = line.strip_prefix('N').and_then(|l| l.split_once(' ')) else {
            return self.execute(line);
        };
        let number: u32 = number.parse().unwrap();
        let command = rest.rsplit_once('*').unwrap().0;
        match number {
            _ if command.starts_with("M110") => self.last = number,
            n if n == self.last + 1 => self.last = n,
            _ => {
                let (last, next) = (self.last, self.last + 1);
                self.say(&format!(
                    "Error:Line Number is not Last Line Number+1, Last Line: {last}\r\nResend: {next}\r\nok"
                ));
                return;
            }
        }
        self.execute(command);
    }

    fn execute(&mut self, command: &str) {
        let at = &self.machine.named;
        let answer = match command.split(' ').next().unwrap() {
            "M110" => String::new(),
            "M115" => "FIRMWARE_NAME:Test\r\nCap:EMERGENCY_PARSER:1\r\n".to_owned(),
            "M105" => " T:20.0 /0.0 B:20.0 /0.0".to_owned(),
            "M114" => {
                format!("X:{:.2} Y:{:.2} Z:{:.2} E:{:.2} Count X:0 Y:0 Z:0\r\n", at[0], at[1], at[2], at[3])
            }
            _ => {
                self.machine.run(command);
                String::new()
            }
        };
        if !["M105", "M110", "M115", "M155"].iter().any(|own| command.starts_with(own)) {
            self.executed.push(command.to_owned());
        }
        match answer.strip_prefix(' ') {
            Some(with) => self.say(&format!("ok{} {with}", self.buffers)),
            None => self.say(&format!("{answer}ok{}", self.buffers)),
        }
    }

    fn say(&mut self, text: &str) {
        self.replies.push_str(text);
        self.replies.push_str("\r\n");
    }
}

/// How much of what is written down the medium keeps.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Medium {
    Good,
    /// Nothing more.
    Stuck,
}

struct Play {
    host: Host<Lines>,
    board: Board,
    now_ms: u64,
    medium: Medium,
    records: Vec<Record>,
    states: Vec<State>,
    refused: Vec<&'static str>,
}

/// What stands between the wire and the user.
fn settings() -> HostSettings {
    let lines = |text: &str| text.split("; ").map(str::to_owned).collect();
    HostSettings {
        session: Settings {
            boot_wait_ms: 0,
            waits_for_link: true,
            cancel_macro: lines("M104 S0; M140 S0; G91; G1 Z10; G90"),
            ..Settings::default()
        },
        start_macro: lines("G28"),
        end_macro: lines("M104 S0; M140 S0; G28 X"),
        pause_macro: lines("M83; G1 E-2 F1800; G91; G1 Z10 F600; G90; G1 X0 Y0 F6000"),
        resume: ResumeRules { homes_xy_alone: true, homing_clears_part: true, ..ResumeRules::default() },
        ..HostSettings::default()
    }
}

/// A file: heat, a fan, then so many beads, one of them on the next layer.
fn file(beads: usize) -> Vec<String> {
    let head = "M190 S60; M109 S210; M83; G92 E0; M106 S128; G1 X5 Y5 Z0.2 F1500";
    let bead = |n: usize| match n {
        20 => "G1 Z0.4".to_owned(),
        n => format!("G1 X{n} Y{} E0.5", n % 7),
    };
    head.split("; ").map(str::to_owned).chain((1..=beads).map(bead)).collect()
}

impl Play {
    fn new(lines: &[String], changed_at: usize, begin: &Begin, board: Board) -> Self {
        let source = Lines { lines: lines.to_vec(), at: 0, changed_at };
        Self {
            host: Host::new(settings(), source, begin, 0),
            board,
            now_ms: 0,
            medium: Medium::Good,
            records: Vec::new(),
            states: Vec::new(),
            refused: Vec::new(),
        }
    }

    fn fresh(lines: &[String]) -> Self {
        Self::new(lines, usize::MAX, &Begin::Fresh, Board::new())
    }

    /// Lines out, replies in, records kept: one round. `false`: nothing happened.
    fn round(&mut self, replies: bool) -> bool {
        let before = self.records.len() + self.states.len();
        while let Some(event) = self.host.poll_event() {
            match event {
                HostEvent::State(state) => self.states.push(state),
                HostEvent::Refused(why) => self.refused.push(why),
                _ => {}
            }
        }
        // Lines go out before the medium has anything new: what waits for it must wait.
        let out = String::from_utf8(self.host.output().to_vec()).unwrap();
        self.host.written(out.len());
        out.lines().filter(|l| !l.is_empty()).for_each(|line| self.board.line(line));
        self.records.extend(std::iter::from_fn(|| self.host.poll_record()));
        if self.medium == Medium::Good {
            self.host.durable(self.records.len() as u64, self.now_ms);
        }
        let said = std::mem::take(&mut self.board.replies);
        if replies && !said.is_empty() {
            self.host.on_bytes(said.as_bytes(), self.now_ms);
        }
        !out.is_empty() || !said.is_empty() || before != self.records.len() + self.states.len()
    }

    /// Goes on until `enough` or for an hour.
    fn until(&mut self, enough: impl Fn(&Self) -> bool) -> &mut Self {
        let give_up_ms = self.now_ms + 3_600_000;
        while !enough(self) && self.now_ms < give_up_ms {
            if self.round(true) {
                continue;
            }
            if self.host.port() == PortWish::Close {
                break;
            }
            let Some(due) = self.host.deadline() else { break };
            self.now_ms = self.now_ms.max(due) + 1;
            self.host.on_tick(self.now_ms);
        }
        self
    }

    fn play_out(&mut self) -> &mut Self {
        self.until(|_| false)
    }

    /// Until the board has executed so many lines.
    fn until_executed(&mut self, lines: usize) -> &mut Self {
        self.until(|play| play.board.executed.len() >= lines)
    }

    fn until_state(&mut self, state: State) -> &mut Self {
        self.until(|play| play.states.last() == Some(&state))
    }

    fn want(&mut self, request: Request) -> &mut Self {
        self.host.request(request, self.now_ms);
        self
    }

    /// What the journal says at a kill -9.
    fn log(&self, lines: &[String]) -> Box<Log> {
        let mut log = Log::new(Accepted { commands: lines.len() as u64, ..Accepted::default() });
        log.apply(&Record::Opened { port: "test".to_owned(), baud: 0, at_unix_s: 0 });
        self.records.iter().for_each(|record| log.apply(record));
        Box::new(log)
    }

    /// What was executed, in one line.
    fn executed(&self) -> String {
        self.board.executed.join("; ")
    }
}

/// `file` with these lines of ours around.
fn with_macros(lines: &[String]) -> String {
    format!("G28; {}; M400; M104 S0; M140 S0; G28 X", lines.join("; "))
}

#[test]
fn a_plain_job_is_its_start_macro_its_lines_and_its_end_macro() {
    for beads in [0, 1, 50, 700] {
        let lines = file(beads);
        let mut play = Play::fresh(&lines);
        play.play_out();
        assert_eq!(play.states, [State::Starting, State::Printing, State::Ending, State::Finished]);
        let executed = play.executed();
        let plain = executed.replace("; M400", "");
        assert_eq!(plain, with_macros(&lines).replace("; M400", ""), "{beads}");
        assert_eq!(play.host.position().commands, lines.len() as u64);
    }
}

#[test]
fn a_pause_parks_and_the_way_back_leads_to_the_same_machine() {
    let lines = file(60);
    // Wherever it comes: also before the first line, at the last, and twice.
    for at in (0..64).step_by(3) {
        let mut play = Play::fresh(&lines);
        play.until_executed(at).want(Request::Pause).until_state(State::Paused);
        if play.states.last() == Some(&State::Finished) {
            // All that is left was in the window.
            assert!(at > 55, "not paused at {at}");
            continue;
        }
        let parked = play.executed();
        assert!(
            parked.ends_with("M114; M83; G1 E-2 F1800; G91; G1 Z10 F600; G90; G1 X0 Y0 F6000"),
            "{parked}"
        );
        let done = play.host.position().commands as usize;
        // The machine as the file has it, made anew by lines alone.
        let want = Reference::new(true).after(["G28"]).after(&lines[..done]);
        play.want(Request::Resume).until_state(State::Printing);
        let whole = play.executed();
        if done > 5 {
            assert_eq!(play.board.machine.told(), want.told(), "paused after {done}: {whole}");
        }
        play.play_out();
        assert_eq!(play.states.last(), Some(&State::Finished));
        // Every line of the file, in order and once.
        let after = play.executed();
        let rest = after.strip_prefix(&whole).unwrap();
        for line in &lines[done..] {
            assert!(rest.contains(line.as_str()), "{line} is missing after {done}");
        }
        assert!(rest.len() <= with_macros(&lines[done..]).len() + "; M400".len(), "{rest}");
    }
}

#[test]
fn a_head_that_somebody_has_moved_while_it_was_parked_comes_back_all_the_same() {
    let lines = file(100);
    // Also to a place lower than the part: up before across.
    for by_hand in ["G1 X120 Y90", "G1 X120 Z80", "G1 X0 Y0 Z0.1"] {
        let mut play = Play::fresh(&lines);
        play.until_executed(60).want(Request::Pause).until_state(State::Paused);
        let done = play.host.position().commands as usize;
        let want = Reference::new(true).after(["G28"]).after(&lines[..done]);
        play.board.machine.run(by_hand);
        let before = play.board.executed.len();
        let mut machine = play.board.machine.clone();
        play.want(Request::Resume).until_state(State::Printing);
        assert_eq!(play.board.machine.told(), want.told(), "{by_hand}");
        for line in &play.board.executed[before..] {
            let was = machine.body;
            machine.run(line);
            let across = (0..2).any(|axis| machine.body[axis] != was[axis]);
            assert!(!across || was[2] > want.body[2] - 1e-6, "{line} at {was:?} after {by_hand}");
        }
    }
}

#[test]
fn a_cancel_ends_in_the_cancel_macro() {
    let lines = file(200);
    for (at, also) in [(1, None), (30, None), (100, Some(Request::Pause))] {
        let mut play = Play::fresh(&lines);
        play.until_executed(at);
        if let Some(also) = also {
            play.want(also).until_state(State::Paused);
        }
        play.want(Request::Cancel).play_out();
        assert_eq!(play.states[play.states.len() - 2..], [State::Cancelling, State::Cancelled]);
        let executed = play.executed();
        assert!(executed.ends_with("M104 S0; M140 S0; G91; G1 Z10; G90"), "{executed}");
        assert!(play.board.executed.len() < 150, "cancelled at {at} and went on: {executed}");
        assert!(matches!(
            play.host.outcome(),
            Some(Outcome::Stopped {
                ending: crate::printer::session::Ending::Cancelled,
                safety: crate::printer::session::Safety::Acknowledged
            })
        ));
    }
}

#[test]
fn a_changed_file_stops_before_the_first_line_that_differs() {
    let lines = file(200);
    for changed_at in [0, 1, 50, 199] {
        let mut play = Play::new(&lines, changed_at, &Begin::Fresh, Board::new());
        play.play_out();
        let executed = play.executed().replace("; M400", "");
        let mut expect = vec!["G28".to_owned()];
        expect.extend_from_slice(&lines[..changed_at]);
        expect.extend(settings().session.cancel_macro);
        assert_eq!(executed, expect.join("; "), "changed at {changed_at}");
        assert_eq!(play.states.last(), Some(&State::Failed));
    }
}

#[test]
fn nothing_goes_out_before_what_it_means_is_written_down() {
    let lines = file(3_000);
    // The first line waits for the record of its number.
    let mut play = Play::fresh(&lines);
    play.medium = Medium::Stuck;
    play.play_out();
    assert_eq!(play.executed(), "G28");
    // The pause macro waits for the record that numbers mean nothing now.
    let mut play = Play::fresh(&lines);
    play.until_executed(30);
    play.medium = Medium::Stuck;
    play.want(Request::Pause).play_out();
    assert_eq!(play.states.last(), Some(&State::Pausing));
    assert!(!play.executed().contains("E-2"), "{}", play.executed());
    play.medium = Medium::Good;
    play.until_state(State::Paused);
    assert!(play.executed().contains("E-2"));
    // No more is ahead of the last checkpoint than a resume may go over again.
    let mut play = Play::fresh(&lines);
    play.until(|play| play.states.last() == Some(&State::Printing) && play.host.ahead().0 > 0);
    play.medium = Medium::Stuck;
    play.play_out();
    let (fed, durable) = play.host.ahead();
    assert_eq!((fed - durable, durable), (MAX_AHEAD, 0));
    play.medium = Medium::Good;
    assert_eq!(play.play_out().states.last(), Some(&State::Finished));
}

#[test]
fn after_a_dead_host_every_line_is_executed_once() {
    let lines = file(150);
    for killed_at in [1, 2, 7, 40, 120, 150] {
        let mut play = Play::fresh(&lines);
        let mut log = play.log(&lines);
        // Killed, and the one who takes it up is killed as well.
        for lines_more in [killed_at, 15] {
            let before = play.board.executed.len();
            play.until_executed(before + lines_more);
            // The last lines arrive; what the board says to them nobody hears.
            play.round(false);
            play.records.iter().for_each(|record| log.apply(record));
            let mut board = play.board;
            board.replies.clear();
            if log.state == State::Finished {
                play = Play { board, ..Play::fresh(&lines) };
                play.states.push(State::Finished);
                break;
            }
            play = Play::new(&lines, usize::MAX, &Begin::TakeOver { log: log.clone() }, board);
        }
        if play.states.is_empty() {
            play.play_out();
            assert_eq!(play.host.position().commands, lines.len() as u64);
        }
        assert_eq!(play.states.last(), Some(&State::Finished), "{killed_at}: {:?}", play.states);
        let ours = ["M400", "M114"];
        let mut executed = play.board.executed.clone();
        executed.retain(|line| !ours.contains(&line.as_str()));
        let mut expect: Vec<_> = with_macros(&lines).split("; ").map(str::to_owned).collect();
        expect.retain(|line| !ours.contains(&line.as_str()));
        // A host that died before the file's first line begins with the start macro.
        while executed.iter().filter(|line| *line == "G28").count() > 1 {
            assert!(killed_at < 2, "the start macro ran again in mid-job");
            executed.remove(0);
        }
        assert_eq!(executed, expect, "killed at {killed_at}");
    }
}

#[test]
fn a_head_that_is_not_where_the_file_has_it_is_made_safe() {
    let lines = file(150);
    let mut first = Play::fresh(&lines);
    first.until_executed(60);
    first.round(false);
    let log = first.log(&lines);
    let mut board = first.board;
    board.replies.clear();
    // Somebody has moved it meanwhile.
    board.machine.run("G1 X150");
    let before = board.executed.len();
    let mut second = Play::new(&lines, usize::MAX, &Begin::TakeOver { log }, board);
    second.play_out();
    assert_eq!(second.states, [State::TakingOver, State::Failing, State::Interrupted]);
    let executed = second.board.executed[before..].join("; ");
    assert!(executed.ends_with("M104 S0; M140 S0; G91; G1 Z10; G90"), "{executed}");
    assert!(!executed.contains("G1 X"), "{executed}");
}

#[test]
fn after_a_power_cut_nothing_moves_before_a_persons_word() {
    let lines = file(1_500);
    let mut first = Play::fresh(&lines);
    first.until_executed(1_200);
    first.round(false);
    let log = first.log(&lines);
    let height_mm = first.board.machine.body[2];

    // A board that has started anew; nobody is there.
    let cold = || {
        let mut board = Board::new();
        board.machine.body[2] = height_mm;
        board
    };
    let mut nobody = Play::new(&lines, usize::MAX, &Begin::TakeOver { log: log.clone() }, cold());
    nobody.play_out();
    assert_eq!(nobody.states, [State::TakingOver, State::Interrupted]);
    assert_eq!(nobody.executed(), "");
    // It does not sit on the port until somebody comes.
    assert_eq!(nobody.host.port(), PortWish::Close);

    // With the word: the way back, and then the file from before where it broke off.
    let begin = Begin::AfterReset { log: log.clone(), confirmed: true };
    let mut back = Play::new(&lines, usize::MAX, &begin, cold());
    back.until_state(State::Printing);
    assert_eq!(back.states, [State::TakingOver, State::Interrupted, State::Recovering, State::Printing]);
    let plan = back.host.plan().unwrap().clone();
    let after = plan.after as usize;
    let known = log.checkpoint.commands as usize;
    assert!(known >= CHECKPOINT_COMMANDS as usize, "{known}");
    assert!(after + settings().resume.depth() as usize <= known, "{after} of {known}");
    let of_steps: Vec<_> = plan.steps.iter().flat_map(|step| step.lines.clone()).collect();
    let want = Reference::new(true).after(["G28"]).after(&lines[..after]);
    assert_eq!(back.executed(), of_steps.join("; "));
    assert_eq!(back.board.machine.told(), want.told());
    back.play_out();
    assert_eq!(back.states.last(), Some(&State::Finished));
    let rest = back.executed();
    let rest = rest.strip_prefix(&of_steps.join("; ")).unwrap().replace("; M400", "");
    assert_eq!(rest, format!("; {}; M104 S0; M140 S0; G28 X", lines[after..].join("; ")));
}

/// A board with more room than its profile says tells so: after a loss of its state the job
/// goes on before all that it may have held.
#[test]
fn a_resume_reckons_with_the_buffers_that_the_printer_tells() {
    let check = |buffers: &'static str, expect: u32| {
        let lines = file(1_500);
        let mut first = Play::new(&lines, usize::MAX, &Begin::Fresh, Board { buffers, ..Board::new() });
        first.until_executed(1_200);
        first.round(false);
        let log = first.log(&lines);
        let mut cold = Board::new();
        cold.machine.body[2] = first.board.machine.body[2];
        let known = log.checkpoint.commands;
        let begin = Begin::AfterReset { log, confirmed: true };
        let mut back = Play::new(&lines, usize::MAX, &begin, cold);
        back.until_state(State::Printing);
        let plan = back.host.plan().unwrap();
        assert!(plan.after + u64::from(expect) <= known, "{buffers}: {} of {known}", plan.after);
        assert!(known - plan.after <= plan.most_twice, "{buffers}: {} of {known}", plan.after);
        let twice = MAX_AHEAD + u64::from(expect) + u64::from(crate::job::recover::CLEAN_BACK_MOVES);
        assert_eq!(plan.most_twice, twice, "{buffers}");
    };
    check("", 16 + 4 + 2);
    check(" P15 B3", 16 + 4 + 2);
    check(" P63 B7", 64 + 8 + 2);
}
