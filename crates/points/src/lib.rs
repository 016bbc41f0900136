//! Point clouds of any size: in an order whose prefixes are levels of detail, in nodes that disk and graphics card can
//! move, chosen for a view with a proven error in pixels.
//!
//! ```
//! use farsight_geometry::Camera;
//! use farsight_points::{
//!     BuildOptions, Grid, Input, Point, Selection, Store, Traversal, ViewOptions, build, glam::DVec3, no_progress,
//! };
//!
//! let grid = Grid::new(DVec3::splat(0.01), DVec3::ZERO)?;
//! let points: Vec<Point> = (0..40_000).map(|i| Point::new([i % 200, i / 200, (i * 7) % 5], [80, 110, 60])).collect();
//! let path = std::env::temp_dir().join(format!("crate-doc-{}.points", std::process::id()));
//! build(Input::from_points(grid, &points), &path, &BuildOptions::default(), &no_progress)?;
//!
//! let store = Store::open(&path)?;
//! let camera = Camera::look_at(DVec3::new(1.0, -6.0, 4.0), DVec3::new(1.0, 1.0, 0.0), DVec3::Z).unwrap();
//! let mut selection = Selection::default();
//! Traversal::new().select(store.octree(), &camera, &ViewOptions::error(1.0), |_| true, &mut selection);
//! assert!(selection.points <= 40_000 && selection.error.unwrap().value <= 1.0);
//! # std::fs::remove_file(path).unwrap();
//! # Ok::<(), farsight_points::PointsError>(())
//! ```
//!
//! | question | answer |
//! |---|---|
//! | where do points come from | [`Input`]: arrays, [`PointReader`]s, [`Positions`], LAS and LAZ (feature `las`), clouds of the geometry crate |
//! | how do they get into levels of detail, in memory | [`Mospt`] |
//! | and on disk, whatever their number | [`build()`] |
//! | what is in such a file | [`Store`], [`Octree`] |
//! | which nodes does a view need, and how wrong is it without the others | [`Traversal`], [`Selection`] |
//! | how are they at hand when they are needed | [`Stream`], with a [`GpuBuffers`] of the engine's |
//! | what was there before | [`Spt`], the published tree |
//!
//! Source: Wimmer 2007, chapter 6.

#[cfg(target_endian = "big")]
compile_error!("points are kept in memory and on disk in little-endian order");

mod build;
mod error;
mod frame;
mod input;
mod layout;
mod morton;
mod mospt;
mod node;
mod point;
mod record;
mod select;
mod spt;
mod store;
mod stream;
mod traverse;
mod tree;

pub use build::{BuildOptions, BuildReport, Progress, Stage, build, no_progress};
pub use error::PointsError;
pub use glam;
#[cfg(feature = "las")]
pub use input::LasOptions;
pub use input::{Batch, Input, NonFinite, PointReader, Positions};
pub use layout::MOST_ATTRIBUTE_BYTES;
pub use mospt::{LeafStrategy, Level, Mospt, MosptOptions, shuffle_batches};
pub use point::{Grid, Point};
pub use spt::{Spt, SptNode};
pub use store::{NodeData, NodeId, Octree, Store};
pub use stream::{Frame, GpuBuffers, Stream, StreamOptions};
pub use traverse::{Drawn, Selection, Traversal, ViewOptions};

/// The README's example, so that it stays true.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
