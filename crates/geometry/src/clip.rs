//! Polygons in homogeneous clip space, cut by half-spaces.

use glam::DVec4;

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

    /// Keeps the part where `inside`, a linear function, is not negative.
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
                self.push(a + (b - a) * (da / (da - db)));
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
