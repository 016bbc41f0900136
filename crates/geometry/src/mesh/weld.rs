//! Merging vertices by exact position.

use super::TriangleMesh;
use glam::Vec3;
use std::collections::HashMap;

/// A mesh in which no two vertices share a position, and what became of the old vertices.
#[derive(Clone, Debug, PartialEq)]
pub struct Welded {
    /// The mesh without attributes; triangles keep their order, degenerate ones included.
    pub mesh: TriangleMesh,
    /// New index of every old vertex.
    pub new_from_old: Vec<u32>,
    /// How many vertices were merged into an earlier one.
    pub merged: usize,
}

/// Gives every distinct position an id, in order of first use. Positive and negative zero are equal.
///
/// Returns the id of each point and the index of the first point of each id.
///
/// # Cost
/// O(n) time, by hashing.
pub fn weld_points(points: &[Vec3]) -> (Vec<u32>, Vec<u32>) {
    let mut ids: HashMap<[u32; 3], u32> = HashMap::with_capacity(points.len());
    let mut first = Vec::new();
    let id_of = points
        .iter()
        .enumerate()
        .map(|(i, p)| {
            // Adding +0.0 turns -0.0 into +0.0.
            let key = (*p + Vec3::ZERO).to_array().map(f32::to_bits);
            *ids.entry(key).or_insert_with(|| {
                first.push(i as u32);
                first.len() as u32 - 1
            })
        })
        .collect();
    (id_of, first)
}

pub(super) fn welded(mesh: &TriangleMesh) -> Welded {
    let (new_from_old, first) = weld_points(&mesh.positions);
    let positions: Vec<Vec3> = first.iter().map(|&i| mesh.positions[i as usize]).collect();
    let triangles: Vec<[u32; 3]> =
        mesh.triangles.iter().map(|t| t.map(|i| new_from_old[i as usize])).collect();
    let merged = mesh.positions.len() - positions.len();
    let mesh = TriangleMesh { origin: mesh.origin, ..TriangleMesh::of_valid(positions, triangles) };
    Welded { mesh, new_from_old, merged }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_positions_merge_in_order_of_first_use() {
        let p = [Vec3::X, Vec3::ZERO, Vec3::X, -Vec3::ZERO, Vec3::Y];
        let (ids, first) = weld_points(&p);
        assert_eq!((ids, first), (vec![0, 1, 0, 1, 2], vec![0, 1, 4]));
        let mesh = TriangleMesh::new(p.to_vec(), vec![[0, 1, 4], [2, 3, 4]]).unwrap();
        let welded = mesh.welded();
        assert_eq!((welded.mesh.triangles(), welded.merged), (&[[0, 1, 2], [0, 1, 2]][..], 2));
    }
}
