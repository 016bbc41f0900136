//! What planning costs, and how well planned frames take what was predicted. Every figure is printed beside the floor it is held to.
//!
//! `cargo bench --all-features --bench plan`; `-- --speed` only what planning costs.

mod predict;

use farsight_plan::*;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use std::alloc::System;
use std::hint::black_box;
use std::time::Instant;

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Coarser forms that an object has.
const DETAILS: i32 = 6;

fn main() {
    speed();
    if !std::env::args().any(|a| a == "--speed") {
        predict::report();
    }
}

/// Time and allocations of a plan.
fn speed() {
    let details = details();
    println!("{:>8} {:>34} {:>11} {:>9} {:>12}", "objects", "case", "us a plan", "floor", "allocations");
    for count in [100, 1000, 10_000] {
        let mut world = World::new(count, &details);
        let floor = if count == 1000 { "50" } else { "" };
        let unlimited = Budget::default();
        let full = world.plan(&mut Planner::new(), &unlimited, 1.0).cost;
        let tight = Budget::within(full * 0.5, Tolerances::default());
        for (case, budget) in [("no limit", unlimited), ("half of the time, known scene", tight)] {
            let mut planner = Planner::new();
            let mut shift = 0;
            let frames = 200_000 / count + 20;
            let mut frame = |planner: &mut Planner| {
                shift += 1;
                // The view moves: sizes change by a thousandth a frame.
                black_box(world.plan(planner, &budget, 1.0 + 1e-3 * f64::from(shift % 20)));
            };
            (0..20).for_each(|_| frame(&mut planner));
            let region = Region::new(ALLOCATOR);
            let start = Instant::now();
            (0..frames).for_each(|_| frame(&mut planner));
            let time = start.elapsed().as_secs_f64() * 1e6 / frames as f64;
            let allocations = region.change().allocations;
            println!("{count:>8} {case:>34} {time:>11.1} {floor:>9} {allocations:>12}");
        }
        let rounds = 20_000 / count + 5;
        let start = Instant::now();
        for _ in 0..rounds {
            black_box(world.plan(&mut Planner::new(), &tight, 1.0));
        }
        let time = start.elapsed().as_secs_f64() * 1e6 / rounds as f64;
        println!("{count:>8} {:>34} {time:>11.1} {:>9} {:>12}", "half of the time, first frame", "", "");
    }
}

/// Objects at all distances, three lights, a cloud.
struct World<'a> {
    objects: Vec<ObjectSummary<'a>>,
    seen: Vec<ObjectView>,
    now: Vec<ObjectView>,
    lights: Vec<LightView>,
}

impl<'a> World<'a> {
    fn new(count: usize, details: &'a [Detail]) -> Self {
        let object = ObjectSummary { draws: 1.0, vertices: 1.2e4, triangles: 2e4, details, impostor: true };
        let seen = (0..count).map(|i| {
            let distance = 2.0 * 500f64.powf((i as f64 + 0.5) / count as f64);
            let px = 1000.0 / distance;
            ObjectView {
                in_view: true,
                size_px: 2.0 * px,
                pixels: 2.0 * px * px,
                px_per_unit: px,
                impostor_frames: distance,
            }
        });
        let light = LightView {
            receiver_pixels: 1e6,
            caster_triangles: 1e5,
            caster_draws: 100.0,
            contribution: 0.8,
            texels: TexelSpread { uniform: 40_000.0, warped: 3000.0, cascades: [2000.0, 1500.0, 1200.0] },
            penumbra_px: 3.0,
            unchanged: false,
        };
        let seen: Vec<_> = seen.collect();
        Self { objects: vec![object; count], now: seen.clone(), seen, lights: vec![light; 3] }
    }

    /// Plans a frame of a view that is `zoom` times closer.
    fn plan<'p>(&mut self, planner: &'p mut Planner, budget: &Budget, zoom: f64) -> &'p Plan {
        for (now, seen) in self.now.iter_mut().zip(&self.seen) {
            now.px_per_unit = seen.px_per_unit * zoom;
        }
        let scene = SceneSummary {
            objects: &self.objects,
            lights: &[LightSummary { most_side: 4096, most_cascades: 4, most_taps: 16 }; 3],
            clouds: &[CloudSummary { points: 1e7 }],
        };
        let view = ViewSummary {
            pixels: 2e6,
            outputs: Outputs::PICTURE,
            objects: &self.now,
            lights: &self.lights,
            clouds: &[CloudView { points_at_one_px: 1e6 }],
            cell: None,
            jumped: false,
        };
        planner.plan(&scene, &view, budget, &Costs::default()).expect("valid numbers")
    }
}

/// Coarser forms that all objects share.
fn details() -> Vec<Detail> {
    let detail = |i| {
        let scale = 4f64.powi(i);
        Detail { form: Form::Mesh, error: 1e-3 * scale, kind: Kind::Proven, elements: 2e4 / scale }
    };
    (0..DETAILS).map(detail).collect()
}
