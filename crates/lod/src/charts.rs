//! Texture coordinates on the reduced mesh: every drawn triangle stays within the chart of the atlas that it is from.
//!
//! A vertex that stands for others belongs to one chart. For the triangles of other charts an extra vertex stands in its place, with the texture
//! coordinates of the point of *their* chart that is nearest to it. There are finitely many pairs of node and chart, so all of this is found when the
//! hierarchy is built, and costs a frame nothing.

use crate::hierarchy::VertexHierarchy;
use crate::{Cut, LodError};
use farsight_geometry::accuracy::{ErrorBound, Unit};
use farsight_geometry::distance::closest_on_triangle;
use farsight_geometry::mesh::DisjointSets;
use farsight_geometry::{MeshError, TriangleMesh, rounding};
use glam::{DVec2, DVec3, Vec3};

/// A vertex that the mesh does not have: it is where another one is, and looks like a point of a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeamVertex {
    /// The mesh vertex whose place it takes.
    pub place: u32,
    /// The triangle of the mesh on which the nearest point of the chart lies.
    pub triangle: u32,
    /// Weights of its corners there: not negative, with sum 1.
    pub weights: Vec3,
}

/// What a hierarchy knows of charts.
#[derive(Clone, Debug)]
pub(crate) struct Charts {
    /// Vertices of the mesh; larger indices are of `extra`.
    own: u32,
    pub(crate) extra: Vec<SeamVertex>,
    /// Chart of each vertex in the hierarchy's order.
    chart: Vec<u32>,
    /// For the nodes with vertices of several charts, in ascending order of node and chart: what stands for the chart's vertices.
    first: Vec<u32>,
    entries: Vec<[u32; 2]>,
    /// For each node, how far its folding moves texture coordinates at most.
    drift: Vec<f32>,
}

impl VertexHierarchy {
    /// [`build`](Self::build) for a mesh with texture coordinates that stay usable on every cut.
    ///
    /// A chart is what hangs together by common vertices: vertices with two texture coordinates are two vertices. The indices of a [`Cut`] may then be those of [extra
    /// vertices](Self::seam_vertices), which follow the mesh's own; [`with_seam_vertices`](Self::with_seam_vertices) makes the buffers.
    ///
    /// # Accuracy
    /// No drawn triangle reaches over a seam. How far texture coordinates are from those of the mesh is known of every cut ([`Cut::texture_drift`]). Where a chart
    /// lies in a node like a sheet, that is at most the node's diameter times how much the chart is stretched.
    ///
    /// # Cost
    /// Each node with several charts looks at the triangles around all of its vertices.
    ///
    /// # Errors
    /// [`LodError::NoUvs`] for a mesh without texture coordinates, and as [`build`](Self::build).
    ///
    /// # References
    /// [Hilbert & Brunnett 2004, section 5]. Differs: the paper takes texture coordinates to be a function of position, which only some parametrisations are.
    pub fn build_textured(mesh: &TriangleMesh) -> Result<Self, LodError> {
        let uvs: Vec<DVec2> = mesh.uvs().ok_or(LodError::NoUvs)?.iter().map(|uv| uv.as_dvec2()).collect();
        let mut hierarchy = Self::build(mesh)?;
        hierarchy.charts = Some(Charts::new(mesh, &uvs, &hierarchy));
        Ok(hierarchy)
    }

    /// The vertices that follow the mesh's own in the indices of a cut; none unless it was [built with texture coordinates](Self::build_textured).
    pub fn seam_vertices(&self) -> &[SeamVertex] {
        self.charts.as_ref().map_or(&[], |c| &c.extra)
    }

    /// The mesh vertex in whose place a vertex of a cut's indices is: itself, or that of a seam vertex.
    ///
    /// # Panics
    /// For an index that no cut has.
    pub fn place_of(&self, vertex: u32) -> u32 {
        let Some(charts) = &self.charts else { return vertex };
        vertex.checked_sub(charts.own).map_or(vertex, |i| charts.extra[i as usize].place)
    }

    /// The mesh with the [extra vertices](Self::seam_vertices) at its end, and all their attributes: what the indices of a cut lead into.
    ///
    /// # Errors
    /// When an attribute mixed from others is out of range.
    ///
    /// # Panics
    /// When the mesh is not the hierarchy's.
    pub fn with_seam_vertices(&self, mesh: &TriangleMesh) -> Result<TriangleMesh, MeshError> {
        let extra = self.seam_vertices();
        let corners = |s: &SeamVertex| mesh.triangles()[s.triangle as usize].map(|v| v as usize);
        let mut positions = mesh.positions().to_vec();
        positions.extend(extra.iter().map(|s| mesh.positions()[s.place as usize]));
        let mut extended =
            TriangleMesh::new(positions, mesh.triangles().to_vec())?.with_origin(mesh.origin())?;
        if let Some(uvs) = mesh.uvs() {
            let mixed = extra.iter().map(|s| {
                let [a, b, c] = corners(s).map(|v| uvs[v]);
                a * s.weights.x + b * s.weights.y + c * s.weights.z
            });
            extended = extended.with_uvs(uvs.iter().copied().chain(mixed).collect())?;
        }
        if let Some(normals) = mesh.normals() {
            let mixed = extra.iter().map(|s| {
                let [a, b, c] = corners(s).map(|v| normals[v]);
                (a * s.weights.x + b * s.weights.y + c * s.weights.z).normalize_or(normals[s.place as usize])
            });
            extended = extended.with_normals(normals.iter().copied().chain(mixed).collect())?;
        }
        if let Some(colours) = mesh.colours() {
            let mixed = extra.iter().map(|s| {
                let of = corners(s).map(|v| colours[v].map(f32::from));
                std::array::from_fn(|i| {
                    (of[0][i] * s.weights.x + of[1][i] * s.weights.y + of[2][i] * s.weights.z).round() as u8
                })
            });
            extended = extended.with_colours(colours.iter().copied().chain(mixed).collect())?;
        }
        Ok(extended)
    }
}

impl Cut {
    /// How far the texture coordinates of a point on what is drawn are from those that it has on the mesh, at most: in units of the texture, 1 for its side.
    /// Zero for a hierarchy without texture coordinates.
    ///
    /// # Cost
    /// Looks at the nodes of the cut.
    ///
    /// # Panics
    /// When the cut belongs to another hierarchy.
    pub fn texture_drift(&self, hierarchy: &VertexHierarchy) -> ErrorBound {
        let mut most = 0.0f64;
        if let Some(charts) = &hierarchy.charts {
            let mut node = 0;
            while (node as usize) < hierarchy.nodes.len() {
                if self.is_unfolded(node) {
                    node += 1;
                } else {
                    most = most.max(charts.drift[node as usize].into());
                    node = hierarchy.nodes[node as usize].end;
                }
            }
        }
        ErrorBound::proven(most, Unit::Fraction)
    }
}

impl Charts {
    fn new(mesh: &TriangleMesh, uvs: &[DVec2], hierarchy: &VertexHierarchy) -> Self {
        let of_vertex = connected(mesh, hierarchy);
        let size = uvs.iter().map(|uv| uv.abs().max_element()).fold(0.0, f64::max);
        let chart: Vec<u32> = hierarchy.vertices.iter().map(|&v| of_vertex[v as usize]).collect();
        let nodes = hierarchy.nodes.len() as u32;
        let mut charts = Self {
            own: mesh.positions().len() as u32,
            extra: Vec::new(),
            chart,
            first: Vec::with_capacity(nodes as usize + 1),
            entries: Vec::new(),
            drift: Vec::with_capacity(nodes as usize),
        };
        let mut nearest: Vec<(u32, Nearest)> = Vec::new();
        for node in 0..nodes {
            charts.first.push(charts.entries.len() as u32);
            charts.of_node(mesh, hierarchy, node, &mut nearest);
            let drift = charts.drift_of(uvs, size, mesh, hierarchy, node);
            charts.drift.push(drift);
        }
        charts.first.push(charts.entries.len() as u32);
        charts.extra.shrink_to_fit();
        charts.entries.shrink_to_fit();
        charts
    }

    /// Finds what stands for each chart in a node.
    fn of_node(
        &mut self,
        mesh: &TriangleMesh,
        hierarchy: &VertexHierarchy,
        node: u32,
        nearest: &mut Vec<(u32, Nearest)>,
    ) {
        let range = hierarchy.vertices_of(node);
        let representative = hierarchy.nodes[node as usize].representative as usize;
        let own = self.chart[representative];
        nearest.clear();
        if self.chart[range.clone()].iter().all(|&c| c == own) {
            return;
        }
        let place = hierarchy.positions[representative].as_dvec3();
        for v in range {
            let chart = self.chart[v];
            if chart == own {
                continue;
            }
            let at = match nearest.binary_search_by_key(&chart, |n| n.0) {
                Ok(at) => at,
                Err(at) => {
                    nearest.insert(at, (chart, Nearest::NONE));
                    at
                }
            };
            nearest[at].1.look(mesh, hierarchy, v, place);
        }
        self.entries.push([own, hierarchy.vertices[representative]]);
        let place = hierarchy.vertices[representative];
        for (chart, found) in nearest.iter() {
            let stands = found.vertex.unwrap_or(self.own + self.extra.len() as u32);
            if found.vertex.is_none() {
                self.extra.push(SeamVertex { place, triangle: found.triangle, weights: found.weights(mesh) });
            }
            self.entries.push([*chart, stands]);
        }
        let first = self.first[node as usize] as usize;
        self.entries[first..].sort_unstable();
    }

    /// Farthest that folding a node moves texture coordinates.
    fn drift_of(
        &self,
        uvs: &[DVec2],
        size: f64,
        mesh: &TriangleMesh,
        hierarchy: &VertexHierarchy,
        node: u32,
    ) -> f32 {
        let representative = hierarchy.vertices[hierarchy.nodes[node as usize].representative as usize];
        let entries = &self.entries[self.first[node as usize] as usize..];
        let uv_of = |chart: u32| {
            let found = entries.binary_search_by_key(&chart, |e| e[0]);
            self.uv(uvs, mesh, found.map_or(representative, |i| entries[i][1]))
        };
        let mut last = (u32::MAX, DVec2::ZERO);
        let mut most = 0.0f64;
        for v in hierarchy.vertices_of(node) {
            if self.chart[v] != last.0 {
                last = (self.chart[v], uv_of(self.chart[v]));
            }
            most = most.max(uvs[hierarchy.vertices[v] as usize].distance(last.1));
        }
        // What is drawn has coordinates mixed in `f32`.
        rounding::f32_up(if most > 0.0 { most + 8.0 * f64::from(f32::EPSILON) * size } else { 0.0 })
    }

    fn uv(&self, uvs: &[DVec2], mesh: &TriangleMesh, vertex: u32) -> DVec2 {
        match vertex.checked_sub(self.own) {
            None => uvs[vertex as usize],
            Some(i) => {
                let s = &self.extra[i as usize];
                let [a, b, c] = mesh.triangles()[s.triangle as usize].map(|v| uvs[v as usize]);
                let w = s.weights.as_dvec3();
                a * w.x + b * w.y + c * w.z
            }
        }
    }

    /// Lets a node's vertices (`proxies`, those of `hierarchy.vertices_of(node)`) be stood for by what stands for their charts; false if one does for all.
    pub(crate) fn stand_in(&self, node: u32, first_vertex: usize, proxies: &mut [u32]) -> bool {
        let entries =
            &self.entries[self.first[node as usize] as usize..self.first[node as usize + 1] as usize];
        if entries.is_empty() {
            return false;
        }
        let charts = &self.chart[first_vertex..first_vertex + proxies.len()];
        let mut last = entries[0];
        for (proxy, &chart) in proxies.iter_mut().zip(charts) {
            if chart != last[0] {
                let at = entries.binary_search_by_key(&chart, |e| e[0]);
                last = entries[at.expect("each chart of a node has an entry")];
            }
            *proxy = last[1];
        }
        true
    }

    pub(crate) fn bytes(&self) -> usize {
        self.extra.capacity() * size_of::<SeamVertex>()
            + (self.chart.capacity() + self.first.capacity() + self.drift.capacity()) * size_of::<u32>()
            + self.entries.capacity() * size_of::<[u32; 2]>()
    }
}

/// The point of a chart nearest to a place, so far.
#[derive(Clone, Copy, Debug)]
struct Nearest {
    distance_sq: f64,
    point: DVec3,
    triangle: u32,
    /// The vertex, if it is one, and lies in the very place.
    vertex: Option<u32>,
}

impl Nearest {
    const NONE: Self =
        Self { distance_sq: f64::INFINITY, point: DVec3::ZERO, triangle: u32::MAX, vertex: None };

    /// Looks at the triangles around a vertex.
    fn look(&mut self, mesh: &TriangleMesh, hierarchy: &VertexHierarchy, v: usize, place: DVec3) {
        if self.vertex.is_some() {
            return;
        }
        if hierarchy.positions[v].as_dvec3() == place {
            self.vertex = Some(hierarchy.vertices[v]);
        }
        for &t in hierarchy.around(v) {
            let triangle = hierarchy.original[t as usize];
            let point = closest_on_triangle(mesh.corners(triangle as usize).map(|p| p.as_dvec3()), place);
            let distance_sq = point.distance_squared(place);
            if distance_sq < self.distance_sq || (distance_sq == self.distance_sq && triangle < self.triangle)
            {
                *self = Self { distance_sq, point, triangle, vertex: self.vertex };
            }
        }
    }

    /// Weights of the triangle's corners at the point.
    fn weights(&self, mesh: &TriangleMesh) -> Vec3 {
        let [a, b, c] = mesh.corners(self.triangle as usize).map(|p| p.as_dvec3());
        let (ab, ac, ap) = (b - a, c - a, self.point - a);
        let normal = ab.cross(ac);
        let area_sq = normal.length_squared();
        let inside = DVec2::new(ap.cross(ac).dot(normal), ab.cross(ap).dot(normal)) / area_sq;
        let (v, w) = if area_sq > 0.0 && inside.is_finite() {
            (inside.x.clamp(0.0, 1.0), inside.y.clamp(0.0, 1.0))
        } else {
            // A triangle without area: along its longest side from the first corner.
            let along = |side: DVec3| (ap.dot(side) / side.length_squared()).clamp(0.0, 1.0);
            match (ab == DVec3::ZERO && ac == DVec3::ZERO, ab.length_squared() >= ac.length_squared()) {
                (true, _) => (0.0, 0.0),
                (_, true) => (along(ab), 0.0),
                (_, false) => (0.0, along(ac)),
            }
        };
        let sum = (v + w).max(1.0);
        let (v, w) = ((v / sum) as f32, (w / sum) as f32);
        Vec3::new((1.0 - v - w).max(0.0), v, w)
    }
}

/// The chart of each vertex: what triangles connect, numbered by its lowest vertex.
fn connected(mesh: &TriangleMesh, hierarchy: &VertexHierarchy) -> Vec<u32> {
    let mut sets = DisjointSets::new(mesh.positions().len());
    for &t in &hierarchy.original {
        let [a, b, c] = mesh.triangles()[t as usize];
        sets.join(a, b);
        sets.join(a, c);
    }
    (0..mesh.positions().len() as u32).map(|v| sets.lowest(v)).collect()
}

#[cfg(test)]
mod tests;
