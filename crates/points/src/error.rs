//! What can go wrong.

use std::path::PathBuf;

/// Why points could not be built, opened or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PointsError {
    /// The operating system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// Its answer.
        source: std::io::Error,
    },
    /// An input file does not follow its format.
    #[error("{}: {problem}", path.display())]
    Input {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: String,
    },
    /// A coordinate is NaN or infinite.
    #[error("point {point} is at ({x}, {y}, {z})")]
    NotFinite {
        /// The point, counted from the start of the input.
        point: u64,
        /// Its x.
        x: f64,
        /// Its y.
        y: f64,
        /// Its z.
        z: f64,
    },
    /// A scale that is not positive, or an offset or scale that is not finite.
    #[error(
        "{what}: a grid needs positive finite scales and finite offsets, not scale {scale:?}, offset {offset:?}"
    )]
    Grid {
        /// Where the grid comes from.
        what: String,
        /// Scale per axis.
        scale: [f64; 3],
        /// Offset per axis.
        offset: [f64; 3],
    },
    /// Inputs whose integer grids cannot be joined without rounding.
    #[error(
        "the grid of {what} (scale {scale:?}, offset {offset:?}) differs from the first one by more than whole steps"
    )]
    GridsDiffer {
        /// The input that does not fit.
        what: String,
        /// Its scale.
        scale: [f64; 3],
        /// Its offset.
        offset: [f64; 3],
    },
    /// A coordinate does not fit in 32 bits on the common grid.
    #[error("coordinate {value} on axis {axis} does not fit in 32 bits")]
    Range {
        /// Axis, 0 to 2.
        axis: usize,
        /// The integer.
        value: i64,
    },
    /// Inputs with different attributes cannot be joined.
    #[error("{what} has {bytes} attribute bytes a point, the first input has {expected}")]
    AttributesDiffer {
        /// The input.
        what: String,
        /// Its attribute bytes.
        bytes: usize,
        /// Those of the first input.
        expected: usize,
    },
    /// More attribute bytes than a point can have.
    #[error("{bytes} attribute bytes a point; the most is {most}")]
    Attributes {
        /// Bytes asked for.
        bytes: usize,
        /// Most.
        most: usize,
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
    /// The work needs more memory than it was given.
    #[error("{what} needs {needed} bytes, but {limit} are left of the memory limit")]
    Memory {
        /// What needs it.
        what: &'static str,
        /// Bytes needed.
        needed: u64,
        /// Bytes allowed.
        limit: u64,
    },
    /// The caller stopped the work.
    #[error("cancelled")]
    Cancelled,
    /// A file of points is damaged, unfinished, or no such file at all.
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

impl PointsError {
    /// Adds the path to an error of the operating system.
    pub(crate) fn io(path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.into();
        move |source| Self::Io { path, source }
    }

    #[cfg(feature = "las")]
    pub(crate) fn input(path: impl Into<PathBuf>, problem: impl Into<String>) -> Self {
        Self::Input { path: path.into(), problem: problem.into() }
    }
}
