//! The process that switches a resin printer's light off when its host is dead, through the real binary.
use std::io::{Read, Write};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Says these words, dies, and gives what was written to the "port" and after how long the process ended.
fn die_after(words: &str, linger: Duration) -> (String, Duration) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_outrigger"))
        .args(["light-watch", "M107", "M42 P4 S0"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("started");
    let mut pipe = child.stdin.take().expect("a pipe");
    pipe.write_all(words.as_bytes()).expect("words");
    std::thread::sleep(linger);
    let began = Instant::now();
    drop(pipe);
    let mut written = String::new();
    child.stdout.take().expect("a port").read_to_string(&mut written).expect("text");
    assert!(child.wait().expect("ended").success());
    (written, began.elapsed())
}

const OFF: &str = "\nM107\nM42 P4 S0\n";

#[test]
fn a_dead_host_leaves_no_light_on() {
    let none = Duration::ZERO;
    // Words, how long the host lives on, what the port gets, how long at least until it is all written.
    let check = |words: &str, linger: Duration, times: usize, at_least_ms: u64| {
        let (written, took) = die_after(words, linger);
        assert_eq!(written, OFF.repeat(times), "{words}");
        assert!(took >= Duration::from_millis(at_least_ms), "{words}: {took:?}");
    };
    check("", none, 0, 0);
    check("lit 60000 host\ndark\n", none, 0, 0);
    check("lit 60000 controller\ndark\n", none, 0, 0);
    // At once, three times.
    check("lit 60000 host\n", none, 3, 400);
    // The controller ends its exposure itself: after it.
    check("lit 700 controller\n", none, 3, 1_000);
    check("dark\nlit 700 controller\nnonsense\n", none, 3, 1_000);
}

#[test]
fn a_host_that_hangs_is_overtaken_where_it_keeps_the_time() {
    let (written, _) = die_after("lit 50 host\n", Duration::from_millis(1_500));
    assert_eq!(written, OFF.repeat(3));
    // A controller needs nobody.
    let (written, _) = die_after("lit 50 controller\n", Duration::from_millis(300));
    assert_eq!(written, OFF.repeat(3), "switched off behind the exposure, once the host is dead");
}
