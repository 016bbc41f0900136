//! From three projected corners to covered pixels.
//!
//! Corners are snapped to 1/256 px. Coverage follows from exact integer edge functions with the top-left rule, so
//! triangles that share an edge cover each pixel along it exactly once. Integers stay below 2⁵³ and are carried in `f64`.

use crate::target::GROUP;
use fearless_simd::{Simd, f32x8, i32x8, prelude::*};
use glam::DVec4;

/// Steps per pixel that corners are snapped to.
pub const SUBPIXELS: f64 = 256.0;

/// A triangle smaller than this (in px², before snapping) has no usable depth slope; it gets its farthest depth.
const FLAT_AREA: f64 = 1e-9;

/// A projected vertex.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Vertex {
    /// Pixel position.
    pub(crate) x: f64,
    pub(crate) y: f64,
    /// Depth, 1 near to 0 far; beyond that where depth is clamped.
    pub(crate) z: f64,
    pub(crate) w: f64,
    /// Pixel position in 1/256 px.
    snapped: [i32; 2],
    pub(crate) outcode: u32,
}

impl Vertex {
    /// Projects a clip-space point within the guard band.
    #[inline(always)]
    pub(crate) fn project(p: DVec4, viewport: &crate::clip::Viewport, outcode: u32) -> Self {
        let px = viewport.homogeneous_px(p) / p.w;
        // Not clamped here: that would tilt the plane of a triangle that reaches beyond the depth range.
        let z = p.z / p.w;
        // The bias makes truncation a floor; NaN and huge values saturate and are never used (they need clipping).
        const BIAS: f64 = 16_777_216.5;
        let snap = |v: f64| ((v * SUBPIXELS + BIAS) as i32).wrapping_sub(1 << 24);
        Self { x: px.x, y: px.y, z, w: p.w, snapped: [snap(px.x), snap(px.y)], outcode }
    }

    /// Pixel coordinates times w, and w.
    pub(crate) fn homogeneous(&self) -> glam::DVec3 {
        glam::DVec3::new(self.x * self.w, self.y * self.w, self.w)
    }
}

/// Pixels that may be touched: half-open ranges.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Window {
    pub(crate) x: [i32; 2],
    pub(crate) y: [i32; 2],
}

/// Which triangles are dropped for the side that they show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Cull {
    /// None.
    #[default]
    None,
    /// Those that appear clockwise.
    Back,
    /// Those that appear counter-clockwise.
    Front,
}

/// An edge that bounds rows on one side: its crossing with a row is `value · slope + offset`, exact after truncation.
#[derive(Clone, Copy, Default)]
struct Bound {
    value: f64,
    per_row: f64,
    slope: f64,
    offset: f64,
}

/// A triangle ready for scan conversion.
pub(crate) struct Setup {
    left: [Bound; 2],
    right: [Bound; 2],
    rows: [i32; 2],
    /// Depth at the centre of pixel (0, 0), and its slopes.
    depth: [f64; 3],
    depth_range: [f32; 2],
}

impl Setup {
    /// [`Culled`] when the triangle is turned away or has no area after snapping, `None` when it misses every row of the window.
    #[inline(always)]
    pub(crate) fn new(v: &[&Vertex; 3], cull: Cull, window: &Window) -> Result<Option<Self>, Culled> {
        let [mut a, mut b, c] = v.map(|v| v.snapped.map(i64::from));
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
        // Pixel rows count downward, so a triangle that appears counter-clockwise has negative area.
        let turned_away = match cull {
            Cull::None => false,
            Cull::Back => area > 0,
            Cull::Front => area < 0,
        };
        if area == 0 || turned_away {
            return Err(Culled);
        }
        if area < 0 {
            std::mem::swap(&mut a, &mut b);
        }
        // A row is touched when its centre lies in [top, bottom): what the top-left rule says of the end points.
        let row = |y: i64| ((y + 127) >> 8) as i32;
        let top = row(a[1].min(b[1]).min(c[1])).max(window.y[0]);
        let bottom = row(a[1].max(b[1]).max(c[1])).min(window.y[1]);
        if top >= bottom {
            return Ok(None);
        }
        let (left, right) = Self::bounds(&[a, b, c], top);
        let (depth, depth_range) = Self::depth_plane(v);
        Ok(Some(Self { left, right, rows: [top, bottom], depth, depth_range }))
    }

    /// Left and right bounds at row `top`. A side with one edge has it twice; horizontal edges bound nothing.
    #[inline(always)]
    fn bounds(corners: &[[i64; 2]; 3], top: i32) -> ([Bound; 2], [Bound; 2]) {
        let mut left = [Bound::default(); 2];
        let mut right = [Bound::default(); 2];
        let (mut lefts, mut rights) = (0, 0);
        for i in 0..3 {
            let (p, q) = (corners[i], corners[(i + 1) % 3]);
            let (dx, dy) = (q[0] - p[0], q[1] - p[1]);
            if dy == 0 {
                continue;
            }
            // E(x, y) = dx·(y − p.y) − dy·(x − p.x) ≥ 0 inside; right edges exclude their own points.
            let is_left = dy < 0;
            let value = dx * (256 * i64::from(top) + 128 - p[1]) - dy * (128 - p[0]) - i64::from(!is_left);
            let inverse = 1.0 / (256 * dy.abs()) as f64;
            let (value, per_row) = (value as f64, (256 * dx) as f64);
            // The half keeps the quotient away from whole numbers by more than its rounding error: with |dy| < 2²⁴ the
            // nearest other multiple is 2⁻³³ away, rounding moves values up to 2¹⁵ by less than 2⁻³⁷.
            if is_left {
                let bound = Bound { value, per_row, slope: -inverse, offset: 1.0 - 0.5 * inverse };
                left[lefts & 1] = bound;
                left[1] = bound;
                lefts += 1;
            } else {
                let bound = Bound { value, per_row, slope: inverse, offset: 1.0 + 0.5 * inverse };
                right[rights & 1] = bound;
                right[1] = bound;
                rights += 1;
            }
        }
        (left, right)
    }

    /// The plane of depth through the corners before snapping: at a pixel's centre it is the surface's own depth.
    #[inline(always)]
    fn depth_plane(v: &[&Vertex; 3]) -> ([f64; 3], [f32; 2]) {
        let [a, b, c] = *v;
        let (x1, y1, z1) = (b.x - a.x, b.y - a.y, b.z - a.z);
        let (x2, y2, z2) = (c.x - a.x, c.y - a.y, c.z - a.z);
        let area = x1 * y2 - x2 * y1;
        let (low, high) = (a.z.min(b.z).min(c.z).clamp(0.0, 1.0), a.z.max(b.z).max(c.z).clamp(0.0, 1.0));
        let range = [low as f32, high as f32];
        if area.abs() < FLAT_AREA {
            return ([low, 0.0, 0.0], range);
        }
        // Slopes beyond this only occur for slivers, whose depth the range limits; it keeps f32 finite.
        const STEEPEST: f64 = 1e30;
        let inverse = 1.0 / area;
        let dx = ((z1 * y2 - z2 * y1) * inverse).clamp(-STEEPEST, STEEPEST);
        let dy = ((x1 * z2 - x2 * z1) * inverse).clamp(-STEEPEST, STEEPEST);
        ([a.z + dx * (0.5 - a.x) + dy * (0.5 - a.y), dx, dy], range)
    }

    /// Hands the covered pixels to `sink`, in aligned groups of eight, row by row.
    #[inline(always)]
    pub(crate) fn scan<S: Simd, K: Sink<S>>(&self, simd: S, window: &Window, sink: &mut K) {
        let lanes = i32x8::simd_from(simd, [0, 1, 2, 3, 4, 5, 6, 7]);
        let slope = f32x8::simd_from(simd, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]) * self.depth[1] as f32;
        let low = f32x8::splat(simd, self.depth_range[0]);
        let high = f32x8::splat(simd, self.depth_range[1]);
        let (x_min, x_max) = (f64::from(window.x[0]), f64::from(window.x[1]));
        let [mut l0, mut l1] = self.left.map(|b| b.value);
        let [mut r0, mut r1] = self.right.map(|b| b.value);
        for y in self.rows[0]..self.rows[1] {
            let at = |b: &Bound, value: f64| value * b.slope + b.offset;
            let begin = at(&self.left[0], l0).max(at(&self.left[1], l1)).max(x_min).min(x_max) as i32;
            let end = at(&self.right[0], r0).min(at(&self.right[1], r1)).max(x_min).min(x_max) as i32;
            l0 += self.left[0].per_row;
            l1 += self.left[1].per_row;
            r0 += self.right[0].per_row;
            r1 += self.right[1].per_row;
            if begin >= end {
                continue;
            }
            sink.row(y, begin, end);
            let row_depth = self.depth[0] + self.depth[2] * f64::from(y);
            let mut x = begin & !(GROUP as i32 - 1);
            while x < end {
                // Starting every group from f64 makes depth a function of the pixel alone, whatever the window.
                let base = (row_depth + self.depth[1] * f64::from(x)) as f32;
                let depth = (slope + base).max(low).min(high);
                let inside = lanes.simd_ge(begin - x) & lanes.simd_lt(end - x);
                sink.group(simd, x, y, inside, depth);
                x += GROUP as i32;
            }
        }
    }
}

/// Turned away or without area.
pub(crate) struct Culled;

/// Receives covered pixels.
pub(crate) trait Sink<S: Simd> {
    /// A row's covered range is known; its groups follow.
    fn row(&mut self, y: i32, begin: i32, end: i32);
    /// Eight pixels from `x` on, a multiple of eight.
    fn group(&mut self, simd: S, x: i32, y: i32, inside: fearless_simd::mask32x8<S>, depth: f32x8<S>);
}
