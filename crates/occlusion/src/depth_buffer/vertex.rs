//! From positions to pixels.

use fearless_simd::{Simd, f64x4, prelude::*};
use glam::{DMat4, DVec3, DVec4, Vec3};

/// Steps per pixel that corners are snapped to.
pub(super) const SUBPIXELS: f64 = 256.0;

/// Largest distance of a corner from the image's corner in pixels; what is beyond is clipped.
pub(super) const GUARD: f64 = 8190.0;

/// Set when a corner's triangles cannot be drawn without clipping.
pub(super) const NEEDS_CLIP: u32 = 64;
/// Bits of the sides of the image beyond which a corner lies.
pub(super) const SIDES: u32 = 31;

/// A projected corner.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Vertex {
    /// Pixel position in 1/256 px.
    pub(super) x: i32,
    pub(super) y: i32,
    /// Depth, rounded away from the eye.
    pub(super) z: f32,
    pub(super) code: u32,
}

/// Adding this leaves a whole number in the low bits of an `f64`.
const WHOLE: f64 = 6_755_399_441_055_744.0;
/// Shift that makes coordinates positive, and the half that makes a floor round.
const BIAS: f64 = 16_777_216.5;

pub(super) fn to_clip(m: &DMat4, p: Vec3) -> DVec4 {
    let p = DVec3::new(p.x.into(), p.y.into(), p.z.into());
    m.x_axis * p.x + m.y_axis * p.y + m.z_axis * p.z + m.w_axis
}

/// Transforms all positions, four at a time. The order of operations is that of a plain renderer in `f64` without fused
/// multiply-add, so that snapping agrees with it.
#[inline(always)]
pub(super) fn transform<S: Simd>(
    simd: S,
    m: &DMat4,
    positions: &[Vec3],
    width: u32,
    height: u32,
    out: &mut Vec<Vertex>,
) {
    out.clear();
    out.reserve(positions.len() + 3);
    let (width, height) = (f64::from(width), f64::from(height));
    let mut chunks = positions.chunks_exact(4);
    for four in &mut chunks {
        out.extend_from_slice(&four_of(simd, m, [four[0], four[1], four[2], four[3]], width, height));
    }
    let rest = chunks.remainder();
    if !rest.is_empty() {
        let four = std::array::from_fn(|i| rest[i.min(rest.len() - 1)]);
        out.extend_from_slice(&four_of(simd, m, four, width, height)[..rest.len()]);
    }
}

/// The coordinate in steps, rounded; a whole number in the low bits.
#[inline(always)]
fn snap<S: Simd>(simd: S, v: f64x4<S>) -> f64x4<S> {
    // The floor, without an instruction for it: the nearest whole number, less one where that is above.
    let v = v * SUBPIXELS + BIAS;
    let nearest = v + WHOLE;
    let above = (nearest - WHOLE).simd_gt(v);
    nearest - above.select(f64x4::splat(simd, 1.0), f64x4::splat(simd, 0.0))
}

#[inline(always)]
fn four_of<S: Simd>(simd: S, m: &DMat4, p: [Vec3; 4], width: f64, height: f64) -> [Vertex; 4] {
    macro_rules! lanes {
        ($f:ident) => {
            f64x4::simd_from(simd, [p[0].$f.into(), p[1].$f.into(), p[2].$f.into(), p[3].$f.into()])
        };
    }
    let (px, py, pz) = (lanes!(x), lanes!(y), lanes!(z));
    let x = px * m.x_axis.x + py * m.y_axis.x + pz * m.z_axis.x + m.w_axis.x;
    let y = px * m.x_axis.y + py * m.y_axis.y + pz * m.z_axis.y + m.w_axis.y;
    let z = px * m.x_axis.z + py * m.y_axis.z + pz * m.z_axis.z + m.w_axis.z;
    let w = px * m.x_axis.w + py * m.y_axis.w + pz * m.z_axis.w + m.w_axis.w;
    let column = (x + w) * (0.5 * width) / w;
    let row = (w - y) * (0.5 * height) / w;
    // Rounding to `f32` moves this by less than it is lowered.
    let depth = z / w;
    let depth = depth - depth.abs() * f64::from(f32::EPSILON) - 1e-37;
    // Comparisons with NaN are false, so what is not certainly good needs clipping.
    let far = f64x4::splat(simd, GUARD);
    let good = column.simd_ge(-GUARD)
        & column.simd_le(far)
        & row.simd_ge(-GUARD)
        & row.simd_le(far)
        & w.simd_gt(0.0)
        & z.simd_le(w)
        & depth.simd_ge(-1e30);
    let good = good.to_bitmask() as u32;
    let left = x.simd_lt(-w).to_bitmask() as u32;
    let right = x.simd_gt(w).to_bitmask() as u32;
    let below = y.simd_lt(-w).to_bitmask() as u32;
    let above = y.simd_gt(w).to_bitmask() as u32;
    let before = z.simd_gt(w).to_bitmask() as u32;
    let (columns, rows, depths): ([f64; 4], [f64; 4], [f64; 4]) =
        (snap(simd, column).into(), snap(simd, row).into(), depth.into());
    let mut out = [Vertex::default(); 4];
    for i in 0..4 {
        let bit = |lanes: u32, k: u32| (lanes >> i & 1) << k;
        let sides = bit(left, 0) | bit(right, 1) | bit(below, 2) | bit(above, 3) | bit(before, 4);
        let clip = bit(!good, NEEDS_CLIP.trailing_zeros());
        let whole = |v: f64| (v.to_bits() as i32).wrapping_sub(1 << 24);
        out[i] = Vertex { x: whole(columns[i]), y: whole(rows[i]), z: depths[i] as f32, code: sides | clip };
    }
    out
}
