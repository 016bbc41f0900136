//! Keeping a model true while frames go by.
//!
//! Objects timed alone run with caches that no frame has, so calibrated costs are off by tens of percent. What a whole frame took tells
//! the truth: this refit is where most of the accuracy comes from.

use crate::calibrate::check_time;
use crate::heuristics::TERMS;
use crate::linear::Normal;
use crate::quantiles::Residuals;
use crate::{Features, Heuristic, Millis, Model, TimingError};

/// How a refit behaves.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct RefitOptions {
    /// Frames after which an observation counts 1/e.
    pub memory: f64,
    /// Frames that the calibrated costs count for at the beginning.
    pub trust: f64,
    /// A frame is an outlier when it misses by more than this many typical misses (medians of the last ones).
    pub outlier: f64,
    /// Outliers in a row, all on one side, that are taken for a change rather than for hitches.
    pub persistence: u32,
    /// Share of the last miss that the next prediction takes over: what no term explains (hidden pixels, large triangles) changes slowly
    /// along a path. Zero predicts from the terms alone.
    pub tracking: f64,
}

impl Default for RefitOptions {
    /// Remembers 120 frames, trusts the calibration for 4, calls ten typical misses an outlier and five in a row a change; takes half of
    /// the last miss over.
    fn default() -> Self {
        Self { memory: 120.0, trust: 4.0, outlier: 10.0, persistence: 5, tracking: 0.5 }
    }
}

/// Typical misses are taken for at least this share of a frame: a large object that comes into view is no hitch, however quiet it was before.
const LEAST_TYPICAL: f64 = 0.015;

/// What became of an observed frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Observed {
    /// It was learnt from.
    Learnt,
    /// It was taken for a hitch and left out.
    Hitch,
    /// Outliers kept coming: the past was dropped, and learning starts anew from here.
    Change,
}

/// A linear model (any heuristic but the maximum) plus a constant per frame, refitted on whole frames.
///
/// Recursive least squares with exponential forgetting, kept as AᵀA and Aᵀb and solved for non-negative costs each frame. The calibration
/// enters as a handful of frames of its own, which also decides between terms that frames cannot tell apart.
///
/// # Cost
/// About 0.5 µs a frame, no allocation.
#[derive(Clone, Debug)]
pub struct Refit {
    model: Model,
    constant: Millis,
    options: RefitOptions,
    normal: Normal<{ TERMS + 1 }>,
    /// Typical size of each term in a frame, for the prior and for scaling.
    typical: [f64; TERMS + 1],
    frames: f64,
    /// Sizes of the last misses, relative to the prediction.
    misses: Residuals,
    outliers: i32,
    /// What the last frames took more than the terms say, as a share.
    bias: f64,
}

impl Refit {
    /// Starts from a calibrated model.
    ///
    /// # Errors
    /// [`TimingError::NotLinear`] for the maximum form, which a linear refit cannot follow.
    pub fn new(model: Model, constant: Millis, options: RefitOptions) -> Result<Self, TimingError> {
        if model.heuristic == Heuristic::Max {
            return Err(TimingError::NotLinear);
        }
        Ok(Self {
            model,
            constant,
            options,
            normal: Normal::ZERO,
            typical: [0.0; TERMS + 1],
            frames: 0.0,
            misses: Residuals::new(64),
            outliers: 0,
            bias: 0.0,
        })
    }

    /// The model as it stands.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Time of a frame that draws nothing, as it stands.
    pub fn constant(&self) -> Millis {
        self.constant
    }

    /// What the last frames took more than model and constant say, as a share: all costs are to be multiplied by 1 + this.
    pub fn bias(&self) -> f64 {
        self.bias
    }

    /// What a frame with these features (added over its objects) takes.
    #[inline]
    pub fn predict(&self, frame: &Features) -> Millis {
        self.by_terms(frame) * (1.0 + self.bias)
    }

    /// What an object of a frame takes, its share of the bias included.
    #[inline]
    pub fn predict_object(&self, object: &Features) -> Millis {
        self.model.predict(object) * (1.0 + self.bias)
    }

    fn by_terms(&self, frame: &Features) -> Millis {
        self.model.predict(frame) + self.constant
    }

    /// Learns from a frame.
    ///
    /// # Errors
    /// [`TimingError::Feature`] or [`TimingError::Time`] for values that no frame has; nothing is learnt then.
    pub fn observe(&mut self, frame: &Features, measured: Millis) -> Result<Observed, TimingError> {
        frame.checked()?;
        check_time(measured)?;
        let predicted = self.predict(frame);
        let verdict = self.judge(predicted, measured);
        if verdict == Observed::Hitch {
            return Ok(verdict);
        }
        if verdict == Observed::Change {
            self.start_anew(predicted, measured);
        }
        self.learn(frame, measured);
        self.track(frame, predicted, measured);
        Ok(verdict)
    }

    /// Whether a frame fits what was seen, is a hitch, or one too many of those.
    fn judge(&mut self, predicted: Millis, measured: Millis) -> Observed {
        let miss = (measured - predicted).0;
        let scale = predicted.0.max(1e-6);
        // Before a few frames were seen nothing is known of typical misses.
        let typical = self.misses.quantile(Millis(scale), 0.5).filter(|_| self.misses.len() >= 16);
        let limit = typical.map(|t| self.options.outlier * t.0.max(LEAST_TYPICAL * scale));
        // Hitches are recorded too: a median does not mind a few, and has to follow when all frames become unsteady.
        self.misses.record(Millis(scale), Millis(miss.abs()));
        if limit.is_none_or(|limit| miss.abs() <= limit) {
            self.outliers = 0;
            return Observed::Learnt;
        }
        let side = if miss > 0.0 { 1 } else { -1 };
        self.outliers = if self.outliers.signum() == side { self.outliers + side } else { side };
        if self.outliers.unsigned_abs() >= self.options.persistence {
            self.outliers = 0;
            return Observed::Change;
        }
        Observed::Hitch
    }

    /// Drops the past: costs are scaled to the new level and trusted like a fresh calibration.
    fn start_anew(&mut self, predicted: Millis, measured: Millis) {
        let factor = (1.0 + self.bias) * if predicted.0 > 0.0 { measured.0 / predicted.0 } else { 1.0 };
        self.bias = 0.0;
        self.model.costs.iter_mut().for_each(|c| *c *= factor);
        self.constant = self.constant * factor;
        self.normal = Normal::ZERO;
        self.frames = 0.0;
    }

    /// Corrects the level by a part of the miss; relative to the costs as they are after learning.
    fn track(&mut self, frame: &Features, predicted: Millis, measured: Millis) {
        let expected = predicted + (measured - predicted) * self.options.tracking.clamp(0.0, 1.0);
        let by_terms = self.by_terms(frame);
        self.bias = if self.options.tracking > 0.0 && by_terms.0 > 0.0 && predicted.0 > 0.0 {
            // Far from the last frames the correction is no more than a guess.
            (expected / by_terms - 1.0).clamp(-0.5, 1.0)
        } else {
            0.0
        };
    }

    fn learn(&mut self, frame: &Features, measured: Millis) {
        let mut row = [0.0; TERMS + 1];
        row[..TERMS].copy_from_slice(&self.model.heuristic.terms(frame));
        row[TERMS] = 1.0;
        if self.frames == 0.0 {
            self.typical = row;
        }
        let forget = (-1.0 / self.options.memory.max(1.0)).exp();
        self.normal.fade(forget);
        self.frames = self.frames * forget + 1.0;
        for (t, r) in self.typical.iter_mut().zip(row) {
            *t += (r - *t) / self.frames.max(1.0);
        }
        // Frames count by relative error, so that heavy ones do not drown light ones.
        let weight = 1.0 / measured.0.max(1e-3).powi(2);
        self.normal.add(&row, measured.0, weight);
        let x = self.with_prior(weight).solve();
        self.model.costs.copy_from_slice(&x[..TERMS]);
        self.constant = Millis(x[TERMS]);
    }

    /// The observations, and the costs so far as some frames that have one term each.
    fn with_prior(&self, weight: f64) -> Normal<{ TERMS + 1 }> {
        let mut normal = self.normal;
        // The prior fades with the observations but never to nothing: it decides what data cannot.
        let trust = (self.options.trust / self.frames.max(1.0)).max(1e-3);
        let costs: [f64; TERMS + 1] =
            std::array::from_fn(|i| if i < TERMS { self.model.costs[i] } else { self.constant.0 });
        for i in 0..=TERMS {
            let mut row = [0.0; TERMS + 1];
            row[i] = self.typical[i];
            normal.add(&row, self.typical[i] * costs[i], weight * trust);
        }
        normal
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(i: u32) -> Features {
        let t = f64::from(i);
        Features {
            vertices: 4e5 + 3e5 * (t * 0.031).sin(),
            pixels: 2e6 + 1.5e6 * (t * 0.047).cos(),
            ..Features::default()
        }
    }

    /// A law that the model does not have: a constant, a bend and a percent of noise.
    fn law(i: u32, f: &Features) -> f64 {
        let noise = 1.0 + 0.01 * (f64::from(i) * 12.9898).sin();
        (1.2 + 1.4e-5 * f.vertices + 3e-6 * f.pixels) * noise
    }

    fn start() -> Refit {
        let model = Model { heuristic: Heuristic::Sum, costs: [0.8e-5, 4e-6, 0.0, 0.0] };
        Refit::new(model, Millis::ZERO, RefitOptions::default()).unwrap()
    }

    #[test]
    fn a_biased_calibration_is_corrected_within_a_second() {
        let mut refit = start();
        let mut errors = Vec::new();
        for i in 0..600 {
            let (f, t) = (frame(i), law(i, &frame(i)));
            if i >= 60 {
                errors.push((refit.predict(&f).0 / t - 1.0).abs());
            }
            refit.observe(&f, Millis(t)).unwrap();
        }
        errors.sort_by(f64::total_cmp);
        let (median, p95) = (errors[errors.len() / 2], errors[errors.len() * 95 / 100]);
        assert!(median <= 0.02 && p95 <= 0.05, "{median} {p95}");
    }

    #[test]
    fn a_hitch_moves_nothing_and_a_step_is_followed_within_sixty_frames() {
        let mut refit = start();
        (0..300).for_each(|i| {
            refit.observe(&frame(i), Millis(law(i, &frame(i)))).unwrap();
        });
        let before = *refit.model();
        assert_eq!(refit.observe(&frame(300), Millis(60.0)).unwrap(), Observed::Hitch);
        assert_eq!(*refit.model(), before);
        let mut recovered = None;
        for k in 0..60 {
            let i = 301 + k;
            let t = 2.0 * law(i, &frame(i));
            if (refit.predict(&frame(i)).0 / t - 1.0).abs() < 0.1 {
                recovered.get_or_insert(k);
            } else {
                recovered = None;
            }
            refit.observe(&frame(i), Millis(t)).unwrap();
        }
        assert!(recovered.is_some_and(|k| k <= 20), "{recovered:?}");
    }

    #[test]
    fn constant_frames_keep_the_ratio_of_the_calibration() {
        let mut refit = start();
        let f = frame(0);
        (0..200).for_each(|_| {
            refit.observe(&f, Millis(20.0)).unwrap();
        });
        assert!((refit.predict(&f).0 - 20.0).abs() < 0.2);
        assert!(refit.model().costs[0] > 0.0 && refit.model().costs[1] > 0.0, "{:?}", refit.model());
    }

    #[test]
    fn nonsense_is_refused_and_teaches_nothing() {
        let mut refit = start();
        for t in [f64::NAN, -1.0, f64::INFINITY] {
            assert!(refit.observe(&frame(0), Millis(t)).is_err());
        }
        assert!(refit.observe(&Features { pixels: -1.0, ..frame(0) }, Millis(1.0)).is_err());
        (0..50).for_each(|_| {
            refit.observe(&Features::default(), Millis(0.0)).unwrap();
        });
        assert!(refit.predict(&frame(0)).0.is_finite());
        let max = Model { heuristic: Heuristic::Max, costs: [0.0; TERMS] };
        assert!(Refit::new(max, Millis::ZERO, RefitOptions::default()).is_err());
    }
}
