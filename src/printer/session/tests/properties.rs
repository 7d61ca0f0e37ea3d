//! What holds whatever the printer says.
use super::*;
use crate::printer::reply::{Reply, parse};
use proptest::prelude::*;

/// What the printer may say, true to form or not.
fn chatter() -> impl Strategy<Value = Vec<u8>> {
    let line = |text: &'static str| Just(text.as_bytes().to_vec());
    prop_oneof![
        8 => line("ok\n"),
        2 => line("ok T:20.0 /0.0 B:20.0 /0.0\n"),
        2 => (0_u32..40).prop_map(|n| format!("ok N{n} P15 B3\n").into_bytes()),
        3 => (0_u32..40).prop_map(|n| format!("Resend: {n}\n").into_bytes()),
        2 => (0_u32..40).prop_map(|n| format!("Error:checksum mismatch, Last Line: {n}\n").into_bytes()),
        1 => line("wait\n"),
        1 => line("echo:busy: processing\n"),
        1 => line("!! shutdown\n"),
        1 => line("start\n"),
        2 => prop::collection::vec(any::<u8>(), 0..30),
    ]
}

/// What a session did with some bytes: what it sent, what it told.
fn listen(chunks: &[(Vec<u8>, u64)]) -> (Vec<String>, Vec<Event>) {
    let mut player = Player::new(settings());
    player.job = (1..=200).map(|n| format!("G1 X{n}")).collect();
    for step in CONNECT.lines().map(str::trim).filter(|l| !l.is_empty()) {
        player.play(step, CONNECT);
    }
    for (bytes, wait_ms) in chunks {
        player.session.on_bytes(bytes, player.now_ms);
        player.settle();
        player.pass(*wait_ms);
    }
    (player.sent.into(), player.events.into())
}

proptest! {
    /// Whatever the printer says, a line is sent in its turn or because it was
    /// asked for.
    #[test]
    fn no_line_goes_out_of_turn(
        chunks in prop::collection::vec((chatter(), prop_oneof![Just(0), Just(25), 0_u64..5000]), 0..80),
    ) {
        let mut asked: Vec<u64> = Vec::new();
        for (bytes, _) in &chunks {
            for line in bytes.split(|b| matches!(b, b'\n' | b'\r')) {
                match parse(line) {
                    Reply::Resend(n) => asked.push(n.into()),
                    Reply::Refused { last_line, .. } => asked.push(u64::from(last_line) + 1),
                    _ => {}
                }
            }
        }
        let (sent, _) = listen(&chunks);
        let mut expect = 4_u64;
        for line in sent {
            if line.starts_with("N0 M110") {
                expect = 1;
                continue;
            }
            let n: u64 = line[1..].split(' ').next().unwrap().parse().unwrap();
            prop_assert!(n == expect || asked.contains(&n), "{} after {}", line, expect);
            expect = n + 1;
        }
    }

    /// The pieces in which a line arrives change nothing.
    #[test]
    fn pieces_do_not_matter(
        lines in prop::collection::vec(chatter(), 0..40),
        cuts in prop::collection::vec(0_usize..20, 1..60),
    ) {
        let whole: Vec<_> = lines.iter().map(|line| (line.clone(), 0)).collect();
        let mut pieces = Vec::new();
        for (line, cut) in lines.iter().zip(cuts.iter().cycle()) {
            let (head, tail) = line.split_at(*cut.min(&line.len()));
            pieces.push((head.to_vec(), 0));
            pieces.push((tail.to_vec(), 0));
        }
        prop_assert_eq!(listen(&pieces), listen(&whole));
    }
}
