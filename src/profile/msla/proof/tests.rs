use super::*;
use crate::profile::{load_printer, printer_names};
use std::io::Write;

/// A built-in profile's file with one thing changed, and what is said of it; "" is nothing.
fn check(from: &str, to: &str, expect: &str) {
    check_of("generic-msla", from, to, expect);
}

fn check_of(name: &str, from: &str, to: &str, expect: &str) {
    let path = format!("{}/profiles/printers/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(path).unwrap();
    assert!(text.contains(from), "{name}: {from:?}");
    let mut file = tempfile::Builder::new().suffix(".toml").tempfile().unwrap();
    file.write_all(text.replacen(from, to, 1).as_bytes()).unwrap();
    let said = match load_printer(file.path().to_str().unwrap()) {
        Ok(_) => String::new(),
        Err(e) => e.to_string(),
    };
    assert_eq!(said.is_empty(), expect.is_empty(), "{from:?} to {to:?}: {said}");
    assert!(said.contains(expect), "{from:?} to {to:?}: {said}");
}

#[test]
fn only_the_resin_printers_are() {
    for name in printer_names() {
        let profile = load_printer(name).unwrap();
        let resin = name.starts_with("generic-msla");
        assert_eq!((profile.msla().is_some(), profile.fdm().is_none()), (resin, resin), "{name}");
        assert_eq!(profile.kind.word() == "msla", resin);
        assert_eq!(profile.want_fdm().is_err(), resin);
    }
    let said = load_printer("generic-msla").unwrap().want_fdm().unwrap_err().to_string();
    assert!(said.starts_with("generic-msla is a resin printer: "), "{said}");
}

#[test]
fn what_is_left_out_has_a_value() {
    let profile = load_printer("generic-msla").unwrap();
    let Msla { lcd, light, plate, before } = profile.msla().unwrap();
    assert_eq!(lcd.sink, Sink::Framebuffer("fb0".to_owned()));
    assert_eq!((light.most_ms(), light.pulse.is_none(), light.dwell.0.as_str()), (120_000, true, "G4 P{ms}"));
    assert_eq!((plate.done.0.as_str(), plate.home.0.as_str()), ("M400\nM118 {word}", "G28 Z"));
    assert_eq!((plate.clear_mm.0, before.len()), (20.0, 2));
}

#[test]
fn keys_of_the_other_kind_are_told() {
    let root = "firmware = \"marlin\"";
    let with = |line: &str| format!("{root}\n{line}");
    check(
        root,
        &with("nozzle_mm = 0.4"),
        "nozzle_mm belongs to a printer of filament, and `kind` says \"msla\"",
    );
    check("[lcd]", "[limits]\nnozzle_c = 260\nbed_c = 0\n[lcd]", "limits belongs to a printer of filament");
    check("[lcd]", "[resume]\nhomes_xy_alone = true\n[lcd]", "resume belongs to a printer of filament");
    let fdm = |from: &str, to: &str, expect: &str| check_of("generic-marlin", from, to, expect);
    fdm(
        "[limits]",
        "[lcd]\nwidth_px = 1\n[limits]",
        "lcd belongs to a resin printer, and `kind` says \"fdm\"",
    );
    fdm("[macros]", "[[before]]\nwhat = \"a\"\n[macros]", "before belongs to a resin printer");
    fdm("\"fdm\"", "\"fmd\"", "did you mean \"fdm\"?");
    check("\"msla\"", "\"mlsa\"", "did you mean \"msla\"?");
    check("kind = \"msla\"\n", "", "kind is missing");
}

#[test]
fn the_panel() {
    check("rectangle", "circle", "bed.shape must be \"rectangle\"");
    check("width_px = 2560", "width_px = 0", "lcd.width_px is 0, outside 1 to 16384");
    check("pixels = \"grey\"", "pixels = \"rgb\"", "lcd.width_px is no multiple of 3");
    check("pixels = \"grey\"", "pixels = \"gray\"", "did you mean \"grey\"?");
    check("pixels = \"grey\"", "pixels = \"grey\"\nmirror = \"xy\"", "");
    check("pixels = \"grey\"", "pixels = \"grey\"\nmirror = \"z\"", "lcd.mirror is \"z\"");
    for wrong in ["fb", "/dev/fb0", "fb0x", "sda"] {
        check("\"fb0\"", &format!("{wrong:?}"), "takes a name as in /dev");
    }
    check("framebuffer = \"fb0\"", "folder = \"/tmp/shown\"", "");
    check(
        "framebuffer = \"fb0\"",
        "framebuffer = \"fb0\", folder = \"a\"",
        "exactly one of framebuffer, folder",
    );
    check("settle_ms = 100", "settle_ms = 19", "lcd.settle_ms is 19, but takes at least 20");
    check("timed_by = \"controller\"", "timed_by = \"host\"", "");
}

#[test]
fn the_light_goes_off_and_nothing_moves() {
    let pulse = |text: &str| format!("[light]\npulse = {text:?}");
    check("M106 S{power}", "M106 S255", "light.on does not say {power}");
    check("M106 S{power}", "M106 S{power} P{pin}", "light.on has a place in braces");
    check("M106 S{power}", "M106 S{power}\\nG1 Z1", "light.on is not safe: it does more");
    check("M106 S{power}", "G28\\nM106 S{power}", "light.on is not safe: it does more");
    check("M106 S{power}", "M106S{power}", "cannot be read");
    check("M106 S{power}", "T1\\nM106 S{power}", "it does more");
    check("M106 S{power}", "SET_PIN PIN=uv VALUE={power}", "");
    check("off = \"M107\"", "off = \"\"", "light.off has no command");
    check("off = \"M107\"", "off = \"M107\\nG0 Z5\"", "light.off is not safe");
    check("[light]", "[light]\ndwell = \"G4 S2\"", "light.dwell does not say {ms}");
    check("[light]", "[light]\nmost_s = 601", "light.most_s is 601, outside 0.1 to 600");
    check("[light]", &pulse("M1400 S{power} P{ms}"), "");
    check("[light]", &pulse("M810 M106 S{power}|G4 P{ms}|M107\nM810"), "");
    check(
        "[light]",
        &pulse("M810 M106 S{power}|G4 P{ms}\nM810"),
        "light.pulse is not safe: it leaves the light on",
    );
    check("[light]", &pulse("M107\nM106 S{power}\nG4 P{ms}"), "it leaves the light on");
    check("[light]", &pulse("M810 M106 S{power}|G1 Z9|G4 P{ms}|M107\nM810"), "nothing may move");
    check("[light]", &pulse("M1400 P{ms}"), "light.pulse does not say {power}");
    let long = format!("M1400 S{{power}} P{{ms}} {}", "X1 ".repeat(22));
    check("[light]", &pulse(long.trim()), "light.pulse cannot be sent");
    let hosts = pulse("M1400 S{power} P{ms}") + "\ntimed_by = \"host\"";
    check(
        "[light]\non = \"M106 S{power}\"\noff = \"M107\"\ntimed_by = \"controller\"",
        &(hosts + "\non = \"M106 S{power}\"\noff = \"M107\""),
        "light.pulse is timed by the controller",
    );
}

#[test]
fn the_exposures_lines_go_together() {
    let check = |window: &str, expect: &str| check("{ bytes = 120 }", window, expect);
    check("{ bytes = 100 }", "");
    check("{ bytes = 99 }", "serial.window lets 99 bytes go together, but takes at least 100");
    check("{ lines = 4 }", "");
    check("{ lines = 3 }", "serial.window lets 3 lines go together, but takes at least 4");
    // A pulse is one line: it comes whole or not at all.
    let mut profile = load_printer("generic-msla").unwrap();
    let mut msla = profile.msla().unwrap().clone();
    profile.serial.window = Window::Lines(1);
    assert_eq!(wrong(&profile, &msla).map(|(key, _)| key), Some("serial.window"));
    msla.light.pulse = Some(Macro("M1400 S{power} P{ms}".to_owned()));
    assert_eq!(wrong(&profile, &msla), None);
    // Own words that are longer want more room.
    let longer = "M106 P0 S{power}\nM106 P1 S{power}\nM106 P2 S{power}";
    msla.light.pulse = None;
    msla.light.on = Macro(longer.to_owned());
    profile.serial.window = Window::Bytes(120);
    assert_eq!(wrong(&profile, &msla).map(|(key, _)| key), Some("serial.window"));
}

#[test]
fn the_plate() {
    check("[plate]", "[plate]\ndone = \"M400\"", "plate.done does not say {word}");
    check("[plate]", "[plate]\ndone = \"G1 Z1\\nM118 {word}\"", "plate.done is not safe");
    check("[plate]", "[plate]\nhome = \"G1 Z0\"", "plate.home does not home");
    check("[plate]", "[plate]\nclear_mm = 151", "plate.clear_mm is more than the plate's travel");
    check("max_mm_min = 300", "max_mm_min = 149", "plate.lift.fast_mm_min is above plate.max_mm_min");
    check(
        "slow_mm = 3, slow_mm_min = 40, fast_mm = 4",
        "slow_mm = 0, slow_mm_min = 40, fast_mm = 0",
        "lifts nothing",
    );
    check(
        "retract = { slow_mm = 3",
        "retract = { slow_mm = 8",
        "plate.retract.slow_mm is more than the lift",
    );
    check("rest_ms = 500", "rest_ms = 60001", "plate.rest_ms is 60001, outside 0 to 60000");
    check("settle_ms = 1000\n", "", "plate.settle_ms is missing");
}

#[test]
fn questions_before_a_print() {
    let ask = |rest: &str| format!("[[before]]\nwhat = \"the door\"\n{rest}\n[[before]]");
    check("[[before]]", &ask(""), "");
    check("[[before]]", &ask("send = \"M119\"\nwants = \"door: TRIGGERED\""), "");
    check("[[before]]", &ask("send = \"M119\""), "before takes send and wants, or neither");
    check("[[before]]", &ask("wants = \"ok\""), "or neither");
    check("[[before]]", &ask("send = \"G28\"\nwants = \"ok\""), "before is not safe");
    check("[[before]]", &ask("send = \"; M119\"\nwants = \"ok\""), "no command");
    check("[[before]]", &ask("wnats = \"ok\""), "did you mean before.wants?");
    check("[[before]]", &ask("").repeat(8).replace("[[before]][[before]]", "[[before]]"), "takes 8 at most");
}

#[test]
fn a_cancel_is_dark_first_and_then_only_up() {
    let check = |text: &str, expect: &str| {
        let found = unsafe_cancel_msla(&Macro(text.into()), &Macro("M107 ; the light".into()));
        assert_eq!(found.is_none(), expect.is_empty(), "{text:?}: {found:?}");
        assert!(found.is_none_or(|why| why.contains(expect)), "{text:?}: {found:?}");
    };
    check("M107", "");
    check("; dark\nm107\nG91\nG1 Z20 F100\nG90\nM400\nM84", "");
    check("", "do not switch the light off");
    check("G91\nG1 Z20\nM107", "do not switch the light off");
    check("M106 S0", "do not switch the light off");
    check("M107\nG1 Z100", "absolute");
    check("M107\nG91\nG90\nG1 Z20", "absolute");
    check("M107\nG91\nG1 Z-1", "downwards");
    check("M107\nG91\nG1 Zx", "cannot be read");
    check("M107\nG91\nG1 X5 Z1", "something else");
    check("M107\nG91\nG1 F100", "something else");
    check("M107\nG91\nG1 X5Z-3", "cannot be read");
    check("M107\nG28 Z", "does more");
    check("M107\nM106 S255", "does more");
    check("M107\nMY_MACRO", "does more");
}

#[test]
fn macros_around_a_job() {
    let pause = "pause = '''\nG91\nG1 Z20 F100\nG90\nM400'''";
    check(pause, "pause = \"\"", "");
    check(pause, "pause = \"G1 Z20\"", "macros.pause is not safe: it moves the plate to an absolute");
    check(pause, "pause = \"M106 S255\"", "macros.pause is not safe: it does more");
    check(
        "{ file = \"msla-cancel.gcode\" }",
        "\"G91\\nG1 Z5\"",
        "macros.cancel is not safe: its first lines",
    );
    check(
        "{ file = \"msla-cancel.gcode\" }",
        "{ file = \"marlin-cancel.gcode\" }",
        "macros.cancel is not safe",
    );
    check("off = \"M107\"", "off = { file = \"none\" }", "light.off names the file");
}
