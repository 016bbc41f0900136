//! The point of a triangle closest to a point.

use glam::DVec3;

/// Relative squared area below which the plane of a triangle is not trusted alone: a height of 1e-6 of the sides.
const THIN: f64 = 1e-12;

/// The point of the segment from `a` to `b` closest to `p`; segments without length are points.
pub fn closest_on_segment(a: DVec3, b: DVec3, p: DVec3) -> DVec3 {
    let ab = b - a;
    let length_sq = ab.length_squared();
    if length_sq == 0.0 {
        return a;
    }
    a + ab * ((p - a).dot(ab) / length_sq).clamp(0.0, 1.0)
}

/// The point of a triangle closest to `p`. Any three points are a triangle, also on a line or in one place.
///
/// # Accuracy
/// The answer lies on the triangle up to a few units in the last place of its coordinates, so its distance to `p` is an
/// upper bound up to that rounding, however thin the triangle. Where the height is below 1e-6 of the sides, that
/// distance may exceed the least one by up to half the height.
pub fn closest_on_triangle([a, b, c]: [DVec3; 3], p: DVec3) -> DVec3 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let normal = ab.cross(ac);
    let area_sq = normal.length_squared();
    let nearer = |x: DVec3, y: DVec3| if y.distance_squared(p) < x.distance_squared(p) { y } else { x };
    let mut inside = a;
    if area_sq > 0.0 {
        let v = ap.cross(ac).dot(normal) / area_sq;
        let w = ab.cross(ap).dot(normal) / area_sq;
        if v >= 0.0 && w >= 0.0 && v + w <= 1.0 {
            inside = a + ab * v + ac * w;
            if area_sq > THIN * ab.length_squared() * ac.length_squared() {
                return inside;
            }
        }
    }
    let on_border =
        nearer(nearer(closest_on_segment(a, b, p), closest_on_segment(b, c, p)), closest_on_segment(c, a, p));
    nearer(inside, on_border)
}

/// A certain lower bound of the distance from `p` to a triangle, given a point `near` the closest one.
///
/// The plane through the closest point across the line to `p` has the whole triangle behind it; the nearest
/// corner along that line bounds the distance, whatever `near` is. Rounding is of the order of the last place of
/// the coordinates, which the caller adds.
pub(super) fn distance_below(corners: [DVec3; 3], p: DVec3, near: DVec3) -> f64 {
    let toward = (near - p).normalize_or_zero();
    corners.iter().map(|&c| toward.dot(c - p)).fold(f64::INFINITY, f64::min).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;

    /// Dense sampling of the triangle, the obvious slow way.
    fn sampled(t: [DVec3; 3], p: DVec3) -> f64 {
        let n = 200;
        let mut best = f64::INFINITY;
        for i in 0..=n {
            for j in 0..=(n - i) {
                let (v, w) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(n));
                best = best.min((t[0] + (t[1] - t[0]) * v + (t[2] - t[0]) * w).distance(p));
            }
        }
        best
    }

    #[test]
    fn closest_points_agree_with_sampling_and_are_enclosed() {
        let shapes = [
            [DVec3::ZERO, DVec3::X, DVec3::Y],
            [DVec3::ZERO, DVec3::X, dvec3(0.5, 1e-7, 0.0)],
            [DVec3::ZERO, DVec3::X, DVec3::X * 3.0],
            [DVec3::ONE; 3],
            [dvec3(1.0, 2.0, 3.0), dvec3(-2.0, 0.1, 0.4), dvec3(0.3, 5.0, -1.0)],
        ];
        for t in shapes {
            for i in 0..200 {
                let x = f64::from(i);
                let p = dvec3((x * 1.1).sin(), (x * 1.7).cos(), (x * 0.3).sin()) * 3.0;
                let closest = closest_on_triangle(t, p);
                let (exact, slow) = (closest.distance(p), sampled(t, p));
                assert!(exact <= slow + 1e-12 && slow < exact + 0.04, "{t:?} {p}");
                let below = distance_below(t, p, closest);
                assert!(below <= exact + 1e-12 && below > exact - 1e-9, "{t:?} {p} {below} {exact}");
            }
        }
    }

    #[test]
    fn a_wrong_guess_still_gives_a_valid_lower_bound() {
        let t = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let p = dvec3(0.2, 0.2, 1.0);
        assert!(distance_below(t, p, DVec3::X) <= 1.0);
        assert_eq!(distance_below(t, p, p), 0.0);
    }
}
