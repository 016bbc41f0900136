//! Every triangle in turn: the oracle.

use super::{Hit, Ray, RayCaster};
use crate::mesh::TriangleMesh;
use glam::DVec3;

/// Tests every triangle by itself with signed volumes in `f64`; the oracle that fast casters are checked against.
///
/// It shares no code and no formula with them. Accuracy: near an edge (relative 1e-14) it may decide differently from
/// a watertight caster, in either direction. A triangle that the ray sees from its edge, as far as `f64` can tell, is
/// missed.
///
/// # Cost
/// O(triangles) per ray.
#[derive(Clone, Debug)]
pub struct BruteForce {
    triangles: Vec<[DVec3; 3]>,
    origin: DVec3,
    front_only: bool,
}

impl BruteForce {
    /// Copies the mesh's triangles.
    pub fn new(mesh: &TriangleMesh) -> Self {
        let triangles = mesh.corner_iter().map(|t| t.map(|p| p.as_dvec3())).collect();
        Self { triangles, origin: mesh.origin(), front_only: false }
    }

    /// The same caster for front faces only.
    #[must_use]
    pub fn front_faces_only(self) -> Self {
        Self { front_only: true, ..self }
    }

    /// Every triangle on the ray, in order of id.
    pub fn all(&self, ray: &Ray) -> impl Iterator<Item = Hit> {
        let (o, d) = (ray.origin() - self.origin, ray.direction());
        let (t_min, t_max) = (ray.t_min(), ray.t_max());
        self.triangles.iter().enumerate().filter_map(move |(id, corners)| {
            let (t, [_, v, w], back_face) = crossing(o, d, *corners)?;
            let barycentrics = [v as f32, w as f32];
            let hit = Hit { t, instance: 0, triangle: id as u32, barycentrics, back_face };
            (t >= t_min && t <= t_max && !(back_face && self.front_only)).then_some(hit)
        })
    }
}

/// Distance, weights of the corners and side, from the volumes that the ray spans with the edges.
fn crossing(o: DVec3, d: DVec3, [a, b, c]: [DVec3; 3]) -> Option<(f64, [f64; 3], bool)> {
    let (e, f) = (b - a, c - a);
    let normal = e.cross(f);
    let facing = normal.dot(d);
    // Less than its own rounding: the distance would be noise.
    if facing.abs() <= 4.0 * f64::EPSILON * e.length() * f.length() {
        return None;
    }
    let (a, b, c) = (a - o, b - o, c - o);
    let volumes = [d.dot(c.cross(b)), d.dot(a.cross(c)), d.dot(b.cross(a))];
    let total: f64 = volumes.iter().sum();
    let one_sign = volumes.iter().all(|v| *v >= 0.0) || volumes.iter().all(|v| *v <= 0.0);
    if !one_sign || total == 0.0 {
        return None;
    }
    Some((normal.dot(a) / facing, volumes.map(|v| v / total), facing > 0.0))
}

impl RayCaster for BruteForce {
    fn closest(&self, ray: &Ray) -> Option<Hit> {
        self.all(ray).reduce(|best, hit| if hit.t < best.t { hit } else { best })
    }
}
