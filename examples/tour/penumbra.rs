//! How wide the sun's penumbrae are in a view, at most.

use farsight_geometry::glam::{DVec2, DVec3};
use farsight_geometry::{Camera, DAabb};

/// Cells along a side of the grid across the light in which the highest casters are noted.
const CELLS: usize = 64;
/// Sine of the lowest elevation of light above a receiver that is allowed for, 30°: there a penumbra is twice as wide as across the light. Lower light
/// shows little.
const STEEPNESS: f64 = 0.5;

/// A box as the sun sees it.
struct Cast {
    min: DVec2,
    max: DVec2,
    /// From the end that is away from the sun to the other.
    along: [f64; 2],
}

impl Cast {
    fn new(b: &DAabb, axes: [DVec3; 3]) -> Self {
        let (center, half) = (b.center(), 0.5 * b.extent());
        let [x, y, z] = axes.map(|a| [center.dot(a) - half.dot(a.abs()), center.dot(a) + half.dot(a.abs())]);
        Self { min: DVec2::new(x[0], y[0]), max: DVec2::new(x[1], y[1]), along: z }
    }
}

/// Widest penumbra in pixels that a sun of this angular radius, shining along a unit direction, may give: from the highest caster that can be between
/// it and each receiver, as the nearest point of the receiver's box shows it.
pub fn widest(
    camera: &Camera,
    direction: DVec3,
    angular_radius: f64,
    casters: impl Iterator<Item = DAabb>,
    receivers: &[DAabb],
) -> f64 {
    let all = receivers.iter().fold(DAabb::EMPTY, |a, b| a.union(*b));
    if all.is_empty() || angular_radius == 0.0 {
        return 0.0;
    }
    let (x, y) = direction.any_orthonormal_pair();
    let axes = [x, y, -direction];
    let ground = Cast::new(&all, axes);
    let cell = (ground.max - ground.min).max_element().max(f64::MIN_POSITIVE) / CELLS as f64;
    let cells = |cast: &Cast| {
        // Casts of what is outside end at the border.
        let at = |p: f64, first: f64| ((p - first) / cell) as usize;
        let range = |min: f64, max: f64, first: f64| at(min, first)..(at(max, first) + 1).min(CELLS);
        let columns = range(cast.min.x, cast.max.x, ground.min.x);
        range(cast.min.y, cast.max.y, ground.min.y)
            .flat_map(move |j| columns.clone().map(move |i| j * CELLS + i))
    };
    let mut highest = vec![f64::NEG_INFINITY; CELLS * CELLS];
    for caster in casters.map(|b| Cast::new(&b, axes)) {
        if caster.max.cmplt(ground.min).any() || caster.min.cmpgt(ground.max).any() {
            continue;
        }
        cells(&caster).for_each(|i| highest[i] = highest[i].max(caster.along[1]));
    }
    let width = |receiver: &DAabb| {
        let cast = Cast::new(receiver, axes);
        let top = cells(&cast).map(|i| highest[i]).fold(f64::NEG_INFINITY, f64::max);
        let width = 2.0 * angular_radius.tan() * (top - cast.along[0]).max(0.0) / STEEPNESS;
        width / camera.world_error(1.0, camera.distance_to_box(receiver).max(camera.near()))
    };
    receivers.iter().map(width).fold(0.0, f64::max)
}
