//! Simulates only the effects that a scene calls for: from plain numbers of scene and view to a plan, with its reasons.
//!
//! ```
//! use farsight_plan::*;
//!
//! // A thousand triangles far away, with a coarser form that is off by a tenth of a unit.
//! let details = [Detail { form: Form::Mesh, error: 0.1, kind: Kind::Proven, elements: 100.0 }];
//! let tree = ObjectSummary { draws: 1.0, vertices: 600.0, triangles: 1000.0, details: &details, impostor: false };
//! let sun = LightSummary { most_side: 4096, most_cascades: 1, most_taps: 36 };
//! let scene = SceneSummary { objects: &[tree], lights: &[sun], clouds: &[] };
//!
//! let seen = ObjectView { in_view: true, size_px: 40.0, pixels: 800.0, px_per_unit: 4.0, impostor_frames: 0.0 };
//! // Nothing throws a shadow into this view.
//! let texels = TexelSpread { uniform: 9000.0, warped: 900.0, cascades: [f64::INFINITY; 3] };
//! let light = LightView { receiver_pixels: 800.0, caster_triangles: 0.0, caster_draws: 0.0, contribution: 0.8, texels,
//!     penumbra_px: 0.0, unchanged: false };
//! let view = ViewSummary { pixels: 1e6, outputs: Outputs::PICTURE, objects: &[seen], lights: &[light], clouds: &[],
//!     cell: None, jumped: false };
//!
//! let mut planner = Planner::new(); // keep it: it remembers, so that decisions stay
//! let plan = planner.plan(&scene, &view, &Budget::default(), &Costs::default())?;
//! let shadow = plan.decision(Effect::Shadow { light: 0 }).unwrap();
//! assert_eq!((shadow.choice, shadow.because.class), (Choice::Nothing, Class::Void));
//! // 0.4 pixels off are within half a pixel, so the coarser form will do.
//! assert_eq!(plan.objects()[0].choice, Choice::Detail { detail: 0, form: Form::Mesh });
//! assert_eq!(plan.passes, [Pass::Objects]);
//! println!("{plan}");
//! # Ok::<(), PlanError>(())
//! ```
//!
//! Decisions come in classes: what is *void* contributes nothing and changes no pixel; what is *dominated* is replaced by something cheaper within the
//! [`Tolerances`]; what is *budgeted* exceeds them, as little as the [`Budget`] allows. A pass that nobody reads does not appear. The planner
//! draws nothing and knows no engine: numbers go in, [`Choice`]s come out. Features bring numbers from other Farsight crates.

mod adapters;
mod candidate;
mod choice;
mod ladder;
mod pass;
mod plan;
mod planner;
mod rules;
mod state;
mod summary;
mod view;
mod work;

#[cfg(test)]
mod tests;

pub use choice::{Choice, Class, Decision, Effect, Layout, Reason, Rejected, Rule};
pub use farsight_geometry;
pub use farsight_geometry::Millis;
pub use farsight_geometry::accuracy::{ErrorBound, Kind};
pub use pass::{Pass, Resource, is_output};
pub use plan::Plan;
pub use planner::{Planner, plan};
pub use state::PlanState;
pub use summary::{
    Budget, CellView, CloudSummary, CloudView, Detail, Form, LightSummary, LightView, ObjectSummary,
    ObjectView, Outputs, SceneSummary, TexelSpread, Tolerances, ViewSummary,
};
pub use work::{CostModel, Costs, Work};

/// Why no plan could be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PlanError {
    /// A number is negative, NaN or infinite.
    #[error("{what} of number {place} cannot be {value}")]
    Number {
        /// Which number.
        what: &'static str,
        /// Its object, light or cloud.
        place: usize,
        /// Its value.
        value: f64,
    },
    /// Scene and view do not have as many of something.
    #[error("the scene has {scene} {what}, the view {view}")]
    Mismatch {
        /// Of what.
        what: &'static str,
        /// In the scene.
        scene: usize,
        /// In the view.
        view: usize,
    },
    /// The forms of an object are not in order.
    #[error("object {object}: errors of its details must not fall, their elements not rise")]
    Details {
        /// The object.
        object: usize,
    },
}

/// The README's example, so that it stays true.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
