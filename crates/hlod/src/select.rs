//! Which nodes to draw for a view.

use crate::tree::{Mesh, NodeId, Tree};
use farsight_geometry::accuracy::{Counters, ErrorBound, Unit};
use farsight_geometry::{Camera, Containment, Frustum, Projection};
use glam::DVec3;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// What to draw of a view.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct ViewOptions {
    /// How many pixels anything may be from where it should be.
    pub error_px: f64,
    /// Part of [`error_px`](Self::error_px) by which the error has to fall below it before a node that was replaced by its children is
    /// drawn again: keeps a cut from flickering. Zero to one.
    pub hysteresis: f64,
    /// Most triangles to draw; the error grows to fit.
    pub most_triangles: u64,
    /// Most bytes of meshes to draw from; the error grows to fit.
    pub most_bytes: u64,
    /// Whether nodes that only show backs are left out: right where only closed surfaces are seen from outside.
    pub cull_backs: bool,
    /// Which meshes.
    pub mesh: Mesh,
}

impl Default for ViewOptions {
    /// Half a pixel, a tenth of hysteresis, no budgets, backs seen, with attributes.
    fn default() -> Self {
        Self {
            error_px: 0.5,
            hysteresis: 0.1,
            most_triangles: u64::MAX,
            most_bytes: u64::MAX,
            cull_backs: false,
            mesh: Mesh::Full,
        }
    }
}

impl ViewOptions {
    /// An error in pixels without budgets.
    pub fn error(error_px: f64) -> Self {
        Self { error_px, ..Self::default() }
    }

    /// The same with a most number of triangles.
    #[must_use]
    pub fn with_most_triangles(self, most_triangles: u64) -> Self {
        Self { most_triangles, ..self }
    }

    /// The same with a most number of bytes.
    #[must_use]
    pub fn with_most_bytes(self, most_bytes: u64) -> Self {
        Self { most_bytes, ..self }
    }

    /// The same with or without nodes that only show backs.
    #[must_use]
    pub fn with_backs_culled(self, cull_backs: bool) -> Self {
        Self { cull_backs, ..self }
    }

    /// The same with other meshes.
    #[must_use]
    pub fn with_mesh(self, mesh: Mesh) -> Self {
        Self { mesh, ..self }
    }
}

/// A node to draw: its triangles, and its rims as lines one pixel wide.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drawn {
    /// The node.
    pub node: NodeId,
    /// Pixels that anything in it may be from where it should be.
    pub error_px: f64,
}

/// What a view asks for. Reused from frame to frame without allocating.
#[derive(Clone, Debug, Default)]
pub struct Selection {
    /// Nodes to draw, in the order of their numbers.
    pub drawn: Vec<Drawn>,
    /// Nodes that were needed but not there, the one that would mend the largest error first.
    pub wanted: Vec<NodeId>,
    /// Triangles of the drawn nodes.
    pub triangles: u64,
    /// Bytes of their meshes in memory.
    pub bytes: u64,
    /// How many pixels a visible point of the input may be from the nearest drawn one at most, and the reverse; no hole is wider than twice this, before
    /// rims are drawn. More than asked for where a budget ended, nodes are missing or the input itself is too coarse; infinite when not even the root is there.
    pub geometric: Option<ErrorBound>,
    /// The same with attributes: how far from where it should be a colour may be found. `None` for shapes and without attributes.
    pub appearance: Option<ErrorBound>,
    /// Counters `visited`, `culled`, `drawn`, `wanted`.
    pub counters: Counters,
}

/// Chooses nodes from frame to frame. Remembers which ones it refined.
///
/// # Cost
/// Work is proportional to the nodes above and on the cut; nothing is allocated after the first frames.
#[derive(Clone, Debug, Default)]
pub struct Selector {
    heap: BinaryHeap<Candidate>,
    /// Whether each node was replaced by its children in the last frame, and in this one.
    refined: Vec<bool>,
    refining: Vec<bool>,
    wanted: Vec<(f64, NodeId)>,
    touched: Vec<NodeId>,
    touching: Vec<NodeId>,
    children: Vec<Candidate>,
}

/// A node on the cut.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    error_px: f64,
    node: NodeId,
    /// Wholly in view.
    inside: bool,
}

impl PartialEq for Candidate {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Candidate {}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        self.error_px.total_cmp(&other.error_px).then(other.node.cmp(&self.node))
    }
}

impl Selector {
    /// A selector without history.
    pub fn new() -> Self {
        Self::default()
    }

    /// Chooses the coarsest nodes that are fine enough for a view, from those that are there. `is_there` is asked only for nodes that are needed.
    ///
    /// A node is replaced by its children as soon as all that are in view are there; until then it is drawn itself, with the error that it
    /// has.
    ///
    /// # Accuracy
    /// [`Selection::geometric`] is proven: errors are stored with the nodes, and pixels are those at the nearest point of a node's box, at the image's corner if
    /// it reaches there. Points before the near plane do not count.
    ///
    /// # References
    /// [Guthe 2004], section 4. Differs: nearest point of the box, off-axis factor, budgets, hysteresis.
    pub fn select(
        &mut self,
        tree: &Tree,
        camera: &Camera,
        options: &ViewOptions,
        mut is_there: impl FnMut(NodeId) -> bool,
        into: &mut Selection,
    ) {
        into.drawn.clear();
        into.wanted.clear();
        self.begin(tree);
        let mut walk =
            Walk { tree, camera, frustum: Frustum::from_camera(camera), options, visited: 0, culled: 0 };
        let (mut triangles, mut bytes) = (0, 0);
        match tree.root().and_then(|root| walk.visit(root, false)) {
            Some(root) if is_there(root.node) => {
                triangles = u64::from(tree.triangles(root.node, options.mesh));
                bytes = tree.memory_bytes(root.node, options.mesh);
                self.heap.push(root);
            }
            Some(root) => self.wanted.push((f64::INFINITY, root.node)),
            None => {}
        }
        while let Some(candidate) = self.heap.pop() {
            let Candidate { error_px, node, inside } = candidate;
            let limit = if self.refined[node.0 as usize] {
                options.error_px * (1.0 - options.hysteresis)
            } else {
                options.error_px
            };
            if error_px <= limit || tree.is_leaf(node) {
                into.drawn.push(Drawn { node, error_px });
                continue;
            }
            self.children.clear();
            let (mut more_triangles, mut more_bytes, mut all_there) = (0, 0, true);
            for child in tree.children(node) {
                let Some(seen) = walk.visit(child, inside) else { continue };
                more_triangles += u64::from(tree.triangles(child, options.mesh));
                more_bytes += tree.memory_bytes(child, options.mesh);
                if !is_there(child) {
                    all_there = false;
                    self.wanted.push((error_px, child));
                }
                self.children.push(seen);
            }
            let rest = triangles - u64::from(tree.triangles(node, options.mesh));
            let rest_bytes = bytes - tree.memory_bytes(node, options.mesh);
            let fits = rest + more_triangles <= options.most_triangles
                && rest_bytes + more_bytes <= options.most_bytes;
            if !(all_there && fits) {
                if !fits {
                    // What a budget rules out is not worth loading.
                    self.wanted.retain(|w| tree.parent(w.1) != Some(node));
                }
                into.drawn.push(Drawn { node, error_px });
                continue;
            }
            (triangles, bytes) = (rest + more_triangles, rest_bytes + more_bytes);
            self.refining[node.0 as usize] = true;
            self.touching.push(node);
            self.heap.extend(self.children.drain(..));
        }
        self.wanted.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        into.wanted.extend(self.wanted.iter().map(|w| w.1));
        into.drawn.sort_unstable_by_key(|d| d.node);
        (into.triangles, into.bytes) = (triangles, bytes);
        walk.report(into, !self.wanted.is_empty() && into.drawn.is_empty());
    }

    fn begin(&mut self, tree: &Tree) {
        let nodes = tree.ids().len();
        if self.refined.len() != nodes {
            self.refined = vec![false; nodes];
            self.refining = vec![false; nodes];
            self.touched.clear();
            self.touching.clear();
        }
        // What was refined in the last frame becomes history; what was before that is forgotten.
        self.touched.drain(..).for_each(|n| self.refined[n.0 as usize] = false);
        std::mem::swap(&mut self.refined, &mut self.refining);
        std::mem::swap(&mut self.touched, &mut self.touching);
        self.heap.clear();
        self.wanted.clear();
    }
}

/// A view being looked at.
struct Walk<'a> {
    tree: &'a Tree,
    camera: &'a Camera,
    frustum: Frustum,
    options: &'a ViewOptions,
    visited: u64,
    culled: u64,
}

impl Walk<'_> {
    /// The node as a candidate, unless it cannot be seen.
    fn visit(&mut self, node: NodeId, inside: bool) -> Option<Candidate> {
        self.visited += 1;
        let bounds = self.tree.bounds(node);
        let place = if inside { Containment::Inside } else { self.frustum.classify(&bounds) };
        if place == Containment::Outside || (self.options.cull_backs && self.shows_backs(node)) {
            self.culled += 1;
            return None;
        }
        let error = self.tree.chosen_by(node, self.options.mesh);
        let error_px = screen_error(self.camera, error, &bounds);
        Some(Candidate { error_px, node, inside: place == Containment::Inside })
    }

    /// Whether every triangle of the node, and of the input in it, is certainly seen from behind.
    fn shows_backs(&self, node: NodeId) -> bool {
        let cone = self.tree.nodes[node.0 as usize].cone;
        let (axis, angle) = (cone.axis.as_dvec3(), f64::from(cone.angle));
        if angle >= std::f64::consts::FRAC_PI_2 {
            return false;
        }
        let bounds = self.tree.bounds(node);
        let (to, radius) = match self.camera.projection() {
            Projection::Orthographic { .. } => (self.camera.forward(), 0.0),
            Projection::Perspective { .. } => (bounds.center() - self.camera.eye(), 0.5 * bounds.diagonal()),
        };
        // A normal n shows its back at x when n · (x − eye) ≥ 0. Over the cone and the box that is least at
        // |to| cos(θ + angle) − radius.
        let theta = axis.angle_between(to.normalize_or(DVec3::ZERO));
        to.length() * (theta + angle).min(std::f64::consts::PI).cos() > radius
    }

    fn report(&self, into: &mut Selection, nothing_there: bool) {
        let worst = |error: &dyn Fn(NodeId) -> f64| {
            let px = |d: &Drawn| screen_error(self.camera, error(d.node), &self.tree.bounds(d.node));
            let worst = into.drawn.iter().map(px).fold(0.0, f64::max);
            if nothing_there { f64::INFINITY } else { worst }
        };
        let mesh = self.options.mesh;
        let geometric = worst(&|n| self.tree.stored(n, mesh).error);
        let has_looks = mesh == Mesh::Full && self.tree.attributes.any();
        let appearance = has_looks.then(|| worst(&|n| self.tree.stored(n, mesh).look_error));
        into.geometric = Some(ErrorBound::proven(geometric, Unit::Pixels));
        into.appearance = appearance.map(|a| ErrorBound::estimated(a, Unit::Pixels));
        into.counters = Counters::new();
        let (drawn, wanted) = (into.drawn.len() as u64, into.wanted.len() as u64);
        for (name, n) in
            [("visited", self.visited), ("culled", self.culled), ("drawn", drawn), ("wanted", wanted)]
        {
            into.counters.add(name, n);
        }
    }
}

/// Pixels that a displacement by `error` may be anywhere in a box, for what is seen before or after it.
pub(crate) fn screen_error(camera: &Camera, error: f64, bounds: &farsight_geometry::DAabb) -> f64 {
    let in_box = camera.box_error_px(error, bounds);
    match camera.projection() {
        Projection::Orthographic { .. } => in_box,
        // Nothing before the near plane is seen, so that a box around the eye is no nearer than that.
        Projection::Perspective { .. } => {
            in_box.min(camera.error_px(error, camera.distance_to_box(bounds).max(camera.near())))
        }
    }
}
