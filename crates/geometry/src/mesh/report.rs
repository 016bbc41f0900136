//! What is unusual about a mesh.

use super::{DisjointSets, TriangleMesh, weld_points};
use std::fmt;

/// Counts of what algorithms may stumble over, taken after merging vertices with equal positions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct MeshReport {
    /// Triangles, all of them.
    pub triangles: usize,
    /// Vertices as given.
    pub vertices: usize,
    /// Vertices that no triangle uses.
    pub unreferenced: usize,
    /// Vertices at the position of an earlier one.
    pub repeated_vertices: usize,
    /// Triangles whose height is below 1e-7 of their longest side, those with a repeated corner included.
    pub zero_area: usize,
    /// Triangles whose height is below 1/100 of their longest side, zero area included.
    pub slivers: usize,
    /// Triangles with the same three corners as an earlier one, in any order; not those that repeat a corner.
    pub doubled: usize,
    /// Edges of one triangle. A triangle that repeats a corner is a line: it has no edges here and below.
    pub border_edges: usize,
    /// Edges of more than two triangles.
    pub non_manifold_edges: usize,
    /// Connected parts: triangles that share a vertex are in one.
    pub components: usize,
}

impl MeshReport {
    /// Whether every edge has exactly two triangles.
    pub fn is_closed(&self) -> bool {
        self.triangles > 0 && self.border_edges == 0 && self.non_manifold_edges == 0
    }

    /// The counts of two meshes together; edges and parts between them are not looked for.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        Self {
            triangles: self.triangles + other.triangles,
            vertices: self.vertices + other.vertices,
            unreferenced: self.unreferenced + other.unreferenced,
            repeated_vertices: self.repeated_vertices + other.repeated_vertices,
            zero_area: self.zero_area + other.zero_area,
            slivers: self.slivers + other.slivers,
            doubled: self.doubled + other.doubled,
            border_edges: self.border_edges + other.border_edges,
            non_manifold_edges: self.non_manifold_edges + other.non_manifold_edges,
            components: self.components + other.components,
        }
    }
}

impl fmt::Display for MeshReport {
    /// Triangle and vertex counts, then whatever is not zero.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} triangles, {} vertices, {} parts", self.triangles, self.vertices, self.components)?;
        for (count, what) in [
            (self.border_edges, "border edges"),
            (self.non_manifold_edges, "non-manifold edges"),
            (self.zero_area, "zero-area"),
            (self.slivers, "slivers"),
            (self.doubled, "doubled"),
            (self.repeated_vertices, "repeated vertices"),
            (self.unreferenced, "unreferenced"),
        ] {
            if count > 0 {
                write!(f, ", {count} {what}")?;
            }
        }
        Ok(())
    }
}

pub(super) fn report(mesh: &TriangleMesh) -> MeshReport {
    let (id_of, first) = weld_points(mesh.positions());
    let triangles: Vec<[u32; 3]> = mesh.triangles().iter().map(|t| t.map(|i| id_of[i as usize])).collect();
    let (zero_area, slivers) = thin_triangles(mesh);
    let (border_edges, non_manifold_edges) = count_edges(&triangles);
    MeshReport {
        triangles: triangles.len(),
        vertices: mesh.positions().len(),
        unreferenced: count_unreferenced(mesh),
        repeated_vertices: mesh.positions().len() - first.len(),
        zero_area,
        slivers,
        doubled: count_doubled(&triangles),
        border_edges,
        non_manifold_edges,
        components: count_components(&triangles, first.len()),
    }
}

fn thin_triangles(mesh: &TriangleMesh) -> (usize, usize) {
    let (mut zero_area, mut slivers) = (0, 0);
    for corners in mesh.corner_iter() {
        let [a, b, c] = corners.map(|p| p.as_dvec3());
        let longest_sq = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
        // height / longest side = 2 area / longest side².
        let ratio = (b - a).cross(c - a).length() / longest_sq;
        zero_area += usize::from(longest_sq == 0.0 || ratio < 1e-7);
        slivers += usize::from(longest_sq == 0.0 || ratio < 1e-2);
    }
    (zero_area, slivers)
}

fn count_unreferenced(mesh: &TriangleMesh) -> usize {
    let mut used = vec![false; mesh.positions().len()];
    mesh.triangles().iter().flatten().for_each(|&i| used[i as usize] = true);
    used.iter().filter(|u| !**u).count()
}

/// Whether the corners differ; one that repeats a corner is a line, with no edges and no double.
fn has_area([a, b, c]: &[u32; 3]) -> bool {
    a != b && b != c && c != a
}

fn count_doubled(triangles: &[[u32; 3]]) -> usize {
    let mut keys: Vec<[u32; 3]> = triangles.iter().copied().filter(has_area).collect();
    keys.iter_mut().for_each(|k| k.sort_unstable());
    keys.sort_unstable();
    keys.windows(2).filter(|w| w[0] == w[1]).count()
}

/// Edges with one triangle, and with more than two.
fn count_edges(triangles: &[[u32; 3]]) -> (usize, usize) {
    let mut edges: Vec<u64> = triangles
        .iter()
        .filter(|t| has_area(t))
        .copied()
        .flat_map(|[a, b, c]| [(a, b), (b, c), (c, a)])
        .map(|(a, b)| u64::from(a.min(b)) << 32 | u64::from(a.max(b)))
        .collect();
    edges.sort_unstable();
    edges.chunk_by(|a, b| a == b).fold((0, 0), |(border, non_manifold), users| {
        (border + usize::from(users.len() == 1), non_manifold + usize::from(users.len() > 2))
    })
}

fn count_components(triangles: &[[u32; 3]], vertices: usize) -> usize {
    let mut sets = DisjointSets::new(vertices);
    let mut used = vec![false; vertices];
    for &[a, b, c] in triangles {
        [a, b, c].iter().for_each(|&v| used[v as usize] = true);
        sets.join(a, b);
        sets.join(a, c);
    }
    (0..vertices).filter(|&v| used[v] && sets.lowest(v as u32) == v as u32).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn defects_are_counted() {
        // Two triangles over one edge, one of them doubled, a far one with zero area, and an unused vertex.
        let p =
            [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::ONE, Vec3::splat(5.0), Vec3::splat(6.0), Vec3::X, Vec3::Z];
        let t = vec![[0, 1, 2], [1, 3, 2], [2, 0, 6], [4, 5, 5]];
        let report = TriangleMesh::new(p.to_vec(), t).unwrap().report();
        assert_eq!(
            report,
            MeshReport {
                triangles: 4,
                vertices: 8,
                unreferenced: 1,
                repeated_vertices: 1,
                zero_area: 1,
                slivers: 1,
                doubled: 1,
                border_edges: 2,
                non_manifold_edges: 1,
                components: 2,
            }
        );
        assert!(!report.is_closed());
    }

    #[test]
    fn a_tetrahedron_is_closed_and_nothing_is_not() {
        let p = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z];
        let mesh = TriangleMesh::new(p, vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]).unwrap();
        assert!(mesh.report().is_closed());
        assert!(!TriangleMesh::default().report().is_closed());
        assert_eq!(TriangleMesh::default().report(), MeshReport::default());
    }
}
