//! A hierarchy of object boxes for culling.
//!
//! One object per leaf, two children per inner node, small ids without gaps after a build, so that a caller can keep
//! state per node in a plain array. Built by the surface-area heuristic (SAH), kept up to date by refitting, inserting
//! and removing, with local rotations on the way up. Same calls, same tree.
//!
//! ```
//! use farsight_geometry::bvh::Bvh;
//! use farsight_geometry::{DAabb, glam::DVec3};
//!
//! let unit = |x: f64| DAabb::new(DVec3::new(x, 0.0, 0.0), DVec3::new(x + 1.0, 1.0, 1.0));
//! let mut bvh = Bvh::build(&[unit(0.0), unit(5.0), unit(9.0)])?;
//! let mut found = vec![];
//! bvh.overlaps(&unit(5.5), |object| found.push(object));
//! assert_eq!(found, [1]);
//!
//! bvh.set_bounds(1, unit(20.0))?;
//! bvh.overlaps(&unit(5.5), |object| panic!("object {object} has moved"));
//! # Ok::<(), farsight_geometry::bvh::BvhError>(())
//! ```

mod build;
mod update;

use crate::bounds::DAabb;
use crate::frustum::{Containment, Frustum};

/// Index of a node; stays the same until the node is removed or the tree is built anew.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeId(pub u32);

/// "No node".
const NONE: u32 = u32::MAX;

/// Largest absolute value of a coordinate; sums and products of areas stay finite up to here.
pub const MAX_COORDINATE: f64 = 1e100;

/// Most levels of a tree, root and leaves included. A tree that would grow beyond is built anew.
pub const MAX_DEPTH: usize = 64;

/// Why a box was refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BvhError {
    /// A coordinate is NaN, infinite or beyond [`MAX_COORDINATE`].
    #[error("the box of object {object} reaches from {} to {}; limit is ±{MAX_COORDINATE:e}", bounds.min, bounds.max)]
    Bounds {
        /// The object.
        object: u32,
        /// Its box.
        bounds: DAabb,
    },
    /// There is no such object.
    #[error("there is no object {object}")]
    NoSuchObject {
        /// The id asked for.
        object: u32,
    },
    /// Another number of boxes than of objects.
    #[error("{boxes} boxes for {objects} objects")]
    Count {
        /// Boxes given.
        boxes: usize,
        /// Objects there are, removed ones included.
        objects: usize,
    },
    /// More than 2³⁰ objects; with a leaf and an inner node each, more would not fit into 32-bit node ids.
    #[error("{objects} objects; at most 2^30 fit into 32-bit node ids")]
    TooMany {
        /// How many.
        objects: usize,
    },
}

/// Whether a walk goes on below a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Walk {
    /// To the children.
    Descend,
    /// Past everything below.
    Skip,
}

#[derive(Clone, Copy, Debug)]
struct Node {
    bounds: DAabb,
    parent: u32,
    /// Children, or `NONE` and the object.
    links: [u32; 2],
    /// Levels below: zero for a leaf.
    height: u32,
}

impl Node {
    #[inline]
    fn is_leaf(&self) -> bool {
        self.links[0] == NONE
    }
}

/// Where an object is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    /// In the leaf.
    Leaf(u32),
    /// Known, but with an empty box.
    Nowhere,
    /// Removed; its id is free.
    Removed,
}

/// The hierarchy. Objects are numbered in the order of the boxes that it was built from.
///
/// # Cost
/// 72 bytes a node, two nodes an object. Walks allocate nothing and need no stack.
#[derive(Clone, Debug, Default)]
pub struct Bvh {
    nodes: Vec<Node>,
    root: Option<u32>,
    places: Vec<Place>,
    free_nodes: Vec<u32>,
    free_objects: Vec<u32>,
    generation: u64,
}

impl Bvh {
    /// The top node; `None` when no object has a box.
    #[inline]
    pub fn root(&self) -> Option<NodeId> {
        self.root.map(NodeId)
    }

    /// How often node ids have been handed out anew, by [`rebuild`](Self::rebuild) or because an insertion made the tree too deep.
    #[inline]
    pub fn generation(&self) -> u64 {
        self.generation
    }

    /// One more than the largest node id; the length for an array of state per node.
    pub fn node_capacity(&self) -> usize {
        self.nodes.len()
    }

    /// One more than the largest object id.
    pub fn object_capacity(&self) -> usize {
        self.places.len()
    }

    /// Box of a node, around everything below it.
    ///
    /// # Panics
    /// When there is no such node; so do all methods that take one.
    #[inline]
    pub fn bounds(&self, node: NodeId) -> &DAabb {
        &self.nodes[node.0 as usize].bounds
    }

    /// The two children; `None` for a leaf.
    #[inline]
    pub fn children(&self, node: NodeId) -> Option<[NodeId; 2]> {
        let node = &self.nodes[node.0 as usize];
        (!node.is_leaf()).then(|| node.links.map(NodeId))
    }

    /// The node above; `None` for the root.
    pub fn parent(&self, node: NodeId) -> Option<NodeId> {
        Some(self.nodes[node.0 as usize].parent).filter(|p| *p != NONE).map(NodeId)
    }

    /// The object of a leaf; `None` for an inner node.
    #[inline]
    pub fn object(&self, node: NodeId) -> Option<u32> {
        let node = &self.nodes[node.0 as usize];
        node.is_leaf().then_some(node.links[1])
    }

    /// The leaf of an object; `None` when its box is empty or there is no such object.
    pub fn leaf_of(&self, object: u32) -> Option<NodeId> {
        match self.places.get(object as usize) {
            Some(&Place::Leaf(leaf)) => Some(NodeId(leaf)),
            _ => None,
        }
    }

    /// Objects at and below a node, from left to right.
    pub fn objects_below(&self, node: NodeId) -> impl Iterator<Item = u32> + '_ {
        let mut next = Some(node.0);
        std::iter::from_fn(move || {
            while let Some(current) = next {
                let n = &self.nodes[current as usize];
                if n.is_leaf() {
                    next = self.after(current, node.0);
                    return Some(n.links[1]);
                }
                next = Some(n.links[0]);
            }
            None
        })
    }

    /// Levels of the tree: zero when empty, one for a single leaf; never above [`MAX_DEPTH`].
    pub fn depth(&self) -> usize {
        self.root.map_or(0, |root| self.nodes[root as usize].height as usize + 1)
    }

    /// Expected number of nodes that a random long ray through the root's box meets, by surface area.
    ///
    /// What the build makes small; a tree whose cost has doubled since then is worth building anew.
    pub fn cost(&self) -> f64 {
        let Some(root) = self.root else { return 0.0 };
        let mut sum = 0.0;
        self.walk(|_, bounds| {
            sum += bounds.area();
            Walk::Descend
        });
        let whole = self.nodes[root as usize].bounds.area();
        if whole > 0.0 { sum / whole } else { 0.0 }
    }

    /// Visits nodes from the root, left before right, below those for which `enter` says so.
    pub fn walk(&self, mut enter: impl FnMut(NodeId, &DAabb) -> Walk) {
        let Some(root) = self.root else { return };
        let mut next = Some(root);
        while let Some(current) = next {
            let node = &self.nodes[current as usize];
            next = match enter(NodeId(current), &node.bounds) {
                Walk::Descend if !node.is_leaf() => Some(node.links[0]),
                _ => self.after(current, root),
            };
        }
    }

    /// The next node in order that is not below `node`, within the tree of `top`.
    fn after(&self, mut node: u32, top: u32) -> Option<u32> {
        while node != top {
            let parent = self.nodes[node as usize].parent;
            let [left, right] = self.nodes[parent as usize].links;
            if node == left {
                return Some(right);
            }
            node = parent;
        }
        None
    }

    /// Calls `found` for every object whose box meets `query`, surfaces included.
    pub fn overlaps(&self, query: &DAabb, mut found: impl FnMut(u32)) {
        self.walk(|node, bounds| {
            if !bounds.overlaps(query) {
                return Walk::Skip;
            }
            if let Some(object) = self.object(node) {
                found(object);
            }
            Walk::Descend
        });
    }

    /// Calls `found` for every object whose box is not certainly outside `frustum`, with where it lies.
    ///
    /// # Cost
    /// Nothing is tested below nodes that are wholly inside or outside.
    pub fn frustum(&self, frustum: &Frustum, mut found: impl FnMut(u32, Containment)) {
        self.walk(|node, bounds| match frustum.classify(bounds) {
            Containment::Outside => Walk::Skip,
            Containment::Inside => {
                self.objects_below(node).for_each(|object| found(object, Containment::Inside));
                Walk::Skip
            }
            Containment::Crossing => {
                if let Some(object) = self.object(node) {
                    found(object, Containment::Crossing);
                }
                Walk::Descend
            }
        });
    }
}

/// Refuses what areas and comparisons could not deal with; `false` for an empty box.
fn check(object: u32, bounds: &DAabb) -> Result<bool, BvhError> {
    if bounds.min.is_nan() || bounds.max.is_nan() {
        return Err(BvhError::Bounds { object, bounds: *bounds });
    }
    if bounds.is_empty() {
        return Ok(false);
    }
    if bounds.min.abs().max(bounds.max.abs()).max_element() > MAX_COORDINATE {
        return Err(BvhError::Bounds { object, bounds: *bounds });
    }
    Ok(true)
}
