//! Border mutation: a new viewpoint, and a direction just past an edge of something known.

use crate::border::outline;
use crate::options::Bisector;
use crate::random::border_point;
use crate::wave::{Scratch, Space};
use farsight_geometry::sampling::Random;
use farsight_geometry::{Ray, RayCaster};
use glam::DVec3;

/// Aims `count` rays past the edges of known triangles.
pub(crate) fn aim<C: RayCaster>(
    space: &Space<C>,
    known: &[u32],
    random: &mut Random,
    count: usize,
    scratch: &mut Scratch,
) {
    scratch.rays.clear();
    if known.is_empty() {
        return;
    }
    for _ in 0..count {
        let triangle = known[random.below(known.len() as u64) as usize];
        let origin = border_point(space.cell, random);
        let [edge, along, reach] = random.units();
        // From ε to the coarse tolerance, all magnitudes alike: neighbours are small and large.
        let (low, high) = (space.options.epsilon, space.options.tolerance[0].max(space.options.epsilon));
        let reach = low * (high / low).powf(reach);
        if let Some(to) = past(space, triangle, origin, [edge, along, reach], &mut scratch.aims) {
            scratch.rays.extend(Ray::new(origin, to));
        }
    }
}

/// A direction past the border of a triangle, by the angle `reach`.
fn past<C: RayCaster>(
    space: &Space<C>,
    triangle: u32,
    origin: DVec3,
    [edge, along, reach]: [f64; 3],
    points: &mut Vec<DVec3>,
) -> Option<DVec3> {
    let corners = space.triangles.corners(triangle).map(|p| p - origin);
    points.clear();
    outline(corners, reach, space.rounding(), Bisector::Outward, points);
    let count = points.len();
    let at = edge * count as f64;
    let (from, to) = (*points.get(at as usize)?, points[(at as usize + 1) % count]);
    Some(from + (to - from) * along)
}
