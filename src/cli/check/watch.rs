//! Someone who looks on while a job is checked: takes the time, moves the progress
//! bar, and keeps what pictures need.
use crate::detect::walk::{Seen, Stage, Watch};
use crate::layers::shape::Bounds;
use crate::report::check::{Seconds, Tops};
use crate::report::survey::Survey;
use indicatif::ProgressBar;
use std::time::Instant;

/// What was seen on the way.
pub(super) struct Eye {
    last: Instant,
    seconds: Seconds,
    bar: ProgressBar,
    pub(super) tops: Tops,
    pub(super) survey: Option<Survey>,
    /// Of all that is printed.
    pub(super) bounds: Bounds,
}

impl Eye {
    /// From now on. `bar` counts layers.
    pub(super) fn new(bar: ProgressBar, survey: Option<Survey>) -> Eye {
        Eye {
            last: Instant::now(),
            seconds: Seconds::default(),
            bar,
            tops: Tops::default(),
            survey,
            bounds: Bounds::EMPTY,
        }
    }

    /// What the layers took, added to what was before them.
    pub(super) fn seconds_with(&self, before: Seconds) -> Seconds {
        let of = self.seconds;
        Seconds {
            slice: before.slice + of.slice,
            islands: before.islands + of.islands,
            overhangs: before.overhangs + of.overhangs,
            resin: before.resin + of.resin,
            pictures: before.pictures + of.pictures,
            ..before
        }
    }

    /// Seconds since the last call.
    fn lap_s(&mut self) -> f64 {
        let now = Instant::now();
        let seconds = now.duration_since(self.last).as_secs_f64();
        self.last = now;
        seconds
    }
}

impl Watch for Eye {
    fn lap(&mut self, stage: Stage) {
        let seconds = self.lap_s();
        let of = &mut self.seconds;
        match stage {
            Stage::Slice => of.slice += seconds,
            Stage::Islands => of.islands += seconds,
            Stage::Overhangs => of.overhangs += seconds,
            Stage::Resin => of.resin += seconds,
            Stage::Watch => of.pictures += seconds,
        }
        self.bar.set_position(self.tops.0.len() as u64);
    }

    fn layer(&mut self, seen: &Seen<'_>) {
        self.tops.0.push(seen.layer.top_mm);
        if let Some(survey) = &mut self.survey {
            survey.add(seen.into());
        }
        self.bounds = self.bounds.joined(seen.layer.part.bounds()).joined(seen.layer.aid.bounds());
    }
}
