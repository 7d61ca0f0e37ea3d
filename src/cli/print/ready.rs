//! What a person is to see to before a print, asked where somebody can answer.
use crate::cli::say;
use crate::profile::Profile;
use crate::station::settings;
use anyhow::{Context, bail};
use std::io::{BufRead, IsTerminal};

/// Asks for what the profile wants; `said`: it has been said already.
///
/// # Errors
/// Nobody can be asked, or the answer is no.
pub(super) fn ask(profile: &Profile, said: bool) -> anyhow::Result<()> {
    let asks = settings::asks(profile);
    if said || asks.is_empty() {
        return Ok(());
    }
    let list: String = asks.iter().map(|what| format!("\n  - {what}")).collect();
    if !std::io::stdin().is_terminal() {
        bail!("before a print on {} it must be so that:{list}\nSay --ready once it is", profile.name);
    }
    say(&format!("Before the plate moves, see to it that:{list}\nIs it so? [y/N]"));
    let mut answer = String::new();
    std::io::stdin().lock().read_line(&mut answer).context("cannot read the answer")?;
    match answer.trim().to_ascii_lowercase().as_str() {
        "y" | "yes" => Ok(()),
        _ => bail!("nothing was moved"),
    }
}
