//! The facts of the wire of real Marlin 2.1.2.1, one by one.
use super::*;

#[test]
fn fact_1_a_resends_ok_comes_before_those_of_queued_lines_and_the_rest_vanishes() {
    let mut board = board(|c| c.advanced_ok = true, "");
    let mut burst: Vec<String> = (2..=7).map(|n| numbered(n, &format!("G1 X{n}"))).collect();
    burst[2] = burst[2].replace("X4", "X5");
    let burst = burst.concat();
    check(
        &mut board,
        &[
            (300, &numbered(1, "M82"), "ok N1 P15 B3\n"),
            (
                400,
                &burst,
                "Error:checksum mismatch, Last Line: 3\nResend: 4\nok\nok N2 P14 B2\nok N3 P13 B3\n",
            ),
            (500, &numbered(4, "G1 X4"), "ok N4 P12 B3\n"),
        ],
    );
    let stats = board.stats();
    assert_eq!((stats.checksum_errors, stats.resends_asked), (1, 1));
    assert_eq!((stats.lines_received, stats.lines_accepted), (5, 4));
}

#[test]
fn fact_1_with_bytes_at_the_speed_of_the_line_the_stale_lines_are_refused_one_by_one() {
    let mut board = board(|c| c.baud = 250_000, "");
    let good = [numbered(1, "G1 X1"), numbered(2, "G1 X2")].concat();
    let bad = numbered(3, "G1 X3").replace("X3", "X9");
    let stale = numbered(4, "G1 X4");
    let input = [good, bad, stale].concat();
    check(
        &mut board,
        &[(
            300,
            &input,
            "ok\nok\nError:checksum mismatch, Last Line: 2\nResend: 3\nok\n\
             Error:Line Number is not Last Line Number+1, Last Line: 2\nResend: 3\nok\n",
        )],
    );
}

#[test]
fn fact_2_a_repeat_of_the_last_two_is_dropped_without_a_word() {
    let mut board = plain();
    let line = |n| numbered(n, "G1 X1");
    let transcript: Vec<(u64, String, &str)> = vec![
        (300, [line(1), line(2), line(3)].concat(), "ok\nok\nok\n"),
        (400, line(3), ""),
        (500, line(2), ""),
        (600, line(1), "Error:Line Number is not Last Line Number+1, Last Line: 3\nResend: 4\nok\n"),
        (700, line(4), "ok\n"),
    ];
    let borrowed: Vec<_> = transcript.iter().map(|(t, i, e)| (*t, i.as_str(), *e)).collect();
    check(&mut board, &borrowed);
    let stats = board.stats();
    assert_eq!((stats.repeats_dropped, stats.lines_out_of_order), (2, 1));
    assert_eq!(stats.digest_lines, 4);
}

#[test]
fn fact_3_a_line_whose_n_is_damaged_runs_as_unknown_and_the_gap_shows_a_line_later() {
    let mut board = plain();
    let damaged = numbered(1, "G1 X1").replace('N', "X");
    check(
        &mut board,
        &[
            (300, &damaged, "echo:Unknown command: \"X1 G1 X1\"\nok\n"),
            (
                400,
                &numbered(2, "G1 X2"),
                "Error:Line Number is not Last Line Number+1, Last Line: 0\nResend: 1\nok\n",
            ),
        ],
    );
    assert_eq!(board.stats().unknown_commands, 1);
}

#[test]
fn fact_4_empty_lines_long_lines_backslashes_and_lower_case() {
    let mut board = plain();
    let framed = |n, bytes| {
        (70..90)
            .map(|x| numbered(n, &format!("M117 {}", "x".repeat(x))))
            .find(|line| line.len() - 1 == bytes)
            .unwrap()
    };
    let (fits, long) = (framed(1, 95), framed(2, 96));
    let no_checksum = "Error:No Checksum with line number, Last Line: 1\nResend: 2\nok\n";
    let mismatch = "Error:checksum mismatch, Last Line: 1\nResend: 2\nok\n";
    check(
        &mut board,
        &[
            (300, "\n\r\n;only a comment\n", ""),
            (400, &fits, "ok\n"),
            (500, &long, mismatch),
            (600, &numbered(2, &"x".repeat(200)), no_checksum),
            (700, &numbered(2, "M117 a\\b"), mismatch),
            (800, &numbered(2, "G1 X1 ; c"), no_checksum),
            (900, "g1 x1\n", "echo:Unknown command: \"g1 x1\"\nok\n"),
            (1000, "N2 G1 X1\n", no_checksum),
            (1100, "  \n", "echo:Unknown command: \"\"\nok\n"),
        ],
    );
}

#[test]
fn fact_5_temperatures_ride_on_an_ok_without_number() {
    let mut board = board(|c| c.advanced_ok = true, "");
    check(
        &mut board,
        &[
            (300, "M105\n", "ok T:22.00 /0.00 B:22.00 /0.00 @:0 B@:0\n"),
            (400, &numbered(1, "M105"), "ok T:22.00 /0.00 B:22.00 /0.00 @:0 B@:0\n"),
            (500, "G92 E0\n", "X:0.00 Y:0.00 Z:0.00 E:0.00 Count X:0 Y:0 Z:0\nok P15 B3\n"),
        ],
    );
}

#[test]
fn fact_6_boot_auto_report_and_the_lines_of_a_wait_for_heat() {
    let config = Config { dtr_reset: true, ..Config::default() };
    let mut board = Firmware::new(config, Faults::default());
    assert_eq!(output(&mut board, 199), "");
    let boot = output(&mut board, 300);
    assert!(boot.starts_with("start\nPowerUp\nMarlin 2.1.2.1\n\necho:"), "{boot}");
    let t = " T:22.00 /0.00 B:22.00 /0.00 @:0 B@:0\n";
    let busy = "echo:busy: processing\n";
    // Reports at 3, 5 and 7 s; the pause is from 4 s on.
    check(&mut board, &[(1000, "M155 S2\n", &format!("ok\n{t}")), (4000, "G4 S3.5\n", "")]);
    assert_eq!(output(&mut board, 9000), format!("{t}{busy}{t}ok\n"));
}

#[test]
fn fact_6_a_wait_for_heat_counts_down() {
    let mut board = board(|c| c.speed = 20.0, "");
    check(&mut board, &[(300, "M113 S0\nM190 S30\n", "ok\n")]);
    let said = output(&mut board, 5000);
    // 8 °C take the bed 16 s, 0.8 s of ours; then 10 s within the window.
    assert_eq!(said, " T:22.00 /0.00 B:30.00 /30.00 @:0 B@:9 W:6\nok\n");
    let stats = board.stats();
    assert_eq!((stats.bed_c, stats.bed_target_c), (30.0, 30.0));
}

#[test]
fn fact_7_every_form_of_m110_and_m999() {
    let mut board = plain();
    check(
        &mut board,
        &[
            (300, "M110 N77\n", "ok\n"),
            (400, &numbered(78, "G90"), "ok\n"),
            (500, "N0 M110 N0*125\n", "ok\n"),
            (600, &numbered(1, "G90"), "ok\n"),
            (700, "N-1 M110 N-1*125\n", "ok\n"),
            (800, &numbered(0, "G90"), "ok\n"),
            (900, "M110\n", "ok\n"),
            (1000, "M999\n", "Resend: 1\nok\nok\n"),
        ],
    );
}

#[test]
fn fact_7_a_host_must_wait_for_the_ok_of_m110() {
    let mut board = plain();
    let burst = ["N0 M110 N0*125\n", &numbered(1, "G90"), &numbered(2, "G90")].concat();
    let later = numbered(3, "G90");
    check(
        &mut board,
        &[
            (300, &burst, "ok\nok\nok\n"),
            (400, &later, "Error:Line Number is not Last Line Number+1, Last Line: 0\nResend: 1\nok\n"),
        ],
    );
}

#[test]
fn fact_8_without_an_emergency_parser_m112_waits_behind_the_window() {
    let slow = "G4 S1\nG4 S1\nG4 S1\nG4 S1\nG4 S1\n";
    let kill = "Error:Printer halted. kill() called!\n";
    let mut with = plain();
    check(&mut with, &[(300, slow, ""), (400, "M112\n", kill), (500, "M105\n", "")]);
    let mut without = board(|c| c.emergency_parser = false, "");
    check(&mut without, &[(300, slow, ""), (400, "M112\n", "")]);
    // It is read when the queue has room for it: two of the pauses later.
    assert_eq!(output(&mut without, 2290), "ok\n");
    assert_eq!(output(&mut without, 4000), format!("ok\n{kill}"));
    assert_eq!(without.stats().kills, 1);
}

#[test]
fn fact_9_m108_ends_a_wait_and_m410_drops_the_moves() {
    let mut board = plain();
    check(
        &mut board,
        &[
            (300, "M113 S0\nM109 S200\n", "ok\n"),
            (400, "M108\n", "ok\nok\n"),
            (500, "G1 X100 F600\nM400\n", "ok\n"),
            (600, "M410\n", "ok\nok\n"),
        ],
    );
    assert!(board.stats().moving_s < 0.2);
}
