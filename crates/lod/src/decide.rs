//! Whether an impostor pays: what it costs a frame, over the frames for which it will serve.

use glam::DVec3;
use std::time::Duration;

/// What an approximation is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kind {
    /// Triangles.
    Geometry,
    /// A picture.
    Impostor,
}

/// What things take, as the caller measures or predicts them for one object: nothing here is built in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Costs {
    /// Bringing the cut up to date and handing over its triangles.
    pub extract: Duration,
    /// Drawing these triangles once.
    pub draw_geometry: Duration,
    /// Making an impostor's picture of them.
    pub create_impostor: Duration,
    /// Drawing the picture once.
    pub draw_impostor: Duration,
}

/// When an impostor is chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct DecisionOptions {
    /// Share of its cost that a change of kind must save.
    pub margin: f64,
    /// Largest picture, as a share of the image's side: a guard for memory and fill rate, since errors are bounded anyway.
    pub max_ratio: f64,
    /// Most frames that anything is counted on to serve.
    pub horizon: u32,
}

impl Default for DecisionOptions {
    /// A tenth, a quarter, 600 frames.
    fn default() -> Self {
        Self { margin: 0.1, max_ratio: 0.25, horizon: 600 }
    }
}

/// What a decision is made from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    /// Costs.
    pub costs: Costs,
    /// Whether nothing can come between the object's parts ([`is_separable`](crate::is_separable)), or the picture has depth.
    pub separable: bool,
    /// Side of the picture over that of the image ([`ImpostorView::resolution_ratio`](crate::ImpostorView::resolution_ratio)).
    pub ratio: f64,
    /// Frames, the first included, for which triangles made now will serve.
    pub geometry_frames: f64,
    /// The same for a picture; below 1 if there can be none.
    pub impostor_frames: f64,
    /// What the object has been drawn as so far.
    pub current: Option<Kind>,
}

/// Why it was decided so.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Reason {
    /// Something else reaches between object and picture.
    NotSeparable,
    /// The picture would be too large a share of the image.
    TooLarge,
    /// The picture would not serve for a single frame, or there can be none.
    NoPicture,
    /// Triangles cost less.
    GeometryCheaper,
    /// The picture costs less.
    ImpostorCheaper,
    /// The other costs less, but not by the margin.
    WithinMargin,
    /// The picture would cost less if nothing moved; but how things move is not known yet.
    FirstSeen,
}

/// What was decided, and from which numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decision {
    /// What to draw.
    pub kind: Kind,
    /// Why.
    pub reason: Reason,
    /// Milliseconds a frame as triangles, making them included.
    pub geometry_ms: f64,
    /// The same as a picture; infinite if there can be none.
    pub impostor_ms: f64,
}

/// Decides between triangles and a picture.
///
/// Both sides pay for what they need when they expire: triangles an extraction, a picture an extraction and the picture. With N the frames that each
/// serves, the picture is chosen where
///
/// (extract + create) / Nᵢ + draw impostor < extract / N_g + draw geometry,
///
/// by a margin if the object has been triangles so far; back to triangles likewise.
///
/// ```
/// use farsight_lod::{Choice, Costs, DecisionOptions, Kind, decide};
/// use std::time::Duration;
///
/// let us = Duration::from_micros;
/// let costs = Costs { extract: us(50), draw_geometry: us(200), create_impostor: us(900), draw_impostor: us(10) };
/// let mut choice = Choice {
///     costs, separable: true, ratio: 0.1, geometry_frames: 20.0, impostor_frames: 20.0, current: None,
/// };
/// assert_eq!(decide(&choice, &DecisionOptions::default()).kind, Kind::Impostor);
/// choice.impostor_frames = 3.0; // it would not last
/// assert_eq!(decide(&choice, &DecisionOptions::default()).kind, Kind::Geometry);
/// ```
///
/// # References
/// [Hilbert & Brunnett 2004, equation 1]; Shade et al. 1996. Differs: the paper spreads the cost of the picture only.
pub fn decide(choice: &Choice, options: &DecisionOptions) -> Decision {
    let ms = |d: Duration| d.as_secs_f64() * 1e3;
    let costs = &choice.costs;
    let horizon = f64::from(options.horizon.max(1));
    let geometry_ms =
        ms(costs.extract) / choice.geometry_frames.clamp(1.0, horizon) + ms(costs.draw_geometry);
    let impostor_ms = if choice.impostor_frames >= 1.0 {
        ms(costs.extract + costs.create_impostor) / choice.impostor_frames.min(horizon)
            + ms(costs.draw_impostor)
    } else {
        f64::INFINITY
    };
    let geometry = |reason| Decision { kind: Kind::Geometry, reason, geometry_ms, impostor_ms };
    let impostor = |reason| Decision { kind: Kind::Impostor, reason, geometry_ms, impostor_ms };
    if impostor_ms.is_infinite() {
        return geometry(Reason::NoPicture);
    }
    if !choice.separable {
        return geometry(Reason::NotSeparable);
    }
    if choice.ratio.is_nan() || choice.ratio > options.max_ratio {
        return geometry(Reason::TooLarge);
    }
    let kept = 1.0 - options.margin;
    match choice.current {
        _ if impostor_ms < kept * geometry_ms => impostor(Reason::ImpostorCheaper),
        _ if geometry_ms < kept * impostor_ms => geometry(Reason::GeometryCheaper),
        Some(Kind::Impostor) if impostor_ms <= geometry_ms => impostor(Reason::ImpostorCheaper),
        Some(Kind::Impostor) => impostor(Reason::WithinMargin),
        Some(Kind::Geometry) if impostor_ms < geometry_ms => geometry(Reason::WithinMargin),
        Some(Kind::Geometry) => geometry(Reason::GeometryCheaper),
        None if impostor_ms < geometry_ms => impostor(Reason::ImpostorCheaper),
        None => geometry(Reason::GeometryCheaper),
    }
}

/// Frames from the present one on, itself included, for which something `serves` an eye that moves by `step` a frame; at most `horizon`, 0 if it does not serve now.
///
/// Found by doubling and halving, so what stops to serve and serves again in between may be overlooked.
pub fn frames_until(serves: impl Fn(DVec3) -> bool, eye: DVec3, step: DVec3, horizon: u32) -> u32 {
    let at = |frames: u32| serves(eye + step * f64::from(frames));
    if !at(0) {
        return 0;
    }
    if step == DVec3::ZERO {
        return horizon.max(1);
    }
    let (mut good, mut bad) = (0, 1);
    while bad < horizon && at(bad) {
        (good, bad) = (bad, bad.saturating_mul(2));
    }
    bad = bad.min(horizon);
    while bad - good > 1 {
        let middle = good + (bad - good) / 2;
        if at(middle) { good = middle } else { bad = middle }
    }
    bad.max(1)
}

/// Corrects predicted numbers of frames by those that were achieved: a moving average of the logarithm of their ratio.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Forecast {
    log_ratio: f64,
    /// Share of a new observation.
    weight: f64,
}

impl Default for Forecast {
    /// No correction yet; a new observation counts for a quarter.
    fn default() -> Self {
        Self { log_ratio: 0.0, weight: 0.25 }
    }
}

/// Largest correction either way: one odd interval must not rule decisions for long.
const MOST: f64 = 8.0;

impl Forecast {
    /// Achieved over predicted frames, on average.
    pub fn ratio(&self) -> f64 {
        self.log_ratio.exp()
    }

    /// A prediction, corrected.
    pub fn corrected(&self, predicted: f64) -> f64 {
        predicted * self.ratio()
    }

    /// Forgets a little, as for a kind that is not in use: what it was like then says less and less.
    pub fn fade(&mut self) {
        self.log_ratio *= 0.99;
    }

    /// Takes note of how long something served that was predicted (uncorrected) to serve for so many frames. Of what was given up while it still served
    /// (`expired` is false) only counts that it served longer than predicted.
    pub fn observe(&mut self, predicted: f64, achieved: f64, expired: bool) {
        let usable = predicted >= 1.0 && achieved >= 1.0;
        if !usable || (!expired && achieved < predicted) {
            return;
        }
        let log = (achieved / predicted).ln().clamp(-MOST.ln(), MOST.ln());
        self.log_ratio += self.weight * (log - self.log_ratio);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn choice(draw_geometry: u64, frames: f64, current: Option<Kind>) -> Choice {
        let us = Duration::from_micros;
        let costs = Costs {
            extract: us(50),
            draw_geometry: us(draw_geometry),
            create_impostor: us(950),
            draw_impostor: us(10),
        };
        Choice { costs, separable: true, ratio: 0.1, geometry_frames: 10.0, impostor_frames: frames, current }
    }

    #[test]
    fn the_equation_by_hand() {
        let options = DecisionOptions::default();
        // 1 ms / 20 + 10 µs = 60 µs against 5 µs + draw.
        for (draw, current, kind, reason) in [
            (54, None, Kind::Geometry, Reason::GeometryCheaper),
            (56, None, Kind::Impostor, Reason::ImpostorCheaper),
            (56, Some(Kind::Geometry), Kind::Geometry, Reason::WithinMargin),
            (62, Some(Kind::Geometry), Kind::Impostor, Reason::ImpostorCheaper),
            (50, Some(Kind::Impostor), Kind::Impostor, Reason::WithinMargin),
            (48, Some(Kind::Impostor), Kind::Geometry, Reason::GeometryCheaper),
        ] {
            let d = decide(&choice(draw, 20.0, current), &options);
            assert_eq!((d.kind, d.reason), (kind, reason), "{draw} {current:?}");
            assert!((d.impostor_ms - 0.06).abs() < 1e-12);
            assert!((d.geometry_ms - 0.005 - draw as f64 * 1e-3).abs() < 1e-12);
        }
        let never = [
            (Choice { impostor_frames: 0.0, ..choice(9000, 20.0, None) }, Reason::NoPicture),
            (Choice { separable: false, ..choice(9000, 20.0, None) }, Reason::NotSeparable),
            (Choice { ratio: 0.26, ..choice(9000, 20.0, None) }, Reason::TooLarge),
            (Choice { ratio: f64::NAN, ..choice(9000, 20.0, None) }, Reason::TooLarge),
        ];
        for (choice, reason) in never {
            let d = decide(&choice, &options);
            assert_eq!((d.kind, d.reason), (Kind::Geometry, reason));
        }
    }

    #[test]
    fn frames_are_counted_to_the_first_that_fails() {
        for limit in 0..40u32 {
            let serves = |p: DVec3| p.x < f64::from(limit) - 0.5;
            assert_eq!(frames_until(serves, DVec3::ZERO, DVec3::X, 600), limit, "{limit}");
            assert_eq!(frames_until(serves, DVec3::ZERO, DVec3::X, 10), limit.min(10));
        }
        assert_eq!(frames_until(|_| true, DVec3::ZERO, DVec3::X, 600), 600);
        assert_eq!(frames_until(|_| true, DVec3::ZERO, DVec3::ZERO, 600), 600);
        assert_eq!(frames_until(|_| true, DVec3::ZERO, DVec3::X, u32::MAX), u32::MAX);
        assert_eq!(frames_until(|_| false, DVec3::ZERO, DVec3::ZERO, 600), 0);
    }

    #[test]
    fn forecasts_learn_the_ratio() {
        let mut forecast = Forecast::default();
        (0..40).for_each(|_| forecast.observe(10.0, 30.0, true));
        assert!((forecast.ratio() - 3.0).abs() < 1e-3);
        forecast.observe(10.0, 1.0, false);
        assert!((forecast.ratio() - 3.0).abs() < 1e-3, "given up, not expired");
        forecast.observe(1.0, 1e9, true);
        assert!(forecast.ratio() < 3.0 * 1.3);
        (0..1000).for_each(|_| forecast.fade());
        assert!((forecast.ratio() - 1.0).abs() < 0.01);
    }
}
