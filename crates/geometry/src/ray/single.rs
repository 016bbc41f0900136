//! One ray through the tree.
//!
//! Boxes and triangles are first tested eight at a time in `f32`, with margins that cover every rounding of that
//! test and of the conversion to `f32`. What remains is decided by [`Sheared::cross`]. Hence an `f32` test can cost
//! time but never a hit.

use super::Hit;
use super::bundle::may_contain;
use super::exact::{Crossing, Sheared, each};
use super::frame::power_of_two_above;
use super::tree::{BLOCK, Block, Node, STACK, Tree};
use crate::bounds::DAabb;
use fearless_simd::{Simd, f32x8, prelude::*};
use glam::DVec3;

/// Bound on the `f32` error of a sheared coordinate, in tree units.
///
/// With |origin| ≤ 1 + 2⁻¹⁰ and |vertex| ≤ 1: the origin's conversion, the difference (≤ 2), the shear's conversion
/// and its product (≤ 2 each), the last difference (≤ 4) and the depth's own error through the shear add to
/// less than 15 units of 2⁻²⁴.
pub(super) const SHEARED_ERROR: f32 = 1.0 / (1 << 20) as f32;

/// Distance in tree units by which the box test enlarges boxes.
///
/// All its roundings act like a shift of the face along its axis, as coordinates are below one: the origin's
/// conversion (1 unit of 2⁻²⁴), its product with the inverse (1), the face's product where it is rounded by itself (1), their
/// difference (2), and the relative error of the inverse, two roundings times a distance of up to 2 along the axis (4).
const BOX_PAD: f32 = 1.0 / (1 << 20) as f32;

/// The best hit so far; `key` is instance and triangle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Best {
    pub(super) t: f64,
    pub(super) key: u64,
    /// Twice the signed areas opposite the second and third corner, and of the whole triangle.
    pub(super) areas: [f64; 3],
}

impl Best {
    pub(super) const NONE: Self = Self { t: f64::INFINITY, key: u64::MAX, areas: [0.0; 3] };

    pub(super) fn hit(&self) -> Option<Hit> {
        (self.key != u64::MAX).then(|| Hit {
            t: self.t,
            instance: (self.key >> 32) as u32,
            triangle: self.key as u32,
            barycentrics: [(self.areas[0] / self.areas[2]) as f32, (self.areas[1] / self.areas[2]) as f32],
            back_face: self.areas[2] < 0.0,
        })
    }

    /// Swaps the sides: the triangle was mirrored.
    pub(super) fn mirror(&mut self) {
        self.areas = [-self.areas[0], -self.areas[1], -self.areas[2]];
    }

    /// Takes a nearer hit, or an equally near one with a lower key.
    #[inline(always)]
    pub(super) fn offer(&mut self, key: u64, hit: &Crossing) -> bool {
        let better = hit.t < self.t || (hit.t == self.t && key < self.key);
        if better {
            *self = Self { t: hit.t, key, areas: hit.areas };
        }
        better
    }
}

/// Children still to be visited, nearest on top. An entry is the distance's bits above the child: distances are not
/// negative, so entries compare like distances.
pub(super) struct Stack(pub(super) [u64; STACK]);

impl Stack {
    pub(super) const fn new() -> Self {
        Self([0; STACK])
    }
}

/// The ray in `f32`, from where it enters the tree's box, with direction components up to one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Walk {
    /// Distance of a face = face · inverse + offset; near and far faces are moved apart by the margin.
    inverse: [f32; 3],
    near: [f32; 3],
    far: [f32; 3],
    /// 1 where the direction is negative.
    negative: [usize; 3],
    /// Axes: two across, then the main one; `origin` and `shear` are in this order.
    axes: [usize; 3],
    origin: [f32; 3],
    /// x and y per unit of depth, and the walk's distance per unit of depth.
    shear: [f32; 3],
    /// Bounds on errors of a sheared coordinate and of a distance.
    error: f32,
    start: f32,
    /// Walk distance = (t − offset) · per_t.
    offset: f64,
    per_t: f64,
}

impl Walk {
    /// `None` when the ray misses the tree's box.
    #[inline(always)]
    pub(super) fn new(bounds: &DAabb, origin: DVec3, direction: DVec3, ray: &Sheared) -> Option<Self> {
        let far_error = origin.abs().max_element() * (0.25 / (1u64 << 48) as f64);
        let mut offset = ray.t_min;
        let inside = (origin.cmpge(bounds.min) & origin.cmple(bounds.max)).all();
        if !inside {
            let (enter, leave) = clip(bounds, origin, direction, 1e-6 + 4.0 * far_error);
            offset = if enter > offset { enter } else { offset };
            // Written so that NaN, which only absurdly far origins give, walks on.
            if offset > leave {
                return None;
            }
        }
        if offset > ray.t_max {
            return None;
        }
        let per_t = power_of_two_above(direction[ray.axes[2]].abs());
        let o = origin + direction * offset;
        // A component this small moves the ray by less than the margin on its whole way.
        let scaled = direction * (1.0 / per_t);
        let d = each(|i| if scaled[i].abs() < 1e-20 { 1e-20 } else { scaled[i] as f32 });
        let pad = BOX_PAD + 2.0 * far_error as f32;
        let away = each(|i| if d[i] < 0.0 { -pad } else { pad });
        let error = SHEARED_ERROR + 4.0 * far_error as f32;
        let depth = |t: f64| ((t - offset) * per_t) as f32;
        let inverse = each(|i| 1.0 / d[i]);
        Some(Self {
            inverse,
            near: each(|i| -(o[i] as f32 + away[i]) * inverse[i]),
            far: each(|i| -(o[i] as f32 - away[i]) * inverse[i]),
            negative: each(|i| usize::from(d[i] < 0.0)),
            axes: ray.axes,
            origin: each(|i| o[ray.axes[i]] as f32),
            shear: [ray.shear[0] as f32, ray.shear[1] as f32, (ray.shear[2] * per_t) as f32],
            error,
            start: depth(ray.t_min) - error,
            offset,
            per_t,
        })
    }

    /// Where the ray is `run_up` walk distances before the walk's start, and its direction in walk distances.
    #[cfg(feature = "obvhs")]
    pub(super) fn start_before(&self, origin: DVec3, direction: DVec3, run_up: f64) -> (DVec3, DVec3) {
        (origin + direction * (self.offset - run_up / self.per_t), direction / self.per_t)
    }

    /// The largest walk distance that can belong to a hit at `t`.
    #[inline(always)]
    pub(super) fn limit(&self, t: f64) -> f32 {
        ((t - self.offset) * self.per_t) as f32 + self.error
    }
}

/// Where a line enters and leaves a box enlarged by `pad`.
#[inline(always)]
fn clip(bounds: &DAabb, origin: DVec3, direction: DVec3, pad: f64) -> (f64, f64) {
    let (lo, hi) = (bounds.min - pad - origin, bounds.max + pad - origin);
    let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
    for axis in 0..3 {
        let d = direction[axis];
        if d == 0.0 {
            if lo[axis] > 0.0 || hi[axis] < 0.0 {
                return (f64::INFINITY, f64::NEG_INFINITY);
            }
            continue;
        }
        let inverse = 1.0 / d;
        let (a, b) = (lo[axis] * inverse, hi[axis] * inverse);
        let (a, b) = if d < 0.0 { (b, a) } else { (a, b) };
        enter = if a > enter { a } else { enter };
        leave = if b < leave { b } else { leave };
    }
    (enter, leave)
}

/// Finds the nearest hit, or with `ANY` just some hit, of the ray with the tree's triangles. `instance` is the upper
/// half of the keys.
#[inline(always)]
pub(super) fn trace<S: Simd, const ANY: bool>(
    simd: S,
    tree: &Tree,
    ray: &Sheared,
    walk: &Walk,
    instance: u64,
    stack: &mut Stack,
    best: &mut Best,
) {
    let mut place = Place::start(walk, ray, best);
    while place.step::<S, ANY>(simd, tree, ray, walk, instance, stack, best) {}
}

/// Where a ray is in the tree.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    current: u32,
    height: usize,
    /// Walk distance beyond which nothing is of interest.
    limit: f32,
}

impl Place {
    #[inline(always)]
    pub(super) fn start(walk: &Walk, ray: &Sheared, best: &Best) -> Self {
        let limit = walk.limit(if best.t < ray.t_max { best.t } else { ray.t_max });
        Self { current: 0, height: 0, limit }
    }

    /// Visits one node or block; false when the ray is through.
    #[inline(always)]
    pub(super) fn step<S: Simd, const ANY: bool>(
        &mut self,
        simd: S,
        tree: &Tree,
        ray: &Sheared,
        walk: &Walk,
        instance: u64,
        stack: &mut Stack,
        best: &mut Best,
    ) -> bool {
        if self.current & BLOCK == 0 {
            let Some(node) = tree.nodes.get(self.current as usize) else { return false };
            let (hits, distances) = boxes(simd, node, walk, self.limit);
            if hits != 0 {
                self.descend(node, hits, &distances, stack);
                return true;
            }
        } else {
            let Some(block) = tree.blocks.get((self.current & !BLOCK) as usize) else { return false };
            let mut lanes = triangles(simd, block, walk, self.limit);
            while lanes != 0 {
                let lane = lanes.trailing_zeros() as usize & 7;
                lanes &= lanes - 1;
                let rows = each(|i| &block.corners[ray.axes[i]]);
                let corners = each(|corner| each(|i| rows[i][corner][lane]));
                if let Some(hit) = ray.cross(corners)
                    && best.offer(instance << 32 | u64::from(block.ids[lane]), &hit)
                {
                    if ANY {
                        return false;
                    }
                    self.limit = walk.limit(hit.t);
                }
            }
        }
        self.pop(stack)
    }

    /// Goes to the nearest of the children that are hit and leaves the others on the stack.
    #[inline(always)]
    fn descend(&mut self, node: &Node, mut hits: u32, distances: &[f32; 8], stack: &mut Stack) {
        let first = hits.trailing_zeros() as usize & 7;
        hits &= hits - 1;
        if hits == 0 {
            self.current = node.children[first];
            return;
        }
        let stack = &mut stack.0;
        let entry = |lane: usize| u64::from(distances[lane].to_bits()) << 32 | u64::from(node.children[lane]);
        let mut nearest = entry(first);
        let base = self.height;
        while hits != 0 {
            let next = entry(hits.trailing_zeros() as usize & 7);
            hits &= hits - 1;
            let farther = nearest.max(next);
            nearest = nearest.min(next);
            // Insertion sort of what waits.
            let mut at = self.height;
            while at > base && stack[(at - 1) & (STACK - 1)] < farther {
                stack[at & (STACK - 1)] = stack[(at - 1) & (STACK - 1)];
                at -= 1;
            }
            stack[at & (STACK - 1)] = farther;
            self.height += 1;
        }
        self.current = nearest as u32;
    }

    /// Goes to the nearest of what waits; false when nothing of interest does.
    #[inline(always)]
    fn pop(&mut self, stack: &Stack) -> bool {
        while self.height != 0 {
            self.height -= 1;
            let entry = stack.0[self.height & (STACK - 1)];
            if f32::from_bits((entry >> 32) as u32) <= self.limit {
                self.current = entry as u32;
                return true;
            }
        }
        false
    }
}

/// Which boxes the ray may meet before `limit`, and from which distance on.
#[inline(always)]
fn boxes<S: Simd>(simd: S, node: &Node, walk: &Walk, limit: f32) -> (u32, [f32; 8]) {
    let slab = |axis: usize| {
        let faces = &node.bounds[axis];
        let inverse = f32x8::splat(simd, walk.inverse[axis]);
        let negative = walk.negative[axis] & 1;
        let near = f32x8::load_array_ref(simd, &faces[negative]);
        let far = f32x8::load_array_ref(simd, &faces[negative ^ 1]);
        let offset = |x: f32| f32x8::splat(simd, x);
        (near.mul_add(inverse, offset(walk.near[axis])), far.mul_add(inverse, offset(walk.far[axis])))
    };
    let ((x0, x1), (y0, y1), (z0, z1)) = (slab(0), slab(1), slab(2));
    let near = x0.max(y0).max(z0.max(f32x8::splat(simd, 0.0)));
    let far = x1.min(y1).min(z1.min(f32x8::splat(simd, limit)));
    let hits = near.simd_le(far).to_bitmask() as u32;
    (hits, near.to_array())
}

/// Which triangles the ray may cross between its start and `limit`.
#[inline(always)]
fn triangles<S: Simd>(simd: S, block: &Block, walk: &Walk, limit: f32) -> u32 {
    let splat = |x: f32| f32x8::splat(simd, x);
    let [x, y, z] = each(|i| &block.corners[walk.axes[i]]);
    let [ox, oy, oz] = each(|i| splat(walk.origin[i]));
    let [sx, sy, sz] = each(|i| splat(walk.shear[i]));
    let corner = |i: usize| {
        let z = f32x8::load_array_ref(simd, &z[i]) - oz;
        let x = (f32x8::load_array_ref(simd, &x[i]) - ox) - sx * z;
        let y = (f32x8::load_array_ref(simd, &y[i]) - oy) - sy * z;
        (x, y, z * sz)
    };
    let ((ax, ay, at), (bx, by, bt), (cx, cy, ct)) = (corner(0), corner(1), corner(2));
    let inside = may_contain(simd, [ax, ay, bx, by, cx, cy], walk.error);
    let reached = at.min(bt).min(ct).simd_le(splat(limit)) & at.max(bt).max(ct).simd_ge(splat(walk.start));
    (inside & reached).to_bitmask() as u32
}
