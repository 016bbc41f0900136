//! What can go wrong.

use std::path::PathBuf;

/// Why something could not be drawn, generated or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RasterError {
    /// A target's side is zero or too long.
    #[error("a target of {width} x {height} pixels; sides must lie in 1..={}", crate::target::MAX_SIDE)]
    TargetSize {
        /// Width.
        width: u32,
        /// Height.
        height: u32,
    },
    /// An image's sides and its number of pixels do not agree.
    #[error("an image of {width} x {height} cannot have {pixels} pixels")]
    ImageSize {
        /// Width.
        width: u32,
        /// Height.
        height: u32,
        /// Pixels given.
        pixels: usize,
    },
    /// Images of different size cannot be compared.
    #[error("images of {} x {} and {} x {} cannot be compared", a[0], a[1], b[0], b[1])]
    SizesDiffer {
        /// Width and height of the first.
        a: [u32; 2],
        /// Width and height of the second.
        b: [u32; 2],
    },
    /// A generator's or renderer's option is out of its range.
    #[error("{option} is {value}; it must lie in {range}")]
    Option {
        /// Name of the option.
        option: &'static str,
        /// Value given.
        value: f64,
        /// Allowed values.
        range: &'static str,
    },
    /// A file could not be written.
    #[error("{path}: {source}", path = path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: std::io::Error,
    },
    /// The PNG encoder refused.
    #[error(transparent)]
    Png(#[from] png::EncodingError),
    /// The EXR encoder refused.
    #[cfg(feature = "exr")]
    #[error(transparent)]
    Exr(#[from] exr::error::Error),
    /// A generator made a mesh that the mesh type refuses.
    #[error(transparent)]
    Mesh(#[from] farsight_geometry::MeshError),
    /// A generator made something that the scene refuses.
    #[error(transparent)]
    Scene(#[from] farsight_geometry::scene::SceneError),
    /// A generator made a camera that does not exist.
    #[error(transparent)]
    Camera(#[from] farsight_geometry::CameraError),
}
