//! Nested octrees on disk: opening them as if they were hostile, and reading nodes.

mod format;
mod octree;
mod parse;

pub(crate) use format::{Head, MAGIC, tail};
pub use octree::{NodeId, Octree};
pub(crate) use octree::{Size, Walked};

use crate::node::POINT_BYTES;
use crate::{Point, PointsError};
use farsight_geometry::streaming::read_exact_at;
use std::fs::File;
use std::path::{Path, PathBuf};

/// An open nested octree: the tree in memory, the points on disk (or in memory as well).
///
/// ```no_run
/// use farsight_points::{NodeData, Store};
///
/// let store = Store::open("street.points")?;
/// let mut data = NodeData::default();
/// for node in store.octree().ids() {
///     store.read(node, &mut data)?;
///     println!("{} points at {:?}", data.points.len(), store.octree().bounds(node));
/// }
/// # Ok::<(), farsight_points::PointsError>(())
/// ```
#[derive(Debug)]
pub struct Store {
    path: PathBuf,
    bytes: Bytes,
    octree: Octree,
}

#[derive(Debug)]
enum Bytes {
    File(File),
    Memory(Vec<u8>),
}

/// Points of a node, level by level; its buffers are reused.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct NodeData {
    /// Positions and colours, as a graphics card takes them.
    pub points: Vec<Point>,
    /// Attributes, point after point.
    pub attributes: Vec<u8>,
}

impl NodeData {
    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.points.len() * POINT_BYTES + self.attributes.len()
    }
}

impl Store {
    /// Opens a file. Only its index is read.
    ///
    /// # Cost
    /// Less than a thousandth of the file in bytes; 40 bytes of memory per node.
    ///
    /// # Errors
    /// [`PointsError::Io`]; [`PointsError::Damaged`] for anything that is not a complete and consistent file.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, PointsError> {
        let path = path.as_ref();
        let metadata = std::fs::metadata(path).map_err(PointsError::io(path))?;
        if !metadata.is_file() {
            let source = std::io::Error::new(std::io::ErrorKind::InvalidInput, "not a regular file");
            return Err(PointsError::Io { path: path.to_owned(), source });
        }
        let file = File::open(path).map_err(PointsError::io(path))?;
        Self::new(path.to_owned(), Bytes::File(file), metadata.len())
    }

    /// Takes the bytes of a file.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn from_bytes(bytes: Vec<u8>) -> Result<Self, PointsError> {
        let length = bytes.len() as u64;
        Self::new("bytes in memory".into(), Bytes::Memory(bytes), length)
    }

    fn new(path: PathBuf, bytes: Bytes, length: u64) -> Result<Self, PointsError> {
        let read = |offset: u64, size: usize| {
            let mut buffer = vec![0; size];
            bytes.read(offset, &mut buffer).map_err(PointsError::io(&path))?;
            Ok(buffer)
        };
        let octree = parse::octree(&path, length, &read)?;
        Ok(Self { path, bytes, octree })
    }

    /// The tree.
    pub fn octree(&self) -> &Octree {
        &self.octree
    }

    /// Where it was opened.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Reads the points of a node. Any number of threads may do so at once.
    ///
    /// # Errors
    /// [`PointsError::Io`], and [`PointsError::Damaged`] when the checksum is wrong.
    ///
    /// # Panics
    /// When the tree has no such node.
    pub fn read(&self, node: NodeId, into: &mut NodeData) -> Result<(), PointsError> {
        let (offset, points, crc) = self.octree.payload(node);
        let each = self.octree.attribute_bytes();
        // Opening has checked that the file is as long as all nodes together, so a small file cannot ask for much.
        into.points.resize(points, Point::default());
        into.attributes.resize(points * each, 0);
        let read =
            |offset, buffer: &mut [u8]| self.bytes.read(offset, buffer).map_err(PointsError::io(&self.path));
        read(offset, bytemuck::cast_slice_mut(&mut into.points))?;
        if each > 0 {
            read(offset + (points * POINT_BYTES) as u64, &mut into.attributes)?;
        }
        let mut hasher = crc32fast::Hasher::new();
        hasher.update(bytemuck::cast_slice(&into.points));
        hasher.update(&into.attributes);
        if hasher.finalize() != crc {
            let problem = format!("the checksum of node {} is wrong", node.0);
            return Err(PointsError::Damaged { path: self.path.clone(), offset, problem });
        }
        Ok(())
    }
}

impl Bytes {
    fn read(&self, offset: u64, buffer: &mut [u8]) -> std::io::Result<()> {
        match self {
            Self::File(file) => read_exact_at(file, buffer, offset),
            Self::Memory(bytes) => {
                let from = usize::try_from(offset).ok().and_then(|o| bytes.get(o..)?.get(..buffer.len()));
                let from = from.ok_or(std::io::ErrorKind::UnexpectedEof)?;
                buffer.copy_from_slice(from);
                Ok(())
            }
        }
    }
}
