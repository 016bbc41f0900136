//! Planes and view volumes for culling.

use crate::bounds::{DAabb, Sphere};
use crate::camera::{Camera, Projection};
use glam::{DMat4, DVec3};

/// An oriented plane: points with `normal · point + offset ≥ 0` are inside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Unit normal, pointing inside.
    pub normal: DVec3,
    /// Signed distance of the coordinate origin.
    pub offset: f64,
}

impl Plane {
    /// The plane through `point` with the unit normal `normal`.
    pub fn through(point: DVec3, normal: DVec3) -> Self {
        Self { normal, offset: -normal.dot(point) }
    }

    /// Signed distance, positive inside.
    #[inline]
    pub fn distance(&self, point: DVec3) -> f64 {
        self.normal.dot(point) + self.offset
    }
}

/// Where something lies relative to a volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Containment {
    /// Certainly no point in common.
    Outside,
    /// Neither of the others is certain.
    Crossing,
    /// Certainly wholly inside.
    Inside,
}

/// A convex volume of at most six planes, kept relative to an anchor so that it stays sharp far from the origin.
///
/// Answers are conservative: `Outside` and `Inside` are certain, rounding included. A box that lies outside without
/// being beyond any single plane is reported as `Crossing`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frustum {
    anchor: DVec3,
    planes: [Plane; 6],
    count: usize,
}

impl Frustum {
    /// The view volume of a camera; an infinite far distance has no plane.
    pub fn from_camera(camera: &Camera) -> Self {
        let half = camera.half_extent();
        let (right, up, ahead) = (camera.right(), camera.up(), camera.forward());
        let mut frustum = Self::without_planes(camera.eye());
        for (axis, half) in [(right, half.x), (-right, half.x), (up, half.y), (-up, half.y)] {
            match camera.projection() {
                Projection::Perspective { .. } => {
                    frustum.push(Plane { normal: (axis + ahead * half).normalize(), offset: 0.0 });
                }
                Projection::Orthographic { .. } => frustum.push(Plane { normal: axis, offset: half }),
            }
        }
        frustum.push(Plane { normal: ahead, offset: -camera.near() });
        if camera.far().is_finite() {
            frustum.push(Plane { normal: -ahead, offset: camera.far() });
        }
        frustum
    }

    /// The volume that a matrix maps into clip space; `relative` coordinates are those minus `origin`.
    ///
    /// Takes any of the usual matrices. `least_depth` is 0 or −1 for the two depth ranges; it does not matter whether depth
    /// is reversed. A plane at infinity is dropped.
    pub fn from_matrix(clip_from_relative: &DMat4, origin: DVec3, least_depth: f64) -> Self {
        let row = |i| clip_from_relative.row(i);
        let (x, y, z, w) = (row(0), row(1), row(2), row(3));
        let mut frustum = Self::without_planes(origin);
        for plane in [w + x, w - x, w + y, w - y, z - w * least_depth, w - z] {
            let length = plane.truncate().length();
            if length > 1e-12 * plane.abs().max_element() {
                frustum.push(Plane { normal: plane.truncate() / length, offset: plane.w / length });
            }
        }
        frustum
    }

    fn without_planes(anchor: DVec3) -> Self {
        Self { anchor, planes: [Plane { normal: DVec3::ZERO, offset: 0.0 }; 6], count: 0 }
    }

    fn push(&mut self, plane: Plane) {
        self.planes[self.count] = plane;
        self.count += 1;
    }

    /// The point that [`planes`](Self::planes) are relative to.
    pub fn anchor(&self) -> DVec3 {
        self.anchor
    }

    /// The planes; their offsets hold for points minus [`anchor`](Self::anchor).
    pub fn planes(&self) -> &[Plane] {
        &self.planes[..self.count]
    }

    /// Where a box lies. An empty box is outside.
    pub fn classify(&self, b: &DAabb) -> Containment {
        if b.is_empty() {
            return Containment::Outside;
        }
        let center = b.center() - self.anchor;
        let half = 0.5 * (b.max - b.min);
        // The plane's distance sums eight terms; 16 roundings cover them and those of centre and half size.
        let magnitude = b.min.abs().max(b.max.abs()) + self.anchor.abs();
        let slack = |p: &Plane| 16.0 * f64::EPSILON * (p.normal.abs().dot(magnitude) + p.offset.abs());
        self.classify_by(|p| (p.distance(center), p.normal.abs().dot(half) + slack(p), slack(p)))
    }

    /// Where a sphere lies.
    pub fn classify_sphere(&self, sphere: &Sphere) -> Containment {
        let center = sphere.center - self.anchor;
        let magnitude = sphere.center.abs() + self.anchor.abs();
        self.classify_by(|p| {
            let slack =
                16.0 * f64::EPSILON * (p.normal.abs().dot(magnitude) + p.offset.abs() + sphere.radius);
            (p.distance(center), sphere.radius + slack, slack)
        })
    }

    /// `reach` gives, per plane, the centre's distance, the radius towards the plane with slack, and the slack.
    fn classify_by(&self, reach: impl Fn(&Plane) -> (f64, f64, f64)) -> Containment {
        let mut result = Containment::Inside;
        for plane in self.planes() {
            let (distance, radius, slack) = reach(plane);
            if distance < -radius {
                return Containment::Outside;
            }
            if distance < radius + slack {
                result = Containment::Crossing;
            }
        }
        result
    }

    /// Whether a point lies inside, up to rounding.
    pub fn contains(&self, point: DVec3) -> bool {
        self.planes().iter().all(|p| p.distance(point - self.anchor) >= 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{ClipConvention, DepthRange};
    use glam::dvec3;

    fn camera(eye: DVec3) -> Camera {
        Camera::look_at(eye, eye + dvec3(0.0, 0.0, -1.0), DVec3::Y).unwrap().with_range(1.0, 100.0).unwrap()
    }

    fn unit_box(center: DVec3) -> DAabb {
        DAabb::from_points([center]).inflated(0.5)
    }

    #[test]
    fn boxes_are_classified() {
        for eye in [DVec3::ZERO, dvec3(4.8e5, 5.4e6, 1e4)] {
            let frustum = Frustum::from_camera(&camera(eye));
            let at = |x, y, z| frustum.classify(&unit_box(eye + dvec3(x, y, z)));
            assert_eq!(at(0.0, 0.0, -20.0), Containment::Inside);
            assert_eq!(at(0.0, 0.0, -1.0), Containment::Crossing);
            assert_eq!(at(0.0, 0.0, 20.0), Containment::Outside);
            assert_eq!(at(0.0, 0.0, -101.0), Containment::Outside);
            assert_eq!(at(50.0, 0.0, -20.0), Containment::Outside);
            assert_eq!(frustum.classify(&DAabb::EMPTY), Containment::Outside);
        }
    }

    #[test]
    fn matrices_of_all_conventions_give_the_camera_s_volume() {
        let eye = dvec3(5.0, 6.0, 7.0);
        for far in [100.0, f64::INFINITY] {
            let camera = camera(eye).with_range(1.0, far).unwrap();
            let reference = Frustum::from_camera(&camera);
            for convention in ClipConvention::all() {
                let least = if convention.depth == DepthRange::ZeroToOne { 0.0 } else { -1.0 };
                let matrix = camera.clip_from_relative_f64(convention, DVec3::ZERO);
                let frustum = Frustum::from_matrix(&matrix, DVec3::ZERO, least);
                assert_eq!(frustum.planes().len(), reference.planes().len(), "{convention:?} {far}");
                for i in 0..1000 {
                    let t = f64::from(i);
                    let p = eye + dvec3((t * 1.1).sin() * 30.0, (t * 1.7).cos() * 30.0, -t * 0.12 + 5.0);
                    let margin =
                        reference.planes().iter().map(|q| q.distance(p - eye).abs()).fold(1.0, f64::min);
                    assert!(
                        margin < 1e-9 || frustum.contains(p) == reference.contains(p),
                        "{convention:?} {p}"
                    );
                }
            }
        }
    }

    #[test]
    fn spheres_are_classified() {
        let frustum = Frustum::from_camera(&camera(DVec3::ZERO));
        let at = |z, radius| frustum.classify_sphere(&Sphere { center: dvec3(0.0, 0.0, z), radius });
        assert_eq!(at(-20.0, 1.0), Containment::Inside);
        assert_eq!(at(0.5, 1.0), Containment::Outside);
        assert_eq!(at(0.0, 1.5), Containment::Crossing);
    }
}
