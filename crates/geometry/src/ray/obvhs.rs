//! The obvhs crate: a quick build for our tree, and its own trees and walks as an independent caster.

use super::build::{Bounds, Item};
use super::bvh8::Bvh8;
use super::collapse::{Binary, Wide, price};
use super::exact::Sheared;
use super::frame::Frame;
use super::single::{Best, Walk};
use super::tree::{WIDTH, without_area_as_segment};
use super::{Hit, Ray, RayCaster};
use crate::bounds::{Aabb, DAabb};
use crate::mesh::TriangleMesh;
use glam::{Vec3, Vec3A};
use obvhs::bvh2::{Bvh2, builder::build_bvh2};
use obvhs::cwbvh::{CwBvh, builder::build_cwbvh};
use obvhs::{BvhBuildParams, ray::RayHit};
use std::time::Duration;

/// How far obvhs boxes are enlarged, in tree units: twice what its box test and the conversion of the ray round.
const PAD: f32 = 1.0 / (1 << 18) as f32;

/// Distance by which rays start before their origin, in tree units: the compressed tree skips what lies within 1e-4.
const RUN_UP: f64 = 1.0 / 64.0;

/// The compressed tree walks with a stack of 32; deeper trees fall back to the binary one.
const MAX_COMPRESSED_DEPTH: usize = 24;

/// Which of the crate's trees an [`ObvhsCaster`] walks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ObvhsTree {
    /// Binary.
    #[default]
    Binary,
    /// Eight children, boxes compressed to 8 bits.
    Compressed,
}

/// A caster that walks a tree of the obvhs crate; slower than [`Bvh8`], and an independent check of it.
///
/// What the crate leaves to its caller is guarded here: rays are normalised and rebased, without negative zeros and with a
/// run-up; meshes are scaled to about one; boxes are padded; triangles are tested in `f64` without leaks; the lowest id
/// wins ties.
///
/// # Accuracy
/// Hits are bit for bit those of [`Bvh8`].
pub struct ObvhsCaster {
    frame: Frame,
    bounds: Option<DAabb>,
    corners: Vec<[Vec3; 3]>,
    tree: Tree,
}

enum Tree {
    Binary(Bvh2),
    Compressed(CwBvh),
}

fn boxes(mesh: &TriangleMesh, frame: &Frame, pad: f32) -> Vec<obvhs::aabb::Aabb> {
    let corners = |t: [Vec3; 3]| Aabb::from_points(t.map(|p| frame.vertex(p))).inflated(pad);
    mesh.corner_iter()
        .map(corners)
        .map(|b| obvhs::aabb::Aabb { min: Vec3A::from(b.min), max: Vec3A::from(b.max) })
        .collect()
}

impl ObvhsCaster {
    /// Builds the wanted tree with the crate's medium preset.
    pub fn new(mesh: &TriangleMesh, tree: ObvhsTree) -> Self {
        let frame = Frame::of_mesh(mesh);
        let boxes = boxes(mesh, &frame, PAD);
        let corners: Vec<_> =
            mesh.corner_iter().map(|t| without_area_as_segment(t.map(|p| frame.vertex(p)))).collect();
        let all = Aabb::from_points(corners.iter().flatten().copied());
        let bounds = (!all.is_empty()).then(|| DAabb::new(all.min.as_dvec3(), all.max.as_dvec3()));
        let (params, mut time) = (BvhBuildParams::medium_build(), Duration::default());
        let compressed = (tree == ObvhsTree::Compressed && !boxes.is_empty())
            .then(|| build_cwbvh(&boxes, params, &mut time))
            .filter(|tree| depth(tree) <= MAX_COMPRESSED_DEPTH);
        let tree = match compressed {
            Some(tree) => Tree::Compressed(tree),
            None if boxes.is_empty() => Tree::Binary(Bvh2::default()),
            None => Tree::Binary(build_bvh2(&boxes, params, &mut time)),
        };
        Self { frame, bounds, corners, tree }
    }

    fn cast(&self, ray: &Ray, any: bool) -> Option<Hit> {
        let bounds = self.bounds.as_ref()?;
        let (origin, direction) = (self.frame.point(ray.origin()), self.frame.vector(ray.direction()));
        let sheared = Sheared::new(origin, direction, ray.t_min(), ray.t_max());
        let walk = Walk::new(bounds, origin, direction, &sheared)?;
        let (start, direction) = walk.start_before(origin, direction, RUN_UP);
        let limit = |t: f64| walk.limit(t) + (RUN_UP + 1e-5) as f32;
        // Adding zero turns what became −0.0 on the way to f32 into +0.0.
        let (start, direction) = (start.as_vec3a(), direction.as_vec3a() + Vec3A::ZERO);
        let wanted = obvhs::ray::Ray::new(start, direction, 0.0, limit(ray.t_max()).min(f32::MAX));
        let mut best = Best::NONE;
        let indices = match &self.tree {
            Tree::Binary(tree) => &tree.primitive_indices,
            Tree::Compressed(tree) => &tree.primitive_indices,
        };
        let mut test = |_: &obvhs::ray::Ray, at: usize| {
            let id = indices[at];
            let corners = self.corners[id as usize].map(|p| sheared.axes.map(|a| p[a]));
            match sheared.cross(corners) {
                // The walk goes on a little behind the hit, so that ties are seen.
                Some(hit) if best.offer(id.into(), &hit) => limit(hit.t),
                _ => f32::INFINITY,
            }
        };
        let mut hit = RayHit::none();
        match (&self.tree, any) {
            (Tree::Binary(tree), false) => _ = tree.ray_traverse(wanted, &mut hit, &mut test),
            (Tree::Binary(tree), true) => _ = tree.ray_traverse_miss(wanted, &mut test),
            (Tree::Compressed(tree), false) => _ = tree.ray_traverse(wanted, &mut hit, &mut test),
            (Tree::Compressed(tree), true) => _ = tree.ray_traverse_miss(wanted, &mut test),
        }
        best.hit()
    }
}

impl RayCaster for ObvhsCaster {
    fn closest(&self, ray: &Ray) -> Option<Hit> {
        self.cast(ray, false)
    }

    fn occluded(&self, ray: &Ray) -> bool {
        self.cast(ray, true).is_some()
    }
}

fn depth(tree: &CwBvh) -> usize {
    let (mut deepest, mut waiting) = (0, vec![(0, 1)]);
    while let Some((index, depth)) = waiting.pop() {
        deepest = deepest.max(depth);
        let node = &tree.nodes[index as usize];
        let inner = (0..8).filter(|&child| !node.is_child_empty(child) && !node.is_leaf(child));
        waiting.extend(inner.map(|child| (node.child_node_index(child), depth + 1)));
    }
    deepest
}

impl Bvh8 {
    /// Builds the tree faster and worse: obvhs clusters the triangles, we collapse its binary tree.
    ///
    /// Answers are the same as those of [`new`](Self::new); rays take longer.
    pub fn quick(mesh: &TriangleMesh) -> Self {
        let frame = Frame::of_mesh(mesh);
        let boxes = boxes(mesh, &frame, 0.0);
        if boxes.is_empty() {
            return Self::with_tree(mesh, frame, Wide::default());
        }
        let params = BvhBuildParams::very_fast_build();
        let tree = build_bvh2(&boxes, params, &mut Duration::default());
        let (mut binary, items) = binary(&tree, &boxes);
        for index in (0..binary.len()).rev() {
            price(&mut binary, index, WIDTH as u32);
        }
        // Too deep: a scene that only the careful builder balances.
        Wide::collapse(&binary, items)
            .map_or_else(|_| Self::new(mesh), |wide| Self::with_tree(mesh, frame, wide))
    }
}

/// The crate's tree, parents first, over items in the order of its leaves.
fn binary(tree: &Bvh2, boxes: &[obvhs::aabb::Aabb]) -> (Vec<Binary>, Vec<Item>) {
    let (mut nodes, mut items): (Vec<Binary>, Vec<Item>) = (Vec::new(), Vec::new());
    // A node to visit, with its parent and the side on which it hangs.
    let mut waiting = vec![(0u32, None)];
    while let Some((index, parent)) = waiting.pop() {
        let node = &tree.nodes[index as usize];
        let (own, start) = (nodes.len(), items.len() as u32);
        if let Some((parent, side)) = parent {
            let parent: &mut Binary = &mut nodes[parent];
            parent.children[side] = own as u32;
        }
        if node.is_leaf() {
            let range = node.first_index as usize..(node.first_index + node.prim_count) as usize;
            items.extend(tree.primitive_indices[range].iter().map(|&id| {
                let bounds = &boxes[id as usize];
                Item { min: bounds.min, max: bounds.max, id }
            }));
        } else {
            waiting.push((node.first_index + 1, Some((own, 1))));
            waiting.push((node.first_index, Some((own, 0))));
        }
        let bounds = Bounds { min: node.aabb().min, max: node.aabb().max };
        nodes.push(Binary::new(bounds, start, items.len() as u32));
    }
    for index in (0..nodes.len()).rev() {
        let [_, right] = nodes[index].children;
        if right != 0 {
            nodes[index].end = nodes[right as usize].end;
        }
    }
    (nodes, items)
}
