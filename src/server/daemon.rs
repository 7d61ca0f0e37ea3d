//! The daemon: puts the rooms together, runs them, and takes them down again in order.
//!
//! One process: the network's side on this thread's event loop, the foreman and the inspector on a
//! thread each, a thread and an event loop for each printer. Stops gracefully: nothing new is
//! taken, a running job is parked and left in its journal, checks are ended, answers are given.
use super::actor::{self, Actor, board::Board};
use super::app::{App, Station};
use super::auth_desk::AuthDesk;
use super::config::Config;
use super::discovery;
use super::foreman::view::View;
use super::foreman::{Foreman, Means, Message, Wants};
use super::inspect::{Inspector, Work};
use super::shelf::Shelf;
use super::{api, gate, http, metrics, moonraker, octoprint, page, prusalink};
use crate::causes;
use crate::station::Folder;
use anyhow::Context;
use axum::Router;
use axum::extract::{DefaultBodyLimit, Path, Request};
use axum::http::{HeaderValue, Uri};
use axum::middleware::{from_fn_with_state, map_request};
use axum::response::Redirect;
use axum::routing::get;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tokio::sync::watch;

/// Largest body of a request that is no upload, bytes.
const MAX_BODY_BYTES: usize = 1 << 20;

/// Between two looks whether another process has changed users and keys.
const LOOK: Duration = Duration::from_secs(2);

/// A part of the daemon that ends is waited for so long, beside what its job may take to be parked.
const END: Duration = Duration::from_secs(60);

/// How the daemon is to run, beside its configuration.
#[derive(Clone, Debug, Default)]
pub(crate) struct Options {
    /// The data folder; the environment's if not given.
    pub(crate) folder: Option<PathBuf>,
    /// Whether it starts a guardian beside each job.
    pub(crate) guards: bool,
    /// How many times faster than life the printers are: mocks.
    pub(crate) speed: Option<f64>,
}

/// A daemon that runs.
pub(crate) struct Daemon {
    /// What its routes reach.
    pub(crate) app: Arc<App>,
    routes: Router,
    inbox: mpsc::Sender<Message>,
    stop_inspector: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Daemon {
    /// Opens the data folder, starts the printers, the foreman and the inspector.
    ///
    /// # Errors
    /// The folder cannot be used, or the system has no thread left.
    pub(crate) fn start(config: Config, options: &Options) -> anyhow::Result<Self> {
        let started = Instant::now();
        let named = options.folder.as_deref().or(config.storage.folder.as_deref());
        let folder = Folder::open(named).context("the data folder")?;
        let shelf = Shelf::open(folder.store.path()).context("the data folder")?;
        let auth = AuthDesk::open(&shelf.auth()).context("users and keys")?;
        let found = shelf.read();
        for amiss in &found.amiss {
            tracing::error!("{amiss}");
        }
        let view = Arc::new(View::default());
        let (post, inbox) = mpsc::channel::<Message>();
        let (work, works) = mpsc::channel::<Work>();
        let means = Means {
            shelf: shelf.clone(),
            folder,
            work,
            post: post.clone(),
            view: Arc::clone(&view),
            guards: options.guards,
            keep_bytes: config.storage.keep_mb * 1_000_000,
        };
        let mut foreman = Foreman::new(means, found.files, found.jobs);
        let mut threads = Vec::new();
        let mut stations = Vec::new();
        for printer in &config.printers {
            let profile = printer.load()?;
            let id = printer.id.clone();
            let (tell, gone) = (to_foreman(&post, &id), to_foreman(&post, &id));
            let actor = Actor {
                id,
                config: printer.clone(),
                profile: profile.clone(),
                board: Arc::new(Board::default()),
                tell: Box::new(tell),
                gone: Some(Box::new(gone)),
                speed: options.speed.unwrap_or(1.0),
            };
            let first = foreman.taken_up_by(&printer.id);
            if let Some(print) = &first {
                tracing::info!(printer = printer.id, job = print.id, "taking up what a dead daemon printed");
            }
            let (handle, thread) = actor::start(actor, first).context("cannot start a printer's thread")?;
            threads.push(thread);
            foreman.place(printer.clone(), Wants::of(&profile), handle.clone());
            stations.push(Station { config: printer.clone(), profile, handle });
        }
        let stop_inspector = Arc::new(AtomicBool::new(false));
        let inspector = Inspector {
            shelf: shelf.clone(),
            limits: config.check.clone(),
            stop: Arc::clone(&stop_inspector),
        };
        let tell = post.clone();
        threads.push(thread("inspector", move || {
            while let Ok(work) = works.recv() {
                if inspector.stop.load(Ordering::Relaxed) {
                    return;
                }
                let done = inspector.work(&work);
                // What was ended by us was not done: it is done after a restart.
                if inspector.stop.load(Ordering::Relaxed) || tell.send(Message::Done(done)).is_err() {
                    return;
                }
            }
        })?);
        // What is there is to be seen before anybody asks.
        foreman.begin();
        threads.push(thread("foreman", move || foreman.run(&inbox))?);
        let app = Arc::new(App {
            config,
            shelf,
            view,
            stations,
            foreman: post.clone(),
            auth,
            again: super::again::Again::default(),
            started,
            selected: std::sync::Mutex::default(),
            oneshots: super::moonraker::oneshot::Oneshots::default(),
        });
        let routes = routes(&app);
        Ok(Self { app, routes, inbox: post, stop_inspector, threads })
    }

    /// Listens and serves until `stop` says so; `listening` hears of each set of addresses. Ends all
    /// parts in order then.
    ///
    /// # Errors
    /// No address can be listened on, or the certificate cannot be used.
    pub(crate) async fn run(
        self,
        stop: watch::Receiver<bool>,
        mut listening: impl FnMut(&[SocketAddr], bool),
    ) -> anyhow::Result<()> {
        let server = &self.app.config.server;
        let tls = match (&server.tls_cert, &server.tls_key) {
            (Some(cert), Some(key)) => Some(http::tls(cert, key)?),
            _ => None,
        };
        let encrypted = tls.is_some();
        let beside = [
            tokio::spawn(api::tick(Arc::clone(&self.app))),
            tokio::spawn(look(Arc::clone(&self.app))),
            tokio::spawn(super::systemd::watchdog(Arc::clone(&self.app))),
        ];
        if self.app.auth.with(|auth, _| auth.needs_first_user()) {
            api::show_code(&self.app);
        }
        let mut has_users = self.app.auth.has_users();
        let mut first = true;
        let mut given = server.listen.clone();
        let served = loop {
            let open = *has_users.borrow_and_update();
            let addresses = if open { given.clone() } else { http::loopback_of(&given) };
            let listeners = match http::bind(&addresses) {
                Ok(listeners) => listeners,
                Err(why) if first => break Err(why),
                Err(why) => {
                    // The configured addresses cannot be had; the loopback could.
                    tracing::error!("{}; listening on the loopback only", causes::line(&why));
                    http::bind(&http::loopback_of(&given))?
                }
            };
            let bound: Vec<SocketAddr> = listeners.iter().filter_map(|l| l.local_addr().ok()).collect();
            // A port that the system has chosen is kept when more addresses are opened.
            for (address, chosen) in given.iter_mut().filter(|a| a.port() == 0).zip(&bound) {
                address.set_port(chosen.port());
            }
            listening(&bound, encrypted);
            if first {
                super::systemd::ready();
                first = false;
            }
            let announced = (open && server.mdns && bound.iter().any(|a| !a.ip().is_loopback()))
                .then(|| announce(&self.app, bound[0].port()))
                .flatten();
            let (end, ended) = watch::channel(false);
            let serving =
                http::serve(listeners, tls.clone(), self.routes.clone(), &server.trusted_proxies, ended);
            let mut serving = std::pin::pin!(serving);
            let mut stopping = stop.clone();
            let over = tokio::select! {
                () = &mut serving => true,
                _ = stopping.wait_for(|stop| *stop) => true,
                () = opened(&mut has_users, open, &addresses, &given) => false,
            };
            let _ = end.send(true);
            serving.await;
            drop(announced);
            if over {
                break Ok(());
            }
        };
        super::systemd::stopping();
        for task in beside {
            task.abort();
        }
        let _ = self.app.auth.keep().await;
        self.end().await;
        served
    }

    /// Ends printers, foreman and inspector; a running job is parked first.
    async fn end(self) {
        self.stop_inspector.store(true, Ordering::Relaxed);
        let _ = self.inbox.send(Message::End);
        let threads = self.threads;
        let parks = self.app.stations.iter().map(|station| station.handle.board.picture().park);
        let wait = END + parks.max().unwrap_or_default();
        drop((self.inbox, self.app, self.routes));
        let joined = tokio::task::spawn_blocking(move || {
            let end = Instant::now() + wait;
            for thread in threads {
                while !thread.is_finished() && Instant::now() < end {
                    std::thread::sleep(Duration::from_millis(10));
                }
            }
        });
        let _ = joined.await;
    }
}

/// Until more or fewer addresses are to be listened on, because there is a user now or none is left.
async fn opened(
    has_users: &mut watch::Receiver<bool>,
    was: bool,
    listened: &[SocketAddr],
    given: &[SocketAddr],
) {
    let same = listened.len() == given.len() && given == http::loopback_of(given);
    loop {
        if has_users.changed().await.is_err() {
            std::future::pending::<()>().await;
        }
        if *has_users.borrow() != was && !same {
            return;
        }
    }
}

/// Where a printer's actor tells what changes a job's life.
fn to_foreman(post: &mpsc::Sender<Message>, printer: &str) -> impl Fn(actor::Told) + Send + use<> {
    let (post, printer) = (post.clone(), printer.to_owned());
    move |told| {
        let _ = post.send(Message::Told { printer: printer.clone(), told });
    }
}

fn thread(name: &str, this: impl FnOnce() + Send + 'static) -> anyhow::Result<JoinHandle<()>> {
    let started = std::thread::Builder::new().name(name.to_owned()).spawn(this);
    started.with_context(|| format!("cannot start the {name}'s thread"))
}

fn announce(app: &App, port: u16) -> Option<discovery::Announced> {
    let model = app.stations.first().map_or("", |s| s.profile.title.as_str());
    match discovery::announce(&app.config.server.name, port, &app.shelf.uuid(), model) {
        Ok(announced) => Some(announced),
        Err(why) => {
            tracing::warn!("not announced in the network: {why}");
            None
        }
    }
}

/// Looks now and then whether users were changed by another process, and keeps what was used when.
async fn look(app: Arc<App>) {
    loop {
        tokio::time::sleep(LOOK).await;
        app.auth.look().await;
        if let Err(problem) = app.auth.keep().await {
            tracing::warn!("users and keys were not written: {}", problem.detail);
        }
    }
}

/// All routes, behind what every request passes.
fn routes(app: &Arc<App>) -> Router {
    let policy =
        HeaderValue::from_str(&gate::policy(app)).unwrap_or(HeaderValue::from_static("default-src 'self'"));
    let own = api::routes().layer(from_fn_with_state(Arc::clone(app), super::again::once));
    let clients = octoprint::routes().merge(prusalink::routes()).merge(moonraker::routes());
    let routes = own
        .route("/metrics", get(metrics::metrics))
        .merge(page::routes())
        .merge(clients.clone())
        .nest("/p/{printer}", clients)
        .route("/p/{printer}", get(at_page))
        .route("/p/{printer}/", get(at_page))
        .layer(DefaultBodyLimit::max(MAX_BODY_BYTES))
        .layer(from_fn_with_state((Arc::clone(app), policy), gate::pass))
        .with_state(Arc::clone(app));
    without_double_slashes(routes)
}

/// A printer's address in a browser, which some slicers show beside their own window.
async fn at_page(Path(printer): Path<String>) -> Redirect {
    // What is no printer's name leads to the page's own words for that.
    let plain: String = printer.chars().filter(|c| c.is_ascii_alphanumeric() || "-_".contains(*c)).collect();
    Redirect::to(&format!("/#/printer/{plain}"))
}

/// Some clients write `//api`: for them that is `/api`. A layer of the routes would come too late, for
/// they are found before it; around them is a router that knows none.
fn without_double_slashes(routes: Router) -> Router {
    let rewrite = async |mut request: Request| {
        if let Some(uri) = single_slashes(request.uri()) {
            *request.uri_mut() = uri;
        }
        request
    };
    Router::new().fallback_service(routes).layer(map_request(rewrite))
}

/// The address without empty parts in its path; `None`: it has none.
fn single_slashes(uri: &Uri) -> Option<Uri> {
    let (path, query) = (uri.path(), uri.query().map(|query| format!("?{query}")).unwrap_or_default());
    if !path.contains("//") {
        return None;
    }
    let mut single = String::with_capacity(path.len());
    for c in path.chars() {
        if c != '/' || !single.ends_with('/') {
            single.push(c);
        }
    }
    (single + &query).parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_slashes_are_one() {
        let check = |uri: &str, expect: Option<&str>| {
            assert_eq!(
                single_slashes(&uri.parse().unwrap()).map(|uri| uri.to_string()).as_deref(),
                expect,
                "{uri}"
            );
        };
        check("//api/printer/bed", Some("/api/printer/bed"));
        check("/p/a///api//job?x=//", Some("/p/a/api/job?x=//"));
        check("/api/job?x=//", None);
        check("/api/files/local/a%2F%2Fb", None);
    }
}
