//! Speed of the reference renderer, one thread, thread CPU time, best of several runs.
//!
//! `cargo bench --bench raster` prints triangles and pixels per second beside the wanted floors.

use farsight_geometry::glam::{DMat4, DVec3, DVec4, Vec3};
use farsight_raster::scenes::{City, Path};
use farsight_raster::{Draw, Outputs, Random, Rasteriser, RenderOptions, State, Target};
use farsight_raster::{render_scene, thread_cpu_time};
use std::time::Duration;

const SIDE: u32 = 1024;

fn main() {
    println!("one thread, thread CPU time, best of 9; target {SIDE} x {SIDE}");
    println!("{:<44} {:>9} {:>9} {:>8}", "", "Mtri/s", "Mpix/s", "px/tri");
    for (size, floor) in [(5.0, "floor 7 Mtri/s"), (50.0, ""), (900.0, "floor 280 Mpix/s")] {
        for (name, outputs) in [("depth", Outputs::DEPTH), ("depth + id", Outputs::DEPTH_ID)] {
            soup(&format!("separate triangles, {name} {floor}"), size, outputs);
        }
    }
    grid("grid mesh, shared vertices, depth + id", 5.0);
    city();
}

fn best(mut run: impl FnMut()) -> Duration {
    let time = |_| {
        let start = thread_cpu_time();
        run();
        thread_cpu_time() - start
    };
    (0..9).map(time).min().unwrap_or_default()
}

/// Clip space from pixels (x right, y down) and depth.
fn from_px() -> DMat4 {
    let s = 2.0 / f64::from(SIDE);
    DMat4::from_cols(
        DVec4::new(s, 0.0, 0.0, 0.0),
        DVec4::new(0.0, -s, 0.0, 0.0),
        DVec4::new(0.0, 0.0, 1.0, 0.0),
        DVec4::new(-1.0, 1.0, 0.0, 1.0),
    )
}

/// Random equilateral triangles of a given area: every vertex its own. Each is nearer than the last one, so every pixel is written.
fn soup(name: &str, area: f32, outputs: Outputs) {
    let count = ((4e7 / area) as usize).min(1_000_000);
    let radius = (area / 1.299).sqrt();
    let mut random = Random::new(7);
    let mut positions = Vec::with_capacity(3 * count);
    for i in 0..count {
        let mut inside = || random.range_f32(radius, SIDE as f32 - radius);
        let center = Vec3::new(inside(), inside(), (i + 1) as f32 / (count + 1) as f32);
        let turn = random.range_f32(0.0, 6.3);
        for k in 0..3 {
            let (sin, cos) = (turn + k as f32 * std::f32::consts::TAU / 3.0).sin_cos();
            positions.push(center + Vec3::new(cos, sin, 0.0) * radius);
        }
    }
    let triangles: Vec<[u32; 3]> = (0..count as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    report(name, &positions, &triangles, outputs);
}

fn grid(name: &str, area: f32) {
    let cell = (2.0 * area).sqrt();
    let n = (SIDE as f32 / cell) as u32;
    let vertex = |i: u32| Vec3::new((i % (n + 1)) as f32 * cell, (i / (n + 1)) as f32 * cell, 0.5);
    let positions: Vec<Vec3> = (0..(n + 1) * (n + 1)).map(vertex).collect();
    let mut triangles = Vec::new();
    for _ in 0..8 {
        for i in (0..n * (n + 1)).filter(|i| i % (n + 1) < n) {
            triangles.push([i, i + 1, i + n + 2]);
            triangles.push([i, i + n + 2, i + n + 1]);
        }
    }
    report(name, &positions, &triangles, Outputs::DEPTH_ID);
}

fn report(name: &str, positions: &[Vec3], triangles: &[[u32; 3]], outputs: Outputs) {
    let mut rasteriser = Rasteriser::new();
    let mut target = Target::new(SIDE, SIDE, outputs).expect("a valid size");
    let draw = Draw { positions, triangles, clip_from_local: from_px(), state: State::default() };
    let time = best(|| {
        target.clear();
        rasteriser.draw(&mut target, &draw);
    });
    let pixels = rasteriser.counters.pixels_tested as f64 / 9.0;
    let (count, seconds) = (triangles.len() as f64, time.as_secs_f64());
    let rates = [1e-6 * count / seconds, 1e-6 * pixels / seconds];
    println!("{name:<44} {:>9.1} {:>9.0} {:>8.1}", rates[0], rates[1], pixels / count);
}

fn city() {
    let city = City::default();
    let scene = city.build().expect("default options");
    let camera = Path::street_walk(&city).camera(3, 12).expect("a path with a direction");
    let mut rasteriser = Rasteriser::new();
    for (name, outputs) in [("depth + id", Outputs::DEPTH_ID), ("shaded", Outputs::ALL)] {
        let mut options = RenderOptions::default();
        options.outputs = outputs;
        let mut triangles = 0;
        let time = best(|| {
            let (_, counters) =
                render_scene(&mut rasteriser, &scene, &camera, &options).expect("a valid camera");
            triangles = counters.triangles;
        });
        let rate = 1e-6 * triangles as f64 / time.as_secs_f64();
        println!("city street 1280 x 720, {name}: {time:.1?} for {triangles} triangles, {rate:.1} Mtri/s");
    }
    let start = thread_cpu_time();
    let built = city.build().expect("default options");
    let eye = built.bounds().center() - DVec3::Z;
    println!("city built in {:.0?} around {eye:.0}", thread_cpu_time() - start);
}
