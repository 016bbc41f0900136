//! What a result looks like apart from its error.

mod common;

use common::{TIERS, terrain};
use farsight_geometry::glam::{DVec3, Vec3, vec3};
use farsight_geometry::{TriangleMesh, hard_cases};
use farsight_hlod::{HlodError, SimplifyOptions, Tier, simplify};

fn count(mesh: &TriangleMesh, tolerance: f64) -> usize {
    simplify(mesh, tolerance, &SimplifyOptions::default()).unwrap().mesh.triangles().len()
}

#[test]
fn a_plane_needs_two_triangles() {
    let plane = terrain(128, |_, _| 0.0);
    assert_eq!(count(&plane, 1.0 / 2048.0), 2);
    // Tilted, with coordinates that are not exact, and far away: flat up to a few units of the last place.
    let (u, v) = (vec3(0.6, 0.3, 0.2), vec3(-0.25, 0.55, 0.31));
    let far = Vec3::splat(1e3);
    let p = plane.positions().iter().map(|q| far + u * q.x * 1e2 + v * q.y * 1e2).collect();
    let tilted = TriangleMesh::new(p, plane.triangles().to_vec()).unwrap();
    let kept = count(&tilted, tilted.bounds().diagonal() as f64 / 65536.0);
    assert!(kept <= 4, "{kept}");
}

#[test]
fn a_box_needs_twelve() {
    let mut p = Vec::new();
    let mut t = Vec::new();
    for (u, v, w) in [
        (Vec3::X, Vec3::Y, Vec3::Z),
        (Vec3::Y, Vec3::Z, Vec3::X),
        (Vec3::Z, Vec3::X, Vec3::Y),
        (Vec3::Y, Vec3::X, Vec3::ZERO),
        (Vec3::Z, Vec3::Y, Vec3::ZERO),
        (Vec3::X, Vec3::Z, Vec3::ZERO),
    ] {
        let side = terrain(16, |_, _| 0.0);
        let base = p.len() as u32;
        p.extend(side.positions().iter().map(|q| u * q.x + v * q.y + w));
        t.extend(side.triangles().iter().map(|t| t.map(|i| i + base)));
    }
    let simple = simplify(&TriangleMesh::new(p, t).unwrap(), 1e-3, &SimplifyOptions::default()).unwrap();
    assert_eq!((simple.mesh.triangles().len(), simple.welded), (12, 6 * 17 * 17 - 6 * 16 * 16 - 2));
    assert!((simple.mesh.area() - 6.0).abs() < 0.02);
}

/// An edge cuts a face that overhangs it by a hair in two, whose own rounding must not let it cut them again and again.
#[test]
fn rims_of_a_rod_are_not_taken_back() {
    let rod = common::rod(96, 48);
    let size = rod.world_bounds().diagonal();
    for share in [128.0, 512.0] {
        for (tier, most) in [(Tier::Guaranteed, 115), (Tier::Verified, 400)] {
            let options = SimplifyOptions::default().with_tier(tier);
            let kept = simplify(&rod, size / share, &options).unwrap().mesh.triangles().len();
            assert!(kept < most, "{tier:?} 1/{share}: {kept} of {}", rod.triangles().len());
        }
    }
}

#[test]
fn closed_surfaces_stay_closed_and_keep_their_volume() {
    let volume = |m: &TriangleMesh| {
        m.corner_iter().map(|[a, b, c]| a.as_dvec3().dot(b.as_dvec3().cross(c.as_dvec3()))).sum::<f64>() / 6.0
    };
    for mesh in [hard_cases::bumpy_ball(20), common::rod(48, 40)] {
        let size = mesh.world_bounds().diagonal();
        for tier in TIERS {
            for share in [32.0, 128.0, 1024.0] {
                let options = SimplifyOptions::default().with_tier(tier);
                let simple = simplify(&mesh, size / share, &options).unwrap();
                let report = simple.mesh.report();
                assert!(report.is_closed() && report.components == 1, "{tier:?} {share}: {report}");
                let change = (volume(&simple.mesh) - volume(&mesh)).abs();
                assert!(change <= mesh.area() * simple.geometric.value, "{tier:?} {share}");
            }
        }
    }
}

#[test]
fn no_triangle_turns_over() {
    for tier in [Tier::Guaranteed, Tier::Verified] {
        let options = SimplifyOptions::default().with_tier(tier);
        let simple = simplify(&terrain(60, common::hills), 0.004, &options).unwrap();
        for [a, b, c] in simple.mesh.corner_iter() {
            assert!((b - a).cross(c - a).z > 0.0, "{a} {b} {c}");
        }
    }
}

#[test]
fn scale_and_origin_change_nothing() {
    let ball = hard_cases::bumpy_ball(16);
    let expected = simplify(&ball, 0.01, &SimplifyOptions::default()).unwrap();
    for exponent in [-60, -20, 20, 58] {
        let scale = 2f32.powi(exponent);
        let p = ball.positions().iter().map(|&p| p * scale).collect();
        let scaled = TriangleMesh::new(p, ball.triangles().to_vec()).unwrap();
        let simple = simplify(&scaled, 0.01 * f64::from(scale), &SimplifyOptions::default()).unwrap();
        assert_eq!(simple.mesh.triangles(), expected.mesh.triangles());
        for (a, b) in simple.mesh.positions().iter().zip(expected.mesh.positions()) {
            assert_eq!(*a, *b * scale);
        }
    }
    let origin = DVec3::new(5e5, -5e6, 1e3);
    let moved = simplify(&ball.with_origin(origin).unwrap(), 0.01, &SimplifyOptions::default()).unwrap();
    assert_eq!((moved.mesh.origin(), moved.mesh.positions()), (origin, expected.mesh.positions()));
}

#[test]
fn the_same_input_gives_the_same_bytes_and_order_of_triangles_hardly_matters() {
    let mesh = terrain(40, common::hills);
    for tier in TIERS {
        let options = SimplifyOptions::default().with_tier(tier);
        let (a, b) = (simplify(&mesh, 0.003, &options).unwrap(), simplify(&mesh, 0.003, &options).unwrap());
        assert_eq!((a.mesh, a.cost.counters), (b.mesh, b.cost.counters));
    }
    let backwards: Vec<[u32; 3]> = mesh.triangles().iter().rev().copied().collect();
    let other = TriangleMesh::new(mesh.positions().to_vec(), backwards).unwrap();
    let (a, b) = (count(&mesh, 0.003) as f64, count(&other, 0.003) as f64);
    assert!((a / b - 1.0).abs() < 0.05, "{a} {b}");
}

#[test]
fn soups_are_welded_and_doubles_dropped() {
    let ball = hard_cases::bumpy_ball(16);
    let p: Vec<Vec3> = ball.corner_iter().flatten().collect();
    let mut t: Vec<[u32; 3]> = (0..p.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    t.push([1, 2, 0]);
    let soup = TriangleMesh::new(p, t).unwrap();
    let simple = simplify(&soup, 0.02, &SimplifyOptions::default()).unwrap();
    assert_eq!((simple.welded, simple.doubled), (soup.positions().len() - ball.positions().len(), 1));
    assert!(simple.mesh.report().is_closed());
    assert_eq!(simple.mesh.triangles().len(), count(&ball, 0.02));
}

#[test]
fn sheets_that_share_an_edge_keep_sharing_it() {
    let mesh = common::three_sheets(24);
    let simple = simplify(&mesh, 0.002, &SimplifyOptions::default()).unwrap();
    let (before, after) = (mesh.report(), simple.mesh.report());
    assert!(
        before.non_manifold_edges == 24 && after.non_manifold_edges > 0 && after.components == 1,
        "{after}"
    );
    assert!(simple.mesh.triangles().len() < mesh.triangles().len() / 8);
}

#[test]
fn impossible_tolerances_are_named() {
    let ball = hard_cases::bumpy_ball(4);
    let options = SimplifyOptions::default();
    for tolerance in [-1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(simplify(&ball, tolerance, &options), Err(HlodError::Tolerance { .. })));
    }
    assert!(matches!(simplify(&ball, 0.0, &options), Err(HlodError::BelowResolution { .. })));
    // The coordinates of a ball far from its origin are rounded by more than this.
    let p = ball.positions().iter().map(|&p| p + Vec3::splat(1e6)).collect();
    let rounded = TriangleMesh::new(p, ball.triangles().to_vec()).unwrap();
    let error = simplify(&rounded, 1e-3, &options).unwrap_err();
    assert!(matches!(error, HlodError::BelowResolution { resolution, .. } if resolution > 0.03), "{error}");
    // Any tolerance is fine for nothing, and the largest leaves something.
    let empty = simplify(&TriangleMesh::default(), 0.0, &options).unwrap();
    assert!(empty.mesh.is_empty() && empty.geometric.value <= 1e-8);
    assert!(!simplify(&ball, 1e30, &options).unwrap().mesh.is_empty());
}
