//! What firmwares with a name say that the plain one does not.
use super::*;

fn named(name: &str) -> Firmware {
    board(|c| Personality::find(name).unwrap().apply(c), "")
}

/// One exchange: a firmware's name, what goes in, what comes out within 40 ms.
fn check_one(name: &str, input: &str, expect: &str) {
    let mut board = named(name);
    board.receive(300 * MS, input.as_bytes());
    assert_eq!(output(&mut board, 340), expect, "{name}: {input:?}");
}

#[test]
fn each_asks_for_a_resend_in_its_own_words() {
    let gap = "Error:Line Number is not Last Line Number+1, Last Line: 0\n";
    let wrong = numbered(5, "G90");
    let check = |name, expect: &str| check_one(name, &wrong, expect);
    check("marlin-2.1", &format!("{gap}Resend: 1\nok\n"));
    check("resend-without-ok", &format!("{gap}Resend: 1\n"));
    check("resend-tight", &format!("{gap}Resend:1\nok\n"));
    check("resend-with-n", &format!("{gap}Resend: N:1\nok\n"));
    check("rs", &format!("{gap}rs 1\n"));
    check("repetier", "Error:expected line 1 got 5\nResend:1\nok\n");
    check("klipper", "ok\n");
}

#[test]
fn each_takes_a_repeat_in_its_own_way() {
    let twice = numbered(1, "G90").repeat(2);
    let check = |name, expect: &str| check_one(name, &twice, expect);
    check("marlin-2.1", "ok\n");
    check("repetier", "ok 1\nskip 1\nok\n");
    for name in ["refuses-repeats", "marlin-1.1", "marlin-1.0"] {
        check(name, "Error:Line Number is not Last Line Number+1, Last Line: 1\nResend: 2\nok\nok\n");
    }
}

#[test]
fn temperatures_name_what_there_is() {
    let plain = "T:22.00 /0.00 B:22.00 /0.00";
    check_one("marlin-2.1", "M105\n", &format!("ok {plain} @:0 B@:0\n"));
    check_one("chamber", "M105\n", &format!("ok {plain} C:22.00 /0.00 @:0 B@:0 C@:0\n"));
    let two = format!("{plain} T0:22.00 /0.00 T1:22.00 /0.00 @:0 B@:0 @0:0 @1:0\n");
    check_one("two-extruders", "M105\n", &format!("ok {two}"));
    check_one("repetier", &numbered(1, "M105"), &format!("ok 1\n{plain} @:0 B@:0\n"));
    check_one("two-extruders", "T1\nT2\n", "echo:Active Extruder: 1\nok\necho:T2 Invalid extruder\nok\n");
    check_one(
        "marlin-2.1",
        "T0\nT1\nM141 S40\n",
        "ok\necho:T1 Invalid extruder\nok\necho:Unknown command: \"M141 S40\"\nok\n",
    );
}

#[test]
fn every_extruder_has_a_heater() {
    let mut board = named("two-extruders");
    board.receive(300 * MS, b"M104 S200\nM104 T1 S150\nT1\n");
    board.advance(400 * MS);
    let stats = board.stats();
    let targets: Vec<f64> = stats.nozzles_c.iter().map(|n| n[1]).collect();
    assert_eq!(
        (targets.as_slice(), stats.tool, stats.nozzle_target_c),
        ([200.0, 150.0].as_slice(), 1, 150.0)
    );
    board.receive(500 * MS, b"M104 T0 S0\nM104 T1 S0\n");
    board.advance(600 * MS);
    assert!(!board.stats().heaters_on);
}

#[test]
fn a_chamber_is_waited_for() {
    let mut board = board(|c| (c.speed, c.machine.chamber) = (1000.0, true), "");
    board.receive(300 * MS, b"M113 S0\nM191 S40\n");
    assert_eq!(output(&mut board, 320), "ok\n");
    board.advance(5000 * MS);
    assert_eq!(board.stats().chamber_c, Some([40.0, 40.0]));
}

#[test]
fn what_is_not_built_in_is_unknown() {
    let unknown = |line: &str| format!("echo:Unknown command: \"{line}\"\nok\n");
    check_one("no-auto-report", "M155 S1\n", &unknown("M155 S1"));
    check_one("no-busy-notes", "M113 S1\n", &unknown("M113 S1"));
    check_one("levelling", "M420 S1\n", "echo:Bed Leveling ON\necho:Fade Height 10.00\nok\n");
    // Unknown kinds of G92 are ignored without a word.
    check_one("no-power-loss-recovery", "G92.9 Z5\n", "ok\n");
    check_one("marlin-2.1", "G92.9 Z5\n", "X:0.00 Y:0.00 Z:5.00 E:0.00 Count X:0 Y:0 Z:2000\nok\n");
    check_one("marlin-2.1", "G92 Z5\n", "X:0.00 Y:0.00 Z:5.00 E:0.00 Count X:0 Y:0 Z:0\nok\n");
    check_one("marlin-1.0", "G92 Z5\n", "ok\n");
    check_one("no-prompts", "M0\n", "");
}

#[test]
fn capabilities_say_what_there_is() {
    let check = |name: &str, lines: &[&str]| {
        let mut board = named(name);
        board.receive(300 * MS, b"M115\n");
        let said = output(&mut board, 350);
        for line in lines {
            assert!(
                said.lines().any(|l| l == *line || l.contains(line) && !line.starts_with("Cap")),
                "{name}: {said}"
            );
        }
        said
    };
    check(
        "marlin-2.1",
        &["FIRMWARE_NAME:Marlin 2.1.2.1 ", "Cap:EMERGENCY_PARSER:1", "Cap:AUTOREPORT_TEMP:1"],
    );
    check("no-emergency-parser", &["Cap:EMERGENCY_PARSER:0"]);
    check("no-auto-report", &["Cap:AUTOREPORT_TEMP:0"]);
    check("no-prompts", &["Cap:PROMPT_SUPPORT:0"]);
    check("chamber", &["Cap:CHAMBER_TEMPERATURE:1"]);
    check("two-extruders", &["EXTRUDER_COUNT:2"]);
    assert!(!check("marlin-1.0", &["FIRMWARE_NAME:Marlin 1.0.2 "]).contains("Cap:"));
}

#[test]
fn repetier_acknowledges_what_it_queues_and_says_when_it_is_idle() {
    let mut board = named("repetier");
    board.receive(300 * MS, [numbered(1, "G4 S2"), numbered(2, "G90")].concat().as_bytes());
    assert_eq!(output(&mut board, 320), "ok 1\nok 2\n");
    assert_eq!(output(&mut board, 2200).matches("wait").count(), 0);
    assert_eq!(output(&mut board, 5000).matches("wait\n").count(), 2);
}

#[test]
fn sizes_are_what_they_are_said_to_be() {
    let mut board = named("large");
    let lines: String = (1..=40).map(|n| numbered(n, &format!("G1 X{n} F60"))).collect();
    board.receive(300 * MS, lines.as_bytes());
    board.advance(400 * MS);
    let stats = board.stats();
    assert_eq!((stats.planner_most, stats.overflow_bytes), (40, 0));
    board.receive(500 * MS, b"G90\n");
    assert!(output(&mut board, 600).ends_with("ok P23 B31\n"));
}

#[test]
fn levelling_outlives_a_reset_only_when_it_is_turned_on_again() {
    let mut board =
        board(|c| (c.machine.levelling, c.speed) = (true, 1000.0), "[[fault]]\nat_s = 1\ndo = 'reset'");
    board.receive(300 * MS, b"G28\nG29\n");
    board.advance(900 * MS);
    assert!(board.stats().levelling_on);
    board.advance(1500 * MS);
    assert!(!board.stats().levelling_on);
    board.receive(1600 * MS, b"M420 S1\n");
    board.advance(1700 * MS);
    assert!(board.stats().levelling_on);
}
