use super::*;
use std::collections::BTreeSet;
use std::io::Write;

fn folder(name: &str) -> BTreeSet<String> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("profiles").join(name);
    std::fs::read_dir(path).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

#[test]
fn every_file_of_the_folder_is_embedded_and_the_lists_are_sorted() {
    for (name, list, ending) in [
        ("printers", builtin::PRINTERS, ".toml"),
        ("materials", builtin::MATERIALS, ".toml"),
        ("macros", builtin::MACROS, ""),
    ] {
        assert!(list.is_sorted_by_key(|(n, _)| *n), "{name}");
        let embedded: BTreeSet<_> = list.iter().map(|(n, _)| format!("{n}{ending}")).collect();
        assert_eq!(embedded, folder(name), "{name}");
    }
}

#[test]
fn every_built_in_profile_is_valid_and_named_as_its_file() {
    for name in printer_names() {
        let profile = load_printer(name).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(profile.name, name);
        // Ours never move X or Y in a cancel: another object may be taller
        // than where the nozzle is now.
        for line in profile.macros.cancel.lines() {
            let sideways = line.starts_with("G1") && line.contains(['X', 'Y']);
            assert!(!sideways, "{name}: {line}");
        }
        let window = match profile.serial.window {
            printer::Window::Bytes(n) => n >= 32,
            printer::Window::Lines(n) => n >= 1,
        };
        assert!(window, "{name}");
    }
    for name in material_names() {
        let material = load_material(name).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(material.name, name);
    }
}

#[test]
fn what_show_prints_is_the_same_profile() {
    let folder = tempfile::tempdir().unwrap();
    for name in printer_names().chain(material_names()) {
        let profile = load_any(name).unwrap();
        let path = folder.path().join(format!("{name}.toml"));
        std::fs::write(&path, explain::explain(&profile).unwrap()).unwrap();
        let again = load_any(path.to_str().unwrap()).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(again, profile, "{name}");
    }
}

/// The table of keys and the structs are two descriptions of one thing: every
/// leaf of a full profile is a key, and every required key is a leaf or a table.
#[test]
fn keys_and_structs_agree() {
    fn leaves(value: &toml::Value, path: &str, out: &mut BTreeSet<String>) {
        match value {
            toml::Value::Table(table) => {
                for (name, value) in table {
                    let path = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
                    leaves(value, &path, out);
                }
            }
            _ => {
                out.insert(path.to_owned());
            }
        }
    }
    let documented = |table: &[keys::Key]| -> BTreeSet<String> {
        table
            .iter()
            .filter(|k| !matches!(k.takes, keys::Takes::Table | keys::Takes::Choice))
            .map(|k| k.path.to_owned())
            .collect()
    };
    let mut printer = BTreeSet::new();
    let mut full = load_printer("prusa-mk3s").unwrap();
    for window in [printer::Window::Bytes(120), printer::Window::Lines(1)] {
        full.serial.window = window;
        leaves(&toml::Value::try_from(&full).unwrap(), "", &mut printer);
    }
    full.serial.hard_stop = Some(printer::HardStop::Dtr);
    full.resume = load_printer("ender-3").unwrap().resume;
    for cornering in [
        printer::Cornering::JunctionMm(crate::units::Mm(0.013)),
        printer::Cornering::SquareCornerMmS(crate::units::MmPerS(5.0)),
    ] {
        let printer::Kind::Fdm(fdm) = &mut full.kind else { unreachable!() };
        fdm.motion.cornering = cornering;
        leaves(&toml::Value::try_from(&full).unwrap(), "", &mut printer);
    }
    assert_eq!(printer, documented(&keys::fdm()));
    let mut printer = BTreeSet::new();
    let mut full = load_printer("generic-msla").unwrap();
    full.serial.hard_stop = Some(printer::HardStop::Dtr);
    let printer::Kind::Msla(msla) = &mut full.kind else { unreachable!() };
    msla.lcd.mirror = msla::Mirror::Xy;
    msla.light.pulse = Some(Macro("M1400 S{power} P{ms}".to_owned()));
    // A list of tables is one leaf: its own keys are compared below.
    let before = msla::Before {
        what: "the door is closed".to_owned(),
        send: Some("M119".to_owned()),
        wants: Some("door: TRIGGERED".to_owned()),
    };
    for (window, sink) in [
        (printer::Window::Bytes(120), msla::Sink::Framebuffer("fb0".to_owned())),
        (printer::Window::Lines(4), msla::Sink::Folder("/tmp".into())),
    ] {
        full.serial.window = window;
        let printer::Kind::Msla(msla) = &mut full.kind else { unreachable!() };
        msla.lcd.sink = sink;
        leaves(&toml::Value::try_from(&full).unwrap(), "", &mut printer);
    }
    leaves(&toml::Value::try_from(&before).unwrap(), "before", &mut printer);
    assert_eq!(printer, documented(&keys::msla()));
    for (name, table) in [("pla", keys::filament()), ("resin-standard", keys::MATERIAL.to_vec())] {
        let mut material = BTreeSet::new();
        let loaded = load_material(name).unwrap();
        leaves(&toml::Value::try_from(&loaded).unwrap(), "", &mut material);
        assert_eq!(material, documented(&table), "{name}");
    }
}

fn mk3s_with(from: &str, to: &str) -> String {
    let text = builtin::PRINTERS.iter().find(|(name, _)| *name == "prusa-mk3s").unwrap().1;
    assert!(text.contains(from));
    text.replace(from, to)
}

/// A user's file with one thing changed, and what is said of it.
fn check(from: &str, to: &str, expect: &str) {
    let mut file = tempfile::Builder::new().suffix(".toml").tempfile().unwrap();
    file.write_all(mk3s_with(from, to).as_bytes()).unwrap();
    let path = file.path().to_str().unwrap();
    let said = match load_printer(path) {
        Ok(_) => String::new(),
        Err(e) => e.to_string(),
    };
    if expect.is_empty() {
        assert_eq!(said, "", "{to:?}");
    } else {
        assert!(said.contains(expect), "{to:?}: {said}");
        assert!(said.contains(path), "{said}");
    }
}

#[test]
fn a_users_file_is_told_what_where_and_the_way_out() {
    check("nozzle_mm = 0.4", "nozzle_mm = 0.4 # mine", "");
    check("dtr_reset", "dtr_rseet", "line 26: unknown key serial.dtr_rseet; did you mean serial.dtr_reset?");
    check("nozzle_mm = 0.4", "nozzle_mm = 40", "line 12: nozzle_mm is 40, outside 0.05 to 3");
    check("max_line = 95\n", "", "");
    check("baud = 115200\n", "", "line 22: serial.baud is missing");
    check("marlin-cancel.gcode", "cancel.gcode", "marlin-cancel.gcode");
    check(
        "{ file = \"marlin-cancel.gcode\" }",
        "\"M104 S0\"",
        "macros.cancel is not safe: it leaves the bed's heater on",
    );
    check("{ file = \"marlin-start.gcode\" }", "\"M117 a\\\\\\\\b\"", "macros.start cannot be sent");
    check("{ bytes = 120 }", "{ bytes = 120, lines = 1 }", "exactly one of bytes, lines");
    check("[bed]", "[bed", "line 15");
    check("G1 Z10 F600\n", "", "macros.pause is not safe: it moves X or Y before Z");
    let way_back =
        |rest: &str| format!("[resume]\nhomes_xy_alone = true\nhoming_clears_part = true\n{rest}\n[macros]");
    check("[macros]", &way_back(""), "");
    check("[macros]", &way_back("home = 'G28'"), "line 43: resume.home is not safe: it homes Z");
    check("[macros]", &way_back("z_set = 'G92 Z0'"), "resume.z_set is not safe");
    check("[macros]", &way_back("levelling = 'G29'"), "resume.levelling is not safe");
    check("[macros]", &way_back("prime = 'G1 Z0'"), "resume.prime is not safe");
    check("[macros]", &way_back("prime = { file = 'none' }"), "resume.prime names the file");
    check("[macros]", &way_back("soften_c = 300\n"), "");
    check("[macros]", "[resume]\nhomes_xy_alone = true\n[macros]", "resume.homing_clears_part is missing");
    check("[macros]", &way_back("raise = 3"), "did you mean resume.raise_mm?");
    check("nozzle_mm", "orphan_timeout_s = 0\nnozzle_mm", "orphan_timeout_s is 0, outside 1 to 86400");
}

#[test]
fn a_profile_that_does_not_say_gets_what_is_safe() {
    let profile = load_printer("prusa-mk3s").unwrap();
    assert_eq!(profile.orphan_timeout_s, 300);
    assert_eq!(profile.serial.hard_stop(), printer::HardStop::Dtr);
    let native = load_printer("prusa-mini").unwrap();
    assert_eq!(native.serial.hard_stop(), printer::HardStop::None);
    assert_eq!(load_printer("generic-marlin").unwrap().resume, None);
}

/// A round bed is a delta, and a delta never resumes after a power cut.
#[test]
fn a_delta_does_not_home_xy_alone() {
    let text = builtin::PRINTERS.iter().find(|(name, _)| *name == "anycubic-kossel-plus").unwrap().1;
    let mut file = tempfile::Builder::new().suffix(".toml").tempfile().unwrap();
    file.write_all(text.replace("homes_xy_alone = false", "homes_xy_alone = true").as_bytes()).unwrap();
    let said = load_printer(file.path().to_str().unwrap()).unwrap_err().to_string();
    assert!(said.contains("homes_xy_alone is true of a round bed"), "{said}");
}

#[test]
fn a_macro_beside_the_users_profile_comes_first() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mine.toml");
    std::fs::write(&path, mk3s_with("marlin-cancel.gcode", "my-cancel.gcode")).unwrap();
    std::fs::write(folder.path().join("my-cancel.gcode"), "M107\nTURN_OFF_HEATERS\n").unwrap();
    let profile = load_printer(path.to_str().unwrap()).unwrap();
    assert_eq!(profile.macros.cancel.lines().collect::<Vec<_>>(), ["M107", "TURN_OFF_HEATERS"]);
}

#[test]
fn names_and_files_that_are_not_there() {
    let say = |name: &str| load_printer(name).unwrap_err().to_string();
    assert!(say("prusa-mk3").contains("did you mean prusa-mk3s?"));
    assert!(say("mk3s").contains("did you mean prusa-mk3s?"));
    assert!(say("zzz").contains("outrigger profile list"));
    assert!(say("./none.toml").contains("./none.toml"));
    assert!(say("/").contains("/"));
    let big = tempfile::Builder::new().suffix(".toml").tempfile().unwrap();
    big.as_file().set_len(FILE_BYTES_MAX + 1).unwrap();
    assert!(say(big.path().to_str().unwrap()).contains("no profile"));
}

#[test]
fn a_materials_faults_are_named() {
    let check = |name: &str, from: &str, to: &str, expect: &str| {
        let text = builtin::MATERIALS.iter().find(|(n, _)| *n == name).unwrap().1;
        assert!(text.contains(from), "{name}: {from}");
        let mut file = tempfile::Builder::new().suffix(".toml").tempfile().unwrap();
        file.write_all(text.replace(from, to).as_bytes()).unwrap();
        let said = load_any(file.path().to_str().unwrap()).unwrap_err().to_string();
        assert!(said.contains(expect), "{name}, {to:?}: {said}");
    };
    check("pla", "usual = 210", "usual = 250", "min <= usual <= max");
    check("pla", "kind = \"filament\"", "kind = \"resin\"", "belongs to a filament, and `kind` says");
    check("pla", "angle_deg = 45", "angle_deg = 90", "self_support.angle_deg is 90, outside 0 to 89");
    check(
        "pla",
        "angle_deg",
        "angle",
        "unknown key self_support.angle; did you mean self_support.angle_deg?",
    );
    check("resin-tough", "kind = \"resin\"", "kind = \"filament\"", "nozzle_c is missing");
    check("resin-tough", "min_area_mm2 = 0.01", "min_area_mm2 = -1", "outside 0 to 100");
    check("resin-tough", "name =", "bed_c = { min = 0, usual = 0, max = 0 }\nname =", "bed_c belongs to");
}

/// Resins bear less of a span than filaments, and show finer islands.
#[test]
fn rules_of_self_support() {
    for name in material_names() {
        let material = load_material(name).unwrap();
        let rules = material.self_support;
        let resin = material.kind == MaterialKind::Resin;
        assert_eq!(resin, name.starts_with("resin-"), "{name}");
        assert!((30.0..=75.0).contains(&rules.angle_deg), "{name}");
        assert_eq!(rules.bridge_mm < 4.0, resin, "{name}");
        assert_eq!(rules.min_area_mm2 < 0.1, resin, "{name}");
    }
}
