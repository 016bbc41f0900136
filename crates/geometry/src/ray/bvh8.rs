//! The watertight eight-wide tree over one mesh.

use super::build::{self, Item};
use super::bundle::{Bundle, FEWEST, Waiting, close_together};
use super::collapse::Wide;
use super::exact::{Faces, Sheared};
use super::frame::Frame;
use super::single::{Best, Place, Stack, Walk, trace};
use super::tree::{BLOCK, Block, Node, Tree, WIDTH};
use super::{Hit, Ray, RayCaster};
use crate::bounds::Aabb;
use crate::mesh::TriangleMesh;
use fearless_simd::{Level, Simd, dispatch};
use glam::DVec3;

/// Rays that one job of a parallel batch traces.
#[cfg(feature = "rayon")]
const JOB: usize = 1024;

/// Which instructions a caster uses. Results do not depend on it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum SimdLevel {
    /// The fastest for this kernel that the processor has: AVX2, SSE4.2 or SSE2; NEON; WebAssembly SIMD.
    #[default]
    Detect,
    /// What every processor of the compilation target has (SSE2 on x86-64).
    Baseline,
}

impl SimdLevel {
    pub(super) fn level(self) -> Level {
        match self {
            Self::Detect => {
                let level = Level::new();
                // Eight lanes are the natural width here; AVX-512 was slower.
                #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
                if let Some(avx2) = level.as_avx2() {
                    return Level::Avx2(avx2);
                }
                level
            }
            Self::Baseline => Level::baseline(),
        }
    }
}

/// A bounding volume hierarchy with eight children per node over one mesh.
///
/// # Accuracy
/// Hits are those of Woop's sheared test in `f64` with every triangle of the mesh, whatever its vertices' magnitude
/// (1e-18 to 1e18) and the mesh's origin. No ray passes between triangles that share an edge or a vertex. `t` is a
/// convex combination of the corners' distances along the ray's main axis. Its error is below 1e-15 of the largest
/// coordinate difference between origin and triangle, times the square of the triangle's longest edge over twice the area
/// that the ray sees: slivers and grazed triangles cost digits, a ray within a triangle's plane all of them. The answer, ties included, is the same
/// bits for single rays, batches and bundles, for any number of threads and on any processor.
///
/// Triangles without area are never hit.
///
/// # Cost
/// About 60 bytes a triangle. O(n log n) to build, in parallel with the feature `rayon`.
///
/// # References
/// [Woop 2013] watertight test; [Wald 2007] binned builder; [Ize 2013] margins of the box test. Differs: `f32` tests
/// with proven margins only filter for the `f64` test, areas are weighted by the number of blocks instead of triangles.
///
/// ```
/// use farsight_geometry::{Ray, RayCaster, TriangleMesh, glam::{DVec3, Vec3}, ray::Bvh8};
///
/// let corners = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
/// let caster = Bvh8::new(&TriangleMesh::new(corners, vec![[0, 1, 2]])?);
/// let down = Ray::new(DVec3::new(0.25, 0.5, 3.0), DVec3::NEG_Z).unwrap();
/// let hit = caster.closest(&down).unwrap();
/// assert_eq!((hit.t, hit.triangle, hit.back_face), (3.0, 0, false));
/// # Ok::<(), farsight_geometry::MeshError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Bvh8 {
    pub(super) frame: Frame,
    pub(super) tree: Tree,
    pub(super) level: Level,
    faces: Faces,
    triangles: usize,
}

impl Bvh8 {
    /// Builds the tree with the surface-area heuristic.
    pub fn new(mesh: &TriangleMesh) -> Self {
        let frame = Frame::of_mesh(mesh);
        let corners = |id: u32| mesh.corners(id as usize).map(|p| frame.vertex(p));
        let count = mesh.triangles().len() as u32;
        let item = |id: u32| Item::new(id, &Aabb::from_points(corners(id)));
        #[cfg(feature = "rayon")]
        let items = {
            use rayon::prelude::*;
            (0..count).into_par_iter().map(item).collect()
        };
        #[cfg(not(feature = "rayon"))]
        let items = (0..count).map(item).collect();
        Self::with_tree(mesh, frame, build::build(items, WIDTH))
    }

    pub(super) fn with_tree(mesh: &TriangleMesh, frame: Frame, wide: Wide) -> Self {
        let Wide { nodes, leaves, items, bounds } = wide;
        let block = |range: &[u32; 2]| {
            let items = &items[range[0] as usize..range[1] as usize];
            Block::new(
                items.iter().map(|item| (item.id, mesh.corners(item.id as usize).map(|p| frame.vertex(p)))),
            )
        };
        #[cfg(feature = "rayon")]
        let blocks = {
            use rayon::prelude::*;
            leaves.par_iter().map(block).collect()
        };
        #[cfg(not(feature = "rayon"))]
        let blocks = leaves.iter().map(block).collect();
        let (tree, triangles) = (Tree { nodes, blocks, bounds }, mesh.triangles().len());
        Self { frame, tree, level: SimdLevel::Detect.level(), faces: Faces::BOTH, triangles }
    }

    /// The same caster with other instructions; for measurements.
    #[must_use]
    pub fn with_simd(self, simd: SimdLevel) -> Self {
        Self { level: simd.level(), ..self }
    }

    /// The same caster for front faces only: rays pass through the backs of triangles, as pictures drawn with back-face
    /// culling have it.
    #[must_use]
    pub fn front_faces_only(self) -> Self {
        Self { faces: Faces::FRONT, ..self }
    }

    /// Number of triangles.
    pub fn triangle_count(&self) -> usize {
        self.triangles
    }

    /// Number of nodes, and of blocks of up to eight triangles.
    pub fn node_and_block_count(&self) -> (usize, usize) {
        (self.tree.nodes.len(), self.tree.blocks.len())
    }

    /// Bytes that the tree holds.
    pub fn bytes(&self) -> u64 {
        (size_of_val(&self.tree.nodes[..]) + size_of_val(&self.tree.blocks[..])) as u64
    }

    /// Levels of nodes.
    pub fn depth(&self) -> usize {
        fn below(nodes: &[Node], index: u32) -> usize {
            let node = &nodes[index as usize];
            let inner = (0..8).filter(|&i| node.bounds[0][0][i] <= node.bounds[0][1][i]);
            let inner = inner.map(|i| node.children[i]).filter(|child| child & BLOCK == 0);
            1 + inner.map(|child| below(nodes, child)).max().unwrap_or(0)
        }
        if self.tree.nodes.is_empty() { 0 } else { below(&self.tree.nodes, 0) }
    }

    /// Whether two casters hold the same tree, byte for byte.
    pub fn same_tree(&self, other: &Self) -> bool {
        let blocks = |tree: &Tree| tree.blocks.iter().map(Block::bits).collect::<Vec<_>>();
        self.tree.nodes == other.tree.nodes && blocks(&self.tree) == blocks(&other.tree)
    }
}

#[inline(always)]
fn trace_one<S: Simd, const ANY: bool>(simd: S, caster: &Bvh8, ray: &Ray, stack: &mut Stack) -> Option<Hit> {
    let bounds = caster.tree.bounds.as_ref()?;
    let (origin, direction) = (caster.frame.point(ray.origin), caster.frame.vector(ray.direction));
    let sheared = Sheared::new(origin, direction, ray.t_min, ray.t_max).with_faces(caster.faces);
    let walk = Walk::new(bounds, origin, direction, &sheared)?;
    let mut best = Best::NONE;
    trace::<S, ANY>(simd, &caster.tree, &sheared, &walk, 0, stack, &mut best);
    best.hit()
}

/// Rays that a batch traces in turns, so that the processor works on one while another waits for memory.
const IN_TURNS: usize = 2;

/// A ray on its way.
struct Turn {
    /// Whose hit it is.
    index: usize,
    ray: Sheared,
    walk: Walk,
    place: Place,
    best: Best,
}

impl Turn {
    /// The next ray that meets the tree's box.
    #[inline(always)]
    fn next(caster: &Bvh8, rays: &[Ray], at: &mut usize) -> Option<Self> {
        let bounds = caster.tree.bounds.as_ref()?;
        while let Some(ray) = rays.get(*at) {
            let (index, best) = (*at, Best::NONE);
            *at += 1;
            let (origin, direction) = (caster.frame.point(ray.origin), caster.frame.vector(ray.direction));
            let ray = Sheared::new(origin, direction, ray.t_min, ray.t_max).with_faces(caster.faces);
            if let Some(walk) = Walk::new(bounds, origin, direction, &ray) {
                let place = Place::start(&walk, &ray, &best);
                return Some(Self { index, ray, walk, place, best });
            }
        }
        None
    }

    #[inline(always)]
    fn step<S: Simd>(&mut self, simd: S, tree: &Tree, stack: &mut Stack) -> bool {
        self.place.step::<S, false>(simd, tree, &self.ray, &self.walk, 0, stack, &mut self.best)
    }
}

#[inline(always)]
fn trace_all<S: Simd>(simd: S, caster: &Bvh8, rays: &[Ray], hits: &mut [Option<Hit>]) {
    hits.fill(None);
    let (tree, mut at) = (&caster.tree, 0);
    let mut stacks = [const { Stack::new() }; IN_TURNS];
    let mut turns = [const { None }; IN_TURNS];
    for turn in &mut turns {
        *turn = Turn::next(caster, rays, &mut at);
    }
    while let [Some(a), Some(b)] = &mut turns {
        if !a.step(simd, tree, &mut stacks[0]) {
            hits[a.index] = a.best.hit();
            turns[0] = Turn::next(caster, rays, &mut at);
        } else if !b.step(simd, tree, &mut stacks[1]) {
            hits[b.index] = b.best.hit();
            turns[1] = Turn::next(caster, rays, &mut at);
        }
    }
    for (turn, stack) in turns.iter_mut().zip(&mut stacks) {
        if let Some(turn) = turn {
            while turn.step(simd, tree, stack) {}
            hits[turn.index] = turn.best.hit();
        }
    }
}

/// Rays of one origin: those close together as bundles, the others one by one.
#[inline(always)]
fn trace_bundle<S: Simd>(
    simd: S,
    caster: &Bvh8,
    origin: DVec3,
    mut directions: &[DVec3],
    mut hits: &mut [Option<Hit>],
) {
    let (mut waiting, mut bundle, mut stack) = (Waiting::new(), Bundle::new(caster.faces), Stack::new());
    while !directions.is_empty() {
        let count = close_together(directions);
        let (these, others) = directions.split_at(count);
        let (theirs, rest) = hits.split_at_mut(count);
        (directions, hits) = (others, rest);
        if count >= FEWEST && bundle.set(simd, &caster.frame, origin, these) {
            bundle.trace(simd, &caster.tree, 0, &mut waiting);
            bundle.store(theirs);
            continue;
        }
        for (&direction, hit) in these.iter().zip(theirs) {
            let ray = Ray::new(origin, direction);
            *hit = ray.and_then(|ray| trace_one::<S, false>(simd, caster, &ray, &mut stack));
        }
    }
}

impl RayCaster for Bvh8 {
    fn closest_bundle(&self, origin: DVec3, directions: &[DVec3], hits: &mut [Option<Hit>]) {
        dispatch!(self.level, simd => trace_bundle(simd, self, origin, directions, hits));
    }

    fn closest(&self, ray: &Ray) -> Option<Hit> {
        dispatch!(self.level, simd => trace_one::<_, false>(simd, self, ray, &mut Stack::new()))
    }

    fn closest_batch(&self, rays: &[Ray], hits: &mut [Option<Hit>]) {
        #[cfg(feature = "rayon")]
        if rays.len() > JOB {
            use rayon::prelude::*;
            rays.par_chunks(JOB)
                .zip(hits.par_chunks_mut(JOB))
                .for_each(|(rays, hits)| dispatch!(self.level, simd => trace_all(simd, self, rays, hits)));
            return;
        }
        dispatch!(self.level, simd => trace_all(simd, self, rays, hits));
    }

    fn occluded(&self, ray: &Ray) -> bool {
        dispatch!(self.level, simd => trace_one::<_, true>(simd, self, ray, &mut Stack::new())).is_some()
    }
}
