//! Lines of sight, and the proof that they are.

use glam::DVec3;

/// A viewpoint and a direction in which a triangle was seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sight {
    /// The triangle.
    pub triangle: u32,
    /// The viewpoint.
    pub origin: DVec3,
    /// The direction, of any length.
    pub direction: DVec3,
}

/// Why a member is in a visible set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Witness {
    /// This ray reaches one of its triangles before anything else that hides.
    Ray(Sight),
    /// This triangle of it touches the view cell.
    Touches(u32),
}
