//! What the traversal needs to know of the caller's tree.

use farsight_geometry::DAabb;
use farsight_geometry::bvh::{Bvh, NodeId};

/// A tree of boxes. Ids should be dense: state is kept in arrays as long as the largest id.
///
/// The tree may change between frames in any way, ids may be reused; see [`generation`](Self::generation).
///
/// ```
/// use farsight_geometry::{DAabb, bvh::NodeId, glam::DVec3};
/// use farsight_occlusion::Hierarchy;
///
/// /// A row of boxes below one root.
/// struct Row(Vec<DAabb>);
///
/// impl Hierarchy for Row {
///     fn root(&self) -> Option<NodeId> {
///         (!self.0.is_empty()).then_some(NodeId(0))
///     }
///     fn bounds(&self, node: NodeId) -> DAabb {
///         match node.0 {
///             0 => self.0.iter().fold(DAabb::EMPTY, |all, b| all.union(*b)),
///             n => self.0[n as usize - 1],
///         }
///     }
///     fn child(&self, node: NodeId, index: u32) -> Option<NodeId> {
///         (node.0 == 0 && (index as usize) < self.0.len()).then(|| NodeId(index + 1))
///     }
/// }
/// ```
pub trait Hierarchy {
    /// The top node; `None` for an empty tree.
    fn root(&self) -> Option<NodeId>;

    /// A box around everything at and below a node. An empty box is never drawn; one with NaN or infinity is always
    /// drawn.
    fn bounds(&self, node: NodeId) -> DAabb;

    /// The child with an index that counts from zero; `None` past the last one. A node without children is a leaf: what
    /// the caller draws as a whole.
    fn child(&self, node: NodeId, index: u32) -> Option<NodeId>;

    /// Another number whenever ids have been handed out anew, so that history is dropped. History that is kept for the
    /// wrong node costs time under [`Policy::Exact`](crate::Policy::Exact), and never pixels.
    fn generation(&self) -> u64 {
        0
    }
}

impl Hierarchy for Bvh {
    fn root(&self) -> Option<NodeId> {
        Bvh::root(self)
    }

    #[inline]
    fn bounds(&self, node: NodeId) -> DAabb {
        *Bvh::bounds(self, node)
    }

    #[inline]
    fn child(&self, node: NodeId, index: u32) -> Option<NodeId> {
        self.children(node)?.get(index as usize).copied()
    }

    fn generation(&self) -> u64 {
        Bvh::generation(self)
    }
}

/// A [`Bvh`] whose leaves hold several objects: fewer queries and draw calls, coarser culling.
///
/// ```
/// use farsight_geometry::{DAabb, bvh::Bvh, glam::DVec3};
/// use farsight_occlusion::{Grouped, Hierarchy};
///
/// let boxes: Vec<_> = (0..8).map(|i| DAabb::from_points([DVec3::splat(f64::from(i))]).inflated(0.4)).collect();
/// let bvh = Bvh::build(&boxes)?;
/// let grouped = Grouped::new(&bvh, 8);
/// let root = grouped.root().unwrap();
/// assert!(grouped.child(root, 0).is_none());
/// assert_eq!(bvh.objects_below(root).count(), 8);
/// # Ok::<(), farsight_geometry::bvh::BvhError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Grouped<'a> {
    bvh: &'a Bvh,
    is_leaf: Vec<bool>,
}

impl<'a> Grouped<'a> {
    /// Makes the highest nodes with at most `objects` below them leaves.
    ///
    /// # Cost
    /// O(nodes · depth of the leaves) time, a byte a node.
    pub fn new(bvh: &'a Bvh, objects: usize) -> Self {
        let mut is_leaf = vec![false; bvh.node_capacity()];
        bvh.walk(|node, _| {
            let few = bvh.objects_below(node).take(objects.saturating_add(1)).count() <= objects.max(1);
            is_leaf[node.0 as usize] = few;
            if few { farsight_geometry::bvh::Walk::Skip } else { farsight_geometry::bvh::Walk::Descend }
        });
        Self { bvh, is_leaf }
    }
}

impl Hierarchy for Grouped<'_> {
    fn root(&self) -> Option<NodeId> {
        self.bvh.root()
    }

    fn bounds(&self, node: NodeId) -> DAabb {
        *self.bvh.bounds(node)
    }

    fn child(&self, node: NodeId, index: u32) -> Option<NodeId> {
        if self.is_leaf[node.0 as usize] { None } else { Hierarchy::child(self.bvh, node, index) }
    }

    fn generation(&self) -> u64 {
        self.bvh.generation()
    }
}
