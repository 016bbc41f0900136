//! Drawing while loading: what is on the graphics card is drawn, what is missing comes in the background, nothing waits.

use crate::traverse::{Drawn, Selection, Traversal, ViewOptions};
use crate::{NodeData, NodeId, PointsError, Store};
use farsight_geometry::Camera;
use farsight_geometry::streaming::{Loader, Lru};
use std::sync::Arc;

/// The graphics card's side: an engine implements it with its vertex buffers.
///
/// A point is 16 bytes: three `i32`, four bytes of colour. Subtract the eye's integer coordinates as integers and convert the
/// difference to floating point: that keeps all precision near the eye, however far from the origin.
///
/// ```
/// use farsight_points::{GpuBuffers, NodeData, NodeId};
///
/// /// "Uploads" into plain memory.
/// struct Plain;
///
/// impl GpuBuffers for Plain {
///     type Buffer = Vec<u8>;
///     fn upload(&mut self, _node: NodeId, data: &NodeData) -> Vec<u8> {
///         bytemuck::cast_slice(&data.points).to_vec()
///     }
///     fn release(&mut self, _buffer: Vec<u8>) {}
/// }
/// ```
pub trait GpuBuffers {
    /// A buffer that can be drawn from.
    type Buffer;
    /// Makes a buffer of a node's points.
    fn upload(&mut self, node: NodeId, data: &NodeData) -> Self::Buffer;
    /// Gives a buffer up.
    fn release(&mut self, buffer: Self::Buffer);
}

/// Sizes of caches and pace of loading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct StreamOptions {
    /// Bytes of points on the graphics card.
    pub card_bytes: u64,
    /// Bytes of points in main memory.
    pub memory_bytes: u64,
    /// Bytes uploaded per frame, though never less than one node.
    pub upload_bytes: u64,
    /// Nodes that may wait to be read; the list is made anew each frame, so that what is no longer needed is not read.
    pub requests: usize,
    /// Threads that read.
    pub threads: usize,
}

impl Default for StreamOptions {
    /// 512 MB on the card, 1 GB in memory, 16 MB per frame, 64 requests, one thread.
    fn default() -> Self {
        Self {
            card_bytes: 512 << 20,
            memory_bytes: 1 << 30,
            upload_bytes: 16 << 20,
            requests: 64,
            threads: 1,
        }
    }
}

/// A nested octree that is drawn frame by frame.
pub struct Stream<G: GpuBuffers> {
    store: Arc<Store>,
    gpu: G,
    options: StreamOptions,
    buffers: Vec<Option<G::Buffer>>,
    on_card: Lru,
    data: Vec<Option<NodeData>>,
    in_memory: Lru,
    loader: Loader<NodeId, NodeData, PointsError>,
    arrived: Vec<(NodeId, Result<NodeData, PointsError>)>,
    broken: Vec<bool>,
    failures: Vec<(NodeId, PointsError)>,
    traversal: Traversal,
    selection: Selection,
}

/// What to draw in a frame.
#[derive(Debug)]
pub struct Frame<'a, B> {
    /// Nodes, missing ones, the proven error of this frame, counters.
    pub selection: &'a Selection,
    buffers: &'a [Option<B>],
}

impl<B> Frame<'_, B> {
    /// Buffers to draw whole, as lists of points.
    pub fn draws(&self) -> impl Iterator<Item = (&B, &Drawn)> {
        self.selection.drawn.iter().filter_map(|d| Some((self.buffers[d.node.0 as usize].as_ref()?, d)))
    }
}

impl<G: GpuBuffers> Stream<G> {
    /// Starts the reading threads, and reads the root so that there is something to draw from the first frame on.
    ///
    /// # Errors
    /// When the root cannot be read.
    pub fn new(store: impl Into<Arc<Store>>, gpu: G, options: StreamOptions) -> Result<Self, PointsError> {
        let store = store.into();
        let nodes = store.octree().len();
        let source = Arc::clone(&store);
        let loader = Loader::new(options.threads, move |node, into: &mut NodeData| source.read(node, into));
        let mut stream = Self {
            store,
            gpu,
            options,
            buffers: (0..nodes).map(|_| None).collect(),
            on_card: Lru::new(nodes, options.card_bytes),
            data: (0..nodes).map(|_| None).collect(),
            in_memory: Lru::new(nodes, options.memory_bytes),
            loader,
            arrived: Vec::new(),
            broken: vec![false; nodes],
            failures: Vec::new(),
            traversal: Traversal::new(),
            selection: Selection::default(),
        };
        if nodes > 0 {
            let mut root = NodeData::default();
            stream.store.read(NodeId(0), &mut root)?;
            stream.keep(NodeId(0), root);
        }
        Ok(stream)
    }

    /// The store.
    pub fn store(&self) -> &Store {
        &self.store
    }

    /// The graphics card's side.
    pub fn gpu(&self) -> &G {
        &self.gpu
    }

    /// Nodes that could not be read, since the last call. They are not asked for again.
    pub fn take_failures(&mut self) -> Vec<(NodeId, PointsError)> {
        std::mem::take(&mut self.failures)
    }

    /// Bytes of points on the card and in memory.
    pub fn cached_bytes(&self) -> (u64, u64) {
        (self.on_card.used(), self.in_memory.used())
    }

    /// Whether nothing is being loaded.
    pub fn is_idle(&self) -> bool {
        self.loader.is_idle()
    }

    /// Chooses what to draw from what is at hand, and asks for the rest. Never waits.
    ///
    /// What a view needs beyond the caches' sizes stays away: on the card the more important nodes push out the less important
    /// ones, in memory what the last frame used stays, and nothing is read that there would be no room for.
    pub fn frame(&mut self, camera: &Camera, options: &ViewOptions) -> Frame<'_, G::Buffer> {
        // First of all, so that arrivals take the place of nothing that the last frame used.
        self.take_arrivals();
        self.on_card.next_frame();
        self.in_memory.next_frame();
        let mut upload_left = self.options.upload_bytes;
        let Self { store, gpu, buffers, on_card, data, in_memory, traversal, selection, .. } = self;
        let octree = store.octree();
        let is_there = |node: NodeId| {
            if in_memory.holds(node.0) {
                in_memory.touch(node.0);
            }
            if on_card.holds(node.0) {
                on_card.touch(node.0);
                return true;
            }
            let Some(points) = &data[node.0 as usize] else { return false };
            let bytes = points.bytes() as u64;
            // One node may always be uploaded, however large.
            if bytes > upload_left && upload_left < self.options.upload_bytes {
                return false;
            }
            let mut release = |old: u32| {
                if let Some(buffer) = buffers[old as usize].take() {
                    gpu.release(buffer);
                }
            };
            if !on_card.make_room(bytes, &mut release) {
                return false;
            }
            buffers[node.0 as usize] = Some(gpu.upload(node, points));
            on_card.insert(node.0, bytes);
            upload_left = upload_left.saturating_sub(bytes);
            true
        };
        traversal.select(octree, camera, options, is_there, selection);
        // Of what this frame draws, the least important is to be given up first in the next.
        selection.drawn.iter().rev().for_each(|drawn| on_card.touch(drawn.node.0));
        let mut room = in_memory.room();
        let wanted = |node: &NodeId| {
            let at = node.0 as usize;
            let bytes = octree.node_bytes(*node);
            let wanted = self.data[at].is_none() && !self.broken[at] && bytes <= room;
            room -= if wanted { bytes } else { 0 };
            wanted
        };
        self.loader.request(self.selection.missing.iter().copied().filter(wanted), self.options.requests);
        Frame { selection: &self.selection, buffers: &self.buffers }
    }

    fn take_arrivals(&mut self) {
        let mut arrived = std::mem::take(&mut self.arrived);
        self.loader.take(&mut arrived);
        for (node, outcome) in arrived.drain(..) {
            match outcome {
                Ok(data) => self.keep(node, data),
                Err(error) => {
                    self.broken[node.0 as usize] = true;
                    self.failures.push((node, error));
                }
            }
        }
        self.arrived = arrived;
    }

    fn keep(&mut self, node: NodeId, new: NodeData) {
        let Self { in_memory, data, loader, .. } = self;
        let release = |old: u32| {
            if let Some(old) = data[old as usize].take() {
                loader.recycle(old);
            }
        };
        if !in_memory.holds(node.0) && in_memory.make_room(new.bytes() as u64, release) {
            in_memory.insert(node.0, new.bytes() as u64);
            self.data[node.0 as usize] = Some(new);
        } else {
            loader.recycle(new);
        }
    }
}
