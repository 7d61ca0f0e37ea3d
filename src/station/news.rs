//! What happens to a running job, in plain words.
//!
//! Takes states and events, gives lines for a person. The printer's own texts are
//! escaped here.
use crate::job::state::State;
use crate::printer::action::{Action, Prompt};
use crate::printer::session::{Ending, Safety, StoppedBy, Waiting};
use crate::station::escape::printable;

/// A state in words, where it is news to the user. How a job ends is the verdict's matter.
pub(crate) fn state(state: State) -> Option<&'static str> {
    Some(match state {
        State::Printing => "printing",
        State::Pausing => "pausing: waiting for what the printer has, then it is parked",
        State::Paused => "paused: parked, heaters as they were; waiting for you",
        State::Resuming => "resuming: going back to where it was",
        State::Asking => "waiting for you at the printer; resume when it is done",
        State::Lost => "the connection is lost: waiting for the printer's port to come back",
        State::TakingOver => "asking the printer where it is",
        State::Recovering => "going back to where the print broke off",
        State::Ending => "the last line is sent: waiting for the last moves",
        State::Interrupted => "broken off, with the part on the bed",
        State::Accepted
        | State::Starting
        | State::Cancelling
        | State::Failing
        | State::Finished
        | State::Cancelled
        | State::Failed => return None,
    })
}

/// A question of the printer with its buttons, or that it is over.
pub(crate) fn prompt(prompt: Option<&Prompt>) -> String {
    let Some(prompt) = prompt else { return "the printer's question is answered".to_owned() };
    let mut words = format!("the printer asks: {}", printable(&prompt.text));
    for (at, choice) in prompt.choices.iter().enumerate() {
        words += &format!("  [{at}] {}", printable(choice));
    }
    words
}

/// What the printer waits for.
pub(crate) fn waiting(waiting: Option<Waiting>) -> &'static str {
    match waiting {
        Some(Waiting::Command | Waiting::User) => "the printer waits for you: see its display",
        Some(Waiting::Input) => "the printer waits for an answer: see its display",
        None => "the printer goes on",
    }
}

/// What the printer wants of its host.
pub(crate) fn action(action: &Action) -> String {
    match action {
        Action::Pause => "the printer wants a pause".to_owned(),
        Action::Paused => "the printer has paused".to_owned(),
        Action::Resume => "the printer wants to go on".to_owned(),
        Action::Resumed => "the printer goes on".to_owned(),
        Action::Cancel => "the printer wants the job to end".to_owned(),
        Action::OutOfFilament { extruder: Some(n) } => format!("out of filament (extruder {n})"),
        Action::OutOfFilament { extruder: None } => "out of filament".to_owned(),
        Action::Notification(text) => format!("printer: {}", printable(text)),
        Action::Other(text) => format!("printer: action {}", printable(text)),
    }
}

/// How an emergency stop went.
pub(crate) fn stopped(by: Option<StoppedBy>) -> &'static str {
    match by {
        Some(StoppedBy::Firmware) => "emergency stop: the firmware has halted the printer (M112)",
        Some(StoppedBy::Reset) => {
            "emergency stop: M112 was not obeyed; resetting the board (DTR) has stopped the printer"
        }
        None => {
            "emergency stop: NOTHING CONFIRMS THAT THE PRINTER HAS STOPPED, neither M112 nor a reset: \
             switch it off by hand"
        }
    }
}

/// Why no more is fed, and what comes now.
pub(crate) fn stopping(ending: &Ending) -> String {
    match ending {
        Ending::Cancelled => "cancelling: waiting for what the printer has, then the cancel macro; Ctrl-C \
                              again quits at once and leaves heaters as they are"
            .to_owned(),
        Ending::EmergencyStop => "emergency stop".to_owned(),
        Ending::Failed(why) => {
            format!("stopping: {}; sending the cancel macro", printable(&why.to_string()))
        }
    }
}

/// What the printer's heaters are after a job that ended early.
pub(crate) fn after(safety: Safety) -> &'static str {
    match safety {
        Safety::Untouched => "nothing of it was sent",
        Safety::Acknowledged => {
            "the printer has run the cancel macro: heaters are off, and a resin printer's light"
        }
        Safety::ByFirmware => "the firmware has switched its heaters off",
        Safety::Unknown => {
            "the printer did not confirm the cancel macro: HEATERS (or a resin printer's LIGHT) MAY BE ON, switch it off by hand"
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_printers_texts_are_escaped_and_buttons_numbered() {
        let asked = Prompt { text: "Mo\x1b[2Jre?".to_owned(), choices: vec!["Yes".into(), "N\ro".into()] };
        assert_eq!(prompt(Some(&asked)), "the printer asks: Mo\\u{1b}[2Jre?  [0] Yes  [1] N\\u{d}o");
        for text in [action(&Action::Other("\x07".into())), action(&Action::Notification("\x07".into()))] {
            assert!(!text.contains('\x07'), "{text:?}");
        }
    }
}
