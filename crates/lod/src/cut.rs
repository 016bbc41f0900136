//! A cut through the tree: which nodes are unfolded for one eye, and the triangles that this leaves.

use crate::hierarchy::{NONE, Node, VertexHierarchy};
use crate::observer::{Class, Observer, Tolerance};
use crate::{LodError, kinetic::Watch};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// What an update did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct UpdateStats {
    /// Nodes whose size was compared with the tolerance.
    pub tested: u64,
    /// Nodes that were unfolded.
    pub unfolded: u64,
    /// Nodes that were folded.
    pub folded: u64,
    /// Triangles whose indices were written: new ones and those with a corner that moved.
    pub written: u64,
}

/// What an update within a budget goes through; kept, so that later ones allocate nothing.
#[derive(Clone, Debug, Default)]
struct Budget {
    /// Nodes that may be unfolded next, by error.
    heap: BinaryHeap<(u64, Reverse<u32>)>,
    wanted: Vec<bool>,
}

/// One instance's view of a [`VertexHierarchy`]: unfolded where its eye needs it.
///
/// ```
/// use farsight_geometry::{TriangleMesh, glam::{DVec3, Vec3}};
/// use farsight_lod::{Cut, Observer, Tolerance, VertexHierarchy};
///
/// // A sheet of 64 x 64 squares, gently curved.
/// let at = |i: u32| { let (x, y) = ((i % 65) as f32, (i / 65) as f32); Vec3::new(x, y, 1e-3 * (x * x + y * y)) };
/// let square = |i: u32| { let a = i / 64 * 65 + i % 64; [[a, a + 1, a + 66], [a, a + 66, a + 65]] };
/// let mesh = TriangleMesh::new((0..65 * 65).map(at).collect(), (0..64 * 64).flat_map(square).collect())?;
///
/// let hierarchy = VertexHierarchy::build(&mesh)?;
/// let mut cut = Cut::new(&hierarchy);
/// // From 300 units away, no point may seem to move by more than 3/100 of its distance.
/// cut.update(&hierarchy, &Observer::in_object(DVec3::new(32.0, 32.0, 300.0)), &Tolerance::uniform(0.03))?;
/// assert!(cut.triangles().len() < 8192 / 4 && !cut.is_point());
/// // `cut.indices()` goes to the index buffer; the vertex buffer is the mesh's own and never changes.
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Cost
/// About 30 bytes a triangle of the mesh when all of it is drawn. An update takes time in the nodes that it tests and in the triangles around the
/// vertices that move.
#[derive(Clone, Debug)]
pub struct Cut {
    /// Whether each node is unfolded.
    unfolded: Vec<bool>,
    /// For each vertex the one of the mesh that stands for it.
    proxy: Vec<u32>,
    /// Vertices whose proxies the update under way has changed: half-open ranges.
    moved: Vec<[u32; 2]>,
    /// Drawn triangles, as places in the hierarchy's list and as mesh vertices.
    drawn: Vec<u32>,
    indices: Vec<[u32; 3]>,
    /// Place of each triangle in `drawn`.
    slot: Vec<u32>,
    /// Drawn triangles whose indices the last update changed.
    changed: Vec<u32>,
    stack: Vec<u32>,
    budget: Budget,
    pub(crate) watch: Watch,
    pub(crate) stats: UpdateStats,
}

impl Cut {
    /// Everything folded into one point.
    pub fn new(hierarchy: &VertexHierarchy) -> Self {
        let mut proxy = vec![NONE; hierarchy.vertices.len()];
        hierarchy.stand_in(0, &mut proxy);
        Self {
            unfolded: vec![false; hierarchy.nodes.len()],
            proxy,
            moved: Vec::new(),
            drawn: Vec::new(),
            indices: Vec::new(),
            slot: vec![NONE; hierarchy.triangles.len()],
            changed: Vec::new(),
            stack: Vec::new(),
            budget: Budget::default(),
            watch: Watch::default(),
            stats: UpdateStats::default(),
        }
    }

    /// Unfolds and folds until the cut is that of the observer: a node is unfolded when all above it are and its own vertices would move
    /// farther than tolerated.
    ///
    /// # Accuracy
    /// Proven: every point p of the mesh has an image on what is drawn (or on a triangle that vanished into a line or a point) within
    /// τ·∣p − eye∣ of it, where τ is the largest tolerance in use; without hysteresis the result depends on the observer alone, not on the path there.
    ///
    /// # Cost
    /// About 8 ns for each node that is tested.
    ///
    /// # Errors
    /// [`LodError::Tolerance`] for tolerances that are not positive or not in order.
    ///
    /// # Panics
    /// When the cut belongs to another hierarchy.
    pub fn update(
        &mut self,
        hierarchy: &VertexHierarchy,
        observer: &Observer,
        tolerance: &Tolerance,
    ) -> Result<UpdateStats, LodError> {
        self.begin(hierarchy, tolerance)?;
        self.watch.forget();
        self.stack.push(0);
        while let Some(node) = self.stack.pop() {
            self.stats.tested += 1;
            if wants_unfolding(hierarchy, node, observer, tolerance, self.unfolded[node as usize]) {
                self.unfold(hierarchy, node);
                self.stack.extend(hierarchy.children(node));
            } else if self.unfolded[node as usize] {
                self.fold(hierarchy, node);
            }
        }
        self.finish(hierarchy);
        Ok(self.stats)
    }

    /// Unfolds the nodes that would move farthest in the eye until no further one fits into `triangles`; returns the largest displacement
    /// that is left, as a share of the distance from the eye (infinite with the eye within reach of a folded node).
    ///
    /// # Cost
    /// n log n in the nodes of the cut.
    ///
    /// # Panics
    /// When the cut belongs to another hierarchy.
    pub fn update_budget(
        &mut self,
        hierarchy: &VertexHierarchy,
        observer: &Observer,
        triangles: usize,
    ) -> f64 {
        self.begin(hierarchy, &Tolerance::uniform(1.0)).expect("a tolerance in range");
        self.watch.forget();
        let Budget { mut heap, mut wanted } = std::mem::take(&mut self.budget);
        wanted.clear();
        wanted.resize(hierarchy.nodes.len(), false);
        // Errors are not negative, so their bits are in their order.
        let key = |node: u32| (share(hierarchy, node, observer).to_bits(), Reverse(node));
        heap.push(key(0));
        let (mut count, mut left) = (0, 0.0f64);
        while let Some((error, Reverse(node))) = heap.pop() {
            self.stats.tested += 1;
            let more = hierarchy.home_triangles(node).len();
            if count + more > triangles || f64::from_bits(error) == 0.0 {
                left = left.max(f64::from_bits(error));
                continue;
            }
            count += more;
            wanted[node as usize] = true;
            heap.extend(hierarchy.children(node).map(key));
        }
        self.stack.push(0);
        while let Some(node) = self.stack.pop() {
            if wanted[node as usize] {
                self.unfold(hierarchy, node);
                self.stack.extend(hierarchy.children(node));
            } else if self.unfolded[node as usize] {
                self.fold(hierarchy, node);
            }
        }
        self.budget = Budget { heap, wanted };
        self.finish(hierarchy);
        left
    }

    /// Indices into the mesh's vertices (and, for a [textured](VertexHierarchy::build_textured) hierarchy, those appended to them), three a triangle. The order of triangles depends on the past.
    pub fn indices(&self) -> &[u32] {
        self.indices.as_flattened()
    }

    /// The same by triangles.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.indices
    }

    /// The triangle of the mesh that each drawn one comes from.
    pub fn originals<'a>(
        &'a self,
        hierarchy: &'a VertexHierarchy,
    ) -> impl ExactSizeIterator<Item = u32> + 'a {
        self.drawn.iter().map(|&t| hierarchy.original[t as usize])
    }

    /// Places in [`triangles`](Self::triangles) that the last update wrote, ascending: what an index buffer has to be sent. Beyond the
    /// list's end nothing is drawn any more.
    pub fn changed(&self) -> &[u32] {
        &self.changed
    }

    /// Whether everything is folded into one vertex, [`point`](Self::point): nothing is drawn unless the caller draws that.
    pub fn is_point(&self) -> bool {
        !self.unfolded[0]
    }

    /// The mesh vertex that stands for the whole object.
    pub fn point(&self, hierarchy: &VertexHierarchy) -> u32 {
        hierarchy.vertices[hierarchy.nodes[0].representative as usize]
    }

    /// Memory held, in bytes.
    pub fn bytes(&self) -> usize {
        self.unfolded.capacity()
            + (self.proxy.capacity() + self.drawn.capacity() + self.slot.capacity()) * size_of::<u32>()
            + (self.changed.capacity() + self.stack.capacity() + 2 * self.moved.capacity()) * size_of::<u32>()
            + self.indices.capacity() * size_of::<[u32; 3]>()
            + self.budget.wanted.capacity()
            + self.budget.heap.capacity() * size_of::<(u64, u32)>()
            + self.watch.bytes()
    }

    #[cfg(test)]
    pub(crate) fn unfolded_nodes(&self) -> &[bool] {
        &self.unfolded
    }

    pub(crate) fn is_unfolded(&self, node: u32) -> bool {
        self.unfolded[node as usize]
    }

    pub(crate) fn begin(
        &mut self,
        hierarchy: &VertexHierarchy,
        tolerance: &Tolerance,
    ) -> Result<(), LodError> {
        assert!(
            self.unfolded.len() == hierarchy.nodes.len() && self.slot.len() == hierarchy.triangles.len(),
            "the cut belongs to this hierarchy"
        );
        tolerance.check()?;
        self.stats = UpdateStats::default();
        clear(&mut self.changed);
        clear(&mut self.moved);
        clear(&mut self.stack);
        Ok(())
    }

    /// Unfolds a node whose parent is unfolded.
    pub(crate) fn unfold(&mut self, hierarchy: &VertexHierarchy, node: u32) {
        if std::mem::replace(&mut self.unfolded[node as usize], true) {
            return;
        }
        self.stats.unfolded += 1;
        self.note_moved(hierarchy, node);
        let own = hierarchy.own_vertices(node);
        self.proxy[own.clone()].copy_from_slice(&hierarchy.vertices[own]);
        for child in hierarchy.children(node) {
            hierarchy.stand_in(child, &mut self.proxy);
        }
        let home = hierarchy.home_triangles(node);
        let most = hierarchy.triangles.len();
        reserve(&mut self.drawn, home.len(), most);
        reserve(&mut self.indices, home.len(), most);
        for t in home {
            self.slot[t] = self.drawn.len() as u32;
            self.drawn.push(t as u32);
            // Not a triangle yet: written when all corners are in place.
            self.indices.push([NONE; 3]);
        }
    }

    /// Folds a node and all below it.
    pub(crate) fn fold(&mut self, hierarchy: &VertexHierarchy, node: u32) {
        self.note_moved(hierarchy, node);
        hierarchy.stand_in(node, &mut self.proxy);
        let mut next = node;
        while next < hierarchy.nodes[node as usize].end {
            if std::mem::replace(&mut self.unfolded[next as usize], false) {
                self.stats.folded += 1;
                hierarchy.home_triangles(next).for_each(|t| self.remove(t));
                next += 1;
            } else {
                // Nothing below a folded node is unfolded.
                next = hierarchy.nodes[next as usize].end;
            }
        }
    }

    fn remove(&mut self, triangle: usize) {
        let slot = std::mem::replace(&mut self.slot[triangle], NONE) as usize;
        self.drawn.swap_remove(slot);
        self.indices.swap_remove(slot);
        if let Some(&moved) = self.drawn.get(slot) {
            self.slot[moved as usize] = slot as u32;
            self.changed.push(slot as u32);
        }
    }

    fn note_moved(&mut self, hierarchy: &VertexHierarchy, node: u32) {
        let range = hierarchy.vertices_of(node);
        self.moved.push([range.start as u32, range.end as u32]);
    }

    /// Brings the indices up to date: those around the vertices that moved, or all when that is most of them.
    pub(crate) fn finish(&mut self, hierarchy: &VertexHierarchy) {
        // What moved with a larger range has been listed with it.
        self.moved.sort_unstable_by_key(|&[first, end]| (first, Reverse(end)));
        let mut listed = 0;
        self.moved.retain_mut(|[first, end]| {
            *first = listed.max(*first);
            listed = listed.max(*end);
            first < end
        });
        let moved: u32 = self.moved.iter().map(|[first, end]| end - first).sum();
        if moved as usize * AROUND > self.drawn.len() {
            (0..self.drawn.len()).for_each(|slot| self.write(hierarchy, slot));
        } else {
            for i in 0..self.moved.len() {
                let [first, end] = self.moved[i];
                for t in (first as usize..end as usize).flat_map(|v| hierarchy.around(v)) {
                    let slot = self.slot[*t as usize];
                    if slot != NONE {
                        self.write(hierarchy, slot as usize);
                    }
                }
            }
        }
        self.changed.sort_unstable();
        self.changed.dedup();
        let shown = self.changed.partition_point(|&slot| (slot as usize) < self.drawn.len());
        self.changed.truncate(shown);
        self.stats.written = self.changed.len() as u64;
    }

    #[inline]
    fn write(&mut self, hierarchy: &VertexHierarchy, slot: usize) {
        let corners = hierarchy.triangles[self.drawn[slot] as usize].map(|v| self.proxy[v as usize]);
        if corners != self.indices[slot] {
            self.indices[slot] = corners;
            self.changed.push(slot as u32);
        }
    }
}

/// Triangles around a vertex, about, times what finding them costs over going through all in a row.
const AROUND: usize = 12;

/// Empties a list; gives back room that a first frame needed and later ones do not.
pub(crate) fn clear<T>(list: &mut Vec<T>) {
    if list.capacity() > 32 * (list.len() + 64) {
        list.shrink_to(4 * (list.len() + 64));
    }
    list.clear();
}

/// Room for more, an eighth at a time and never for more than `most`.
fn reserve<T>(list: &mut Vec<T>, more: usize, most: usize) {
    let needed = list.len() + more;
    if needed > list.capacity() {
        list.reserve_exact((needed + needed / 8).min(most) - list.len());
    }
}

/// Whether a node's vertices would move farther than the observer tolerates if it were folded.
pub(crate) fn wants_unfolding(
    hierarchy: &VertexHierarchy,
    node: u32,
    observer: &Observer,
    tolerance: &Tolerance,
    is_unfolded: bool,
) -> bool {
    let n = &hierarchy.nodes[node as usize];
    wants_unfolding_from(n, observer.distance(n.center.as_dvec3()), observer, tolerance, is_unfolded)
}

/// The same from a known distance of the observer.
#[inline]
pub(crate) fn wants_unfolding_from(
    n: &Node,
    distance: f64,
    observer: &Observer,
    tolerance: &Tolerance,
    is_unfolded: bool,
) -> bool {
    let limit = |tau| limit(n, tau, tolerance, is_unfolded);
    if distance < limit(tolerance.back) {
        return true;
    }
    if distance >= limit(tolerance.silhouette) {
        return false;
    }
    distance < limit(tau_of(observer.facing(n, n.center.as_dvec3()).class, tolerance))
}

pub(crate) fn tau_of(class: Class, tolerance: &Tolerance) -> f64 {
    match class {
        Class::Front => tolerance.tau,
        Class::Silhouette => tolerance.silhouette,
        Class::Back => tolerance.back,
    }
}

/// The distance from which on a node may be folded: δ ≤ τ·(distance − reach), as no point that it moves is farther than its reach from
/// its representative.
pub(crate) fn limit(node: &Node, tau: f64, tolerance: &Tolerance, is_unfolded: bool) -> f64 {
    let tau = if is_unfolded { tau * (1.0 - tolerance.hysteresis) } else { tau };
    if node.radius == 0.0 { 0.0 } else { f64::from(node.radius) / tau + f64::from(node.reach) }
}

/// How far a folded node's vertices move, as a share of the distance of the nearest point that this moves.
fn share(hierarchy: &VertexHierarchy, node: u32, observer: &Observer) -> f64 {
    let n = &hierarchy.nodes[node as usize];
    let free = observer.distance(n.center.as_dvec3()) - f64::from(n.reach);
    match n.radius {
        0.0 => 0.0,
        _ if free <= 0.0 => f64::INFINITY,
        radius => f64::from(radius) / free,
    }
}
