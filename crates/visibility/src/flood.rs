//! Flooding: one ray past the middle of each edge of what was just seen. On a connected surface that finds every neighbour
//! at a ray or two a triangle. Only triangles at whose edges the surface breaks off are then sampled all around.

use crate::border::{Job, across, groups};
use crate::sight::Sight;
use crate::wave::{Scratch, Space};
use farsight_geometry::RayCaster;
use glam::DVec3;
use std::collections::HashSet;
use std::hash::{BuildHasherDefault, Hasher};

/// Triangles that are flooded from together.
const GROUP: usize = 16;

/// How much nearer or farther than the triangle's plane, relatively, something past its edge must be for the surface to
/// break off there.
const BREAK: f64 = 1e-3;

/// Edges that the flood has crossed: the triangle on the other side need not come back.
#[derive(Debug, Default)]
pub(crate) struct Crossed(HashSet<u64, BuildHasherDefault<Mixed>>);

/// The hash of a number that is a hash.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Mixed(u64);

impl Hasher for Mixed {
    fn write_u64(&mut self, hash: u64) {
        self.0 = hash;
    }

    fn write(&mut self, _: &[u8]) {
        unreachable!("edges are numbers");
    }

    fn finish(&self) -> u64 {
        self.0
    }
}

impl Crossed {
    /// Which edges of a triangle were not crossed before, as bits; from now on they are.
    pub(crate) fn cross(&mut self, corners: [DVec3; 3]) -> u8 {
        let [a, b, c] = corners.map(hash);
        // The same for both ways along an edge.
        let edges = [[a, b], [b, c], [c, a]].map(|[p, q]| p.wrapping_add(q));
        (0..3).map(|i| u8::from(self.0.insert(edges[i])) << i).sum()
    }

    /// Bytes of the table.
    pub(crate) fn bytes(&self) -> usize {
        // A number and a byte of control for each place.
        self.0.capacity() * (size_of::<u64>() + 1)
    }
}

fn hash(p: DVec3) -> u64 {
    let mix = |h: u64, x: f64| {
        // Both zeros are one place.
        let h = (h ^ (x + 0.0).to_bits()).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        h ^ h >> 29
    };
    mix(mix(mix(1, p.x), p.y), p.z)
}

/// One ray past the middle of each edge of the triangles of `jobs` that is still to be crossed. Those where the surface
/// breaks off are to be sampled all around.
pub(crate) fn flood<C: RayCaster>(space: &Space<C>, jobs: &[Job], scratch: &mut Scratch) {
    for group in groups(jobs, GROUP) {
        let Scratch { aims, corners, hits, owners, out, .. } = &mut *scratch;
        let origin = group[0].sight.origin;
        aims.clear();
        owners.clear();
        corners.clear();
        space.triangles.gather(group.iter().map(|job| job.sight.triangle), corners);
        for (owner, (job, corners)) in group.iter().zip(corners.iter_mut()).enumerate() {
            *corners = corners.map(|p| p - origin);
            middles(*corners, job.edges, space.options.epsilon, space.rounding(), aims);
            owners.resize(aims.len(), owner as u32);
        }
        space.occluders.bundle(space.triangles, origin, aims, hits, |i, triangle| {
            out.see(space, Sight { triangle, origin, direction: aims[i] });
        });
        out.rays += aims.len() as u64;
        let mut at = 0;
        for (owner, (job, &[a, b, c])) in group.iter().zip(corners.iter()).enumerate() {
            let own = job.sight.triangle;
            let normal = (b - a).cross(c - a);
            let mut breaks = false;
            while owners.get(at) == Some(&(owner as u32)) {
                let (direction, hit) = (aims[at], hits[at]);
                at += 1;
                let Some(hit) = hit else {
                    breaks = true;
                    continue;
                };
                let triangle = space.triangles.of_hit(&hit);
                out.self_hits += u64::from(triangle == own);
                out.see(space, Sight { triangle, origin, direction });
                let gap = direction.length() * normal.dot(a) / normal.dot(direction) - hit.t;
                breaks |= gap.is_nan() || gap.abs() > BREAK * hit.t;
            }
            if breaks {
                out.later.push(*job);
            }
        }
    }
}

/// Points past the middles of those of a triangle's edges that `which` has bits for, by the angle `epsilon`, as seen from
/// the origin; none for an edge seen end-on.
fn middles([a, b, c]: [DVec3; 3], which: u8, epsilon: f64, coarse: f64, points: &mut Vec<DVec3>) {
    let sign = if a.dot(b.cross(c)) > 0.0 { -1.0 } else { 1.0 };
    for (i, [from, to]) in [[a, b], [b, c], [c, a]].into_iter().enumerate() {
        if which >> i & 1 != 0 {
            let middle = (from + to) * 0.5;
            let reach = sign * (epsilon * middle.length()).max(8.0 * coarse);
            points.extend(across(from, to).map(|out| middle + out * reach));
        }
    }
}
