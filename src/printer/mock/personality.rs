//! Firmwares by name: what each changes of the plain Marlin 2.1.
//!
//! One table: the scenarios of the rig and `outrigger mock --personality` take
//! their names from it, the help its words. Each stands for something that a
//! host must cope with, and most differ from the plain one in that alone.
use super::config::{Config, Habits, OkForm, Repeats, ResendForm};

/// A firmware with a name.
#[derive(Clone, Copy, Debug)]
pub struct Personality {
    /// Its name, as scenarios and flags have it.
    pub name: &'static str,
    /// What is special about it, for people.
    pub help: &'static str,
    change: fn(&mut Config),
}

/// All of them.
pub const PERSONALITIES: &[Personality] = &[
    Personality {
        name: "marlin-2.1",
        help: "Marlin 2.1.2.1 as shipped, with emergency parser and prompts",
        change: |_| {},
    },
    Personality {
        name: "advanced-ok",
        help: "says the free places in each ok: ok N1 P15 B3",
        change: |c| c.advanced_ok = true,
    },
    Personality {
        name: "no-emergency-parser",
        help: "M108, M112, M410 and M876 wait in the queue like all else",
        change: |c| c.emergency_parser = false,
    },
    Personality {
        name: "no-auto-report",
        help: "does not know M155: temperatures come when asked for",
        change: |c| c.habits.auto_report = false,
    },
    Personality {
        name: "no-busy-notes",
        help: "says nothing while a command lasts (no HOST_KEEPALIVE_FEATURE)",
        change: |c| c.habits.busy_notes = false,
    },
    Personality {
        name: "no-prompts",
        help: "M0 and M600 wait for M108 without a prompt",
        change: |c| c.habits.prompts = false,
    },
    Personality {
        name: "resend-without-ok",
        help: "no ok follows its Resend:, as in some versions",
        change: |c| c.habits.resend_ok = false,
    },
    Personality {
        name: "resend-tight",
        help: "asks with Resend:12",
        change: |c| c.habits.resend = ResendForm::Tight,
    },
    Personality {
        name: "resend-with-n",
        help: "asks with Resend: N:12",
        change: |c| c.habits.resend = ResendForm::WithN,
    },
    Personality { name: "rs", help: "asks with rs 12, and no ok", change: rs },
    Personality {
        name: "refuses-repeats",
        help: "asks for a resend when the last line comes again",
        change: |c| c.habits.repeats = Repeats::Refused,
    },
    Personality { name: "rx-64", help: "receive buffer of 64 bytes", change: |c| c.rx_bytes = 64 },
    Personality { name: "rx-1024", help: "receive buffer of 1024 bytes", change: |c| c.rx_bytes = 1024 },
    Personality {
        name: "large",
        help: "32-bit board: 1024 bytes, 32 commands, 64 moves, ADVANCED_OK",
        change: large,
    },
    Personality {
        name: "no-power-loss-recovery",
        help: "ignores G92.9 without a word",
        change: |c| c.habits.native_position = false,
    },
    Personality {
        name: "two-extruders",
        help: "T0 and T1, each with a heater",
        change: |c| c.machine.extruders = 2,
    },
    Personality {
        name: "chamber",
        help: "a heated chamber: M141, M191 and C: in the temperatures",
        change: |c| c.machine.chamber = true,
    },
    Personality {
        name: "levelling",
        help: "bed levelling: G29, M420",
        change: |c| c.machine.levelling = true,
    },
    Personality {
        name: "marlin-1.1",
        help: "Marlin 1.1.9: no prompts, no emergency parser, refuses repeats",
        change: marlin_1_1,
    },
    Personality {
        name: "marlin-1.0",
        help: "Marlin 1.0: besides no M155, no busy notes, no capabilities",
        change: marlin_1_0,
    },
    Personality {
        name: "repetier",
        help: "Repetier-Firmware 1.0: ok 12 when queued, wait, skip",
        change: repetier,
    },
    Personality {
        name: "klipper",
        help: "Klipper's terminal: neither numbers nor checksums are looked at",
        change: klipper,
    },
];

impl Personality {
    /// The one of this name.
    pub fn find(name: &str) -> Option<&'static Self> {
        PERSONALITIES.iter().find(|p| p.name == name)
    }

    /// Changes what makes it different, and nothing else.
    pub fn apply(&self, config: &mut Config) {
        (self.change)(config);
    }

    /// A board of its own with this firmware.
    pub fn config(&self) -> Config {
        let mut config = Config::default();
        self.apply(&mut config);
        config
    }
}

fn rs(config: &mut Config) {
    config.habits.resend = ResendForm::Short;
    config.habits.resend_ok = false;
}

fn large(config: &mut Config) {
    (config.rx_bytes, config.queue, config.blocks) = (1024, 32, 64);
    config.advanced_ok = true;
}

fn marlin_1_1(config: &mut Config) {
    config.emergency_parser = false;
    config.habits = Habits {
        version: "Marlin 1.1.9",
        repeats: Repeats::Refused,
        prompts: false,
        native_position: false,
        homing_raise: false,
        ..config.habits
    };
}

fn marlin_1_0(config: &mut Config) {
    marlin_1_1(config);
    config.habits = Habits {
        version: "Marlin 1.0.2",
        auto_report: false,
        busy_notes: false,
        capabilities: false,
        tells_position: false,
        ..config.habits
    };
}

fn repetier(config: &mut Config) {
    config.emergency_parser = false;
    config.queue = 16;
    config.habits = Habits {
        version: "Repetier_1.0.4",
        ok: OkForm::Number,
        ok_when_queued: true,
        resend: ResendForm::Tight,
        repeats: Repeats::Skipped,
        wait_s: 1.0,
        prompts: false,
        native_position: false,
        homing_raise: false,
        tells_position: false,
        ..config.habits
    };
}

fn klipper(config: &mut Config) {
    (config.rx_bytes, config.queue, config.blocks) = (4096, 64, 256);
    config.habits = Habits {
        version: "Klipper v0.12.0",
        checks_lines: false,
        auto_report: false,
        busy_notes: false,
        capabilities: false,
        prompts: false,
        native_position: false,
        homing_raise: false,
        tells_position: false,
        ..config.habits
    };
}

/// The table for people, one a line.
pub fn help() -> String {
    let width = PERSONALITIES.iter().map(|p| p.name.len()).max().unwrap_or(0);
    PERSONALITIES.iter().map(|p| format!("{:width$}  {}\n", p.name, p.help)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_names_and_each_differs_from_the_plain_one() {
        for (at, personality) in PERSONALITIES.iter().enumerate() {
            assert!(PERSONALITIES[..at].iter().all(|p| p.name != personality.name), "{}", personality.name);
            assert_eq!(personality.config() == Config::default(), at == 0, "{}", personality.name);
            assert!(Personality::find(personality.name).is_some());
            assert!(help().contains(personality.help));
        }
        assert!(Personality::find("marlin").is_none());
    }
}
