//! The slow path: triangles that reach before the near plane or beyond the guard band, and coverage of whole pixels.

use super::vertex::{GUARD, Vertex, to_clip};
use super::{Coverage, DepthBuffer, Faces};
use farsight_geometry::clip::ClipPolygon;
use farsight_geometry::rounding::f32_down;
use glam::{DMat4, DVec2, DVec3, DVec4, Vec3};

/// How far edges of clipped triangles move inwards, in pixels. Where a renderer puts the corners that clipping makes is its own
/// affair; it moves edges by at most 1/128 px when it snaps to 1/256 px or finer.
const INSET: f64 = 1.0 / 64.0;

/// Most corners after clipping: six planes add one each.
const MOST: usize = 9;

/// Clips a triangle, moves its edges inwards and hands on the pieces.
#[inline(always)]
pub(super) fn draw_clipped(
    buffer: &mut DepthBuffer,
    clip_from_local: &DMat4,
    corners: [Vec3; 3],
    faces: Faces,
    mut draw: impl FnMut(&mut DepthBuffer, [Vertex; 3]),
) {
    let size = DVec2::new(buffer.width.into(), buffer.height.into());
    let clip = corners.map(|p| to_clip(clip_from_local, p));
    let Some((polygon, count)) = inset_polygon(clip, size, buffer.coverage, faces) else { return };
    for k in 2..count {
        draw(buffer, [polygon[0], polygon[k - 1], polygon[k]]);
    }
}

/// Pixels and depth of the clipped and shrunk triangle; `None` when nothing certain is left of it.
#[inline(never)]
fn inset_polygon(
    clip: [DVec4; 3],
    size: DVec2,
    coverage: Coverage,
    faces: Faces,
) -> Option<([Vertex; MOST], usize)> {
    if !clip.iter().all(|p| p.is_finite()) {
        return None;
    }
    let mut polygon = ClipPolygon::<MOST>::new(clip);
    // A little inside the planes, so that rounding leaves no corner beyond them. The guard is narrower than that of unclipped
    // corners for the same reason.
    let guard = (2.0 * (GUARD - 2.0) / size) - 1.0;
    let largest = clip.iter().fold(0.0, |m: f64, p| m.max(p.abs().max_element()));
    polygon.cut(|p| p.w - p.z - 1e-12 * largest);
    polygon.cut(|p| p.w - 1e-9 * largest);
    polygon.cut(|p| guard.x * p.w - p.x);
    polygon.cut(|p| p.x + p.w * (1.0 + 2.0 * (GUARD - 2.0) / size.x));
    polygon.cut(|p| p.w * (1.0 + 2.0 * (GUARD - 2.0) / size.y) - p.y);
    polygon.cut(|p| p.y + guard.y * p.w);
    let corners = polygon.corners();
    let n = corners.len();
    if n < 3 {
        return None;
    }
    let mut px = [DVec3::ZERO; MOST];
    for k in 0..n {
        let p = corners[k];
        px[k] = DVec3::new(0.5 * size.x * (p.x + p.w), 0.5 * size.y * (p.w - p.y), p.z) / p.w;
        if !px[k].is_finite() {
            return None;
        }
    }
    shrink(&px[..n], coverage, faces)
}

/// Moves the edges of a convex polygon inwards and snaps its corners.
fn shrink(px: &[DVec3], coverage: Coverage, faces: Faces) -> Option<([Vertex; MOST], usize)> {
    let n = px.len();
    let at = |k: usize| px[k % n].truncate();
    let area: f64 = (0..n).map(|k| (at(k) - at(0)).perp_dot(at(k + 1) - at(0))).sum();
    if area == 0.0 || (faces == Faces::Front && area > 0.0) {
        return None;
    }
    let turn = area.signum();
    let plane = depth_plane(px)?;
    let mut out = [Vertex::default(); MOST];
    let mut inner = [DVec2::ZERO; MOST];
    for k in 0..n {
        let (a, b, c) = (at(k + n - 1), at(k), at(k + 1));
        // Inner normals of the edges before and after corner k, and how far they move.
        let (p, q) = ((b - a).perp() * turn, (c - b).perp() * turn);
        let (p, q) = (p.try_normalize()?, q.try_normalize()?);
        let move_by = |normal: DVec2| match coverage {
            Coverage::Centres | Coverage::Rounded => INSET,
            Coverage::Whole => INSET + 0.5 * normal.abs().element_sum(),
        };
        let det = p.perp_dot(q);
        if det.abs() < 1e-9 {
            return None;
        }
        let (s, t) = (move_by(p), move_by(q));
        inner[k] = b + DVec2::new(s * q.y - t * p.y, t * p.x - s * q.x) / det;
    }
    for k in 0..n {
        let p = inner[k];
        // Inside all the old edges, or the polygon has turned inside out.
        let inside = (0..n).all(|e| {
            let (a, b) = (at(e), at(e + 1));
            ((b - a).perp_dot(p - a) * turn) >= 0.0
        });
        if !inside || p.abs().max_element() > GUARD {
            return None;
        }
        // Lowest over a snapping step, and over a pixel for samples anywhere in it.
        let slack = (plane.x.abs() + plane.y.abs())
            * match coverage {
                Coverage::Centres | Coverage::Rounded => 1.0 / 256.0,
                Coverage::Whole => 0.5 + 1.0 / 256.0,
            };
        let z = plane.x * (p.x - px[0].x) + plane.y * (p.y - px[0].y) + px[0].z - slack;
        let noise = 1e-12 * (plane.x.abs() + plane.y.abs()) * 4.0 * GUARD + 1e-12;
        let least = px.iter().fold(f64::INFINITY, |m, v| m.min(v.z)) - noise;
        let snap = |v: f64| (v * 256.0).round() as i32;
        out[k] = Vertex { x: snap(p.x), y: snap(p.y), z: f32_down((z - noise).max(least)), code: 0 };
    }
    Some((out, n))
}

/// Change of depth per pixel, from the largest triangle at corner 0.
fn depth_plane(px: &[DVec3]) -> Option<DVec2> {
    let edge = |k: usize| px[k] - px[0];
    let area = |k: usize| edge(k).truncate().perp_dot(edge(k + 1).truncate());
    let k = (1..px.len() - 1).max_by(|&a, &b| area(a).abs().total_cmp(&area(b).abs()))?;
    let (a, b, det) = (edge(k), edge(k + 1), area(k));
    let terms = (a.x * b.y).abs() + (a.y * b.x).abs();
    if det.abs() <= 1e-6 * terms {
        return None;
    }
    Some(DVec2::new(a.z * b.y - b.z * a.y, b.z * a.x - a.z * b.x) / det)
}
