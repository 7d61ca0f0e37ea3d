//! Where a broken-off job stands, where it is taken up, and the order of the way back:
//! against tables, and against a machine that shares no code with the walk.
use super::walk::Walk;
use super::*;
use crate::job::record::Accepted;
use crate::job::reference::Reference;
use crate::job::tracker::EModes;
use proptest::prelude::*;

/// Commands of the job in the cases below.
const COMMANDS: u64 = 10_000;

fn rules() -> ResumeRules {
    ResumeRules { homes_xy_alone: true, homing_clears_part: true, ..ResumeRules::default() }
}

/// A job that has come to a state; `numbers` is `first` and `after`, or `after` alone.
fn log(state: State, numbers: (Option<u32>, u64), acknowledged: u64) -> Log {
    let mut log = Log::new(Accepted { commands: COMMANDS, ..Accepted::default() });
    log.state = state;
    log.numbers = match numbers {
        (Some(first), after) => Numbers::Job { first, after, own: vec![12] },
        (None, after) => Numbers::Nothing { after },
    };
    log.checkpoint.commands = acknowledged;
    log
}

/// A case without the words of what is not known.
fn told(case: &Case) -> String {
    match case {
        Case::NotKnown { .. } => "NotKnown".to_owned(),
        other => format!("{other:?}"),
    }
}

#[test]
fn the_cases_are_told_apart() {
    use State::*;
    let check = |log: &Log, found, expect: &str| {
        assert_eq!(told(&case(log, found, &rules())), expect, "{log:?} {found:?}");
    };
    let counting = |last| Found::Counting { last };
    let reset = |after, exact| format!("PrinterReset {{ after: {after}, exact: {exact} }}");
    let died = |after, parked| format!("HostDied {{ after: {after}, parked: {parked} }}");
    let nothing_sent = log(Starting, (None, 0), 0);
    // N10 is the file's first line, N12 is not the file's.
    let printing = log(Printing, (Some(10), 0), 500);
    let parked = log(Paused, (None, 500), 500);
    let mut made_safe = printing.clone();
    made_safe.made_safe = Some(Some(12.0));
    let mut moved_when_made_safe = printing.clone();
    moved_when_made_safe.made_safe = Some(None);
    let mut damaged = printing.clone();
    damaged.distrust();

    for over in [Finished, Cancelled, Failed] {
        check(&log(over, (Some(10), 0), 500), counting(600), "Over");
    }
    for found in [Found::Started, Found::NotSaid, counting(0), counting(600)] {
        check(&log(Cancelling, (Some(10), 0), 500), found, "Unsafe");
        check(&nothing_sent, found, "NotBegun");
    }
    check(&log(Failing, (Some(10), 0), 500), counting(600), "Unsafe");
    // Its heaters are off already.
    check(&log(Failing, (Some(10), 0), 500), Found::Started, &reset(500, false));

    // The printer has at least what was acknowledged, and at most what may be sent.
    check(&printing, counting(509), "NotKnown");
    check(&printing, counting(510), &died(500, false));
    check(&printing, counting(600), &died(590, false));
    check(&printing, counting(510 + MAX_AHEAD as u32), &died(500 + MAX_AHEAD, false));
    check(&printing, counting(511 + MAX_AHEAD as u32), "NotKnown");
    check(&printing, Found::NotSaid, "NotKnown");
    check(&damaged, counting(600), "NotKnown");
    check(&damaged, Found::Started, "Refused(RecordsLost)");
    check(&parked, counting(777), &died(500, true));
    check(&log(Ending, (None, COMMANDS), COMMANDS), counting(7), &died(COMMANDS, false));
    check(&log(Ending, (None, 500), 500), counting(7), &died(500, false));

    // A board that counts from 0 has started before we listened.
    for found in [Found::Started, counting(0)] {
        check(&printing, found, &reset(500, false));
        check(&parked, found, &reset(500, true));
        check(&made_safe, found, &reset(500, false));
        check(&moved_when_made_safe, found, "NotKnown");
        // On the way to the pause or back: at no known height.
        check(&log(Pausing, (None, 500), 500), found, "NotKnown");
        check(&log(Resuming, (None, 500), 500), found, "NotKnown");
    }
    // Cold and with its head up: it kept its numbers, and nothing else.
    check(&made_safe, counting(600), &reset(500, false));

    let refused = |rules: &ResumeRules, expect| {
        assert_eq!(case(&printing, Found::Started, rules), Case::Refused(expect), "{rules:?}");
    };
    refused(&ResumeRules::default(), Refusal::HomingMovesZ);
    refused(&ResumeRules { homes_xy_alone: false, ..rules() }, Refusal::HomingMovesZ);
    refused(&ResumeRules { homing_clears_part: false, ..rules() }, Refusal::HomingMayHitPart);
}

/// What a file begins with, as far as the machine is concerned.
const PREPARATION: [&str; 8] =
    ["G28", "M190 S60", "M109 S210", "G90", "M83", "G92 E0", "G1 Z0.2 F600", "G1 X0 Y0 F3000"];

/// `n` beads in a row.
fn beads(n: usize) -> Vec<String> {
    (1..=n).map(|x| format!("G1 X{x} Y5 E0.1")).collect()
}

fn file(parts: &[&[String]]) -> Vec<String> {
    let preparation: Vec<_> = PREPARATION.map(str::to_owned).to_vec();
    std::iter::once(preparation.as_slice()).chain(parts.iter().copied()).flatten().cloned().collect()
}

/// A walk through the first `to` of these commands; command `k` is line `2 k` of its file.
fn walk(commands: &[String], to: usize, back_moves: u32) -> Walk {
    let mut walk = Walk::new(EModes::WithAxes, to as u64, back_moves);
    for (at, command) in commands[..to].iter().enumerate() {
        assert!(!walk.is_done());
        walk.step(command.as_bytes(), 2 * (at as u64 + 1), 7);
    }
    assert!(walk.is_done());
    walk
}

fn line(text: &str) -> Vec<String> {
    text.split("; ").map(str::to_owned).collect()
}

#[test]
fn a_restart_is_before_all_that_may_not_have_been_made() {
    let depth = rules().depth();
    assert_eq!(depth, 16 + 4 + UNPROVED_OKS);
    let check = |commands: &[String], expect: Result<(usize, f64), Refusal>| {
        let place = walk(commands, commands.len(), depth).place();
        let got = place.map(|p| {
            let between: Vec<_> =
                p.between.iter().map(|k| String::from_utf8(k.text.clone()).unwrap()).collect();
            assert_eq!(between, commands[p.after as usize..], "what is sent again");
            assert_eq!(p.last, (2 * p.after, 7));
            (p.after as usize, p.lowest_mm)
        });
        assert_eq!(got, expect, "{commands:?}");
    };
    let d = depth as usize;
    let most = CLEAN_BACK_MOVES as usize;
    // Beads alone, 8 commands before them: the last 22 are made again. What moves nothing
    // does not count.
    check(&file(&[&beads(60)]), Ok((8 + 60 - d, 0.2)));
    check(&file(&[&beads(60), &line("M106 S1; G1 F600; G92 E0")]), Ok((8 + 60 - d, 0.2)));
    // A travel a little further back is a better place; one too far back is none.
    let hop = line("G1 X0 Y9");
    check(&file(&[&beads(60), &hop, &beads(d - 1)]), Ok((8 + 60, 0.2)));
    check(&file(&[&beads(60), &hop, &beads(d + 3)]), Ok((8 + 60, 0.2)));
    check(&file(&[&beads(60), &hop, &beads(d + most - 1)]), Ok((8 + 60, 0.2)));
    check(&file(&[&beads(60), &hop, &beads(d + most)]), Ok((8 + 61 + most, 0.2)));
    // The lowest height between decides where the nozzle may stand: also where the first of
    // these moves begins.
    check(&file(&[&beads(60), &line("G1 Z0.4"), &beads(d - 1)]), Ok((8 + 60, 0.2)));
    check(&file(&[&beads(60), &line("G1 Z0.6; G1 Z0.4"), &beads(d - 1)]), Ok((8 + 61, 0.4)));
    // Nothing was printed, or what was kept does not reach back to a place.
    check(&file(&[]), Err(Refusal::InPreparation));
    check(&file(&[&line("G1 X1; G1 X2")]), Err(Refusal::InPreparation));
    check(&beads(60), Err(Refusal::InPreparation));
    check(&file(&[&beads(60), &vec!["M105".to_owned(); 5_000]]), Err(Refusal::TooManyCommands));
    check(&file(&[&beads(60), &line("G29")]), Ok((8 + 60 - d, 0.2)));
    // An object that is finished stands in the way.
    let second = line("G1 Z12; G1 X50 Y5 E1; G1 Z20; G1 X100; G1 Z0.2");
    check(&file(&[&beads(60), &second, &beads(60)]), Err(Refusal::OneByOne));
}

#[test]
fn an_exact_place_is_the_end_of_the_walk() {
    let commands = file(&[&beads(3)]);
    let place = walk(&commands, commands.len(), 0).place().unwrap();
    assert_eq!((place.after, place.last, place.lowest_mm, place.moves), (11, (22, 7), 0.2, 0));
    assert!(place.between.is_empty());
    assert_eq!(walk(&file(&[&beads(3), &line("G29")]), 12, 0).place().unwrap_err(), Refusal::InPreparation);
}

#[test]
fn the_height_is_what_was_written_down_or_the_lowest_in_question() {
    let commands = file(&[&beads(60), &line("G1 Z5"), &beads(10)]);
    let place = walk(&commands, commands.len(), 22).place().unwrap();
    let park = line("G91; G1 Z10 F600; G90");
    let check = |state, made_safe, expect| {
        let log = Log { made_safe, ..log(state, (None, 70), 70) };
        assert_eq!(height_mm(&log, &place, &park), expect, "{state:?} {made_safe:?}");
    };
    check(State::Printing, None, Some(0.2));
    check(State::Printing, Some(Some(33.0)), Some(33.0));
    check(State::Printing, Some(None), None);
    check(State::Paused, None, Some(10.2));
    check(State::Paused, Some(Some(33.0)), Some(33.0));
}

fn plan_of(commands: &[String], rules: &ResumeRules) -> Plan {
    let place = walk(commands, commands.len(), rules.depth()).place().unwrap();
    plan(&place, place.lowest_mm, rules)
}

/// `what: lines` of each step.
fn steps(plan: &Plan) -> Vec<String> {
    plan.steps.iter().map(|s| format!("{}: {}", s.what, s.lines.join("; "))).collect()
}

#[test]
fn the_way_back_step_by_step() {
    let commands = file(&[&line("M106 S128; M204 S800; T0"), &beads(60)]);
    assert_eq!(
        steps(&plan_of(&commands, &rules())),
        [
            "heat the bed to 60 °C, then the nozzle to 150 °C, so that it comes off the part: M190 S60; M109 S150",
            "take the nozzle to be at 0.2 mm and raise it by 10 mm: G21; G90; G92 Z0.2; G91; G1 Z10 F300; G90",
            "home X and Y, Z staying up: G28 R0 X Y",
            "restore bed levelling: M420 S1",
            "heat up as the file wants it here: M109 S210; M190 S60",
            "prime the nozzle beside the part: M83; G1 E10 F150; G21; G90; M83; G1 E-2 F1800",
            "go above X 38 Y 5: G0 Z10.2 F300; G0 X38 Y5 F3000",
            "go down to Z 0.2 and go on: G0 Z0.2 F300; G1 E2 F1800; M204 S800; G92 E3.8; M106 S128; G1 F3000; \
             G90; M83",
        ]
    );
    // What the profile says takes the place of what every Marlin understands.
    let own = ResumeRules {
        raise_mm: 5.0,
        soften_c: 170.0,
        z_set: line("G92.9 Z{z}; M114"),
        home: line("G28 X Y"),
        levelling: Vec::new(),
        prime: line("G1 X0 Y0; G1 E30"),
        ..rules()
    };
    let got = steps(&plan_of(&commands, &own));
    let expect = [
        "M190 S60; M109 S170",
        "G21; G90; G92.9 Z0.2; M114; G91; G1 Z5 F300; G90",
        "G28 X Y",
        "M109 S210; M190 S60",
        "M83; G1 X0 Y0; G1 E30; G21; G90; M83; G1 E-2 F1800",
        "G0 Z5.2 F300; G0 X38 Y5 F3000",
    ];
    for (got, expect) in got.iter().zip(expect) {
        assert!(got.ends_with(&format!(": {expect}")), "{got}\nis not {expect}");
    }
}

/// Lines of a file's body; the modes of a step that goes up and comes down again are its own.
fn body() -> impl Strategy<Value = Vec<String>> {
    let mm = |least: i32, most: i32| (least..most).prop_map(|n| f64::from(n) / 100.0);
    let bead = || {
        (mm(0, 20_000), mm(0, 20_000), mm(1, 500)).prop_map(|(x, y, e)| vec![format!("G1 X{x} Y{y} E{e}")])
    };
    prop_oneof![
        8 => bead(),
        2 => (mm(0, 20_000), 60..9000i32).prop_map(|(x, f)| vec![format!("G0 X{x} F{f}")]),
        2 => (mm(0, 20_000), mm(1, 200)).prop_map(|(x, e)| vec![
            "G21".to_owned(),
            "M83".to_owned(), format!("G1 E-{e} F1800"), "G91".to_owned(), "G1 Z0.4".to_owned(),
            format!("G1 X{x}"), "G1 Z-0.4".to_owned(), "G90".to_owned(), "M83".to_owned(), format!("G1 E{e}"),
        ]),
        1 => mm(0, 20_000).prop_map(|x| line(&format!("G10; G0 X{x}; G11"))),
        1 => mm(0, 20_000).prop_map(|x| line(&format!("M82; G92 E0; G1 X{x} Y1 E1; G1 X3 Y{x} E2; M83"))),
        1 => mm(0, 500).prop_map(|x| vec![format!("G92 X{x}")]),
        1 => mm(0, 500).prop_map(|e| vec![format!("G92 E{e}")]),
        1 => (0..=255).prop_map(|s| vec![format!("M106 S{s}"), format!("M106 P1 S{s}")]),
        1 => (170..260).prop_map(|c| vec![format!("M104 S{c}")]),
        1 => (0..110).prop_map(|c| vec![format!("M140 S{c}")]),
        1 => prop::sample::select(vec!["M220 S50", "M221 S90", "M221 S110", "G20", "G21", "T1", "T0", "M107"]).prop_map(|l| vec![l.to_owned()]),
    ]
}

proptest! {
    /// From power-on, the way back leads to the machine that the file has made of it where it
    /// goes on; nothing moves before the nozzle is soft, nor across before it was raised; and
    /// what is sent again leads to where it broke off.
    #[test]
    fn the_way_back_leads_to_where_the_file_is(
        parts in prop::collection::vec(body(), 40..120),
        heights in prop::collection::vec(0..3u32, 120),
        raise_mm in 1..30i32,
    ) {
        let rules = ResumeRules { raise_mm: f64::from(raise_mm), ..rules() };
        let mut commands = file(&[&line("M104 T1 S0; G1 X5 Y5 E1")]);
        let mut z = 20;
        for (part, up) in parts.iter().zip(&heights) {
            commands.extend(part.iter().cloned());
            if *up == 0 {
                z += 20;
                commands.extend([format!("G1 Z{}", f64::from(z) / 100.0)]);
            }
        }
        // Inches would make a step of 20 mm look like 500 mm: heights are in mm.
        let commands: Vec<_> = commands
            .iter()
            .flat_map(|c| match c.starts_with("G1 Z") {
                true => vec!["G21".to_owned(), c.clone()],
                false => vec![c.clone()],
            })
            .collect();
        let walked = walk(&commands, commands.len(), rules.depth());
        let whole = format!("{:?}", walked.tracker());
        let place = match walked.place() {
            Ok(place) => place,
            // Too few moves.
            Err(refusal) => return Err(TestCaseError::reject(refusal.to_string())),
        };
        let after = place.after as usize;
        prop_assert!(place.moves >= rules.depth(), "{} moves", place.moves);
        let plan = plan(&place, place.lowest_mm, &rules);
        let fresh = || Reference::new(true);
        let at_place = fresh().after(&commands[..after]);

        let mut machine = fresh();
        // The power was cut with the nozzle there.
        machine.body[2] = place.lowest_mm;
        let last = plan.steps.len() - 1;
        for (at, step) in plan.steps.iter().enumerate() {
            for line in &step.lines {
                let was = machine.body;
                machine.run(line);
                let moved = |axis: usize| (machine.body[axis] - was[axis]).abs() > 1e-9;
                let homes = line.starts_with("G28");
                if (0..3).any(moved) || homes {
                    prop_assert!(machine.nozzles_c.iter().any(|c| *c >= 150.0), "{line}: the nozzle sticks");
                }
                if moved(0) || moved(1) || homes {
                    let up = was[2] > place.lowest_mm + rules.raise_mm - 1e-6;
                    prop_assert!(up, "{line} goes across at {:?}", was);
                }
                prop_assert!(machine.body[2] > was[2] - 1e-6 || at == last, "{line} goes down");
            }
            if let ZDuring::MovesTo(z) = step.z {
                prop_assert!((machine.body[2] - z).abs() < 1e-5, "{}: {z} {:?}", step.what, machine.body);
            }
        }
        prop_assert_eq!(machine.told(), at_place.told());

        let mut again = place.tracker;
        for kept in &place.between {
            again.apply(&kept.text);
        }
        prop_assert_eq!(format!("{again:?}"), whole);
    }
}
