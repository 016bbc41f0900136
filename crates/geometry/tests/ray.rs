//! Ray casters against the brute-force oracle, against one another, and on inputs where casters usually break.

use farsight_geometry::distance::closest_on_triangle;
use farsight_geometry::glam::{DAffine3, DQuat, DVec3, Vec3};
use farsight_geometry::ray::{BruteForce, Bvh8, SceneCaster, SimdLevel};
use farsight_geometry::scene::{Instance, MeshId};
use farsight_geometry::{DAabb, Hit, Ray, RayCaster, Scene, TriangleMesh};
use proptest::prelude::*;

struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 33) as f64 / (1u64 << 31) as f64
    }

    fn vector(&mut self) -> DVec3 {
        DVec3::new(self.next(), self.next(), self.next()) * 2.0 - DVec3::ONE
    }
}

/// Random triangles of the given size in a cube of side 2.
fn confetti(count: usize, size: f64, seed: u64) -> TriangleMesh {
    let mut random = Random(seed);
    let mut positions = Vec::new();
    for _ in 0..count {
        let centre = random.vector();
        positions.extend((0..3).map(|_| (centre + random.vector() * size).as_vec3()));
    }
    soup(positions)
}

fn soup(positions: Vec<Vec3>) -> TriangleMesh {
    let triangles = (0..positions.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    TriangleMesh::new(positions, triangles).unwrap()
}

fn mapped(mesh: &TriangleMesh, f: impl Fn(Vec3) -> Vec3) -> TriangleMesh {
    TriangleMesh::new(mesh.positions().iter().map(|&p| f(p)).collect(), mesh.triangles().to_vec()).unwrap()
}

/// A closed bumpy sphere with radii from 0.8 to 1.2.
fn bumpy_sphere(rings: usize, sectors: usize) -> TriangleMesh {
    use std::f64::consts::{PI, TAU};
    let mut p = vec![Vec3::Z, Vec3::NEG_Z];
    for r in 1..rings {
        for s in 0..sectors {
            let (a, b) = (PI * r as f64 / rings as f64, TAU * s as f64 / sectors as f64);
            let radius = 1.0 + 0.2 * (7.0 * a).sin() * (9.0 * b).cos();
            p.push((DVec3::new(a.sin() * b.cos(), a.sin() * b.sin(), a.cos()) * radius).as_vec3());
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
    TriangleMesh::new(p, triangles).unwrap()
}

/// The caster's answer must be the oracle's. Where they differ, the ray must pass within rounding of an edge or
/// two triangles must lie at the same distance.
fn agree(mesh: &TriangleMesh, caster: &impl RayCaster, rays: &[Ray]) -> usize {
    let oracle = BruteForce::new(mesh);
    let mut hits = 0;
    for ray in rays {
        let (ours, theirs) = (caster.closest(ray), oracle.closest(ray));
        hits += usize::from(ours.is_some());
        let tolerance = |t: f64| 1e-9 * (t.abs() + f64::from(mesh.bounds().diagonal()));
        let same = ours.zip(theirs).is_some_and(|(a, b)| {
            let confirmed = |h: Hit| h.triangle == a.triangle && h.back_face == a.back_face;
            (a.t - b.t).abs() <= tolerance(b.t) && (oracle.all(ray).any(confirmed) || on_border(a))
        });
        let grazed = ours.or(theirs).is_some_and(on_border);
        assert!(
            same || grazed || ours.is_none() && theirs.is_none(),
            "{ray:?}: {ours:?} instead of {theirs:?}"
        );
        assert_eq!(caster.occluded(ray), ours.is_some());
    }
    hits
}

fn on_border(hit: Hit) -> bool {
    let [v, w] = hit.barycentrics;
    v.min(w).min(1.0 - v - w) < 1e-5
}

fn rays_around(mesh: &TriangleMesh, count: usize, seed: u64) -> Vec<Ray> {
    let mut random = Random(seed);
    let bounds = mesh.world_bounds();
    let size = bounds.diagonal();
    let ray = |_| {
        let (origin, target) = (random.vector() * size, random.vector() * 0.3 * size);
        Ray::new(bounds.center() + origin, target - origin).unwrap()
    };
    (0..count).map(ray).collect()
}

#[test]
fn random_scenes_agree_with_brute_force() {
    for (count, size) in [(1, 1.0), (7, 0.7), (9, 0.5), (300, 0.3), (2000, 0.05)] {
        let mesh = confetti(count, size, count as u64);
        let rays = rays_around(&mesh, 3000, 5);
        for simd in [SimdLevel::Detect, SimdLevel::Baseline] {
            let hits = agree(&mesh, &Bvh8::new(&mesh).with_simd(simd), &rays);
            assert!(hits > 20, "only {hits} hits");
        }
    }
}

#[test]
fn scales_and_offsets_do_not_matter() {
    let mesh = confetti(500, 0.3, 1);
    for scale in [1e-18, 1e-9, 1e-3, 1e6, 1e17] {
        let scaled = mapped(&mesh, |p| p * scale);
        assert!(agree(&scaled, &Bvh8::new(&scaled), &rays_around(&scaled, 1000, 2)) > 100);
    }
    // In the local coordinates themselves, and in the origin.
    let moved = mapped(&mesh, |p| p + Vec3::new(1e6, -2e6, 3e5));
    assert!(agree(&moved, &Bvh8::new(&moved), &rays_around(&moved, 1000, 2)) > 100);
    let moved = mesh.with_origin(DVec3::new(1e6, -2e7, 3e5)).unwrap();
    assert!(agree(&moved, &Bvh8::new(&moved), &rays_around(&moved, 1000, 2)) > 100);
}

#[test]
fn flat_and_uneven_scenes_agree_with_brute_force() {
    let mesh = confetti(400, 0.4, 3);
    let shapes: [fn(Vec3) -> Vec3; 4] = [
        |p| Vec3::new(p.x, p.y, 0.0),
        |p| Vec3::new(p.x * 1e9, p.y, p.z * 1e-9),
        |p| Vec3::new(p.x, p.y * 1e-6, p.z),
        |p| Vec3::new(p.x * 1e-6, p.y, p.z * 1e-6),
    ];
    for shape in shapes {
        let mesh = mapped(&mesh, shape);
        agree(&mesh, &Bvh8::new(&mesh), &rays_around(&mesh, 1000, 4));
    }
}

#[test]
fn rays_from_far_away_agree_with_brute_force() {
    let mesh = bumpy_sphere(12, 16);
    let caster = Bvh8::new(&mesh);
    let mut random = Random(8);
    for distance in [10.0, 1e3, 1e6] {
        let aimed = |_| {
            let origin = random.vector().normalize() * distance;
            Ray::new(origin, random.vector() * 0.3 - origin).unwrap()
        };
        let rays: Vec<Ray> = (0..300).map(aimed).collect();
        assert_eq!(agree(&mesh, &caster, &rays), 300);
    }
}

#[test]
fn closed_meshes_do_not_leak_at_vertices_edges_and_axes() {
    let sphere = bumpy_sphere(40, 60);
    for offset in [DVec3::ZERO, DVec3::new(148_376.0, 1234.0, -223_423.0), DVec3::splat(1e9)] {
        for inside in [false, true] {
            // The offset in the mesh's origin, or baked into what f32 leaves of the coordinates.
            if inside && offset.x > 1e8 {
                continue;
            }
            let mesh = if inside {
                mapped(&sphere, |p| p + offset.as_vec3())
            } else {
                sphere.clone().with_origin(offset).unwrap()
            };
            let caster = Bvh8::new(&mesh);
            let mut random = Random(4);
            let mut rays = Vec::new();
            for corners in mesh.corner_iter() {
                let [a, b, c] = corners.map(|p| mesh.origin() + p.as_dvec3());
                for target in [a, a.midpoint(b), b.midpoint(c), a.lerp(c, random.next())] {
                    let origin = offset + random.vector() * 0.2;
                    rays.extend(Ray::new(origin, target - origin));
                    rays.extend(Ray::new(offset, target - offset));
                }
            }
            for axis in DVec3::AXES {
                for tiny in [0.0, -0.0, 1e-30, -1e-300] {
                    for d in [axis, -axis, axis + DVec3::splat(tiny), -axis + DVec3::splat(tiny)] {
                        rays.extend(Ray::new(offset, d * DVec3::new(1.0, 1.0, 1.0) + DVec3::splat(-0.0)));
                    }
                }
            }
            let mut hits = vec![None; rays.len()];
            caster.closest_batch(&rays, &mut hits);
            let leaks = hits.iter().filter(|h| h.is_none()).count();
            assert_eq!(leaks, 0, "of {} rays at {offset}", rays.len());
        }
    }
}

#[test]
fn the_lowest_of_coincident_triangles_wins_whatever_its_winding() {
    let mut random = Random(6);
    for _ in 0..200 {
        let t = [0; 3].map(|_| random.vector().as_vec3());
        let [a, b, c] = t;
        let orders = [[a, b, c], [c, a, b], [b, a, c], [a, c, b], [b, c, a], [c, b, a]];
        let rotate = (random.next() * 6.0) as usize;
        let positions: Vec<Vec3> = (0..30).flat_map(|i| orders[(i + rotate) % 6]).collect();
        let mesh = soup(positions);
        let target = (a + b * 0.9 + c * 1.1).as_dvec3() / 3.0;
        let origin = random.vector() * 3.0;
        let hit = Bvh8::new(&mesh).closest(&Ray::new(origin, target - origin).unwrap()).unwrap();
        assert_eq!(hit.triangle, 0);
    }
}

#[test]
fn degenerate_triangles_are_never_hit() {
    let mut random = Random(9);
    let mut positions = Vec::new();
    for _ in 0..300 {
        let (a, d) = (random.vector().as_vec3(), Vec3::new(0.25, 0.5, -0.125));
        positions.extend([a, a, a + d]);
        // Coarse coordinates keep the three exactly on a line.
        let a = (a * 64.0).round() / 64.0;
        positions.extend([a, a + d, a + d * 3.0]);
        positions.extend([a, a, a]);
    }
    let mesh = soup(positions);
    let caster = Bvh8::new(&mesh);
    for corners in mesh.corner_iter() {
        let target = (corners[0] + corners[2]).as_dvec3() * 0.5;
        let origin = random.vector() * 4.0;
        assert!(caster.closest(&Ray::new(origin, target - origin).unwrap()).is_none());
    }
}

#[test]
fn slivers_agree_with_brute_force() {
    let mut random = Random(10);
    let mut positions = Vec::new();
    for _ in 0..300 {
        let (a, along) = (random.vector(), random.vector());
        let thin = random.vector() * 1e-6;
        positions.extend([a, a + along, a + along * 0.5 + thin].map(|p| p.as_vec3()));
    }
    let mesh = soup(positions);
    let caster = Bvh8::new(&mesh);
    let mut rays = rays_around(&mesh, 500, 3);
    for [a, b, c] in mesh.corner_iter() {
        let target = (a + b + c).as_dvec3() / 3.0;
        let origin = random.vector() * 3.0;
        rays.extend(Ray::new(origin, target - origin));
    }
    agree(&mesh, &caster, &rays);
}

#[test]
fn empty_and_single_meshes_are_fine() {
    let ray = Ray::new(DVec3::ZERO, DVec3::X).unwrap();
    let empty = Bvh8::new(&TriangleMesh::default());
    assert!(empty.closest(&ray).is_none() && !empty.occluded(&ray) && empty.depth() == 0);
    let mut hits = [None; 3];
    empty.closest_bundle(DVec3::ZERO, &[DVec3::X, DVec3::ZERO, DVec3::NAN], &mut hits);
    assert_eq!(hits, [None; 3]);
    let point = Bvh8::new(&soup(vec![Vec3::ZERO; 3]));
    assert!(point.closest(&ray).is_none());
}

#[test]
fn ranges_include_their_ends() {
    let mesh = soup(vec![Vec3::new(2.0, -1.0, -1.0), Vec3::new(2.0, 1.0, -1.0), Vec3::new(2.0, 0.0, 1.0)]);
    let caster = Bvh8::new(&mesh);
    let ray = Ray::new(DVec3::ZERO, DVec3::X).unwrap();
    for (from, to, hit) in
        [(0.0, 2.0, true), (2.0, 3.0, true), (0.0, 1.999_999_999, false), (2.000_000_001, 9.0, false)]
    {
        assert_eq!(caster.closest(&ray.with_range(from, to)).is_some(), hit, "{from} to {to}");
    }
    let behind = Ray::new(DVec3::ZERO, DVec3::NEG_X).unwrap();
    assert!(caster.closest(&behind).is_none());
    assert_eq!(caster.closest(&behind.with_range(-5.0, 5.0)).unwrap().t, -2.0);
}

#[test]
fn bundles_answer_as_single_rays_do() {
    let sphere = bumpy_sphere(60, 80);
    let meshes = [sphere.clone(), mapped(&sphere, |p| p * 1e-9), confetti(3000, 0.1, 7), confetti(5, 1.0, 2)];
    for mesh in meshes {
        let scale = mesh.bounds().diagonal() as f64;
        for simd in [SimdLevel::Detect, SimdLevel::Baseline] {
            let caster = Bvh8::new(&mesh).with_simd(simd);
            let mut random = Random(12);
            for round in 0..600 {
                let origin = random.vector() * scale * [0.05, 1.0, 30.0][round % 3];
                let spread = [1e-4, 0.03, 0.1, 0.5, 3.0][round % 5];
                let middle = random.vector();
                let count = 1 + (random.next() * 70.0) as usize;
                let mut directions: Vec<DVec3> =
                    (0..count).map(|_| (middle + random.vector() * spread) * scale).collect();
                // Vertices and edges are where other arithmetic would choose another triangle.
                for i in 0..count / 2 {
                    let [a, b, _] = mesh.corners((i * 37 + round) % mesh.triangles().len());
                    let target = [a, (a + b) * 0.5][i % 2].as_dvec3();
                    if (target - origin).normalize().angle_between(middle) < 0.3 {
                        directions[i] = target - origin;
                    }
                }
                let mut bundle = vec![None; count];
                caster.closest_bundle(origin, &directions, &mut bundle);
                for (d, hit) in directions.iter().zip(&bundle) {
                    assert_eq!(*hit, caster.closest(&Ray::new(origin, *d).unwrap()), "{d} from {origin}");
                }
            }
        }
    }
}

#[test]
fn instruction_sets_answer_alike() {
    let mesh = confetti(4000, 0.08, 21);
    let (best, base) = (Bvh8::new(&mesh), Bvh8::new(&mesh).with_simd(SimdLevel::Baseline));
    for ray in rays_around(&mesh, 5000, 22) {
        assert_eq!(best.closest(&ray), base.closest(&ray));
    }
}

#[cfg(feature = "rayon")]
#[test]
fn threads_do_not_change_a_byte() {
    let mesh = confetti(60_000, 0.02, 30);
    let rays = rays_around(&mesh, 5000, 31);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let caster = Bvh8::new(&mesh);
            let mut hits = vec![None; rays.len()];
            caster.closest_batch(&rays, &mut hits);
            (caster, hits)
        })
    };
    let ((one, a), (two, b)) = (run(1), run(2));
    assert!(one.same_tree(&two));
    assert_eq!(a, b);
}

#[test]
fn trees_of_hostile_inputs_stay_shallow() {
    // Ever smaller triangles at one place, and thousands of the same triangle.
    let shrinking: Vec<Vec3> = (0..1500)
        .flat_map(|i| {
            let size = 0.99f32.powi(i);
            [Vec3::ZERO, Vec3::X, Vec3::Y].map(|p| (p + Vec3::ONE) * size)
        })
        .collect();
    let same = [Vec3::ZERO, Vec3::X, Vec3::Y].repeat(5000);
    for positions in [shrinking, same] {
        let mesh = soup(positions);
        let caster = Bvh8::new(&mesh);
        assert!(caster.depth() <= 32, "{}", caster.depth());
        agree(&mesh, &caster, &rays_around(&mesh, 300, 1));
    }
}

#[test]
fn instances_agree_with_the_flattened_mesh() {
    let meshes = [bumpy_sphere(8, 10), confetti(60, 0.4, 40), soup(vec![])];
    let mut random = Random(41);
    let mut scene = Scene::new();
    let ids = meshes.clone().map(|mesh| scene.add_mesh(mesh));
    let (mut flat, mut names) = (Vec::new(), Vec::new());
    for i in 0..60 {
        let stretch =
            [DVec3::ONE, DVec3::new(-1.0, 1.0, 1.0), DVec3::new(0.01, 3.0, -0.5), DVec3::splat(1e-3)][i % 4];
        let rotation = DQuat::from_axis_angle(random.vector().normalize(), random.next() * 6.0);
        let place =
            DAffine3::from_scale_rotation_translation(stretch, rotation, random.vector() * 6.0 + 1000.0);
        let mesh = i % 3;
        let instance =
            Instance { name: i.to_string(), mesh: ids[mesh], world_from_mesh: place, material: None };
        scene.add_instance(instance).unwrap();
        for (t, corners) in meshes[mesh].corner_iter().enumerate() {
            flat.extend(corners.map(|p| place.transform_point3(p.as_dvec3())));
            names.push((i as u32, t as u32));
        }
    }
    let indices = (0..flat.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let flat = TriangleMesh::from_world(&flat, indices).unwrap();
    let (caster, oracle) = (SceneCaster::new(&scene).unwrap(), BruteForce::new(&flat));
    let rays = rays_around(&flat, 3000, 42);
    let mut batch = vec![None; rays.len()];
    caster.closest_batch(&rays, &mut batch);
    let mut hits = 0;
    for (ray, ours) in rays.iter().zip(batch) {
        assert_eq!(ours, caster.closest(ray));
        assert_eq!(caster.occluded(ray), ours.is_some());
        let theirs = oracle.closest(ray);
        hits += usize::from(theirs.is_some());
        let same = match (ours, theirs) {
            (None, None) => true,
            (Some(a), Some(b)) => {
                let name = (a.instance, a.triangle) == names[b.triangle as usize];
                // The flattened mesh is rounded to f32.
                (a.t - b.t).abs() < 1e-4 && name && a.back_face == b.back_face || grazes(a) || grazes(b)
            }
            (a, b) => a.or(b).is_some_and(grazes),
        };
        assert!(same, "{ours:?} instead of {theirs:?} {:?}", theirs.map(|h| names[h.triangle as usize]));
    }
    assert!(hits > 500, "{hits}");
}

/// Close enough to a border for the rounding of a mesh to f32 to matter.
fn grazes(hit: Hit) -> bool {
    let [v, w] = hit.barycentrics;
    v.min(w).min(1.0 - v - w) < 2e-2
}

#[test]
fn instances_tie_to_the_lowest_and_singular_ones_are_named() {
    let mut scene = Scene::of_mesh(bumpy_sphere(6, 8));
    let place = |matrix| Instance {
        name: "copy".into(),
        mesh: MeshId(0),
        world_from_mesh: DAffine3::from_scale(matrix),
        material: None,
    };
    scene.add_instance(place(DVec3::ONE)).unwrap();
    let caster = SceneCaster::new(&scene).unwrap();
    let hit = caster.closest(&Ray::new(DVec3::new(0.1, 0.2, 5.0), DVec3::NEG_Z).unwrap()).unwrap();
    assert_eq!(hit.instance, 0);
    // Shrunk to a point or a line there is nothing to hit.
    scene.add_instance(place(DVec3::ZERO)).unwrap();
    scene.add_instance(place(DVec3::Y)).unwrap();
    let caster = SceneCaster::new(&scene).unwrap();
    assert!(
        caster.closest(&Ray::new(DVec3::new(0.0, 0.0, 0.5), DVec3::X).unwrap()).is_some_and(|h| h.t > 0.5)
    );
    scene.add_instance(place(DVec3::new(1.0, 1.0, 0.0))).unwrap();
    let error = SceneCaster::new(&scene).unwrap_err();
    assert_eq!(error.to_string(), "instance 4 ('copy') has a placement without inverse");
    let empty = SceneCaster::new(&Scene::new()).unwrap();
    assert!(empty.closest(&Ray::new(DVec3::ZERO, DVec3::X).unwrap()).is_none());
}

/// Squared distance by minimising over the triangle with nested ternary search: no formula shared with the code under test.
fn searched_distance_sq(p: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let search = |f: &dyn Fn(f64) -> f64| {
        let (mut lo, mut hi) = (0.0, 1.0);
        for _ in 0..60 {
            let (m, n) = (lo + (hi - lo) / 3.0, hi - (hi - lo) / 3.0);
            if f(m) < f(n) { hi = n } else { lo = m }
        }
        f(0.5 * (lo + hi))
    };
    search(&|s| {
        let (q, r) = (a.lerp(b, s), a.lerp(c, s));
        search(&|t| q.lerp(r, t).distance_squared(p))
    })
}

#[test]
fn closest_points_agree_with_a_search() {
    for (scale, offset) in [(1.0, 0.0), (1e-9, 0.0), (1e6, 5e6)] {
        let mesh = mapped(&confetti(60, 0.4, 50), |p| p * scale + Vec3::splat(offset));
        let caster = Bvh8::new(&mesh);
        let bounds = mesh.world_bounds();
        let mut random = Random(51);
        let points: Vec<DVec3> = (0..40)
            .map(|i| bounds.center() + random.vector() * bounds.diagonal() * [0.3, 1.0, 1e6][i % 3])
            .collect();
        let mut batch = vec![None; points.len()];
        caster.closest_points(&points, f64::INFINITY, &mut batch);
        for (&p, found) in points.iter().zip(batch) {
            let found = found.unwrap();
            assert_eq!(Some(found), caster.closest_point(p, f64::INFINITY));
            let world = |t: [Vec3; 3]| t.map(|q| mesh.origin() + q.as_dvec3());
            let distances = mesh.corner_iter().map(|t| searched_distance_sq(p, world(t)));
            let least = distances.fold(f64::INFINITY, f64::min).sqrt();
            let distance = found.distance_sq.sqrt();
            let tolerance = 1e-7 * (least + f64::from(scale));
            assert!((distance - least).abs() <= tolerance, "{distance} instead of {least}");
            assert!((found.point.distance(p) - distance).abs() <= tolerance);
            let own = searched_distance_sq(p, world(mesh.corners(found.triangle as usize))).sqrt();
            assert!((own - distance).abs() <= tolerance);
            assert!(caster.closest_point(p, distance * 0.999).is_none());
            assert!(caster.closest_point(p, distance * 1.001).is_some());
        }
    }
    let segment = Bvh8::new(&soup(vec![Vec3::ZERO, Vec3::X, Vec3::X * 0.25]));
    let found = segment.closest_point(DVec3::new(0.5, 2.0, 0.0), 3.0).unwrap();
    assert_eq!((found.distance_sq, found.point), (4.0, DVec3::X * 0.5));
    assert!(Bvh8::new(&TriangleMesh::default()).closest_point(DVec3::ZERO, 1.0).is_none());
}

#[test]
fn overlaps_agree_with_clipping() {
    let mesh = confetti(300, 0.4, 60);
    let caster = Bvh8::new(&mesh);
    let mut random = Random(61);
    for _ in 0..200 {
        let (centre, half) = (random.vector(), random.vector().abs() * 0.3);
        let bounds = DAabb::new(centre - half, centre + half);
        let clipped = |t: [Vec3; 3]| {
            let mut polygon: Vec<DVec3> = t.iter().map(|p| p.as_dvec3()).collect();
            for axis in 0..3 {
                for (sign, limit) in [(1.0, bounds.max[axis]), (-1.0, -bounds.min[axis])] {
                    let mut kept = Vec::new();
                    for i in 0..polygon.len() {
                        let (p, q) = (polygon[i], polygon[(i + 1) % polygon.len()]);
                        let (a, b) = (limit - sign * p[axis], limit - sign * q[axis]);
                        if a >= 0.0 {
                            kept.push(p);
                        }
                        if (a >= 0.0) != (b >= 0.0) {
                            kept.push(p.lerp(q, a / (a - b)));
                        }
                    }
                    polygon = kept;
                }
            }
            !polygon.is_empty()
        };
        let expected: Vec<u32> =
            mesh.corner_iter().enumerate().filter(|(_, t)| clipped(*t)).map(|(i, _)| i as u32).collect();
        assert_eq!(caster.overlapping(&bounds), expected);
    }
    let touching = DAabb::new(DVec3::new(1.0, 0.0, 0.0), DVec3::new(2.0, 1.0, 1.0));
    let one = Bvh8::new(&soup(vec![Vec3::ZERO, Vec3::X, Vec3::Y]));
    assert_eq!(one.overlapping(&touching), [0]);
    assert!(one.overlapping(&DAabb::EMPTY).is_empty());
}

#[cfg(feature = "obvhs")]
mod obvhs {
    use super::*;
    use farsight_geometry::ray::{ObvhsCaster, ObvhsTree};

    const TREES: [ObvhsTree; 2] = [ObvhsTree::Binary, ObvhsTree::Compressed];

    fn same_as_ours(mesh: &TriangleMesh, rays: &[Ray]) -> usize {
        let ours = Bvh8::new(mesh);
        let quick = Bvh8::quick(mesh);
        let mut hits = 0;
        for tree in TREES {
            let theirs = ObvhsCaster::new(mesh, tree);
            for ray in rays {
                let hit = ours.closest(ray);
                hits += usize::from(hit.is_some());
                assert_eq!(theirs.closest(ray), hit, "{tree:?} {ray:?}");
                assert_eq!(quick.closest(ray), hit, "quick {ray:?}");
                assert_eq!(theirs.occluded(ray), hit.is_some());
            }
        }
        hits
    }

    #[test]
    fn both_trees_and_the_quick_build_answer_as_ours() {
        for mesh in [confetti(1, 1.0, 70), confetti(4000, 0.06, 71), bumpy_sphere(30, 40)] {
            same_as_ours(&mesh, &rays_around(&mesh, 1500, 72));
        }
        same_as_ours(&soup(vec![]), &[Ray::new(DVec3::ZERO, DVec3::X).unwrap()]);
    }

    #[test]
    fn negative_zeros_and_axis_directions_hit() {
        let mesh = bumpy_sphere(30, 40);
        let mut rays = Vec::new();
        for axis in DVec3::AXES {
            for tiny in [0.0, -0.0, 1e-60, -1e-60, -1e-9] {
                for sign in [1.0, -1.0] {
                    let d = (axis * sign).map(|x| if x == 0.0 { tiny } else { x });
                    rays.extend(Ray::new(DVec3::new(0.01, 0.02, 0.03), d));
                    rays.extend(Ray::new(axis * sign * -3.0, d));
                }
            }
        }
        assert_eq!(same_as_ours(&mesh, &rays), 2 * rays.len());
    }

    #[test]
    fn the_length_of_the_direction_does_not_matter() {
        let mesh = bumpy_sphere(30, 40);
        let mut random = Random(73);
        let rays: Vec<Ray> = [1e-300, 1e-8, 1e-6, 1e6, 1e300]
            .into_iter()
            .flat_map(|length| (0..100).map(move |_| length))
            .map(|length| Ray::new(DVec3::ZERO, random.vector() * length).unwrap())
            .collect();
        assert_eq!(same_as_ours(&mesh, &rays), 2 * rays.len());
    }

    #[test]
    fn tiny_scenes_and_hits_close_to_the_origin_are_found() {
        for scale in [1e-12, 1e-4, 1.0, 1e12] {
            let mesh = mapped(&bumpy_sphere(20, 30), |p| p * scale);
            let mut random = Random(74);
            let mut rays = Vec::new();
            for [a, b, c] in mesh.corner_iter() {
                let target = (a + b + c).as_dvec3() / 3.0;
                rays.extend(Ray::new(target * (1.0 - 1e-6), target));
                rays.extend(Ray::new(random.vector() * 0.1 * f64::from(scale), target));
            }
            assert!(same_as_ours(&mesh, &rays) > rays.len());
        }
    }

    #[test]
    fn vertices_and_edges_do_not_leak() {
        let mesh = bumpy_sphere(30, 40);
        let mut rays = Vec::new();
        for [a, b, _] in mesh.corner_iter() {
            for target in [a, (a + b) * 0.5] {
                rays.extend(Ray::new(DVec3::ZERO, target.as_dvec3()));
            }
        }
        assert_eq!(same_as_ours(&mesh, &rays), 2 * rays.len());
    }

    #[test]
    fn distances_are_in_world_units_and_ties_go_to_the_lowest() {
        let corners = [Vec3::new(-9.0, -9.0, 5.0), Vec3::new(9.0, -9.0, 5.0), Vec3::new(0.0, 9.0, 5.0)];
        let mesh = soup(corners.repeat(50));
        for tree in TREES {
            let caster = ObvhsCaster::new(&mesh, tree);
            let hit = caster.closest(&Ray::new(DVec3::ZERO, DVec3::Z * 7.0).unwrap()).unwrap();
            assert_eq!((hit.t, hit.triangle), (5.0, 0));
        }
    }
}

/// Where a ray meets a triangle, when all coordinates are small integers: nothing is rounded before the last division.
#[derive(Debug, PartialEq)]
enum OnGrid {
    Misses,
    /// On an edge or a corner, or the origin is in the triangle: a caster may call it a hit.
    Touches(f64),
    /// Through the interior, this many lengths of the direction away.
    Crosses(f64),
    /// The ray is in the triangle's plane.
    InPlane,
}

fn on_grid(corners: [[i64; 3]; 3], origin: [i64; 3], direction: [i64; 3]) -> OnGrid {
    let minus = |a: [i64; 3], b: [i64; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    let cross = |a: [i64; 3], b: [i64; 3]| {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    let dot = |a: [i64; 3], b: [i64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let seen = corners.map(|corner| minus(corner, origin));
    let normal = cross(minus(corners[1], corners[0]), minus(corners[2], corners[0]));
    let (slope, height) = (dot(normal, direction), dot(normal, seen[0]));
    if slope == 0 {
        return if height == 0 { OnGrid::InPlane } else { OnGrid::Misses };
    }
    // Six times the volumes between the ray and each edge, positive inside.
    let sides = [0, 1, 2].map(|i| dot(cross(seen[i], seen[(i + 1) % 3]), direction) * slope.signum());
    let ahead = height * slope.signum();
    let t = height as f64 / slope as f64;
    match (sides.into_iter().min().unwrap(), ahead) {
        (side, ahead) if side < 0 || ahead < 0 => OnGrid::Misses,
        (side, ahead) if side == 0 || ahead == 0 => OnGrid::Touches(t),
        _ => OnGrid::Crosses(t),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// Coordinates on a small grid: rays along edges, through vertices, inside planes, coincident triangles. Judged in integers.
    #[test]
    fn grid_scenes_agree_with_exact_arithmetic(
        corners in prop::collection::vec(prop::array::uniform3(-3i64..=3), 3..120),
        rays in prop::collection::vec((prop::array::uniform3(-4i64..=4), prop::array::uniform3(-2i64..=2)), 1..20),
    ) {
        let real = |p: [i64; 3]| DVec3::from_array(p.map(|x| x as f64));
        let triangles: Vec<[[i64; 3]; 3]> = corners.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect();
        let mesh = soup(triangles.iter().flatten().map(|&p| real(p).as_vec3()).collect());
        let casters: [&dyn RayCaster; 2] = [&Bvh8::new(&mesh), &BruteForce::new(&mesh)];
        for (origin, direction) in rays {
            let Some(ray) = Ray::new(real(origin), real(direction)) else { continue };
            let length = real(direction).length();
            let exact: Vec<OnGrid> = triangles.iter().map(|&t| on_grid(t, origin, direction)).collect();
            let nearest = exact.iter().filter_map(|e| if let OnGrid::Crosses(t) = e { Some(t * length) } else { None });
            let nearest = nearest.fold(f64::INFINITY, f64::min);
            for hit in casters.map(|caster| caster.closest(&ray)) {
                let t = hit.map_or(f64::INFINITY, |h| h.t);
                prop_assert!(t <= nearest * (1.0 + 1e-12), "{hit:?} instead of {nearest}");
                match hit.map(|h| &exact[h.triangle as usize]) {
                    Some(OnGrid::Misses) => prop_assert!(false, "{hit:?} is no hit"),
                    Some(OnGrid::Touches(s) | OnGrid::Crosses(s)) => prop_assert!((t - s * length).abs() < 1e-12 * (1.0 + t)),
                    // Rounding may see such a triangle from its edge; then the point must still lie on it.
                    Some(OnGrid::InPlane) => {
                        let at = ray.origin() + ray.direction() * t;
                        let corners = triangles[hit.unwrap().triangle as usize].map(real);
                        prop_assert!(closest_on_triangle(corners, at).distance(at) < 1e-9, "{hit:?} is no hit");
                    }
                    None => {}
                }
            }
        }
    }
}

/// Distances in 128-bit integers, on triangles and rays whose coordinates are integers.
#[test]
fn distances_are_as_accurate_as_documented() {
    let mut random = Random(23);
    let mut point = |size: f64| (random.vector() * size).round();
    let (mut hits, mut worst) = (0, 0.0f64);
    for _ in 0..200_000 {
        let corners = [point(1000.0), point(1000.0), point(1000.0)];
        let (origin, target) = (point(4000.0), (corners[0] + corners[1] + corners[2]) / 3.0 + point(200.0));
        let along = target.round() - origin;
        let Some(ray) = Ray::new(origin, along) else { continue };
        let caster = BruteForce::new(&soup(corners.map(|p| p.as_vec3()).to_vec()));
        let tree = Bvh8::new(&soup(corners.map(|p| p.as_vec3()).to_vec()));
        assert_eq!(tree.closest(&ray).is_some(), caster.closest(&ray).is_some());
        let Some(hit) = tree.closest(&ray) else { continue };
        let int = |p: DVec3| p.to_array().map(|x| x as i128);
        let dot = |a: [i128; 3], b: [i128; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let (e, f) = (int(corners[1] - corners[0]), int(corners[2] - corners[0]));
        let normal = [e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]];
        let (height, slope) = (dot(normal, int(corners[0] - origin)), dot(normal, int(along)));
        let exact = height as f64 / slope as f64 * along.length();
        // Twice the area that the ray sees, and the longest edge.
        let area = (slope as f64 / along.length()).abs();
        let edge = (0..3).map(|i| corners[i].distance_squared(corners[(i + 1) % 3])).fold(0.0, f64::max);
        let reach = corners.iter().map(|&p| (p - origin).abs().max_element()).fold(0.0, f64::max);
        worst = worst.max((hit.t - exact).abs() / (reach * edge / area));
        hits += 1;
    }
    println!("worst error of {hits} distances: {worst:e} of the bound's unit");
    assert!(hits > 50_000 && worst < 1e-15, "{hits} hits, {worst:e}");
}

#[test]
fn casters_for_front_faces_look_through_backs() {
    let mesh = confetti(2000, 0.15, 31);
    let caster = Bvh8::new(&mesh).front_faces_only();
    let oracle = BruteForce::new(&mesh).front_faces_only();
    let id = |hit: Option<Hit>| hit.map(|h| h.triangle);
    let mut behind_backs = 0;
    for ray in rays_around(&mesh, 3000, 33) {
        let hit = caster.closest(&ray);
        assert_eq!(id(hit), id(oracle.closest(&ray)));
        assert!(hit.is_none_or(|h| !h.back_face));
        behind_backs += i32::from(BruteForce::new(&mesh).closest(&ray).is_some_and(|h| h.back_face));
        let mut bundle = [None];
        caster.closest_bundle(ray.origin(), &[ray.direction()], &mut bundle);
        // Directions are normalised again, by an ulp.
        assert_eq!(bundle[0], caster.closest(&Ray::new(ray.origin(), ray.direction()).unwrap()));
        caster.closest_batch(&[ray], &mut bundle);
        assert_eq!((bundle[0], caster.occluded(&ray)), (hit, hit.is_some()));
        if behind_backs > 60 {
            break;
        }
    }
    assert!(behind_backs > 20);
    // Coincident front and back: only the front is there. In a mirror the other one is the front.
    let pair = TriangleMesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 2, 1], [0, 1, 2]]).unwrap();
    let down = Ray::new(DVec3::new(0.25, 0.25, 1.0), DVec3::NEG_Z).unwrap();
    assert_eq!(Bvh8::new(&pair).front_faces_only().closest(&down).unwrap().triangle, 1);
    let mut scene = Scene::of_mesh(pair);
    let place =
        |world_from_mesh| Instance { name: String::new(), mesh: MeshId(0), world_from_mesh, material: None };
    let mirror = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    scene.add_instance(place(mirror)).unwrap();
    let caster = SceneCaster::new(&scene).unwrap().front_faces_only();
    let beside = Ray::new(DVec3::new(-0.25, 0.25, 1.0), DVec3::NEG_Z).unwrap();
    let (plain, mirrored) = (caster.closest(&down).unwrap(), caster.closest(&beside).unwrap());
    assert_eq!((plain.instance, plain.triangle, plain.back_face), (0, 1, false));
    assert_eq!((mirrored.instance, mirrored.triangle, mirrored.back_face), (1, 0, false));
}
