//! What a printer wants of its host or of a person: action commands and prompts.
//!
//! Takes what follows `//action:`, gives an [`Action`], or the steps of a
//! [`Prompt`] put together. Texts come as the printer said them, cut to a bound,
//! and must be escaped before they are shown. Does not know who answers.

/// Longest text of a prompt or an action kept, in bytes: a display's few lines.
pub const MAX_TEXT: usize = 256;

/// Buttons kept of a prompt; Marlin's own prompts have at most three.
pub const MAX_CHOICES: usize = 10;

/// What an action command asks of the host.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Action {
    /// `pause`: the host is to pause.
    Pause,
    /// `paused`: the printer has paused by itself.
    Paused,
    /// `resume`: the host is to go on.
    Resume,
    /// `resumed`: the printer goes on by itself.
    Resumed,
    /// `cancel`: the job is to end.
    Cancel,
    /// `out_of_filament T0`, `filament_runout`, or a note that says so.
    OutOfFilament {
        /// The extruder, where the printer names it.
        extruder: Option<u8>,
    },
    /// `notification …`: a text for the user.
    Notification(String),
    /// Any other.
    Other(String),
}

/// A question with buttons, as Marlin's `HOST_PROMPT_SUPPORT` puts it.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Prompt {
    /// What is asked.
    pub text: String,
    /// The buttons; the answer is the place of one of them, from 0.
    pub choices: Vec<String>,
}

/// What an action command means to the session.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Step {
    /// To be told as it is.
    Act(Action),
    /// A prompt is to be shown, or taken away.
    Show(Option<Prompt>),
    /// Part of a prompt that is not to be shown yet.
    Nothing,
}

/// Puts the prompt's parts together.
#[derive(Debug, Default)]
pub(super) struct Prompts {
    open: Prompt,
    shown: bool,
}

impl Prompts {
    /// Takes what follows `//action:`.
    pub(super) fn take(&mut self, action: &[u8]) -> Step {
        let (word, rest) = split(action);
        match word {
            b"prompt_begin" => {
                self.open = Prompt { text: text(rest), choices: Vec::new() };
                // A new question takes the place of one that is open.
                match std::mem::take(&mut self.shown) {
                    true => Step::Show(None),
                    false => Step::Nothing,
                }
            }
            b"prompt_text" => {
                self.open.text = text(&[self.open.text.as_bytes(), b" ", rest].concat());
                Step::Nothing
            }
            b"prompt_choice" | b"prompt_button" => {
                if self.open.choices.len() < MAX_CHOICES {
                    self.open.choices.push(text(rest));
                }
                Step::Nothing
            }
            b"prompt_show" => {
                self.shown = true;
                Step::Show(Some(self.open.clone()))
            }
            b"prompt_end" => {
                self.open = Prompt::default();
                match std::mem::take(&mut self.shown) {
                    true => Step::Show(None),
                    false => Step::Nothing,
                }
            }
            _ => Step::Act(action_of(word, rest, action)),
        }
    }

    /// Whether a question is open.
    pub(super) fn is_open(&self) -> bool {
        self.shown
    }

    /// The question was answered or the printer started anew; whether one was open.
    pub(super) fn close(&mut self) -> bool {
        self.open = Prompt::default();
        std::mem::take(&mut self.shown)
    }
}

fn action_of(word: &[u8], rest: &[u8], whole: &[u8]) -> Action {
    match word {
        b"pause" => Action::Pause,
        b"paused" => Action::Paused,
        b"resume" => Action::Resume,
        b"resumed" => Action::Resumed,
        b"cancel" => Action::Cancel,
        b"out_of_filament" | b"filament_runout" | b"filament_out" => {
            Action::OutOfFilament { extruder: extruder(rest) }
        }
        b"notification" => Action::Notification(text(rest)),
        _ => Action::Other(text(whole)),
    }
}

/// Whether a note says that the filament has run out.
pub(super) fn says_runout(note: &[u8]) -> bool {
    const STARTS: [&[u8]; 4] = [b"filament runout", b"filament run out", b"filament out", b"out of filament"];
    STARTS.iter().any(|start| note.len() >= start.len() && note[..start.len()].eq_ignore_ascii_case(start))
}

/// `T0` → 0.
fn extruder(rest: &[u8]) -> Option<u8> {
    match rest {
        [b'T' | b't', n @ b'0'..=b'9'] => Some(n - b'0'),
        _ => None,
    }
}

fn split(action: &[u8]) -> (&[u8], &[u8]) {
    let action = action.trim_ascii();
    let end = action.iter().position(u8::is_ascii_whitespace).unwrap_or(action.len());
    (&action[..end], action[end..].trim_ascii())
}

/// The printer's bytes as text, cut to [`MAX_TEXT`].
fn text(bytes: &[u8]) -> String {
    let mut text = String::from_utf8_lossy(&bytes[..bytes.len().min(MAX_TEXT)]).into_owned();
    // A character that the cut has split became a longer mark.
    while text.len() > MAX_TEXT {
        text.pop();
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn actions() {
        let check = |said: &str, expect| {
            assert_eq!(Prompts::default().take(said.as_bytes()), Step::Act(expect), "{said}");
        };
        check("pause", Action::Pause);
        check("paused", Action::Paused);
        check("resume", Action::Resume);
        check("resumed", Action::Resumed);
        check("cancel ", Action::Cancel);
        check("out_of_filament T1", Action::OutOfFilament { extruder: Some(1) });
        check("filament_runout", Action::OutOfFilament { extruder: None });
        check("out_of_filament T99", Action::OutOfFilament { extruder: None });
        check("notification Heating done", Action::Notification("Heating done".into()));
        check("paused_by_magic", Action::Other("paused_by_magic".into()));
        check("", Action::Other(String::new()));
        assert!(says_runout(b"Filament Runout Detected!"));
        assert!(says_runout(b"filament out"));
        assert!(!says_runout(b"Filament"));
        assert!(!says_runout(b"No filament runout"));
    }

    fn steps(said: &[&str]) -> Vec<Step> {
        let mut prompts = Prompts::default();
        said.iter().map(|s| prompts.take(s.as_bytes())).filter(|s| *s != Step::Nothing).collect()
    }

    #[test]
    fn prompts_are_put_together() {
        let question = Prompt { text: "Filament?".into(), choices: vec!["More".into(), "Go on".into()] };
        assert_eq!(
            steps(&[
                "prompt_begin Filament?",
                "prompt_choice More",
                "prompt_button Go on",
                "prompt_show",
                "prompt_end",
                "prompt_end",
            ]),
            [Step::Show(Some(question)), Step::Show(None)],
        );
        // A second question closes the first.
        assert_eq!(steps(&["prompt_begin A", "prompt_show", "prompt_begin B"]).len(), 2);
    }

    #[test]
    fn prompts_are_bounded() {
        let long = "ä".repeat(1000);
        let mut said = vec![format!("prompt_begin {long}")];
        said.extend((0..100).map(|_| format!("prompt_button {long}")));
        said.push(format!("prompt_text {long}"));
        said.push("prompt_show".into());
        let said: Vec<&str> = said.iter().map(String::as_str).collect();
        let shown = steps(&said);
        let [Step::Show(Some(prompt))] = &shown[..] else { panic!("one prompt: {shown:?}") };
        assert!(prompt.text.len() <= MAX_TEXT);
        assert_eq!(prompt.choices.len(), MAX_CHOICES);
        assert!(prompt.choices.iter().all(|c| c.len() <= MAX_TEXT));
    }
}
