//! The matrix of a shadow map: a uniform focus, or a perspective warp that gives near receivers more texels.
//!
//! With `u` the distance along the warp axis from the nearest receiver and `w = 1 + κ·u`, the map's coordinates are
//!
//! ```text
//! s = (1 + κ·d)·u / (d·w)        t = a·x/w + b        depth ∝ y/w
//! ```
//!
//! where `d` is the extent of the receivers along the axis. κ = 0 is the uniform focus, κ = 1/n the light space perspective
//! shadow map of Wimmer 2007 (ch. 3) with its parameter n; in this form the uniform map needs no case of its own and nothing
//! is divided by the sine of an angle that may vanish.

use crate::Focus;
use farsight_geometry::ClipConvention;
use farsight_geometry::accuracy::{ErrorBound, Unit};
use glam::{DMat4, DVec3, DVec4, Mat4};

/// How the strength κ of the warp is chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum Warp {
    /// κ = 0: equal texels everywhere.
    Uniform,
    /// n = near distance: perspective shadow maps (baseline).
    Perspective,
    /// n = zn + √(zn·zf), over sin γ when the light is tilted (Wimmer 2007, 3.4.3 and 3.4.4).
    Paper,
    /// The rule of 3.4.4 with zf replaced by the extent along the light's z axis.
    PaperTilted,
    /// n = (zf − zn) / (r^(2/3) − 1) with r = zf/zn: least product of both errors for light across the view.
    LeastProduct,
    /// The κ with the least worst texel over the receivers, if it gains enough over κ = 0.
    #[default]
    Minimax,
    /// This κ, per world unit.
    Kappa(f64),
}

/// Texels kept free along each side of the map, so that filters and `f32` rounding stay inside.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct MapOptions {
    /// Texels on a side.
    pub side: u32,
    /// How κ is chosen.
    pub warp: Warp,
    /// Clip space of the result.
    pub convention: ClipConvention,
    /// Free texels along each side.
    pub border: f64,
    /// [`Warp::Minimax`] warps from this gain of the worst texel over the uniform map on ...
    pub gain_on: f64,
    /// ... and, once it does, until the gain falls below this one.
    pub gain_off: f64,
}

impl MapOptions {
    /// Minimax warp with a border of one texel, in reversed depth; warps from a gain of 1.25 until one of 1.10.
    pub fn new(side: u32) -> Self {
        Self {
            side,
            warp: Warp::Minimax,
            convention: ClipConvention::REVERSED,
            border: 1.0,
            gain_on: 1.25,
            gain_off: 1.10,
        }
    }
}

/// A shadow map's matrix and what it is worth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShadowView {
    /// World position that the matrices are relative to: the eye.
    pub origin: DVec3,
    /// Clip space from world coordinates minus `origin`. s grows with clip y, t with clip x.
    pub clip_from_relative: DMat4,
    /// The warp's strength, per world unit.
    pub kappa: f64,
    /// Largest number of pixels that one texel covers on the screen, over all receivers in view, surfaces facing the light.
    pub texel: ErrorBound,
    /// The same for κ = 0.
    pub texel_uniform: ErrorBound,
}

impl ShadowView {
    /// The matrix rounded to `f32`, as graphics interfaces take it.
    pub fn matrix(&self) -> Mat4 {
        self.clip_from_relative.as_mat4()
    }

    /// Factor by which the warp shrinks the worst texel.
    pub fn gain(&self) -> f64 {
        self.texel_uniform.value / self.texel.value
    }
}

impl Focus {
    /// The map for what was focused on. `warped` says whether the previous frame's map had κ > 0 (hysteresis).
    ///
    /// # Accuracy
    /// The worst texel is attained at a corner of the receivers (for |κ·x| ≤ √2·w its extent is a convex function over a
    /// linear one; beyond, dense sampling found no exception). [`Warp::Minimax`] is within 1 % of the least worst
    /// texel and never above that of the uniform map.
    ///
    /// # Cost
    /// About 3 µs for `Minimax` over eight corners, 0.2 µs for the other rules.
    ///
    /// # Panics
    /// When the focus is empty: it was not filled, or was skipped.
    pub fn map(&self, options: &MapOptions, warped: bool) -> ShadowView {
        let axes = self.axes.filter(|_| !self.receivers.is_empty()).expect("the focus holds receivers");
        let fit = Fit::new(self);
        let kappa = match options.warp {
            Warp::Minimax if !axes.from_view => 0.0,
            Warp::Minimax => {
                let (kappa, worst) = fit.least_worst();
                let enough = if warped { options.gain_off } else { options.gain_on };
                if fit.worst_texel(0.0) >= enough * worst { kappa } else { 0.0 }
            }
            rule => self.kappa_of(rule, fit.d),
        };
        self.view(&fit, kappa, options)
    }

    /// κ of a closed rule, from the depths of the receivers and the angle of the light.
    fn kappa_of(&self, rule: Warp, d: f64) -> f64 {
        let depths = self.eye_depths.iter().copied();
        let (near, far) = depths.fold((f64::INFINITY, 0.0), |(lo, hi), z| (z.min(lo), z.max(hi)));
        let sin_gamma = (1.0 - self.cos_gamma * self.cos_gamma).max(0.0).sqrt();
        let kappa = match rule {
            Warp::Uniform | Warp::Minimax => 0.0,
            Warp::Perspective => sin_gamma / near,
            Warp::Paper => sin_gamma / (near + (near * far).sqrt()),
            Warp::PaperTilted => sin_gamma / (near + (near * (near + d * sin_gamma)).sqrt()),
            Warp::LeastProduct => sin_gamma * ((far / near).powf(2.0 / 3.0) - 1.0) / (far - near),
            Warp::Kappa(kappa) => kappa,
        };
        if kappa.is_finite() && kappa > 0.0 { kappa } else { 0.0 }
    }

    fn view(&self, fit: &Fit, kappa: f64, options: &MapOptions) -> ShadowView {
        let inside = 1.0 - 2.0 * options.border / f64::from(options.side);
        // Pixels per texel: extent per unit of map, over texels per unit, times pixels per unit of image plane.
        let pixels = self.pixels_per_unit / (f64::from(options.side) * inside);
        let bound = |kappa| ErrorBound::estimated(fit.worst_texel(kappa) * pixels, Unit::Pixels);
        ShadowView {
            origin: self.origin,
            clip_from_relative: self.matrix(fit, kappa, inside, options.convention),
            kappa,
            texel: bound(kappa),
            texel_uniform: bound(0.0),
        }
    }

    fn matrix(&self, fit: &Fit, kappa: f64, inside: f64, convention: ClipConvention) -> DMat4 {
        let axes = self.axes.expect("the focus is filled");
        let (low, extent) = fit.across(kappa);
        let near = self.footprint.min.z;
        // Rows act on (x, y, z, 1) of light space. w = 1 + κ(z − near).
        let w = DVec4::new(0.0, 0.0, kappa, 1.0 - kappa * near);
        let centred = |row01: DVec4| (row01 * 2.0 - w) * inside;
        let s = DVec4::new(0.0, 0.0, 1.0, -near) * ((1.0 + kappa * fit.d) / fit.d);
        let t = (DVec4::X - w * low) / extent;
        // Depth grows along the light, from the highest caster to the lowest receiver.
        let (top, span) = self.depth_span(kappa);
        let along = DVec4::new(0.0, -1.0, 0.0, top) / span;
        let (near_depth, far_depth) = convention.near_far_depth();
        let depth = w * near_depth + along * (far_depth - near_depth);
        let y_sign = if convention.y_down { -1.0 } else { 1.0 };
        let clip_from_light = DMat4::from_cols(centred(t), centred(s) * y_sign, depth, w).transpose();
        let light_from_relative =
            DMat4::from_cols(axes.x.extend(0.0), axes.y.extend(0.0), axes.z.extend(0.0), DVec4::W)
                .transpose();
        clip_from_light * light_from_relative
    }

    /// Highest y, and the largest (top − y)/w over casters and receivers.
    fn depth_span(&self, kappa: f64) -> (f64, f64) {
        let all = || self.casters.iter().chain(&self.receivers);
        let top = all().map(|p| p.y).fold(f64::NEG_INFINITY, f64::max);
        let near = self.footprint.min.z;
        let span = all().map(|p| (top - p.y) / (1.0 + kappa * (p.z - near)).max(1.0)).fold(0.0, f64::max);
        // A margin of a thousandth keeps the ends off the planes; a flat scene still needs a range.
        (top + 5e-4 * span, (span * 1.001).max(self.footprint.extent().y).max(f64::MIN_POSITIVE))
    }
}

/// The receivers' corners in the coordinates of the warp: `x` across, `u` along the axis from the nearest, depth from the eye.
struct Fit<'a> {
    focus: &'a Focus,
    /// Extent along the warp.
    d: f64,
}

impl<'a> Fit<'a> {
    fn new(focus: &'a Focus) -> Self {
        Self { focus, d: focus.footprint.extent().z }
    }

    /// x, u and eye depth of each corner.
    fn corners(&self) -> impl Iterator<Item = (f64, f64, f64)> + '_ {
        let near = self.focus.footprint.min.z;
        self.focus
            .receivers
            .iter()
            .zip(&self.focus.eye_depths)
            .map(move |(p, &depth)| (p.x, p.z - near, depth))
    }

    /// Least x/w and the extent of x/w.
    fn across(&self, kappa: f64) -> (f64, f64) {
        let (lo, hi) = self.corners().fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), (x, u, _)| {
            let t = x / (1.0 + kappa * u);
            (lo.min(t), hi.max(t))
        });
        let missing = (self.focus.footprint.extent().x / (1.0 + kappa * self.d) - (hi - lo)).max(0.0);
        (lo - 0.5 * missing, hi - lo + missing)
    }

    /// Largest extent of a unit of the map on the image plane, over all corners and both directions.
    fn worst_texel(&self, kappa: f64) -> f64 {
        let (_, across) = self.across(kappa);
        let along = self.d / (1.0 + kappa * self.d);
        let texel = |(x, u, depth): (f64, f64, f64)| {
            let w = 1.0 + kappa * u;
            (along * (w * w + kappa * kappa * x * x).sqrt()).max(across) * w / depth
        };
        self.corners().map(texel).fold(0.0, f64::max)
    }

    /// The κ with the least worst texel, and that texel; κ = 0 when no warp is better.
    ///
    /// The worst texel is a maximum of few smooth functions of log κ, with few minima: a scan brackets the lowest, golden
    /// section refines it.
    fn least_worst(&self) -> (f64, f64) {
        const COARSE: i32 = 20;
        let kappa = |log: f64| log.exp2() / self.d;
        // From where w differs by 1 % across the receivers to where the near end is a million times finer.
        let (first, last) = (-6.0, 20.0);
        let step = (last - first) / f64::from(COARSE);
        let value = |log: f64| self.worst_texel(kappa(log));
        let start = (0..=COARSE)
            .map(|i| first + step * f64::from(i))
            .map(|log| (value(log), log))
            .fold((f64::INFINITY, first), |best, v| if v.0 < best.0 { v } else { best });
        let log = golden_section(start.1 - step, start.1 + step, 12, value);
        let refined = value(log);
        let best = if refined < start.0 { (kappa(log), refined) } else { (kappa(start.1), start.0) };
        let uniform = self.worst_texel(0.0);
        if best.1 < uniform { best } else { (0.0, uniform) }
    }
}

/// Where a function with one minimum in [a, b] is least, after `steps` evaluations.
fn golden_section(mut a: f64, mut b: f64, steps: u32, f: impl Fn(f64) -> f64) -> f64 {
    const RATIO: f64 = 0.618_033_988_749_894_9;
    let (mut x, mut y) = (b - RATIO * (b - a), a + RATIO * (b - a));
    let (mut fx, mut fy) = (f(x), f(y));
    for _ in 2..steps {
        if fx < fy {
            (b, y, fy) = (y, x, fx);
            x = b - RATIO * (b - a);
            fx = f(x);
        } else {
            (a, x, fx) = (x, y, fy);
            y = a + RATIO * (b - a);
            fy = f(y);
        }
    }
    if fx < fy { x } else { y }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Skip;
    use farsight_geometry::{Camera, DAabb, Projection};
    use glam::{DVec2, dvec3};

    /// A square frustum along −z and light across it, as in the analysis of chapter 3.
    fn chapter_focus(r: f64) -> (Focus, Camera) {
        let camera = Camera::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y)
            .and_then(|c| c.with_projection(Projection::Perspective { fov_y: std::f64::consts::FRAC_PI_3 }))
            .and_then(|c| c.with_range(1.0, r))
            .and_then(|c| c.with_image(512, 512))
            .unwrap();
        let mut focus = Focus::new();
        let everything = [DAabb::from_points([DVec3::ZERO]).inflated(1e5)];
        let skip = focus.directional(&camera, r, DVec3::NEG_Y, &everything, &everything, 1024).unwrap();
        assert_eq!(skip, None);
        (focus, camera)
    }

    /// (s, t) in [0, 1] of a point relative to the eye, from the matrix.
    fn map_position(view: &ShadowView, p: DVec3) -> DVec2 {
        let clip = view.clip_from_relative * p.extend(1.0);
        DVec2::new(clip.y, clip.x) / clip.w * 0.5 + 0.5
    }

    fn options(warp: Warp) -> MapOptions {
        MapOptions { warp, border: 0.0, ..MapOptions::new(1024) }
    }

    /// The errors dp/ds and dp/dt of the chapter by finite differences of the real matrix, largest along the centre line:
    /// p in units of the viewport's height at distance 1, per unit of s (t).
    fn largest_errors(focus: &Focus, view: &ShadowView, r: f64) -> (f64, f64) {
        let (mut es, mut et) = (0.0f64, 0.0f64);
        for i in 0..=200 {
            let z = r.powf(f64::from(i) / 200.0);
            let h = 1e-5 * z;
            let at = |dz: f64, dx: f64| map_position(view, dvec3(dx, 0.0, -(z + dz)));
            let (below, above) = (if i == 0 { 0.0 } else { -h }, if i == 200 { 0.0 } else { h });
            let ds = ((at(above, 0.0) - at(below, 0.0)).x / (above - below)).abs();
            let dt = ((at(0.0, h) - at(0.0, -h)).y / (2.0 * h)).abs();
            es = es.max(1.0 / (ds * z));
            // t is normalised over the frustum's width at the far end in the chapter: 2·tan(30°)·zf.
            et = et.max(1.0 / (dt * z) / (2.0 * 30f64.to_radians().tan()));
        }
        assert!(!focus.receivers.is_empty());
        (es, et)
    }

    #[test]
    fn finite_differences_meet_the_formulas_of_the_chapter() {
        for r in [100.0f64, 400.0] {
            let (focus, _) = chapter_focus(r);
            let cases = [
                (Warp::Uniform, r - 1.0, r),
                (Warp::Paper, r.sqrt() - 1.0 / r.sqrt(), r.sqrt()),
                (Warp::Perspective, r - 1.0, 1.0),
            ];
            for (warp, s, t) in cases {
                let (es, et) = largest_errors(&focus, &focus.map(&options(warp), false), r);
                assert!((es / s - 1.0).abs() < 1e-3, "{warp:?} r {r}: dp/ds {es} instead of {s}");
                assert!((et / t - 1.0).abs() < 1e-3, "{warp:?} r {r}: dp/dt {et} instead of {t}");
            }
        }
    }

    #[test]
    fn minimax_is_within_one_percent_of_brute_force_and_never_above_uniform() {
        let mut worst = 1.0f64;
        for i in 0..400 {
            let t = f64::from(i);
            let gamma = std::f64::consts::PI * (t * 0.618).fract();
            let r = 2.0 * 5e5f64.powf((t * 0.414).fract());
            let camera =
                Camera::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y).unwrap().with_range(1.0, r).unwrap();
            let light = dvec3(0.3 * gamma.sin(), -gamma.sin(), -gamma.cos()).normalize();
            let slab = DAabb::new(dvec3(-r, -2.0 - r * (t * 0.2).fract(), -r), dvec3(r, 2.0, r));
            let mut focus = Focus::new();
            if focus.directional(&camera, r, light, &[slab], &[slab], 2048).unwrap().is_some() {
                continue;
            }
            let fit = Fit::new(&focus);
            let brute =
                (0..20_000).map(|k| fit.worst_texel((-12.0 + 36.0 * f64::from(k) / 2e4).exp2() / fit.d));
            let brute = brute.fold(fit.worst_texel(0.0), f64::min);
            let (_, found) = fit.least_worst();
            worst = worst.max(found / brute);
            assert!(
                found <= 1.01 * brute && found <= fit.worst_texel(0.0),
                "gamma {gamma} r {r}: {found} {brute}"
            );
        }
        assert!(worst >= 1.0);
    }

    #[test]
    fn receivers_lie_in_the_map_and_casters_in_its_depth() {
        for (i, convention) in ClipConvention::all().enumerate() {
            for gamma in [0.0, 1e-8, 1e-4, 0.03, 0.5, 1.5, 3.1, std::f64::consts::PI] {
                let eye = dvec3(1e6, -3e5, 70.0 * i as f64);
                let camera = Camera::look_at(eye, eye + dvec3(1.0, 0.2, 0.1), DVec3::Y).unwrap();
                let tilt = camera.right() * f64::sin(gamma) + camera.forward() * f64::cos(gamma);
                let b = DAabb::from_points([eye]).inflated(90.0);
                let mut focus = Focus::new();
                let skip = focus.directional(&camera, 80.0, tilt.normalize(), &[b], &[b], 4096).unwrap();
                assert_eq!(skip, None);
                let view = focus.map(&MapOptions { convention, ..MapOptions::new(4096) }, false);
                let (near, far) = convention.near_far_depth();
                let axes = focus.axes().unwrap();
                for p in focus.receivers.iter().chain(&focus.casters) {
                    let relative = axes.x * p.x + axes.y * p.y + axes.z * p.z;
                    // As a graphics card would: in f32.
                    let clip = view.matrix() * relative.as_vec3().extend(1.0);
                    let depth = f64::from(clip.z / clip.w);
                    assert!(depth >= near.min(far) - 1e-6 && depth <= near.max(far) + 1e-6, "{depth}");
                    if focus.receivers.contains(p) {
                        assert!(
                            clip.w > 0.0 && clip.x.abs() <= clip.w && clip.y.abs() <= clip.w,
                            "{gamma} {clip}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn what_needs_no_map_is_skipped() {
        let camera = Camera::look_at(DVec3::ZERO, DVec3::X, DVec3::Y).unwrap();
        let mut focus = Focus::new();
        let ground = [DAabb::new(dvec3(-50.0, -2.0, -50.0), dvec3(50.0, -1.5, 50.0))];
        let mut ask = |receivers: &[DAabb], casters: &[DAabb]| {
            focus.directional(&camera, 40.0, DVec3::NEG_Y, receivers, casters, 1024).unwrap()
        };
        let behind = [DAabb::new(dvec3(-9.0, 0.0, -1.0), dvec3(-5.0, 2.0, 1.0))];
        let below = [DAabb::new(dvec3(5.0, -9.0, -1.0), dvec3(9.0, -8.0, 1.0))];
        let above = [DAabb::new(dvec3(5.0, 50.0, -1.0), dvec3(9.0, 60.0, 1.0))];
        assert_eq!(ask(&behind, &above), Some(Skip::NothingSeen));
        assert_eq!(ask(&[], &above), Some(Skip::NothingSeen));
        assert_eq!(ask(&ground, &behind), Some(Skip::NoCaster));
        assert_eq!(ask(&ground, &below), Some(Skip::NoCaster));
        assert_eq!(ask(&ground, &[]), Some(Skip::NoCaster));
        assert_eq!(ask(&ground, &above), None);
    }
}
