//! From the wire to the queue: receiving, judging, refusing, renumbering.
//!
//! Takes the bytes that have arrived, gives queued commands and the words of a
//! refusal. Knows not what a command does.
use super::super::config::Repeats;
use super::super::emergency::Emergency;
use super::super::faults::Damage;
use super::super::line::{Verdict, number_of};
use super::super::report;
use super::super::stats::Digest;
use super::super::words::Command;
use super::wait::Wait;
use super::{Firmware, Power, Queued};

impl Firmware {
    /// One byte comes in, as in the receive interrupt.
    pub(super) fn arrive(&mut self) {
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

    /// Takes a run of bytes within a line from the wire straight to the line, where the
    /// receive buffer would only hand them on: the same, many at a time.
    pub(super) fn take_run_of_bytes(&mut self, until_ns: u64) {
        let free = self.power == Power::Running
            && self.uart.rx_is_empty()
            && self.queue.len() < self.config.queue
            && self
                .uart
                .next_arrival_ns()
                .is_some_and(|at| at <= until_ns && at >= self.hung_until_ns && at >= self.uart.tx_free_ns());
        if !free {
            return;
        }
        let mut run = std::mem::take(&mut self.run_of_bytes);
        run.clear();
        if let Some(last_ns) = self.uart.take_run(until_ns, &mut run) {
            self.now_ns = self.now_ns.max(last_ns);
            if self.config.emergency_parser {
                self.emergency.take_run(&run);
            }
            self.line.take_run(&run);
            self.uart.rx_bytes_most = self.uart.rx_bytes_most.max(1);
        }
        self.run_of_bytes = run;
    }

    pub(super) fn read_lines(&mut self) -> bool {
        let mut any = false;
        while self.queue.len() < self.config.queue && self.power == Power::Running {
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
    pub(super) fn take_line(&mut self, mut line: Vec<u8>) -> bool {
        let number = number_of(&line);
        let next = number.unwrap_or(self.numbering.last.saturating_add(1));
        self.faults.arm(self.now_ns, next);
        match self.faults.damage(number, &mut line) {
            Damage::None => self.resend_without_ok = false,
            Damage::ResendWithoutOk => self.resend_without_ok = true,
            Damage::Lost => return true,
        }
        self.counts.lines_received += 1;
        let before = self.numbering.last;
        let verdict = if self.config.habits.checks_lines {
            self.numbering.judge(&line)
        } else {
            Verdict::Accept(number_of(&line))
        };
        let number = match verdict {
            Verdict::Accept(number) => number,
            Verdict::Repeat if self.config.habits.repeats == Repeats::Dropped => {
                self.counts.repeats_dropped += 1;
                return true;
            }
            Verdict::Repeat if self.config.habits.repeats == Repeats::Skipped => {
                self.counts.repeats_dropped += 1;
                self.say(format!("skip {}\nok\n", number.unwrap_or(0)).as_bytes());
                return true;
            }
            refused => {
                self.count_refusal(&refused);
                self.refuse(&refused);
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
            if self.config.habits.ok_when_queued {
                self.say_ok(number, "");
            }
        }
        true
    }

    fn count_refusal(&mut self, why: &Verdict) {
        match why {
            Verdict::WrongChecksum => self.counts.checksum_errors += 1,
            Verdict::NoChecksum => self.counts.checksums_missing += 1,
            _ => self.counts.lines_out_of_order += 1,
        }
    }

    pub(super) fn count_number(&mut self, before: i64, n: i64, line: &[u8]) {
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
        self.all_digest.add(command.whole);
        if self.counts.first_job_line_s == 0.0 && self.digest.lines() > 0 {
            self.counts.first_job_line_s = self.now_ns as f64 / 1e9;
        }
    }

    /// M110 moved the numbering: ahead loses lines, to 0 begins a new job.
    pub(super) fn renumber(&mut self, before: i64, n: i64) {
        if n <= 0 {
            self.highest = n;
            self.digest = Digest::default();
        } else if n > before {
            self.counts.lines_lost = self.counts.lines_lost.saturating_add(n.abs_diff(before));
            self.highest = self.highest.max(n);
        }
    }

    /// Without an emergency parser Marlin looks at unnumbered lines early.
    pub(super) fn early(&mut self, line: &[u8]) {
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

    pub(super) fn emergency(&mut self, what: Emergency) {
        match what {
            Emergency::Kill => self.kill(""),
            Emergency::QuickStop => self.quick_stop(),
            Emergency::GoOn | Emergency::Answer => {
                if matches!(self.wait, Some((Wait::Heat(_) | Wait::User { .. }, _))) {
                    self.finish();
                }
            }
        }
    }

    /// M410: the moves end here, and what is left of the command that makes some.
    pub(super) fn quick_stop(&mut self) {
        self.stop_moves();
        if let Some((Wait::Room(path), _)) = &self.wait {
            self.motion.stopped_short(path.rest());
            self.finish();
        }
    }

    /// A line error: the receive buffer goes, a resend is asked for. What is
    /// still on the wire comes afterwards, and if the buffer ended in the
    /// middle of a line, the rest of that line comes as a line of its own: so
    /// it is on a real board.
    pub(super) fn refuse(&mut self, why: &Verdict) {
        self.line.clear();
        let ok = !std::mem::take(&mut self.resend_without_ok);
        let text = report::refusal(self.config.habits.repeats, why, self.numbering.last);
        self.say(text.as_bytes());
        self.ask_resend(ok);
    }

    /// Marlin's `flush_and_request_resend`.
    pub(super) fn ask_resend(&mut self, ok: bool) {
        self.uart.flush_rx();
        self.counts.resends_asked += 1;
        let next = self.numbering.last.saturating_add(1);
        let mut text = report::resend(self.config.habits.resend, next);
        if ok && self.config.habits.resend_ok {
            text.push_str("ok\n");
        }
        self.say(text.as_bytes());
    }
}
