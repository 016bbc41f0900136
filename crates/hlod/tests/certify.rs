//! Certificates of given pairs against distances measured by other code.

use farsight_geometry::distance::{HausdorffOptions, hausdorff};
use farsight_geometry::glam::{DVec3, Vec3};
use farsight_geometry::{TriangleMesh, hard_cases};
use farsight_hlod::{SimplifyOptions, Tier, certify, simplify};

/// A certain lower bound of the true distance.
fn true_distance(a: &TriangleMesh, b: &TriangleMesh, tolerance: f64) -> f64 {
    hausdorff(a, b, &HausdorffOptions::new(0.02 * tolerance).with_max_splits(20_000)).lower
}

#[test]
fn what_was_simplified_is_certified_without_measuring() {
    let ball = hard_cases::bumpy_ball(24);
    for tier in [Tier::Guaranteed, Tier::Verified] {
        for tolerance in [0.002, 0.01, 0.05] {
            let simple = simplify(&ball, tolerance, &SimplifyOptions::default().with_tier(tier)).unwrap();
            let found = certify(&ball, &simple.mesh, tolerance).unwrap();
            assert!(found.holds(tolerance), "{tier:?} {tolerance}: {found:?}");
            let triangles = ball.triangles().len() + simple.mesh.triangles().len();
            assert!(found.measured * 100 <= triangles as u64, "{tier:?} {tolerance}: {found:?}");
            assert!(found.bound.value >= true_distance(&ball, &simple.mesh, tolerance));
        }
    }
}

#[test]
fn no_bound_is_below_the_truth() {
    for hard in hard_cases::meshes() {
        let size = hard.mesh.world_bounds().diagonal();
        let tolerance = size / 64.0;
        let Ok(simple) = simplify(&hard.mesh, tolerance, &SimplifyOptions::default().with_tier(Tier::Fast))
        else {
            continue;
        };
        // The simplified one, itself, turned over, with a hole, and shifted by twice the tolerance.
        let mesh = &simple.mesh;
        let with = |positions: Vec<Vec3>, triangles: Vec<[u32; 3]>| {
            TriangleMesh::new(positions, triangles).unwrap().with_origin(mesh.origin()).unwrap()
        };
        let turned = mesh.triangles().iter().map(|&[a, b, c]| [a, c, b]).collect();
        let open = mesh.triangles()[mesh.triangles().len() / 8..].to_vec();
        let shift = Vec3::new(2.0 * tolerance as f32, 0.0, 0.0);
        let shifted = mesh.positions().iter().map(|&p| p + shift).collect();
        let others = [
            mesh.clone(),
            hard.mesh.clone(),
            with(mesh.positions().to_vec(), turned),
            with(mesh.positions().to_vec(), open),
            with(shifted, mesh.triangles().to_vec()),
        ];
        for (i, other) in others.iter().enumerate() {
            let found = certify(&hard.mesh, other, tolerance).unwrap();
            let truth = true_distance(&hard.mesh, other, tolerance);
            assert!(found.bound.value >= truth, "{} {i}: {found:?} below {truth}", hard.name);
            assert!(found.holds(tolerance) || found.measured > 0, "{} {i}: {found:?}", hard.name);
        }
    }
}

#[test]
fn origins_far_apart_are_seen() {
    let ball = hard_cases::bumpy_ball(8);
    let moved = ball.clone().with_origin(DVec3::new(0.01, 0.0, 0.0)).unwrap();
    let found = certify(&ball, &moved, 0.02).unwrap();
    assert!(found.holds(0.02) && found.bound.value > 0.005, "{found:?}");
    let far = ball.clone().with_origin(DVec3::new(1e4, 0.0, 0.0)).unwrap();
    let found = certify(&ball, &far, 0.02).unwrap();
    assert!(found.bound.value > 9e3, "{found:?}");
    let empty = TriangleMesh::new(vec![], vec![]).unwrap();
    assert!(certify(&ball, &empty, 0.02).unwrap().bound.value.is_infinite());
    assert!(certify(&ball, &ball, f64::NAN).is_err());
}
