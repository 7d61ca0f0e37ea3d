use super::*;

fn check(text: &str, expect: &str) {
    let text = if text.contains("title") {
        text.to_owned()
    } else {
        format!("title = 't'\n[job]\nlines = 9\n{text}\n[expect]\noutcome = 'finished'")
    };
    let said = Scenario::parse("x", &text).map_or_else(|e| e.to_string(), |_| String::new());
    match expect {
        "" => assert_eq!(said, "", "{text}"),
        _ => assert!(said.contains(expect), "{text}: {said:?}"),
    }
}

#[test]
fn files_are_checked() {
    check("", "");
    check("line = 3", "unknown field `line`");
    check("gcode = 'G28'", "needs one of lines");
    check("insert = { 50 = 'M600' }", "no number of moves");
    check("[[fault]]\nat_line = 3\ndo = 'lose_line'", "");
    check("[[fault]]\nat_line = [3, 4]\ndo = 'lose_line'", "");
    check("[[fault]]\nat_line = []\ndo = 'lose_line'", "sweeps over");
    check("[[fault]]\ndo = 'lose_line'", "needs one of at_line");
    check("[[fault]]\nat_line = 3\nat_s = 3\ndo = 'lose_line'", "needs one of at_line");
    check("[[fault]]\nat_s = -3\ndo = 'lose_line'", "outside 0");
    check("[[fault]]\nat_s = 3\ndo = 'hang'", "needs for_s");
    check("[[fault]]\nat_s = 3\nfor_s = 1\ndo = 'pause'", "takes no for_s");
    check("[[fault]]\nat_s = 3\ndo = 'say'", "needs text");
    check("[[fault]]\nat_state = 'asleep'\ndo = 'resume'", "state \"asleep\"");
    check("[[fault]]\nat_s = 3\ndo = 'drop_ok'", "needs at_line");
    check("[noise]\nlose_line = 1001", "thousandths");
}

#[test]
fn the_help_names_every_kind_and_every_key() {
    for kind in Kind::ALL {
        assert!(HELP.contains(kind.name()), "{}", kind.name());
        let quoted = format!("k = {:?}", kind.name());
        let table: toml::Table = toml::from_str(&quoted).unwrap();
        let parsed: Kind = table["k"].clone().try_into().unwrap();
        assert_eq!(parsed, *kind);
    }
    // What serde knows of keys it says when one is wrong.
    for (section, prefix) in
        [("", "title = 't'\n"), ("[printer]", ""), ("[noise]", ""), ("[[fault]]", ""), ("[expect]", "")]
    {
        let text = format!("{prefix}{section}\nno_such_key = 1");
        let said = Scenario::parse("x", &text).unwrap_err().to_string();
        let keys = said.split("expected one of").nth(1).unwrap_or_default();
        let keys: Vec<_> = keys.split('`').skip(1).step_by(2).collect();
        assert!(keys.len() > 2, "{said}");
        for key in keys {
            assert!(HELP.contains(key), "{key} of {section}");
        }
    }
}

#[test]
fn sweeps_become_one_scenario_each() {
    let text = "title = 't'\n[job]\nlines = 9\n[[fault]]\nat_line = [3, 4]\ndo = 'pause'\n\
                [[fault]]\nat_line = [5, 6]\ndo = 'lose_line'\n[expect]\noutcome = 'finished'";
    let names: Vec<_> = Scenario::parse("x", text).unwrap().unroll().iter().map(|s| s.name.clone()).collect();
    assert_eq!(names, ["x@3@5", "x@3@6", "x@4@5", "x@4@6"]);
}

#[test]
fn generated_moves_are_all_unlike() {
    let mut all: Vec<_> = (1..=500).map(job::generated).collect();
    all.sort();
    all.dedup();
    assert_eq!(all.len(), 500);
}
