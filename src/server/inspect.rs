//! Looks at files and mends jobs, each time in a process of its own.
//!
//! Takes [`Work`]; gives what was found ([`Check`]) or made ([`Mend`]). The work is done by this
//! program's own verbs (`check`, `post`), whose JSON is a documented interface. A process of its
//! own, because a file that exhausts memory or time then takes nothing else with it, because the
//! daemon keeps none of the memory that a check takes, and because the kernel can be told that a
//! print matters more. One at a time. Knows no queue and no network.
mod summary;

use super::config;
use super::model::{Check, CheckState, Kind, Mend, MendState};
use super::shelf::Shelf;
use crate::station::guardian::program;
use rustix::process::{Pid, Resource, Rlimit, Signal, kill_process, prlimit, setpriority_process};
use serde_json::Value;
use std::ffi::OsStr;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;
use std::process::{Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use summary::summary;

/// Other processes go first: the higher the nicer, up to 19.
const NICENESS: i32 = 10;

/// Largest report that is read, bytes.
const MAX_REPORT_BYTES: u64 = 16 << 20;

/// Between two looks at a process that works.
const POLL: Duration = Duration::from_millis(20);

/// What a look needs to know of a printer.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct For {
    /// Its short name.
    pub(crate) printer: String,
    /// Its profile, as the verbs take it.
    pub(crate) profile: String,
    /// It prints resin jobs, and nothing else.
    pub(crate) resin: bool,
    /// What is in it, where that is told.
    pub(crate) material: Option<String>,
    /// Whether the infill of clean jobs is put into a better order.
    pub(crate) reorder: bool,
}

/// Something to do.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Work {
    /// Look at a file for a printer.
    Look {
        /// The file's name here…
        file: String,
        /// …and for people.
        name: String,
        /// The printer.
        of: For,
    },
    /// Grow supports into a job.
    Mend {
        /// The job.
        job: String,
        /// Its file's name here…
        file: String,
        /// …and for people.
        name: String,
        /// The printer.
        of: For,
    },
}

/// What came of it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Done {
    /// A file was looked at.
    Looked {
        /// The file.
        file: String,
        /// The printer.
        printer: String,
        /// What it is.
        kind: Kind,
        /// What was found.
        check: Box<Check>,
    },
    /// A job was mended, or could not be.
    Mended {
        /// The job.
        job: String,
        /// What was made.
        mend: Box<Mend>,
    },
}

/// Who does it.
pub(crate) struct Inspector {
    /// Where files are.
    pub(crate) shelf: Shelf,
    /// The limits.
    pub(crate) limits: config::Check,
    /// The daemon ends: whatever runs is ended.
    pub(crate) stop: std::sync::Arc<AtomicBool>,
}

/// A verb that was run.
struct Ran {
    status: Option<ExitStatus>,
    /// What it said on its standard error, without our name before it.
    words: String,
}

impl Ran {
    fn is_done(&self) -> bool {
        self.status.is_some_and(|status| status.success())
    }
}

impl Inspector {
    /// Does it, however long it takes.
    pub(crate) fn work(&self, work: &Work) -> Done {
        match work {
            Work::Look { file, name, of } => {
                let began = Instant::now();
                let (kind, mut check) = self.look(file, name, of);
                check.seconds = began.elapsed().as_secs_f64();
                let printer = of.printer.clone();
                Done::Looked { file: file.clone(), printer, kind, check: Box::new(check) }
            }
            Work::Mend { job, file, name, of } => {
                let mend = self.mend(job, file, name, of).unwrap_or_else(|words| Mend {
                    state: MendState::Failed,
                    words,
                    ..Mend::default()
                });
                Done::Mended { job: job.clone(), mend: Box::new(mend) }
            }
        }
    }

    fn look(&self, file: &str, name: &str, of: &For) -> (Kind, Check) {
        let content = self.shelf.content(file);
        let made = |what: &str| self.shelf.made(file, &of.printer, what);
        let (report, picture) = (made("check.json"), made("layers.html"));
        let mut verb: Vec<&OsStr> = vec!["check".as_ref(), "--quiet".as_ref()];
        verb.extend::<[&OsStr; 4]>([
            "--json".as_ref(),
            report.as_ref(),
            "--picture".as_ref(),
            picture.as_ref(),
        ]);
        let resin = is_resin(&content);
        if resin == of.resin {
            verb.extend::<[&OsStr; 2]>(["--printer".as_ref(), of.profile.as_ref()]);
            if let Some(material) = &of.material {
                verb.extend::<[&OsStr; 2]>(["--material".as_ref(), material.as_ref()]);
            }
        }
        verb.push(content.as_ref());
        let ran = self.run(&verb, name);
        let told = read_report(&report).filter(|_| ran.is_done());
        let Some(told) = told else {
            let failed = Check { state: CheckState::Failed, words: Some(ran.words), ..Check::default() };
            return (if resin { Kind::Resin } else { Kind::Unknown }, failed);
        };
        let mut check = summary(&told);
        check.picture =
            picture.exists().then(|| format!("/api/v2/files/{file}/pictures/layers?printer={}", of.printer));
        if of.reorder && !resin && check.state == CheckState::Clean {
            check.reordered = self.reorder(file, name, of);
        }
        (if resin { Kind::Resin } else { Kind::Gcode }, check)
    }

    /// Puts the infill into a better order, beside the file; `None`: it stays as it is.
    fn reorder(&self, file: &str, name: &str, of: &For) -> Option<String> {
        let made = |what: &str| self.shelf.made(file, &of.printer, what);
        let (out, report, paths) = (made("reordered"), made("reordered.json"), made("paths.svg"));
        self.reorder_into(&self.shelf.content(file), &out, [&report, &paths], name, of)
    }

    fn reorder_into(
        &self,
        from: &Path,
        to: &Path,
        [report, picture]: [&Path; 2],
        name: &str,
        of: &For,
    ) -> Option<String> {
        let verb: [&OsStr; 11] = [
            "post".as_ref(),
            "--quiet".as_ref(),
            "--profile".as_ref(),
            of.profile.as_ref(),
            "--report".as_ref(),
            report.as_ref(),
            "--picture".as_ref(),
            picture.as_ref(),
            "-o".as_ref(),
            to.as_ref(),
            from.as_ref(),
        ];
        let ran = self.run(&verb, name);
        let told = read_report(report).filter(|_| ran.is_done());
        let words = told.filter(|told| told["unchanged_reason"].is_null()).map(|told| gain(&told));
        if words.is_none() {
            // What was not changed is printed from where it is.
            let _ = std::fs::remove_file(to);
        }
        words
    }

    /// Supports, then the better order.
    fn mend(&self, job: &str, file: &str, name: &str, of: &For) -> Result<Mend, String> {
        let content = self.shelf.content(file);
        let made = |what: &str| self.shelf.of_job(job, what);
        let resin = is_resin(&content);
        // The verb tells the format of a resin job by the name's ending: it stays what it is.
        let out = match resin {
            true => made(&format!("supported.{}", self.format(file, of)?)),
            false => made("supported"),
        };
        let (report, page) = (made("supports.json"), made("supports.html"));
        let mut verb: Vec<&OsStr> = vec![
            "post".as_ref(),
            "--quiet".as_ref(),
            "--supports".as_ref(),
            "auto".as_ref(),
            "--report".as_ref(),
            report.as_ref(),
            "--picture".as_ref(),
            page.as_ref(),
            "-o".as_ref(),
            out.as_ref(),
        ];
        if let Some(material) = &of.material {
            verb.extend::<[&OsStr; 2]>(["--material".as_ref(), material.as_ref()]);
        }
        verb.push(content.as_ref());
        let mut ran = self.run(&verb, name);
        let mut told = read_report(&report).unwrap_or_default();
        let left = told["unroutable"].as_array().map_or(0, Vec::len);
        let mut warns = String::new();
        if !ran.is_done() && left > 0 {
            // Not all can be held. Most of it is better than nothing, and a person looks at it.
            verb.insert(1, "--allow-unroutable".as_ref());
            ran = self.run(&verb, name);
            told = read_report(&report).unwrap_or_default();
            warns = format!("; {left} places have no room for a support and stay as they are");
        }
        if !ran.is_done() {
            return Err(ran.words);
        }
        let added_mm3 = told["volume_mm3"].as_f64().unwrap_or_default();
        let tips = told["tips"].as_u64();
        if added_mm3 <= 0.0 {
            return Err("nothing in it needs a support that can be grown".to_owned());
        }
        let grown = match tips {
            Some(tips) => format!("supports with {tips} tips grown ({added_mm3:.0} mm³)"),
            None => format!("supports grown ({added_mm3:.0} mm³)"),
        };
        let (mended, paths) = (made("mended"), made("paths.svg"));
        let better = if of.reorder && !resin {
            self.reorder_into(&out, &mended, [&made("reordered.json"), &paths], name, of)
        } else {
            None
        };
        if better.is_none() {
            std::fs::rename(&out, &mended).map_err(|e| format!("cannot keep the mended job: {e}"))?;
        }
        let _ = std::fs::remove_file(&out);
        let better = better.map(|words| format!("; {words}")).unwrap_or_default();
        let address =
            |what: &str, path: &Path| path.exists().then(|| format!("/api/v2/jobs/{job}/pictures/{what}"));
        Ok(Mend {
            state: MendState::Done,
            words: format!("{grown}{better}{warns}"),
            picture: address("mended", &page),
            paths_picture: address("paths", &paths),
            added_mm3,
        })
    }

    /// The format of a resin job, as the check has found it, which is its name's ending too.
    fn format(&self, file: &str, of: &For) -> Result<&'static str, String> {
        let told = read_report(&self.shelf.made(file, &of.printer, "check.json")).unwrap_or_default();
        let known = ["sl1", "nanodlp", "goo"].into_iter().find(|format| told["kind"] == *format);
        known.ok_or_else(|| "its check does not tell its format: upload it again".to_owned())
    }

    /// Runs one of our verbs. Its words end with its last line on standard error, or say why it was
    /// ended.
    fn run(&self, verb: &[&OsStr], name: &str) -> Ran {
        match self.try_run(verb, name) {
            Ok(ran) => ran,
            Err(why) => Ran { status: None, words: format!("cannot look at it: {why}") },
        }
    }

    fn try_run(&self, verb: &[&OsStr], name: &str) -> std::io::Result<Ran> {
        let mut said = tempfile::tempfile()?;
        let mut child = Command::new(program())
            .args(verb)
            // What people know the file by, in reports and pictures.
            .env("SLIC3R_PP_OUTPUT_NAME", name)
            .env_remove("NOTIFY_SOCKET")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(said.try_clone()?)
            .spawn()?;
        let pid = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
        if let Some(pid) = pid {
            // What the system refuses is a pity, not a fault.
            let _ = setpriority_process(Some(pid), NICENESS);
            let most = Some(self.limits.memory_mb * 1_000_000);
            // When memory runs out, this goes before a print does.
            let _ = std::fs::write(format!("/proc/{pid}/oom_score_adj"), "500");
            let _ = prlimit(Some(pid), Resource::Data, Rlimit { current: most, maximum: most });
        }
        let began = Instant::now();
        let mut ended_by_us = None;
        let status = loop {
            if let Some(status) = child.try_wait()? {
                break status;
            }
            if ended_by_us.is_none() {
                if self.stop.load(Ordering::Relaxed) {
                    ended_by_us = Some("the daemon ends".to_owned());
                } else if began.elapsed() > self.limits.timeout() {
                    ended_by_us =
                        Some(format!("it took longer than {} s (check.timeout_s)", self.limits.timeout_s));
                }
                if let (Some(_), Some(pid)) = (&ended_by_us, pid) {
                    // Its temporary files go with it.
                    let _ = kill_process(pid, Signal::TERM);
                }
            } else if began.elapsed() > self.limits.timeout() + Duration::from_secs(5) {
                let _ = child.kill();
            }
            std::thread::sleep(POLL);
        };
        let words = match ended_by_us {
            Some(why) => why,
            None if status.code().is_none() => {
                format!("it was ended ({status}), most likely for want of memory (check.memory_mb)")
            }
            None => match last_line(&mut said)? {
                words if words.is_empty() && !status.success() => {
                    format!("it ended with {status} and said nothing")
                }
                words => words,
            },
        };
        Ok(Ran { status: Some(status), words })
    }
}

/// The last line that a verb has said, without our name before it.
fn last_line(said: &mut File) -> std::io::Result<String> {
    let mut text = Vec::new();
    let end = said.seek(SeekFrom::End(0))?;
    said.seek(SeekFrom::Start(end.saturating_sub(4096)))?;
    said.take(4096).read_to_end(&mut text)?;
    let text = String::from_utf8_lossy(&text);
    let line = text.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or_default();
    Ok(line.strip_prefix("outrigger: ").unwrap_or(line).to_owned())
}

/// Whether a file's first bytes are those of a resin job: a zip, or GOO's.
pub(crate) fn is_resin(path: &Path) -> bool {
    let mut start = [0_u8; 4];
    let read = File::open(path).and_then(|mut file| file.read_exact(&mut start));
    read.is_ok() && (&start == b"PK\x03\x04" || start.starts_with(b"V3."))
}

fn read_report(path: &Path) -> Option<Value> {
    let file = File::open(path).ok()?;
    serde_json::from_reader(std::io::BufReader::new(file.take(MAX_REPORT_BYTES))).ok()
}

/// What reordering has gained, in words.
fn gain(told: &Value) -> String {
    let number = |key: &str| told[key].as_f64().unwrap_or_default();
    let change = |what: &str| {
        let (before, after) = (number(&format!("{what}_before")), number(&format!("{what}_after")));
        if before > 0.0 { (1.0 - after / before) * 100.0 } else { 0.0 }
    };
    let gains =
        [("less travel", "travel_mm"), ("fewer lifts", "lifts"), ("fewer retractions", "retractions")];
    let told: Vec<String> = gains
        .iter()
        .map(|(words, what)| (words, change(what).round()))
        .filter(|(_, percent)| *percent >= 1.0)
        .map(|(words, percent)| format!("{percent} % {words}"))
        .collect();
    match told.is_empty() {
        true => "infill reordered".to_owned(),
        false => format!("infill reordered: {}", told.join(", ")),
    }
}
