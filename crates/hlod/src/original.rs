//! The surface that a result is compared with: welded, sorted along a curve that keeps neighbours together, each triangle with its neighbours.

use crate::frame::Frame;
use farsight_geometry::TriangleMesh;
use farsight_geometry::mesh::weld_points;
use glam::DVec3;

/// No triangle, no vertex.
pub(crate) const NONE: u32 = u32::MAX;

/// The input surface.
#[derive(Clone, Debug, Default)]
pub(crate) struct Original {
    pub points: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
    /// Across the side from corner i to corner i + 1; [`NONE`] at borders and wherever not exactly two triangles
    /// with opposite directions meet.
    pub neighbours: Vec<[u32; 3]>,
    /// Index in the mesh of each triangle.
    pub source: Vec<u32>,
    /// Triangles that repeat a corner, and are no part of another one: segments and points that belong to the surface but have
    /// no side.
    pub lines: Vec<[u32; 3]>,
    /// A vertex of the mesh at each point.
    pub vertex: Vec<u32>,
    /// Vertices merged into another at the same position.
    pub welded: usize,
    /// Triangles dropped because an equal one, with the same side up, is there.
    pub doubled: usize,
}

impl Original {
    pub(crate) fn new(mesh: &TriangleMesh, frame: &Frame) -> Self {
        let (id_of, first) = weld_points(mesh.positions());
        let place = |id: u32| frame.enter(mesh.positions()[first[id as usize] as usize]);
        let mut keyed: Vec<(u64, u32)> = Vec::with_capacity(mesh.triangles().len());
        let mut lines = Vec::new();
        for (i, t) in mesh.triangles().iter().enumerate() {
            let [a, b, c] = t.map(|v| id_of[v as usize]);
            if a == b || b == c || c == a {
                lines.push([a, b, c]);
            } else {
                keyed.push((morton((place(a) + place(b) + place(c)) / 3.0), i as u32));
            }
        }
        keyed.sort_unstable();
        let mut new_id = vec![NONE; first.len()];
        let mut points = Vec::with_capacity(first.len());
        let mut vertex = Vec::with_capacity(first.len());
        let mut number = |id: u32| {
            let new = &mut new_id[id as usize];
            if *new == NONE {
                *new = points.len() as u32;
                points.push(place(id));
                vertex.push(first[id as usize]);
            }
            *new
        };
        let mut source: Vec<u32> = keyed.iter().map(|&(_, i)| i).collect();
        let corners = |i: u32| mesh.triangles()[i as usize].map(|v| id_of[v as usize]);
        let mut triangles: Vec<[u32; 3]> = source.iter().map(|&i| corners(i).map(&mut number)).collect();
        let mut lines: Vec<[u32; 3]> = lines.into_iter().map(|l| l.map(&mut number)).collect();
        let before = triangles.len();
        let mut sides = sides_of(&triangles, points.len());
        if drop_doubles(&mut triangles, &mut source, &sides) {
            sides = sides_of(&triangles, points.len());
        }
        let neighbours = neighbours(&triangles, &sides);
        keep_bare_lines(&mut lines, &triangles, &sides);
        Self {
            doubled: before - triangles.len(),
            welded: id_of.len() - first.len(),
            points,
            vertex,
            neighbours,
            triangles,
            source,
            lines,
        }
    }

    pub(crate) fn bytes(&self) -> usize {
        let per_triangle = 12 + 12 + 4;
        28 * self.points.capacity() + per_triangle * self.triangles.capacity() + 12 * self.lines.capacity()
    }

    #[inline(always)]
    pub(crate) fn corners(&self, t: u32) -> [DVec3; 3] {
        self.triangles[t as usize].map(|v| self.points[v as usize])
    }
}

/// Position along a curve through the frame's cube.
pub(crate) fn morton(p: DVec3) -> u64 {
    let spread = |x: f64| {
        let mut v = ((x * 0.5 + 0.5) * f64::from(1 << 20)) as u64 & 0xf_ffff;
        v = (v | v << 32) & 0x1f_0000_0000_ffff;
        v = (v | v << 16) & 0x1f_0000_ff00_00ff;
        v = (v | v << 8) & 0x100f_00f0_0f00_f00f;
        v = (v | v << 4) & 0x10c3_0c30_c30c_30c3;
        (v | v << 2) & 0x1249_2492_4924_9249
    };
    spread(p.x) | spread(p.y) << 1 | spread(p.z) << 2
}

/// All sides as (smaller vertex, larger vertex, 4 · triangle + side), sorted.
fn sides_of(triangles: &[[u32; 3]], vertices: usize) -> Vec<(u64, u32)> {
    // By counting those of each smaller vertex: there are few.
    let ends = |c: &[u32; 3], i: usize| (c[i].min(c[(i + 1) % 3]), c[i].max(c[(i + 1) % 3]));
    let mut next = vec![0u32; vertices + 1];
    for c in triangles {
        (0..3).for_each(|i| next[ends(c, i).0 as usize + 1] += 1);
    }
    for v in 0..vertices {
        next[v + 1] += next[v];
    }
    let mut sides = vec![(0, 0); 3 * triangles.len()];
    for (t, c) in triangles.iter().enumerate() {
        for i in 0..3 {
            let (low, high) = ends(c, i);
            sides[next[low as usize] as usize] =
                (u64::from(low) << 32 | u64::from(high), (t as u32) << 2 | i as u32);
            next[low as usize] += 1;
        }
    }
    let mut first = 0;
    for &end in &next[..vertices] {
        sides[first..end as usize].sort_unstable();
        first = end as usize;
    }
    sides
}

/// Drops triangles that repeat an earlier one; returns whether there were any.
fn drop_doubles(triangles: &mut Vec<[u32; 3]>, source: &mut Vec<u32>, sides: &[(u64, u32)]) -> bool {
    // A double shares all its sides with its like, so that at least three triangles meet there or two go the same way.
    let mut suspects: Vec<([u32; 3], u32)> = Vec::new();
    for users in sides.chunk_by(|a, b| a.0 == b.0) {
        let same_way = users.len() == 2 && {
            let from = |u: u32| triangles[(u >> 2) as usize][(u & 3) as usize];
            from(users[0].1) == from(users[1].1)
        };
        if users.len() > 2 || same_way {
            for &(_, user) in users {
                let [a, b, c] = triangles[(user >> 2) as usize];
                // The same cycle, the smallest vertex first.
                let cycle = if a < b && a < c {
                    [a, b, c]
                } else if b < c {
                    [b, c, a]
                } else {
                    [c, a, b]
                };
                suspects.push((cycle, user >> 2));
            }
        }
    }
    suspects.sort_unstable();
    suspects.dedup();
    let mut dropped = vec![];
    for same in suspects.chunk_by(|a, b| a.0 == b.0) {
        dropped.extend(same[1..].iter().map(|s| s.1));
    }
    if dropped.is_empty() {
        return false;
    }
    dropped.sort_unstable();
    let keep = |i: usize| dropped.binary_search(&(i as u32)).is_err();
    let mut i = 0;
    triangles.retain(|_| (keep(i), i += 1).0);
    i = 0;
    source.retain(|_| (keep(i), i += 1).0);
    true
}

/// Drops lines that are a side or a corner of a triangle, and repeated ones.
fn keep_bare_lines(lines: &mut Vec<[u32; 3]>, triangles: &[[u32; 3]], sides: &[(u64, u32)]) {
    if lines.is_empty() {
        return;
    }
    let mut corners: Vec<u32> = triangles.iter().flatten().copied().collect();
    corners.sort_unstable();
    for line in lines.iter_mut() {
        line.sort_unstable();
    }
    lines.retain(|&[a, _, c]| {
        let side = u64::from(a) << 32 | u64::from(c);
        let on_side = sides.binary_search_by_key(&side, |s| s.0).is_ok();
        let is_corner = a == c && corners.binary_search(&a).is_ok();
        !(on_side || is_corner)
    });
    lines.sort_unstable();
    // Two equal corners and a third: the middle one does not matter.
    lines.dedup_by_key(|l| (l[0], l[2]));
}

fn neighbours(triangles: &[[u32; 3]], sides: &[(u64, u32)]) -> Vec<[u32; 3]> {
    let mut neighbours = vec![[NONE; 3]; triangles.len()];
    for users in sides.chunk_by(|a, b| a.0 == b.0) {
        if let [(_, x), (_, y)] = *users {
            let ((t, i), (u, j)) =
                (((x >> 2) as usize, (x & 3) as usize), ((y >> 2) as usize, (y & 3) as usize));
            if triangles[t][i] != triangles[u][j] && t != u {
                neighbours[t][i] = u as u32;
                neighbours[u][j] = t as u32;
            }
        }
    }
    neighbours
}

#[cfg(test)]
mod tests {
    use super::*;
    use farsight_geometry::hard_cases;
    use glam::Vec3;

    fn of(mesh: &TriangleMesh) -> Original {
        Original::new(mesh, &Frame::of(mesh))
    }

    #[test]
    fn neighbours_are_mutual_and_share_their_side() {
        for hard in hard_cases::meshes() {
            let o = of(&hard.mesh);
            let kept = o.triangles.len() + o.lines.len() + o.doubled;
            assert!(kept <= hard.mesh.triangles().len(), "{}", hard.name);
            for (t, n) in o.neighbours.iter().enumerate() {
                for i in (0..3).filter(|&i| n[i] != NONE) {
                    let j = (0..3).find(|&j| o.neighbours[n[i] as usize][j] == t as u32);
                    let Some(j) = j else { panic!("{}: not mutual", hard.name) };
                    let (c, d) = (o.triangles[t], o.triangles[n[i] as usize]);
                    let same = (0..3).any(|j| c[i] == d[(j + 1) % 3] && c[(i + 1) % 3] == d[j]);
                    assert!(same, "{} {j}", hard.name);
                }
            }
        }
        let ball = of(&hard_cases::bumpy_ball(5));
        assert!(ball.neighbours.iter().flatten().all(|&n| n != NONE));
    }

    #[test]
    fn doubles_go_and_backs_stay() {
        let p = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::X];
        let t = vec![[0, 1, 2], [1, 2, 0], [2, 1, 0], [0, 3, 2], [1, 3, 0]];
        let o = of(&TriangleMesh::new(p, t).unwrap());
        // The line from 1 to 0 is a side, so that nothing of it is lost.
        assert_eq!((o.triangles.len(), o.doubled, o.welded, o.lines.len()), (2, 2, 1, 0));
        let p = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
        let bare = of(&TriangleMesh::new(p, vec![[0, 1, 1], [1, 0, 0], [2, 2, 2]]).unwrap());
        assert_eq!(bare.lines.len(), 2);
        // The kept double is the first one in the input.
        assert_eq!(
            {
                let mut s = o.source.clone();
                s.sort_unstable();
                s
            },
            vec![0, 2]
        );
    }
}
