//! Points that stand for all triangles of a node: what a renderer without triangles draws.

use farsight_geometry::glam::Vec3;
use farsight_hlod::NodeMesh;
use std::collections::HashSet;

/// Points with normals.
#[derive(Default)]
pub struct Points {
    pub positions: Vec<Vec3>,
    pub normals: Vec<Vec3>,
    pub radius: f64,
}

/// Every triangle divided until the corners of its parts are within `2 · reach` of their barycentres; then points at corners and middles of sides, one a cell of
/// a grid of half the reach. Discs of their radius cover the surface.
pub fn all(mesh: &NodeMesh, reach: f64) -> Points {
    let cell = (0.5 * reach) as f32;
    let mut seen = HashSet::new();
    let mut out = Points { radius: reach * (1.0 + 0.5 * 3f64.sqrt()), ..Points::default() };
    for t in mesh.indices.as_chunks::<3>().0 {
        let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
        let middle = (a + b + c) / 3.0;
        let farthest = [a, b, c].iter().map(|p| p.distance(middle)).fold(0.0, f32::max);
        let face = (b - a).cross(c - a).normalize_or_zero();
        let normals = t.map(|v| mesh.normals.get(v as usize).copied().unwrap_or(face));
        // Parts along a side, and two steps to each of them.
        let steps = 2 * ((f64::from(farthest) / (2.0 * reach)).ceil().max(1.0) as u32);
        for i in 0..=steps {
            for j in 0..=steps - i {
                let (u, v) = (i as f32 / steps as f32, j as f32 / steps as f32);
                let at = a + (b - a) * u + (c - a) * v;
                if seen.insert((at / cell).floor().to_array().map(|x| x as i32)) {
                    let n = normals[0] * (1.0 - u - v) + normals[1] * u + normals[2] * v;
                    out.positions.push(at);
                    out.normals.push(n.normalize_or_zero());
                }
            }
        }
    }
    out
}
