//! Polygons in homogeneous clip space, cut by half-spaces.

use glam::DVec4;

/// Which sides of triangles count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Faces {
    /// Both.
    #[default]
    Both,
    /// Those that appear counter-clockwise, as when back faces are culled.
    Front,
}

/// A convex polygon in clip space with room for `N` corners; a triangle cut by k planes needs k + 3.
///
/// Cutting before the division by w keeps corners behind the eye from wrapping around.
///
/// ```
/// use farsight_geometry::clip::ClipPolygon;
/// use farsight_geometry::glam::dvec4;
///
/// let mut polygon = ClipPolygon::<4>::new([dvec4(-1.0, 0.0, 0.0, 1.0), dvec4(1.0, 0.0, 0.0, 1.0), dvec4(1.0, 1.0, 0.0, 1.0)]);
/// polygon.cut(|p| p.x); // keeps what lies at x ≥ 0
/// assert_eq!(polygon.corners().len(), 4);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct ClipPolygon<const N: usize> {
    corners: [DVec4; N],
    count: usize,
}

impl<const N: usize> ClipPolygon<N> {
    /// A triangle.
    ///
    /// # Panics
    /// When `N` is below three.
    pub fn new(triangle: [DVec4; 3]) -> Self {
        let mut corners = [DVec4::ZERO; N];
        corners[..3].copy_from_slice(&triangle);
        Self { corners, count: 3 }
    }

    /// The corners, in the order of the triangle's.
    pub fn corners(&self) -> &[DVec4] {
        &self.corners[..self.count]
    }

    /// Keeps the part where `inside`, a linear function, is not negative. Polygons with a common side get the same corner on it, to the last bit.
    pub fn cut(&mut self, inside: impl Fn(DVec4) -> f64) {
        let (old, count) = (self.corners, self.count);
        self.count = 0;
        for i in 0..count {
            let (a, b) = (old[i], old[(i + 1) % count]);
            let (da, db) = (inside(a), inside(b));
            if da >= 0.0 {
                self.push(a);
            }
            if (da >= 0.0) != (db >= 0.0) {
                // From inside to outside, whichever way the side is gone along.
                let (from, to, d, beyond) = if da >= 0.0 { (a, b, da, db) } else { (b, a, db, da) };
                self.push(from + (to - from) * (d / (d - beyond)));
            }
        }
    }

    fn push(&mut self, p: DVec4) {
        // Rounding may let a sliver cross a plane more often than a convex polygon can; what is lost has no area.
        if self.count < N {
            self.corners[self.count] = p;
            self.count += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::Random;

    #[test]
    fn a_common_side_is_cut_alike_from_both_triangles() {
        let mut random = Random::new(2);
        let mut cuts = 0;
        for _ in 0..2000 {
            let mut corner = || DVec4::from_array(random.units()) * 2.0 - DVec4::ONE;
            let [a, b, c, d] = [corner(), corner(), corner(), corner()];
            let inside = |p: DVec4| p.w + 0.3 * p.x - 0.1;
            let on_side = |triangle| {
                let mut polygon = ClipPolygon::<4>::new(triangle);
                polygon.cut(inside);
                polygon.corners().to_vec()
            };
            let (left, right) = (on_side([a, b, c]), on_side([b, a, d]));
            if (inside(a) >= 0.0) != (inside(b) >= 0.0) {
                let common = left.iter().filter(|p| right.contains(p)).count();
                assert_eq!(common, 2, "an end and the crossing");
                cuts += 1;
            }
        }
        assert!(cuts > 500);
    }
}
