//! The board: bytes and the time in, bytes and counts out.
//!
//! Marlin's main loop on a clock that is given from outside: bytes arrive at
//! the line's speed, are read into lines while the command queue has room,
//! are judged, queued and executed one after the other; moves run in the
//! planner meanwhile. Time is in nanoseconds since power-on; the mechanics
//! (moves, heat, dwelling) run [`Config::speed`] times faster than it, the
//! serial line and the reports do not. Does no I/O, owns no clock.
use super::emergency::{Emergency, EmergencyParser};
use super::faults::{Fault, Faults, Kind};
use super::heater::{self, Heater};
use super::line::{LineBuffer, Numbering, Verdict, number_of};
use super::motion::{Motion, Path};
use super::planner::{Dynamics, Planner};
use super::report;
use super::stats::{Digest, Stats};
use super::uart::Uart;
use super::words::Command;
use std::collections::VecDeque;

/// Marlin's BUFSIZE: commands in the queue, the one being executed included.
pub(crate) const BUFSIZE: usize = 4;

/// How long a start takes. Boot loaders take one to two seconds; a tenth is
/// enough to lose the bytes of a host that does not wait for `start`.
const BOOT_NS: u64 = 200_000_000;

/// Marlin's DEFAULT_KEEPALIVE_INTERVAL.
const BUSY_S: f64 = 2.0;

/// Between the lines of a wait for heat.
pub(crate) const HEAT_REPORT_NS: u64 = 1_000_000_000;

/// What a mock is like.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Bits per second; 0 is a line without a speed limit.
    pub baud: u32,
    /// RX_BUFFER_SIZE, bytes (Marlin's own choice is 128).
    pub rx_bytes: usize,
    /// How many times faster than life moves, heaters and pauses are.
    pub speed: f64,
    /// ADVANCED_OK: `ok N1 P15 B3`.
    pub advanced_ok: bool,
    /// EMERGENCY_PARSER: M108, M112, M410 and M876 are seen on arrival.
    pub emergency_parser: bool,
    /// Whether opening the port resets the board.
    pub dtr_reset: bool,
    /// The machine around the board.
    pub machine: Machine,
}

/// The machine around the board.
#[derive(Clone, Debug, PartialEq)]
pub struct Machine {
    /// MACHINE_TYPE of M115.
    pub name: String,
    /// Speeds and accelerations at power-on.
    pub dynamics: Dynamics,
    /// Highest target of the nozzle, °C: more is cut to it.
    pub nozzle_max_c: f64,
    /// Highest target of the bed, °C.
    pub bed_max_c: f64,
}

#[derive(Debug)]
pub(crate) struct Queued {
    pub(crate) line: Vec<u8>,
    pub(crate) number: Option<i64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Power {
    /// Starting until then; what comes meanwhile is lost.
    Booting(u64),
    Running,
    /// After `kill()`: only a reset helps.
    Halted,
}

/// What the command at the head of the queue waits for.
#[derive(Debug)]
pub(crate) enum Wait {
    /// Room in the planner for the rest of its path.
    Room(Path),
    /// The end of all moves, and then something.
    Drain(After),
    /// A time.
    Until(u64),
    /// A temperature.
    Heat(Heat),
    /// The user (M108 or M876), or a time if it is given.
    User(Option<u64>),
}

/// A wait for a temperature.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Heat {
    /// When the temperature is in its window.
    pub(crate) reached_ns: u64,
    /// When it has been there long enough.
    pub(crate) done_ns: u64,
    pub(crate) report_ns: u64,
}

/// What comes after the last move.
#[derive(Clone, Copy, Debug)]
pub(crate) enum After {
    Nothing,
    Dwell { lasts_ns: u64 },
    Home([bool; 3]),
    AskUser { at_most_ns: Option<u64> },
}

/// The board.
#[derive(Debug)]
pub struct Firmware {
    pub(crate) config: Config,
    faults: Faults,
    pub(crate) uart: Uart,
    emergency: EmergencyParser,
    line: LineBuffer,
    pub(crate) numbering: Numbering,
    pub(crate) queue: VecDeque<Queued>,
    wait: Option<(Wait, u64)>,
    pub(crate) planner: Planner,
    pub(crate) motion: Motion,
    pub(crate) nozzle: Heater,
    pub(crate) bed: Heater,
    pub(crate) fan: u8,
    pub(crate) cold_extrusion_allowed: bool,
    now_ns: u64,
    power: Power,
    boot_cause: &'static str,
    hung_until_ns: u64,
    /// M155: interval and next time.
    pub(crate) auto_report: Option<(u64, u64)>,
    /// M113: interval, 0 for never.
    pub(crate) busy_every_ns: u64,
    busy_next_ns: u64,
    /// M85: interval.
    pub(crate) inactive_max_ns: Option<u64>,
    last_command_ns: u64,
    /// The next resend request lacks its `ok`.
    resend_without_ok: bool,
    hang_up_ns: Option<u64>,
    /// Highest number in this numbering.
    highest: i64,
    digest: Digest,
    pub(crate) counts: Stats,
}

impl Firmware {
    /// A board at time 0: one that opening the port resets is just switched
    /// on and hears nothing yet; another has been on for
    /// long, so that a host that opens the port hears no `start`.
    pub fn new(config: Config, faults: Faults) -> Self {
        let mut board = Self {
            uart: Uart::new(config.baud, config.rx_bytes),
            planner: Planner::new(config.machine.dynamics, config.speed),
            faults,
            emergency: EmergencyParser::default(),
            line: LineBuffer::default(),
            numbering: Numbering::default(),
            queue: VecDeque::with_capacity(BUFSIZE),
            wait: None,
            motion: Motion::default(),
            nozzle: Heater::new(heater::NOZZLE),
            bed: Heater::new(heater::BED),
            fan: 0,
            cold_extrusion_allowed: false,
            now_ns: 0,
            power: Power::Running,
            boot_cause: "",
            hung_until_ns: 0,
            auto_report: None,
            busy_every_ns: (BUSY_S * 1e9) as u64,
            busy_next_ns: 0,
            inactive_max_ns: None,
            last_command_ns: 0,
            resend_without_ok: false,
            hang_up_ns: None,
            highest: 0,
            digest: Digest::default(),
            counts: Stats {
                boots: 1,
                ..Stats::default()
            },
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
        self.uart.room()
    }

    /// The host wrote these bytes now, no more than [`Self::room`].
    pub fn receive(&mut self, now_ns: u64, bytes: &[u8]) {
        self.advance(now_ns);
        self.uart.write(self.now_ns, bytes);
        self.advance(now_ns);
    }

    /// The host opened the port (raised DTR).
    pub fn connect(&mut self, now_ns: u64) {
        self.advance(now_ns);
        self.counts.connects += 1;
        if self.config.dtr_reset {
            self.boot(" External Reset");
        }
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
        while let Some(at_ns) = self.next_event_ns().filter(|at| *at <= now_ns) {
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

    fn next_event_ns(&self) -> Option<u64> {
        [
            self.uart.next_arrival_ns(),
            self.planner.next_end_ns(),
            self.own_event_ns(),
        ]
        .into_iter()
        .flatten()
        .min()
    }

    /// Events of the board itself: not bytes, not moves.
    fn own_event_ns(&self) -> Option<u64> {
        let fault = self.faults.next_event_s().map(|s| (s * 1e9) as u64);
        let own = match self.power {
            Power::Booting(until_ns) => Some(until_ns),
            Power::Halted => None,
            Power::Running => {
                let waits = self.wait.as_ref().and_then(|(wait, _)| match wait {
                    Wait::Until(at) => Some(*at),
                    Wait::Heat(heat) => Some(heat.done_ns.min(heat.report_ns)),
                    Wait::User(at) => *at,
                    Wait::Room(_) | Wait::Drain(_) => None,
                });
                let busy =
                    (self.wait.is_some() && self.busy_every_ns > 0).then_some(self.busy_next_ns);
                // Work that waits for the transmitter.
                let work = !self.uart.rx_is_empty() && self.queue.len() < BUFSIZE
                    || !self.queue.is_empty() && self.wait.is_none();
                let ready = work.then(|| self.uart.tx_free_ns().max(self.now_ns));
                let inactive = self.inactive_at_ns();
                let report = self.auto_report.map(|(_, next)| next);
                [waits, busy, ready, inactive, report]
                    .into_iter()
                    .flatten()
                    .min()
                    .map(|at| at.max(self.hung_until_ns).max(self.uart.tx_free_ns()))
            }
        };
        [own, fault].into_iter().flatten().min()
    }

    /// Everything that happens at `now_ns`.
    fn step(&mut self) {
        while let Some(fault) = self.faults.event_at_time(self.now_ns as f64 / 1e9) {
            self.happen(fault);
        }
        if let Power::Booting(until_ns) = self.power
            && until_ns <= self.now_ns
        {
            self.power = Power::Running;
            self.last_command_ns = self.now_ns;
            let text = report::boot(self.boot_cause);
            self.say(text.as_bytes());
        }
        while self
            .planner
            .next_end_ns()
            .is_some_and(|at| at <= self.now_ns)
        {
            self.planner.end_move(self.now_ns);
        }
        while self
            .uart
            .next_arrival_ns()
            .is_some_and(|at| at <= self.now_ns)
        {
            self.arrive();
        }
        if self.can_run() {
            self.timers();
            self.main_loop();
        }
    }

    /// One byte comes in, as in the receive interrupt.
    fn arrive(&mut self) {
        let Some(byte) = self.uart.arrive() else {
            return;
        };
        if self.power != Power::Running {
            self.counts.deaf_bytes += 1;
            return;
        }
        if self.config.emergency_parser
            && let Some(found) = self.emergency.take(byte)
        {
            self.emergency(found);
        }
        if self.uart.rx_is_full() {
            // On a line without a speed limit the board gets its chance
            // between two bytes, or no window would ever be small enough.
            self.main_loop();
        }
        self.uart.keep(byte);
    }

    fn can_run(&self) -> bool {
        self.power == Power::Running
            && self.now_ns >= self.hung_until_ns
            && self.now_ns >= self.uart.tx_free_ns()
    }

    fn timers(&mut self) {
        if let Some((every_ns, next_ns)) = self.auto_report
            && next_ns <= self.now_ns
        {
            self.auto_report = Some((every_ns, self.now_ns + every_ns));
            let text = format!(" {}\n", self.temperatures());
            self.say(text.as_bytes());
        }
        if self.inactive_at_ns().is_some_and(|at| at <= self.now_ns) {
            self.kill("!! KILLED caused by too much inactive time");
            return;
        }
        let Some((wait, _)) = &mut self.wait else {
            return;
        };
        let paused = matches!(wait, Wait::User(_));
        if let Wait::Heat(heat) = wait
            && heat.report_ns <= self.now_ns
            && heat.done_ns > self.now_ns
        {
            heat.report_ns = self.now_ns + HEAT_REPORT_NS;
            let left_ns = (heat.reached_ns <= self.now_ns).then(|| heat.done_ns - self.now_ns);
            // The wait lasts `speed` times longer for the machine.
            let left_s = left_ns.map(|ns| (ns as f64 * self.config.speed / 1e9) as u64);
            let text = report::heating(&self.temperatures(), left_s);
            self.say(text.as_bytes());
        }
        if self.busy_every_ns > 0 && self.busy_next_ns <= self.now_ns {
            self.busy_next_ns = self.now_ns + self.busy_every_ns;
            self.say(report::busy(paused));
        }
    }

    /// When M85 gives up; a command that waits counts as activity.
    fn inactive_at_ns(&self) -> Option<u64> {
        let idle = self.wait.is_none() && self.planner.is_empty();
        self.inactive_max_ns
            .filter(|_| idle)
            .map(|max| self.last_command_ns.saturating_add(max))
    }

    /// Reads lines while the queue has room, then executes one command; over
    /// again until neither goes on.
    fn main_loop(&mut self) {
        while self.can_run() {
            let mut progress = self.read_lines();
            if self.wait.is_some() {
                progress |= self.go_on();
            } else if self.can_run() && !self.queue.is_empty() {
                self.execute();
                progress = true;
            }
            if !progress {
                return;
            }
        }
    }

    fn read_lines(&mut self) -> bool {
        let mut any = false;
        while self.queue.len() < BUFSIZE && self.power == Power::Running {
            let Some(byte) = self.uart.read() else {
                break;
            };
            any = true;
            if self.line.take(byte) {
                let line = self.line.finish();
                if !self.take_line(line) {
                    break;
                }
            }
        }
        any
    }

    /// Judges a line and queues it; false when it was refused.
    fn take_line(&mut self, mut line: Vec<u8>) -> bool {
        self.counts.lines_received += 1;
        let number = number_of(&line);
        self.faults.arm(
            self.now_ns as f64 / 1e9,
            number.unwrap_or(self.numbering.last + 1),
        );
        self.resend_without_ok = self.faults.damage(number, &mut line);
        let before = self.numbering.last;
        let number = match self.numbering.judge(&line) {
            Verdict::Accept(number) => number,
            Verdict::Repeat => {
                self.counts.repeats_dropped += 1;
                return true;
            }
            Verdict::WrongNumber(_) => {
                self.counts.lines_out_of_order += 1;
                self.refuse("Line Number is not Last Line Number+1, Last Line: ");
                return false;
            }
            Verdict::WrongChecksum => {
                self.counts.checksum_errors += 1;
                self.refuse("checksum mismatch, Last Line: ");
                return false;
            }
            Verdict::NoChecksum => {
                self.counts.checksums_missing += 1;
                self.refuse("No Checksum with line number, Last Line: ");
                return false;
            }
        };
        self.counts.lines_accepted += 1;
        match number {
            None => self.counts.lines_unnumbered += 1,
            Some(n) => self.count_number(before, n, &line),
        }
        if !self.config.emergency_parser {
            self.early(&line);
        }
        if self.power == Power::Running {
            self.queue.push_back(Queued { line, number });
            self.counts.queue_most = self.counts.queue_most.max(self.queue.len());
        }
        true
    }

    fn count_number(&mut self, before: i64, n: i64, line: &[u8]) {
        let command = Command::parse(line);
        if (command.letter, command.code) == (b'M', 110) {
            self.renumber(before, n);
            return;
        }
        if n <= self.highest {
            self.counts.lines_repeated += 1;
        }
        self.highest = self.highest.max(n);
        self.digest.add(command.whole);
    }

    /// M110 moved the numbering: ahead loses lines, to 0 begins a new job.
    pub(crate) fn renumber(&mut self, before: i64, n: i64) {
        if n <= 0 {
            self.highest = n;
            self.digest = Digest::default();
        } else if n > before {
            self.counts.lines_lost += n.abs_diff(before);
            self.highest = self.highest.max(n);
        }
    }

    /// Without an emergency parser Marlin looks at unnumbered lines early.
    fn early(&mut self, line: &[u8]) {
        if line.first() != Some(&b'M') {
            return;
        }
        match (line.get(1), line.get(2), line.get(3)) {
            (Some(b'1'), Some(b'0'), Some(b'8')) => self.emergency(Emergency::GoOn),
            (Some(b'1'), Some(b'1'), Some(b'2')) => self.emergency(Emergency::Kill),
            (Some(b'4'), Some(b'1'), Some(b'0')) => self.emergency(Emergency::QuickStop),
            _ => {}
        }
    }

    pub(crate) fn emergency(&mut self, what: Emergency) {
        match what {
            Emergency::Kill => self.kill(""),
            Emergency::QuickStop => {
                self.planner.stop(self.now_ns);
                if matches!(self.wait, Some((Wait::Room(_), _))) {
                    self.finish();
                }
            }
            Emergency::GoOn | Emergency::Answer => {
                if matches!(self.wait, Some((Wait::Heat(_) | Wait::User(_), _))) {
                    self.finish();
                }
            }
        }
    }

    /// A line error: the receive buffer goes, a resend is asked for.
    fn refuse(&mut self, why: &str) {
        let last = self.numbering.last;
        self.line.clear();
        let ok = !std::mem::take(&mut self.resend_without_ok);
        let text = format!("Error:{why}{last}\n");
        self.say(text.as_bytes());
        self.ask_resend(ok);
    }

    /// Marlin's `flush_and_request_resend`.
    pub(crate) fn ask_resend(&mut self, ok: bool) {
        self.uart.flush_rx();
        self.counts.resends_asked += 1;
        let next = self.numbering.last.saturating_add(1);
        let text = format!("Resend: {next}\n{}", if ok { "ok\n" } else { "" });
        self.say(text.as_bytes());
    }

    /// The command at the head of the queue waits now.
    pub(crate) fn begin_wait(&mut self, wait: Wait) {
        self.busy_next_ns = self.now_ns + self.busy_every_ns;
        self.wait = Some((wait, self.now_ns));
        self.go_on();
    }

    /// Goes on with what waits; true when it got anywhere.
    fn go_on(&mut self) -> bool {
        let now_ns = self.now_ns;
        let Some((wait, _)) = &mut self.wait else {
            return false;
        };
        let done = match wait {
            Wait::Room(path) => loop {
                if self.planner.free() == 0 {
                    break false;
                }
                match path.next() {
                    Some(by_mm) => {
                        self.counts.extruded_mm += by_mm[3];
                        self.planner.push(now_ns, by_mm, path.feed_mm_s);
                    }
                    None => break true,
                }
            },
            Wait::Drain(after) if self.planner.is_empty() => {
                let after = *after;
                return self.drained(after);
            }
            Wait::Drain(_) => false,
            Wait::Until(at_ns) => *at_ns <= now_ns,
            Wait::Heat(heat) => heat.done_ns <= now_ns,
            Wait::User(at_ns) => at_ns.is_some_and(|at| at <= now_ns),
        };
        if done {
            self.finish();
        }
        done
    }

    /// All moves have ended: the second part of G4, G28, M0 and M400.
    fn drained(&mut self, after: After) -> bool {
        let next = match after {
            After::Nothing => {
                self.finish();
                return true;
            }
            After::Dwell { lasts_ns } => Wait::Until(self.now_ns.saturating_add(lasts_ns)),
            After::Home(axes) => {
                let lasts_ns = self.scaled_ns(self.homing_s(axes));
                self.motion.home(axes);
                Wait::Until(self.now_ns.saturating_add(lasts_ns))
            }
            After::AskUser { at_most_ns } => {
                self.say(report::PROMPT);
                Wait::User(at_most_ns.map(|ns| self.now_ns.saturating_add(ns)))
            }
        };
        self.wait = Some((next, self.now_ns));
        true
    }

    /// The command at the head of the queue is done: its `ok` goes out.
    fn finish(&mut self) {
        if let Some((wait, since_ns)) = self.wait.take()
            && !matches!(wait, Wait::Room(_) | Wait::Drain(_))
        {
            self.planner.excuse(since_ns, self.now_ns);
        }
        self.reply_ok("");
        self.pop();
    }

    /// Takes the executed command from the queue.
    pub(crate) fn pop(&mut self) {
        self.queue.pop_front();
        self.last_command_ns = self.now_ns;
    }

    /// The `ok` of the command at the head of the queue; `more` follows it.
    pub(crate) fn reply_ok(&mut self, more: &str) {
        let Some(head) = self.queue.front() else {
            return;
        };
        let number = head.number;
        let mut ok = b"ok".to_vec();
        if more.is_empty() && self.config.advanced_ok {
            let free = (self.planner.free(), BUFSIZE - self.queue.len());
            report::advanced_ok(&mut ok, &head.line, free);
        }
        ok.extend(more.bytes());
        ok.push(b'\n');
        self.faults.reply(number, &mut ok);
        self.say(&ok);
    }

    /// Scripted events when a line is executed; false when there is nothing
    /// left to execute it.
    pub(crate) fn faults_of_line(&mut self, number: Option<i64>) -> bool {
        while let Some(fault) = self.faults.event_at_line(number) {
            self.happen(fault);
            if self.power != Power::Running {
                return false;
            }
        }
        self.now_ns >= self.hung_until_ns
    }

    fn happen(&mut self, fault: Fault) {
        let text = fault.text.unwrap_or_default();
        let for_ns = (fault.for_s.unwrap_or(0.0) * 1e9) as u64;
        match fault.kind {
            Kind::Say => self.say(format!("{text}\n").as_bytes()),
            Kind::Kill => self.kill(&text),
            Kind::Reset => self.boot(" Brown out Reset"),
            Kind::Hang => self.hung_until_ns = self.now_ns.saturating_add(for_ns),
            Kind::HangUp => self.hang_up_ns = Some(for_ns),
            // These wait for a line: `damage` and `reply` look for them.
            Kind::CorruptLine
            | Kind::ResendWithoutOk
            | Kind::DropOk
            | Kind::GarbleReply
            | Kind::Noise => {}
        }
    }

    /// Marlin's `kill()`: says why, switches everything off, and stays so.
    pub(crate) fn kill(&mut self, why: &str) {
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

    fn boot(&mut self, cause: &'static str) {
        self.all_off();
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

    fn all_off(&mut self) {
        self.planner.stop(self.now_ns);
        self.queue.clear();
        self.wait = None;
        self.line.finish();
        let now_s = self.simulated_s();
        self.nozzle.set(0.0, now_s);
        self.bed.set(0.0, now_s);
        self.fan = 0;
    }

    pub(crate) fn say(&mut self, bytes: &[u8]) {
        if self.power == Power::Running {
            self.uart.send(self.now_ns, bytes);
        }
    }

    pub(crate) fn now_ns(&self) -> u64 {
        self.now_ns
    }

    /// The machine's own time, s.
    pub(crate) fn simulated_s(&self) -> f64 {
        self.now_ns as f64 / 1e9 * self.config.speed
    }

    /// How long something of the machine takes on the clock, ns.
    pub(crate) fn scaled_ns(&self, seconds: f64) -> u64 {
        (seconds.max(0.0) * 1e9 / self.config.speed) as u64
    }

    pub(crate) fn temperatures(&self) -> String {
        report::temperatures(&self.nozzle, &self.bed, self.simulated_s())
    }

    /// The counts as of the last [`Self::advance`].
    pub fn stats(&self) -> Stats {
        let now_s = self.simulated_s();
        let seconds = |ns: u64| ns as f64 / 1e9;
        let (empty, moving) = (self.planner.empty_ns, self.planner.moving_ns);
        let running_on = self
            .planner
            .next_end_ns()
            .map_or(0, |end| end.saturating_sub(self.now_ns));
        let moved = moving.saturating_sub(running_on);
        Stats {
            overflow_bytes: self.uart.overflow_bytes,
            unread_bytes: self.uart.unread_bytes,
            rx_bytes_most: self.uart.rx_bytes_most,
            moves: self.planner.moves,
            planner_empty_share: if empty + moved == 0 {
                0.0
            } else {
                empty as f64 / (empty + moved) as f64
            },
            planner_empty_s: seconds(empty),
            moving_s: seconds(moved),
            planner_gaps: self.planner.gaps,
            planner_most: self.planner.planned_most,
            digest: self.digest.hex(),
            digest_lines: self.digest.lines(),
            real_s: seconds(self.now_ns),
            simulated_s: now_s,
            nozzle_c: self.nozzle.temperature_c(now_s),
            nozzle_target_c: self.nozzle.target_c(),
            bed_c: self.bed.temperature_c(now_s),
            bed_target_c: self.bed.target_c(),
            fan: self.fan,
            position_mm: [
                self.motion.at_mm[0],
                self.motion.at_mm[1],
                self.motion.at_mm[2],
            ],
            ..self.counts.clone()
        }
    }
}
