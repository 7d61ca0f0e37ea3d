use super::*;
use crate::merge::into_gcode::Options;
use crate::merge::testing::{around_the_bench, corpus, merged, part_beads, plain, same_beads};
use outrigger_gcode::dialect::Dialect;
use outrigger_gcode::line::{parse, split_lines};
use outrigger_gcode::state::{Effect, Kind, Machine};
use std::io::Cursor;

fn taken(input: &[u8]) -> Result<(Vec<u8>, Taken), Failure> {
    let mut output = Vec::new();
    let taken = out_of_gcode(&mut Cursor::new(input), &mut output, &|_, _| {})?;
    Ok((output, taken))
}

/// The way of the head without filament, mm.
fn travels_mm(text: &[u8]) -> f64 {
    let mut machine = Machine::default();
    let effects = split_lines(text).map(|bytes| machine.apply(&parse(bytes)));
    let travels = effects.filter_map(|effect| match effect {
        Effect::Motion(m) if m.kind() == Kind::Travel => Some(m.length_mm()),
        _ => None,
    });
    travels.sum()
}

/// What is put into a job comes out again, all of it and nothing else, and the head goes no
/// farther than it did with it.
fn check(name: &str) {
    let input = corpus(name);
    let (with, put) = merged(&input, &around_the_bench(), &Options::default()).unwrap();
    let (without, taken) = taken(&with).unwrap_or_else(|e| panic!("{name}: {e}"));
    assert!((taken.filament_mm - put.filament_mm).abs() < 0.01, "{name}: {taken:?} {put:?}");
    assert!(taken.beads > 1000 && taken.ways > 10, "{name}: {taken:?}");
    let [was, now] = [&input, &without].map(|job| plain(job));
    let ((beads, all), (beads_now, all_now)) = (part_beads(&was), part_beads(&now));
    same_beads(name, &beads, &beads_now);
    assert!((all - all_now).abs() < 0.01, "{name}: {all} {all_now}");
    let ways = travels_mm(&now) / travels_mm(&plain(&with));
    assert!(ways < 1.0, "{name}: {ways}");
    // There is nothing left to be taken.
    let (again, none) = self::taken(&without).unwrap();
    assert!(none == Taken::default() && again == without, "{name}: {none:?}");
}

#[test]
fn what_was_put_in_comes_out_of_every_dialect() {
    check("ps25-marlin-rel-triangles.gcode");
    check("ps25-marlin-abs-grid.gcode");
    check("ps25-marlin-abs-grid.bgcode");
    check("ps25-marlin-wipe-zhop-honeycomb.gcode");
    check("ps25-marlin2-fwretract-rectilinear.gcode");
    check("ps25-marlin-comments.gcode");
    check("ps25-klipper-gyroid.gcode");
    check("cura413-marlin-zhop-triangles.gcode");
    check("cura413-marlin-rel-cubic.gcode");
    check("cura413-marlin-fwretract-two-meshes.gcode");
    check("slic3r13-rel-comments.gcode");
    check("remarked-bambu.gcode");
    check("remarked-orca.gcode");
}

/// A job of a few layers in relative E, from the lines after its start.
fn job(body: &str) -> String {
    format!(
        "M83\n;LAYER_CHANGE\n;Z:.2\n;HEIGHT:0.2\nG1 Z.2 F600\nG1 X50 Y50 F9000\n;TYPE:Perimeter\n;WIDTH:0.4\nG1 F1200\nG1 X60 E.4\nG1 X50 Y55 F9000\nG1 F1200\nG1 X60 E.4\n{body}"
    )
}

#[test]
fn the_way_is_closed_where_supports_were() {
    let check = |body: &str, expect: &str| {
        let (output, _) = taken(job(body).as_bytes()).unwrap_or_else(|e| panic!("{body}: {e}"));
        assert_eq!(String::from_utf8(output).unwrap(), job(expect), "of {body}");
    };
    let support = ";TYPE:Support material\n";
    let part = ";TYPE:Perimeter\n";
    // Within a layer, with the filament pulled back before and pushed after.
    check(
        &format!(
            "G1 E-1 F2400\nG1 X9 Y9 F9000\nG1 E1 F2400\n{support}G1 F900\nG1 X19 E.4\nM106 S9\nG1 E-1 F2400\nG1 X50 Y60 F9000\nG1 E1 F2400\n{part}G1 F1200\nG1 X60 E.4\n"
        ),
        "G1 E-1 F2400\nM106 S9\nG1 Z.6 F9000\nG1 X50 Y60\nG1 Z.2\nG1 E1 F2400\nG1 F1200\nG1 X60 E.4\n",
    );
    // From one layer into the next, and the first of the next as well: marks stay.
    check(
        &format!(
            "G1 E-1 F2400\nG1 X9 Y9 F9000\nG1 E1 F2400\n{support}G1 F900\nG1 X19 E.4\nG1 E-1 F2400\n;LAYER_CHANGE\n;Z:.4\n;HEIGHT:0.2\nG1 Z.4 F600\nG1 X9 Y9 F9000\nG1 E1 F2400\nG1 F900\nG1 X19 E.4\nG1 E-1 F2400\nG1 X50 Y50 F9000\nG1 E1 F2400\n{part}G1 F1200\nG1 X60 E.4\n"
        ),
        "G1 E-1 F2400\n;LAYER_CHANGE\n;Z:.4\nG1 Z.4 F600\nG1 X50 Y50 F9000\nG1 E1 F2400\nG1 F1200\nG1 X60 E.4\n",
    );
    // Where the nozzle is may matter to this one.
    check(
        &format!(
            "{support}G1 X70 E.4\nTIMELAPSE\nG1 X80 E.4\nG1 X50 Y60 F9000\n{part}G1 F1200\nG1 X60 E.4\n"
        ),
        "G1 Z.6 F9000\nG1 X70 Y55\nG1 Z.2\nG1 F1200\nTIMELAPSE\nG1 Z.6 F9000\nG1 X50 Y60\nG1 Z.2\nG1 F1200\nG1 X60 E.4\n",
    );
}

#[test]
fn what_supports_cannot_be_taken_from_is_refused() {
    let check = |text: String, expect: &str| {
        let got = taken(text.as_bytes()).map(|(_, taken)| taken).expect_err(expect).to_string();
        assert!(got.contains(expect), "{got}");
    };
    check(
        job("T1\n;TYPE:Support material\nG1 X70 E.4\nT0\n;TYPE:Perimeter\nG1 X90 E.4\n"),
        "a tool of their own",
    );
    let raft = job("").replace(";TYPE:Perimeter", ";TYPE:Support material");
    check(
        format!("{raft};LAYER_CHANGE\n;Z:.5\nG1 Z.5\nG1 X50\n;TYPE:Perimeter\nG1 X60 E.4\n"),
        "begins at Z 0.5 mm on supports from Z 0.2 mm",
    );
    check(
        job(";TYPE:Support material\nG91\nG1 X9 E.4\nG1 X-9\n;TYPE:Perimeter\nG1 X9 E.4\n"),
        "relative coordinates",
    );
    check("G1 X1 E1\n".to_owned(), "no slicer's layer comments");
}

#[test]
fn the_proof_finds_every_change() {
    const JOB: &str = "M83\n;TYPE:Perimeter\n;WIDTH:0.4\nG1 Z.2 F600\nG1 X9 F1200 E.4\nM106 S9\nG1 E-1\nG1 X5 Y5\n;TYPE:Support material\nG1 E1\nG1 X9 E.4\nPARK\n;TYPE:Perimeter\nG1 X19 E.4\n";
    const BARE: &str = "M83\n;TYPE:Perimeter\n;WIDTH:0.4\nG1 Z.2 F600\nG1 X9 F1200 E.4\nM106 S9\nG1 X9 Y5\nPARK\nG1 X19 E.4\n";
    let proof = |result: &str| {
        let mut verifier = Verifier::new(Dialect::Prusa);
        verifier.layer(1, JOB.as_bytes(), result.as_bytes())?;
        verifier.finish(1)
    };
    assert_eq!(proof(BARE), Ok(()));
    let check = |from: &str, to: &str, expect: &str| {
        assert!(BARE.contains(from), "{from}");
        let got = proof(&BARE.replacen(from, to, 1)).expect_err(&format!("{from} → {to}")).to_string();
        assert!(got.contains(expect), "{from} → {to}: {got}");
    };
    check("G1 X19 E.4\n", "", "being there");
    check("G1 X19 E.4\n", "G1 X19 E.4\nG1 X20 E.1\n", "being there");
    check("G1 X19 E.4", "G1 X18 E.4", "where it leads");
    check("G1 X19 E.4", "G1 X19 E.5", "its filament");
    check("G1 X19 E.4", "G1 F9\nG1 X19 E.4", "its feed rate");
    check("PARK\n", "PARK\nG1 E-1\n", "the filament before it");
    check("PARK\n", "PARK\n;TYPE:Skirt\n", "what it is");
    check("PARK\n", "PARK\n;WIDTH:0.5\n", "what it is");
    check("PARK\n", "PARK\nT1\n", "would be lost, moved or new");
    check("PARK\n", "", "would be lost, moved or new");
    check("G1 X9 Y5\nPARK\n", "PARK\nG1 X9 Y5\n", "find the nozzle elsewhere");
    check("M106 S9\n", "", "would be lost, moved or new");
    check("M106 S9\n", "M106 S8\n", "would be lost, moved or new");
    check("G1 X9 Y5\n", ";TYPE:Support material\nG1 X9 Y5 E1\n", "is still there");
    check("G1 X9 Y5\n", "G1 X9 Y5 F99999\nG1 F1200\n", "faster than the file");
    check("G1 X9 Y5\n", "G1 E-9\nG1 E9\nG1 X9 Y5\n", "deeper than the file");
    check("G1 X19 E.4\n", "G1 X19 E.4\nG1 X0\n", "the end");
}

mod random {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(256))]
        /// No text makes it panic, and what it gives holds no supports any more.
        #[test]
        fn any_text_is_survived(lines in proptest::collection::vec(
            "G[0-1]( [XYZEF]-?[0-9]{1,2}(\\.[0-9]{1,2})?){1,4}|G9[0-2]( E0)?|M8[23]|G1[01]|;LAYER_CHANGE|;TYPE:(Perimeter|Internal infill|Support material|Support material interface)|;(WIDTH|HEIGHT):0\\.[1-9]|PARK|M106 S9", 0..80)) {
            let text = job(&lines.join("\n"));
            if let Ok((output, _)) = taken(text.as_bytes()) {
                let (_, again) = taken(&output).unwrap();
                prop_assert_eq!(again.beads, 0);
            }
        }
    }
}
