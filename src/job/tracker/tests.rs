//! What lines add up to, and the way back: against tables, and against a machine that
//! shares no code with the tracker.
use super::*;
use crate::job::reference::Reference;
use proptest::prelude::*;

/// Position, E, feed rate and modes; `?` where lines do not tell.
fn told(t: &Tracker) -> String {
    let or = |value: Option<f64>| value.map_or("?".to_owned(), number);
    let m = &t.machine;
    let absolute = |is: bool| if is { "abs" } else { "rel" };
    let [x, y, z] = [0, 1, 2].map(|axis| or(t.at_mm(axis)));
    let inches = if m.inches { " in" } else { "" };
    let (e, f, axes, filament) =
        (or(t.e_mm()), number(m.feed), absolute(m.absolute), absolute(m.e_is_absolute()));
    format!("X{x} Y{y} Z{z} E{e} F{f} {axes} {filament} T{}{inches}", t.tool())
}

fn of(e_modes: EModes, lines: &str) -> Tracker {
    let mut tracker = Tracker::keeping_settings(e_modes);
    for line in lines.split("; ") {
        tracker.apply(line.as_bytes());
    }
    tracker
}

#[test]
fn lines_add_up_to_a_state() {
    let check_in = |e_modes, lines: &str, expect: &str| {
        assert_eq!(told(&of(e_modes, lines)), expect, "{lines}");
    };
    let check = |lines: &str, expect: &str| check_in(EModes::WithAxes, lines, expect);
    check("M105", "X? Y? Z? E? F0 abs abs T0");
    check("G1 X1 Y2 F1200; G1 Z0.2 E3", "X1 Y2 Z0.2 E3 F1200 abs abs T0");
    // A relative move from an unknown place leads to one.
    check("G91; G1 X1; G90; G1 Y5", "X? Y5 Z? E? F0 abs abs T0");
    check("G1 X1 Y1 Z1; G91; G1 X1 Z-0.5", "X2 Y1 Z0.5 E? F0 rel rel T0");
    check("G92 E0; M83; G1 E2; G1 E-0.5", "X? Y? Z? E1.5 F0 abs rel T0");
    // Homing leaves the head where its end stops are, G92 renames where it is.
    check("G1 X1 Y2 Z3; G28 X", "X? Y2 Z3 E? F0 abs abs T0");
    check("G1 X1 Y2 Z3; G28", "X? Y? Z? E? F0 abs abs T0");
    check("G1 X10 Y2 Z3; G92 X0; G1 Y4", "X0 Y4 Z3 E? F0 abs abs T0");
    check("G20; G1 X1 F60", "X25.4 Y? Z? E? F1524 abs abs T0 in");
    check("G1 X1 F600; G1 X2 F0", "X2 Y? Z? E? F600 abs abs T0");
    check("T1; G1 X1", "X1 Y? Z? E? F0 abs abs T1");
    // The head goes elsewhere by itself.
    for away in ["G29", "G27", "G12", "G28.1", "PRINT_START BED=60", "G80"] {
        check(&format!("G1 X1 Y2 Z3; {away}"), "X? Y? Z? E? F0 abs abs T0");
    }
    for still in ["G4 P5", "SET_PRINT_STATS_INFO CURRENT_LAYER=2", "EXCLUDE_OBJECT NAME=a", "M400"] {
        check(&format!("G1 X1 Y2 Z3; {still}"), "X1 Y2 Z3 E? F0 abs abs T0");
    }
    // G90 and G91 and E: two families.
    check("M83; G90", "X? Y? Z? E? F0 abs abs T0");
    check("G91; M82", "X? Y? Z? E? F0 rel abs T0");
    check_in(EModes::Alone, "M83; G90", "X? Y? Z? E? F0 abs rel T0");
    check_in(EModes::Alone, "M82; G91", "X? Y? Z? E? F0 rel abs T0");
}

#[test]
fn dials_are_as_lines_have_set_them() {
    let check = |lines: &str, expect: &dyn Fn(&Dials) -> bool| {
        let tracker = of(EModes::WithAxes, lines);
        assert!(expect(&tracker.dials), "{lines}: {:?}", tracker.dials);
    };
    check("M105", &|d| *d == Dials::default());
    check("M106", &|d| d.fans[0] == Some(255.0));
    check("M106 S300; M106 P1 S20", &|d| d.fans[..2] == [Some(255.0), Some(20.0)]);
    check("M106 S9; M107", &|d| d.fans[0] == Some(0.0));
    check("M106 P9 S20", &|d| d.fans == [None; MAX_FANS]);
    check("M104 S200; M104 T1 S180", &|d| d.nozzles_c[..2] == [Some(200.0), Some(180.0)]);
    check("T1; M109 R190", &|d| d.nozzles_c[..2] == [None, Some(190.0)]);
    check("M190 S60; M140", &|d| d.bed_c == Some(60.0));
    check("M141 S40", &|d| d.chamber_c == Some(40.0));
    check("M220 S80; M220 B; M220 S50; M220 R", &|d| d.speed_percent == Some(80.0));
    check("M221 S95; M221 T1 S90", &|d| d.flow_percent[..2] == [Some(95.0), Some(90.0)]);
}

#[test]
fn settings_are_kept_the_latest_of_each_kind() {
    let check = |lines: &str, expect: &[&str]| {
        assert_eq!(of(EModes::WithAxes, lines).settings().collect::<Vec<_>>(), expect, "{lines}");
    };
    check("M205 X8 Y8; M900 K0.1; M205 X9 Y9; G1 X1; M104 S200", &["M900 K0.1", "M205 X9 Y9"]);
    check("M204 P500; M204 S800", &["M204 P500", "M204 S800"]);
    check(
        "M204 P500 T1500; M204 P800 T900; M900 T0 K0.1; M900 T1 K0.2",
        &["M204 P800 T900", "M900 T0 K0.1", "M900 T1 K0.2"],
    );
    check(
        "SET_PRESSURE_ADVANCE ADVANCE=0.1; SET_PRESSURE_ADVANCE ADVANCE=0.2",
        &["SET_PRESSURE_ADVANCE ADVANCE=0.2"],
    );
    check("SET_PRINT_STATS_INFO CURRENT_LAYER=1; EXCLUDE_OBJECT NAME=a", &[]);
    check(&format!("M900 K0.{}", "1".repeat(90)), &[]);
    let many: Vec<_> = (0..40).map(|n| format!("M92 T{n}")).collect();
    let kept = of(EModes::WithAxes, &many.join("; "));
    assert_eq!(kept.settings().collect::<Vec<_>>(), many[8..], "the oldest go first");
}

fn report(x_mm: f64, y_mm: f64, z_mm: f64, e_mm: Option<f64>) -> Position {
    Position { x_mm, y_mm, z_mm, e_mm }
}

#[test]
fn a_report_makes_good_what_lines_do_not_tell() {
    let mut t = of(EModes::WithAxes, "G28; G92 E0; G1 X5 F600");
    t.resolve(report(9.0, 8.0, 7.0, Some(6.0)));
    assert_eq!(told(&t), "X5 Y8 Z7 E0 F600 abs abs T0");
    t.relocate(report(9.0, 8.0, 7.5, Some(6.0)));
    assert_eq!(told(&t), "X9 Y8 Z7.5 E0 F600 abs abs T0");

    let t = of(EModes::WithAxes, "G1 X5 Y6; G92 E1000");
    let check = |report, expect: Result<(), &str>| {
        assert_eq!(t.agrees(report), expect.map_err(str::to_owned), "{report:?}");
    };
    check(report(5.02, 6.0, 77.0, Some(1000.1)), Ok(()));
    check(report(5.0, 6.0, 77.0, None), Ok(()));
    check(report(5.03, 6.0, 0.0, None), Err("X should be at 5.00 mm and is at 5.03 mm"));
    check(report(5.0, 5.0, 0.0, None), Err("Y should be at 6.00 mm and is at 5.00 mm"));
    check(report(5.0, 6.0, 0.0, Some(1000.2)), Err("E should be at 1000.00 mm and is at 1000.20 mm"));
}

#[test]
fn filament_pulled_back_is_known_through_flow_and_g92() {
    let check = |lines: &str, expect_mm: f64| {
        let back_mm = of(EModes::WithAxes, lines).retracted_mm();
        assert!((back_mm - expect_mm).abs() < 1e-9, "{lines}: {back_mm}");
    };
    check("G92 E0; G1 E5; G1 E3", 2.0);
    check("G92 E0; G1 E5; G92 E0; G1 E-1", 1.0);
    check("M83; G1 E5; M221 S50; G1 E-2", 1.0);
    // How far the first goes is not known.
    check("G1 E50; G1 E49", 1.0);
}

#[test]
fn the_way_back_line_by_line() {
    let check = |file: &str, park: &str, expect: &str| {
        let want = of(EModes::WithAxes, file);
        let mut now = want.clone();
        park.split("; ").for_each(|line| _ = now.apply(line.as_bytes()));
        assert_eq!(unpark(&now, &want, 10.0).join("; "), expect, "{file} | {park}");
    };
    let file = "G92 E0; M104 S210; M140 S60; M106 S128; G1 X50 Y60 Z0.4 E2 F1500";
    check(
        file,
        "M83; G1 E-2 F1800; G91; G1 Z10 F600; G90; G1 X0 Y0 F6000",
        "G21; G90; M83; G0 X50 Y60 F3000; G0 Z0.4 F600; G1 E2 F1800; G92 E2; G1 F1500; G90; M82",
    );
    // Cooled meanwhile, the fan off: heat first, the fan last.
    check(
        file,
        "M104 S150; M140 S0; M107",
        "M140 S60; M109 S210; M190 S60; G21; G90; M83; G0 X50 Y60 F3000; G0 Z0.4 F600; G92 E2; M106 S128; \
         G1 F1500; G90; M82",
    );
    // Lower than the part, or nobody knows how high: up before across.
    check(
        "G1 X50 Y60 Z5 F1500; M83",
        "G1 Z1 F600",
        "G21; G90; M83; G0 Z5 F600; G0 X50 Y60 F3000; G0 Z5 F600; G1 F1500; G90; M83",
    );
    check(
        "G1 X50 Y60 Z5 F1500; M83",
        "G27 P2",
        "G21; G90; M83; G0 Z15 F600; G0 X50 Y60 F3000; G0 Z5 F600; G1 F1500; G90; M83",
    );
}

/// Lines that files and macros are made of. Every one means the same to all firmwares,
/// but for what `G90` and `G91` do to E.
fn line() -> impl Strategy<Value = String> {
    let mm = |least: i32, most: i32| (least..most).prop_map(|n| number(f64::from(n) / 100.0));
    prop_oneof![
        4 => (mm(0, 20_000), mm(0, 20_000), mm(-500, 500)).prop_map(|(x, y, e)| format!("G1 X{x} Y{y} E{e}")),
        2 => (mm(0, 20_000), 1..9000i32).prop_map(|(x, f)| format!("G0 X{x} F{f}")),
        2 => mm(0, 2_000).prop_map(|z| format!("G1 Z{z}")),
        1 => mm(-500, 500).prop_map(|e| format!("G1 E{e} F1800")),
        1 => mm(0, 500).prop_map(|e| format!("G92 E{e}")),
        1 => mm(0, 500).prop_map(|x| format!("G92 X{x}")),
        1 => mm(0, 500).prop_map(|z| format!("G92 Z{z}")),
        2 => prop::sample::select(vec!["G90", "G91", "M82", "M83", "G20", "G21", "G10", "G11", "M107"])
            .prop_map(str::to_owned),
        1 => (0..=255).prop_map(|s| format!("M106 S{s}")),
        1 => (0..=255).prop_map(|s| format!("M106 P1 S{s}")),
        1 => (0..260).prop_map(|c| format!("M104 S{c}")),
        1 => (0..260).prop_map(|c| format!("M104 T1 S{c}")),
        1 => (0..110).prop_map(|c| format!("M140 S{c}")),
        1 => prop::sample::select(vec![50, 100, 120]).prop_map(|s| format!("M220 S{s}")),
        1 => prop::sample::select(vec![90, 100, 110]).prop_map(|s| format!("M221 S{s}")),
    ]
}

/// After these all is known.
const KNOWN: &str = "G28; G90; M82; G92 E0; M104 S200; M104 T1 S0; M140 S60; M106 S0; M106 P1 S0; M220 S100; \
                     M221 S100; M221 T1 S100; G1 X10 Y10 Z0.3 E0 F3000";

proptest! {
    /// Wherever the file is and wherever the pause macro leads: the machine is as it was, to
    /// the last mode, and does not go across lower than where it goes to.
    #[test]
    fn the_way_back_restores_the_machine(
        file in prop::collection::vec(line(), 0..40),
        tool: bool,
        macro_lines in prop::collection::vec(line(), 0..10),
        alone: bool,
    ) {
        let e_modes = if alone { EModes::Alone } else { EModes::WithAxes };
        let mut want = of(e_modes, KNOWN);
        let mut machine = Reference::new(!alone).after(KNOWN.split("; "));
        let tool = if tool { "T1" } else { "T0" };
        for line in std::iter::once(tool).chain(file.iter().map(String::as_str)) {
            want.apply(line.as_bytes());
            machine.run(line);
        }
        let before = machine.clone();
        let mut now = want.clone();
        for line in &macro_lines {
            now.apply(line.as_bytes());
            machine.run(line);
        }
        for line in unpark(&now, &want, 10.0) {
            let was = machine.body;
            machine.run(&line);
            let across = (0..2).any(|axis| (machine.body[axis] - was[axis]).abs() > 1e-6);
            prop_assert!(!across || machine.body[2] > before.body[2] - 1e-6, "{line} at {:?}", machine.body);
        }
        let filament_mm = machine.body[3] - before.body[3];
        prop_assert!(filament_mm.abs() < 1e-4, "{filament_mm} mm of filament");
        // How far the macro has pushed it is in the most that ever was.
        let pulled = |mut machine: Reference| { machine.run("G92 E0"); machine };
        let (now, then) = (pulled(machine.clone()), pulled(before.clone()));
        prop_assert!((machine.named[3] - before.named[3]).abs() < 1e-4, "E {} {}", machine.named[3], before.named[3]);
        prop_assert_eq!(without_back(&now.told()), without_back(&then.told()));
    }
}

/// The text without what is pulled back.
fn without_back(told: &str) -> String {
    let (head, tail) = told.split_once(" back ").unwrap();
    format!("{head} {}", tail.split_once(' ').unwrap().1)
}
