//! The stated bound against the true share of missed pixels, and what sampling stops at.

use farsight_geometry::ray::Bvh8;
use farsight_geometry::sampling::Random;
use farsight_geometry::{DAabb, Ray, RayCaster, TriangleMesh};
use farsight_visibility::glam::{DVec3, Vec3};
use farsight_visibility::{Budget, Occluders, Options, Pvs, Sampler, Triangles, ViewCell};

/// Leaves strewn around the origin, none within 2.
fn leaves(count: usize) -> TriangleMesh {
    let mut random = Random::new(77);
    let mut positions = Vec::new();
    while positions.len() < 3 * count {
        let mut vector = || DVec3::from_array(random.units()) * 2.0 - DVec3::ONE;
        let center = vector() * 10.0;
        if center.length() > 2.5 {
            positions.extend((0..3).map(|_| (center + vector() * 0.4).as_vec3()));
        }
    }
    let triangles = (0..count as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    TriangleMesh::new(positions, triangles).unwrap()
}

/// Triangles of pixels, from viewpoints and in directions drawn by other means than the sampler's.
fn pixels(caster: &Bvh8, b: &DAabb, count: usize) -> Vec<Option<u32>> {
    let mut random = Random::new(123_456);
    let mut direction = move || loop {
        let d = DVec3::from_array(random.units()) * 2.0 - DVec3::ONE;
        if (0.01..1.0).contains(&d.length_squared()) {
            return (d, DVec3::from_array(random.units()));
        }
    };
    let ray = |(d, u): (DVec3, DVec3)| Ray::new(b.min + (b.max - b.min) * u, d).unwrap();
    (0..count).map(|_| caster.closest(&ray(direction())).map(|h| h.triangle)).collect()
}

fn share(set: &Pvs, pixels: &[Option<u32>]) -> f64 {
    pixels.iter().flatten().filter(|&&t| !set.contains(t)).count() as f64 / pixels.len() as f64
}

#[test]
fn bounds_hold_as_often_as_they_say() {
    let mesh = leaves(3000);
    let (triangles, caster) = (Triangles::of_mesh(&mesh), Bvh8::new(&mesh));
    let b = DAabb::new(DVec3::splat(-0.5), DVec3::splat(0.5));
    let cell = ViewCell::from_box(&b).unwrap();
    let truth = pixels(&caster, &b, 500_000);
    let (mut held, mut tight, runs) = (0, 0.0, 240);
    for seed in 0..runs {
        let mut options = Options::default();
        (options.seed, options.first_random) = (seed, 4096);
        let mut sampler = Sampler::new(&triangles, Occluders::opaque(&caster), &cell, options).unwrap();
        sampler.run(&Budget::rays(8000 + 40 * seed));
        let set = sampler.pvs();
        let missed = sampler.validate(4000, 0.95).unwrap();
        let true_share = share(&set, &truth);
        held += u64::from(true_share <= missed.bound.value);
        tight += missed.bound.value / true_share / runs as f64;
        // What was missed is added.
        assert!(set.is_subset(&sampler.pvs()) && (missed.misses == 0) == (set == sampler.pvs()));
    }
    // Of 240 with probability 0.95 each, 217 or fewer happen once in a thousand times.
    assert!(held >= 218, "{held} of {runs}");
    assert!(tight < 2.0, "the bound is {tight} times the truth on average");
}

#[test]
fn sampling_stops_at_a_proven_share_and_the_share_is_true() {
    let mesh = leaves(1500);
    let (triangles, caster) = (Triangles::of_mesh(&mesh), Bvh8::new(&mesh));
    let b = DAabb::new(DVec3::splat(-0.5), DVec3::splat(0.5));
    let cell = ViewCell::from_box(&b).unwrap();
    let truth = pixels(&caster, &b, 1_000_000);
    for (seed, limit) in [(1, 1e-3), (2, 1e-3), (3, 1e-4)] {
        let mut options = Options::default();
        (options.seed, options.first_random) = (seed, 4096);
        let mut sampler = Sampler::new(&triangles, Occluders::opaque(&caster), &cell, options).unwrap();
        sampler.run(&Budget::missed(limit, 0.95, 20_000_000).unwrap());
        let missed = sampler.missed().unwrap();
        assert!(missed.bound.value <= limit && missed.confidence == 0.95, "{missed:?}");
        assert!(share(&sampler.pvs(), &truth) <= limit);
        assert!(sampler.rays() < 6_000_000, "{}", sampler.rays());
    }
    assert!(Budget::missed(0.0, 0.95, 1).is_err() && Budget::missed(0.1, 1.0, 1).is_err());
}

#[test]
fn sampling_stops_when_a_million_rays_find_little() {
    let mesh = leaves(300);
    let (triangles, caster) = (Triangles::of_mesh(&mesh), Bvh8::new(&mesh));
    let cell = ViewCell::from_box(&DAabb::new(DVec3::splat(-0.5), DVec3::splat(0.5))).unwrap();
    let mut sampler =
        Sampler::new(&triangles, Occluders::opaque(&caster), &cell, Options::default()).unwrap();
    let mut budget = Budget::rays(50_000_000);
    budget.new_per_million = Some(50.0);
    sampler.run(&budget);
    assert!((1_000_000..3_000_000).contains(&sampler.rays()), "{}", sampler.rays());
    assert!(sampler.new_per_million().unwrap() < 50.0);
}

#[test]
fn a_set_that_misses_everything_says_so() {
    let mesh = TriangleMesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2]]).unwrap();
    let (triangles, caster) = (Triangles::of_mesh(&mesh), Bvh8::new(&mesh));
    let cell =
        ViewCell::from_box(&DAabb::new(DVec3::new(0.2, 0.2, 0.01), DVec3::new(0.3, 0.3, 0.02))).unwrap();
    let mut sampler =
        Sampler::new(&triangles, Occluders::opaque(&caster), &cell, Options::default()).unwrap();
    let missed = sampler.validate(10_000, 0.95).unwrap();
    assert!((0.45..0.56).contains(&missed.bound.value), "half of all directions: {missed:?}");
    assert_eq!((sampler.len(), missed.per_million()), (1, missed.bound.value * 1e6));
    assert!(sampler.validate(10, 1.5).is_err());
}

/// Where members are groups, a known group is not missed for want of some of its triangles.
#[test]
fn groups_are_missed_as_groups() {
    let mesh = leaves(3000);
    let caster = Bvh8::new(&mesh);
    let groups: Vec<u32> = (0..3000).map(|t| t % 30).collect();
    let triangles = Triangles::of_mesh(&mesh).with_members(groups, 30).unwrap();
    let cell = ViewCell::from_box(&DAabb::new(DVec3::splat(-0.5), DVec3::splat(0.5))).unwrap();
    let mut options = Options::default();
    options.first_random = 2000;
    let mut sampler = Sampler::new(&triangles, Occluders::opaque(&caster), &cell, options).unwrap();
    sampler.run(&Budget::rays(2000));
    // Every group has triangles on all sides; far from all triangles are known.
    assert_eq!(sampler.pvs().len(), 30);
    let missed = sampler.validate(20_000, 0.95).unwrap();
    assert_eq!((missed.misses, missed.rays), (0, 20_000));
    assert!(missed.bound.value < 2e-4);
}
