//! The comparison of estimators: calibrated on single objects, looked up, refitted on frames.

use crate::backend::Backend;
use farsight_geometry::Camera;
use farsight_timing::{
    Collinear, Features, Heuristic, Millis, Model, ObjectSamples, Refit, RefitOptions, Residuals, Sample,
    SampleOptions, calibrate,
};

/// A frame of the path: what was drawn and what it took.
pub struct Seen {
    pub camera: Camera,
    pub visible: Vec<usize>,
    pub objects: Vec<Features>,
    pub sum: Features,
    pub time: Millis,
}

pub fn walk(backend: &mut impl Backend, frames: usize) -> Vec<Seen> {
    (0..frames).map(|i| see(backend, i as f64 / frames as f64)).collect()
}

pub fn see(backend: &mut impl Backend, t: f64) -> Seen {
    let camera = backend.camera(0, t);
    let visible = backend.visible(&camera);
    let objects: Vec<Features> = visible.iter().map(|&i| backend.features(i, &camera)).collect();
    let sum = total(&objects);
    let time = backend.time_frame(&visible, &camera);
    Seen { camera, visible, objects, sum, time }
}

fn total(objects: &[Features]) -> Features {
    objects.iter().fold(Features::default(), |a, &b| a + b)
}

/// Single objects timed from cameras of the training paths.
pub fn samples(backend: &mut impl Backend, count: usize) -> Vec<Sample> {
    let mut samples = Vec::with_capacity(count);
    let mut view = 0u32;
    while samples.len() < count && view < 100_000 {
        // A low-discrepancy walk over both training paths.
        let camera = backend.camera(1 + view % 2, (f64::from(view) * 0.618_033_988_749_894_9).fract());
        let visible = backend.visible(&camera);
        for &object in visible.iter().skip(view as usize % 3).step_by(3 + visible.len() / 8) {
            let features = backend.features(object, &camera);
            samples.push(Sample { features, time: backend.time_alone(object, &camera) });
        }
        view += 1;
    }
    samples
}

/// Time of a frame without objects.
pub fn empty_frame(backend: &mut impl Backend) -> Millis {
    let camera = backend.camera(1, 0.5);
    let mut times: Vec<Millis> = (0..31).map(|_| backend.time_frame(&[], &camera)).collect();
    times.sort_by(|a, b| a.0.total_cmp(&b.0));
    times[times.len() / 2]
}

pub fn model(heuristic: Heuristic, samples: &[Sample]) -> Model {
    calibrate(heuristic, samples, false, Collinear::Accept).expect("enough samples").model
}

pub struct Column {
    pub name: &'static str,
    pub predicted: Vec<Millis>,
}

/// Predictions of every estimator for every frame.
pub fn columns(
    backend: &mut impl Backend,
    path: &[Seen],
    samples: &[Sample],
    per_object: SampleOptions,
) -> Vec<Column> {
    let constant = empty_frame(backend);
    let mut columns = Vec::new();
    let names = [
        (Heuristic::Triangles, "H1"),
        (Heuristic::Vertices, "H2"),
        (Heuristic::Max, "H3"),
        (Heuristic::Sum, "H4"),
    ];
    for (heuristic, name) in names {
        let model = model(heuristic, samples);
        let predicted = path.iter().map(|s| model.predict_frame(&s.objects) + constant).collect();
        columns.push(Column { name, predicted });
    }
    columns.push(Column { name: "pos", predicted: by_look_up(backend, path, per_object, constant) });
    let refits = [
        (Heuristic::Triangles, "H1 refit"),
        (Heuristic::Sum, "H4 refit"),
        (Heuristic::Extended, "H4+ refit"),
    ];
    for (heuristic, name) in refits {
        let start = model(heuristic, samples);
        let frames = path.iter().map(|s| (s.sum, s.time));
        columns.push(Column { name, predicted: refitted(start, constant, frames).0 });
    }
    let round = path.iter().map(|s| {
        let objects: Vec<Features> =
            s.visible.iter().map(|&i| backend.round_features(i, &s.camera)).collect();
        (total(&objects), s.time)
    });
    let start = model(Heuristic::Extended, samples);
    columns.push(Column { name: "H4+ sphere", predicted: refitted(start, constant, round).0 });
    columns
}

/// Every object's times by apparent size and direction.
pub fn object_samples(backend: &mut impl Backend, options: SampleOptions) -> Vec<ObjectSamples> {
    let (lens, objects) = (backend.camera(0, 0.0), backend.objects());
    let measure = |i| {
        let sphere = backend.sphere(i);
        let s = ObjectSamples::measure(sphere, &lens, options, |camera| backend.time_alone(i, camera));
        s.expect("clocks do not run backwards")
    };
    (0..objects).map(measure).collect()
}

fn by_look_up(
    backend: &mut impl Backend,
    path: &[Seen],
    options: SampleOptions,
    constant: Millis,
) -> Vec<Millis> {
    let samples = object_samples(backend, options);
    let pruned: usize = samples.iter().map(ObjectSamples::pruned).sum();
    let measured: usize = samples.iter().map(ObjectSamples::measured).sum();
    println!("  pos: {measured} measurements, {pruned} pruned");
    path.iter()
        .map(|s| s.visible.iter().map(|&i| samples[i].look_up(&s.camera)).sum::<Millis>() + constant)
        .collect()
}

/// Predictions made before each frame was seen.
pub fn refitted(
    start: Model,
    constant: Millis,
    frames: impl IntoIterator<Item = (Features, Millis)>,
) -> (Vec<Millis>, Refit) {
    let mut refit = Refit::new(start, constant, RefitOptions::default()).expect("a sum");
    let predicted = frames.into_iter().map(|(sum, time)| {
        let predicted = refit.predict(&sum);
        refit.observe(&sum, time).expect("measured times are possible");
        predicted
    });
    (predicted.collect(), refit)
}

/// Mean squared error in ms², and the median, 95th percentile and share within 10 % of the relative errors.
pub fn errors(predicted: &[Millis], path: &[Seen]) -> [f64; 4] {
    let pairs = || predicted.iter().zip(path).map(|(p, s)| (p.0, s.time.0));
    let n = path.len().max(1) as f64;
    let squared = pairs().map(|(p, t)| (p - t).powi(2)).sum::<f64>() / n;
    let mut relative: Vec<f64> = pairs().map(|(p, t)| (p / t - 1.0).abs()).collect();
    relative.sort_by(f64::total_cmp);
    let at = |q: f64| relative[((relative.len() as f64 * q) as usize).min(relative.len() - 1)];
    let within = relative.iter().filter(|&&e| e <= 0.1).count() as f64 / n;
    [squared, at(0.5), at(0.95), within]
}

/// Shares of frames above their predicted 95 % and 99.9 % quantiles.
pub fn coverage(predicted: &[Millis], times: &[Millis], memory: usize) -> [f64; 2] {
    let mut residuals = Residuals::new(memory);
    let (mut over, mut asked) = ([0.0; 2], [0.0f64; 2]);
    for (&p, &t) in predicted.iter().zip(times) {
        for (k, q) in [0.95, 0.999].into_iter().enumerate() {
            if let Some(limit) = residuals.quantile(p, q).filter(|_| residuals.len() >= 200) {
                asked[k] += 1.0;
                over[k] += f64::from(u8::from(t > limit));
            }
        }
        residuals.record(p, t);
    }
    std::array::from_fn(|k| over[k] / asked[k].max(1.0))
}
