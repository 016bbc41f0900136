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
//! | may colour and normal maps be read on what is drawn? | [`VertexHierarchy::build_textured`], [`Cut::texture_drift`] |
//! | where is a picture of it, and how wrong from here? | [`ImpostorView`], [`ImpostorView::parallax`], [`is_separable`] |
//! | does a picture pay? | [`decide()`] |
//! | what was made before that serves again? | [`Cache`] |
//! | all of that, object by object and frame by frame | [`Approximations`] |
//! | shapes that a script switches or a user edits | [`Switch`], [`Editable`] |
//!
//! The criterion knows the eye's position and not where it looks, so a cut stays right when the camera turns and can serve as a cached
//! approximation or as the source of an impostor.

mod angle;
mod approximate;
mod approximation;
mod build;
mod cache;
mod charts;
mod cut;
mod decide;
mod dynamic;
mod hierarchy;
mod impostor;
mod kinetic;
mod observer;
mod placement;
mod separable;
#[cfg(test)]
mod tests;
mod track;
mod wheel;

pub use angle::{corner_angle, view_angle};
pub use approximate::{ApproximationError, Approximations, Engine, Shown, Subject, Work};
pub use approximation::{Approximation, ApproximationOptions, ParallaxTest};
pub use cache::{Cache, CacheStats, Inserted, Key, LightKey};
pub use charts::SeamVertex;
pub use cut::{Cut, UpdateStats};
pub use decide::{Choice, Costs, Decision, DecisionOptions, Forecast, Kind, Reason, decide, frames_until};
pub use dynamic::{Editable, Switch, Version};
pub use farsight_geometry;
pub use glam;
pub use hierarchy::VertexHierarchy;
pub use impostor::{ImpostorOptions, ImpostorRenderer, ImpostorView};
pub use observer::{Observer, Tolerance};
pub use placement::Placement;
pub use separable::is_separable;

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
    /// Texture coordinates were asked for, and the mesh has none.
    #[error("the mesh has no texture coordinates")]
    NoUvs,
    /// An attribute mixed for a seam vertex is out of range.
    #[error("attributes mixed at a seam are out of range")]
    Attributes,
    /// The thread that built a hierarchy came to an unexpected end.
    #[error("the thread that built the hierarchy has panicked")]
    Thread,
    /// A parallel camera's pixels have no tolerance that grows with distance.
    #[error("a tolerance in pixels that grows with distance needs a perspective camera")]
    Parallel,
    /// The eye or the placement is not finite, or flattens the object; or there is nothing to place.
    #[error("the eye or the object's placement is not finite, or the placement flattens the object")]
    Placement,
    /// Some of the object is beside or behind the eye, so no picture holds all of it.
    #[error("the object is too near for an impostor")]
    TooNear,
    /// A picture would have a longer side than allowed.
    #[error("an impostor of {side} texels exceeds the limit of {most}")]
    Texture {
        /// Its longer side.
        side: f64,
        /// The limit.
        most: u32,
    },
    /// An option is out of its range.
    #[error("{option} cannot be {value}; allowed is {range}")]
    Option {
        /// Its name.
        option: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        range: &'static str,
    },
}

/// The README's example, so that it stays true.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
