//! View-dependent level of detail for any triangle mesh, on the processor, with a displacement that is proven.
//!
//! A [`VertexHierarchy`] is built once per mesh: a tree whose leaves are the mesh's vertices and whose inner nodes are clusters of
//! them. A [`Cut`] is one instance's way through it: folded nodes draw all their vertices at one place, so triangles with two corners in one
//! vanish. Only the index buffer changes; vertices stay where they are.
//!
//! | question | answer |
//! |---|---|
//! | what may move how far? | [`Tolerance`], in shares of the distance or in pixels |
//! | which triangles are drawn? | [`Cut::update`], [`Cut::indices`], [`Cut::changed`] |
//! | the same for a smoothly moving eye, at a fraction of the tests | [`Cut::update_kinetic`] |
//! | the best with so many triangles, and how good that is | [`Cut::update_budget`] |
//!
//! The criterion knows the eye's position and not where it looks, so a cut stays right when the camera turns and can serve as a cached
//! approximation or as the source of an impostor.

mod build;
mod cut;
mod hierarchy;
mod kinetic;
mod observer;
#[cfg(test)]
mod tests;
mod wheel;

pub use cut::{Cut, UpdateStats};
pub use farsight_geometry;
pub use glam;
pub use hierarchy::VertexHierarchy;
pub use observer::{Observer, Tolerance};

/// Why a hierarchy, an observer or a tolerance was refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LodError {
    /// No triangle of the mesh has three different vertices.
    #[error("the mesh has no triangle with three different vertices")]
    NoTriangle,
    /// Tolerances must satisfy 0 < silhouette ≤ tau ≤ back, all finite, and the hysteresis lie in [0, 1).
    #[error("{tolerance:?}: 0 < silhouette <= tau <= back must hold, and 0 <= hysteresis < 1")]
    Tolerance {
        /// What was asked for.
        tolerance: Tolerance,
    },
    /// A parallel camera's pixels have no tolerance that grows with distance.
    #[error("a tolerance in pixels that grows with distance needs a perspective camera")]
    Parallel,
    /// The eye or the placement is not finite, or flattens the object.
    #[error("the eye or the object's placement is not finite, or the placement flattens the object")]
    Placement,
}

/// The README's example, so that it stays true.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
