//! Frame times of view cells: looked up by direction, and bounded by the objects' own samples.

use crate::backend::Backend;
use crate::estimate::{empty_frame, object_samples};
use farsight_geometry::glam::DVec3;
use farsight_geometry::sampling::Random;
use farsight_geometry::{Camera, DAabb};
use farsight_timing::{Millis, SampleOptions, ViewCellSamples, view_cell_estimate};

/// Directions around the horizon that a cell is asked in.
const DIRECTIONS: usize = 16;
/// Frames that each cell's answers are held against.
const FRAMES: usize = 400;

/// Samples cells along the path and holds them against frames that they have not seen.
pub fn report(backend: &mut impl Backend, cells: usize) {
    let cells: Vec<DAabb> = (0..cells)
        .map(|i| {
            let eye = backend.camera(0, i as f64 / cells as f64).eye();
            DAabb::new(eye - DVec3::splat(2.0), eye + DVec3::splat(2.0))
        })
        .collect();
    println!(
        "\n{}, {} view cells of 4 m, {DIRECTIONS} directions, {FRAMES} unseen frames each: taken / estimated",
        backend.name(),
        cells.len()
    );
    for views in [1, 4, 16, 64] {
        let ratios = cells.iter().enumerate().flat_map(|(k, cell)| {
            let looked = ViewCellSamples::measure(cell, DIRECTIONS, views, k as u64, |eye, ahead| {
                frame(backend, eye, ahead)
            });
            let looked = looked.expect("clocks do not run backwards");
            unseen(backend, cell, |ahead| looked.look_up(ahead))
        });
        print_line(&format!("{views:>3} frames a direction"), ratios.collect());
    }
    let lens = backend.camera(0, 0.0);
    let constant = empty_frame(backend);
    let objects = object_samples(backend, SampleOptions::default());
    let ratios = cells.iter().flat_map(|cell| {
        let most =
            view_cell_estimate(&objects, cell, &lens, DIRECTIONS).expect("a cell with directions") + constant;
        unseen(backend, cell, |_| most)
    });
    print_line("sum of largest views", ratios.collect());
}

/// The time of a frame from `eye`.
fn frame(backend: &mut impl Backend, eye: DVec3, ahead: DVec3) -> Millis {
    let lens = backend.camera(0, 0.0);
    let camera =
        Camera::look_at(eye, eye + ahead, DVec3::Z).and_then(|c| c.with_image(lens.width(), lens.height()));
    let camera = camera.and_then(|c| c.with_range(lens.near(), lens.far())).expect("level views");
    let visible = backend.visible(&camera);
    backend.time_frame(&visible, &camera)
}

/// Ratios of the time that random frames take to what was estimated for them.
fn unseen(backend: &mut impl Backend, cell: &DAabb, estimate: impl Fn(DVec3) -> Millis) -> Vec<f64> {
    let mut random = Random::new(99);
    let ratio = |_| {
        let eye = cell.min + cell.extent() * DVec3::from_array(random.units());
        let (sin, cos) = (std::f64::consts::TAU * random.unit()).sin_cos();
        let ahead = DVec3::new(cos, sin, 0.0);
        frame(backend, eye, ahead).0 / estimate(ahead).0
    };
    (0..FRAMES).map(ratio).collect()
}

fn print_line(name: &str, mut ratios: Vec<f64>) {
    ratios.sort_by(f64::total_cmp);
    let at = |q: f64| ratios[((ratios.len() - 1) as f64 * q) as usize];
    let above = ratios.iter().filter(|&&r| r > 1.0).count() as f64 / ratios.len() as f64;
    println!(
        "  {name:<24} median {:.2}, most {:.2}, above the estimate {:.1} %",
        at(0.5),
        at(1.0),
        100.0 * above
    );
}
