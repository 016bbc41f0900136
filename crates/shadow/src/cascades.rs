//! How many maps a wanted error takes, and where each of them begins.

use crate::ShadowError;
use crate::focus::{Focus, Scope, Skip};
use crate::light::ShadowLight;
use crate::warp::{MapOptions, ShadowView};
use farsight_geometry::accuracy::ErrorBound;

/// A map of its own for a range of distances from the eye.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cascade {
    /// Distance ahead of the eye where it begins.
    pub near: f64,
    /// Where it ends.
    pub far: f64,
    /// Its map.
    pub view: ShadowView,
}

/// Cascades that meet an error, or the most that were allowed.
#[derive(Clone, Debug, PartialEq)]
pub struct CascadePlan {
    /// The cascades, near to far. Ranges in which nothing needs a map have none.
    pub cascades: Vec<Cascade>,
    /// Ranges the distances were split into, with and without a map.
    pub splits: u32,
    /// Largest texel over all cascades.
    pub texel: ErrorBound,
    /// Whether it is as small as was asked for.
    pub met: bool,
}

impl CascadePlan {
    /// Texels of all maps.
    pub fn texels(&self) -> u64 {
        self.cascades.iter().map(|c| u64::from(c.view.side).pow(2)).sum()
    }
}

/// Distances that split `near`..`far` into `count` ranges of equal ratio.
pub fn log_splits(near: f64, far: f64, count: u32) -> impl Iterator<Item = (f64, f64)> {
    let at = move |i: u32| match i {
        0 => near,
        i if i == count => far,
        i => near * (far / near).powf(f64::from(i) / f64::from(count)),
    };
    (0..count).map(move |i| (at(i), at(i + 1)))
}

/// The least number of log splits for which dp/ds stays at or below `dp_ds`, for light across the view and receivers at all distances
/// whose ratio is `ratio` (closed form).
///
/// With ρ = ratio^(1/k), uniform maps have ρ − 1 at worst, the best warp √ρ − 1/√ρ = 2·sinh(ln ρ / 2).
///
/// # References
/// Wimmer 2007, 3.4, applied to each cascade.
pub fn least_cascades(ratio: f64, dp_ds: f64, warped: bool) -> u32 {
    let largest_log = if warped { 2.0 * (0.5 * dp_ds).asinh() } else { dp_ds.ln_1p() };
    let count = (ratio.ln() / largest_log).max(1.0);
    // A quotient that rounding lifted over a whole number must not cost a map.
    (count * (1.0 - 1e-12)).ceil() as u32
}

/// Plans cascades by log splits between the nearest and farthest receiver in view: the least number whose largest texel is at
/// most `error_px`, up to `most`.
///
/// Each count is tried with the real bodies, casters and warp, from one on, so no smaller number of log splits would do. When `most`
/// do not suffice, the plan of `most` comes back with [`CascadePlan::met`] false. The inner `Err` says why no map is needed at all.
///
/// # Cost
/// One [`Focus::fit`] and [`Focus::map`] for each cascade of each count: about 100 µs for `most` = 8. For planning, not for
/// every frame: with the splits known, fit one focus for each.
///
/// # Errors
/// As [`Focus::fit`].
pub fn plan_cascades(
    light: &ShadowLight,
    scope: &Scope,
    options: &MapOptions,
    error_px: f64,
    most: u32,
) -> Result<Result<CascadePlan, Skip>, ShadowError> {
    let mut focus = Focus::new();
    if let Some(skip) = focus.fit(light, scope)? {
        return Ok(Err(skip));
    }
    let (near, far) = focus.eye_depths(scope);
    let mut plan = None;
    for splits in 1..=most.max(1) {
        let next = with_splits(light, scope, options, log_splits(near, far, splits).collect(), error_px)?;
        let met = next.met;
        plan = Some(next);
        if met {
            break;
        }
    }
    Ok(Ok(plan.expect("at least one count was tried")))
}

/// Maps for given ranges of distance; those that need none are dropped.
fn with_splits(
    light: &ShadowLight,
    scope: &Scope,
    options: &MapOptions,
    ranges: Vec<(f64, f64)>,
    error_px: f64,
) -> Result<CascadePlan, ShadowError> {
    let mut cascades = Vec::new();
    let mut texel: Option<ErrorBound> = None;
    let splits = ranges.len() as u32;
    for (near, far) in ranges {
        let Ok(camera) = scope.camera.with_range(near, far) else { continue };
        let mut focus = Focus::new();
        let part = Scope { camera: &camera, shadow_far: far, map_side: options.side, ..*scope };
        if focus.fit(light, &part)?.is_some() {
            continue;
        }
        let view = focus.map(options, None);
        texel = Some(match texel {
            None => view.texel,
            Some(t) => t.worst_of(view.texel).expect("both are in pixels"),
        });
        cascades.push(Cascade { near, far, view });
    }
    let texel = texel.unwrap_or(ErrorBound::proven(0.0, farsight_geometry::accuracy::Unit::Pixels));
    Ok(CascadePlan { cascades, splits, texel, met: texel.value <= error_px })
}

impl Focus {
    /// Least and largest distance ahead of the eye over the receivers, widened by rounding.
    fn eye_depths(&self, scope: &Scope) -> (f64, f64) {
        let ahead = scope.camera.forward();
        let depths = self.corners().iter().map(|p| ahead.dot(*p));
        let (near, far) = depths.fold((f64::INFINITY, 0.0f64), |(lo, hi), z| (lo.min(z), hi.max(z)));
        let near = (near * (1.0 - 1e-9)).max(scope.camera.near());
        (near, (far * (1.0 + 1e-9)).max(near * (1.0 + 1e-6)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Spacing, Warp};
    use farsight_geometry::{Camera, DAabb};
    use glam::{DVec3, dvec3};

    #[test]
    fn the_closed_form_is_the_least_count() {
        for r in [2.0f64, 100.0, 400.0, 1000.0, 1e4, 1e6] {
            for e in [0.01, 0.5, 1.0, 2.19, 10.0, 31.62] {
                for warped in [false, true] {
                    let worst = |k: u32| {
                        let rho = r.powf(1.0 / f64::from(k));
                        let spacing = if warped { Spacing::best_warp(1.0, rho) } else { Spacing::Uniform };
                        spacing.largest_dp_ds(1.0, rho)
                    };
                    let k = least_cascades(r, e, warped);
                    assert!(worst(k) <= e * (1.0 + 1e-9), "{r} {e} {warped}");
                    assert!(k == 1 || worst(k - 1) > e, "{r} {e} {warped}: {k} is not the least");
                }
            }
        }
        // A 2048 map for 1080 rows at 60°, r = 100, 400, 1000, 10⁴.
        let e = 2.0 * 30f64.to_radians().tan() * 2048.0 / 1080.0;
        let counts = |warped| [1e2, 4e2, 1e3, 1e4].map(|r| least_cascades(r, e, warped));
        assert_eq!((counts(false), counts(true)), ([4, 6, 6, 8], [3, 4, 4, 5]));
    }

    #[test]
    fn plans_meet_their_error_and_drop_what_is_empty() {
        let camera = Camera::look_at(DVec3::ZERO, DVec3::X, DVec3::Z).unwrap();
        let light = ShadowLight::directional(dvec3(0.1, 0.3, -1.0).normalize());
        let ground = [DAabb::new(dvec3(-1e3, -1e3, -2.0), dvec3(1e3, 1e3, -1.9))];
        // Two houses, one near, one far: the ranges between need no map.
        let houses = [
            DAabb::new(dvec3(4.0, -1.0, -2.0), dvec3(6.0, 1.0, 1.0)),
            DAabb::new(dvec3(600.0, -20.0, -2.0), dvec3(640.0, 20.0, 20.0)),
        ];
        let scope = Scope::new(&camera, 1000.0, &ground, &houses, 2048);
        let options = MapOptions::new(2048);
        let plan = plan_cascades(&light, &scope, &options, 1.0, 24).unwrap().unwrap();
        assert!(plan.met && plan.texel.value <= 1.0, "{} {}", plan.splits, plan.texel);
        assert!(plan.splits > 2 && (plan.cascades.len() as u32) < plan.splits, "{plan:?}");
        assert_eq!(plan.texels(), 2048 * 2048 * plan.cascades.len() as u64);
        let fewer = plan_cascades(&light, &scope, &options, 1.0, plan.splits - 1).unwrap().unwrap();
        assert!(!fewer.met && fewer.splits == plan.splits - 1);
        let uniform = options.with_warp(Warp::Uniform);
        let uniform = plan_cascades(&light, &scope, &uniform, 1.0, 64).unwrap().unwrap();
        assert!(uniform.met && uniform.splits >= plan.splits);
        let nothing = Scope::new(&camera, 1000.0, &ground, &[], 2048);
        assert_eq!(plan_cascades(&light, &nothing, &options, 1.0, 4), Ok(Err(Skip::NoCaster)));
    }
}
