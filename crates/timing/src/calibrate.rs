//! Costs of a heuristic's terms from measured drawings.

use crate::heuristics::TERMS;
use crate::linear::Normal;
use crate::{Features, Heuristic, Millis, Model, TimingError};

/// A measured drawing: of an object alone, or of a frame (with its features added up).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// What was drawn.
    pub features: Features,
    /// What it took.
    pub time: Millis,
}

/// A calibrated model and how far it can be trusted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// The model.
    pub model: Model,
    /// Time that does not depend on the features; zero unless asked for.
    pub constant: Millis,
    /// Share of the variance that the model explains; can be negative for a bad one.
    pub r_squared: f64,
    /// Root of the mean squared error over the samples.
    pub rms: Millis,
    /// Share of each term that the other terms do not explain: near zero, its cost is a guess.
    pub independence: [f64; TERMS],
}

/// What to do when terms cannot be told apart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Collinear {
    /// Refuse with [`TimingError::Collinear`].
    #[default]
    Refuse,
    /// Leave the cost to one of them. Predictions stay good while they keep their ratio.
    Accept,
}

/// Least independence of a term for its cost to mean something: below, noise of 1 % moves it by half.
const LEAST_INDEPENDENCE: f64 = 1e-4;

/// Finds the non-negative costs with the least squared error. `constant` asks for a time per sample as well.
///
/// # Cost
/// Linear in the samples; for H3 a few hundred passes, as its error has several minima.
///
/// # Errors
/// [`TimingError::Samples`] for fewer samples than unknowns, [`TimingError::Feature`] and [`TimingError::Time`] for impossible values,
/// [`TimingError::Collinear`] when terms cannot be told apart and `collinear` refuses that.
pub fn calibrate(
    heuristic: Heuristic,
    samples: &[Sample],
    constant: bool,
    collinear: Collinear,
) -> Result<Calibration, TimingError> {
    let unknowns = heuristic.term_names().len() + usize::from(constant);
    if samples.len() < unknowns {
        return Err(TimingError::Samples { count: samples.len(), needed: unknowns });
    }
    for s in samples {
        s.features.checked()?;
        check_time(s.time)?;
    }
    let mut normal = Normal::<{ TERMS + 1 }>::ZERO;
    for s in samples {
        normal.add(&row(heuristic, &s.features, constant), s.time.0, 1.0);
    }
    let independence = std::array::from_fn(|i| normal.independence(i));
    refuse_collinear(heuristic, &normal, &independence, collinear)?;
    let (costs, constant) = match heuristic {
        Heuristic::Max => (fit_max(samples), Millis::ZERO),
        _ => {
            let x = normal.solve();
            (std::array::from_fn(|i| x[i]), Millis(x[TERMS]))
        }
    };
    let model = Model { heuristic, costs };
    let (r_squared, rms) = quality(&model, constant, samples);
    Ok(Calibration { model, constant, r_squared, rms, independence })
}

/// Calibrates every heuristic on `samples` and returns the one with the least squared error on `unseen`, which must be others.
///
/// # Errors
/// As [`calibrate`], when none can be calibrated.
pub fn best_model(samples: &[Sample], unseen: &[Sample], constant: bool) -> Result<Calibration, TimingError> {
    let mut best: Option<(f64, Calibration)> = None;
    let mut refused = TimingError::Samples { count: samples.len(), needed: 1 };
    for heuristic in Heuristic::ALL {
        match calibrate(heuristic, samples, constant, Collinear::Accept) {
            Ok(c) => {
                let error = quality(&c.model, c.constant, unseen).1.0;
                if best.is_none_or(|b| error < b.0) {
                    best = Some((error, c));
                }
            }
            Err(error) => refused = error,
        }
    }
    best.map(|b| b.1).ok_or(refused)
}

/// Refuses times that no clock gives.
pub(crate) fn check_time(time: Millis) -> Result<(), TimingError> {
    if time.0.is_finite() && time.0 >= 0.0 { Ok(()) } else { Err(TimingError::Time { time: time.0 }) }
}

fn row(heuristic: Heuristic, features: &Features, constant: bool) -> [f64; TERMS + 1] {
    let terms = heuristic.terms(features);
    let mut row = [0.0; TERMS + 1];
    row[..TERMS].copy_from_slice(&terms);
    row[TERMS] = if constant { 1.0 } else { 0.0 };
    row
}

fn refuse_collinear(
    heuristic: Heuristic,
    normal: &Normal<{ TERMS + 1 }>,
    independence: &[f64; TERMS],
    collinear: Collinear,
) -> Result<(), TimingError> {
    if collinear == Collinear::Accept {
        return Ok(());
    }
    let names = heuristic.term_names();
    // A term that never occurs has no cost to find; it is not in conflict with another.
    let occurs = |i: usize| normal.gram[i][i] > 0.0;
    match (0..names.len()).find(|&i| occurs(i) && independence[i] < LEAST_INDEPENDENCE) {
        Some(i) => Err(TimingError::Collinear { term: names[i], independence: independence[i] }),
        None => Ok(()),
    }
}

/// R² and RMS error.
fn quality(model: &Model, constant: Millis, samples: &[Sample]) -> (f64, Millis) {
    let n = samples.len().max(1) as f64;
    let mean = samples.iter().map(|s| s.time.0).sum::<f64>() / n;
    let error_sq = |s: &Sample| (model.predict(&s.features).0 + constant.0 - s.time.0).powi(2);
    let unexplained: f64 = samples.iter().map(error_sq).sum();
    let all: f64 = samples.iter().map(|s| (s.time.0 - mean).powi(2)).sum();
    let r_squared = if all > 0.0 { 1.0 - unexplained / all } else { 0.0 };
    (r_squared, Millis((unexplained / n).sqrt()))
}

/// Costs of the maximum of two terms. The error is not convex: which samples geometry limits, and which pixels, has to be guessed, so
/// alternating fits start from many ratios of the two costs.
fn fit_max(samples: &[Sample]) -> [f64; TERMS] {
    let error = |costs: &[f64; TERMS]| {
        let model = Model { heuristic: Heuristic::Max, costs: *costs };
        samples.iter().map(|s| (model.predict(&s.features).0 - s.time.0).powi(2)).sum::<f64>()
    };
    let mut best = ([0.0; TERMS], error(&[0.0; TERMS]));
    for start in 0..=48 {
        // One vertex is worth between a thousandth of a pixel and ten million.
        let mut ratio = 10f64.powf(-3.0 + f64::from(start) * 10.0 / 48.0);
        for _ in 0..8 {
            let costs = fit_sides(samples, ratio);
            let found = error(&costs);
            if found < best.1 {
                best = (costs, found);
            }
            let next = costs[0] / costs[1];
            if !(next.is_finite() && next > 0.0) || next == ratio {
                break;
            }
            ratio = next;
        }
    }
    best.0
}

/// Each cost alone from the samples that it limits, when a vertex costs `ratio` pixels.
fn fit_sides(samples: &[Sample], ratio: f64) -> [f64; TERMS] {
    let mut sums = [[0.0; 2]; 2];
    for s in samples {
        let [v, p, ..] = Heuristic::Max.terms(&s.features);
        let (side, x) = if v * ratio >= p { (0, v) } else { (1, p) };
        sums[side][0] += x * s.time.0;
        sums[side][1] += x * x;
    }
    let cost = |s: [f64; 2]| if s[1] > 0.0 { (s[0] / s[1]).max(0.0) } else { 0.0 };
    [cost(sums[0]), cost(sums[1]), 0.0, 0.0]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A heuristic, a law that it can follow, and the costs of that law.
    type Law = (Heuristic, fn(&Features) -> f64, [f64; TERMS]);

    fn sample(i: u32, law: impl Fn(&Features) -> f64) -> Sample {
        let t = f64::from(i);
        let features = Features {
            triangles: 1000.0 + 900.0 * (t * 1.3).sin(),
            vertices: 700.0 + 500.0 * (t * 0.7).cos(),
            pixels: 20_000.0 + 19_000.0 * (t * 2.1).sin(),
            draws: 1.0 + (i % 3) as f64,
            ..Features::default()
        };
        Sample { features, time: Millis(law(&features)) }
    }

    #[test]
    fn each_heuristic_recovers_its_own_law() {
        let laws: [Law; 4] = [
            (Heuristic::Triangles, |f| 2e-3 * f.triangles, [2e-3, 0.0, 0.0, 0.0]),
            (Heuristic::Sum, |f| 1e-3 * f.vertices + 5e-5 * f.pixels, [1e-3, 5e-5, 0.0, 0.0]),
            (Heuristic::Max, |f| (1e-3 * f.vertices).max(4e-5 * f.pixels), [1e-3, 4e-5, 0.0, 0.0]),
            (
                Heuristic::Extended,
                |f| 1e-3 * f.vertices + 5e-5 * f.pixels + 0.1 * f.draws,
                [1e-3, 5e-5, 0.1, 0.0],
            ),
        ];
        for (heuristic, law, expected) in laws {
            let samples: Vec<Sample> = (0..200).map(|i| sample(i, law)).collect();
            let c = calibrate(heuristic, &samples, false, Collinear::Refuse).unwrap();
            for (got, want) in c.model.costs.iter().zip(expected) {
                assert!((got - want).abs() <= 2e-3 * want + 1e-9, "{heuristic}: {:?}", c.model.costs);
            }
            assert!(c.r_squared > 0.999, "{heuristic} {}", c.r_squared);
            let unseen: Vec<Sample> = (500..600).map(|i| sample(i, law)).collect();
            let best = best_model(&samples, &unseen, false).unwrap();
            assert!(best.rms.0 < 0.02, "{heuristic}: {best:?}");
        }
    }

    #[test]
    fn a_constant_is_found_beside_the_costs() {
        let samples: Vec<Sample> = (0..100).map(|i| sample(i, |f| 1.5 + 2e-3 * f.triangles)).collect();
        let c = calibrate(Heuristic::Triangles, &samples, true, Collinear::Refuse).unwrap();
        assert!((c.constant.0 - 1.5).abs() < 1e-9 && (c.model.costs[0] - 2e-3).abs() < 1e-12);
    }

    #[test]
    fn what_cannot_be_told_apart_is_refused_by_name() {
        let same = |i: u32| {
            let s = sample(i, |f| f.triangles);
            let features = Features { vertices: s.features.triangles * 0.5, ..s.features };
            Sample { features, ..s }
        };
        let samples: Vec<Sample> = (0..50).map(same).collect();
        let error = calibrate(Heuristic::Extended, &samples, false, Collinear::Refuse).unwrap_err();
        assert!(error.to_string().starts_with("vertices cannot be told apart"), "{error}");
        let accepted = calibrate(Heuristic::Extended, &samples, false, Collinear::Accept).unwrap();
        assert!(accepted.r_squared > 0.999);
    }

    #[test]
    fn impossible_samples_are_refused() {
        let one = [sample(1, |_| 1.0)];
        assert!(matches!(
            calibrate(Heuristic::Sum, &one, false, Collinear::Refuse),
            Err(TimingError::Samples { count: 1, needed: 2 })
        ));
        for bad in [-1.0, f64::NAN, f64::INFINITY] {
            let samples = vec![Sample { time: Millis(bad), ..one[0] }; 5];
            assert!(matches!(
                calibrate(Heuristic::Triangles, &samples, false, Collinear::Refuse),
                Err(TimingError::Time { .. })
            ));
        }
        let nothing = vec![Sample { features: Features::default(), time: Millis(1.0) }; 5];
        let c = calibrate(Heuristic::Sum, &nothing, true, Collinear::Refuse).unwrap();
        assert!(c.model.costs == [0.0; TERMS] && (c.constant.0 - 1.0).abs() < 1e-12);
    }
}
