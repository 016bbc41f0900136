//! What is known of an object before it is drawn.

use crate::{Faces, TimingError, projected_pixels, transformed_vertices};
use farsight_geometry::{Camera, TriangleMesh};
use glam::DAffine3;
use std::ops::{Add, AddAssign};

/// Number of features.
pub const FEATURES: usize = 6;

/// What an object at a level of detail asks of the graphics card from a view. Sums describe whole frames.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Features {
    /// Triangles.
    pub triangles: f64,
    /// Vertices really transformed: those that miss the vertex cache.
    pub vertices: f64,
    /// Pixels covered, hidden ones included.
    pub pixels: f64,
    /// Draw calls.
    pub draws: f64,
    /// Changes of state between draws.
    pub state_changes: f64,
    /// Bytes to bring to the card.
    pub upload_bytes: f64,
}

impl Features {
    /// Names, in the order of [`to_array`](Self::to_array).
    pub const NAMES: [&str; FEATURES] =
        ["triangles", "vertices", "pixels", "draws", "state changes", "upload bytes"];

    /// A mesh drawn by one call, as far as it is the same from everywhere: its triangles, and its vertices through a cache of `cache_size`.
    ///
    /// # Cost
    /// Linear in the indices; keep the result and add the pixels of each view.
    ///
    /// # Errors
    /// None: the indices of a [`TriangleMesh`] always lead somewhere.
    pub fn of_mesh(mesh: &TriangleMesh, cache_size: u32) -> Result<Self, TimingError> {
        let indices = mesh.triangles().as_flattened();
        let vertices = transformed_vertices(indices, mesh.positions().len(), cache_size)?;
        Ok(Self {
            triangles: mesh.triangles().len() as f64,
            vertices: vertices as f64,
            draws: if mesh.is_empty() { 0.0 } else { 1.0 },
            ..Self::default()
        })
    }

    /// The same with other pixels, such as [`sphere_pixels`](crate::sphere_pixels).
    #[must_use]
    pub fn with_pixels(self, pixels: f64) -> Self {
        Self { pixels, ..self }
    }

    /// The same from a view: exact pixels of the mesh it was made of.
    #[must_use]
    pub fn seen(
        self,
        mesh: &TriangleMesh,
        world_from_mesh: &DAffine3,
        camera: &Camera,
        faces: Faces,
    ) -> Self {
        self.with_pixels(projected_pixels(mesh, world_from_mesh, camera, faces))
    }

    /// All features.
    pub fn to_array(&self) -> [f64; FEATURES] {
        [self.triangles, self.vertices, self.pixels, self.draws, self.state_changes, self.upload_bytes]
    }

    /// Refuses what no drawing could have.
    ///
    /// # Errors
    /// [`TimingError::Feature`] names the first that is negative, NaN or infinite.
    pub fn checked(self) -> Result<Self, TimingError> {
        let bad = self.to_array().iter().position(|v| !(v.is_finite() && *v >= 0.0));
        match bad {
            Some(i) => Err(TimingError::Feature { name: Self::NAMES[i], value: self.to_array()[i] }),
            None => Ok(self),
        }
    }
}

impl Add for Features {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self {
            triangles: self.triangles + o.triangles,
            vertices: self.vertices + o.vertices,
            pixels: self.pixels + o.pixels,
            draws: self.draws + o.draws,
            state_changes: self.state_changes + o.state_changes,
            upload_bytes: self.upload_bytes + o.upload_bytes,
        }
    }
}

impl AddAssign for Features {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn impossible_features_are_named() {
        let bad = Features { pixels: f64::NAN, ..Features::default() };
        assert_eq!(bad.checked().unwrap_err().to_string(), "pixels of an object cannot be NaN");
        assert!(Features { draws: -1.0, ..Features::default() }.checked().is_err());
        assert!(Features::default().checked().is_ok());
    }
}
