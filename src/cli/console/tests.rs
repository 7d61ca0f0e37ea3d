//! Conversations on a virtual clock.
use super::talk::{MAX_WAITING, Manner, Shown, Talk, Wish};
use proptest::prelude::*;

/// One step of a conversation.
enum Step {
    Type(&'static str),
    Hear(&'static str),
    /// Milliseconds pass.
    Pass(u64),
    /// So many bytes are written.
    Write(usize),
    /// All that is to be written, and the wishes before it.
    Sends(&'static [Wish], &'static str),
    /// What is shown; a note by how it begins.
    Shows(&'static [&'static str]),
    Idle(bool),
}
use Step::*;

const AWAKE: Manner = Manner { verbose: false, max_line: Some(95), boot_ms: 0 };

fn check(manner: Manner, steps: &[Step]) {
    let mut now_ms = 0;
    let mut talk = Talk::new(manner, now_ms);
    for (at, step) in steps.iter().enumerate() {
        match step {
            Type(line) => talk.type_line(line, now_ms),
            Hear(text) => talk.on_bytes(text.as_bytes(), now_ms),
            Pass(ms) => {
                let end_ms = now_ms + ms;
                while let Some(due_ms) = talk.deadline().filter(|due_ms| *due_ms <= end_ms) {
                    now_ms = due_ms;
                    talk.on_tick(now_ms);
                    assert!(talk.deadline() != Some(due_ms), "step {at}: a deadline that stays");
                }
                now_ms = end_ms;
            }
            Write(len) => talk.written(*len),
            Sends(wishes, text) => {
                let wished: Vec<Wish> = std::iter::from_fn(|| talk.poll_wish()).collect();
                assert_eq!(wished, *wishes, "step {at}");
                let output = String::from_utf8_lossy(talk.output()).into_owned();
                assert_eq!(output, *text, "step {at}");
                talk.written(output.len());
            }
            Shows(expect) => {
                let shown: Vec<Shown> = std::iter::from_fn(|| talk.poll_shown()).collect();
                assert_eq!(shown.len(), expect.len(), "step {at}: {shown:?}");
                for (shown, expect) in shown.iter().zip(*expect) {
                    match shown {
                        Shown::Note(text) => assert!(text.starts_with(expect), "step {at}: {text}"),
                        Shown::Said(text) | Shown::Aside(text) => assert_eq!(text, expect, "step {at}"),
                    }
                }
            }
            Idle(expect) => assert_eq!(talk.idle(), *expect, "step {at}"),
        }
    }
}

#[test]
fn commands_go_one_after_the_other() {
    check(
        AWAKE,
        &[
            Type("G28 ; home"),
            Type("m114"),
            Sends(&[], "G28\n"),
            Hear("echo:busy: processing\necho:busy: processing\n"),
            Sends(&[], ""),
            Shows(&["echo:busy: processing"]),
            Idle(false),
            Hear("ok\nX:0.0"),
            Sends(&[], "M114\n"),
            Hear("0 Y:0.00 Z:0.00\nok\n"),
            Shows(&["ok", "X:0.00 Y:0.00 Z:0.00", "ok"]),
            Idle(true),
        ],
    );
}

#[test]
fn what_comes_by_itself_is_hidden_unless_it_is_asked_for() {
    let report = "T:20.0 /0.0 B:20.0 /0.0\nwait\n";
    check(AWAKE, &[Hear(report), Shows(&[])]);
    check(Manner { verbose: true, ..AWAKE }, &[Hear(report), Shows(&["T:20.0 /0.0 B:20.0 /0.0", "wait"])]);
    check(
        AWAKE,
        &[
            Type("/verbose"),
            Shows(&["all is shown"]),
            Hear(report),
            Shows(&["T:20.0 /0.0 B:20.0 /0.0", "wait"]),
        ],
    );
    // A heater's progress is an answer; so is what M105 asks for.
    check(AWAKE, &[Type("M109 S200"), Hear(report), Shows(&["T:20.0 /0.0 B:20.0 /0.0"])]);
    check(AWAKE, &[Type("M105"), Hear("ok T:20.0 /0.0\n"), Shows(&["ok T:20.0 /0.0"]), Idle(false)]); // not written yet
}

#[test]
fn a_stop_goes_ahead_of_everything() {
    // What is half out is cut by a line feed, what waits is dropped.
    check(
        AWAKE,
        &[
            Type("G28"),
            Write(2),
            Type("G1 X10"),
            Type("G1 X20"),
            Type("M112"),
            Sends(&[Wish::Flush], "\nM112\n"),
            Shows(&["M112 is sent; 2 commands that waited are dropped"]),
            Idle(false),
            Hear("Error:Printer halted. kill() called!\n"),
            Shows(&["Error:Printer halted. kill() called!", "the firmware has stopped"]),
            Idle(true),
            Pass(5_000),
            Shows(&[]),
        ],
    );
    // One without effect is told.
    check(
        AWAKE,
        &[
            Type("/stop"),
            Sends(&[Wish::Flush], "\nM112\n"),
            Shows(&["M112 is sent"]),
            Pass(999),
            Shows(&[]),
            Pass(1),
            Shows(&["the printer did not say that it stopped: SWITCH IT OFF"]),
        ],
    );
    // Also while the board boots.
    check(
        Manner { boot_ms: 2_500, ..AWAKE },
        &[Type("G28"), Sends(&[], ""), Type("M112"), Sends(&[Wish::Flush], "\nM112\n")],
    );
}

#[test]
fn what_ends_a_wait_does_not_wait() {
    check(
        AWAKE,
        &[
            Type("M109 S200"),
            Sends(&[], "M109 S200\n"),
            Type("G28"),
            Type("M108"),
            Sends(&[], "M108\n"),
            Hear("ok\n"),
            Sends(&[], "G28\n"),
        ],
    );
    // A line that is half out is finished first, one that is not begun waits.
    check(AWAKE, &[Type("M109 S200"), Write(4), Type("M410"), Sends(&[], " S200\nM410\n")]);
    check(AWAKE, &[Type("M109 S200"), Type("M108"), Sends(&[], "M108\nM109 S200\n")]);
}

#[test]
fn a_board_that_boots_is_not_talked_to() {
    let boots = Manner { boot_ms: 2_500, ..AWAKE };
    check(
        boots,
        &[
            Type("M105"),
            Pass(1_500),
            Hear("start\necho:Marlin\n"),
            Pass(200),
            Hear("echo:more\n"),
            Pass(249),
            Sends(&[], ""),
            Pass(1),
            Sends(&[], "M105\n"),
            Shows(&["start", "echo:Marlin", "echo:more"]),
        ],
    );
    // One that was not reset says nothing.
    check(boots, &[Type("M105"), Pass(2_499), Sends(&[], ""), Pass(1), Sends(&[], "M105\n")]);
    // A restart that nobody waited for loses what it was told.
    check(
        AWAKE,
        &[
            Type("G28"),
            Type("G29"),
            Sends(&[], "G28\n"),
            Hear("start\n"),
            Shows(&["start", "the board has started anew: 2 commands are lost or dropped"]),
            Type("M105"),
            Sends(&[], ""),
            Pass(250),
            Sends(&[], "M105\n"),
        ],
    );
}

#[test]
fn nothing_is_waited_for_in_vain() {
    check(
        AWAKE,
        &[
            Type("G28"),
            Type("M105"),
            Sends(&[], "G28\n"),
            Pass(10_000),
            Shows(&["silence since G28"]),
            Type("/drop"),
            Shows(&["not waiting any longer; 1 commands were not sent"]),
            Idle(true),
        ],
    );
    // An answer that asks for a line again may have an ok behind it or not.
    check(
        AWAKE,
        &[
            Type("N9 G28*1"),
            Type("M105"),
            Sends(&[], "G28\n"),
            Hear("Error:No Line Number with checksum, Last Line: 5\nResend: 6\n"),
            Pass(499),
            Sends(&[], ""),
            Pass(1),
            Sends(&[], "M105\n"),
        ],
    );
}

#[test]
fn what_has_no_effect_is_told() {
    let long = "M117 xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx";
    let told = |line, note| check(AWAKE, &[Type(line), Sends(&[], ""), Shows(note), Idle(true)]);
    told("; a comment", &["nothing was sent: this is a comment"]);
    told(long, &["not sent: it has 101 characters, the firmware takes 95"]);
    told("/nonsense", &["/nonsense is no word of ours"]);
    told("", &[]);
    told("/help", &["/stop"]);
}

#[test]
fn a_pasted_file_is_no_conversation() {
    let mut talk = Talk::new(AWAKE, 0);
    for _ in 0..2 * MAX_WAITING {
        talk.type_line("G1 X1", 0);
    }
    assert_eq!(talk.backlog(), MAX_WAITING);
    assert!(matches!(talk.poll_shown(), Some(Shown::Note(text)) if text.contains("outrigger print")));
}

proptest! {
    /// Whatever is typed and heard: no panic, one command at a time, and a stop is
    /// always the next to go out.
    #[test]
    fn a_stop_is_always_next(
        steps in prop::collection::vec(
            prop_oneof![
                "[GM][0-9]{1,3}".prop_map(|line| (true, line)),
                prop::sample::select(vec!["ok", "start", "Resend: 3", "wait", "!!", "T:1 /2", "\u{fffd}"])
                    .prop_map(|line| (false, line.to_owned())),
            ],
            0..30,
        ),
        written in 0_usize..9,
    ) {
        let mut talk = Talk::new(AWAKE, 0);
        for (at, (typed, line)) in steps.iter().enumerate() {
            let now_ms = 100 * at as u64;
            match typed {
                true => talk.type_line(line, now_ms),
                false => talk.on_bytes(format!("{line}\n").as_bytes(), now_ms),
            }
            talk.written(written.min(talk.output().len()));
            talk.on_tick(now_ms);
        }
        while talk.poll_wish().is_some() {}
        talk.type_line("/stop", 10_000);
        prop_assert_eq!(talk.poll_wish(), Some(Wish::Flush));
        prop_assert_eq!(talk.output(), b"\nM112\n");
        prop_assert_eq!(talk.backlog(), 0);
    }
}
