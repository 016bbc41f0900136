//! Validated triangle soups.
//!
//! A [`TriangleMesh`] is checked once, when it is built. After that indices are in range and no coordinate is
//! NaN, infinite or beyond [`MAX_COORDINATE`], so no algorithm has to ask again. Nothing is assumed of topology.

mod report;
mod sets;
mod weld;

pub use report::MeshReport;
pub use sets::DisjointSets;
pub use weld::{Welded, weld_points};

use crate::bounds::{Aabb, DAabb};
use glam::{DVec3, Vec2, Vec3};

/// Largest absolute value of a local coordinate. Squared distances stay finite in `f32` up to here.
pub const MAX_COORDINATE: f32 = 1e18;

/// A triangle soup: an `f64` origin and `f32` positions relative to it, with optional attributes per vertex.
///
/// ```
/// use farsight_geometry::{TriangleMesh, glam::Vec3};
///
/// // Data of another maths library comes in through a cast.
/// let raw: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
/// let positions: &[Vec3] = bytemuck::cast_slice(&raw);
/// let mesh = TriangleMesh::from_slices(positions, &[0, 1, 2])?;
/// assert_eq!(mesh.area(), 0.5);
///
/// let wrong = TriangleMesh::from_slices(positions, &[0, 1, 3]);
/// assert_eq!(wrong.unwrap_err().to_string(), "triangle 0 uses vertex 3, but there are 3 vertices");
/// # Ok::<(), farsight_geometry::MeshError>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriangleMesh {
    origin: DVec3,
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    normals: Option<Vec<Vec3>>,
    uvs: Option<Vec<Vec2>>,
    colours: Option<Vec<[u8; 4]>>,
    /// Around the corners of all triangles.
    bounds: Aabb,
}

/// Why a mesh was refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// An index points past the last vertex.
    #[error("triangle {triangle} uses vertex {index}, but there are {vertices} vertices")]
    IndexOutOfRange {
        /// The triangle.
        triangle: usize,
        /// The index that it uses.
        index: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// The flat index list does not consist of whole triangles.
    #[error("{count} indices are not a multiple of three")]
    IndexCount {
        /// Number of indices.
        count: usize,
    },
    /// A position is NaN, infinite or beyond [`MAX_COORDINATE`].
    #[error(
        "vertex {vertex} is at {position}; coordinates must be finite and at most {MAX_COORDINATE:e} from the origin"
    )]
    Position {
        /// The vertex.
        vertex: usize,
        /// Its position.
        position: DVec3,
    },
    /// The origin is NaN or infinite.
    #[error("the origin {origin} is not finite")]
    Origin {
        /// The origin.
        origin: DVec3,
    },
    /// An attribute has another length than the positions.
    #[error("{count} {attribute} for {vertices} vertices")]
    AttributeCount {
        /// "normals", "uvs" or "colours".
        attribute: &'static str,
        /// Number of values.
        count: usize,
        /// Number of vertices.
        vertices: usize,
    },
    /// An attribute value is NaN or infinite.
    #[error("the {attribute} of vertex {vertex} are not finite")]
    Attribute {
        /// "normals" or "uvs".
        attribute: &'static str,
        /// The vertex.
        vertex: usize,
    },
    /// More vertices or triangles than 32-bit indices can name.
    #[error("{count} {what} are more than 32-bit indices can name")]
    TooMany {
        /// "vertices" or "triangles".
        what: &'static str,
        /// How many.
        count: usize,
    },
}

impl TriangleMesh {
    /// Takes positions and triangles, checking both.
    ///
    /// # Errors
    /// Names the first bad vertex or triangle.
    pub fn new(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        for (what, count) in [("vertices", positions.len()), ("triangles", triangles.len())] {
            if u32::try_from(count).is_err() {
                return Err(MeshError::TooMany { what, count });
            }
        }
        let in_range = |p: &Vec3| p.abs().cmple(Vec3::splat(MAX_COORDINATE)).all();
        if let Some(vertex) = positions.iter().position(|p| !in_range(p)) {
            return Err(MeshError::Position { vertex, position: positions[vertex].as_dvec3() });
        }
        let vertices = positions.len();
        for (triangle, corners) in triangles.iter().enumerate() {
            if let Some(&index) = corners.iter().find(|&&i| i as usize >= vertices) {
                return Err(MeshError::IndexOutOfRange { triangle, index, vertices });
            }
        }
        Ok(Self::of_valid(positions, triangles))
    }

    /// Takes what was checked.
    fn of_valid(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Self {
        let mut mesh = Self { positions, triangles, ..Self::default() };
        mesh.bounds = Aabb::from_points(mesh.corner_iter().flatten());
        mesh
    }

    /// Copies positions and a flat index list, three indices a triangle.
    ///
    /// # Errors
    /// As [`new`](Self::new), and when the list does not consist of whole triangles.
    pub fn from_slices(positions: &[Vec3], indices: &[u32]) -> Result<Self, MeshError> {
        let (triangles, rest) = indices.as_chunks::<3>();
        if !rest.is_empty() {
            return Err(MeshError::IndexCount { count: indices.len() });
        }
        Self::new(positions.to_vec(), triangles.to_vec())
    }

    /// Takes world positions. Far from the world's origin, the origin becomes the centre of their box, so that little
    /// precision is lost; near it, where that gains nothing, it stays zero, so that `f32` positions stay as they are.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn from_world(positions: &[DVec3], triangles: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        if let Some(vertex) = positions.iter().position(|p| !p.is_finite()) {
            return Err(MeshError::Position { vertex, position: positions[vertex] });
        }
        let bounds = DAabb::from_points(positions.iter().copied());
        // Within a few diagonals of the origin an offset would save less than three bits and cost rounding.
        let near = bounds.is_empty() || bounds.center().abs().max_element() <= 4.0 * bounds.diagonal();
        let origin = if near { DVec3::ZERO } else { bounds.center().as_vec3().as_dvec3() };
        if !origin.is_finite() {
            return Err(MeshError::Origin { origin });
        }
        let local = positions.iter().map(|&p| (p - origin).as_vec3()).collect();
        Ok(Self { origin, ..Self::new(local, triangles)? })
    }

    /// The mesh moved: the same local positions, now relative to `origin`.
    ///
    /// # Errors
    /// [`MeshError::Origin`] when it is not finite.
    pub fn with_origin(self, origin: DVec3) -> Result<Self, MeshError> {
        if !origin.is_finite() {
            return Err(MeshError::Origin { origin });
        }
        Ok(Self { origin, ..self })
    }

    /// Adds a normal per vertex (any length; zero means unknown).
    ///
    /// # Errors
    /// When the count differs from the positions' or a value is not finite.
    pub fn with_normals(self, normals: Vec<Vec3>) -> Result<Self, MeshError> {
        self.check("normals", normals.len(), normals.iter().position(|n| !n.is_finite()))?;
        Ok(Self { normals: Some(normals), ..self })
    }

    /// Adds a texture coordinate per vertex.
    ///
    /// # Errors
    /// When the count differs from the positions' or a value is not finite.
    pub fn with_uvs(self, uvs: Vec<Vec2>) -> Result<Self, MeshError> {
        self.check("uvs", uvs.len(), uvs.iter().position(|uv| !uv.is_finite()))?;
        Ok(Self { uvs: Some(uvs), ..self })
    }

    /// Adds a colour per vertex: sRGB-encoded red, green, blue and linear alpha.
    ///
    /// # Errors
    /// When the count differs from the positions'.
    pub fn with_colours(self, colours: Vec<[u8; 4]>) -> Result<Self, MeshError> {
        self.check("colours", colours.len(), None)?;
        Ok(Self { colours: Some(colours), ..self })
    }

    fn check(&self, attribute: &'static str, count: usize, bad: Option<usize>) -> Result<(), MeshError> {
        let vertices = self.positions.len();
        if count != vertices {
            return Err(MeshError::AttributeCount { attribute, count, vertices });
        }
        bad.map_or(Ok(()), |vertex| Err(MeshError::Attribute { attribute, vertex }))
    }

    /// World position of the local origin.
    #[inline]
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// Positions relative to [`origin`](Self::origin).
    #[inline]
    pub fn positions(&self) -> &[Vec3] {
        &self.positions
    }

    /// Vertex indices of each triangle.
    #[inline]
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Normals, if there are any.
    pub fn normals(&self) -> Option<&[Vec3]> {
        self.normals.as_deref()
    }

    /// Texture coordinates, if there are any.
    pub fn uvs(&self) -> Option<&[Vec2]> {
        self.uvs.as_deref()
    }

    /// Colours, if there are any.
    pub fn colours(&self) -> Option<&[[u8; 4]]> {
        self.colours.as_deref()
    }

    /// Whether there is no triangle.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// Local corners of a triangle.
    ///
    /// # Panics
    /// When there is no such triangle.
    #[inline]
    pub fn corners(&self, triangle: usize) -> [Vec3; 3] {
        self.triangles[triangle].map(|i| self.positions[i as usize])
    }

    /// Local corners of all triangles in order.
    pub fn corner_iter(&self) -> impl ExactSizeIterator<Item = [Vec3; 3]> + '_ {
        self.triangles.iter().map(|t| t.map(|i| self.positions[i as usize]))
    }

    /// Local box around the vertices that triangles use.
    #[inline]
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// World box around the vertices that triangles use.
    pub fn world_bounds(&self) -> DAabb {
        self.bounds().to_world(self.origin)
    }

    /// Total area, summed in `f64`.
    pub fn area(&self) -> f64 {
        self.corner_iter().map(triangle_area).sum()
    }

    /// Bytes that the arrays hold.
    pub fn bytes(&self) -> u64 {
        let per_vertex = 12
            + if self.normals.is_some() { 12 } else { 0 }
            + if self.uvs.is_some() { 8 } else { 0 }
            + if self.colours.is_some() { 4 } else { 0 };
        (self.positions.len() * per_vertex + self.triangles.len() * 12) as u64
    }

    /// Counts defects (degenerate and doubled triangles, border and non-manifold edges, ...) and connected parts.
    ///
    /// # Cost
    /// O(n log n) time; about 60 bytes a triangle while it runs.
    pub fn report(&self) -> MeshReport {
        report::report(self)
    }

    /// Merges vertices with exactly equal positions. Attributes are dropped; the map leads back to them.
    pub fn welded(&self) -> Welded {
        weld::welded(self)
    }
}

/// Area of a triangle, computed in `f64`.
pub fn triangle_area(corners: [Vec3; 3]) -> f64 {
    let [a, b, c] = corners.map(|p| p.as_dvec3());
    0.5 * (b - a).cross(c - a).length()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square() -> TriangleMesh {
        let p = [(0., 0.), (1., 0.), (1., 1.), (0., 1.)].map(|(x, y)| Vec3::new(x, y, 0.0));
        TriangleMesh::from_slices(&p, &[0, 1, 2, 0, 2, 3]).unwrap()
    }

    #[test]
    fn bad_input_is_named() {
        let p = vec![Vec3::ZERO, Vec3::X, Vec3::new(0.0, f32::NAN, 0.0)];
        assert!(matches!(TriangleMesh::new(p, vec![]), Err(MeshError::Position { vertex: 2, .. })));
        let far = vec![Vec3::ZERO, Vec3::splat(1.1e18)];
        assert!(matches!(TriangleMesh::new(far, vec![]), Err(MeshError::Position { vertex: 1, .. })));
        assert_eq!(TriangleMesh::from_slices(&[], &[0]), Err(MeshError::IndexCount { count: 1 }));
        assert!(matches!(square().with_normals(vec![Vec3::Z]), Err(MeshError::AttributeCount { .. })));
        let uvs = vec![Vec2::ZERO, Vec2::ZERO, Vec2::INFINITY, Vec2::ZERO];
        assert!(matches!(square().with_uvs(uvs), Err(MeshError::Attribute { vertex: 2, .. })));
        assert!(square().with_origin(DVec3::NAN).is_err());
        assert!(TriangleMesh::from_world(&[DVec3::NAN], vec![]).is_err());
        assert!(TriangleMesh::from_world(&[DVec3::ZERO, DVec3::splat(1e300)], vec![]).is_err());
    }

    #[test]
    fn unused_vertices_do_not_count_in_the_bounds() {
        let mesh =
            TriangleMesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::splat(9.0)], vec![[0, 1, 2]]).unwrap();
        assert_eq!(mesh.bounds().max, Vec3::new(1.0, 1.0, 0.0));
        assert!(TriangleMesh::default().bounds().is_empty());
    }

    #[test]
    fn world_positions_keep_millimetres_at_utm_coordinates() {
        let utm = DVec3::new(480_000.001, 5_400_000.002, 120.003);
        let p = [utm, utm + DVec3::X, utm + DVec3::Y];
        let mesh = TriangleMesh::from_world(&p, vec![[0, 1, 2]]).unwrap();
        for (local, world) in mesh.positions().iter().zip(p) {
            assert!((mesh.origin() + local.as_dvec3()).distance(world) < 1e-6);
        }
    }
}
