//! Hierarchies on disk: opened as if they were hostile, read node by node.

mod format;
mod parse;

pub(crate) use format::{Head, MAGIC, tail};

use crate::HlodError;
use crate::codec::{Looks, Shape, decode_looks, decode_shape};
use crate::piece::{Attributes, Piece};
use crate::tree::{Mesh, NodeId, Stored, Tree};
use farsight_geometry::streaming::read_exact_at;
use farsight_geometry::{MeshError, TriangleMesh};
use glam::{DVec3, Vec2, Vec3};
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

/// An open hierarchy: the tree in memory, meshes on disk (or in memory as well).
///
/// ```no_run
/// use farsight_hlod::{Mesh, NodeMesh, Store};
///
/// let store = Store::open("statue.hlod")?;
/// let mut mesh = NodeMesh::default();
/// for node in store.tree().ids() {
///     store.read(node, Mesh::Full, &mut mesh)?;
///     println!("{} triangles within {}", mesh.indices.len() / 3, store.tree().error(node, Mesh::Full));
/// }
/// # Ok::<(), farsight_hlod::HlodError>(())
/// ```
#[derive(Debug)]
pub struct Store {
    path: PathBuf,
    bytes: Bytes,
    tree: Tree,
}

#[derive(Debug)]
pub(crate) enum Bytes {
    File(File),
    Memory(Vec<u8>),
}

/// A node's mesh as a graphics card takes it; its buffers are reused.
#[derive(Clone, Debug, Default)]
pub struct NodeMesh {
    /// World position that [`positions`](Self::positions) are relative to.
    pub origin: DVec3,
    /// Positions of the vertices.
    pub positions: Vec<Vec3>,
    /// Normals of unit length, or zero where unknown; empty without.
    pub normals: Vec<Vec3>,
    /// Texture coordinates; empty without.
    pub uvs: Vec<Vec2>,
    /// Colours, sRGB-encoded with linear alpha; empty without.
    pub colours: Vec<[u8; 4]>,
    /// Three vertices a triangle.
    pub indices: Vec<u32>,
    /// Pairs of vertices: sides that end at a wall of the node's cell. Drawn as lines, they close what is between nodes of different levels.
    pub rims: Vec<[u32; 2]>,
    shape: Shape,
    looks: Looks,
    raw: Vec<u8>,
}

impl NodeMesh {
    /// Bytes of positions, attributes and indices.
    pub fn bytes(&self) -> u64 {
        let attributes = 12 * self.normals.len() + 8 * self.uvs.len() + 4 * self.colours.len();
        (12 * self.positions.len() + attributes + 4 * self.indices.len()) as u64
    }

    /// The same as a mesh of the geometry crate.
    ///
    /// # Errors
    /// None for what a [`Store`] has read.
    pub fn to_mesh(&self) -> Result<TriangleMesh, MeshError> {
        let mut mesh = TriangleMesh::from_slices(&self.positions, &self.indices)?.with_origin(self.origin)?;
        if !self.normals.is_empty() {
            mesh = mesh.with_normals(self.normals.clone())?;
        }
        if !self.uvs.is_empty() {
            mesh = mesh.with_uvs(self.uvs.clone())?;
        }
        if !self.colours.is_empty() {
            mesh = mesh.with_colours(self.colours.clone())?;
        }
        Ok(mesh)
    }
}

impl Store {
    /// Opens a file. Only its index is read.
    ///
    /// # Cost
    /// A few per cent of the file in bytes; about 300 bytes of memory per node.
    ///
    /// # Errors
    /// [`HlodError::Io`]; [`HlodError::Damaged`] for anything that is not a complete and consistent file.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, HlodError> {
        let path = path.as_ref();
        let metadata = std::fs::metadata(path).map_err(HlodError::io(path))?;
        if !metadata.is_file() {
            let source = io::Error::new(io::ErrorKind::InvalidInput, "not a regular file");
            return Err(HlodError::io(path)(source));
        }
        let file = File::open(path).map_err(HlodError::io(path))?;
        Self::new(path.to_owned(), Bytes::File(file), metadata.len())
    }

    /// Takes the bytes of a file.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn from_bytes(bytes: Vec<u8>) -> Result<Self, HlodError> {
        let length = bytes.len() as u64;
        Self::new("bytes in memory".into(), Bytes::Memory(bytes), length)
    }

    fn new(path: PathBuf, bytes: Bytes, length: u64) -> Result<Self, HlodError> {
        let read = |offset: u64, size: usize| {
            let mut buffer = vec![0; size];
            bytes.read(offset, &mut buffer).map_err(HlodError::io(&path))?;
            Ok(buffer)
        };
        let tree = parse::tree(&path, length, &read)?;
        Ok(Self { path, bytes, tree })
    }

    /// The tree.
    pub fn tree(&self) -> &Tree {
        &self.tree
    }

    /// Where it was opened.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Reads and decodes a node's mesh. Any number of threads may do so at once.
    ///
    /// # Errors
    /// [`HlodError::Io`], and [`HlodError::Damaged`] when a checksum is wrong or the bytes make no sense.
    ///
    /// # Panics
    /// When the tree has no such node.
    pub fn read(&self, node: NodeId, mesh: Mesh, into: &mut NodeMesh) -> Result<(), HlodError> {
        let n = &self.tree.nodes[node.0 as usize];
        let stored = self.tree.stored(node, mesh);
        let with_looks = mesh == Mesh::Full && stored.looks_bytes > 0;
        let step = self.tree.steps.of(&n.cell, n.children == 0);
        let damaged = |problem: &str| HlodError::Damaged {
            path: self.path.clone(),
            offset: stored.offset,
            problem: format!("node {}: {problem}", node.0),
        };
        let NodeMesh { origin, positions, normals, uvs, colours, indices, rims, shape, looks, raw } = into;
        self.bytes.fetch(stored, with_looks, raw).map_err(HlodError::io(&self.path))?;
        decode(raw, stored, n.cell.edge() / step, with_looks, self.tree.attributes, shape, looks)
            .map_err(damaged)?;
        *origin = self.tree.cube.leave(n.cell.middle());
        let (scale, half) = (f64::from(step) * self.tree.cube.unit, n.cell.edge() / step / 2);
        let local = |x: i32| (f64::from(x.wrapping_sub(half)) * scale) as f32;
        positions.clear();
        positions.extend(shape.at.iter().map(|p| Vec3::from_array(p.map(local))));
        std::mem::swap(indices, &mut shape.indices);
        std::mem::swap(rims, &mut shape.rims);
        std::mem::swap(normals, &mut looks.normals);
        std::mem::swap(uvs, &mut looks.uvs);
        std::mem::swap(colours, &mut looks.colours);
        Ok(())
    }
}

/// Checks and decodes the bytes of a stored mesh.
pub(crate) fn decode(
    raw: &[u8],
    stored: &Stored,
    edge: i32,
    with_looks: bool,
    attributes: Attributes,
    shape: &mut Shape,
    looks: &mut Looks,
) -> Result<(), &'static str> {
    let (coded_shape, coded_looks) =
        raw.split_at_checked(stored.shape_bytes as usize).ok_or("it is cut off")?;
    if crc32fast::hash(coded_shape) != stored.shape_crc {
        return Err("the checksum of its shape is wrong");
    }
    looks.clear();
    if !decode_shape(coded_shape, stored.positions, stored.triangles, edge, shape) {
        return Err("its shape makes no sense");
    }
    if with_looks {
        if crc32fast::hash(coded_looks) != stored.looks_crc {
            return Err("the checksum of its attributes is wrong");
        }
        if !decode_looks(coded_looks, stored.vertices, attributes, shape, looks) {
            return Err("its attributes make no sense");
        }
    }
    Ok(())
}

/// A decoded mesh on the lattice.
pub(crate) fn piece_of(shape: &Shape, looks: &Looks, corner: [i32; 3], step: i32) -> Piece {
    let has_looks = !(looks.normals.is_empty() && looks.uvs.is_empty() && looks.colours.is_empty());
    let count = if has_looks { shape.at.len() } else { 0 };
    Piece {
        at: shape.at.iter().map(|p| [0, 1, 2].map(|k| p[k] * step + corner[k])).collect(),
        looks: (0..count).map(|v| looks.look(v)).collect(),
        triangles: shape.indices.as_chunks::<3>().0.to_vec(),
    }
}

impl Bytes {
    fn read(&self, offset: u64, buffer: &mut [u8]) -> io::Result<()> {
        match self {
            Self::File(file) => read_exact_at(file, buffer, offset),
            Self::Memory(bytes) => {
                let from = usize::try_from(offset).ok().and_then(|o| bytes.get(o..)?.get(..buffer.len()));
                buffer.copy_from_slice(from.ok_or(io::ErrorKind::UnexpectedEof)?);
                Ok(())
            }
        }
    }

    /// The bytes of a stored mesh. Opening has checked that the file holds all of them, so a small file cannot ask for much.
    pub(crate) fn fetch(&self, stored: &Stored, with_looks: bool, into: &mut Vec<u8>) -> io::Result<()> {
        let looks = if with_looks { stored.looks_bytes as usize } else { 0 };
        into.resize(stored.shape_bytes as usize + looks, 0);
        self.read(stored.offset, into)
    }
}
