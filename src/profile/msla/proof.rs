//! What a resin printer's profile must hold beyond its keys: that the light goes off whoever
//! dies, that nothing moves while it is on, and that a plate only ever clears the vat.
//!
//! Each proof says why something would do harm, or nothing. Knows no file.
use super::{Before, MS_PLACE, Msla, POWER_PLACE, Plate, Sink, TimedBy, WORD_BYTES_MAX, WORD_PLACE};
use crate::profile::macros::{FRAME_BYTES_MAX, GLUED, Macro, Words, unsendable};
use crate::profile::printer::{BedShape, Profile, Window};

/// A key and what is wrong with its value.
pub(crate) type Wrong = (&'static str, String);

/// Room that an exposure's lines need at least: on, dwell and off with their frames are some
/// 75 bytes of Marlin's words.
const EXPOSURE_BYTES_MIN: u32 = 100;

/// And in lines: on, dwell, off, and the one before them whose `ok` is still on its way.
const EXPOSURE_LINES_MIN: u32 = 4;

/// Questions whose answers the protocol takes for itself: temperatures, place, name.
const READ_BY_HOST: [&str; 3] = ["M105", "M114", "M115"];

/// Shortest time in which an exposure's lines arrive before the light goes on, ms: 6 ms at
/// 115200 baud, and as much again for the board to read them into its queue.
const ARRIVAL_MS_MIN: u32 = 20;

/// What of a resin printer's profile does not hold together.
pub(crate) fn wrong(profile: &Profile, msla: &Msla) -> Option<Wrong> {
    if profile.bed.shape != BedShape::Rectangle {
        return Some((
            "bed.shape",
            "must be \"rectangle\" where the kind is \"msla\": an LCD is one".to_owned(),
        ));
    }
    let max_line = profile.serial.max_line;
    panel(msla)
        .or_else(|| light(msla, max_line))
        .or_else(|| window(profile, msla))
        .or_else(|| plate(profile, &msla.plate))
        .or_else(|| msla.before.iter().find_map(|before| asks(before, max_line)))
        .or_else(|| {
            let macros = &profile.macros;
            let not_safe = |key, why: &str| (key, format!("is not safe: {why}"));
            unsafe_cancel_msla(&macros.cancel, &msla.light.off)
                .map(|why| not_safe("macros.cancel", why))
                .or_else(|| unsafe_pause_msla(&macros.pause).map(|why| not_safe("macros.pause", why)))
        })
}

fn panel(msla: &Msla) -> Option<Wrong> {
    let (lcd, light) = (&msla.lcd, &msla.light);
    if let Sink::Framebuffer(name) = &lcd.sink {
        let digits = name.strip_prefix("fb").unwrap_or_default();
        if digits.is_empty() || !digits.bytes().all(|b| b.is_ascii_digit()) {
            let why = format!("is {name:?}, but takes a name as in /dev: fb and a number");
            return Some(("lcd.sink.framebuffer", why));
        }
    }
    if lcd.width_px % lcd.pixels.in_one() != 0 {
        let why = "is no multiple of 3, so that its rows are no whole pixels of the display (lcd.pixels)";
        return Some(("lcd.width_px", why.to_owned()));
    }
    if light.timed_by == TimedBy::Controller && lcd.settle_ms < ARRIVAL_MS_MIN {
        let why = format!(
            "is {}, but takes at least {ARRIVAL_MS_MIN} where the controller times the light: its lines arrive meanwhile",
            lcd.settle_ms
        );
        return Some(("lcd.settle_ms", why));
    }
    None
}

/// A macro with the largest values in their places.
fn filled(text: &Macro, most_ms: u32) -> Macro {
    let word = "w".repeat(WORD_BYTES_MAX);
    text.filled(&[(POWER_PLACE, "255"), (MS_PLACE, &most_ms.to_string()), (WORD_PLACE, &word)])
}

/// A macro that can be sent when filled and has the places that it needs, and no other.
fn sent(
    key: &'static str,
    text: &Macro,
    places: &[&str],
    most_ms: u32,
    max_line: Option<u32>,
) -> Option<Wrong> {
    if text.is_empty() {
        return Some((key, "has no command".to_owned()));
    }
    let mut bare = text.lines().collect::<Vec<_>>().join("\n");
    if let Some(place) = places.iter().find(|place| !bare.contains(**place)) {
        return Some((key, format!("does not say {place}")));
    }
    for place in places {
        bare = bare.replace(place, "");
    }
    if bare.contains(['{', '}']) {
        let known = if places.is_empty() { "none".to_owned() } else { places.join(", ") };
        return Some((
            key,
            format!("has a place in braces that is not filled here; those that are: {known}"),
        ));
    }
    unsendable(&filled(text, most_ms), max_line).map(|why| (key, format!("cannot be sent: {why}")))
}

fn light(msla: &Msla, max_line: Option<u32>) -> Option<Wrong> {
    let light = &msla.light;
    let most_ms = light.most_ms();
    for (key, text, places) in [
        ("light.on", Some(&light.on), &[POWER_PLACE][..]),
        ("light.off", Some(&light.off), &[]),
        ("light.dwell", Some(&light.dwell), &[MS_PLACE]),
        ("light.pulse", light.pulse.as_ref(), &[MS_PLACE, POWER_PLACE]),
    ] {
        let Some(text) = text else { continue };
        if let Some(wrong) = sent(key, text, places, most_ms, max_line) {
            return Some(wrong);
        }
        if let Some(why) = unsafe_still(&filled(text, most_ms)) {
            return Some((key, format!("is not safe: {why}")));
        }
    }
    let pulse = light.pulse.as_ref()?;
    if light.timed_by == TimedBy::Host {
        let why = "is timed by the controller, and light.timed_by says \"host\"";
        return Some(("light.pulse", why.to_owned()));
    }
    let by = |text: &Macro| commands(&filled(text, most_ms)).map(words_of).collect::<Vec<_>>();
    let (steps, on, off) = (by(pulse), by(&light.on), by(&light.off));
    let lit = steps.iter().rposition(|step| on.contains(step))?;
    let goes_off = off.iter().all(|off| steps.iter().skip(lit).any(|step| step == off));
    (!goes_off)
        .then(|| ("light.pulse", "is not safe: it leaves the light on: end it with light.off".to_owned()))
}

/// The controller can only time what it has: the light must not go on before the line that
/// switches it off has arrived, or a host that dies between the two leaves it on.
fn window(profile: &Profile, msla: &Msla) -> Option<Wrong> {
    let light = &msla.light;
    if light.timed_by == TimedBy::Host || light.pulse.is_some() {
        return None;
    }
    let (mut bytes, mut lines) = (0, 0);
    for text in [&light.on, &light.dwell, &light.off] {
        for line in filled(text, light.most_ms()).lines() {
            bytes += line.len() + FRAME_BYTES_MAX + 1;
            lines += 1;
        }
    }
    let at_least = |least: u32, own: usize| least.max(u32::try_from(own).unwrap_or(u32::MAX));
    let (has, needs, unit) = match profile.serial.window {
        Window::Bytes(has) => (has, at_least(EXPOSURE_BYTES_MIN, bytes), "bytes"),
        Window::Lines(has) => (has, at_least(EXPOSURE_LINES_MIN, lines), "lines"),
    };
    (has < needs).then(|| {
        let why = format!(
            "lets {has} {unit} go together, but takes at least {needs} where light.timed_by is \"controller\": \
             the line that switches the light off must have arrived before it goes on"
        );
        ("serial.window", why)
    })
}

fn plate(profile: &Profile, plate: &Plate) -> Option<Wrong> {
    let max_line = profile.serial.max_line;
    for (key, text, places) in
        [("plate.done", &plate.done, &[WORD_PLACE][..]), ("plate.home", &plate.home, &[])]
    {
        if let Some(wrong) = sent(key, text, places, 0, max_line) {
            return Some(wrong);
        }
    }
    if let Some(why) = unsafe_still(&filled(&plate.done, 0)) {
        return Some(("plate.done", format!("is not safe: {why}")));
    }
    if !plate.home.lines().any(|line| Words(line).is("G28")) {
        return Some(("plate.home", "does not home: G28 Z will do".to_owned()));
    }
    let (lift, retract) = (&plate.lift, &plate.retract);
    let too_fast = [
        ("plate.lift.slow_mm_min", lift.slow_mm_min),
        ("plate.lift.fast_mm_min", lift.fast_mm_min),
        ("plate.retract.slow_mm_min", retract.slow_mm_min),
        ("plate.retract.fast_mm_min", retract.fast_mm_min),
    ];
    if let Some((key, _)) = too_fast.into_iter().find(|(_, speed)| *speed > plate.max_mm_min) {
        return Some((key, "is above plate.max_mm_min".to_owned()));
    }
    let whole_mm = lift.slow_mm.0 + lift.fast_mm.0;
    if whole_mm <= 0.0 {
        return Some(("plate.lift", "lifts nothing: the part would not come off the film".to_owned()));
    }
    for (key, mm) in [("plate.lift", whole_mm), ("plate.clear_mm", plate.clear_mm.0)] {
        if mm > profile.bed.z_mm.0 {
            return Some((key, "is more than the plate's travel, bed.z_mm".to_owned()));
        }
    }
    (retract.slow_mm.0 > whole_mm)
        .then(|| ("plate.retract.slow_mm", "is more than the lift that it takes back".to_owned()))
}

fn asks(before: &Before, max_line: Option<u32>) -> Option<Wrong> {
    let send = match (&before.send, &before.wants) {
        (None, None) => return None,
        (Some(send), Some(_)) => Macro(send.clone()),
        _ => return Some(("before", "takes send and wants, or neither".to_owned())),
    };
    if send.is_empty() {
        return Some(("before", "has no command to send".to_owned()));
    }
    if let Some(why) = unsendable(&send, max_line) {
        return Some(("before", format!("cannot be sent: {why}")));
    }
    if let Some(read) = send.lines().find(|line| READ_BY_HOST.iter().any(|own| Words(line).is(own))) {
        let why = format!(
            "cannot ask with {read}: the host reads the answer itself, and it never reaches the question; ask with \
             what answers in free words, as M119 does"
        );
        return Some(("before", why));
    }
    unsafe_still(&send).map(|why| ("before", format!("is not safe: {why}")))
}

/// The single commands of a macro: those that `M810` to `M819` keep for later stand between
/// bars in one line.
fn commands(text: &Macro) -> impl Iterator<Item = &str> {
    text.lines().flat_map(|line| {
        let body =
            if kept(line) { line.split_once(char::is_whitespace).map_or("", |(_, body)| body) } else { line };
        body.split('|').map(str::trim).filter(|command| !command.is_empty())
    })
}

/// Whether a line gives one of Marlin's ten macros, or plays it.
fn kept(line: &str) -> bool {
    (810..=819).any(|n| Words(line).is(&format!("M{n}")))
}

/// A command's words, as firmware takes them alike.
fn words_of(command: &str) -> Vec<String> {
    command.split_whitespace().map(str::to_ascii_uppercase).collect()
}

/// M codes that move, wait for a person, or run what nobody here has read.
const RESTLESS: &[&str] =
    &["M0", "M1", "M18", "M24", "M32", "M48", "M84", "M98", "M125", "M600", "M701", "M702", "M852", "M999"];

/// Why a macro may move something, which none may while a picture is lit, or `None`.
fn unsafe_still(text: &Macro) -> Option<&'static str> {
    commands(text).find_map(|command| {
        let words = Words(command);
        let is_a = |letters: [char; 2]| {
            let number = command.strip_prefix(letters);
            number.is_some_and(|rest| rest.starts_with(|c: char| c.is_ascii_digit()))
        };
        if words.glued() {
            Some(GLUED)
        } else if (is_a(['G', 'g']) && !words.is("G4"))
            || is_a(['T', 't'])
            || RESTLESS.iter().any(|name| words.is(name))
        {
            Some("it does more than light, wait or ask: nothing may move")
        } else {
            None
        }
    })
}

/// Why a resin printer's cancel macro is not safe, or `None`.
///
/// Its first commands must be those of `light.off`: whatever becomes of the rest, nothing
/// cures on. Then it may raise the plate relatively, and nothing else.
pub(crate) fn unsafe_cancel_msla(text: &Macro, off: &Macro) -> Option<&'static str> {
    let mut lines = text.lines();
    for want in off.lines() {
        if lines.next().map(words_of) != Some(words_of(want)) {
            return Some("its first lines do not switch the light off: begin with those of light.off");
        }
    }
    only_up(lines)
}

/// Why a resin printer's pause macro is not safe, or `None`: it may raise the plate
/// relatively, and nothing else.
pub(crate) fn unsafe_pause_msla(text: &Macro) -> Option<&'static str> {
    only_up(text.lines())
}

/// Commands that neither move nor light: modes, steppers, waiting for the planner, words.
const HARMLESS: &[&str] = &["G90", "G91", "M5", "M17", "M18", "M84", "M107", "M117", "M118", "M400"];

fn only_up<'a>(lines: impl Iterator<Item = &'a str>) -> Option<&'static str> {
    let mut relative = false;
    for line in lines {
        let words = Words(line);
        if words.glued() {
            return Some(GLUED);
        }
        if words.is("G0") || words.is("G1") {
            if words.value('Z').is_none() || words.moves("XYEABCIJ") {
                return Some("it moves something else than the plate");
            }
            if !relative {
                return Some("it moves the plate to an absolute height: say G91 first");
            }
            if words.value('Z').is_none_or(|z| z.is_nan() || z < 0.0) {
                return Some("it moves the plate downwards");
            }
        } else if HARMLESS.iter().any(|name| words.is(name)) {
            relative = words.is("G91") || (relative && !words.is("G90"));
        } else {
            return Some("it does more than raising the plate: G91, G1 Z… and M400 will do");
        }
    }
    None
}

#[cfg(test)]
mod tests;
