//! `/events`: all that changes, over one WebSocket.
//!
//! Each viewer first gets everything, then changes. A viewer that is too slow for its backlog gets
//! everything anew; it holds up nobody. Printers are told at most every [`TICK`], whatever they do.
use crate::server::app::App;
use crate::server::asker::{Read, Who};
use crate::server::auth::Scope as May;
use crate::server::foreman::view::{News, Scope};
use crate::server::model::{ConsoleLine, Sample};
use crate::server::problem::{Kind, Problem, ProblemDetails};
use axum::extract::State;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::http::{HeaderMap, header};
use axum::response::Response;
use serde_json::json;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;
use tokio::sync::broadcast::error::RecvError;
use tokio::time::{Instant, interval, timeout};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

/// Printers are told so often at most.
pub(crate) const TICK: Duration = Duration::from_millis(500);

/// A viewer that takes nothing for so long is gone.
pub(crate) const STUCK: Duration = Duration::from_secs(20);

/// So often it is asked whether a viewer is there, and looked whether it still may.
pub(crate) const PING: Duration = Duration::from_secs(30);

/// Viewers at a time.
const MAX_VIEWERS: usize = 400;

/// Largest message of a viewer, bytes: it has nothing to say.
const MAX_HEARD_BYTES: usize = 4096;

static VIEWERS: AtomicUsize = AtomicUsize::new(0);

pub(super) fn routes() -> OpenApiRouter<Arc<App>> {
    OpenApiRouter::new().routes(routes!(events))
}

/// All that changes, as text messages of a WebSocket
#[utoipa::path(get, path = "/events", responses((status = 101), (status = 401, body = ProblemDetails)))]
async fn events(
    Read(who): Read,
    State(app): State<Arc<App>>,
    headers: HeaderMap,
    upgrade: WebSocketUpgrade,
) -> Result<Response, Problem> {
    if !same_origin(&headers) {
        // A browser sends the cookie along whichever page opens the socket.
        return Err(Problem::new(Kind::Forbidden, "this page may not listen here: it came from elsewhere"));
    }
    if VIEWERS.load(Ordering::Relaxed) >= MAX_VIEWERS {
        return Err(Problem::conflict(format!("{MAX_VIEWERS} viewers listen already")));
    }
    Ok(upgrade.max_message_size(MAX_HEARD_BYTES).on_upgrade(move |socket| watch(socket, app, who)))
}

/// Whether a page that opens a socket came from here; programs say no origin.
pub(crate) fn same_origin(headers: &HeaderMap) -> bool {
    let Some(origin) = headers.get(header::ORIGIN) else { return true };
    let host = headers.get(header::HOST).and_then(|h| h.to_str().ok());
    let origin = origin.to_str().ok().and_then(|o| o.split_once("://")).map(|(_, host)| host);
    origin.is_some() && origin == host
}

struct Counted;

impl Counted {
    fn new() -> Self {
        VIEWERS.fetch_add(1, Ordering::Relaxed);
        Self
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        VIEWERS.fetch_sub(1, Ordering::Relaxed);
    }
}

async fn watch(mut socket: WebSocket, app: Arc<App>, who: Who) {
    let _counted = Counted::new();
    let mut news = app.view.listen();
    let mut who = who;
    let hello = |app: &App| {
        json!({"type": "hello", "printers": app.printers(), "jobs": app.view.jobs(), "files": app.view.files()})
            .to_string()
    };
    if !say(&mut socket, hello(&app)).await {
        return;
    }
    let mut ping = interval(PING);
    ping.tick().await;
    let mut heard = Instant::now();
    loop {
        tokio::select! {
            told = news.recv() => {
                let text = match told {
                    Ok(News { scope, text }) if may(&who, scope) => text.to_string(),
                    Ok(_) => continue,
                    // Too slow for its backlog.
                    Err(RecvError::Lagged(_)) => hello(&app),
                    Err(RecvError::Closed) => return,
                };
                if !say(&mut socket, text).await {
                    return;
                }
            }
            said = socket.recv() => match said {
                Some(Ok(Message::Close(_)) | Err(_)) | None => return,
                Some(Ok(_)) => heard = Instant::now(),
            },
            _ = ping.tick() => {
                let still = app.auth.with(|auth, now| auth.refresh(&who.0, now));
                let Some(still) = still.filter(|_| heard.elapsed() < 3 * PING) else { return };
                who = Who(still);
                if who.require(May::Read).is_err() || socket.send(Message::Ping(Default::default())).await.is_err() {
                    return;
                }
            }
        }
    }
}

fn may(who: &Who, scope: Scope) -> bool {
    who.require(match scope {
        Scope::Read => May::Read,
        Scope::Control => May::Control,
        Scope::Admin => May::Admin,
    })
    .is_ok()
}

async fn say(socket: &mut WebSocket, text: String) -> bool {
    matches!(timeout(STUCK, socket.send(Message::Text(text.into()))).await, Ok(Ok(())))
}

/// What was told of a printer.
#[derive(Clone, Copy, Debug, Default)]
struct ToldOf {
    board: u64,
    place: u64,
    samples: u64,
    console: u64,
}

/// Tells what printers do, for as long as the daemon runs.
pub(crate) async fn tick(app: Arc<App>) {
    let mut told = vec![ToldOf::default(); app.stations.len()];
    let mut beat = interval(TICK);
    beat.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
    loop {
        beat.tick().await;
        if app.view.listeners() == 0 {
            continue;
        }
        for (station, told) in app.stations.iter().zip(&mut told) {
            let (id, board) = (&station.config.id, &station.handle.board);
            let (now, place) = (board.version(), app.view.place(id).version);
            if (now, place) != (told.board, told.place) {
                (told.board, told.place) = (now, place);
                let printer = app.printer(station);
                app.view.tell(Scope::Read, || json!({"type": "printer", "printer": printer}));
            }
            let (sample, samples): (Option<Sample>, u64) = board.newest_sample();
            if let Some(sample) = sample.filter(|_| samples != told.samples) {
                told.samples = samples;
                app.view
                    .tell(Scope::Read, || json!({"type": "temperatures", "printer": id, "sample": sample}));
            }
            let (lines, total): (Vec<ConsoleLine>, u64) = board.console_since(told.console);
            if total != told.console {
                told.console = total;
                app.view.tell(Scope::Control, || json!({"type": "console", "printer": id, "lines": lines}));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_from_elsewhere_may_not_listen() {
        let check = |origin: Option<&str>, expect| {
            let mut headers = HeaderMap::new();
            headers.insert(header::HOST, "pi.local:8080".parse().unwrap());
            if let Some(origin) = origin {
                headers.insert(header::ORIGIN, origin.parse().unwrap());
            }
            assert_eq!(same_origin(&headers), expect, "{origin:?}");
        };
        check(None, true);
        check(Some("http://pi.local:8080"), true);
        check(Some("http://pi.local"), false);
        check(Some("https://evil.example"), false);
        check(Some("null"), false);
    }
}
