//! What real firmware does on the wire while a job runs.
use super::*;

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
    for answers in ["< ok\n< ok\n< ok", "< ok\n< ok N4 P15 B3\n< ok N5 P15 B3"] {
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
    }
}

#[test]
fn a_resend_without_its_ok() {
    check(
        "job 2",
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
             ! Ended(Finished)",
    );
}

/// Dialects: an error without a resend request (and without an `ok`) is one too.
#[test]
fn an_error_alone_asks_for_lines() {
    check(
        "job 1",
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
             ! Ended(Finished)",
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
             ! Ended(Finished)",
    );
}

/// Wire fact 4 and 5: M105's `ok` has no number; with it all before is done.
#[test]
fn numbers_and_temperatures_acknowledge_what_came_before() {
    check(
        "job 2",
        "> N4 G1 X1
             > N5 G1 X2
             > N6 M400
             < ok N6 P15 B3
             > N7 M105
             < ok N5 P15 B3
             ! nothing
             < ok T:1 /0
             ! Ended(Finished)",
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

/// Wire fact 7: M999 asks for the next line; nothing is missing.
#[test]
fn a_request_for_the_next_line_resends_nothing() {
    check(
        "job M999",
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
             ! Ended(Finished)",
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
fn a_printer_that_keeps_alive_and_falls_silent_has_less_time() {
    let job = "> N4 G28\n> N5 M400\n < busy: processing\n + 3000\n > N6 M105\n";
    check("job G28", &format!("{job} + 29999\n > nothing\n + 1\n > N7 M105"));
}

#[test]
fn the_jobs_own_line_numbers_are_left_out() {
    check(
        "job M110 N0\njob G1 X1",
        "! Skipped { job_line: 1 }\n> N4 G1 X1\n> N5 M400\n < ok\n < ok\n > N6 M105",
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
             > N1 M105
             < Resend: 11
             + 20
             > M110
             < ok
             + 20
             > N1 M105
             < ok T:20.0 /0.0
             > N2 {long}
             ! Probed
             ! nothing"
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
         > N3 G1 X1
         > N4 G1 X2
         > N5 G1 X3
         > N6 M400
         < ok
         < ok
         < ok
         + 2999
         < echo:busy: processing
         + 2001
         > nothing
         < ok
         > N7 M105
         < ok T:20.0 /0.0
         ! Ended(Finished)",
    );
}

/// A reset whose `start` was lost in noise: the board asks for the first line of all. Once may
/// be a garbled number; the job is never sent again from there.
#[test]
fn a_lost_start_is_seen_by_what_is_asked_for() {
    check(
        "job 2",
        "> N4 G1 X1
             > N5 G1 X2
             > N6 M400
             < ok
             < svart
             < Error:Line Number is not Last Line Number+1, Last Line: 0
             < Resend: 1
             < ok
             + 20
             > N7 M105
             < Error:Line Number is not Last Line Number+1, Last Line: 0
             ! Ended(Stopped { ending: Failed(Reset { job_line: 1 }), safety: ByFirmware })",
    );
}
