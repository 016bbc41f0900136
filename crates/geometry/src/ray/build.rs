//! The builder: binned surface-area heuristic straight to eight children.

use super::tree::{BLOCK, Block, MAX_DEPTH, Node, Tree, WIDTH};
use crate::bounds::Aabb;
use glam::{Vec3, Vec3A};
use std::ops::Range;

/// Bins per axis.
const BINS: usize = 32;

/// Below this many levels the builder halves by count instead, which bounds the depth of any input:
/// 8^11 exceeds 2^32.
const SAH_DEPTH: usize = MAX_DEPTH - 12;

/// Subtrees with more items are built in parallel.
#[cfg(feature = "rayon")]
const PARALLEL: usize = 1 << 13;

/// Something with a box.
#[derive(Clone, Copy, Debug)]
pub(super) struct Item {
    pub(super) min: Vec3A,
    pub(super) max: Vec3A,
    pub(super) id: u32,
}

impl Item {
    pub(super) fn new(id: u32, bounds: &Aabb) -> Self {
        Self { min: bounds.min.into(), max: bounds.max.into(), id }
    }

    /// Twice the centre.
    #[inline(always)]
    fn centre(&self) -> Vec3A {
        self.min + self.max
    }
}

#[derive(Clone, Copy, Debug)]
struct Bounds {
    min: Vec3A,
    max: Vec3A,
}

impl Bounds {
    const EMPTY: Self = Self { min: Vec3A::INFINITY, max: Vec3A::NEG_INFINITY };

    #[inline(always)]
    fn add(&mut self, min: Vec3A, max: Vec3A) {
        self.min = self.min.min(min);
        self.max = self.max.max(max);
    }

    #[inline(always)]
    fn half_area(&self) -> f32 {
        let e = self.max - self.min;
        e.x * e.y + e.y * e.z + e.z * e.x
    }

    fn aabb(&self) -> Aabb {
        Aabb::new(Vec3::from(self.min), Vec3::from(self.max))
    }
}

/// A range of items, around what they span and around their centres.
#[derive(Clone, Debug)]
struct Part {
    items: Range<usize>,
    bounds: Bounds,
    centres: Bounds,
}

impl Part {
    fn of(items: &[Item], range: Range<usize>) -> Self {
        let (mut bounds, mut centres) = (Bounds::EMPTY, Bounds::EMPTY);
        for item in &items[range.clone()] {
            bounds.add(item.min, item.max);
            centres.add(item.centre(), item.centre());
        }
        Self { items: range, bounds, centres }
    }
}

/// What a group of at most [`Leaves::SIZE`] items becomes.
pub(super) trait Leaves: Sync {
    /// Most items in one leaf.
    const SIZE: usize;

    /// Appends the leaf to `blocks` and returns the child entry, with block numbers counted from the vector's start.
    fn leaf(&self, items: &mut [Item], blocks: &mut Vec<Block>) -> u32;
}

/// Leaves of triangle blocks.
pub(super) struct Triangles<F>(pub(super) F);

impl<F: Fn(u32) -> [Vec3; 3] + Sync> Leaves for Triangles<F> {
    const SIZE: usize = WIDTH;

    fn leaf(&self, items: &mut [Item], blocks: &mut Vec<Block>) -> u32 {
        // Within a block the lowest id comes first, as ties go to it.
        items.sort_unstable_by_key(|item| item.id);
        blocks.push(Block::new(items.iter().map(|item| (item.id, self.0(item.id)))));
        BLOCK | (blocks.len() - 1) as u32
    }
}

/// Leaves that are the items themselves.
pub(super) struct Single;

impl Leaves for Single {
    const SIZE: usize = 1;

    fn leaf(&self, items: &mut [Item], _: &mut Vec<Block>) -> u32 {
        BLOCK | items[0].id
    }
}

/// Builds the tree of `items`. The same bytes for any number of threads.
pub(super) fn build<L: Leaves>(mut items: Vec<Item>, leaves: &L) -> Tree {
    if items.is_empty() {
        return Tree::default();
    }
    let mut tree = Tree::default();
    let all = Part::of(&items, 0..items.len());
    tree.bounds = Some(all.bounds.aabb());
    node(&mut items, all, 0, leaves, &mut tree);
    tree
}

/// Appends the subtree of a part and returns its node.
fn node<L: Leaves>(items: &mut [Item], part: Part, depth: usize, leaves: &L, tree: &mut Tree) -> u32 {
    let parts = children(items, part, depth, L::SIZE);
    let index = tree.nodes.len();
    tree.nodes.push(Node::EMPTY);
    #[cfg(feature = "rayon")]
    if items.len() > PARALLEL {
        parallel::children(items, &parts, depth, leaves, tree, index);
        return index as u32;
    }
    for (lane, part) in parts.iter().enumerate() {
        let own = &mut items[part.items.clone()];
        let child = child(own, part, depth, leaves, tree);
        tree.nodes[index].set(lane, &part.bounds.aabb(), child);
    }
    index as u32
}

fn child<L: Leaves>(own: &mut [Item], part: &Part, depth: usize, leaves: &L, tree: &mut Tree) -> u32 {
    if own.len() <= L::SIZE {
        return leaves.leaf(own, &mut tree.blocks);
    }
    let part = Part { items: 0..own.len(), ..part.clone() };
    node(own, part, depth + 1, leaves, tree)
}

/// Splits a part into up to eight, always opening the one with the largest surface.
fn children(items: &mut [Item], part: Part, depth: usize, leaf: usize) -> Vec<Part> {
    let mut parts = Vec::with_capacity(WIDTH);
    parts.push(part);
    while parts.len() < WIDTH {
        let open = (0..parts.len()).filter(|&i| parts[i].items.len() > leaf);
        // The first of the largest; by count where the builder has given up on areas.
        let size = |p: &Part| if depth < SAH_DEPTH { p.bounds.half_area() } else { p.items.len() as f32 };
        let Some(i) = open.reduce(|a, b| if size(&parts[b]) > size(&parts[a]) { b } else { a }) else {
            break;
        };
        let (left, right) = split(items, &parts[i], depth, leaf);
        parts[i] = left;
        parts.push(right);
    }
    parts
}

fn split(items: &mut [Item], part: &Part, depth: usize, leaf: usize) -> (Part, Part) {
    let best = if depth < SAH_DEPTH { best_plane(&items[part.items.clone()], part, leaf) } else { None };
    match best {
        Some(plane) => partition(items, part, &plane),
        None => {
            // A whole number of full leaves on the left.
            let half = part.items.len().div_ceil(2).next_multiple_of(leaf).min(part.items.len() - 1);
            let middle = part.items.start + half;
            (Part::of(items, part.items.start..middle), Part::of(items, middle..part.items.end))
        }
    }
}

/// Maps centres to bins.
#[derive(Clone, Copy, Debug)]
struct Binning {
    origin: Vec3A,
    per_unit: Vec3A,
    last: u32,
}

impl Binning {
    fn new(centres: &Bounds, bins: usize) -> Self {
        let extent = centres.max - centres.min;
        // The factor keeps the largest centre in the last bin; an axis without extent has one bin.
        let per_unit = |e: f32| if e > f32::MIN_POSITIVE * 64.0 { bins as f32 * 0.999_99 / e } else { 0.0 };
        let per_unit = Vec3A::new(per_unit(extent.x), per_unit(extent.y), per_unit(extent.z));
        Self { origin: centres.min, per_unit, last: bins as u32 - 1 }
    }

    #[inline(always)]
    fn bin(&self, centre: Vec3A) -> [usize; 3] {
        let b = ((centre - self.origin) * self.per_unit).to_array();
        b.map(|x| (x as i32 as u32).min(self.last) as usize & (BINS - 1))
    }
}

/// A plane between two bins.
struct Plane {
    binning: Binning,
    axis: usize,
    /// First bin on the right.
    bin: usize,
    left: Bounds,
    right: Bounds,
}

#[derive(Clone, Copy)]
struct Bin {
    bounds: Bounds,
    count: u32,
}

/// The plane with the least cost: area times the number of leaves that the items fill at best.
fn best_plane(items: &[Item], part: &Part, leaf: usize) -> Option<Plane> {
    match items.len() {
        0..=32 => best_plane_of::<8>(items, part, leaf),
        33..=256 => best_plane_of::<16>(items, part, leaf),
        _ => best_plane_of::<BINS>(items, part, leaf),
    }
}

fn best_plane_of<const N: usize>(items: &[Item], part: &Part, leaf: usize) -> Option<Plane> {
    let binning = Binning::new(&part.centres, N);
    let mut bins = [[Bin { bounds: Bounds::EMPTY, count: 0 }; N]; 3];
    for item in items {
        let [x, y, z] = binning.bin(item.centre());
        for (axis, bin) in [x, y, z].into_iter().enumerate() {
            let bin = &mut bins[axis][bin & (N - 1)];
            bin.bounds.add(item.min, item.max);
            bin.count += 1;
        }
    }
    let leaves = |count: u32| count.div_ceil(leaf as u32) as f32;
    let mut best: Option<(f32, Plane)> = None;
    for axis in 0..3 {
        if binning.per_unit[axis] == 0.0 {
            continue;
        }
        let bins = &bins[axis];
        let mut right_of = [Bounds::EMPTY; N];
        let mut right = Bounds::EMPTY;
        for i in (1..N).rev() {
            right.add(bins[i].bounds.min, bins[i].bounds.max);
            right_of[i] = right;
        }
        let (mut left, mut count) = (Bounds::EMPTY, 0);
        for i in 1..N {
            left.add(bins[i - 1].bounds.min, bins[i - 1].bounds.max);
            count += bins[i - 1].count;
            let rest = items.len() as u32 - count;
            if count == 0 || rest == 0 || bins[i - 1].count == 0 {
                continue;
            }
            let cost = left.half_area() * leaves(count) + right_of[i].half_area() * leaves(rest);
            if best.as_ref().is_none_or(|(least, _)| cost < *least) {
                best = Some((cost, Plane { binning, axis, bin: i, left, right: right_of[i] }));
            }
        }
    }
    best.map(|(_, plane)| plane)
}

/// Moves the items left of the plane to the front.
fn partition(items: &mut [Item], part: &Part, plane: &Plane) -> (Part, Part) {
    let (mut i, mut end) = (part.items.start, part.items.end);
    let (mut left, mut right) = (Bounds::EMPTY, Bounds::EMPTY);
    while i < end {
        let centre = items[i].centre();
        if plane.binning.bin(centre)[plane.axis] < plane.bin {
            left.add(centre, centre);
            i += 1;
        } else {
            right.add(centre, centre);
            end -= 1;
            items.swap(i, end);
        }
    }
    (
        Part { items: part.items.start..i, bounds: plane.left, centres: left },
        Part { items: i..part.items.end, bounds: plane.right, centres: right },
    )
}

#[cfg(feature = "rayon")]
mod parallel {
    use super::*;
    use rayon::prelude::*;

    /// Builds each child on its own and appends them in order: the layout of the serial build.
    pub(super) fn children<L: Leaves>(
        items: &mut [Item],
        parts: &[Part],
        depth: usize,
        leaves: &L,
        tree: &mut Tree,
        index: usize,
    ) {
        let mut jobs = Vec::with_capacity(parts.len());
        let mut order: Vec<usize> = (0..parts.len()).collect();
        order.sort_by_key(|&i| parts[i].items.start);
        let mut rest = items;
        for i in order {
            let (own, after) = rest.split_at_mut(parts[i].items.len());
            jobs.push((i, own));
            rest = after;
        }
        jobs.sort_by_key(|job| job.0);
        let subtrees: Vec<(u32, Tree)> = jobs
            .into_par_iter()
            .map(|(i, own)| {
                let mut tree = Tree::default();
                (child(own, &parts[i], depth, leaves, &mut tree), tree)
            })
            .collect();
        for (lane, (child, subtree)) in subtrees.into_iter().enumerate() {
            let (nodes, blocks) = (tree.nodes.len() as u32, tree.blocks.len() as u32);
            let move_child = |c: u32| if c & BLOCK == 0 { c + nodes } else { moved_leaf::<L>(c, blocks) };
            tree.nodes[index].set(lane, &parts[lane].bounds.aabb(), move_child(child));
            tree.nodes.extend(subtree.nodes.into_iter().map(|mut node| {
                for child in used(&mut node) {
                    *child = move_child(*child);
                }
                node
            }));
            tree.blocks.extend(subtree.blocks);
        }
    }

    fn moved_leaf<L: Leaves>(child: u32, blocks: u32) -> u32 {
        if L::SIZE == 1 { child } else { child + blocks }
    }

    fn used(node: &mut Node) -> impl Iterator<Item = &mut u32> {
        let lower = node.bounds[0][0];
        let upper = node.bounds[0][1];
        node.children.iter_mut().enumerate().filter(move |(i, _)| lower[*i] <= upper[*i]).map(|(_, c)| c)
    }
}
