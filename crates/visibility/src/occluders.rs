//! Casting the rays: what hides, what is seen through, and what a line of sight meets on its way.

use crate::triangles::Triangles;
use farsight_geometry::{Hit, Ray, RayCaster, TriangleMesh};
use glam::DVec3;

/// The casters that answer for a scene: one over what hides, and one over what is seen and seen through.
///
/// Alpha-tested triangles (leaves, fences) are drawn but hide nothing for certain. They go into a caster of their own,
/// so that they never let a ray slip past an opaque triangle at the same place. [`parted`] splits a mesh.
#[derive(Debug)]
pub struct Occluders<'a, C> {
    opaque: &'a C,
    transparent: Option<&'a C>,
}

impl<C> Clone for Occluders<'_, C> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<C> Copy for Occluders<'_, C> {}

impl<'a, C: RayCaster> Occluders<'a, C> {
    /// All triangles hide.
    pub fn opaque(caster: &'a C) -> Self {
        Self { opaque: caster, transparent: None }
    }

    /// Those of the second caster are seen and seen through.
    pub fn with_transparent(opaque: &'a C, transparent: &'a C) -> Self {
        Self { opaque, transparent: Some(transparent) }
    }

    /// The first triangle of every ray of a bundle, opaque or not. What lies behind a transparent one goes to `behind`.
    pub(crate) fn bundle(
        &self,
        triangles: &Triangles,
        origin: DVec3,
        directions: &[DVec3],
        hits: &mut Vec<Option<Hit>>,
        mut behind: impl FnMut(usize, u32),
    ) {
        hits.resize(directions.len(), None);
        self.opaque.closest_bundle(origin, directions, hits);
        if self.transparent.is_some() {
            for (i, (&direction, hit)) in directions.iter().zip(hits).enumerate() {
                if let Some(ray) = Ray::new(origin, direction) {
                    self.through(triangles, &ray, hit, |triangle| behind(i, triangle));
                }
            }
        }
    }

    /// As [`bundle`](Self::bundle) for rays of different origins.
    pub(crate) fn batch(
        &self,
        triangles: &Triangles,
        rays: &[Ray],
        hits: &mut Vec<Option<Hit>>,
        mut behind: impl FnMut(usize, u32),
    ) {
        hits.resize(rays.len(), None);
        self.opaque.closest_batch(rays, hits);
        if self.transparent.is_some() {
            for (i, (ray, hit)) in rays.iter().zip(hits).enumerate() {
                self.through(triangles, ray, hit, |triangle| behind(i, triangle));
            }
        }
    }

    /// Walks through what is transparent before `hit`, which becomes the first of all; the others are told.
    fn through(&self, triangles: &Triangles, ray: &Ray, hit: &mut Option<Hit>, mut behind: impl FnMut(u32)) {
        let Some(transparent) = self.transparent else { return };
        let end = hit.map_or(f64::INFINITY, |h| h.t);
        let (opaque, mut from, mut first) = (*hit, 0.0f64, true);
        while let Some(next) = transparent.closest(&ray.with_range(from, end)) {
            if first {
                *hit = Some(next);
            } else {
                behind(triangles.of_hit(&next));
            }
            first = false;
            from = next.t.next_up();
        }
        if let (Some(opaque), false) = (opaque, first) {
            behind(triangles.of_hit(&opaque));
        }
    }
}

/// Two meshes that number their triangles as `mesh` does: the first without those that `is_transparent` names, the second
/// with nothing else. What is left out has no area, and no ray meets it.
pub fn parted(mesh: &TriangleMesh, is_transparent: impl Fn(u32) -> bool) -> [TriangleMesh; 2] {
    [false, true].map(|wanted| {
        let triangles = mesh.triangles().iter().enumerate();
        let kept = triangles.map(|(i, &t)| if is_transparent(i as u32) == wanted { t } else { [t[0]; 3] });
        let part = TriangleMesh::new(mesh.positions().to_vec(), kept.collect());
        part.and_then(|p| p.with_origin(mesh.origin())).expect("positions and indices of a valid mesh")
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use farsight_geometry::ray::Bvh8;
    use glam::Vec3;

    /// Squares across x at the given distances.
    fn screens(at: &[f32]) -> TriangleMesh {
        let mut positions = Vec::new();
        for &x in at {
            positions.extend([(-9.0, -9.0), (9.0, -9.0), (0.0, 9.0)].map(|(y, z)| Vec3::new(x, y, z)));
        }
        let triangles = (0..at.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        TriangleMesh::new(positions, triangles).unwrap()
    }

    #[test]
    fn rays_go_through_what_is_transparent_and_no_further() {
        // Transparent at 1, 2, 3 and 5; opaque at 3 and 4, the first of them at the same place as a transparent one.
        let mesh = screens(&[1.0, 2.0, 3.0, 3.0, 4.0, 5.0]);
        let is_transparent = |t: u32| [0, 1, 2, 5].contains(&t);
        let [opaque, transparent] = parted(&mesh, is_transparent).map(|m| Bvh8::new(&m));
        let occluders = Occluders::with_transparent(&opaque, &transparent);
        let triangles = Triangles::of_mesh(&mesh);
        let (mut hits, mut seen) = (Vec::new(), Vec::new());
        occluders.bundle(&triangles, DVec3::ZERO, &[DVec3::X], &mut hits, |_, t| seen.push(t));
        assert_eq!((hits[0].unwrap().triangle, seen.as_slice()), (0, &[1, 2, 3][..]));
        seen.clear();
        let ray = Ray::new(DVec3::X * 3.5, DVec3::X).unwrap();
        occluders.batch(&triangles, &[ray], &mut hits, |_, t| seen.push(t));
        assert_eq!((hits[0].unwrap().triangle, seen.as_slice()), (4, &[][..]));
    }
}
