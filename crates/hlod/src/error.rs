//! What can go wrong.

use std::path::PathBuf;

/// Why something could not be simplified, built or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum HlodError {
    /// The tolerance is negative or not finite.
    #[error("a tolerance of {tolerance} is impossible; it must be finite and not negative")]
    Tolerance {
        /// The tolerance.
        tolerance: f64,
    },
    /// The tolerance is below what the coordinates can tell apart.
    #[error("a tolerance of {tolerance:e} is below the coordinates' resolution of {resolution:e}")]
    BelowResolution {
        /// The tolerance.
        tolerance: f64,
        /// The least one that makes sense for this mesh.
        resolution: f64,
    },
    /// More triangles than the tables can number, or than memory allows.
    #[error("{triangles} triangles are more than {limit}; cut the mesh into parts")]
    TooLarge {
        /// Triangles of the mesh.
        triangles: usize,
        /// Most that are taken.
        limit: usize,
    },
    /// The result is no valid mesh.
    #[error(transparent)]
    Mesh(#[from] farsight_geometry::MeshError),
    /// The operating system refused something.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What it said.
        source: std::io::Error,
    },
    /// The input ended with an error.
    #[error("batch {batch} of the input: {source}")]
    Input {
        /// Number of the batch.
        batch: usize,
        /// The error.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// An option is out of its range.
    #[error("{option} is {value}; it must be {range}")]
    Option {
        /// Name of the option.
        option: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        range: &'static str,
    },
    /// The caller stopped the work.
    #[error("cancelled")]
    Cancelled,
    /// A file is damaged, unfinished, or no hierarchy at all.
    #[error("{}: {problem} (at byte {offset})", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Where.
        offset: u64,
        /// What is wrong.
        problem: String,
    },
}

impl HlodError {
    /// Adds the path to an error of the operating system.
    pub(crate) fn io(path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.into();
        move |source| Self::Io { path, source }
    }
}
