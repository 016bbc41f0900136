//! Quick contractions by quadrics, with a log from which each can be taken back.
//!
//! Nothing is certain here: the quadric of a vertex is a mean of squared distances to planes and bounds no maximum. What
//! comes out is a good guess that [`certify`](crate::certify) checks and mends.

use crate::complex::{Complex, Marks, Surroundings};
use crate::frame::Frame;
use crate::original::{NONE, Original};
use crate::quadric::Quadric;
use crate::roles::{Place, Roles};
use glam::DVec3;

/// When a quick contraction is accepted.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FastLimits {
    /// Root of the mean squared distance to the planes of the original triangles.
    pub rms: f64,
    /// Original vertices in one; bounds what taking back costs.
    pub members: u32,
}

/// What a contraction replaced, so that it can be taken back.
#[derive(Clone, Copy, Debug)]
struct Entry {
    removed: u32,
    /// Earlier contraction into the same vertex.
    earlier: u32,
    /// Where the vertex was before.
    was: DVec3,
}

/// The log of contractions.
#[derive(Clone, Debug)]
pub(crate) struct Log {
    /// The vertex that each was contracted into, or itself.
    parent: Vec<u32>,
    /// Last contraction into each vertex.
    latest: Vec<u32>,
    members: Vec<u32>,
    entries: Vec<Entry>,
}

impl Log {
    pub(crate) fn new(vertices: usize) -> Self {
        Self {
            parent: (0..vertices as u32).collect(),
            latest: vec![NONE; vertices],
            members: vec![1; vertices],
            entries: Vec::new(),
        }
    }

    fn record(&mut self, kept: u32, removed: u32, was: DVec3) {
        self.parent[removed as usize] = kept;
        self.members[kept as usize] += self.members[removed as usize];
        let earlier = std::mem::replace(&mut self.latest[kept as usize], self.entries.len() as u32);
        self.entries.push(Entry { removed, earlier, was });
    }

    /// The vertex that stands for an original one now.
    #[inline]
    pub(crate) fn representative(&self, mut v: u32) -> u32 {
        while self.parent[v as usize] != v {
            v = self.parent[v as usize];
        }
        v
    }

    /// Whether the vertex is an original one, where it was.
    #[inline]
    pub(crate) fn is_single(&self, v: u32) -> bool {
        self.members[v as usize] == 1
    }

    /// Original vertices in one.
    pub(crate) fn members_of(&self, v: u32) -> u32 {
        self.members[v as usize]
    }

    /// Takes back the last contraction into `v`; returns the vertex that is free again.
    pub(crate) fn take_back(&mut self, v: u32, points: &mut [DVec3]) -> Option<u32> {
        let entry = *self.entries.get(self.latest[v as usize] as usize)?;
        self.latest[v as usize] = entry.earlier;
        points[v as usize] = entry.was;
        self.parent[entry.removed as usize] = entry.removed;
        self.members[v as usize] -= self.members[entry.removed as usize];
        Some(entry.removed)
    }
}

/// Area-weighted quadrics of all vertices, borders included.
pub(crate) fn quadrics(original: &Original) -> Vec<Quadric> {
    let mut quadrics = vec![Quadric::default(); original.points.len()];
    for (t, triangle) in original.triangles.iter().enumerate() {
        let corners = original.corners(t as u32);
        let cross = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let Some(normal) = cross.try_normalize() else { continue };
        let q = Quadric::plane(normal, corners[0], cross.length() * 0.5);
        for &v in triangle {
            quadrics[v as usize].add(&q);
        }
        for i in (0..3).filter(|&i| original.neighbours[t][i] == NONE) {
            let (a, b) = (corners[i], corners[(i + 1) % 3]);
            if let Some(q) = border_quadric(a, b, normal) {
                quadrics[triangle[i] as usize].add(&q);
                quadrics[triangle[(i + 1) % 3] as usize].add(&q);
            }
        }
    }
    quadrics
}

/// The plane through a border's edge that stands on its face, weighted by the length squared.
pub(crate) fn border_quadric(a: DVec3, b: DVec3, normal: DVec3) -> Option<Quadric> {
    let wall = (b - a).cross(normal).try_normalize()?;
    let mut q = Quadric::plane(wall, a, a.distance_squared(b));
    // Mean distances are over area: a border's part does not count as such.
    q.weight = 0.0;
    Some(q)
}

/// Vertices whose pairs are looked at together: few enough that all that is known of them stays in the cache.
const BLOCK: usize = 1024;

/// One possible contraction.
#[derive(Clone, Copy)]
struct Candidate {
    /// Stays.
    u: u32,
    v: u32,
    at: DVec3,
}

/// The size of a cost, in half powers of two.
fn half_powers(cost: f64) -> u16 {
    ((cost as f32).to_bits() >> 22) as u16
}

/// Sorts by the size of costs, neighbours together within: that is faster to go through than the order of the costs themselves, and no worse.
#[derive(Default)]
struct Order {
    costs: Vec<u16>,
    sorted: Vec<u32>,
}

impl Order {
    fn sorted(&mut self) -> &[u32] {
        let mut next = [0u32; 513];
        self.costs.iter().for_each(|&c| next[c as usize + 1] += 1);
        (1..next.len()).for_each(|c| next[c] += next[c - 1]);
        self.sorted.resize(self.costs.len(), 0);
        for (i, &c) in self.costs.iter().enumerate() {
            self.sorted[next[c as usize] as usize] = i as u32;
            next[c as usize] += 1;
        }
        &self.sorted
    }
}

/// Contracts until nothing is left within the limits, as far as the vertices' roles allow.
pub(crate) fn contract_fast(
    original: &Original,
    frame: &Frame,
    s: &mut Complex,
    roles: &Roles,
    limits: FastLimits,
) -> Log {
    let mut log = Log::new(s.points.len());
    let mut quadrics = quadrics(original);
    let mut around = Surroundings::default();
    let mut touched = Marks::new(s.points.len());
    let mut candidates: Vec<Candidate> = Vec::new();
    let mut order = Order::default();
    let mut neighbours: Vec<u32> = Vec::new();
    let mut alive: Vec<u32> = (0..s.points.len() as u32).filter(|&v| !s.is_isolated(v)).collect();
    loop {
        touched.clear();
        let mut contracted = 0;
        for block in alive.chunks(BLOCK) {
            candidates.clear();
            order.costs.clear();
            for &u in block {
                if touched.has(u) {
                    continue;
                }
                neighbours.clear();
                for corner in s.corners_at(u) {
                    for v in s.others(corner) {
                        if v > u && !touched.has(v) && !neighbours.contains(&v) {
                            neighbours.push(v);
                            let members = log.members[u as usize] + log.members[v as usize];
                            if members <= limits.members
                                && let Some((u, v, rule)) = roles.pair(u, v)
                                && let Some((cost, at)) = place(s, &quadrics, u, v, rule, limits.rms)
                            {
                                order.costs.push(half_powers(cost));
                                candidates.push(Candidate { u, v, at });
                            }
                        }
                    }
                }
            }
            for &next in order.sorted() {
                let Candidate { u, v, at } = candidates[next as usize];
                if touched.has(u) || touched.has(v) {
                    continue;
                }
                around.read(s, u, v);
                if !around.link_holds() || !around.keep_orientation(s, at) {
                    continue;
                }
                let was = s.points[u as usize];
                s.contract(u, v, frame.snap(at));
                log.record(u, v, was);
                let q = quadrics[v as usize];
                quadrics[u as usize].add(&q);
                touched.set(u);
                touched.set(v);
                contracted += 1;
            }
        }
        alive.retain(|&v| !s.is_isolated(v));
        // Passes that change less than a fortieth cost more than they bring.
        if contracted * 40 < alive.len().max(40) {
            return log;
        }
    }
}

/// Cost and place of a contraction within the limit.
fn place(s: &Complex, quadrics: &[Quadric], u: u32, v: u32, rule: Place, rms: f64) -> Option<(f64, DVec3)> {
    let mut q = quadrics[u as usize];
    q.add(&quadrics[v as usize]);
    let (a, b) = (s.points[u as usize], s.points[v as usize]);
    let middle = (a + b) * 0.5;
    let limit = rms * rms * q.weight;
    let at = match rule {
        Place::Anywhere => {
            let mut pulled = q;
            pulled.pull(middle, 1e-3 * q.trace());
            pulled.minimum().unwrap_or(middle)
        }
        Place::Kept => a,
        Place::Either if q.at(b) < q.at(a) => b,
        Place::Either => a,
    };
    let cost = q.at(at);
    // Far away from both ends, planes say little about the surface.
    let reach_sq = a.distance_squared(b);
    let near = at.distance_squared(middle) <= 4.0 * reach_sq;
    (near && cost <= limit).then_some((cost + 1e-6 * reach_sq * q.weight, at))
}

#[cfg(test)]
mod tests {
    use super::*;
    use farsight_geometry::hard_cases;

    #[test]
    fn taking_everything_back_leads_to_the_original() {
        let mesh = hard_cases::bumpy_ball(10);
        let frame = Frame::of(&mesh);
        let o = Original::new(&mesh, &frame);
        let mut s = Complex::new(o.points.clone(), o.triangles.clone());
        let roles = Roles::free(o.points.len());
        let mut log = contract_fast(&o, &frame, &mut s, &roles, FastLimits { rms: 0.02, members: 16 });
        assert!(s.live < o.triangles.len() / 3, "{} of {}", s.live, o.triangles.len());
        assert!((0..o.points.len()).all(|v| log.members[v] <= 16));
        for v in 0..o.points.len() as u32 {
            let mut free = vec![v];
            while let Some(v) = free.pop() {
                while let Some(w) = log.take_back(v, &mut s.points) {
                    free.push(w);
                }
            }
        }
        assert_eq!(s.points, o.points);
        assert!((0..o.points.len() as u32).all(|v| log.representative(v) == v && log.is_single(v)));
    }
}
