//! Klipper's objects, told from what is known of a printer of ours: pure.
//!
//! Takes [`Now`]; gives all objects, what a client wants of them, and what has changed. What firmwares
//! do not tell (positions of X and Y, the heaters' power) is 0.
use super::host::system_stats;
use crate::server::model::{Heater, PrinterKind, Stage};
use crate::server::octoprint::asked::{Doing, Now};
use serde_json::{Map, Value, json};

/// Objects, or parts of them.
pub(super) type Status = Map<String, Value>;

/// What a client wants: objects, and of each some fields, or all.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Wanted(Vec<(String, Option<Vec<String>>)>);

/// How Klipper is, and why, in its words.
pub(super) fn klippy(now: &Now) -> (&'static str, String) {
    let state = match now.doing {
        Doing::Offline => "disconnected",
        Doing::Connecting => "startup",
        Doing::Failed => "error",
        _ => return ("ready", "Printer is ready".to_owned()),
    };
    (state, now.words().to_owned())
}

/// The state of `print_stats`, its message, and the job's name.
fn print_state(now: &Now) -> (&'static str, String, String) {
    let words = |job: &crate::server::model::Job| {
        let printer = now.printer.waits_for_user.clone();
        printer.or(job.waits_for.clone()).or(job.error.clone()).unwrap_or_default()
    };
    match (&now.job, &now.next, &now.last) {
        (Some(job), _, _) => {
            let paused =
                matches!(job.state, Stage::Paused | Stage::Asking | Stage::Lost | Stage::Interrupted);
            (if paused { "paused" } else { "printing" }, words(job), job.name.clone())
        }
        (None, Some(job), _) => ("standby", words(job), String::new()),
        (None, None, Some(job)) => {
            let state = match job.state {
                Stage::Finished => "complete",
                Stage::Cancelled => "cancelled",
                _ => "error",
            };
            (state, job.error.clone().unwrap_or_default(), job.name.clone())
        }
        (None, None, None) => ("standby", String::new(), String::new()),
    }
}

fn heater(heater: Option<Heater>) -> Value {
    let tenths = |c: f32| (f64::from(c) * 10.0).round() / 10.0;
    let heater = heater.unwrap_or_default();
    json!({"temperature": tenths(heater.actual_c), "target": tenths(heater.target_c), "power": 0.0})
}

/// All objects. `size`: bytes of the job's file.
pub(super) fn all(now: &Now, size: u64) -> Status {
    let (klippy, klippy_words) = klippy(now);
    let (state, message, name) = print_state(now);
    let running = now.job.is_some();
    let at = now.printer.progress.filter(|_| running).unwrap_or_default();
    let done = !running && state == "complete";
    let fraction = if done { 1.0 } else { at.fraction };
    let printed_s = match (&now.last, running) {
        (Some(job), false) if state != "standby" => {
            let ends = job.ended_unix_s.zip(job.started_unix_s);
            ends.map_or(0.0, |(end, start)| end.saturating_sub(start) as f64)
        }
        _ => at.elapsed_s,
    };
    let position = json!([0.0, 0.0, at.z_mm.unwrap_or(0.0), 0.0]);
    let layer = |n: u64| (n > 0).then_some(n);
    let heat = now.printer.temperatures;
    // A resin printer has neither nozzle nor heaters: what is not there tells no temperature.
    let melts = now.printer.kind == PrinterKind::Fdm;
    let mut all = Map::new();
    let mut object = |name: &str, value: Value| drop(all.insert(name.to_owned(), value));
    object("webhooks", json!({"state": klippy, "state_message": klippy_words}));
    object(
        "print_stats",
        json!({
            "state": state,
            "filename": name,
            "message": message,
            "print_duration": printed_s,
            "total_duration": printed_s,
            "filament_used": 0.0,
            "info": {"total_layer": layer(at.layers), "current_layer": layer(at.layer)},
        }),
    );
    object(
        "display_status",
        json!({"progress": fraction, "message": (!message.is_empty()).then_some(&message)}),
    );
    object(
        "virtual_sdcard",
        json!({
            "progress": fraction,
            "file_position": (fraction * size as f64) as u64,
            "file_size": size,
            "is_active": state == "printing",
            "file_path": (!name.is_empty()).then_some(&name),
        }),
    );
    object(
        "toolhead",
        json!({
            "position": position,
            "homed_axes": match (running, melts) {
                (true, true) => "xyz",
                (true, false) => "z",
                (false, _) => "",
            },
            "extruder": if melts { "extruder" } else { "" },
            "print_time": printed_s,
            "axis_minimum": [0.0, 0.0, 0.0, 0.0],
            "axis_maximum": [now.printer.bed_mm.x, now.printer.bed_mm.y, now.printer.bed_mm.z, 0.0],
        }),
    );
    object(
        "gcode_move",
        json!({
            "speed": 0.0,
            "speed_factor": 1.0,
            "extrude_factor": 1.0,
            "absolute_coordinates": true,
            "position": position,
            "gcode_position": position,
        }),
    );
    object(
        "motion_report",
        json!({"live_position": position, "live_velocity": 0.0, "live_extruder_velocity": 0.0}),
    );
    if melts {
        object("extruder", heater(heat.nozzle));
    }
    if now.printer.limits.bed_c > 0.0 {
        object("heater_bed", heater(heat.bed));
    }
    if heat.chamber.is_some() {
        object("temperature_sensor chamber", heater(heat.chamber));
    }
    object(
        "idle_timeout",
        json!({"state": if running { "Printing" } else { "Ready" }, "printing_time": printed_s}),
    );
    object("pause_resume", json!({"is_paused": state == "paused"}));
    object("system_stats", system_stats());
    all
}

impl Wanted {
    /// What a client says, as far as there are such objects: nothing else is kept of it.
    pub(super) fn of(objects: Option<&Value>, all: &Status) -> Self {
        let Some(Value::Object(objects)) = objects else { return Self::default() };
        let fields = |name: &str, fields: &Value| {
            let said = fields.as_array()?.iter().filter_map(Value::as_str);
            Some(said.filter(|field| all[name].get(field).is_some()).map(str::to_owned).collect())
        };
        let known = objects.iter().filter(|(name, _)| all.contains_key(*name));
        Self(known.map(|(name, list)| (name.clone(), fields(name, list))).collect())
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// That of all.
    pub(super) fn pick(&self, all: &Status) -> Status {
        let pick = |(name, fields): &(String, Option<Vec<String>>)| {
            let object = all.get(name)?;
            let picked = match (fields, object) {
                (Some(fields), Value::Object(object)) => object
                    .iter()
                    .filter(|(field, _)| fields.contains(field))
                    .map(|(f, v)| (f.clone(), v.clone()))
                    .collect(),
                _ => object.clone(),
            };
            Some((name.clone(), picked))
        };
        self.0.iter().filter_map(pick).collect()
    }
}

/// What is new or other than before.
pub(super) fn changed(before: &Status, now: &Status) -> Status {
    let new = |(name, object): (&String, &Value)| {
        let was = before.get(name);
        let fields: Map<_, _> = object
            .as_object()?
            .iter()
            .filter(|(field, value)| was.and_then(|was| was.get(*field)) != Some(*value))
            .map(|(field, value)| (field.clone(), value.clone()))
            .collect();
        (!fields.is_empty()).then(|| (name.clone(), Value::Object(fields)))
    };
    now.iter().filter_map(new).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn status(value: Value) -> Status {
        serde_json::from_value(value).unwrap()
    }

    #[test]
    fn only_what_is_wanted_and_there_is_told() {
        let all = status(json!({"a": {"x": 1, "y": 2}, "b": {"z": 3}}));
        let check = |objects: Value, expect: Value| {
            let wanted = Wanted::of(Some(&objects), &all);
            assert_eq!(Value::Object(wanted.pick(&all)), expect, "{objects}");
        };
        check(json!({"a": null, "none": null}), json!({"a": {"x": 1, "y": 2}}));
        check(json!({"a": ["y", "none"]}), json!({"a": {"y": 2}}));
        check(json!({"b": []}), json!({"b": {}}));
        check(json!({}), json!({}));
        check(json!([1]), json!({}));
    }

    #[test]
    fn changes_are_fields() {
        let before = status(json!({"a": {"x": 1, "y": 2}, "b": {"z": 3}}));
        let now = status(json!({"a": {"x": 1, "y": 5}, "b": {"z": 3}, "c": {"w": 1}}));
        assert_eq!(Value::Object(changed(&before, &now)), json!({"a": {"y": 5}, "c": {"w": 1}}));
        assert!(changed(&now, &now).is_empty());
    }
}
