//! Every preset over every hard case: an answer or a typed error, members that can be seen, never a panic.

use farsight_geometry::hard_cases::{bad_meshes, meshes};
use farsight_geometry::ray::{Bvh8, SceneCaster};
use farsight_geometry::scene::{Instance, MeshId};
use farsight_geometry::{DAabb, Ray, RayCaster, Scene, TriangleMesh};
use farsight_visibility::glam::{DAffine3, DVec3, Vec3};
use farsight_visibility::{
    Bisector, Budget, Occluders, Options, Reverse, Sampler, Triangles, ViewCell, VisibilityError, Witness,
    parted,
};

fn presets() -> Vec<Options> {
    let mut printed = Options::paper();
    (printed.bisector, printed.reverse) = (Bisector::Printed, Reverse::Both);
    let mut fine = Options::default();
    (fine.tolerance, fine.epsilon, fine.first_random) = ([1e-3, 1e-5], 1e-9, 512);
    let mut all = vec![Options::default(), Options::paper(), Options::random(), printed, fine];
    all.iter_mut().for_each(|o| (o.witnesses, o.first_random) = (true, o.first_random.min(2000)));
    all
}

/// Cells that stand in a difficult relation to a box: around a corner, inside, outside, flat, a point, on a face.
fn cells(b: &DAabb) -> Vec<ViewCell> {
    let size = if b.diagonal() > 0.0 { b.diagonal() } else { 1.0 };
    let (min, max) = if b.is_empty() { (DVec3::ZERO, DVec3::ZERO) } else { (b.min, b.max) };
    let middle = (min + max) * 0.5;
    let around = |p: DVec3, half: DVec3| ViewCell::from_box(&DAabb::new(p - half, p + half)).unwrap();
    vec![
        around(max, DVec3::splat(0.1 * size)),
        around(middle, DVec3::splat(1e-3 * size)),
        around(middle + DVec3::new(0.3, -0.4, 2.0) * size, DVec3::splat(0.2 * size)),
        around(middle + DVec3::Z * 1.3 * size, DVec3::new(0.3, 0.2, 0.0) * size),
        around(middle + DVec3::new(1.0, 1.1, 1.2) * size, DVec3::ZERO),
        around(middle + DVec3::X * 50.0 * size, DVec3::X * size),
    ]
}

#[test]
fn every_preset_survives_every_hard_mesh() {
    for hard in meshes() {
        let (triangles, caster) = (Triangles::of_mesh(&hard.mesh), Bvh8::new(&hard.mesh));
        for (n, cell) in cells(&hard.mesh.world_bounds()).iter().enumerate() {
            for options in presets() {
                let mut sampler =
                    Sampler::new(&triangles, Occluders::opaque(&caster), cell, options).unwrap();
                sampler.run(&Budget::rays(3000));
                let missed = sampler.validate(500, 0.9).unwrap();
                assert!((0.0..=1.0).contains(&missed.bound.value));
                for &(member, witness) in sampler.witnesses() {
                    if let Witness::Ray(sight) = witness {
                        let hit = caster.closest(&Ray::new(sight.origin, sight.direction).unwrap()).unwrap();
                        // Normalising the direction once more turns it by an ulp: right at an edge the neighbour may answer.
                        let own = hit.triangle == member;
                        let mesh = &hard.mesh;
                        let shares = mesh
                            .corners(hit.triangle as usize)
                            .iter()
                            .any(|c| mesh.corners(member as usize).contains(c));
                        assert!(own || shares, "{}, cell {n}: {member} or {}", hard.name, hit.triangle);
                    }
                }
            }
        }
    }
    for bad in bad_meshes() {
        assert!(TriangleMesh::new(bad.positions, bad.triangles).is_err(), "{}", bad.name);
    }
}

#[test]
fn scenes_of_any_size_and_place_give_the_same_set() {
    let ball = farsight_geometry::hard_cases::bumpy_ball(5);
    let seen = |mesh: &TriangleMesh, scale: f64, offset: DVec3| {
        let corner = (DVec3::new(1.4, 0.3, 0.5), DVec3::new(1.8, 0.9, 1.1));
        let cell =
            ViewCell::from_box(&DAabb::new(corner.0 * scale + offset, corner.1 * scale + offset)).unwrap();
        let (triangles, caster) = (Triangles::of_mesh(mesh), Bvh8::new(mesh));
        let mut sampler =
            Sampler::new(&triangles, Occluders::opaque(&caster), &cell, Options::default()).unwrap();
        sampler.run(&Budget::rays(300_000));
        assert_eq!(sampler.cost().counters.get("self_hits"), 0, "{scale} {offset}");
        sampler.pvs()
    };
    let plain = seen(&ball, 1.0, DVec3::ZERO);
    assert!(plain.len() > 80);
    // Powers of two scale exactly.
    for power in [-60, -20, 20, 59] {
        let scale = 2f32.powi(power);
        let scaled = ball.positions().iter().map(|p| *p * scale).collect();
        let mesh = TriangleMesh::new(scaled, ball.triangles().to_vec()).unwrap();
        assert_eq!(seen(&mesh, f64::from(scale), DVec3::ZERO), plain, "2^{power}");
    }
    for offset in [1e4, 1e6] {
        let mesh = ball.clone().with_origin(DVec3::splat(offset)).unwrap();
        assert_eq!(seen(&mesh, 1.0, DVec3::splat(offset)), plain, "{offset}");
    }
}

/// Two walls with a gap of a tenth of a milliradian, and a screen behind.
#[test]
fn a_gap_of_a_tenth_of_a_milliradian_is_seen_through() {
    let wall = |y: [f32; 2], x: f32| {
        [[y[0], -9.0], [y[1], -9.0], [y[1], 9.0], [y[0], 9.0]].map(|[y, z]| Vec3::new(x, y, z))
    };
    let mut positions = Vec::new();
    for (y, x) in [([-9.0, 0.0], 2.0), ([2e-4, 9.0], 2.0), ([-20.0, 20.0], 4.0)] {
        let [a, b, c, d] = wall(y, x);
        positions.extend([a, b, c, a, c, d]);
    }
    let triangles = (0..6).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let mesh = TriangleMesh::new(positions, triangles).unwrap();
    let (triangles, caster) = (Triangles::of_mesh(&mesh), Bvh8::new(&mesh));
    let cell = ViewCell::from_box(&DAabb::new(DVec3::splat(-0.05), DVec3::splat(0.05))).unwrap();
    let mut sampler =
        Sampler::new(&triangles, Occluders::opaque(&caster), &cell, Options::default()).unwrap();
    sampler.run(&Budget::rays(400_000));
    assert!(sampler.contains(4) || sampler.contains(5));
}

#[test]
fn instances_and_groups_count_as_members() {
    let mut scene = Scene::of_mesh(farsight_geometry::hard_cases::bumpy_ball(4));
    for x in [4.0, 8.0, -4.0] {
        let world_from_mesh = DAffine3::from_translation(DVec3::X * x);
        scene
            .add_instance(Instance { name: String::new(), mesh: MeshId(0), world_from_mesh, material: None })
            .unwrap();
    }
    let caster = SceneCaster::new(&scene).unwrap();
    // From left of the leftmost ball, close behind it: it hides the others but for a rim.
    let cell =
        ViewCell::from_box(&DAabb::new(DVec3::new(-7.0, -0.1, -0.1), DVec3::new(-6.8, 0.1, 0.1))).unwrap();
    let triangles = Triangles::of_scene(&scene).unwrap();
    let run = |triangles: &Triangles| {
        let mut sampler =
            Sampler::new(triangles, Occluders::opaque(&caster), &cell, Options::default()).unwrap();
        sampler.run(&Budget::rays(300_000));
        sampler.pvs()
    };
    let (single, whole) = (run(&triangles), run(&triangles.clone().by_instance()));
    let instances: std::collections::BTreeSet<u32> =
        single.iter().map(|t| triangles.clone().by_instance().member(t)).collect();
    assert_eq!(whole.iter().collect::<Vec<_>>(), instances.into_iter().collect::<Vec<_>>());
    assert!(whole.contains(3));
}

/// A two-sided leaf as a pair of opposite triangles before a wall: with back-face culling from either side one is seen, and
/// the wall through a transparent one.
#[test]
fn culled_backs_and_transparent_fronts() {
    let p = [Vec3::new(2.0, -1.0, -1.0), Vec3::new(2.0, 1.0, -1.0), Vec3::new(2.0, 0.0, 1.0)];
    let far = [Vec3::new(4.0, -0.2, -0.2), Vec3::new(4.0, 0.0, 0.2), Vec3::new(4.0, 0.2, -0.2)];
    let mesh = TriangleMesh::new([p, far].concat(), vec![[0, 1, 2], [0, 2, 1], [3, 4, 5]]).unwrap();
    let triangles = Triangles::of_mesh(&mesh);
    let cell = ViewCell::from_box(&DAabb::new(DVec3::splat(-0.1), DVec3::splat(0.1))).unwrap();
    let seen = |occluders: Occluders<Bvh8>| {
        let mut sampler = Sampler::new(&triangles, occluders, &cell, Options::default()).unwrap();
        sampler.run(&Budget::rays(150_000));
        sampler.pvs().iter().collect::<Vec<_>>()
    };
    assert_eq!(seen(Occluders::opaque(&Bvh8::new(&mesh))), [0], "of coincident triangles the first");
    // Seen from −x, counter-clockwise is what winds from −y to +z to +y: the second.
    let fronts = Bvh8::new(&mesh).front_faces_only();
    assert_eq!(seen(Occluders::opaque(&fronts)), [1]);
    let [solid, leaf] = parted(&mesh, |t| t < 2).map(|m| Bvh8::new(&m).front_faces_only());
    assert_eq!(seen(Occluders::with_transparent(&solid, &leaf)), [1, 2]);
}

#[test]
fn impossible_options_are_refused_by_name() {
    let mesh = TriangleMesh::default();
    let (triangles, caster) = (Triangles::of_mesh(&mesh), Bvh8::new(&mesh));
    let cell = ViewCell::from_box(&DAabb::new(DVec3::ZERO, DVec3::ONE)).unwrap();
    type Change = fn(&mut Options);
    let changes: [(&str, Change); 6] = [
        ("epsilon", |o| o.epsilon = f64::NAN),
        ("tolerance[0]", |o| o.tolerance[0] = 0.0),
        ("tolerance[1]", |o| o.tolerance = [1e-3, 1e-2]),
        ("least_share", |o| o.least_share = 0.5),
        ("least_share", |o| o.least_share = f64::NAN),
        ("jobs_per_member", |o| o.jobs_per_member = 0),
    ];
    for (name, change) in changes {
        let mut options = Options::default();
        change(&mut options);
        let error = Sampler::new(&triangles, Occluders::opaque(&caster), &cell, options).err().unwrap();
        assert!(matches!(error, VisibilityError::Option { option, .. } if option == name), "{error}");
    }
    let mut nothing =
        Sampler::new(&triangles, Occluders::opaque(&caster), &cell, Options::default()).unwrap();
    nothing.run(&Budget::rays(u64::MAX));
    assert!(nothing.is_empty() && nothing.rays() == 0);
}
