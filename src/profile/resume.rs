//! The proofs that the macros of the way back do their step and nothing else.
//!
//! Each takes a macro and says why it would do harm, or `None`. A part stands on the
//! bed while they run and the machine does not know where it is: so what cannot be
//! seen to be harmless is refused, an unknown command too. Knows no printer.
use super::macros::{GLUED, Macro, Words};

/// Says why a macro is not safe in its step, or `None`.
pub type Proof = fn(&Macro) -> Option<&'static str>;

/// Where the height stands in `z_set`.
pub const Z_PLACE: &str = "{z}";

/// Commands that neither move nor heat, for any step: pauses, modes, steppers on, and
/// limits of speed and current, as sensorless homing wants them.
const HARMLESS: &[&str] = &[
    "G4", "G90", "G91", "M17", "M82", "M83", "M117", "M118", "M201", "M203", "M204", "M205", "M211", "M400",
    "M569", "M906", "M914",
];

fn harmless(words: &Words<'_>) -> bool {
    HARMLESS.iter().any(|name| words.is(name))
}

/// It must set Z to `{z}`, and move nothing.
pub fn unsafe_z_set(text: &Macro) -> Option<&'static str> {
    let mut set = false;
    for line in text.lines() {
        let with_place = line.contains(Z_PLACE);
        let filled = line.replace(Z_PLACE, "1.5");
        let words = Words(&filled);
        if words.glued() {
            return Some(GLUED);
        }
        if words.is("G92") || words.is("G92.9") {
            if words.moves("XYABC") {
                return Some("it names X or Y anew: they are not known before they are homed");
            }
            if words.value('Z') != Some(1.5) || !with_place {
                return Some("it sets Z to something else than {z}");
            }
            set = true;
        } else if words.is("SET_KINEMATIC_POSITION") {
            let z = filled.split_whitespace().any(|word| word.eq_ignore_ascii_case("Z=1.5"));
            if !z || !with_place {
                return Some("it sets Z to something else than {z}");
            }
            set = true;
        } else if !harmless(&words) {
            return Some("it does more than setting Z: G92, G92.9 or SET_KINEMATIC_POSITION will do");
        }
    }
    (!set).then_some("it does not set Z: add G92 Z{z}")
}

/// It must home X and Y, and neither home nor move Z.
pub fn unsafe_home(text: &Macro) -> Option<&'static str> {
    let (mut x, mut y) = (false, false);
    for line in text.lines() {
        let words = Words(line);
        if words.glued() {
            return Some(GLUED);
        }
        if words.is("G28") {
            if words.moves("Z") || !words.moves("XY") {
                return Some("it homes Z, onto the part: name X and Y and nothing else");
            }
            if words.value('R').is_some_and(|r| r.is_nan() || r < 0.0) {
                return Some("it lowers Z before it homes (R)");
            }
            x |= words.moves("X");
            y |= words.moves("Y");
        } else if !harmless(&words) {
            return Some("it does more than homing: G28 X Y will do");
        }
    }
    (!(x && y)).then_some("it does not home both X and Y: add G28 R0 X Y")
}

/// It must not probe: it may only turn on what the firmware kept.
pub fn unsafe_levelling(text: &Macro) -> Option<&'static str> {
    for line in text.lines() {
        let words = Words(line);
        if words.glued() {
            return Some(GLUED);
        }
        let loads = words.is("BED_MESH_PROFILE")
            && line.split_whitespace().skip(1).all(|word| word.to_ascii_uppercase().starts_with("LOAD="));
        if !(words.is("M420") || loads || harmless(&words)) {
            return Some(
                "it does more than turning levelling on: M420 S1 or BED_MESH_PROFILE LOAD=… will do",
            );
        }
    }
    None
}

/// It must stay at the raised height or above, and leave heat and position alone.
pub fn unsafe_prime(text: &Macro) -> Option<&'static str> {
    let mut relative = false;
    for line in text.lines() {
        let words = Words(line);
        if words.glued() {
            return Some(GLUED);
        }
        if words.is("G90") {
            relative = false;
        } else if words.is("G91") {
            relative = true;
        } else if words.is("G0") || words.is("G1") {
            if words.moves("Z") && !relative {
                return Some("it moves Z to an absolute height: the part is there");
            }
            if words.moves("Z") && words.value('Z').is_none_or(|z| z.is_nan() || z < 0.0) {
                return Some("it moves Z downwards");
            }
        } else if words.is("G92") {
            if words.moves("XYZ") || !words.moves("E") {
                return Some("it names X, Y or Z anew");
            }
        } else if !harmless(&words) {
            return Some("it does more than pressing filament out: G0 and G1 will do");
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(proof: Proof, text: &str, expect: &str) {
        let found = proof(&Macro(text.into()));
        match found {
            None => assert_eq!(expect, "", "{text:?} passed"),
            Some(why) => assert!(!expect.is_empty() && why.contains(expect), "{text:?}: {why}"),
        }
    }

    #[test]
    fn z_is_set_and_nothing_moves() {
        check(unsafe_z_set, "G92 Z{z}", "");
        check(unsafe_z_set, "G92.9 Z{z} ; as Marlin's own recovery", "");
        check(unsafe_z_set, "M400\nSET_KINEMATIC_POSITION Z={z}", "");
        check(unsafe_z_set, "", "does not set");
        check(unsafe_z_set, "G92 Z0", "something else");
        check(unsafe_z_set, "G92 Z1.5", "something else");
        check(unsafe_z_set, "G92 E{z}", "something else");
        check(unsafe_z_set, "G92 X0 Z{z}", "X or Y");
        check(unsafe_z_set, "SET_KINEMATIC_POSITION X={z}", "something else");
        check(unsafe_z_set, "G92 Z{z}\nG1 Z{z}", "does more");
        check(unsafe_z_set, "G28 Z\nG92 Z{z}", "does more");
        check(unsafe_z_set, "MY_MACRO Z={z}", "does more");
    }

    #[test]
    fn x_and_y_are_homed_and_z_is_not() {
        check(unsafe_home, "G28 R0 X Y", "");
        check(unsafe_home, "G28 X\nG28 Y", "");
        check(unsafe_home, "M204 T500\nG28 X0 Y0", "");
        check(unsafe_home, "G28", "homes Z");
        check(unsafe_home, "G28 W", "homes Z");
        check(unsafe_home, "G28 X Y Z", "homes Z");
        check(unsafe_home, "G28 X Y z", "homes Z");
        check(unsafe_home, "G28 R-5 X Y", "lowers");
        check(unsafe_home, "G28 X", "both");
        check(unsafe_home, "", "both");
        check(unsafe_home, "G28 X Y\nG1 Z0", "does more");
        check(unsafe_home, "G28 X Y\nG29", "does more");
        check(unsafe_home, "HOME_XY", "does more");
        check(unsafe_home, "G28 XYZ", "cannot be read");
        check(unsafe_home, "G28 X0Y0Z0", "cannot be read");
    }

    #[test]
    fn levelling_is_turned_on_and_not_made() {
        check(unsafe_levelling, "", "");
        check(unsafe_levelling, "M420 S1", "");
        check(unsafe_levelling, "BED_MESH_PROFILE LOAD=default", "");
        check(unsafe_levelling, "G29", "does more");
        check(unsafe_levelling, "BED_MESH_PROFILE SAVE=default", "does more");
        check(unsafe_levelling, "BED_MESH_CALIBRATE", "does more");
    }

    #[test]
    fn priming_stays_high() {
        check(unsafe_prime, "", "");
        check(unsafe_prime, "M83\nG1 E20 F300\nG92 E0", "");
        check(unsafe_prime, "G90\nG1 X0 Y0 F6000\nG91\nG1 Z5\nG1 E10 F200", "");
        check(unsafe_prime, "G1 Z0.3", "absolute");
        check(unsafe_prime, "G91\nG1 Z-1", "downwards");
        check(unsafe_prime, "G91\nG1 E5Z-3", "cannot be read");
        check(unsafe_prime, "G28", "does more");
        check(unsafe_prime, "M104 S0", "does more");
        check(unsafe_prime, "G92", "anew");
        check(unsafe_prime, "G92 E0 Z0", "anew");
    }
}
