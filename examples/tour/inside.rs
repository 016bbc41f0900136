//! Finding a place to stand inside a building.

use farsight_geometry::glam::DVec3;
use farsight_geometry::sampling::{Directions, Halton};
use farsight_geometry::{DAabb, Ray, RayCaster};

/// Rays shot from every candidate.
const RAYS: u32 = 96;
/// Share of the rays that must hit something: a place inside has walls around it.
const ENCLOSED: f64 = 0.7;
/// Share of the hits that must be front faces: inside a solid body one sees backs only.
const FRONTS: f64 = 0.7;

/// A line along which one can walk inside, level and free of obstacles; `None` where there is no inside.
pub fn walkway(scene: &impl RayCaster, bounds: &DAabb, up: DVec3) -> Option<[DVec3; 2]> {
    let size = bounds.diagonal();
    let mut best: Option<(f64, [DVec3; 2])> = None;
    for eye in candidates(bounds, up) {
        let Some(distances) = look_around(scene, eye) else { continue };
        let mean = distances.iter().sum::<f64>() / distances.len() as f64;
        let nearest = distances.iter().copied().fold(f64::INFINITY, f64::min);
        let Some((free, ahead)) = longest_view(scene, eye, up) else { continue };
        if nearest < 0.005 * size {
            continue;
        }
        let score = mean + 0.3 * free;
        if best.is_none_or(|b| score > b.0) {
            best = Some((score, [eye, eye + ahead * (0.5 * free)]));
        }
    }
    best.map(|b| b.1)
}

/// A grid over the box, in its lower half where people are.
fn candidates(bounds: &DAabb, up: DVec3) -> impl Iterator<Item = DVec3> + '_ {
    let at = move |i: u32, heights: f64, widths: f64| {
        let grid = |k: u32| (f64::from(k) + 0.5) / widths;
        let height = (f64::from(i / 49) + 0.5) / heights * 0.5;
        let (a, b) = (grid(i % 7), grid(i / 7 % 7));
        let share = if up == DVec3::Y { DVec3::new(a, height, b) } else { DVec3::new(a, b, height) };
        bounds.min + bounds.extent() * share
    };
    (0..49 * 4).map(move |i| at(i, 4.0, 7.0))
}

/// Distances to what is around, if the place is inside.
fn look_around(scene: &impl RayCaster, eye: DVec3) -> Option<Vec<f64>> {
    let halton = Halton::new(1);
    let hits: Vec<_> = (0..RAYS)
        .filter_map(|i| {
            let direction = Directions::Sphere.sample(halton.point::<2>(i));
            scene.closest(&Ray::new(eye, direction)?)
        })
        .collect();
    let fronts = hits.iter().filter(|h| !h.back_face).count() as f64;
    let inside = hits.len() as f64 >= ENCLOSED * f64::from(RAYS) && fronts >= FRONTS * hits.len() as f64;
    inside.then(|| hits.iter().map(|h| h.t).collect())
}

/// The level direction in which one sees farthest, with the distance.
fn longest_view(scene: &impl RayCaster, eye: DVec3, up: DVec3) -> Option<(f64, DVec3)> {
    let (a, b) = up.any_orthonormal_pair();
    (0..32)
        .filter_map(|i| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / 32.0).sin_cos();
            let ahead = a * cos + b * sin;
            scene.closest(&Ray::new(eye, ahead)?).map(|hit| (hit.t, ahead))
        })
        .max_by(|x, y| x.0.total_cmp(&y.0))
}
