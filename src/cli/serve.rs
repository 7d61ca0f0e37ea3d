//! `outrigger serve`: the daemon.
use crate::causes;
use crate::server::config::{Config, FILE_BYTES_MAX};
use crate::server::daemon::{Daemon, Options};
use anyhow::{Context, bail};
use std::fs::File;
use std::io::{IsTerminal, Read};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::watch;
use tracing_subscriber::filter::LevelFilter;

/// Where the configuration is when none is named.
const USUAL: &str = "/etc/outrigger/outrigger.toml";

/// Run the daemon: page, API, checks, queue and printers
///
/// Without --config it reads outrigger.toml in this folder, else /etc/outrigger/outrigger.toml,
/// else it runs with the defaults and no printer. Before the first user is made
/// (`outrigger user add NAME`, or with the one-time code that it shows) it listens on the
/// loopback only. SIGTERM and Ctrl-C end it in order: a running job is parked, and goes on
/// when the daemon runs again. A wrong configuration is exit status 2.
#[derive(clap::Args)]
pub(super) struct Args {
    /// The configuration, TOML
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Print all keys with their values and what they mean, and end
    #[arg(long)]
    print_config: bool,
    /// The data folder; the configuration's (storage.folder) if not given, else $OUTRIGGER_STATE,
    /// $STATE_DIRECTORY (systemd), $XDG_STATE_HOME/outrigger or ~/.local/state/outrigger
    #[arg(long, value_name = "DIR")]
    state: Option<PathBuf>,
    /// Listen here instead of where the configuration says; may be given again
    #[arg(long, value_name = "ADDRESS:PORT")]
    listen: Vec<SocketAddr>,
    /// Start no guardian beside each job (see `outrigger guard`): one for all runs by itself
    #[arg(long)]
    no_guard: bool,
}

/// Runs the verb.
///
/// # Errors
/// The configuration is wrong, the data folder cannot be used, or no address be listened on.
pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let mut config = match read(args.config.as_deref()) {
        Ok(config) => config,
        Err(why) => {
            // Trying again changes nothing: supervisors tell this status from others.
            eprintln!("outrigger: {}", causes::line(&why));
            return Ok(ExitCode::from(2));
        }
    };
    if !args.listen.is_empty() {
        config.server.listen.clone_from(&args.listen);
    }
    if args.print_config {
        super::say(config.explain().trim_end());
        return Ok(ExitCode::SUCCESS);
    }
    lean();
    log(&config.log.level);
    let options = Options { folder: args.state.clone(), guards: !args.no_guard, speed: None };
    serve(config, &options, |_| {})?;
    Ok(ExitCode::SUCCESS)
}

/// Settings of the C library's allocator: few arenas, and what is large goes back to the system at
/// once. By itself it keeps what a password's hash has taken (19 MB, on each thread that ever
/// looked at one) for the rest of the daemon's life.
const LEAN: [(&str, &str); 3] =
    [("MALLOC_ARENA_MAX", "2"), ("MALLOC_MMAP_THRESHOLD_", "131072"), ("MALLOC_TRIM_THRESHOLD_", "131072")];

/// Begins this program once more with [`LEAN`], in the same process, unless that was done: the
/// allocator reads its settings before anything of ours runs. Where that is not possible it goes on as
/// it is.
fn lean() {
    use std::os::unix::process::CommandExt;
    if LEAN.iter().any(|(name, _)| std::env::var_os(name).is_some()) {
        return;
    }
    let mut again = std::process::Command::new(crate::station::guardian::program());
    again.args(std::env::args_os().skip(1)).envs(LEAN);
    if let Some(name) = std::env::args_os().next() {
        again.arg0(name);
    }
    // It returns only if it fails.
    let _ = again.exec();
}

/// The configuration that is named, or the usual one, or the defaults.
fn read(named: Option<&Path>) -> anyhow::Result<Config> {
    let usual = [Path::new("outrigger.toml"), Path::new(USUAL)];
    let Some(path) = named.or_else(|| usual.into_iter().find(|path| path.exists())) else {
        return Ok(Config::default());
    };
    let told = || path.display().to_string();
    let mut text = String::new();
    File::open(path).and_then(|f| f.take(FILE_BYTES_MAX + 1).read_to_string(&mut text)).with_context(told)?;
    if text.len() as u64 > FILE_BYTES_MAX {
        bail!("{}: larger than {FILE_BYTES_MAX} bytes, so it is no configuration", path.display());
    }
    Config::parse(&text).with_context(told)
}

/// The log goes to standard error: with times for people, without them for journald, which has its
/// own.
pub(super) fn log(level: &str) {
    let level: LevelFilter = level.parse().unwrap_or(LevelFilter::INFO);
    let journald = std::env::var_os("JOURNAL_STREAM").is_some();
    let log = tracing_subscriber::fmt()
        .with_max_level(level)
        .with_writer(std::io::stderr)
        .with_target(false)
        .with_ansi(std::io::stderr().is_terminal());
    // A second one in the same process (tests) is none.
    let _ = match journald {
        true => log.without_time().try_init(),
        false => log.try_init(),
    };
}

/// Runs a daemon until a signal ends it; `listening` hears where it can be reached.
///
/// # Errors
/// As [`run`].
pub(super) fn serve(
    config: Config,
    options: &Options,
    mut listening: impl FnMut(&str),
) -> anyhow::Result<()> {
    let runtime = super::print::runtime()?;
    runtime.block_on(async {
        let (end, stop) = watch::channel(false);
        signals(end).context("cannot wait for signals")?;
        let daemon = Daemon::start(config, options)?;
        daemon
            .run(stop, |addresses, encrypted| {
                let scheme = if encrypted { "https" } else { "http" };
                for address in addresses {
                    tracing::info!("listening on {scheme}://{address}/");
                }
                if let Some(first) = addresses.first() {
                    listening(&format!("{scheme}://{first}/"));
                }
            })
            .await
    })?;
    // Threads that read a printer's silence are not waited for.
    runtime.shutdown_background();
    Ok(())
}

fn signals(end: watch::Sender<bool>) -> std::io::Result<()> {
    let mut interrupt = signal(SignalKind::interrupt())?;
    let mut terminate = signal(SignalKind::terminate())?;
    let mut hang_up = signal(SignalKind::hangup())?;
    tokio::spawn(async move {
        let mut asked = false;
        loop {
            tokio::select! {
                _ = interrupt.recv() => {}
                _ = terminate.recv() => {}
                _ = hang_up.recv() => {}
            }
            if asked {
                // Twice is meant: the journal is whole at any moment.
                std::process::exit(1);
            }
            asked = true;
            tracing::info!("ending: a running job is parked first");
            let _ = end.send(true);
        }
    });
    Ok(())
}
