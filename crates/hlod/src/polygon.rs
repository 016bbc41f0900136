//! Small convex polygons, cut by lines.

/// Most corners of a polygon.
pub(crate) const CORNERS: usize = 12;

/// A convex polygon with corners of any kind that can be interpolated.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Polygon<P> {
    corners: [P; CORNERS],
    len: usize,
}

/// What lies between two corners.
pub(crate) trait Between: Copy + Default {
    /// `t` of the way from `self` to `other`.
    fn between(self, other: Self, t: f64) -> Self;
}

impl Between for glam::DVec3 {
    #[inline]
    fn between(self, other: Self, t: f64) -> Self {
        self + (other - self) * t
    }
}

impl<const N: usize> Between for [f64; N]
where
    Self: Default,
{
    #[inline]
    fn between(self, other: Self, t: f64) -> Self {
        std::array::from_fn(|i| self[i] + (other[i] - self[i]) * t)
    }
}

impl<P: Between> Polygon<P> {
    pub(crate) fn new(corners: [P; 3]) -> Self {
        let mut all = [P::default(); CORNERS];
        all[..3].copy_from_slice(&corners);
        Self { corners: all, len: 3 }
    }

    #[inline(always)]
    pub(crate) fn corners(&self) -> &[P] {
        &self.corners[..self.len]
    }

    #[inline]
    fn push(&mut self, corner: P) {
        self.corners[self.len] = corner;
        self.len += 1;
    }

    /// A value at each corner, and whether there are positive and negative ones.
    #[inline(always)]
    fn values(&self, value: impl Fn(P) -> f64) -> ([f64; CORNERS], bool, bool) {
        let mut values = [0.0; CORNERS];
        let (mut above, mut below) = (false, false);
        for (v, &c) in values.iter_mut().zip(self.corners()) {
            *v = value(c);
            above |= *v > 0.0;
            below |= *v < 0.0;
        }
        (values, above, below)
    }

    /// The part where `value` is not negative, and the part where it is not positive; none for a part without a corner off
    /// the line. `None` when there is no room for the corners, or rounding has bent the polygon so that the line crosses it twice.
    pub(crate) fn cut(&self, value: impl Fn(P) -> f64) -> Option<(Option<Self>, Option<Self>)> {
        let (values, above, below) = self.values(value);
        if !(above && below) {
            return Some((above.then_some(*self), below.then_some(*self)));
        }
        if self.is_full() {
            return None;
        }
        let empty = Self { corners: [P::default(); CORNERS], len: 0 };
        let (mut up, mut down, mut crossings) = (empty, empty, 0);
        for i in 0..self.len {
            let j = if i + 1 == self.len { 0 } else { i + 1 };
            let (a, b) = (values[i], values[j]);
            if a >= 0.0 {
                up.push(self.corners[i]);
            }
            if a <= 0.0 {
                down.push(self.corners[i]);
            }
            if (a > 0.0 && b < 0.0) || (a < 0.0 && b > 0.0) {
                crossings += 1;
                if crossings > 2 {
                    return None;
                }
                let crossing = self.corners[i].between(self.corners[j], a / (a - b));
                up.push(crossing);
                down.push(crossing);
            }
        }
        Some((Some(up), Some(down)))
    }

    /// [`cut`](Self::cut), keeping the first part only; `false` when there is none.
    pub(crate) fn clip(&mut self, value: impl Fn(P) -> f64) -> Option<bool> {
        let (values, above, below) = self.values(value);
        if !(above && below) {
            return Some(above);
        }
        if self.is_full() {
            return None;
        }
        let (old, len) = (self.corners, self.len);
        let mut crossings = 0;
        self.len = 0;
        for i in 0..len {
            let j = if i + 1 == len { 0 } else { i + 1 };
            let (a, b) = (values[i], values[j]);
            if a >= 0.0 {
                self.push(old[i]);
            }
            if (a > 0.0 && b < 0.0) || (a < 0.0 && b > 0.0) {
                crossings += 1;
                if crossings > 2 {
                    return None;
                }
                self.push(old[i].between(old[j], a / (a - b)));
            }
        }
        Some(true)
    }

    /// Whether there is no room for the two corners that a cut adds at most.
    pub(crate) fn is_full(&self) -> bool {
        self.len + 2 > CORNERS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(p: &Polygon<[f64; 2]>) -> f64 {
        let c = p.corners();
        (0..c.len())
            .map(|i| (c[i], c[(i + 1) % c.len()]))
            .map(|(a, b)| 0.5 * (a[0] * b[1] - a[1] * b[0]))
            .sum()
    }

    #[test]
    fn parts_have_the_area_of_the_whole() {
        let mut pieces = vec![Polygon::new([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])];
        for i in 0..7 {
            let (s, c) = f64::from(i).sin_cos();
            pieces = pieces
                .iter()
                .flat_map(|p| {
                    let line = |x: [f64; 2]| (x[0] - 0.3) * s + (x[1] - 0.25) * c - 0.02;
                    let (up, down) = p.cut(line).unwrap();
                    let mut clipped = *p;
                    assert_eq!(clipped.clip(line), Some(up.is_some()));
                    assert!(up.is_none_or(|up| up.corners() == clipped.corners()));
                    [up, down].into_iter().flatten()
                })
                .collect();
            assert!((pieces.iter().map(area).sum::<f64>() - 0.5).abs() < 1e-12);
        }
        assert!(pieces.len() > 15 && pieces.iter().all(|p| area(p) > 0.0));
        let (up, down) = pieces[0].cut(|_| 1.0).unwrap();
        assert!(up.is_some() && down.is_none());
    }
}
