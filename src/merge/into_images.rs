//! Supports into the images of a resin job.
//!
//! Takes supports that can be cut at any height and how a job's pictures lie over the
//! plate; draws each layer's section into its picture. A pixel's brightness is the share of
//! it that the section covers, or what it was where that is more: what the slicer drew stays
//! as it is. Knows no format.
use crate::layers::scan::spans;
use crate::layers::shape::{Point, Region};
use crate::resin::image::Image;
use crate::resin::job::{JobLayer, Placement};
use crate::resin::rewrite::{Edit, Edits};
use crate::support::section::Sections;

/// Lines across a row of pixels at which it is looked whether they are covered.
const LINES: u32 = 4;

/// Supports drawn into pictures.
pub struct Drawn<'a, S> {
    sections: &'a S,
    layers: &'a [JobLayer],
    placement: Placement,
}

impl<'a, S: Sections> Drawn<'a, S> {
    /// Supports in the layers of a job.
    #[must_use]
    pub fn new(sections: &'a S, layers: &'a [JobLayer], placement: Placement) -> Drawn<'a, S> {
        Drawn { sections, layers, placement }
    }

    fn heights_mm(&self, layer: u32) -> Option<[f64; 2]> {
        let layer = self.layers.get(layer as usize)?;
        Some([(layer.top_mm - layer.height_mm).max(0.0), layer.top_mm])
    }
}

impl<S: Sections> Edits for Drawn<'_, S> {
    fn touches(&self, layer: u32) -> bool {
        self.heights_mm(layer).is_some_and(|[bottom, _]| bottom < self.sections.top_mm())
    }

    fn edit(&self, layer: u32, image: &mut Image) -> Edit {
        let Some([bottom, top]) = self.heights_mm(layer) else { return Edit::Kept };
        let section = self.sections.section(bottom, top);
        let mut changed = false;
        for region in [&section.body, &section.interface] {
            changed |= draw(region, self.placement, image);
        }
        if changed { Edit::Changed } else { Edit::Kept }
    }
}

/// Draws a region; `false`: no pixel became brighter.
fn draw(region: &Region, placement: Placement, image: &mut Image) -> bool {
    let (wide, high) = (image.width_px as usize, image.height_px as usize);
    let place = |p: Point| {
        let [x, y] = p.mm();
        let [a, b] = if placement.swap { [y, x] } else { [x, y] };
        let [u, v] = [a / placement.pixel_mm[0], b / placement.pixel_mm[1]];
        let reversed = |c: f64, reverse: bool, of: usize| if reverse { of as f64 - c } else { c };
        [reversed(u, placement.reverse_u, wide), reversed(v, placement.reverse_v, high)]
    };
    let lines = f64::from(LINES);
    let offsets: Vec<f64> = (0..high as u32 * LINES).map(|line| (f64::from(line) + 0.5) / lines).collect();
    let crossed = spans(region.rings(), place, &offsets);
    let mut covered = vec![0.0_f32; wide];
    let mut changed = false;
    for (number, row) in crossed.chunks(LINES as usize).enumerate() {
        let (mut from, mut to) = (wide, 0);
        for piece in row.iter().flatten() {
            let [left, right] = piece.map(|u| u.clamp(0.0, wide as f64));
            let [first, last] = [left.floor() as usize, (right.ceil() as usize).min(wide)];
            for (px, covered) in covered.iter_mut().enumerate().take(last).skip(first) {
                let share = (right.min(px as f64 + 1.0) - left.max(px as f64)).max(0.0);
                *covered += (share / lines) as f32;
            }
            (from, to) = (from.min(first), to.max(last));
        }
        let pixels = &mut image.pixels[number * wide..(number + 1) * wide];
        for px in from..to {
            let brightness = (covered[px] * 255.0).round().clamp(0.0, 255.0) as u8;
            changed |= brightness > pixels[px];
            pixels[px] = pixels[px].max(brightness);
            covered[px] = 0.0;
        }
    }
    changed
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layers::polygon::{Inside, resolve};
    use crate::resin::testing::layer as resin_layer;
    use crate::support::section::Section;

    /// A square of 2 × 2 mm from (1, 1) mm, 1 mm high.
    struct Square;

    impl Sections for Square {
        fn top_mm(&self) -> f64 {
            1.0
        }

        fn section(&self, bottom_mm: f64, _: f64) -> Section {
            let ring = [(1.0, 1.0), (3.0, 1.0), (3.0, 3.0), (1.0, 3.0)].map(|(x, y)| Point::from_mm(x, y));
            let body = resolve(&[ring.to_vec()], Inside::NonZero);
            if bottom_mm < 1.0 { Section { body, ..Section::default() } } else { Section::default() }
        }
    }

    fn drawn(placement: Placement, size: [u32; 2], layer: u32) -> (Edit, Vec<u8>, bool) {
        let layers: Vec<JobLayer> = (1..=3).map(|k| resin_layer(f64::from(k))).collect();
        let edits = Drawn::new(&Square, &layers, placement);
        let pixels = vec![0; (size[0] * size[1]) as usize];
        let mut image = Image { width_px: size[0], height_px: size[1], pixels };
        image.pixels[0] = 7;
        let touches = edits.touches(layer);
        let edit = edits.edit(layer, &mut image);
        (edit, image.pixels, touches)
    }

    #[test]
    fn a_section_is_drawn_where_the_picture_lies_over_the_plate() {
        let check = |turn: [bool; 3], pixel_mm: [f64; 2], size: [u32; 2], expect: &[&[u8]]| {
            let [reverse_u, reverse_v, swap] = turn;
            let placement = Placement { pixel_mm, reverse_u, reverse_v, swap };
            let (edit, pixels, _) = drawn(placement, size, 0);
            assert_eq!(edit, Edit::Changed);
            let mut expect = expect.concat();
            expect[0] = expect[0].max(7);
            assert_eq!(pixels, expect, "{turn:?}");
        };
        // Upright, 1 mm pixels: rows from the top are counted from the back.
        let square: [&[u8]; 5] = [&[0; 5], &[0; 5], &[0, 255, 255, 0, 0], &[0, 255, 255, 0, 0], &[0; 5]];
        check([false, true, false], [1.0; 2], [5, 5], &square);
        let turned: [&[u8]; 5] = [&[0; 5], &[0, 0, 255, 255, 0], &[0, 0, 255, 255, 0], &[0; 5], &[0; 5]];
        check([true, false, false], [1.0; 2], [5, 5], &turned);
        // Pixels of 2 mm are covered in part.
        let half: [&[u8]; 2] = [&[64, 64], &[64, 64]];
        check([false, false, false], [2.0, 2.0], [2, 2], &half);
        // Swapped, with a panel that is not square.
        let wide: [&[u8]; 3] = [&[0, 0, 0, 0], &[0, 255, 255, 0], &[0, 255, 255, 0]];
        check([false, false, true], [1.0; 2], [4, 3], &wide);
    }

    #[test]
    fn what_is_there_stays_and_layers_above_are_not_touched() {
        let placement = Placement { pixel_mm: [1.0; 2], reverse_u: false, reverse_v: false, swap: false };
        let (edit, pixels, touches) = drawn(placement, [5, 5], 0);
        assert_eq!((edit, touches, pixels[0]), (Edit::Changed, true, 7));
        let (edit, pixels, touches) = drawn(placement, [5, 5], 1);
        assert_eq!((edit, touches), (Edit::Kept, false));
        assert!(pixels[1..].iter().all(|p| *p == 0));
        // Outside of the panel nothing is drawn.
        let (edit, ..) = drawn(placement, [1, 1], 0);
        assert_eq!(edit, Edit::Kept);
    }
}
