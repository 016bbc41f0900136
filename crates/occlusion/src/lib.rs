//! Occlusion culling that drops into any engine: coherent hierarchical culling as a state machine, and a software depth
//! buffer to answer its queries.
//!
//! | question | answer |
//! |---|---|
//! | what to draw, what to query | [`Culler`] walks a [`Hierarchy`] for a [`View`] and hands out [`Command`]s |
//! | exact, or never waiting? | [`Policy`], and everything else that can be chosen in [`Options`] |
//! | is this box hidden, without a graphics card? | [`DepthBuffer`] |
//! | how do I connect it to my graphics interface? | [`adapters`] |
//! | what did it take? | [`FrameStats`] |

pub mod adapters;
mod adaptive;
mod depth_buffer;
mod hierarchy;
mod policy;
mod state;
mod stats;
mod traversal;
mod view;

pub use depth_buffer::{
    Coverage, DepthBuffer, DepthBufferError, DepthBufferStats, Faces, MAX_SIDE, Occluders, Projected,
    ScreenBox,
};
pub use farsight_geometry::bvh::NodeId;
pub use farsight_geometry::ray::SimdLevel;
pub use glam;
pub use hierarchy::{Grouped, Hierarchy};
pub use policy::{
    Adaptive, Algorithm, Backend, Options, OptionsError, Order, Policy, Reentry, Schedule, Unknown,
};
pub use stats::FrameStats;
pub use traversal::{Answer, Classification, Command, Culler, Proxy, QueryId};
pub use view::View;

#[doc = include_str!("../README.md")]
#[cfg(doctest)]
struct Readme;
