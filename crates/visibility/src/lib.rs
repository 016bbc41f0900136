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
//!
//! Source: Wimmer 2007, chapter 5.

mod bits;
mod border;
mod cell;
mod mutation;
mod occluders;
mod options;
mod overlap;
mod pvs;
mod random;
mod reverse;
mod sampler;
mod schedule;
mod sight;
mod triangles;
mod wave;

pub use cell::ViewCell;
pub use glam;
pub use occluders::{Occluders, parted};
pub use options::{Bisector, Budget, Options, Reverse};
pub use pvs::Pvs;
pub use sampler::Sampler;
pub use sight::{Sight, Witness};
pub use triangles::Triangles;

use glam::DVec3;

/// Why visibility could not be sampled, stored or read.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum VisibilityError {
    /// A view cell without viewpoints.
    #[error("the view cell is empty")]
    EmptyCell,
    /// A corner of a view cell is not finite or too far away.
    #[error("a view cell cannot have a corner at {point}; coordinates must be finite and at most 1e18")]
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
