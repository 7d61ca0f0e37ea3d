//! Pixels taken out of the images of a resin job.
//!
//! Takes rows of pixels, layer by layer; makes them black, and proves of what was written that nothing
//! else became other. Knows no format, and not why they are taken out.
use crate::resin::image::{Image, ImageError, Panel};
use crate::resin::job::{Job, JobError};
use crate::resin::rewrite::{Edit, Edits};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::io::{Read, Seek};

/// Pictures that are compared at once.
const BATCH: u32 = 16;

/// Pixels to take out, by layer: the row, the first column, and the one behind the last.
pub type Rows = BTreeMap<u32, Vec<(u32, [u16; 2])>>;

/// A job without some of its pixels.
#[derive(Debug)]
pub struct Without<'a>(pub &'a Rows);

impl Edits for Without<'_> {
    fn touches(&self, layer: u32) -> bool {
        self.0.contains_key(&layer)
    }

    fn edit(&self, layer: u32, image: &mut Image) -> Edit {
        let Some(rows) = self.0.get(&layer) else { return Edit::Kept };
        let mut edit = Edit::Kept;
        each(rows, image.width_px, |pixels| {
            if let Some(pixels) = image.pixels.get_mut(pixels) {
                pixels.fill(0);
                edit = Edit::Changed;
            }
        });
        edit
    }
}

/// Shows which of a picture's pixels each row is.
fn each(rows: &[(u32, [u16; 2])], width_px: u32, mut show: impl FnMut(std::ops::Range<usize>)) {
    for &(row, [begin, end]) in rows {
        let first = row as usize * width_px as usize;
        show(first + usize::from(begin)..first + usize::from(end));
    }
}

/// Why what was written is not what was promised.
#[derive(Debug, thiserror::Error)]
pub enum NotProved {
    /// A job cannot be read.
    #[error(transparent)]
    Job(#[from] JobError),
    /// Another number of layers.
    #[error("the result has {after} layers, the job {before}")]
    Layers {
        /// Of the job.
        before: usize,
        /// Of the result.
        after: usize,
    },
    /// A picture is not what it was without the pixels that were taken out.
    #[error("layer {layer} of the result differs where nothing was taken out, or still has what was")]
    Picture {
        /// From 0 at the plate.
        layer: u32,
    },
}

/// Proves that a result has the job's pictures without those pixels, pixel by pixel.
///
/// # Errors
/// It has not, or one of them cannot be read.
pub fn prove<A: Read + Seek, B: Read + Seek>(
    before: &mut Job<A>,
    after: &mut Job<B>,
    rows: &Rows,
) -> Result<(), NotProved> {
    let (count, found) = (before.layers().len(), after.layers().len());
    if count != found {
        return Err(NotProved::Layers { before: count, after: found });
    }
    let panels = [before.panel(), after.panel()];
    for first in (0..count as u32).step_by(BATCH as usize) {
        let layers = first..(first + BATCH).min(count as u32);
        let packed: Vec<[Vec<u8>; 2]> = layers
            .clone()
            .map(|layer| Ok([before.packed(layer)?, after.packed(layer)?]))
            .collect::<Result<_, JobError>>()?;
        let same: Vec<Result<bool, (bool, ImageError)>> = packed
            .par_iter()
            .zip(layers.clone())
            .map(|(packed, layer)| is_same(panels, packed, rows.get(&layer)))
            .collect();
        for (layer, same) in layers.zip(same) {
            match same {
                Ok(true) => {}
                Ok(false) => return Err(NotProved::Picture { layer }),
                Err((true, error)) => return Err(after.picture_error(layer, error).into()),
                Err((false, error)) => return Err(before.picture_error(layer, error).into()),
            }
        }
    }
    Ok(())
}

/// Whether two packed pictures differ by those rows alone. An error tells whether it is the second's.
fn is_same(
    panels: [Panel; 2],
    [before, after]: &[Vec<u8>; 2],
    rows: Option<&Vec<(u32, [u16; 2])>>,
) -> Result<bool, (bool, ImageError)> {
    if rows.is_none() && panels[0] == panels[1] && before == after {
        return Ok(true);
    }
    let mut before = panels[0].image(before).map_err(|error| (false, error))?;
    let after = panels[1].image(after).map_err(|error| (true, error))?;
    if let Some(rows) = rows {
        each(rows, before.width_px, |pixels| {
            if let Some(pixels) = before.pixels.get_mut(pixels) {
                pixels.fill(0);
            }
        });
    }
    Ok(before == after)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::resin;
    use crate::resin::job::Format;
    use crate::resin::rewrite::rewrite;
    use crate::resin::testing::sl1;
    use std::io::Cursor;

    fn job(pictures: &[[u8; 6]]) -> Job<Cursor<Vec<u8>>> {
        let pictures: Vec<Vec<u8>> = pictures.iter().map(|p| p.to_vec()).collect();
        resin::open(Cursor::new(sl1(3, 2, &pictures))).expect("a job")
    }

    #[test]
    fn what_is_taken_out_is_black_and_all_else_stays() {
        let rows: Rows = [(1, vec![(0, [1, 3]), (1, [0, 1])])].into();
        let mut out = Cursor::new(Vec::new());
        let before = [[9; 6], [5, 6, 7, 8, 9, 10], [255; 6]];
        let written = rewrite(&mut job(&before), &mut out, Format::Sl1, &Without(&rows), &mut |_| ());
        assert_eq!(written.expect("written").changed, 1);
        let mut result = resin::open(out).expect("a job");
        assert_eq!(result.image(1).expect("a picture").pixels, [5, 0, 0, 0, 9, 10]);
        assert_eq!(result.image(2).expect("a picture").pixels, [255; 6]);
        prove(&mut job(&before), &mut result, &rows).expect("it holds");
    }

    #[test]
    fn whatever_else_differs_is_no_proof() {
        let rows: Rows = [(1, vec![(0, [1, 3])])].into();
        let before = [[9; 6], [5, 6, 7, 8, 9, 10]];
        let check = |after: &[[u8; 6]], expect: &str| {
            let told = prove(&mut job(&before), &mut job(after), &rows).err().map(|e| e.to_string());
            assert_eq!(told.is_some(), !expect.is_empty(), "{told:?}");
            assert!(told.unwrap_or_default().contains(expect), "{expect}");
        };
        let good = [5, 0, 0, 8, 9, 10];
        check(&[[9; 6], good], "");
        check(&[[9; 6], [5, 6, 0, 8, 9, 10]], "layer 1");
        check(&[[9; 6], [5, 0, 0, 8, 9, 11]], "layer 1");
        check(&[[9, 9, 9, 9, 9, 8], good], "layer 0");
        check(&[[9; 6]], "1 layers");
    }
}
