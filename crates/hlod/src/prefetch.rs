//! What may be needed soon: how far the viewer has to move, or turn, for a node to be drawn.

use crate::select::ViewOptions;
use crate::tree::{NodeId, Tree};
use farsight_geometry::{Camera, Frustum, Projection};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// How far ahead to look.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct PrefetchOptions {
    /// Movement of the viewer, in world units, beyond which nothing is looked for.
    pub movement: f64,
    /// Movement that counts like turning by one radian.
    pub turn: f64,
    /// Most nodes to name.
    pub nodes: usize,
}

impl PrefetchOptions {
    /// Nodes that are needed within some movement; turning by a radian counts like all of it.
    pub fn within(movement: f64) -> Self {
        Self { movement, turn: movement, nodes: 256 }
    }
}

/// How far the viewer has to move for a node to be needed: in world units, turning converted.
///
/// Needed is a node when it is in view and its parent's error is too large there. Neither can happen before the viewer has come nearer to the parent by what its
/// error allows, or has moved or turned so that the node's box enters the view.
pub fn movement_until_needed(
    tree: &Tree,
    node: NodeId,
    camera: &Camera,
    options: &ViewOptions,
    turn: f64,
) -> f64 {
    Ahead::new(camera, options, turn).movement(tree, node)
}

struct Ahead<'a> {
    camera: &'a Camera,
    frustum: Frustum,
    options: &'a ViewOptions,
    turn: f64,
}

impl<'a> Ahead<'a> {
    fn new(camera: &'a Camera, options: &'a ViewOptions, turn: f64) -> Self {
        Self { camera, frustum: Frustum::from_camera(camera), options, turn }
    }

    fn movement(&self, tree: &Tree, node: NodeId) -> f64 {
        let bounds = tree.bounds(node);
        let distance = self.camera.distance_to_box(&bounds);
        let center = bounds.center() - self.frustum.anchor();
        let half = 0.5 * bounds.extent();
        // How far it is beyond the plane that it is farthest beyond.
        let beyond = |p: &farsight_geometry::Plane| -(p.distance(center) + p.normal.abs().dot(half));
        let moved = self.frustum.planes().iter().map(beyond).fold(0.0, f64::max);
        let turned = if distance > 0.0 { (moved / distance).min(1.0).asin() * self.turn } else { 0.0 };
        let to_view = moved.min(turned);
        let Some(parent) = tree.parent(node) else { return to_view };
        let error = tree.chosen_by(parent, self.options.mesh);
        let to_error = match self.camera.projection() {
            Projection::Orthographic { .. } => {
                let needed = self.camera.error_px(error, 0.0) > self.options.error_px;
                if needed { 0.0 } else { f64::INFINITY }
            }
            Projection::Perspective { .. } => {
                // The distance at which the error is as large as allowed, anywhere on the screen.
                let enough = error / self.camera.world_error(self.options.error_px, 1.0);
                (self.camera.distance_to_box(&tree.bounds(parent)) - enough).max(0.0)
            }
        };
        to_view.max(to_error)
    }
}

/// Names nodes that are not there, the one that is needed after the least movement first. A node is only named when its parent is
/// there or named.
pub fn prefetch(
    tree: &Tree,
    camera: &Camera,
    view: &ViewOptions,
    options: &PrefetchOptions,
    mut is_there: impl FnMut(NodeId) -> bool,
    into: &mut Vec<NodeId>,
) {
    into.clear();
    let ahead = Ahead::new(camera, view, options.turn);
    // Movement is at least zero, and such floats are ordered like their bits.
    let mut heap: BinaryHeap<Reverse<(u64, NodeId)>> = BinaryHeap::new();
    heap.extend(tree.root().map(|root| Reverse((ahead.movement(tree, root).to_bits(), root))));
    while let Some(Reverse((bits, node))) = heap.pop() {
        let movement = f64::from_bits(bits);
        if movement > options.movement || into.len() >= options.nodes {
            break;
        }
        if !is_there(node) {
            into.push(node);
        }
        for child in tree.children(node) {
            heap.push(Reverse((ahead.movement(tree, child).max(movement).to_bits(), child)));
        }
    }
}
