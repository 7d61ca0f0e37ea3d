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

/// What happens to a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Event {
    /// A printer's port was opened for it.
    Start,
    /// The handshake and the start macro are done; the file's first line may go.
    Ready,
    /// The user wants a pause.
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
