//! Object sets for the simulated card: a city of boxes and spheres, a forest of triangle soups.

use crate::{Faces, Features};
use farsight_geometry::frustum::Containment;
use farsight_geometry::sampling::Random;
use farsight_geometry::{Camera, Frustum, Sphere, TriangleMesh};
use glam::{DAffine3, DVec3, Vec3};

/// Entries of the simulated card's vertex cache: what triangles miss there is counted once, for the card and for features alike.
const CACHE_SIZE: u32 = 24;

/// An object at one level of detail.
#[derive(Clone, Debug)]
pub struct SimLevel {
    /// Its surface, in world coordinates.
    pub mesh: TriangleMesh,
    /// What is the same from everywhere.
    pub features: Features,
    /// Vertices of each triangle that miss the cache.
    pub(crate) misses: Vec<u8>,
}

/// An object with its levels of detail.
#[derive(Clone, Debug)]
pub struct SimObject {
    /// Levels, finest first; each about half of the one before.
    pub levels: Vec<SimLevel>,
    /// Around the finest level.
    pub sphere: Sphere,
}

impl SimObject {
    fn new(meshes: impl IntoIterator<Item = TriangleMesh>) -> Self {
        let levels: Vec<SimLevel> = meshes.into_iter().map(SimLevel::new).collect();
        let sphere = Sphere::around_box(&levels[0].mesh.world_bounds());
        Self { levels, sphere }
    }

    /// What a level asks of the card from a view.
    pub fn features(&self, level: usize, camera: &Camera) -> Features {
        let l = &self.levels[level];
        l.features.seen(&l.mesh, &DAffine3::IDENTITY, camera, Faces::Both)
    }
}

impl SimLevel {
    fn new(mesh: TriangleMesh) -> Self {
        let mut cache = std::collections::VecDeque::new();
        let miss = |cache: &mut std::collections::VecDeque<u32>, i: u32| {
            let missed = !cache.contains(&i);
            if missed {
                cache.push_back(i);
                if cache.len() > CACHE_SIZE as usize {
                    cache.pop_front();
                }
            }
            u8::from(missed)
        };
        let misses = mesh.triangles().iter().map(|t| t.iter().map(|&i| miss(&mut cache, i)).sum()).collect();
        let features = Features::of_mesh(&mesh, CACHE_SIZE).expect("a mesh's indices lead somewhere");
        Self { mesh, features, misses }
    }
}

/// Objects to draw, and paths among them.
#[derive(Clone, Debug)]
pub struct SimScene {
    /// "city" or "forest".
    pub name: &'static str,
    /// The objects.
    pub objects: Vec<SimObject>,
    radius: f64,
}

impl SimScene {
    /// 260 boxes and spheres of well-shaped triangles on a square of 340 m.
    pub fn city(seed: u64) -> Self {
        let mut random = Random::new(seed);
        let object = |i: u32| {
            let cell = DVec3::new(f64::from(i % 17), f64::from(i / 17), 0.0) - DVec3::new(8.0, 7.5, 0.0);
            let jitter = DVec3::new(random.unit() - 0.5, random.unit() - 0.5, 0.0) * 5.0;
            let at = cell * 20.0 + jitter;
            let box_like = random.unit() < 0.65;
            let half = if box_like {
                DVec3::new(3.0 + 4.0 * random.unit(), 3.0 + 4.0 * random.unit(), 4.0 + 11.0 * random.unit())
            } else {
                DVec3::splat(1.0 + 3.0 * random.unit())
            };
            let finest = if box_like { 4 + random.below(5) } else { 8 + random.below(9) } as u32;
            let levels = (0..5).map(|k| (f64::from(finest) * 0.7f64.powi(k)).round().max(1.0) as u32);
            SimObject::new(levels.map(|n| lump(n, at + DVec3::Z * half.z, half, box_like)))
        };
        Self { name: "city", objects: (0..260).map(object).collect(), radius: 110.0 }
    }

    /// 90 soups of triangles whose edges are between 1 cm and 2 m, log-uniform.
    pub fn forest(seed: u64) -> Self {
        let mut random = Random::new(seed);
        let object = |i: u32| {
            let cell = DVec3::new(f64::from(i % 10), f64::from(i / 10), 0.0) - DVec3::new(4.5, 4.0, 0.0);
            let at = cell * 12.0 + DVec3::new(random.unit() - 0.5, random.unit() - 0.5, 0.0) * 7.0;
            let leaves = soup(1200 + random.below(1200) as u32, at + DVec3::Z * 4.0, &mut random);
            let part = |k: u32| {
                let kept: Vec<DVec3> = leaves.chunks(3).step_by(1 << k).flatten().copied().collect();
                let triangles = (0..kept.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
                TriangleMesh::from_world(&kept, triangles).expect("small and finite")
            };
            SimObject::new((0..5).map(part))
        };
        Self { name: "forest", objects: (0..90).map(object).collect(), radius: 42.0 }
    }

    /// The camera at `t` from 0 to 1 on one of several closed paths among the objects.
    pub fn camera(&self, path: u32, t: f64) -> Camera {
        let (p, turn) = (f64::from(path), std::f64::consts::TAU * t);
        let r = self.radius * (0.55 + 0.3 * ((2.0 + p) * turn + p).sin());
        let height = 3.0 + 0.12 * self.radius * (1.0 + (3.0 * turn + 2.0 * p).sin());
        let eye = DVec3::new(r * (turn + p).cos(), r * (turn + p).sin(), height);
        let heading = turn + p + 2.0 + 0.9 * (2.0 * turn + p).sin();
        let target = eye + DVec3::new(heading.cos(), heading.sin(), -0.12);
        let camera = Camera::look_at(eye, target, DVec3::Z).and_then(|c| c.with_image(800, 600));
        camera.and_then(|c| c.with_range(0.2, 2000.0)).expect("the path never looks up or down")
    }

    /// The objects in view, near ones first.
    pub fn visible(&self, camera: &Camera) -> Vec<usize> {
        let frustum = Frustum::from_camera(camera);
        let distance = |i: &usize| self.objects[*i].sphere.center.distance_squared(camera.eye());
        let mut seen: Vec<usize> = (0..self.objects.len())
            .filter(|&i| frustum.classify_sphere(&self.objects[i].sphere) != Containment::Outside)
            .collect();
        seen.sort_by(|a, b| distance(a).total_cmp(&distance(b)).then(a.cmp(b)));
        seen
    }
}

/// A box or an ellipsoid whose six faces have `n` x `n` cells.
fn lump(n: u32, center: DVec3, half: DVec3, box_like: bool) -> TriangleMesh {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for face in 0..6 {
        let sign = if face < 3 { 1.0 } else { -1.0 };
        let (w, u, v) = (axes[face % 3] * sign, axes[(face + 1) % 3] * sign, axes[(face + 2) % 3]);
        let base = positions.len() as u32;
        for i in 0..(n + 1) * (n + 1) {
            let at = |k: u32| 2.0 * f64::from(k) / f64::from(n) - 1.0;
            let cube = w + u * at(i % (n + 1)) + v * at(i / (n + 1));
            positions.push(center + if box_like { cube } else { cube.normalize() } * half);
        }
        for i in 0..n * n {
            let a = base + i / n * (n + 1) + i % n;
            triangles.extend([[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]);
        }
    }
    TriangleMesh::from_world(&positions, triangles).expect("small and finite")
}

/// Corners of separate triangles in a ball of 3.5 m.
fn soup(count: u32, center: DVec3, random: &mut Random) -> Vec<DVec3> {
    let mut corners = Vec::with_capacity(3 * count as usize);
    let mut direction = || {
        let (z, turn) = (2.0 * random.unit() - 1.0, std::f64::consts::TAU * random.unit());
        let r = (1.0 - z * z).max(0.0).sqrt();
        (DVec3::new(r * turn.cos(), r * turn.sin(), z), random.unit())
    };
    for _ in 0..count {
        let (out, along) = direction();
        let at = center + out * (3.5 * along.cbrt());
        for _ in 0..3 {
            let (d, size) = direction();
            // Small ones are far more numerous than large ones, as leaves and trunks are.
            corners.push(at + d * (0.005 * 200f64.powf(size * size)));
        }
    }
    debug_assert!(corners.iter().all(|c| c.as_vec3().cmplt(Vec3::splat(1e6)).all()));
    corners
}
