//! A triangle prepared for many questions: where does a point lie over it, how far is it.

use glam::DVec3;

/// Longest side over height above which a triangle is too thin to certify anything with.
const THINNEST: f64 = 1e5;

/// What a point looks like from a facet: barycentric coordinates of its foot, and its height.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Shadow {
    pub l: [f64; 3],
    pub h: f64,
}

/// A triangle with the gradients of its barycentric coordinates.
#[derive(Clone, Debug)]
pub(crate) struct Facet {
    pub corners: [DVec3; 3],
    /// Of the second and third barycentric coordinate.
    gradients: [DVec3; 2],
    pub normal: DVec3,
    /// Of the sides opposite to each corner.
    inverse_sq: [f64; 3],
    double_area_sq: f64,
}

impl Facet {
    /// `None` for triangles whose plane rounding would spoil.
    pub(crate) fn new(corners: [DVec3; 3]) -> Option<Self> {
        let (e1, e2) = (corners[1] - corners[0], corners[2] - corners[0]);
        let opposite = corners[2] - corners[1];
        let sq = [opposite.length_squared(), e2.length_squared(), e1.length_squared()];
        let longest_sq = sq[0].max(sq[1]).max(sq[2]);
        let cross = e1.cross(e2);
        let double_area = cross.length();
        // Longest side / height = longest² / double area; also false for NaN.
        if !(double_area * THINNEST > longest_sq && double_area > 1e-30) {
            return None;
        }
        let inverse = 1.0 / double_area;
        let normal = cross * inverse;
        Some(Self {
            corners,
            gradients: [e2.cross(normal) * inverse, normal.cross(e1) * inverse],
            normal,
            inverse_sq: sq.map(|s| 1.0 / s),
            double_area_sq: double_area * double_area,
        })
    }

    #[inline(always)]
    pub(crate) fn shadow(&self, p: DVec3) -> Shadow {
        let x = p - self.corners[0];
        let (l1, l2) = (x.dot(self.gradients[0]), x.dot(self.gradients[1]));
        Shadow { l: [1.0 - l1 - l2, l1, l2], h: x.dot(self.normal) }
    }

    /// One barycentric coordinate of a point.
    #[inline(always)]
    pub(crate) fn coordinate(&self, i: usize, p: DVec3) -> f64 {
        self.shadow(p).l[i]
    }

    /// The point of the facet's plane with these barycentric coordinates.
    #[inline]
    pub(crate) fn at(&self, l: [f64; 3]) -> DVec3 {
        self.corners[0] * l[0] + self.corners[1] * l[1] + self.corners[2] * l[2]
    }

    /// Squared distance of `p` to the facet. The nearest point lies on a side that `p` is outside of, if there is one.
    #[inline(always)]
    pub(crate) fn distance_sq(&self, p: DVec3, s: &Shadow) -> f64 {
        if s.l[0] >= 0.0 && s.l[1] >= 0.0 && s.l[2] >= 0.0 {
            return s.h * s.h;
        }
        let mut best = f64::INFINITY;
        for i in 0..3 {
            if s.l[i] < 0.0 {
                let (a, b) = (self.corners[(i + 1) % 3], self.corners[(i + 2) % 3]);
                let (x, e) = (p - a, b - a);
                let t = (x.dot(e) * self.inverse_sq[i]).clamp(0.0, 1.0);
                best = best.min((x - e * t).length_squared());
            }
        }
        best
    }

    /// [`distance_sq`](Self::distance_sq) where it is within the limit, otherwise infinite. Most of what is too far is so by its height and the
    /// distance to the line of one side, which need no branches.
    #[inline(always)]
    pub(crate) fn distance_sq_within(&self, p: DVec3, limit_sq: f64) -> f64 {
        let s = self.shadow(p);
        // A coordinate is the distance to a side over the height on it, which is the double area over the side.
        let beyond = |i: usize| {
            let l = if s.l[i] < 0.0 { s.l[i] } else { 0.0 };
            l * l * self.inverse_sq[i]
        };
        let larger = |a: f64, b: f64| if a > b { a } else { b };
        let off_sq = larger(larger(beyond(0), beyond(1)), beyond(2)) * self.double_area_sq;
        if s.h * s.h + off_sq > limit_sq {
            return f64::INFINITY;
        }
        let distance_sq = self.distance_sq(p, &s);
        if distance_sq <= limit_sq { distance_sq } else { f64::INFINITY }
    }

    #[inline]
    pub(crate) fn distance_sq_to(&self, p: DVec3) -> f64 {
        self.distance_sq(p, &self.shadow(p))
    }
}

/// Squared distance to a segment; one without length is a point.
pub(crate) fn segment_distance_sq(a: DVec3, b: DVec3, p: DVec3) -> f64 {
    let (x, e) = (p - a, b - a);
    let length_sq = e.length_squared();
    let t = if length_sq > 0.0 { (x.dot(e) / length_sq).clamp(0.0, 1.0) } else { 0.0 };
    (x - e * t).length_squared()
}

/// Squared distance to any three points as a triangle. Thin ones are their sides: never below the true distance.
pub(crate) fn triangle_distance_sq(corners: [DVec3; 3], p: DVec3) -> f64 {
    match Facet::new(corners) {
        Some(facet) => facet.distance_sq_to(p),
        None => (0..3)
            .map(|i| segment_distance_sq(corners[i], corners[(i + 1) % 3], p))
            .fold(f64::INFINITY, f64::min),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use farsight_geometry::distance::closest_on_triangle;
    use glam::dvec3;

    #[test]
    fn distances_agree_with_the_yardstick() {
        let mut seed = 1u64;
        let mut random = || {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (seed >> 33) as f64 / (1u64 << 31) as f64 - 0.5
        };
        let mut facets = 0;
        for i in 0..20_000 {
            let squash = if i % 3 == 0 { 1e-4 } else { 1.0 };
            let t = [0; 3].map(|_| dvec3(random(), random() * squash, random() * squash));
            let p = dvec3(random(), random(), random()) * 2.0;
            let expected = closest_on_triangle(t, p).distance(p);
            assert!((triangle_distance_sq(t, p).sqrt() - expected).abs() < 1e-10);
            let Some(f) = Facet::new(t) else { continue };
            facets += 1;
            let s = f.shadow(p);
            assert!((f.at(s.l) + f.normal * s.h).distance(p) < 1e-9);
        }
        assert!(facets > 10_000);
        assert!(Facet::new([DVec3::ZERO; 3]).is_none());
        assert!(Facet::new([DVec3::ZERO, DVec3::X, dvec3(0.5, 1e-6, 0.0)]).is_none());
    }
}
