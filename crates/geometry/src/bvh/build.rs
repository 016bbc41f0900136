//! Building a hierarchy by the surface-area heuristic in bins.

use super::{Bvh, BvhError, MAX_DEPTH, NONE, Node, Place, check};
use crate::bounds::DAabb;

/// Bins along the longest axis of the centres.
const BINS: usize = 16;
/// From this level on halves are equal, which leaves levels for two to the thirtieth objects.
const MEDIAN_DEPTH: usize = MAX_DEPTH - 32;

/// Objects that still have to be put under a node.
struct Task {
    start: usize,
    end: usize,
    parent: u32,
    side: usize,
    depth: usize,
}

impl Bvh {
    /// Builds a tree over the boxes; an object's id is its index. Objects with empty boxes are known but in no leaf.
    ///
    /// # Cost
    /// O(n log n).
    ///
    /// # Errors
    /// [`BvhError::Bounds`] for NaN, infinite and enormous boxes, [`BvhError::TooMany`] beyond 2³⁰ objects.
    pub fn build(boxes: &[DAabb]) -> Result<Self, BvhError> {
        if boxes.len() > 1 << 30 {
            return Err(BvhError::TooMany { objects: boxes.len() });
        }
        let mut objects = Vec::with_capacity(boxes.len());
        let mut places = vec![Place::Nowhere; boxes.len()];
        for (object, bounds) in boxes.iter().enumerate() {
            if check(object as u32, bounds)? {
                objects.push((object as u32, *bounds));
            }
        }
        let mut bvh = Self::default();
        bvh.nodes.reserve_exact((2 * objects.len()).saturating_sub(1));
        std::mem::swap(&mut bvh.places, &mut places);
        bvh.grow(&mut objects);
        Ok(bvh)
    }

    /// Builds the tree of the present objects anew; node ids change, object ids stay.
    ///
    /// # Cost
    /// As [`build`](Self::build).
    pub fn rebuild(&mut self) {
        let mut objects = Vec::with_capacity(self.places.len());
        for (object, place) in self.places.iter().enumerate() {
            if let Place::Leaf(leaf) = *place {
                objects.push((object as u32, self.nodes[leaf as usize].bounds));
            }
        }
        self.generation += 1;
        self.nodes.clear();
        self.free_nodes.clear();
        self.root = None;
        self.grow(&mut objects);
    }

    /// Makes the nodes, each before those below it and the left before the right.
    fn grow(&mut self, objects: &mut [(u32, DAabb)]) {
        if objects.is_empty() {
            return;
        }
        self.root = Some(0);
        let mut tasks = vec![Task { start: 0, end: objects.len(), parent: NONE, side: 0, depth: 0 }];
        while let Some(Task { start, end, parent, side, depth }) = tasks.pop() {
            let node = self.nodes.len() as u32;
            if parent != NONE {
                self.nodes[parent as usize].links[side] = node;
            }
            let range = &mut objects[start..end];
            let bounds = range.iter().fold(DAabb::EMPTY, |sum, (_, b)| sum.union(*b));
            let mut links = [NONE; 2];
            if let [(object, _)] = *range {
                links[1] = object;
                self.places[object as usize] = Place::Leaf(node);
            } else {
                let middle = start + split(range, depth);
                tasks.push(Task { start: middle, end, parent: node, side: 1, depth: depth + 1 });
                tasks.push(Task { start, end: middle, parent: node, side: 0, depth: depth + 1 });
                // Not a leaf, though the children are still to come.
                links[0] = 0;
            }
            self.nodes.push(Node { bounds, parent, links, height: 0 });
        }
        // Children come after their parents.
        for node in (0..self.nodes.len()).rev() {
            if !self.nodes[node].is_leaf() {
                let [a, b] = self.nodes[node].links.map(|child| self.nodes[child as usize].height);
                self.nodes[node].height = a.max(b) + 1;
            }
        }
    }
}

/// Orders the objects in two groups and returns the size of the first; neither is empty.
fn split(objects: &mut [(u32, DAabb)], depth: usize) -> usize {
    let centres = DAabb::from_points(objects.iter().map(|(_, b)| b.center()));
    let extent = centres.extent();
    let axis = if extent.x >= extent.y && extent.x >= extent.z {
        0
    } else if extent.y >= extent.z {
        1
    } else {
        2
    };
    let half = objects.len() / 2;
    if depth >= MEDIAN_DEPTH {
        // Ties by id keep the order independent of what came before.
        objects
            .sort_unstable_by(|a, b| a.1.center()[axis].total_cmp(&b.1.center()[axis]).then(a.0.cmp(&b.0)));
        return half;
    }
    let (low, width) = (centres.min[axis], extent[axis]);
    if width <= 0.0 {
        return half;
    }
    let bin_of = |b: &DAabb| (((b.center()[axis] - low) / width * BINS as f64) as usize).min(BINS - 1);
    let mut bins = [(0usize, DAabb::EMPTY); BINS];
    for (_, bounds) in objects.iter() {
        let bin = &mut bins[bin_of(bounds)];
        *bin = (bin.0 + 1, bin.1.union(*bounds));
    }
    let Some(border) = cheapest_border(&bins) else { return half };
    // A stable partition: the order of ids survives in both groups.
    let mut right = Vec::new();
    let mut left = 0;
    for i in 0..objects.len() {
        if bin_of(&objects[i].1) < border {
            objects[left] = objects[i];
            left += 1;
        } else {
            right.push(objects[i]);
        }
    }
    objects[left..].copy_from_slice(&right);
    left
}

/// The bin before which to cut, by area times count on both sides; `None` if all are in one bin.
fn cheapest_border(bins: &[(usize, DAabb); BINS]) -> Option<usize> {
    let mut right_costs = [0.0; BINS];
    let (mut count, mut bounds) = (0, DAabb::EMPTY);
    for i in (1..BINS).rev() {
        (count, bounds) = (count + bins[i].0, bounds.union(bins[i].1));
        right_costs[i] = if count == 0 { f64::INFINITY } else { bounds.area() * count as f64 };
    }
    let (mut count, mut bounds) = (0, DAabb::EMPTY);
    let mut best = None;
    for border in 1..BINS {
        (count, bounds) = (count + bins[border - 1].0, bounds.union(bins[border - 1].1));
        let cost = bounds.area() * count as f64 + right_costs[border];
        if count > 0 && cost.is_finite() && best.is_none_or(|(least, _)| cost < least) {
            best = Some((cost, border));
        }
    }
    best.map(|(_, border)| border)
}
