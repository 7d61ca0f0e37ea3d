//! The daemon: `outrigger serve`.
//!
//! Takes a configuration and a data folder; serves the page, our own API and those that slicers
//! and apps speak, looks at every upload before it prints, queues, prints, and tells what happens.
//!
//! # Layout
//! - [`daemon`]: puts it together and takes it down; [`config`], [`systemd`], [`discovery`]
//! - [`foreman`]: alone decides what becomes of files and jobs; [`shelf`]: where they lie;
//!   [`inspect`]: looks at them and mends them, in processes of their own
//! - [`actor`]: a printer's thread
//! - [`http`]: sockets; [`gate`], [`asker`], [`again`], [`upload`], [`problem`]: what requests have
//!   in common; [`auth`] (the rules of who may what) and [`auth_desk`] (their disk and clock)
//! - [`octoprint`], [`prusalink`], [`moonraker`]: what slicers and apps speak
//! - [`api`]: our own routes; [`page`]: the page's files; [`metrics`]
//!
//! # Threads
//! The network's side never waits for a disk or a printer. The foreman waits for disks, the actors
//! for printers; each printer has a thread of its own.
pub(crate) mod actor;
pub(crate) mod again;
pub(crate) mod api;
pub(crate) mod app;
pub(crate) mod asker;
pub(crate) mod auth;
pub(crate) mod auth_desk;
pub(crate) mod config;
pub(crate) mod daemon;
pub(crate) mod discovery;
pub(crate) mod foreman;
pub(crate) mod gate;
pub(crate) mod http;
pub(crate) mod inspect;
pub(crate) mod metrics;
pub(crate) mod model;
pub(crate) mod moonraker;
pub(crate) mod octoprint;
pub(crate) mod page;
pub(crate) mod problem;
pub(crate) mod prusalink;
pub(crate) mod shelf;
pub(crate) mod systemd;
pub(crate) mod upload;
