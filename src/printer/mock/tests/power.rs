//! Power, cables and filament: what the board keeps, and where the nozzle really is.
use super::*;

/// Heats without waiting, prints so many squares of 10 mm one above the other at
/// 100, 100, and stands on the last. Commands as a host would number them.
fn tower(layers: u32) -> Vec<String> {
    let mut lines: Vec<String> =
        ["M302 P1", "G28", "G90", "M82", "G1 X100 Y100 F12000"].map(String::from).into();
    for layer in 1..=layers {
        let z = f64::from(layer) * 0.2;
        lines.push(format!("G92 E0\nG1 Z{z:.1} F600"));
        for (at, (x, y)) in [(110, 100), (110, 110), (100, 110), (100, 100)].into_iter().enumerate() {
            lines.push(format!("G1 X{x} Y{y} E{} F3000", at + 1));
        }
    }
    lines.iter().flat_map(|line| line.split('\n').map(String::from).collect::<Vec<_>>()).collect()
}

/// Sends lines one after the other, each when the one before was acknowledged; gives
/// the time at the end, in ms, and stops when the board says nothing more.
fn send(board: &mut Firmware, from_ms: u64, first: i64, lines: &[String]) -> u64 {
    let mut now_ms = from_ms;
    for (at, line) in lines.iter().enumerate() {
        board.receive(now_ms * MS, numbered(first + at as i64, line).as_bytes());
        let mut said = String::new();
        let patience = now_ms + 60_000;
        while !said.contains("ok\n") {
            now_ms += 1;
            said += &output(board, now_ms);
            if now_ms > patience {
                return now_ms;
            }
        }
    }
    now_ms
}

fn words(text: &str) -> Vec<String> {
    text.lines().map(String::from).collect()
}

/// Cuts the power in a tower and takes the job up by `steps`; crashes, cold moves, and
/// the height at which X or Y first moved.
fn after_power_cut(sag_mm: f64, steps: &str) -> (u64, u64, Option<f64>) {
    let mut job = tower(10);
    job.extend(words("M400\nM105"));
    let fault = format!("[[fault]]\nat_line = {}\ndo = 'power_cut'\nfor_s = 1\nsag_mm = {sag_mm}", job.len());
    let mut board = board(|c| c.speed = 100.0, &fault);
    let end_ms = send(&mut board, 300, 1, &job);
    let stats = board.stats();
    assert_eq!((stats.crashes, stats.power_cuts, stats.heaters_on), (0, 1, false));
    assert_eq!(stats.position_mm, [0.0; 3], "it believes that it is at home");
    assert!((stats.true_position_mm[2] - (2.0 - sag_mm)).abs() < 0.05, "{stats:?}");
    send(&mut board, end_ms, 1, &words(steps));
    let stats = board.stats();
    (stats.crashes, stats.moved_cold, stats.first_xy_after_reset_z_mm.map(|z| (z * 100.0).round() / 100.0))
}

#[test]
fn a_resume_after_a_power_cut_is_safe_in_the_right_order_only() {
    let warm = "M302 P1\nM104 S200\nG4 S40\n";
    let good = format!(
        "{warm}G92.9 Z2\nG91\nG1 Z10 F600\nG90\nG28 R0 X Y\nG1 X100 Y100\nG1 Z2\nG1 X110 E1 F3000\nM400"
    );
    assert_eq!(after_power_cut(0.3, &good), (0, 0, Some(11.7)));
    // Aside before up.
    assert!(after_power_cut(0.3, &format!("{warm}G92 Z2\nG28 R0 X Y\nM400")).0 > 0);
    // The whole of G28, from line 1 again: over the part.
    assert!(after_power_cut(0.0, &format!("{warm}G28\nM400")).0 > 0);
    // Cold, the nozzle sticks to the part.
    assert_eq!(after_power_cut(0.0, "G91\nG1 Z10 F600\nM400").1, 1);
}

#[test]
fn a_part_that_was_taken_off_is_no_obstacle() {
    let job = tower(3);
    let mut board = board(|c| c.speed = 100.0, "");
    let end_ms = send(&mut board, 300, 1, &job);
    let end_ms = send(&mut board, end_ms, job.len() as i64 + 1, &words("M400"));
    assert!((board.stats().part_top_mm - 0.6).abs() < 1e-6);
    board.remove_part();
    send(&mut board, end_ms, job.len() as i64 + 2, &job);
    assert_eq!(board.stats().crashes, 0);
}

#[test]
fn the_same_part_has_the_same_digest_however_it_was_printed() {
    let print = |extra: &str, fault: &str| {
        let mut lines = tower(4);
        lines.splice(15..15, words(extra));
        lines.push("M400".into());
        let mut board = board(|c| (c.speed, c.record) = (100.0, true), fault);
        send(&mut board, 300, 1, &lines);
        let stats = board.stats();
        (stats.deposit_digest, stats.executed_digest, stats.deposits, board.take_executed())
    };
    let plain = print("", "");
    let paused = print("G91\nG1 Z5\nG1 X-20\nG1 X20\nG1 Z-5\nG90", "");
    let lost = print("", "[[fault]]\nat_line = 20\ndo = 'drop_byte'");
    assert_eq!((plain.0 == paused.0, plain.1 == paused.1), (true, false));
    assert_eq!(plain.2, 16);
    assert_ne!(plain.0, lost.0, "a line was never sent again");
    let last = plain.3.last().unwrap();
    assert_eq!((last.command.as_str(), last.whole), ("M400", true));
    assert_eq!(plain.3.iter().filter(|e| e.command.contains(" E")).count(), 16 + 4);
}

#[test]
fn what_a_reset_throws_out_of_the_planner_was_never_executed() {
    let mut board = board(|c| c.record = true, "[[fault]]\nat_s = 3\ndo = 'reset'");
    let moves: Vec<String> = (1..=8).map(|n| format!("G1 X{} F600", n * 10)).collect();
    send(&mut board, 300, 1, &moves);
    board.advance(5000 * MS);
    let executed = board.take_executed();
    let whole: Vec<_> = executed.iter().filter(|e| e.whole).map(|e| e.command.as_str()).collect();
    assert_eq!(whole, ["G1 X10 F600", "G1 X20 F600"]);
    let broken = executed.last().unwrap();
    assert!(!broken.whole && broken.number == Some(3), "{broken:?}");
    assert!((20.0..30.0).contains(&broken.at_mm[0]) && broken.at_mm == board.stats().true_position_mm);
    assert_eq!((board.stats().executed, board.stats().lines_accepted), (2, 8));
}

#[test]
fn m410_tells_the_firmware_where_it_stopped() {
    let mut board = plain();
    board.receive(300 * MS, b"G1 X100 F600\nG1 Y50\n");
    board.receive(1300 * MS, b"M410\n");
    board.advance(1400 * MS);
    let stats = board.stats();
    assert!((stats.position_mm[0] - stats.true_position_mm[0]).abs() < 1e-9, "{stats:?}");
    assert!((5.0..15.0).contains(&stats.position_mm[0]) && stats.position_mm[1] == 0.0, "{stats:?}");
}

#[test]
fn a_cable_that_was_out_loses_bytes_and_no_state() {
    let script = "[[fault]]\nat_s = 0.5\ndo = 'unplug'\nfor_s = 2";
    let mut board = board(|c| c.baud = 115_200, script);
    board.receive(300 * MS, format!("{}{}", numbered(1, "M104 S50"), numbered(2, "G1 X100 F600")).as_bytes());
    board.advance(499 * MS);
    board.receive(499 * MS, numbered(3, "G1 X50").as_bytes());
    board.advance(500 * MS);
    assert_eq!((board.take_hang_up(), board.room()), (Some(2000 * MS), 0));
    board.receive(1000 * MS, b"M105\n");
    assert_eq!(output(&mut board, 2400), "", "neither way");
    // Half a line is left in the board: the next line would be glued to it.
    check(&mut board, &[(2600, "\n", "Error:checksum mismatch, Last Line: 2\nResend: 3\nok\n")]);
    check(&mut board, &[(2700, &numbered(3, "G1 X50"), "ok\n")]);
    assert_eq!((board.stats().nozzle_target_c, board.stats().boots), (50.0, 1));
}

#[test]
fn a_cable_that_was_out_may_restart_the_board() {
    let mut board = board(|_| {}, "[[fault]]\nat_s = 0.5\ndo = 'unplug'\nfor_s = 2\nreset = true");
    check(&mut board, &[(300, &numbered(1, "M104 S50"), "ok\n")]);
    assert_eq!(output(&mut board, 2650), "");
    assert!(output(&mut board, 2800).starts_with("start\n External Reset\n"));
    assert_eq!((board.stats().nozzle_target_c, board.stats().boots), (0.0, 2));
}

#[test]
fn power_that_is_off_takes_the_port_along_where_it_feeds_it() {
    let mut board = board(|_| {}, "[[fault]]\nat_s = 1\ndo = 'power_cut'\nfor_s = 3\nunplugs = true");
    board.receive(300 * MS, b"M104 S200\nM140 S60\n");
    board.advance(1000 * MS);
    assert_eq!(board.take_hang_up(), Some(3000 * MS));
    let cut = board.stats();
    board.advance(3900 * MS);
    assert!(board.stats().nozzle_c < cut.nozzle_c, "it cools");
    assert!(output(&mut board, 4300).starts_with("start\nPowerUp\n"));
}

#[test]
fn a_device_that_takes_nothing_gets_its_bytes_later() {
    let mut board = board(|_| {}, "[[fault]]\nat_s = 1\ndo = 'blocked'\nfor_s = 2");
    board.advance(1000 * MS);
    assert_eq!((board.room(), board.deadline_ns()), (0, Some(3000 * MS)));
    board.advance(3000 * MS);
    assert!(board.room() > 0);
    check(&mut board, &[(3100, &numbered(1, "G90"), "ok\n")]);
}

#[test]
fn filament_that_ends_waits_for_a_person_and_no_ok_is_lost_or_added() {
    let mut board = board(|_| {}, "[[fault]]\nat_line = 2\ndo = 'filament_out'");
    let ask = "//action:out_of_filament T0\n//action:paused\necho:Insert filament and press button\n\
               //action:prompt_end\n//action:prompt_begin Nozzle Parked\n//action:prompt_button Continue\n\
               //action:prompt_show\n";
    check(
        &mut board,
        &[
            (300, &numbered(1, "G90"), "ok\n"),
            // The line of the fault is done first.
            (400, &numbered(2, "G91"), &format!("ok\n{ask}")),
            (500, &numbered(3, "G90"), ""),
            (600, "M108\n", "//action:resumed\nok\nok\n"),
        ],
    );
}

#[test]
fn m600_parks_asks_and_goes_on() {
    let mut board = board(|c| c.habits.prompts = false, "");
    check(
        &mut board,
        &[
            (300, "M600\n", "//action:paused\necho:Insert filament and press button\n"),
            (400, "M108\n", "//action:resumed\nok\nok\n"),
        ],
    );
}

#[test]
fn homing_raises_first_unless_told_not_to() {
    let mut board = board(|c| c.speed = 1000.0, "");
    let mut z_after = |line: &str, at_ms: u64| {
        board.receive(at_ms * MS, format!("{line}\nM400\n").as_bytes());
        board.advance((at_ms + 90) * MS);
        let stats = board.stats();
        assert_eq!(stats.position_mm[2], stats.true_position_mm[2], "{line}");
        stats.position_mm[2]
    };
    assert_eq!(z_after("G28 R0 X Y", 300), 0.0);
    assert_eq!(z_after("G28 X Y", 400), 5.0);
    assert_eq!(z_after("G28 X Y", 500), 10.0, "an unknown Z goes up from where it is");
    assert_eq!(z_after("G28 Z", 600), 0.0);
    assert_eq!(z_after("G28 X", 700), 5.0);
    assert_eq!(z_after("G28 X", 800), 5.0, "a known one up to there");
    assert_eq!(z_after("G28 R2 X\nG28 O", 900), 5.0);
}
