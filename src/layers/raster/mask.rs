//! A set of a picture's pixels, in spans of its rows.

/// A set of pixels: in each row spans that neither overlap nor touch, from the left.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Mask {
    width_px: u16,
    /// Where the spans of each row begin, and where those of the last end.
    rows: Vec<u32>,
    /// First column, and the one behind the last.
    spans: Vec<[u16; 2]>,
}

impl Mask {
    /// A set without rows, of a picture that is `width_px` wide.
    pub(super) fn new(width_px: u32) -> Mask {
        Mask { width_px: width_px as u16, rows: vec![0], spans: Vec::new() }
    }

    /// Adds a row of spans from the left that do not overlap; those that touch become one.
    pub(super) fn row(&mut self, spans: impl IntoIterator<Item = [u16; 2]>) {
        let first = self.spans.len();
        for [begin, end] in spans {
            match self.spans[first..].last_mut() {
                Some(last) if last[1] == begin => last[1] = end,
                _ => self.spans.push([begin, end]),
            }
        }
        self.rows.push(self.spans.len() as u32);
    }

    /// Rows.
    #[must_use]
    pub fn height_px(&self) -> u32 {
        self.rows.len().saturating_sub(1) as u32
    }

    /// Spans of all rows.
    pub(super) fn len(&self) -> usize {
        self.spans.len()
    }

    /// Whether it has no pixel.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.spans.is_empty()
    }

    /// Spans of a row, by their places among all; none beyond the last row.
    pub(super) fn places(&self, row: u32) -> std::ops::Range<usize> {
        let at = |row: usize| self.rows.get(row).map_or(self.spans.len(), |&at| at as usize);
        at(row as usize)..at(row as usize + 1)
    }

    /// A span by its place.
    pub(super) fn span(&self, place: usize) -> [u16; 2] {
        self.spans[place]
    }

    /// The spans of a row, from the left.
    #[must_use]
    pub fn spans(&self, row: u32) -> &[[u16; 2]] {
        &self.spans[self.places(row)]
    }

    /// The picture's other pixels.
    #[must_use]
    pub fn inverse(&self) -> Mask {
        let mut inverse = Mask::new(u32::from(self.width_px));
        for row in 0..self.height_px() {
            let spans = self.spans(row);
            let ends = std::iter::once(0).chain(spans.iter().map(|span| span[1]));
            let begins = spans.iter().map(|span| span[0]).chain([self.width_px]);
            inverse.row(ends.zip(begins).filter(|(end, begin)| end < begin).map(|(end, begin)| [end, begin]));
        }
        inverse
    }

    /// The pixels that are not in the other set. Of a row that the other has not all stay.
    #[must_use]
    pub fn without(&self, other: &Mask) -> Mask {
        let mut rest = Mask::new(u32::from(self.width_px));
        let mut left = Vec::new();
        for row in 0..self.height_px() {
            let mut others = other.spans(row).iter().copied().peekable();
            for &[mut begin, end] in self.spans(row) {
                while let Some(&[from, to]) = others.peek().filter(|span| span[0] < end) {
                    if begin < from {
                        left.push([begin, from]);
                    }
                    begin = begin.max(to);
                    if to > end {
                        break;
                    }
                    others.next();
                }
                if begin < end {
                    left.push([begin, end]);
                }
            }
            rest.row(left.drain(..));
        }
        rest
    }

    /// The spans whose places are wanted.
    pub(super) fn filtered(&self, wanted: impl Fn(usize) -> bool) -> Mask {
        let mut some = Mask::new(u32::from(self.width_px));
        for row in 0..self.height_px() {
            some.row(self.places(row).filter(|&place| wanted(place)).map(|place| self.span(place)));
        }
        some
    }

    /// The pixels whose four neighbours are in the set as well; behind the picture's edge all are.
    #[must_use]
    pub fn eroded(&self) -> Mask {
        let mut eroded = Mask::new(u32::from(self.width_px));
        let (mut inner, mut under) = (Vec::new(), Vec::new());
        for row in 0..self.height_px() {
            inner.clear();
            inner.extend(self.spans(row).iter().filter_map(|&[begin, end]| {
                let begin = begin + u16::from(begin > 0);
                let end = end - u16::from(end < self.width_px);
                (begin < end).then_some([begin, end])
            }));
            let below = Some(row + 1).filter(|&row| row < self.height_px());
            for beside in row.checked_sub(1).into_iter().chain(below) {
                common(&inner, self.spans(beside), &mut under);
                std::mem::swap(&mut inner, &mut under);
            }
            eroded.row(inner.iter().copied());
        }
        eroded
    }

    /// Shows where two sets share pixels: places of a span of this one and of one of the other, in
    /// the same row, and how many pixels.
    pub(super) fn meet(&self, other: &Mask, mut show: impl FnMut(usize, usize, u32)) {
        for row in 0..self.height_px().min(other.height_px()) {
            self.meet_rows(row, other, row, &mut show);
        }
    }

    /// The same of a row of this one and another row of the other.
    pub(super) fn meet_rows(
        &self,
        row: u32,
        other: &Mask,
        other_row: u32,
        show: &mut impl FnMut(usize, usize, u32),
    ) {
        let (mut ours, mut theirs) = (self.places(row), other.places(other_row));
        while let (Some(a), Some(b)) = (ours.clone().next(), theirs.clone().next()) {
            let ([a_begin, a_end], [b_begin, b_end]) = (self.span(a), other.span(b));
            let (begin, end) = (a_begin.max(b_begin), a_end.min(b_end));
            if begin < end {
                show(a, b, u32::from(end - begin));
            }
            if a_end <= b_end {
                ours.next()
            } else {
                theirs.next()
            };
        }
    }
}

/// The spans that two rows have in common.
fn common(one: &[[u16; 2]], other: &[[u16; 2]], shared: &mut Vec<[u16; 2]>) {
    shared.clear();
    let (mut a, mut b) = (0, 0);
    while let (Some(one), Some(other)) = (one.get(a), other.get(b)) {
        let (begin, end) = (one[0].max(other[0]), one[1].min(other[1]));
        if begin < end {
            shared.push([begin, end]);
        }
        if one[1] <= other[1] { a += 1 } else { b += 1 }
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{bits, grown, mask};
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn sets_are_sets_of_pixels(a in grown(9, 5), b in grown(9, 5)) {
            let both = |f: fn(bool, bool) -> bool| -> Vec<Vec<bool>> {
                a.iter().zip(&b).map(|(a, b)| a.iter().zip(b).map(|(&a, &b)| f(a, b)).collect()).collect()
            };
            let (one, other) = (mask(&a), mask(&b));
            prop_assert_eq!(bits(&one), a.clone());
            prop_assert_eq!(bits(&one.inverse()), both(|a, _| !a));
            prop_assert_eq!(bits(&one.without(&other)), both(|a, b| a && !b));
            prop_assert_eq!(one.without(&other), mask(&both(|a, b| a && !b)));
            let at = |x: usize, y: usize| a.get(y).and_then(|row| row.get(x)).copied().unwrap_or(true);
            let left: Vec<Vec<bool>> = (0..5_usize)
                .map(|y| {
                    let stays = |x: usize| -> bool {
                        [(x, y), (x + 1, y), (x, y + 1), (x.wrapping_sub(1), y), (x, y.wrapping_sub(1))]
                            .into_iter()
                            .all(|(x, y)| at(x, y))
                    };
                    (0..9).map(stays).collect()
                })
                .collect();
            prop_assert_eq!(bits(&one.eroded()), left);
            let mut shared = 0;
            one.meet(&other, |_, _, pixels| shared += pixels as usize);
            prop_assert_eq!(shared, both(|a, b| a && b).concat().into_iter().filter(|&b| b).count());
        }
    }

    #[test]
    fn rows_that_the_other_has_not_stay() {
        let two = mask(&[vec![true, true], vec![true, false]]);
        assert_eq!(two.without(&Mask::default()), two);
        assert!(Mask::default().is_empty() && Mask::default().inverse().is_empty());
    }
}
