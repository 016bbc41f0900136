//! The same set for any number of threads, however a run is cut, and whichever caster answers.

use farsight_geometry::hard_cases::bumpy_ball;
use farsight_geometry::ray::{BruteForce, Bvh8, ObvhsCaster, ObvhsTree};
use farsight_geometry::sampling::Random;
use farsight_geometry::{DAabb, Ray, RayCaster, TriangleMesh};
use farsight_visibility::glam::{DVec3, Vec3};
use farsight_visibility::{Budget, Occluders, Options, Sampler, Triangles, ViewCell, Witness};
use std::ops::ControlFlow;

/// Cubes turned at random in a box of side 30 around the origin.
pub fn cubes(count: usize, seed: u64) -> TriangleMesh {
    let mut random = Random::new(seed);
    let (mut positions, mut triangles) = (Vec::<Vec3>::new(), Vec::<[u32; 3]>::new());
    for _ in 0..count {
        let mut vector = || DVec3::from_array(random.units()) * 2.0 - DVec3::ONE;
        let (center, axis) = (vector() * 15.0, vector().normalize());
        let turn = farsight_visibility::glam::DQuat::from_axis_angle(axis, random.unit() * 6.0);
        let half = DVec3::splat(0.5 + 1.5 * random.unit());
        let base = positions.len() as u32;
        positions.extend(DAabb::new(-half, half).corners().map(|c| (center + turn * c).as_vec3()));
        triangles.extend(DAabb::TRIANGLES.map(|t| t.map(|i| base + i)));
    }
    TriangleMesh::new(positions, triangles).unwrap()
}

fn cell() -> ViewCell {
    ViewCell::from_box(&DAabb::new(DVec3::splat(-0.5), DVec3::splat(0.5))).unwrap()
}

fn options() -> Options {
    let mut options = Options::default();
    (options.first_random, options.witnesses) = (20_000, true);
    options
}

#[cfg(feature = "rayon")]
#[test]
fn threads_change_nothing() {
    let mesh = cubes(400, 3);
    let (triangles, caster, cell) = (Triangles::of_mesh(&mesh), Bvh8::new(&mesh), cell());
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut sampler = Sampler::new(&triangles, Occluders::opaque(&caster), &cell, options()).unwrap();
            sampler.run(&Budget::rays(300_000));
            (sampler.pvs(), sampler.witnesses().to_vec(), sampler.cost().counters)
        })
    };
    let one = run(1);
    assert!(one.0.len() > 500);
    assert!(run(2) == one && run(5) == one);
}

#[test]
fn runs_can_be_cut_cancelled_and_taken_up_again() {
    let mesh = cubes(200, 4);
    let (triangles, caster, cell) = (Triangles::of_mesh(&mesh), Bvh8::new(&mesh), cell());
    let sampler = || Sampler::new(&triangles, Occluders::opaque(&caster), &cell, options()).unwrap();
    let (mut whole, mut cut) = (sampler(), sampler());
    whole.run(&Budget::rays(400_000));
    let mut waves = 0;
    let stopped = cut.run_with(&Budget::rays(400_000), |s| {
        waves += 1;
        assert!(!s.is_empty());
        if waves == 5 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    assert!(stopped.is_break() && cut.rays() < whole.rays());
    cut.run(&Budget::rays(200_000));
    cut.run(&Budget::rays(400_000));
    assert_eq!((cut.pvs(), cut.witnesses()), (whole.pvs(), whole.witnesses()));
}

#[test]
fn casters_that_share_no_tree_give_the_same_set() {
    let mesh = bumpy_ball(6);
    let cell = ViewCell::from_box(&DAabb::new(DVec3::splat(1.5), DVec3::splat(2.0))).unwrap();
    let triangles = Triangles::of_mesh(&mesh);
    fn seen<C: RayCaster>(
        triangles: &Triangles,
        caster: &C,
        cell: &ViewCell,
    ) -> (farsight_visibility::Pvs, u64) {
        let mut sampler =
            Sampler::new(triangles, Occluders::opaque(caster), cell, Options::default()).unwrap();
        sampler.run(&Budget::rays(200_000));
        assert_eq!(sampler.len(), sampler.pvs().len());
        (sampler.pvs(), sampler.cost().counters.get("self_hits"))
    }
    let ours = seen(&triangles, &Bvh8::new(&mesh), &cell);
    assert!(ours.0.len() > 100 && ours.1 == 0);
    for tree in [ObvhsTree::Binary, ObvhsTree::Compressed] {
        assert_eq!(seen(&triangles, &ObvhsCaster::new(&mesh, tree), &cell), ours);
    }
    assert_eq!(seen(&triangles, &BruteForce::new(&mesh), &cell), ours);
}

/// Every member's witness, looked at with another method: the ray meets the triangle, and nothing lies before it.
#[test]
fn every_witness_holds_by_brute_force() {
    let mesh = cubes(150, 5);
    let (triangles, caster, cell) = (Triangles::of_mesh(&mesh), Bvh8::new(&mesh), cell());
    let mut sampler = Sampler::new(&triangles, Occluders::opaque(&caster), &cell, options()).unwrap();
    sampler.run(&Budget::rays(400_000));
    let oracle = BruteForce::new(&mesh);
    assert_eq!(sampler.witnesses().len(), sampler.len() as usize);
    for &(member, witness) in sampler.witnesses() {
        match witness {
            Witness::Touches(triangle) => {
                let b = DAabb::from_points(triangles.corners(triangle)).intersection(*cell.bounds());
                assert!(triangle == member && !b.is_empty());
            }
            Witness::Ray(sight) => {
                assert!(sight.triangle == member && cell.contains(sight.origin));
                let ray = Ray::new(sight.origin, sight.direction).unwrap();
                let own = oracle.all(&ray).find(|h| h.triangle == member).expect("the ray meets it");
                let first = oracle.closest(&ray).unwrap();
                assert!(first.t >= own.t * (1.0 - 1e-12), "{member} is hidden by {}", first.triangle);
            }
        }
    }
}

/// Twenty cubes: segments from the cell to every triangle, each checked against all, find nothing that the set lacks; what the
/// set has beyond that, brute force confirms along its witness.
#[test]
fn of_twenty_cubes_brute_force_finds_nothing_more() {
    let mesh = cubes(20, 6);
    let (triangles, caster, cell) = (Triangles::of_mesh(&mesh), Bvh8::new(&mesh), cell());
    let oracle = BruteForce::new(&mesh);
    let mut random = Random::new(61);
    let b = *cell.bounds();
    let seen: farsight_visibility::Pvs = (0..triangles.count())
        .filter(|&t| {
            let [p, q, r] = triangles.corners(t);
            (0..6000).any(|_| {
                let eye = b.min + (b.max - b.min) * DVec3::from_array(random.units());
                let [u, v] = random.units();
                let root = u.sqrt();
                let target = p + (q - p) * (root * (1.0 - v)) + (r - p) * (root * v);
                let ray = Ray::new(eye, target - eye).unwrap();
                oracle.closest(&ray).is_some_and(|h| h.triangle == t)
            })
        })
        .collect();
    let mut sampler = Sampler::new(&triangles, Occluders::opaque(&caster), &cell, options()).unwrap();
    sampler.run(&Budget::rays(4_000_000));
    assert_eq!(triangles.count(), 240);
    let lacking = seen.difference(&sampler.pvs());
    assert!(lacking.is_empty(), "{lacking:?}");
    let more = sampler.pvs().difference(&seen);
    assert!(more.len() <= 3, "slivers that random segments miss: {more:?}");
    for (member, witness) in sampler.witnesses() {
        if let (true, Witness::Ray(sight)) = (more.contains(*member), witness) {
            let hit = oracle.closest(&Ray::new(sight.origin, sight.direction).unwrap()).unwrap();
            assert_eq!(hit.triangle, *member);
        }
    }
}
