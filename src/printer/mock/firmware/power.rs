//! Starting, halting and the scripted faults in between.
use super::super::emergency::EmergencyParser;
use super::super::faults::{Fault, Kind};
use super::super::line::Numbering;
use super::super::motion::Motion;
use super::super::stats::Digest;
use super::wait::Wait;
use super::watch::Did;
use super::{BUSY_S, Firmware, Power};

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

    pub(super) fn happen(&mut self, fault: Fault) {
        let text = fault.text.unwrap_or_default();
        let for_ns = (fault.for_s.unwrap_or(0.0) * 1e9) as u64;
        match fault.kind {
            Kind::Say => self.say(format!("{text}\n").as_bytes()),
            Kind::Kill => self.kill(&text),
            Kind::Reset => self.boot(" Brown out Reset"),
            Kind::Hang => self.hung_until_ns = self.now_ns.saturating_add(for_ns),
            Kind::HangUp => self.hang_up_ns = Some(for_ns),
            // These wait for a line: `damage` and `reply` look for them.
            Kind::CorruptLine | Kind::ResendWithoutOk | Kind::DropOk | Kind::GarbleReply | Kind::Noise => {}
        }
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
        self.note(|| Did::Started);
        self.uart.reset(self.now_ns);
        self.emergency = EmergencyParser::default();
        self.numbering = Numbering::default();
        self.motion = Motion::default();
        self.planner.dynamics = self.config.machine.dynamics;
        self.cold_extrusion_allowed = false;
        self.auto_report = None;
        self.busy_every_ns = (BUSY_S * 1e9) as u64;
        self.inactive_max_ns = None;
        self.hung_until_ns = 0;
        self.highest = 0;
        self.digest = Digest::default();
        self.boot_cause = cause;
        self.power = Power::Booting(self.now_ns + BOOT_NS);
        self.counts.boots += 1;
    }

    pub(super) fn all_off(&mut self) {
        // A command in hand that waits for room has a move too.
        let moves = self.planner.planned() + usize::from(matches!(self.wait, Some((Wait::Room(_), _))));
        self.note(|| Did::Dropped { moves });
        self.planner.stop(self.now_ns);
        self.queue.clear();
        self.wait = None;
        self.line.finish();
        let now_s = self.simulated_s();
        self.nozzle.set(0.0, now_s);
        self.bed.set(0.0, now_s);
        self.fan = 0;
    }
}
