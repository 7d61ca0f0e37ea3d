//! The table of `docs/job-states.md` and the function say the same, pair by pair.
use super::*;
use std::collections::BTreeMap;

const TABLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/job-states.md");

fn cell(decision: Decision, reasons: &mut Vec<&'static str>) -> String {
    match decision {
        Decision::To(state) => format!("{state:?}"),
        Decision::Stay => "·".to_owned(),
        Decision::Refuse(why) => {
            let at = reasons.iter().position(|r| *r == why).unwrap_or_else(|| {
                reasons.push(why);
                reasons.len() - 1
            });
            format!("✗{}", at + 1)
        }
    }
}

/// The two tables, from the function.
fn tables() -> String {
    let mut reasons = Vec::new();
    let mut text = String::from("| |");
    let name = |e: &Event| format!("{e:?}");
    for state in State::ALL {
        text += &format!(" {state:?} |");
    }
    text += &format!("\n| --- |{}\n", " --- |".repeat(State::ALL.len()));
    for event in Event::ALL {
        text += &format!("| **{}** |", name(&event));
        for state in State::ALL {
            text += &format!(" {} |", cell(next(state, event), &mut reasons));
        }
        text.push('\n');
    }
    text.push('\n');
    for (at, why) in reasons.iter().enumerate() {
        text += &format!("- ✗{}: {why}\n", at + 1);
    }
    text
}

const BEGIN: &str = "<!-- table -->\n";
const END: &str = "<!-- end of table -->";

/// `OUTRIGGER_RENEW=1 cargo test state::` writes the table anew.
#[test]
fn the_documented_table_is_the_function() {
    let text = std::fs::read_to_string(TABLE).expect("docs/job-states.md");
    let (head, rest) = text.split_once(BEGIN).expect("the table begins");
    let (table, tail) = rest.split_once(END).expect("the table ends");
    if std::env::var_os("OUTRIGGER_RENEW").is_some() {
        std::fs::write(TABLE, format!("{head}{BEGIN}{}{END}{tail}", tables())).expect("written");
        return;
    }
    // The document is read by what it says, not compared as text: a row or column
    // that is missing, doubled or out of place shows by its name.
    let rows: Vec<Vec<&str>> = table
        .lines()
        .filter(|l| l.starts_with('|') && !l.contains("---"))
        .map(|l| l.trim_matches('|').split('|').map(str::trim).collect())
        .collect();
    let reasons: BTreeMap<&str, &str> =
        table.lines().filter_map(|l| l.strip_prefix("- ")?.split_once(": ")).collect();
    let states: Vec<&str> = rows[0][1..].to_vec();
    assert_eq!(states, State::ALL.map(|s| format!("{s:?}")));
    let events: Vec<&str> = rows[1..].iter().map(|r| r[0].trim_matches('*')).collect();
    assert_eq!(events, Event::ALL.map(|e| format!("{e:?}")));
    let mut used = Vec::new();
    for (row, event) in rows[1..].iter().zip(Event::ALL) {
        assert_eq!(row.len(), State::ALL.len() + 1, "{event:?}");
        for (cell, state) in row[1..].iter().zip(State::ALL) {
            let said = match *cell {
                "·" => "Stay".to_owned(),
                mark if mark.starts_with('✗') => {
                    used.push(mark);
                    format!("Refuse({:?})", reasons.get(mark).expect("a reason"))
                }
                to => format!("To({to})"),
            };
            assert_eq!(said, format!("{:?}", next(state, event)), "{state:?}, {event:?}");
        }
    }
    assert!(reasons.keys().all(|mark| used.contains(mark)), "every reason is used");
}

/// No event leads anywhere from where nothing follows; heaters are never left by a
/// way around the states that make them safe.
#[test]
fn what_never_happens() {
    for state in State::ALL {
        for event in Event::ALL {
            let Decision::To(to) = next(state, event) else { continue };
            assert!(!state.is_over(), "{state:?} is over, and {event:?} leads to {to:?}");
            if to == State::Finished {
                assert!(event == Event::Ended, "finished by {event:?}");
            }
            // From motion to rest the way is through the cancel macro, unless the
            // printer itself is off, stopped or out of reach.
            let at_rest = to.is_over() || to == State::Interrupted;
            let safe_by_itself = matches!(
                event,
                Event::Reset | Event::EmergencyStop | Event::Ended | Event::Safe | Event::Spoil | Event::Fail
            );
            assert!(!at_rest || !state.is_active() || safe_by_itself, "{state:?} {event:?}");
            // A reset printer moves again by a person's word alone.
            if state == State::Interrupted {
                let allowed = matches!(event, Event::Confirm | Event::TakeUp | Event::Spoil);
                assert!(allowed, "{event:?} leads from Interrupted to {to:?}");
            }
        }
    }
}

#[test]
fn every_state_and_event_is_listed_once() {
    let mut states = State::ALL.map(|s| s as u8);
    states.sort_unstable();
    assert!(states.iter().enumerate().all(|(at, s)| usize::from(*s) == at));
    let mut events = Event::ALL.map(|e| e as u8);
    events.sort_unstable();
    assert!(events.iter().enumerate().all(|(at, e)| usize::from(*e) == at));
}
