//! What went over the wire, as a third party sees it who trusts neither side.
//!
//! Takes the lines that the program wrote, the bytes that reached the printer and the lines that
//! it said; gives how far the job is, what a printer that checks numbers and checksums must have
//! taken, and how hot it says it is. Shares no code with the sender. For the mock its own deeds
//! are better; for others there is nothing else.
use crate::world::source::Commands;
use outrigger::printer::mock::Executed;
use outrigger::printer::reply::{Reply, parse};
use outrigger::printer::temperature::Reading;

/// Longest unfinished line that is kept: what is longer is no line of a printer.
const LINE_BYTES_MAX: usize = 4096;

/// The account of one scenario.
#[derive(Debug)]
pub struct Account {
    commands: Commands,
    /// Commands of the job that went out.
    pub sent: usize,
    last_ns: Option<u64>,
    /// Longest time between new commands of the job, ns.
    pub stall_ns: u64,
    /// The line that has not wholly reached the printer.
    line: Vec<u8>,
    /// What the printer must have taken, in order.
    took: Vec<Executed>,
    /// What it seemed to have taken and then wanted again: until it takes the next line, it may
    /// think better of it.
    aside: Vec<Executed>,
    /// The number that it wants next.
    wants: i64,
    /// When it said `start`, ns, since it first took a line.
    pub starts_ns: Vec<u64>,
    /// Measured at nozzle and bed, °C, since the last call of [`Account::heat`].
    heat: Option<(f64, f64)>,
}

impl Account {
    /// Nothing has gone over the wire yet.
    pub fn new(commands: Commands) -> Self {
        Self {
            commands,
            sent: 0,
            last_ns: None,
            stall_ns: 0,
            line: Vec::new(),
            took: Vec::new(),
            aside: Vec::new(),
            wants: 1,
            starts_ns: Vec::new(),
            heat: None,
        }
    }

    /// The program wrote a line: which new command of the job that is, from 1; 0 for none.
    pub fn wrote(&mut self, line: &[u8], now_ns: u64) -> usize {
        let command = Framed::of(line).map(|framed| framed.command);
        if command.is_none() || self.commands.get(self.sent) != command {
            return 0;
        }
        self.sent += 1;
        let since = self.last_ns.replace(now_ns).unwrap_or(now_ns);
        self.stall_ns = self.stall_ns.max(now_ns - since);
        self.sent
    }

    /// Bytes have reached the printer.
    pub fn reached(&mut self, bytes: &[u8], now_ns: u64) {
        for byte in bytes {
            if *byte != b'\n' {
                if self.line.len() < LINE_BYTES_MAX {
                    self.line.push(*byte);
                }
                continue;
            }
            let line = std::mem::take(&mut self.line);
            self.take(&line, now_ns);
        }
    }

    fn take(&mut self, line: &[u8], now_ns: u64) {
        let Some(framed) = Framed::of(line) else {
            let text = line.trim_ascii();
            if !text.is_empty() && !text.starts_with(b"N") {
                self.push(None, text, now_ns);
            }
            return;
        };
        // M110 sets the number, whatever it was.
        let sets = framed.command.starts_with(b"M110");
        if !framed.holds || (framed.number != self.wants && !sets) {
            return;
        }
        let set = || {
            let word = framed.command.split(|b| *b == b' ').find_map(|w| w.strip_prefix(b"N"))?;
            std::str::from_utf8(word).ok()?.parse::<i64>().ok()
        };
        self.wants = if sets { set().unwrap_or(framed.number) } else { framed.number } + 1;
        self.push(Some(framed.number), framed.command, now_ns);
    }

    fn push(&mut self, number: Option<i64>, command: &[u8], at_ns: u64) {
        if number.is_some() {
            self.aside.clear();
        }
        let command = String::from_utf8_lossy(command).into_owned();
        self.took.push(Executed { at_ns, number, command, at_mm: [0.0; 3], whole: true });
    }

    /// The printer said a line.
    pub fn said(&mut self, line: &[u8], now_ns: u64) {
        let temperatures = match parse(line) {
            Reply::Resend(n) => return self.refused(i64::from(n)),
            Reply::Start => {
                if self.took.iter().any(|t| t.number.is_some()) {
                    self.starts_ns.push(now_ns);
                }
                self.line.clear();
                self.wants = 1;
                return;
            }
            Reply::Ok(ack) => ack.temperatures,
            Reply::Temperatures(t) => Some(t),
            _ => None,
        };
        if let Some(t) = temperatures {
            let c = |reading: Option<Reading>| reading.map_or(0.0, |r| f64::from(r.actual_c));
            self.heat = Some((c(t.hotend()), c(t.bed)));
        }
    }

    /// It wants this number again: what seemed to be taken from there on was not. One that
    /// wants a later number right after that says that it has the earlier ones nevertheless.
    fn refused(&mut self, wants: i64) {
        let numbering = |t: &Executed| t.command.starts_with("M110");
        let since = self.took.iter().rposition(numbering).map_or(0, |at| at + 1);
        let mut tail = self.took.split_off(since);
        tail.append(&mut self.aside);
        for one in tail {
            match one.number.is_none_or(|n| n < wants) {
                true => self.took.push(one),
                false => self.aside.push(one),
            }
        }
        self.wants = wants;
    }

    /// Measured at nozzle and bed, °C, if it was said since the last call.
    pub fn heat(&mut self) -> Option<(f64, f64)> {
        self.heat.take()
    }

    /// All that the printer took.
    pub fn took(&self) -> &[Executed] {
        &self.took
    }
}

/// The targets of nozzle and bed after these commands, °C, as a printer that took them has them.
pub fn targets(took: &[Executed]) -> (f64, f64) {
    let mut targets = (0.0, 0.0);
    for command in took.iter().map(|t| t.command.as_str()) {
        let mut words = command.split_whitespace();
        let Some(name) = words.next() else { continue };
        let wanted = words.find_map(|w| w.strip_prefix(['S', 'R'])?.parse().ok());
        match (name, wanted) {
            ("M104" | "M109", Some(c)) => targets.0 = c,
            ("M140" | "M190", Some(c)) => targets.1 = c,
            ("M112", _) => targets = (0.0, 0.0),
            _ => {}
        }
    }
    targets
}

/// The number of a line on the wire.
pub fn number(line: &[u8]) -> Option<i64> {
    Framed::of(line).map(|framed| framed.number)
}

/// A line as it is framed for the wire: `N7 G1 X1*99`.
struct Framed<'a> {
    number: i64,
    command: &'a [u8],
    /// Whether the checksum is the line's.
    holds: bool,
}

impl<'a> Framed<'a> {
    fn of(line: &'a [u8]) -> Option<Self> {
        let line = line.trim_ascii();
        let star = line.iter().rposition(|b| *b == b'*')?;
        let (text, sum) = (&line[..star], std::str::from_utf8(&line[star + 1..]).ok()?);
        let rest = text.strip_prefix(b"N")?;
        let digits = rest.iter().take_while(|b| b.is_ascii_digit()).count();
        let number = std::str::from_utf8(&rest[..digits]).ok()?.parse().ok()?;
        let holds = sum.parse() == Ok(text.iter().fold(0_u8, |sum, b| sum ^ b));
        Some(Self { number, command: rest[digits..].trim_ascii_start(), holds })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn framed(number: u32, command: &str) -> Vec<u8> {
        let text = format!("N{number} {command}");
        let sum = text.bytes().fold(0, |sum, b| sum ^ b);
        format!("{text}*{sum}\n").into_bytes()
    }

    fn took(account: &Account) -> Vec<&str> {
        account.took().iter().map(|t| t.command.as_str()).collect()
    }

    #[test]
    fn what_is_refused_damaged_or_out_of_order_was_not_taken() {
        let mut account = Account::new(Commands::of("G28\nG1 X1\nG1 X2\n"));
        account.reached(&framed(0, "M110 N0"), 1);
        for (number, command) in [(1, "G28"), (2, "G1 X1"), (3, "G1 X2")] {
            account.reached(&framed(number, command), 2);
        }
        assert_eq!(took(&account), ["M110 N0", "G28", "G1 X1", "G1 X2"]);
        account.said(b"Resend: 2\n", 3);
        account.reached(&framed(3, "G1 X2"), 4);
        let mut damaged = framed(2, "G1 X1");
        damaged[5] ^= 1;
        account.reached(&damaged, 5);
        assert_eq!(took(&account), ["M110 N0", "G28"]);
        account.reached(&framed(2, "G1 X1"), 6);
        account.reached(b"M105\n", 7);
        assert_eq!(took(&account), ["M110 N0", "G28", "G1 X1", "M105"]);
        // OctoPrint's `resend_with_timeout` wants a line again and then claims to have it.
        account.said(b"Resend: 2\n", 8);
        account.said(b"Resend: 3\n", 9);
        account.reached(&framed(3, "G1 X2"), 10);
        assert_eq!(took(&account), ["M110 N0", "G28", "M105", "G1 X1", "G1 X2"]);
    }

    #[test]
    fn a_start_counts_once_the_job_is_begun() {
        let mut account = Account::new(Commands::of("G28\n"));
        account.said(b"start\n", 1);
        assert_eq!(account.wrote(&framed(1, "G28"), 2), 1);
        account.reached(&framed(1, "G28"), 2);
        account.said(b"start\n", 3);
        assert_eq!(account.starts_ns, [3]);
        account.said(b" T:20.5 /0.0 B:19.0 /0.0 @:0 B@:0\n", 4);
        assert_eq!((account.heat(), account.heat()), (Some((20.5, 19.0)), None));
    }

    #[test]
    fn targets_are_what_the_last_command_wants() {
        let check = |commands: &[&str], expect: (f64, f64)| {
            let mut account = Account::new(Commands::of(""));
            for command in commands {
                account.reached(format!("{command}\n").as_bytes(), 1);
            }
            assert_eq!(targets(account.took()), expect, "{commands:?}");
        };
        check(&["M140 S50", "M104 S150", "M109 R200"], (200.0, 50.0));
        check(&["M109 S200", "M104 S0"], (0.0, 0.0));
        check(&["M109 S200", "M105", "M112"], (0.0, 0.0));
    }
}
