//! The states of a job and the one function that leads from one to the next.
//!
//! Takes a state and an event, gives a decision for every pair. Knows no printer, no
//! file and no clock.

/// Where a job is in its life.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum State {
    /// Accepted: checked, its digest known, nothing of it sent.
    Accepted,
    /// The port is open: handshake, then the start macro; nothing of the file sent.
    Starting,
    /// Lines of the file go out.
    Printing,
    /// A pause is wanted: what was sent is awaited, then the pause macro runs.
    Pausing,
    /// Parked, heaters as they were; a person decides.
    Paused,
    /// The head goes back to where it was.
    Resuming,
    /// The printer itself waits for a person (M0, M600, a prompt).
    Asking,
    /// The port is gone; the printer may go on with what it has.
    Lost,
    /// The port is back, or the host after its death: the printer is asked where it is.
    TakingOver,
    /// After the printer lost its state: a person has confirmed, the way back runs.
    Recovering,
    /// The last line of the file was printed; the end macro runs.
    Ending,
    /// Cancelled: what was sent is awaited, then the cancel macro runs.
    Cancelling,
    /// Failed: the cancel macro runs over what is left of the link.
    Failing,
    /// Broken off with the part on the bed: a person resumes or forgets it.
    Interrupted,
    /// Printed to its end.
    Finished,
    /// Ended by the user.
    Cancelled,
    /// Ended by a fault after which it cannot be resumed.
    Failed,
}

impl State {
    /// Every state, in the order of a job's life.
    pub const ALL: [State; 17] = [
        State::Accepted,
        State::Starting,
        State::Printing,
        State::Pausing,
        State::Paused,
        State::Resuming,
        State::Asking,
        State::Lost,
        State::TakingOver,
        State::Recovering,
        State::Ending,
        State::Cancelling,
        State::Failing,
        State::Interrupted,
        State::Finished,
        State::Cancelled,
        State::Failed,
    ];

    /// Nothing follows but being forgotten.
    pub fn is_over(self) -> bool {
        matches!(self, State::Finished | State::Cancelled | State::Failed)
    }

    /// A host has the printer's port, or had it when it died: heaters may be on.
    pub fn is_active(self) -> bool {
        !self.is_over() && !matches!(self, State::Accepted | State::Interrupted)
    }

    /// For people, after "the job is".
    pub fn words(self) -> &'static str {
        match self {
            State::Accepted => "waiting to be printed",
            State::Starting => "getting ready",
            State::Printing => "printing",
            State::Pausing => "pausing",
            State::Paused => "paused",
            State::Resuming => "going back to where it paused",
            State::Asking => "waiting for you at the printer",
            State::Lost => "waiting for the printer to come back",
            State::TakingOver => "asking the printer where it is",
            State::Recovering => "on the way back to where it broke off",
            State::Ending => "printed, the end macro runs",
            State::Cancelling => "being cancelled",
            State::Failing => "being made safe after a failure",
            State::Interrupted => "broken off, with the part on the bed",
            State::Finished => "finished",
            State::Cancelled => "cancelled",
            State::Failed => "failed",
        }
    }
}

/// What happens to a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Event {
    /// A printer's port was opened for it.
    Start,
    /// The handshake and the start macro are done; the file's first line may go.
    Ready,
    /// The user (or the printer) wants a pause; where it is not possible yet but will be,
    /// it is noted and nothing changes.
    Pause,
    /// Parked: the pause macro has run.
    Parked,
    /// The user wants it to go on.
    Resume,
    /// The head is back and the modes are as they were.
    Restored,
    /// The printer waits for a person.
    Asked,
    /// The printer goes on.
    Answered,
    /// The file's last line was printed.
    Exhausted,
    /// The end macro has run.
    Ended,
    /// The user wants it to end.
    Cancel,
    /// The cancel macro has run, or could not.
    Safe,
    /// It cannot go on; the link may still work.
    Fail,
    /// What is left cannot be resumed: nothing was printed, or the file has changed.
    Spoil,
    /// The port is gone.
    LinkLost,
    /// The port is open again.
    LinkBack,
    /// The host that printed it is dead; another found this in the journal and opened the port.
    TakeUp,
    /// The printer has kept its state and says where it is.
    TakenOver,
    /// The printer has lost its state (reset, power).
    Reset,
    /// Where the printer is cannot be known.
    Unknown,
    /// A person has confirmed that part and nozzle are clear.
    Confirm,
    /// An emergency stop was wanted.
    EmergencyStop,
    /// The user wants to hear no more of it.
    Forget,
}

/// What an event does in a state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Decision {
    /// The job is now in this state.
    To(State),
    /// Nothing changes.
    Stay,
    /// It cannot be, and why; told to the user who wanted it.
    Refuse(&'static str),
}

impl Event {
    /// Every event.
    pub const ALL: [Event; 23] = [
        Event::Start,
        Event::Ready,
        Event::Pause,
        Event::Parked,
        Event::Resume,
        Event::Restored,
        Event::Asked,
        Event::Answered,
        Event::Exhausted,
        Event::Ended,
        Event::Cancel,
        Event::Safe,
        Event::Fail,
        Event::Spoil,
        Event::LinkLost,
        Event::LinkBack,
        Event::TakeUp,
        Event::TakenOver,
        Event::Reset,
        Event::Unknown,
        Event::Confirm,
        Event::EmergencyStop,
        Event::Forget,
    ];
}

const IT_IS_OVER: &str = "the job is over";
const NOT_BEGUN: &str = "nothing of the job was sent yet";
const RUNS: &str = "the job is being printed";
const BROKEN_OFF: &str = "the job was broken off: resume or forget it";
const BEING_ENDED: &str = "the job is already being ended";
const AT_ITS_END: &str = "the file is printed to its end";
const NOT_PAUSED: &str = "the job is not paused";
const ASKS_ALREADY: &str = "the printer waits for you already";
const OUT_OF_REACH: &str = "the printer does not answer: it is asked again when it is back";
const NOTHING_TO_CONFIRM: &str = "there is nothing to confirm";

/// What an event does in a state. Total: every pair is decided, and the table in
/// `docs/job-states.md` says the same.
pub fn next(state: State, event: Event) -> Decision {
    use State::*;
    match event {
        Event::Start
        | Event::TakeUp
        | Event::Pause
        | Event::Resume
        | Event::Cancel
        | Event::Confirm
        | Event::EmergencyStop
        | Event::Forget => wanted(state, event),
        Event::Fail
        | Event::Spoil
        | Event::Safe
        | Event::LinkLost
        | Event::LinkBack
        | Event::Reset
        | Event::Unknown => gone_wrong(state, event),
        // What the printer comes to in the course of a job. After the way back into
        // it each leads on from there too.
        Event::Ready => step(state, Starting, Printing),
        Event::Parked => step(state, Pausing, Paused),
        Event::Restored if state == Recovering => Decision::To(Printing),
        Event::Restored => step(state, Resuming, Printing),
        // A pause that was on its way waits behind the printer's own.
        Event::Asked if state == Pausing => Decision::To(Asking),
        Event::Asked => step(state, Printing, Asking),
        Event::Answered if state == TakingOver => Decision::Stay,
        Event::Answered => step(state, Asking, Printing),
        // The file's last lines may wait behind the one that asks.
        Event::Exhausted if state == Asking => Decision::To(Ending),
        Event::Exhausted => step(state, Printing, Ending),
        Event::Ended => step(state, Ending, Finished),
        Event::TakenOver => step(state, TakingOver, Printing),
    }
}

fn step(state: State, from: State, to: State) -> Decision {
    match state == from || state == State::TakingOver {
        true => Decision::To(to),
        false => Decision::Stay,
    }
}

/// What people and other hosts want.
fn wanted(state: State, event: Event) -> Decision {
    use Decision::{Refuse, Stay, To};
    use State::*;
    match (event, state) {
        (_, Finished | Cancelled | Failed) => match event {
            Event::Forget => Stay,
            _ => Refuse(IT_IS_OVER),
        },

        (Event::Start, Accepted | TakingOver) => To(Starting),
        (Event::Start | Event::Cancel | Event::Pause | Event::Resume, Interrupted) => Refuse(BROKEN_OFF),
        (Event::Start, _) => Refuse(RUNS),

        (Event::TakeUp, Accepted) => Refuse(NOT_BEGUN),
        (Event::TakeUp, _) => To(TakingOver),

        (Event::Pause | Event::Resume | Event::EmergencyStop, Accepted) => Refuse(NOT_BEGUN),
        (Event::Pause, Printing) => To(Pausing),
        (Event::Pause, Starting | Pausing | Paused | Resuming | Lost | TakingOver | Recovering) => Stay,
        (Event::Pause, Asking) => Refuse(ASKS_ALREADY),
        (Event::Pause, Ending) => Refuse(AT_ITS_END),
        (Event::Pause | Event::Resume, Cancelling | Failing) => Refuse(BEING_ENDED),

        (Event::Resume, Paused) => To(Resuming),
        // A pause that was noted is dropped; the printer's own question is answered.
        (Event::Resume, Starting | Pausing | Resuming | Asking | Recovering) => Stay,
        (Event::Resume, Lost | TakingOver) => Refuse(OUT_OF_REACH),
        (Event::Resume, Printing | Ending) => Refuse(NOT_PAUSED),

        (Event::Cancel, Accepted) => To(Cancelled),
        (Event::Cancel, Cancelling) => Stay,
        (Event::Cancel, Failing) => Refuse(BEING_ENDED),
        (Event::Cancel, _) => To(Cancelling),

        (Event::Confirm, Interrupted) => To(Recovering),
        (Event::Confirm, _) => Refuse(NOTHING_TO_CONFIRM),

        // Nothing of the file is on the bed.
        (Event::EmergencyStop, Starting) => To(Failed),
        (Event::EmergencyStop, Cancelling) => To(Cancelled),
        (Event::EmergencyStop, Interrupted) => Stay,
        (Event::EmergencyStop, _) => To(Interrupted),

        (Event::Forget, Accepted | Interrupted) => Stay,
        (Event::Forget, _) => Refuse(RUNS),

        // The caller sends no other event here.
        (_, _) => Stay,
    }
}

/// What goes wrong, and what follows it.
fn gone_wrong(state: State, event: Event) -> Decision {
    use Decision::{Stay, To};
    use State::*;
    match (event, state) {
        (_, Finished | Cancelled | Failed) => Stay,

        (Event::Fail | Event::Spoil, Accepted) => To(Failed),
        (Event::Fail, Lost) => To(Interrupted),
        (Event::Fail, Cancelling | Failing | Interrupted) => Stay,
        (Event::Fail, _) => To(Failing),

        (Event::Spoil, Starting | Failing | Interrupted) => To(Failed),
        (Event::Spoil, _) => Stay,

        (Event::Safe, Cancelling) => To(Cancelled),
        (Event::Safe, Failing | TakingOver) => To(Interrupted),
        (Event::Safe, _) => Stay,

        // While it is made safe the end follows, with or without the link.
        (Event::LinkLost, Accepted | Lost | Cancelling | Failing | Interrupted) => Stay,
        (Event::LinkLost, _) => To(Lost),

        (Event::LinkBack, Lost) => To(TakingOver),
        (Event::LinkBack, _) => Stay,

        (Event::Reset, Accepted | Interrupted) => Stay,
        (Event::Reset, Starting) => To(Failed),
        (Event::Reset, Cancelling) => To(Cancelled),
        (Event::Reset, _) => To(Interrupted),

        // What cannot be known is made safe.
        (Event::Unknown, TakingOver) => To(Failing),
        (_, _) => Stay,
    }
}

#[cfg(test)]
mod tests;
