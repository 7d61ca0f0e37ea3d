//! The board on a virtual clock: what goes in at which time, what comes out.
use super::faults::Faults;
use super::*;

const MS: u64 = 1_000_000;

/// A line with its number and checksum, made here and not by the sender.
fn numbered(n: i64, command: &str) -> String {
    let text = format!("N{n} {command}");
    let sum = text.bytes().fold(0u8, |sum, b| sum ^ b);
    format!("{text}*{sum}\n")
}

/// A board that has booted (at 200 ms) and whose first words were read.
fn board(change: impl FnOnce(&mut Config), faults: &str) -> Firmware {
    let mut config = Config {
        baud: 0,
        ..Config::default()
    };
    change(&mut config);
    let mut board = Firmware::new(config, Faults::parse(faults).unwrap());
    output(&mut board, 250);
    board
}

fn plain() -> Firmware {
    board(|_| {}, "")
}

fn output(board: &mut Firmware, at_ms: u64) -> String {
    let mut out = Vec::new();
    board.advance(at_ms * MS);
    board.take_output(&mut out);
    String::from_utf8_lossy(&out).into_owned()
}

/// Each input at its time (ms), and everything that was said by the next; the
/// last output is read 10 ms after the last input.
fn check(board: &mut Firmware, transcript: &[(u64, &str, &str)]) {
    for (at, &(ms, input, expect)) in transcript.iter().enumerate() {
        board.receive(ms * MS, input.as_bytes());
        let until = transcript.get(at + 1).map_or(ms + 10, |next| next.0 - 1);
        assert_eq!(output(board, until), expect, "after {input:?} at {ms} ms");
    }
}

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
        (
            600,
            line(1),
            "Error:Line Number is not Last Line Number+1, Last Line: 3\nResend: 4\nok\n",
        ),
        (700, line(4), "ok\n"),
    ];
    let borrowed: Vec<_> = transcript
        .iter()
        .map(|(t, i, e)| (*t, i.as_str(), *e))
        .collect();
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
            (
                400,
                &numbered(1, "M105"),
                "ok T:22.00 /0.00 B:22.00 /0.00 @:0 B@:0\n",
            ),
            (500, "G92 E0\n", "ok P15 B3\n"),
        ],
    );
}

#[test]
fn fact_6_boot_auto_report_and_the_lines_of_a_wait_for_heat() {
    let config = Config {
        dtr_reset: true,
        ..Config::default()
    };
    let mut board = Firmware::new(config, Faults::default());
    assert_eq!(output(&mut board, 199), "");
    let boot = output(&mut board, 300);
    assert!(
        boot.starts_with("start\nPowerUp\nMarlin 2.1.2.1\n\necho:"),
        "{boot}"
    );
    let t = " T:22.00 /0.00 B:22.00 /0.00 @:0 B@:0\n";
    let busy = "echo:busy: processing\n";
    // Reports at 3, 5 and 7 s; the pause is from 4 s on.
    check(
        &mut board,
        &[
            (1000, "M155 S2\n", &format!("ok\n{t}")),
            (4000, "G4 S3.5\n", ""),
        ],
    );
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
            (
                400,
                &later,
                "Error:Line Number is not Last Line Number+1, Last Line: 0\nResend: 1\nok\n",
            ),
        ],
    );
}

#[test]
fn fact_8_without_an_emergency_parser_m112_waits_behind_the_window() {
    let slow = "G4 S1\nG4 S1\nG4 S1\nG4 S1\nG4 S1\n";
    let kill = "Error:Printer halted. kill() called!\n";
    let mut with = plain();
    check(
        &mut with,
        &[(300, slow, ""), (400, "M112\n", kill), (500, "M105\n", "")],
    );
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
    assert!(
        !said.contains("ok"),
        "a starting board hears nothing: {said}"
    );
    let stats = board.stats();
    assert_eq!(
        (stats.deaf_bytes, stats.nozzle_target_c, stats.boots),
        (5, 0.0, 2)
    );
    check(&mut board, &[(1100, &numbered(1, "G90"), "ok\n")]);
}

#[test]
fn reports_say_what_marlin_says() {
    let mut board = plain();
    check(
        &mut board,
        &[
            (300, "G1 X10.5 Y2 Z.3 F6000\n", "ok\n"),
            (
                400,
                "M114\n",
                "X:10.50 Y:2.00 Z:0.30 E:0.00 Count X:840 Y:160 Z:120\nok\n",
            ),
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
    assert!(
        identity.starts_with("FIRMWARE_NAME:Marlin 2.1.2.1 "),
        "{identity}"
    );
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
    assert!(
        (10_000..10_200).contains(&real) && (1_000..1_040).contains(&fast),
        "{real} {fast}"
    );
}

#[test]
fn scripted_faults_happen() {
    let script = "
        [[fault]]
        at_line = 2
        do = 'drop_ok'
        [[fault]]
        at_line = 3
        do = 'resend_without_ok'
        [[fault]]
        at_line = 4
        do = 'hang'
        for_s = 0.5
        [[fault]]
        at_line = 5
        do = 'say'
        text = '//action:pause'
        [[fault]]
        at_line = 6
        do = 'reset'";
    let mut board = board(|_| {}, script);
    let line = |n| numbered(n, "G90");
    let inputs: Vec<_> = [1, 2, 3, 3, 4, 5].iter().map(|&n| line(n)).collect();
    check(
        &mut board,
        &[
            (300, &inputs[0], "ok\n"),
            (310, &inputs[1], ""),
            (
                320,
                &inputs[2],
                "Error:checksum mismatch, Last Line: 2\nResend: 3\n",
            ),
            (330, &inputs[3], "ok\n"),
            (340, &inputs[4], ""),
        ],
    );
    assert_eq!(output(&mut board, 839), "");
    assert_eq!(output(&mut board, 841), "ok\n");
    check(&mut board, &[(850, &inputs[5], "//action:pause\nok\n")]);
    board.receive(900 * MS, line(6).as_bytes());
    let said = output(&mut board, 1200);
    assert!(said.starts_with("start\n Brown out Reset\n"), "{said}");
    check(
        &mut board,
        &[(
            1300,
            &line(7),
            "Error:Line Number is not Last Line Number+1, Last Line: 0\nResend: 1\nok\n",
        )],
    );
}

#[test]
fn a_hang_up_is_handed_on_and_a_kill_says_why() {
    let script = "
        [[fault]]
        at_s = 0.5
        do = 'hang_up'
        for_s = 2
        [[fault]]
        at_s = 1
        do = 'kill'
        text = 'Thermal Runaway, system stopped! Heater_ID: 0'";
    let mut board = board(|_| {}, script);
    board.advance(499 * MS);
    assert_eq!(board.take_hang_up(), None);
    assert_eq!(board.deadline_ns(), Some(500 * MS));
    board.advance(500 * MS);
    assert_eq!(board.take_hang_up(), Some(2000 * MS));
    assert_eq!(board.take_hang_up(), None);
    assert_eq!(
        output(&mut board, 1000),
        "Error:Thermal Runaway, system stopped! Heater_ID: 0\nError:Printer halted. kill() called!\n"
    );
}

#[test]
fn m85_halts_a_board_that_is_left_alone() {
    let mut board = plain();
    check(
        &mut board,
        &[
            (300, "M85 S10\n", "ok\n"),
            (400, "M113 S0\nG4 S30\n", "ok\n"),
        ],
    );
    assert_eq!(output(&mut board, 30_500), "ok\n", "a pause is activity");
    assert_eq!(output(&mut board, 40_300), "");
    let said = output(&mut board, 40_500);
    assert!(said.starts_with("Error:!! KILLED"), "{said}");
}

#[test]
fn m110_ahead_counts_lost_lines_and_back_counts_repeats() {
    let mut board = plain();
    for n in 1..=5 {
        board.receive((300 + n) * MS, numbered(n as i64, "G90").as_bytes());
    }
    board.receive(400 * MS, b"M110 N9\n");
    board.receive(410 * MS, numbered(10, "G91").as_bytes());
    board.receive(420 * MS, b"M110 N3\n");
    board.receive(430 * MS, numbered(4, "G90").as_bytes());
    board.advance(500 * MS);
    let stats = board.stats();
    assert_eq!((stats.lines_lost, stats.lines_repeated), (4, 1));
    let mut digest = stats::Digest::default();
    for line in ["G90", "G90", "G90", "G90", "G90", "G91", "G90"] {
        digest.add(line.as_bytes());
    }
    assert_eq!((stats.digest, stats.digest_lines), (digest.hex(), 7));
}

#[test]
fn a_host_sees_nothing_between_deadlines() {
    // Advancing only at the deadlines gives the same words as advancing often.
    let input = "M155 S1\nG1 X5 F300\nG1 X10\nM400\nM104 S50\nM190 S25\nG28\nG4 P100\nM105\n";
    let often = {
        let mut board = board(
            |c| {
                c.baud = 115_200;
                c.speed = 5.0
            },
            "",
        );
        board.receive(300 * MS, input.as_bytes());
        (300..20_000)
            .map(|ms| output(&mut board, ms))
            .collect::<String>()
    };
    let mut board = board(
        |c| {
            c.baud = 115_200;
            c.speed = 5.0
        },
        "",
    );
    board.receive(300 * MS, input.as_bytes());
    let (mut said, mut wakes) = (Vec::new(), 0);
    while let Some(at) = board.deadline_ns().filter(|at| *at < 20_000 * MS) {
        board.advance(at);
        board.take_output(&mut said);
        wakes += 1;
    }
    assert_eq!(String::from_utf8(said).unwrap(), often);
    assert!(wakes < 300, "{wakes} wake-ups for {} bytes", often.len());
}

proptest::proptest! {
    #[test]
    fn any_bytes_at_any_time_neither_panic_nor_grow(
        pieces in proptest::collection::vec((0u64..50, proptest::collection::vec(proptest::prelude::any::<u8>(), 0..300)), 0..30),
        baud in proptest::sample::select(vec![0u32, 9600, 250_000]),
    ) {
        let mut board = board(|c| c.baud = baud, "[random]\ncorrupt_line = 0.2");
        let mut now = 300 * MS;
        for (later, bytes) in pieces {
            now += later * MS;
            let room = board.room().min(bytes.len());
            board.receive(now, &bytes[..room]);
            assert!(board.queue.len() <= 4 && board.planner.free() <= 15);
        }
        output(&mut board, 100_000);
        board.stats();
    }

    #[test]
    fn commands_of_any_numbers_never_hold_the_clock(
        lines in proptest::collection::vec("(G[0-9]{1,2}|M[0-9]{1,3})( ?[XYZEFSPIJR]-?[0-9]{0,9}(\\.[0-9])?){0,5}", 1..40),
    ) {
        let mut board = board(|c| c.speed = 1000.0, "");
        let mut now = 300 * MS;
        for line in lines {
            now += 10 * MS;
            board.receive(now, format!("{line}\n").as_bytes());
        }
        output(&mut board, now / MS + 1000);
        assert!(board.stats().extruded_mm.is_finite());
    }
}
