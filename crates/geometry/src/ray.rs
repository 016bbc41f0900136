//! Ray casting: what is asked and answered, whoever answers.
//!
//! | caster | for |
//! |---|---|
//! | [`Bvh8`] | one mesh: eight-wide tree in SIMD, watertight, exact to `f64` |
//! | [`SceneCaster`] | all instances of a scene |
//! | `ObvhsCaster` (feature `obvhs`) | a second, independent tree |
//! | [`BruteForce`] | tests: every triangle in turn, a different method, no tree |

mod brute;
mod build;
mod bundle;
mod bvh8;
mod collapse;
mod exact;
mod frame;
mod instances;
mod nearest;
#[cfg(feature = "obvhs")]
mod obvhs;
mod single;
mod tree;

pub use brute::BruteForce;
pub use bvh8::{Bvh8, SimdLevel};
pub use instances::{SceneCaster, SceneCasterError};
pub use nearest::SurfacePoint;
#[cfg(feature = "obvhs")]
pub use obvhs::{ObvhsCaster, ObvhsTree};

use glam::DVec3;

/// A half-line, or a piece of it, in world coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    origin: DVec3,
    direction: DVec3,
    t_min: f64,
    t_max: f64,
}

impl Ray {
    /// The half-line from `origin` in `direction`, which need not be of unit length.
    ///
    /// `None` when a coordinate is NaN or infinite, or `direction` has no length.
    pub fn new(origin: DVec3, direction: DVec3) -> Option<Self> {
        // Dividing by the largest component first keeps squares of tiny and huge vectors representable.
        let scale = direction.abs().max_element();
        let direction = (direction / scale).normalize_or_zero();
        // Adding +0.0 turns −0.0 into +0.0, which slab tests by sign rely on.
        let usable = origin.is_finite() && scale.is_finite() && direction != DVec3::ZERO;
        usable.then(|| Self { origin, direction: direction + DVec3::ZERO, t_min: 0.0, t_max: f64::INFINITY })
    }

    /// The ray restricted to distances from `t_min` to `t_max`, both included.
    #[must_use]
    pub fn with_range(self, t_min: f64, t_max: f64) -> Self {
        Self { t_min, t_max, ..self }
    }

    /// Where it starts.
    #[inline]
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// Unit direction, without negative zeros.
    #[inline]
    pub fn direction(&self) -> DVec3 {
        self.direction
    }

    /// Smallest distance that counts.
    pub fn t_min(&self) -> f64 {
        self.t_min
    }

    /// Largest distance that counts.
    pub fn t_max(&self) -> f64 {
        self.t_max
    }

    /// The point at distance `t`.
    pub fn at(&self, t: f64) -> DVec3 {
        self.origin + self.direction * t
    }
}

/// What a ray meets first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance along the ray, in world units.
    pub t: f64,
    /// Instance that was hit; zero for a caster over a single mesh.
    pub instance: u32,
    /// Triangle of the instance's mesh.
    pub triangle: u32,
    /// Weights of the second and third corner.
    pub barycentrics: [f32; 2],
    /// Whether the triangle's back was hit (its corners appear clockwise).
    pub back_face: bool,
}

/// Anything that finds the first triangle on a ray.
///
/// Implementations must not leak through shared edges and vertices, and must answer with the lowest (instance,
/// triangle) when several triangles lie at the same distance.
pub trait RayCaster: Sync {
    /// The first hit, if there is one.
    fn closest(&self, ray: &Ray) -> Option<Hit>;

    /// The first hit of every ray, in order. `hits` is as long as `rays`; all of it is overwritten.
    fn closest_batch(&self, rays: &[Ray], hits: &mut [Option<Hit>]) {
        for (ray, hit) in rays.iter().zip(hits) {
            *hit = self.closest(ray);
        }
    }

    /// The first hit of rays that share their origin and are close in direction. `hits` is as long as
    /// `directions`, and all of it is overwritten; a direction without length hits nothing.
    fn closest_bundle(&self, origin: DVec3, directions: &[DVec3], hits: &mut [Option<Hit>]) {
        for (&direction, hit) in directions.iter().zip(hits) {
            *hit = Ray::new(origin, direction).and_then(|ray| self.closest(&ray));
        }
    }

    /// Whether anything lies on the ray.
    fn occluded(&self, ray: &Ray) -> bool {
        self.closest(ray).is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_normalised_without_negative_zeros() {
        for scale in [1e-300, 1e-8, 1.0, 1e300] {
            let ray = Ray::new(DVec3::ZERO, DVec3::new(-0.0, 3.0, -4.0) * scale).unwrap();
            assert!(ray.direction().abs_diff_eq(DVec3::new(0.0, 0.6, -0.8), 1e-15));
            assert!(ray.direction().x.is_sign_positive());
        }
        assert!(Ray::new(DVec3::ZERO, DVec3::ZERO).is_none());
        assert!(Ray::new(DVec3::ZERO, DVec3::NAN).is_none());
        assert!(Ray::new(DVec3::INFINITY, DVec3::X).is_none());
    }
}
