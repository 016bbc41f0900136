//! Collects coloured polygons into a mesh.

use crate::RasterError;
use farsight_geometry::TriangleMesh;
use glam::Vec3;

/// sRGB colour.
pub(crate) type Rgb = [u8; 3];

/// A mesh under construction: flat polygons with their own corners, and smooth patches.
#[derive(Default)]
pub(crate) struct Builder {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    colours: Vec<[u8; 4]>,
    triangles: Vec<[u32; 3]>,
}

impl Builder {
    pub(crate) fn vertex(&mut self, position: Vec3, normal: Vec3, [r, g, b]: Rgb) -> u32 {
        self.positions.push(position);
        self.normals.push(normal);
        self.colours.push([r, g, b, 255]);
        self.positions.len() as u32 - 1
    }

    pub(crate) fn vertices(&self) -> u32 {
        self.positions.len() as u32
    }

    pub(crate) fn triangle(&mut self, corners: [u32; 3]) {
        self.triangles.push(corners);
    }

    /// A flat convex polygon, counter-clockwise seen from its front.
    pub(crate) fn polygon(&mut self, corners: &[Vec3], colour: Rgb) {
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
        let first = self.positions.len() as u32;
        for &corner in corners {
            self.vertex(corner, normal, colour);
        }
        for i in 2..corners.len() as u32 {
            self.triangles.push([first, first + i - 1, first + i]);
        }
    }

    /// The parallelogram at `corner` with sides `u` and `v`; its front is on the side of `u × v`.
    pub(crate) fn parallelogram(&mut self, corner: Vec3, u: Vec3, v: Vec3, colour: Rgb) {
        self.polygon(&[corner, corner + u, corner + u + v, corner + v], colour);
    }

    /// The six sides of a parallelepiped with right-handed sides `u`, `v`, `w`.
    pub(crate) fn solid(&mut self, corner: Vec3, u: Vec3, v: Vec3, w: Vec3, colour: Rgb) {
        for (a, b, c) in [(u, v, w), (v, w, u), (w, u, v)] {
            self.parallelogram(corner, b, a, colour);
            self.parallelogram(corner + c, a, b, colour);
        }
    }

    /// A grid of (columns + 1) x (rows + 1) vertices joined by triangles; its front is where columns × rows points.
    pub(crate) fn patch(
        &mut self,
        columns: u32,
        rows: u32,
        mut vertex: impl FnMut(u32, u32) -> (Vec3, Vec3, Rgb),
    ) {
        let first = self.positions.len() as u32;
        for j in 0..=rows {
            for i in 0..=columns {
                let (position, normal, colour) = vertex(i, j);
                self.vertex(position, normal, colour);
            }
        }
        for j in 0..rows {
            for i in 0..columns {
                let a = first + j * (columns + 1) + i;
                let c = a + columns + 1;
                self.triangles.push([a, a + 1, c + 1]);
                self.triangles.push([a, c + 1, c]);
            }
        }
    }

    pub(crate) fn build(self) -> Result<TriangleMesh, RasterError> {
        Ok(TriangleMesh::new(self.positions, self.triangles)?
            .with_normals(self.normals)?
            .with_colours(self.colours)?)
    }
}

/// A colour made lighter or darker by a factor.
pub(crate) fn shaded(colour: Rgb, factor: f32) -> Rgb {
    colour.map(|c| (f32::from(c) * factor).clamp(0.0, 255.0) as u8)
}
