//! A thread that has the next picture ready before it is wanted, and shows it when it is.
//!
//! Takes a job's pictures and a display; does what it is told in order and says when it is done.
//! Unpacking takes time, and is done while the plate moves; showing takes next to none. Knows
//! neither light nor plate: when to show and when to be dark is the caller's matter.
use crate::causes;
use crate::printer::exposure::Order;
use crate::printer::lcd::painter::Painter;
use crate::printer::lcd::{Frame, Sink};
use crate::resin::job::Job;
use anyhow::Context;
use std::io::{Read, Seek};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// What the screen has done.
#[derive(Debug)]
pub(crate) enum Did {
    /// This layer's picture is ready, from 0.
    Loaded(u32),
    /// It is shown.
    Shown(u32),
    /// All is dark.
    Blanked,
    /// It cannot go on, and why. Nothing follows.
    Failed(String),
}

enum Letter {
    Do(Order),
    /// Go dark then, and end.
    End(Option<Instant>),
}

/// The thread. Dropped, it goes dark and ends.
#[derive(Debug)]
pub(crate) struct Screen {
    post: Sender<Letter>,
    did: Receiver<Did>,
    thread: Option<JoinHandle<()>>,
    /// When the light is off at the latest, if it may be on.
    pub(crate) lit_until: Option<Instant>,
}

impl Screen {
    /// Starts it; `wake` is called whenever something was done.
    ///
    /// # Errors
    /// The system has no thread left.
    pub(crate) fn start<R: Read + Seek + Send + 'static>(
        pictures: Job<R>,
        sink: Box<dyn Sink>,
        wake: impl Fn() + Send + 'static,
    ) -> anyhow::Result<Self> {
        let (post, letters) = channel();
        let (tell, did) = channel();
        let painter = sink.painter();
        let mut desk = Desk { pictures, sink, painter, ready: None };
        let run = move || {
            while let Ok(letter) = letters.recv() {
                let done = match letter {
                    Letter::Do(order) => desk.obey(order),
                    Letter::End(at) => {
                        // A picture does not change while the light is on.
                        if let Some(at) = at {
                            std::thread::sleep(at.saturating_duration_since(Instant::now()));
                        }
                        // Nobody is left who could be told.
                        let _ = desk.sink.blank();
                        return;
                    }
                };
                let failed = done.is_err();
                let news = done.unwrap_or_else(|why| Did::Failed(causes::line(&why)));
                if tell.send(news).is_err() {
                    continue;
                }
                wake();
                if failed {
                    tracing::debug!("the screen waits for its end");
                }
            }
        };
        let thread = std::thread::Builder::new()
            .name("screen".to_owned())
            .spawn(run)
            .context("cannot start the screen's thread")?;
        Ok(Self { post, did, thread: Some(thread), lit_until: None })
    }

    /// Tells it what to do.
    pub(crate) fn tell(&self, order: Order) {
        // A thread that is gone is noticed by what it does not do.
        let _ = self.post.send(Letter::Do(order));
    }

    /// What it has done since.
    pub(crate) fn did(&self) -> Option<Did> {
        self.did.try_recv().ok()
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        let _ = self.post.send(Letter::End(self.lit_until));
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

struct Desk<R> {
    pictures: Job<R>,
    sink: Box<dyn Sink>,
    painter: Painter,
    ready: Option<(u32, Frame)>,
}

impl<R: Read + Seek> Desk<R> {
    fn obey(&mut self, order: Order) -> anyhow::Result<Did> {
        match order {
            Order::Load(layer) => {
                if let Some((_, frame)) = self.ready.take() {
                    self.painter.take_back(frame);
                }
                let began = Instant::now();
                let frame = self.paint(layer)?;
                tracing::debug!(layer, took_ms = ms(began.elapsed()), "picture ready");
                self.ready = Some((layer, frame));
                Ok(Did::Loaded(layer))
            }
            Order::Show(layer) => match &self.ready {
                Some((ready, frame)) if *ready == layer => {
                    self.sink.show(frame)?;
                    Ok(Did::Shown(layer))
                }
                _ => anyhow::bail!("layer {layer} is to be shown and is not ready"),
            },
            Order::Blank => {
                self.sink.blank()?;
                Ok(Did::Blanked)
            }
        }
    }

    fn paint(&mut self, layer: u32) -> anyhow::Result<Frame> {
        let packed = self.pictures.packed(layer)?;
        let mut refused = None;
        let painter = &mut self.painter;
        let read = self.pictures.panel().rows(&packed, |row| {
            if refused.is_none() {
                refused = painter.row(row).err();
            }
        });
        if let Err(why) = read {
            painter.discard();
            return Err(self.pictures.picture_error(layer, why).into());
        }
        if let Some(why) = refused {
            painter.discard();
            return Err(why).with_context(|| format!("layer {layer}"));
        }
        painter.finish().with_context(|| format!("layer {layer}"))
    }
}

fn ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}
