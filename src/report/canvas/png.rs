//! The drawing as a PNG: alone names `tiny_skia`, and here alone the PNG crate.
//!
//! Drawn at twice the size in px that the picture is laid out in, so that it is
//! sharp on today's screens.
use super::super::svg::Rgb;
use super::{Anchor, Canvas, Outline, Style, font};
pub(in super::super) use png::EncodingError;
use tiny_skia::{
    Color, FillRule, LineCap, LineJoin, Paint, Path, PathBuilder, Pixmap, Rect, Stroke, Transform,
};

/// Pixels a px.
const SCALE: f32 = 2.0;

/// Greatest width and height, px: 8192 pixels need 256 MiB at most.
const SIZE_MAX: f64 = 4096.0;

/// Width of a letter's lines, as a part of the font's size: plain, and bold.
const PEN: [f64; 2] = [0.075, 0.125];

/// A picture of pixels.
pub(in super::super) struct Png {
    pixels: Pixmap,
}

impl Png {
    /// A white picture, px; what lies beyond the greatest size is cut off.
    pub(in super::super) fn new(size: [f64; 2]) -> Option<Png> {
        let [width, height] = size.map(|s| (s.clamp(1.0, SIZE_MAX).ceil() * f64::from(SCALE)) as u32);
        let mut pixels = Pixmap::new(width, height)?;
        pixels.fill(Color::WHITE);
        Some(Png { pixels })
    }

    /// The file's bytes.
    ///
    /// # Errors
    /// The encoder's own; none is expected when writing to memory.
    pub(in super::super) fn finish(self) -> Result<Vec<u8>, EncodingError> {
        let (width, height) = (self.pixels.width(), self.pixels.height());
        // Opaque everywhere, so that the premultiplied colours are the plain ones.
        let rgb: Vec<u8> = self.pixels.data().chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, width, height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&rgb)?;
        writer.finish()?;
        Ok(bytes)
    }

    fn fill_path(&mut self, path: Option<Path>, colour: Rgb) {
        if let Some(path) = path {
            self.pixels.fill_path(&path, &paint(colour), FillRule::EvenOdd, scale(), None);
        }
    }

    fn stroke_path(&mut self, path: Option<Path>, colour: Rgb, width: f64) {
        let stroke = Stroke {
            width: width as f32,
            line_cap: LineCap::Round,
            line_join: LineJoin::Round,
            ..Stroke::default()
        };
        if let Some(path) = path {
            self.pixels.stroke_path(&path, &paint(colour), &stroke, scale(), None);
        }
    }
}

fn scale() -> Transform {
    Transform::from_scale(SCALE, SCALE)
}

fn paint(colour: Rgb) -> Paint<'static> {
    let mut paint = Paint::default();
    paint.set_color_rgba8(colour[0], colour[1], colour[2], 255);
    paint
}

fn add(builder: &mut PathBuilder, points: &[[f64; 2]], close: bool) {
    for (k, p) in points.iter().enumerate() {
        let [x, y] = p.map(|c| c as f32);
        if k == 0 {
            builder.move_to(x, y);
        } else {
            builder.line_to(x, y);
        }
    }
    if close && !points.is_empty() {
        builder.close();
    }
}

impl Canvas for Png {
    fn frame(&mut self, [x, y]: [f64; 2], [width, height]: [f64; 2], fill: Rgb, border: Rgb) {
        let corners = vec![[x, y], [x + width, y], [x + width, y + height], [x, y + height]];
        self.fill(std::slice::from_ref(&corners), fill);
        let rect = Rect::from_xywh(x as f32, y as f32, width as f32, height as f32);
        self.stroke_path(rect.map(PathBuilder::from_rect), border, 1.0);
    }

    fn fill(&mut self, outlines: &[Outline], colour: Rgb) {
        let mut builder = PathBuilder::new();
        outlines.iter().for_each(|outline| add(&mut builder, outline, true));
        self.fill_path(builder.finish(), colour);
    }

    fn line(&mut self, points: &[[f64; 2]], colour: Rgb, width: f64) {
        let mut builder = PathBuilder::new();
        add(&mut builder, points, false);
        self.stroke_path(builder.finish(), colour, width);
    }

    fn circle(&mut self, [x, y]: [f64; 2], radius: f64, colour: Rgb, width: f64) {
        let path = PathBuilder::from_circle(x as f32, y as f32, radius as f32);
        self.stroke_path(path, colour, width);
    }

    fn text(&mut self, [x, y]: [f64; 2], style: Style, words: &str) {
        let start = match style.anchor {
            Anchor::Start => x,
            Anchor::End => x - font::width(words, style.size),
        };
        let pen = style.size * PEN[usize::from(style.bold)];
        let mut builder = PathBuilder::new();
        let mut dots = PathBuilder::new();
        for line in font::lines(words, [start, y], style.size) {
            match line.as_slice() {
                [dot] => dots.push_circle(dot[0] as f32, dot[1] as f32, (pen * 0.75) as f32),
                points => add(&mut builder, points, false),
            }
        }
        self.stroke_path(builder.finish(), style.colour, pen);
        self.fill_path(dots.finish(), style.colour);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decoded(bytes: &[u8]) -> (u32, u32, Vec<u8>) {
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().expect("a header");
        let mut pixels = vec![0; reader.output_buffer_size().expect("a size")];
        let info = reader.next_frame(&mut pixels).expect("pixels");
        (info.width, info.height, pixels)
    }

    #[test]
    fn what_is_drawn_is_in_the_file() {
        let mut png = Png::new([10.0, 5.0]).expect("a small picture");
        let square = |x: f64, s: f64| vec![[x, 1.0], [x + s, 1.0], [x + s, 1.0 + s], [x, 1.0 + s]];
        png.fill(&[square(1.0, 3.0), square(2.0, 1.0)], [10, 20, 30]);
        let (width, height, pixels) = decoded(&png.finish().expect("bytes"));
        assert_eq!((width, height), (20, 10));
        let count = |rgb: [u8; 3]| pixels.chunks_exact(3).filter(|p| **p == rgb).count();
        // 3 × 3 px with a hole of 1 × 1 px, four pixels a px.
        assert_eq!((count([10, 20, 30]), count([255, 255, 255])), (32, 200 - 32));
    }

    #[test]
    fn words_leave_ink_where_they_stand() {
        let mut png = Png::new([60.0, 20.0]).expect("a small picture");
        let style = Style { size: 12.0, bold: false, colour: [0, 0, 0], anchor: Anchor::End };
        png.text([58.0, 15.0], style, "Z 5.2 mm");
        let (width, _, pixels) = decoded(&png.finish().expect("bytes"));
        let dark: Vec<usize> = (0..pixels.len() / 3).filter(|k| pixels[3 * k] < 128).collect();
        let columns = dark.iter().map(|k| k % width as usize);
        assert!(dark.len() > 60 && columns.clone().max() <= Some(118) && columns.min() >= Some(2));
    }

    #[test]
    fn wild_numbers_draw_nothing_and_end() {
        let mut png = Png::new([f64::INFINITY, 1.0]).expect("a bounded picture");
        let wild = vec![[f64::NAN, 0.0], [f64::INFINITY, 1e300], [-1e300, 3.0]];
        png.fill(std::slice::from_ref(&wild), [0; 3]);
        png.line(&wild, [0; 3], 1.0);
        png.circle([f64::NAN; 2], f64::NAN, [0; 3], 1.0);
        assert!(png.finish().is_ok());
    }
}
