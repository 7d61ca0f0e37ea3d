//! What a host needs of a printer's profile, as plain values.
use crate::job::host::HostSettings;
use crate::job::recover::{PlateRules, ResumeRules};
use crate::job::tracker::EModes;
use crate::printer::exposure::script;
use crate::printer::session::{DEFAULT_BOOT_WAIT_MS, Settings};
use crate::printer::window::Limit;
use crate::profile::msla::{Before, Homes, TimedBy};
use crate::profile::printer::{Firmware, Window};
use crate::profile::{Macro, Msla, Profile};
use outrigger_gcode::checksum::sendable;

/// A board that opening the port does not reset may have been switched on just now; one that
/// has already said `start`, or says nothing, is asked after so long. Who boots does
/// not hear the first question, and is asked again.
const NO_RESET_WAIT_MS: u64 = 50;

/// Longest framed line that the profile's firmware takes.
pub(crate) fn max_line(profile: &Profile) -> Option<usize> {
    profile.serial.max_line.map(size)
}

/// How long a board may be silent after its port was opened.
pub(crate) fn boot_wait_ms(profile: &Profile) -> u64 {
    match profile.serial.dtr_reset {
        true => DEFAULT_BOOT_WAIT_MS,
        false => NO_RESET_WAIT_MS,
    }
}

fn size(n: u32) -> usize {
    usize::try_from(n).unwrap_or(usize::MAX)
}

/// What a host needs of a profile; `around`: whether its start and end macros go
/// around the file.
pub(crate) fn of(profile: &Profile, around: bool) -> HostSettings {
    let serial = &profile.serial;
    let when = |text: &Macro| if around { lines(text) } else { Vec::new() };
    HostSettings {
        session: Settings {
            window: match serial.window {
                Window::Bytes(bytes) => Limit::Bytes(size(bytes)),
                Window::Lines(lines) => Limit::Lines(size(lines)),
            },
            max_line: max_line(profile),
            boot_wait_ms: boot_wait_ms(profile),
            asks: true,
            waits_for_link: true,
            cancel_macro: lines(&profile.macros.cancel),
        },
        start_macro: when(&profile.macros.start),
        end_macro: if around { end(profile) } else { Vec::new() },
        pause_macro: pause(profile),
        resume: resume(profile),
        e_modes: match profile.firmware {
            Firmware::Marlin => EModes::WithAxes,
            Firmware::Prusa | Firmware::Klipper | Firmware::Repetier | Firmware::RepRapFirmware => {
                EModes::Alone
            }
        },
        resets_when_halted: profile.msla().is_some_and(|msla| !msla.light.off_when_halted),
        pause_cooling: None,
        waits_for_person: false,
    }
}

/// A plate is raised clear of the vat where the profile says nothing of a pause.
fn pause(profile: &Profile) -> Vec<String> {
    match profile.msla() {
        Some(msla) if profile.macros.pause.lines().next().is_none() => {
            let up = format!("G1 Z{} F{}", msla.plate.clear_mm.0, msla.plate.lift.fast_mm_min.0);
            ["G91", &up, "G90", "M400"].map(str::to_owned).to_vec()
        }
        _ => lines(&profile.macros.pause),
    }
}

/// A finished part is raised to the top where the profile says nothing of the end.
fn end(profile: &Profile) -> Vec<String> {
    match profile.msla() {
        Some(msla) if profile.macros.end.lines().next().is_none() => {
            let up = format!("G1 Z{} F{}", profile.bed.z_mm.0, msla.plate.max_mm_min.0);
            ["G90", &up, "M400"].map(str::to_owned).to_vec()
        }
        _ => lines(&profile.macros.end),
    }
}

/// How a resin printer is told.
pub(crate) fn script_rules(msla: &Msla) -> script::Rules {
    let timing = match (msla.light.timed_by, &msla.light.pulse) {
        (TimedBy::Host, _) => script::Timing::Host,
        (TimedBy::Controller, Some(_)) => script::Timing::Pulse,
        (TimedBy::Controller, None) => script::Timing::Controller,
    };
    let check = |before: &Before| {
        let (send, wants) = before.send.clone().zip(before.wants.clone())?;
        Some(script::Check { what: before.what.clone(), send, wants })
    };
    script::Rules {
        timing,
        on: lines(&msla.light.on),
        off: lines(&msla.light.off),
        pulse: msla.light.pulse.as_ref().map(lines).unwrap_or_default(),
        dwell: lines(&msla.light.dwell).into_iter().next().unwrap_or_default(),
        lead_ms: msla.lcd.settle_ms,
        done: lines(&msla.plate.done),
        home: lines(&msla.plate.home),
        checks: msla.before.iter().filter_map(check).collect(),
    }
}

/// What homes a resin printer's plate.
pub(crate) fn home(msla: &Msla) -> Vec<String> {
    lines(&msla.plate.home)
}

/// What switches the light of a resin printer off; nothing for others.
pub(crate) fn light_off(profile: &Profile) -> Vec<String> {
    profile.msla().map(|msla| lines(&msla.light.off)).unwrap_or_default()
}

/// What a person is to see to before a print.
pub(crate) fn asks(profile: &Profile) -> Vec<&str> {
    let before = profile.msla().map(|msla| msla.before.as_slice()).unwrap_or_default();
    before.iter().filter(|one| one.send.is_none()).map(|one| one.what.as_str()).collect()
}

/// A profile that says nothing of resuming refuses it, by the rules' default.
fn resume(profile: &Profile) -> ResumeRules {
    if let Some(msla) = profile.msla() {
        let plate = PlateRules {
            homes_up: msla.plate.homes == Homes::Up,
            home: lines(&msla.plate.home),
            top_mm: profile.bed.z_mm.0,
            light_off: lines(&msla.light.off),
            raise_mm: msla.plate.clear_mm.0,
        };
        return ResumeRules { plate: Some(plate), ..ResumeRules::default() };
    }
    let Some(said) = &profile.resume else { return ResumeRules::default() };
    ResumeRules {
        homes_xy_alone: said.homes_xy_alone,
        homing_clears_part: said.homing_clears_part,
        raise_mm: said.raise_mm.0,
        // A temperature has some digits only.
        soften_c: said.soften_c.0 as f32,
        planner_moves: said.planner_moves,
        queue_commands: said.queue_commands,
        z_set: lines(&said.z_set),
        home: lines(&said.home),
        levelling: lines(&said.levelling),
        prime: lines(&said.prime),
        plate: None,
    }
}

/// The commands of a macro, as they are sent.
pub(crate) fn lines(text: &Macro) -> Vec<String> {
    let mut scratch = Vec::new();
    let line = |l: &str| {
        sendable(l.as_bytes(), &mut scratch).map(|command| String::from_utf8_lossy(command).into_owned())
    };
    text.lines().filter_map(line).collect()
}
