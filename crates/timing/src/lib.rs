//! How long will it take to draw this, and what can be drawn in the time there is.
//!
//! ```
//! use farsight_timing::{Features, Heuristic, Millis, Model, Refit, RefitOptions, Residuals};
//!
//! // Costs from a calibration (or a guess); whole frames put them right.
//! let model = Model { heuristic: Heuristic::Sum, costs: [1e-5, 2e-6, 0.0, 0.0] };
//! let mut refit = Refit::new(model, Millis::ZERO, RefitOptions::default())?;
//! let mut residuals = Residuals::new(1000);
//! for frame in 0..200 {
//!     let drawn = Features { vertices: 3e5 + 1e3 * frame as f64, pixels: 2e6, ..Features::default() };
//!     let predicted = refit.predict(&drawn);
//!     let measured = Millis(1.0 + 1.5e-5 * drawn.vertices + 2e-6 * drawn.pixels); // from your timestamps
//!     residuals.record(predicted, measured);
//!     refit.observe(&drawn, measured)?;
//! }
//! let next = Features { vertices: 5e5, pixels: 2e6, ..Features::default() };
//! assert!((refit.predict(&next).0 - 12.5).abs() < 0.1);
//! // With 95 % confidence the frame takes no longer than this.
//! assert!(residuals.quantile(refit.predict(&next), 0.95).is_some());
//! # Ok::<(), farsight_timing::TimingError>(())
//! ```
//!
//! | question | answer |
//! |---|---|
//! | what does an object ask of the card | [`Features`], [`transformed_vertices`], [`projected_pixels`], [`sphere_pixels`] |
//! | what does it cost | [`Heuristic`], [`calibrate()`], [`best_model`]; by look-up: [`ObjectSamples`] |
//! | what does a view cell cost at most | [`ViewCellSamples`], [`view_cell_estimate`] |
//! | what will the next frame take | [`Refit`], and with which confidence: [`Residuals`] |
//! | which levels of detail fit | [`Budget`] |
//! | and if the prediction fails | [`Deadline`], [`Controller`] |
//!
//! Source: Wimmer 2007, chapter 2.

mod appearance;
mod branch;
mod budget;
mod calibrate;
mod controller;
mod features;
mod framework;
mod heuristics;
mod linear;
mod pixels;
mod quantiles;
mod refit;
mod sampling;
#[cfg(feature = "simulator")]
pub mod simulator;
mod vertex_cache;

pub use branch::{Deadline, Taken};
pub use budget::{Budget, Choice, Level, exact};
pub use calibrate::{Calibration, Collinear, Sample, best_model, calibrate};
pub use controller::{Controller, ControllerOptions};
pub use farsight_geometry::Millis;
pub use farsight_geometry::clip::Faces;
pub use features::{FEATURES, Features};
pub use framework::{FrameTime, Tasks, system_constant};
pub use glam;
pub use heuristics::{Heuristic, Model, TERMS};
pub use pixels::{projected_pixels, sphere_pixels};
pub use quantiles::Residuals;
pub use refit::{Observed, Refit, RefitOptions};
pub use sampling::{ObjectSamples, SampleOptions, ViewCellSamples, view_cell_estimate};
pub use vertex_cache::transformed_vertices;

/// Why something could not be estimated.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TimingError {
    /// An index list names a vertex that does not exist.
    #[error("index {position} names vertex {index}, but there are {vertices} vertices")]
    Index {
        /// Place in the list.
        position: usize,
        /// The index.
        index: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// A feature is negative, NaN or infinite.
    #[error("{name} of an object cannot be {value}")]
    Feature {
        /// The feature.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// A measured time is negative, NaN or infinite.
    #[error("a drawing cannot take {time} ms")]
    Time {
        /// The time in milliseconds.
        time: f64,
    },
    /// Fewer samples than unknowns.
    #[error("{count} samples for {needed} unknowns")]
    Samples {
        /// Samples given.
        count: usize,
        /// Samples needed at least.
        needed: usize,
    },
    /// The samples do not tell a term from the others.
    #[error("{term} cannot be told apart from the other terms (independent part: {independence:.1e})")]
    Collinear {
        /// The term.
        term: &'static str,
        /// Share of it that the other terms do not explain.
        independence: f64,
    },
    /// The maximum form cannot be refitted on sums over objects.
    #[error("only heuristics that add up can be refitted on whole frames")]
    NotLinear,
    /// A cost is negative, or a cost or benefit is NaN or beyond 1e100.
    #[error("level {level} of object {object}: a cost must lie in 0..=1e100, a benefit in -1e100..=1e100")]
    Level {
        /// The object.
        object: usize,
        /// Its level.
        level: usize,
    },
    /// An object has no level of detail.
    #[error("object {object} has no level")]
    NoLevel {
        /// The object.
        object: usize,
    },
}

/// The README's example, so that it stays true.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
