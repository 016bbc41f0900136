//! Who looks, and how much a node may move for them.

use crate::hierarchy::Node;
use crate::{LodError, Placement};
use farsight_geometry::{Camera, Projection};
use glam::{DAffine3, DMat3, DVec3};

/// How far vertices may move: shares of the distance from the eye.
///
/// Displacement δ at a distance d is tolerated where δ ≤ τ·d.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Tolerance {
    /// Where the surface faces the eye.
    pub tau: f64,
    /// Where it may be a silhouette; at most `tau`.
    pub silhouette: f64,
    /// Where it faces away; at least `tau`. Only for surfaces whose back nobody sees.
    pub back: f64,
    /// A node folds again at this share below the tolerance at which it unfolded, 0 to 1: what stands on the limit does not flicker.
    pub hysteresis: f64,
}

impl Tolerance {
    /// The same tolerance everywhere, without hysteresis.
    pub fn uniform(tau: f64) -> Self {
        Self { tau, silhouette: tau, back: tau, hysteresis: 0.0 }
    }

    /// The tolerance that keeps every displacement on a camera's image below `px` pixels, wherever in the image it is.
    ///
    /// With f pixels per unit of tangent and the image's half diagonal Φ, a displacement of τ·d is at most f·τ/(cos²Φ·(1 − τ/cos Φ)) pixels:
    /// a point at the corner is farther away than it is deep, and what moves towards the eye grows. For a parallel camera, whose
    /// pixels have no distance, there is no such share.
    ///
    /// # Errors
    /// [`LodError::Tolerance`] when `px` is not positive, [`LodError::Parallel`] for a parallel camera.
    pub fn pixels(px: f64, camera: &Camera) -> Result<Self, LodError> {
        if !matches!(camera.projection(), Projection::Perspective { .. }) {
            return Err(LodError::Parallel);
        }
        let cos = 1.0 / (1.0 + camera.half_extent().length_squared()).sqrt();
        let tolerance = Self::uniform(px * cos * cos / (camera.pixels_per_unit() + px * cos));
        tolerance.check()?;
        Ok(tolerance)
    }

    /// Pixels by which a camera may see points off that are displaced by no more than `share` of their distance: the inverse of
    /// [`pixels`](Self::pixels). Infinite for a parallel camera, and where a point may come to the eye.
    pub fn displacement_px(share: f64, camera: &Camera) -> f64 {
        let cos = 1.0 / (1.0 + camera.half_extent().length_squared()).sqrt();
        if !matches!(camera.projection(), Projection::Perspective { .. }) || share >= cos {
            return f64::INFINITY;
        }
        camera.pixels_per_unit() * share / (cos * cos * (1.0 - share / cos))
    }

    pub(crate) fn check(&self) -> Result<(), LodError> {
        let ordered = self.silhouette > 0.0 && self.silhouette <= self.tau && self.tau <= self.back;
        let usable = ordered && self.back.is_finite() && (0.0..1.0).contains(&self.hysteresis);
        if usable { Ok(()) } else { Err(LodError::Tolerance { tolerance: *self }) }
    }
}

/// An eye in the frame of an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observer {
    /// The eye in the object's coordinates, relative to the mesh's origin.
    pub(crate) eye: DVec3,
    /// What stretches the object unevenly, without its turn, over the largest stretch; `None` where all directions are stretched alike.
    stretch: Option<DMat3>,
}

impl Observer {
    /// An eye at `eye` in the world looks at a mesh with origin `origin` that `world_from_object` places.
    ///
    /// # Errors
    /// [`LodError::Placement`] when the eye or the matrix is not finite, or the matrix flattens the object.
    pub fn new(eye: DVec3, world_from_object: &DAffine3, origin: DVec3) -> Result<Self, LodError> {
        let placement = Placement::new(world_from_object, origin)?;
        // The world point that the mesh's origin goes to is subtracted before anything is divided.
        let eye = world_from_object.matrix3.inverse() * (eye - placement.anchor());
        if !eye.is_finite() {
            return Err(LodError::Placement);
        }
        let m = *placement.stretch();
        let lengths = [m.x_axis, m.y_axis, m.z_axis].map(|c| c.length());
        let dots = [m.x_axis.dot(m.y_axis), m.y_axis.dot(m.z_axis), m.z_axis.dot(m.x_axis)];
        let size = lengths[0];
        let alike = lengths.iter().all(|l| (l / size - 1.0).abs() < 1e-9)
            && dots.iter().all(|d| d.abs() < 1e-9 * size * size);
        Ok(Self { eye, stretch: (!alike).then(|| m * (1.0 / largest_stretch(&m))) })
    }

    /// An eye in the object's own coordinates relative to the mesh's origin, for an object that is not stretched unevenly.
    pub fn in_object(eye: DVec3) -> Self {
        Self { eye, stretch: None }
    }

    /// The observer with the stretch of an earlier one, if both stretch alike up to rounding: an object that turns keeps its stretch, but not to the last bit.
    /// The margin of [`largest_stretch`] covers the difference.
    pub(crate) fn stretched_as(&self, before: &Self) -> Option<Self> {
        let alike = match (self.stretch, before.stretch) {
            (None, None) => true,
            (Some(a), Some(b)) => a.abs_diff_eq(b, 1e-9),
            _ => false,
        };
        alike.then_some(Self { eye: self.eye, stretch: before.stretch })
    }

    /// A vector of the object's coordinates as distances measure it.
    pub(crate) fn stretched(&self, v: DVec3) -> DVec3 {
        self.stretch.map_or(v, |s| s * v)
    }

    /// Distance of a point of the object from the eye, over the object's largest stretch: what radii are compared with.
    pub(crate) fn distance(&self, point: DVec3) -> f64 {
        self.stretched(self.eye - point).length()
    }

    /// How a node's surface can face the eye. Whether an eye is before or behind a plane does not depend on stretching.
    pub(crate) fn facing(&self, node: &Node, center: DVec3) -> Facing {
        let to_eye = self.eye - center;
        let distance = to_eye.length();
        let reach = f64::from(node.reach);
        if node.cone_angle >= std::f32::consts::FRAC_PI_2 || distance <= reach {
            return Facing { class: Class::Silhouette, margin: 0.0 };
        }
        let axis = node.cone_axis.as_dvec3();
        let angle = axis.cross(to_eye).length().atan2(axis.dot(to_eye));
        let spread = f64::from(node.cone_angle) + (reach / distance).asin() + 1e-9;
        let off = angle - std::f64::consts::FRAC_PI_2;
        let class = if off.abs() <= spread {
            Class::Silhouette
        } else if off > 0.0 {
            Class::Back
        } else {
            Class::Front
        };
        Facing { class, margin: (off.abs() - spread).abs() }
    }
}

/// How the triangles around a node can face the eye.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Class {
    Front,
    Silhouette,
    Back,
}

/// A class and by how many radians it is clear.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Facing {
    pub class: Class,
    pub margin: f64,
}

/// A little more than the largest singular value of a matrix: power iteration on mᵀm from three starts finds it from below.
fn largest_stretch(m: &DMat3) -> f64 {
    let square = m.transpose() * *m;
    let grown = |start: DVec3| {
        let mut v = start;
        for _ in 0..200 {
            v = (square * v).normalize_or(start);
        }
        (square * v).length().sqrt()
    };
    let largest = [DVec3::X, DVec3::Y, DVec3::Z].into_iter().map(grown).fold(0.0, f64::max);
    // No more than the Frobenius norm, and with the margin of an iteration that has not quite arrived.
    let bound = (m.x_axis.length_squared() + m.y_axis.length_squared() + m.z_axis.length_squared()).sqrt();
    (largest * (1.0 + 1e-3)).min(bound * (1.0 + 1e-12))
}

#[cfg(test)]
mod tests {
    use super::*;
    use farsight_geometry::sampling::Random;

    #[test]
    fn stretch_is_never_below_what_any_vector_is_stretched_by() {
        let mut random = Random::new(3);
        for _ in 0..300 {
            let mut v = || DVec3::from_array(random.units()) * 2.0 - 1.0;
            let m = DMat3::from_cols(v(), v() * 3.0, v() * 0.1);
            let most = largest_stretch(&m);
            for _ in 0..100 {
                let x = v().normalize();
                assert!((m * x).length() <= most * (1.0 + 1e-12));
            }
        }
    }

    #[test]
    fn moved_and_scaled_objects_see_the_same() {
        let place = DAffine3::from_scale_rotation_translation(
            DVec3::splat(7.0),
            glam::DQuat::from_rotation_y(0.7),
            DVec3::new(1e6, -2e5, 40.0),
        );
        let (origin, eye) = (DVec3::new(5.0, 6.0, 7.0), DVec3::new(0.3, -4.0, 2.0));
        let observer = Observer::new(place.transform_point3(origin + eye), &place, origin).unwrap();
        assert!(observer.stretch.is_none() && observer.eye.distance(eye) < 1e-8);
        let flat = DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0));
        assert_eq!(Observer::new(eye, &flat, origin), Err(LodError::Placement));
    }
}
