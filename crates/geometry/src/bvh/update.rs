//! Moving, inserting and removing objects.

use super::{Bvh, BvhError, MAX_DEPTH, NONE, Node, Place, check};
use crate::bounds::DAabb;

impl Bvh {
    /// Gives an object another box and makes the boxes above fit.
    ///
    /// # Cost
    /// O(depth); nothing is allocated unless the box was empty before. The tree keeps its shape: objects that travel far
    /// are better removed and inserted.
    ///
    /// # Errors
    /// [`BvhError::NoSuchObject`], [`BvhError::Bounds`]; the tree is then as before.
    pub fn set_bounds(&mut self, object: u32, bounds: DAabb) -> Result<(), BvhError> {
        let place = self.place(object)?;
        let solid = check(object, &bounds)?;
        match (place, solid) {
            (Place::Leaf(leaf), true) => {
                self.nodes[leaf as usize].bounds = bounds;
                self.refit_above(leaf);
            }
            (Place::Leaf(leaf), false) => {
                self.detach(leaf);
                self.places[object as usize] = Place::Nowhere;
            }
            (_, true) => self.attach(object, bounds),
            (_, false) => {}
        }
        Ok(())
    }

    /// Gives all objects new boxes, in the order of their ids; those of removed objects are not looked at.
    ///
    /// # Cost
    /// O(n); nothing is allocated unless boxes were empty before.
    ///
    /// # Errors
    /// [`BvhError::Count`], [`BvhError::Bounds`]; the tree is then as before.
    pub fn refit(&mut self, boxes: &[DAabb]) -> Result<(), BvhError> {
        if boxes.len() != self.places.len() {
            return Err(BvhError::Count { boxes: boxes.len(), objects: self.places.len() });
        }
        for (object, bounds) in boxes.iter().enumerate() {
            if self.places[object] != Place::Removed {
                check(object as u32, bounds)?;
            }
        }
        for (object, bounds) in boxes.iter().enumerate() {
            match self.places[object] {
                Place::Removed => {}
                Place::Leaf(leaf) if !bounds.is_empty() => self.nodes[leaf as usize].bounds = *bounds,
                _ => self.set_bounds(object as u32, *bounds)?,
            }
        }
        // Leaves first: climb from each right child once both sides are done.
        let Some(root) = self.root else { return Ok(()) };
        let mut next = Some(self.leftmost(root));
        while let Some(node) = next {
            if !self.nodes[node as usize].is_leaf() {
                self.pull(node);
            }
            next = if node == root { None } else { Some(self.after_below(node)) };
        }
        Ok(())
    }

    /// Adds an object and returns its id: that of a removed one, or the next.
    ///
    /// # Cost
    /// O(depth) time; allocates only when there are more objects than ever before.
    ///
    /// # Errors
    /// [`BvhError::Bounds`], [`BvhError::TooMany`].
    pub fn insert(&mut self, bounds: DAabb) -> Result<u32, BvhError> {
        let fresh = self.places.len();
        let object = self.free_objects.last().copied().unwrap_or(fresh as u32);
        let solid = check(object, &bounds)?;
        if self.free_objects.pop().is_none() {
            if fresh >= 1 << 30 {
                return Err(BvhError::TooMany { objects: fresh + 1 });
            }
            self.places.push(Place::Nowhere);
        }
        self.places[object as usize] = Place::Nowhere;
        if solid {
            self.attach(object, bounds);
        }
        Ok(object)
    }

    /// Removes an object; its id is free for the next one.
    ///
    /// # Cost
    /// O(depth).
    ///
    /// # Errors
    /// [`BvhError::NoSuchObject`].
    pub fn remove(&mut self, object: u32) -> Result<(), BvhError> {
        if let Place::Leaf(leaf) = self.place(object)? {
            self.detach(leaf);
        }
        self.places[object as usize] = Place::Removed;
        self.free_objects.push(object);
        Ok(())
    }

    fn place(&self, object: u32) -> Result<Place, BvhError> {
        match self.places.get(object as usize) {
            None | Some(Place::Removed) => Err(BvhError::NoSuchObject { object }),
            Some(&place) => Ok(place),
        }
    }

    fn new_node(&mut self, node: Node) -> u32 {
        match self.free_nodes.pop() {
            Some(id) => {
                self.nodes[id as usize] = node;
                id
            }
            None => {
                self.nodes.push(node);
                self.nodes.len() as u32 - 1
            }
        }
    }

    fn attach(&mut self, object: u32, bounds: DAabb) {
        let leaf = self.new_node(Node { bounds, parent: NONE, links: [NONE, object], height: 0 });
        self.places[object as usize] = Place::Leaf(leaf);
        let Some(root) = self.root else {
            self.root = Some(leaf);
            return;
        };
        let sibling = self.best_sibling(root, &bounds);
        let above = self.nodes[sibling as usize].parent;
        let inner = Node { bounds, parent: above, links: [sibling, leaf], height: 0 };
        let inner = self.new_node(inner);
        self.nodes[sibling as usize].parent = inner;
        self.nodes[leaf as usize].parent = inner;
        self.replace(above, sibling, inner);
        self.repair(inner);
        if self.depth() > MAX_DEPTH {
            self.rebuild();
        }
    }

    fn detach(&mut self, leaf: u32) {
        let parent = self.nodes[leaf as usize].parent;
        self.free_nodes.push(leaf);
        if parent == NONE {
            self.root = None;
            return;
        }
        let [a, b] = self.nodes[parent as usize].links;
        let sibling = if a == leaf { b } else { a };
        let above = self.nodes[parent as usize].parent;
        self.nodes[sibling as usize].parent = above;
        self.replace(above, parent, sibling);
        self.free_nodes.push(parent);
        if above != NONE {
            self.repair(above);
        }
    }

    /// Puts `new` where `parent` (or the root) had `old`.
    fn replace(&mut self, parent: u32, old: u32, new: u32) {
        if parent == NONE {
            self.root = Some(new);
            return;
        }
        let links = &mut self.nodes[parent as usize].links;
        links[usize::from(links[1] == old)] = new;
    }

    /// The node next to which a box costs least area, found by going down greedily.
    fn best_sibling(&self, root: u32, bounds: &DAabb) -> u32 {
        let mut node = root;
        loop {
            let current = &self.nodes[node as usize];
            if current.is_leaf() {
                return node;
            }
            let grown = current.bounds.union(*bounds).area();
            let here = 2.0 * grown;
            // Every box above the final place grows; that is paid whichever child is taken.
            let passed_on = 2.0 * (grown - current.bounds.area());
            let cost = |child: u32| {
                let child = &self.nodes[child as usize];
                let grown = child.bounds.union(*bounds).area();
                passed_on + if child.is_leaf() { grown } else { grown - child.bounds.area() }
            };
            let [a, b] = current.links;
            let (cost_a, cost_b) = (cost(a), cost(b));
            if here < cost_a && here < cost_b {
                return node;
            }
            let fills = |child: u32| self.nodes[child as usize].height;
            // Equal costs, as among coincident boxes, go to the lower side.
            node = if cost_a < cost_b || (cost_a == cost_b && fills(a) <= fills(b)) { a } else { b };
        }
    }

    /// Fits boxes and heights from `node` to the root, rotating where that makes boxes smaller.
    fn repair(&mut self, mut node: u32) {
        while node != NONE {
            self.pull(node);
            self.rotate(node);
            node = self.nodes[node as usize].parent;
        }
    }

    fn refit_above(&mut self, leaf: u32) {
        let mut node = self.nodes[leaf as usize].parent;
        while node != NONE {
            let before = self.nodes[node as usize].bounds;
            self.pull(node);
            if self.nodes[node as usize].bounds == before {
                return;
            }
            node = self.nodes[node as usize].parent;
        }
    }

    /// Box and height of an inner node from its children.
    fn pull(&mut self, node: u32) {
        let [a, b] = self.nodes[node as usize].links.map(|child| &self.nodes[child as usize]);
        let (bounds, height) = (a.bounds.union(b.bounds), a.height.max(b.height) + 1);
        let node = &mut self.nodes[node as usize];
        (node.bounds, node.height) = (bounds, height);
    }

    /// Swaps a child of `node` with a grandchild on the other side if that shrinks the box between them most, or evens
    /// out heights at no cost in area.
    fn rotate(&mut self, node: u32) {
        let mut best: Option<(f64, u32, usize, usize)> = None;
        for side in 0..2 {
            let inner = self.nodes[node as usize].links[side];
            let other = self.nodes[node as usize].links[1 - side];
            if self.nodes[inner as usize].is_leaf() {
                continue;
            }
            let area = self.nodes[inner as usize].bounds.area();
            for which in 0..2 {
                let kept = self.nodes[inner as usize].links[1 - which];
                let moved = self.nodes[inner as usize].links[which];
                let height = |n: u32| self.nodes[n as usize].height;
                let merged = self.nodes[kept as usize].bounds.union(self.nodes[other as usize].bounds);
                let gain = area - merged.area();
                let saved = height(moved).saturating_sub(height(other).max(height(kept)));
                let better = best.is_none_or(|(g, s, ..)| gain > g || (gain == g && saved > s));
                if (gain > 0.0 || (gain == 0.0 && saved > 0)) && better {
                    best = Some((gain, saved, side, which));
                }
            }
        }
        let Some((_, _, side, which)) = best else { return };
        let inner = self.nodes[node as usize].links[side];
        let other = self.nodes[node as usize].links[1 - side];
        let moved = self.nodes[inner as usize].links[which];
        self.nodes[node as usize].links[1 - side] = moved;
        self.nodes[inner as usize].links[which] = other;
        self.nodes[moved as usize].parent = node;
        self.nodes[other as usize].parent = inner;
        self.pull(inner);
        self.pull(node);
    }

    fn leftmost(&self, mut node: u32) -> u32 {
        while !self.nodes[node as usize].is_leaf() {
            node = self.nodes[node as usize].links[0];
        }
        node
    }

    /// The next node in an order that has children before parents; `node` is not the root.
    fn after_below(&self, node: u32) -> u32 {
        let parent = self.nodes[node as usize].parent;
        let [left, right] = self.nodes[parent as usize].links;
        if node == left { self.leftmost(right) } else { parent }
    }
}
