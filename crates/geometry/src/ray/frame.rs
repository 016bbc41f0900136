//! Tree coordinates: the mesh moved next to the origin and scaled to about one.

use crate::bounds::Aabb;
use crate::mesh::TriangleMesh;
use glam::{DVec3, Vec3};

/// The map between a mesh's coordinates and those of its tree.
///
/// Both steps are exact in `f32`: the shift is taken only on axes where all coordinates lie within a factor of two
/// (Sterbenz's lemma), the scale is a power of two. Tree coordinates therefore are the mesh's own vertices, not
/// approximations of them (coordinates below 1e-45 of the mesh's size round to zero).
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    origin: DVec3,
    shift: DVec3,
    scale: f64,
}

impl Frame {
    pub(super) fn of_mesh(mesh: &TriangleMesh) -> Self {
        Self::new(mesh.origin(), mesh.bounds())
    }

    fn new(origin: DVec3, bounds: Aabb) -> Self {
        if bounds.is_empty() {
            return Self { origin, shift: DVec3::ZERO, scale: 1.0 };
        }
        let shift = Vec3::from_array(std::array::from_fn(|i| shift(bounds.min[i], bounds.max[i]))).as_dvec3();
        let (lo, hi) = (bounds.min.as_dvec3() - shift, bounds.max.as_dvec3() - shift);
        let largest = lo.abs().max(hi.abs()).max_element();
        Self { origin, shift, scale: if largest > 0.0 { power_of_two_above(largest).recip() } else { 1.0 } }
    }

    /// A local mesh position in the tree: exact.
    pub(super) fn vertex(&self, p: Vec3) -> Vec3 {
        ((p.as_dvec3() - self.shift) * self.scale).as_vec3()
    }

    pub(super) fn point(&self, world: DVec3) -> DVec3 {
        ((world - self.origin) - self.shift) * self.scale
    }

    /// A direction keeps its parameter: `point(o + t·d) = point(o) + t·vector(d)`.
    pub(super) fn vector(&self, world: DVec3) -> DVec3 {
        world * self.scale
    }

    pub(super) fn world_point(&self, p: DVec3) -> DVec3 {
        (p / self.scale + self.shift) + self.origin
    }

    /// Tree units per world unit.
    pub(super) fn scale(&self) -> f64 {
        self.scale
    }
}

/// What can be subtracted from every number between `lo` and `hi` without rounding, and makes them smaller.
fn shift(lo: f32, hi: f32) -> f32 {
    let same_binade = (lo > 0.0 && hi <= 2.0 * lo) || (hi < 0.0 && lo >= 2.0 * hi);
    if same_binade { lo * 0.5 + hi * 0.5 } else { 0.0 }
}

/// The smallest power of two above a positive number, for the magnitudes that `f32` has.
pub(super) fn power_of_two_above(x: f64) -> f64 {
    f64::from_bits(((x.to_bits() >> 52) + 1) << 52)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vertices_survive_exactly() {
        for (offset, size) in [(0.0, 1.0), (1e6, 1.0), (-3e7, 100.0), (0.0, 1e18), (0.0, 1e-18), (5.0, 30.0)]
        {
            let p = [Vec3::ZERO, Vec3::X, Vec3::new(0.3, 0.7, -0.2)].map(|v| v * size + Vec3::splat(offset));
            let mesh = TriangleMesh::new(p.to_vec(), vec![[0, 1, 2]]).unwrap();
            let frame = Frame::of_mesh(&mesh);
            for v in p {
                let tree = frame.vertex(v);
                assert!(tree.abs().max_element() < 1.0, "{tree}");
                assert_eq!(frame.world_point(tree.as_dvec3()), v.as_dvec3(), "{offset} {size}");
            }
        }
    }

    #[test]
    fn powers_of_two_lie_above() {
        for (x, p) in [(1.0, 2.0), (0.75, 1.0), (1e18, 2f64.powi(60)), (3e-40, 2f64.powi(-131))] {
            assert_eq!(power_of_two_above(x), p);
        }
    }
}
