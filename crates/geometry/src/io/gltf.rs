//! glTF 2.0: .gltf and .glb.
//!
//! The `gltf` crate parses the JSON; everything behind it (container, buffers, accessors, node graph) is read by
//! checked code here, because that crate's own readers panic on buffers and indices that do not agree, and copy the
//! binary chunk.
//!
//! Each primitive becomes a mesh, stored once however many nodes place it. Read are positions, normals, the texture
//! coordinates of the base colour, vertex colours, base colours with their pictures, cameras and punctual lights;
//! triangles, strips and fans; sparse and quantised accessors. Skins, morph targets and animations are left out.

mod accessor;
mod container;
mod material;
mod node;
mod primitive;

use super::{Budget, Content, ImportError, Loaded, Siblings};
use crate::scene::Scene;
use ::gltf::json::{self, Root};
use std::path::Path;

/// Most JSON objects in a file. A pair of braces can become some three hundred bytes.
const MAX_OBJECTS: u64 = 1 << 21;
/// Bytes that a small file may expand to.
const GEOMETRY_FLOOR: u64 = 1 << 24;

/// Required extensions that change what is read and are dealt with.
const KNOWN_EXTENSIONS: [&str; 4] =
    ["KHR_mesh_quantization", "KHR_lights_punctual", "KHR_materials_unlit", "KHR_texture_transform"];

/// Loads a .gltf or .glb file; buffers and pictures are looked for beside it.
///
/// # Errors
/// [`ImportError`]; missing pictures are only warnings.
pub fn load(path: &Path) -> Result<Loaded, ImportError> {
    read(&super::read_file(path)?, &|name| super::read_sibling(path, name))
}

/// Reads a glTF that holds its buffers itself.
///
/// # Errors
/// [`ImportError`] naming the item.
pub fn from_bytes(bytes: &[u8]) -> Result<Loaded, ImportError> {
    read(bytes, &super::no_siblings)
}

/// Reads a glTF, binary or JSON by its first bytes; `siblings` finds buffers and pictures beside it.
///
/// # Accuracy
/// `f32` values are taken as they are, quantised ones exactly. Node transforms are multiplied in `f64`.
///
/// # Cost
/// O(bytes + result). Peak memory is the bytes and the result. A result beyond 64 times the bytes (and 16 MiB) is refused.
///
/// # Errors
/// [`ImportError`] naming the item.
pub fn read(bytes: &[u8], siblings: Siblings<'_>) -> Result<Loaded, ImportError> {
    let (text, chunk) = container::split(bytes)?;
    let objects = text.iter().filter(|&&b| b == b'{').count() as u64;
    if objects > MAX_OBJECTS {
        return Err(ImportError::Limit { what: "JSON objects", count: objects, limit: MAX_OBJECTS });
    }
    let root: Root =
        json::deserialize::from_slice(text).map_err(|e| ImportError::syntax("JSON", e.to_string()))?;
    if let Some(name) = root.extensions_required.iter().find(|e| !KNOWN_EXTENSIONS.contains(&e.as_str())) {
        return Err(ImportError::Unsupported {
            what: format!("the required extension {}", super::short_name(name)),
        });
    }
    let mut warnings = Vec::new();
    if root.extensions_required.iter().any(|e| e == "KHR_texture_transform") {
        warnings.push("texture transforms are left out".into());
    }
    let (buffers, input) = container::Buffers::load(&root, chunk, siblings, bytes.len() as u64)?;
    let mut reader = Reader {
        root: &root,
        buffers,
        budget: Budget::new("bytes of geometry", input, GEOMETRY_FLOOR),
        pictures: Budget::new("bytes of texels", input, super::picture::PICTURES_FLOOR),
        siblings,
        scene: Scene::new(),
        warnings,
        stored_vertices: 0,
    };
    reader.read_nodes()?;
    let Reader { scene, warnings, stored_vertices, .. } = reader;
    Ok(Loaded { content: Content::Scene(scene), stored_vertices, warnings })
}

/// A file being read.
struct Reader<'a> {
    root: &'a Root,
    buffers: container::Buffers<'a>,
    budget: Budget,
    pictures: Budget,
    siblings: Siblings<'a>,
    scene: Scene,
    warnings: Vec<String>,
    stored_vertices: u64,
}

/// The item that an index of the file leads to.
fn item<'a, T>(list: &'a [T], index: usize, what: &str) -> Result<&'a T, ImportError> {
    list.get(index)
        .ok_or_else(|| ImportError::syntax(format!("{what} {index}"), format!("there are {}", list.len())))
}
