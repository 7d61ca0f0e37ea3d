//! A part and its supports, two meshes, as one stack of layers.
use crate::layers::from_mesh::{FromMesh, SliceError};
use crate::layers::polygon::union;
use crate::layers::stack::{Layer, Layers};
use std::collections::VecDeque;

/// A mesh's layers, one at a time.
struct OneByOne<'a> {
    layers: FromMesh<'a>,
    ready: VecDeque<Layer>,
    over: bool,
}

impl<'a> OneByOne<'a> {
    fn new(layers: FromMesh<'a>) -> OneByOne<'a> {
        OneByOne { layers, ready: VecDeque::new(), over: false }
    }

    fn next(&mut self) -> Result<Option<Layer>, SliceError> {
        while self.ready.is_empty() && !self.over {
            match self.layers.next_batch()? {
                Some(batch) => self.ready.extend(batch),
                None => self.over = true,
            }
        }
        Ok(self.ready.pop_front())
    }
}

/// The layers of a part with those of its supports.
pub struct Together<'a> {
    part: FromMesh<'a>,
    supports: Vec<OneByOne<'a>>,
}

impl<'a> Together<'a> {
    /// `supports` are cut at the same heights; several are united, as where the same ones
    /// are looked at raised as well.
    #[must_use]
    pub fn new(part: FromMesh<'a>, supports: Vec<FromMesh<'a>>) -> Together<'a> {
        Together { part, supports: supports.into_iter().map(OneByOne::new).collect() }
    }
}

impl Layers for Together<'_> {
    type Error = SliceError;

    fn count(&self) -> Option<u32> {
        self.part.count()
    }

    fn next_batch(&mut self) -> Result<Option<Vec<Layer>>, SliceError> {
        let Some(mut batch) = self.part.next_batch()? else { return Ok(None) };
        for layer in &mut batch {
            for supports in &mut self.supports {
                if let Some(own) = supports.next()? {
                    layer.aid = union(&layer.aid, &own.part);
                }
            }
        }
        Ok(Some(batch))
    }
}
