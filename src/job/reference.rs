//! A machine as firmware has it, for tests alone: it shares no code with the tracker.
//!
//! Takes lines with blanks between their words; tells where the machine is and how it is
//! set, as text that two machines can be compared by.

/// The machine.
#[derive(Debug, Clone)]
pub(in crate::job) struct Reference {
    /// X, Y, Z from the end stops and filament through the drive, mm.
    pub(in crate::job) body: [f64; 4],
    /// The same as lines count them.
    pub(in crate::job) named: [f64; 4],
    /// The most filament that ever was through the drive, mm.
    most_mm: f64,
    g90_takes_e: bool,
    absolute: bool,
    e_absolute: bool,
    unit_mm: f64,
    feed: f64,
    tool: usize,
    firmware_retracted: bool,
    fans: [f64; 2],
    pub(in crate::job) nozzles_c: [f64; 2],
    bed_c: f64,
    speed: f64,
    flow: [f64; 2],
}

impl Reference {
    /// Fresh from power-on.
    pub(in crate::job) fn new(g90_takes_e: bool) -> Self {
        Self {
            body: [0.0; 4],
            named: [0.0; 4],
            most_mm: 0.0,
            g90_takes_e,
            absolute: true,
            e_absolute: true,
            unit_mm: 1.0,
            feed: 0.0,
            tool: 0,
            firmware_retracted: false,
            fans: [0.0; 2],
            nozzles_c: [0.0; 2],
            bed_c: 0.0,
            speed: 100.0,
            flow: [100.0; 2],
        }
    }

    /// The same after these lines.
    pub(in crate::job) fn after<L: AsRef<str>>(mut self, lines: impl IntoIterator<Item = L>) -> Self {
        lines.into_iter().for_each(|line| self.run(line.as_ref()));
        self
    }

    /// One line.
    pub(in crate::job) fn run(&mut self, line: &str) {
        let mut parts = line.split_whitespace();
        let command = parts.next().unwrap_or_default();
        let words: Vec<(u8, Option<f64>)> =
            parts.map(|word| (word.as_bytes()[0], word[1..].parse().ok())).collect();
        let word = |letter: u8| words.iter().find(|(l, _)| *l == letter).and_then(|(_, value)| *value);
        let tool = word(b'T').map_or(self.tool, |t| t as usize);
        let axes = || b"XYZE".iter().enumerate().filter_map(|(at, letter)| Some((at, word(*letter)?)));
        match command {
            "G0" | "G1" => {
                if let Some(feed) = word(b'F') {
                    self.feed = feed * self.unit_mm;
                }
                for (axis, value) in axes() {
                    let absolute = if axis == 3 { self.e_absolute } else { self.absolute };
                    let to = value * self.unit_mm + if absolute { 0.0 } else { self.named[axis] };
                    let by = to - self.named[axis];
                    self.body[axis] += if axis == 3 { by * self.flow[self.tool] / 100.0 } else { by };
                    self.named[axis] = to;
                }
                self.most_mm = self.most_mm.max(self.body[3]);
            }
            "G28" => {
                for axis in 0..3 {
                    if words.iter().all(|(l, _)| !b"XYZ".contains(l))
                        || words.iter().any(|(l, _)| *l == b"XYZ"[axis])
                    {
                        (self.body[axis], self.named[axis]) = (0.0, 0.0);
                    }
                }
            }
            "G92" => axes().for_each(|(axis, value)| self.named[axis] = value * self.unit_mm),
            "G10" => self.firmware_retracted = true,
            "G11" => self.firmware_retracted = false,
            "G20" => self.unit_mm = 25.4,
            "G21" => self.unit_mm = 1.0,
            "G90" | "G91" => {
                self.absolute = command == "G90";
                if self.g90_takes_e {
                    self.e_absolute = self.absolute;
                }
            }
            "M82" => self.e_absolute = true,
            "M83" => self.e_absolute = false,
            "T0" => self.tool = 0,
            "T1" => self.tool = 1,
            "M104" | "M109" => self.nozzles_c[tool] = word(b'S').unwrap(),
            "M140" | "M190" => self.bed_c = word(b'S').unwrap(),
            "M106" => self.fans[word(b'P').map_or(0, |p| p as usize)] = word(b'S').unwrap_or(255.0),
            "M107" => self.fans[0] = 0.0,
            "M220" => self.speed = word(b'S').unwrap(),
            "M221" => self.flow[tool] = word(b'S').unwrap(),
            "M105" | "M114" | "M115" | "M155" | "M400" | "M420" => {}
            other => panic!("the test's machine does not know {other}"),
        }
    }

    /// Filament pulled back from where it was furthest, mm.
    pub(in crate::job) fn pulled_back_mm(&self) -> f64 {
        self.most_mm - self.body[3]
    }

    /// All but how much filament there ever was; lengths to 0.1 µm.
    pub(in crate::job) fn told(&self) -> String {
        let tenths = |value: &f64| (value * 1e4).round() as i64;
        let [body, named] =
            [&self.body[..3], &self.named[..]].map(|all| all.iter().map(tenths).collect::<Vec<_>>());
        format!(
            "at {body:?} named {named:?} back {} firmware {} F{} G90 {} M82 {} inches {} T{} fans {:?} nozzles {:?} \
             bed {} M220 {} M221 {:?}",
            tenths(&self.pulled_back_mm()),
            self.firmware_retracted,
            tenths(&self.feed),
            self.absolute,
            self.e_absolute,
            self.unit_mm != 1.0,
            self.tool,
            self.fans,
            self.nozzles_c,
            self.bed_c,
            self.speed,
            self.flow
        )
    }
}
