//! One fault at any instant of a resin job, on the virtual clock: what the light, the display and the
//! plate then do.
//!
//! Each test sweeps one fault over the time of a job of two layers; near the lines of an exposure by
//! fractions of a millisecond.
use outrigger::job::state::State;
use outrigger::printer::exposure::script::Timing;
use outrigger_hil::judge::resin::Exposed;
use outrigger_hil::resin::{Job, again};
use outrigger_hil::scenario::{Fault, Kind};
use outrigger_hil::world::plate::Task;
use outrigger_hil::world::{Plan, Report};

const EXPOSURE_MS: u32 = 2_000;

/// A cable that never comes back, s.
const NEVER_S: f64 = 50_000.0;

fn job(timing: Timing) -> Job {
    Job::of(2, EXPOSURE_MS, timing)
}

fn at(kind: Kind, at_s: f64, for_s: Option<f64>) -> Fault {
    Fault { for_s, ..Fault::at_s(kind, at_s) }
}

fn print(job: &Job, faults: Vec<Fault>, change: impl Fn(&mut Plan)) -> (Report, Exposed) {
    let mut plan = job.plan(faults).unwrap();
    change(&mut plan);
    job.print(plan)
}

/// When the light of each layer goes on where nothing goes wrong, and when the job is over, s.
fn times(job: &Job) -> (Vec<f64>, f64) {
    let (report, _) = print(job, Vec::new(), |_| {});
    let lit_s = report.light.iter().map(|pulse| pulse.begin.at_ns as f64 / 1e9).collect();
    (lit_s, report.ended_ns as f64 / 1e9)
}

/// Instants from the first line to the end: everywhere coarsely, around each exposure finely, where
/// its lines arrive by a fifth of a millisecond.
fn instants(job: &Job) -> Vec<f64> {
    let (lit_s, end_s) = times(job);
    let mut all: Vec<f64> = (0..).map(|n| f64::from(n) * 0.25).take_while(|at_s| *at_s < end_s).collect();
    let mut steps = |from_s: f64, to_s: f64, step_s: f64| {
        all.extend((0..).map(|n| from_s + f64::from(n) * step_s).take_while(|at_s| *at_s < to_s));
    };
    for lit_s in lit_s {
        let exposure_s = f64::from(EXPOSURE_MS) / 1e3;
        steps(lit_s - 0.7, lit_s + exposure_s + 0.8, 0.05);
        steps(lit_s - 0.115, lit_s - 0.085, 0.0002);
        steps(lit_s - 0.003, lit_s + 0.003, 0.0002);
        steps(lit_s + exposure_s - 0.01, lit_s + exposure_s + 0.01, 0.001);
    }
    all
}

/// What must hold of any end: nothing wrong in the light, on the display, of the plate.
fn sound(report: &Report, done: &Exposed, what: &str) {
    assert_eq!(done.wrong, Vec::<String>::new(), "{what}");
    assert_eq!((report.stats.crashes, report.stats.light_moved), (0, 0), "{what}");
}

fn not_too_long(done: &Exposed, what: &str) {
    assert_eq!(done.too_long, [], "{what}");
}

/// Each layer once, each pixel its dose; or as often as was told.
fn whole(job: &Job, report: &Report, done: &Exposed, what: &str) {
    assert_eq!(report.state, State::Finished, "{what}: {:?}", report.outcome);
    let wrong = done.whole(&job.layers, |layer| again(&report.told, layer));
    assert_eq!(wrong, Vec::<String>::new(), "{what}");
}

const TIMINGS: [Timing; 3] = [Timing::Controller, Timing::Pulse, Timing::Host];

#[test]
fn nothing_goes_wrong() {
    for timing in TIMINGS {
        for homes_up in [false, true] {
            let job = Job { homes_up, ..Job::of(5, EXPOSURE_MS, timing) };
            let (report, done) = print(&job, Vec::new(), |_| {});
            let what = format!("{timing:?} {homes_up}");
            sound(&report, &done, &what);
            not_too_long(&done, &what);
            whole(&job, &report, &done, &what);
            eprintln!("{what}: exposures at most {:+.3} % off", done.longest.unwrap() * 100.0);
        }
    }
}

#[test]
fn the_host_is_killed_at_any_instant_and_another_takes_over() {
    for timing in [Timing::Controller, Timing::Pulse] {
        let job = job(timing);
        for at_s in instants(&job) {
            for for_s in [0.3, 8.0] {
                let what = format!("{timing:?} {at_s} {for_s}");
                let (report, done) = print(&job, vec![at(Kind::Kill, at_s, Some(for_s))], |_| {});
                sound(&report, &done, &what);
                not_too_long(&done, &what);
                // Once: nobody is asked, since the printer kept its state.
                whole(&job, &report, &done, &what);
                assert!(report.confirmed_ns.is_empty(), "{what}");
            }
        }
    }
}

#[test]
fn the_cable_is_cut_at_any_instant_where_a_pulse_ends_by_itself() {
    let job = job(Timing::Pulse);
    for at_s in instants(&job) {
        for for_s in [0.05, 4.0, NEVER_S] {
            let what = format!("{at_s} {for_s}");
            let (report, done) = print(&job, vec![at(Kind::Unplug, at_s, Some(for_s))], |_| {});
            sound(&report, &done, &what);
            not_too_long(&done, &what);
            if for_s < NEVER_S {
                whole(&job, &report, &done, &what);
            }
        }
    }
}

#[test]
fn the_cable_is_cut_at_any_instant_where_the_controller_keeps_the_time() {
    let job = job(Timing::Controller);
    let mut holes_s = Vec::new();
    for at_s in instants(&job) {
        for for_s in [0.05, 4.0, NEVER_S] {
            let what = format!("{at_s} {for_s}");
            let (report, done) = print(&job, vec![at(Kind::Unplug, at_s, Some(for_s))], |_| {});
            sound(&report, &done, &what);
            let dose_off = for_s < NEVER_S && !done.whole(&job.layers, |_| 0).is_empty();
            if !done.too_long.is_empty() || dose_off {
                holes_s.push(at_s);
            }
            if for_s < NEVER_S {
                assert_eq!(report.state, State::Finished, "{what}");
            }
        }
    }
    // Of each exposure one, as long as what lies between the two lines on the wire: some 35 bytes.
    let (lit_s, _) = times(&job);
    for lit_s in lit_s {
        let near: Vec<f64> = holes_s.iter().map(|at_s| at_s - lit_s).filter(|s| s.abs() < 1.0).collect();
        let from_s = near.iter().copied().fold(f64::INFINITY, f64::min);
        let to_s = near.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        eprintln!("cut from {:.1} to {:.1} ms before the light: it stays on", -from_s * 1e3, -to_s * 1e3);
        assert!(near.is_empty() || to_s - from_s < 0.004, "{near:?}");
    }
    assert!(holes_s.len() < 200);
}

#[test]
fn each_line_of_an_exposure_is_lost_or_damaged_and_each_answer() {
    let kinds = [Kind::LoseLine, Kind::CorruptLine, Kind::LoseEnd, Kind::LoseReply, Kind::CorruptReply];
    for timing in TIMINGS {
        let job = job(timing);
        let commands = job.plan(Vec::new()).unwrap().commands;
        for kind in kinds {
            for line in 1..=commands.len() as u64 {
                for (times, byte) in [(1, 1), (1, 0), (1, 5), (1, 9), (2, 5)] {
                    let mut fault = Fault::at_line(kind, line);
                    (fault.times, fault.byte) = (Some(times), Some(byte));
                    let text = String::from_utf8_lossy(commands.get(line as usize - 1).unwrap());
                    let what = format!("{timing:?} {kind:?} {line} {text} byte {byte} times {times}");
                    let (report, done) = print(&job, vec![fault], |_| {});
                    sound(&report, &done, &what);
                    not_too_long(&done, &what);
                    assert_eq!(report.state, State::Finished, "{what}");
                    // With two in a row nothing tells that light off is missing before it is overdue; nor is
                    // there anything behind it where the host keeps the time.
                    if times == 1 && timing != Timing::Host {
                        whole(&job, &report, &done, &what);
                    }
                }
            }
        }
    }
}

#[test]
fn answers_come_late() {
    for timing in TIMINGS {
        let job = job(timing);
        for at_s in instants(&job) {
            let what = format!("{timing:?} {at_s}");
            let (report, done) = print(&job, vec![at(Kind::HoldReplies, at_s, Some(2.5))], |_| {});
            sound(&report, &done, &what);
            // The host does not know when the light went on before it hears of it.
            if timing != Timing::Host {
                not_too_long(&done, &what);
                whole(&job, &report, &done, &what);
            }
        }
    }
}

#[test]
fn the_board_loses_power_at_any_instant() {
    for (timing, homes_up) in [(Timing::Controller, false), (Timing::Pulse, true)] {
        let job = Job { homes_up, ..job(timing) };
        let (lit_s, _) = times(&job);
        let (mut finished, mut refused) = (0, 0);
        for at_s in instants(&job) {
            let what = format!("{timing:?} {homes_up} {at_s}");
            let (report, done) = print(&job, vec![at(Kind::PowerCut, at_s, Some(6.0))], |_| {});
            sound(&report, &done, &what);
            not_too_long(&done, &what);
            // From a while before the light, when it is written down that the plate stands, to its end.
            let stands =
                lit_s.iter().any(|lit_s| (-0.6..f64::from(EXPOSURE_MS) / 1e3).contains(&(at_s - lit_s)));
            match report.state {
                State::Finished => {
                    finished += 1;
                    whole(&job, &report, &done, &what);
                }
                state => {
                    refused += 1;
                    assert_eq!(state, State::Interrupted, "{what}");
                    assert!(!stands, "{what}: it could have gone on\n{}", report.told);
                }
            }
        }
        eprintln!("{timing:?}, homes up {homes_up}: {finished} went on, {refused} were refused");
    }
}

#[test]
fn the_firmware_halts_at_any_instant_and_the_board_is_reset() {
    for timing in TIMINGS {
        let job = job(timing);
        for at_s in instants(&job) {
            let what = format!("{timing:?} {at_s}");
            let mut halt = at(Kind::Halt, at_s, None);
            halt.text = Some("Heating failed, system stopped! Heater_ID: 0".to_owned());
            let stops = [halt, at(Kind::EmergencyStop, at_s, None)];
            for stop in stops {
                let no_confirm = |plan: &mut Plan| plan.user.confirms_ns = None;
                let (report, done) = print(&job, vec![stop], no_confirm);
                sound(&report, &done, &what);
                not_too_long(&done, &what);
                assert!(!report.stats.light_on, "{what}");
            }
        }
    }
}

#[test]
fn a_person_pauses_or_cancels_at_any_instant() {
    for timing in TIMINGS {
        let job = job(timing);
        for at_s in instants(&job) {
            let what = format!("{timing:?} {at_s}");
            let (report, done) = print(&job, vec![at(Kind::Pause, at_s, None)], |_| {});
            sound(&report, &done, &what);
            not_too_long(&done, &what);
            whole(&job, &report, &done, &what);
            let (report, done) = print(&job, vec![at(Kind::Cancel, at_s, None)], |_| {});
            sound(&report, &done, &what);
            if timing != Timing::Host {
                not_too_long(&done, &what);
            }
            let last = job.layers.len() as u64 * 11;
            assert!(
                report.state == State::Cancelled || report.sent as u64 > last,
                "{what}: {:?}",
                report.state
            );
            let part_mm = report.stats.part_top_mm;
            let clear = part_mm == 0.0 || report.stats.true_position_mm[2] > part_mm + 15.0;
            assert!(clear && !report.stats.light_on, "{what}: {:?}", report.stats.true_position_mm);
        }
    }
}

#[test]
fn the_display_fails_at_any_of_its_tasks() {
    for timing in TIMINGS {
        let job = job(timing);
        for task in [Task::Load, Task::Show, Task::Blank] {
            for nth in 1..=4 {
                let what = format!("{timing:?} {task:?} {nth}");
                let fails = |plan: &mut Plan| {
                    if let Some(resin) = &mut plan.resin {
                        resin.screen.fails = Some((task, nth));
                    }
                };
                let (report, done) = print(&job, Vec::new(), fails);
                sound(&report, &done, &what);
                not_too_long(&done, &what);
                assert!(
                    matches!(report.state, State::Failed | State::Finished),
                    "{what}: {:?}",
                    report.state
                );
                assert!(!report.stats.light_on, "{what}");
            }
        }
    }
}

/// No host can switch off a light on a board that does not run. What it can do is not to make it worse.
#[test]
fn the_board_hangs() {
    for timing in [Timing::Controller, Timing::Pulse] {
        let job = job(timing);
        let hang_s = 1.0;
        for at_s in instants(&job) {
            let what = format!("{timing:?} {at_s}");
            let (report, done) = print(&job, vec![at(Kind::Hang, at_s, Some(hang_s))], |_| {});
            sound(&report, &done, &what);
            assert_eq!(report.state, State::Finished, "{what}");
            let most = hang_s / (f64::from(EXPOSURE_MS) / 1e3) + 0.01;
            assert!(done.longest.unwrap() <= most, "{what}: {:?}", done.longest);
            for pulses in &done.pulses_s {
                assert_eq!(pulses.len(), 1, "{what}");
            }
        }
    }
}
