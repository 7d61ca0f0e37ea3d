//! How long a job takes when the planner is never short of moves: the mock's board on a
//! virtual clock, and a sender that knows every answer at once.
use crate::host::PROFILE;
use anyhow::bail;
use outrigger::printer::mock::{Config, Cornering, Dynamics, Faults, Firmware, Machine};
use outrigger::profile::{load_printer, printer};
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

/// Lines on their way at a time: short ones, so that they fit the receive buffer.
const AHEAD: usize = 3;

/// Seconds from the first move to the end of the last.
pub(crate) fn ideal_s(job: &Path) -> anyhow::Result<f64> {
    let config = Config { baud: 0, machine: machine()?, ..Config::default() };
    let mut board = Firmware::new(config, Faults::default());
    let mut lines = BufReader::new(File::open(job)?).split(b'\n');
    let (mut now_ns, mut flying, mut said) = (0, 0, Vec::new());
    loop {
        while flying < AHEAD
            && let Some(line) = lines.next().transpose()?
        {
            board.receive(now_ns, &[&line, b"\n".as_slice()].concat());
            flying += 1;
        }
        board.advance(now_ns);
        said.clear();
        board.take_output(&mut said);
        let oks = said.split(|&b| b == b'\n').filter(|line| line.starts_with(b"ok")).count();
        flying -= oks.min(flying);
        match board.deadline_ns() {
            _ if oks > 0 => {}
            Some(at_ns) => now_ns = at_ns.max(now_ns),
            None if flying > 0 => bail!("the mock printer takes no more of {}", job.display()),
            None => break,
        }
    }
    let stats = board.stats();
    Ok(stats.moving_s + stats.planner_empty_s)
}

/// What the profile's machine can do along its axes.
fn machine() -> anyhow::Result<Machine> {
    let profile = load_printer(PROFILE)?;
    let motion = &profile.want_fdm()?.motion;
    let (feed, accel) = (motion.max_feed_mm_s, motion.max_accel_mm_s2);
    let printer::Cornering::JerkMmS(jerk) = motion.cornering else {
        bail!("{PROFILE}: not a machine with jerk");
    };
    let dynamics = Dynamics {
        max_feed_mm_s: [feed.x.0, feed.y.0, feed.z.0, feed.e.0],
        max_accel_mm_s2: [accel.x.0, accel.y.0, accel.z.0, accel.e.0],
        print_mm_s2: motion.print_mm_s2.0,
        travel_mm_s2: motion.travel_mm_s2.0,
        retract_mm_s2: motion.retract_mm_s2.0,
        cornering: Cornering::JerkMmS(jerk.0),
    };
    Ok(Machine { dynamics, ..Machine::default() })
}
