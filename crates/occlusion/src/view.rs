//! Where the eye is and what it can see.

use farsight_geometry::camera::DepthRange;
use farsight_geometry::{Camera, ClipConvention, Containment, DAabb, Frustum, Plane, Projection};
use glam::{DMat4, DVec3};

/// A view to cull for: camera, cascade of a shadow map, eye of a stereo pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    frustum: Frustum,
    /// Where depth begins; coordinates relative to the frustum's anchor. Positive ahead.
    near: Plane,
    order: Order,
    /// Size of a pixel in world units, at distance one (central) or anywhere (parallel).
    pixel: f64,
}

/// What "front to back" means.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Order {
    /// By distance from a point.
    Point(DVec3),
    /// By distance from the near plane.
    Plane,
}

/// Where a box lies in a view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Placed {
    /// Grows from front to back; never negative.
    pub(crate) key: f32,
    /// Wholly inside the view volume: so is everything below.
    pub(crate) inside: bool,
    /// Reaches before the near plane, or is not finite: no proxy can be drawn for it.
    pub(crate) unbounded: bool,
}

/// A box this close to the near plane, as a share of the coordinates' size, counts as reaching it: more than the error of
/// `f32` matrices and positions relative to the eye.
const NEAR_SHARE: f64 = 1e-5;

impl View {
    /// The view of a camera. Infinite far planes and any image size are fine.
    pub fn from_camera(camera: &Camera) -> Self {
        let ahead = camera.forward();
        let order = match camera.projection() {
            Projection::Perspective { .. } => Order::Point(camera.eye()),
            Projection::Orthographic { .. } => Order::Plane,
        };
        Self {
            frustum: Frustum::from_camera(camera),
            near: Plane { normal: ahead, offset: -camera.near() },
            order,
            pixel: 1.0 / camera.pixels_per_unit(),
        }
    }

    /// The view of a parallel projection's matrix, as shadow maps have. `relative` coordinates are those minus `origin`; any
    /// depth convention, reversed or not, but no perspective. `side_px` is the longer side of the image.
    ///
    /// `None` when the matrix has no near plane, or is a central projection.
    pub fn from_parallel_matrix(
        clip_from_relative: &DMat4,
        origin: DVec3,
        convention: ClipConvention,
        side_px: u32,
    ) -> Option<Self> {
        let least = if convention.depth == DepthRange::ZeroToOne { 0.0 } else { -1.0 };
        let [x, y, z, w] = [0, 1, 2, 3].map(|i| clip_from_relative.row(i));
        if w.truncate() != DVec3::ZERO || w.w <= 0.0 {
            return None;
        }
        let plane = if convention.reversed { w - z } else { z - w * least };
        let length = plane.truncate().length();
        if !(length > 0.0 && plane.is_finite()) {
            return None;
        }
        let steepest = x.truncate().length().max(y.truncate().length());
        Some(Self {
            frustum: Frustum::from_matrix(clip_from_relative, origin, least),
            near: Plane { normal: plane.truncate() / length, offset: plane.w / length },
            order: Order::Plane,
            pixel: 2.0 * w.w / (steepest * f64::from(side_px.max(1))),
        })
    }

    /// The view volume.
    pub fn frustum(&self) -> &Frustum {
        &self.frustum
    }

    /// `None` when the box is not seen. `parent_inside` spares the test against the view volume.
    #[inline]
    pub(crate) fn place(&self, b: &DAabb, parent_inside: bool) -> Option<Placed> {
        if !(b.min.is_finite() && b.max.is_finite()) {
            return Self::place_unusual(b);
        }
        let inside = parent_inside
            || match self.frustum.classify(b) {
                Containment::Outside => return None,
                Containment::Inside => true,
                Containment::Crossing => false,
            };
        if b.is_empty() {
            return None;
        }
        let relative = DAabb::new(b.min - self.frustum.anchor(), b.max - self.frustum.anchor());
        let (center, half) = (relative.center(), 0.5 * (relative.max - relative.min));
        let reach = self.near.normal.abs().dot(half);
        let least = self.near.distance(center) - reach;
        let size = center.abs().max_element() + half.max_element() + self.near.offset.abs();
        let key = match self.order {
            Order::Point(eye) => b.closest_point(eye).distance_squared(eye),
            Order::Plane => least.max(0.0),
        };
        Some(Placed { key: key as f32, inside, unbounded: least <= NEAR_SHARE * size })
    }

    /// Empty boxes are skipped; what is NaN or infinite is drawn.
    #[cold]
    fn place_unusual(b: &DAabb) -> Option<Placed> {
        let nan = b.min.is_nan() || b.max.is_nan();
        (nan || !b.is_empty()).then_some(Placed { key: 0.0, inside: false, unbounded: true })
    }

    /// The box to draw in a query: grown by `px` pixels, at its farthest point, on all sides.
    pub(crate) fn proxy(&self, b: &DAabb, px: f64) -> DAabb {
        let distance = match self.order {
            Order::Point(eye) => (b.min - eye).abs().max((b.max - eye).abs()).length(),
            Order::Plane => 1.0,
        };
        b.inflated(px * self.pixel * distance)
    }
}
