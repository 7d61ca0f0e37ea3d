//! What the user sees of a running job: a bar on a terminal, plain lines elsewhere.
//!
//! Takes the session's events and the lines that are acknowledged. All goes to
//! standard error but the summary. Failing output is ignored: a terminal that is
//! gone must not end a print.
use super::Person;
use crate::job::host::{HostEvent, Request};
use crate::job::record::Checkpoint;
use crate::job::recover::{Case, Plan};
use crate::job::run::{Mail, Watcher};
use crate::printer::job_file::Checked;
use crate::printer::session::Event;
use crate::printer::temperature::{Reading, Temperatures};
use crate::station::escape::printable;
use crate::station::marks::{Facts, Marks};
use crate::station::{cases, news, pace};
use indicatif::{ProgressBar, ProgressStyle};
use std::cell::RefCell;
use std::io::{IsTerminal, Write};
use std::rc::Rc;
use std::time::{Duration, Instant};
use tokio::sync::mpsc;

/// The bar is drawn so often; faster cannot be read.
const BAR_INTERVAL: Duration = Duration::from_millis(200);

/// Without a terminal, a line so often: a log of a ten-hour print stays readable.
const PLAIN_INTERVAL: Duration = Duration::from_secs(10);

/// Unknown commands that are named; more would say no more.
const MAX_UNKNOWN: usize = 20;

/// The display.
pub(super) struct Show {
    bar: Option<ProgressBar>,
    verbose: bool,
    checked: Checked,
    facts: Facts,
    marks: Rc<RefCell<Marks>>,
    speed: f64,
    temperatures: Option<Temperatures>,
    connected: bool,
    line: u64,
    started: Instant,
    first_line: Option<Instant>,
    shown: Instant,
    resends: u64,
    probes: u64,
    person: Person,
    post: Option<mpsc::Sender<Mail>>,
    /// First words of the commands that the printer did not know.
    unknown: Vec<String>,
}

impl Show {
    /// `speed`: how many times faster than the slicer's estimate the printer is.
    pub(super) fn new(
        verbose: bool,
        checked: Checked,
        facts: Facts,
        marks: Rc<RefCell<Marks>>,
        speed: f64,
    ) -> Self {
        let bar = std::io::stderr().is_terminal().then(|| {
            let bar = ProgressBar::new(checked.last_command);
            let style = ProgressStyle::with_template("{wide_bar} {percent:>3} %  {msg}");
            bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar
        });
        let now = Instant::now();
        let show = Self {
            bar,
            verbose,
            checked,
            facts,
            marks,
            speed,
            temperatures: None,
            connected: false,
            line: 0,
            started: now,
            first_line: None,
            shown: now,
            resends: 0,
            probes: 0,
            person: Person::Away,
            post: None,
            unknown: Vec::new(),
        };
        if checked.shortened > 0 {
            let n = checked.shortened;
            show.say(&format!("{n} messages (M117, M118) are too long and will be shortened"));
        }
        show
    }

    /// Who answers when the way back into a job is planned, and where the word goes.
    pub(super) fn answer_plans(&mut self, person: Person, post: mpsc::Sender<Mail>) {
        self.person = person;
        self.post = Some(post);
    }

    /// What the user may do, told where a person reads along.
    pub(super) fn hint(&self, words: &str) {
        self.say(words);
    }

    /// The bar goes; what was said stays.
    pub(super) fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }

    /// One line on standard output: what was printed and how it went.
    pub(super) fn summary(&self, name: &str) {
        let took_s = self.started.elapsed().as_secs_f64();
        let took = match took_s < 60.0 {
            true => format!("{took_s:.1} s"),
            false => duration(took_s),
        };
        let (commands, resends) = (self.checked.commands, self.resends);
        let line = format!("{name}: printed, {commands} commands in {took}, {resends} resends");
        let _ = writeln!(std::io::stdout(), "{line}");
    }

    fn say(&self, line: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| {
                let _ = writeln!(std::io::stderr(), "{line}");
            }),
            None => {
                let _ = writeln!(std::io::stderr(), "{line}");
            }
        }
    }

    /// What goes beside the bar: layer, temperatures, time left.
    fn status(&self) -> String {
        let marks = self.marks.borrow();
        let mut parts = Vec::with_capacity(4);
        match (self.facts.layers, marks.layer) {
            (0, 0) => {}
            (0, layer) => parts.push(format!("layer {layer}")),
            (layers, layer) => parts.push(format!("layer {layer}/{layers}")),
        }
        if let Some(t) = &self.temperatures {
            parts.extend(reading("nozzle", t.hotend()));
            parts.extend(reading("bed", t.bed));
            parts.extend(reading("chamber", t.chamber));
        }
        if let Some(left_s) = self.left_s(&marks) {
            parts.push(format!("{} left", duration(left_s)));
        }
        parts.join("  ")
    }

    /// A file for another firmware may hold thousands of one command: it is named
    /// once.
    fn unknown(&mut self, text: &str) {
        let word = text.split_whitespace().next().unwrap_or_default();
        let known = self.unknown.iter().any(|w| w == word);
        if self.verbose || (!known && self.unknown.len() < MAX_UNKNOWN) {
            self.say(&format!("printer: unknown command {}", printable(text)));
        }
        if !known && self.unknown.len() < MAX_UNKNOWN {
            self.unknown.push(word.to_owned());
        }
    }

    fn fraction(&self) -> f64 {
        pace::fraction(self.line, &self.checked)
    }

    fn left_s(&self, marks: &Marks) -> Option<f64> {
        let elapsed_s = self.first_line?.elapsed().as_secs_f64();
        pace::left_s(elapsed_s, self.line, &self.checked, self.facts, marks, self.speed)
    }

    fn refresh(&mut self, interval: Duration) {
        if self.shown.elapsed() < interval {
            return;
        }
        self.shown = Instant::now();
        let status = self.status();
        match &self.bar {
            Some(bar) => {
                bar.set_message(status);
                bar.set_position(self.line);
            }
            None if self.connected => {
                self.say(&format!("{:.0} %  {status}", self.fraction() * 100.0));
            }
            None => {}
        }
    }

    fn interval(&self) -> Duration {
        match self.bar {
            Some(_) => BAR_INTERVAL,
            None => PLAIN_INTERVAL,
        }
    }
}

impl Watcher for Show {
    fn event(&mut self, event: &HostEvent) {
        match event {
            HostEvent::State(state) => {
                if let Some(words) = news::state(*state) {
                    self.say(words);
                }
            }
            HostEvent::Session(event) => self.session(event),
            HostEvent::Refused(why) => self.say(&format!("not done: {why}")),
            HostEvent::Told(words) => self.say(&printable(words)),
            HostEvent::Case(case) => {
                self.say(&cases::words(case));
                if matches!(case, Case::PrinterReset { .. }) && self.person == Person::Away {
                    self.say(
                        "nobody can be asked here whether part and nozzle, or plate, are clear: resume it on a \
                         terminal, or say so with --yes-part-and-nozzle-are-clear",
                    );
                }
            }
            HostEvent::Planned => {}
        }
    }

    fn planned(&mut self, plan: &Plan) {
        self.say(&cases::plan(plan));
        self.ask(plan.of_plate);
    }

    fn acknowledged(&mut self, at: &Checkpoint) {
        let job_line = at.line;
        if job_line == self.line {
            return;
        }
        self.line = job_line;
        self.first_line.get_or_insert_with(Instant::now);
        self.marks.borrow_mut().reach(job_line);
        self.refresh(self.interval());
    }
}

impl Show {
    /// Nothing moves before a person has said that nothing is in the way.
    fn ask(&mut self, of_plate: bool) {
        let (clear, so) = match of_plate {
            true => {
                ("part and plate", "does the part still hang on the plate, and is nothing in the way of both")
            }
            false => {
                ("part and nozzle", "is the part still in its place, and nothing in the way of the nozzle")
            }
        };
        match self.person {
            Person::Sure => {
                let sent = self.post.as_ref().map(|post| post.try_send(Mail::Ask(Request::Confirm)));
                if !matches!(sent, Some(Ok(()))) {
                    self.say(&format!("the word that {clear} are clear got lost: say it again"));
                }
            }
            Person::Asked | Person::Away => {
                self.say(&format!("{so}? Then press y (or write `confirm`); Ctrl-C leaves all as it is"))
            }
        }
    }

    fn connected(&mut self, firmware: Option<&str>) {
        self.connected = true;
        let name = firmware.unwrap_or("a printer that does not say its name");
        self.say(&format!("connected to {}", printable(name)));
    }

    fn session(&mut self, event: &Event) {
        match event {
            Event::Connected { firmware, .. } => self.connected(firmware.as_deref()),
            Event::Temperatures(t) => self.temperatures = Some(*t),
            Event::Busy(_) => {}
            Event::Resend { n } => {
                self.resends += 1;
                if self.verbose {
                    self.say(&format!("the printer asks for line N{n} again"));
                }
            }
            Event::Probed { timeouts } => {
                self.probes += 1;
                if self.verbose || *timeouts > 1 {
                    self.say(&format!("no answer from the printer (timeout {timeouts}); asking again"));
                }
            }
            Event::ManyResends { resends, lines } => self.say(&format!(
                "warning: {resends} resends in {lines} lines; check the cable, its shielding and \
                 the baud rate"
            )),
            Event::Action(action) => self.say(&news::action(action)),
            Event::UnknownCommand(text) => self.unknown(text),
            Event::PrinterError(text) => {
                // Refused lines are part of a resend.
                if self.verbose || !text.contains("Last Line:") {
                    self.say(&format!("printer: {}", printable(text)));
                }
            }
            Event::Note(text) => {
                if self.verbose {
                    self.say(&format!("printer: {}", printable(text)));
                }
            }
            Event::Skipped { job_line } => {
                self.say(&format!("line {job_line} of the file sets the line number (M110) and was left out"))
            }
            Event::Stopping(ending) => self.say(&news::stopping(ending)),
            Event::Prompt(prompt) => self.say(&news::prompt(prompt.as_ref())),
            Event::Waiting(waiting) => self.say(news::waiting(*waiting)),
            Event::EmergencyStopped { by } => self.say(news::stopped(*by)),
            Event::LinkLost { reason } => self.say(&printable(reason)),
            Event::Rejoined { firmware } => self.connected(firmware.as_deref()),
            Event::Arrived
            | Event::Position(_)
            | Event::Held
            | Event::OwnDone
            | Event::Found(_)
            | Event::Ended(_) => {}
        }
        self.refresh(self.interval());
    }
}

fn reading(name: &str, heater: Option<Reading>) -> Option<String> {
    let heater = heater?;
    Some(match heater.target_c {
        Some(target) if target > 0.0 => {
            format!("{name} {:.0}/{target:.0} °C", heater.actual_c)
        }
        _ => format!("{name} {:.0} °C", heater.actual_c),
    })
}

/// `1 h 02 min`, `2 min 03 s`, `4 s`.
fn duration(seconds: f64) -> String {
    // A float cast saturates: no estimate is too wild.
    let s = seconds.max(0.0) as u64;
    match (s / 3600, s / 60 % 60, s % 60) {
        (0, 0, s) => format!("{s} s"),
        (0, m, s) => format!("{m} min {s:02} s"),
        (h, m, _) => format!("{h} h {m:02} min"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations() {
        let check = |s, expect: &str| assert_eq!(duration(s), expect);
        check(4.9, "4 s");
        check(14.9, "14 s");
        check(123.0, "2 min 03 s");
        check(3720.0, "1 h 02 min");
        check(-5.0, "0 s");
        check(f64::INFINITY, "5124095576030431 h 00 min");
    }
}
