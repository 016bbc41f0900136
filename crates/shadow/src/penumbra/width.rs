//! Widths of penumbrae.
//!
//! `d_l` is the distance from the light to the caster, `d_p` that from the caster to the receiver.

use farsight_geometry::DAabb;
use glam::DVec3;

/// Width on a receiver parallel to a flat light of size `light_size`: s_l·d_p/d_l, half of it to each side of the centre's shadow.
pub fn planar(light_size: f64, d_p: f64, d_l: f64) -> f64 {
    light_size * d_p / d_l
}

/// Width, on a receiver across the ray from the light's centre, of the shadow of an edge in front of a sphere light of `radius` whose
/// centre is `distance` from the edge. Infinite when the edge touches the light.
///
/// The flat formula with s_l = 2R is 0.5 % less at R/D = 0.1 and 15 % at 0.5.
pub fn sphere(radius: f64, distance: f64, d_p: f64) -> f64 {
    if distance <= radius {
        return f64::INFINITY;
    }
    2.0 * radius * d_p / ((distance - radius) * (distance + radius)).sqrt()
}

/// The two sides of a penumbra on a tilted receiver, from the shadow of the light's centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sides {
    /// The shorter side: towards the foot of the perpendicular from the edge.
    pub near: f64,
    /// The longer side; infinite when the light sinks below the receiver's horizon.
    pub far: f64,
}

impl Sides {
    /// Full width.
    pub fn width(&self) -> f64 {
        self.near + self.far
    }
}

/// Widths to both sides on a plane whose normal makes the angle `theta` with the ray from a round light's centre, which appears from the
/// edge with the half angle `half_angle`; `d_p` is measured along that ray. Edge and tilt axis are parallel.
///
/// They are d_p·sin a / cos(θ ∓ a): unequal as soon as the plane is tilted.
pub fn tilted(half_angle: f64, theta: f64, d_p: f64) -> Sides {
    let (sin, theta) = (half_angle.sin(), theta.abs());
    let side = |angle: f64| {
        let cos = angle.cos();
        // Grazing: the outermost ray never meets the plane.
        if angle.abs() >= std::f64::consts::FRAC_PI_2 { f64::INFINITY } else { d_p * sin / cos }
    };
    Sides { near: side(theta - half_angle), far: side(theta + half_angle) }
}

/// Least and largest of d_p and d_l between a light's sphere, casters in a box and receivers in another: every ray is within.
///
/// d_p is the distance of a point of one box to a point of the other, so both ends are attained by some pair of points, but not
/// necessarily by points on one ray: the interval is safe, not tight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distances {
    /// From caster to receiver.
    pub d_p: [f64; 2],
    /// From the light's centre to the caster.
    pub d_l: [f64; 2],
}

impl Distances {
    /// Distances between boxes and the light's centre.
    pub fn between(light: DVec3, caster: &DAabb, receiver: &DAabb) -> Self {
        Self { d_p: box_distances(caster, receiver), d_l: box_distances(&DAabb::new(light, light), caster) }
    }

    /// Interval of [`sphere`] widths over all distances.
    pub fn sphere_widths(&self, radius: f64) -> [f64; 2] {
        [sphere(radius, self.d_l[1], self.d_p[0]), sphere(radius, self.d_l[0], self.d_p[1])]
    }

    /// Interval of [`planar`] widths over all distances.
    pub fn planar_widths(&self, light_size: f64) -> [f64; 2] {
        [planar(light_size, self.d_p[0], self.d_l[1]), planar(light_size, self.d_p[1], self.d_l[0])]
    }
}

/// Least and largest distance between points of two boxes.
fn box_distances(a: &DAabb, b: &DAabb) -> [f64; 2] {
    let gap = (a.min - b.max).max(b.min - a.max).max(DVec3::ZERO);
    let span = (a.max - b.min).abs().max((b.max - a.min).abs());
    [gap.length(), span.length()]
}

/// Shape of a light as an edge sweeps across it: how its brightness is distributed along the way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Profile {
    /// A rectangle, edge parallel to a side: even.
    Rectangle,
    /// A disk or a sphere.
    Disk,
    /// A square, edge along a diagonal; no convex light has a sharper profile.
    Diamond,
}

impl Profile {
    /// Largest density relative to even brightness over the same width: the steepest slope of the shadow times its width.
    pub fn steepest(self) -> f64 {
        match self {
            Self::Rectangle => 1.0,
            Self::Disk => 4.0 / std::f64::consts::PI,
            Self::Diamond => 2.0,
        }
    }

    /// Mean of the positive part of the edge's position, width 1 centred at 0: what a soft shadow of width s ≤ 1 px differs from
    /// a hard one by, at most, per pixel of s, under a box filter of one pixel.
    pub fn hard_error(self) -> f64 {
        match self {
            Self::Rectangle => 1.0 / 8.0,
            Self::Disk => 1.0 / (3.0 * std::f64::consts::PI),
            Self::Diamond => 1.0 / 12.0,
        }
    }
}

/// Largest difference of any pixel (share of the light) between a soft shadow `width_px` ≤ 1 wide and a hard one, box-filtered.
pub fn hard_shadow_error(width_px: f64, profile: Profile) -> f64 {
    width_px * profile.hard_error()
}

/// Whether a hard shadow may stand for a soft one of `width_px` when `tolerance` (share of the light) is allowed: `width_px`/8 ≤ tolerance,
/// whatever the convex light. Never for penumbrae wider than a pixel.
pub fn hard_suffices(width_px: f64, tolerance: f64) -> bool {
    width_px <= 1.0 && hard_shadow_error(width_px, Profile::Rectangle) <= tolerance
}

#[cfg(test)]
mod tests {
    use super::*;
    use farsight_geometry::sampling::{Random, in_box};
    use glam::dvec3;

    /// Where the tangents from the edge to the light's circle meet the receiver, by intersecting lines.
    fn by_tangents(radius: f64, distance: f64, theta: f64, d_p: f64) -> [f64; 2] {
        // The edge at the origin, the light's centre at (0, D); the receiver passes (0, -d_p), tilted by θ.
        let a = (radius / distance).asin();
        let reach = |angle: f64| {
            let ray = [angle.sin(), -angle.cos()];
            let along = [theta.cos(), theta.sin()];
            // t·ray = (0, −d_p) + s·along
            let det = -ray[0] * along[1] + ray[1] * along[0];
            ((ray[0] * d_p) / det).abs()
        };
        [reach(a), reach(-a)]
    }

    #[test]
    fn widths_are_those_of_tangents() {
        for (radius, distance, d_p) in [(0.1, 2.0, 3.0), (0.5, 1.0, 3.0), (1e-3, 5.0, 0.1)] {
            let [a, b] = by_tangents(radius, distance, 0.0, d_p);
            assert!((sphere(radius, distance, d_p) / (a + b) - 1.0).abs() < 1e-12);
            for theta in [0.0, 0.4, 1.0, 1.3] {
                let half = f64::asin(radius / distance);
                if theta + half > 1.5 {
                    continue;
                }
                let [a, b] = by_tangents(radius, distance, theta, d_p);
                let sides = tilted(half, theta, d_p);
                assert!(
                    (sides.near / a.min(b) - 1.0).abs() < 1e-9 && (sides.far / a.max(b) - 1.0).abs() < 1e-9
                );
            }
        }
        // A plane tilted by 80°, the light 0.1 rad in radius.
        let sides = tilted(0.1, 80f64.to_radians(), 3.0);
        assert!((sides.near - 1.10).abs() < 0.01 && (sides.far - 4.02).abs() < 0.01, "{sides:?}");
        assert!(tilted(0.1, 1.5, 1.0).far.is_infinite() && sphere(1.0, 0.9, 1.0).is_infinite());
        // The flat formula's deficit.
        let deficit = |ratio: f64| 1.0 - planar(2.0 * ratio, 1.0, 1.0) / sphere(ratio, 1.0, 1.0);
        assert!((deficit(0.1) - 0.005).abs() < 2e-4 && (deficit(0.5) - 0.134).abs() < 1e-3);
    }

    #[test]
    fn intervals_hold_for_points_of_the_boxes() {
        let mut random = Random::new(7);
        for _ in 0..500 {
            let mut v = || DVec3::from_array(random.units()) * 4.0 - 2.0;
            let (light, a, b) = (v() + DVec3::Z * 9.0, v() + DVec3::Z * 2.0, v() - DVec3::Z * 3.0);
            let (caster, receiver) =
                (DAabb::from_points([a, v() + DVec3::Z]), DAabb::from_points([b, v() - DVec3::Z * 2.0]));
            let all = Distances::between(light, &caster, &receiver);
            let (flat, round) = (all.planar_widths(0.3), all.sphere_widths(0.3));
            for _ in 0..50 {
                let (p, q) = (in_box(&caster, random.units()), in_box(&receiver, random.units()));
                let (d_p, d_l) = (p.distance(q), p.distance(light));
                let inside = |[lo, hi]: [f64; 2], x: f64| x >= lo * (1.0 - 1e-12) && x <= hi * (1.0 + 1e-12);
                assert!(inside(all.d_p, d_p) && inside(all.d_l, d_l));
                assert!(inside(flat, planar(0.3, d_p, d_l)) && inside(round, sphere(0.3, d_l, d_p)));
            }
        }
        let same = DAabb::new(dvec3(0.0, 0.0, 0.0), DVec3::ONE);
        assert_eq!(Distances::between(DVec3::ZERO, &same, &same).d_p, [0.0, 3f64.sqrt()]);
    }

    /// The worst pixel, by sliding a pixel over the soft and the hard edge and integrating numerically.
    #[test]
    fn the_hard_shadow_rule_is_exact() {
        let cumulative = |profile: Profile, x: f64| {
            let x: f64 = x.clamp(-0.5, 0.5);
            match profile {
                Profile::Rectangle => x + 0.5,
                Profile::Disk => {
                    let h = 2.0 * x;
                    0.5 + (h * (1.0 - h * h).sqrt() + h.asin()) / std::f64::consts::PI
                }
                Profile::Diamond if x < 0.0 => 2.0 * (x + 0.5).powi(2),
                Profile::Diamond => 1.0 - 2.0 * (0.5 - x).powi(2),
            }
        };
        for profile in [Profile::Rectangle, Profile::Disk, Profile::Diamond] {
            let width = 0.7;
            let mut worst = 0.0f64;
            let steps = 2000;
            for i in 0..=200 {
                let start = -1.0 + f64::from(i) / 200.0;
                let mean = |f: &dyn Fn(f64) -> f64| {
                    (0..steps).map(|k| f(start + (f64::from(k) + 0.5) / f64::from(steps))).sum::<f64>()
                        / f64::from(steps)
                };
                let soft = mean(&|x| cumulative(profile, x / width));
                let hard = (start + 1.0).clamp(0.0, 1.0);
                worst = worst.max((soft - hard).abs());
            }
            let claimed = hard_shadow_error(width, profile);
            assert!((worst / claimed - 1.0).abs() < 2e-3, "{profile:?} {worst} {claimed}");
            assert!(profile.hard_error() <= 0.125);
            // The steepest slope, by differences.
            let slope = (cumulative(profile, 1e-6) - cumulative(profile, -1e-6)) / 2e-6;
            assert!((slope / profile.steepest() - 1.0).abs() < 1e-5);
        }
        assert!(
            hard_suffices(0.25, 1.0 / 32.0) && !hard_suffices(0.26, 1.0 / 32.0) && !hard_suffices(2.0, 1.0)
        );
    }
}
