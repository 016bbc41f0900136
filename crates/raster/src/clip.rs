//! Clip space: conventions, outcodes, and homogeneous polygon clipping.

use farsight_geometry::camera::ClipConvention;
use glam::{DMat4, DVec4};

/// Matrix from a convention's clip space to the one drawn in: y up, depth 1 (near) to 0 (far).
///
/// Put it in front of any other matrix: `native_from(ClipConvention::OPENGL) * clip_from_local`.
pub fn native_from(convention: ClipConvention) -> DMat4 {
    let (near, far) = convention.near_far_depth();
    // z' = (z − far·w) / (near − far) maps the far depth to 0 and the near depth to 1.
    let scale = 1.0 / (near - far);
    let y = if convention.y_down { -1.0 } else { 1.0 };
    DMat4::from_cols(
        DVec4::new(1.0, 0.0, 0.0, 0.0),
        DVec4::new(0.0, y, 0.0, 0.0),
        DVec4::new(0.0, 0.0, scale, 0.0),
        DVec4::new(0.0, 0.0, -far * scale, 1.0),
    )
}

/// Largest distance in pixels of a vertex from the image's corner before its triangle is clipped. With 1/256 px
/// steps coordinates stay below 2²³ and edge functions below 2⁵⁰, exact in `f64`.
const GUARD_PX: f64 = 32_000.0;

/// A vertex with |w| below this share of its triangle's largest coordinate is cut off when depth is not clipped.
const W_SHARE: f64 = 1e-9;

/// Size of the image and the guard band around it, in clip space.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Viewport {
    pub(crate) width: f64,
    pub(crate) height: f64,
    guard_x: f64,
    guard_y: f64,
    depth_clamp: bool,
}

/// Set in an outcode when the triangle cannot be drawn without clipping.
pub(crate) const NEEDS_CLIP: u32 = 64;
/// Bits of an outcode that say on which sides of the view volume a vertex lies.
pub(crate) const SIDES: u32 = 63;

/// Most corners that a triangle can have after clipping: each of six planes adds one.
pub(crate) const MAX_CORNERS: usize = 9;

impl Viewport {
    pub(crate) fn new(width: u32, height: u32, depth_clamp: bool) -> Self {
        let (width, height) = (f64::from(width), f64::from(height));
        let (guard_x, guard_y) = (2.0 * GUARD_PX / width - 1.0, 2.0 * GUARD_PX / height - 1.0);
        Self { width, height, guard_x, guard_y, depth_clamp }
    }

    /// Which sides of the view volume `p` is outside of, and whether its triangles must be clipped.
    #[inline(always)]
    pub(crate) fn outcode(&self, p: DVec4) -> u32 {
        let bit = |outside: bool, n: u32| u32::from(outside) << n;
        let sides = bit(p.x < -p.w, 0) | bit(p.x > p.w, 1) | bit(p.y < -p.w, 2) | bit(p.y > p.w, 3);
        let depth = bit(p.z > p.w, 4) | bit(p.z < 0.0, 5);
        let guarded = p.x.abs() <= self.guard_x * p.w && p.y.abs() <= self.guard_y * p.w && p.w > 0.0;
        let (depth, clip) = if self.depth_clamp { (0, !guarded) } else { (depth, !guarded || depth != 0) };
        sides | depth | bit(clip, 6)
    }

    /// Pixel coordinates times w, and w: what perspective interpolation needs.
    #[inline(always)]
    pub(crate) fn homogeneous_px(&self, p: DVec4) -> glam::DVec3 {
        glam::DVec3::new(0.5 * self.width * (p.x + p.w), 0.5 * self.height * (p.w - p.y), p.w)
    }

    /// Clips a triangle to the guard band and (unless depth is clamped) to the near and far plane.
    ///
    /// The point where a plane cuts an edge is computed from the edge's inner to its outer end, so two triangles
    /// that share the edge get the same point.
    pub(crate) fn clip(&self, triangle: [DVec4; 3]) -> Polygon {
        let mut polygon = Polygon { corners: [DVec4::ZERO; MAX_CORNERS], count: 3 };
        polygon.corners[..3].copy_from_slice(&triangle);
        if self.depth_clamp {
            let largest = triangle.iter().fold(0.0, |m: f64, p| m.max(p.abs().max_element()));
            polygon.cut(|p| p.w - W_SHARE * largest);
        } else {
            polygon.cut(|p| p.w - p.z);
            polygon.cut(|p| p.z);
        }
        polygon.cut(|p| self.guard_x * p.w - p.x);
        polygon.cut(|p| self.guard_x * p.w + p.x);
        polygon.cut(|p| self.guard_y * p.w - p.y);
        polygon.cut(|p| self.guard_y * p.w + p.y);
        polygon
    }
}

/// A plane that cuts off the negative side.
type Side = fn(&Viewport, DVec4, f64) -> f64;

impl Viewport {
    /// The part of a segment that [`clip`](Self::clip) would keep, in the segment's order.
    pub(crate) fn clip_segment(&self, [a, b]: [DVec4; 2]) -> Option<([DVec4; 2], [f64; 2])> {
        let largest = a.abs().max_element().max(b.abs().max_element());
        let depth: [Side; 2] = if self.depth_clamp {
            [|_, p, largest| p.w - W_SHARE * largest; 2]
        } else {
            [|_, p, _| p.w - p.z, |_, p, _| p.z]
        };
        let guard: [Side; 4] = [
            |v, p, _| v.guard_x * p.w - p.x,
            |v, p, _| v.guard_x * p.w + p.x,
            |v, p, _| v.guard_y * p.w - p.y,
            |v, p, _| v.guard_y * p.w + p.y,
        ];
        let (mut from, mut to) = (0.0f64, 1.0f64);
        for side in depth.iter().chain(&guard) {
            let (da, db) = (side(self, a, largest), side(self, b, largest));
            match (da >= 0.0, db >= 0.0) {
                (true, true) => {}
                (true, false) => to = to.min(da / (da - db)),
                (false, true) => from = from.max(da / (da - db)),
                (false, false) => return None,
            }
        }
        (from < to).then(|| ([a + (b - a) * from, a + (b - a) * to], [from, to]))
    }
}

/// A convex polygon in clip space. Unlike [`farsight_geometry::clip`], it cuts an edge the same way from both sides: neighbours must not part.
pub(crate) struct Polygon {
    corners: [DVec4; MAX_CORNERS],
    count: usize,
}

impl Polygon {
    pub(crate) fn corners(&self) -> &[DVec4] {
        &self.corners[..self.count]
    }

    fn cut(&mut self, inside: impl Fn(DVec4) -> f64) {
        let (old, count) = (self.corners, self.count);
        self.count = 0;
        for i in 0..count {
            let (a, b) = (old[i], old[(i + 1) % count]);
            let (da, db) = (inside(a), inside(b));
            if da >= 0.0 {
                self.push(a);
            }
            if (da >= 0.0) != (db >= 0.0) {
                let (p, q, dp, dq) = if da >= 0.0 { (a, b, da, db) } else { (b, a, db, da) };
                self.push(p + (q - p) * (dp / (dp - dq)));
            }
        }
    }

    fn push(&mut self, p: DVec4) {
        // Rounding may let a sliver cross a plane more often than a convex polygon can; what is lost has no area.
        if self.count < MAX_CORNERS {
            self.corners[self.count] = p;
            self.count += 1;
        }
    }
}
