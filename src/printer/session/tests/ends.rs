//! How jobs end: well, by the user, by the printer, by the cable.
use super::*;

#[test]
fn prints_and_proves_the_end() {
    check(
        "job 2",
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
             ! Ended(Finished)",
    );
}

#[test]
fn silence_is_no_printer() {
    let tries = "> M110\n + 2000\n".repeat(10);
    check_with(
        settings(),
        &format!("+ 250\n {tries} ! NoAnswer {{ bytes: 0, lines: 0 }}), safety: Untouched"),
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
fn a_job_that_cannot_be_read_on_ends_safely() {
    check(
        "job 1",
        "> N4 G1 X1
         > N5 M400
         broken
         ! Stopping(Failed(Source { job_line: 7, reason: \"cut\" }))
         > M110
         < ok
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
fn an_empty_job_finishes() {
    check("", "> N4 M400\n < ok\n > N5 M105\n < ok T:1 /0\n ! Ended(Finished)");
}
