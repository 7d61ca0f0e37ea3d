//! The board on a virtual clock: what goes in at which time, what comes out.
use super::faults::Faults;
use super::*;

mod faults;
mod machine;
mod personality;
mod power;
mod resin;
mod wire;

const MS: u64 = 1_000_000;

/// A line with its number and checksum, made here and not by the sender.
fn numbered(n: i64, command: &str) -> String {
    let text = format!("N{n} {command}");
    let sum = text.bytes().fold(0u8, |sum, b| sum ^ b);
    format!("{text}*{sum}\n")
}

/// A board that has booted (at 200 ms) and whose first words were read.
fn board(change: impl FnOnce(&mut Config), faults: &str) -> Firmware {
    let mut config = Config { baud: 0, ..Config::default() };
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
fn m85_halts_a_board_that_is_left_alone() {
    let mut board = plain();
    check(&mut board, &[(300, "M85 S10\n", "ok\n"), (400, "M113 S0\nG4 S30\n", "ok\n")]);
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
        (300..20_000).map(|ms| output(&mut board, ms)).collect::<String>()
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
        lines in proptest::collection::vec("(G[0-9]{1,2}|M[0-9]{1,3})( ?[XYZEFSPIJRN]-?[0-9]{0,20}(\\.[0-9])?){0,5}", 1..40),
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

    #[test]
    fn a_fault_at_any_time_happens_once(at_s in 0.0f64..3.0) {
        let mut board = board(|_| {}, &format!("[[fault]]\nat_s = {at_s:.12}\ndo = 'hang_up'\nfor_s = 1"));
        let mut happened = usize::from(board.take_hang_up().is_some());
        for ms in 250..3100 {
            board.advance(ms * MS);
            happened += usize::from(board.take_hang_up().is_some());
        }
        assert_eq!(happened, 1);
    }
}
