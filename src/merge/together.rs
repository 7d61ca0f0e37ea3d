//! A part and its supports, of two sources, as one stack of layers.
use crate::layers::polygon::union;
use crate::layers::stack::{Layer, Layers};
use std::collections::VecDeque;

/// Layers one at a time.
struct OneByOne<L> {
    layers: L,
    ready: VecDeque<Layer>,
    over: bool,
}

impl<L: Layers> OneByOne<L> {
    fn new(layers: L) -> OneByOne<L> {
        OneByOne { layers, ready: VecDeque::new(), over: false }
    }

    fn next(&mut self) -> Result<Option<Layer>, L::Error> {
        while self.ready.is_empty() && !self.over {
            match self.layers.next_batch()? {
                Some(batch) => self.ready.extend(batch),
                None => self.over = true,
            }
        }
        Ok(self.ready.pop_front())
    }
}

/// The layers of a part with those of its supports as their aid.
pub struct Together<P, A> {
    part: P,
    supports: Vec<OneByOne<A>>,
}

impl<P: Layers, A: Layers<Error = P::Error>> Together<P, A> {
    /// `supports` have the same layers as the part; several are united, as where the same
    /// ones are looked at raised as well.
    #[must_use]
    pub fn new(part: P, supports: Vec<A>) -> Together<P, A> {
        Together { part, supports: supports.into_iter().map(OneByOne::new).collect() }
    }
}

impl<P: Layers, A: Layers<Error = P::Error>> Layers for Together<P, A> {
    type Error = P::Error;

    fn count(&self) -> Option<u32> {
        self.part.count()
    }

    fn next_batch(&mut self) -> Result<Option<Vec<Layer>>, P::Error> {
        let Some(mut batch) = self.part.next_batch()? else { return Ok(None) };
        for layer in &mut batch {
            for supports in &mut self.supports {
                if let Some(own) = supports.next()? {
                    layer.aid = if layer.aid.is_empty() { own.part } else { union(&layer.aid, &own.part) };
                }
            }
        }
        Ok(Some(batch))
    }
}
