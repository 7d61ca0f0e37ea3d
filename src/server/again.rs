//! A request that is sent again is done once: the header `Idempotency-Key`.
//!
//! Takes a key, who asks and where; keeps the answer for a day and gives it again. Bounded: the
//! oldest answers go. One that is still being made is a conflict, not a second try. Answers that
//! say "try later" or "a fault of ours" are not kept.
use super::app::App;
use super::asker;
use super::problem::Problem;
use axum::body::{Body, Bytes, to_bytes};
use axum::extract::{Request, State};
use axum::http::{HeaderMap, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use sha2::{Digest, Sha256};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Answers that are kept.
const MAX_KEPT: usize = 256;

/// Largest answer that is kept, bytes.
const MAX_BYTES: usize = 64 << 10;

/// Longest key, bytes.
const MAX_KEY_BYTES: usize = 255;

/// How long an answer is kept.
const FOR: Duration = Duration::from_secs(24 * 60 * 60);

type Id = [u8; 32];

/// See the module's text.
#[derive(Default)]
pub(crate) struct Again {
    kept: Mutex<VecDeque<(Id, Instant, Option<Answer>)>>,
}

#[derive(Clone)]
struct Answer {
    status: StatusCode,
    headers: HeaderMap,
    body: Bytes,
}

enum Known {
    New,
    Running,
    Answered(Answer),
}

impl Again {
    fn look(&self, id: Id) -> Known {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.retain(|(_, at, _)| at.elapsed() < FOR);
        match kept.iter().find(|(known, _, _)| *known == id) {
            Some((_, _, Some(answer))) => Known::Answered(answer.clone()),
            Some((_, _, None)) => Known::Running,
            None => {
                if kept.len() >= MAX_KEPT {
                    kept.pop_front();
                }
                kept.push_back((id, Instant::now(), None));
                Known::New
            }
        }
    }

    fn answered(&self, id: Id, answer: Option<Answer>) {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        match answer {
            Some(answer) => {
                if let Some(entry) = kept.iter_mut().find(|(known, _, _)| *known == id) {
                    entry.2 = Some(answer);
                }
            }
            None => kept.retain(|(known, _, _)| *known != id),
        }
    }
}

/// Forgets a try whose client has gone before it was answered.
struct Trying<'a>(&'a Again, Id, bool);

impl Drop for Trying<'_> {
    fn drop(&mut self) {
        if !self.2 {
            self.0.answered(self.1, None);
        }
    }
}

/// The layer around our own API.
pub(crate) async fn once(State(app): State<Arc<App>>, request: Request, next: Next) -> Response {
    let key = request.headers().get("idempotency-key").map(|value| value.as_bytes().to_vec());
    let Some(key) = key.filter(|_| request.method() == Method::POST) else {
        return next.run(request).await;
    };
    if key.is_empty() || key.len() > MAX_KEY_BYTES {
        return Problem::bad(format!("Idempotency-Key has 1 to {MAX_KEY_BYTES} bytes")).into_response();
    }
    let mut sum = Sha256::new();
    // Nobody meets another's answers: who asks is part of the key.
    let who = asker::key(request.headers()).or_else(|| asker::cookie(request.headers())).unwrap_or_default();
    for part in [who.as_bytes(), request.uri().path().as_bytes(), &key] {
        sum.update((part.len() as u64).to_le_bytes());
        sum.update(part);
    }
    let id: Id = sum.finalize().into();
    match app.again.look(id) {
        Known::Answered(answer) => {
            let mut response = Response::new(Body::from(answer.body));
            (*response.status_mut(), *response.headers_mut()) = (answer.status, answer.headers);
            return response;
        }
        Known::Running => return Problem::conflict("the same request is still being done").into_response(),
        Known::New => {}
    }
    let mut trying = Trying(&app.again, id, false);
    let (parts, body) = next.run(request).await.into_parts();
    let keeps = !parts.status.is_server_error()
        && ![StatusCode::TOO_MANY_REQUESTS, StatusCode::UNAUTHORIZED, StatusCode::FORBIDDEN]
            .contains(&parts.status);
    let small =
        parts.headers.get(header::CONTENT_LENGTH).and_then(|n| n.to_str().ok()?.parse::<usize>().ok());
    if !keeps || small.is_some_and(|bytes| bytes > MAX_BYTES) {
        return Response::from_parts(parts, body);
    }
    let Ok(body) = to_bytes(body, MAX_BYTES).await else {
        return Problem::internal("an answer that was to be kept is too large").into_response();
    };
    let answer = Answer { status: parts.status, headers: parts.headers.clone(), body: body.clone() };
    trying.2 = true;
    app.again.answered(id, Some(answer));
    Response::from_parts(parts, Body::from(body))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_is_given_again_and_a_try_is_not_made_twice() {
        let again = Again::default();
        assert!(matches!(again.look([1; 32]), Known::New));
        assert!(matches!(again.look([1; 32]), Known::Running));
        drop(Trying(&again, [1; 32], false));
        assert!(matches!(again.look([1; 32]), Known::New));
        let answer =
            Answer { status: StatusCode::CREATED, headers: HeaderMap::new(), body: Bytes::from_static(b"x") };
        again.answered([1; 32], Some(answer));
        let Known::Answered(answer) = again.look([1; 32]) else { panic!("not kept") };
        assert_eq!((answer.status, answer.body.as_ref()), (StatusCode::CREATED, &b"x"[..]));
        for n in 0..=MAX_KEPT {
            let mut id = [2; 32];
            id[..8].copy_from_slice(&(n as u64).to_le_bytes());
            again.look(id);
        }
        assert!(matches!(again.look([1; 32]), Known::New), "the oldest goes");
    }
}
