//! Scan conversion: eight triangles are set up at once, then each goes through its tiles with a lane per scanline.

use super::bins::{TILE_HEIGHT, TILE_WIDTH};
use super::clip::draw_clipped;
use super::vertex::{NEEDS_CLIP, SIDES, Vertex};
use super::{Coverage, DepthBuffer, Faces};
use fearless_simd::{Simd, f32x8, i32x8, prelude::*, u8x32};
use glam::{DMat4, Vec3};

/// Unit roundoff of `f32`.
const U: f32 = f32::EPSILON * 0.5;

/// How far a corner may have moved when it was snapped, and by the projection's rounding, in 1/256 px along each axis, times
/// 1.2: what the gradient of a triangle that is not thin may have grown by.
const SNAP: f32 = 0.61;

/// A triangle is thin when its doubled area is below this many steps times the sum of its edges' coordinates: snapping may have
/// turned its plane over.
const THICK: f32 = 8.0;

/// Keeps bounds above what underflow may have lost.
const TINY: f32 = 1e-35;

/// A triangle whose doubled area is less than this share of the products it is the difference of is too thin.
const THINNEST: f32 = 1.0 / 1_048_576.0;

/// Eight triangles on their way into the tiles. Lengths in 1/256 px, corners from top to bottom.
struct Batch {
    x: [[i32; 8]; 3],
    y: [[i32; 8]; 3],
    /// Pixels per row along the edges 0-2, 0-1, 1-2.
    slope: [[f32; 8]; 3],
    /// Depth at corner 0, lowered by the error bound and to the farthest sample of a sub-tile.
    depth: [f32; 8],
    /// Change of depth per 1/256 px.
    dx: [f32; 8],
    dy: [f32; 8],
    /// Depth of the farthest corner.
    farthest: [f32; 8],
    /// Bit set where corner 1 lies to the right of edge 0-2.
    bulges_right: u32,
    usable: u32,
}

#[inline(always)]
pub(super) fn draw<S: Simd>(
    simd: S,
    buffer: &mut DepthBuffer,
    clip_from_local: &DMat4,
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    faces: Faces,
) {
    let vertices = std::mem::take(&mut buffer.vertices);
    let mut chosen = [[Vertex::default(); 3]; 8];
    let mut count = 0;
    for corners in triangles {
        let v = corners.map(|i| vertices[i as usize]);
        if v[0].code & v[1].code & v[2].code & SIDES != 0 {
            continue;
        }
        let clips = (v[0].code | v[1].code | v[2].code) & NEEDS_CLIP != 0;
        if clips || buffer.coverage == Coverage::Whole {
            let corners = corners.map(|i| positions[i as usize]);
            buffer.stats.clipped += u64::from(clips);
            draw_clipped(buffer, clip_from_local, corners, faces, |buffer, v| {
                batch(simd, buffer, &[v; 8], 1, faces);
            });
            continue;
        }
        chosen[count] = v;
        count += 1;
        if count == 8 {
            batch(simd, buffer, &chosen, 8, faces);
            count = 0;
        }
    }
    if count > 0 {
        batch(simd, buffer, &chosen, count, faces);
    }
    buffer.vertices = vertices;
}

#[inline(always)]
fn batch<S: Simd>(simd: S, buffer: &mut DepthBuffer, v: &[[Vertex; 3]; 8], count: usize, faces: Faces) {
    let batch = set_up(simd, v, faces);
    let mut left = batch.usable & ((1u32 << count) - 1);
    while left != 0 {
        let i = (left.trailing_zeros() & 7) as usize;
        left &= left - 1;
        rasterise(simd, buffer, &batch, i);
    }
}

#[inline(always)]
fn set_up<S: Simd>(simd: S, v: &[[Vertex; 3]; 8], faces: Faces) -> Batch {
    let xs = |k: usize| i32x8::simd_from(simd, std::array::from_fn(|i| v[i][k].x));
    let ys = |k: usize| i32x8::simd_from(simd, std::array::from_fn(|i| v[i][k].y));
    let zs = |k: usize| f32x8::simd_from(simd, std::array::from_fn(|i| v[i][k].z));
    let (mut x, mut y, mut z) = ([xs(0), xs(1), xs(2)], [ys(0), ys(1), ys(2)], [zs(0), zs(1), zs(2)]);
    let mut even = i32x8::splat(simd, 0).simd_eq(0);
    macro_rules! sort {
        ($a:literal, $b:literal) => {
            let swap = y[$b].simd_lt(y[$a]);
            (x[$a], x[$b]) = (swap.select(x[$b], x[$a]), swap.select(x[$a], x[$b]));
            (y[$a], y[$b]) = (swap.select(y[$b], y[$a]), swap.select(y[$a], y[$b]));
            (z[$a], z[$b]) = (swap.select(z[$b], z[$a]), swap.select(z[$a], z[$b]));
            even = even ^ swap;
        };
    }
    sort!(0, 1);
    sort!(1, 2);
    sort!(0, 1);
    // Differences of at most 2²³ steps: exact.
    let float = |a: i32x8<S>| -> f32x8<S> { f32x8::float_from(a) };
    let (dx1, dy1) = (float(x[1] - x[0]), float(y[1] - y[0]));
    let (dx2, dy2) = (float(x[2] - x[0]), float(y[2] - y[0]));
    let (dx3, dy3) = (float(x[2] - x[1]), float(y[2] - y[1]));
    let (p, q) = (dx1 * dy2, dx2 * dy1);
    let area = p - q;
    let terms = p.abs() + q.abs();
    let usable = area.abs().simd_gt(terms * THINNEST);
    let right = area.simd_gt(0.0);
    // Rows count downwards: with an even number of swaps a positive area appears clockwise.
    let usable = match faces {
        Faces::Both => usable,
        Faces::Front => usable & (right ^ even),
    };
    let one = f32x8::splat(simd, 1.0);
    let slope = |dx: f32x8<S>, dy: f32x8<S>| {
        let level = dy.simd_eq(0.0);
        level.select(f32x8::splat(simd, 0.0), dx / level.select(one, dy))
    };
    let (dz1, dz2) = (z[1] - z[0], z[2] - z[0]);
    let inverse = one / area;
    let gx = (dz1 * dy2 - dz2 * dy1) * inverse;
    let gy = (dz2 * dx1 - dz1 * dx2) * inverse;
    // What the gradients may be off by; see the derivation in docs/occlusion.md.
    let weight = inverse.abs() * (terms * inverse.abs() * (4.0 * U) + 8.0 * U);
    let off_x = (dz1 * dy2).abs() + (dz2 * dy1).abs();
    let off_y = (dz2 * dx1).abs() + (dz1 * dx2).abs();
    let reach_x = dx1.abs().max(dx2.abs());
    let reach_y = dy2;
    let steep = gx.abs() + gy.abs();
    let largest = z[0].abs().max(z[1].abs()).max(z[2].abs());
    // A corner of a sub-tile lies up to a tile beyond the triangle's box.
    let span = gx.abs() * (reach_x + 8192.0) + gy.abs() * (reach_y + 2048.0);
    let error = (off_x * reach_x + off_y * reach_y) * weight * 1.25
        + steep * SNAP
        + span * (8.0 * U)
        + largest * (8.0 * U)
        + TINY;
    // From a sub-tile's first sample to its farthest: 7 columns and 3 rows.
    let farther = gx.min(0.0) * 1792.0 + gy.min(0.0) * 768.0;
    let depth = z[0] - error + farther;
    // Of a thin triangle, and where a gradient overflows to NaN or infinity, only the farthest corner is certain.
    let extent = dx1.abs() + dx2.abs() + dy1.abs() + dy2.abs();
    let thick = area.abs().simd_ge(extent * THICK) & depth.abs().simd_lt(1e30) & steep.simd_lt(1e30);
    let zero = f32x8::splat(simd, 0.0);
    let farthest = z[0].min(z[1]).min(z[2]);
    let (depth, gx, gy) = (thick.select(depth, farthest), thick.select(gx, zero), thick.select(gy, zero));
    Batch {
        x: x.map(Into::into),
        y: y.map(Into::into),
        slope: [slope(dx2, dy2).into(), slope(dx1, dy1).into(), slope(dx3, dy3).into()],
        depth: depth.into(),
        dx: gx.into(),
        dy: gy.into(),
        farthest: farthest.into(),
        bulges_right: right.to_bitmask() as u32,
        usable: usable.to_bitmask() as u32,
    }
}

/// An edge by which columns of a row are inside or outside.
struct Edge<S: Simd> {
    x0: f32,
    slope: f32,
    y0: i32,
    /// Smallest column c with value + c · per_column ≥ 0 for `value` of a row: exact, in wrapping arithmetic.
    per_column: i32,
    per_row: i32,
    at_origin: i32x8<S>,
}

/// Columns beyond which crossings are clamped; they are off by at most one.
const CLAMP: f32 = 16_400.0;

impl<S: Simd> Edge<S> {
    #[inline(always)]
    fn new(simd: S, [x0, y0]: [i32; 2], [x1, y1]: [i32; 2], slope: f32) -> Self {
        let (dx, dy) = (x1.wrapping_sub(x0), y1.wrapping_sub(y0));
        // Downward edge: dy·(x − x0) − dx·(y − y0) grows with x; zero belongs to the left edge's inside, and to the
        // right edge's outside. Both ask for the first column at which it is not negative.
        let per_column = dy.wrapping_mul(256);
        let per_row = dx.wrapping_mul(-256);
        let value =
            dy.wrapping_mul(128i32.wrapping_sub(x0)).wrapping_sub(dx.wrapping_mul(128i32.wrapping_sub(y0)));
        Self {
            x0: x0 as f32 * (1.0 / 256.0) - 0.5,
            slope,
            y0,
            per_column,
            per_row,
            at_origin: i32x8::splat(simd, value),
        }
    }

    /// For eight rows from `row` on, the first column whose centre is on or right of the edge.
    #[inline(always)]
    fn crossing(&self, simd: S, rows: i32x8<S>, centres: f32x8<S>) -> i32x8<S> {
        let estimate = (centres - self.y0 as f32) * (self.slope * (1.0 / 256.0)) + self.x0;
        let estimate = estimate.ceil().min(CLAMP).max(-CLAMP);
        let column: i32x8<S> = i32x8::truncate_from(estimate);
        let value = self.at_origin + rows * self.per_row + column * self.per_column;
        let zero = i32x8::splat(simd, 0);
        let before = value - self.per_column;
        let late = value.simd_lt(zero);
        let early = before.simd_ge(zero);
        // Masks are −1 where true.
        column + late.select(i32x8::splat(simd, 1), zero) - early.select(i32x8::splat(simd, 1), zero)
    }
}

#[inline(always)]
fn rasterise<S: Simd>(simd: S, buffer: &mut DepthBuffer, b: &Batch, i: usize) {
    let corner = |k: usize| [b.x[k][i], b.y[k][i]];
    let (c0, c1, c2) = (corner(0), corner(1), corner(2));
    // Rows whose centres lie in [top, bottom), columns that the corners span.
    let first = |v: i32| (v + 127) >> 8;
    let top = first(c0[1]).max(0);
    let bottom = first(c2[1]).min(buffer.height as i32);
    let begin = first(c0[0].min(c1[0]).min(c2[0])).max(0);
    let end = first(c0[0].max(c1[0]).max(c2[0])).min(buffer.width as i32);
    if top >= bottom || begin >= end {
        return;
    }
    buffer.stats.drawn += 1;
    let right = b.bulges_right >> i & 1 != 0;
    let long = Edge::new(simd, c0, c2, b.slope[0][i]);
    let upper = Edge::new(simd, c0, c1, b.slope[1][i]);
    let lower = Edge::new(simd, c1, c2, b.slope[2][i]);
    let level_upper = c0[1] == c1[1];
    let level_lower = c1[1] == c2[1];
    let tile_rows = top as usize / TILE_HEIGHT..(bottom as usize - 1) / TILE_HEIGHT + 1;
    buffer.bins.touch(tile_rows.start, tile_rows.end);
    let lanes = i32x8::simd_from(simd, [0, 1, 2, 3, 4, 5, 6, 7]);
    let columns = buffer.bins.columns;
    // Depth at the first sample of each sub-tile of tile (0, 0), relative to corner 0.
    let (gx, gy) = (b.dx[i], b.dy[i]);
    let lane_x = f32x8::simd_from(simd, [0.0, 2048.0, 4096.0, 6144.0, 0.0, 2048.0, 4096.0, 6144.0]);
    let lane_y = f32x8::simd_from(simd, [0.0, 0.0, 0.0, 0.0, 1024.0, 1024.0, 1024.0, 1024.0]);
    let lane_depth = lane_x * gx + lane_y * gy + b.depth[i];
    let farthest = f32x8::splat(simd, b.farthest[i]);
    for tile_row in tile_rows {
        let y = (tile_row * TILE_HEIGHT) as i32;
        let rows = lanes + y;
        let centres: f32x8<S> = f32x8::float_from(rows * 256 + 128);
        let a = long.crossing(simd, rows, centres);
        // A level edge bounds no row; the other short edge then stands for both.
        let (u, l) = match (level_upper, level_lower) {
            (true, _) => {
                let l = lower.crossing(simd, rows, centres);
                (l, l)
            }
            (_, true) => {
                let u = upper.crossing(simd, rows, centres);
                (u, u)
            }
            _ => (upper.crossing(simd, rows, centres), lower.crossing(simd, rows, centres)),
        };
        let (from, to) = if right { (a, u.min(l)) } else { (u.max(l), a) };
        let from = from.max(begin);
        let to = to.min(end);
        let in_rows = rows.simd_ge(top) & rows.simd_lt(bottom);
        let to = in_rows.select(to, i32x8::splat(simd, 0));
        let filled = from.simd_lt(to);
        if !filled.any_true() {
            continue;
        }
        let from = filled.select(from, i32x8::splat(simd, i32::MAX));
        let to = filled.select(to, i32x8::splat(simd, 0));
        let (least, most) = (from.reduce_min(), to.reduce_max());
        let down = (y * 256 + 128 - c0[1]) as f32;
        for tile_column in least as usize / TILE_WIDTH..(most as usize - 1) / TILE_WIDTH + 1 {
            let x = (tile_column * TILE_WIDTH) as i32;
            let covered = sub_tiles(simd, from - x, to - x);
            let across = (x * 256 + 128 - c0[0]) as f32;
            let depth = (lane_depth + (gx * across + gy * down)).max(farthest);
            buffer.bins.merge(simd, tile_row * columns + tile_column, covered, depth);
        }
    }
}

/// From a lane per row to a lane per sub-tile: columns `from..to` of each row, relative to the tile.
#[inline(always)]
fn sub_tiles<S: Simd>(simd: S, from: i32x8<S>, to: i32x8<S>) -> i32x8<S> {
    let from = from.max(0).min(32);
    let to = to.max(0).min(32);
    if simd.level().as_sse4_2().is_some() || cfg!(not(any(target_arch = "x86", target_arch = "x86_64"))) {
        // A shift by 32 need not give zero.
        let ones = |by: i32x8<S>| {
            let whole = by.simd_ge(32);
            whole.select(
                i32x8::splat(simd, 0),
                i32x8::splat(simd, -1) << whole.select(i32x8::splat(simd, 0), by),
            )
        };
        let rows = ones(from) & !ones(to);
        let bytes: u8x32<S> = rows.bitcast();
        const TRANSPOSE: [u8; 16] = [0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15];
        let order = u8x32::simd_from(simd, std::array::from_fn(|i| TRANSPOSE[i % 16]));
        let bytes: u8x32<S> = simd.swizzle_dyn_within_blocks_u8x32(bytes, order);
        return bytes.bitcast();
    }
    // Without variable shifts and byte shuffles scalar code is faster than emulation.
    let (from, to): ([i32; 8], [i32; 8]) = (from.into(), to.into());
    let row = |r: usize| ((1u64 << to[r]) as i64 - (1u64 << from[r].min(to[r])) as i64) as u32;
    let half = |r: usize| {
        // Bytes of four rows, 4 x 4, transposed by swapping blocks.
        let (a, b, c, d) = (row(r), row(r + 1), row(r + 2), row(r + 3));
        let (p, q) = ((a & 0x00ff_00ff) | (b & 0x00ff_00ff) << 8, (a >> 8 & 0x00ff_00ff) | (b & 0xff00_ff00));
        let (s, t) = ((c & 0x00ff_00ff) | (d & 0x00ff_00ff) << 8, (c >> 8 & 0x00ff_00ff) | (d & 0xff00_ff00));
        [
            (p & 0xffff) | s << 16,
            (q & 0xffff) | t << 16,
            p >> 16 | (s & 0xffff_0000),
            q >> 16 | (t & 0xffff_0000),
        ]
    };
    let ([a, b, c, d], [e, f, g, h]) = (half(0), half(4));
    i32x8::simd_from(simd, [a, b, c, d, e, f, g, h].map(|m| m as i32))
}
