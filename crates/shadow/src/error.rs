//! How large the texels of a map are: at any point, from the matrix alone, and along the view axis in closed form.

use crate::warp::ShadowView;
use farsight_geometry::{Camera, Projection};
use glam::{DVec3, DVec4};

/// What one texel of a map covers at a point.
///
/// Extents are across the light's ray, as on a surface that faces the light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Texel {
    /// Extent along the warp axis (one texel of s), in world units.
    pub along: f64,
    /// Extent across it (one texel of t), in world units.
    pub across: f64,
    /// Distance of the point ahead of the eye; 1 for a parallel camera.
    pub eye_depth: f64,
    /// dp/ds of Wimmer 2007, chapter 3: extent of the whole map's s on the image plane at distance 1, had it this point's scale everywhere.
    pub dp_ds: f64,
    /// The same for t.
    pub dp_dt: f64,
    /// The larger extent in pixels.
    pub pixels: f64,
}

impl ShadowView {
    /// Map position (s, t) in [0, 1]² of a world point; `None` unless it lies ahead of the light.
    pub fn map_position(&self, point: DVec3) -> Option<[f64; 2]> {
        let clip = self.clip_from_relative * (point - self.origin).extend(1.0);
        (clip.w > 0.0).then(|| [clip.y, clip.x].map(|c| 0.5 + 0.5 * c / clip.w))
    }

    /// Gradients of s and t at a world point.
    pub fn gradients(&self, point: DVec3) -> Option<[DVec3; 2]> {
        let p = (point - self.origin).extend(1.0);
        let rows = self.clip_from_relative;
        let (x, y, w): (DVec4, DVec4, DVec4) = (rows.row(0), rows.row(1), rows.row(3));
        let h = w.dot(p);
        let gradient = |row: DVec4| (row.truncate() - w.truncate() * (row.dot(p) / h)) * (0.5 / h);
        (h > 0.0).then(|| [gradient(y), gradient(x)])
    }

    /// What a texel covers at a world point, from the matrix alone. `None` unless the point is ahead of the light and of the eye.
    ///
    /// The light's ray is the direction in which neither s nor t changes. A step of one texel in s along which t and the place on the ray
    /// stay has the length |∇t| / |∇s × ∇t|, and the other way round.
    pub fn texel_at(&self, camera: &Camera, point: DVec3) -> Option<Texel> {
        let [s, t] = self.gradients(point)?;
        let eye_depth = match camera.projection() {
            Projection::Perspective { .. } => camera.forward().dot(point - camera.eye()),
            Projection::Orthographic { .. } => 1.0,
        };
        if eye_depth <= 0.0 {
            return None;
        }
        let area = s.cross(t).length();
        let (along, across) = (t.length() / area, s.length() / area);
        let side = f64::from(self.side);
        let pixels = along.max(across) / side * camera.pixels_per_unit() / eye_depth;
        Some(Texel {
            along: along / side,
            across: across / side,
            eye_depth,
            dp_ds: along / eye_depth,
            dp_dt: across / eye_depth,
            pixels,
        })
    }
}

/// How map coordinates are spread along the view axis, for light across the view (Wimmer 2007, 3.4).
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Spacing {
    /// Equal steps.
    Uniform,
    /// The perspective warp with parameter n; n = near distance is the perspective shadow map.
    Warp {
        /// Distance of the warp's centre before the near plane.
        n: f64,
    },
    /// Equal steps of ln z, with t ∝ x/z: what no perspective map can do, and the least possible largest dp/ds.
    Logarithmic,
}

impl Spacing {
    /// The warp with n = zn + √(zn·zf), which equalises dp/ds at both ends.
    pub fn best_warp(near: f64, far: f64) -> Self {
        Self::Warp { n: near + (near * far).sqrt() }
    }

    /// s in [0, 1] of a distance `z` along the view between `near` and `far`.
    pub fn s(&self, near: f64, far: f64, z: f64) -> f64 {
        match *self {
            Self::Uniform => (z - near) / (far - near),
            Self::Warp { n } => {
                let d = far - near;
                (n + d) * (z - near) / (d * (z - near + n))
            }
            Self::Logarithmic => (z / near).ln() / (far / near).ln(),
        }
    }

    /// dp/ds at distance `z`: length on the image plane at distance 1 per unit of s.
    pub fn dp_ds(&self, near: f64, far: f64, z: f64) -> f64 {
        let d = far - near;
        match *self {
            Self::Uniform => d / z,
            Self::Warp { n } => (z - near + n).powi(2) * d / (z * n * (n + d)),
            Self::Logarithmic => (far / near).ln(),
        }
    }

    /// dp/dt at distance `z`, t being normalised by the widest place of the view in the map.
    pub fn dp_dt(&self, near: f64, far: f64, z: f64) -> f64 {
        match *self {
            Self::Uniform => far / z,
            Self::Warp { n } => {
                // x/w is widest at the far end for n ≥ near, at the near end otherwise.
                let w = |z: f64| 1.0 + (z - near) / n;
                w(z) / z * (far / w(far)).max(near)
            }
            Self::Logarithmic => 1.0,
        }
    }

    /// The largest dp/ds between `near` and `far`. It is attained at an end.
    pub fn largest_dp_ds(&self, near: f64, far: f64) -> f64 {
        self.dp_ds(near, far, near).max(self.dp_ds(near, far, far))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Focus, MapOptions, Scope, ShadowLight, Warp};
    use farsight_geometry::accuracy::Kind;
    use farsight_geometry::sampling::{Random, in_box};
    use farsight_geometry::{DAabb, Frustum};
    use glam::dvec3;

    /// The table of section 3.5: largest errors for five depth ratios.
    #[test]
    fn closed_forms_are_derivatives_of_s_and_meet_the_table() {
        for r in [10.0f64, 100.0, 400.0, 1000.0, 1e4] {
            let cases = [
                (Spacing::Uniform, r - 1.0),
                (Spacing::Warp { n: 1.0 }, r - 1.0),
                (Spacing::best_warp(1.0, r), r.sqrt() - 1.0 / r.sqrt()),
                (Spacing::Logarithmic, r.ln()),
            ];
            for (spacing, largest) in cases {
                assert!((spacing.largest_dp_ds(1.0, r) / largest - 1.0).abs() < 1e-12, "{spacing:?} {r}");
                assert!(spacing.s(1.0, r, 1.0).abs() < 1e-12 && (spacing.s(1.0, r, r) - 1.0).abs() < 1e-12);
                for i in 1..50 {
                    let z = r.powf(f64::from(i) / 50.0);
                    let h = 1e-4 * z;
                    let ds = (spacing.s(1.0, r, z + h) - spacing.s(1.0, r, z - h)) / (2.0 * h);
                    assert!((spacing.dp_ds(1.0, r, z) * ds * z - 1.0).abs() < 1e-6);
                    assert!(spacing.dp_ds(1.0, r, z) <= largest * (1.0 + 1e-12));
                }
            }
            assert!((Spacing::best_warp(1.0, r).dp_dt(1.0, r, 1.0) - r.sqrt()).abs() < 1e-9 * r);
            assert!((Spacing::Warp { n: 1.0 }.dp_dt(1.0, r, 7.0) - 1.0).abs() < 1e-12);
        }
    }

    /// Lights of all kinds over a slab: (focus, camera, light) that need a map.
    fn views(random: &mut Random, count: usize, mut visit: impl FnMut(&Focus, &Camera, &DAabb, f64)) {
        let mut focus = Focus::new();
        for i in 0..count {
            let mut v = || DVec3::from_array(random.units()) * 2.0 - 1.0;
            let eye = v() * 1e4;
            let (view, light_direction, offset) = (v(), v().normalize(), v());
            let camera = Camera::look_at(eye, eye + view, DVec3::Y).unwrap();
            let [r, thickness] = random.units();
            let far = 10f64.powf(0.5 + 3.0 * r);
            let slab = DAabb::new(
                eye - dvec3(far, 0.2 * far * thickness + 1.0, far),
                eye + dvec3(far, 0.1 * far * thickness, far),
            );
            let light = if i % 2 == 0 {
                ShadowLight::directional(light_direction)
            } else {
                let from = eye + offset * far * 0.5;
                ShadowLight::spot(from, light_direction, 0.2 + thickness, 0.01 * far, f64::INFINITY)
            };
            let boxes = [slab];
            let scope = Scope::new(&camera, far, &boxes, &boxes, 2048);
            if focus.fit(&light, &scope).unwrap().is_none() {
                visit(&focus, &camera, &slab, far);
            }
        }
    }

    /// The claim comes from closed forms at corners; the check from the matrix's Jacobian anywhere in the body.
    #[test]
    fn no_texel_exceeds_the_claim() {
        let mut random = Random::new(11);
        let (mut proven, mut points, mut tightest) = (0, 0, 0.0f64);
        let mut sampler = Random::new(12);
        views(&mut random, 1500, |focus, camera, slab, far| {
            let uniform = focus.map(&MapOptions::new(2048).with_warp(Warp::Uniform), None);
            assert_eq!(uniform.texel.kind, Kind::Proven);
            for view in [uniform, focus.map(&MapOptions::new(2048), None)] {
                proven += usize::from(view.texel.kind == Kind::Proven);
                let seen = Frustum::from_camera(&camera.with_range(camera.near(), far).unwrap());
                let mut check = |p: DVec3| {
                    let texel = view.texel_at(camera, p).unwrap();
                    assert!(texel.pixels <= view.texel.value, "{} > {}", texel.pixels, view.texel);
                    assert!(view.texel.kind == Kind::Proven || texel.pixels <= view.texel.value);
                    points += 1;
                    texel.pixels / view.texel.value
                };
                // Convex combinations of corners reach every part of the body.
                for _ in 0..60 {
                    let corners = focus.corners();
                    let mut p = DVec3::ZERO;
                    let mut sum = 0.0;
                    for &c in corners {
                        let weight = -sampler.unit().max(1e-12).ln();
                        let weight = weight.powi(6);
                        p += c * weight;
                        sum += weight;
                    }
                    tightest = tightest.max(check(camera.eye() + p / sum));
                }
                let p = in_box(slab, sampler.units());
                if focus.is_directional() && seen.contains(p) {
                    check(p);
                }
            }
        });
        assert!(points > 50_000 && proven > 1000 && tightest > 0.99, "{points} {proven} {tightest}");
        println!(
            "{points} texels within the claim, which is proven for {proven} maps; closest {tightest:.4}"
        );
    }

    #[test]
    fn gradients_are_finite_differences_of_positions() {
        let mut random = Random::new(5);
        views(&mut random, 200, |focus, camera, _, far| {
            let view = focus.map(&MapOptions::new(512), None);
            let c = focus.corners();
            let p = camera.eye() + c.iter().sum::<DVec3>() / c.len() as f64;
            let [s, t] = view.gradients(p).unwrap();
            for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                let h = 1e-6 * far.min(1.0 / s.length());
                let (a, b) =
                    (view.map_position(p + axis * h).unwrap(), view.map_position(p - axis * h).unwrap());
                let scale = s.length().max(t.length());
                assert!(((a[0] - b[0]) / (2.0 * h) - s.dot(axis)).abs() < 1e-3 * scale);
                assert!(((a[1] - b[1]) / (2.0 * h) - t.dot(axis)).abs() < 1e-3 * scale);
            }
        });
    }

    #[test]
    fn the_required_side_gives_a_pixel_per_texel() {
        let mut random = Random::new(6);
        views(&mut random, 100, |focus, _, _, _| {
            let kappa = focus.map(&MapOptions::new(1024), None).kappa;
            let options = MapOptions::new(1024).with_warp(Warp::Kappa(kappa));
            let view = focus.map(&options, None);
            let side = view.required_side(1.0).min(1 << 30);
            let finer = focus.map(&MapOptions { side, ..options }, None);
            assert!(
                finer.texel.value <= 1.0 + 1e-6 && (side < 10 || finer.texel.value > 0.8),
                "{side} {}",
                finer.texel
            );
        });
    }
}
