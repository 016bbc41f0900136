//! Drawing while loading: what is in memory is drawn, what is missing comes in the background, nothing waits.

use crate::prefetch::{PrefetchOptions, prefetch};
use crate::select::{Selection, Selector, ViewOptions};
use crate::tree::{Mesh, NodeId};
use crate::{HlodError, NodeMesh, Store};
use farsight_geometry::Camera;
use farsight_geometry::streaming::{Loader, Lru};
use std::sync::Arc;

/// Size of the cache and pace of loading.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct StreamOptions {
    /// Bytes of decoded meshes that are kept.
    pub memory_bytes: u64,
    /// Bytes of decoded meshes that a frame takes in, though never less than one node: what an engine uploads per frame.
    pub frame_bytes: u64,
    /// Nodes that may wait to be read. The list is made anew each frame, so that what is no longer needed is not read.
    pub requests: usize,
    /// Threads that read and decode.
    pub threads: usize,
    /// What to load before it is needed; `None` loads only what is.
    pub prefetch: Option<PrefetchOptions>,
}

impl Default for StreamOptions {
    /// 512 MB, 16 MB a frame, 64 requests, one thread, nothing ahead.
    fn default() -> Self {
        Self { memory_bytes: 512 << 20, frame_bytes: 16 << 20, requests: 64, threads: 1, prefetch: None }
    }
}

impl StreamOptions {
    /// The options with another size of the cache.
    #[must_use]
    pub fn with_memory_bytes(self, memory_bytes: u64) -> Self {
        Self { memory_bytes, ..self }
    }

    /// The options with another pace.
    #[must_use]
    pub fn with_frame_bytes(self, frame_bytes: u64) -> Self {
        Self { frame_bytes, ..self }
    }

    /// The options with loading ahead.
    #[must_use]
    pub fn with_prefetch(self, prefetch: PrefetchOptions) -> Self {
        Self { prefetch: Some(prefetch), ..self }
    }
}

/// A store that is drawn frame by frame.
///
/// ```no_run
/// use farsight_geometry::Camera;
/// use farsight_hlod::{Mesh, Store, Stream, StreamOptions, ViewOptions, glam::DVec3};
///
/// let mut stream = Stream::new(Store::open("statue.hlod")?, Mesh::Full, StreamOptions::default())?;
/// let camera = Camera::look_at(DVec3::new(0.0, -5.0, 1.0), DVec3::ZERO, DVec3::Z).unwrap();
/// for frame in 0..100 {
///     let frame = stream.frame(&camera, &ViewOptions::error(0.5));
///     for (mesh, drawn) in frame.draws() {
///         // Draw mesh.indices, and mesh.rims as lines.
///     }
///     println!("{} triangles, off by {}", frame.selection.triangles, frame.selection.geometric.unwrap());
/// }
/// # Ok::<(), farsight_hlod::HlodError>(())
/// ```
pub struct Stream {
    store: Arc<Store>,
    mesh: Mesh,
    options: StreamOptions,
    meshes: Vec<Option<NodeMesh>>,
    lru: Lru,
    loader: Loader<NodeId, NodeMesh, HlodError>,
    arrived: Vec<(NodeId, Result<NodeMesh, HlodError>)>,
    broken: Vec<bool>,
    failures: Vec<(NodeId, HlodError)>,
    came: Vec<NodeId>,
    went: Vec<NodeId>,
    /// Whether no frame has told of the root yet.
    begins: bool,
    selector: Selector,
    selection: Selection,
    ahead: Vec<NodeId>,
}

/// What to draw in a frame.
#[derive(Debug)]
pub struct Frame<'a> {
    /// Nodes, wanted ones, the error that this frame has, counters.
    pub selection: &'a Selection,
    /// Nodes that came into memory since the last frame: to upload.
    pub came: &'a [NodeId],
    /// Nodes that left it: to forget.
    pub went: &'a [NodeId],
    meshes: &'a [Option<NodeMesh>],
}

impl Frame<'_> {
    /// Meshes to draw.
    pub fn draws(&self) -> impl Iterator<Item = (&NodeMesh, &crate::Drawn)> {
        self.selection.drawn.iter().filter_map(|d| Some((self.mesh(d.node)?, d)))
    }

    /// A node's mesh, if it is in memory.
    pub fn mesh(&self, node: NodeId) -> Option<&NodeMesh> {
        self.meshes.get(node.0 as usize)?.as_ref()
    }
}

impl Stream {
    /// Starts the reading threads, and reads the root so that there is something to draw from the first frame on.
    ///
    /// # Errors
    /// When the root cannot be read.
    pub fn new(store: impl Into<Arc<Store>>, mesh: Mesh, options: StreamOptions) -> Result<Self, HlodError> {
        let store = store.into();
        let nodes = store.tree().ids().len();
        let source = Arc::clone(&store);
        let read = move |node, into: &mut NodeMesh| source.read(node, mesh, into);
        let mut stream = Self {
            loader: Loader::new(options.threads, read),
            store,
            mesh,
            options,
            meshes: (0..nodes).map(|_| None).collect(),
            lru: Lru::new(nodes, options.memory_bytes),
            arrived: Vec::new(),
            broken: vec![false; nodes],
            failures: Vec::new(),
            came: Vec::new(),
            went: Vec::new(),
            begins: true,
            selector: Selector::new(),
            selection: Selection::default(),
            ahead: Vec::new(),
        };
        if let Some(root) = stream.store.tree().root() {
            let mut out = NodeMesh::default();
            stream.store.read(root, mesh, &mut out)?;
            // The root stays for good, whatever the budget.
            stream.lru.insert(root.0, out.bytes());
            stream.meshes[root.0 as usize] = Some(out);
            stream.came.push(root);
        }
        Ok(stream)
    }

    /// The store.
    pub fn store(&self) -> &Store {
        &self.store
    }

    /// Nodes that could not be read, since the last call. They are not asked for again.
    pub fn take_failures(&mut self) -> Vec<(NodeId, HlodError)> {
        std::mem::take(&mut self.failures)
    }

    /// Bytes of meshes in memory.
    pub fn cached_bytes(&self) -> u64 {
        self.lru.used()
    }

    /// Whether nothing is being loaded, and nothing waits to be taken in.
    pub fn is_idle(&self) -> bool {
        self.arrived.is_empty() && self.loader.is_idle()
    }

    /// Chooses what to draw from what is in memory, and asks for the rest. Never waits.
    pub fn frame(&mut self, camera: &Camera, options: &ViewOptions) -> Frame<'_> {
        // Still in the last frame: what it used does not make room.
        self.take_arrivals();
        self.lru.next_frame();
        let options = ViewOptions { mesh: self.mesh, ..*options };
        let Self { store, selector, selection, meshes, lru, broken, .. } = self;
        let tree = store.tree();
        if let Some(root) = tree.root() {
            lru.touch(root.0);
        }
        selector.select(tree, camera, &options, |n| meshes[n.0 as usize].is_some(), selection);
        for d in &selection.drawn {
            // What is above is needed again when this one goes.
            let mut at = Some(d.node);
            while let Some(node) = at.filter(|&n| !lru.was_touched(n.0)) {
                if meshes[node.0 as usize].is_some() {
                    lru.touch(node.0);
                }
                at = tree.parent(node);
            }
        }
        // Siblings wait for each other: what has come of a wanted family stays.
        for &wanted in &selection.wanted {
            let family = tree.parent(wanted).into_iter().flat_map(|p| tree.children(p));
            family.filter(|n| meshes[n.0 as usize].is_some()).for_each(|n| lru.touch(n.0));
        }
        // Bytes of what may be needed soon and is there already.
        let mut kept = 0;
        if let Some(ahead) = &self.options.prefetch {
            let is_there = |n: NodeId| {
                let there = meshes[n.0 as usize].is_some();
                kept += if there && !lru.was_touched(n.0) { tree.memory_bytes(n, options.mesh) } else { 0 };
                there
            };
            prefetch(tree, camera, &options, ahead, is_there, &mut self.ahead);
        }
        // What there would be no room for is not read, only to be thrown away and asked for again.
        let (mut room, urgent, arrived) = (lru.room(), selection.wanted.len(), &self.arrived);
        let asked = |&(i, n): &(usize, NodeId)| {
            // What comes early does not take the place of what else may be needed.
            let bytes = tree.memory_bytes(n, options.mesh) + if i < urgent { 0 } else { kept };
            let fits = bytes <= room;
            let waiting = arrived.iter().any(|a| a.0 == n);
            room -= if fits { tree.memory_bytes(n, options.mesh) } else { 0 };
            fits && !waiting && !broken[n.0 as usize]
        };
        let nodes = selection.wanted.iter().chain(&self.ahead).copied().enumerate();
        self.loader.request(nodes.filter(asked).map(|(_, n)| n), self.options.requests);
        Frame { selection, came: &self.came, went: &self.went, meshes }
    }

    /// Takes in what was read, as much as a frame may.
    fn take_arrivals(&mut self) {
        // The first frame tells of the root, which came before it.
        if !std::mem::take(&mut self.begins) {
            self.came.clear();
        }
        self.went.clear();
        self.loader.take(&mut self.arrived);
        let mut taken = 0;
        let mut count = 0;
        for (node, outcome) in &mut self.arrived {
            let size = outcome.as_ref().map_or(0, NodeMesh::bytes);
            if taken > 0 && taken + size > self.options.frame_bytes {
                break;
            }
            count += 1;
            taken += size;
            let Ok(new) = outcome.as_mut().map(std::mem::take) else { continue };
            let Self { meshes, lru, loader, went, came, .. } = self;
            let release = |old: u32| {
                if let Some(old_mesh) = meshes[old as usize].take() {
                    loader.recycle(old_mesh);
                    went.push(NodeId(old));
                }
            };
            if !lru.holds(node.0) && lru.make_room(size, release) {
                lru.insert(node.0, size);
                meshes[node.0 as usize] = Some(new);
                came.push(*node);
            } else {
                loader.recycle(new);
            }
        }
        for (node, outcome) in self.arrived.drain(..count) {
            if let Err(error) = outcome {
                self.broken[node.0 as usize] = true;
                self.failures.push((node, error));
            }
        }
    }
}
