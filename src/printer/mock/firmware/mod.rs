//! The board: bytes and the time in, bytes and counts out.
//!
//! Marlin's main loop on a clock that is given from outside: bytes arrive at
//! the line's speed, are read into lines while the command queue has room,
//! are judged, queued and executed one after the other; moves run in the
//! planner meanwhile. Time is in nanoseconds since power-on; the mechanics
//! (moves, heat, dwelling) run [`Config::speed`] times faster than it, the
//! serial line and the reports do not. Does no I/O, owns no clock.
//!
//! # Layout
//! Here the state, the clock and the main loop · `intake` from bytes to the
//! queue · `execute` what commands do, `set` those that set values · `wait` what
//! they wait for · `lamp` the light of a resin printer · `script` commands within a command ·
//! `deeds` which of them have really run · `power` starting,
//! halting, faults · `watch` for who judges a run.
use super::body::Body;
use super::config::{Config, EXTRUDERS_MAX, Machine, OkForm};
use super::emergency::EmergencyParser;
use super::faults::Faults;
use super::heater::{self, Heater};
use super::light::{self, Light};
use super::line::{LineBuffer, Numbering};
use super::motion::Motion;
use super::planner::Planner;
use super::plate::Plate;
use super::report::{self, Heaters};
use super::stats::{Digest, Stats};
use super::uart::Uart;
use std::collections::VecDeque;
use wait::Wait;

mod deeds;
mod execute;
mod intake;
mod lamp;
mod power;
mod script;
mod set;
mod wait;
mod watch;

pub use deeds::Executed;

/// Marlin's DEFAULT_KEEPALIVE_INTERVAL.
const BUSY_S: f64 = 2.0;

#[derive(Debug)]
pub(super) struct Queued {
    line: Vec<u8>,
    number: Option<i64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Power {
    /// Starting until then; what comes meanwhile is lost.
    Booting(u64),
    Running,
    /// After `kill()`: only a reset helps.
    Halted,
    /// Without power until then.
    Off(u64),
}

/// The board.
#[derive(Debug)]
pub struct Firmware {
    config: Config,
    faults: Faults,
    uart: Uart,
    emergency: EmergencyParser,
    line: LineBuffer,
    numbering: Numbering,
    pub(super) queue: VecDeque<Queued>,
    wait: Option<(Wait, u64)>,
    pub(super) planner: Planner,
    motion: Motion,
    body: Body,
    heaters: Heaters,
    fan: u8,
    /// Power of spindle or laser.
    cutter: u8,
    light: Light,
    /// M810 to M819.
    macros: [Vec<u8>; script::MACROS],
    /// What is left of the macro that the command at the head of the queue runs.
    script: Option<script::Script>,
    levelling_on: bool,
    cold_extrusion_allowed: bool,
    now_ns: u64,
    power: Power,
    boot_cause: &'static str,
    hung_until_ns: u64,
    /// The device takes no bytes until then.
    blocked_until_ns: u64,
    /// The device is gone until then; whether the board has restarted when it is back.
    gone_until_ns: u64,
    reset_at_ns: Option<u64>,
    /// The filament ended; M600 comes before the next command.
    runout: bool,
    /// What waits is no command of the queue.
    injected: bool,
    /// The position is told before the next `ok`.
    tell_position: bool,
    /// When an idle board says `wait`.
    wait_next_ns: u64,
    /// Moves whose end has not come, and what has been executed.
    deeds: VecDeque<deeds::Deed>,
    /// The text of the command that is being executed, if it is no move.
    current: Vec<u8>,
    executed: Vec<Executed>,
    executed_digest: Digest,
    /// Bytes on their way from the wire to the line.
    run_of_bytes: Vec<u8>,
    /// M155: interval and next time.
    auto_report: Option<(u64, u64)>,
    /// M113: interval, 0 for never.
    busy_every_ns: u64,
    busy_next_ns: u64,
    /// M85: interval.
    inactive_max_ns: Option<u64>,
    last_command_ns: u64,
    /// The next resend request lacks its `ok`.
    resend_without_ok: bool,
    hang_up_ns: Option<u64>,
    /// Highest number in this numbering.
    highest: i64,
    digest: Digest,
    all_digest: Digest,
    counts: Stats,
    /// When it began to start, each time.
    starts_ns: Vec<u64>,
}

impl Firmware {
    /// A board at time 0: one that opening the port resets is just switched
    /// on and hears nothing yet; another has been on for
    /// long, so that a host that opens the port hears no `start`.
    pub fn new(config: Config, faults: Faults) -> Self {
        let machine = &config.machine;
        let extruders = machine.extruders.clamp(1, EXTRUDERS_MAX);
        let mut board = Self {
            uart: Uart::new(config.baud, config.rx_bytes).with_latency(config.latency_ns),
            planner: Planner::new(machine.dynamics, config.speed, config.blocks),
            heaters: Heaters {
                nozzles: vec![Heater::new(heater::NOZZLE); extruders],
                tool: 0,
                bed: Heater::new(heater::BED),
                chamber: machine.chamber.then(|| Heater::new(heater::CHAMBER)),
            },
            faults,
            emergency: EmergencyParser::default(),
            line: LineBuffer::default(),
            numbering: Numbering::default(),
            queue: VecDeque::with_capacity(config.queue),
            wait: None,
            motion: Motion::new(z_only_mm(machine)),
            body: Body::new(machine.resin.map(|resin| Plate::new(resin.homes_up, resin.z_max_mm))),
            fan: 0,
            cutter: 0,
            light: Light::new(config.speed, light::PULSES_MAX),
            macros: Default::default(),
            script: None,
            levelling_on: false,
            cold_extrusion_allowed: false,
            now_ns: 0,
            power: Power::Running,
            boot_cause: "",
            hung_until_ns: 0,
            blocked_until_ns: 0,
            gone_until_ns: 0,
            reset_at_ns: None,
            runout: false,
            injected: false,
            tell_position: false,
            wait_next_ns: 0,
            deeds: VecDeque::new(),
            current: Vec::new(),
            executed: Vec::new(),
            executed_digest: Digest::default(),
            run_of_bytes: Vec::new(),
            auto_report: None,
            busy_every_ns: busy_every_ns(&config),
            busy_next_ns: 0,
            inactive_max_ns: None,
            last_command_ns: 0,
            resend_without_ok: false,
            hang_up_ns: None,
            highest: 0,
            digest: Digest::default(),
            all_digest: Digest::default(),
            counts: Stats { boots: 1, ..Stats::default() },
            starts_ns: Vec::new(),
            config,
        };
        if board.config.dtr_reset {
            board.counts.boots = 0;
            board.boot("PowerUp");
        }
        board
    }

    /// How many bytes [`Self::receive`] takes now.
    pub fn room(&self) -> usize {
        if self.now_ns < self.blocked_until_ns.max(self.gone_until_ns) { 0 } else { self.uart.room() }
    }

    /// The host wrote these bytes now, no more than [`Self::room`].
    pub fn receive(&mut self, now_ns: u64, bytes: &[u8]) {
        self.advance(now_ns);
        if self.now_ns < self.gone_until_ns {
            return;
        }
        self.uart.write(self.now_ns, bytes);
        self.advance(now_ns);
    }

    /// The host opened the port, and DTR rose.
    pub fn connect(&mut self, now_ns: u64) {
        self.advance(now_ns);
        self.counts.connects += 1;
        if self.config.dtr_reset && !matches!(self.power, Power::Off(_)) {
            self.boot(" External Reset");
        }
    }

    /// The host opened the port, and DTR was up already.
    pub fn reconnect(&mut self, now_ns: u64) {
        self.advance(now_ns);
        self.counts.connects += 1;
    }

    /// Whether DTR stays up over a port that is closed without HUPCL.
    pub(super) fn keeps_dtr(&self) -> bool {
        self.config.keeps_dtr
    }

    /// Somebody took the part off the bed.
    pub fn remove_part(&mut self) {
        self.body.remove_part();
    }

    /// Appends the reply bytes that are out by now.
    pub fn take_output(&mut self, to: &mut Vec<u8>) {
        self.uart.take_output(self.now_ns, to);
    }

    /// A scripted fault wants the serial device gone for so long, ns.
    pub fn take_hang_up(&mut self) -> Option<u64> {
        self.hang_up_ns.take()
    }

    /// Runs everything that happens up to now.
    pub fn advance(&mut self, now_ns: u64) {
        while let Some(at_ns) = self.next_event_ns(now_ns) {
            self.now_ns = self.now_ns.max(at_ns);
            self.step();
        }
        self.now_ns = self.now_ns.max(now_ns);
    }

    /// When [`Self::advance`] next has something that the host can see, or
    /// that makes room; `None` until bytes come.
    pub fn deadline_ns(&self) -> Option<u64> {
        let for_moves = matches!(self.wait, Some((Wait::Room(_) | Wait::Drain(_), _)));
        [
            self.uart.next_line_ns(),
            self.uart.next_output_ns(),
            for_moves.then(|| self.planner.next_end_ns()).flatten(),
            self.own_event_ns(),
        ]
        .into_iter()
        .flatten()
        .min()
    }

    /// When something happens next, no later than `until_ns`. Bytes within a line are
    /// taken on the way.
    fn next_event_ns(&mut self, until_ns: u64) -> Option<u64> {
        let limit_ns = [self.planner.next_end_ns(), self.own_event_ns()].into_iter().flatten().min();
        let before_ns = limit_ns.map_or(until_ns, |at| at.min(until_ns));
        self.take_run_of_bytes(before_ns);
        let arrival_ns = self.uart.next_arrival_ns();
        [limit_ns, arrival_ns].into_iter().flatten().min().filter(|at| *at <= until_ns)
    }

    /// Events of the board itself: not bytes, not moves.
    fn own_event_ns(&self) -> Option<u64> {
        let fault = self.faults.next_event_ns();
        let own = match self.power {
            Power::Booting(until_ns) | Power::Off(until_ns) => Some(until_ns),
            Power::Halted => None,
            Power::Running => {
                let waits = self.wait.as_ref().and_then(|(wait, _)| match wait {
                    Wait::Until(at) => Some(*at),
                    Wait::Heat(heat) => Some(heat.done_ns.min(heat.report_ns)),
                    Wait::User { until_ns, .. } => *until_ns,
                    // The planner's own end of a move leads on, unless the board did not run then.
                    Wait::Room(_) => (self.planner.free() > 0).then_some(self.now_ns),
                    Wait::Drain(_) => self.planner.is_empty().then_some(self.now_ns),
                });
                let busy = (self.wait.is_some() && self.busy_every_ns > 0).then_some(self.busy_next_ns);
                // Work that waits for the transmitter.
                let work = !self.uart.rx_is_empty() && self.queue.len() < self.config.queue
                    || (self.runout || !self.queue.is_empty()) && self.wait.is_none();
                let ready = work.then(|| self.uart.tx_free_ns().max(self.now_ns));
                let inactive = self.inactive_at_ns();
                let report = self.auto_report.map(|(_, next)| next);
                let idle = self.is_idle().then_some(self.wait_next_ns);
                [waits, busy, ready, inactive, report, idle]
                    .into_iter()
                    .flatten()
                    .min()
                    .map(|at| at.max(self.hung_until_ns).max(self.uart.tx_free_ns()))
            }
        };
        let unblocked = (self.blocked_until_ns > self.now_ns).then_some(self.blocked_until_ns);
        [own, fault, unblocked, self.reset_at_ns].into_iter().flatten().min()
    }

    /// Whether it says `wait` from time to time, as Repetier does when idle.
    fn is_idle(&self) -> bool {
        self.config.habits.wait_s > 0.0 && self.queue.is_empty() && self.uart.rx_is_empty()
    }

    /// Everything that happens at `now_ns`.
    fn step(&mut self) {
        while let Some(fault) = self.faults.event_at_time(self.now_ns) {
            self.happen(fault);
        }
        self.power_events();
        while self.planner.next_end_ns().is_some_and(|at| at <= self.now_ns) {
            self.end_move();
        }
        while self.uart.next_arrival_ns().is_some_and(|at| at <= self.now_ns) {
            self.arrive();
        }
        if self.can_run() {
            self.timers();
            self.main_loop();
        }
    }

    fn can_run(&self) -> bool {
        self.power == Power::Running
            && self.now_ns >= self.hung_until_ns
            && self.now_ns >= self.uart.tx_free_ns()
    }

    /// Reads lines while the queue has room, then executes one command; over
    /// again until neither goes on.
    fn main_loop(&mut self) {
        while self.can_run() {
            let mut progress = self.read_lines();
            if self.wait.is_some() {
                progress |= self.go_on();
            } else if self.runout && self.can_run() {
                self.begin_runout();
                progress = true;
            } else if self.can_run() && !self.queue.is_empty() {
                self.execute();
                progress = true;
            }
            if !progress {
                return;
            }
        }
    }

    /// Takes the executed command from the queue.
    pub(crate) fn pop(&mut self) {
        if let Some(head) = self.queue.pop_front() {
            self.note_executed(head.number);
        }
        self.last_command_ns = self.now_ns;
        self.wait_next_ns = self.now_ns + (self.config.habits.wait_s * 1e9) as u64;
    }

    /// The `ok` of the command at the head of the queue; `more` follows it.
    pub(crate) fn reply_ok(&mut self, more: &str) {
        let Some(head) = self.queue.front() else {
            return;
        };
        let number = head.number;
        if !self.config.habits.ok_when_queued {
            self.say_ok(number, more);
        } else if !more.is_empty() {
            self.say(format!("{}\n", more.trim_start()).as_bytes());
        }
    }

    fn say_ok(&mut self, number: Option<i64>, more: &str) {
        let mut ok = Vec::with_capacity(32);
        ok.extend(b"ok");
        match (self.config.habits.ok, number) {
            (OkForm::Number, Some(n)) => ok.extend(format!(" {n}").bytes()),
            _ if more.is_empty() && self.config.advanced_ok => {
                let free = (self.planner.free(), self.config.queue - self.queue.len());
                report::advanced_ok(&mut ok, number, free);
            }
            _ => {}
        }
        ok.extend(more.bytes());
        ok.push(b'\n');
        self.faults.reply(number, &mut ok);
        self.say(&ok);
    }

    fn say(&mut self, bytes: &[u8]) {
        if self.power == Power::Running && self.now_ns >= self.gone_until_ns {
            self.uart.send(self.now_ns, bytes);
        }
    }

    fn now_ns(&self) -> u64 {
        self.now_ns
    }

    /// The machine's own time, s.
    fn simulated_s(&self) -> f64 {
        self.now_ns as f64 / 1e9 * self.config.speed
    }

    /// How long something of the machine takes on the clock, ns.
    fn scaled_ns(&self, seconds: f64) -> u64 {
        (seconds.max(0.0) * 1e9 / self.config.speed) as u64
    }

    fn temperatures(&self) -> String {
        self.heaters.temperatures(self.simulated_s())
    }

    /// The nozzle in use, °C.
    fn nozzle_c(&self) -> f64 {
        self.heaters.nozzle().temperature_c(self.simulated_s())
    }

    /// The counts as of the last [`Self::advance`].
    pub fn stats(&self) -> Stats {
        let now_s = self.simulated_s();
        let seconds = |ns: u64| ns as f64 / 1e9;
        let (empty, moving) = (self.planner.empty_ns, self.planner.moving_ns);
        let running_on = self.planner.next_end_ns().map_or(0, |end| end.saturating_sub(self.now_ns));
        let moved = moving.saturating_sub(running_on);
        let now_and_target = |heater: &Heater| [heater.temperature_c(now_s), heater.target_c()];
        let (nozzle, bed, body) = (self.heaters.nozzle(), &self.heaters.bed, &self.body);
        let light = self.light.sums(self.now_ns);
        Stats {
            overflow_bytes: self.uart.overflow_bytes,
            unread_bytes: self.uart.unread_bytes,
            rx_bytes_most: self.uart.rx_bytes_most,
            moves: self.planner.moves,
            planner_empty_share: if empty + moved == 0 { 0.0 } else { empty as f64 / (empty + moved) as f64 },
            planner_empty_s: seconds(empty),
            moving_s: seconds(moved),
            planner_gaps: self.planner.gaps,
            planner_most: self.planner.planned_most,
            digest: self.digest.hex(),
            digest_lines: self.digest.lines(),
            all_digest: self.all_digest.hex(),
            all_digest_lines: self.all_digest.lines(),
            real_s: seconds(self.now_ns),
            simulated_s: now_s,
            heaters_on: self.heaters.all().any(|heater| heater.target_c() > 0.0),
            nozzles_c: self.heaters.nozzles.iter().map(now_and_target).collect(),
            chamber_c: self.heaters.chamber.as_ref().map(now_and_target),
            tool: self.heaters.tool,
            levelling_on: self.levelling_on,
            nozzle_c: nozzle.temperature_c(now_s),
            nozzle_target_c: nozzle.target_c(),
            bed_c: bed.temperature_c(now_s),
            bed_target_c: bed.target_c(),
            executed: self.executed_digest.lines(),
            executed_digest: self.executed_digest.hex(),
            deposits: body.deposits.lines(),
            deposit_digest: body.deposits.hex(),
            crashes: body.crashes,
            moved_cold: body.moved_cold,
            first_xy_after_reset_z_mm: body.first_xy_after_reset_z_mm,
            true_position_mm: body.at_mm,
            part_top_mm: body.part_top_mm(),
            fan: self.fan,
            light_on: light.on,
            light_pulses: light.pulses,
            light_pulses_not_kept: light.not_kept,
            light_s: light.total_s,
            light_longest_s: light.longest_s,
            light_moved: light.moved,
            pressed_in_mm: body.pressed_in_mm(),
            position_mm: [self.motion.at_mm[0], self.motion.at_mm[1], self.motion.at_mm[2]],
            ..self.counts.clone()
        }
    }
}

/// How far up the plate of a resin printer goes, which has Z alone, mm.
fn z_only_mm(machine: &Machine) -> Option<f64> {
    machine.resin.map(|resin| resin.z_max_mm)
}

/// Marlin's DEFAULT_KEEPALIVE_INTERVAL, where there is one; 0 for never.
fn busy_every_ns(config: &Config) -> u64 {
    if config.habits.busy_notes { (BUSY_S * 1e9) as u64 } else { 0 }
}
