//! The WebSocket: JSON-RPC 2.0 in text messages, and what is told unasked.
//!
//! Every request that has an id is answered, one after the other. A client that subscribes hears what
//! changes at most every [`TICK`], and what it is answered is never older than what it was told. One
//! that takes nothing is gone; it holds up nobody. Bounded: sockets, a message, what is remembered of a
//! subscription.
use super::call::{call, status, told};
use super::fault::{Fault, Viewer};
use super::files::{ROOT, item};
use super::host::{Counted, MAX_SOCKETS, event_time};
use super::method;
use super::objects::{Status, Wanted, changed, klippy};
use crate::server::api::live::{PING, STUCK, TICK};
use crate::server::app::App;
use crate::server::asker::Who;
use crate::server::auth::Scope;
use crate::server::foreman::view::News;
use crate::server::octoprint::asked::Asked;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::http::StatusCode;
use axum::response::Response;
use serde::Deserialize;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::sync::Arc;
use tokio::sync::broadcast::error::RecvError;
use tokio::time::{Instant, interval, timeout};

/// Largest message of a client, bytes.
const MAX_HEARD_BYTES: usize = 64 << 10;

/// Opens it.
pub(super) async fn open(Viewer(asked): Viewer, upgrade: WebSocketUpgrade) -> Result<Response, Fault> {
    let counted = Counted::new().ok_or_else(|| {
        Fault::new(StatusCode::SERVICE_UNAVAILABLE, format!("{MAX_SOCKETS} sockets are open already"))
    })?;
    Ok(upgrade.max_message_size(MAX_HEARD_BYTES).on_upgrade(move |socket| {
        let files = names(&asked.at.app);
        let klippy = klippy(&asked.at.now()).0;
        Talk { socket, asked, counted, wanted: Wanted::default(), told: Map::new(), klippy, files, fresh: 0 }
            .talk()
    }))
}

fn names(app: &App) -> BTreeMap<String, String> {
    app.view.files().into_iter().map(|file| (file.id, file.name)).collect()
}

/// The client is gone, or takes nothing.
struct Gone;

struct Talk {
    socket: WebSocket,
    asked: Asked,
    counted: Counted,
    wanted: Wanted,
    /// What it was told last of what it wants.
    told: Status,
    klippy: &'static str,
    /// Files that it knows of, by id.
    files: BTreeMap<String, String>,
    /// So many beats more are looked at: news may come a little before what it is of can be seen.
    fresh: u8,
}

impl Talk {
    async fn talk(mut self) {
        let _ = self.run().await;
    }

    async fn run(&mut self) -> Result<(), Gone> {
        let app = Arc::clone(&self.asked.at.app);
        let mut news = app.view.listen();
        let (mut beat, mut ping) = (interval(TICK), interval(PING));
        beat.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        ping.tick().await;
        let mut heard = Instant::now();
        loop {
            tokio::select! {
                told = news.recv() => match told {
                    Ok(told) => self.news(&told).await?,
                    Err(RecvError::Lagged(_)) => {
                        self.files = names(&app);
                        self.fresh = 2;
                        self.notify("notify_filelist_changed", json!([{"action": "root_update", "item": {"path": "", "root": ROOT}}])).await?;
                    }
                    Err(RecvError::Closed) => return Err(Gone),
                },
                said = self.socket.recv() => {
                    heard = Instant::now();
                    match said {
                        Some(Ok(Message::Text(text))) => self.hear(text.as_str()).await?,
                        Some(Ok(Message::Close(_)) | Err(_)) | None => return Err(Gone),
                        Some(Ok(_)) => {}
                    }
                }
                _ = beat.tick(), if self.fresh > 0 => {
                    self.fresh -= 1;
                    self.look().await?;
                }
                _ = ping.tick() => {
                    let still = app.auth.with(|auth, now| auth.refresh(&self.asked.who.0, now));
                    let still = still.filter(|_| heard.elapsed() < 3 * PING).ok_or(Gone)?;
                    self.asked.who = Who(still);
                    self.asked.who.require(Scope::Read).map_err(|_| Gone)?;
                    self.send(Message::Ping(axum::body::Bytes::new())).await?;
                }
            }
        }
    }

    async fn send(&mut self, message: Message) -> Result<(), Gone> {
        match timeout(STUCK, self.socket.send(message)).await {
            Ok(Ok(())) => Ok(()),
            _ => Err(Gone),
        }
    }

    async fn say(&mut self, value: &Value) -> Result<(), Gone> {
        self.send(Message::Text(value.to_string().into())).await
    }

    async fn notify(&mut self, method: &str, params: Value) -> Result<(), Gone> {
        self.say(&json!({"jsonrpc": "2.0", "method": method, "params": params})).await
    }

    // ---- what is told unasked ----

    async fn news(&mut self, News { scope, text }: &News) -> Result<(), Gone> {
        #[derive(Deserialize)]
        struct Kind {
            r#type: String,
        }
        let Ok(Kind { r#type: kind }) = serde_json::from_str(text) else { return Ok(()) };
        match kind.as_str() {
            "printer" | "temperatures" => self.fresh = 2,
            "job" => {
                self.fresh = 2;
                self.look().await?;
            }
            "file" | "gone" => self.files_changed(text).await?,
            "console" if *scope == crate::server::foreman::view::Scope::Control => self.console(text).await?,
            _ => {}
        }
        Ok(())
    }

    /// A file is new when it is first heard of; later news of it is about its checks.
    async fn files_changed(&mut self, text: &str) -> Result<(), Gone> {
        #[derive(Deserialize)]
        struct Told {
            file: Option<crate::server::model::File>,
            what: Option<String>,
            id: Option<String>,
        }
        let Ok(Told { file, what, id }) = serde_json::from_str(text) else { return Ok(()) };
        let notice = match (file, what.as_deref(), id) {
            (Some(file), _, _) => {
                let known = self.files.insert(file.id.clone(), file.name.clone()).is_some();
                (!known).then(|| json!([{"action": "create_file", "item": item(&file)}]))
            }
            (None, Some("file"), Some(id)) => self.files.remove(&id).map(|name| {
                json!([{"action": "delete_file", "item": {"path": name, "root": ROOT, "modified": 0, "size": 0, "permissions": ""}}])
            }),
            _ => None,
        };
        match notice {
            Some(notice) => self.notify("notify_filelist_changed", notice).await,
            None => Ok(()),
        }
    }

    async fn console(&mut self, text: &str) -> Result<(), Gone> {
        #[derive(Deserialize)]
        struct Line {
            from: String,
            text: String,
        }
        #[derive(Deserialize)]
        struct Told {
            printer: String,
            lines: Vec<Line>,
        }
        let Ok(Told { printer, lines }) = serde_json::from_str(text) else { return Ok(()) };
        if printer != self.asked.at.id() || self.asked.who.require(Scope::Control).is_err() {
            return Ok(());
        }
        for line in lines.into_iter().filter(|line| line.from == "printer") {
            self.notify("notify_gcode_response", json!([line.text])).await?;
        }
        Ok(())
    }

    /// Looks at the printer and tells what has changed of what is wanted; gives all.
    async fn look(&mut self) -> Result<Status, Gone> {
        let now = self.asked.at.now();
        let (all, klippy) = (status(&self.asked.at, &now), klippy(&now).0);
        if klippy != self.klippy {
            self.klippy = klippy;
            let notice = match klippy {
                "ready" => Some("notify_klippy_ready"),
                "disconnected" => Some("notify_klippy_disconnected"),
                "error" => Some("notify_klippy_shutdown"),
                _ => None,
            };
            if let Some(notice) = notice {
                self.say(&json!({"jsonrpc": "2.0", "method": notice})).await?;
            }
        }
        if !self.wanted.is_empty() {
            let picked = self.wanted.pick(&all);
            let new = changed(&self.told, &picked);
            self.told = picked;
            if !new.is_empty() {
                let at_s = event_time(&self.asked.at.app);
                self.notify("notify_status_update", json!([new, at_s])).await?;
            }
        }
        Ok(all)
    }

    // ---- what is asked ----

    async fn hear(&mut self, text: &str) -> Result<(), Gone> {
        #[derive(Deserialize)]
        struct Request {
            method: String,
            #[serde(default)]
            params: Value,
            id: Option<Value>,
        }
        let request = match serde_json::from_str::<Value>(text) {
            Err(_) => Err((Value::Null, Fault::rpc(-32700, "Parse error"))),
            Ok(value) => {
                let id = value.get("id").cloned().unwrap_or_default();
                serde_json::from_value::<Request>(value)
                    .map_err(|_| (id, Fault::rpc(-32600, "Invalid Request")))
            }
        };
        let (id, answer) = match request {
            Err((id, fault)) => (Some(id), Err(fault)),
            Ok(Request { method, params, id }) => {
                let params = if let Value::Object(params) = params { params } else { Map::new() };
                let all = self.look().await?;
                (id, self.answer(&method, &params, all).await)
            }
        };
        let Some(id) = id else { return Ok(()) };
        let told = match answer {
            Ok(result) => json!({"jsonrpc": "2.0", "result": result, "id": id}),
            Err(fault) => json!({"jsonrpc": "2.0", "error": fault.told(), "id": id}),
        };
        self.say(&told).await
    }

    async fn answer(&mut self, name: &str, params: &Map<String, Value>, all: Status) -> Result<Value, Fault> {
        match name {
            "server.connection.identify" => Ok(json!({"connection_id": self.counted.0})),
            "server.websocket.id" => Ok(json!({"websocket_id": self.counted.0})),
            "printer.objects.subscribe" => {
                self.wanted = Wanted::of(params.get("objects"), &all);
                self.told = self.wanted.pick(&all);
                Ok(told(&self.asked.at, self.told.clone()))
            }
            // Of the same moment as what was told just now.
            "printer.objects.query" => {
                Ok(told(&self.asked.at, Wanted::of(params.get("objects"), &all).pick(&all)))
            }
            name => call(&self.asked, method(name)?, params).await,
        }
    }
}
