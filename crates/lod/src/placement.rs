//! Where an object is, taken apart: what stretches it, and the rigid motion that follows.

use crate::{LodError, Observer};
use farsight_geometry::{Aabb, DAabb};
use glam::{DAffine3, DMat3, DVec3};

/// Factor on claims for what was made under a stretch that counts as the same.
pub(crate) const SAME_STRETCH: f64 = 1.0 + 1e-8;

/// The placement of a mesh, split into a stretch and a rigid motion.
///
/// In the *rigid frame* the object is stretched but neither turned nor moved, and the origin is that of the mesh. Distances and angles there are those
/// of the world, whatever the scale along each axis, and an object that only moves stays as it is: what moves is the eye. Impostors and the tests of cached
/// approximations live in this frame.
///
/// ```
/// use farsight_lod::{Placement, glam::{DAffine3, DQuat, DVec3}};
///
/// let place = |angle, at| {
///     DAffine3::from_scale_rotation_translation(DVec3::new(1.0, 5.0, 0.2), DQuat::from_rotation_y(angle), at)
/// };
/// let before = Placement::new(&place(0.3, DVec3::X), DVec3::ZERO)?;
/// let after = Placement::new(&place(1.7, DVec3::Z * 9.0), DVec3::ZERO)?;
/// assert!(before.is_stretched_like(&after));
/// # Ok::<(), farsight_lod::LodError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// World from rigid frame: orthonormal, right-handed.
    rotation: DMat3,
    /// Rigid frame from the object's coordinates: upper triangular.
    stretch: DMat3,
    /// Where the mesh's origin is in the world.
    anchor: DVec3,
    world_from_object: DAffine3,
    origin: DVec3,
}

impl Placement {
    /// Splits the placement `world_from_object` of a mesh with origin `origin`.
    ///
    /// # Errors
    /// [`LodError::Placement`] when the matrix is not finite or flattens the object.
    pub fn new(world_from_object: &DAffine3, origin: DVec3) -> Result<Self, LodError> {
        let m = world_from_object.matrix3;
        let anchor = world_from_object.transform_point3(origin);
        if !(m.is_finite() && anchor.is_finite() && m.inverse().is_finite()) {
            return Err(LodError::Placement);
        }
        // Gram and Schmidt, twice: the second pass mends what cancellation in the first has left.
        let x = m.x_axis.normalize();
        let rejected = |v: DVec3| v - x * x.dot(v);
        let y = rejected(rejected(m.y_axis.normalize()).normalize()).normalize();
        let rotation = DMat3::from_cols(x, y, x.cross(y));
        let mut stretch = rotation.transpose() * m;
        // Zero but for rounding, which would make two turns of one object look like two shapes.
        (stretch.x_axis.y, stretch.x_axis.z, stretch.y_axis.z) = (0.0, 0.0, 0.0);
        if !rotation.is_finite() {
            return Err(LodError::Placement);
        }
        Ok(Self { rotation, stretch, anchor, world_from_object: *world_from_object, origin })
    }

    /// World coordinates from the object's.
    pub fn world_from_object(&self) -> &DAffine3 {
        &self.world_from_object
    }

    /// Rigid frame from positions relative to the mesh's origin.
    pub fn stretch(&self) -> &DMat3 {
        &self.stretch
    }

    /// Axes of the rigid frame in the world.
    pub fn rotation(&self) -> &DMat3 {
        &self.rotation
    }

    /// Where the origin of mesh and rigid frame is in the world.
    pub fn anchor(&self) -> DVec3 {
        self.anchor
    }

    /// A world point in the rigid frame.
    pub fn to_rigid(&self, world: DVec3) -> DVec3 {
        self.rotation.transpose() * (world - self.anchor)
    }

    /// A point of the rigid frame in the world.
    pub fn to_world(&self, rigid: DVec3) -> DVec3 {
        self.anchor + self.rotation * rigid
    }

    /// A direction of the world in the rigid frame.
    pub fn direction_to_rigid(&self, world: DVec3) -> DVec3 {
        self.rotation.transpose() * world
    }

    /// The eye as the object's [`Cut`](crate::Cut) takes it.
    ///
    /// # Errors
    /// [`LodError::Placement`] when the eye is not finite.
    pub fn observer(&self, eye: DVec3) -> Result<Observer, LodError> {
        Observer::new(eye, &self.world_from_object, self.origin)
    }

    /// The box, in the rigid frame, around what a mesh's own box ([`TriangleMesh::bounds`](farsight_geometry::TriangleMesh::bounds)) contains, rounded outward.
    pub fn bounds(&self, local: &Aabb) -> DAabb {
        if local.is_empty() {
            return DAabb::EMPTY;
        }
        let (min, max) = (local.min.as_dvec3(), local.max.as_dvec3());
        let (center, half) = (0.5 * (min + max), 0.5 * (max - min));
        let s = &self.stretch;
        let wide = DMat3::from_cols(s.x_axis.abs(), s.y_axis.abs(), s.z_axis.abs());
        // Three products and two sums an axis, twice, and what was zeroed in the stretch.
        let slack = wide * (center.abs() + half) * (32.0 * f64::EPSILON);
        let (middle, reach) = (*s * center, wide * half + slack);
        DAabb::new(middle - reach, middle + reach)
    }

    /// Whether two placements differ by a rigid motion only, up to rounding.
    pub fn is_stretched_like(&self, other: &Self) -> bool {
        self.is_stretched_by(&other.stretch)
    }

    /// Whether the stretch is that of another placement, up to rounding. What this lets pass is part of [`SAME_STRETCH`].
    pub(crate) fn is_stretched_by(&self, stretch: &DMat3) -> bool {
        let size = self.stretch.to_cols_array().iter().fold(0.0f64, |m, x| m.max(x.abs()));
        self.stretch.abs_diff_eq(*stretch, 1e-9 * size)
    }

    /// How far points in a box of the rigid frame and an eye in the world may be from where they should be, by rounding of coordinates.
    pub(crate) fn rounding(&self, eye: DVec3, bounds: &DAabb) -> f64 {
        let reach = bounds.min.abs().max(bounds.max.abs()).length();
        16.0 * f64::EPSILON * (self.anchor.length() + eye.length() + reach)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use farsight_geometry::sampling::Random;
    use glam::{DQuat, Vec3};

    #[test]
    fn parts_multiply_to_the_whole_and_do_not_depend_on_rigid_motion() {
        let mut random = Random::new(11);
        for i in 0..2000 {
            let mut v = || DVec3::from_array(random.units()) * 2.0 - 1.0;
            let stretch = 10f64.powi(-(i % 9));
            let m = DMat3::from_cols(v(), v() * stretch, v() * if i % 2 == 0 { 1.0 } else { -4.0 });
            let origin = v() * 1e3;
            let place = DAffine3 { matrix3: m, translation: v() * 1e6 };
            let split = Placement::new(&place, origin).unwrap();
            let q = split.rotation;
            assert!((q.transpose() * q).abs_diff_eq(DMat3::IDENTITY, 1e-14) && q.determinant() > 0.0);
            let local = v();
            let rigid = split.stretch * local;
            let error = (split.rotation * rigid).distance(m * local);
            assert!(error <= 1e-14, "{error}");
            assert!(split.to_rigid(split.to_world(rigid)).distance(rigid) < 1e-8);

            let turn = DAffine3::from_rotation_translation(
                DQuat::from_axis_angle(v().normalize(), 3.0 * v().x),
                v() * 1e4,
            );
            let moved = Placement::new(&(turn * place), origin).unwrap();
            assert!(moved.is_stretched_like(&split), "{:?} {:?}", moved.stretch, split.stretch);
        }
    }

    #[test]
    fn boxes_contain_what_they_should() {
        let mut random = Random::new(12);
        for _ in 0..500 {
            let mut v = || DVec3::from_array(random.units()) * 2.0 - 1.0;
            let place = DAffine3 { matrix3: DMat3::from_cols(v(), v(), v()), translation: v() };
            let Ok(split) = Placement::new(&place, DVec3::ZERO) else { continue };
            let local = Aabb::from_points([v().as_vec3(), v().as_vec3()]);
            let rigid = split.bounds(&local);
            for corner in local.corners() {
                assert!(rigid.contains(split.stretch * corner.as_dvec3()));
            }
        }
        let split = Placement::new(&DAffine3::IDENTITY, DVec3::ZERO).unwrap();
        assert!(split.bounds(&Aabb::EMPTY).is_empty());
        assert!(split.bounds(&Aabb::new(Vec3::ZERO, Vec3::ONE)).contains(DVec3::ONE));
    }

    #[test]
    fn flat_and_broken_placements_are_refused() {
        for m in [DMat3::ZERO, DMat3::from_diagonal(DVec3::new(1.0, 0.0, 1.0)), DMat3::IDENTITY * f64::NAN] {
            let place = DAffine3 { matrix3: m, translation: DVec3::ZERO };
            assert_eq!(Placement::new(&place, DVec3::ZERO), Err(LodError::Placement));
        }
        let split = Placement::new(&DAffine3::IDENTITY, DVec3::ZERO).unwrap();
        assert_eq!(split.observer(DVec3::NAN), Err(LodError::Placement));
    }
}
