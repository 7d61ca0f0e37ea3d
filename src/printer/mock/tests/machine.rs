//! Buffers, resets, reports, and the planner's accounts.
use super::*;

#[test]
fn a_small_receive_buffer_overflows_and_a_window_within_it_does_not() {
    let job: String = (0..40).map(|n| format!("G1 X{} F60\n", n % 10)).collect();
    let mut board = board(|c| c.baud = 250_000, "");
    board.receive(300 * MS, job.as_bytes());
    board.advance(400 * MS);
    let stats = board.stats();
    assert!(stats.overflow_bytes > 0);
    assert_eq!(stats.rx_bytes_most, 127);
    assert_eq!((stats.planner_most, stats.queue_most), (15, 4));
}

#[test]
fn opening_the_port_resets_a_board_with_dtr() {
    let mut board = board(|c| c.dtr_reset = true, "");
    check(&mut board, &[(300, &numbered(1, "M104 S200"), "ok\n")]);
    board.connect(500 * MS);
    board.receive(550 * MS, b"M105\n");
    let said = output(&mut board, 1000);
    assert!(said.starts_with("start\n External Reset\n"), "{said}");
    assert!(!said.contains("ok"), "a starting board hears nothing: {said}");
    let stats = board.stats();
    assert_eq!((stats.deaf_bytes, stats.nozzle_target_c, stats.boots), (5, 0.0, 2));
    check(&mut board, &[(1100, &numbered(1, "G90"), "ok\n")]);
}

#[test]
fn reports_say_what_marlin_says() {
    let mut board = plain();
    check(
        &mut board,
        &[
            (300, "G1 X10.5 Y2 Z.3 F6000\n", "ok\n"),
            (400, "M114\n", "X:10.50 Y:2.00 Z:0.30 E:0.00 Count X:840 Y:160 Z:120\nok\n"),
            (500, "M118 E1 hello\n", "echo:hello\nok\n"),
            (600, "M118 A1 action:pause\n", "//action:pause\nok\n"),
            (700, "M117 ok ok\n", "ok\n"),
            (800, "M113\n", "echo:M113 S2\nok\n"),
            (900, "G1 E5\n", "echo: cold extrusion prevented\nok\n"),
            (1000, "M302 P1\nG1 E9\n", "ok\nok\n"),
        ],
    );
    let identity = {
        board.receive(1100 * MS, b"M115\n");
        output(&mut board, 1150)
    };
    assert!(identity.starts_with("FIRMWARE_NAME:Marlin 2.1.2.1 "), "{identity}");
    assert!(identity.contains("\nCap:EMERGENCY_PARSER:1\n") && identity.ends_with("\nok\n"));
    let stats = board.stats();
    assert_eq!((stats.cold_extrusions, stats.extruded_mm), (1, 4.0));
}

#[test]
fn m0_asks_and_waits_for_the_user() {
    let mut board = plain();
    check(
        &mut board,
        &[(
            300,
            "M0\n",
            "//action:prompt_end\n//action:prompt_begin M0 Stop\n//action:prompt_button Continue\n//action:prompt_show\n",
        )],
    );
    assert_eq!(output(&mut board, 3000), "echo:busy: paused for user\n");
    board.receive(3000 * MS, b"M876 S0\n");
    assert_eq!(output(&mut board, 3100), "ok\nok\n");
}

#[test]
fn the_planners_empty_share_is_the_senders_gaps_alone() {
    let mut board = plain();
    // 10 mm at 10 mm/s: 1 s and the ramps; then G4, which is no gap of the sender.
    check(&mut board, &[(1000, "G1 X10 F600\n", "ok\n")]);
    let took = board.planner.next_end_ns().unwrap() - 1000 * MS;
    board.advance(5_000 * MS);
    assert_eq!(board.stats().planner_empty_s, 0.0, "the job may have ended");
    board.receive(5_000 * MS, b"G4 S3\n");
    output(&mut board, 8_000);
    board.receive(10_000 * MS, b"G1 X20\n");
    board.advance(20_000 * MS);
    let stats = board.stats();
    let gap_s = 9.0 - took as f64 / 1e9 - 3.0;
    assert!((stats.planner_empty_s - gap_s).abs() < 1e-3, "{stats:?}");
    assert!((stats.moving_s - 2.0 * took as f64 / 1e9).abs() < 1e-6);
    assert!((stats.planner_empty_share - gap_s / (gap_s + stats.moving_s)).abs() < 1e-9);
}

#[test]
fn a_faster_machine_has_the_same_line() {
    let run = |speed: f64| {
        let mut board = board(
            |c| {
                c.speed = speed;
                c.baud = 250_000
            },
            "",
        );
        board.receive(300 * MS, b"G1 X100 F6000\nG4 S9\nM400\n");
        let mut at = 300;
        while board.stats().lines_accepted < 3 || !board.queue.is_empty() {
            at += 1;
            board.advance(at * MS);
        }
        at - 300
    };
    let (real, fast) = (run(1.0), run(10.0));
    assert!((10_000..10_200).contains(&real) && (1_000..1_040).contains(&fast), "{real} {fast}");
}
