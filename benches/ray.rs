//! Ray casting speed in the generated town, each figure beside the floor that it must not fall below.
//!
//! `cargo bench --bench ray` prints the table; `-- --quick` uses a small town; `-- --check` exits non-zero when a floor
//! is missed. Speeds are per CPU time of one thread, best of several
//! runs; ours and the rival's alternate, so that both see the same machine. The ratio of threads is of wall times and needs idle
//! cores.

use farsight_geometry::glam::{DVec3, Vec3};
use farsight_geometry::ray::{Bvh8, SimdLevel};
use farsight_geometry::{Hit, Ray, RayCaster, TriangleMesh};
use farsight_raster::scenes::{City, Path};
use obvhs::{BvhBuildParams, bvh2::builder::build_bvh2_from_tris, ray::RayHit, triangle::Triangle};
use std::hint::black_box;
use std::time::{Duration, Instant};

/// Pixels along one side of a picture.
const SIDE: usize = 512;
/// Rays in a bundle.
const TILE: usize = 32;

fn main() {
    let has = |flag: &str| std::env::args().any(|a| a == flag);
    let city = if has("--quick") { City::small() } else { City::default() };
    let mesh = city.build().unwrap().flattened().unwrap();
    let mut table = Table::default();
    println!("town: {} triangles", mesh.triangles().len());

    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let (one, two) = (pool(1), pool(2));
    let (mut bvh, mut build) = (None, f64::INFINITY);
    for _ in 0..3 {
        let (tree, seconds) = one.install(|| {
            let start = cpu_time();
            (Bvh8::new(&mesh), (cpu_time() - start).as_secs_f64())
        });
        (bvh, build) = (Some(tree), build.min(seconds));
    }
    let bvh = bvh.unwrap();
    let (nodes, blocks) = bvh.node_and_block_count();
    println!(
        "tree: {nodes} nodes, {blocks} blocks ({:.2} triangles each), {:.1} MB, depth {}",
        mesh.triangles().len() as f64 / blocks as f64,
        bvh.bytes() as f64 / 1e6,
        bvh.depth()
    );
    table.most("build, s, one thread", build, 1.0);

    let sets = [("coherent", pinhole(&city)), ("incoherent", street(&city))];
    let rival = Rival::new(&mesh);
    let base = bvh.clone().with_simd(SimdLevel::Baseline);
    let floors = [(8.5, 7.2, 2.0), (6.2, 5.2, 3.0)];
    for ((name, rays), (floor, floor_base, floor_ratio)) in sets.iter().zip(floors) {
        let mut hits = vec![None; rays.len()];
        let (mut ours, mut baseline, mut theirs) = (0.0f64, 0.0f64, 0.0f64);
        // Chunks below the size that batches split keep this on one thread.
        let run = |caster: &Bvh8, hits: &mut [Option<Hit>]| {
            for (rays, hits) in rays.chunks(1024).zip(hits.chunks_mut(1024)) {
                caster.closest_batch(rays, hits);
            }
        };
        for _ in 0..7 {
            ours = ours.max(mrays(rays.len(), || run(&bvh, &mut hits)));
            theirs = theirs.max(mrays(rays.len(), || rival.trace(rays)));
            baseline = baseline.max(mrays(rays.len(), || run(&base, &mut hits)));
        }
        table.least(&format!("{name}, Mray/s"), ours, floor);
        table.least(&format!("{name}, baseline instructions, Mray/s"), baseline, floor_base);
        table.info(&format!("{name}, obvhs, Mray/s"), theirs);
        table.least(&format!("{name}, ratio to obvhs"), ours / theirs, floor_ratio);
        println!("{name}: {} of {} rays hit", hits.iter().flatten().count(), rays.len());
    }

    let views = views(&city);
    let mut hits = vec![None; TILE];
    let mut speed = 0.0f64;
    for _ in 0..9 {
        speed = speed.max(mrays(views.len() * SIDE * SIDE, || {
            for (eye, directions) in &views {
                for directions in directions.chunks(TILE) {
                    bvh.closest_bundle(*eye, directions, &mut hits);
                    black_box(&hits);
                }
            }
        }));
    }
    table.least("bundles of 32 coherent, Mray/s", speed, 38.0);

    let many: Vec<Ray> = sets.iter().flat_map(|s| s.1.iter().copied()).cycle().take(1 << 20).collect();
    let mut hits = vec![None; many.len()];
    let mut wall = |pool: &rayon::ThreadPool| {
        let run = |_| {
            let start = Instant::now();
            pool.install(|| bvh.closest_batch(&many, &mut hits));
            start.elapsed().as_secs_f64()
        };
        (0..4).map(run).fold(f64::INFINITY, f64::min)
    };
    let ratio = wall(&one) / wall(&two);
    table.least("two threads over one (wall)", ratio, 1.9);
    table.least("leaks in aimed rays, 0 = none", -(leaks() as f64), 0.0);
    if has("--check") && !table.passed {
        std::process::exit(1);
    }
}

struct Table {
    passed: bool,
}

impl Default for Table {
    fn default() -> Self {
        println!("{:<46} {:>9} {:>9}", "", "measured", "floor");
        Self { passed: true }
    }
}

impl Table {
    fn row(&mut self, name: &str, value: f64, bound: f64, ok: bool) {
        println!("{name:<46} {value:>9.2} {bound:>9.2} {}", if ok { "ok" } else { "MISSED" });
        self.passed &= ok;
    }

    fn least(&mut self, name: &str, value: f64, bound: f64) {
        self.row(name, value, bound, value >= bound);
    }

    fn most(&mut self, name: &str, value: f64, bound: f64) {
        self.row(name, value, bound, value <= bound);
    }

    fn info(&mut self, name: &str, value: f64) {
        println!("{name:<46} {value:>9.2} {:>9}", "-");
    }
}

/// Million rays per second of this thread's CPU time, which other work on the machine disturbs least.
fn mrays(rays: usize, mut run: impl FnMut()) -> f64 {
    // Several passes over few rays, as the system counts CPU time in steps of some milliseconds.
    let passes = (1usize << 20).div_ceil(rays);
    let start = cpu_time();
    for _ in 0..passes {
        run();
    }
    (rays * passes) as f64 / (cpu_time() - start).as_secs_f64() / 1e6
}

/// CPU time of this thread; wall time where the system does not tell.
fn cpu_time() -> Duration {
    static START: std::sync::OnceLock<Instant> = std::sync::OnceLock::new();
    let start = START.get_or_init(Instant::now);
    let nanos = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanos = nanos.and_then(|s| s.split(' ').next()?.parse().ok());
    nanos.map_or_else(|| start.elapsed(), Duration::from_nanos)
}

/// The obvhs crate as its documentation uses it: its medium binary tree and its own triangle test.
struct Rival {
    bvh: obvhs::bvh2::Bvh2,
    triangles: Vec<Triangle>,
    origin: DVec3,
}

impl Rival {
    fn new(mesh: &TriangleMesh) -> Self {
        let triangle = |[a, b, c]: [Vec3; 3]| Triangle { v0: a.into(), v1: b.into(), v2: c.into() };
        let triangles: Vec<_> = mesh.corner_iter().map(triangle).collect();
        let params = BvhBuildParams::medium_build();
        let mut time = Duration::default();
        let bvh = build_bvh2_from_tris(&triangles, params, &mut time);
        let triangles = bvh.primitive_indices.iter().map(|&i| triangles[i as usize]).collect();
        Self { bvh, triangles, origin: mesh.origin() }
    }

    fn trace(&self, rays: &[Ray]) {
        for ray in rays {
            let (o, d) = ((ray.origin() - self.origin).as_vec3a(), ray.direction().as_vec3a());
            let mut hit = RayHit::none();
            let ray = obvhs::ray::Ray::new_inf(o, d);
            black_box(self.bvh.ray_traverse(ray, &mut hit, |ray, id| self.triangles[id].intersect(ray)));
            black_box(hit);
        }
    }
}

/// A deterministic stream of numbers in [0, 1).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 33) as f64 / (1u64 << 31) as f64
    }

    fn direction(&mut self) -> DVec3 {
        let (z, angle) = (2.0 * self.next() - 1.0, std::f64::consts::TAU * self.next());
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * angle.cos(), r * angle.sin(), z)
    }
}

/// Four pictures from a walk along the streets, their rays in tiles of 8 x 4 pixels.
fn views(city: &City) -> Vec<(DVec3, Vec<DVec3>)> {
    let walk = Path::street_walk(city);
    let view = |t: f64| {
        let (eye, target) = walk.at(t);
        let forward = (target - eye).normalize();
        let right = forward.cross(DVec3::Z).normalize();
        let up = right.cross(forward);
        let pixel = |i: usize| {
            let (tile, i) = (i / TILE, i % TILE);
            let (x, y) = (tile % (SIDE / 8) * 8 + i % 8, tile / (SIDE / 8) * 4 + i / 8);
            let at = |i: usize| (2.0 * i as f64 + 1.0) / SIDE as f64 - 1.0;
            forward + right * (at(x) * 0.7) - up * (at(y) * 0.7)
        };
        (eye, (0..SIDE * SIDE).map(pixel).collect())
    };
    [0.05, 0.3, 0.55, 0.8].map(view).to_vec()
}

fn pinhole(city: &City) -> Vec<Ray> {
    let views = views(city);
    views.iter().flat_map(|(eye, view)| view.iter().map(|&d| Ray::new(*eye, d).unwrap())).collect()
}

/// All directions, from a cell in a street in the middle of the town.
fn street(city: &City) -> Vec<Ray> {
    let mut random = Random(7);
    let middle = city.street(city.blocks / 2);
    let (corner, size) = (DVec3::new(middle - 1.1, middle + 12.0, 1.3), DVec3::new(2.2, 15.0, 0.8));
    let ray = |_| {
        let p = corner + size * DVec3::from_array([0; 3].map(|_| random.next()));
        Ray::new(p, random.direction()).unwrap()
    };
    (0..SIDE * SIDE).map(ray).collect()
}

/// Rays from inside a closed bumpy sphere at vertices and edges, also far from the origin: every one must hit.
fn leaks() -> usize {
    let mut missed = 0;
    for offset in [DVec3::ZERO, DVec3::new(148_376.0, 1234.0, -223_423.0), DVec3::splat(1e9)] {
        let (mesh, targets) = bumpy_sphere(240, 360, offset);
        let bvh = Bvh8::new(&mesh);
        let mut random = Random(3);
        let rays: Vec<Ray> = targets
            .iter()
            .map(|&target| {
                let origin = offset + random.direction() * 0.2;
                Ray::new(origin, target - origin).unwrap()
            })
            .collect();
        let mut hits = vec![None; rays.len()];
        bvh.closest_batch(&rays, &mut hits);
        println!("aimed at vertices and edges around {offset}: {} rays", rays.len());
        missed += hits.iter().filter(|h| h.is_none()).count();
    }
    missed
}

/// A closed surface around `offset` with radii from 0.8 to 1.2, and the points on it where leaks would be.
fn bumpy_sphere(rings: usize, sectors: usize, offset: DVec3) -> (TriangleMesh, Vec<DVec3>) {
    use std::f64::consts::{PI, TAU};
    let mut p = vec![DVec3::Z, DVec3::NEG_Z];
    for r in 1..rings {
        for s in 0..sectors {
            let (a, b) = (PI * r as f64 / rings as f64, TAU * s as f64 / sectors as f64);
            let radius =
                1.0 + 0.1 * (7.0 * a).sin() * (9.0 * b).cos() + 0.02 * (55.0 * b).sin() * (61.0 * a).cos();
            p.push(DVec3::new(a.sin() * b.cos(), a.sin() * b.sin(), a.cos()) * radius);
        }
    }
    let at = |r: usize, s: usize| (2 + (r - 1) * sectors + s % sectors) as u32;
    let mut triangles = Vec::new();
    for s in 0..sectors {
        triangles.push([0, at(1, s), at(1, s + 1)]);
        triangles.push([1, at(rings - 1, s + 1), at(rings - 1, s)]);
        for r in 1..rings - 1 {
            triangles.push([at(r, s), at(r + 1, s), at(r + 1, s + 1)]);
            triangles.push([at(r, s), at(r + 1, s + 1), at(r, s + 1)]);
        }
    }
    let local: Vec<Vec3> = p.iter().map(|p| p.as_vec3()).collect();
    let mesh = TriangleMesh::new(local, triangles).unwrap().with_origin(offset).unwrap();
    let world = |p: Vec3| offset + p.as_dvec3();
    let mut targets: Vec<DVec3> = mesh.positions().iter().map(|&p| world(p)).collect();
    for [a, b, c] in mesh.corner_iter() {
        let (a, b, c) = (world(a), world(b), world(c));
        targets.extend([a.midpoint(b), a.lerp(b, 0.3), b.midpoint(c)]);
    }
    (mesh, targets)
}
