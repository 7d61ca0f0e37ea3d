//! Emergency stops.
use super::*;

const RUNNING: &str = "> N4 G1 X1\n> N5 G1 X2\n> N6 M400\n";

fn stopped(transcript: &str) {
    check("job 2", &format!("{RUNNING} stop\n ! Stopping(EmergencyStop)\n >> M112\n {transcript}"));
}

#[test]
fn the_firmware_obeys() {
    for said in ["Error:Printer halted. kill() called!", "start", "!! Shutdown due to M112 command"] {
        stopped(&format!(
            "< ok
             < {said}
             ! EmergencyStopped {{ by: Some(Firmware) }}
             ! Ended(Stopped {{ ending: EmergencyStop, safety: ByFirmware }})
             + 100000
             > nothing"
        ));
    }
}

#[test]
fn a_stop_without_effect_wants_a_reset() {
    let deaf = "+ 300\n >> M112\n + 300\n >> M112\n + 300\n >> M112\n + 100\n";
    stopped(&format!(
        "{deaf} reset true
         + 4000
         ! nothing
         < start
         ! EmergencyStopped {{ by: Some(Reset) }}
         ! safety: ByFirmware"
    ));
    // A port without the wire for it: nothing shows that the board was reset.
    stopped(&format!(
        "{deaf} reset true
         < T:200.0 /200.0
         + 5000
         ! EmergencyStopped {{ by: None }}
         ! safety: Unknown"
    ));
    stopped(&format!("{deaf} reset false\n ! EmergencyStopped {{ by: None }}\n ! safety: Unknown"));
    // It was only late.
    stopped(&format!("{deaf} < Error:Printer halted. kill() called!\n ! by: Some(Firmware)"));
}

/// What is half out is ended by a line feed; nothing else follows.
#[test]
fn m112_is_the_next_on_the_wire() {
    let mut session = Session::new(Settings { boot_wait_ms: 0, ..Settings::default() }, 0);
    session.on_tick(0);
    session.written(5);
    session.emergency_stop(0);
    assert_eq!(session.output(), b"\nM112\n");
    assert!(session.wants_flush());
    session.written(1);
    assert!(!session.wants_flush());
    session.on_bytes(b"ok\nResend: 3\nok\n", 0);
    assert_eq!(session.output(), b"M112\n");
    // What is not written is not said twice.
    session.on_tick(300);
    assert_eq!(session.output(), b"M112\n");
}

#[test]
fn it_works_in_every_phase() {
    let waits = Settings { waits_for_link: true, ..settings() };
    for before in [
        "",
        "+ 250\n > M110",
        "+ 250\n > M110\n < ok\n > N1 M115",
        "+ 250\n > M110\n < ok\n > N1 M115\n cancel\n",
    ] {
        let rest = match before.contains("cancel") {
            true => "! Ended\n stop\n ! nothing\n + 5000\n > nothing",
            false => "stop\n >> M112\n < start\n ! by: Some(Firmware)",
        };
        check_with(waits.clone(), &format!("{before}\n {rest}"));
    }
    let job = format!("job 2\n {CONNECT} {RUNNING}");
    for before in [
        "< Resend: 5\n stop\n >> M112",
        "cancel\n stop\n >> M112",
        "broken\n > M110\n < ok\n > N1 M104 S0\n > N2 M107\n stop\n >> M112",
        "hold\n stop\n >> M112",
        "lost\n back\n stop\n >> M112",
        "lost\n back\n + 250\n > QUESTION\n stop\n >> M112",
        // Without a port it is the first that the next one gets.
        "lost\n stop\n > nothing\n + 100000\n back\n >> M112",
        "stop\n >> M112\n lost\n + 5000\n back\n >> M112",
    ] {
        check_with(
            waits.clone(),
            &format!("{job} {before}\n < Error:Printer halted. kill() called!\n ! by: Some(Firmware)"),
        );
    }
}

#[test]
fn a_port_that_is_lost_for_good_ends_it() {
    check(
        "job 2",
        &format!("{RUNNING} stop\n >> M112\n lost\n ! EmergencyStopped {{ by: None }}\n ! safety: Unknown"),
    );
}
