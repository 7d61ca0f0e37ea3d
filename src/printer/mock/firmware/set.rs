//! Commands that set values: temperatures, tool, position, homing, dynamics, numbers.
//!
//! As Marlin 2.1.2 does it; what its options lack is the caller's matter.
use super::super::heater::Heater;
use super::super::planner::Cornering;
use super::super::report;
use super::super::words::Command;
use super::Firmware;
use super::execute::Next;
use super::wait::{After, HEAT_REPORT_NS, Heat, Wait};

/// Marlin's TEMP_WINDOW and TEMP_RESIDENCY_TIME: how near the target counts as
/// there, and for how long it must stay.
const HEAT_WINDOW_C: f64 = 1.0;
const HEAT_RESIDENCY_S: f64 = 10.0;

/// Hottest chamber (CHAMBER_MAXTEMP).
const CHAMBER_MAX_C: f64 = 70.0;

/// Speeds of homing, mm/s, and what the touches of the switch take, s.
const HOME_XY_MM_S: f64 = 50.0;
const HOME_Z_MM_S: f64 = 10.0;
const HOME_TOUCH_S: f64 = 2.0;

/// Farthest raise before homing, mm.
const HOMING_RAISE_MM_MAX: f64 = 100.0;

impl Firmware {
    pub(super) fn set_number(&mut self, command: &Command<'_>) {
        let Some(n) = command.value(b'N') else {
            return;
        };
        let n = n as i64;
        // A numbered M110 was counted when it was read; that the number is set
        // once more here, over lines that were read since, is Marlin's way: a
        // host must wait for the `ok` of M110.
        if self.queue.front().is_some_and(|head| head.number.is_none()) {
            self.renumber(self.numbering.last, n);
        }
        self.numbering.last = n;
    }

    /// M104 and M109, of the tool in use or of T.
    pub(super) fn heat_nozzle(&mut self, command: &Command<'_>, now_s: f64) -> Next {
        let tool = command.value(b'T').map_or(self.heaters.tool, |t| t.max(0.0) as usize);
        let most_c = self.config.machine.nozzle_max_c;
        let (Some((target_c, cools)), true) = (target(command, most_c), tool < self.heaters.nozzles.len())
        else {
            return Next::Ok;
        };
        self.heaters.nozzles[tool].set(target_c, now_s);
        if command.code == 104 {
            return Next::Ok;
        }
        self.wait_for(&self.heaters.nozzles[tool], cools, now_s)
    }

    /// M140 and M190.
    pub(super) fn heat_bed(&mut self, command: &Command<'_>, now_s: f64) -> Next {
        let Some((target_c, cools)) = target(command, self.config.machine.bed_max_c) else {
            return Next::Ok;
        };
        self.heaters.bed.set(target_c, now_s);
        if command.code == 140 {
            return Next::Ok;
        }
        self.wait_for(&self.heaters.bed, cools, now_s)
    }

    /// M141 and M191.
    pub(super) fn heat_chamber(&mut self, command: &Command<'_>, now_s: f64) -> Next {
        let (Some((target_c, cools)), Some(chamber)) =
            (target(command, CHAMBER_MAX_C), &mut self.heaters.chamber)
        else {
            return Next::Ok;
        };
        chamber.set(target_c, now_s);
        if command.code == 141 {
            return Next::Ok;
        }
        match &self.heaters.chamber {
            Some(chamber) => self.wait_for(chamber, cools, now_s),
            None => Next::Ok,
        }
    }

    /// S waits for heating only, R for cooling too.
    fn wait_for(&self, heater: &Heater, cools: bool, now_s: f64) -> Next {
        let hotter = heater.temperature_c(now_s) > heater.target_c() + HEAT_WINDOW_C;
        if heater.target_c() <= 0.0 || (hotter && !cools) {
            return Next::Ok;
        }
        let in_s = heater.reaches_s(HEAT_WINDOW_C, now_s) - now_s;
        let now_ns = self.now_ns();
        Next::Wait(Wait::Heat(Heat {
            reached_ns: now_ns + self.scaled_ns(in_s),
            done_ns: now_ns + self.scaled_ns(in_s + HEAT_RESIDENCY_S),
            report_ns: now_ns + HEAT_REPORT_NS,
        }))
    }

    /// T0, T1 …
    pub(super) fn change_tool(&mut self, tool: u32) -> Next {
        let several = self.heaters.nozzles.len() > 1;
        if tool as usize >= self.heaters.nozzles.len() {
            self.say(format!("echo:T{tool} Invalid extruder\n").as_bytes());
        } else {
            self.heaters.tool = tool as usize;
            if several {
                self.say(format!("echo:Active Extruder: {tool}\n").as_bytes());
            }
        }
        Next::Ok
    }

    /// G92, and G92.9 where it is known; other kinds are ignored without a word.
    pub(super) fn name_position(&mut self, command: &Command<'_>) {
        match command.sub {
            0 => self.motion.name_position(command, false),
            9 if self.config.habits.native_position => self.motion.name_position(command, true),
            _ => return,
        }
        if self.config.habits.tells_position {
            self.say_position();
        }
    }

    pub(super) fn say_position(&mut self) {
        let text = report::position(self.motion.at_mm, self.motion.native_mm());
        self.say(text.as_bytes());
    }

    pub(super) fn begin_homing(&mut self, command: &Command<'_>) -> Next {
        let named = [b'X', b'Y', b'Z'].map(|axis| command.has(axis));
        let axes = if named.contains(&true) { named } else { [true; 3] };
        if self.config.machine.resin.is_some() {
            let homes = axes[2] && !(command.has(b'O') && self.motion.is_homed(2));
            // Nothing goes across, so nothing is raised for it.
            let home = After::Home { axes: [false, false, true], raise_mm: 0.0 };
            return if homes { Next::Wait(Wait::Drain(home)) } else { Next::Ok };
        }
        if command.has(b'O') && (0..3).all(|axis| !axes[axis] || self.motion.is_homed(axis)) {
            return Next::Ok;
        }
        let own_mm = self.config.machine.homing_raise_mm;
        let raise_mm = match command.has(b'R') && self.config.habits.homing_raise {
            true => command.value(b'R').unwrap_or(0.0).clamp(0.0, HOMING_RAISE_MM_MAX),
            false => own_mm,
        };
        Next::Wait(Wait::Drain(After::Home { axes, raise_mm }))
    }

    /// Homes at once; gives how long it takes, s of the machine's time. Levelling is off
    /// afterwards, as without RESTORE_LEVELING_AFTER_G28.
    pub(super) fn home(&mut self, axes: [bool; 3], raise_mm: f64) -> f64 {
        let mut lasts_s = self.homing_s(axes);
        let raised_mm = if raise_mm > 0.0 { self.motion.raise_before_homing(raise_mm) } else { 0.0 };
        if raised_mm > 0.0 {
            lasts_s += raised_mm / HOME_Z_MM_S;
            self.moved([0.0, 0.0, raised_mm, 0.0]);
        }
        let nozzle_c = self.nozzle_c();
        for axis in (0..3).filter(|&axis| axes[axis]) {
            self.body.home(axis, nozzle_c);
        }
        self.light.plate_at(self.body.at_mm[2]);
        self.motion.home(axes, [0.0, 0.0, self.home_z_mm()]);
        self.levelling_on = false;
        lasts_s
    }

    /// Where Z is when it is homed, mm.
    fn home_z_mm(&self) -> f64 {
        self.config.machine.resin.filter(|resin| resin.homes_up).map_or(0.0, |resin| resin.z_max_mm)
    }

    /// M420 S: the mesh is there and outlives a reset.
    pub(super) fn set_levelling(&mut self, s: Option<f64>) {
        if let Some(s) = s {
            self.levelling_on = s != 0.0;
        }
        let on = if self.levelling_on { "ON" } else { "OFF" };
        self.say(format!("echo:Bed Leveling {on}\necho:Fade Height 10.00\n").as_bytes());
    }

    pub(super) fn set_dynamics(&mut self, command: &Command<'_>) {
        let dynamics = &mut self.planner.dynamics;
        let positive = |letter| command.value(letter).filter(|v| *v > 0.0);
        match command.code {
            201 | 203 => {
                for (axis, letter) in [b'X', b'Y', b'Z', b'E'].into_iter().enumerate() {
                    if let Some(value) = positive(letter) {
                        if command.code == 201 {
                            dynamics.max_accel_mm_s2[axis] = value;
                        } else {
                            dynamics.max_feed_mm_s[axis] = value;
                        }
                    }
                }
            }
            204 => {
                let both = positive(b'S');
                let set = |to: &mut f64, value: Option<f64>| *to = value.unwrap_or(*to);
                set(&mut dynamics.print_mm_s2, positive(b'P').or(both));
                set(&mut dynamics.travel_mm_s2, positive(b'T').or(both));
                set(&mut dynamics.retract_mm_s2, positive(b'R'));
            }
            205 => {
                let jerk = positive(b'X').or(positive(b'Y')).map(Cornering::JerkMmS);
                let junction = positive(b'J').map(Cornering::JunctionMm);
                dynamics.cornering = junction.or(jerk).unwrap_or(dynamics.cornering);
            }
            _ => {
                let (length, feed) = &mut self.motion.retract;
                *length = positive(b'S').unwrap_or(*length);
                *feed = positive(b'F').map_or(*feed, |f| f / 60.0);
            }
        }
    }

    /// How long homing these axes takes, s of the machine's time.
    pub(super) fn homing_s(&self, axes: [bool; 3]) -> f64 {
        let speeds = [HOME_XY_MM_S, HOME_XY_MM_S, HOME_Z_MM_S];
        let switches_mm = [0.0, 0.0, self.home_z_mm()];
        (0..3)
            .filter(|&axis| axes[axis])
            .map(|axis| {
                HOME_TOUCH_S + (self.motion.at_mm[axis] - switches_mm[axis]).abs().min(1000.0) / speeds[axis]
            })
            .sum()
    }
}

/// The target of S or R, and whether cooling is waited for too.
fn target(command: &Command<'_>, most_c: f64) -> Option<(f64, bool)> {
    let s = command.value(b'S');
    let target_c = s.or(command.value(b'R'))?;
    Some((target_c.clamp(0.0, most_c), s.is_none()))
}
