//! Importers: files and bytes become validated types; no algorithm sees a file.
//!
//! [`load`] picks the format by the file's extension. Each format is one Cargo feature and one module: `obj`,
//! `gltf`, `ply` for scenes and points, `exr` for images.
//!
//! Files are taken as hostile: no declared count is believed before the bytes behind it were seen, no index is
//! followed unchecked, and what a small file may expand to is limited. A file that is damaged gives an [`ImportError`]
//! that says what is wrong and where.
//!
//! Texture coordinates have one convention whatever the format: (0, 0) is the top left corner of the picture, v grows
//! downwards.

#[cfg(feature = "exr")]
pub mod exr;
#[cfg(feature = "gltf")]
pub mod gltf;
#[cfg(feature = "obj")]
pub mod obj;
#[cfg(any(feature = "obj", feature = "gltf"))]
mod picture;
#[cfg(feature = "ply")]
pub mod ply;

use crate::mesh::MeshError;
use crate::points::{PointCloud, PointsError};
use crate::scene::{Scene, SceneError};
use std::path::{Component, Path, PathBuf};

/// What a file held.
#[derive(Clone, Debug, PartialEq)]
pub enum Content {
    /// Meshes with instances, materials, lights and cameras.
    Scene(Scene),
    /// Points without triangles.
    Points(PointCloud),
}

/// What an importer returns.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Loaded {
    /// The scene or the points.
    pub content: Content,
    /// Positions as the file stores them. A mesh has more where one position carries several normals or texture
    /// coordinates.
    pub stored_vertices: u64,
    /// What was left out or could not be read, without which the rest still makes sense; a line each.
    pub warnings: Vec<String>,
}

impl Loaded {
    /// The scene; `None` for points.
    pub fn into_scene(self) -> Option<Scene> {
        match self.content {
            Content::Scene(scene) => Some(scene),
            Content::Points(_) => None,
        }
    }

    /// The points; `None` for a scene.
    pub fn into_points(self) -> Option<PointCloud> {
        match self.content {
            Content::Points(points) => Some(points),
            Content::Scene(_) => None,
        }
    }
}

/// Why bytes could not be turned into a scene.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImportError {
    /// The operating system refused.
    #[error("{0}")]
    Io(#[from] std::io::Error),
    /// A folder, a pipe or a device.
    #[error("not a regular file")]
    NotAFile,
    /// No importer has this extension.
    #[error("unknown extension '{extension}' (known: obj, gltf, glb, ply)")]
    UnknownExtension {
        /// The extension, in lower case; empty when there is none.
        extension: String,
    },
    /// The importer was not compiled.
    #[error("reading .{extension} needs the Cargo feature '{feature}'")]
    FeatureOff {
        /// The extension, in lower case.
        extension: String,
        /// The feature to switch on.
        feature: &'static str,
    },
    /// The bytes do not follow the format.
    #[error("{place}: {problem}")]
    Syntax {
        /// Line, byte or item.
        place: String,
        /// What is wrong there.
        problem: String,
    },
    /// The file needs something that the importer does not do.
    #[error("{what} is not supported")]
    Unsupported {
        /// What it needs.
        what: String,
    },
    /// A mesh of the file was refused.
    #[error("mesh '{part}': {error}")]
    Mesh {
        /// Its name.
        part: String,
        /// Why.
        error: MeshError,
    },
    /// The points of the file were refused.
    #[error("{0}")]
    Points(#[from] PointsError),
    /// A material, instance or light of the file was refused.
    #[error("{0}")]
    Scene(#[from] SceneError),
    /// More than the importer is willing to hold.
    #[error("{count} {what}, but the limit is {limit}")]
    Limit {
        /// What there is too much of.
        what: &'static str,
        /// How much.
        count: u64,
        /// How much is allowed.
        limit: u64,
    },
}

impl ImportError {
    #[cfg(any(feature = "obj", feature = "gltf", feature = "ply", feature = "exr"))]
    pub(crate) fn syntax(place: impl Into<String>, problem: impl Into<String>) -> Self {
        Self::Syntax { place: place.into(), problem: problem.into() }
    }
}

/// A file could not be loaded.
#[derive(Debug, thiserror::Error)]
#[error("{}: {cause}", path.display())]
#[non_exhaustive]
pub struct LoadError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    pub cause: ImportError,
}

/// Loads a scene or points; the extension, in any case, picks the importer.
///
/// Files named inside the file (buffers, pictures, materials) are looked for beside it.
///
/// # Cost
/// Time is that of parsing. While it runs, a text file is read in pieces, a binary one lies whole in memory next to the
/// result.
///
/// # Errors
/// [`LoadError`] with the path and an [`ImportError`]: missing file, unknown extension, feature not compiled, damaged
/// or refused content.
///
/// ```
/// use farsight_geometry::io;
///
/// let error = io::load("no/such/house.step").unwrap_err();
/// assert_eq!(error.to_string(), "no/such/house.step: unknown extension 'step' (known: obj, gltf, glb, ply)");
/// ```
pub fn load(path: impl AsRef<Path>) -> Result<Loaded, LoadError> {
    let path = path.as_ref();
    dispatch(path).map_err(|cause| LoadError { path: path.to_owned(), cause })
}

fn dispatch(path: &Path) -> Result<Loaded, ImportError> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    match extension.as_str() {
        #[cfg(feature = "obj")]
        "obj" => obj::load(path),
        #[cfg(not(feature = "obj"))]
        "obj" => Err(ImportError::FeatureOff { extension, feature: "obj" }),
        #[cfg(feature = "gltf")]
        "gltf" | "glb" => gltf::load(path),
        #[cfg(not(feature = "gltf"))]
        "gltf" | "glb" => Err(ImportError::FeatureOff { extension, feature: "gltf" }),
        #[cfg(feature = "ply")]
        "ply" => ply::load(path),
        #[cfg(not(feature = "ply"))]
        "ply" => Err(ImportError::FeatureOff { extension, feature: "ply" }),
        _ => Err(ImportError::UnknownExtension { extension }),
    }
}

/// Opens a regular file; pipes and devices could block or never end.
#[allow(dead_code)] // Which importers use it depends on the features.
pub(crate) fn open(path: &Path) -> Result<std::fs::File, ImportError> {
    if !std::fs::metadata(path)?.is_file() {
        return Err(ImportError::NotAFile);
    }
    Ok(std::fs::File::open(path)?)
}

/// The whole of a regular file.
#[allow(dead_code)]
pub(crate) fn read_file(path: &Path) -> Result<Vec<u8>, ImportError> {
    use std::io::Read;
    let mut file = open(path)?;
    // One allocation of the right size; growing would double the peak.
    let mut bytes = Vec::with_capacity(usize::try_from(file.metadata()?.len()).unwrap_or(0));
    file.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Finds the bytes of a file that another file names.
pub type Siblings<'a> = &'a dyn Fn(&str) -> Result<Vec<u8>, ImportError>;

/// For bytes that stand alone.
#[allow(dead_code)]
pub(crate) fn no_siblings(name: &str) -> Result<Vec<u8>, ImportError> {
    Err(ImportError::Unsupported { what: format!("the file '{name}' beside bytes without a path") })
}

/// Reads `name` from the folder of `path`. Absolute names and those that climb out of the folder are refused.
#[allow(dead_code)]
pub(crate) fn read_sibling(path: &Path, name: &str) -> Result<Vec<u8>, ImportError> {
    let relative = PathBuf::from(name.replace('\\', "/"));
    if !relative.components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir)) {
        return Err(ImportError::Unsupported {
            what: format!("the file name '{name}', which leaves the folder,"),
        });
    }
    read_file(&path.parent().unwrap_or(Path::new("")).join(relative))
}

/// Largest coordinates of the first vertex for which all wide coordinates are kept relative to it: from where steps of `f32` exceed 1/256 to far
/// beyond any map.
#[cfg(any(feature = "obj", feature = "ply"))]
const FAR: std::ops::Range<f64> = 65_536.0..1e12;

/// What a file may still expand to. A few bytes can ask for a lot: a shared vertex list decoded for every user, a
/// picture of one colour.
#[cfg(any(feature = "obj", feature = "gltf"))]
pub(crate) struct Budget {
    what: &'static str,
    limit: u64,
    used: u64,
}

#[cfg(any(feature = "obj", feature = "gltf"))]
impl Budget {
    /// Result bytes that every input byte may stand for.
    pub(crate) const FACTOR: u64 = 64;

    /// `FACTOR` times the input, and `floor` bytes for small files.
    pub(crate) fn new(what: &'static str, input: u64, floor: u64) -> Self {
        Self { what, limit: floor.saturating_add(input.saturating_mul(Self::FACTOR)), used: 0 }
    }

    /// Asks for more, before it is allocated.
    pub(crate) fn take(&mut self, bytes: u64) -> Result<(), ImportError> {
        let count = self.used.saturating_add(bytes);
        if count > self.limit {
            return Err(ImportError::Limit { what: self.what, count, limit: self.limit });
        }
        self.used = count;
        Ok(())
    }
}

/// Longest name that is kept, in bytes. Names are repeated in every instance.
#[cfg(any(feature = "obj", feature = "gltf"))]
const MAX_NAME: usize = 256;

/// The beginning of a name.
#[cfg(any(feature = "obj", feature = "gltf"))]
pub(crate) fn short_name(name: &str) -> String {
    let end = (0..=name.len().min(MAX_NAME)).rev().find(|&i| name.is_char_boundary(i));
    name[..end.unwrap_or(0)].to_owned()
}
