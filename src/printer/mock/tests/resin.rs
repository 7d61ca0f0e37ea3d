//! A resin printer: pulses of light to the nanosecond, macros, the plate and its part.
use super::*;

/// What a host sends for a layer once the plate is there: a settling time, the light for so
/// many ms, and words at both ends.
fn exposure(ms: u64) -> String {
    format!("M400\nM118 Z_move_comp\nG4 P100\nM106 S255\nG4 P{ms}\nM107\nM118 light_off\n")
}

fn machine(light: LightPin) -> Machine {
    Machine::resin(ResinMachine { homes_up: true, z_max_mm: 150.0, light })
}

/// A resin printer that was homed up and stands at 5 mm, at some time before 60 s.
fn printer(light: LightPin, change: impl FnOnce(&mut Config), faults: &str) -> Firmware {
    let change = |c: &mut Config| {
        c.machine = machine(light);
        change(c);
    };
    let mut board = board(change, faults);
    board.receive(300 * MS, b"M113 S0\nG28\nG1 Z5 F1200\nM400\n");
    output(&mut board, 60_000);
    assert_eq!(board.stats().true_position_mm, [0.0, 0.0, 5.0]);
    board
}

fn fan() -> Firmware {
    printer(LightPin::Fan, |_| {}, "")
}

/// How long each pulse that has ended was, ns.
fn lengths_ns(board: &Firmware) -> Vec<u64> {
    board.light().iter().filter_map(|pulse| Some(pulse.end?.at_ns - pulse.begin.at_ns)).collect()
}

fn numbered_lines(first: i64, commands: &str) -> String {
    commands.lines().zip(first..).map(|(line, n)| numbered(n, line)).collect()
}

#[test]
fn a_pulse_lasts_as_long_as_its_pause_and_two_oks() {
    // Baud, speed, pause in ms, what the pulse lasts in ns. The board sends `ok` before it goes
    // on, 120 us at 250,000 baud: after M106, and after the pause before M107.
    let check = |baud: u32, speed: f64, ms: u64, expect_ns: u64| {
        let change = |c: &mut Config| (c.baud, c.speed) = (baud, speed);
        let mut board = printer(LightPin::Fan, change, "");
        board.receive(60_000 * MS, exposure(ms).as_bytes());
        let said = output(&mut board, 120_000);
        assert!(said.contains("Z_move_comp\nok\n") && said.contains("light_off\n"), "{said}");
        assert_eq!(lengths_ns(&board), [expect_ns], "{baud} {speed} {ms}");
        let pulse = board.light()[0];
        assert_eq!((pulse.begin.z_mm, pulse.power), (5.0, 255));
        let lasts_s = pulse.machine_s(speed).unwrap();
        assert!((lasts_s - expect_ns as f64 * speed / 1e9).abs() < 1e-12);
        let stats = board.stats();
        assert_eq!((stats.light_on, stats.light_pulses, stats.light_moved), (false, 1, 0));
        assert_eq!((stats.light_s, stats.light_longest_s), (lasts_s, lasts_s));
    };
    check(0, 1.0, 2500, 2500 * MS);
    check(0, 40.0, 2500, 2500 * MS / 40);
    check(250_000, 1.0, 2500, 2500 * MS + 240_000);
    check(250_000, 40.0, 2500, 2500 * MS / 40 + 240_000);
}

#[test]
fn a_pause_that_ends_with_a_note_is_no_longer_for_it() {
    for every in [1, 2] {
        let mut board = printer(LightPin::Fan, |c| c.baud = 250_000, "");
        board.receive(60_000 * MS, format!("M113 S{every}\n{}", exposure(4000)).as_bytes());
        let said = output(&mut board, 70_000);
        assert!(said.contains("busy: processing"), "{said}");
        assert_eq!(lengths_ns(&board), [4000 * MS + 240_000]);
    }
}

#[test]
fn a_host_sees_the_same_pulses_however_late_the_clock_is_told() {
    let job = format!("{}G1 Z10 F300\nG1 Z5.05 F300\n{}", exposure(1234), exposure(777));
    let run = |steps: &mut dyn FnMut(&mut Firmware)| {
        let mut board = printer(LightPin::Fan, |c| (c.baud, c.speed) = (115_200, 3.0), "");
        // More than the queue holds waits in the receive buffer and on the wire.
        board.receive(60_000 * MS, &job.as_bytes()[..120]);
        board.receive(61_000 * MS, &job.as_bytes()[120..]);
        steps(&mut board);
        board.advance(120_000 * MS);
        assert_eq!(board.light().len(), 2);
        board.light().to_vec()
    };
    let at_once = run(&mut |_| {});
    let often = run(&mut |board| (610_000..700_000).for_each(|at| board.advance(at * MS / 10)));
    let when_due = run(&mut |board| {
        while let Some(at_ns) = board.deadline_ns() {
            board.advance(at_ns);
            board.take_output(&mut Vec::new());
        }
    });
    assert_eq!(at_once, often);
    assert_eq!(at_once, when_due);
}

#[test]
fn m107_that_was_damaged_and_came_again_in_time_ends_the_pulse_exactly() {
    let script = "[[fault]]\nat_line = 5\ndo = 'corrupt_line'";
    let mut board = printer(LightPin::Fan, |_| {}, script);
    let layer = numbered_lines(1, "G4 P100\nM106 S255\nG4 P3000\nM118 lit\nM107\nM118 light_off");
    board.receive(60_000 * MS, layer.as_bytes());
    // The queue of 4 takes M107 once the first pause is over.
    let said = output(&mut board, 61_000);
    assert!(said.contains("Resend: 5\n") && board.stats().light_on, "{said}");
    board.receive(61_000 * MS, numbered_lines(5, "M107\nM118 light_off").as_bytes());
    let said = output(&mut board, 64_000);
    assert!(said.contains("light_off\n"), "{said}");
    assert_eq!((lengths_ns(&board), board.stats().checksum_errors), (vec![3000 * MS], 1));
}

#[test]
fn a_kill_leaves_a_fan_on_and_switches_a_cutter_off() {
    let check = |light, on: &str, stays: bool| {
        let mut board = printer(light, |_| {}, "[[fault]]\nat_s = 70\ndo = 'reset'");
        board.receive(60_000 * MS, format!("{on}\nG4 P60000\n").as_bytes());
        board.receive(61_000 * MS, b"M112\n");
        board.advance(65_000 * MS);
        assert_eq!((board.stats().light_on, board.stats().kills), (stays, 1), "{on}");
        board.advance(71_000 * MS);
        let end_ms = if stays { 70_000 } else { 61_000 };
        assert!(!board.stats().light_on, "a start switches both off");
        assert_eq!(lengths_ns(&board), [(end_ms - 60_000) * MS], "{on}");
    };
    check(LightPin::Fan, "M106", true);
    check(LightPin::Fan, "M106 P0 S128", true);
    check(LightPin::Cutter, "M3 S255", false);
    check(LightPin::Cutter, "M4", false);
}

#[test]
fn m85_and_a_power_cut_end_as_a_kill_and_a_start() {
    let mut board = fan();
    board.receive(60_000 * MS, b"M85 S5\nM106\n");
    board.advance(80_000 * MS);
    assert!(board.stats().kills == 1 && board.stats().light_on);
    let cut = "[[fault]]\nat_s = 61\ndo = 'power_cut'\nfor_s = 2\nsag_mm = 1";
    let mut board = printer(LightPin::Fan, |_| {}, cut);
    board.receive(60_000 * MS, b"M106\n");
    board.advance(70_000 * MS);
    assert_eq!(lengths_ns(&board), [1000 * MS]);
    assert_eq!((board.stats().true_position_mm[2], board.stats().part_top_mm), (4.0, 5.0));
    // Up out of the film is no crash, and homing up is none.
    board.receive(70_000 * MS, b"G91\nG1 Z10 F600\nG90\nG28\nG1 Z5.05 F1200\nM400\n");
    board.advance(120_000 * MS);
    assert_eq!((board.stats().crashes, board.stats().moved_cold), (0, 0));
    assert!((board.stats().true_position_mm[2] - 5.05).abs() < 1e-9);
}

#[test]
fn a_cutter_is_known_where_the_light_hangs_on_it_and_waits_for_moves() {
    let mut board = fan();
    let unknown = "echo:Unknown command: \"M3 S255\"\nok\n";
    check(&mut board, &[(60_000, "M3 S255\n", unknown), (60_100, "M106 P1\n", "ok\n")]);
    assert!(!board.stats().light_on);
    let mut board = printer(LightPin::Cutter, |_| {}, "");
    board.receive(60_000 * MS, b"G1 Z6 F60\nM3 S200\nG4 P500\nM5\nM106\n");
    board.advance(62_000 * MS);
    let pulse = board.light()[0];
    assert_eq!((pulse.begin.z_mm, pulse.power, lengths_ns(&board)), (6.0, 200, vec![500 * MS]));
    assert_eq!((board.stats().light_on, board.stats().light_moved), (false, 0));
    // A fan waits for nothing: here it comes on within a move, and the move is seen.
    let mut board = fan();
    board.receive(60_000 * MS, b"G1 Z15 F60\nG4 P500\nM107\n");
    board.receive(60_100 * MS, b"G1 Z5\n");
    board.receive(70_000 * MS, b"M400\n");
    board.advance(90_000 * MS);
    board.receive(90_000 * MS, b"G1 Z15 F60\nM106\nM400\nM107\n");
    board.advance(95_000 * MS);
    assert_eq!(board.light()[0].begin.z_mm, 5.0);
    board.advance(101_000 * MS);
    assert_eq!((board.light()[0].end.unwrap().z_mm, board.stats().light_moved), (15.0, 1));
}

#[test]
fn macros_run_within_their_command() {
    let mut board = fan();
    check(
        &mut board,
        &[(60_000, "M810 G4 P100|M106 S255|G4 P2000|M107|M118 light_off\n", "ok\n"), (60_100, "M810\n", "")],
    );
    assert_eq!(output(&mut board, 62_199), "");
    assert_eq!(output(&mut board, 62_201), "light_off\nok\n");
    assert_eq!(lengths_ns(&board), [2000 * MS]);
    let long = format!("M811 {}\n", "x".repeat(51));
    check(
        &mut board,
        &[
            (63_000, "M819\n", "ok\n"),
            (63_100, &long, "Error:Macro too long.\nok\n"),
            (63_200, "M811 M118 a|M812|M118 c\nM812 M118 b\n", "ok\nok\n"),
            (63_300, "M811\nM118 d\n", "a\nb\nc\nok\nd\nok\n"),
            // One that runs itself comes to an end.
            (63_400, "M813 M813\nM813\n", "ok\nok\n"),
            (63_500, "M820\n", "echo:Unknown command: \"M820\"\nok\n"),
        ],
    );
    let said = |change: fn(&mut Config)| {
        let mut board = super::board(change, "");
        board.receive(300 * MS, b"M810 M118 a\n");
        output(&mut board, 400)
    };
    assert_eq!(said(|_| {}), "echo:Unknown command: \"M810 M118 a\"\nok\n");
    assert_eq!(said(|c| c.machine.macros = true), "ok\n");
}

#[test]
fn at_250_000_baud_a_macro_is_exact_to_the_nanosecond() {
    let mut board = printer(LightPin::Fan, |c| c.baud = 250_000, "");
    board.receive(60_000 * MS, b"M810 M106|G4 P2000|M107\nM810\n");
    board.advance(63_000 * MS);
    assert_eq!(lengths_ns(&board), [2000 * MS]);
}

#[test]
fn a_kill_and_m410_end_a_macro() {
    let mut board = fan();
    board.receive(60_000 * MS, b"M810 M106|G1 Z100 F60|M400|M107|M118 b\nM810\n");
    board.receive(61_000 * MS, b"M410\n");
    assert!(output(&mut board, 62_000).contains("b\nok\n"));
    assert_eq!(lengths_ns(&board), [1000 * MS]);
    board.receive(62_000 * MS, b"M810\n");
    board.receive(63_000 * MS, b"M112\nM118 c\n");
    assert!(!output(&mut board, 90_000).contains('b'));
    assert!(board.stats().light_on);
}

/// From 5 mm, with a layer cured there: so many crashes.
fn crashes(commands: &str) -> u64 {
    let mut board = fan();
    board.receive(60_000 * MS, exposure(100).as_bytes());
    output(&mut board, 61_000);
    board.receive(61_000 * MS, commands.as_bytes());
    output(&mut board, 120_000);
    board.stats().crashes
}

#[test]
fn the_part_is_not_to_be_pressed_into_the_film() {
    assert_eq!(crashes("G1 Z10 F1200\nG1 Z5.05\nM106\nM107\nG1 Z12\nG1 Z5.1\n"), 0);
    assert_eq!(crashes("G1 Z4.99 F600\n"), 0);
    assert_eq!(crashes("G1 Z4.9 F600\n"), 1);
    assert_eq!(crashes("G28\nG1 Z5.05 F1200\n"), 0);
    // What the board believes is another matter.
    assert_eq!(crashes("G92 Z9\nG1 Z8 F600\n"), 1);
    // Soft endstops cut a move to the travel; without them it ends at the frame.
    assert_eq!(crashes("G1 Z500 F1200\n"), 0);
    assert_eq!(crashes("M211 S0\nG1 Z151 F1200\n"), 1);
}

#[test]
fn homing_goes_where_the_switch_is() {
    let run = |homes_up: bool, commands: &str| {
        let change = |c: &mut Config| {
            c.machine = Machine::resin(ResinMachine { homes_up, z_max_mm: 150.0, light: LightPin::Fan });
        };
        let mut board = board(change, "");
        board.receive(300 * MS, commands.as_bytes());
        board.advance(100_000 * MS);
        let stats = board.stats();
        (stats.position_mm, stats.true_position_mm, stats.crashes)
    };
    let at = |z_mm: f64| [0.0, 0.0, z_mm];
    assert_eq!(run(true, "G28\n"), (at(150.0), at(150.0), 0));
    assert_eq!(run(true, "G28 X\nG1 X5 Y5 E5 Z3\nG2 X1 I1\nG92 X7\n"), (at(3.0), at(3.0), 0));
    assert_eq!(run(true, "G1 Z3\nM106\nM107\nG28 Z\nG92 Z10\n"), (at(10.0), at(150.0), 0));
    assert_eq!(run(false, "G1 Z3\nG28\n"), (at(0.0), at(0.0), 0));
    assert_eq!(run(false, "G1 Z3\nM106\nM107\nG1 Z5\nG28 Z\n"), (at(0.0), at(0.0), 1));
    // With the workspace shifted the endstops are where they were.
    assert_eq!(run(true, "G28\nG92 Z0\nG1 Z50\nG1 Z-20\n"), (at(-20.0), at(130.0), 0));
}

#[test]
fn a_part_that_was_taken_off_the_plate_is_no_obstacle() {
    let mut board = fan();
    board.receive(60_000 * MS, b"M106\nM107\nG1 Z4 F600\nM400\n");
    board.advance(62_000 * MS);
    let stats = board.stats();
    assert_eq!((stats.crashes, stats.pressed_in_mm, stats.part_top_mm), (1, 1.0, 5.0));
    board.remove_part();
    board.receive(62_000 * MS, b"G1 Z0.05 F600\nM400\nM106\nM107\n");
    board.advance(65_000 * MS);
    assert!(board.stats().crashes == 1 && (board.stats().part_top_mm - 0.05).abs() < 1e-9);
}

#[test]
fn temperatures_are_told_and_nothing_gets_warm() {
    let mut board = fan();
    let said = "ok\nok\nok T:22.00 /0.00 B:22.00 /0.00 @:0 B@:0\n";
    check(&mut board, &[(60_000, "M104 S200\nM140 S60\nM105\n", said)]);
    assert!(!board.stats().heaters_on);
}

/// The cable is pulled out so many ns after M107 went onto the line at 115,200 baud, and put
/// in again: whether the light went off, and how many bytes had come.
fn cut_at(after_ns: u64) -> (bool, usize) {
    let mut board = printer(LightPin::Fan, |c| c.baud = 115_200, "");
    board.receive(60_000 * MS, b"M106\n");
    board.advance(61_000 * MS);
    let line = numbered(1, "M107");
    board.receive(61_000 * MS, line.as_bytes());
    let unplug = toml::from_str("at_s = 0\ndo = 'unplug'\nfor_s = 0.5").unwrap();
    board.inject(61_000 * MS + after_ns, unplug);
    board.receive(61_100 * MS, b"lost\n");
    board.advance(62_000 * MS);
    let off = !board.stats().light_on;
    // What had come of the line is still there, and the next line is put behind it.
    board.receive(62_000 * MS, b"*\n");
    let received = board.stats().lines_received;
    board.advance(63_000 * MS);
    assert_eq!(board.stats().lines_received, received + 1);
    let byte_ns = 10 * 1_000_000_000 / 115_200;
    (off, ((after_ns / byte_ns) as usize).min(line.len()))
}

proptest::proptest! {
    #[test]
    fn a_line_that_was_cut_at_any_moment_did_not_arrive(after_ns in 0u64..1_200_000) {
        let (off, came) = cut_at(after_ns);
        assert_eq!(off, came == numbered(1, "M107").len(), "{after_ns} ns, {came} bytes");
    }

    #[test]
    fn commands_of_any_numbers_never_hold_a_resin_printers_clock(
        lines in proptest::collection::vec(
            "(G(1|4|28|92)|M(3|5|106|107|211|81[0-2]))( ?[XZEFSP]-?[0-9]{0,12}(\\.[0-9])?){0,3}(\\|M81[0-2]){0,2}",
            1..40,
        ),
        cutter: bool,
    ) {
        let light = if cutter { LightPin::Cutter } else { LightPin::Fan };
        let change = |c: &mut Config| (c.machine, c.speed) = (machine(light), 1000.0);
        let mut board = board(change, "");
        let mut now = 300;
        for line in lines {
            now += 10;
            board.receive(now * MS, format!("{line}\n").as_bytes());
        }
        output(&mut board, now + 1000);
        let mut free_ns = 0;
        for pulse in board.light() {
            assert!(pulse.begin.at_ns >= free_ns && pulse.begin.z_mm.is_finite());
            free_ns = pulse.end.map_or(u64::MAX, |end| end.at_ns);
        }
        assert!(board.stats().light_s.is_finite());
    }
}
