//! The current surface: vertices, faces, and which faces meet at a vertex. Any soup is fine; nothing is assumed of topology.

use crate::original::NONE;
use glam::DVec3;

/// Vertices and faces that pairs of vertices are contracted in.
#[derive(Clone, Debug, Default)]
pub(crate) struct Complex {
    pub points: Vec<DVec3>,
    /// Corners of each face; [`DEAD`] when it is gone.
    pub faces: Vec<[u32; 3]>,
    /// First and last entry of each vertex's list of corners.
    ends: Vec<[u32; 2]>,
    /// Next corner at the same vertex, by `4 · face + corner`.
    next: Vec<u32>,
    pub live: usize,
}

/// A face that is gone.
pub(crate) const DEAD: [u32; 3] = [NONE; 3];

impl Complex {
    /// Faces that repeat a corner or are [`DEAD`] are left out.
    pub(crate) fn new(points: Vec<DVec3>, faces: Vec<[u32; 3]>) -> Self {
        let mut complex = Self { points, faces, ..Self::default() };
        complex.relink();
        complex
    }

    /// Builds the lists of corners from the faces.
    pub(crate) fn relink(&mut self) {
        self.ends.clear();
        self.ends.resize(self.points.len(), [NONE; 2]);
        self.next.clear();
        self.next.resize(4 * self.faces.len(), NONE);
        self.live = 0;
        for f in 0..self.faces.len() {
            let [a, b, c] = self.faces[f];
            if a == NONE {
                continue;
            }
            if a == b || b == c || c == a {
                self.faces[f] = DEAD;
                continue;
            }
            self.live += 1;
            for i in 0..3 {
                self.append(self.faces[f][i], (f as u32) << 2 | i as u32);
            }
        }
    }

    pub(crate) fn bytes(&self) -> usize {
        24 * self.points.capacity()
            + 12 * self.faces.capacity()
            + 8 * self.ends.capacity()
            + 4 * self.next.capacity()
    }

    fn append(&mut self, v: u32, corner: u32) {
        let [first, last] = &mut self.ends[v as usize];
        if *first == NONE {
            *first = corner;
        } else {
            self.next[*last as usize] = corner;
        }
        *last = corner;
        self.next[corner as usize] = NONE;
    }

    /// Corners (`4 · face + corner`) of the live faces at a vertex.
    #[inline]
    pub(crate) fn corners_at(&self, v: u32) -> impl Iterator<Item = u32> + '_ {
        let mut at = self.ends[v as usize][0];
        std::iter::from_fn(move || {
            while at != NONE {
                let corner = at;
                at = self.next[at as usize];
                if self.faces[(corner >> 2) as usize][0] != NONE {
                    return Some(corner);
                }
            }
            None
        })
    }

    pub(crate) fn live_faces(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.faces.len() as u32).filter(|&f| self.faces[f as usize][0] != NONE)
    }

    #[inline]
    pub(crate) fn faces_at(&self, v: u32) -> impl Iterator<Item = u32> + '_ {
        self.corners_at(v).map(|c| c >> 2)
    }

    /// The two other corners of the face, in its order.
    #[inline]
    pub(crate) fn others(&self, corner: u32) -> [u32; 2] {
        let f = self.faces[(corner >> 2) as usize];
        match corner & 3 {
            0 => [f[1], f[2]],
            1 => [f[2], f[0]],
            _ => [f[0], f[1]],
        }
    }

    #[inline]
    pub(crate) fn corners(&self, face: u32) -> [DVec3; 3] {
        self.faces[face as usize].map(|v| self.points[v as usize])
    }

    pub(crate) fn is_isolated(&self, v: u32) -> bool {
        self.corners_at(v).next().is_none()
    }

    /// Moves `v` into `u` and both to `at`. Faces with both corners die.
    pub(crate) fn contract(&mut self, u: u32, v: u32, at: DVec3) {
        let mut list = self.ends[v as usize][0];
        self.ends[v as usize] = [NONE; 2];
        while list != NONE {
            let next = self.next[list as usize];
            let f = (list >> 2) as usize;
            if self.faces[f][0] != NONE {
                if self.faces[f].contains(&u) {
                    self.faces[f] = DEAD;
                    self.live -= 1;
                } else {
                    self.faces[f][(list & 3) as usize] = u;
                    self.append(u, list);
                }
            }
            list = next;
        }
        self.drop_dead_corners(u);
        self.points[u as usize] = at;
    }

    fn drop_dead_corners(&mut self, v: u32) {
        let mut at = self.ends[v as usize][0];
        self.ends[v as usize] = [NONE; 2];
        while at != NONE {
            let next = self.next[at as usize];
            if self.faces[(at >> 2) as usize][0] != NONE {
                self.append(v, at);
            }
            at = next;
        }
    }
}

/// Marks on vertices that are cleared all at once.
#[derive(Clone, Debug, Default)]
pub(crate) struct Marks {
    stamp: Vec<u32>,
    now: u32,
}

impl Marks {
    pub(crate) fn new(len: usize) -> Self {
        Self { stamp: vec![0; len], now: 0 }
    }

    pub(crate) fn bytes(&self) -> usize {
        4 * self.stamp.capacity()
    }

    pub(crate) fn clear(&mut self) {
        self.now = self.now.wrapping_add(1);
        if self.now == 0 {
            self.stamp.fill(0);
            self.now = 1;
        }
    }

    #[inline(always)]
    pub(crate) fn has(&self, i: u32) -> bool {
        self.stamp[i as usize] == self.now
    }

    /// Whether the mark is new.
    #[inline(always)]
    pub(crate) fn set(&mut self, i: u32) -> bool {
        std::mem::replace(&mut self.stamp[i as usize], self.now) != self.now
    }
}

/// The faces around a pair of vertices, read once for everything that is asked before it is contracted.
#[derive(Clone, Debug, Default)]
pub(crate) struct Surroundings {
    u: u32,
    v: u32,
    /// The two other corners of each face, in its order.
    at_u: Vec<[u32; 2]>,
    at_v: Vec<[u32; 2]>,
}

impl Surroundings {
    pub(crate) fn read(&mut self, s: &Complex, u: u32, v: u32) {
        (self.u, self.v) = (u, v);
        for (spokes, x) in [(&mut self.at_u, u), (&mut self.at_v, v)] {
            spokes.clear();
            spokes.extend(s.corners_at(x).map(|corner| s.others(corner)));
        }
    }

    pub(crate) fn bytes(&self) -> usize {
        size_of::<[u32; 2]>() * (self.at_u.capacity() + self.at_v.capacity())
    }

    /// Whether contracting the pair keeps the topology: what the links of `u` and `v` share is the link of their edge (after
    /// Dey, Edelsbrunner, Guha & Nekhayev 1999). At borders, an inner edge between two border vertices does not pass. Neither does what would
    /// leave no face at all.
    pub(crate) fn link_holds(&self) -> bool {
        // Sets of vertices by a bit each of 64: a bit that is not set says no, for certain.
        let bit = |x: u32| 1u64 << (x.wrapping_mul(0x9e37_79b1) >> 26);
        let (mut around_u, mut apexes) = (0u64, 0u64);
        let apex = |spoke: &[u32; 2]| if spoke[0] == self.v { spoke[1] } else { spoke[0] };
        let is_apex = |x: u32| self.at_u.iter().any(|s| s.contains(&self.v) && apex(s) == x);
        let mut shared = 0;
        for (i, spoke) in self.at_u.iter().enumerate() {
            around_u |= bit(spoke[0]) | bit(spoke[1]);
            if spoke.contains(&self.v) {
                let x = apex(spoke);
                let again = |s: &[u32; 2]| s.contains(&self.v) && apex(s) == x;
                if apexes & bit(x) != 0 && self.at_u[..i].iter().any(again) {
                    return false;
                }
                apexes |= bit(x);
                shared += 1;
            }
        }
        if shared == 0 || (self.at_u.len() == shared && self.at_v.iter().all(|s| s.contains(&self.u))) {
            return false;
        }
        for spoke in &self.at_v {
            let [a, b] = *spoke;
            for x in [a, b] {
                let met = x != self.u && around_u & bit(x) != 0 && self.at_u.iter().any(|s| s.contains(&x));
                if met && !(apexes & bit(x) != 0 && is_apex(x)) {
                    return false;
                }
            }
            // The same face on both sides of the edge would be doubled.
            if !spoke.contains(&self.u)
                && apexes & bit(a) != 0
                && apexes & bit(b) != 0
                && is_apex(a)
                && is_apex(b)
                && self.at_u.iter().any(|s| s.contains(&a) && s.contains(&b))
            {
                return false;
            }
        }
        let open = |spokes: &[[u32; 2]]| is_open(spokes.iter().copied());
        shared != 2 || !(open(&self.at_u) && open(&self.at_v))
    }

    /// Whether no face around the pair turns by more than 84° or becomes a needle when both go `to` a place.
    pub(crate) fn keep_orientation(&self, s: &Complex, to: DVec3) -> bool {
        let keep = |spokes: &[[u32; 2]], from: DVec3, other: u32| {
            spokes.iter().filter(|spoke| !spoke.contains(&other)).all(|spoke| {
                let [pa, pb] = spoke.map(|x| s.points[x as usize]);
                let (before, after) = ((pa - from).cross(pb - from), (pa - to).cross(pb - to));
                // A face without area has no orientation to keep.
                let sizes = before.length_squared() * after.length_squared();
                let longest_sq = (pa - to)
                    .length_squared()
                    .max((pb - to).length_squared())
                    .max((pa - pb).length_squared());
                let needle = after.length_squared() * (NEEDLE * NEEDLE) < longest_sq * longest_sq;
                let turn = before.dot(after);
                sizes == 0.0 || !needle && turn > 0.0 && turn * turn > 0.01 * sizes
            })
        };
        keep(&self.at_u, s.points[self.u as usize], self.v)
            && keep(&self.at_v, s.points[self.v as usize], self.u)
    }
}

/// Longest side over height of a needle.
const NEEDLE: f64 = 1e3;

/// Whether a side at `v` has one face only.
pub(crate) fn on_border(s: &Complex, v: u32) -> bool {
    is_open(s.corners_at(v).map(|corner| s.others(corner)))
}

/// Whether a side at the vertex that has faces with these other corners has one face only.
fn is_open(others: impl Iterator<Item = [u32; 2]>) -> bool {
    // Around an inner vertex every neighbour is as often the one before as the one after.
    let mix = |x: u32| u64::from(x).wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    others.fold(0u64, |sum, [a, b]| sum.wrapping_add(mix(a)).wrapping_sub(mix(b))) != 0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Frame;
    use crate::original::Original;
    use farsight_geometry::hard_cases;

    fn ball() -> Complex {
        let mesh = hard_cases::bumpy_ball(4);
        let o = Original::new(&mesh, &Frame::of(&mesh));
        Complex::new(o.points, o.triangles)
    }

    fn is_closed(s: &Complex) -> bool {
        let mut sides: Vec<_> = s
            .faces
            .iter()
            .filter(|f| f[0] != NONE)
            .collect::<Vec<_>>()
            .iter()
            .flat_map(|f| (0..3).map(|i| (f[i], f[(i + 1) % 3])).collect::<Vec<_>>())
            .collect();
        sides.sort_unstable();
        sides.windows(2).all(|w| w[0] != w[1])
            && sides.iter().all(|&(a, b)| sides.binary_search(&(b, a)).is_ok())
    }

    #[test]
    fn a_closed_ball_stays_closed_down_to_a_tetrahedron() {
        let mut s = ball();
        let mut around = Surroundings::default();
        let mut holds = |s: &Complex, u: u32, v: u32| {
            around.read(s, u, v);
            around.link_holds()
        };
        loop {
            let pair = (0..s.points.len() as u32).find_map(|u| {
                let neighbours: Vec<u32> = s.corners_at(u).flat_map(|c| s.others(c)).collect();
                neighbours.into_iter().find(|&v| holds(&s, u, v)).map(|v| (u, v))
            });
            let Some((u, v)) = pair else { break };
            let before = s.live;
            let at = s.points[u as usize];
            s.contract(u, v, at);
            assert_eq!(s.live, before - 2);
            assert!(s.is_isolated(v) && is_closed(&s));
        }
        assert_eq!(s.live, 4);
    }

    #[test]
    fn borders_are_seen() {
        let mut s = ball();
        assert!((0..s.points.len() as u32).all(|v| !on_border(&s, v)));
        let gone = s.faces[7];
        s.faces[7] = DEAD;
        s.relink();
        assert!(gone.iter().all(|&v| on_border(&s, v)));
        assert_eq!((0..s.points.len() as u32).filter(|&v| on_border(&s, v)).count(), 3);
    }
}
