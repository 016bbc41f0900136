//! Adaptive border sampling: rays just outside triangles that were seen, and between them where they meet different things.
//!
//! Triangles that were seen from one viewpoint are sampled together: their rays go through the tree as bundles.

use crate::options::{Bisector, Reverse};
use crate::reverse;
use crate::sight::Sight;
use crate::wave::{Scratch, Space};
use farsight_geometry::RayCaster;
use glam::DVec3;

/// Most rays that the borders of one triangle get on average over a group; what a finer subdivision would find is left to
/// others.
const MOST_RAYS: usize = 4096;

/// Triangles whose borders are sampled together.
pub(crate) const GROUP: usize = 8;

/// What a ray meets that meets nothing.
pub(crate) const NOTHING: u32 = u32::MAX;

/// A triangle whose border is to be sampled from where it was seen.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Job {
    pub(crate) sight: Sight,
    /// Angle below which no ray goes between two others.
    pub(crate) tolerance: f64,
    /// Bits of the edges that the flood is to cross.
    pub(crate) edges: u8,
}

/// Jobs in a row that look from the same point.
pub(crate) fn groups(jobs: &[Job], most: usize) -> impl Iterator<Item = &[Job]> {
    jobs.chunk_by(|a, b| a.sight.origin == b.sight.origin).flat_map(move |jobs| jobs.chunks(most))
}

/// A border ray and what it met.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sample {
    /// Point that the ray is aimed at, relative to the viewpoint.
    pub(crate) to: DVec3,
    /// Distance of what was met; infinite for nothing.
    pub(crate) t: f64,
    /// Triangle met, or [`NOTHING`].
    pub(crate) met: u32,
    /// Job of the group whose border it belongs to.
    pub(crate) owner: u32,
}

/// Samples the borders of a group's triangles, all seen from one viewpoint. Which rays are shot depends on the jobs alone,
/// not on what is known already: so groups can be sampled in any order, and side by side.
pub(crate) fn sample<C: RayCaster>(space: &Space<C>, group: &[Job], scratch: &mut Scratch) {
    let Some(&Job { sight: Sight { origin, .. }, tolerance, .. }) = group.first() else { return };
    let Scratch { aims, corners, owners, edges, samples, .. } = scratch;
    aims.clear();
    owners.clear();
    edges.clear();
    samples.clear();
    corners.clear();
    space.triangles.gather(group.iter().map(|job| job.sight.triangle), corners);
    for (owner, corners) in corners.iter().enumerate() {
        let first = aims.len() as u32;
        let outline = Outline::new(corners.map(|p| p - origin), space.rounding());
        outline.points(space.options.epsilon, space.options.bisector, aims);
        let last = aims.len() as u32;
        edges.extend((first..last).map(|i| [i, if i + 1 == last { first } else { i + 1 }]));
        owners.resize(aims.len(), owner as u32);
    }
    shoot(space, group, scratch);
    let most = MOST_RAYS * group.len();
    while !scratch.edges.is_empty() && scratch.samples.len() < most {
        split(scratch, tolerance, most);
        shoot(space, group, scratch);
    }
    if space.options.reverse != Reverse::Off {
        reverse::sample(space, group, scratch);
    }
}

/// Replaces each edge whose ends met different things by its halves, and aims at their common points.
fn split(scratch: &mut Scratch, tolerance: f64, most: usize) {
    let Scratch { edges, next_edges, samples, aims, owners, .. } = scratch;
    next_edges.clear();
    aims.clear();
    owners.clear();
    for &[a, b] in edges.iter() {
        let (from, to) = (&samples[a as usize], &samples[b as usize]);
        if from.met != to.met && samples.len() + aims.len() < most && are_apart(from.to, to.to, tolerance) {
            let middle = (samples.len() + aims.len()) as u32;
            aims.push((from.to + to.to) * 0.5);
            owners.push(from.owner);
            next_edges.extend([[a, middle], [middle, b]]);
        }
    }
    std::mem::swap(edges, next_edges);
}

/// Whether the angle between two directions is at least `tolerance`, or so blunt that its sine is not.
fn are_apart(a: DVec3, b: DVec3, tolerance: f64) -> bool {
    let lengths = a.length_squared() * b.length_squared();
    a.cross(b).length_squared() >= tolerance * tolerance * lengths || a.dot(b) < 0.0
}

/// Traces the rays that are aimed and appends them to the samples.
fn shoot<C: RayCaster>(space: &Space<C>, group: &[Job], scratch: &mut Scratch) {
    let Scratch { aims, hits, owners, samples, out, .. } = scratch;
    let origin = group[0].sight.origin;
    space.occluders.bundle(space.triangles, origin, aims, hits, |i, triangle| {
        out.see(space, Sight { triangle, origin, direction: aims[i] });
    });
    out.rays += aims.len() as u64;
    for ((&to, &owner), hit) in aims.iter().zip(owners.iter()).zip(hits.iter()) {
        let (met, t) = hit.map_or((NOTHING, f64::INFINITY), |h| (space.triangles.of_hit(&h), h.t));
        if met != NOTHING {
            out.self_hits += u64::from(met == group[owner as usize].sight.triangle);
            out.see(space, Sight { triangle: met, origin, direction: to });
        }
        samples.push(Sample { to, t, met, owner });
    }
}

/// A triangle as seen from the origin of its corners, to be enlarged.
pub(crate) struct Outline {
    /// Counter-clockwise as seen from here, so that directions across edges point outward.
    corners: [DVec3; 3],
    is_back: bool,
    /// Direction across the edge from each corner to the next; none for an edge seen end-on.
    ways: [Option<DVec3>; 3],
    distances: [f64; 3],
    /// What coordinates are rounded to.
    coarse: f64,
}

impl Outline {
    pub(crate) fn new([a, b, c]: [DVec3; 3], coarse: f64) -> Self {
        let is_back = a.dot(b.cross(c)) > 0.0;
        let corners = if is_back { [a, c, b] } else { [a, b, c] };
        let [a, b, c] = corners;
        let ways = [across(a, b), across(b, c), across(c, a)];
        Self { corners, is_back, ways, distances: corners.map(DVec3::length), coarse }
    }

    /// The direction out of a corner between those across its edges.
    fn middle(&self, corner: usize, bisector: Bisector) -> Option<DVec3> {
        let (incoming, outgoing) = (self.ways[(corner + 2) % 3]?, self.ways[corner]?);
        if incoming.dot(outgoing) > 0.0 {
            return direction(incoming + outgoing);
        }
        // The sum of the edges' directions at a sharp corner, in ones that stay apart.
        direction((incoming - outgoing).cross(self.corners[corner])).map(|out| match bisector {
            Bisector::Printed if !self.is_back => -out,
            _ => out,
        })
    }

    /// A point outside a corner by the angle `epsilon`, and by no less than coordinates can tell.
    fn beyond(&self, corner: usize, way: DVec3, epsilon: f64) -> DVec3 {
        self.corners[corner] + way * (epsilon * self.distances[corner]).max(8.0 * self.coarse)
    }

    /// The border of the triangle enlarged by the angle `epsilon`: up to nine points, counter-clockwise.
    ///
    /// Around each corner lie a point across from each of its two edges and one on the bisector outside. Points that have no
    /// direction (an edge seen end-on) are left out.
    pub(crate) fn points(&self, epsilon: f64, bisector: Bisector, points: &mut Vec<DVec3>) {
        for corner in 0..3 {
            let ways = [self.ways[(corner + 2) % 3], self.middle(corner, bisector), self.ways[corner]];
            points.extend(ways.into_iter().flatten().map(|way| self.beyond(corner, way, epsilon)));
        }
    }

    /// A point on one of the nine sides of that border: `side` below 9, the point a share `along` of the way.
    pub(crate) fn point_on(&self, side: usize, along: f64, epsilon: f64) -> Option<DVec3> {
        let corner = side / 3 % 3;
        let (from, to) = match side % 3 {
            0 => (self.ways[(corner + 2) % 3]?, self.middle(corner, Bisector::Outward)?),
            1 => (self.middle(corner, Bisector::Outward)?, self.ways[corner]?),
            _ => (self.ways[corner]?, self.ways[corner]?),
        };
        // The third side of a corner runs along the edge to the next one.
        let end = if side % 3 == 2 { (corner + 1) % 3 } else { corner };
        let (from, to) = (self.beyond(corner, from, epsilon), self.beyond(end, to, epsilon));
        Some(from + (to - from) * along)
    }
}

/// Unit vector square to the line of sight to an edge, out of the triangle at its left.
pub(crate) fn across(from: DVec3, to: DVec3) -> Option<DVec3> {
    direction(from.cross(to - from))
}

fn direction(v: DVec3) -> Option<DVec3> {
    let square = v.length_squared();
    if (1e-200..1e200).contains(&square) {
        return Some(v / square.sqrt());
    }
    // Squares of tiny and huge vectors need not be representable.
    let largest = v.abs().max_element();
    (largest > 0.0 && largest.is_finite()).then(|| (v / largest).normalize())
}

#[cfg(test)]
impl Sample {
    pub(crate) fn for_test(to: DVec3, met: u32, t: f64) -> Self {
        Self { to, t, met, owner: 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use farsight_geometry::sampling::Random;

    fn around(corners: [DVec3; 3], epsilon: f64, bisector: Bisector) -> Vec<DVec3> {
        let mut points = Vec::new();
        Outline::new(corners, 0.0).points(epsilon, bisector, &mut points);
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
