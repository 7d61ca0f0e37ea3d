//! What cannot be played where, and why.
//!
//! Takes a scenario and what it would be played on; gives the reason to leave it out. What is
//! left out here is played on the virtual clock.
use super::{Rig, Sort};
use crate::scenario::{Fault, Kind, Place, Scenario};

/// Why a scenario cannot be played there; `None`: it can.
pub fn skips(scenario: &Scenario, sort: Sort, rig: &Rig) -> Option<String> {
    for fault in &scenario.fault {
        if let Some(why) = cannot(fault, sort, rig) {
            return Some(format!("{}: {why}", fault.kind.name()));
        }
    }
    if scenario.job.resin.is_some() {
        return Some("a display and a light are in the virtual world only".to_owned());
    }
    let printer = &scenario.printer;
    if printer.dtr_reset || printer.hard_stop {
        return Some("the program's DTR ends at the rig's pseudo-terminal".to_owned());
    }
    if sort != Sort::Mock && (printer.personality.is_some() || printer.profile.is_some()) {
        return Some("it asks for a firmware of its own".to_owned());
    }
    if sort == Sort::Real && (scenario.job.corpus.is_some() || scenario.job.gcode.is_some()) {
        return Some("its moves are at heights of their own, and this bed is real".to_owned());
    }
    None
}

fn cannot(fault: &Fault, sort: Sort, rig: &Rig) -> Option<&'static str> {
    let kind = fault.kind;
    let relay = sort == Sort::Real && rig.power_off.is_some();
    let dtr = sort == Sort::Real && rig.dtr_reset;
    match (kind.place(), sort) {
        (Place::Disk, _) => Some("the journal's disk is this computer's own"),
        (Place::Host, _) if kind == Kind::ChangeFile => {
            Some("a small file is read whole at the start, and a changed one refused before the port opens")
        }
        (Place::Host, Sort::Real) if kind == Kind::EmergencyStop && !relay && !dtr => {
            Some("this rig cannot start a halted board again")
        }
        (Place::Board, Sort::Mock) | (Place::Wire | Place::Host, _) => None,
        (Place::Board, _) => match kind {
            Kind::PowerCut if relay => None,
            Kind::PowerCut => Some("this rig cannot cut the printer's power"),
            Kind::Reset if dtr => None,
            Kind::Reset => Some("this rig cannot reset the board"),
            _ => Some("no board does that on demand"),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_real_board_cannot_do_is_skipped_with_the_reason() {
        let scenario = |kind: &str, more: &str| {
            let text = format!(
                "title = 't'\n[job]\nlines = 9\n[[fault]]\nat_line = 3\ndo = '{kind}'\n{more}\n\
                 [expect]\noutcome = 'finished'"
            );
            Scenario::parse("x", &text).unwrap()
        };
        let bare = Rig::mock();
        let relay =
            Rig { power_off: Some("a".into()), power_on: Some("b".into()), dtr_reset: true, ..Rig::mock() };
        let check = |scenario: &Scenario, sort, rig: &Rig, expect: Option<&str>| {
            let why = skips(scenario, sort, rig);
            assert_eq!(why.is_some(), expect.is_some(), "{why:?}");
            assert!(why.unwrap_or_default().contains(expect.unwrap_or_default()));
        };
        check(&scenario("lose_line", ""), Sort::Real, &bare, None);
        check(&scenario("drop_ok", ""), Sort::Mock, &bare, None);
        check(&scenario("drop_ok", ""), Sort::Real, &relay, Some("no board"));
        check(&scenario("power_cut", "for_s = 3"), Sort::Real, &relay, None);
        check(&scenario("power_cut", "for_s = 3"), Sort::Real, &bare, Some("cannot cut"));
        check(&scenario("reset", ""), Sort::Real, &relay, None);
        check(&scenario("reset", ""), Sort::Virtual, &relay, Some("cannot reset"));
        check(&scenario("disk_slow", "for_s = 3"), Sort::Mock, &bare, Some("own"));
    }
}
