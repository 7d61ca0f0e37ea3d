//! `outrigger user`: who may use the daemon, from the machine's own command line.
//!
//! Writes the data folder's `auth.json`, which a running daemon reads anew.
use crate::server::auth::{Auth, Kept, Name, PasswordHash, Role, Scope, ScopeSet, check_password_length};
use crate::server::shelf::{Shelf, read_text, write_text};
use crate::station::{Folder, now_unix_s};
use anyhow::{Context, bail};
use clap::{Subcommand, ValueEnum};
use std::io::{BufRead, IsTerminal, Read, Write};
use std::path::PathBuf;
use std::process::ExitCode;

/// Longest line that is read as a password, bytes.
const MAX_LINE_BYTES: u64 = 4096;

/// Add, list and remove users and API keys of the daemon
#[derive(clap::Args)]
pub(super) struct Args {
    #[command(subcommand)]
    what: What,
    /// The daemon's data folder; $OUTRIGGER_STATE, $STATE_DIRECTORY, $XDG_STATE_HOME/outrigger or
    /// ~/.local/state/outrigger if not given; of the Debian package /var/lib/outrigger
    #[arg(long, value_name = "DIR", global = true)]
    state: Option<PathBuf>,
}

#[derive(Subcommand)]
enum What {
    /// Add a user; the password is asked for, or read from standard input
    Add {
        /// The user's name
        name: String,
        /// What they may do; the first user is an admin
        #[arg(long, value_enum, default_value_t = AsRole::Operator)]
        role: AsRole,
    },
    /// List users and keys
    List,
    /// Remove a user
    Remove {
        /// The user's name
        name: String,
    },
    /// Give a user another role
    Role {
        /// The user's name
        name: String,
        /// What they may do
        #[arg(value_enum)]
        role: AsRole,
    },
    /// Give a user another password
    Password {
        /// The user's name
        name: String,
    },
    /// Make an API key for a slicer or an app; it is shown this once
    Key {
        /// What it is for
        name: String,
        /// What it may do
        #[arg(long, value_enum, value_delimiter = ',', default_values_t = [AsScope::Read, AsScope::Print, AsScope::Control])]
        scopes: Vec<AsScope>,
    },
    /// Revoke an API key
    Revoke {
        /// The key's id, from `outrigger user list`
        id: String,
    },
}

/// What a user may do
#[derive(Clone, Copy, Debug, ValueEnum)]
enum AsRole {
    /// See everything
    Viewer,
    /// See, print, move and heat
    Operator,
    /// All of it, users and keys too
    Admin,
}

impl From<AsRole> for Role {
    fn from(role: AsRole) -> Self {
        match role {
            AsRole::Viewer => Role::Viewer,
            AsRole::Operator => Role::Operator,
            AsRole::Admin => Role::Admin,
        }
    }
}

/// What a key may do
#[derive(Clone, Copy, Debug, ValueEnum)]
enum AsScope {
    /// See everything
    Read,
    /// Upload, queue, pause, cancel
    Print,
    /// Move, heat, send commands
    Control,
    /// Users, keys, commands while printing
    Admin,
}

impl From<AsScope> for Scope {
    fn from(scope: AsScope) -> Self {
        match scope {
            AsScope::Read => Scope::Read,
            AsScope::Print => Scope::Print,
            AsScope::Control => Scope::Control,
            AsScope::Admin => Scope::Admin,
        }
    }
}

/// Runs the verb.
///
/// # Errors
/// The data folder cannot be used, or what is wanted cannot be.
pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let folder = Folder::open(args.state.as_deref())?;
    let shelf = Shelf::beside(folder.store.path());
    let path = shelf.auth();
    let kept = match read_text(&path)? {
        Some(text) => Kept::from_json(&text).with_context(|| path.display().to_string())?,
        None => Kept::default(),
    };
    let mut auth = Auth::new(kept);
    let now = now_unix_s();
    let mut words = Vec::new();
    match &args.what {
        What::Add { name, role } => {
            let name = Name::new(name)?;
            let role = if auth.needs_first_user() { Role::Admin } else { Role::from(*role) };
            let hash = password()?;
            auth.add_user(name.clone(), role, hash, now)?;
            words.push(format!("user {name} added ({})", role.word()));
        }
        What::List => {
            words.extend(auth.users().map(|u| format!("user {:<24} {}", u.name.to_string(), u.role.word())));
            words.extend(auth.keys().map(|k| {
                let scopes: Vec<_> = k.scopes.iter().map(Scope::word).collect();
                format!("key  {:<24} {}  {}", k.name.to_string(), k.id, scopes.join(","))
            }));
            if words.is_empty() {
                words.push("no user yet: outrigger user add NAME".to_owned());
            }
        }
        What::Remove { name } => {
            auth.remove_user(&Name::new(name)?)?;
            words.push(format!("user {name} removed"));
        }
        What::Role { name, role } => {
            auth.set_role(&Name::new(name)?, Role::from(*role))?;
            words.push(format!("user {name} is {} now", Role::from(*role).word()));
        }
        What::Password { name } => {
            let name = Name::new(name)?;
            if !auth.users().any(|user| user.name == name) {
                bail!("there is no user {name}");
            }
            auth.set_password(&name, password()?)?;
            words.push(format!("password of {name} changed"));
        }
        What::Key { name, scopes } => {
            let scopes: Vec<Scope> = scopes.iter().map(|scope| Scope::from(*scope)).collect();
            let (_, secret) =
                auth.make_key(Name::new(name)?, ScopeSet::of(&scopes), "the command line", now)?;
            words.push(secret.reveal().to_owned());
        }
        What::Revoke { id } => {
            auth.revoke_key(id)?;
            words.push(format!("key {id} revoked"));
        }
    }
    if let Some(kept) = auth.take_change() {
        write_text(&path, &kept.to_json()?)?;
        give_to_owner(&path, folder.store.path());
    }
    super::say(&words.join("\n"));
    Ok(ExitCode::SUCCESS)
}

/// A file that root has written in another's folder is that one's: the daemon must read it.
fn give_to_owner(path: &std::path::Path, folder: &std::path::Path) {
    use std::os::unix::fs::MetadataExt;
    if let (Ok(file), Ok(owner)) = (path.metadata(), folder.metadata())
        && (file.uid(), file.gid()) != (owner.uid(), owner.gid())
    {
        let _ = std::os::unix::fs::chown(path, Some(owner.uid()), Some(owner.gid()));
    }
}

/// Asks for a password without showing it, twice; without a terminal it is a line of standard input.
fn password() -> anyhow::Result<PasswordHash> {
    let text = if std::io::stdin().is_terminal() {
        let one = hidden("Password: ")?;
        check_password_length(&one)?;
        if hidden("Once more: ")? != one {
            bail!("the two are not the same: nothing was changed");
        }
        one
    } else {
        line()?
    };
    Ok(PasswordHash::of(&text)?)
}

fn hidden(ask: &str) -> anyhow::Result<String> {
    use rustix::termios::{LocalModes, OptionalActions, tcgetattr, tcsetattr};
    let terminal = std::io::stdin();
    let shown = tcgetattr(&terminal).context("cannot hide what is typed")?;
    let mut quiet = shown.clone();
    quiet.local_modes.remove(LocalModes::ECHO);
    let mut out = std::io::stderr();
    let _ = write!(out, "{ask}");
    let _ = out.flush();
    tcsetattr(&terminal, OptionalActions::Flush, &quiet).context("cannot hide what is typed")?;
    let read = line();
    tcsetattr(&terminal, OptionalActions::Now, &shown).context("cannot show what is typed again")?;
    let _ = writeln!(out);
    read
}

fn line() -> anyhow::Result<String> {
    let mut text = String::new();
    std::io::stdin().lock().take(MAX_LINE_BYTES).read_line(&mut text).context("cannot read the password")?;
    Ok(text.trim_end_matches(['\r', '\n']).to_owned())
}
