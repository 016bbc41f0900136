//! Coordinates to compute in: the box centred, the extent between ½ and 1, every output position an `f32`.

use farsight_geometry::{Aabb, TriangleMesh};
use glam::{DVec3, Vec3};

/// What all rounding of a certificate together may amount to, in units of the frame (extent below 1).
///
/// Barycentric coordinates of a [`Facet`](crate::facet::Facet) are the worst: their error is a few units in the last
/// place of 1 times the facet's longest side over its height, at most 1e5, so 1e-10 when turned back into a
/// distance. Edges that are taken for touching a facet's border reach into it by 1e-12 of its size. The rest are sums of
/// products of coordinates below 2: 1e-14.
pub(crate) const SLACK: f64 = 1e-9;

/// The map between a mesh's local `f32` coordinates and the frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    center: DVec3,
    /// A power of two, so that scaling is exact.
    scale: f64,
}

impl Frame {
    pub(crate) fn of(mesh: &TriangleMesh) -> Self {
        let b: Aabb = mesh.bounds();
        if b.is_empty() {
            return Self { center: DVec3::ZERO, scale: 1.0 };
        }
        let (min, max) = (b.min.as_dvec3(), b.max.as_dvec3());
        let extent = (max - min).max_element();
        let scale = if extent > 0.0 { (-(extent.log2().floor() + 1.0)).exp2() } else { 1.0 };
        // An f32 centre: most differences to f32 coordinates are exact then.
        Self { center: ((min + max) * 0.5).as_vec3().as_dvec3(), scale }
    }

    pub(crate) fn enter(&self, p: Vec3) -> DVec3 {
        (p.as_dvec3() - self.center) * self.scale
    }

    pub(crate) fn leave(&self, p: DVec3) -> Vec3 {
        (p / self.scale + self.center).as_vec3()
    }

    /// The nearest position that an output vertex can have.
    pub(crate) fn snap(&self, p: DVec3) -> DVec3 {
        self.enter(self.leave(p))
    }

    pub(crate) fn length_in(&self, length: f64) -> f64 {
        length * self.scale
    }

    pub(crate) fn length_out(&self, length: f64) -> f64 {
        length / self.scale
    }
}

/// Most that rounding to `f32` moved a coordinate of the mesh: half the spacing at the largest one.
pub(crate) fn resolution(mesh: &TriangleMesh) -> f64 {
    let b = mesh.bounds();
    if b.is_empty() {
        return 0.0;
    }
    let largest = b.min.abs().max(b.max.abs()).max_element();
    0.5 * (f64::from(largest.next_up()) - f64::from(largest))
}

#[cfg(test)]
mod tests {
    use super::*;
    use farsight_geometry::hard_cases;

    #[test]
    fn every_vertex_comes_back_bit_for_bit() {
        for hard in hard_cases::meshes() {
            let frame = Frame::of(&hard.mesh);
            for &p in hard.mesh.corner_iter().collect::<Vec<_>>().iter().flatten() {
                let q = frame.enter(p);
                assert!(q.abs().max_element() <= 1.0, "{}", hard.name);
                assert!(frame.leave(q).distance(p) <= 1e-7 * p.abs().max_element(), "{} {p}", hard.name);
                assert_eq!(frame.snap(frame.snap(q)), frame.snap(q));
            }
        }
    }
}
