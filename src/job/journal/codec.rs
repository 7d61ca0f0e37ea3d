//! Records and pictures as bytes, and back.
//!
//! Takes and gives payloads: what stands inside a frame of the journal, a picture or
//! records one after the other. Everything is
//! little-endian; `docs/journal.md` has each of them byte by byte. Decoding is total:
//! any bytes give a value or `None`, and no count is trusted with more memory than the
//! bytes that follow it. Knows no frames, no checksums and no medium.
use crate::job::digest::MAX_CHUNKS;
use crate::job::record::{Accepted, Checkpoint, Log, MAX_OWN, MAX_TEXT_BYTES, Numbers, Record, kept};
use crate::job::state::State;
use std::ffi::OsStr;
use std::os::unix::ffi::OsStrExt;
use std::path::PathBuf;

/// A record's kind is its first byte. Never given to another kind.
mod kind {
    pub(super) const PICTURE: u8 = 1;
    pub(super) const OPENED: u8 = 2;
    pub(super) const STATE: u8 = 3;
    pub(super) const NUMBERS: u8 = 4;
    pub(super) const OWN: u8 = 5;
    pub(super) const UNNUMBERED: u8 = 6;
    pub(super) const CHECKPOINT: u8 = 7;
    pub(super) const MADE_SAFE: u8 = 8;
    pub(super) const NOTE: u8 = 9;
    pub(super) const DEPTH: u8 = 10;
}

/// A state's number on the medium: never given to another state.
fn number(state: State) -> u8 {
    match state {
        State::Accepted => 1,
        State::Starting => 2,
        State::Printing => 3,
        State::Pausing => 4,
        State::Paused => 5,
        State::Resuming => 6,
        State::Asking => 7,
        State::Lost => 8,
        State::TakingOver => 9,
        State::Recovering => 10,
        State::Ending => 11,
        State::Cancelling => 12,
        State::Failing => 13,
        State::Interrupted => 14,
        State::Finished => 15,
        State::Cancelled => 16,
        State::Failed => 17,
    }
}

/// The other way round.
fn state(number: u8) -> Option<State> {
    Some(match number {
        1 => State::Accepted,
        2 => State::Starting,
        3 => State::Printing,
        4 => State::Pausing,
        5 => State::Paused,
        6 => State::Resuming,
        7 => State::Asking,
        8 => State::Lost,
        9 => State::TakingOver,
        10 => State::Recovering,
        11 => State::Ending,
        12 => State::Cancelling,
        13 => State::Failing,
        14 => State::Interrupted,
        15 => State::Finished,
        16 => State::Cancelled,
        17 => State::Failed,
        _ => return None,
    })
}

/// Bytes that a payload is written to.
struct Out<'a>(&'a mut Vec<u8>);

impl Out<'_> {
    fn u8(&mut self, value: u8) {
        self.0.push(value);
    }
    fn u32(&mut self, value: u32) {
        self.0.extend_from_slice(&value.to_le_bytes());
    }
    fn u64(&mut self, value: u64) {
        self.0.extend_from_slice(&value.to_le_bytes());
    }
    fn f32(&mut self, value: f32) {
        self.0.extend_from_slice(&value.to_le_bytes());
    }
    fn f64(&mut self, value: f64) {
        self.0.extend_from_slice(&value.to_le_bytes());
    }
    /// Its length, at most [`MAX_TEXT_BYTES`], and its bytes.
    fn bytes(&mut self, bytes: &[u8]) {
        let bytes = &bytes[..bytes.len().min(MAX_TEXT_BYTES)];
        self.u32(bytes.len() as u32);
        self.0.extend_from_slice(bytes);
    }
    fn text(&mut self, text: &str) {
        self.bytes(kept(text).as_bytes());
    }
    fn state(&mut self, state: State) {
        self.u8(number(state));
    }
    fn height(&mut self, z_mm: Option<f64>) {
        self.u8(u8::from(z_mm.is_some()));
        self.f64(z_mm.unwrap_or(0.0));
    }
}

/// Bytes that a payload is read from.
struct In<'a>(&'a [u8]);

impl<'a> In<'a> {
    fn take(&mut self, len: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(len)?;
        self.0 = rest;
        Some(taken)
    }
    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }
    fn u8(&mut self) -> Option<u8> {
        Some(self.array::<1>()?[0])
    }
    fn u32(&mut self) -> Option<u32> {
        Some(u32::from_le_bytes(self.array()?))
    }
    fn u64(&mut self) -> Option<u64> {
        Some(u64::from_le_bytes(self.array()?))
    }
    fn f32(&mut self) -> Option<f32> {
        Some(f32::from_le_bytes(self.array()?))
    }
    fn f64(&mut self) -> Option<f64> {
        Some(f64::from_le_bytes(self.array()?))
    }
    fn flag(&mut self) -> Option<bool> {
        match self.u8()? {
            0 => Some(false),
            1 => Some(true),
            _ => None,
        }
    }
    fn count(&mut self, max: usize) -> Option<usize> {
        usize::try_from(self.u32()?).ok().filter(|count| *count <= max)
    }
    fn bytes(&mut self) -> Option<&'a [u8]> {
        let len = self.count(MAX_TEXT_BYTES)?;
        self.take(len)
    }
    fn text(&mut self) -> Option<String> {
        std::str::from_utf8(self.bytes()?).ok().map(str::to_owned)
    }
    fn state(&mut self) -> Option<State> {
        state(self.u8()?)
    }
    fn height(&mut self) -> Option<Option<f64>> {
        let known = self.flag()?;
        let z_mm = self.f64()?;
        Some(known.then_some(z_mm))
    }
}

/// Adds a record to a payload; an acceptance adds nothing, it is in the picture that a
/// journal begins with.
pub(super) fn encode(record: &Record, payload: &mut Vec<u8>) {
    let out = &mut Out(payload);
    match record {
        Record::Accepted(_) => {}
        Record::Opened { port, baud, at_unix_s } => {
            out.u8(kind::OPENED);
            out.text(port);
            out.u32(*baud);
            out.u64(*at_unix_s);
        }
        Record::State(state) => {
            out.u8(kind::STATE);
            out.state(*state);
        }
        Record::Numbers { first, after } => {
            out.u8(kind::NUMBERS);
            out.u32(*first);
            out.u64(*after);
        }
        Record::Own { n } => {
            out.u8(kind::OWN);
            out.u32(*n);
        }
        Record::Unnumbered { after } => {
            out.u8(kind::UNNUMBERED);
            out.u64(*after);
        }
        Record::Checkpoint(checkpoint) => {
            out.u8(kind::CHECKPOINT);
            put_checkpoint(out, checkpoint);
        }
        Record::MadeSafe { z_mm } => {
            out.u8(kind::MADE_SAFE);
            out.height(*z_mm);
        }
        Record::Depth(moves) => {
            out.u8(kind::DEPTH);
            out.u32(*moves);
        }
        Record::Note(text) => {
            out.u8(kind::NOTE);
            out.text(text);
        }
    }
}

/// The payload that stands for all records so far.
pub(super) fn encode_picture(log: &Log) -> Vec<u8> {
    let mut payload = Vec::new();
    let out = &mut Out(&mut payload);
    out.u8(kind::PICTURE);
    put_accepted(out, &log.accepted);
    out.state(log.state);
    out.u8(u8::from(log.opened.is_some()));
    if let Some((port, baud, at_unix_s)) = &log.opened {
        out.text(port);
        out.u32(*baud);
        out.u64(*at_unix_s);
    }
    out.u32(log.starts);
    put_numbers(out, &log.numbers);
    put_checkpoint(out, &log.checkpoint);
    out.u8(u8::from(log.made_safe.is_some()));
    if let Some(z_mm) = log.made_safe {
        out.height(z_mm);
    }
    out.u32(log.depth);
    out.u8(u8::from(log.note.is_some()));
    if let Some(note) = &log.note {
        out.text(note);
    }
    out.u8(u8::from(log.damaged));
    payload
}

/// The picture that a payload is; zeros may follow it.
pub(super) fn decode_picture(payload: &[u8]) -> Option<Log> {
    let mut input = In(payload);
    let log = (input.u8()? == kind::PICTURE).then(|| picture(&mut input))??;
    input.0.iter().all(|byte| *byte == 0).then_some(log)
}

/// The records that a payload consists of; `None` if anything in it is none of ours.
pub(super) fn decode(payload: &[u8]) -> Option<Vec<Record>> {
    let mut input = In(payload);
    let mut records = Vec::new();
    while !input.0.is_empty() {
        let kind = input.u8()?;
        records.push(record(kind, &mut input)?);
    }
    Some(records)
}

fn record(kind: u8, input: &mut In) -> Option<Record> {
    Some(match kind {
        kind::OPENED => Record::Opened { port: input.text()?, baud: input.u32()?, at_unix_s: input.u64()? },
        kind::STATE => Record::State(input.state()?),
        kind::NUMBERS => Record::Numbers { first: input.u32()?, after: input.u64()? },
        kind::OWN => Record::Own { n: input.u32()? },
        kind::UNNUMBERED => Record::Unnumbered { after: input.u64()? },
        kind::CHECKPOINT => Record::Checkpoint(checkpoint(input)?),
        kind::MADE_SAFE => Record::MadeSafe { z_mm: input.height()? },
        kind::DEPTH => Record::Depth(input.u32()?),
        kind::NOTE => Record::Note(input.text()?),
        _ => return None,
    })
}

fn picture(input: &mut In) -> Option<Log> {
    let mut log = Log::new(accepted(input)?);
    log.state = input.state()?;
    if input.flag()? {
        log.opened = Some((input.text()?, input.u32()?, input.u64()?));
    }
    log.starts = input.u32()?;
    log.numbers = numbers(input)?;
    log.checkpoint = checkpoint(input)?;
    if input.flag()? {
        log.made_safe = Some(input.height()?);
    }
    log.depth = input.u32()?;
    if input.flag()? {
        log.note = Some(input.text()?);
    }
    log.damaged = input.flag()?;
    Some(log)
}

fn put_accepted(out: &mut Out, accepted: &Accepted) {
    out.bytes(accepted.path.as_os_str().as_bytes());
    out.0.extend_from_slice(&accepted.digest);
    out.u64(accepted.bytes);
    out.u64(accepted.commands);
    out.u64(accepted.last_line);
    out.u32(accepted.chunk_bytes);
    let chunks = &accepted.chunks[..accepted.chunks.len().min(MAX_CHUNKS)];
    out.u32(chunks.len() as u32);
    for chunk in chunks {
        out.0.extend_from_slice(chunk);
    }
    out.text(&accepted.profile);
    out.u64(accepted.at_unix_s);
    out.u64(accepted.stamp);
}

fn accepted(input: &mut In) -> Option<Accepted> {
    let path = PathBuf::from(OsStr::from_bytes(input.bytes()?));
    let digest = input.array()?;
    let (bytes, commands, last_line) = (input.u64()?, input.u64()?, input.u64()?);
    let chunk_bytes = input.u32()?;
    let count = input.count(MAX_CHUNKS)?;
    let chunks = input.take(count * 16)?.as_chunks::<16>().0.to_vec();
    let profile = input.text()?;
    let (at_unix_s, stamp) = (input.u64()?, input.u64()?);
    Some(Accepted {
        path,
        digest,
        bytes,
        commands,
        last_line,
        chunk_bytes,
        chunks,
        profile,
        at_unix_s,
        stamp,
    })
}

fn put_checkpoint(out: &mut Out, checkpoint: &Checkpoint) {
    out.u64(checkpoint.commands);
    out.u64(checkpoint.line);
    out.u32(checkpoint.layer);
    out.f64(checkpoint.z_mm);
    for heater in [checkpoint.nozzle_c, checkpoint.bed_c] {
        out.f32(heater[0]);
        out.f32(heater[1]);
    }
}

fn checkpoint(input: &mut In) -> Option<Checkpoint> {
    Some(Checkpoint {
        commands: input.u64()?,
        line: input.u64()?,
        layer: input.u32()?,
        z_mm: input.f64()?,
        nozzle_c: [input.f32()?, input.f32()?],
        bed_c: [input.f32()?, input.f32()?],
    })
}

/// The numbers that are not the file's go as runs: a long wait asks the printer again
/// and again, and nothing of the file lies between.
fn put_numbers(out: &mut Out, numbers: &Numbers) {
    match numbers {
        Numbers::Nothing { after } => {
            out.u8(0);
            out.u64(*after);
        }
        Numbers::Job { first, after, own } => {
            out.u8(1);
            out.u32(*first);
            out.u64(*after);
            let runs = own.chunk_by(|a, b| a.checked_add(1) == Some(*b));
            out.u32(runs.clone().count() as u32);
            for run in runs {
                out.u32(run[0]);
                out.u32(run.len() as u32);
            }
        }
    }
}

fn numbers(input: &mut In) -> Option<Numbers> {
    if !input.flag()? {
        return Some(Numbers::Nothing { after: input.u64()? });
    }
    let (first, after) = (input.u32()?, input.u64()?);
    let mut own: Vec<u32> = Vec::new();
    for _ in 0..input.count(MAX_OWN)? {
        let (from, len) = (input.u32()?, input.u32()?);
        let room = MAX_OWN.checked_sub(own.len())?;
        let ascends = own.last().is_none_or(|last| from > *last);
        if !ascends || len == 0 || len as usize > room {
            return None;
        }
        own.extend(from..=from.checked_add(len - 1)?);
    }
    Some(Numbers::Job { first, after, own })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn encoded(record: &Record) -> Vec<u8> {
        let mut payload = Vec::new();
        encode(record, &mut payload);
        payload
    }

    #[test]
    fn every_state_has_its_own_number() {
        for n in 0..=u8::MAX {
            let state = state(n);
            assert_eq!(state.is_some(), (1..=17).contains(&n), "{n}");
            assert!(state.is_none_or(|state| number(state) == n), "{n}");
        }
    }

    #[test]
    fn what_is_none_of_ours_is_refused() {
        let check = |payload: &[u8]| assert_eq!(decode(payload), None, "{payload:?}");
        check(&[0]);
        check(&[77, 1, 2, 3]);
        check(&[kind::PICTURE]);
        check(&[kind::STATE]);
        check(&[kind::STATE, 0]);
        check(&[kind::STATE, 18]);
        check(&[kind::STATE, 1, 1]);
        check(&[kind::OWN, 1, 2, 3]);
        check(&[kind::NOTE, 2, 0, 0, 0, 0xc3, 0x28]);
        check(&[kind::NOTE, 255, 255, 255, 255]);
        check(&[kind::MADE_SAFE, 2, 0, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(decode_picture(&[kind::PICTURE]), None);
        assert_eq!(decode_picture(&encoded(&Record::Own { n: 1 })), None);
    }

    #[test]
    fn a_long_text_is_cut_between_characters() {
        let check = |text: String, expect: usize| {
            let records = decode(&encoded(&Record::Note(text.clone()))).unwrap();
            assert_eq!(records, [Record::Note(text[..expect].to_owned())]);
        };
        check("ü".repeat(4000), MAX_TEXT_BYTES);
        check(format!("x{}", "ü".repeat(4000)), MAX_TEXT_BYTES - 1);
        check(String::new(), 0);
    }
}
