//! Over pseudo-terminals whose other side the test holds.
use super::device::{Device, is_pseudo_terminal};
use super::*;
use rustix::fs::{Mode, OFlags};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use std::os::fd::OwnedFd;

/// What the far side's own buffer takes: delivered, it cannot be taken back.
const DELIVERED_MAX: usize = 4095;

fn run(test: impl Future<Output = ()>) {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(test);
}

/// A pseudo-terminal: the far side, non-blocking, and the near one's path.
fn terminal() -> (OwnedFd, String) {
    let far = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&far).unwrap();
    unlockpt(&far).unwrap();
    rustix::io::ioctl_fionbio(&far, true).unwrap();
    let path = ptsname(&far, Vec::new()).unwrap().to_string_lossy().into_owned();
    (far, path)
}

/// All that the far side can read now.
fn drain(far: &OwnedFd) -> Vec<u8> {
    let (mut all, mut some) = (Vec::new(), [0; 65_536]);
    while let Ok(read @ 1..) = rustix::io::read(far, &mut some) {
        all.extend_from_slice(&some[..read]);
    }
    all
}

/// Without TCSETS2, as an emulator would have it.
fn open_without_rates(path: &str) -> Port {
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC | OFlags::NONBLOCK;
    let data = rustix::fs::open(path, flags, Mode::empty()).unwrap();
    let device = Some(Device::new(data, None).unwrap());
    Port { device, path: path.to_owned(), baud: 250_000, writes: 0 }
}

/// Writes until the system takes no more; how much it took.
async fn fill(port: &mut Port) -> usize {
    let (mut input, mut taken) = ([0; 16], 0);
    loop {
        let write = port.exchange(&mut input, &[b'x'; 512]);
        match tokio::time::timeout(Duration::from_millis(50), write).await {
            Ok(Ok(Moved::Wrote(len))) => taken += len,
            Ok(other) => panic!("{other:?}"),
            Err(_blocked) => return taken,
        }
    }
}

/// Every byte goes both ways, and the far side's end is a port that is gone.
#[test]
fn a_terminal_is_a_port() {
    let check = |open: fn(&str) -> Port| {
        run(async {
            let (far, path) = terminal();
            assert!(is_pseudo_terminal(&path) && !is_pseudo_terminal("/dev/null"));
            let mut port = open(&path);
            let mut input = [0; 512];
            let bytes: Vec<u8> = (0..=255).collect();

            for _ in 0..3 {
                rustix::io::write(&far, &bytes).unwrap();
                assert_eq!(port.exchange(&mut input, b"").await.unwrap(), Moved::Read(256));
                assert_eq!(&input[..256], bytes);
                assert_eq!(port.exchange(&mut input, &bytes).await.unwrap(), Moved::Wrote(256));
                assert_eq!(drain(&far), bytes);
            }
            drop(far);
            assert!(matches!(port.exchange(&mut input, b"").await, Err(PortError::Gone { .. })));
        });
    };
    check(|path| Port::open(path, 250_000).unwrap());
    check(open_without_rates);
}

/// Whoever comes while it is open is told why not; afterwards it is free.
#[test]
fn a_port_is_held_by_one() {
    run(async {
        let (_far, path) = terminal();
        let first = Port::open(&path, 115_200).unwrap();
        let second = Port::open(&path, 115_200).map(drop).unwrap_err().to_string();
        assert!(second.contains("another program holds it"), "{second}");
        drop(first);
        Port::open(&path, 115_200).unwrap();
    });
}

#[test]
fn what_cannot_be_opened_is_told() {
    run(async {
        let check = |path: &str, expect: &str| {
            let error = Port::open(path, 115_200).map(drop).unwrap_err().to_string();
            assert!(error.starts_with("cannot open") && error.contains(expect), "{path}: {error}");
        };
        check("/dev/outrigger-none", "is the printer plugged in");
        check("/dev/null", "no serial port");
        check("/tmp", "irectory");
    });
}

/// Our end must not lower DTR.
#[test]
fn hupcl_is_cleared() {
    let check = |open: fn(&str) -> Port| {
        run(async {
            let (far, path) = terminal();
            let hangs_up = || {
                let modes = rustix::termios::tcgetattr(&far).unwrap();
                modes.control_modes.contains(rustix::termios::ControlModes::HUPCL)
            };
            let mut modes = rustix::termios::tcgetattr(&far).unwrap();
            modes.control_modes |= rustix::termios::ControlModes::HUPCL;
            rustix::termios::tcsetattr(&far, rustix::termios::OptionalActions::Now, &modes).unwrap();
            assert!(hangs_up());
            let mut port = open(&path);
            assert!(!hangs_up());
            port.set_baud(115_200).unwrap();
            assert!(!hangs_up(), "nor does another speed set it again");
        });
    };
    check(|path| Port::open(path, 250_000).unwrap());
    check(open_without_rates);
}

/// A speed without a name arrives as it is, clearing HUPCL notwithstanding.
#[test]
fn any_speed_is_set() {
    run(async {
        let (far, path) = terminal();
        let speed = || rustix::termios::tcgetattr(&far).unwrap().output_speed();
        let mut port = Port::open(&path, 250_000).unwrap();
        assert_eq!((speed(), port.baud()), (250_000, 250_000));
        port.set_baud(76_800).unwrap();
        assert_eq!((speed(), port.baud()), (76_800, 76_800));
    });
}

/// A far side that reads nothing blocks the write, not the program; after a flush
/// the stop is the next to come behind what the far side had already taken.
#[test]
fn a_stop_overtakes_what_is_blocked() {
    let check = |open: fn(&str) -> Port| {
        run(async {
            let (far, path) = terminal();
            let mut port = open(&path);
            let mut input = [0; 16];
            let taken = fill(&mut port).await;
            assert!(taken > DELIVERED_MAX, "{taken}");

            // It still hears the printer.
            rustix::io::write(&far, b"ok\n").unwrap();
            assert_eq!(port.exchange(&mut input, b"N1 M105*1\n").await.unwrap(), Moved::Read(3));

            port.flush_output().unwrap();
            assert_eq!(port.exchange(&mut input, b"\nM112\n").await.unwrap(), Moved::Wrote(6));
            let seen = drain(&far);
            let old = seen.len() - 6;
            assert!(old <= DELIVERED_MAX && seen[..old].iter().all(|b| *b == b'x'), "{old}");
            assert_eq!(&seen[old..], b"\nM112\n");
        });
    };
    check(|path| Port::open(path, 250_000).unwrap());
    check(open_without_rates);
}

/// A blocked write goes on when the far side reads again.
#[test]
fn a_blocked_write_goes_on() {
    run(async {
        let (far, path) = terminal();
        let mut port = Port::open(&path, 250_000).unwrap();
        let mut input = [0; 16];
        let taken = fill(&mut port).await;
        assert!(drain(&far).len() <= taken);
        for _ in 0..100 {
            let Moved::Wrote(len) = port.exchange(&mut input, b"y").await.unwrap() else { panic!("a write") };
            assert_eq!(len, 1);
        }
        assert!(drain(&far).ends_with(&[b'y'; 100]));
    });
}

/// Endless output leaves room for what the printer says.
#[test]
fn who_writes_for_ever_still_hears() {
    run(async {
        let (far, path) = terminal();
        let mut port = Port::open(&path, 250_000).unwrap();
        let mut input = [0; 16];
        rustix::io::write(&far, b"ok\n").unwrap();
        let mut exchanges = 0;
        while port.exchange(&mut input, b"y").await.unwrap() != Moved::Read(3) {
            exchanges += 1;
            assert!(exchanges <= WRITES_IN_A_ROW, "never heard");
        }
        // And with nothing to hear it writes on.
        for _ in 0..3 * WRITES_IN_A_ROW {
            assert_eq!(port.exchange(&mut input, b"y").await.unwrap(), Moved::Wrote(1));
        }
    });
}

/// No DTR: the port is closed and opened, in every mode it stays a port.
#[test]
fn a_terminal_is_reset_by_opening_again() {
    run(async {
        let (far, path) = terminal();
        let mut input = [0; 16];
        for mode in [OpenMode::Fresh { reset: true }, OpenMode::Fresh { reset: false }, OpenMode::TakeOver] {
            let mut port = Port::open_as(&path, 250_000, mode).await.unwrap();
            assert!(!port.has_dtr());
            port.reset_board().await.unwrap();
            assert_eq!(port.exchange(&mut input, b"M105\n").await.unwrap(), Moved::Wrote(5));
            assert_eq!(drain(&far), b"M105\n");
        }
        let mut port = Port::open(&path, 250_000).unwrap();
        drop(far);
        assert!(matches!(port.reset_board().await, Err(PortError::Open { .. })));
        assert!(matches!(port.exchange(&mut input, b"").await, Err(PortError::Gone { .. })));
        assert!(matches!(port.flush_output(), Err(PortError::Gone { .. })));
    });
}
