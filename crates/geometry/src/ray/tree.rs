//! The tree's memory: nodes of eight boxes, blocks of eight triangles.

use crate::bounds::{Aabb, DAabb};
use glam::Vec3;

/// Lanes of a node and of a block.
pub(super) const WIDTH: usize = 8;

/// Marks a child that is a block; the other bits are the block's index.
pub(super) const BLOCK: u32 = 1 << 31;

/// The builder keeps trees shallower than this; a walk holds at most seven waiting children per level.
pub(super) const MAX_DEPTH: usize = 32;

/// Entries of a walk's stack: a power of two, so that masking replaces the bounds check.
pub(super) const STACK: usize = 256;
const _: () = assert!((WIDTH - 1) * MAX_DEPTH < STACK && STACK.is_power_of_two());

/// Eight boxes. `bounds[axis][0]` are the lower faces, `bounds[axis][1]` the upper ones.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(64))]
pub(super) struct Node {
    pub(super) bounds: [[[f32; WIDTH]; 2]; 3],
    pub(super) children: [u32; WIDTH],
}

impl Node {
    /// Boxes that nothing meets: lower faces above upper ones.
    pub(super) const EMPTY: Self =
        Self { bounds: [[[1e30; WIDTH], [-1e30; WIDTH]]; 3], children: [0; WIDTH] };

    pub(super) fn set(&mut self, lane: usize, bounds: &Aabb, child: u32) {
        for axis in 0..3 {
            self.bounds[axis][0][lane] = bounds.min[axis];
            self.bounds[axis][1][lane] = bounds.max[axis];
        }
        self.children[lane] = child;
    }
}

/// Eight triangles, as `corners[axis][corner][lane]`. Spare lanes hold NaN, with which every comparison fails.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Block {
    pub(super) corners: [[[f32; WIDTH]; 3]; 3],
    pub(super) ids: [u32; WIDTH],
}

impl Block {
    /// A block of up to eight triangles.
    pub(super) fn new(triangles: impl Iterator<Item = (u32, [Vec3; 3])>) -> Self {
        let mut block = Self { corners: [[[f32::NAN; WIDTH]; 3]; 3], ids: [u32::MAX; WIDTH] };
        for (lane, (id, corners)) in triangles.enumerate() {
            block.set(lane, id, without_area_as_segment(corners));
        }
        block
    }

    fn set(&mut self, lane: usize, id: u32, corners: [Vec3; 3]) {
        self.ids[lane] = id;
        for axis in 0..3 {
            for corner in 0..3 {
                self.corners[axis][corner][lane] = corners[corner][axis];
            }
        }
    }

    #[inline(always)]
    pub(super) fn corner(&self, lane: usize, corner: usize) -> Vec3 {
        Vec3::from_array([0, 1, 2].map(|axis| self.corners[axis][corner][lane & 7]))
    }

    /// Everything that it holds, comparable.
    pub(super) fn bits(&self) -> ([[[u32; WIDTH]; 3]; 3], [u32; WIDTH]) {
        (self.corners.map(|axis| axis.map(|corner| corner.map(f32::to_bits))), self.ids)
    }

    pub(super) fn triangle(&self, lane: usize) -> [Vec3; 3] {
        [0, 1, 2].map(|corner| self.corner(lane, corner))
    }
}

/// A triangle without area, written with two equal corners: then its edge functions cancel exactly for every ray,
/// which they need not do for three corners that merely lie on a line.
pub(super) fn without_area_as_segment(corners: [Vec3; 3]) -> [Vec3; 3] {
    let [a, b, c] = corners;
    if !is_collinear(corners) {
        return corners;
    }
    // The end points of the segment are the pair with the longest extent.
    let length = |p: Vec3, q: Vec3| (p - q).abs().max_element();
    let (ab, bc, ca) = (length(a, b), length(b, c), length(c, a));
    if ab >= bc && ab >= ca {
        [a, a, b]
    } else if bc >= ca {
        [b, b, c]
    } else {
        [a, a, c]
    }
}

/// Whether three points lie on a line, decided exactly.
fn is_collinear([a, b, c]: [Vec3; 3]) -> bool {
    let (a64, b64, c64) = (a.as_dvec3(), b.as_dvec3(), c.as_dvec3());
    let (e, f) = (b64 - a64, c64 - a64);
    let normal = e.cross(f).abs();
    // Coordinates are below one, so each component is off by less than this.
    if normal.max_element() > 1e-14 {
        return false;
    }
    [[0, 1], [1, 2], [2, 0]].into_iter().all(|[i, j]| {
        let coord = |p: glam::DVec3| robust::Coord { x: p[i], y: p[j] };
        robust::orient2d(coord(a64), coord(b64), coord(c64)) == 0.0
    })
}

/// Nodes and blocks; the root is node 0 unless there is no triangle.
#[derive(Clone, Debug, Default)]
pub(super) struct Tree {
    pub(super) nodes: Vec<Node>,
    pub(super) blocks: Vec<Block>,
    pub(super) bounds: Option<DAabb>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn collinear_is_exact() {
        let line = |t: f32| Vec3::new(0.1, 0.2, 0.3) * t;
        // 1, 2 and 4 times a vector are exact multiples, 3 times it is not.
        assert!(is_collinear([line(1.0), line(2.0), line(4.0)]));
        let bent = Vec3::new(0.1f32.next_up() * 2.0, 0.4, 0.6);
        assert!(!is_collinear([line(1.0), bent, line(4.0)]));
        let tiny = 1e-30;
        assert!(!is_collinear([Vec3::ZERO, Vec3::X * tiny, Vec3::Y * tiny]));
    }

    #[test]
    fn a_triangle_without_area_keeps_its_extent() {
        let p = |t: f32| Vec3::splat(t);
        let [a, b, c] = without_area_as_segment([p(0.5), p(0.0), p(0.75)]);
        assert!(a == b && a == p(0.0) && c == p(0.75));
    }
}
