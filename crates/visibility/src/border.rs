//! Adaptive border sampling: rays just outside a triangle that was seen, and between them where they meet different things.
//!
//! First comes a flood: one ray past the middle of each edge. On a connected surface that finds every neighbour for three rays
//! a triangle. Only triangles at whose edges the surface breaks off are then sampled all around.

use crate::options::{Bisector, Reverse};
use crate::reverse;
use crate::sight::Sight;
use crate::wave::{Scratch, Space};
use farsight_geometry::{Ray, RayCaster};
use glam::DVec3;

/// Most rays that one triangle's border gets; what a finer subdivision would find is left to others.
const MOST_RAYS: usize = 4096;

/// What a ray meets that meets nothing.
pub(crate) const NOTHING: u32 = u32::MAX;

/// A triangle whose border is to be sampled from where it was seen.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Job {
    pub(crate) sight: Sight,
    /// Angle below which no ray goes between two others.
    pub(crate) tolerance: f64,
}

/// How much nearer or farther than the triangle's plane, relatively, something past its edge must be for the surface to
/// break off there.
const BREAK: f64 = 1e-3;

/// One ray past the middle of each edge of the triangles of `jobs`. Those where the surface breaks off are to be sampled
/// all around.
pub(crate) fn flood<C: RayCaster>(space: &Space<C>, jobs: &[Job], scratch: &mut Scratch) {
    let Scratch { aims, rays, hits, owners, out, .. } = scratch;
    rays.clear();
    owners.clear();
    for (index, job) in jobs.iter().enumerate() {
        let origin = job.sight.origin;
        let corners = space.triangles.corners(job.sight.triangle).map(|p| p - origin);
        aims.clear();
        middles(corners, space.options.epsilon, space.rounding(), aims);
        rays.extend(aims.iter().filter_map(|&to| Ray::new(origin, to)));
        owners.resize(rays.len(), index as u32);
    }
    space.occluders.batch(space.triangles, rays, hits, |i, triangle| {
        out.see(space, Sight { triangle, origin: rays[i].origin(), direction: rays[i].direction() });
    });
    out.rays.border += rays.len() as u64;
    let mut at = 0;
    for (index, job) in jobs.iter().enumerate() {
        let Sight { triangle: own, origin, .. } = job.sight;
        let [a, b, c] = space.triangles.corners(own).map(|p| p - origin);
        let normal = (b - a).cross(c - a);
        let mut breaks = false;
        while owners.get(at) == Some(&(index as u32)) {
            let direction = rays[at].direction();
            let met = hits[at].map(|hit| (space.triangles.of_hit(&hit), hit.t));
            at += 1;
            let Some((triangle, t)) = met else {
                breaks = true;
                continue;
            };
            out.self_hits += u64::from(triangle == own);
            out.see(space, Sight { triangle, origin, direction });
            let gap = normal.dot(a) / normal.dot(direction) - t;
            breaks |= gap.is_nan() || gap.abs() > BREAK * t;
        }
        if breaks {
            out.later.push(*job);
        }
    }
}

/// Points past the middles of a triangle's edges by the angle `epsilon`, as seen from the origin; none for an edge seen
/// end-on.
fn middles([a, b, c]: [DVec3; 3], epsilon: f64, coarse: f64, points: &mut Vec<DVec3>) {
    let sign = if a.dot(b.cross(c)) > 0.0 { -1.0 } else { 1.0 };
    points.extend([[a, b], [b, c], [c, a]].into_iter().filter_map(|[from, to]| {
        let middle = (from + to) * 0.5;
        let reach = sign * (epsilon * middle.length()).max(8.0 * coarse);
        across(from, to).map(|out| middle + out * reach)
    }));
}

/// A border ray and what it met.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sample {
    /// Point that the ray is aimed at, relative to the viewpoint.
    pub(crate) to: DVec3,
    unit: DVec3,
    /// Triangle met, or [`NOTHING`].
    pub(crate) met: u32,
    /// Distance of what was met; infinite for nothing.
    pub(crate) t: f64,
}

/// Samples the border of a triangle. Which rays are shot depends on the job alone, not on what is known already: so jobs
/// can run in any order, and side by side.
pub(crate) fn sample<C: RayCaster>(space: &Space<C>, job: &Job, scratch: &mut Scratch) {
    let corners = space.triangles.corners(job.sight.triangle).map(|p| p - job.sight.origin);
    let options = &space.options;
    let coarse = space.rounding();
    scratch.aims.clear();
    outline(corners, options.epsilon, coarse, options.bisector, &mut scratch.aims);
    scratch.samples.clear();
    shoot(space, job, scratch);
    let count = scratch.samples.len() as u32;
    scratch.edges.clear();
    scratch.edges.extend((0..count).map(|i| [i, (i + 1) % count]));
    while !scratch.edges.is_empty() && scratch.samples.len() < MOST_RAYS {
        split(scratch, job.tolerance);
        shoot(space, job, scratch);
    }
    if options.reverse != Reverse::Off {
        reverse::sample(space, job, corners, scratch);
    }
}

/// Replaces each edge whose ends met different things by its halves, and aims at their common points.
fn split(scratch: &mut Scratch, tolerance: f64) {
    let Scratch { edges, next_edges, samples, aims, .. } = scratch;
    next_edges.clear();
    aims.clear();
    for &[a, b] in edges.iter() {
        let (from, to) = (&samples[a as usize], &samples[b as usize]);
        let apart = from.unit.distance_squared(to.unit) >= tolerance * tolerance;
        if from.met != to.met && apart && samples.len() + aims.len() < MOST_RAYS {
            let middle = (samples.len() + aims.len()) as u32;
            aims.push((from.to + to.to) * 0.5);
            next_edges.extend([[a, middle], [middle, b]]);
        }
    }
    std::mem::swap(edges, next_edges);
}

/// Traces the rays that are aimed and appends them to the samples.
fn shoot<C: RayCaster>(space: &Space<C>, job: &Job, scratch: &mut Scratch) {
    let Scratch { aims, hits, samples, out, .. } = scratch;
    let origin = job.sight.origin;
    space.occluders.bundle(space.triangles, origin, aims, hits, |i, triangle| {
        out.see(space, Sight { triangle, origin, direction: aims[i] });
    });
    out.rays.border += aims.len() as u64;
    for (&to, hit) in aims.iter().zip(hits.iter()) {
        let met = hit.map_or(NOTHING, |h| space.triangles.of_hit(&h));
        out.self_hits += u64::from(met == job.sight.triangle);
        if met != NOTHING {
            out.see(space, Sight { triangle: met, origin, direction: to });
        }
        let t = hit.map_or(f64::INFINITY, |h| h.t);
        samples.push(Sample { to, unit: to.normalize_or_zero(), met, t });
    }
}

/// The border of a triangle enlarged by the angle `epsilon`, as seen from the origin of its corners: up to nine points,
/// counter-clockwise.
///
/// Around each corner lie a point across from each of its two edges and one on the bisector outside. `coarse` is what
/// coordinates are rounded to. Points that have no direction (an edge seen end-on) are left out.
pub(crate) fn outline(
    [a, b, c]: [DVec3; 3],
    epsilon: f64,
    coarse: f64,
    bisector: Bisector,
    points: &mut Vec<DVec3>,
) {
    let is_back = a.dot(b.cross(c)) > 0.0;
    // Counter-clockwise as seen from here, so that directions across edges point outward.
    let corners = if is_back { [a, c, b] } else { [a, b, c] };
    for i in 0..3 {
        let [before, at, after] = [corners[(i + 2) % 3], corners[i], corners[(i + 1) % 3]];
        let distance = at.length();
        let reach = (epsilon * distance).max(8.0 * coarse);
        let (incoming, outgoing) = (across(before, at), across(at, after));
        let middle = match (incoming, outgoing) {
            (Some(p), Some(q)) if p.dot(q) > 0.0 => direction(p + q),
            // The sum of the edges' directions at a sharp corner, in ones that stay apart.
            (Some(p), Some(q)) => direction((p - q).cross(at)).map(|out| match bisector {
                Bisector::Printed if !is_back => -out,
                _ => out,
            }),
            _ => None,
        };
        points.extend([incoming, middle, outgoing].into_iter().flatten().map(|d| at + d * reach));
    }
}

/// Unit vector square to the line of sight to an edge, out of the triangle at its left.
fn across(from: DVec3, to: DVec3) -> Option<DVec3> {
    direction(from.cross(to - from))
}

fn direction(v: DVec3) -> Option<DVec3> {
    let largest = v.abs().max_element();
    // Scaled first: squares of tiny and huge vectors need not be representable.
    (largest > 0.0 && largest.is_finite()).then(|| (v / largest).normalize())
}

#[cfg(test)]
impl Sample {
    pub(crate) fn for_test(to: DVec3, met: u32, t: f64) -> Self {
        Self { to, unit: to.normalize(), met, t }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use farsight_geometry::sampling::Random;

    fn around(corners: [DVec3; 3], epsilon: f64, bisector: Bisector) -> Vec<DVec3> {
        let mut points = Vec::new();
        outline(corners, epsilon, 0.0, bisector, &mut points);
        points
    }

    /// Angle between `p` and the triangle as seen from the origin; negative inside its cone.
    fn outside(corners: [DVec3; 3], p: DVec3) -> f64 {
        let [a, b, c] = corners;
        let sign = if a.dot(b.cross(c)) > 0.0 { -1.0 } else { 1.0 };
        let height = |p: DVec3, q: DVec3, x: DVec3| sign * p.cross(q).normalize().dot(x.normalize());
        let edges = [[a, b], [b, c], [c, a]];
        let highest = edges.map(|[p0, p1]| height(p0, p1, p)).into_iter().fold(f64::NEG_INFINITY, f64::max);
        if highest <= 0.0 {
            return highest;
        }
        let angle = |[from, to]: [DVec3; 2]| {
            let normal = from.cross(to).normalize();
            let onto = p - normal * normal.dot(p);
            let between = from.cross(onto).dot(normal) >= 0.0 && onto.cross(to).dot(normal) >= 0.0;
            let ends = p.angle_between(from).min(p.angle_between(to));
            if between { p.angle_between(onto) } else { ends }
        };
        edges.map(angle).into_iter().fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn every_point_lies_outside_by_about_epsilon_from_any_side_and_with_any_winding() {
        let mut random = Random::new(4);
        let epsilon = 1e-4;
        for _ in 0..20_000 {
            let mut corner = || DVec3::from_array(random.units()) * 2.0 - DVec3::ONE + DVec3::Z * 2.0;
            let t = [corner(), corner(), corner()];
            let points = around(t, epsilon, Bisector::Outward);
            assert_eq!(points.len(), 9);
            for p in points {
                let by = outside(t, p);
                assert!(by > 0.7 * epsilon && by < 1.001 * epsilon, "{by} of {t:?}");
            }
        }
    }

    #[test]
    fn the_printed_bisector_leads_into_front_faces_at_sharp_corners() {
        // Equilateral, seen from the front: all its corners are sharp.
        let t = [DVec3::new(-1.0, -0.6, -3.0), DVec3::new(1.0, -0.6, -3.0), DVec3::new(0.0, 1.1, -3.0)];
        let inward =
            |t, bisector| around(t, 1e-4, bisector).into_iter().filter(|&p| outside(t, p) < 0.0).count();
        assert_eq!((inward(t, Bisector::Printed), inward(t, Bisector::Outward)), (3, 0));
        let back = [t[0], t[2], t[1]];
        assert_eq!((inward(back, Bisector::Printed), inward(back, Bisector::Outward)), (0, 0));
        // All corners blunt or right does not exist; one blunt corner leaves two sharp ones.
        let blunt = [DVec3::new(-2.0, 0.0, -3.0), DVec3::new(2.0, 0.0, -3.0), DVec3::new(0.0, 0.3, -3.0)];
        assert_eq!(inward(blunt, Bisector::Printed), 2);
    }

    #[test]
    fn degenerate_views_leave_points_out_instead_of_making_them_up() {
        let finite = |t: [DVec3; 3]| {
            let points = around(t, 1e-4, Bisector::Outward);
            assert!(points.iter().all(|p| p.is_finite()), "{t:?}");
            points.len()
        };
        let [a, b] = [DVec3::new(0.0, 0.0, -2.0), DVec3::new(1.0, 0.0, -2.0)];
        assert_eq!(finite([a; 3]), 0);
        assert_eq!(finite([a, a, b]), 5, "a segment there and back");
        assert_eq!(finite([a, a * 2.0, b]), 5, "an edge seen end-on");
        assert_eq!(finite([DVec3::ZERO, a, b]), 2, "a corner in the eye");
        for scale in [1e-18, 1e18] {
            let t = [a, b, DVec3::new(0.0, 1.0, -2.0)].map(|p| p * scale);
            assert_eq!(finite(t), 9);
        }
        finite([a, b, DVec3::new(2.0, 0.0, -4.0)]);
        finite([a, DVec3::new(1e6, 0.0, -2.0), DVec3::new(5e5, 1e-9, -2.0)]);
    }
}
