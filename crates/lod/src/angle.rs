//! How far a change of viewpoint can turn lines of sight: angles under which points of a box see two eyes.

use farsight_geometry::DAabb;
use glam::DVec3;

/// Largest angle under which any point of a box sees the way from one eye to another, in radians: at most 2·atan(b / 2D) for a way of length b
/// that keeps a distance D from the box. π where it touches.
///
/// The points that see a segment under an angle of θ or more lie within b / (2·tan(θ/2)) of it, the height of the arc over the chord. Never below
/// the truth, rounding included; equal to it where the box has a point right beside the middle of the way.
///
/// ```
/// use farsight_lod::{corner_angle, view_angle};
/// use farsight_lod::{farsight_geometry::DAabb, glam::DVec3};
///
/// // An eye passes a wide slab by one unit, one unit from its face: no corner sees much of that, the middle of the face does.
/// let slab = DAabb::new(DVec3::new(-10.0, -10.0, -1.0), DVec3::new(10.0, 10.0, 0.0));
/// let (a, b) = (DVec3::new(-0.5, 0.0, 1.0), DVec3::new(0.5, 0.0, 1.0));
/// assert!((view_angle(&slab, a, b).to_degrees() - 53.13).abs() < 0.01);
/// assert!(corner_angle(&slab, a, b).to_degrees() < 5.8);
/// ```
///
/// # Cost
/// About 50 ns.
pub fn view_angle(bounds: &DAabb, from: DVec3, to: DVec3) -> f64 {
    let way = from.distance(to) * (1.0 + 4.0 * f64::EPSILON);
    if way == 0.0 || bounds.is_empty() {
        return 0.0;
    }
    // Rounding of the differences, charged to the distance.
    let size = bounds.min.abs().max(bounds.max.abs()).max_element() + from.length() + to.length();
    let distance = distance_to_way(bounds, from, to) * (1.0 - 1e-13) - 16.0 * f64::EPSILON * size;
    if distance <= 0.0 {
        return std::f64::consts::PI;
    }
    (2.0 * (0.5 * way / distance).atan() * (1.0 + 1e-15)).min(std::f64::consts::PI)
}

/// Largest sine of the angles under which points of the box see the way between two eyes, never below the truth: the smaller of two bounds.
///
/// The first is that of [`view_angle`]. For the second, the sine is ∣(p − a) × (b − a)∣ over the product of both distances; the numerator is convex in p, so a
/// corner has its maximum. It is by far the smaller one for an eye that comes nearer or draws back.
pub(crate) fn turn_sine(bounds: &DAabb, from: DVec3, to: DVec3) -> f64 {
    let first = view_angle(bounds, from, to).min(std::f64::consts::FRAC_PI_2).sin() * (1.0 + 1e-15);
    let way = to - from;
    let across = bounds.corners().iter().fold(0.0f64, |most, &c| {
        let ray = c - from;
        most.max(ray.cross(way).length() + 1e-15 * ray.length() * way.length())
    });
    let size = bounds.min.abs().max(bounds.max.abs()).max_element() + from.length() + to.length();
    let below = |eye: DVec3| (distance(bounds, eye) - 4.0 * f64::EPSILON * size).max(0.0);
    let second = across * (1.0 + 1e-14) / (below(from) * below(to));
    // Not a number inside of the box.
    if second < first { second } else { first }
}

/// Largest angle under which a *corner* of the box sees two eyes: the test of the paper, kept for comparison. It is no bound for the other points.
///
/// # References
/// [Hilbert & Brunnett 2004, equation 2].
pub fn corner_angle(bounds: &DAabb, from: DVec3, to: DVec3) -> f64 {
    if bounds.is_empty() {
        return 0.0;
    }
    bounds.corners().iter().map(|&c| angle_at(c, from, to)).fold(0.0, f64::max)
}

/// The angle at `apex` between two points.
fn angle_at(apex: DVec3, a: DVec3, b: DVec3) -> f64 {
    let (a, b) = (a - apex, b - apex);
    a.cross(b).length().atan2(a.dot(b))
}

/// The largest k for which some point of the box may be k times as far from `from` as from `to`: how much what was right at one eye grows at the other.
///
/// Infinite with the second eye in the box. Points more than k times farther from the first lie in a ball around the second (Apollonius); k is found by
/// halving on whether that ball meets the box, and is never below the truth.
pub(crate) fn growth(bounds: &DAabb, from: DVec3, to: DVec3) -> f64 {
    let way = from.distance(to);
    let near = distance(bounds, to);
    if way == 0.0 || bounds.is_empty() {
        return 1.0;
    }
    let farthest = bounds.corners().iter().map(|c| c.distance(to)).fold(0.0, f64::max);
    if near <= 0.0 {
        return f64::INFINITY;
    }
    // The triangle inequality from both sides.
    let (mut low, mut high) = ((1.0 - way / near).max(way / farthest - 1.0).max(0.0), 1.0 + way / near);
    for _ in 0..24 {
        let k = 0.5 * (low + high);
        if stays_below(bounds, from, to, k) { high = k } else { low = k }
    }
    high * (1.0 + 1e-12)
}

/// Whether no point of the box is more than k times as far from `from` as from `to`.
fn stays_below(bounds: &DAabb, from: DVec3, to: DVec3, k: f64) -> bool {
    // ∣p − from∣² ≤ k²·∣p − to∣², multiplied out: (k² − 1)·∣p∣² + 2p·(from − k²·to) + … ≥ 0, around `to`.
    let (w, q) = (from - to, k * k - 1.0);
    let f = |p: DVec3| {
        let p = p - to;
        q * p.length_squared() + 2.0 * p.dot(w) - w.length_squared()
    };
    if q <= 0.0 {
        // Concave: least at a corner.
        return bounds.corners().iter().all(|&c| f(c) >= 0.0);
    }
    // Convex with round level sets around −w/q: least at the point of the box nearest to it.
    let middle = to - w / q;
    let least = f(bounds.closest_point(middle));
    least >= 1e-12 * w.length_squared()
}

/// Distance of a box from a point.
pub(crate) fn distance(bounds: &DAabb, point: DVec3) -> f64 {
    bounds.closest_point(point).distance(point)
}

/// Distance of a box from a segment. The squared distance is convex along it, and its slope linear between the places where the segment crosses
/// the planes of the box's faces.
pub(crate) fn distance_to_way(bounds: &DAabb, from: DVec3, to: DVec3) -> f64 {
    let step = to - from;
    let at = |t: f64| from + step * t;
    // Half the slope of the squared distance.
    let slope = |t: f64| {
        let p = at(t);
        (p - bounds.closest_point(p)).dot(step)
    };
    let mut bends = [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    for axis in 0..3 {
        for (i, face) in [bounds.min[axis], bounds.max[axis]].into_iter().enumerate() {
            let t = (face - from[axis]) / step[axis];
            bends[2 + 2 * axis + i] = if t.is_finite() { t.clamp(0.0, 1.0) } else { 0.0 };
        }
    }
    bends.sort_by(f64::total_cmp);
    let nearest = bends.windows(2).find_map(|ends| {
        let (a, b) = (slope(ends[0]), slope(ends[1]));
        (b >= 0.0).then(|| if a >= 0.0 { ends[0] } else { ends[0] + (ends[1] - ends[0]) * (a / (a - b)) })
    });
    let t = nearest.unwrap_or(1.0);
    distance(bounds, at(t)).min(distance(bounds, from)).min(distance(bounds, to))
}

#[cfg(test)]
mod tests {
    use super::*;
    use farsight_geometry::sampling::{Random, in_box};

    fn configurations(seed: u64, count: u32, mut check: impl FnMut(&DAabb, DVec3, DVec3, &mut Random)) {
        let mut random = Random::new(seed);
        for i in 0..count {
            let mut v = || DVec3::from_array(random.units()) * 2.0 - 1.0;
            // Cubes, plates, needles, points.
            let shape =
                DVec3::new(1.0, [1.0, 1e-3, 0.0][i as usize % 3], [1.0, 1e-2, 0.0][i as usize / 3 % 3]);
            let center = v() * 3.0;
            let bounds = DAabb::new(center - shape, center + shape);
            let from = v() * 6.0;
            let to = from + v() * [4.0, 0.3, 1e-3][i as usize / 9 % 3];
            check(&bounds, from, to, &mut random);
        }
    }

    #[test]
    fn no_point_of_the_box_sees_a_larger_angle_or_ratio() {
        let (mut tightest, mut closest) = (0.0f64, 0.0f64);
        configurations(5, 4000, |bounds, from, to, random| {
            let (angle, ratio) = (view_angle(bounds, from, to), growth(bounds, from, to));
            let sine = turn_sine(bounds, from, to);
            for _ in 0..200 {
                // Corners and faces as often as the inside.
                let u: [f64; 3] = random.units();
                let u = u.map(|x| if random.unit() < 0.5 { x } else { x.round() });
                let p = in_box(bounds, u);
                let seen = angle_at(p, from, to);
                assert!(seen <= angle, "{seen} {angle}");
                // Rounding of the seen angle, a difference of directions that may be almost equal.
                assert!(seen.sin() <= sine + 1e-15, "{} {sine}", seen.sin());
                let grown = p.distance(from) / p.distance(to);
                assert!(grown <= ratio, "{grown} {ratio}");
                (tightest, closest) = (tightest.max(seen / angle), closest.max(grown / ratio));
            }
        });
        println!("tightest: angle {tightest:.3}, ratio {closest:.3}");
        assert!(tightest > 0.99 && closest > 0.999);
    }

    #[test]
    fn distance_to_a_way_is_that_of_dense_samples() {
        configurations(6, 3000, |bounds, from, to, _| {
            let samples = (0..=1000).map(|i| distance(bounds, from.lerp(to, f64::from(i) / 1000.0)));
            let least = samples.fold(f64::INFINITY, f64::min);
            let exact = distance_to_way(bounds, from, to);
            assert!(exact <= least && exact >= least - from.distance(to) / 1000.0, "{exact} {least}");
        });
    }

    #[test]
    fn corners_are_not_a_bound() {
        let mut missed = 0;
        configurations(7, 2000, |bounds, from, to, random| {
            let corner = corner_angle(bounds, from, to);
            assert!(corner <= view_angle(bounds, from, to));
            let inside = (0..100).any(|_| angle_at(in_box(bounds, random.units()), from, to) > 1.01 * corner);
            missed += u32::from(inside);
        });
        assert!(missed > 100, "{missed}");
    }
}
