//! Border mutation: a new viewpoint, and directions just past the edges of what is known.

use crate::border::outline;
use crate::options::Bisector;
use crate::random::border_point;
use crate::sight::Sight;
use crate::wave::{Scratch, Space};
use farsight_geometry::RayCaster;
use farsight_geometry::sampling::Random;
use glam::DVec3;

/// Rays of one viewpoint. They go past triangles that were found one after the other, which lie side by side more often than
/// not: so they go through the tree together.
const TOGETHER: usize = 16;

/// Shoots `count` rays past the edges of known triangles.
pub(crate) fn sample<C: RayCaster>(
    space: &Space<C>,
    known: &[u32],
    random: &mut Random,
    count: usize,
    scratch: &mut Scratch,
) {
    // From ε to the coarse tolerance, all magnitudes alike: neighbours are small and large.
    let (low, high) = (space.options.epsilon, space.options.tolerance[0].max(space.options.epsilon));
    for _ in 0..count / TOGETHER {
        let origin = border_point(space.cell, random);
        let first = random.below(known.len() as u64) as usize;
        let Scratch { aims, next_aims, hits, out, .. } = scratch;
        aims.clear();
        let (before, after) = known.split_at(first);
        for triangle in after.iter().chain(before).take(TOGETHER) {
            let [edge, along, reach] = random.units();
            let corners = space.triangles.corners(*triangle).map(|p| p - origin);
            let reach = low * (high / low).powf(reach);
            aims.extend(past(corners, [edge, along, reach], space.rounding(), next_aims));
        }
        space.occluders.bundle(space.triangles, origin, aims, hits, |i, triangle| {
            out.see(space, Sight { triangle, origin, direction: aims[i] });
        });
        out.rays.mutation += aims.len() as u64;
        for (&direction, hit) in aims.iter().zip(hits.iter()) {
            if let Some(hit) = hit {
                out.see(space, Sight { triangle: space.triangles.of_hit(hit), origin, direction });
            }
        }
    }
}

/// A direction past the border of a triangle, by the angle `reach`.
fn past(
    corners: [DVec3; 3],
    [edge, along, reach]: [f64; 3],
    coarse: f64,
    points: &mut Vec<DVec3>,
) -> Option<DVec3> {
    points.clear();
    outline(corners, reach, coarse, Bisector::Outward, points);
    let at = (edge * points.len() as f64) as usize;
    let (from, to) = (*points.get(at)?, points[(at + 1) % points.len()]);
    Some(from + (to - from) * along)
}
