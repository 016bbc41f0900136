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
//! is divided by the sine of an angle that may vanish. For a spot light x, y, u are those after its own projection.

use crate::focus::Focus;
use crate::light::{LightAxes, LightSpace};
use crate::minimax::Fit;
use farsight_geometry::ClipConvention;
use farsight_geometry::accuracy::{ErrorBound, Unit};
use glam::{DMat4, DVec3, DVec4, Mat4};

/// How the strength κ of the warp is chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum Warp {
    /// κ = 0: equal texels everywhere.
    Uniform,
    /// κ = 0, a size that does not depend on where the camera looks, and a position in whole texels: shadows do not crawl.
    /// Parallel light only; other lights get [`Warp::Uniform`].
    Stable,
    /// n = near distance: perspective shadow maps (baseline).
    Perspective,
    /// n = zn + √(zn·zf), over sin γ when the light is tilted (Wimmer 2007, 3.4.3 and 3.4.4).
    Paper,
    /// The rule of Wimmer 2007, 3.4.4, with zf replaced by the extent along the light's z axis.
    PaperTilted,
    /// n = (zf − zn) / (r^(2/3) − 1) with r = zf/zn: least product of both errors for light across the view.
    LeastProduct,
    /// The κ with the least worst texel over the receivers, if it gains enough over κ = 0.
    #[default]
    Minimax,
    /// This κ, per unit of light space; as all rules, up to where texels would be finer than `f32` coordinates.
    Kappa(f64),
}

/// Size, filter border, warp and conventions of a map.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct MapOptions {
    /// Texels on a side.
    pub side: u32,
    /// How κ is chosen.
    pub warp: Warp,
    /// Clip space of the result.
    pub convention: ClipConvention,
    /// Texels kept free along each side, so that filters and `f32` rounding stay inside.
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

    /// The options with another warp.
    #[must_use]
    pub fn with_warp(self, warp: Warp) -> Self {
        Self { warp, ..self }
    }

    /// The options for another clip space.
    #[must_use]
    pub fn with_convention(self, convention: ClipConvention) -> Self {
        Self { convention, ..self }
    }

    /// The options with `border` free texels along each side.
    #[must_use]
    pub fn with_border(self, border: f64) -> Self {
        Self { border, ..self }
    }

    /// Share of a side that is used; at least half, however wide the border.
    fn inside(&self) -> f64 {
        (1.0 - 2.0 * self.border.max(0.0) / f64::from(self.side.max(1))).max(0.5)
    }
}

/// A shadow map's matrix and what it is worth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShadowView {
    /// World position that the matrices are relative to: the eye.
    pub origin: DVec3,
    /// Clip space from world coordinates minus `origin`. s grows with clip y, t with clip x.
    pub clip_from_relative: DMat4,
    /// The warp's strength, per unit of light space.
    pub kappa: f64,
    /// Largest number of pixels that one texel covers on the screen, over all receivers in view: the texel's extent
    /// across the light (along the map's plane for a spot), over the distance ahead of the eye.
    ///
    /// [`Proven`](farsight_geometry::accuracy::Kind::Proven) where the proof holds (see [`Focus::map`]), else `Measured`:
    /// the largest value at the receivers' corners.
    pub texel: ErrorBound,
    /// The same for κ = 0.
    pub texel_uniform: ErrorBound,
    /// Texels on a side, those kept free included.
    pub side: u32,
    /// Texels kept free along each side.
    pub border: f64,
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

    /// Side of the map at which no texel covers more than `pixels`; the same κ is assumed. Saturates at `u32::MAX`.
    pub fn required_side(&self, pixels: f64) -> u32 {
        let used = f64::from(self.side) - 2.0 * self.border;
        (self.texel.value / pixels * used + 2.0 * self.border).ceil() as u32
    }
}

/// Claims are rounded up by this share. The corners carry errors of a few ulp of their coordinates, which exceed their
/// distance from the eye by at most the ratio of far to near; 1e-9 covers a ratio of 1e6.
const ROUNDING: f64 = 1e-9;

impl Focus {
    /// The map for what was fitted. `previous` is the last frame's map of this light: while it warps, the warp is kept until it
    /// gains little, and among equally good ones (within 1 %) the strength nearest to it is taken, so that the map moves steadily.
    ///
    /// # Accuracy
    /// The worst texel is attained at a corner of the receivers. Across, its extent is w over the eye's distance, a ratio of linear
    /// functions. Along, it is w·√(w² + κ²x²) over that distance, which is convex where |κ·x| ≤ √2·w; its ratio to a positive
    /// linear function is then quasi-convex, with its maximum over a convex body at a corner. When all corners satisfy the
    /// condition, so does the body, and [`ShadowView::texel`] is proven; otherwise it is what the corners show, and a larger texel
    /// between them is possible though dense sampling found none. [`Warp::Minimax`] is within 1 % of the least value at the corners
    /// and never above that of the uniform map.
    ///
    /// # Cost
    /// About 2 µs for `Minimax` over eight corners, 0.2 µs for the other rules.
    ///
    /// # Panics
    /// When the focus is empty: it was not filled, or was skipped.
    pub fn map(&self, options: &MapOptions, previous: Option<&ShadowView>) -> ShadowView {
        assert!(!self.receivers.is_empty(), "the focus holds receivers");
        if options.warp == Warp::Stable && self.is_directional() {
            return self.stable(options);
        }
        let fit = Fit::new(self);
        let kappa = match options.warp {
            Warp::Minimax => self.minimax(&fit, options, previous),
            rule => self.kappa_of(rule, fit.d),
        };
        let inside = options.inside();
        let (low, across) = fit.across(kappa);
        let window = Window {
            space: self.space,
            near: self.footprint.min.z,
            along: fit.d,
            low,
            across,
            kappa,
            inside,
            depth: self.depth_span(kappa),
        };
        // Pixels per texel: extent per unit of map, over texels per unit, times pixels per unit of image plane.
        let pixels = self.pixels_per_unit / (f64::from(options.side) * inside);
        let bound = |kappa| {
            let value = fit.worst_texel(kappa) * pixels * (1.0 + ROUNDING);
            if fit.corners_decide(kappa) {
                ErrorBound::proven(value, Unit::Pixels)
            } else {
                ErrorBound::measured(value, Unit::Pixels)
            }
        };
        let uniform = bound(0.0);
        let texel = if kappa > 0.0 { bound(kappa) } else { uniform };
        self.view(window.matrix(options.convention), kappa, [texel, uniform], options)
    }

    pub(crate) fn view(
        &self,
        matrix: DMat4,
        kappa: f64,
        [texel, texel_uniform]: [ErrorBound; 2],
        options: &MapOptions,
    ) -> ShadowView {
        let border = 0.5 * f64::from(options.side) * (1.0 - options.inside());
        let (origin, side) = (self.origin, options.side);
        ShadowView { origin, clip_from_relative: matrix, kappa, texel, texel_uniform, side, border }
    }

    fn minimax(&self, fit: &Fit, options: &MapOptions, previous: Option<&ShadowView>) -> f64 {
        if !self.axes.is_some_and(|a| a.from_view) {
            return 0.0;
        }
        let before = previous.map_or(0.0, |p| p.kappa);
        let (kappa, worst) = fit.least_worst(before);
        let enough = if before > 0.0 { options.gain_off } else { options.gain_on };
        if fit.worst_texel(0.0) >= enough * worst { kappa } else { 0.0 }
    }

    /// κ of a closed rule, from the depths of the receivers and the angle of the light.
    fn kappa_of(&self, rule: Warp, d: f64) -> f64 {
        let depths = self.receivers.iter().map(|c| c.scale.recip());
        let (near, far) = depths.fold((f64::INFINITY, 0.0), |(lo, hi), z| (z.min(lo), z.max(hi)));
        // A spot's depths are relative to the distance from the light; what turns them into lengths along the map's axis is
        // the ratio of the extents rather than an angle.
        let sin_gamma = if self.is_directional() { self.sin_gamma } else { (far - near) / d };
        let kappa = match rule {
            Warp::Uniform | Warp::Stable | Warp::Minimax => 0.0,
            Warp::Perspective => sin_gamma / near,
            Warp::Paper => sin_gamma / (near + (near * far).sqrt()),
            Warp::PaperTilted => sin_gamma / (near + (near * (near + d * sin_gamma)).sqrt()),
            Warp::LeastProduct => sin_gamma * ((far / near).powf(2.0 / 3.0) - 1.0) / (far - near),
            Warp::Kappa(kappa) => kappa,
        };
        if kappa > 0.0 { kappa.min(self.kappa_most) } else { 0.0 }
    }

    /// Highest y, and the largest (top − y)/w over casters and receivers, with a margin.
    pub(crate) fn depth_span(&self, kappa: f64) -> (f64, f64) {
        let near = self.footprint.min.z;
        let all = || self.casters.iter().copied().chain(self.receivers.iter().map(|c| c.q));
        let top = all().map(|p| p.y).fold(f64::NEG_INFINITY, f64::max);
        let span = all().map(|p| (top - p.y) / (1.0 + kappa * (p.z - near)).max(1.0)).fold(0.0, f64::max);
        // A margin of a thousandth keeps the ends off the planes; a flat scene still needs a range.
        let least = self.footprint.extent().y.max(1e-6 * top.abs()).max(f64::from(f32::MIN_POSITIVE));
        let span = (span * 1.001).max(least);
        (top + 5e-4 * span, span)
    }

    pub(crate) fn is_directional(&self) -> bool {
        matches!(self.light, Some(crate::ShadowLight::Directional { .. }))
    }
}

/// What part of light space the map shows, and how.
pub(crate) struct Window {
    pub space: LightSpace,
    /// Where it begins along the warp axis, and how far it reaches.
    pub near: f64,
    pub along: f64,
    /// Where x/w begins, and how far it reaches.
    pub low: f64,
    pub across: f64,
    pub kappa: f64,
    /// Share of the map that it fills, in the middle.
    pub inside: f64,
    /// Highest y and the extent of y/w.
    pub depth: (f64, f64),
}

impl Window {
    pub fn matrix(&self, convention: ClipConvention) -> DMat4 {
        let LightSpace { x, y, z, h } = self.space;
        let kappa = self.kappa;
        let u = z - h * self.near;
        let w = h + u * kappa;
        let centred = |row01: DVec4| (row01 * 2.0 - w) * self.inside;
        let s = u * ((1.0 + kappa * self.along) / self.along);
        let t = (x - w * self.low) / self.across;
        // Depth grows along the light, from the highest caster to the lowest receiver.
        let (top, span) = self.depth;
        let along = (h * top - y) / span;
        let (near_depth, far_depth) = convention.near_far_depth();
        let depth = w * near_depth + along * (far_depth - near_depth);
        let y_sign = if convention.y_down { -1.0 } else { 1.0 };
        DMat4::from_cols(centred(t), centred(s) * y_sign, depth, w).transpose()
    }
}

/// Light space along axes that depend on the light alone.
pub(crate) fn light_only(direction: DVec3) -> (LightAxes, LightSpace) {
    let axes = LightAxes::of_light(direction);
    (axes, LightSpace::new(&crate::ShadowLight::Directional { direction }, &axes, DVec3::ZERO))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Scope, ShadowLight, Skip};
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
        let skip = focus
            .fit(
                &ShadowLight::directional(DVec3::NEG_Y),
                &Scope::new(&camera, r, &everything, &everything, 1024),
            )
            .unwrap();
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

    /// The errors dp/ds and dp/dt of Wimmer 2007, chapter 3, by finite differences of the real matrix, largest along the centre line:
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
                let (es, et) = largest_errors(&focus, &focus.map(&options(warp), None), r);
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
            if focus
                .fit(&ShadowLight::directional(light), &Scope::new(&camera, r, &[slab], &[slab], 2048))
                .unwrap()
                .is_some()
            {
                continue;
            }
            let fit = Fit::new(&focus);
            let brute = (0..20_000).map(|k| {
                fit.worst_texel(((-12.0 + 36.0 * f64::from(k) / 2e4).exp2() / fit.d).min(focus.kappa_most))
            });
            let brute = brute.fold(fit.worst_texel(0.0), f64::min);
            let (_, found) = fit.least_worst(0.0);
            worst = worst.max(found / brute);
            assert!(
                found <= 1.01 * brute && found <= fit.worst_texel(0.0),
                "gamma {gamma} r {r}: {found} {brute}"
            );
        }
        println!("worst texel over that of the best of 20000 strengths, minus one: {:.1e}", worst - 1.0);
        assert!(worst >= 1.0 - 1e-9);
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
                let skip = focus
                    .fit(
                        &ShadowLight::directional(tilt.normalize()),
                        &Scope::new(&camera, 80.0, &[b], &[b], 4096),
                    )
                    .unwrap();
                assert_eq!(skip, None);
                let view = focus.map(&MapOptions::new(4096).with_convention(convention), None);
                let (near, far) = convention.near_far_depth();
                let axes = focus.axes().unwrap();
                let corners: Vec<DVec3> = focus.receivers.iter().map(|c| c.q).collect();
                for p in corners.iter().chain(&focus.casters) {
                    let relative = axes.x * p.x + axes.y * p.y + axes.z * p.z;
                    // As a graphics card would: in f32.
                    let clip = view.matrix() * relative.as_vec3().extend(1.0);
                    let depth = f64::from(clip.z / clip.w);
                    assert!(depth >= near.min(far) - 1e-6 && depth <= near.max(far) + 1e-6, "{depth}");
                    if corners.contains(p) {
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
            focus
                .fit(
                    &ShadowLight::directional(DVec3::NEG_Y),
                    &Scope::new(&camera, 40.0, receivers, casters, 1024),
                )
                .unwrap()
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
