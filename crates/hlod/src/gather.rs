//! Joining the meshes of cells to one surface again.
//!
//! What was equal on both sides of a wall is one after merging equal vertices. Elsewhere (where one cell is a leaf and its neighbour is simplified, or a rim
//! could not become what the other side made of it) there is a crack, no wider than the errors of both sides together. It is closed by
//! moving vertices onto each other, or into sides of the other rim, which are divided there (the pairs of vertices, and of vertex and edge, of
//! Borodin, Gumhold, Guthe & Klein 2003). The way that is moved adds to the error. What is left is [filled](fill).

mod fill;

use crate::appearance::Look;
use crate::cell::{Cell, Lattice, place};
use crate::piece::{Piece, Vertices};
use glam::DVec3;

/// A mesh to join, with the bound of its error in units.
pub(crate) struct Part {
    pub piece: Piece,
    pub error: f64,
}

/// The whole.
pub(crate) struct Gathered {
    pub piece: Piece,
    /// The largest error of a part, what it was moved by included, in units.
    pub error: f64,
    /// Vertices moved onto others or into sides.
    pub joined: u64,
}

/// A triangle being joined.
#[derive(Clone, Copy)]
struct Face {
    points: [u32; 3],
    looks: [Look; 3],
    part: u32,
    /// How far it was moved, at most.
    moved: f64,
}

/// An open side on a wall: from corner `side` of a face to the next.
#[derive(Clone, Copy)]
struct Open {
    face: u32,
    side: u8,
}

/// Joins the meshes of the cells below `cell`, down to `levels` levels below it. No triangle is moved by more than `farthest`, in units; cracks that
/// would need more stay.
pub(crate) fn gather(cell: &Cell, levels: u32, parts: Vec<Part>, farthest: f64) -> Gathered {
    let mut join = Join::new(parts, farthest);
    let parts_per_edge = 1 << levels;
    let step = cell.edge() / parts_per_edge;
    let walls =
        || (0..3).flat_map(|axis| (1..parts_per_edge).map(move |i| (axis, cell.corner()[axis] + i * step)));
    walls().for_each(|(axis, wall)| join.close(axis, wall));
    // Sides may lie on two walls.
    let mut left: Vec<Open> = walls().flat_map(|(axis, wall)| join.open_sides(axis, wall)).collect();
    left.sort_unstable_by_key(|o| (o.face, o.side));
    left.dedup_by_key(|o| (o.face, o.side));
    join.fill(&left);
    join.finish()
}

struct Join {
    at: Vec<Lattice>,
    faces: Vec<Face>,
    with_looks: bool,
    errors: Vec<f64>,
    farthest: f64,
    joined: u64,
}

impl Join {
    fn new(parts: Vec<Part>, farthest: f64) -> Self {
        let mut vertices = Vertices::default();
        let with_looks = parts.iter().any(|p| !p.piece.looks.is_empty());
        let mut join = Self {
            at: Vec::new(),
            faces: Vec::new(),
            with_looks,
            errors: parts.iter().map(|p| p.error).collect(),
            farthest,
            joined: 0,
        };
        for (i, Part { piece, .. }) in parts.into_iter().enumerate() {
            let ids: Vec<u32> = piece.at.iter().map(|&p| vertices.add(p, None)).collect();
            for t in &piece.triangles {
                let looks = t.map(|v| piece.looks.get(v as usize).copied().unwrap_or_default());
                join.faces.push(Face {
                    points: t.map(|v| ids[v as usize]),
                    looks,
                    part: i as u32,
                    moved: 0.0,
                });
            }
        }
        join.at = vertices.at;
        join
    }

    fn place(&self, v: u32) -> DVec3 {
        place(self.at[v as usize])
    }

    fn distance(&self, a: u32, b: u32) -> f64 {
        self.place(a).distance(self.place(b))
    }

    /// Sides on a wall that only one face has.
    fn open_sides(&self, axis: usize, wall: i32) -> Vec<Open> {
        let on = |v: u32| self.at[v as usize][axis] == wall;
        let mut sides: Vec<(u32, u32, Open)> = Vec::new();
        for (f, face) in self.faces.iter().enumerate() {
            for i in 0..3 {
                let (a, b) = (face.points[i], face.points[(i + 1) % 3]);
                if a != b && on(a) && on(b) {
                    sides.push((a.min(b), a.max(b), Open { face: f as u32, side: i as u8 }));
                }
            }
        }
        sides.sort_unstable_by_key(|s| (s.0, s.1, s.2.face));
        let alone = sides.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)).filter(|same| same.len() == 1);
        alone.map(|same| same[0].2).collect()
    }

    fn ends(&self, open: Open) -> [u32; 2] {
        let face = &self.faces[open.face as usize];
        [face.points[open.side as usize], face.points[(open.side as usize + 1) % 3]]
    }

    /// Closes what is open on a wall, as far as the errors of both sides explain it.
    fn close(&mut self, axis: usize, wall: i32) {
        let open = self.open_sides(axis, wall);
        if open.is_empty() {
            return;
        }
        self.merge_vertices(&open);
        // One side of a face a round.
        for _ in 0..3 {
            let open = self.open_sides(axis, wall);
            if !self.divide_sides(&open) {
                break;
            }
        }
    }

    /// The part of each open vertex, by place along an axis; a vertex of several parts has several entries.
    fn open_vertices(&self, open: &[Open], along: usize) -> Vec<(i32, u32, u32)> {
        let mut vertices: Vec<(i32, u32, u32)> = Vec::new();
        for &o in open {
            let part = self.faces[o.face as usize].part;
            vertices.extend(self.ends(o).map(|v| (self.at[v as usize][along], v, part)));
        }
        vertices.sort_unstable();
        vertices.dedup();
        vertices
    }

    /// Moves vertices that are each other's nearest of another part: the one with the larger error goes.
    fn merge_vertices(&mut self, open: &[Open]) {
        let along = self.longest_axis(open);
        let vertices = self.open_vertices(open, along);
        let shared = |v: u32| vertices.iter().filter(|x| x.1 == v).count() > 1;
        let nearest: Vec<Option<usize>> = vertices
            .iter()
            .map(|&(x, v, part)| {
                let limit = |other: u32| self.widest(part, other);
                let window = self.farthest.ceil() as i32;
                let first = vertices.partition_point(|o| o.0 < x.saturating_sub(window));
                let near = (first..vertices.len()).take_while(|&i| vertices[i].0 <= x.saturating_add(window));
                near.filter(|&i| vertices[i].2 != part && vertices[i].1 != v)
                    .map(|i| (self.distance(v, vertices[i].1), i))
                    .filter(|&(d, i)| d <= limit(vertices[i].2))
                    .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
                    .map(|(_, i)| i)
            })
            .collect();
        let mut target: Vec<(u32, u32)> = Vec::new();
        for (i, &(_, v, part)) in vertices.iter().enumerate() {
            let Some(j) = nearest[i] else { continue };
            // One of a pair is looked at; vertices that join parts already stay where they are.
            if nearest[j] != Some(i) || i > j || shared(v) || shared(vertices[j].1) {
                continue;
            }
            let (_, w, other) = vertices[j];
            let goes = self.errors[part as usize] >= self.errors[other as usize];
            target.push(if goes { (v, w) } else { (w, v) });
        }
        target.sort_unstable();
        let ways: Vec<f64> = target.iter().map(|&(from, to)| self.distance(from, to)).collect();
        let moves = |v: &u32| target.binary_search_by_key(v, |t| t.0).ok();
        // Not what was moved before, if that would be too much together.
        let mut may = vec![true; target.len()];
        for face in &self.faces {
            let way: f64 = face.points.iter().filter_map(moves).map(|i| ways[i]).sum();
            if face.moved + way > self.farthest {
                face.points.iter().filter_map(moves).for_each(|i| may[i] = false);
            }
        }
        self.joined += may.iter().filter(|m| **m).count() as u64;
        for face in &mut self.faces {
            for v in &mut face.points {
                if let Some(i) = moves(v).filter(|&i| may[i]) {
                    *v = target[i].1;
                    face.moved += ways[i];
                }
            }
        }
    }

    /// The widest crack between two parts that is closed.
    fn widest(&self, part: u32, other: u32) -> f64 {
        (self.errors[part as usize] + self.errors[other as usize] + 2.0).min(self.farthest)
    }

    fn longest_axis(&self, open: &[Open]) -> usize {
        let mut low = [i32::MAX; 3];
        let mut high = [i32::MIN; 3];
        for v in open.iter().flat_map(|&o| self.ends(o)) {
            for k in 0..3 {
                low[k] = low[k].min(self.at[v as usize][k]);
                high[k] = high[k].max(self.at[v as usize][k]);
            }
        }
        (0..3).max_by_key(|&k| i64::from(high[k]) - i64::from(low[k])).unwrap_or(0)
    }

    /// Divides open sides at vertices of other parts that lie beside them, one side a face; whether there was any.
    fn divide_sides(&mut self, open: &[Open]) -> bool {
        let along = self.longest_axis(open);
        let vertices = self.open_vertices(open, along);
        let mut divided: Vec<(Open, f64, Vec<u32>)> = Vec::new();
        for &o in open {
            let [p, q] = self.ends(o).map(|v| self.at[v as usize][along]);
            let window = self.farthest.ceil() as i32;
            let (low, high) = (p.min(q).saturating_sub(window), p.max(q).saturating_add(window));
            let first = vertices.partition_point(|v| v.0 < low);
            let near = vertices[first..].iter().take_while(|v| v.0 <= high);
            let mut inside: Vec<(f64, f64, u32)> =
                near.filter_map(|&(_, v, part)| self.beside(o, v, part)).collect();
            inside.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.2.cmp(&b.2)));
            inside.dedup_by_key(|i| i.2);
            if !inside.is_empty() {
                let moved = inside.iter().fold(0.0f64, |m, i| m.max(i.1));
                divided.push((o, moved, inside.into_iter().map(|i| i.2).collect()));
            }
        }
        divided.sort_unstable_by_key(|d| (d.0.face, d.0.side));
        divided.dedup_by_key(|d| d.0.face);
        for (o, moved, inside) in &divided {
            self.joined += inside.len() as u64;
            self.faces[o.face as usize].moved += moved;
            self.fan(*o, inside);
        }
        !divided.is_empty()
    }

    /// Where along an open side a vertex of another part lies, and how far from it, if it is inside and no farther than both errors.
    fn beside(&self, o: Open, v: u32, part: u32) -> Option<(f64, f64, u32)> {
        let own = self.faces[o.face as usize].part;
        let [p, q] = self.ends(o);
        if part == own || v == p || v == q {
            return None;
        }
        let [from, to, at] = [p, q, v].map(|v| self.place(v));
        let (line, offset) = (to - from, at - from);
        let t = offset.dot(line) / line.length_squared();
        let off = (offset - t * line).length();
        let reach = self.widest(own, part).min(self.farthest - self.faces[o.face as usize].moved);
        (t > 0.0 && t < 1.0 && off <= reach).then_some((t, off, v))
    }

    /// Makes a face a fan over the points inside one of its sides.
    fn fan(&mut self, o: Open, inside: &[u32]) {
        let (side, next) = (o.side as usize, (o.side as usize + 1) % 3);
        let face = self.faces[o.face as usize];
        let length = self.distance(face.points[side], face.points[next]).max(1.0);
        let mut rest = face;
        for &x in inside {
            let t = (self.distance(face.points[side], x) / length).min(1.0) as f32;
            let look = face.looks[side].towards(&face.looks[next], t).with_unit_normal();
            let mut cut = rest;
            (cut.points[next], cut.looks[next]) = (x, look);
            (rest.points[side], rest.looks[side]) = (x, look);
            self.faces.push(cut);
        }
        self.faces[o.face as usize] = rest;
    }

    fn finish(self) -> Gathered {
        let mut vertices = Vertices::default();
        let mut triangles = Vec::with_capacity(self.faces.len());
        for face in &self.faces {
            let corner =
                |i: usize| (self.at[face.points[i] as usize], self.with_looks.then_some(face.looks[i]));
            triangles.push([0, 1, 2].map(|i| {
                let (at, look) = corner(i);
                vertices.add(at, look)
            }));
        }
        // A part without triangles has nothing that could be wrong.
        let error = |f: &Face| self.errors[f.part as usize] + f.moved;
        let error = self.faces.iter().map(error).fold(0.0, f64::max);
        let piece = Piece { at: vertices.at, looks: vertices.looks, triangles };
        Gathered { piece, error, joined: self.joined }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::BITS;

    const M: i32 = 1 << (BITS - 1);

    /// A strip from x = `from` to the wall x = M, or from there; its rim at the given (y, z).
    fn strip(from: i32, rim: &[(i32, i32)]) -> Piece {
        let n = rim.len() as u32;
        let mut at: Vec<Lattice> = rim.iter().map(|&(y, z)| [M, y, z]).collect();
        at.extend(rim.iter().map(|&(y, _)| [from, y, 0]));
        let mut triangles = Vec::new();
        for i in 0..n - 1 {
            let quad = [i, i + 1, n + i + 1, n + i];
            let flip = from > M;
            for [a, b, c] in [[0, 1, 2], [0, 2, 3]] {
                triangles.push([quad[a], quad[if flip { c } else { b }], quad[if flip { b } else { c }]]);
            }
        }
        Piece { at, looks: vec![], triangles }
    }

    fn open_on_wall(piece: &Piece) -> usize {
        Join::new(vec![Part { piece: piece.clone(), error: 0.0 }], 0.0).open_sides(0, M).len()
    }

    #[test]
    fn equal_rims_need_nothing() {
        let rim = [(0, 0), (1000, 5), (2000, -7)];
        let parts = [M - 999, M + 999].map(|x| Part { piece: strip(x, &rim), error: 3.0 });
        let g = gather(&Cell::ROOT, 1, parts.into(), 99.0);
        assert_eq!((open_on_wall(&g.piece), g.joined, g.error), (0, 0, 3.0));
    }

    #[test]
    fn cracks_are_closed_by_vertices_and_sides() {
        let fine = strip(M - 999, &[(0, 0), (500, 4), (1000, 5), (1500, 3), (2000, -7)]);
        let coarse = strip(M + 999, &[(0, 1), (1001, 6), (2000, -7)]);
        let parts = vec![Part { piece: fine, error: 0.0 }, Part { piece: coarse, error: 8.0 }];
        let g = gather(&Cell::ROOT, 1, parts, 99.0);
        assert_eq!((open_on_wall(&g.piece), g.joined), (0, 4));
        assert!(g.error > 8.0 && g.error < 16.0, "{}", g.error);
        assert_eq!(g.piece.triangles.len(), 8 + 4 + 2);
    }

    #[test]
    fn cracks_that_no_vertex_may_close_are_filled() {
        let crack = |farthest| {
            let a = strip(M - 999, &[(0, 0), (1000, 0), (2000, 0)]);
            let b = strip(M + 999, &[(0, 0), (900, 90), (2000, 0)]);
            let parts = vec![Part { piece: a, error: 4.0 }, Part { piece: b, error: 5.0 }];
            gather(&Cell::ROOT, 1, parts, farthest)
        };
        let g = crack(99.0);
        // Wider than both errors explain, so that nothing moves; two triangles between the rims, within 90 of the surface.
        assert_eq!((open_on_wall(&g.piece), g.joined, g.piece.triangles.len()), (0, 0, 8 + 2));
        assert!(g.error > 50.0 && g.error <= 95.0, "{}", g.error);
        let mut sides: Vec<(u32, u32)> =
            g.piece.triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]).collect();
        sides.sort_unstable();
        assert!(sides.windows(2).all(|s| s[0] != s[1]), "all triangles face the same way");
        let outer = sides.iter().filter(|&&(a, b)| sides.binary_search(&(b, a)).is_err()).count();
        assert_eq!(outer, 8, "only the outer sides of both strips are open");
        assert_eq!(open_on_wall(&crack(40.0).piece), 4);
    }

    #[test]
    fn what_is_too_far_stays_open() {
        let a = strip(M - 999, &[(0, 0), (1000, 0), (2000, 0)]);
        let b = strip(M + 999, &[(0, 90), (1000, 90), (2000, 90)]);
        let parts = vec![Part { piece: a, error: 4.0 }, Part { piece: b, error: 4.0 }];
        let g = gather(&Cell::ROOT, 1, parts, 99.0);
        assert_eq!((open_on_wall(&g.piece), g.joined, g.error), (4, 0, 4.0));
    }
}
