//! What can be seen from a region: potentially visible sets by guided sampling, with a bound on what they miss.
//!
//! ```
//! use farsight_geometry::ray::Bvh8;
//! use farsight_geometry::{DAabb, TriangleMesh, glam::{DVec3, Vec3}};
//! use farsight_visibility::{Budget, Occluders, Options, Sampler, Triangles, ViewCell};
//!
//! // A wall at x = 2, and behind it a small triangle that nobody in the cell can see.
//! let p = [(2.0, -9.0, -9.0), (2.0, 9.0, -9.0), (2.0, 0.0, 18.0), (3.0, 0.0, 0.0), (3.0, 1.0, 0.0), (3.0, 0.0, 1.0)];
//! let positions = p.map(|(x, y, z)| Vec3::new(x, y, z)).to_vec();
//! let mesh = TriangleMesh::new(positions, vec![[0, 1, 2], [3, 4, 5]])?;
//! let (triangles, caster) = (Triangles::of_mesh(&mesh), Bvh8::new(&mesh));
//! let cell = ViewCell::from_box(&DAabb::new(DVec3::splat(-0.1), DVec3::splat(0.1)))?;
//! let mut sampler = Sampler::new(&triangles, Occluders::opaque(&caster), &cell, Options::default())?;
//! sampler.run(&Budget::rays(50_000));
//! let seen = sampler.pvs();
//! assert!(seen.contains(0) && !seen.contains(1));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! | question | answer |
//! |---|---|
//! | from where is looked | [`ViewCell`] |
//! | at what, and what counts as seen | [`Triangles`], [`Occluders`] |
//! | what is seen | [`Sampler`], [`Options`], [`Budget`] |
//! | who can prove it | [`Witness`] |
//! | how much is missing at most | [`Sampler::validate`], [`Missed`], [`upper_bound`] |
//! | what is done with sets | [`Pvs`] |
//! | and what would pictures instead of rays find | [`nir()`], [`ItemBuffer`] |
//! | and with many cells | [`CellGrid`], [`Bake`], [`shard`], [`PvsStore`] |
//!
//! Source: Wimmer 2007, chapter 5.

mod bake;
mod bits;
mod border;
mod cell;
mod codec;
mod flood;
mod grid;
mod known;
mod mutation;
mod nir;
mod occluders;
mod options;
mod overlap;
mod pvs;
mod random;
mod reverse;
mod sampler;
mod schedule;
mod sight;
mod store;
mod triangles;
mod validate;
mod wave;

pub use bake::{Bake, BakedCell, shard};
pub use cell::ViewCell;
pub use glam;
pub use grid::CellGrid;
pub use nir::{ItemBuffer, NirOptions, NirSet, cube, nir};
pub use occluders::{Occluders, parted};
pub use options::{Bisector, Budget, MissedLimit, Options, Reverse};
pub use pvs::Pvs;
pub use sampler::Sampler;
pub use sight::{Sight, Witness};
pub use store::{PvsStore, PvsWriter};
pub use triangles::Triangles;
pub use validate::{Missed, upper_bound};

use glam::DVec3;

/// Why visibility could not be sampled, stored or read.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum VisibilityError {
    /// A view cell without viewpoints.
    #[error("the view cell is empty")]
    EmptyCell,
    /// A corner of a view cell is not finite or too far away.
    #[error("a view cell cannot have a corner at {point}; coordinates must be finite and at most 1e24")]
    CellCoordinate {
        /// The corner.
        point: DVec3,
    },
    /// More triangles than 32 bits can number.
    #[error("{count} triangles are more than can be numbered")]
    TooManyTriangles {
        /// How many.
        count: u64,
    },
    /// A list of members does not fit the triangles.
    #[error("{entries} members for {triangles} triangles{}", bad.map_or(String::new(), |t| format!("; that of triangle {t} is out of range")))]
    Members {
        /// Entries given.
        entries: usize,
        /// Triangles that there are.
        triangles: u32,
        /// The first triangle whose member is out of range.
        bad: Option<u32>,
    },
    /// The runs of a set are not in order.
    #[error("run {index} of a set is empty or does not follow the one before it with a gap")]
    Runs {
        /// The run.
        index: usize,
    },
    /// A grid without cells or with too many.
    #[error("a grid of {} x {} x {} cells is not possible", counts[0], counts[1], counts[2])]
    Cells {
        /// Cells along each axis.
        counts: [u32; 3],
    },
    /// Cells that a grid does not have, or a section has no room for.
    #[error("cells {start} to {end} are not to be had, of {cells}")]
    CellRange {
        /// First cell.
        start: u32,
        /// The one after the last.
        end: u32,
        /// Cells of the grid.
        cells: u32,
    },
    /// A set holds a number that is no member.
    #[error("{number} is not one of {members} members")]
    NotAMember {
        /// The number.
        number: u32,
        /// Members that there are.
        members: u32,
    },
    /// Bytes that hold no sets.
    #[error("{what} at byte {offset}")]
    Format {
        /// What was found.
        what: &'static str,
        /// Where.
        offset: u64,
    },
    /// A file could not be read or written.
    #[error("{path}: {reason}")]
    File {
        /// The file.
        path: String,
        /// The system's reason.
        reason: String,
    },
    /// An option is out of its range.
    #[error("{option} cannot be {value}; allowed is {range}")]
    Option {
        /// The option.
        option: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        range: &'static str,
    },
}
