//! Lines of ours between the job's wait for leave, where someone writes them down.
use super::*;

fn asking(job: &str, transcript: &str) {
    let settings = Settings { asks: true, window: Limit::Lines(1), waits_for_link: true, ..settings() };
    // Nothing in the handshake is asked for.
    check_with(settings, &format!("{job}\n{CONNECT}\n? nothing\n{transcript}"));
}

#[test]
fn a_probe_waits_for_leave() {
    asking(
        "job 2",
        "> N4 G1 X1
         + 3000
         ? Own { n: 5 }
         > nothing
         + 100000
         > nothing
         allow
         > N5 M105
         ? nothing
         < ok T:20.0 /0.0
         > N6 G1 X2",
    );
}

/// While an ask is open, no new line gets a number; what is asked for again goes.
#[test]
fn nothing_gets_a_number_meanwhile() {
    asking(
        "job 2",
        "> N4 G1 X1
         + 3000
         ? Own { n: 5 }
         < ok
         > nothing
         < Resend: 4
         + 20
         > N4 G1 X1
         < ok
         > nothing
         allow
         > N5 M105
         < ok T:20.0 /0.0
         > N6 G1 X2",
    );
}

#[test]
fn a_hold_asks_for_its_lines_and_own_lines_do_not() {
    asking(
        "job 3",
        "> N4 G1 X1
         hold
         < ok
         ? Own { n: 5 }
         allow
         > N5 M400
         < ok
         ? Own { n: 6 }
         allow
         > N6 M105
         < ok T:20.0 /0.0
         ! Held
         own M17
         ? nothing
         > N7 M17
         < ok
         ? nothing
         > N8 M105
         < ok T:20.0 /0.0
         ! OwnDone
         say M300
         ? Own { n: 9 }
         release
         > nothing
         allow
         > N9 M300
         < ok
         > N10 G1 X2",
    );
}

#[test]
fn a_cancel_waits_for_nobody() {
    asking(
        "job 2",
        "> N4 G1 X1
         + 3000
         ? Own { n: 5 }
         cancel
         ? nothing
         allow
         < ok
         > M110
         < ok
         > N1 M104 S0
         < ok
         > N2 M107
         < ok
         > N3 M105
         < ok T:20.0 /0.0
         ! safety: Acknowledged",
    );
}

#[test]
fn counting_anew_is_asked_for_twice() {
    let long = format!("G1 X{}", "1".repeat(84));
    let run: String = (1..=6).map(|n| format!("> N{} G1 X{n}\n < ok\n", n + 3)).collect();
    asking(
        &format!("job 6\njob {long}"),
        &format!(
            "{run}
             ? Own {{ n: 10 }}
             allow
             > N10 M105
             < ok T:20.0 /0.0
             ? Renumber
             > nothing
             allow
             > M110
             < ok
             ? nothing
             > N1 M105
             < ok T:20.0 /0.0
             ? Count {{ n: 2 }}
             > nothing
             allow
             > N2 {long}"
        ),
    );
}

/// An ask outlives the port.
#[test]
fn leave_that_comes_while_the_port_is_gone() {
    asking(
        "job 2",
        "> N4 G1 X1
         + 3000
         ? Own { n: 5 }
         lost
         ? Own { n: 5 }
         allow
         > nothing
         back
         + 250
         > QUESTION
         < Resend: 5
         < Resend: 5
         + 50
         ! Found(Counting { last: 4 })
         go 4
         > N5 M105
         < ok T:20.0 /0.0
         ! Rejoined
         > N6 G1 X2
         ? Own { n: 7 }",
    );
}
