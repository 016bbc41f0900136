//! The vertex hierarchy: which vertices stand for which others, and which triangles that makes vanish.

use crate::LodError;
use crate::build;
use crate::charts::Charts;
use farsight_geometry::{Aabb, TriangleMesh};
use glam::{DVec3, Vec3};

/// "No node".
pub(crate) const NONE: u32 = u32::MAX;

/// A cluster of two or more vertices, and the one that stands for all of them while the node is folded.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Node {
    /// Node above; [`NONE`] for the root.
    pub(crate) parent: u32,
    /// One past the last node below. Nodes are numbered depth first, so what is below `i` is `i + 1..end`.
    pub(crate) end: u32,
    /// First of its vertices in the hierarchy's own order: those of no node below come first, then those of each node below.
    pub(crate) first_vertex: u32,
    /// First of the triangles that vanish when the node folds; they end where those of the next node begin.
    pub(crate) first_triangle: u32,
    /// The vertex that stands for all, by its place in the hierarchy's order.
    pub(crate) representative: u32,
    /// Where that is, relative to the mesh's origin.
    pub(crate) center: Vec3,
    /// Farthest vertex of the node from the representative, rounded up.
    pub(crate) radius: f32,
    /// Farthest point, from the representative, of any triangle with a corner in the node, rounded up.
    pub(crate) reach: f32,
    /// Normals of all these triangles lie within `cone_angle` of this axis.
    pub(crate) cone_axis: Vec3,
    /// In radians, rounded up; π where nothing is known.
    pub(crate) cone_angle: f32,
}

/// A tree over a mesh's vertices, and the mesh's triangles in its order. One serves any number of [`Cut`](crate::Cut)s.
///
/// The leaves are single vertices, so an all-unfolded cut is the mesh itself. Nodes are cells of an octree whose boxes are shrunk to
/// their vertices. The vertex of highest weight (curvature times mean length of its edges) stands for the others.
///
/// # Cost
/// 56 bytes a node (about one for 4 or 5 triangles), 28 a triangle and 20 a vertex; see [`bytes`](Self::bytes).
///
/// # References
/// [Hilbert & Brunnett 2004, section 3], after Luebke & Erikson 1997. Differs: every triangle hangs on the one node whose folding makes
/// it vanish, displacement is measured from the representative, and the normal cones are of the triangles that touch a node.
#[derive(Clone, Debug)]
pub struct VertexHierarchy {
    pub(crate) nodes: Vec<Node>,
    /// The mesh's number of each vertex, and its position relative to the mesh's origin.
    pub(crate) vertices: Vec<u32>,
    pub(crate) positions: Vec<Vec3>,
    /// Corners as vertices in this order, triangles in the order of their home nodes, and each one's index in the mesh.
    pub(crate) triangles: Vec<[u32; 3]>,
    pub(crate) original: Vec<u32>,
    /// Triangles around each vertex, and where they begin.
    around: Vec<u32>,
    first_around: Vec<u32>,
    dropped: usize,
    bounds: Aabb,
    /// Middle and radius of a ball around all vertices.
    pub(crate) ball: (DVec3, f64),
    /// For meshes with texture coordinates that are to stay usable.
    pub(crate) charts: Option<Charts>,
}

impl VertexHierarchy {
    /// Builds the tree.
    ///
    /// The mesh may be any triangle soup. Triangles that name a vertex twice have no area in any cut and are [`dropped`](Self::dropped).
    ///
    /// # Errors
    /// [`LodError::NoTriangle`] when none is left.
    pub fn build(mesh: &TriangleMesh) -> Result<Self, LodError> {
        let whole = |t: &[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
        let kept: Vec<u32> =
            (0..mesh.triangles().len() as u32).filter(|&t| whole(&mesh.triangles()[t as usize])).collect();
        if kept.is_empty() {
            return Err(LodError::NoTriangle);
        }
        let dropped = mesh.triangles().len() - kept.len();
        Ok(build::build(mesh, kept, dropped))
    }

    pub(crate) fn from_parts(
        nodes: Vec<Node>,
        vertices: Vec<u32>,
        positions: Vec<Vec3>,
        triangles: Vec<[u32; 3]>,
        original: Vec<u32>,
        dropped: usize,
    ) -> Self {
        let bounds = Aabb::from_points(positions.iter().copied());
        let middle = bounds.center().as_dvec3();
        let farthest_sq = positions.iter().map(|p| p.as_dvec3().distance_squared(middle)).fold(0.0, f64::max);
        let ball = (middle, farthest_sq.sqrt() * (1.0 + 1e-14));
        let mut first_around = vec![0u32; vertices.len() + 1];
        triangles.as_flattened().iter().for_each(|&v| first_around[v as usize + 1] += 1);
        (0..vertices.len()).for_each(|v| first_around[v + 1] += first_around[v]);
        let mut next = first_around.clone();
        let mut around = vec![0; 3 * triangles.len()];
        for (t, corners) in triangles.iter().enumerate() {
            for &v in corners {
                around[next[v as usize] as usize] = t as u32;
                next[v as usize] += 1;
            }
        }
        Self {
            nodes,
            vertices,
            positions,
            triangles,
            original,
            around,
            first_around,
            dropped,
            bounds,
            ball,
            charts: None,
        }
    }

    /// Triangles that a fully unfolded cut draws.
    pub fn triangle_count(&self) -> usize {
        self.triangles.len()
    }

    /// Triangles of the mesh that named a vertex twice.
    pub fn dropped(&self) -> usize {
        self.dropped
    }

    /// Clusters of two or more vertices.
    pub fn node_count(&self) -> usize {
        self.nodes.len()
    }

    /// Farthest vertex from the one that stands for the whole mesh.
    pub fn radius(&self) -> f64 {
        self.nodes[0].radius.into()
    }

    /// Box of the vertices that triangles use, relative to the mesh's origin.
    pub fn bounds(&self) -> &Aabb {
        &self.bounds
    }

    /// Memory held, in bytes.
    pub fn bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<Node>()
            + self.positions.capacity() * size_of::<Vec3>()
            + (self.vertices.capacity() + self.original.capacity()) * size_of::<u32>()
            + (self.around.capacity() + self.first_around.capacity()) * size_of::<u32>()
            + self.triangles.capacity() * size_of::<[u32; 3]>()
            + self.charts.as_ref().map_or(0, Charts::bytes)
    }

    /// Position of what stands for a node, relative to the mesh's origin.
    #[cfg(test)]
    pub(crate) fn position(&self, node: u32) -> DVec3 {
        self.nodes[node as usize].center.as_dvec3()
    }

    /// The nodes right below one.
    pub(crate) fn children(&self, node: u32) -> impl Iterator<Item = u32> + '_ {
        let end = self.nodes[node as usize].end;
        let mut next = node + 1;
        std::iter::from_fn(move || {
            let child = next;
            (child < end).then(|| {
                next = self.nodes[child as usize].end;
                child
            })
        })
    }

    /// The vertices of a node.
    pub(crate) fn vertices_of(&self, node: u32) -> std::ops::Range<usize> {
        let first = self.nodes[node as usize].first_vertex as usize;
        let next = self.nodes.get(self.nodes[node as usize].end as usize);
        first..next.map_or(self.vertices.len(), |n| n.first_vertex as usize)
    }

    /// The vertices of a node that belong to none below.
    pub(crate) fn own_vertices(&self, node: u32) -> std::ops::Range<usize> {
        let all = self.vertices_of(node);
        let below = self.children(node).next();
        all.start..below.map_or(all.end, |n| self.nodes[n as usize].first_vertex as usize)
    }

    /// Writes, for the vertices of a node (`proxies` are those of all), what stands for them while it is folded.
    pub(crate) fn stand_in(&self, node: u32, proxies: &mut [u32]) {
        let range = self.vertices_of(node);
        let own = &mut proxies[range.clone()];
        if self.charts.as_ref().is_some_and(|charts| charts.stand_in(node, range.start, own)) {
            return;
        }
        own.fill(self.vertices[self.nodes[node as usize].representative as usize]);
    }

    /// The triangles around a vertex.
    pub(crate) fn around(&self, vertex: usize) -> &[u32] {
        &self.around[self.first_around[vertex] as usize..self.first_around[vertex + 1] as usize]
    }

    /// The triangles that vanish when a node folds.
    pub(crate) fn home_triangles(&self, node: u32) -> std::ops::Range<usize> {
        let first = self.nodes[node as usize].first_triangle as usize;
        let end = self.nodes.get(node as usize + 1);
        first..end.map_or(self.triangles.len(), |n| n.first_triangle as usize)
    }
}
