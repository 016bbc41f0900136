//! Decisions on a sign that are never wrong.
//!
//! A determinant is first computed in plain `f64` beside a bound on its rounding error; only when it is smaller
//! than the bound does the slower exact evaluation of the `robust` crate decide (adaptive precision after Shewchuk 1997).
//! Inputs are `f32` or `f64` coordinates taken as they stand; coordinates must be finite and, where not zero, of a size between 1e-60 and
//! 1e75, so that no product underflows or overflows. Any `f32` value is within that range.

use glam::{DVec2, DVec3, Vec3};
use std::cmp::Ordering;

/// On which side of a plane or line something lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Sign {
    /// The determinant is below zero.
    Negative,
    /// The determinant is exactly zero.
    Zero,
    /// The determinant is above zero.
    Positive,
}

impl Sign {
    fn of(x: f64) -> Self {
        match x.total_cmp(&0.0) {
            _ if x == 0.0 => Sign::Zero,
            Ordering::Less => Sign::Negative,
            _ => Sign::Positive,
        }
    }

    /// The opposite side.
    #[must_use]
    pub fn flipped(self) -> Self {
        match self {
            Sign::Negative => Sign::Positive,
            Sign::Zero => Sign::Zero,
            Sign::Positive => Sign::Negative,
        }
    }
}

/// Error bound of the 2x2 filter: 3 roundings, Shewchuk's `ccwerrboundA`.
const ERROR_2D: f64 = (3.0 + 16.0 * UNIT) * UNIT;
/// Error bound of the 3x3 filter: Shewchuk's `o3derrboundA`.
const ERROR_3D: f64 = (7.0 + 56.0 * UNIT) * UNIT;
const UNIT: f64 = crate::rounding::UNIT_F64;

/// Whether `a`, `b`, `c` turn counter-clockwise (positive), clockwise (negative) or lie on a line (zero).
///
/// # Cost
/// About 3 ns when the filter decides, 20 ns when it cannot.
pub fn orient2d(a: DVec2, b: DVec2, c: DVec2) -> Sign {
    let left = (a.x - c.x) * (b.y - c.y);
    let right = (a.y - c.y) * (b.x - c.x);
    let det = left - right;
    if det.abs() > ERROR_2D * (left.abs() + right.abs()) {
        return Sign::of(det);
    }
    let coord = |p: DVec2| robust::Coord { x: p.x, y: p.y };
    Sign::of(robust::orient2d(coord(a), coord(b), coord(c)))
}

/// On which side of the plane through `a`, `b`, `c` the point `d` lies.
///
/// Positive when `a`, `b`, `c` appear counter-clockwise seen from `d`: the triangle's front faces `d`. Zero when all
/// four lie in a plane, in particular when `a`, `b`, `c` lie on a line.
///
/// ```
/// use farsight_geometry::predicates::{Sign, orient3d};
/// use farsight_geometry::glam::DVec3;
///
/// let [a, b, c] = [DVec3::ZERO, DVec3::X, DVec3::Y];
/// assert_eq!(orient3d(a, b, c, DVec3::Z), Sign::Positive);
/// assert_eq!(orient3d(a, b, c, DVec3::new(0.3, 0.3, 0.0)), Sign::Zero);
/// ```
///
/// # Cost
/// About 6 ns when the filter decides, 0.2 µs when it cannot.
pub fn orient3d(a: DVec3, b: DVec3, c: DVec3, d: DVec3) -> Sign {
    let (ad, bd, cd) = (a - d, b - d, c - d);
    let (p, q) = (bd.x * cd.y, cd.x * bd.y);
    let (r, s) = (cd.x * ad.y, ad.x * cd.y);
    let (t, u) = (ad.x * bd.y, bd.x * ad.y);
    let det = ad.z * (p - q) + bd.z * (r - s) + cd.z * (t - u);
    let size = (p.abs() + q.abs()) * ad.z.abs()
        + (r.abs() + s.abs()) * bd.z.abs()
        + (t.abs() + u.abs()) * cd.z.abs();
    // Positive here means clockwise from `d`; our convention is the opposite.
    if det.abs() > ERROR_3D * size {
        return Sign::of(-det);
    }
    let coord = |p: DVec3| robust::Coord3D { x: p.x, y: p.y, z: p.z };
    Sign::of(-robust::orient3d(coord(a), coord(b), coord(c), coord(d)))
}

/// [`orient3d`] of `f32` points.
pub fn orient3d_f32(a: Vec3, b: Vec3, c: Vec3, d: Vec3) -> Sign {
    orient3d(a.as_dvec3(), b.as_dvec3(), c.as_dvec3(), d.as_dvec3())
}

/// Whether three points lie exactly on a line; true when two of them coincide.
///
/// They do exactly when they do in the projections along all three axes.
pub fn collinear(a: DVec3, b: DVec3, c: DVec3) -> bool {
    [0, 1, 2].into_iter().all(|axis| {
        let flat = |p: DVec3| DVec2::new(p[(axis + 1) % 3], p[(axis + 2) % 3]);
        orient2d(flat(a), flat(b), flat(c)) == Sign::Zero
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Determinant in integer arithmetic: exact for coordinates below 2^20.
    fn integer_orient3d(p: [[i64; 3]; 4]) -> Sign {
        let d = |i: usize, k: usize| i128::from(p[i][k] - p[3][k]);
        let minor = |i: usize, j: usize| d(i, 0) * d(j, 1) - d(j, 0) * d(i, 1);
        let det = d(0, 2) * minor(1, 2) + d(1, 2) * minor(2, 0) + d(2, 2) * minor(0, 1);
        Sign::of(-(det.signum() as f64))
    }

    fn random(seed: &mut u64, range: i64) -> i64 {
        *seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (*seed >> 33) as i64 % (2 * range + 1) - range
    }

    #[test]
    fn signs_equal_integer_arithmetic_on_near_coplanar_points() {
        let mut seed = 7;
        let mut zeros = 0;
        for round in 0..60_000 {
            let range = [3, 40, 1_000_000][round % 3];
            // Two directions span a plane; the fourth point is on it or one unit off.
            let mut p = [[0i64; 3]; 4];
            p.iter_mut().flatten().for_each(|x| *x = random(&mut seed, range));
            let (s, t) = (random(&mut seed, 2), random(&mut seed, 2));
            for k in 0..3 {
                p[3][k] = p[0][k] + s * (p[1][k] - p[0][k]) + t * (p[2][k] - p[0][k]);
            }
            p[3][round % 3] += random(&mut seed, 1);
            // Scaling by a power of two and storing as f64 is exact, and so the answer stays.
            let f = p.map(|q| DVec3::from_array(q.map(|x| x as f64 * 2f64.powi(-30))));
            let expected = integer_orient3d(p);
            zeros += usize::from(expected == Sign::Zero);
            assert_eq!(orient3d(f[0], f[1], f[2], f[3]), expected, "{p:?}");
            assert_eq!(orient3d(f[1], f[0], f[2], f[3]), expected.flipped());
        }
        assert!(zeros > 10_000, "the exact path must be taken: {zeros}");
    }

    #[test]
    fn plain_arithmetic_would_be_wrong_where_we_are_right() {
        // Points of a tilted coplanar grid far from the origin, stored in f32.
        let at =
            |i: i32, j: i32| Vec3::new(1e4 + i as f32 * 0.1, j as f32 * 0.1, 0.3 * (1e4 + i as f32 * 0.1));
        let mut wrong = 0;
        for i in 0..30 {
            for j in 0..30 {
                let [a, b, c, d] = [at(0, 0), at(29, 3), at(5, 27), at(i, j)];
                let naive = (b - a).cross(c - a).dot(d - a);
                wrong += usize::from(Sign::of(f64::from(naive)) != orient3d_f32(a, b, c, d));
            }
        }
        assert!(wrong > 0);
    }

    #[test]
    fn turning_and_lines() {
        let [o, x, y] = [DVec2::ZERO, DVec2::X, DVec2::Y];
        assert_eq!(orient2d(o, x, y), Sign::Positive);
        assert_eq!(orient2d(o, y, x), Sign::Negative);
        assert_eq!(orient2d(o, x, DVec2::new(0.1 + 0.2, 0.0)), Sign::Zero);
        let line = DVec3::new(1.0, 3.0, 7.0);
        assert!(collinear(DVec3::ZERO, line, line * 3.0) && collinear(line, line, DVec3::X));
        assert!(!collinear(DVec3::ZERO, line, line * 3.0 + DVec3::new(0.0, 0.0, 1e-14)));
    }
}
