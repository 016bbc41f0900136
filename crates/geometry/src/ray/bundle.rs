//! Rays of one origin together through the tree.
//!
//! A bundle is bounded by a pyramid: directions per unit of the common main axis lie in a rectangle. A node's eight boxes
//! are tested against the pyramid once for all rays; each box that is left, against eight rays at a time, so that a ray goes
//! only where it would go by itself. In the leaves many rays are tested against one triangle at a time, a few rays
//! against eight triangles each. As for single rays, `f32` with margins only sorts out misses, and the same `f64` arithmetic
//! decides. So a bundle's hits are those of its rays, bit for bit.

use super::Hit;
use super::exact::{Faces, Sheared, axes, each};
use super::frame::Frame;
use super::single::{Best, SHEARED_ERROR};
use super::tree::{BLOCK, Block, Node, STACK, Tree};
use fearless_simd::{Simd, f32x8, f64x4, mask32x8, mask64x4, prelude::*};
use glam::DVec3;

/// Most rays in a bundle; longer lists are cut.
const RAYS: usize = 32;

/// Fewest rays that are worth a bundle.
pub(super) const FEWEST: usize = 3;

/// Widest side of a bundle's rectangle: about 0.2 rad to either side.
const WIDEST: f64 = 0.4;

/// Up to so many rays are tested one by one against eight triangles; more, against one triangle at a time.
const FEW: u32 = 6;

/// How many directions from the first on go together. A guess, for [`Bundle::set`] decides.
#[inline(always)]
pub(super) fn close_together(directions: &[DVec3]) -> usize {
    let Some(first) = directions.first() else { return 0 };
    let axes = axes(*first);
    let shear = |d: &DVec3| [d[axes[0]] / d[axes[2]], d[axes[1]] / d[axes[2]]];
    let (mut low, mut high) = (shear(first), shear(first));
    for (count, direction) in directions.iter().take(RAYS).enumerate() {
        let at = shear(direction);
        let depth = direction[axes[2]];
        // Written so that NaN ends the bundle.
        let mut fits = depth * first[axes[2]] > 0.0;
        for i in 0..2 {
            low[i] = low[i].min(at[i]);
            high[i] = high[i].max(at[i]);
            fits &= high[i] - low[i] <= WIDEST && at[i].abs() < 1.0;
        }
        if !fits {
            return count.max(1);
        }
    }
    directions.len().min(RAYS)
}

/// Origins farther from the mesh (in its sizes) are left to single rays, which start where they enter its box.
const FARTHEST: f64 = 16.0;

/// A bundle ready to be traced. Spare rays repeat the first.
pub(super) struct Bundle {
    /// Axes: two across, then the main one.
    axes: [usize; 3],
    /// Bits of the rays that are in use.
    all: u32,
    origin: [f64; 3],
    /// Per ray: x and y per unit of depth, and t per unit of depth.
    shear: [[f64; RAYS]; 3],
    /// Per ray: depth per unit of x and y.
    inverse: [[f32; RAYS]; 2],
    /// Shear in the middle of the rectangle, and how each ray's differs from it, at most by `spread`.
    centre: [f32; 2],
    offset: [[f32; RAYS]; 2],
    spread: [f32; 2],
    /// Per ray: depth (times `sign`) per unit of t.
    depth: [f64; RAYS],
    /// Depth times this is not negative.
    sign: f32,
    /// Sides of triangles that count.
    faces: Faces,
    /// Shear on the pyramid's sides: lower and upper ends of x, then y, in terms of depth times `sign`.
    sides: [[f32; 2]; 2],
    /// Bound on the `f32` error of a sheared coordinate.
    error: f32,
    /// Per ray, the best hit: t, key (as the bits of a float, so that lanes can be blended) and areas.
    t: [f64; RAYS],
    key: [f64; RAYS],
    areas: [[f64; RAYS]; 3],
    /// Depths (times `sign`) beyond which each ray's hit is settled.
    limits: [f32; RAYS],
}

impl Bundle {
    pub(super) fn new(faces: Faces) -> Self {
        Self {
            axes: [0, 1, 2],
            all: 0,
            origin: [0.0; 3],
            shear: [[0.0; RAYS]; 3],
            inverse: [[0.0; RAYS]; 2],
            centre: [0.0; 2],
            offset: [[0.0; RAYS]; 2],
            spread: [0.0; 2],
            depth: [0.0; RAYS],
            sign: 1.0,
            faces,
            sides: [[0.0; 2]; 2],
            error: 0.0,
            t: [f64::INFINITY; RAYS],
            key: [0.0; RAYS],
            areas: [[0.0; RAYS]; 3],
            limits: [f32::INFINITY; RAYS],
        }
    }

    /// Takes new rays. False when they are better, or only, traced one by one.
    #[inline(always)]
    pub(super) fn set<S: Simd>(
        &mut self,
        simd: S,
        frame: &Frame,
        origin: DVec3,
        directions: &[DVec3],
    ) -> bool {
        let bundle = self;
        let origin = frame.point(origin);
        let reach = origin.abs().max_element();
        let near = reach <= FARTHEST;
        if directions.is_empty() || directions.len() > RAYS || !near {
            return false;
        }
        let axes = axes(directions[0]);
        bundle.axes = axes;
        bundle.origin = each(|i| origin[axes[i]]);
        bundle.sign = if directions[0][axes[2]] < 0.0 { -1.0 } else { 1.0 };
        bundle.error = SHEARED_ERROR * (reach as f32).max(1.0);
        bundle.key = [f64::from_bits(u64::MAX); RAYS];
        // Spare rays have nothing to wait for.
        bundle.t = [f64::NEG_INFINITY; RAYS];
        bundle.limits = [f32::NEG_INFINITY; RAYS];
        bundle.t[..directions.len()].fill(f64::INFINITY);
        bundle.limits[..directions.len()].fill(f32::INFINITY);
        bundle.all = u32::MAX >> (RAYS - directions.len());
        let mut usable = true;
        for group in 0..directions.len().div_ceil(4) {
            usable &= bundle.aim(simd, group, directions, frame.scale());
        }
        if !usable {
            return false;
        }
        let count = directions.len().next_multiple_of(4);
        for side in 0..2 {
            let shear = &mut bundle.shear[side];
            let (mut low, mut high) = (shear[0], shear[0]);
            for i in 0..count {
                low = if shear[i] < low { shear[i] } else { low };
                high = if shear[i] > high { shear[i] } else { high };
            }
            if high - low > WIDEST {
                return false;
            }
            for i in count..RAYS {
                shear[i] = shear[0];
            }
            let centre = (low * 0.5 + high * 0.5) as f32;
            let (mut spread, offset) = (0.0, &mut bundle.offset[side]);
            for i in 0..RAYS {
                let shear32 = shear[i] as f32;
                // So little moves the ray by less than the margin on its whole way.
                let safe = if shear32.abs() < 1e-20 { 1e-20 } else { shear32 };
                bundle.inverse[side][i] = 1.0 / safe;
                offset[i] = (shear[i] - f64::from(centre)) as f32;
                spread = if offset[i].abs() > spread { offset[i].abs() } else { spread };
            }
            bundle.centre[side] = centre;
            bundle.spread[side] = spread * (1.0 + 2.0 * f32::EPSILON);
            let ends = if bundle.sign < 0.0 { [-high, -low] } else { [low, high] };
            bundle.sides[side] = [ends[0] as f32, ends[1] as f32];
        }
        let (third, depth) = (bundle.shear[2][0], bundle.depth[0]);
        bundle.shear[2][count..].fill(third);
        bundle.depth[count..].fill(depth);
        true
    }

    /// Normalises four directions exactly as [`Ray::new`](super::Ray::new) does and shears them. False when one has
    /// another main axis or no length.
    #[inline(always)]
    fn aim<S: Simd>(&mut self, simd: S, group: usize, directions: &[DVec3], scale: f64) -> bool {
        let at =
            |lane: usize| directions[if group * 4 + lane < directions.len() { group * 4 + lane } else { 0 }];
        let (a, b, c, d) = (at(0), at(1), at(2), at(3));
        let axes = self.axes;
        let raw = each(|i| f64x4::load_array(simd, [a[i], b[i], c[i], d[i]]));
        let largest = raw[0].abs().max(raw[1].abs()).max(raw[2].abs());
        let (x, y, z) = (raw[0] / largest, raw[1] / largest, raw[2] / largest);
        let length = (x * x + y * y + z * z).sqrt();
        let inverse = f64x4::splat(simd, 1.0) / length;
        let unit = [x * inverse, y * inverse, z * inverse];
        let [x, y, z] = each(|i| unit[axes[i]] * scale);
        let depth = z.abs();
        let usable = largest.simd_gt(0.0)
            & largest.simd_lt(f64::INFINITY)
            & depth.simd_gt(x.abs())
            & depth.simd_gt(y.abs())
            & (z * f64::from(self.sign)).simd_gt(0.0);
        let lanes = group * 4..group * 4 + 4;
        (x / z).store_slice(&mut self.shear[0][lanes.clone()]);
        (y / z).store_slice(&mut self.shear[1][lanes.clone()]);
        (f64x4::splat(simd, 1.0) / z).store_slice(&mut self.shear[2][lanes.clone()]);
        depth.store_slice(&mut self.depth[lanes]);
        usable.all_true()
    }

    #[inline(always)]
    pub(super) fn store(&self, hits: &mut [Option<Hit>]) {
        for (ray, hit) in hits.iter_mut().enumerate().take(RAYS) {
            let areas = each(|i| self.areas[i][ray]);
            *hit = Best { t: self.t[ray], key: self.key[ray].to_bits(), areas }.hit();
        }
    }

    /// Traces all rays. `instance` is the upper half of the keys.
    #[inline(always)]
    pub(super) fn trace<S: Simd>(&mut self, simd: S, tree: &Tree, instance: u64, waiting: &mut Waiting) {
        let pyramid = Pyramid::new(self);
        let (mut place, mut limit) = (Entry { child: 0, rays: self.all, near: 0.0 }, f32::INFINITY);
        waiting.height = 0;
        loop {
            if place.child & BLOCK != 0 {
                let Some(block) = tree.blocks.get((place.child & !BLOCK) as usize) else { return };
                if self.block(simd, block, place.rays, limit, instance) {
                    let load = |i: usize| f32x8::from_slice(simd, &self.limits[i * 8..i * 8 + 8]);
                    limit = load(0).max(load(1)).max(load(2).max(load(3))).reduce_max();
                }
            } else {
                let Some(node) = tree.nodes.get(place.child as usize) else { return };
                let (near, far, mut hits) = pyramid.boxes(simd, node, limit);
                if hits != 0 {
                    let boxes = Boxes::new(simd, self, node, near, far);
                    let base = waiting.height;
                    while hits != 0 {
                        let lane = hits.trailing_zeros() as usize & 7;
                        hits &= hits - 1;
                        let rays = self.reach(simd, &boxes, lane, place.rays);
                        if rays != 0 {
                            waiting.push(
                                base,
                                Entry { child: node.children[lane], rays, near: boxes.near[lane] },
                            );
                        }
                    }
                }
            }
            loop {
                let Some(next) = waiting.pop() else { return };
                if next.near <= limit {
                    place = next;
                    break;
                }
            }
        }
    }

    /// Which of the rays reach a box of a node before they end.
    #[inline(always)]
    fn reach<S: Simd>(&self, simd: S, boxes: &Boxes, lane: usize, rays: u32) -> u32 {
        let splat = |x: f32| f32x8::splat(simd, x);
        let [x0, x1, y0, y1] = [
            boxes.sides[0][lane & 7],
            boxes.sides[1][lane & 7],
            boxes.sides[2][lane & 7],
            boxes.sides[3][lane & 7],
        ];
        let (near, far) = (splat(boxes.near[lane & 7]), splat(boxes.far[lane & 7]));
        let mut reached = 0;
        for group in 0..RAYS / 8 {
            if rays >> (8 * group) & 0xff == 0 {
                continue;
            }
            let load = |row: &[f32; RAYS]| f32x8::from_slice(simd, &row[8 * group..8 * group + 8]);
            let (ix, iy) = (load(&self.inverse[0]), load(&self.inverse[1]));
            let (a, b, c, d) = (ix * x0, ix * x1, iy * y0, iy * y1);
            let enter = a.min(b).max(c.min(d)).max(near);
            let leave = a.max(b).min(c.max(d)).min(far).min(load(&self.limits));
            reached |= (enter.simd_le(leave).to_bitmask() as u32) << (8 * group);
        }
        reached & rays
    }

    /// Eight triangles against rays; whether a hit came nearer.
    #[inline(always)]
    fn block<S: Simd>(&mut self, simd: S, block: &Block, rays: u32, limit: f32, instance: u64) -> bool {
        if rays.count_ones() <= FEW {
            return self.block_by_ray(simd, block, rays, instance);
        }
        let edges = Edges::new(simd, self, block);
        let mut lanes = edges.candidates(simd, self, limit);
        if lanes == 0 {
            return false;
        }
        let (edges, mut improved) = (edges.store(), false);
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize & 7;
            lanes &= lanes - 1;
            improved |= self.triangle(simd, block, &edges, lane, rays, instance);
        }
        improved
    }

    /// Eight triangles against a few rays, one after the other; whether a hit came nearer.
    #[inline(always)]
    fn block_by_ray<S: Simd>(&mut self, simd: S, block: &Block, mut rays: u32, instance: u64) -> bool {
        let splat = |x: f32| f32x8::splat(simd, x);
        let rows = each(|i| &block.corners[self.axes[i]]);
        let corners = sheared(simd, self, rows);
        let (reach, depths) = (reach(simd, self, &corners), each(|i| corners[i][2] * self.sign));
        let [a, b, c] = depths;
        // One more rounding than a single ray's, of which the margin has a third left.
        let error = splat(1.5 * self.error);
        let margin = (reach + error) * error * 4.0;
        let nearest = a.min(b).min(c);
        let ahead = a.max(b).max(c).simd_ge(-error);
        let mut improved = false;
        while rays != 0 {
            let ray = rays.trailing_zeros() as usize & (RAYS - 1);
            rays &= rays - 1;
            let (sx, sy) = (splat(self.offset[0][ray]), splat(self.offset[1][ray]));
            let across = each(|i| [corners[i][0] - sx * corners[i][2], corners[i][1] - sy * corners[i][2]]);
            let [[ax, ay], [bx, by], [cx, cy]] = across;
            let (u, v, w) = (cx * by - cy * bx, ax * cy - ay * cx, bx * ay - by * ax);
            let inside = u.min(v).min(w).simd_ge(-margin) | u.max(v).max(w).simd_le(margin);
            let near = nearest.simd_le(splat(self.limits[ray] + self.error));
            let mut lanes = (inside & near & ahead).to_bitmask() as u32;
            while lanes != 0 {
                let lane = lanes.trailing_zeros() as usize & 7;
                lanes &= lanes - 1;
                let corners = each(|corner| each(|i| rows[i][corner][lane]));
                improved |= self.cross_one(corners, instance << 32 | u64::from(block.ids[lane]), ray);
            }
        }
        improved
    }

    /// [`Sheared::cross`] for one ray; whether the hit came nearer.
    #[inline(always)]
    fn cross_one(&mut self, corners: [[f32; 3]; 3], key: u64, ray: usize) -> bool {
        let sheared = Sheared {
            axes: self.axes,
            origin: self.origin,
            shear: each(|i| self.shear[i][ray]),
            t_min: 0.0,
            t_max: f64::INFINITY,
            faces: self.faces,
        };
        let Some(hit) = sheared.cross(corners) else { return false };
        let better = hit.t < self.t[ray] || (hit.t == self.t[ray] && key < self.key[ray].to_bits());
        if better {
            (self.t[ray], self.key[ray]) = (hit.t, f64::from_bits(key));
            for i in 0..3 {
                self.areas[i][ray] = hit.areas[i];
            }
            self.limits[ray] = (hit.t * self.depth[ray]) as f32 + self.error;
        }
        better
    }

    /// One triangle against rays; whether a hit came nearer.
    #[inline(always)]
    fn triangle<S: Simd>(
        &mut self,
        simd: S,
        block: &Block,
        edges: &StoredEdges,
        lane: usize,
        rays: u32,
        instance: u64,
    ) -> bool {
        let splat = |x: f32| f32x8::splat(simd, x);
        let rows = each(|i| &block.corners[self.axes[i]]);
        let corners = each(|corner| each(|i| rows[i][corner][lane & 7]));
        let key = instance << 32 | u64::from(block.ids[lane & 7]);
        let [u, v, w] = each(|edge| each(|i| splat(edges.normals[edge][i][lane & 7])));
        let (margin, nearest) = (splat(edges.margin[lane & 7]), splat(edges.nearest[lane & 7]));
        let mut improved = false;
        for group in 0..RAYS / 8 {
            let first = group * 8;
            if rays >> first & 0xff == 0 {
                continue;
            }
            let x = f32x8::from_slice(simd, &self.offset[0][first..first + 8]);
            let y = f32x8::from_slice(simd, &self.offset[1][first..first + 8]);
            let side = |n: [f32x8<S>; 3]| n[0].mul_add(x, n[1].mul_add(y, n[2]));
            let (u, v, w) = (side(u), side(v), side(w));
            let inside = u.min(v).min(w).simd_ge(-margin) | u.max(v).max(w).simd_le(margin);
            let limits = f32x8::from_slice(simd, &self.limits[first..first + 8]);
            let candidates = (inside & limits.simd_ge(nearest)).to_bitmask() as usize;
            let mut nearer = false;
            for half in 0..2 {
                if candidates >> (half * 4) & 15 != 0 {
                    nearer |= self.cross(simd, corners, key, first + half * 4);
                }
            }
            if nearer {
                self.limit(simd, first);
                improved = true;
            }
        }
        improved
    }

    /// [`Sheared::cross`](super::exact::Sheared::cross) for four rays: the same operations in the same order.
    #[inline(always)]
    fn cross<S: Simd>(&mut self, simd: S, corners: [[f32; 3]; 3], key: u64, first: usize) -> bool {
        let splat = |x: f64| f64x4::splat(simd, x);
        let [sx, sy, sz] = each(|i| f64x4::from_slice(simd, &self.shear[i][first..first + 4]));
        let local = each(|corner| each(|i| f64::from(corners[corner][i]) - self.origin[i]));
        let [az, bz, cz] = each(|i| splat(local[i][2]));
        let [ax, bx, cx] =
            [splat(local[0][0]) - sx * az, splat(local[1][0]) - sx * bz, splat(local[2][0]) - sx * cz];
        let [ay, by, cy] =
            [splat(local[0][1]) - sy * az, splat(local[1][1]) - sy * bz, splat(local[2][1]) - sy * cz];
        let (u, v, w) = (cx * by - cy * bx, ax * cy - ay * cx, bx * ay - by * ax);
        let one_sign = u.min(v).min(w).simd_ge(0.0) | u.max(v).max(w).simd_le(0.0);
        let det = sum(u, v, w);
        let t = sum(u * az, v * bz, w * cz) / det * sz;
        let lanes = first..first + 4;
        let best = f64x4::from_slice(simd, &self.t[lanes.clone()]);
        let counts = det.simd_ne(0.0) & (det * self.faces.unwanted()).simd_le(0.0);
        let valid = one_sign & t.simd_ge(0.0) & t.simd_le(best) & t.simd_lt(f64::INFINITY) & counts;
        if valid.all_false() {
            return false;
        }
        let mut better = valid & t.simd_lt(best);
        let tied = (valid & t.simd_eq(best)).to_bitmask() as usize;
        for lane in 0..4 {
            if tied >> lane & 1 != 0 && key < self.key[first + lane].to_bits() {
                better.set(lane, true);
            }
        }
        better.select(t, best).store_slice(&mut self.t[lanes.clone()]);
        blend(simd, better, splat(f64::from_bits(key)), &mut self.key[lanes.clone()]);
        blend(simd, better, v, &mut self.areas[0][lanes.clone()]);
        blend(simd, better, w, &mut self.areas[1][lanes.clone()]);
        blend(simd, better, det, &mut self.areas[2][lanes]);
        true
    }

    /// Brings the depth limits of eight rays up to date.
    #[inline(always)]
    fn limit<S: Simd>(&mut self, simd: S, first: usize) {
        let depth = |at: usize| {
            f64x4::from_slice(simd, &self.t[at..at + 4]) * f64x4::from_slice(simd, &self.depth[at..at + 4])
        };
        let limits = simd.narrow_f64x4(depth(first), depth(first + 4)) + self.error;
        limits.store_slice(&mut self.limits[first..first + 8]);
    }
}

/// A node or block that some rays are to visit.
#[derive(Clone, Copy)]
pub(super) struct Entry {
    child: u32,
    /// Bits of the rays.
    rays: u32,
    /// Depth from which on.
    near: f32,
}

/// What is still to be visited, nearest on top.
pub(super) struct Waiting {
    entries: [Entry; STACK],
    height: usize,
}

impl Waiting {
    pub(super) const fn new() -> Self {
        Self { entries: [Entry { child: 0, rays: 0, near: 0.0 }; STACK], height: 0 }
    }

    /// Sorts an entry in among those above `base`.
    #[inline(always)]
    fn push(&mut self, base: usize, entry: Entry) {
        let mut at = self.height;
        while at > base && self.entries[(at - 1) & (STACK - 1)].near < entry.near {
            self.entries[at & (STACK - 1)] = self.entries[(at - 1) & (STACK - 1)];
            at -= 1;
        }
        self.entries[at & (STACK - 1)] = entry;
        self.height += 1;
    }

    #[inline(always)]
    fn pop(&mut self) -> Option<Entry> {
        if self.height == 0 {
            return None;
        }
        self.height -= 1;
        Some(self.entries[self.height & (STACK - 1)])
    }
}

/// A node's boxes relative to the bundle's origin, enlarged by the margin.
struct Boxes {
    /// Lower and upper x, lower and upper y.
    sides: [[f32; 8]; 4],
    near: [f32; 8],
    far: [f32; 8],
}

impl Boxes {
    /// The margin covers all roundings as in the test of single rays ([`super::single`]), whose distances are depths here.
    #[inline(always)]
    fn new<S: Simd>(simd: S, bundle: &Bundle, node: &Node, near: f32x8<S>, far: f32x8<S>) -> Self {
        let [low_x, high_x] = relative(simd, bundle, node, 0);
        let [low_y, high_y] = relative(simd, bundle, node, 1);
        let sides = [low_x, high_x, low_y, high_y];
        Self { sides, near: near.to_array(), far: (far + 2.0 * bundle.error).to_array() }
    }
}

/// Lower and upper faces across one axis relative to the bundle's origin, times the sign, as depths are.
#[inline(always)]
fn relative<S: Simd>(simd: S, bundle: &Bundle, node: &Node, side: usize) -> [[f32; 8]; 2] {
    let (origin, faces) = (bundle.origin[side] as f32, &node.bounds[bundle.axes[side]]);
    let low = (row(simd, faces, 0) - origin - bundle.error) * bundle.sign;
    let high = (row(simd, faces, 1) - origin + bundle.error) * bundle.sign;
    [low.to_array(), high.to_array()]
}

#[inline(always)]
fn blend<S: Simd>(simd: S, mask: mask64x4<S>, new: f64x4<S>, old: &mut [f64]) {
    mask.select(new, f64x4::from_slice(simd, old)).store_slice(old);
}

/// As [`sum`](super::exact::sum) of scalars.
#[inline(always)]
fn sum<S: Simd>(a: f64x4<S>, b: f64x4<S>, c: f64x4<S>) -> f64x4<S> {
    let (lo, hi) = (a.min(b), a.max(b));
    (lo.min(c) + hi.max(c)) + lo.max(hi.min(c))
}

/// Whether the sheared triangles (x and y of three corners) contain the ray, or may do so but for rounding.
///
/// |Δu| ≤ ε(|bx| + |by| + |cx| + |cy|) + 2ε² + 3·2⁻²⁴(|cx·by| + |cy·bx|). Coordinates exceed neither 8 nor 8ε·2²⁰, so
/// four times the first two terms cover all, products that vanish included.
#[inline(always)]
pub(super) fn may_contain<S: Simd>(
    simd: S,
    [ax, ay, bx, by, cx, cy]: [f32x8<S>; 6],
    error: f32,
) -> mask32x8<S> {
    let (u, v, w) = (cx * by - cy * bx, ax * cy - ay * cx, bx * ay - by * ax);
    let reach = (ax.abs() + ay.abs()) + (bx.abs() + by.abs()) + (cx.abs() + cy.abs());
    let margin = (reach + f32x8::splat(simd, error)) * f32x8::splat(simd, 4.0 * error);
    u.min(v).min(w).simd_ge(-margin) | u.max(v).max(w).simd_le(margin)
}

/// Corners of eight triangles relative to the bundle's origin, sheared onto its middle ray.
#[inline(always)]
fn sheared<S: Simd>(simd: S, bundle: &Bundle, rows: [&[[f32; 8]; 3]; 3]) -> [[f32x8<S>; 3]; 3] {
    let splat = |x: f32| f32x8::splat(simd, x);
    let origin = each(|i| splat(bundle.origin[i] as f32));
    let (cx, cy) = (splat(bundle.centre[0]), splat(bundle.centre[1]));
    each(|corner| {
        let [x, y, z] = each(|i| f32x8::load_array_ref(simd, &rows[i][corner]) - origin[i]);
        [x - cx * z, y - cy * z, z]
    })
}

/// Sum of what |x| + |y| of the corners is at most for any ray.
#[inline(always)]
fn reach<S: Simd>(simd: S, bundle: &Bundle, corners: &[[f32x8<S>; 3]; 3]) -> f32x8<S> {
    let spread = f32x8::splat(simd, bundle.spread[0] + bundle.spread[1]);
    let reach = each(|i| corners[i][0].abs() + corners[i][1].abs() + corners[i][2].abs() * spread);
    reach[0] + reach[1] + reach[2]
}

/// Eight triangles as seen from the bundle's origin, sheared onto its middle ray: a ray's edge functions are linear in
/// its offset from the middle, so that two multiplications each are left for every ray.
///
/// With r = |x| + |y| + σ|z| of a corner (sheared; σ the sum of the spreads, below 0.4) the error of an edge function of
/// corners b and c is at most 1.4 ε(r_b + r_c) + 2.8 ε² for the coordinates' ε and 6·2⁻²⁴ r_b r_c for its own rounding.
struct Edges<S: Simd> {
    /// Per edge: per offset in x, per offset in y, on the middle ray.
    normals: [[f32x8<S>; 3]; 3],
    margin: f32x8<S>,
    corners: [[f32x8<S>; 3]; 3],
    /// Depths of the corners.
    depths: [f32x8<S>; 3],
}

/// [`Edges`] to be read by lane.
struct StoredEdges {
    normals: [[[f32; 8]; 3]; 3],
    margin: [f32; 8],
    nearest: [f32; 8],
}

impl<S: Simd> Edges<S> {
    #[inline(always)]
    fn new(simd: S, bundle: &Bundle, block: &Block) -> Self {
        let splat = |x: f32| f32x8::splat(simd, x);
        let corners = sheared(simd, bundle, each(|i| &block.corners[bundle.axes[i]]));
        let [a, b, c] = corners;
        let edge = |[cx, cy, cz]: [f32x8<S>; 3], [bx, by, bz]: [f32x8<S>; 3]| {
            [cy * bz - cz * by, cz * bx - cx * bz, cx * by - cy * bx]
        };
        let reach = reach(simd, bundle, &corners);
        let error = splat(bundle.error);
        let margin = reach * (error * 1.6 + reach * 1e-7) + error * error * 4.0;
        let depths = each(|i| corners[i][2] * bundle.sign);
        Self { normals: [edge(c, b), edge(a, c), edge(b, a)], margin, corners, depths }
    }

    /// Which triangles some ray may cross before the depth `limit`: no side of the pyramid, and no edge, has all of
    /// the other beyond it.
    #[inline(always)]
    fn candidates(&self, simd: S, bundle: &Bundle, limit: f32) -> u32 {
        let splat = |x: f32| f32x8::splat(simd, x);
        let error = 2.0 * bundle.error;
        let [a, b, c] = self.depths;
        let mut hits = a.min(b).min(c).simd_le(splat(limit + error)) & a.max(b).max(c).simd_ge(splat(-error));
        for side in 0..2 {
            let spread = splat(bundle.spread[side]);
            let [ax, bx, cx] = each(|corner| self.corners[corner][side]);
            let low = a.mul_add(spread, ax).max(b.mul_add(spread, bx)).max(c.mul_add(spread, cx));
            let high = (ax - a * spread).min(bx - b * spread).min(cx - c * spread);
            hits = hits & low.simd_ge(splat(-error)) & high.simd_le(splat(error));
        }
        let (sx, sy) = (splat(bundle.spread[0]), splat(bundle.spread[1]));
        let turn = |n: [f32x8<S>; 3]| n[0].abs() * sx + n[1].abs() * sy;
        let [u, v, w] = self.normals;
        let (du, dv, dw) = (turn(u), turn(v), turn(w));
        let front = (u[2] + du).min(v[2] + dv).min(w[2] + dw).simd_ge(-self.margin);
        let back = (u[2] - du).max(v[2] - dv).max(w[2] - dw).simd_le(self.margin);
        (hits & (front | back)).to_bitmask() as u32
    }

    #[inline(always)]
    fn store(&self) -> StoredEdges {
        let [a, b, c] = self.depths;
        StoredEdges {
            normals: each(|edge| each(|i| self.normals[edge][i].to_array())),
            margin: self.margin.to_array(),
            nearest: a.min(b).min(c).to_array(),
        }
    }
}

/// The four sides of the pyramid as `across − slope · depth`, compared with bounds that include the margin.
struct Pyramid {
    /// Across, across, main.
    axes: [usize; 3],
    /// Per side: axis (0 or 1), upper or lower face of the box, face along the main axis, slope, bound.
    slopes: [[f32; 2]; 2],
    bounds: [[f32; 2]; 2],
    /// Which main-axis face makes the sides' expressions extreme.
    deep: [[usize; 2]; 2],
    sign: f32,
    origin: f32,
    error: f32,
}

impl Pyramid {
    #[inline(always)]
    fn new(bundle: &Bundle) -> Self {
        let mut pyramid = Self {
            axes: bundle.axes,
            slopes: [[0.0; 2]; 2],
            bounds: [[0.0; 2]; 2],
            deep: [[0; 2]; 2],
            sign: bundle.sign,
            origin: bundle.origin[2] as f32 * bundle.sign,
            error: 2.0 * bundle.error,
        };
        for side in 0..2 {
            for end in 0..2 {
                let slope = bundle.sides[side][end] * bundle.sign;
                let at_origin = bundle.origin[side] as f32 - slope * bundle.origin[2] as f32;
                let margin = if end == 0 { -pyramid.error } else { pyramid.error };
                pyramid.slopes[side][end] = -slope;
                pyramid.bounds[side][end] = at_origin + margin;
                // The lower end's expression is to be largest, the upper end's smallest.
                pyramid.deep[side][end] = usize::from((slope < 0.0) == (end == 0));
            }
        }
        pyramid
    }

    #[inline(always)]
    fn boxes<S: Simd>(&self, simd: S, node: &Node, limit: f32) -> (f32x8<S>, f32x8<S>, u32) {
        let splat = |x: f32| f32x8::splat(simd, x);
        let depth = &node.bounds[self.axes[2]];
        let backwards = usize::from(self.sign < 0.0);
        let near = row(simd, depth, backwards) * splat(self.sign) - splat(self.origin);
        let far = row(simd, depth, backwards ^ 1) * splat(self.sign) - splat(self.origin);
        let near = (near - splat(self.error)).max(splat(0.0));
        let hits = self.box_side(simd, node, 0)
            & self.box_side(simd, node, 1)
            & near.simd_le(splat(limit))
            & far.simd_ge(splat(-self.error));
        // Empty lanes have their far face before the near one.
        let hits = hits & row(simd, depth, 0).simd_le(row(simd, depth, 1));
        (near, far, hits.to_bitmask() as u32)
    }

    #[inline(always)]
    fn box_side<S: Simd>(&self, simd: S, node: &Node, side: usize) -> mask32x8<S> {
        let splat = |x: f32| f32x8::splat(simd, x);
        let (depth, across) = (&node.bounds[self.axes[2]], &node.bounds[self.axes[side]]);
        let [low, high] = self.deep[side];
        let low = row(simd, depth, low).mul_add(splat(self.slopes[side][0]), row(simd, across, 1));
        let high = row(simd, depth, high).mul_add(splat(self.slopes[side][1]), row(simd, across, 0));
        low.simd_ge(splat(self.bounds[side][0])) & high.simd_le(splat(self.bounds[side][1]))
    }
}

#[inline(always)]
fn row<S: Simd>(simd: S, rows: &[[f32; 8]; 2], index: usize) -> f32x8<S> {
    f32x8::load_array_ref(simd, &rows[index & 1])
}
