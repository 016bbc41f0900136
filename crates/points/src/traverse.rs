//! Which nodes to draw, in which order: the one that shows most first.

use crate::select::Lens;
use crate::store::{NodeId, Octree, Size, Walked};
use farsight_geometry::accuracy::{Counters, ErrorBound, Unit};
use farsight_geometry::{Camera, Frustum};
use glam::Vec3;

/// What to draw of a view.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct ViewOptions {
    /// How many pixels a point may be from the one that represents it.
    pub error_px: f64,
    /// Most points to draw.
    pub budget: u64,
}

impl Default for ViewOptions {
    /// One pixel, no budget.
    fn default() -> Self {
        Self { error_px: 1.0, budget: u64::MAX }
    }
}

impl ViewOptions {
    /// An error in pixels without a budget.
    pub fn error(error_px: f64) -> Self {
        Self { error_px, ..Self::default() }
    }

    /// The same with a most number of points.
    #[must_use]
    pub fn with_budget(self, budget: u64) -> Self {
        Self { budget, ..self }
    }
}

/// A node to draw.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drawn {
    /// The node; all its points are drawn.
    pub node: NodeId,
    /// Number of its points.
    pub points: u32,
    /// Diameter in the world that leaves no gaps between its points and those that represent what is not drawn below it.
    pub splat: f32,
}

/// What a view asks for. Reused from frame to frame without allocating.
#[derive(Clone, Debug, Default)]
pub struct Selection {
    /// Nodes to draw, parents before children, the most important first.
    pub drawn: Vec<Drawn>,
    /// Nodes that are needed but were not there, the most important first.
    pub missing: Vec<NodeId>,
    /// Points in [`drawn`](Self::drawn).
    pub points: u64,
    /// How many pixels a visible point may be from a drawn one at most. More than asked for where the budget ended or
    /// nodes are missing; infinite when not even the root is there.
    pub error: Option<ErrorBound>,
    /// Counters `visited`, `culled`, `fine_enough`, `drawn`, `missing`, `over_budget`.
    pub counters: Counters,
}

/// Walks an octree. Keeps its queues, so that frames after the first few allocate nothing.
///
/// # Cost
/// About 25 ns per chosen node, less for one that is culled or fine enough.
#[derive(Clone, Debug, Default)]
pub struct Traversal {
    queue: BucketQueue,
    /// Per drawn node of this frame: place of its parent in `drawn`, and whether a child that it needs is not drawn.
    parents: Vec<Above>,
}

#[derive(Clone, Copy, Debug)]
struct Above {
    parent: u32,
    /// A needed child is missing.
    incomplete: bool,
    /// Largest splat among drawn children.
    coarsest: f32,
}

const NO_PARENT: u32 = u32::MAX;

impl Traversal {
    /// A traversal without history.
    pub fn new() -> Self {
        Self::default()
    }

    /// Chooses nodes for a view. `is_there` says whether a node's points are at hand; it is asked once per needed node, the most
    /// important first.
    ///
    /// A node is needed when it is in view and the cells that the nodes above show would be larger than
    /// [`ViewOptions::error_px`] pixels there. A node that does not fit in the budget any more is left out with everything below
    /// it; smaller ones that come later may still fit.
    ///
    /// # Accuracy
    /// [`Selection::error`] is proven: every visible point has a drawn one within its cell, rounding included. Points behind
    /// other points count as visible, those before the near plane do not.
    ///
    /// # References
    /// Wimmer 2007, section 6.5.3. Differs: culled before it is counted, threshold by the cells of the nodes *above*.
    pub fn select(
        &mut self,
        octree: &Octree,
        camera: &Camera,
        options: &ViewOptions,
        is_there: impl FnMut(NodeId) -> bool,
        into: &mut Selection,
    ) {
        into.drawn.clear();
        into.missing.clear();
        into.points = 0;
        into.counters = Counters::new();
        self.parents.clear();
        let error = if octree.is_empty() {
            0.0
        } else {
            let view = View::new(octree, camera);
            self.walk(octree, &view, options, is_there, into)
        };
        into.error = Some(ErrorBound::proven(error, Unit::Pixels));
        self.size_splats(into);
    }

    /// Returns the largest error of what is not drawn.
    fn walk(
        &mut self,
        octree: &Octree,
        view: &View,
        options: &ViewOptions,
        mut is_there: impl FnMut(NodeId) -> bool,
        into: &mut Selection,
    ) -> f64 {
        let mut count = Count::default();
        // Largest error among nodes that are left out.
        let mut left = 0f32;
        let tolerance = options.error_px as f32 * (1.0 - 4.0 * f32::EPSILON);
        self.queue.reset(octree.len());
        for (node, size) in octree.walk(0..1) {
            if let Some(root) = view.seen(node, ALL_PLANES) {
                self.queue.push(Entry::new(0, NO_PARENT, f32::INFINITY, node, root.planes, size));
            }
        }
        while let Some(entry) = self.queue.pop() {
            let id = NodeId(entry.node);
            count.visited += 1;
            let points = entry.points;
            let there = into.points + u64::from(points) <= options.budget;
            if !there || !is_there(id) {
                count.over_budget += u64::from(!there);
                if there {
                    into.missing.push(id);
                }
                left = left.max(entry.error);
                if let Some(above) = self.parents.get_mut(entry.parent as usize) {
                    above.incomplete = true;
                }
                continue;
            }
            let place = into.drawn.len() as u32;
            into.points += u64::from(points);
            into.drawn.push(Drawn { node: id, points, splat: entry.spacing });
            self.parents.push(Above { parent: entry.parent, incomplete: false, coarsest: 0.0 });
            let children = entry.first_child..entry.first_child + (entry.children_planes >> 8);
            let planes = entry.children_planes as u8;
            for (child, (below, size)) in children.clone().zip(octree.walk(children)) {
                let Some(seen) = view.seen(below, planes) else {
                    count.culled += 1;
                    continue;
                };
                // A bound that holds for the node above holds for what lies in it.
                let own = view.error_px(below, &seen);
                let error = if own < entry.error { own } else { entry.error };
                if error <= tolerance {
                    count.fine_enough += 1;
                    left = left.max(error);
                    continue;
                }
                self.queue.push(Entry::new(child, place, error, below, seen.planes, size));
            }
        }
        count.into_counters(into);
        f64::from(left)
    }

    /// Bottom up: a node whose needed children are all drawn only has to fill the gaps between their points.
    fn size_splats(&mut self, into: &mut Selection) {
        for i in (0..into.drawn.len()).rev() {
            let above = self.parents[i];
            // As the walk left it.
            let own = into.drawn[i].splat;
            let splat = if above.incomplete || above.coarsest == 0.0 { own } else { above.coarsest.min(own) };
            into.drawn[i].splat = splat;
            if let Some(parent) = self.parents.get_mut(above.parent as usize) {
                parent.coarsest = parent.coarsest.max(splat);
            }
        }
    }
}

#[derive(Default)]
struct Count {
    visited: u64,
    culled: u64,
    fine_enough: u64,
    over_budget: u64,
}

impl Count {
    fn into_counters(self, into: &mut Selection) {
        let (drawn, missing) = (into.drawn.len() as u64, into.missing.len() as u64);
        for (name, n) in [
            ("visited", self.visited),
            ("culled", self.culled),
            ("fine_enough", self.fine_enough),
            ("drawn", drawn),
            ("missing", missing),
            ("over_budget", self.over_budget),
        ] {
            into.counters.add(name, n);
        }
    }
}

/// A camera in the octree's own coordinates, in `f32`.
struct View {
    eye: Vec3,
    forward: Vec3,
    forward_abs: Vec3,
    /// Planes through points relative to the eye: inside where `normal · p + offset ≥ 0`.
    planes: [(Vec3, Vec3, f32); 6],
    /// Bits of those that there are.
    used: u8,
    lens: Lens,
    /// Half extents are inflated by this for the rounding of coordinates relative to the eye.
    slack: f32,
    diagonals: [f64; 34],
}

/// All six planes still have to be tested.
const ALL_PLANES: u8 = 0x3f;

/// What is known of a node that may be in view.
struct Seen {
    planes: u8,
    center: Vec3,
    half: Vec3,
}

impl View {
    fn new(octree: &Octree, camera: &Camera) -> Self {
        let eye = camera.eye() - octree.corner();
        let frustum = Frustum::from_camera(camera);
        let mut planes = [(Vec3::ZERO, Vec3::ZERO, 0.0); 6];
        for (slot, plane) in planes.iter_mut().zip(frustum.planes()) {
            let normal = plane.normal.as_vec3();
            *slot = (normal, normal.abs(), plane.offset as f32);
        }
        let size = octree.world_bounds().extent().max_element();
        let largest = (eye.abs().max_element() + size) as f32;
        // Eye, centre and difference are rounded once each, a plane's distance sums four products with rounded normals.
        let slack = 12.0 * f32::EPSILON * largest;
        let forward = camera.forward().as_vec3();
        Self {
            eye: eye.as_vec3(),
            forward,
            forward_abs: forward.abs(),
            planes,
            used: ALL_PLANES >> (6 - frustum.planes().len()),
            lens: Lens::new(camera),
            slack,
            // What is not drawn of a node of level k is represented in cells of level k − 1 + D.
            diagonals: std::array::from_fn(|k| {
                octree.cell_diagonal((k as u32 + octree.inner_depth()).saturating_sub(1))
            }),
        }
    }

    /// Whether a node may be in view; `planes` are those that it is not known to be inside of.
    #[inline]
    fn seen(&self, node: &Walked, mut planes: u8) -> Option<Seen> {
        let center = node.center - self.eye;
        let half = node.half + self.slack;
        let mut rest = planes & self.used;
        while rest != 0 {
            let i = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            let (normal, abs, offset) = self.planes[i];
            let (distance, reach) =
                (normal.dot(center) + offset, abs.dot(half) + offset.abs() * 4.0 * f32::EPSILON);
            if distance < -reach {
                return None;
            }
            if distance > reach {
                planes &= !(1 << i);
            }
        }
        Some(Seen { planes, center, half })
    }

    /// Pixels that points of a node may be off when it is not drawn.
    #[inline]
    fn error_px(&self, node: &Walked, seen: &Seen) -> f32 {
        let least = self.forward.dot(seen.center) - self.forward_abs.dot(seen.half);
        let farthest = seen.center.length() + seen.half.length();
        let error = self.lens.error_px(
            self.diagonals[node.level() as usize],
            least.into(),
            f64::from(farthest) * 1.000_001,
        );
        // Rounded up to `f32`; it is not negative.
        let near = error as f32;
        if near < f32::INFINITY { f32::from_bits(near.to_bits() + 1) } else { near }
    }
}

/// A monotone priority queue: nodes of nearly equal error share a bucket, and no node enters a bucket above the current one.
///
/// Buckets are a 32nd of an octave wide; lists run through the entries.
#[derive(Clone, Debug, Default)]
struct BucketQueue {
    heads: Vec<u32>,
    entries: Vec<Entry>,
    top: usize,
}

/// A node that waits, with all that is asked of it when its turn comes: siblings are read side by side when they enter, while the
/// order of turns jumps about.
#[derive(Clone, Copy, Debug)]
#[repr(align(32))]
struct Entry {
    node: u32,
    parent: u32,
    error: f32,
    points: u32,
    spacing: f32,
    first_child: u32,
    /// Number of children in the upper 24 bits, planes that are still to be tested in the lower 8.
    children_planes: u32,
    next: u32,
}

impl Entry {
    #[inline]
    fn new(node: u32, parent: u32, error: f32, walked: &Walked, planes: u8, size: &Size) -> Self {
        let children_planes = walked.children() << 8 | u32::from(planes);
        let (&Size { points, spacing }, first_child) = (size, walked.first_child);
        Self { node, parent, error, points, spacing, first_child, children_planes, next: NONE }
    }
}

const NONE: u32 = u32::MAX;
const BUCKETS: usize = 2048;

impl BucketQueue {
    fn reset(&mut self, nodes: usize) {
        self.heads.clear();
        self.heads.resize(BUCKETS, NONE);
        self.entries.clear();
        self.entries.reserve(nodes);
        self.top = 0;
    }

    /// Floats of one sign sort like their bits. Five bits of mantissa, eight of exponent less those below 2⁻³¹.
    #[inline]
    fn bucket(error: f32) -> usize {
        ((error.to_bits() >> 18) as usize).saturating_sub(96 << 5).min(BUCKETS - 1)
    }

    #[inline]
    fn push(&mut self, entry: Entry) {
        let bucket = Self::bucket(entry.error);
        self.top = self.top.max(bucket);
        let next = std::mem::replace(&mut self.heads[bucket], self.entries.len() as u32);
        self.entries.push(Entry { next, ..entry });
    }

    #[inline]
    fn pop(&mut self) -> Option<Entry> {
        while self.heads[self.top] == NONE {
            self.top = self.top.checked_sub(1)?;
        }
        let entry = self.entries[self.heads[self.top] as usize];
        self.heads[self.top] = entry.next;
        Some(entry)
    }
}
