//! A town for the simulator: objects of few triangles that stand for many.

use farsight_geometry::bvh::Bvh;
use farsight_geometry::glam::{DVec3, Vec3};
use farsight_geometry::{Camera, DAabb};
use farsight_raster::Random;
use farsight_raster::scenes::Path;

/// An object: positions relative to `origin`, drawn as they are, costed as if it had `nominal_triangles`.
#[derive(Clone, Debug)]
pub struct Object {
    pub origin: DVec3,
    pub positions: Vec<Vec3>,
    pub triangles: &'static [[u32; 3]],
    pub nominal_triangles: u32,
}

impl Object {
    pub fn bounds(&self) -> DAabb {
        DAabb::from_points(self.positions.iter().map(|p| self.origin + p.as_dvec3()))
    }

    /// A box.
    pub fn cuboid(min: DVec3, size: DVec3, nominal_triangles: u32) -> Self {
        let corner = |i: usize| {
            let pick = |bit: usize, s: f64| if i & bit == 0 { 0.0 } else { s as f32 };
            Vec3::new(pick(1, size.x), pick(2, size.y), pick(4, size.z))
        };
        Self {
            origin: min,
            positions: (0..8).map(corner).collect(),
            triangles: &DAabb::TRIANGLES,
            nominal_triangles,
        }
    }

    /// An octahedron: fills a sixth of its box.
    pub fn octahedron(center: DVec3, half: DVec3, nominal_triangles: u32) -> Self {
        let h = half.as_vec3();
        let positions =
            [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z].map(|d| d * h).to_vec();
        Self { origin: center, positions, triangles: &OCTAHEDRON, nominal_triangles }
    }
}

const OCTAHEDRON: [[u32; 3]; 8] =
    [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];

/// Objects and the tree over them.
#[derive(Clone, Debug)]
pub struct World {
    pub objects: Vec<Object>,
    pub bvh: Bvh,
}

impl World {
    pub fn new(objects: Vec<Object>) -> Self {
        let boxes: Vec<DAabb> = objects.iter().map(Object::bounds).collect();
        let bvh = Bvh::build(&boxes).expect("finite boxes");
        Self { objects, bvh }
    }
}

/// Distance from one building to the next.
pub const PITCH: f64 = 30.0;

/// `side`² buildings with five props each: 40 gives 9,600 objects that stand for 27.2 M triangles.
pub fn town(side: u32, seed: u64) -> World {
    let mut random = Random::new(seed);
    let mut objects = Vec::new();
    for y in 0..side {
        for x in 0..side {
            let corner = DVec3::new(f64::from(x), f64::from(y), 0.0) * PITCH;
            let size =
                DVec3::new(random.range(17.0, 22.0), random.range(17.0, 22.0), random.range(9.0, 30.0));
            let inset = (DVec3::new(22.0, 22.0, 0.0) - size) * DVec3::new(0.5, 0.5, 0.0);
            objects.push(Object::cuboid(corner + inset, size, 9000));
            for _ in 0..5 {
                let along = random.range(0.0, PITCH);
                let across = random.range(22.5, 29.5);
                let (px, py) = if random.chance(0.5) { (along, across) } else { (across, along) };
                let half = DVec3::new(random.range(0.2, 0.8), random.range(0.2, 0.8), random.range(0.3, 1.5));
                let center = corner + DVec3::new(px, py, half.z);
                objects.push(if random.chance(0.5) {
                    Object::octahedron(center, half, 1600)
                } else {
                    Object::cuboid(center - half, 2.0 * half, 1600)
                });
            }
        }
    }
    World::new(objects)
}

/// Objects that hide nothing: small, far apart, seen from above.
pub fn field(side: u32, seed: u64) -> World {
    let mut random = Random::new(seed);
    let objects = (0..side * side).map(|i| {
        let at = DVec3::new(f64::from(i % side), f64::from(i / side), 0.0) * 12.0;
        let jitter = DVec3::new(random.range(0.0, 2.0), random.range(0.0, 2.0), 0.6);
        Object::cuboid(at + jitter, DVec3::new(7.0, 7.0, random.range(0.5, 1.2)), 2800)
    });
    World::new(objects.collect())
}

/// The walks of the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Walk {
    Street,
    Rise,
    Turn,
    Static,
    Flyover,
}

impl Walk {
    /// The camera of frame `i` of `n` over a town of the given side.
    pub fn camera(self, side: u32, i: usize, n: usize, px: [u32; 2]) -> Camera {
        let extent = f64::from(side) * PITCH;
        let street = |k: f64| k * PITCH - 4.0;
        let (x, y) = (street((f64::from(side) * 0.5).floor()), street((f64::from(side) * 0.4).floor()));
        let p = DVec3::new;
        let t = if n > 1 { i as f64 / (n - 1) as f64 } else { 0.0 };
        let (eye, target) = match self {
            // A metre a frame: 60 km/h at 16 frames a second, brisk for a walk.
            Walk::Street => {
                let from = street(3.0);
                let path = Path::through(vec![
                    (p(from, y, 1.7), p(from + 40.0, y, 2.5)),
                    (p(from + 0.5 * n as f64, y, 1.7), p(from + 0.5 * n as f64 + 40.0, y, 2.5)),
                    (p(from + n as f64, y + 0.4, 1.7), p(from + n as f64 + 40.0, y + 6.0, 2.5)),
                ]);
                path.expect("stops").at(t)
            }
            Walk::Rise => (p(x, 10.0, 1.7 + 33.0 * t), p(x + 60.0, extent * 0.8, 4.0)),
            Walk::Turn => {
                let (sin, cos) = (t * std::f64::consts::TAU * 0.5 + 0.3).sin_cos();
                (p(x, y, 1.7), p(x + 10.0 * cos, y + 10.0 * sin, 2.1))
            }
            Walk::Static => (p(x, y, 1.7), p(x + 30.0, y + 1.0, 2.5)),
            Walk::Flyover => {
                let at = p(0.3 * extent, (0.1 + 0.2 * t) * extent, 0.35 * extent);
                (at, at + p(0.05 * extent, 0.15 * extent, -0.35 * extent))
            }
        };
        Camera::look_at(eye, target, DVec3::Z)
            .and_then(|c| c.with_image(px[0], px[1]))
            .expect("eye and target differ")
    }
}
