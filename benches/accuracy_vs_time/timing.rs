//! Rendering-time estimation: estimator and number of samples against the true frame times of the simulated card.
//!
//! Two rows a setting: the RMS of the misses against the time per estimate, and the share of frames that overrun their
//! estimate by more than the head room against the time that calibrating or refitting took.

use super::row::{Row, timed};
use farsight_geometry::accuracy::{Counters, ErrorBound, Norm, Unit};
use farsight_timing::simulator::{Law, SimScene, Simulator};
use farsight_timing::{
    Collinear, Features, Heuristic, Millis, Model, Refit, RefitOptions, Sample, calibrate,
};
use std::time::Duration;

pub fn rows(quick: bool) -> Vec<Row> {
    let frames = if quick { 150 } else { 600 };
    [SimScene::city(1), SimScene::forest(1)].iter().flat_map(|scene| of_scene(scene, frames)).collect()
}

/// A frame overruns when it takes longer than its estimate and this share of it.
const HEAD_ROOM: f64 = 0.1;

/// A frame: what each object asks, and what it took.
type Seen = (Vec<Features>, Millis);

fn of_scene(scene: &SimScene, frames: usize) -> Vec<Row> {
    let mut card = Simulator::new(Law::default(), 3);
    let seen: Vec<Seen> = (0..frames).map(|i| see(scene, &mut card, i as f64 / frames as f64)).collect();
    let samples = samples(scene, &mut card, 2000);
    let mut rows = Vec::new();
    for heuristic in [Heuristic::Triangles, Heuristic::Vertices, Heuristic::Max, Heuristic::Sum] {
        let settings: Vec<Setting> =
            [50, 200, 2000].map(|count| calibrated(&seen, heuristic, &samples[..count])).into();
        rows.extend(table(scene, &seen, format!("{heuristic} samples"), heuristic, settings));
    }
    for heuristic in [Heuristic::Triangles, Heuristic::Sum] {
        let known = [0.25, 0.5, 1.0].map(|share| (frames as f64 * 0.8 * share) as usize);
        let settings = known.map(|known| refitted(&seen, heuristic, &samples, known)).into();
        rows.extend(table(scene, &seen, format!("{heuristic} refit frames"), heuristic, settings));
    }
    rows
}

/// What was found at one setting of an estimator.
struct Setting {
    /// Samples or frames that it has learnt from.
    learnt: usize,
    claimed_rms: f64,
    /// Predicted and true times of frames before and in the last fifth of the path, which nothing has learnt from.
    before: Vec<[f64; 2]>,
    last: Vec<[f64; 2]>,
    /// Times that the learning took.
    times: Vec<Duration>,
}

fn see(scene: &SimScene, card: &mut Simulator, t: f64) -> Seen {
    let camera = scene.camera(0, t);
    let visible = scene.visible(&camera);
    let features = visible.iter().map(|&i| scene.objects[i].features(0, &camera)).collect();
    (features, card.time_frame(visible.iter().map(|&i| (&scene.objects[i], 0)), &camera))
}

fn samples(scene: &SimScene, card: &mut Simulator, count: usize) -> Vec<Sample> {
    let mut samples = Vec::with_capacity(count);
    for view in 0u32.. {
        let camera = scene.camera(1 + view % 2, (f64::from(view) * 0.618_034).fract());
        for &i in scene.visible(&camera).iter().step_by(7) {
            let object = &scene.objects[i];
            samples.push(Sample {
                features: object.features(0, &camera),
                time: card.time_alone(object, 0, &camera),
            });
        }
        if samples.len() >= count {
            break;
        }
    }
    samples
}

fn rms(pairs: &[[f64; 2]]) -> f64 {
    (pairs.iter().map(|[p, t]| (p - t).powi(2)).sum::<f64>() / pairs.len() as f64).sqrt()
}

fn overruns(pairs: &[[f64; 2]]) -> f64 {
    pairs.iter().filter(|[p, t]| *t > p * (1.0 + HEAD_ROOM)).count() as f64 / pairs.len() as f64
}

fn calibrated(seen: &[Seen], heuristic: Heuristic, samples: &[Sample]) -> Setting {
    let (c, times) =
        timed(5, || calibrate(heuristic, samples, false, Collinear::Accept).expect("enough samples"));
    let predict = |s: &Seen| [(c.model.predict_frame(&s.0) + Millis(0.6)).0, s.1.0];
    let pairs: Vec<[f64; 2]> = seen.iter().map(predict).collect();
    let (before, last) = pairs.split_at(seen.len() * 4 / 5);
    // The calibration knows its misses on objects; a frame of n independent ones misses by √n times as much.
    let objects = seen.iter().map(|s| s.0.len()).sum::<usize>() as f64 / seen.len() as f64;
    Setting {
        learnt: samples.len(),
        claimed_rms: c.rms.0 * objects.sqrt(),
        before: before.into(),
        last: last.into(),
        times,
    }
}

fn refitted(seen: &[Seen], heuristic: Heuristic, samples: &[Sample], frames: usize) -> Setting {
    let start = calibrate(heuristic, samples, false, Collinear::Accept).expect("enough samples").model;
    let sums: Vec<(Features, Millis)> =
        seen.iter().map(|s| (s.0.iter().fold(Features::default(), |a, &b| a + b), s.1)).collect();
    let fresh = || Refit::new(start, Millis(0.6), RefitOptions::default()).expect("a sum");
    let follow = |refit: &mut Refit, of: &[(Features, Millis)]| -> Vec<[f64; 2]> {
        let one = |(sum, time): &(Features, Millis)| {
            let predicted = refit.predict(sum);
            refit.observe(sum, *time).expect("possible");
            [predicted.0, time.0]
        };
        of.iter().map(one).collect()
    };
    let split = seen.len() * 4 / 5;
    let known = &sums[split - frames..split];
    let (_, times) = timed(5, || follow(&mut fresh(), known));
    let mut refit = fresh();
    let before = follow(&mut refit, known).split_off(frames / 4);
    let last = follow(&mut refit, &sums[split..]);
    Setting { learnt: frames, claimed_rms: rms(&before), before, last, times }
}

/// Both rows of every setting of an estimator.
fn table(
    scene: &SimScene,
    seen: &[Seen],
    knob: String,
    heuristic: Heuristic,
    settings: Vec<Setting>,
) -> Vec<Row> {
    let estimate = times_of(heuristic, seen);
    let row = |knob: &str, s: &Setting, claimed: ErrorBound, measured, times: &[Duration]| {
        let mut counters = Counters::default();
        counters.add("samples", s.learnt as u64);
        counters.add("objects", seen[0].0.len() as u64);
        Row {
            krate: "timing",
            scene: scene.name.into(),
            knob: knob.into(),
            value: s.learnt as f64,
            claimed,
            measured,
            times: times.to_vec(),
            bytes: size_of::<Model>() as u64,
            counters,
        }
    };
    let misses = settings.iter().map(|s| {
        let claimed = ErrorBound::estimated(s.claimed_rms, Unit::Milliseconds).with_norm(Norm::Rms);
        row(&knob, s, claimed, rms(&s.last), &estimate)
    });
    // Each stands for itself: what single drawings do not show, more of them do not teach, so none is the finer setting.
    let overruns = settings.iter().map(|s| {
        let late = format!("overruns; {} {knob}", s.learnt);
        let claimed = ErrorBound::estimated(overruns(&s.before), Unit::Fraction).with_norm(Norm::Mean);
        row(&late, s, claimed, overruns(&s.last), &s.times)
    });
    misses.chain(overruns).collect()
}

/// Times of one frame's estimate. What the samples were changes the costs, not the work.
fn times_of(heuristic: Heuristic, seen: &[Seen]) -> Vec<Duration> {
    let (model, frame) = (Model { heuristic, costs: [1e-5; 4] }, &seen[0].0);
    // A thousand at once, so that the clock's resolution does not matter.
    let (_, times) = timed(7, || {
        for _ in 0..1000 {
            std::hint::black_box(model.predict_frame(std::hint::black_box(frame)));
        }
    });
    times.into_iter().map(|t| t / 1000).collect()
}
