//! Closest points on the mesh, and triangles that meet a box, on the same tree.

use super::bvh8::Bvh8;
use super::single::Stack;
use super::tree::{BLOCK, Block, Node, STACK};
use crate::bounds::DAabb;
use fearless_simd::{Simd, dispatch};
use glam::DVec3;

/// Queries that one job of a parallel batch answers.
#[cfg(feature = "rayon")]
const JOB: usize = 256;

/// Keeps box distances from exceeding the triangle's by their few roundings.
const BELOW: f64 = 1.0 - 1e-14;

/// The point of a mesh that is closest to a query.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Squared distance, in square world units.
    pub distance_sq: f64,
    /// Where, in world coordinates.
    pub point: DVec3,
    /// On which triangle; the lowest of those at the same computed distance.
    pub triangle: u32,
}

#[derive(Clone, Copy)]
struct Nearest {
    distance_sq: f64,
    point: DVec3,
    triangle: u32,
    block: usize,
    lane: usize,
}

impl Bvh8 {
    /// The point of the mesh closest to `point`, if it is not farther than `max_distance`.
    ///
    /// Triangles without area count as the segment or point that they are.
    ///
    /// # Accuracy
    /// Computed in `f64`: the distance is off by about 1e-15 of the larger of it and the triangle's extent.
    ///
    /// # Cost
    /// O(log n) near the surface; a small `max_distance` ends the search early.
    pub fn closest_point(&self, point: DVec3, max_distance: f64) -> Option<SurfacePoint> {
        dispatch!(self.level, simd => search(simd, self, point, max_distance, None, &mut Stack::new()))
            .map(|nearest| self.surface_point(&nearest))
    }

    /// [`closest_point`](Self::closest_point) for many points; faster when neighbours in the list are neighbours in space.
    /// `found` is as long as `points`.
    pub fn closest_points(&self, points: &[DVec3], max_distance: f64, found: &mut [Option<SurfacePoint>]) {
        #[cfg(feature = "rayon")]
        if points.len() > JOB {
            use rayon::prelude::*;
            points.par_chunks(JOB).zip(found.par_chunks_mut(JOB)).for_each(|(points, found)| {
                dispatch!(self.level, simd => search_all(simd, self, points, max_distance, found));
            });
            return;
        }
        dispatch!(self.level, simd => search_all(simd, self, points, max_distance, found));
    }

    /// Triangles that share a point with `bounds`, touching included, in ascending order.
    ///
    /// # Accuracy
    /// A separating-axis test in `f64`; what its rounding (1e-15 of the coordinates) leaves open counts as sharing.
    pub fn overlapping(&self, bounds: &DAabb) -> Vec<u32> {
        let mut found = Vec::new();
        if bounds.is_empty() || self.tree.nodes.is_empty() {
            return found;
        }
        let (min, max) = (self.frame.point(bounds.min), self.frame.point(bounds.max));
        // The conversion rounds relative to the origin's distance as well.
        let slack = DVec3::splat(1e-15) * (1.0 + min.abs().max(max.abs()).max_element());
        let (min, max) = (min - slack, max + slack);
        let mut waiting = vec![0];
        while let Some(current) = waiting.pop() {
            if current & BLOCK == 0 {
                let node = &self.tree.nodes[current as usize];
                let meets = |lane: usize| {
                    (0..3).all(|axis| {
                        let [lower, upper] = &node.bounds[axis];
                        f64::from(lower[lane]) <= max[axis] && f64::from(upper[lane]) >= min[axis]
                    })
                };
                waiting.extend((0..8).filter(|&lane| meets(lane)).map(|lane| node.children[lane]));
            } else {
                let block = &self.tree.blocks[(current & !BLOCK) as usize];
                let used = (0..8).filter(|&lane| !block.corners[0][0][lane].is_nan());
                let meets = |lane: &usize| overlaps(block.triangle(*lane).map(|p| p.as_dvec3()), min, max);
                found.extend(used.filter(meets).map(|lane| block.ids[lane]));
            }
        }
        found.sort_unstable();
        found
    }

    fn surface_point(&self, nearest: &Nearest) -> SurfacePoint {
        let scale = self.frame.scale();
        SurfacePoint {
            distance_sq: nearest.distance_sq / scale / scale,
            point: self.frame.world_point(nearest.point),
            triangle: nearest.triangle,
        }
    }
}

#[inline(always)]
fn search_all<S: Simd>(
    simd: S,
    caster: &Bvh8,
    points: &[DVec3],
    max_distance: f64,
    found: &mut [Option<SurfacePoint>],
) {
    let (mut stack, mut last) = (Stack::new(), None);
    for (&point, found) in points.iter().zip(found) {
        let nearest = search(simd, caster, point, max_distance, last, &mut stack);
        *found = nearest.as_ref().map(|nearest| caster.surface_point(nearest));
        last = nearest.map(|nearest| (nearest.block, nearest.lane)).or(last);
    }
}

/// Depth-first, nearest box first. `hint` is a triangle likely to be close, which only saves time.
#[inline(always)]
fn search<S: Simd>(
    _: S,
    caster: &Bvh8,
    point: DVec3,
    max_distance: f64,
    hint: Option<(usize, usize)>,
    stack: &mut Stack,
) -> Option<Nearest> {
    let (tree, stack) = (&caster.tree, &mut stack.0);
    let point = caster.frame.point(point);
    if !point.is_finite() || max_distance.is_nan() || max_distance < 0.0 {
        return None;
    }
    let reach = max_distance * caster.frame.scale();
    let (distance_sq, block) = (reach * reach, usize::MAX);
    let mut best = Nearest { distance_sq, point, triangle: u32::MAX, block, lane: 0 };
    if let Some((block, lane)) = hint {
        best.offer(tree.blocks.get(block)?, block, lane, point);
    }
    let (mut height, mut current) = (0, 0);
    loop {
        if current & BLOCK == 0 {
            let node = tree.nodes.get(current as usize)?;
            let distances = to_boxes(node, point);
            let base = height;
            for lane in 0..8 {
                let empty = distances[lane] == f64::INFINITY;
                if distances[lane] > best.distance_sq || empty {
                    continue;
                }
                // The distance in f32, rounded down, orders the stack.
                let key = (distances[lane] as f32).next_down().max(0.0);
                let entry = u64::from(key.to_bits()) << 32 | u64::from(node.children[lane]);
                let mut at = height;
                while at > base && stack[(at - 1) & (STACK - 1)] < entry {
                    stack[at & (STACK - 1)] = stack[(at - 1) & (STACK - 1)];
                    at -= 1;
                }
                stack[at & (STACK - 1)] = entry;
                height += 1;
            }
        } else {
            let index = (current & !BLOCK) as usize;
            let block = tree.blocks.get(index)?;
            let distances = to_triangle_boxes(block, point);
            for lane in 0..8 {
                let spare = distances[lane] == f64::INFINITY;
                if distances[lane] <= best.distance_sq && !spare {
                    best.offer(block, index, lane, point);
                }
            }
        }
        loop {
            if height == 0 {
                return (best.block != usize::MAX).then_some(best);
            }
            height -= 1;
            let entry = stack[height & (STACK - 1)];
            if f64::from(f32::from_bits((entry >> 32) as u32)) <= best.distance_sq {
                current = entry as u32;
                break;
            }
        }
    }
}

impl Nearest {
    #[inline(always)]
    fn offer(&mut self, block: &Block, index: usize, lane: usize, point: DVec3) {
        let corners = [0, 1, 2];
        let corners = corners.map(|i| block.corner(lane, i).as_dvec3());
        let (distance_sq, closest) = to_triangle(point, corners);
        let triangle = block.ids[lane & 7];
        let nearer = distance_sq < self.distance_sq;
        if nearer || (distance_sq == self.distance_sq && triangle < self.triangle) {
            *self = Self { distance_sq, point: closest, triangle, block: index, lane };
        }
    }
}

/// Lower bounds of the squared distances to the eight boxes; infinite for empty lanes.
#[inline(always)]
fn to_boxes(node: &Node, point: DVec3) -> [f64; 8] {
    let mut sum = [0.0; 8];
    for axis in 0..3 {
        let [lower, upper] = &node.bounds[axis];
        for lane in 0..8 {
            let outside = outside(lower[lane], upper[lane], point[axis]);
            sum[lane] += outside * outside;
        }
    }
    for lane in 0..8 {
        let empty = node.bounds[0][0][lane] > node.bounds[0][1][lane];
        sum[lane] = if empty { f64::INFINITY } else { sum[lane] * BELOW };
    }
    sum
}

/// The same for the boxes of a block's triangles.
#[inline(always)]
fn to_triangle_boxes(block: &Block, point: DVec3) -> [f64; 8] {
    let mut sum = [0.0; 8];
    for axis in 0..3 {
        let [a, b, c] = &block.corners[axis];
        for lane in 0..8 {
            let (a, b, c) = (a[lane], b[lane], c[lane]);
            let (low, high) = (if a < b { a } else { b }, if a < b { b } else { a });
            let (low, high) = (if low < c { low } else { c }, if high > c { high } else { c });
            let outside = outside(low, high, point[axis]);
            sum[lane] += outside * outside;
        }
    }
    for lane in 0..8 {
        let spare = block.corners[0][0][lane].is_nan();
        sum[lane] = if spare { f64::INFINITY } else { sum[lane] * BELOW };
    }
    sum
}

#[inline(always)]
fn outside(low: f32, high: f32, p: f64) -> f64 {
    let (below, above) = (f64::from(low) - p, p - f64::from(high));
    let outside = if below > above { below } else { above };
    if outside > 0.0 { outside } else { 0.0 }
}

/// Squared distance to a triangle, and the closest point.
#[inline(always)]
fn to_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> (f64, DVec3) {
    let (ab, bc, ca) = (b - a, c - b, a - c);
    let (ap, bp, cp) = (p - a, p - b, p - c);
    let normal = ab.cross(-ca);
    let normal_sq = normal.length_squared();
    let inside =
        normal.cross(ab).dot(ap) >= 0.0 && normal.cross(bc).dot(bp) >= 0.0 && normal.cross(ca).dot(cp) >= 0.0;
    if inside && normal_sq > 0.0 {
        // The corner closest to the point loses least to cancellation.
        let height = normal.dot(ap) / normal_sq;
        let offset = normal * height;
        return (offset.length_squared(), p - offset);
    }
    let on_ab = to_segment(ap, ab);
    let on_bc = to_segment(bp, bc);
    let on_ca = to_segment(cp, ca);
    let mut nearest = (on_ab.0, a + ab * on_ab.1);
    if on_bc.0 < nearest.0 {
        nearest = (on_bc.0, b + bc * on_bc.1);
    }
    if on_ca.0 < nearest.0 {
        nearest = (on_ca.0, c + ca * on_ca.1);
    }
    nearest
}

/// Squared distance to a segment from the start of which the point lies at `offset`, and where along it.
#[inline(always)]
fn to_segment(offset: DVec3, edge: DVec3) -> (f64, f64) {
    let (along, length_sq) = (offset.dot(edge), edge.length_squared());
    let at = if along <= 0.0 || length_sq == 0.0 { 0.0 } else { (along / length_sq).min(1.0) };
    ((offset - edge * at).length_squared(), at)
}

/// Whether a triangle and a box share a point, by the 13 axes that could separate them.
fn overlaps(triangle: [DVec3; 3], min: DVec3, max: DVec3) -> bool {
    let (centre, half) = ((min + max) * 0.5, (max - min) * 0.5);
    let v = triangle.map(|p| p - centre);
    let edges = [v[1] - v[0], v[2] - v[1], v[0] - v[2]];
    let size = v.iter().fold(half, |size, p| size.max(p.abs()));
    let separates = |axis: DVec3| {
        let d = v.map(|p| p.dot(axis));
        let radius = half.dot(axis.abs()) + 1e-15 * size.dot(axis.abs());
        d[0].min(d[1]).min(d[2]) > radius || d[0].max(d[1]).max(d[2]) < -radius
    };
    let crossed = DVec3::AXES.into_iter().flat_map(|axis| edges.map(|edge| axis.cross(edge)));
    !DVec3::AXES.into_iter().chain([edges[0].cross(edges[1])]).chain(crossed).any(separates)
}
