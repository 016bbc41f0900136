//! How well rendering times are estimated, and what that costs. Every figure is printed beside the floor it is held to.
//!
//! `cargo bench --bench timing` runs everything; `-- --quick` shorter paths; `-- --cost` only what the calls cost.

mod backend;
mod cells;
mod cost;
mod estimate;

use backend::{Backend, Raster, Simulated};
use estimate::{Seen, columns, coverage, errors, model, refitted, samples, see, walk};
use farsight_timing::simulator::{HoldOptions, Law, SimScene, Simulator, hold};
use farsight_timing::{Heuristic, Millis, SampleOptions};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let asked = |flag: &str| std::env::args().any(|a| a == flag);
    if asked("--cost") {
        cost::report();
        return Ok(());
    }
    let quick = asked("--quick");
    let length = if quick { 200 } else { 600 };
    for scene in [SimScene::city(1), SimScene::forest(1)] {
        experiment(Simulated::new(scene, 7), length, 3000, SampleOptions::default());
    }
    let mut sparse = SampleOptions::default();
    (sparse.sizes, sparse.around, sparse.up) = (8, 4, 2);
    experiment(Raster::city()?, length, 3000, sparse);
    experiment(Raster::forest()?, length, 1000, sparse);
    for scene in [SimScene::city(1), SimScene::forest(1)] {
        stationary(Simulated::new(scene, 11), if quick { 2000 } else { 6000 });
    }
    for scene in [SimScene::city(1), SimScene::forest(1)] {
        cells::report(&mut Simulated::new(scene, 5), if quick { 2 } else { 6 });
    }
    soft_real_time(if quick { 300 } else { 3000 })?;
    cost::report();
    Ok(())
}

/// Coverage of the quantiles over many rounds of the same path at the same speed.
fn stationary(mut backend: Simulated, frames: usize) {
    let samples = samples(&mut backend, 1500);
    let round = 600;
    let mut path = walk(&mut backend, round);
    let mut pairs = Vec::with_capacity(frames);
    while pairs.len() < frames {
        pairs.extend(path.iter().map(|s| (s.sum, s.time)));
        for s in &mut path {
            s.time = backend.time_frame(&s.visible, &s.camera);
        }
    }
    let times: Vec<Millis> = pairs.iter().map(|p| p.1).collect();
    let predicted = refitted(model(Heuristic::Extended, &samples), Millis::ZERO, pairs).0;
    let [above95, above999] = coverage(&predicted[60..], &times[60..], 2000);
    println!(
        "\n{}, stationary, {frames} frames: nominal 95 % covers {:.1} % (floor 93 to 97); 99.9 % missed {:.2} per 1000 (floor 2)",
        backend.name(),
        100.0 * (1.0 - above95),
        1000.0 * above999
    );
}

/// Frames over the target, with a tenth of head room.
fn soft_real_time(frames: usize) -> Result<(), Box<dyn std::error::Error>> {
    println!(
        "\nsoft real time, simulator, {frames} frames, 10 % head room: late frames, and the share of full detail drawn"
    );
    for (scene, target) in [(SimScene::city(1), 12.0), (SimScene::forest(1), 10.0)] {
        for slower_from in [None, Some(frames / 2)] {
            let mut line = String::new();
            for (name, solver, branch) in [
                ("all at its finest", false, false),
                ("solver", true, false),
                ("solver and branch", true, true),
            ] {
                let mut options = HoldOptions::default();
                (options.target, options.frames) = (Millis(target), frames);
                (options.solver, options.branch, options.slower_from) = (solver, branch, slower_from);
                let held = hold(&scene, &mut Simulator::new(Law::default(), 4), &options)?;
                line += &format!("  {name}: {} late, {:.3}", held.over, held.benefit);
            }
            let what = if slower_from.is_some() { "1.5x slower from half way" } else { "steady" };
            println!("  {} at {target} ms, {what}:{line}", scene.name);
        }
    }
    println!("  floor: at most {} late, steady, with the branch", frames / 1000);
    Ok(())
}

/// Table 2.6 and what follows from it.
fn experiment(mut backend: impl Backend, frames: usize, calibration: usize, per_object: SampleOptions) {
    let samples = samples(&mut backend, calibration);
    let path = walk(&mut backend, frames);
    let mean = path.iter().map(|s| s.time.0).sum::<f64>() / frames as f64;
    println!(
        "\n{}: {frames} frames of {mean:.2} ms, {} single-object timings",
        backend.name(),
        samples.len()
    );
    // The first second teaches the refits; all estimators are compared on the rest.
    let warm = 60.min(frames / 3);
    println!("  {:<12} {:>10} {:>8} {:>8} {:>12}", "", "ms^2", "p50 %", "p95 %", "within 10 %");
    for column in columns(&mut backend, &path, &samples, per_object) {
        let [squared, p50, p95, within] = errors(&column.predicted[warm..], &path[warm..]);
        let (p50, p95, within) = (100.0 * p50, 100.0 * p95, 100.0 * within);
        let floor = if column.name.contains("refit") { "floor 3, 10, 95" } else { "" };
        println!("  {:<12} {squared:>10.3} {p50:>8.2} {p95:>8.2} {within:>12.1}  {floor}", column.name);
    }
    println!("  noise of the clock: {:.4} ms^2", noise(&mut backend, &path));
    let start = model(Heuristic::Extended, &samples);
    let times: Vec<Millis> = path.iter().map(|s| s.time).collect();
    let predicted = refitted(start, Millis::ZERO, path.iter().map(|s| (s.sum, s.time))).0;
    let [above95, _] = coverage(&predicted[warm..], &times[warm..], 400);
    println!(
        "  nominal 95 % covers {:.1} % of the path (floor 93 to 97 on stationary paths)",
        100.0 * (1.0 - above95)
    );
    recover(&mut backend, &path, &samples);
}

/// Half the mean squared difference of two timings of the same frame.
fn noise(backend: &mut impl Backend, path: &[Seen]) -> f64 {
    let some: Vec<&Seen> = path.iter().step_by(7).collect();
    let again = |s: &&Seen| 0.5 * (backend.time_frame(&s.visible, &s.camera).0 - s.time.0).powi(2);
    let count = some.len() as f64;
    some.iter().map(again).sum::<f64>() / count
}

/// Everything takes twice as long at once: frames until the error stays below 10 %.
fn recover(backend: &mut impl Backend, path: &[Seen], samples: &[farsight_timing::Sample]) {
    let start = model(Heuristic::Extended, samples);
    let (_, mut refit) = refitted(start, Millis::ZERO, path.iter().map(|s| (s.sum, s.time)));
    let before = *refit.model();
    let last = &path[path.len() - 1];
    let hitch = refit.observe(&last.sum, last.time * 4.0).expect("possible");
    let moved = *refit.model() != before;
    backend.double_the_cost();
    let mut late = 0;
    for k in 0..90 {
        let frame = see(backend, 1.0 - (k + 1) as f64 / 600.0);
        if (refit.predict(&frame.sum).0 / frame.time.0 - 1.0).abs() >= 0.1 {
            late = k + 1;
        }
        refit.observe(&frame.sum, frame.time).expect("possible");
    }
    println!(
        "  after a step to 2x: below 10 % from frame {late} on (floor 60); a hitch of 4x: {hitch:?}, model moved: {moved}"
    );
}
