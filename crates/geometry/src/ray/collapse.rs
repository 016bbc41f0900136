//! From a binary tree to one with eight children per node, at least expected cost.
//!
//! Dynamic programming over the binary tree (Ylitie, Karras, Laine 2017, sec. 3): the cost of the best forest of at most
//! `j` roots below each binary node follows from the forests of its two children.

use super::build::{Bounds, Item};
use super::tree::{BLOCK, MAX_DEPTH, Node, WIDTH};
use crate::bounds::DAabb;

/// Cost of testing eight boxes against that of eight triangles.
const NODE_COST: f32 = 1.0;
const LEAF_COST: f32 = 1.0;

/// A node of the binary tree over `items[start..end]`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Binary {
    pub(super) bounds: Bounds,
    pub(super) start: u32,
    pub(super) end: u32,
    /// Indices of the children, which come after this node; zero in a leaf.
    pub(super) children: [u32; 2],
    /// Cost of the best forest with at most `j + 1` roots.
    cost: [f32; WIDTH - 1],
    /// How many of `j + 1` roots lie on the left; zero: the forest with one root less is as good.
    left_roots: [u8; WIDTH],
    is_leaf: bool,
}

impl Binary {
    pub(super) fn new(bounds: Bounds, start: u32, end: u32) -> Self {
        let (cost, left_roots) = ([0.0; WIDTH - 1], [0; WIDTH]);
        Self { bounds, start, end, children: [0; 2], cost, left_roots, is_leaf: false }
    }
}

/// Computes the costs of node `index`, whose children have theirs. Leaves hold up to `leaf` items.
pub(super) fn price(nodes: &mut [Binary], index: usize, leaf: u32) {
    let node = nodes[index];
    let area = node.bounds.half_area();
    let as_leaf = if node.end - node.start <= leaf { area * LEAF_COST } else { f32::INFINITY };
    let out = &mut nodes[index];
    if node.children == [0; 2] {
        (out.cost, out.is_leaf) = ([as_leaf; WIDTH - 1], true);
        return;
    }
    let [left, right] = node.children.map(|c| nodes[c as usize].cost);
    let mut best = [(f32::INFINITY, 0u8); WIDTH];
    for j in 1..WIDTH {
        for k in 0..j {
            let cost = left[k] + right[j - 1 - k];
            if cost < best[j].0 {
                best[j] = (cost, k as u8 + 1);
            }
        }
    }
    let out = &mut nodes[index];
    let inner = best[WIDTH - 1].0 + area * NODE_COST;
    out.is_leaf = as_leaf <= inner;
    out.cost[0] = as_leaf.min(inner);
    for j in 1..WIDTH {
        let (cost, roots) = best[j];
        if j == WIDTH - 1 {
            out.left_roots[j] = roots;
        } else if cost < out.cost[j - 1] {
            (out.cost[j], out.left_roots[j]) = (cost, roots);
        } else {
            out.cost[j] = out.cost[j - 1];
        }
    }
}

/// A tree of eight children per node. Leaf `i`, entered in nodes as `BLOCK | i`, holds `items[leaves[i]]`.
#[derive(Debug, Default)]
pub(super) struct Wide {
    pub(super) nodes: Vec<Node>,
    pub(super) leaves: Vec<[u32; 2]>,
    pub(super) items: Vec<Item>,
    pub(super) bounds: Option<DAabb>,
}

impl Wide {
    /// Collapses a priced tree. Gives the items back when it is deeper than walks allow.
    pub(super) fn collapse(binary: &[Binary], items: Vec<Item>) -> Result<Self, Vec<Item>> {
        let Some(root) = binary.first() else { return Ok(Self::default()) };
        let bounds = root.bounds.aabb();
        let bounds = Some(DAabb::new(bounds.min.as_dvec3(), bounds.max.as_dvec3()));
        let mut wide = Self { items, bounds, ..Self::default() };
        if wide.node(binary, 0, 1) { Ok(wide) } else { Err(wide.items) }
    }

    /// Appends the subtree of a binary node; false when it is too deep.
    fn node(&mut self, binary: &[Binary], index: u32, depth: usize) -> bool {
        if depth > MAX_DEPTH {
            return false;
        }
        let mut roots = Roots { nodes: [0; WIDTH], count: 0 };
        roots.gather(binary, index, WIDTH);
        let own = self.nodes.len();
        self.nodes.push(Node::EMPTY);
        for lane in 0..roots.count {
            let root = &binary[roots.nodes[lane] as usize];
            let child = if root.is_leaf {
                self.leaves.push([root.start, root.end]);
                BLOCK | (self.leaves.len() - 1) as u32
            } else {
                self.nodes.len() as u32
            };
            self.nodes[own].set(lane, &root.bounds.aabb(), child);
            if !root.is_leaf && !self.node(binary, roots.nodes[lane], depth + 1) {
                return false;
            }
        }
        true
    }
}

struct Roots {
    nodes: [u32; WIDTH],
    count: usize,
}

impl Roots {
    /// The best forest of at most `most` roots below a node.
    fn gather(&mut self, binary: &[Binary], index: u32, most: usize) {
        let node = &binary[index as usize];
        // A node that stays whole: a leaf, or a single root.
        if node.children == [0; 2] || most == 1 {
            self.nodes[self.count] = index;
            self.count += 1;
            return;
        }
        let left = node.left_roots[most - 1] as usize;
        if left == 0 {
            self.gather(binary, index, most - 1);
            return;
        }
        self.gather(binary, node.children[0], left);
        self.gather(binary, node.children[1], most - left);
    }
}
