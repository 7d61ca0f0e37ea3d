//! The table, played: what each phase waits for, and that nothing goes before its time.
use super::script::{Layer, Rules, Step, Timing, Way, word};
use super::*;
use proptest::prelude::*;

fn rules(timing: Timing) -> Rules {
    let lines = |text: &str| text.split('\n').map(str::to_owned).collect::<Vec<_>>();
    Rules {
        timing,
        on: lines("M106 S{power}"),
        off: lines("M107"),
        pulse: lines("M810 M106 S{power}|G4 P{ms}|M107\nM810"),
        dwell: "G4 P{ms}".to_owned(),
        lead_ms: 100,
        done: lines("M400\nM118 {word}"),
        home: Vec::new(),
        checks: Vec::new(),
    }
}

fn script(timing: Timing, layers: u32) -> Script {
    let layer = |n: u32| Layer {
        z_mm: f64::from(n + 1) * 0.05,
        exposure_ms: 2_000,
        power: 255,
        lift: [Way { mm: 5.0, mm_min: 60.0 }, Way::default()],
        retract: [Way { mm: 4.0, mm_min: 150.0 }, Way { mm: 1.0, mm_min: 50.0 }],
        settle_ms: 500,
        rest_ms: 200,
        top_ms: 0,
    };
    Script::new(rules(timing), (0..layers).map(layer).collect())
}

/// A machine that is fed all that it takes, and what it wants of the screen.
struct Play {
    machine: Exposure,
    orders: Vec<Order>,
    sent: Vec<String>,
    now_ms: u64,
}

impl Play {
    fn new(timing: Timing, layers: u32) -> Self {
        let machine = Exposure::new(script(timing, layers));
        let mut play = Self { machine, orders: Vec::new(), sent: Vec::new(), now_ms: 0 };
        play.on(Event::Begin);
        play
    }

    fn on(&mut self, event: Event<'_>) {
        self.machine.on(event, self.now_ms, &mut self.orders);
    }

    /// Takes all lines that may go.
    fn feed(&mut self) -> Vec<String> {
        let mut fed = Vec::new();
        while self.machine.may() != May::Wait
            && self.machine.script().place().layer < self.machine.script().layers()
        {
            self.on(Event::Taken);
            fed.push(self.machine.script().line().to_owned());
            if self.machine.phase() == Phase::Between {
                break;
            }
        }
        self.sent.extend(fed.clone());
        fed
    }

    fn acknowledge(&mut self) {
        let lines = self.machine.script().place().lines;
        self.on(Event::Acknowledged(lines));
    }

    fn keep(&mut self) {
        let lines = self.machine.script().place().lines;
        self.on(Event::Durable(lines));
    }

    fn say(&mut self, step: Step) {
        let words = word(step, self.machine.layer());
        self.on(Event::Heard(&words));
    }

    fn pass(&mut self, ms: u64) {
        self.now_ms += ms;
        self.on(Event::Tick);
    }

    fn orders(&mut self) -> Vec<Order> {
        std::mem::take(&mut self.orders)
    }
}

#[test]
fn a_layer_waits_for_each_thing_in_its_turn() {
    let mut p = Play::new(Timing::Controller, 2);
    assert_eq!(p.orders(), [Order::Blank, Order::Load(0)]);
    assert_eq!(p.machine.phase(), Phase::Between);
    assert!(p.machine.may_hold());
    assert_eq!(p.feed().last().unwrap(), "M118 Z_move_comp 0");
    assert!(!p.machine.may_hold());
    // What the printer says of another layer is not its word.
    p.on(Event::Heard("Z_move_comp 1"));
    p.on(Event::Heard("light_off 0"));
    assert_eq!(p.machine.phase(), Phase::Moving);
    p.say(Step::Lower);
    assert_eq!(p.machine.phase(), Phase::Settling);
    // The word comes ahead of its line's `ok`: a checkpoint now would not tell of that line.
    assert!(!p.machine.take_note());
    p.acknowledge();
    assert!(p.machine.take_note() && !p.machine.take_note());
    // Three things, in any order; none is enough.
    p.pass(500);
    p.keep();
    assert_eq!((p.machine.phase(), p.orders()), (Phase::Settling, vec![]));
    p.on(Event::Loaded(0));
    assert_eq!((p.machine.phase(), p.orders()), (Phase::Showing, vec![Order::Show(0)]));
    assert_eq!(p.machine.may(), May::Wait);
    p.on(Event::Shown(0));
    assert_eq!((p.machine.phase(), p.machine.may()), (Phase::Exposing, May::GoAlone));
    assert_eq!(p.feed(), ["G4 P100", "M106 S255", "G4 P2000", "M107", "M118 light_off 0"]);
    assert_eq!(p.machine.may(), May::Wait);
    p.pass(2_100);
    p.acknowledge();
    assert_eq!((p.machine.phase(), p.orders()), (Phase::Exposing, vec![]), "dark too early");
    p.say(Step::Expose);
    assert_eq!(p.machine.phase(), Phase::Resting);
    assert_eq!(p.orders(), [Order::Blank, Order::Load(1)]);
    assert!(p.machine.take_note());
    p.on(Event::Blanked);
    p.keep();
    assert_eq!(p.machine.may(), May::Wait, "lifted before its rest");
    p.pass(200);
    assert_eq!((p.machine.phase(), p.machine.may()), (Phase::Lifting, May::Go));
    assert_eq!(p.feed(), ["G1 Z5.05 F60"]);
    assert_eq!((p.machine.phase(), p.machine.layer()), (Phase::Between, 1));
}

const TABLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/resin-printing.md");

/// A machine that has just come to a phase, with nothing of what that needs.
fn at(phase: Phase) -> Play {
    let mut p = Play::new(Timing::Controller, 2);
    p.feed();
    let steps: [(&[&str], Phase); 4] = [
        (&["Said"], Phase::Settling),
        (&["Time", "Loaded", "Durable"], Phase::Showing),
        (&["Shown"], Phase::Exposing),
        (&["Said"], Phase::Resting),
    ];
    for (needs, to) in steps {
        if p.machine.phase() == phase {
            break;
        }
        needs.iter().for_each(|need| p.give(need));
        assert_eq!(p.machine.phase(), to);
        p.feed();
    }
    p.orders();
    p.acknowledge();
    p.machine.take_note();
    p
}

impl Play {
    fn give(&mut self, need: &str) {
        match need {
            "Said" if self.machine.phase() == Phase::Moving => self.say(Step::Lower),
            "Said" => self.say(Step::Expose),
            "Time" => self.pass(500),
            "Loaded" => self.on(Event::Loaded(self.machine.layer())),
            "Durable" => self.keep(),
            "Shown" => self.on(Event::Shown(self.machine.layer())),
            "Blanked" => self.on(Event::Blanked),
            other => panic!("{other} is nothing that a phase needs"),
        }
    }
}

#[test]
fn the_table_in_the_docs_is_what_the_machine_does() {
    let text = std::fs::read_to_string(TABLE).expect("docs/resin-printing.md");
    let table = text.split("<!-- table -->").nth(1).expect("a table");
    let rows = table.trim_start().lines().skip(2).take_while(|line| line.starts_with('|'));
    let mut phases = Vec::new();
    for row in rows {
        let cells: Vec<&str> = row.trim_matches('|').split('|').map(str::trim).collect();
        let [phase, line, needs, then, next] = cells[..] else { panic!("{row}") };
        let phases_all = [Phase::Moving, Phase::Settling, Phase::Showing, Phase::Exposing, Phase::Resting];
        let phase_is = *phases_all.iter().find(|p| format!("{p:?}") == phase).expect("a phase");
        let needs: Vec<&str> = needs.split(", ").collect();
        // A line goes, or not, before anything has come. `at` has fed what goes: it is seen one line back.
        let mut fresh = Exposure::new(script(Timing::Controller, 2));
        if phase_is == Phase::Exposing {
            let mut p = at(Phase::Showing);
            p.give("Shown");
            fresh = p.machine;
        } else if phase_is == Phase::Moving {
            fresh.on(Event::Begin, 0, &mut Vec::new());
            fresh.on(Event::Taken, 0, &mut Vec::new());
        } else {
            fresh = at(phase_is).machine;
        }
        let goes = match line {
            "goes" => May::Go,
            "goes alone" => May::GoAlone,
            "waits" => May::Wait,
            other => panic!("{other}"),
        };
        assert_eq!((fresh.phase(), fresh.may()), (phase_is, goes), "{row}");
        for last in &needs {
            let mut p = at(phase_is);
            needs.iter().filter(|need| *need != last).for_each(|need| p.give(need));
            assert_eq!(p.machine.phase(), phase_is, "without {last}: {row}");
            p.give(last);
            assert_eq!(format!("{:?}", p.machine.phase()), next, "with {last}: {row}");
            let mut did: Vec<String> = p
                .orders()
                .iter()
                .map(|order| format!("{order:?}").split('(').next().unwrap_or_default().to_owned())
                .collect();
            p.acknowledge();
            if p.machine.take_note() {
                did.push("note".to_owned());
            }
            let did = if did.is_empty() { "–".to_owned() } else { did.join(", ") };
            assert_eq!(did, then, "{row}");
        }
        phases.push(phase_is);
    }
    assert_eq!(phases.len(), 5, "each phase that waits has its row");
}

#[test]
fn what_is_no_matter_of_time_is_not_asked_for_all_the_time() {
    let mut p = Play::new(Timing::Controller, 1);
    p.feed();
    p.acknowledge();
    p.say(Step::Lower);
    assert_eq!(p.machine.due_ms(), Some(500));
    p.pass(500);
    // The picture and the record come by themselves.
    assert_eq!((p.machine.phase(), p.machine.due_ms()), (Phase::Settling, None));
    p.keep();
    p.on(Event::Loaded(0));
    p.on(Event::Shown(0));
    p.feed();
    p.acknowledge();
    p.say(Step::Expose);
    assert_eq!((p.machine.phase(), p.machine.due_ms()), (Phase::Resting, Some(700)));
    p.pass(200);
    assert_eq!(
        (p.machine.phase(), p.machine.due_ms()),
        (Phase::Resting, None),
        "the display is not dark yet"
    );
}

#[test]
fn a_word_that_got_lost_costs_seconds_and_not_the_print() {
    let mut p = Play::new(Timing::Controller, 1);
    p.feed();
    p.pass(10_000);
    assert_eq!(p.machine.phase(), Phase::Moving, "nothing was acknowledged");
    p.acknowledge();
    assert_eq!(p.machine.due_ms(), Some(10_000 + LOST_WORD_MS));
    p.pass(LOST_WORD_MS - 1);
    assert_eq!(p.machine.phase(), Phase::Moving);
    p.pass(1);
    assert_eq!((p.machine.phase(), p.machine.lost_words()), (Phase::Settling, 1));
    p.on(Event::Loaded(0));
    p.keep();
    p.pass(500);
    p.on(Event::Shown(0));
    p.feed();
    // Acknowledgements that came too early: the light may still be on.
    p.acknowledge();
    p.pass(2_100 + LOST_WORD_MS - 1);
    assert_eq!(p.machine.phase(), Phase::Exposing);
    p.pass(1);
    assert_eq!((p.machine.phase(), p.machine.lost_words()), (Phase::Resting, 2));
}

#[test]
fn a_host_that_keeps_the_time_sends_off_when_it_is_over() {
    let mut p = Play::new(Timing::Host, 1);
    p.feed();
    p.say(Step::Lower);
    p.on(Event::Loaded(0));
    p.keep();
    p.pass(500);
    p.on(Event::Shown(0));
    assert_eq!(p.feed(), ["G4 P100", "M106 S255"]);
    assert_eq!(p.machine.may(), May::Wait, "light on was not acknowledged");
    // Its answer may have got lost: the printer is asked.
    assert_eq!(p.machine.due_ms(), Some(500 + LATE_MS));
    assert!(!p.machine.take_question(500 + LATE_MS - 1));
    assert!(p.machine.take_question(500 + LATE_MS) && !p.machine.take_question(500 + LATE_MS));
    p.pass(70);
    p.acknowledge();
    assert_eq!(p.machine.due_ms(), Some(570 + 2_000));
    p.pass(1_999);
    assert_eq!(p.machine.may(), May::Wait);
    p.pass(1);
    assert_eq!(p.feed(), ["M107", "M118 light_off 0"]);
}

#[test]
fn a_lost_answer_to_light_on_does_not_make_it_longer() {
    let mut p = Play::new(Timing::Host, 1);
    p.feed();
    p.say(Step::Lower);
    p.on(Event::Loaded(0));
    p.keep();
    p.pass(500);
    p.on(Event::Shown(0));
    assert_eq!(p.feed(), ["G4 P100", "M106 S255"]);
    p.pass(LATE_MS);
    assert!(p.machine.take_question(p.now_ms));
    p.pass(10);
    p.on(Event::Arrived);
    assert_eq!(p.machine.due_ms(), Some(500 + 2_000), "from when it was sent");
    p.pass(2_000 - LATE_MS - 10);
    assert_eq!(p.machine.may(), May::Go, "does not wait for the lost answer");
    p.on(Event::Taken);
    assert_eq!(p.machine.script().line(), "M107");
    assert_eq!(p.machine.due_ms(), Some(2_500 + LATE_MS), "and asks for light off");
}

#[test]
fn the_tail_of_a_line_may_say_the_word_too_early() {
    // Whether a line was asked for again, and so long after the first the word comes: whether it is believed.
    let check = |asked_again: bool, after_ms: u64, believed: bool| {
        let mut p = at(Phase::Showing);
        p.give("Shown");
        p.feed();
        if asked_again {
            p.on(Event::AskedAgain);
        }
        p.pass(after_ms);
        p.say(Step::Expose);
        assert_eq!(p.machine.phase() == Phase::Resting, believed, "{asked_again} {after_ms}");
    };
    check(true, 100, false);
    check(true, 2_099, false);
    check(true, 2_100, true);
    // A clock that runs faster than ours is no fault.
    check(false, 100, true);
}

#[test]
fn the_tail_of_a_line_may_say_that_the_plate_stands() {
    let mut p = Play::new(Timing::Controller, 1);
    p.feed();
    p.on(Event::AskedAgain);
    p.say(Step::Lower);
    assert_eq!(p.machine.phase(), Phase::Moving, "the wait for the moves is not acknowledged");
    p.acknowledge();
    assert_eq!(p.machine.phase(), Phase::Settling);
}

#[test]
fn it_begins_wherever_the_script_stands() {
    // After so many lines: the phase, and what may come.
    let check = |lines: u64, phase: Phase, may: May| {
        let mut script = script(Timing::Controller, 2);
        script.go_to(lines);
        let mut machine = Exposure::new(script);
        let mut orders = Vec::new();
        machine.on(Event::Begin, 0, &mut orders);
        assert_eq!((machine.phase(), machine.may()), (phase, may), "{lines}");
        assert_eq!(orders[0], Order::Blank);
    };
    check(0, Phase::Between, May::Go);
    check(3, Phase::Moving, May::Go);
    // The word was said to a host that is dead; the plate was found where it should be.
    check(6, Phase::Settling, May::Wait);
    // All but the question.
    check(10, Phase::Exposing, May::Go);
    check(11, Phase::Resting, May::Wait);
    check(12, Phase::Between, May::Go);
    check(14, Phase::Moving, May::Go);
    check(u64::MAX, Phase::Over, May::Go);
}

proptest! {
    /// Whatever comes in whatever order: the light's lines go only while the layer's picture is shown,
    /// and no order for the screen comes between them and the word behind them.
    #[test]
    fn light_and_picture_go_together(
        timing in prop::sample::select(vec![Timing::Controller, Timing::Pulse, Timing::Host]),
        events in prop::collection::vec((0_u8..9, 0_u64..3_000), 1..400),
    ) {
        let mut p = Play::new(timing, 3);
        let mut shown: Option<u32> = None;
        let mut lit = false;
        for (event, ms) in events {
            match event {
                0 => p.pass(ms),
                1 => p.acknowledge(),
                2 => p.keep(),
                3 => p.say(Step::Lower),
                4 => p.say(Step::Expose),
                5 => p.on(Event::Loaded(p.machine.layer())),
                6 if shown.is_some() => p.on(Event::Shown(p.machine.layer())),
                7 if shown.is_none() => p.on(Event::Blanked),
                _ => {
                    for line in p.feed() {
                        if line.starts_with("M106") || line == "M810" {
                            prop_assert_eq!(shown, Some(p.machine.layer()));
                            lit = true;
                        }
                        if line.starts_with("G1") {
                            prop_assert!(!lit && shown.is_none(), "moves while lit or shown");
                        }
                    }
                }
            }
            // Only the printer's word, or its time and more, says that it is off.
            for order in p.orders() {
                match order {
                    Order::Show(layer) => { prop_assert!(!lit); shown = Some(layer); }
                    Order::Blank => { lit = false; shown = None; }
                    Order::Load(_) => {}
                }
            }
            if lit {
                prop_assert_eq!(p.machine.phase(), Phase::Exposing);
                prop_assert!(!p.machine.may_hold());
            }
        }
    }
}
