//! Shadow maps that put texels where the eye needs them, and the mathematics of penumbrae.
//!
//! | question | answer |
//! |---|---|
//! | what must a map cover, is one needed? | [`Focus::fit`], [`PointFocus::fit`] |
//! | which matrix? | [`Focus::map`] with a [`Warp`] |
//! | how large are its texels? | [`ShadowView::texel`], [`ShadowView::texel_at`], [`ShadowView::required_side`]; [`Spacing`] in closed form |
//! | how many cascades? | [`plan_cascades`], [`least_cascades`] |
//! | what if I have no camera, only its matrix? | [`camera_from_matrix`] |
//! | soft shadows, coarse casters | [`penumbra`] |
//!
//! A frame: fit, and draw nothing when the answer is a [`Skip`]; else ask for the map, handing over the previous one so that the warp moves steadily.
//! Matrices are built in `f64` relative to the eye and work the same a thousand kilometres from the origin.
//!
//! ```
//! use farsight_geometry::{Camera, DAabb, glam::{DVec3, dvec3}};
//! use farsight_shadow::{Focus, MapOptions, Scope, ShadowLight};
//!
//! let camera = Camera::look_at(dvec3(0.0, 2.0, 0.0), dvec3(30.0, 1.0, 0.0), DVec3::Y)?;
//! let ground = [DAabb::new(dvec3(-500.0, -1.0, -500.0), dvec3(500.0, 3.0, 500.0))];
//! let sun = ShadowLight::directional(dvec3(0.5, -0.7, 0.2).normalize());
//!
//! let mut focus = Focus::new(); // keep it: its buffers are reused every frame
//! if focus.fit(&sun, &Scope::new(&camera, 400.0, &ground, &ground, 2048))?.is_none() {
//!     let view = focus.map(&MapOptions::new(2048), None);
//!     // view.matrix() takes world coordinates minus view.origin to the map's clip space.
//!     assert!(view.gain() > 10.0);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod cascades;
mod error;
mod focus;
mod light;
mod matrix;
mod minimax;
pub mod penumbra;
mod point;
mod skip;
mod stable;
mod warp;

pub use cascades::{Cascade, CascadePlan, least_cascades, log_splits, plan_cascades};
pub use error::{Spacing, Texel};
pub use farsight_geometry;
pub use focus::{Focus, Scope, Skip};
pub use glam;
pub use light::{CubeFace, LightAxes, ShadowLight};
pub use matrix::camera_from_matrix;
pub use point::{PointFocus, PointLight};
pub use warp::{MapOptions, ShadowView, Warp};

use glam::DVec3;

/// Why no shadow map could be fitted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ShadowError {
    /// A direction is not of unit length, or a spot's `side` runs along its axis.
    #[error("direction {direction} is not a unit vector, or gives no frame")]
    Direction {
        /// The direction.
        direction: DVec3,
    },
    /// The eye or the light is not finite or too far out.
    #[error("position {position}: must be finite, coordinates at most 1e15")]
    Position {
        /// The position.
        position: DVec3,
    },
    /// A spot's opening is not between 0 and 89.9° on each side.
    #[error("a light's half opening with tangent {tangent}: must lie in (0, 600]")]
    Opening {
        /// Tangent of half the opening.
        tangent: f64,
    },
    /// A spot's near distance is not positive, or not before its range.
    #[error("light near {near} and range {range}: must satisfy 0 < near < range")]
    LightRange {
        /// Near distance.
        near: f64,
        /// Range.
        range: f64,
    },
    /// The shadow distance is not finite or not ahead of the near plane.
    #[error("shadow distance {far}: must be at most 1e15 and beyond the near distance {near}")]
    Far {
        /// The shadow distance.
        far: f64,
        /// The camera's near distance.
        near: f64,
    },
    /// A box that is not empty has a coordinate beyond 1e15, infinite or NaN.
    #[error("{what} {index} reaches beyond coordinates of 1e15")]
    Bounds {
        /// "receiver" or "caster".
        what: &'static str,
        /// Its index.
        index: usize,
    },
    /// The map has no texels.
    #[error("a shadow map needs at least one texel")]
    MapSide,
    /// A matrix is not that of a perspective camera.
    #[error("no camera has this matrix: {reason}")]
    Matrix {
        /// What is wrong with it.
        reason: &'static str,
    },
}

/// The README's example, tested.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
