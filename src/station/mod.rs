//! A printer at its place: what the verbs in the foreground and the daemon both need of it.
//!
//! Takes a file, a profile and the folder of the jobs' records; gives a [`Job`] that was checked
//! and can be sent, a host's settings as plain values, and words for what happens. Knows no
//! terminal, no flag and no network.
//!
//! # Layout
//! - [`job`]: a file that was checked and can be sent · [`marks`]: layers and times that it tells of
//!   itself · [`pace`]: how long the rest takes
//! - [`resin`]: what a resin job becomes on a printer · [`screen`]: a thread that shows its pictures ·
//!   [`plate`]: its lines, and what they wait for · [`display`]: where pictures go
//! - [`settings`]: what a host needs of a profile
//! - [`realtime`]: a thread that must not be late
//! - [`watchdog`]: who switches a light off when we are dead
//! - [`folder`]: no job is printed over another's part · [`guardian`]: who acts when we are dead
//! - [`news`], [`cases`], [`escape`]: what happens, in plain words
pub(crate) mod cases;
pub(crate) mod display;
pub(crate) mod escape;
pub(crate) mod folder;
pub(crate) mod guardian;
pub(crate) mod job;
pub(crate) mod marks;
pub(crate) mod news;
pub(crate) mod pace;
pub(crate) mod plate;
pub(crate) mod realtime;
pub(crate) mod resin;
pub(crate) mod screen;
pub(crate) mod settings;
pub(crate) mod watchdog;

pub(crate) use folder::{Folder, lasting_name, lasting_port};
pub(crate) use job::{Job, now_unix_s};
