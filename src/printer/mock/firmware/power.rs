//! Starting, halting and the scripted faults in between.
use super::super::emergency::EmergencyParser;
use super::super::faults::{Fault, Kind};
use super::super::line::Numbering;
use super::super::motion::Motion;
use super::super::report;
use super::super::stats::Digest;
use super::{Firmware, Power, busy_every_ns, z_only_mm};

/// How long a start takes. Boot loaders take one to two seconds; a tenth is
/// enough to lose the bytes of a host that does not wait for `start`.
const BOOT_NS: u64 = 200_000_000;

impl Firmware {
    /// Scripted events when a line is executed; false when there is nothing
    /// left to execute it.
    pub(super) fn faults_of_line(&mut self, number: Option<i64>) -> bool {
        while let Some(fault) = self.faults.event_at_line(number) {
            self.happen(fault);
            if self.power != Power::Running {
                return false;
            }
        }
        self.now_ns >= self.hung_until_ns
    }

    /// What is due of starting, of the power and of the device that comes back.
    pub(super) fn power_events(&mut self) {
        match self.power {
            Power::Booting(until_ns) if until_ns <= self.now_ns => {
                self.power = Power::Running;
                self.last_command_ns = self.now_ns;
                let text = report::boot(&self.config.habits, self.boot_cause);
                self.say(text.as_bytes());
            }
            Power::Off(until_ns) if until_ns <= self.now_ns => self.boot("PowerUp"),
            _ => {}
        }
        if self.reset_at_ns.is_some_and(|at| at <= self.now_ns) {
            self.reset_at_ns = None;
            self.boot(" External Reset");
        }
    }

    pub(super) fn happen(&mut self, fault: Fault) {
        if matches!(self.power, Power::Off(_)) && fault.kind != Kind::PartRemoved {
            return;
        }
        let text = fault.text.unwrap_or_default();
        let for_ns = (fault.for_s.unwrap_or(0.0) * 1e9) as u64;
        match fault.kind {
            Kind::Say => self.say(format!("{text}\n").as_bytes()),
            Kind::Kill => self.kill(&text),
            Kind::Reset => self.boot(" Brown out Reset"),
            Kind::Hang => self.hung_until_ns = self.now_ns.saturating_add(for_ns),
            Kind::HangUp => self.unplug(for_ns, fault.reset == Some(true)),
            Kind::Blocked => self.blocked_until_ns = self.now_ns.saturating_add(for_ns),
            Kind::PowerCut => {
                self.cut_power(for_ns, fault.sag_mm.unwrap_or(0.0));
                if fault.unplugs == Some(true) {
                    self.unplug(for_ns, false);
                }
            }
            Kind::FilamentOut => self.runout = true,
            Kind::PartRemoved => self.body.remove_part(),
            // These wait for a line: `damage` and `reply` look for them.
            Kind::CorruptLine
            | Kind::ResendWithoutOk
            | Kind::LoseLine
            | Kind::DropByte
            | Kind::DropOk
            | Kind::GarbleReply
            | Kind::CutReply
            | Kind::Noise => {}
        }
    }

    /// The cable is out: what was on it is lost either way, the board goes on.
    fn unplug(&mut self, for_ns: u64, reset: bool) {
        self.hang_up_ns = Some(for_ns);
        self.gone_until_ns = self.now_ns.saturating_add(for_ns);
        self.uart.unplug();
        self.reset_at_ns = reset.then_some(self.gone_until_ns);
    }

    /// No power: what the board knew is gone, and the motors no longer hold Z.
    fn cut_power(&mut self, for_ns: u64, sag_mm: f64) {
        self.counts.power_cuts += 1;
        self.all_off();
        self.fan_off();
        self.uart.reset(self.now_ns);
        self.body.sag(sag_mm);
        self.body.lose();
        self.power = Power::Off(self.now_ns.saturating_add(for_ns));
    }

    /// Marlin's `kill()`: says why, switches everything off, and stays so.
    pub(super) fn kill(&mut self, why: &str) {
        if self.power != Power::Running {
            return;
        }
        if !why.is_empty() {
            self.say(format!("Error:{why}\n").as_bytes());
        }
        self.say(b"Error:Printer halted. kill() called!\n");
        self.counts.kills += 1;
        self.all_off();
        self.power = Power::Halted;
    }

    pub(super) fn boot(&mut self, cause: &'static str) {
        self.all_off();
        self.fan_off();
        self.macros = Default::default();
        self.uart.reset(self.now_ns);
        self.emergency = EmergencyParser::default();
        self.numbering = Numbering::default();
        self.motion = Motion::new(z_only_mm(&self.config.machine));
        self.body.lose();
        self.heaters.tool = 0;
        self.levelling_on = false;
        self.planner.dynamics = self.config.machine.dynamics;
        self.cold_extrusion_allowed = false;
        self.auto_report = None;
        self.busy_every_ns = busy_every_ns(&self.config);
        self.inactive_max_ns = None;
        self.hung_until_ns = 0;
        self.highest = 0;
        self.digest = Digest::default();
        self.boot_cause = cause;
        self.power = Power::Booting(self.now_ns + BOOT_NS);
        self.counts.boots += 1;
        self.note_start();
    }

    /// What `kill()` switches off: fans go on as they were.
    pub(super) fn all_off(&mut self) {
        self.stop_moves();
        self.queue.clear();
        self.current.clear();
        self.script = None;
        self.wait = None;
        self.runout = false;
        self.injected = false;
        self.tell_position = false;
        self.line.finish();
        let now_s = self.simulated_s();
        self.heaters.all_off(now_s);
        self.cutter = 0;
        self.look_at_light();
    }

    fn fan_off(&mut self) {
        self.fan = 0;
        self.look_at_light();
    }
}
