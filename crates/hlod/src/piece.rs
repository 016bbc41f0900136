//! The mesh of a node, on the lattice.

use crate::HlodError;
use crate::appearance::Look;
use crate::cell::{Lattice, LocalFrame, place, rounded};
use crate::cut::Polygons;
use farsight_geometry::TriangleMesh;
use glam::{DVec3, Vec2, Vec3, Vec4};
use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

/// Which attributes a surface has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Attributes {
    pub normals: bool,
    pub uvs: bool,
    pub colours: bool,
}

impl Attributes {
    pub(crate) fn of(mesh: &TriangleMesh) -> Self {
        Self {
            normals: mesh.normals().is_some(),
            uvs: mesh.uvs().is_some(),
            colours: mesh.colours().is_some(),
        }
    }

    pub(crate) fn any(self) -> bool {
        self.normals || self.uvs || self.colours
    }

    pub(crate) fn union(self, other: Self) -> Self {
        Self {
            normals: self.normals || other.normals,
            uvs: self.uvs || other.uvs,
            colours: self.colours || other.colours,
        }
    }

    pub(crate) fn bits(self) -> u8 {
        u8::from(self.normals) | u8::from(self.uvs) << 1 | u8::from(self.colours) << 2
    }

    pub(crate) fn from_bits(bits: u8) -> Option<Self> {
        let on = |i: u8| bits >> i & 1 == 1;
        (bits < 8).then(|| Self { normals: on(0), uvs: on(1), colours: on(2) })
    }
}

/// Vertices and triangles. Without attributes, `looks` is empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Piece {
    pub at: Vec<Lattice>,
    pub looks: Vec<Look>,
    pub triangles: Vec<[u32; 3]>,
}

/// Mixes whole words: positions and looks are looked up far more often than anyone could choose them badly.
#[derive(Clone, Copy, Default)]
struct Mix(u64);

impl Hasher for Mix {
    fn finish(&self) -> u64 {
        // High bits know of all words, and tables use the low ones too.
        self.0 ^ self.0 >> 32
    }

    fn write(&mut self, bytes: &[u8]) {
        let (words, rest) = bytes.as_chunks::<8>();
        words.iter().for_each(|w| self.write_u64(u64::from_le_bytes(*w)));
        let mut last = [0; 8];
        last[..rest.len()].copy_from_slice(rest);
        self.write_u64(u64::from_le_bytes(last));
    }

    fn write_u64(&mut self, word: u64) {
        self.0 = (self.0.rotate_left(23) ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    }

    fn write_usize(&mut self, word: usize) {
        self.write_u64(word as u64);
    }
}

/// Numbers vertices by position and look.
#[derive(Default)]
pub(crate) struct Vertices {
    bare: HashMap<Lattice, u32, BuildHasherDefault<Mix>>,
    ids: HashMap<(Lattice, [u32; 9]), u32, BuildHasherDefault<Mix>>,
    pub at: Vec<Lattice>,
    pub looks: Vec<Look>,
}

impl Vertices {
    pub(crate) fn add(&mut self, at: Lattice, look: Option<Look>) -> u32 {
        let next = self.at.len() as u32;
        let id = match look {
            None => *self.bare.entry(at).or_insert(next),
            Some(look) => *self.ids.entry((at, look.to_array().map(f32::to_bits))).or_insert(next),
        };
        if id == next {
            self.at.push(at);
            self.looks.extend(look);
        }
        id
    }
}

impl Piece {
    /// Triangles of the polygons, corners rounded to a multiple of `step`.
    pub(crate) fn of_polygons(polygons: &Polygons, step: i32) -> Self {
        let mut vertices = Vertices::default();
        let mut triangles = Vec::with_capacity(polygons.triangles());
        for range in polygons.iter() {
            let corners: Vec<u32> = range
                .map(|i| {
                    let look = polygons.looks.get(i).map(|l| l.with_unit_normal());
                    vertices.add(rounded(polygons.at[i], step), look)
                })
                .collect();
            triangulate(&vertices.at, corners, &mut triangles);
        }
        Self { at: vertices.at, looks: vertices.looks, triangles }.tidied()
    }

    /// The mesh with its vertices rounded to a multiple of `step`.
    pub(crate) fn of_mesh(
        mesh: &TriangleMesh,
        frame: &LocalFrame,
        step: i32,
        attributes: Attributes,
    ) -> Self {
        let mut vertices = Vertices::default();
        let ids: Vec<u32> = (0..mesh.positions().len())
            .map(|v| {
                let look = attributes.any().then(|| Look::of_mesh(mesh, v));
                vertices.add(frame.lattice(mesh.positions()[v], step), look)
            })
            .collect();
        let triangles = mesh.triangles().iter().map(|t| t.map(|v| ids[v as usize])).collect();
        Self { at: vertices.at, looks: vertices.looks, triangles }.tidied()
    }

    /// The same with another's triangles, their corners rounded to a multiple of `step`.
    pub(crate) fn joined(self, other: &Self, step: i32) -> Self {
        let mut vertices = Vertices::default();
        let mut ids = |piece: &Self, step: i32| -> Vec<u32> {
            let look = |v: usize| piece.looks.get(v).copied();
            piece.at.iter().enumerate().map(|(v, &p)| vertices.add(rounded(p, step), look(v))).collect()
        };
        let (own, others) = (ids(&self, 1), ids(other, step));
        let mut triangles: Vec<[u32; 3]> =
            self.triangles.iter().map(|t| t.map(|v| own[v as usize])).collect();
        triangles.extend(other.triangles.iter().map(|t| t.map(|v| others[v as usize])));
        Self { at: vertices.at, looks: vertices.looks, triangles }.tidied()
    }

    /// In the coordinates of a cell.
    pub(crate) fn to_mesh(
        &self,
        frame: &LocalFrame,
        origin: DVec3,
        attributes: Attributes,
    ) -> Result<TriangleMesh, HlodError> {
        let positions = self.at.iter().map(|&p| frame.local(p)).collect();
        let mut mesh = TriangleMesh::new(positions, self.triangles.clone())?.with_origin(origin)?;
        if self.looks.is_empty() {
            return Ok(mesh);
        }
        if attributes.normals {
            mesh = mesh.with_normals(self.looks.iter().map(|l| l.normal).collect())?;
        }
        if attributes.uvs {
            mesh = mesh.with_uvs(self.looks.iter().map(|l| l.uv).collect())?;
        }
        if attributes.colours {
            mesh = mesh.with_colours(self.looks.iter().map(Look::colour_bytes).collect())?;
        }
        Ok(mesh)
    }

    /// Without triangles that rounding has made sides or corners of others, without repeated ones, and without unused
    /// vertices.
    fn tidied(mut self) -> Self {
        let place = |v: u32| self.at[v as usize];
        let is_flat = |t: &[u32; 3]| {
            let [a, b, c] = t.map(place);
            a == b || b == c || c == a
        };
        if self.triangles.iter().any(is_flat) {
            let (flat, full): (Vec<[u32; 3]>, Vec<[u32; 3]>) =
                self.triangles.iter().partition(|t| is_flat(t));
            let mut sides: Vec<[Lattice; 2]> = Vec::with_capacity(6 * full.len());
            for t in &full {
                for i in 0..3 {
                    let (a, b) = (place(t[i]), place(t[(i + 1) % 3]));
                    sides.extend([[a.min(b), a.max(b)], [a, a]]);
                }
            }
            sides.sort_unstable();
            let mut bare: Vec<([Lattice; 2], [u32; 3])> = flat
                .into_iter()
                .map(|t| {
                    let mut p = t.map(place);
                    p.sort_unstable();
                    ([p[0], p[2]], t)
                })
                .filter(|(side, _)| sides.binary_search(side).is_err())
                .collect();
            bare.sort_unstable();
            bare.dedup_by_key(|b| b.0);
            self.triangles = full;
            self.triangles.extend(bare.into_iter().map(|b| b.1));
        }
        self.compacted()
    }

    /// Vertices numbered by first use.
    pub(crate) fn compacted(mut self) -> Self {
        let mut new = vec![u32::MAX; self.at.len()];
        let mut order = Vec::with_capacity(self.at.len());
        for v in self.triangles.iter_mut().flatten() {
            let id = &mut new[*v as usize];
            if *id == u32::MAX {
                *id = order.len() as u32;
                order.push(*v as usize);
            }
            *v = *id;
        }
        self.at = order.iter().map(|&v| self.at[v]).collect();
        if !self.looks.is_empty() {
            self.looks = order.iter().map(|&v| self.looks[v]).collect();
        }
        self
    }
}

/// Triangles of a convex polygon: ears are cut off, the best shaped first. Corners that rounding made equal are left out, unless nothing would remain.
fn triangulate(at: &[Lattice], mut corners: Vec<u32>, into: &mut Vec<[u32; 3]>) {
    let place = |v: u32| place(at[v as usize]);
    let full = corners.clone();
    corners.dedup_by_key(|v| at[*v as usize]);
    while corners.len() > 1 && at[corners[0] as usize] == at[corners[corners.len() - 1] as usize] {
        corners.pop();
    }
    if corners.len() < 3 {
        // A line or a point: its farthest corners.
        let a = full[0];
        let far = |from: u32| {
            let d = |v: u32| place(v).distance_squared(place(from));
            full.iter().copied().fold(from, |best, v| if d(v) > d(best) { v } else { best })
        };
        let b = far(a);
        return into.push([a, b, far(b)]);
    }
    while corners.len() > 3 {
        let n = corners.len();
        let ear = |i: usize| [corners[(i + n - 1) % n], corners[i], corners[(i + 1) % n]];
        let shape = |i: usize| {
            let [a, b, c] = ear(i).map(place);
            let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
            (b - a).cross(c - a).length() / longest
        };
        let best = (1..n).fold((0, shape(0)), |best, i| {
            let s = shape(i);
            if s > best.1 { (i, s) } else { best }
        });
        into.push(ear(best.0));
        corners.remove(best.0);
    }
    into.push([corners[0], corners[1], corners[2]]);
}

impl Look {
    pub(crate) fn to_array(self) -> [f32; 9] {
        let (n, uv, c) = (self.normal, self.uv, self.colour);
        [n.x, n.y, n.z, uv.x, uv.y, c.x, c.y, c.z, c.w]
    }

    pub(crate) fn from_array(a: [f32; 9]) -> Self {
        Self {
            normal: Vec3::new(a[0], a[1], a[2]),
            uv: Vec2::new(a[3], a[4]),
            colour: Vec4::new(a[5], a[6], a[7], a[8]),
        }
    }

    /// The look of a mesh's vertex, its normal of unit length.
    pub(crate) fn of_mesh(mesh: &TriangleMesh, v: usize) -> Self {
        Self {
            normal: mesh.normals().map_or(Vec3::ZERO, |n| n[v].normalize_or_zero()),
            uv: mesh.uvs().map_or(Vec2::ZERO, |uv| uv[v]),
            colour: mesh.colours().map_or(Vec4::ZERO, |c| Vec4::from(c[v].map(|x| f32::from(x) / 255.0))),
        }
    }

    pub(crate) fn with_unit_normal(self) -> Self {
        Self { normal: self.normal.normalize_or_zero(), ..self }
    }

    pub(crate) fn colour_bytes(&self) -> [u8; 4] {
        self.colour.to_array().map(|x| (x * 255.0).round() as u8)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::{Cell, Cube};

    #[test]
    fn polygons_become_triangles_of_the_same_area() {
        let mut p = Polygons::default();
        let square = [[0, 0, 0], [1024, 0, 0], [1024, 1024, 0]];
        p.push_triangle(square, None);
        p.at.push([0, 1024, 0]);
        p.ends[0] = 4;
        let piece = Piece::of_polygons(&p, 1);
        assert_eq!((piece.at.len(), piece.triangles.len()), (4, 2));
        // Rounded so that it vanishes: a point stays.
        let point = Piece::of_polygons(&p, 1 << 12);
        assert_eq!((point.at.len(), point.triangles.len()), (1, 1));
    }

    #[test]
    fn sides_of_others_go_and_bare_lines_stay() {
        let at = vec![[0, 0, 0], [64, 0, 0], [0, 64, 0], [64, 0, 1], [640, 0, 0], [641, 0, 0]];
        let piece = Piece { at, looks: vec![], triangles: vec![[0, 1, 2], [0, 1, 3], [1, 4, 5], [4, 5, 1]] };
        let cube = Cube { min: DVec3::ZERO, unit: 1.0 };
        let frame = LocalFrame::of(&Cell::ROOT, &cube);
        let mesh = piece.to_mesh(&frame, DVec3::ZERO, Attributes::default()).unwrap();
        let rounded = Piece::of_mesh(&mesh, &frame, 64, Attributes::default());
        // Of the two slivers to (640, 0, 0) one line is left; that along the side is part of the triangle.
        assert_eq!((rounded.triangles.len(), rounded.at.len()), (2, 4));
    }
}
