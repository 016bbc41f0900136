//! Which nodes cast shadows into what is seen, and how fine they have to be.
//!
//! The errors that casters may have depend on light, receiver and pixel; the caller gives them. What is found here is which casters matter: those between a light and the
//! boxes of what is seen, level by level (Guthe 2004, section 4.2).

use crate::select::{Drawn, Selection};
use crate::tree::{Mesh, NodeId, Tree};
use farsight_geometry::accuracy::{ErrorBound, Unit};
use farsight_geometry::{Camera, ConvexBody, DAabb};
use glam::DVec3;

/// A light, as far as casters are concerned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CasterLight {
    /// Shines from a position.
    Point(DVec3),
    /// Shines along a direction (of any length but zero), from everywhere.
    Directional(DVec3),
}

/// What is seen of one level: a box along the view's axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReceiverBox {
    /// Level of the nodes.
    pub level: u32,
    /// Its corners in the world.
    pub corners: [DVec3; 8],
}

/// The view-aligned box around the drawn nodes of each level, coarse levels first.
pub fn receiver_boxes(tree: &Tree, camera: &Camera, drawn: &[Drawn]) -> Vec<ReceiverBox> {
    let mut boxes: Vec<DAabb> = Vec::new();
    for d in drawn {
        let level = tree.level(d.node) as usize;
        boxes.resize(boxes.len().max(level + 1), DAabb::EMPTY);
        for corner in tree.bounds(d.node).corners() {
            boxes[level] = boxes[level].with_point(camera.to_view(corner));
        }
    }
    let corners = |b: &DAabb| b.corners().map(|c| camera.eye() + camera.world_from_view() * c);
    let used = boxes.iter().enumerate().filter(|(_, b)| !b.is_empty());
    used.map(|(level, b)| ReceiverBox { level: level as u32, corners: corners(b) }).collect()
}

/// Nodes that cast shadows.
#[derive(Clone, Debug, Default)]
pub struct Casters {
    /// Nodes to draw, by their meshes for shape, in the order of their numbers.
    pub drawn: Vec<NodeId>,
    /// Nodes that were needed but not there.
    pub wanted: Vec<NodeId>,
    /// Triangles of the drawn nodes.
    pub triangles: u64,
    /// The largest geometric error of a drawn node over what it may be; at most one unless nodes are missing or the input is too coarse. Infinite when not even the root
    /// is there.
    pub excess: f64,
    /// The largest geometric error of a drawn node.
    pub error: Option<ErrorBound>,
    stack: Vec<NodeId>,
}

/// Chooses the coarsest casters that are fine enough. `tolerance` gives the geometric error that is allowed in a box (in world units) for the light;
/// `is_there` says whether a node's mesh for shape is at hand.
///
/// A node casts a shadow that matters when its box meets the hull of a receiver box and the light.
pub fn select_casters(
    tree: &Tree,
    light: CasterLight,
    receivers: &[ReceiverBox],
    mut tolerance: impl FnMut(NodeId, &DAabb) -> f64,
    mut is_there: impl FnMut(NodeId) -> bool,
    into: &mut Casters,
) {
    into.drawn.clear();
    into.wanted.clear();
    (into.triangles, into.excess) = (0, 0.0);
    let mut error = 0.0f64;
    let volumes: Vec<ConvexBody> = receivers.iter().map(|r| volume(tree, light, r)).collect();
    let matters = |b: &DAabb| volumes.iter().any(|v| meets(v, b));
    let stack = &mut into.stack;
    stack.clear();
    match tree.root().filter(|&r| matters(&tree.bounds(r))) {
        Some(root) if is_there(root) => stack.push(root),
        Some(root) => {
            into.wanted.push(root);
            into.excess = f64::INFINITY;
        }
        None => {}
    }
    while let Some(node) = stack.pop() {
        let own = tree.stored(node, Mesh::Shape).error;
        let allowed = tolerance(node, &tree.bounds(node));
        let mut refine = own > allowed && !tree.is_leaf(node);
        if refine {
            let before = stack.len();
            for child in tree.children(node).filter(|&c| matters(&tree.bounds(c))) {
                if !is_there(child) {
                    into.wanted.push(child);
                    refine = false;
                }
                stack.push(child);
            }
            if !refine {
                stack.truncate(before);
            }
        }
        if !refine {
            into.drawn.push(node);
            into.triangles += u64::from(tree.triangles(node, Mesh::Shape));
            into.excess = into.excess.max(if own > 0.0 { own / allowed } else { 0.0 });
            error = error.max(own);
        }
    }
    into.drawn.sort_unstable();
    into.wanted.sort_unstable();
    into.error = Some(ErrorBound::proven(error, Unit::Metres));
}

/// Where casters for a receiver box can be.
fn volume(tree: &Tree, light: CasterLight, receiver: &ReceiverBox) -> ConvexBody {
    match light {
        CasterLight::Point(at) => {
            let mut points = receiver.corners.to_vec();
            points.push(at);
            ConvexBody::hull(&points)
        }
        CasterLight::Directional(along) => {
            // Far enough to leave the scene.
            let scene = tree.world_bounds();
            let reach = receiver.corners.iter().fold(scene, |b, &c| b.with_point(c)).diagonal();
            ConvexBody::hull(&receiver.corners).swept(-along.normalize_or_zero() * reach)
        }
    }
}

/// Whether a box may meet a convex body: no plane of it has the box outside, and their own boxes meet.
fn meets(body: &ConvexBody, b: &DAabb) -> bool {
    let (center, half) = (b.center(), 0.5 * b.extent());
    let margin = 1e-9 * (b.diagonal() + center.abs().max_element());
    body.bounds().inflated(margin).overlaps(b)
        && body.planes().iter().all(|p| p.distance(center) >= -p.normal.abs().dot(half) - margin)
}

impl Selection {
    /// The view-aligned box around the drawn nodes of each level.
    pub fn receiver_boxes(&self, tree: &Tree, camera: &Camera) -> Vec<ReceiverBox> {
        receiver_boxes(tree, camera, &self.drawn)
    }
}
