//! What predicting, refitting and choosing cost, in thread CPU time, best of several runs.

use farsight_geometry::sampling::Random;
use farsight_raster::thread_cpu_time;
use farsight_timing::{Budget, Features, Heuristic, Level, Millis, Model, Refit, RefitOptions, exact};
use std::hint::black_box;
use std::time::Duration;

fn best(runs: usize, mut work: impl FnMut()) -> Duration {
    let time = |_| {
        let start = thread_cpu_time();
        work();
        thread_cpu_time() - start
    };
    (0..runs).map(time).min().unwrap_or_default()
}

pub fn report() {
    println!("\ncost, one thread, thread CPU time, best of 15");
    let mut random = Random::new(2);
    let objects: Vec<Features> = (0..1_000_000)
        .map(|_| Features {
            vertices: 1e4 * random.unit(),
            pixels: 1e5 * random.unit(),
            ..Features::default()
        })
        .collect();
    let model = Model { heuristic: Heuristic::Sum, costs: [1e-5, 1e-6, 0.0, 0.0] };
    let time = best(15, || {
        black_box(model.predict_frame(black_box(&objects)));
    });
    println!(
        "  predict                    {:>8.2} ns per object (floor 20), 1e6 objects",
        per(time, objects.len())
    );
    let start = Model { heuristic: Heuristic::Extended, costs: [1e-5, 1e-6, 1e-3, 1e-6] };
    let mut refit = Refit::new(start, Millis(1.0), RefitOptions::default()).expect("a sum");
    let frames = &objects[..10_000];
    let time = best(15, || {
        for f in frames {
            let t = start.predict(f) + Millis(1.0);
            black_box(refit.observe(f, t).expect("possible"));
        }
    });
    println!("  refit                      {:>8.2} ns per frame (floor 1000)", per(time, frames.len()));
    solver(&mut random);
}

fn per(time: Duration, count: usize) -> f64 {
    time.as_secs_f64() * 1e9 / count as f64
}

fn solver(random: &mut Random) {
    let (levels, first) = problem(random, 10_000, 5);
    let all: f64 = levels.chunks(5).map(|l| l[4].cost.0).sum();
    let mut budget = Budget::new();
    let mut cold = Duration::MAX;
    for _ in 0..15 {
        let mut fresh = budget.clone();
        fresh.choose(&levels, &first, Millis(0.1 * all)).expect("valid");
        cold = cold.min(best(1, || {
            black_box(fresh.choose(&levels, &first, Millis(0.5 * all)).expect("valid"));
        }));
    }
    let warm = best(15, || {
        black_box(budget.choose(&levels, &first, Millis(0.5 * all)).expect("valid"));
    });
    println!(
        "  solver, 10,000 x 5         {:>8.3} ms after another frame, {:.3} ms after one like it (floor 1)",
        ms(cold),
        ms(warm)
    );
    let (mut least, mut sum) = (f64::INFINITY, 0.0);
    let rounds = 200;
    for _ in 0..rounds {
        let (whole, first) = problem(random, 60, 5);
        let limit = 60 * (10 + random.below(60) as u32);
        let units: Vec<(u32, f64)> = whole.iter().map(|l| (l.cost.0 as u32, l.benefit)).collect();
        let choice = budget.choose(&whole, &first, Millis(f64::from(limit))).expect("valid");
        let optimum = exact(&units, &first, limit).expect("the cheapest fit");
        least = least.min(choice.benefit / optimum);
        sum += choice.benefit / optimum / f64::from(rounds);
    }
    println!(
        "  solver against exact       {sum:>8.4} on average (floor 0.98), {least:.4} at least (floor 0.5), {rounds} problems of 60 x 5"
    );
}

fn ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

/// Objects whose levels cost whole units, roughly doubling.
fn problem(random: &mut Random, objects: usize, levels: usize) -> (Vec<Level>, Vec<u32>) {
    let mut all = Vec::new();
    for _ in 0..objects {
        let (mut cost, mut benefit, size) = (1.0 + random.below(8) as f64, 0.0, 1.0 + 99.0 * random.unit());
        for _ in 0..levels {
            benefit += size * random.unit();
            all.push(Level { cost: Millis(cost), benefit });
            cost += 1.0 + (cost * (0.5 + random.unit())).floor();
        }
    }
    let first = (0..=objects as u32).map(|i| i * levels as u32).collect();
    (all, first)
}
