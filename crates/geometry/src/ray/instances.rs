//! Whole scenes: a tree of instances over the trees of their meshes.

use super::build::{self, Item};
use super::bvh8::Bvh8;
use super::exact::{Faces, Sheared};
use super::single::{Best, Stack, Walk, trace};
use super::tree::{BLOCK, Node};
use super::{Hit, Ray, RayCaster, SimdLevel};
use crate::bounds::{Aabb, DAabb};
use crate::scene::Scene;
use fearless_simd::{Level, Simd, dispatch};
use glam::{DAffine3, DVec3};

/// Rays that one job of a parallel batch traces.
#[cfg(feature = "rayon")]
const JOB: usize = 512;

/// Why a scene cannot be traced.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SceneCasterError {
    /// The placement of an instance flattens it or cannot be inverted in `f64`.
    #[error("instance {instance} ('{name}') has a placement without inverse")]
    Singular {
        /// Its index.
        instance: u32,
        /// Its name.
        name: String,
    },
}

/// Casts rays into all instances of a [`Scene`]; hits name instance and triangle.
///
/// Meshes are stored once, however often they are placed. Rays are taken to each mesh in `f64`; mirrored and unevenly
/// scaled placements are fine. `back_face` is told in the world: a mirroring placement swaps the sides back.
///
/// # Accuracy
/// As [`Bvh8`], plus the rounding of the inverse placement applied to the ray (about 1e-15 of the world coordinates).
/// Neighbouring triangles of one instance never leak; two instances that share an edge may.
///
/// # Cost
/// The meshes' trees, and about 300 bytes an instance.
#[derive(Clone, Debug)]
pub struct SceneCaster {
    meshes: Vec<Option<Bvh8>>,
    placed: Vec<Placed>,
    nodes: Vec<Node>,
    /// The instance tree's own coordinates: centre and units per world unit.
    centre: DVec3,
    scale: f64,
    level: Level,
    faces: Faces,
}

#[derive(Clone, Debug)]
struct Placed {
    instance: u32,
    mesh: u32,
    mesh_from_world: DAffine3,
    bounds: DAabb,
    mirrored: bool,
}

impl SceneCaster {
    /// Builds a tree for every mesh that is placed, and one over the instances.
    ///
    /// # Errors
    /// [`SceneCasterError::Singular`] names the first instance whose placement has no inverse. Those that are shrunk to a line or a point are left out: no ray
    /// hits them, and files hide objects that way.
    pub fn new(scene: &Scene) -> Result<Self, SceneCasterError> {
        let mut meshes = vec![None; scene.meshes().len()];
        let mut placed = Vec::with_capacity(scene.instances().len());
        for (index, instance) in scene.instances().iter().enumerate() {
            let matrix = instance.world_from_mesh.matrix3;
            let mesh_from_world = instance.world_from_mesh.inverse();
            let [x, y, z] = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
            if [x.cross(y), y.cross(z), z.cross(x)] == [DVec3::ZERO; 3] {
                continue;
            }
            let sound = matrix.determinant() != 0.0 && mesh_from_world.is_finite();
            if !sound {
                let (instance, name) = (index as u32, instance.name.clone());
                return Err(SceneCasterError::Singular { instance, name });
            }
            let mesh = scene.mesh_of(instance);
            if mesh.is_empty() {
                continue;
            }
            meshes[instance.mesh.0 as usize].get_or_insert_with(|| Bvh8::new(mesh));
            let bounds = mesh.world_bounds().transformed(&instance.world_from_mesh);
            // Corners are rounded relative to all that is added up for them.
            let corner = mesh.world_bounds().min.abs().max(mesh.world_bounds().max.abs());
            let size = matrix.abs() * corner + instance.world_from_mesh.translation.abs();
            placed.push(Placed {
                instance: index as u32,
                mesh: instance.mesh.0,
                mesh_from_world,
                bounds: bounds.inflated(1e-14 * size.max_element()),
                mirrored: matrix.determinant() < 0.0,
            });
        }
        let all = placed.iter().fold(DAabb::EMPTY, |all, p| all.union(p.bounds));
        let centre = if all.is_empty() { DVec3::ZERO } else { all.center() };
        let largest = if all.is_empty() { 0.0 } else { all.extent().max_element() };
        let scale = if largest > 0.0 { 1.0 / largest } else { 1.0 };
        let items = placed.iter().enumerate().map(|(i, p)| {
            let local = |v: DVec3| (v - centre) * scale;
            let (min, max) = (local(p.bounds.min).as_vec3(), local(p.bounds.max).as_vec3());
            Item::new(i as u32, &Aabb::new(min, max).inflated(1e-6))
        });
        let wide = build::build(items.collect(), 1);
        let mut nodes = wide.nodes;
        for node in &mut nodes {
            for child in &mut node.children {
                // Leaves hold one instance each; enter it directly.
                if *child & BLOCK != 0 {
                    let leaf = wide.leaves[(*child & !BLOCK) as usize];
                    *child = BLOCK | wide.items[leaf[0] as usize].id;
                }
            }
        }
        Ok(Self {
            meshes,
            placed,
            nodes,
            centre,
            scale,
            level: SimdLevel::Detect.level(),
            faces: Faces::BOTH,
        })
    }

    /// The same caster for front faces only, as they are in the world: rays pass through the backs of triangles.
    #[must_use]
    pub fn front_faces_only(self) -> Self {
        Self { faces: Faces::FRONT, ..self }
    }

    /// Bytes that the trees hold.
    pub fn bytes(&self) -> u64 {
        let meshes: u64 = self.meshes.iter().flatten().map(Bvh8::bytes).sum();
        meshes + (size_of_val(&self.nodes[..]) + size_of_val(&self.placed[..])) as u64
    }

    /// Visits instances whose boxes the ray meets before the best hit, nearest first.
    #[inline(always)]
    fn walk<S: Simd, const ANY: bool>(&self, simd: S, ray: &Ray, scratch: &mut Scratch) -> Option<Hit> {
        let mut best = Best::NONE;
        let origin = (ray.origin() - self.centre) * self.scale;
        let direction = ray.direction() * self.scale;
        let inverse = DVec3::ONE / direction;
        let waiting = &mut scratch.waiting;
        waiting.clear();
        if !self.nodes.is_empty() {
            waiting.push((f64::NEG_INFINITY, 0));
        }
        while let Some((distance, current)) = waiting.pop() {
            let limit = if best.t < ray.t_max() { best.t } else { ray.t_max() };
            if distance > limit {
                continue;
            }
            if current & BLOCK != 0 {
                let placed = &self.placed[(current & !BLOCK) as usize];
                self.enter::<S, ANY>(simd, placed, ray, &mut scratch.stack, &mut best);
                if ANY && best.hit().is_some() {
                    break;
                }
                continue;
            }
            let node = &self.nodes[current as usize];
            let first = waiting.len();
            for lane in 0..8 {
                let (enter, leave) = slab(node, lane, origin, direction, inverse);
                if enter <= leave && enter <= limit && leave >= ray.t_min() {
                    waiting.push((enter, node.children[lane]));
                }
            }
            waiting[first..].sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(b.1.cmp(&a.1)));
        }
        best.hit()
    }

    #[inline(always)]
    fn enter<S: Simd, const ANY: bool>(
        &self,
        simd: S,
        placed: &Placed,
        ray: &Ray,
        stack: &mut Stack,
        best: &mut Best,
    ) {
        let Some(caster) = &self.meshes[placed.mesh as usize] else { return };
        let Some(bounds) = &caster.tree.bounds else { return };
        let origin = caster.frame.point(placed.mesh_from_world.transform_point3(ray.origin()));
        let direction = placed.mesh_from_world.transform_vector3(ray.direction());
        let direction = caster.frame.vector(direction) + DVec3::ZERO;
        if direction == DVec3::ZERO || !direction.is_finite() || !origin.is_finite() {
            return;
        }
        let faces = self.faces.mirrored(placed.mirrored);
        let sheared = Sheared::new(origin, direction, ray.t_min(), ray.t_max()).with_faces(faces);
        let Some(walk) = Walk::new(bounds, origin, direction, &sheared) else { return };
        let before = best.key;
        trace::<S, ANY>(simd, &caster.tree, &sheared, &walk, u64::from(placed.instance), stack, best);
        if best.key != before && placed.mirrored {
            best.mirror();
        }
    }
}

struct Scratch {
    waiting: Vec<(f64, u32)>,
    stack: Stack,
}

impl Scratch {
    fn new() -> Self {
        Self { waiting: Vec::with_capacity(64), stack: Stack::new() }
    }
}

/// Where a ray enters and leaves a child box, a little widened. Zero components give infinities, never NaN, as the boxes
/// are padded and the comparison drops what is not a number.
#[inline(always)]
fn slab(node: &Node, lane: usize, origin: DVec3, direction: DVec3, inverse: DVec3) -> (f64, f64) {
    let pad = 1e-14 * (1.0 + origin.abs().max_element());
    let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
    for axis in 0..3 {
        let lower = f64::from(node.bounds[axis][0][lane]) - pad - origin[axis];
        let upper = f64::from(node.bounds[axis][1][lane]) + pad - origin[axis];
        if lower > upper {
            return (f64::INFINITY, f64::NEG_INFINITY);
        }
        if direction[axis] == 0.0 {
            if lower > 0.0 || upper < 0.0 {
                return (f64::INFINITY, f64::NEG_INFINITY);
            }
            continue;
        }
        let (a, b) = (lower * inverse[axis], upper * inverse[axis]);
        enter = enter.max(a.min(b));
        leave = leave.min(a.max(b));
    }
    (enter, leave)
}

#[inline(always)]
fn cast_all<S: Simd>(simd: S, caster: &SceneCaster, rays: &[Ray], hits: &mut [Option<Hit>]) {
    let mut scratch = Scratch::new();
    for (ray, hit) in rays.iter().zip(hits) {
        *hit = caster.walk::<S, false>(simd, ray, &mut scratch);
    }
}

impl RayCaster for SceneCaster {
    fn closest(&self, ray: &Ray) -> Option<Hit> {
        dispatch!(self.level, simd => self.walk::<_, false>(simd, ray, &mut Scratch::new()))
    }

    fn closest_batch(&self, rays: &[Ray], hits: &mut [Option<Hit>]) {
        #[cfg(feature = "rayon")]
        if rays.len() > JOB {
            use rayon::prelude::*;
            rays.par_chunks(JOB)
                .zip(hits.par_chunks_mut(JOB))
                .for_each(|(rays, hits)| dispatch!(self.level, simd => cast_all(simd, self, rays, hits)));
            return;
        }
        dispatch!(self.level, simd => cast_all(simd, self, rays, hits));
    }

    fn occluded(&self, ray: &Ray) -> bool {
        dispatch!(self.level, simd => self.walk::<_, true>(simd, ray, &mut Scratch::new())).is_some()
    }
}
