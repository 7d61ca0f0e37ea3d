//! Tokens that open one socket: a browser cannot send a key along with it.
//!
//! Takes who asks; gives a text that is that one, once and for some seconds. Bounded; in memory only.
use crate::server::asker::Who;
use crate::server::problem::Problem;
use crate::server::shelf::new_id;
use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Tokens that are open; the oldest go.
const MAX_OPEN: usize = 64;

/// How long one is good.
const FOR: Duration = Duration::from_secs(5);

/// See the module's text.
#[derive(Default)]
pub(crate) struct Oneshots(Mutex<VecDeque<(String, Instant, Who)>>);

impl Oneshots {
    /// A token for somebody.
    ///
    /// # Errors
    /// The system has no randomness.
    pub(super) fn make(&self, who: &Who) -> Result<String, Problem> {
        let token = new_id('T').map_err(|e| Problem::internal(e.to_string()))?;
        let mut open = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        open.retain(|(_, made, _)| made.elapsed() < FOR);
        if open.len() >= MAX_OPEN {
            open.pop_front();
        }
        open.push_back((token.clone(), Instant::now(), who.clone()));
        Ok(token)
    }

    /// Whose token that is; it is spent then. Nobody finds 96 bits in some seconds, however exactly
    /// the time of a comparison is measured.
    pub(super) fn spend(&self, token: &str) -> Option<Who> {
        let mut open = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let at = open.iter().position(|(known, made, _)| known == token && made.elapsed() < FOR)?;
        open.remove(at).map(|(_, _, who)| who)
    }
}
