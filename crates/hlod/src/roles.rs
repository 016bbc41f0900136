//! What contractions may do with a vertex: nearly anything, unless it lies on the wall of a cell.
//!
//! Where a surface was cut at a wall, both sides have the same rim. Each side is simplified alone, by its own certificates; but what the
//! rim becomes depends on the rim only, so that both sides come to the same: a few of its vertices are kept, and the others may only
//! go along the rim. Which ones are kept is found here, by Douglas & Peucker's rule, from coordinates relative to each other, which are the
//! same seen from both cells.

use crate::appearance::{Appearance, Look};
use crate::original::{NONE, Original};
use farsight_geometry::TriangleMesh;
use glam::{DVec3, Vec3};

/// Where the vertex that is left by a contraction may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Place {
    Anywhere,
    /// Where the kept vertex is.
    Kept,
    /// At one of both.
    Either,
}

/// What may be done with a vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Role {
    Free,
    /// No contraction at all.
    Locked,
    /// Stays where it is; others may go there.
    Fixed,
    /// Goes along its part of a rim.
    Rim(u32),
}

/// The roles of all vertices.
#[derive(Clone, Debug)]
pub(crate) struct Roles {
    of: Vec<Role>,
    /// The kept vertices at the ends of each part of a rim.
    ends: Vec<[u32; 2]>,
}

/// The box whose sides a surface was cut at, in the coordinates of its mesh.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Walls {
    pub min: Vec3,
    pub max: Vec3,
    /// How far a rim may be from where it was.
    pub tolerance: f64,
    /// How far normals may have been rounded, in radians.
    pub normal_rounding: f32,
}

impl Walls {
    /// Which walls a position lies on, a bit each.
    fn at(&self, p: Vec3) -> u8 {
        let bits = |on: glam::BVec3| on.bitmask() as u8;
        bits(p.cmpeq(self.min)) | bits(p.cmpeq(self.max)) << 3
    }
}

impl Roles {
    pub(crate) fn free(vertices: usize) -> Self {
        Self { of: vec![Role::Free; vertices], ends: Vec::new() }
    }

    /// Whether there are rims to follow.
    pub(crate) fn any_rims(&self) -> bool {
        !self.ends.is_empty()
    }

    pub(crate) fn is_on_rim(&self, v: u32) -> bool {
        matches!(self.of[v as usize], Role::Rim(_))
    }

    pub(crate) fn lock(&mut self, v: u32) {
        self.of[v as usize] = Role::Locked;
    }

    /// The vertex that stays, the one that goes, and where to, if the pair may be contracted at all.
    #[inline]
    pub(crate) fn pair(&self, u: u32, v: u32) -> Option<(u32, u32, Place)> {
        use Role::{Fixed, Free, Rim};
        match (self.of[u as usize], self.of[v as usize]) {
            (Free, Free) => Some((u, v, Place::Anywhere)),
            (Fixed | Rim(_), Free) => Some((u, v, Place::Kept)),
            (Free, Fixed | Rim(_)) => Some((v, u, Place::Kept)),
            (Rim(a), Rim(b)) => (a == b).then_some((u, v, Place::Either)),
            (Fixed, Rim(part)) => self.ends[part as usize].contains(&u).then_some((u, v, Place::Kept)),
            (Rim(part), Fixed) => self.ends[part as usize].contains(&v).then_some((v, u, Place::Kept)),
            _ => None,
        }
    }

    /// Keeps the vertices of rims that both sides of a wall agree on.
    pub(crate) fn add_rims(
        &mut self,
        original: &Original,
        mesh: &TriangleMesh,
        appearance: Option<&Appearance>,
        walls: &Walls,
    ) {
        let position = |v: u32| mesh.positions()[original.vertex[v as usize] as usize];
        let on: Vec<u8> = (0..original.points.len() as u32).map(|v| walls.at(position(v))).collect();
        let mut edges: [Vec<[u32; 2]>; 6] = Default::default();
        for (t, corners) in original.triangles.iter().enumerate() {
            for i in (0..3).filter(|&i| original.neighbours[t][i] == NONE) {
                let (a, b) = (corners[i], corners[(i + 1) % 3]);
                let shared = on[a as usize] & on[b as usize];
                (0..6).filter(|w| shared >> w & 1 != 0).for_each(|w| edges[w].extend([[a, b], [b, a]]));
            }
        }
        let look = |v: u32| appearance.map_or(Look::default(), |a| a.vertex(original.vertex[v as usize]));
        let mut used = vec![false; original.points.len()];
        for edges in &mut edges {
            edges.sort_unstable();
            edges.dedup();
            let mut rim =
                Rim { edges, position: &position, look: &look, appearance, tolerance: walls.tolerance };
            rim.assign(self, &mut used);
        }
    }
}

/// The rim on one wall.
struct Rim<'a> {
    /// Both directions, sorted.
    edges: &'a [[u32; 2]],
    position: &'a dyn Fn(u32) -> Vec3,
    look: &'a dyn Fn(u32) -> Look,
    appearance: Option<&'a Appearance<'a>>,
    tolerance: f64,
}

impl Rim<'_> {
    fn neighbours(&self, v: u32) -> &[[u32; 2]] {
        let first = self.edges.partition_point(|e| e[0] < v);
        let count = self.edges[first..].iter().take_while(|e| e[0] == v).count();
        &self.edges[first..first + count]
    }

    /// Difference of positions: exact, and therefore the same seen from both sides.
    fn between(&self, from: u32, to: u32) -> DVec3 {
        (self.position)(to).as_dvec3() - (self.position)(from).as_dvec3()
    }

    /// Whether `a` comes before `b`, whatever their numbers.
    fn is_before(&self, a: u32, b: u32) -> bool {
        let d = self.between(a, b).to_array();
        d.into_iter().find(|&x| x != 0.0).is_some_and(|x| x > 0.0)
    }

    fn assign(&mut self, roles: &mut Roles, used: &mut [bool]) {
        let mut vertices: Vec<u32> = self.edges.iter().map(|e| e[0]).collect();
        vertices.dedup();
        for &v in &vertices {
            // Where rims meet, on one wall or on several.
            if std::mem::replace(&mut used[v as usize], true) || self.neighbours(v).len() != 2 {
                roles.of[v as usize] = Role::Fixed;
            }
        }
        let mut done = vec![false; vertices.len()];
        let place = |v: u32| vertices.binary_search(&v).expect("a vertex of the rim");
        for &v in &vertices {
            if roles.of[v as usize] == Role::Fixed {
                for &[_, first] in self.neighbours(v) {
                    self.follow(v, first, roles, &mut |v| !std::mem::replace(&mut done[place(v)], true));
                }
            }
        }
        // What is left are closed curves.
        for &v in &vertices {
            if roles.of[v as usize] == Role::Fixed || done[place(v)] {
                continue;
            }
            let mut curve = vec![v];
            let mut at = self.neighbours(v)[0][1];
            while at != v {
                let before = *curve.last().expect("not empty");
                curve.push(at);
                done[place(at)] = true;
                let next = self.neighbours(at);
                at = if next[0][1] == before { next[1][1] } else { next[0][1] };
            }
            done[place(v)] = true;
            self.close(&curve, roles);
        }
    }

    /// Follows a rim from a kept vertex to the next one, unless that was done from there.
    fn follow(&self, from: u32, first: u32, roles: &mut Roles, is_new: &mut dyn FnMut(u32) -> bool) {
        let mut curve = vec![from, first];
        while roles.of[curve[curve.len() - 1] as usize] != Role::Fixed {
            let [before, at] = [curve[curve.len() - 2], curve[curve.len() - 1]];
            if !is_new(at) {
                return;
            }
            let next = self.neighbours(at);
            curve.push(if next[0][1] == before { next[1][1] } else { next[0][1] });
        }
        if curve.len() == 2 {
            return;
        }
        if curve[0] == curve[curve.len() - 1] {
            self.close(&curve[..curve.len() - 1], roles);
        } else {
            self.thin(&curve, roles);
        }
    }

    /// A closed curve: three vertices are kept in any case.
    fn close(&self, curve: &[u32], roles: &mut Roles) {
        if curve.len() <= 3 {
            curve.iter().for_each(|&v| roles.of[v as usize] = Role::Fixed);
            return;
        }
        // A vertex that is kept already, or else the first in space.
        let fixed = (0..curve.len()).find(|&i| roles.of[curve[i] as usize] == Role::Fixed);
        let first = fixed.unwrap_or_else(|| {
            (1..curve.len()).fold(0, |best, i| if self.is_before(curve[i], curve[best]) { i } else { best })
        });
        let at = |i: usize| curve[(first + i) % curve.len()];
        let farthest = |score: &dyn Fn(u32) -> f64| {
            (1..curve.len()).fold(1, |best, i| {
                let (a, b) = (score(at(i)), score(at(best)));
                if a > b || (a == b && self.is_before(at(i), at(best))) { i } else { best }
            })
        };
        let second = farthest(&|v| self.between(at(0), v).length_squared());
        let along = self.between(at(0), at(second));
        let third = farthest(&|v| self.between(at(0), v).cross(along).length_squared());
        let mut cuts = [0, second.min(third), second.max(third), curve.len()];
        if second == third {
            // All on one line: any other vertex.
            cuts[2] = if second + 1 < curve.len() { second + 1 } else { second };
            cuts[1] = if second + 1 < curve.len() { second } else { second - 1 };
        }
        cuts[..3].iter().for_each(|&i| roles.of[at(i) as usize] = Role::Fixed);
        for w in cuts.windows(2) {
            let part: Vec<u32> = (w[0]..=w[1]).map(at).collect();
            self.thin(&part, roles);
        }
    }

    /// Keeps vertices between two kept ones until all others are within the tolerance of the line.
    fn thin(&self, curve: &[u32], roles: &mut Roles) {
        let mut stack = vec![(0, curve.len() - 1)];
        while let Some((i, j)) = stack.pop() {
            if j == i + 1 {
                continue;
            }
            // The same direction from both sides.
            let [a, b] = if self.is_before(curve[i], curve[j]) { [i, j] } else { [j, i] }.map(|k| curve[k]);
            let mut worst = (-1.0, i + 1);
            for k in i + 1..j {
                let off = self.off_sq(a, b, curve[k]);
                if off > worst.0 || (off == worst.0 && self.is_before(curve[k], curve[worst.1])) {
                    worst = (off, k);
                }
            }
            if worst.0 > self.tolerance * self.tolerance {
                roles.of[curve[worst.1] as usize] = Role::Fixed;
                stack.extend([(i, worst.1), (worst.1, j)]);
            } else {
                let part = roles.ends.len() as u32;
                roles.ends.push([curve[i], curve[j]]);
                curve[i + 1..j].iter().for_each(|&v| roles.of[v as usize] = Role::Rim(part));
            }
        }
    }

    /// Squared distance of `v` to the line from `a` to `b`, along it too if it looks different there.
    fn off_sq(&self, a: u32, b: u32, v: u32) -> f64 {
        let (along, x) = (self.between(a, b), self.between(a, v));
        let length_sq = along.length_squared();
        let t = if length_sq > 0.0 { (x.dot(along) / length_sq).clamp(0.0, 1.0) } else { 0.0 };
        let off_sq = (x - along * t).length_squared();
        match self.appearance {
            Some(appearance) => {
                let [a, b, v] = [a, b, v].map(self.look);
                let shift = appearance.shift_on_line([a, b], t as f32, &v, length_sq.sqrt());
                off_sq + shift * shift
            }
            None => off_sq,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Frame;

    /// A strip along x from 0 to 16, its lower rim on a wall and bent; numbered from either end.
    fn strip(backwards: bool) -> (TriangleMesh, Walls) {
        let n = 17;
        let rim = |i: usize| {
            Vec3::new(i as f32, 0.0, if (4..=8).contains(&i) { 0.5 } else { 0.01 * (i % 2) as f32 })
        };
        let mut p: Vec<Vec3> = (0..n).map(rim).chain((0..n).map(|i| Vec3::new(i as f32, 1.0, 0.0))).collect();
        let mut t: Vec<[u32; 3]> = (0..n as u32 - 1)
            .flat_map(|i| [[i, i + 1, n as u32 + i + 1], [i, n as u32 + i + 1, n as u32 + i]])
            .collect();
        if backwards {
            // The neighbour across the wall, its vertices in another order.
            p.iter_mut().for_each(|p| p.y = -p.y);
            p.reverse();
            let last = p.len() as u32 - 1;
            t = t.iter().rev().map(|t| [last - t[0], last - t[2], last - t[1]]).collect();
        }
        let walls = if backwards {
            Walls {
                min: Vec3::new(-9.0, -99.0, -9.0),
                max: Vec3::new(99.0, 0.0, 99.0),
                tolerance: 0.1,
                normal_rounding: 0.0,
            }
        } else {
            Walls {
                min: Vec3::new(-9.0, 0.0, -9.0),
                max: Vec3::new(99.0, 99.0, 99.0),
                tolerance: 0.1,
                normal_rounding: 0.0,
            }
        };
        (TriangleMesh::new(p, t).unwrap(), walls)
    }

    #[test]
    fn both_sides_of_a_wall_keep_the_same_vertices() {
        let kept = |backwards| {
            let (mesh, walls) = strip(backwards);
            let original = Original::new(&mesh, &Frame::of(&mesh));
            let mut roles = Roles::free(original.points.len());
            roles.add_rims(&original, &mesh, None, &walls);
            let mut kept: Vec<[i32; 3]> = (0..original.points.len())
                .filter(|&v| roles.of[v] == Role::Fixed)
                .map(|v| mesh.positions()[original.vertex[v] as usize].to_array().map(|x| (100.0 * x) as i32))
                .collect();
            kept.sort_unstable();
            let rim = roles.of.iter().filter(|r| matches!(r, Role::Rim(_))).count();
            assert_eq!(kept.len() + rim, 17);
            kept
        };
        assert_eq!(kept(false), kept(true));
        assert_eq!(kept(false).len(), 6);
    }

    #[test]
    fn octants_of_a_ball_keep_the_same_vertices() {
        use crate::cell::{Cell, Cube, LocalFrame};
        use crate::cut::Polygons;
        use crate::piece::{Attributes, Piece};
        let ball = farsight_geometry::hard_cases::bumpy_ball(16);
        let cube = Cube::around(&ball.world_bounds());
        let mut all = Polygons::default();
        for c in ball.corner_iter() {
            all.push_triangle(c.map(|p| cube.enter(p.as_dvec3())), None);
        }
        let step = 1 << 15;
        let mut kept: [Vec<[i32; 3]>; 2] = Default::default();
        for (octant, part) in all.split(&Cell::ROOT).into_iter().enumerate() {
            let cell = Cell::ROOT.child(octant as u32);
            let frame = LocalFrame::of(&cell, &cube);
            let piece = Piece::of_polygons(&part, step);
            let mesh = piece.to_mesh(&frame, glam::DVec3::ZERO, Attributes::default()).unwrap();
            let original = Original::new(&mesh, &Frame::of(&mesh));
            let mut roles = Roles::free(original.points.len());
            let walls = Walls {
                min: frame.local(cell.corner()),
                max: frame.local(cell.corner().map(|m| m + cell.edge())),
                tolerance: 0.003,
                normal_rounding: 0.0,
            };
            roles.add_rims(&original, &mesh, None, &walls);
            for v in (0..original.points.len()).filter(|&v| roles.of[v] == Role::Fixed) {
                let at = frame.lattice(mesh.positions()[original.vertex[v] as usize], step);
                if at[0] == Cell::ROOT.middle()[0] {
                    kept[octant & 1].push(at);
                }
            }
        }
        kept.iter_mut().for_each(|k| k.sort_unstable());
        assert!(kept[0].len() > 10);
        assert_eq!(kept[0], kept[1]);
    }

    #[test]
    fn pairs_follow_their_rim() {
        let roles = Roles {
            of: vec![
                Role::Free,
                Role::Fixed,
                Role::Rim(0),
                Role::Rim(0),
                Role::Rim(1),
                Role::Fixed,
                Role::Locked,
            ],
            ends: vec![[1, 7], [5, 7]],
        };
        assert_eq!(roles.pair(0, 1), Some((1, 0, Place::Kept)));
        assert_eq!(roles.pair(2, 3), Some((2, 3, Place::Either)));
        assert_eq!(roles.pair(3, 1), Some((1, 3, Place::Kept)));
        for (u, v) in [(2, 4), (1, 5), (5, 2), (4, 1), (0, 6), (6, 1)] {
            assert_eq!(roles.pair(u, v), None, "{u} {v}");
        }
    }
}
