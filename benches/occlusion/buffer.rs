//! Speed of the depth buffer: random right triangles and boxes, one thread.

use crate::Table;
use farsight_geometry::glam::{DMat4, DVec3, DVec4, Vec3};
use farsight_occlusion::{Coverage, DepthBuffer, Faces, ScreenBox, SimdLevel};
use farsight_raster::{Random, thread_cpu_time};

const WIDTH: u32 = 1920;
const HEIGHT: u32 = 1080;

/// Pixels and depth to clip space.
fn clip_from_px() -> DMat4 {
    DMat4::from_cols(
        DVec4::new(2.0 / f64::from(WIDTH), 0.0, 0.0, 0.0),
        DVec4::new(0.0, -2.0 / f64::from(HEIGHT), 0.0, 0.0),
        DVec4::new(0.0, 0.0, 1.0, 0.0),
        DVec4::new(-1.0, 1.0, 0.0, 1.0),
    )
}

/// Right triangles with legs of `edge` pixels anywhere in the image, each at one depth, later ones nearer.
fn triangles(edge: f32, count: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut random = Random::new(3);
    let mut positions = Vec::new();
    for i in 0..count {
        let x = random.range_f32(0.0, WIDTH as f32 - edge);
        let y = random.range_f32(0.0, HEIGHT as f32 - edge);
        let z = 0.1 + 0.8 * i as f32 / count as f32;
        let mut corners = [[0.0, 0.0], [edge, 0.0], [0.0, edge]].map(|[a, b]| Vec3::new(x + a, y + b, z));
        if random.chance(0.5) {
            corners = [[edge, edge], [0.0, edge], [edge, 0.0]].map(|[a, b]| Vec3::new(x + a, y + b, z));
        }
        positions.extend(corners);
    }
    (positions, (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect())
}

fn best(runs: usize, mut work: impl FnMut()) -> f64 {
    let time = |_| {
        let start = thread_cpu_time();
        work();
        (thread_cpu_time() - start).as_secs_f64()
    };
    (0..runs).map(time).fold(f64::INFINITY, f64::min)
}

/// Share by which the first buffer takes longer than the second, drawn in turns.
fn price_of_exactness(
    buffers: [&mut DepthBuffer; 2],
    runs: usize,
    positions: &[Vec3],
    triangles: &[[u32; 3]],
) -> f64 {
    let m = clip_from_px();
    let mut times = [f64::INFINITY; 2];
    for _ in 0..3 {
        for i in 0..2 {
            let seconds = best(runs, || {
                buffers[i].clear();
                buffers[i].draw(&m, positions, triangles, Faces::Both);
            });
            times[i] = times[i].min(seconds);
        }
    }
    times[0] / times[1] - 1.0
}

pub fn speeds(table: &mut Table, quick: bool) {
    let m = clip_from_px();
    let runs = if quick { 5 } else { 15 };
    let mut avx = DepthBuffer::new(WIDTH, HEIGHT).expect("a usual size");
    let mut base = avx.clone().with_simd(SimdLevel::Baseline);
    for (edge, floor, floor_base) in [
        (5.0, f64::NAN, f64::NAN),
        (10.0, 20.0, 9.0),
        (25.0, f64::NAN, f64::NAN),
        (50.0, 4.5, f64::NAN),
        (100.0, f64::NAN, f64::NAN),
    ] {
        let count = if edge > 30.0 { 20_000 } else { 60_000 };
        let (positions, triangles) = triangles(edge, count);
        for (name, buffer, floor) in [("detected", &mut avx, floor), ("baseline", &mut base, floor_base)] {
            let seconds = best(runs, || {
                buffer.clear();
                buffer.draw(&m, &positions, &triangles, Faces::Both);
            });
            let name = format!("depth buffer, {name}, {edge} px triangles, Mtri/s");
            let speed = f64::from(count) / seconds * 1e-6;
            if floor.is_finite() { table.least(&name, speed, floor) } else { table.info(&name, speed) }
        }
        let mut rounded = avx.clone().with_coverage(Coverage::Rounded);
        let price = price_of_exactness([&mut avx, &mut rounded], runs, &positions, &triangles);
        table.most(&format!("depth buffer, price of exact coverage, {edge} px triangles"), price, 0.3);
    }
    let (positions, _) = triangles(10.0, 60_000);
    let seconds = best(runs, || avx.draw(&m, &positions, &[], Faces::Both));
    table.info("depth buffer, corners alone, Mvertex/s", positions.len() as f64 / seconds * 1e-6);
    let mut random = Random::new(4);
    for (edge, floor) in [(5, f64::NAN), (10, f64::NAN), (25, f64::NAN), (50, 24.0), (100, f64::NAN)] {
        let boxes: Vec<ScreenBox> = (0..100_000)
            .map(|_| {
                let x = random.below((WIDTH - edge) as usize) as u32;
                let y = random.below((HEIGHT - edge) as usize) as u32;
                ScreenBox { x: [x, x + edge], y: [y, y + edge], depth: random.range_f32(0.1, 0.9) }
            })
            .collect();
        let mut answers = vec![false; boxes.len()];
        let seconds = best(runs, || avx.are_screen_boxes_occluded(&boxes, &mut answers));
        let name = format!("depth buffer, boxes of {edge} px, Mq/s");
        let speed = boxes.len() as f64 / seconds * 1e-6;
        if floor.is_finite() {
            table.least(&name, speed, floor)
        } else {
            table.info(&name, speed)
        }
        let occluded = answers.iter().filter(|a| **a).count() as f64 / answers.len() as f64;
        table.info("    of them occluded", occluded);
    }
    let world: Vec<_> = (0..20_000)
        .map(|_| {
            let c =
                DVec3::new(random.range(50.0, 1800.0), random.range(50.0, 1000.0), random.range(0.1, 0.9));
            farsight_geometry::DAabb::new(c, c + DVec3::new(50.0, 50.0, 0.01))
        })
        .collect();
    let mut occluded = 0;
    let seconds = best(runs, || {
        occluded = world.iter().filter(|b| avx.is_occluded(&m, DVec3::ZERO, b)).count();
    });
    table.info("depth buffer, boxes of 50 px from the world, Mq/s", world.len() as f64 / seconds * 1e-6);
}
