//! A port that goes and comes back.
//!
//! What was numbered stays in the window, what waits stays where it is, be it lines of
//! the job or our own while it is held. After [`Session::link_back`] the printer is
//! asked which line it accepted last ([`take_over`](super::take_over)), and
//! [`Session::go_on`] sends the rest: each line is executed once, however much of it
//! had arrived. An [`Ask`](super::Ask) that is open stays open, but for that of a new
//! count, which is asked again.
use super::asks::Asked;
use super::emergency::Stop;
use super::{Ending, Event, Failure, Phase, Session, Then, Whence};

impl Session {
    /// The port is gone for good: nothing can be sent any more, and the end is told.
    pub fn port_lost(&mut self, reason: String) {
        if self.is_over() {
            return;
        }
        if matches!(self.phase, Phase::Stopping(_)) {
            self.tell(Event::EmergencyStopped { by: None });
        }
        if self.ending.is_none() {
            self.ending = Some(Ending::Failed(Failure::PortLost { reason }));
        }
        self.end_early(self.unanswered());
    }

    /// The port is gone. Where [`Settings::waits_for_link`](super::Settings::waits_for_link)
    /// is set, [`Event::LinkLost`] is told and all waits, a safe sequence and an emergency stop
    /// too; [`Session::link_back`] leads to [`Event::Found`], [`Session::port_lost`] ends the
    /// wait. Otherwise the session ends.
    ///
    /// Before the job or a macro has sent anything, [`Session::link_back`] begins the
    /// handshake again, and [`Event::Connected`] follows.
    pub fn link_lost(&mut self, reason: String) {
        if !self.settings.waits_for_link {
            return self.port_lost(reason);
        }
        let anew = match self.phase {
            Phase::Ended | Phase::Lost { .. } => return,
            Phase::Stopping(_) => {
                // After a reset that may be the reset's own doing, but it proves
                // nothing: M112 again when the port is back.
                self.phase = Phase::Stopping(Stop::NoPort);
                self.silence();
                self.tell(Event::LinkLost { reason });
                return;
            }
            Phase::Boot { .. } => true,
            Phase::Numbering { then, .. } => then == Then::Identify,
            Phase::Identify { whence, .. } => whence == Whence::Anew,
            _ => false,
        };
        if matches!(self.asked, Some(Asked::Renumber)) {
            self.asked = None;
        }
        self.phase = Phase::Lost { anew };
        self.silence();
        self.tell(Event::LinkLost { reason });
    }

    /// Drops what was on its way, either way.
    fn silence(&mut self) {
        self.out.clear();
        self.out_at = 0;
        self.splitter.forget();
        self.answers.forget_drain();
        self.person.forget_strays();
    }

    /// The port was opened again, after [`Event::LinkLost`].
    pub fn link_back(&mut self, now_ms: u64) {
        match self.phase {
            Phase::Lost { anew: true } => {
                self.start_over();
                self.phase = self.settings.boot(now_ms);
            }
            Phase::Lost { anew: false } => self.search(now_ms),
            Phase::Stopping(_) => self.stop_now(now_ms),
            _ => {}
        }
    }
}
