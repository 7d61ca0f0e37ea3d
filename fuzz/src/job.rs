//! A whole job: no file of lines makes the machine's state or a dialect panic,
//! and marks come from comments and labels alone.
//!
//! Takes the fuzzer's bytes as a file. Fails by panic.
#![no_main]
use libfuzzer_sys::fuzz_target;
use outrigger_gcode::dialect::{Detection, Dialect, detect};
use outrigger_gcode::line::{Command, parse, split_lines};
use outrigger_gcode::state::{Effect, Machine};

fuzz_target!(|data: &[u8]| {
    let dialects = match detect(data) {
        Detection::One(dialect) => vec![dialect],
        Detection::Mixed(one, other) => {
            assert_ne!(one, other);
            vec![one, other]
        }
        Detection::Unknown => Dialect::ALL.to_vec(),
    };
    let mut machine = Machine::default();
    for piece in split_lines(data) {
        let line = parse(piece);
        for dialect in &dialects {
            let marked = dialect.mark(&line).is_some();
            let may_mark = !line.comment.is_empty() || line.command != Command::None;
            assert!(!marked || may_mark, "{dialect:?} reads {piece:?}");
        }
        let before = machine.clone();
        if let Effect::Motion(step) = machine.apply(&line) {
            // Debug: a coordinate beyond every number makes NaN, which does not equal itself.
            assert_eq!(format!("{:?}", step.from), format!("{:?}", before.position));
            assert_eq!(format!("{:?}", step.to), format!("{:?}", machine.position));
            let _ = (step.kind(), step.length_mm(), step.arc.map(|arc| arc.reversed()));
        }
    }
});
