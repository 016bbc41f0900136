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

/// Two sets of marks for [`link_holds`].
#[derive(Clone, Debug)]
pub(crate) struct LinkMarks {
    around_u: Marks,
    apexes: Marks,
}

impl LinkMarks {
    pub(crate) fn bytes(&self) -> usize {
        self.around_u.bytes() + self.apexes.bytes()
    }

    pub(crate) fn new(vertices: usize) -> Self {
        Self { around_u: Marks::new(vertices), apexes: Marks::new(vertices) }
    }
}

/// Whether contracting the pair keeps the topology: what the links of `u` and `v` share is the link of their edge (after
/// Dey, Edelsbrunner, Guha & Nekhayev 1999). At borders, an inner edge between two border vertices does not pass. Neither does what would leave
/// no face at all.
pub(crate) fn link_holds(s: &Complex, u: u32, v: u32, marks: &mut LinkMarks) -> bool {
    marks.around_u.clear();
    marks.apexes.clear();
    let mut shared = 0;
    for corner in s.corners_at(u) {
        let [a, b] = s.others(corner);
        marks.around_u.set(a);
        marks.around_u.set(b);
        if a == v || b == v {
            shared += 1;
            if !marks.apexes.set(if a == v { b } else { a }) {
                return false;
            }
        }
    }
    let others_at = |x: u32, y: u32| s.corners_at(x).filter(|&c| !s.others(c).contains(&y)).count();
    if shared == 0 || (others_at(u, v) == 0 && others_at(v, u) == 0) {
        return false;
    }
    for corner in s.corners_at(v) {
        let [a, b] = s.others(corner);
        for x in [a, b] {
            if x != u && marks.around_u.has(x) && !marks.apexes.has(x) {
                return false;
            }
        }
        // The same face on both sides of the edge would be doubled.
        let closes = a != u && b != u && marks.apexes.has(a) && marks.apexes.has(b);
        if closes && s.corners_at(u).any(|c| s.others(c) == [b, a] || s.others(c) == [a, b]) {
            return false;
        }
    }
    shared != 2 || !(on_border(s, u) && on_border(s, v))
}

/// Whether a side at `v` has one face only.
pub(crate) fn on_border(s: &Complex, v: u32) -> bool {
    // Around an inner vertex every neighbour is as often the one before as the one after.
    let mut balance: u64 = 0;
    let mix = |x: u32| u64::from(x).wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    for corner in s.corners_at(v) {
        let [a, b] = s.others(corner);
        balance = balance.wrapping_add(mix(a)).wrapping_sub(mix(b));
    }
    balance != 0
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
        let mut marks = LinkMarks::new(s.points.len());
        loop {
            let pair = (0..s.points.len() as u32).find_map(|u| {
                let neighbours: Vec<u32> = s.corners_at(u).flat_map(|c| s.others(c)).collect();
                neighbours.into_iter().find(|&v| link_holds(&s, u, v, &mut marks)).map(|v| (u, v))
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
