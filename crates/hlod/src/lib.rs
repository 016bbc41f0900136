//! Simplification of triangle soups with a proven two-sided error bound.

mod appearance;
mod certify;
mod claims;
mod complex;
mod contract;
mod cover;
mod facet;
mod fast;
mod flood;
mod frame;
mod original;
mod polygon;
mod quadric;
mod simplify;

pub use glam;
pub use simplify::{Simplified, SimplifyOptions, Tier, simplify};

/// Why something could not be simplified.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum HlodError {
    /// The tolerance is negative or not finite.
    #[error("a tolerance of {tolerance} is impossible; it must be finite and not negative")]
    Tolerance {
        /// The tolerance.
        tolerance: f64,
    },
    /// The tolerance is below what the coordinates can tell apart.
    #[error("a tolerance of {tolerance:e} is below the coordinates' resolution of {resolution:e}")]
    BelowResolution {
        /// The tolerance.
        tolerance: f64,
        /// The least one that makes sense for this mesh.
        resolution: f64,
    },
    /// The result is no valid mesh.
    #[error(transparent)]
    Mesh(#[from] farsight_geometry::MeshError),
}
