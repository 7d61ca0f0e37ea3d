//! Uploads by form, as slicers send them: the file somewhere among small fields, in any order.
//!
//! Takes a request; gives the file on the disk, its name and the fields. Streamed: memory is a few
//! pieces. Bounded: parts, a field's length, the file. What is refused half-way is read on and thrown
//! away, for a client that is cut off while it sends shows no reason.
use super::asked::At;
use crate::server::api::files::{keep, take_part};
use crate::server::app::App;
use crate::server::asker::Who;
use crate::server::model::{File, Job, Stage};
use crate::server::problem::{Kind, Problem};
use crate::server::upload::{ReadAhead, Upload, read_ahead, shown_name};
use axum::extract::multipart::Field;
use axum::extract::{FromRequest, Multipart, Request};
use std::collections::BTreeMap;
use std::time::Duration;
use tokio::time::{Instant, timeout_at};

/// Parts of a form at most: slicers send six.
const MAX_PARTS: usize = 32;

/// Longest field that is no file, bytes.
const MAX_FIELD_BYTES: usize = 4096;

/// An upload that is to be printed is answered after so long at the latest, looked at or not.
const LOOK: Duration = Duration::from_secs(1);

/// What a form held.
pub(crate) struct Form {
    pub(crate) name: String,
    pub(crate) upload: Upload,
    fields: BTreeMap<String, String>,
}

impl Form {
    /// Reads a form; `free` says whether a name may be taken, before its bytes come.
    ///
    /// # Errors
    /// It is none, lacks its file, is too large, or the name or the disk refuses.
    pub(crate) async fn read(
        app: &App,
        request: Request,
        free: impl Fn(&str) -> Result<(), Problem>,
    ) -> Result<Self, Problem> {
        let (head, body) = request.into_parts();
        let (body, ahead) = read_ahead(body);
        let mut form = Multipart::from_request(Request::from_parts(head, body), &()).await.map_err(|e| {
            Problem::new(Kind::Unsupported, format!("a file comes as multipart/form-data: {}", e.body_text()))
        })?;
        match Self::parts(app, &mut form, &ahead, free).await {
            Ok(form) => Ok(form),
            Err(why) => {
                drain(&mut form, &ahead, app.config.server.max_upload_bytes()).await;
                Err(why)
            }
        }
    }

    async fn parts(
        app: &App,
        form: &mut Multipart,
        ahead: &ReadAhead,
        free: impl Fn(&str) -> Result<(), Problem>,
    ) -> Result<Self, Problem> {
        let (mut file, mut fields) = (None, BTreeMap::new());
        for _ in 0..MAX_PARTS {
            let Some(part) = form.next_field().await.map_err(|e| Problem::bad(e.body_text()))? else {
                let (name, upload) = file.ok_or_else(|| Problem::bad("the form has no part `file`"))?;
                return Ok(Self { name, upload, fields });
            };
            ahead.got();
            match part.name() {
                Some("file") if file.is_none() => {
                    let name = shown_name(&unescaped(part.file_name().unwrap_or_default()))?;
                    free(&name)?;
                    file = Some((name, take_part(app, part, ahead).await?));
                }
                _ => {
                    let name = part.name().unwrap_or_default().to_owned();
                    fields.insert(name, text(part).await?);
                }
            }
        }
        Err(Problem::bad(format!("a form has {MAX_PARTS} parts at most")))
    }

    /// A field.
    pub(crate) fn field(&self, name: &str) -> Option<&str> {
        self.fields.get(name).map(String::as_str)
    }

    /// Whether a field says yes.
    pub(crate) fn says(&self, name: &str) -> bool {
        self.field(name)
            .is_some_and(|text| ["true", "yes", "1", "on"].contains(&text.to_ascii_lowercase().as_str()))
    }
}

/// curl and browsers write three characters of a file's name so (HTML, 4.10.21.8).
fn unescaped(name: &str) -> String {
    name.replace("%22", "\"").replace("%0D", "").replace("%0A", "")
}

async fn text(mut part: Field<'_>) -> Result<String, Problem> {
    let mut bytes = Vec::new();
    while let Some(piece) = part.chunk().await.map_err(|e| Problem::bad(e.body_text()))? {
        if bytes.len() + piece.len() > MAX_FIELD_BYTES {
            return Err(Problem::bad(format!("a field has {MAX_FIELD_BYTES} bytes at most")));
        }
        bytes.extend_from_slice(&piece);
    }
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

async fn drain(form: &mut Multipart, ahead: &ReadAhead, most_bytes: u64) {
    let (mut bytes, mut parts) = (0_u64, 0);
    while let Ok(Some(mut part)) = form.next_field().await {
        parts += 1;
        ahead.got();
        while let Ok(Some(piece)) = part.chunk().await {
            ahead.got();
            bytes += piece.len() as u64;
            if bytes > most_bytes || parts > MAX_PARTS {
                return;
            }
        }
    }
}

/// Makes an upload a file of this printer, which is looked at for it; queues it if it is to be
/// printed. The job is told as it stands once its file was looked at, or after [`LOOK`].
///
/// # Errors
/// The disk or the foreman refuses.
pub(crate) async fn kept(
    at: &At,
    who: &Who,
    upload: Upload,
    name: String,
    print: bool,
) -> Result<(File, Option<Job>), Problem> {
    let file = keep(&at.app, upload, name, who.name(), Some(at.id().to_owned())).await?;
    if !print {
        return Ok((file, None));
    }
    let job = at.queue(file.id.clone(), who).await?;
    Ok((file, Some(looked_at(&at.app, job).await)))
}

/// Whether a job goes to the printer now: nothing and nobody is waited for.
pub(crate) fn goes(job: &Job) -> bool {
    job.state.is_running() || (job.state == Stage::Queued && job.waits_for.is_none())
}

async fn looked_at(app: &App, job: Job) -> Job {
    let mut news = app.view.listen();
    let end = Instant::now() + LOOK;
    loop {
        match app.view.job(&job.id) {
            Some(now) if now.state != Stage::Checking => return now,
            _ if timeout_at(end, news.recv()).await.is_err() => return app.view.job(&job.id).unwrap_or(job),
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_as_it_was_before_the_form() {
        assert_eq!(unescaped("W %2220mm%22.gcode"), "W \"20mm\".gcode");
        assert_eq!(unescaped("a%0D%0Ab%20c"), "ab%20c");
    }
}
