//! Reverse sampling: where a border ray is stopped before it reaches the triangle's plane, look past what stopped it from
//! another viewpoint.

use crate::border::{Job, NOTHING, Sample};
use crate::options::Reverse;
use crate::sight::Sight;
use crate::wave::{Scratch, Space};
use farsight_geometry::{Ray, RayCaster};
use glam::DVec3;

/// How much nearer than predicted, relatively, what stops a ray must be.
const GAP: f64 = 1e-3;

/// The predicted distance is believed within these factors of that of the border point; grazed planes lead anywhere.
const BELIEVED: [f64; 2] = [0.25, 4.0];

/// Shoots the reverse rays of a group's border samples.
pub(crate) fn sample<C: RayCaster>(space: &Space<C>, group: &[Job], scratch: &mut Scratch) {
    let Scratch { samples, corners, rays, hits, stopped, planes, out, .. } = scratch;
    rays.clear();
    stopped.clear();
    planes.clear();
    let origin = group[0].sight.origin;
    // Of the group's triangles, as their borders left them.
    planes.extend(corners.iter().map(|corners| Plane::of(corners.map(|p| p - origin))));
    for (index, sample) in samples.iter().enumerate() {
        let own = group[sample.owner as usize].sight.triangle;
        // Neighbours often stop at the same: most of what is passed once is seen without sorting.
        let again = stopped.last().is_some_and(|&[owner, met, _]| [owner, met] == [sample.owner, sample.met]);
        if !again && sample.met != own && planes[sample.owner as usize].stopped_before(sample).is_some() {
            stopped.push([sample.owner, sample.met, index as u32]);
        }
    }
    // What stops many rays of one border is passed once.
    stopped.sort_unstable();
    stopped.dedup_by_key(|[owner, met, _]| [*owner, *met]);
    corners.clear();
    space.triangles.gather(stopped.iter().map(|[_, met, _]| *met), corners);
    for (&[owner, _, index], occluder) in stopped.iter().zip(corners.iter()) {
        let (job, sample) = (&group[owner as usize], &samples[index as usize]);
        let Some(distance) = planes[owner as usize].stopped_before(sample) else { continue };
        let wanted = origin + sample.to.normalize_or_zero() * distance;
        let Some(ends) =
            ends(occluder.map(|p| p - origin), sample.to, job.sight.direction, space.options.epsilon)
        else {
            continue;
        };
        let wanted_ends = if space.options.reverse == Reverse::Both { &ends[..] } else { &ends[..1] };
        for &end in wanted_ends {
            let viewpoint = space.cell.viewpoint_past(origin + end, wanted);
            rays.extend(viewpoint.and_then(|from| Ray::new(from, wanted - from)));
        }
    }
    if rays.is_empty() {
        return;
    }
    space.occluders.batch(space.triangles, rays, hits, |i, triangle| {
        out.see(space, Sight { triangle, origin: rays[i].origin(), direction: rays[i].direction() });
    });
    out.reverse += rays.len() as u64;
    for (ray, hit) in rays.iter().zip(hits.iter()) {
        if let Some(hit) = hit {
            let triangle = space.triangles.of_hit(hit);
            out.see(space, Sight { triangle, origin: ray.origin(), direction: ray.direction() });
        }
    }
}

/// The plane of a triangle, relative to the viewpoint.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plane {
    normal: DVec3,
    height: f64,
}

impl Plane {
    fn of([a, b, c]: [DVec3; 3]) -> Self {
        let normal = (b - a).cross(c - a);
        Self { normal, height: normal.dot(a) }
    }

    /// The distance at which the ray was predicted to meet the plane, when something stopped it before.
    fn stopped_before(&self, sample: &Sample) -> Option<f64> {
        if sample.met == NOTHING {
            return None;
        }
        let factor = self.height / self.normal.dot(sample.to);
        let believed = (BELIEVED[0]..=BELIEVED[1]).contains(&factor);
        let predicted = sample.to.length() * if believed { factor } else { 1.0 };
        (predicted - sample.t > GAP * predicted).then_some(predicted)
    }
}

/// Points just outside a triangle, on both ends of its section with the plane through the viewpoint and two directions: first
/// the end on the side of `seen`.
fn ends(triangle: [DVec3; 3], stopped: DVec3, seen: DVec3, epsilon: f64) -> Option<[DVec3; 2]> {
    let [stopped, seen] = [stopped, seen].map(DVec3::normalize_or_zero);
    // In f64 the normal of two directions 1e-4 apart still has eleven digits.
    let normal = stopped.cross(seen).try_normalize()?;
    let heights = triangle.map(|p| p.dot(normal));
    let mut crossings = (0..3).filter_map(|i| {
        let j = (i + 1) % 3;
        let (p, q) = (heights[i], heights[j]);
        ((p < 0.0) != (q < 0.0)).then(|| triangle[i] + (triangle[j] - triangle[i]) * (p / (p - q)))
    });
    let (p, q) = (crossings.next()?, crossings.next()?);
    // Across the stopped ray, towards what was seen.
    let towards = normal.cross(stopped);
    let side = |x: DVec3| towards.dot(x) / stopped.dot(x).abs().max(f64::MIN_POSITIVE);
    let (near, far) = if side(p) >= side(q) { (p, q) } else { (q, p) };
    let along = (near - far).try_normalize()?;
    Some([near + along * (epsilon * near.length()), far - along * (epsilon * far.length())])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_near_end_lies_on_the_side_of_what_was_seen() {
        // The occluder covers y from 0 to 3 at z = −2; what was seen lies at negative y.
        let occluder = [DVec3::new(-1.0, 0.0, -2.0), DVec3::new(1.0, 0.0, -2.0), DVec3::new(0.0, 3.0, -2.0)];
        let (stopped, seen) = (DVec3::new(0.0, 0.1, -10.0), DVec3::new(0.0, -0.1, -10.0));
        let [near, far] = ends(occluder, stopped, seen, 1e-3).unwrap();
        assert!(near.y < 0.0 && near.y > -0.01 && near.x.abs() < 1e-12, "{near}");
        assert!(far.y > 3.0 && far.y < 3.01, "{far}");
        assert!(ends(occluder, stopped, stopped, 1e-3).is_none(), "one direction spans no plane");
    }

    #[test]
    fn grazed_planes_fall_back_to_the_distance_of_the_border() {
        let sample = |to: DVec3, t: f64| Sample::for_test(to, 7, t);
        let flat = [DVec3::new(-1.0, -1.0, -4.0), DVec3::new(1.0, -1.0, -4.0), DVec3::new(0.0, 1.0, -4.0)];
        assert_eq!(Plane::of(flat).stopped_before(&sample(DVec3::NEG_Z * 4.0, 2.0)), Some(4.0));
        assert_eq!(Plane::of(flat).stopped_before(&sample(DVec3::NEG_Z * 4.0, 3.9999)), None);
        // Nearly in the triangle's plane: the prediction is behind or very far.
        let grazed = [DVec3::new(1.0, 0.0, -4.0), DVec3::new(1.0, 1e-9, -4.0), DVec3::new(1.0, 0.0, -6.0)];
        let to = DVec3::new(1.0 - 1e-12, 0.0, -4.0);
        let distance = Plane::of(grazed).stopped_before(&sample(to, 1.0)).unwrap();
        assert!((distance - to.length()).abs() < 1e-6);
    }
}
