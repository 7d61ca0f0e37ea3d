//! Scripted faults on the board.
use super::*;

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
            (320, &inputs[2], "Error:checksum mismatch, Last Line: 2\nResend: 3\n"),
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
        &[(1300, &line(7), "Error:Line Number is not Last Line Number+1, Last Line: 0\nResend: 1\nok\n")],
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
        at_s = 3
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
        output(&mut board, 3000),
        "Error:Thermal Runaway, system stopped! Heater_ID: 0\nError:Printer halted. kill() called!\n"
    );
}

#[test]
fn a_board_that_hangs_still_receives_until_its_buffer_is_full() {
    let script = "[[fault]]\nat_s = 0.3\ndo = 'hang'\nfor_s = 1";
    let mut board = board(|c| c.baud = 250_000, script);
    let job: String = (1..=20).map(|n| numbered(n, "G90")).collect();
    board.receive(310 * MS, job.as_bytes());
    assert_eq!(output(&mut board, 1290), "");
    let said = output(&mut board, 1400);
    assert!(said.starts_with("ok\n"), "{said}");
    let stats = board.stats();
    assert_eq!(stats.overflow_bytes, job.len() as u64 - 127);
}
