//! The claimed bound against independent measurements of the true distance.

mod common;

use common::{TIERS, measure, meshes};
use farsight_geometry::distance::closest_on_triangle;
use farsight_geometry::glam::DVec3;
use farsight_geometry::{TriangleMesh, hard_cases};
use farsight_hlod::{HlodError, SimplifyOptions, Tier, simplify};

#[test]
fn true_distances_stay_below_the_claim_and_the_claim_below_the_request() {
    for (name, mesh) in meshes() {
        let size = mesh.world_bounds().diagonal();
        for share in [128.0, 512.0, 2048.0] {
            let tolerance = size / share;
            for tier in [Tier::Guaranteed, Tier::Verified] {
                let simple = simplify(&mesh, tolerance, &SimplifyOptions::default().with_tier(tier)).unwrap();
                let claim = simple.geometric.value;
                let case = format!("{name} 1/{share} {tier:?}");
                assert!(claim <= tolerance, "{case}: claims {claim} of {tolerance}");
                let true_distance = measure(&mesh, &simple, tolerance);
                assert!(true_distance.lower <= claim, "{case}: {true_distance:?} above {claim}");
                assert!(simple.mesh.triangles().len() <= mesh.triangles().len(), "{case}");
            }
        }
    }
}

#[test]
fn halving_the_tolerance_halves_the_error_and_never_helps_the_count_much() {
    let mesh = common::terrain(60, common::hills);
    let mut last = 0;
    for step in 0..8 {
        let tolerance = 0.1 * 0.5f64.powi(step);
        let simple = simplify(&mesh, tolerance, &SimplifyOptions::default()).unwrap();
        let d = measure(&mesh, &simple, tolerance);
        assert!(d.lower <= simple.geometric.value && simple.geometric.value <= tolerance);
        let count = simple.mesh.triangles().len();
        assert!(count as f64 >= 0.9 * f64::from(last), "{tolerance}: {count} after {last}");
        last = count as u32;
    }
    // The tolerance is used: the true error is near it.
    let tolerance = 1.0 / 300.0;
    let simple = simplify(&mesh, tolerance, &SimplifyOptions::default()).unwrap();
    assert!(measure(&mesh, &simple, tolerance).lower > 0.9 * tolerance);
}

#[test]
fn every_tier_holds_on_every_hard_mesh() {
    for hard in hard_cases::meshes() {
        let bounds = hard.mesh.world_bounds();
        let size = if bounds.is_empty() { 1.0 } else { bounds.diagonal() };
        for share in [3.0, 10.0, 100.0, 1000.0] {
            let tolerance = size / share;
            for tier in TIERS {
                let case = format!("{} 1/{share} {tier:?}", hard.name);
                let simple =
                    match simplify(&hard.mesh, tolerance, &SimplifyOptions::default().with_tier(tier)) {
                        Ok(simple) => simple,
                        Err(HlodError::BelowResolution { resolution, .. }) => {
                            assert!(tolerance < resolution, "{case}");
                            continue;
                        }
                        Err(other) => panic!("{case}: {other}"),
                    };
                assert_eq!(simple.mesh.is_empty(), hard.mesh.is_empty(), "{case}");
                let claim = simple.geometric.value;
                assert!(tier == Tier::Fast || claim <= tolerance, "{case}");
                let d = measure(&hard.mesh, &simple, tolerance);
                assert!(d.lower <= claim, "{case}: {} above {claim}", d.lower);
            }
        }
    }
}

/// Largest distance of points on `a` from `b`, the obvious slow way.
fn sampled(a: &TriangleMesh, b: &TriangleMesh) -> f64 {
    let corners = |m: &TriangleMesh| -> Vec<[DVec3; 3]> {
        m.corner_iter().map(|c| c.map(|p| m.origin() + p.as_dvec3())).collect()
    };
    let others = corners(b);
    let mut worst = 0.0f64;
    // An even share of the triangles: the product of both counts is what takes time.
    let step = a.triangles().len() / 400 + 1;
    for [p, q, r] in corners(a).into_iter().step_by(step) {
        for (v, w) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.5, 0.5), (0.5, 0.0), (0.0, 0.5), (0.33, 0.33)] {
            let x = p + (q - p) * v + (r - p) * w;
            let near =
                others.iter().map(|&t| closest_on_triangle(t, x).distance(x)).fold(f64::INFINITY, f64::min);
            worst = worst.max(near);
        }
    }
    worst
}

#[test]
fn the_fast_tier_reports_what_it_really_did() {
    for (name, mesh) in meshes() {
        let size = mesh.world_bounds().diagonal();
        for share in [64.0, 512.0] {
            let tolerance = size / share;
            let simple =
                simplify(&mesh, tolerance, &SimplifyOptions::default().with_tier(Tier::Fast)).unwrap();
            let seen = sampled(&mesh, &simple.mesh).max(sampled(&simple.mesh, &mesh));
            let claim = simple.geometric.value;
            assert!(seen <= claim, "{name} 1/{share}: {seen} above {claim}");
            // Not an idle bound: above the request, it is near the truth.
            let d = measure(&mesh, &simple, tolerance);
            assert!(claim <= tolerance || claim <= d.upper + 0.05 * tolerance, "{name} {claim} {d:?}");
        }
    }
}

/// Numbers from a fixed sequence.
fn numbers(mut seed: u64) -> impl FnMut(u32) -> u32 {
    move |below| {
        seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (seed >> 33) as u32 % below
    }
}

#[test]
fn random_soups_on_a_grid_hold_whatever_coincides() {
    use farsight_geometry::glam::Vec3;
    // Corners on a coarse grid: edges of many triangles, folds, doubles, backs, triangles through each other.
    for seed in 0..120 {
        let mut number = numbers(seed);
        let grid = 2 + number(4);
        let mut at = || Vec3::from_array([0; 3].map(|_| number(grid) as f32));
        let p: Vec<Vec3> = (0..6 + seed % 20).map(|_| at()).collect();
        let count = p.len() as u32;
        let t = (0..4 + number(60)).map(|_| [0; 3].map(|_| number(count))).collect();
        let mesh = TriangleMesh::new(p, t).unwrap();
        let tolerance = f64::from(1 + number(100)) * 0.01;
        for tier in TIERS {
            let simple = simplify(&mesh, tolerance, &SimplifyOptions::default().with_tier(tier)).unwrap();
            let d = measure(&mesh, &simple, tolerance);
            assert!(d.lower <= simple.geometric.value, "{seed} {tier:?}: {d:?}");
            assert!(tier == Tier::Fast || simple.geometric.value <= tolerance, "{seed} {tier:?}");
        }
    }
}

#[test]
fn crumpled_sheets_hold() {
    use farsight_geometry::glam::vec3;
    // Manifold, but folded over and through itself: floods meet many layers.
    for seed in 0..24 {
        let mut number = numbers(seed);
        let n = 6 + number(10);
        let strength = [0.05, 0.5, 2.0][number(3) as usize];
        let sheet = common::terrain(n, |_, _| 0.0);
        let mut offset = || (number(1000) as f32 / 1000.0 - 0.5) * strength;
        let p = sheet.positions().iter().map(|&q| q * 2.0 + vec3(offset(), offset(), offset())).collect();
        let mesh = TriangleMesh::new(p, sheet.triangles().to_vec()).unwrap();
        let tolerance = f64::from(strength) * [0.02, 0.1, 0.3][number(3) as usize];
        for tier in TIERS {
            let simple = simplify(&mesh, tolerance, &SimplifyOptions::default().with_tier(tier)).unwrap();
            let d = measure(&mesh, &simple, tolerance);
            assert!(d.lower <= simple.geometric.value, "{seed} {tier:?}: {d:?}");
            assert!(tier == Tier::Fast || simple.geometric.value <= tolerance, "{seed} {tier:?}");
        }
    }
}
