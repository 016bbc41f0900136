//! Scan conversion: eight triangles are set up at once, then each goes through its tiles with a lane per scanline.

use super::bins::{TILE_HEIGHT, TILE_WIDTH};
use super::clip::draw_clipped;
use super::vertex::{NEEDS_CLIP, SIDES, Vertex};
use super::{Coverage, DepthBuffer, Faces};
use fearless_simd::{Simd, f32x8, i16x8, i32x4, i32x8, prelude::*, u8x16, u8x32};
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

/// Eight triangles on their way into the tiles. Lengths in 1/256 px.
struct Batch {
    /// Edges by which rows end: from the top corner to the bottom one, and the two on the other side.
    edges: [Edges; 3],
    /// Rows and columns whose centres the triangle's box spans: first, and one after the last.
    top: [i32; 8],
    bottom: [i32; 8],
    begin: [i32; 8],
    end: [i32; 8],
    /// Depth at the top corner, lowered by the error bound and to the farthest sample of a sub-tile.
    depth: [f32; 8],
    /// Change of depth per 1/256 px.
    dx: [f32; 8],
    dy: [f32; 8],
    /// Depth of the farthest corner.
    farthest: [f32; 8],
    /// The top corner.
    x: [i32; 8],
    y: [i32; 8],
    /// −1 where the two short edges lie on the right.
    right: [i32; 8],
    /// An estimated crossing that lies closer than this to the middle between two columns' centres is on its right side of them.
    sure: [f32; 8],
    usable: u32,
}

/// An edge of eight triangles. Of its points, dy · (x − x0) − dx · (y − y0) is zero, and grows to the right: zero belongs to
/// the inside of left edges and to the outside of right ones, so both ask for the first column where it is not negative.
struct Edges {
    /// Its upper end, in columns from the middle before `begin` and in 1/256 px, and how far it moves per 1/256 px.
    x: [f32; 8],
    y: [f32; 8],
    slope: [f32; 8],
    /// What the exact function is made of.
    left: [i32; 8],
    dx: [i32; 8],
    dy: [i32; 8],
}

#[inline(always)]
pub(super) fn draw<S: Simd, const EXACT: bool>(
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
                batch::<S, EXACT>(simd, buffer, &[v; 8], 1, faces);
            });
            continue;
        }
        chosen[count] = v;
        count += 1;
        if count == 8 {
            batch::<S, EXACT>(simd, buffer, &chosen, 8, faces);
            count = 0;
        }
    }
    if count > 0 {
        batch::<S, EXACT>(simd, buffer, &chosen, count, faces);
    }
    buffer.vertices = vertices;
}

#[inline(always)]
fn batch<S: Simd, const EXACT: bool>(
    simd: S,
    buffer: &mut DepthBuffer,
    v: &[[Vertex; 3]; 8],
    count: usize,
    faces: Faces,
) {
    let size = [buffer.width as i32, buffer.height as i32];
    let (batch, rows) = set_up(simd, v, faces, size);
    let mut left = batch.usable & ((1u32 << count) - 1);
    if left == 0 {
        return;
    }
    buffer.bins.touch(rows[0] as usize / TILE_HEIGHT, (rows[1] as usize).div_ceil(TILE_HEIGHT));
    buffer.stats.drawn += u64::from(left.count_ones());
    while left != 0 {
        let i = (left.trailing_zeros() & 7) as usize;
        left &= left - 1;
        rasterise::<S, EXACT>(simd, buffer, &batch, i);
    }
}

#[inline(always)]
fn set_up<S: Simd>(simd: S, v: &[[Vertex; 3]; 8], faces: Faces, size: [i32; 2]) -> (Batch, [i32; 2]) {
    // Closures between here and the vector operations might not be inlined, at a manifold price; hence macros.
    macro_rules! gather {
        ($vector:ident, $k:literal, $field:ident) => {
            $vector::simd_from(
                simd,
                [
                    v[0][$k].$field,
                    v[1][$k].$field,
                    v[2][$k].$field,
                    v[3][$k].$field,
                    v[4][$k].$field,
                    v[5][$k].$field,
                    v[6][$k].$field,
                    v[7][$k].$field,
                ],
            )
        };
    }
    let mut x = [gather!(i32x8, 0, x), gather!(i32x8, 1, x), gather!(i32x8, 2, x)];
    let mut y = [gather!(i32x8, 0, y), gather!(i32x8, 1, y), gather!(i32x8, 2, y)];
    let mut z = [gather!(f32x8, 0, z), gather!(f32x8, 1, z), gather!(f32x8, 2, z)];
    let mut even = i32x8::splat(simd, 0).simd_eq(0);
    macro_rules! sort {
        ($a:literal, $b:literal) => {
            let swap = y[$b].simd_lt(y[$a]);
            (x[$a], x[$b]) = (swap.select(x[$b], x[$a]), swap.select(x[$a], x[$b]));
            (y[$a], y[$b]) = (swap.select(y[$b], y[$a]), swap.select(y[$a], y[$b]));
            (z[$a], z[$b]) = (swap.select(z[$b], z[$a]), swap.select(z[$a], z[$b]));
            even ^= swap;
        };
    }
    sort!(0, 1);
    sort!(1, 2);
    sort!(0, 1);
    // Differences of at most 2²³ steps: exact.
    let (dx1, dy1) = (float(x[1] - x[0]), float(y[1] - y[0]));
    let (dx2, dy2) = (float(x[2] - x[0]), float(y[2] - y[0]));
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
    // Rows and columns whose centres lie in the triangle's box.
    let top = first(y[0]).max(0);
    let bottom = first(y[2]).min(size[1]);
    let begin = first(x[0].min(x[1]).min(x[2])).max(0);
    let end = first(x[0].max(x[1]).max(x[2])).min(size[0]);
    let usable = usable & top.simd_lt(bottom) & begin.simd_lt(end);
    // A level edge ends no row; the other short one then stands for both.
    let (level_upper, level_lower) = (y[0].simd_eq(y[1]), y[1].simd_eq(y[2]));
    let edges = [
        edges(simd, begin, [x[0], y[0]], [x[2], y[2]]),
        edges(
            simd,
            begin,
            [level_upper.select(x[1], x[0]), level_upper.select(y[1], y[0])],
            [level_upper.select(x[2], x[1]), level_upper.select(y[2], y[1])],
        ),
        edges(
            simd,
            begin,
            [level_lower.select(x[0], x[1]), level_lower.select(y[0], y[1])],
            [level_lower.select(x[1], x[2]), level_lower.select(y[1], y[2])],
        ),
    ];
    // An estimate among the triangle's columns is a product of at most the two others, rounded three times in all, and a sum,
    // rounded once: see docs/occlusion.md.
    let ends = float(x[0] - (begin << 8)).abs().max(float(x[1] - (begin << 8)).abs()) * (1.0 / 256.0);
    let sure = (ends + float(end - begin) + 2.0) * (-4.0 * U) + 0.5;
    let one = f32x8::splat(simd, 1.0);
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
    let flat = f32x8::splat(simd, 0.0);
    let farthest = z[0].min(z[1]).min(z[2]);
    let (depth, gx, gy) = (thick.select(depth, farthest), thick.select(gx, flat), thick.select(gy, flat));
    let zero = i32x8::splat(simd, 0);
    let far_up = usable.select(top, i32x8::splat(simd, i32::MAX));
    let far_down = usable.select(bottom, zero);
    let (far_up, far_down): ([i32; 8], [i32; 8]) = (far_up.into(), far_down.into());
    let rows = [far_up.into_iter().fold(i32::MAX, i32::min), far_down.into_iter().fold(0, i32::max)];
    let batch = Batch {
        edges,
        top: top.into(),
        bottom: bottom.into(),
        begin: begin.into(),
        end: end.into(),
        depth: depth.into(),
        dx: gx.into(),
        dy: gy.into(),
        farthest: farthest.into(),
        x: x[0].into(),
        y: y[0].into(),
        right: right.select(i32x8::splat(simd, -1), zero).into(),
        sure: sure.into(),
        usable: usable.to_bitmask() as u32,
    };
    (batch, rows)
}

#[inline(always)]
fn edges<S: Simd>(simd: S, begin: i32x8<S>, [x0, y0]: [i32x8<S>; 2], [x1, y1]: [i32x8<S>; 2]) -> Edges {
    let (dx, dy) = (x1 - x0, y1 - y0);
    // Without height the triangle has no rows; any slope will do.
    let level = dy.simd_eq(0);
    let slope = float(dx) / level.select(f32x8::splat(simd, 1.0), float(dy));
    Edges {
        x: (float(x0 - (begin << 8)) * (1.0 / 256.0) + 0.5).into(),
        y: float(y0).into(),
        slope: (slope * (1.0 / 256.0)).into(),
        left: x0.into(),
        dx: dx.into(),
        dy: dy.into(),
    }
}

#[inline(always)]
fn float<S: Simd>(v: i32x8<S>) -> f32x8<S> {
    f32x8::float_from(v)
}

/// The first row or column whose centre is not before a coordinate.
#[inline(always)]
fn first<S: Simd>(v: i32x8<S>) -> i32x8<S> {
    (v + 127) >> 8
}

/// Bits from `by` on; none for 32, for which a shift need not give zero.
#[inline(always)]
fn ones_from<S: Simd>(simd: S, by: i32x8<S>) -> i32x8<S> {
    let zero = i32x8::splat(simd, 0);
    let whole = by.simd_ge(32);
    whole.select(zero, i32x8::splat(simd, -1) << whole.select(zero, by))
}

impl Edges {
    /// For each row about where the edge crosses it, in columns from `begin`: the whole part is the number of columns whose
    /// centres are left of the edge. What is before the first or after the last of `most` columns is put half a column beyond.
    #[inline(always)]
    fn estimate<S: Simd>(&self, i: usize, centres: f32x8<S>, most: f32) -> f32x8<S> {
        ((centres - self.y[i]) * self.slope[i] + self.x[i]).max(0.5).min(most + 0.5)
    }

    /// Puts right an estimate that is off by at most one column. Exact although it wraps: so close to the edge the function is small.
    #[inline(always)]
    fn exact<S: Simd>(&self, i: usize, rows: i32x8<S>, columns: i32x8<S>, begin: i32) -> i32x8<S> {
        let (left, top, dx, dy) = (self.left[i], self.y[i] as i32, self.dx[i], self.dy[i]);
        let first = dy.wrapping_mul(128 + 256 * begin - left).wrapping_sub(dx.wrapping_mul(128 - top));
        let per_column = dy << 8;
        let value = columns * per_column - rows * (dx << 8) + first;
        // Shifts make −1 of negative numbers.
        columns - (value >> 31) - ((value - per_column) >> 31) - 1
    }
}

#[inline(always)]
fn rasterise<S: Simd, const EXACT: bool>(simd: S, buffer: &mut DepthBuffer, b: &Batch, i: usize) {
    let (top, bottom, begin, end) = (b.top[i], b.bottom[i], b.begin[i], b.end[i]);
    let tile_rows = top as usize / TILE_HEIGHT..(bottom as usize - 1) / TILE_HEIGHT + 1;
    let lanes = i32x8::simd_from(simd, [0, 1, 2, 3, 4, 5, 6, 7]);
    let most = (end - begin) as f32;
    let sure = f32x8::splat(simd, b.sure[i]);
    let right = i16x8::splat(simd, b.right[i] as i16).simd_lt(0);
    let short_lanes = i16x8::simd_from(simd, [0, 1, 2, 3, 4, 5, 6, 7]);
    let columns = buffer.bins.columns;
    // Depth at the first sample of each sub-tile of tile (0, 0), relative to the top corner.
    let (gx, gy) = (b.dx[i], b.dy[i]);
    let lane_x = f32x8::simd_from(simd, [0.0, 2048.0, 4096.0, 6144.0, 0.0, 2048.0, 4096.0, 6144.0]);
    let lane_y = f32x8::simd_from(simd, [0.0, 0.0, 0.0, 0.0, 1024.0, 1024.0, 1024.0, 1024.0]);
    let lane_depth = lane_x * gx + lane_y * gy + b.depth[i];
    let farthest = f32x8::splat(simd, b.farthest[i]);
    let tiles = [begin as usize / TILE_WIDTH, (end as usize - 1) / TILE_WIDTH + 1];
    for tile_row in tile_rows {
        let y = (tile_row * TILE_HEIGHT) as i32;
        let rows = lanes + y;
        let centres: f32x8<S> = f32x8::float_from((rows << 8) + 128);
        // Closures might not be inlined.
        macro_rules! each_edge {
            (|$k:ident| $body:expr) => {
                [
                    {
                        let $k = 0;
                        $body
                    },
                    {
                        let $k = 1;
                        $body
                    },
                    {
                        let $k = 2;
                        $body
                    },
                ]
            };
        }
        let estimates = each_edge!(|k| b.edges[k].estimate(i, centres, most));
        let mut crossings: [i32x8<S>; 3] = each_edge!(|k| i32x8::truncate_from(estimates[k]));
        if EXACT {
            // Rarely is an edge so close to a centre that rounding might decide.
            let off = each_edge!(|k| (estimates[k] - float(crossings[k]) - 0.5).abs());
            if off[0].max(off[1]).max(off[2]).simd_gt(sure).to_bitmask() != 0 {
                crossings = each_edge!(|k| {
                    let exact = b.edges[k].exact(i, rows, crossings[k], begin);
                    off[k].simd_gt(sure).select(exact, crossings[k])
                });
            }
        }
        // Columns fit 16 bits, for which every instruction set has minima.
        let [a, u, l] = each_edge!(|k| narrow(simd, crossings[k]));
        let from = right.select(a, u.max(l));
        let to = right.select(u.min(l), a);
        let rows = short_lanes + y as i16;
        let in_rows = rows.simd_ge(top as i16) & rows.simd_lt(bottom as i16);
        let to = in_rows.select(to, i16x8::splat(simd, 0));
        let mut tiles = tiles;
        // Where the box is wide most of its tiles may be empty.
        if tiles[1] - tiles[0] > 2 {
            let filled = from.simd_lt(to);
            let least = filled.select(from, i16x8::splat(simd, i16::MAX)).reduce_min();
            let most = filled.select(to, i16x8::splat(simd, 0)).reduce_max();
            if most == 0 {
                continue;
            }
            tiles = [
                (begin as usize + least as usize) / TILE_WIDTH,
                (begin as usize + most as usize - 1) / TILE_WIDTH + 1,
            ];
        }
        let down = gy * (y * 256 + 128 - b.y[i]) as f32;
        for tile_column in tiles[0]..tiles[1] {
            let x = (tile_column * TILE_WIDTH) as i32;
            let shift = (begin - x) as i16;
            let covered = sub_tiles(simd, from + shift, to + shift);
            let across = gx * (x * 256 + 128 - b.x[i]) as f32;
            let depth = (lane_depth + (across + down)).max(farthest);
            buffer.bins.merge(simd, tile_row * columns + tile_column, covered, depth);
        }
    }
}

/// Transposes 4 x 4 bytes, twice.
const TRANSPOSE: [u8; 32] = [
    0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15, 0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11,
    15,
];

/// Bits from an index on; none from 32 on.
static ONES_FROM: [u32; 64] = {
    let mut table = [0u32; 64];
    let mut i = 0;
    while i < 32 {
        table[i] = u32::MAX << i;
        i += 1;
    }
    table
};

/// From a lane per row to a lane per sub-tile: columns `from..to` of each row, relative to the tile.
#[inline(always)]
fn sub_tiles<S: Simd>(simd: S, from: i16x8<S>, to: i16x8<S>) -> i32x8<S> {
    let (from, to) = (from.max(0).min(32), to.max(0).min(32));
    if simd.level().as_sse4_2().is_some() || cfg!(not(any(target_arch = "x86", target_arch = "x86_64"))) {
        let rows = ones_from(simd, widen(simd, from)) & !ones_from(simd, widen(simd, to));
        let bytes: u8x32<S> = rows.bitcast();
        let order = u8x32::simd_from(simd, TRANSPOSE);
        let bytes: u8x32<S> = simd.swizzle_dyn_within_blocks_u8x32(bytes, order);
        return bytes.bitcast();
    }
    // SSE2 has no shifts by lane and no byte shuffles: a table, and two rounds of zips.
    let (f, t): ([i16; 8], [i16; 8]) = (from.into(), to.into());
    macro_rules! row {
        ($r:literal) => {
            (ONES_FROM[f[$r] as usize & 63] & !ONES_FROM[t[$r] as usize & 63]) as i32
        };
    }
    let a: u8x16<S> = i32x4::simd_from(simd, [row!(0), row!(4), row!(1), row!(5)]).bitcast();
    let b: u8x16<S> = i32x4::simd_from(simd, [row!(2), row!(6), row!(3), row!(7)]).bitcast();
    let (even, odd) = (simd.zip_low_u8x16(a, b), simd.zip_high_u8x16(a, b));
    let upper: i32x4<S> = simd.zip_low_u8x16(even, odd).bitcast();
    let lower: i32x4<S> = simd.zip_high_u8x16(even, odd).bitcast();
    simd.combine_i32x4(upper, lower)
}

#[inline(always)]
fn narrow<S: Simd>(simd: S, columns: i32x8<S>) -> i16x8<S> {
    let (upper, lower) = simd.split_i32x8(columns);
    simd.saturating_narrow_i32x4(upper, lower)
}

#[inline(always)]
fn widen<S: Simd>(simd: S, columns: i16x8<S>) -> i32x8<S> {
    let (upper, lower) = simd.widen_i16x8(columns);
    simd.combine_i32x4(upper, lower)
}
