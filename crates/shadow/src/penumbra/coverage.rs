//! How much of a light is seen past an occluder's edge, or past a ball.
//!
//! Two shares are told apart by name. *Area* shares count a light's area (disk, polygon) or solid angle (sphere); *irradiance* shares weigh
//! it with the cosine at the receiver and its foreshortening, as light does. For a square light they differ by 3e-4, 0.008, 0.027,
//! 0.076 when its side is 0.1, 0.5, 1, 2 times its distance.
//!
//! Arguments and results are `f32`. Differences of nearly equal areas are taken in `f64`: in `f32` the exact formulas for spheres are wrong
//! by 0.2 % at an angular radius of 0.1 rad, by 12 % at 0.02, and meaningless at the sun's 0.0047. Where a shader has only
//! `f32`, [`disk_past_disk`] with sines for radii is the form to use below 0.1 rad; it is off by 2.6e-4 there, by 8e-7 for the sun.

use glam::{DVec2, DVec3, Vec3};
use std::f64::consts::PI;

/// Share of a disk's area beyond a line at the distance `h` (in radii) from its centre: 0 from h = 1 on, 1 up to −1.
///
/// # Accuracy
/// 3e-7 of the exact (acos h − h·√(1 − h²))/π.
pub fn disk_past_half_plane(h: f32) -> f32 {
    let h = h.clamp(-1.0, 1.0);
    // acos h loses digits near ±1; the arc tangent of the half chord does not.
    let chord = ((1.0 - h) * (1.0 + h)).sqrt();
    ((chord.atan2(h) - h * chord) / std::f32::consts::PI).clamp(0.0, 1.0)
}

/// Below this angular radius (radians) a sphere light is taken as a disk, which is then within 1e-6.
const FLAT_BELOW: f64 = 0.005;

/// Share of the solid angle of a sphere light of angular radius `light` that an edge leaves visible; the plane through receiver
/// and edge passes the light's centre at the angle `offset`, positive when it hides the centre.
///
/// # Accuracy
/// 1e-6 for light radii up to 1.4 rad.
pub fn sphere_past_half_space(offset: f32, light: f32) -> f32 {
    let (d, a) = (f64::from(offset), f64::from(light));
    if a < FLAT_BELOW {
        let h = if a > 0.0 { d / a } else { d.signum() };
        return disk_past_half_plane(h as f32);
    }
    if d.abs() >= a {
        return if d > 0.0 { 0.0 } else { 1.0 };
    }
    let area = acos(d.sin() / a.sin()) - a.cos() * acos(d.tan() / a.tan());
    (area / (PI * one_minus_cos(a))).clamp(0.0, 1.0) as f32
}

/// Share of the solid angle of a sphere light of angular radius `light` that a ball of angular radius `ball` leaves visible, their centres
/// being `separation` apart (radians, all up to π/2).
///
/// # Accuracy
/// 1e-5 for light radii from 1e-4 to 1.4 rad.
pub fn sphere_past_sphere(separation: f32, light: f32, ball: f32) -> f32 {
    let [d, a, b] = [separation, light, ball].map(|x| f64::from(x).max(0.0));
    if d >= a + b {
        return 1.0;
    }
    if d <= b - a {
        return 0.0;
    }
    let whole = 2.0 * PI * one_minus_cos(a);
    if d <= a - b {
        return (1.0 - 2.0 * PI * one_minus_cos(b) / whole) as f32;
    }
    if a < FLAT_BELOW {
        // Stereographic projection keeps circles circles, and areas nearly so over a light this small.
        let [near, far] = [d - b, d + b].map(|x| 2.0 * (0.5 * x).tan());
        let r = 2.0 * (0.5 * a).tan();
        return (1.0 - flat_lens(0.5 * (near + far), r, 0.5 * (far - near)) / (PI * r * r)).clamp(0.0, 1.0)
            as f32;
    }
    let (sd, cd, sa, ca, sb, cb) = (d.sin(), d.cos(), a.sin(), a.cos(), b.sin(), b.cos());
    let hidden = 2.0
        * (PI
            - acos((cd - ca * cb) / (sa * sb))
            - ca * acos((cb - cd * ca) / (sd * sa))
            - cb * acos((ca - cd * cb) / (sd * sb)));
    (1.0 - hidden / whole).clamp(0.0, 1.0) as f32
}

/// Share of a disk's area outside another disk in the same plane, in `f32` alone.
///
/// # Accuracy
/// 5e-6 for radii within a factor of 10 of each other.
pub fn disk_past_disk(separation: f32, light: f32, ball: f32) -> f32 {
    let (d, a, b) = (separation.max(0.0), light, ball);
    if d >= a + b {
        return 1.0;
    }
    if d <= b - a {
        return 0.0;
    }
    if d <= a - b {
        return 1.0 - (b / a) * (b / a);
    }
    // Half chord times twice the distance, as a product of differences (Heron), so that nothing cancels.
    let heron = ((a + b + d) * (a + b - d) * (d + a - b) * (d - a + b)).max(0.0).sqrt();
    let angle_a = heron.atan2(d * d + (a - b) * (a + b));
    let angle_b = heron.atan2(d * d - (a - b) * (a + b));
    let lens = a * a * angle_a + b * b * angle_b - 0.5 * heron;
    (1.0 - lens / (std::f32::consts::PI * a * a)).clamp(0.0, 1.0)
}

/// Area common to two disks.
fn flat_lens(d: f64, a: f64, b: f64) -> f64 {
    let heron = ((a + b + d) * (a + b - d) * (d + a - b) * (d - a + b)).max(0.0).sqrt();
    let angle_a = heron.atan2(d * d + (a - b) * (a + b));
    let angle_b = heron.atan2(d * d - (a - b) * (a + b));
    a * a * angle_a + b * b * angle_b - 0.5 * heron
}

fn acos(x: f64) -> f64 {
    x.clamp(-1.0, 1.0).acos()
}

/// 1 − cos x without cancellation.
fn one_minus_cos(x: f64) -> f64 {
    2.0 * (0.5 * x).sin().powi(2)
}

/// What of a polygonal light an edge leaves visible at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PolygonShare {
    /// Share of the light's area.
    pub area: f32,
    /// Share of the irradiance that the light gives to a receiver with the stated normal.
    pub irradiance: f32,
}

/// Most corners of a polygon light.
pub const MAX_CORNERS: usize = 15;

/// Shares of a convex polygon light on the side `plane_normal · x > 0` of a plane through the receiver (and an occluder's edge).
///
/// `corners` are relative to the receiver, in order around the polygon; `normal` is the receiver's. What lies below the receiver's
/// horizon does not count for the irradiance. A light without area, or wholly below the horizon, is fully visible.
///
/// # Accuracy
/// 1e-6: exact clipping, and for the irradiance the exact sum over edges (Lambert), in `f64`.
///
/// # Panics
/// With more than [`MAX_CORNERS`] corners.
pub fn polygon_past_half_space(corners: &[Vec3], plane_normal: Vec3, normal: Vec3) -> PolygonShare {
    assert!(corners.len() <= MAX_CORNERS, "a polygon light of {} corners", corners.len());
    let whole = Polygon::new(corners);
    let seen = whole.clipped(plane_normal.as_dvec3());
    let share = |part: f64, all: f64| if all > 0.0 { (part / all).clamp(0.0, 1.0) as f32 } else { 1.0 };
    let n = normal.as_dvec3();
    let arriving = |p: &Polygon| p.clipped(n).irradiance(n);
    PolygonShare {
        area: share(seen.area(), whole.area()),
        irradiance: share(arriving(&seen), arriving(&whole)),
    }
}

/// Convex; a clip adds at most one corner.
#[derive(Clone, Copy)]
struct Polygon {
    corners: [DVec3; MAX_CORNERS + 3],
    len: usize,
}

impl Polygon {
    fn new(corners: &[Vec3]) -> Self {
        let mut p = Self { corners: [DVec3::ZERO; MAX_CORNERS + 3], len: 0 };
        corners.iter().for_each(|c| p.push(c.as_dvec3()));
        p
    }

    fn push(&mut self, corner: DVec3) {
        self.corners[self.len] = corner;
        self.len += 1;
    }

    fn edges(&self) -> impl Iterator<Item = (DVec3, DVec3)> + '_ {
        (0..self.len).map(|i| (self.corners[i], self.corners[(i + 1) % self.len]))
    }

    /// The part with n·x ≥ 0.
    fn clipped(&self, n: DVec3) -> Self {
        let mut kept = Self { len: 0, ..*self };
        for (a, b) in self.edges() {
            let (da, db) = (n.dot(a), n.dot(b));
            if da >= 0.0 {
                kept.push(a);
            }
            if (da > 0.0 && db < 0.0) || (da < 0.0 && db > 0.0) {
                kept.push(a.lerp(b, da / (da - db)));
            }
        }
        kept
    }

    fn area(&self) -> f64 {
        let c = self.corners[0];
        0.5 * self.edges().map(|(a, b)| (a - c).cross(b - c)).sum::<DVec3>().length()
    }

    /// Irradiance at the origin for unit radiance, over π.
    fn irradiance(&self, n: DVec3) -> f64 {
        let edge = |(a, b): (DVec3, DVec3)| {
            let cross = a.cross(b);
            let sin = cross.length();
            // The angle times the unit normal; for a tiny angle both go to zero together.
            if sin > 0.0 { cross.dot(n) * (sin.atan2(a.dot(b)) / sin) } else { 0.0 }
        };
        (self.edges().map(edge).sum::<f64>() / (2.0 * PI)).abs()
    }
}

/// Signed share of the unit disk in the triangle of its centre and the edge from `a` to `b`, positive when they run counter-clockwise.
///
/// Summed round an occluder's outline, projected into the disk's plane in units of its radius, it gives the share of the disk that is hidden:
/// exact for any simple outline, convex or not. Outlines that overlap count twice.
///
/// # Accuracy
/// 1e-14, in `f64`.
pub fn disk_behind_edge(a: DVec2, b: DVec2) -> f64 {
    let sector = |p: DVec2, q: DVec2| 0.5 * p.perp_dot(q).atan2(p.dot(q));
    let edge = b - a;
    // Where the edge enters and leaves the disk: |a + t·edge| = 1.
    let (qa, qb, qc) = (edge.length_squared(), a.dot(edge), a.length_squared() - 1.0);
    let discriminant = qb * qb - qa * qc;
    if qa == 0.0 {
        return 0.0;
    }
    let root = discriminant.max(0.0).sqrt();
    let (enter, leave) = ((-qb - root) / qa, (-qb + root) / qa);
    if discriminant <= 0.0 || leave <= 0.0 || enter >= 1.0 {
        return sector(a, b) / PI;
    }
    let (p, q) = (a + edge * enter.max(0.0), a + edge * leave.min(1.0));
    let before = if enter > 0.0 { sector(a, p) } else { 0.0 };
    let after = if leave < 1.0 { sector(q, b) } else { 0.0 };
    (before + 0.5 * p.perp_dot(q) + after) / PI
}

/// Cheap stand-ins for [`disk_past_half_plane`], as shaders use them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ramp {
    /// A straight line.
    Linear,
    /// 3x² − 2x³.
    Smoothstep,
}

impl Ramp {
    /// The share seen past a line at `h` radii from the centre.
    pub fn share(self, h: f32) -> f32 {
        let x = (0.5 - 0.5 * h).clamp(0.0, 1.0);
        match self {
            Self::Linear => x,
            Self::Smoothstep => x * x * (3.0 - 2.0 * x),
        }
    }

    /// Largest difference from the exact share of a disk.
    pub fn error(self) -> f32 {
        match self {
            Self::Linear => 0.0579,
            Self::Smoothstep => 0.0395,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use farsight_geometry::sampling::Random;

    /// Share of a cap beyond a half-space by quadrature over rings around the cap's axis: each ring lies beyond with a closed share
    /// of its circle.
    fn cap_reference(a: f64, beyond: impl Fn(f64) -> f64) -> f64 {
        // Substituting cos r makes rings of equal width equal in area; sin² spaces them densely at both ends.
        let n = 20_000;
        let sum: f64 = (0..n)
            .map(|i| {
                let x = (f64::from(i) + 0.5) / f64::from(n);
                let t = (0.5 * PI * x).sin().powi(2);
                let weight = 0.5 * PI * (PI * x).sin();
                // 1 − cos r = t·(1 − cos a)
                let r = 2.0 * ((0.5 * a).sin() * t.sqrt()).asin();
                weight * beyond(r)
            })
            .sum();
        sum / f64::from(n)
    }

    #[test]
    fn half_spaces_match_quadrature() {
        let (mut worst, mut worst_disk) = (0.0f64, 0.0f64);
        for i in 0..60 {
            let a = 1e-4 * 1.4e4f64.powf(f64::from(i) / 59.0);
            for k in -9..=9 {
                let d = f64::from(k) / 9.3 * a;
                // A ring of radius r: a point at the azimuth φ is beyond the plane where cos φ > tan d / tan r.
                let reference = cap_reference(a, |r| (d.tan() / r.tan()).clamp(-1.0, 1.0).acos() / PI);
                let (d32, a32) = (d as f32, a as f32);
                worst = worst.max((f64::from(sphere_past_half_space(d32, a32)) - reference).abs());
                let h = f64::from(k) / 9.3;
                let exact = (h.acos() - h * (1.0 - h * h).sqrt()) / PI;
                worst_disk = worst_disk.max((f64::from(disk_past_half_plane(h as f32)) - exact).abs());
            }
        }
        println!("half-space x sphere {worst:.2e}, x disk {worst_disk:.2e}");
        assert!(worst <= 1e-5 && worst_disk <= 3e-7, "{worst} {worst_disk}");
        assert_eq!((sphere_past_half_space(0.0, 0.0), sphere_past_half_space(0.2, 0.1)), (0.0, 0.0));
        assert_eq!((sphere_past_half_space(-1.0, 0.5), disk_past_half_plane(-2.0)), (1.0, 1.0));
    }

    #[test]
    fn balls_match_quadrature() {
        let mut random = Random::new(9);
        let (mut worst, mut worst_flat) = (0.0f64, 0.0f64);
        for _ in 0..600 {
            let [u, v, x] = random.units::<3>();
            let a = 1e-4 * 1.4e4f64.powf(u);
            let b = (a * 100f64.powf(2.0 * v - 1.0)).min(1.5);
            let d = ((b - a).abs() + x * (a + b - (b - a).abs())).min(3.0);
            let [d32, a32, b32] = [d, a, b].map(|x| x as f32);
            // The same values in f64, so that the reference answers the same question.
            let [d, a, b] = [d32, a32, b32].map(f64::from);
            let hidden = |r: f64| {
                // Of a ring of radius r, the share within b of the ball's centre.
                let small =
                    2.0 * ((0.5 * b).sin().powi(2) - (0.5 * (r - d)).sin().powi(2)) / (r.sin() * d.sin());
                // cos φ ≥ 1 − small, written so that tiny angles keep their digits.
                2.0 * (0.5 * small).clamp(0.0, 1.0).sqrt().asin() / PI
            };
            let reference = 1.0 - cap_reference(a, hidden);
            worst = worst.max((f64::from(sphere_past_sphere(d32, a32, b32)) - reference).abs());
            if a < 5e-3 && b < 10.0 * a && a < 10.0 * b {
                worst_flat = worst_flat.max((f64::from(disk_past_disk(d32, a32, b32)) - reference).abs());
            }
        }
        println!("ball x sphere light {worst:.2e}, as disks below 0.005 rad {worst_flat:.2e}");
        assert!(worst <= 1e-5 && worst_flat < 1e-5, "{worst} {worst_flat}");
        // Annular and total eclipses, and none.
        let sun = 0.00465;
        let annular = 1.0 - sphere_past_sphere(0.0, sun, 0.5 * sun);
        assert!((annular - 0.25).abs() < 1e-5);
        assert_eq!((sphere_past_sphere(0.0, sun, 0.0047), sphere_past_sphere(0.01, sun, 0.0047)), (0.0, 1.0));
    }

    /// Shares of a rectangle by summing over small patches.
    #[test]
    fn polygons_match_patches() {
        let mut random = Random::new(10);
        let mut worst = 0.0f64;
        for _ in 0..40 {
            let mut v = || Vec3::from_array(random.units::<3>().map(|x| x as f32)) * 2.0 - 1.0;
            let (center, u, w) = (v() + Vec3::Z * 2.5, v() * 0.5, v() * 0.5);
            let corners = [center - u - w, center + u - w, center + u + w, center - u + w];
            let (plane, normal) = ((v() - Vec3::Z * 0.2).normalize(), (v() * 0.3 + Vec3::Z).normalize());
            let share = polygon_past_half_space(&corners, plane, normal);
            let n = 1500;
            let (mut all, mut seen) = ([0.0; 2], [0.0; 2]);
            let light_normal = u.cross(w).as_dvec3();
            for i in 0..n {
                for j in 0..n {
                    let at = |i: i32| 2.0 * (f64::from(i) + 0.5) / f64::from(n) - 1.0;
                    let p = center.as_dvec3() + u.as_dvec3() * at(i) + w.as_dvec3() * at(j);
                    let r_sq = p.length_squared();
                    let cosines = normal.as_dvec3().dot(p).max(0.0) * light_normal.dot(p).abs();
                    let value = [1.0, cosines / (r_sq * r_sq)];
                    let visible = f64::from(u8::from(plane.as_dvec3().dot(p) > 0.0));
                    for k in 0..2 {
                        all[k] += value[k];
                        seen[k] += value[k] * visible;
                    }
                }
            }
            let expected = [seen[0] / all[0], seen[1] / all[1]];
            worst = worst.max((f64::from(share.area) - expected[0]).abs());
            worst = worst.max((f64::from(share.irradiance) - expected[1]).abs());
        }
        // The patches themselves are good to 1/n of the boundary only.
        assert!(worst < 1e-3, "{worst}");
    }

    /// Closed values: planes through the centre, along an edge, across the receiver's normal.
    #[test]
    fn polygons_match_closed_forms() {
        let side = 0.6f32;
        let square = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
            .map(|(x, y)| Vec3::new(x * side, y * side, 1.0));
        for k in -10..=10 {
            // The plane x = c·z through the receiver.
            let c = side * k as f32 / 10.0;
            let share = polygon_past_half_space(&square, Vec3::new(-1.0, 0.0, c), Vec3::Z);
            assert!((share.area - (0.5 + 0.05 * k as f32)).abs() < 1e-6);
            // Irradiance of the rectangle x < c, |y| < s at distance 1 straight above, from its antiderivative.
            let g = |x: f64| {
                let s = f64::from(side);
                (x / (1.0 + x * x).sqrt()) * (s / (1.0 + x * x).sqrt()).atan()
                    + (s / (1.0 + s * s).sqrt()) * (x / (1.0 + s * s).sqrt()).atan()
            };
            let s = f64::from(side);
            let expected = (g(f64::from(c)) + g(s)) / (2.0 * g(s));
            assert!((f64::from(share.irradiance) - expected).abs() < 1e-6, "{k}");
        }
        let none = polygon_past_half_space(&square, Vec3::Z, Vec3::NEG_Z);
        assert_eq!((none.area, none.irradiance), (1.0, 1.0));
        assert_eq!(
            polygon_past_half_space(&[], Vec3::Z, Vec3::Z),
            PolygonShare { area: 1.0, irradiance: 1.0 }
        );
    }

    /// Random simple outlines (stars), against points of the disk.
    #[test]
    fn outlines_hide_what_points_say() {
        let mut random = Random::new(12);
        let mut worst = 0.0f64;
        for _ in 0..60 {
            let centre = DVec2::from_array(random.units()) * 2.0 - 1.0;
            let corner = |i: u32| {
                let (sin, cos) = (f64::from(i) / 7.0 * 2.0 * PI).sin_cos();
                centre + DVec2::new(cos, sin) * (0.1 + 1.5 * random.unit())
            };
            let corners: Vec<DVec2> = (0..7).map(corner).collect();
            let edge = |i: usize| (corners[i], corners[(i + 1) % 7]);
            let hidden: f64 = (0..7).map(|i| disk_behind_edge(edge(i).0, edge(i).1)).sum();
            let n = 400;
            let (mut inside, mut all) = (0, 0);
            for k in 0..n * n {
                let at = |i: i32| 2.0 * (f64::from(i) + 0.5) / f64::from(n) - 1.0;
                let p = DVec2::new(at(k % n), at(k / n));
                if p.length_squared() > 1.0 {
                    continue;
                }
                all += 1;
                let crosses = |i: usize| {
                    let (a, b) = edge(i);
                    (a.y > p.y) != (b.y > p.y) && p.x < a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x)
                };
                inside += i32::from((0..7).filter(|&i| crosses(i)).count() % 2 == 1);
            }
            worst = worst.max((hidden - f64::from(inside) / f64::from(all)).abs());
        }
        // Points on the outline's pixels are worth about 1/n of its length.
        assert!(worst < 3e-3, "{worst}");
        let square = [(-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0)].map(|(x, y)| DVec2::new(x, y));
        let all: f64 = (0..4).map(|i| disk_behind_edge(square[i], square[(i + 1) % 4])).sum();
        let half: f64 = disk_behind_edge(DVec2::new(-3.0, 0.0), DVec2::new(3.0, 0.0))
            + disk_behind_edge(DVec2::new(3.0, 0.0), DVec2::new(0.0, 9.0))
            + disk_behind_edge(DVec2::new(0.0, 9.0), DVec2::new(-3.0, 0.0));
        assert!((all - 1.0).abs() < 1e-14 && (half - 0.5).abs() < 1e-14, "{all} {half}");
    }

    #[test]
    fn ramps_are_as_far_off_as_they_say() {
        for ramp in [Ramp::Linear, Ramp::Smoothstep] {
            let off = |i: i32| {
                let h = i as f32 / 10_000.0;
                (ramp.share(h) - disk_past_half_plane(h)).abs()
            };
            let worst = (-10_000..=10_000).map(off).fold(0.0, f32::max);
            assert!(worst <= ramp.error() && worst > 0.98 * ramp.error(), "{ramp:?} {worst}");
        }
    }
}
