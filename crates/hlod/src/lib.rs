//! Levels of detail that know how far they are off: [`simplify()`] for a mesh, and hierarchies on disk for surfaces of any size.
//!
//! | question | answer |
//! |---|---|
//! | how few triangles stand for a mesh within a distance | [`simplify()`], [`Simplified`] |
//! | are two given surfaces within a distance | [`certify()`], [`Certification`] |
//! | how does a surface of any size get into levels of detail | [`build()`], in batches of triangles |
//! | what is in such a file | [`Store`], [`Tree`], [`NodeMesh`] |
//! | which nodes does a view need, and how wrong is it | [`Selector`], [`Selection`] |
//! | which cast shadows into it | [`select_casters`] |
//! | how are they at hand when they are needed | [`Stream`], [`prefetch()`] |
//! | what about triangles smaller than a pixel | [`Splats`] |
//!
//! ```
//! use farsight_geometry::hard_cases::bumpy_ball;
//! use farsight_hlod::{SimplifyOptions, simplify};
//!
//! let ball = bumpy_ball(30); // 10,800 triangles, radius about 1
//! let simple = simplify(&ball, 0.01, &SimplifyOptions::default())?;
//! assert!(simple.mesh.triangles().len() < 1500);
//! // No point of either surface is farther from the other: proven, rounding included.
//! assert!(simple.geometric.value <= 0.01);
//! # Ok::<(), farsight_hlod::HlodError>(())
//! ```
//!
//! Two certificates stand behind the bound, each for one direction. *Backward*: every point of a new triangle has a point of
//! the original within the tolerance, found by a flood over the original triangles below it. *Forward*: every original triangle is cut into
//! convex pieces, each within the tolerance of one new triangle. Both are checked for what a contraction changes, when it
//! is made, and for nothing else: distances are to the original, not added up from step to step.
//!
//! The work is done in three phases: quick contractions by quadrics, without any certainty; certification of the whole, taking back the
//! contractions that fail; then contractions that are certified one by one. [`Tier`] chooses how far to go.
//!
//! A hierarchy is an octree. Leaves hold the input, cut at the walls of their cells; an inner node holds what lies two levels below, simplified, with the error of all steps together. See
//! [`build()`] for an example, and the book for how neighbours are made to fit.
//!
//! Source: Guthe 2004, sections 3 and 4. The certificates are new.

mod appearance;
mod build;
mod casters;
mod cell;
mod certify;
mod claims;
mod codec;
mod complex;
mod contract;
mod cover;
mod cut;
mod error;
mod facet;
mod fast;
mod flood;
mod frame;
mod gather;
mod measure;
mod original;
mod pair;
mod piece;
mod polygon;
mod prefetch;
mod quadric;
mod roles;
mod select;
mod simplify;
mod splat;
mod store;
mod stream;
mod tree;

pub use build::{BuildOptions, BuildReport, LevelReport, Progress, Stage, build, no_progress};
pub use casters::{CasterLight, Casters, ReceiverBox, receiver_boxes, select_casters};
pub use error::HlodError;
pub use glam;
pub use pair::{Certification, certify};
pub use prefetch::{PrefetchOptions, movement_until_needed, prefetch};
pub use select::{Drawn, Selection, Selector, ViewOptions};
pub use simplify::{Simplified, SimplifyOptions, Tier, simplify};
pub use splat::Splats;
pub use store::{NodeMesh, Store};
pub use stream::{Frame, Stream, StreamOptions};
pub use tree::{Mesh, NodeId, Tree};

/// The README's example, so that it stays true.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
