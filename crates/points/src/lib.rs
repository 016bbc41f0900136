//! Point clouds of any size.

#[cfg(target_endian = "big")]
compile_error!("points are kept in memory and on disk in little-endian order");

mod build;
mod cache;
mod error;
mod frame;
mod input;
mod layout;
mod load;
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
