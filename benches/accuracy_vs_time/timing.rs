//! Rendering-time estimation: estimator and number of samples against the true frame times of the simulated card.

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

/// A frame: what each object asks, and what it took.
type Seen = (Vec<Features>, Millis);

fn of_scene(scene: &SimScene, frames: usize) -> Vec<Row> {
    let mut card = Simulator::new(Law::default(), 3);
    let seen: Vec<Seen> = (0..frames).map(|i| see(scene, &mut card, i as f64 / frames as f64)).collect();
    let samples = samples(scene, &mut card, 2000);
    let mut rows = Vec::new();
    for heuristic in [Heuristic::Triangles, Heuristic::Vertices, Heuristic::Max, Heuristic::Sum] {
        let times = times_of(heuristic, &seen);
        for count in [50, 200, 2000] {
            rows.push(calibrated(scene, &seen, heuristic, &samples[..count], &times));
        }
    }
    for heuristic in [Heuristic::Triangles, Heuristic::Sum] {
        let times = times_of(heuristic, &seen);
        for count in [0.25, 0.5, 1.0] {
            let known = (frames as f64 * 0.8 * count) as usize;
            rows.push(refitted(scene, &seen, heuristic, &samples, known, &times));
        }
    }
    rows
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

/// RMS of the misses over the last fifth of the path, which no estimator has seen before it predicts it.
fn rms(seen: &[Seen], mut predict: impl FnMut(&Seen) -> Millis) -> f64 {
    let last = &seen[seen.len() * 4 / 5..];
    (last.iter().map(|s| (predict(s).0 - s.1.0).powi(2)).sum::<f64>() / last.len() as f64).sqrt()
}

fn calibrated(
    scene: &SimScene,
    seen: &[Seen],
    heuristic: Heuristic,
    samples: &[Sample],
    times: &[Duration],
) -> Row {
    let c = calibrate(heuristic, samples, false, Collinear::Accept).expect("enough samples");
    let predict = |s: &Seen| c.model.predict_frame(&s.0) + Millis(0.6);
    // The calibration knows its misses on objects; a frame of n independent ones misses by √n times as much.
    let objects = seen.iter().map(|s| s.0.len()).sum::<usize>() as f64 / seen.len() as f64;
    row(
        scene,
        format!("{heuristic} samples"),
        samples.len(),
        c.rms.0 * objects.sqrt(),
        rms(seen, predict),
        times,
        seen,
    )
}

fn refitted(
    scene: &SimScene,
    seen: &[Seen],
    heuristic: Heuristic,
    samples: &[Sample],
    frames: usize,
    times: &[Duration],
) -> Row {
    let start = calibrate(heuristic, samples, false, Collinear::Accept).expect("enough samples").model;
    let mut refit = Refit::new(start, Millis(0.6), RefitOptions::default()).expect("a sum");
    let mut own = Vec::new();
    let mut follow = |refit: &mut Refit, s: &Seen| {
        let sum = s.0.iter().fold(Features::default(), |a, &b| a + b);
        let predicted = refit.predict(&sum);
        refit.observe(&sum, s.1).expect("possible");
        own.push((predicted.0 - s.1.0).powi(2));
        predicted
    };
    let before = seen.len() * 4 / 5;
    seen[before - frames..before].iter().for_each(|s| {
        follow(&mut refit, s);
    });
    let measured = rms(seen, |s| follow(&mut refit, s));
    let learnt = &own[frames / 4..frames];
    let claimed = (learnt.iter().sum::<f64>() / learnt.len() as f64).sqrt();
    row(scene, format!("{heuristic} refit frames"), frames, claimed, measured, times, seen)
}

fn row(
    scene: &SimScene,
    knob: String,
    value: usize,
    claimed: f64,
    measured: f64,
    times: &[Duration],
    seen: &[Seen],
) -> Row {
    let frame = &seen[0].0;
    let mut counters = Counters::default();
    counters.add("samples", value as u64);
    counters.add("objects", frame.len() as u64);
    Row {
        krate: "timing",
        scene: scene.name.into(),
        knob,
        value: value as f64,
        claimed: ErrorBound::estimated(claimed, Unit::Milliseconds).with_norm(Norm::Rms),
        measured,
        times: times.to_vec(),
        bytes: size_of::<Model>() as u64,
        counters,
    }
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
