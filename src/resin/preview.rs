//! The picture of a whole part that slicers put into a job for people to see.
//!
//! Takes pixels, gives them at another size. Knows no format and no file.

/// A small picture in colours, on black.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Preview {
    /// Pixels along a row.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Red, green and blue, row by row from the top.
    pub pixels: Vec<[u8; 3]>,
}

impl Preview {
    /// The same picture as large as it fits into this size, black around it. Each pixel
    /// is the mean of what it covers (a box filter).
    #[must_use]
    pub fn fitted(&self, [width, height]: [u32; 2]) -> Preview {
        let mut pixels = vec![[0; 3]; width as usize * height as usize];
        let [from_w, from_h] = [self.width_px, self.height_px].map(f64::from);
        let scale = (f64::from(width) / from_w).min(f64::from(height) / from_h);
        let whole = self.pixels.len() == self.width_px as usize * self.height_px as usize;
        if !whole || !scale.is_finite() || pixels.is_empty() {
            return Preview { width_px: width, height_px: height, pixels };
        }
        let inner = |from: f64, most: u32| ((from * scale).round() as u32).clamp(1, most);
        let [inner_w, inner_h] = [inner(from_w, width), inner(from_h, height)];
        let [left, top] = [(width - inner_w) / 2, (height - inner_h) / 2];
        let columns: Vec<Vec<(u32, f64)>> =
            (0..inner_w).map(|c| covered(c, inner_w, self.width_px)).collect();
        for row in 0..inner_h {
            let rows = covered(row, inner_h, self.height_px);
            let at = ((top + row) * width + left) as usize;
            for (pixel, columns) in pixels[at..].iter_mut().zip(&columns) {
                *pixel = self.mean(columns, &rows);
            }
        }
        Preview { width_px: width, height_px: height, pixels }
    }

    /// Mean of columns and rows, each with its weight.
    fn mean(&self, columns: &[(u32, f64)], rows: &[(u32, f64)]) -> [u8; 3] {
        let mut sum = [0.0; 3];
        for (row, high) in rows {
            for (column, wide) in columns {
                let pixel = self.pixels[(row * self.width_px + column) as usize];
                for (sum, part) in sum.iter_mut().zip(pixel) {
                    *sum += f64::from(part) * high * wide;
                }
            }
        }
        sum.map(|s| s.round() as u8)
    }
}

/// What part `k` of `parts` covers of `pixels`, and how much of itself each fills.
fn covered(k: u32, parts: u32, pixels: u32) -> Vec<(u32, f64)> {
    let length = f64::from(pixels) / f64::from(parts);
    let (from, to) = (f64::from(k) * length, f64::from(k + 1) * length);
    let last = (to.ceil() as u32).min(pixels);
    let share = |i: u32| (to.min(f64::from(i) + 1.0) - from.max(f64::from(i))).max(0.0) / length;
    (from as u32..last).map(|i| (i, share(i))).collect()
}

/// A pixel of five, six and five bits.
#[must_use]
pub fn to_565([red, green, blue]: [u8; 3]) -> u16 {
    u16::from(red >> 3) << 11 | u16::from(green >> 2) << 5 | u16::from(blue >> 3)
}

/// The pixel of five, six and five bits, its colours spread over 0 to 255.
#[must_use]
pub fn from_565(pixel: u16) -> [u8; 3] {
    let spread = |value: u16, most: u16| ((value & most) * 255 / most) as u8;
    [spread(pixel >> 11, 31), spread(pixel >> 5, 63), spread(pixel, 31)]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(width_px: u32, height_px: u32, pixels: &[u8]) -> Preview {
        Preview { width_px, height_px, pixels: pixels.iter().map(|&p| [p; 3]).collect() }
    }

    #[test]
    fn a_picture_is_fitted_and_centred() {
        let check = |from: &Preview, size, expect: &[u8]| {
            assert_eq!(from.fitted(size), grey(size[0], size[1], expect));
        };
        let four = grey(2, 2, &[0, 100, 200, 60]);
        check(&four, [2, 2], &[0, 100, 200, 60]);
        check(&four, [1, 1], &[90]);
        check(&four, [4, 2], &[0, 0, 100, 0, 0, 200, 60, 0]);
        check(&four, [2, 3], &[0, 100, 200, 60, 0, 0]);
        // A pixel covers two thirds of one and one third of the next.
        check(&grey(3, 1, &[0, 90, 255]), [2, 1], &[30, 200]);
        check(&grey(1, 1, &[7]), [3, 3], &[7; 9]);
        check(&grey(0, 0, &[]), [2, 1], &[0, 0]);
        check(&grey(5, 5, &[1]), [2, 1], &[0, 0]);
    }

    #[test]
    fn five_bits_come_back() {
        for pixel in [0, 0xffff, 0xf800, 0x07e0, 0x001f, 0x1234, 0xabcd] {
            assert_eq!(to_565(from_565(pixel)), pixel);
        }
    }
}
