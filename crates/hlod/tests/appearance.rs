//! Attributes: kept, and where they belong.

mod common;

use common::{TIERS, terrain};
use farsight_geometry::distance::closest_on_triangle;
use farsight_geometry::glam::{DVec3, Vec2, Vec3, vec2};
use farsight_geometry::{TriangleMesh, hard_cases};
use farsight_hlod::{Simplified, SimplifyOptions, Tier, simplify};

fn looks() -> SimplifyOptions {
    SimplifyOptions::default().with_appearance(true)
}

fn with_normals(mesh: TriangleMesh) -> TriangleMesh {
    let mut sums = vec![Vec3::ZERO; mesh.positions().len()];
    for (t, [a, b, c]) in mesh.triangles().iter().zip(mesh.corner_iter()) {
        t.iter().for_each(|&v| sums[v as usize] += (b - a).cross(c - a));
    }
    mesh.with_normals(sums.into_iter().map(Vec3::normalize_or_zero).collect()).unwrap()
}

/// The point of the result nearest to `p`: its triangle, and barycentric coordinates found by areas.
fn nearest(simple: &Simplified, p: DVec3) -> (usize, [f64; 3]) {
    let mesh = &simple.mesh;
    let mut best = (f64::INFINITY, 0, DVec3::ZERO);
    for (i, c) in mesh.corner_iter().enumerate() {
        let q = closest_on_triangle(c.map(|v| v.as_dvec3()), p);
        if q.distance(p) < best.0 {
            best = (q.distance(p), i, q);
        }
    }
    let [a, b, c] = mesh.corners(best.1).map(|v| v.as_dvec3());
    let (q, area) = (best.2, (b - a).cross(c - a).length());
    let part = |x: DVec3, y: DVec3| (x - q).cross(y - q).length() / area;
    (best.1, [part(b, c), part(c, a), part(a, b)])
}

#[test]
fn a_texture_on_a_plane_survives_two_triangles() {
    let plane = terrain(32, |_, _| 0.0);
    let uv = |p: &Vec3| vec2(0.2 + 3.0 * p.x, 0.7 - 2.0 * p.y + p.x);
    let uvs: Vec<Vec2> = plane.positions().iter().map(uv).collect();
    let colours =
        plane.positions().iter().map(|p| [(p.x * 200.0) as u8, 77, (p.y * 100.0) as u8, 255]).collect();
    let plane = plane.with_uvs(uvs).unwrap().with_colours(colours).unwrap();
    let simple = simplify(&plane, 0.02, &looks()).unwrap();
    assert!(simple.mesh.triangles().len() <= 8, "{}", simple.mesh.triangles().len());
    assert!(simple.appearance.unwrap().value <= 0.02);
    for (p, &found) in simple.mesh.positions().iter().zip(simple.mesh.uvs().unwrap()) {
        assert!(found.distance(uv(p)) < 0.02, "{p} {found}");
    }
    assert!(simple.mesh.colours().unwrap().iter().all(|c| c[1] == 77 && c[3] == 255));
}

#[test]
fn a_border_between_colours_stays_where_it_is() {
    let plane = terrain(64, |_, _| 0.0);
    let colour = |x: f64| if x < 0.4 { [255, 0, 0, 255] } else { [0, 0, 255, 255] };
    let colours = plane.positions().iter().map(|p| colour(f64::from(p.x))).collect();
    let plane = plane.with_colours(colours).unwrap();
    let simple = simplify(&plane, 0.02, &looks()).unwrap();
    let count = simple.mesh.triangles().len();
    assert!(count > 2 && count < plane.triangles().len() / 10, "{count}");
    for i in 0..200 {
        let x = f64::from(i) / 199.0;
        // The border itself is as wide as a square of the grid.
        if (x - 0.4).abs() < 0.02 + 2.0 / 64.0 {
            continue;
        }
        // The right colour need not be here, but within the tolerance.
        let red_at = |p: DVec3| -> f64 {
            let (t, w) = nearest(&simple, p);
            let found = simple.mesh.triangles()[t].map(|v| simple.mesh.colours().unwrap()[v as usize]);
            (0..3).map(|k| w[k] * f64::from(found[k][0])).sum()
        };
        let p = DVec3::new(x, (x * 7.3).fract(), 0.0);
        let around =
            (-4..=4).flat_map(|i| (-4..=4).map(move |j| DVec3::new(f64::from(i), f64::from(j), 0.0) * 0.005));
        let best =
            around.map(|d| (red_at(p + d) - f64::from(colour(x)[0])).abs()).fold(f64::INFINITY, f64::min);
        assert!(best < 25.0, "{x}: {best}");
    }
}

#[test]
fn creases_stay_sharp() {
    // A box whose sides have their own vertices and normals.
    let sides = [
        (Vec3::X, Vec3::Y, Vec3::Z),
        (Vec3::Y, Vec3::Z, Vec3::X),
        (Vec3::Z, Vec3::X, Vec3::Y),
        (Vec3::Y, Vec3::X, Vec3::ZERO),
        (Vec3::Z, Vec3::Y, Vec3::ZERO),
        (Vec3::X, Vec3::Z, Vec3::ZERO),
    ];
    let (mut p, mut n, mut t) = (vec![], vec![], vec![]);
    for (u, v, w) in sides {
        let side = terrain(12, |_, _| 0.0);
        let base = p.len() as u32;
        p.extend(side.positions().iter().map(|q| u * q.x + v * q.y + w));
        n.extend(side.positions().iter().map(|_| u.cross(v)));
        t.extend(side.triangles().iter().map(|t| t.map(|i| i + base)));
    }
    let cube = TriangleMesh::new(p, t).unwrap().with_normals(n).unwrap();
    let simple = simplify(&cube, 1e-3, &looks()).unwrap();
    assert_eq!((simple.mesh.triangles().len(), simple.mesh.positions().len()), (12, 24));
    for (t, [a, b, c]) in simple.mesh.triangles().iter().zip(simple.mesh.corner_iter()) {
        let flat = (b - a).cross(c - a).normalize();
        assert!(t.iter().all(|&v| simple.mesh.normals().unwrap()[v as usize].dot(flat) > 0.9999));
    }
}

#[test]
fn normals_are_found_within_the_tolerance() {
    let ball = with_normals(hard_cases::bumpy_ball(24));
    for tolerance in [0.04, 0.015] {
        let simple = simplify(&ball, tolerance, &looks()).unwrap();
        let plain = simplify(&ball, tolerance, &SimplifyOptions::default()).unwrap();
        assert!(simple.mesh.triangles().len() > plain.mesh.triangles().len());
        assert!(simple.geometric.value <= tolerance && simple.appearance.unwrap().value <= tolerance);
        assert!(plain.appearance.is_none() && plain.mesh.normals().is_none());
        // Somewhere near every vertex there is its normal: sampled over the result, the slow way.
        let mut samples = Vec::new();
        let normals = simple.mesh.normals().unwrap();
        for (t, c) in simple.mesh.triangles().iter().zip(simple.mesh.corner_iter()) {
            for i in 0..=12 {
                for j in 0..=(12 - i) {
                    let (v, w) = (i as f32 / 12.0, j as f32 / 12.0);
                    let mix = |x: [Vec3; 3]| x[0] * (1.0 - v - w) + x[1] * v + x[2] * w;
                    samples.push((mix(c), mix(t.map(|v| normals[v as usize])).normalize()));
                }
            }
        }
        let mut missed = 0;
        for (p, n) in ball.positions().iter().zip(ball.normals().unwrap()) {
            let near = |s: &&(Vec3, Vec3)| s.0.distance(*p) <= 1.5 * tolerance as f32;
            missed +=
                usize::from(!samples.iter().filter(near).any(|s| s.1.dot(*n) > 6f32.to_radians().cos()));
        }
        assert!(missed * 50 < ball.positions().len(), "{missed} of {}", ball.positions().len());
    }
}

#[test]
fn every_hard_mesh_keeps_its_attributes() {
    for hard in hard_cases::meshes() {
        let size = hard.mesh.world_bounds().diagonal();
        let count = hard.mesh.positions().len();
        let normals = (0..count).map(|i| Vec3::new((i as f32).sin(), 0.0, (i as f32).cos())).collect();
        let uvs = (0..count).map(|i| vec2(i as f32, -1e6)).collect();
        let mesh = hard.mesh.clone().with_normals(normals).unwrap().with_uvs(uvs).unwrap();
        for tier in TIERS {
            let tolerance = if hard.mesh.is_empty() { 1.0 } else { size / 50.0 };
            let Ok(simple) = simplify(&mesh, tolerance, &looks().with_tier(tier)) else { continue };
            assert_eq!(simple.mesh.is_empty(), mesh.is_empty(), "{}", hard.name);
            assert!(simple.mesh.normals().is_some() && simple.mesh.uvs().is_some());
            let error = simple.appearance.unwrap().value;
            assert!(tier == Tier::Fast || error <= tolerance, "{} {error} {tolerance}", hard.name);
            let d = common::measure(&mesh, &simple, tolerance);
            assert!(d.lower <= simple.geometric.value, "{}", hard.name);
        }
    }
}

#[test]
fn what_has_no_attributes_gets_none() {
    let ball = hard_cases::bumpy_ball(8);
    let (with, without) = (
        simplify(&ball, 0.02, &looks()).unwrap(),
        simplify(&ball, 0.02, &SimplifyOptions::default()).unwrap(),
    );
    assert!(with.appearance.is_none() && with.mesh == without.mesh);
}
