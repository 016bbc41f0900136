//! Shadow maps that put texels where the eye needs them.
//!
//! ```
//! use farsight_geometry::{Camera, DAabb, glam::{DVec3, dvec3}};
//! use farsight_shadow::{Focus, MapOptions};
//!
//! let camera = Camera::look_at(dvec3(0.0, 2.0, 0.0), dvec3(30.0, 1.0, 0.0), DVec3::Y)?;
//! let ground = DAabb::new(dvec3(-500.0, -1.0, -500.0), dvec3(500.0, 3.0, 500.0));
//! let sun = dvec3(0.5, -0.7, 0.2).normalize();
//!
//! let mut focus = Focus::new(); // keep it: its buffers are reused every frame
//! if focus.directional(&camera, 400.0, sun, &[ground], &[ground], 2048)?.is_none() {
//!     let view = focus.map(&MapOptions::new(2048), false);
//!     // view.matrix() takes world coordinates minus view.origin to the map's clip space.
//!     assert!(view.gain() > 10.0);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod focus;
mod warp;

pub use farsight_geometry;
pub use focus::{Focus, LightAxes, Skip};
pub use glam;
pub use warp::{MapOptions, ShadowView, Warp};

use glam::DVec3;

/// Why no shadow map could be fitted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ShadowError {
    /// The light's direction is not of unit length.
    #[error("light direction {direction} is not a unit vector")]
    Direction {
        /// The direction.
        direction: DVec3,
    },
    /// The shadow distance is not finite or not ahead of the near plane.
    #[error("shadow distance {far}: must be finite and beyond the near distance {near}")]
    Far {
        /// The shadow distance.
        far: f64,
        /// The camera's near distance.
        near: f64,
    },
    /// The map has no texels.
    #[error("a shadow map needs at least one texel")]
    MapSide,
}
