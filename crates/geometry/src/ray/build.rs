//! The builder: a binary tree by the binned surface-area heuristic, then collapsed to eight children.

use super::collapse::{Binary, Wide, price};
use crate::bounds::Aabb;
use glam::{Vec3, Vec3A};
use std::ops::Range;

/// Bins per axis.
const BINS: usize = 32;

/// Binary levels below which the builder halves by count, so that recursion stays shallow for any input.
const SAH_DEPTH: usize = 96;

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
pub(super) struct Bounds {
    pub(super) min: Vec3A,
    pub(super) max: Vec3A,
}

impl Bounds {
    const EMPTY: Self = Self { min: Vec3A::INFINITY, max: Vec3A::NEG_INFINITY };

    #[inline(always)]
    fn add(&mut self, min: Vec3A, max: Vec3A) {
        self.min = self.min.min(min);
        self.max = self.max.max(max);
    }

    #[inline(always)]
    pub(super) fn half_area(&self) -> f32 {
        let e = self.max - self.min;
        e.x * e.y + e.y * e.z + e.z * e.x
    }

    pub(super) fn aabb(&self) -> Aabb {
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

/// Builds the tree of `items` with up to `leaf` items in a leaf. The same bytes for any number of threads.
pub(super) fn build(items: Vec<Item>, leaf: usize) -> Wide {
    let built = halved_below(items, leaf, SAH_DEPTH);
    // Inputs made to unbalance areas end here: halving by count is never deep.
    built.or_else(|items| halved_below(items, leaf, 0)).unwrap_or_default()
}

fn halved_below(mut items: Vec<Item>, leaf: usize, sah_depth: usize) -> Result<Wide, Vec<Item>> {
    let mut binary = Vec::with_capacity(items.len() / leaf.max(2));
    if !items.is_empty() {
        let all = Part::of(&items, 0..items.len());
        subtree(&mut items, 0, all, sah_depth, leaf, &mut binary);
    }
    Wide::collapse(&binary, items)
}

/// Appends the priced binary subtree over `items`, which begin at `first` of all items. Surface areas decide for
/// `sah_depth` more levels.
fn subtree(items: &mut [Item], first: u32, part: Part, sah_depth: usize, leaf: usize, out: &mut Vec<Binary>) {
    let index = out.len();
    let count = items.len();
    out.push(Binary::new(part.bounds, first, first + count as u32));
    // Leaves are first made half as large, so that the collapse may choose how to fill them.
    if count > (leaf / 2).max(1) {
        let (left, right) = split(items, &part, sah_depth > 0, leaf);
        let deeper = sah_depth.saturating_sub(1);
        let (own, others) = items.split_at_mut(left.items.len());
        let middle = first + own.len() as u32;
        let right = Part { items: 0..others.len(), ..right };
        let left_index = out.len();
        #[cfg(feature = "rayon")]
        if count > PARALLEL {
            let (mut a, mut b) = (Vec::new(), Vec::new());
            rayon::join(
                || subtree(own, first, left, deeper, leaf, &mut a),
                || subtree(others, middle, right, deeper, leaf, &mut b),
            );
            let right_index = left_index + a.len();
            append(out, a);
            append(out, b);
            out[index].children = [left_index as u32, right_index as u32];
            price(out, index, leaf as u32);
            return;
        }
        subtree(own, first, left, deeper, leaf, out);
        let right_index = out.len();
        subtree(others, middle, right, deeper, leaf, out);
        out[index].children = [left_index as u32, right_index as u32];
    }
    price(out, index, leaf as u32);
}

#[cfg(feature = "rayon")]
fn append(out: &mut Vec<Binary>, subtree: Vec<Binary>) {
    let offset = out.len() as u32;
    out.extend(subtree.into_iter().map(|mut node| {
        if node.children != [0; 2] {
            node.children = [node.children[0] + offset, node.children[1] + offset];
        }
        node
    }));
}

fn split(items: &mut [Item], part: &Part, by_area: bool, leaf: usize) -> (Part, Part) {
    let best = if by_area { best_plane(&items[part.items.clone()], part, leaf) } else { None };
    match best {
        Some(plane) => partition(items, part, &plane),
        None => {
            // Full leaves on the left where there is more than one.
            let half = part.items.len().div_ceil(2);
            let half = if part.items.len() > leaf { half.next_multiple_of(leaf) } else { half };
            let middle = part.items.start + half.min(part.items.len() - 1);
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
