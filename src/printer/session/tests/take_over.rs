//! A port that comes back, and a printer in mid-job that another host has left.
use super::*;

/// The refusal of the question, as Marlin says it.
fn refusal(last: u32) -> String {
    format!(
        "< Error:Line Number is not Last Line Number+1, Last Line: {last}
         < Resend: {}
         < ok
         + 50
         ! Found(Counting {{ last: {last} }})\n",
        last + 1
    )
}

fn rejoin(transcript: &str) {
    let settings = Settings { waits_for_link: true, ..settings() };
    check_with(
        settings,
        &format!(
            "job 4
             {CONNECT}
             > N4 G1 X1\n> N5 G1 X2\n> N6 G1 X3\n> N7 G1 X4\n> N8 M400
             < ok
             {transcript}"
        ),
    );
}

const ASKED: &str = "lost\n ! LinkLost\n + 5000\n > nothing\n back\n + 250\n > QUESTION\n";

#[test]
fn a_port_that_comes_back_goes_on_where_the_printer_is() {
    rejoin(&format!(
        "{ASKED} {} go 6
         > N7 G1 X4\n> N8 M400
         < ok\n< ok
         > N9 M105
         < ok T:20.0 /0.0
         ! Rejoined
         ! Ended(Finished)",
        refusal(6)
    ));
    // Everything had arrived.
    rejoin(&format!("{ASKED} {} go 8\n > N9 M105\n < ok T:20.0 /0.0\n ! Ended(Finished)", refusal(8)));
    // Nothing had, and an `ok` had lied.
    rejoin(&format!(
        "{ASKED} {} go 3\n > N4 G1 X1\n> N5 G1 X2\n> N6 G1 X3\n> N7 G1 X4\n> N8 M400",
        refusal(3)
    ));
    // A number that was never sent.
    rejoin(&format!("{ASKED} {} no go 9\n no go 77\n > nothing\n go 8\n > N9 M105", refusal(77)));
}

#[test]
fn stale_acknowledgements_do_no_harm() {
    rejoin(&format!(
        "{ASKED} < ok
         < ok
         {} < ok
         go 6
         > N7 G1 X4\n> N8 M400
         < ok\n< ok
         > N9 M105
         < ok
         > N10 M105
         < ok T:20.0 /0.0
         < ok T:20.0 /0.0
         ! Ended(Finished)",
        refusal(6)
    ));
}

#[test]
fn a_reset_while_the_port_was_gone() {
    rejoin(
        "lost
         back
         + 100
         < start
         < Marlin 2.1.2.1
         + 249
         > nothing
         + 1
         ! Found(Started)
         no go 6
         anew
         > M110
         < ok
         > N1 M115",
    );
    // After the question, and after its answer.
    rejoin(&format!("{ASKED} < start\n + 250\n ! Found(Started)"));
    rejoin(&format!("{ASKED} {} < start\n + 250\n ! Found(Started)\n no go 6", refusal(6)));
}

#[test]
fn one_statement_is_not_enough() {
    rejoin(&format!(
        "{ASKED} < Resend: 7
         + 50
         > QUESTION
         < Resend: 3
         + 50
         > QUESTION
         < Resend: 3
         + 50
         ! Found(Counting {{ last: 2 }})"
    ));
    // Half a line was refused, then the question: the later number counts.
    rejoin(&format!(
        "{ASKED} < Error:No Checksum with line number, Last Line: 6
         < Resend: 7
         < ok
         + 20
         < Error:Line Number is not Last Line Number+1, Last Line: 7
         < Resend: 8
         < ok
         + 49
         ! nothing
         + 1
         ! Found(Counting {{ last: 7 }})"
    ));
}

#[test]
fn silence_has_an_end() {
    taken_over(
        "+ 250
         > QUESTION\n + 3000\n > QUESTION\n + 6000\n > QUESTION\n + 12000\n > QUESTION\n + 24000
         > QUESTION
         + 47999
         ! nothing
         + 1
         ! NoAnswer { bytes: 0, lines: 0 }), safety: Unknown",
    );
}

#[test]
fn a_busy_printer_is_waited_for() {
    let busy = "+ 2500\n < echo:busy: processing\n".repeat(400);
    rejoin(&format!("{ASKED} {busy} {}", refusal(5)));
    let heating = "+ 1000\n < T:100.0 /200.0 W:?\n".repeat(90);
    rejoin(&format!("{ASKED} {heating} > QUESTION\n > QUESTION\n > QUESTION\n > QUESTION\n{}", refusal(5)));
}

#[test]
fn a_firmware_that_does_not_count() {
    let answer = "< ok B:20.0 /0.0 T0:20.0 /0.0\n";
    rejoin(&format!(
        "{ASKED} {answer} + 3000\n > QUESTION\n {answer} + 6000\n > QUESTION\n {answer} + 12000
         ! Found(NotSaid)
         no go 5
         anew
         > M110"
    ));
}

fn taken_over(transcript: &str) {
    play(Player::of(Session::take_over(settings(), 0)), transcript);
}

#[test]
fn a_fresh_host_takes_over() {
    let begin = "job 2\n + 249\n > nothing\n + 1\n > QUESTION\n";
    taken_over(&format!(
        "{begin} {} go 41
         > N42 M115
         < ok
         < FIRMWARE_NAME:Test 1.0
         < Cap:AUTOREPORT_TEMP:1
         < ok
         > N43 M105
         > N44 M155 S2
         < ok T:20.0 /0.0
         ! nothing
         < ok
         > N45 M105
         > N46 M105
         < ok T:20.0 /0.0
         ! Rejoined {{ firmware: Some(\"Test 1.0\") }}
         > N47 G1 X1\n > N48 G1 X2\n > N49 M400",
        refusal(41)
    ));
    taken_over("+ 100\n < start\n + 250\n ! Found(Started)");
    // A board that was switched on without our hearing it: the caller decides.
    taken_over(&format!("{begin} {} anew\n > M110", refusal(0)));
    taken_over("+ 250\n > QUESTION\n < Error:Printer halted. kill() called!\n ! safety: ByFirmware");
    taken_over("+ 250\n > QUESTION\n cancel\n > M110\n < ok\n > N1 M104 S0\n > N2 M107");
}

/// Our own lines while held are lines like any other.
#[test]
fn a_macro_goes_on_after_the_port_came_back() {
    let settings = Settings { waits_for_link: true, window: Limit::Lines(1), ..settings() };
    check_with(
        settings,
        &format!(
            "job 2
             {CONNECT}
             > N4 G1 X1
             hold
             < ok
             > N5 M400
             < ok
             > N6 M105
             < ok T:20.0 /0.0
             ! Held
             own M17
             > N7 M17
             own M18
             < ok
             > N8 M18
             lost
             back
             + 250
             > QUESTION
             {} go 7
             > N8 M18
             < ok
             > N9 M105
             < ok T:20.0 /0.0
             ! Rejoined
             ! OwnDone
             > nothing
             release
             > N10 G1 X2",
            refusal(7)
        ),
    );
}

#[test]
fn a_port_lost_before_the_job_begins_anew() {
    let settings = Settings { waits_for_link: true, ..settings() };
    check_with(
        settings,
        &format!("job 1\n + 250\n > M110\n lost\n back\n {CONNECT}\n > N4 G1 X1\n > N5 M400"),
    );
}

#[test]
fn a_cancel_while_the_port_is_gone_is_done_when_it_is_back() {
    rejoin(
        "lost
         cancel
         ! Stopping(Cancelled)
         + 60000
         > nothing
         back
         + 250
         > M110
         < ok
         > N1 M104 S0
         > N2 M107",
    );
    rejoin("lost\n cancel\n back\n < start\n ! ending: Cancelled, safety: ByFirmware");
}

#[test]
fn a_board_that_starts_again_and_again() {
    let starts = "< start\n + 250\n > M110\n".repeat(7);
    check_with(settings(), &format!("{starts} < start\n ! BootLoop {{ starts: 8 }}"));
}
