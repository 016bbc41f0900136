//! Where the eye is and what it can see.

use farsight_geometry::camera::DepthRange;
use farsight_geometry::{Camera, ClipConvention, DAabb, Frustum, Plane, Projection};
use glam::{DMat4, DVec3};

/// A view to cull for: camera, cascade of a shadow map, eye of a stereo pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    frustum: Frustum,
    /// Where depth begins; coordinates relative to the frustum's anchor. Positive ahead.
    near: Plane,
    /// Sum of the sizes of the anchor's coordinates.
    anchor_size: f64,
    order: Order,
    /// Size of a pixel in world units, at distance one (central) or anywhere (parallel).
    pixel: f64,
    sides: Sides,
}

/// Planes of the view volume with what a box test needs of them.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Sides {
    planes: [(Plane, DVec3); 6],
    count: usize,
    largest_offset: f64,
}

impl Sides {
    fn new(frustum: &Frustum) -> Self {
        let none = Plane { normal: DVec3::ZERO, offset: 0.0 };
        let mut sides = Self { planes: [(none, DVec3::ZERO); 6], count: 0, largest_offset: 0.0 };
        for &plane in frustum.planes() {
            sides.planes[sides.count] = (plane, plane.normal.abs());
            sides.count += 1;
            sides.largest_offset = sides.largest_offset.max(plane.offset.abs());
        }
        sides
    }

    /// Which of the planes in `mask` a box crosses; `None` when it is certainly outside one. `size` bounds the sum of the
    /// coordinates' sizes, anchor included.
    #[inline]
    fn crossed(&self, center: DVec3, half: DVec3, size: f64, mask: u8) -> Option<u8> {
        // A plane's distance sums eight terms; 16 roundings cover them and those of centre and half size.
        let slack = 16.0 * f64::EPSILON * (size + self.largest_offset);
        let (mut crossed, mut left) = (0u8, mask);
        while left != 0 {
            let Some((plane, abs)) = self.planes.get(left.trailing_zeros() as usize) else { break };
            let (distance, radius) = (plane.distance(center), abs.dot(half) + slack);
            if distance < -radius {
                return None;
            }
            if distance < radius + slack {
                crossed |= left & left.wrapping_neg();
            }
            left &= left - 1;
        }
        Some(crossed)
    }
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
    /// Planes of the view volume that it crosses; what is below crosses no others.
    pub(crate) crosses: u8,
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
        let frustum = Frustum::from_camera(camera);
        Self {
            frustum,
            near: Plane { normal: ahead, offset: -camera.near() },
            anchor_size: frustum.anchor().abs().element_sum(),
            order,
            pixel: 1.0 / camera.pixels_per_unit(),
            sides: Sides::new(&frustum),
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
        let frustum = Frustum::from_matrix(clip_from_relative, origin, least);
        Some(Self {
            frustum,
            sides: Sides::new(&frustum),
            near: Plane { normal: plane.truncate() / length, offset: plane.w / length },
            anchor_size: frustum.anchor().abs().element_sum(),
            order: Order::Plane,
            pixel: 2.0 * w.w / (steepest * f64::from(side_px.max(1))),
        })
    }

    /// The view volume.
    pub fn frustum(&self) -> &Frustum {
        &self.frustum
    }

    /// All planes of the view volume.
    pub(crate) fn all_planes(&self) -> u8 {
        (1u8 << self.sides.count) - 1
    }

    /// `None` when the box is not seen. Only the planes in `mask` are tested.
    #[inline]
    pub(crate) fn place(&self, b: &DAabb, mask: u8) -> Option<Placed> {
        let extent = b.max - b.min;
        // Also false for NaN; infinite boxes have infinite or NaN extents.
        if !(extent.min_element() >= 0.0 && extent.max_element() < f64::INFINITY) {
            return Self::place_unusual(b);
        }
        let anchor = self.frustum.anchor();
        let half = 0.5 * extent;
        let center = b.min + half - anchor;
        let size = b.min.abs().max(b.max.abs()).element_sum() + self.anchor_size;
        let crosses = self.sides.crossed(center, half, size, mask)?;
        let least = self.near.distance(center) - self.near.normal.abs().dot(half);
        let reach = center.abs().max_element() + half.max_element() + self.near.offset.abs();
        let key = match self.order {
            // The anchor is the eye.
            Order::Point(_) => (center.abs() - half).max(DVec3::ZERO).length_squared(),
            Order::Plane => least.max(0.0),
        };
        let unbounded = least <= NEAR_SHARE * reach + 16.0 * f64::EPSILON * size;
        Some(Placed { key: key as f32, crosses, unbounded })
    }

    /// Empty boxes are skipped; what is NaN or infinite is drawn.
    #[cold]
    fn place_unusual(b: &DAabb) -> Option<Placed> {
        let nan = b.min.is_nan() || b.max.is_nan();
        (nan || !b.is_empty()).then_some(Placed { key: 0.0, crosses: u8::MAX, unbounded: true })
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
