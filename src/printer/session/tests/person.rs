//! A person beside the job: commands, prompts, waits.
use super::*;

#[test]
fn a_command_goes_between_the_jobs_lines() {
    check(
        "job 12",
        "> N4 G1 X1\n> N5 G1 X2\n> N6 G1 X3\n> N7 G1 X4\n> N8 G1 X5\n> N9 G1 X6\n> N10 G1 X7\n> N11 G1 X8\n> N12 G1 X9
         say  m300 p10 ; beep
         > nothing
         < ok\n< ok
         > N13 M300 P10
         > nothing
         < ok
         > N14 G1 X10",
    );
}

#[test]
fn what_cannot_be_sent_is_refused() {
    let mut player = Player::new(settings());
    let long = format!("G1 X{}", "1".repeat(100));
    for step in CONNECT.lines().map(str::trim).filter(|l| !l.is_empty()) {
        assert!(!player.session.command("M300", player.now_ms) || step.contains("Connected"));
        player.play(step, CONNECT);
    }
    for command in ["M110 N5", "", "; only a comment", &long] {
        assert!(!player.session.command(command, player.now_ms), "{command}");
    }
    let taken = (0..100).filter(|_| player.session.command("M300", player.now_ms)).count();
    assert!(taken < 100, "commands are bounded");
}

/// M108 overtakes what waits, and its `ok` acknowledges no line of the job.
#[test]
fn an_urgent_command_overtakes() {
    check(
        "job 3",
        "> N4 G1 X1\n> N5 G1 X2\n> N6 G1 X3\n> N7 M400
         say M108
         >> M108
         < ok\n< ok\n< ok\n< ok
         < ok
         > N8 M105
         < ok T:20.0 /0.0
         ! Ended(Finished)",
    );
    // With it the printer asks again for what came after: no `ok` of it is awaited.
    check(
        "job 2",
        "> N4 G1 X1\n> N5 G1 X2\n> N6 M400
         say M108
         >> M108
         < ok
         < Resend: 5
         < ok
         + 20
         > N5 G1 X2\n> N6 M400
         < ok\n< ok
         > N7 M105",
    );
}

#[test]
fn an_urgent_command_waits_for_the_end_of_a_line() {
    let mut player = Player::new(settings());
    player.job = (1..=30).map(|n| format!("G1 X{n}")).collect();
    for step in CONNECT.lines().map(str::trim).filter(|l| !l.is_empty()) {
        player.play(step, CONNECT);
    }
    player.session.on_bytes(b"ok\nok\nok\n", player.now_ms);
    player.session.feed(b"G1 X11", 11, player.now_ms);
    player.session.written("N13 G".len());
    assert!(player.session.command("M108", player.now_ms));
    let out = String::from_utf8(player.session.output().to_vec()).unwrap();
    let lines: Vec<&str> = out.lines().map(|line| line.split('*').next().unwrap()).collect();
    assert_eq!(lines, ["1 X10", "M108", "N14 G1 X11"]);
}

#[test]
fn prompts_are_asked_and_answered() {
    let ask = "< //action:prompt_begin Filament?
               < //action:prompt_choice More
               < //action:prompt_button Go on
               < //action:prompt_show
               ! Prompt(Some(Prompt { text: \"Filament?\", choices: [\"More\", \"Go on\"] }))\n";
    let job = "> N4 M600\n> N5 M400\n";
    check("job M600", &format!("{job} {ask} answer 1\n >> M876 S1\n ! Prompt(None)"));
    check("job M600", &format!("{job} {ask} < //action:prompt_end\n ! Prompt(None)"));
}

#[test]
fn prompts_are_wanted_where_the_firmware_has_them() {
    check_with(
        settings(),
        "job 1
         + 250
         > M110
         < ok
         > N1 M115
         < Cap:PROMPT_SUPPORT:1
         < ok
         > N2 M876 P1
         < ok
         > N3 M105",
    );
}

#[test]
fn a_wait_for_a_person_is_told() {
    // By its note.
    check(
        "job M0",
        "> N4 M0\n> N5 M400
         < echo:busy: paused for user
         ! Waiting(Some(User))
         say M108
         >> M108
         < ok
         ! Waiting(None)",
    );
    check(
        "job 1",
        "> N4 G1 X1\n> N5 M400\n < busy: paused for input\n ! Waiting(Some(Input))\n < busy: processing\n ! Waiting(None)",
    );
    // By the command, where no note comes.
    check(
        "job M0",
        "> N4 M0\n> N5 M400\n + 999\n ! nothing\n + 1\n ! Waiting(Some(Command))\n < ok\n ! Waiting(None)",
    );
    // Not while it waits behind another, and not for a firmware that does not wait.
    check(
        "job G28\njob M0",
        "> N4 G28\n> N5 M0\n> N6 M400\n + 2900\n ! nothing\n < ok\n + 900\n < ok\n ! nothing",
    );
}

#[test]
fn actions_and_runouts() {
    let check_event = |said: &str, event: &str| {
        check("job 1", &format!("> N4 G1 X1\n> N5 M400\n < {said}\n ! {event}"));
    };
    check_event("//action:pause", "Action(Pause)");
    check_event("// action:out_of_filament T1", "Action(OutOfFilament { extruder: Some(1) })");
    check_event("echo:Filament runout", "Action(OutOfFilament { extruder: None })");
    check_event("//action:dance", "Action(Other(\"dance\"))");
}
