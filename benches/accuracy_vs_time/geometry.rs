//! Hausdorff distance: tolerance against time, on pairs of surfaces whose distance has a closed form.

use super::row::{Row, timed};
use farsight_geometry::TriangleMesh;
use farsight_geometry::accuracy::{ErrorBound, Unit};
use farsight_geometry::distance::{HausdorffOptions, hausdorff};
use farsight_geometry::glam::{Vec3, vec3};

pub fn rows(quick: bool) -> Vec<Row> {
    let (n, runs) = if quick { (24, 3) } else { (60, 3) };
    let scenes = [balls(n), hills(n)];
    let tolerances = [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6];
    scenes.iter().flat_map(|scene| tolerances.map(|tolerance| row(scene, tolerance, runs))).collect()
}

struct Pair {
    name: &'static str,
    a: TriangleMesh,
    b: TriangleMesh,
    exact: f64,
}

fn row(pair: &Pair, tolerance: f64, runs: usize) -> Row {
    let (d, times) = timed(runs, || hausdorff(&pair.a, &pair.b, &HausdorffOptions::new(tolerance)));
    let cost = d.cost();
    Row {
        krate: "geometry",
        scene: format!("{} {}k", pair.name, (pair.a.triangles().len() + pair.b.triangles().len()) / 1000),
        knob: "hausdorff tolerance".into(),
        value: tolerance,
        claimed: ErrorBound::proven(d.upper - d.lower, Unit::Metres),
        measured: (d.upper - pair.exact).abs().max((d.lower - pair.exact).abs()),
        times,
        bytes: cost.bytes,
        counters: cost.counters,
    }
}

/// A convex polyhedron with its vertices on a sphere, and itself at twice the size: every vertex `2v` is nearest to `v`.
fn balls(n: u32) -> Pair {
    let (points, triangles) = sheet(2 * n, n);
    let on_sphere = |p: Vec3| {
        let (longitude, latitude) =
            (f64::from(p.x) * std::f64::consts::TAU, f64::from(p.y) * std::f64::consts::PI);
        let ring = latitude.sin();
        let q = [ring * longitude.cos(), ring * longitude.sin(), latitude.cos()];
        Vec3::from_array(q.map(|c| c as f32))
    };
    let ball: Vec<Vec3> = points.into_iter().map(on_sphere).collect();
    let double: Vec<Vec3> = ball.iter().map(|&p| p * 2.0).collect();
    let exact = ball.iter().map(|p| p.as_dvec3().length()).fold(0.0, f64::max);
    Pair { name: "balls", a: mesh(ball, &triangles), b: mesh(double, &triangles), exact }
}

/// Hills over a plain that reaches beyond them on all sides: the highest vertex is as far away as it is high.
fn hills(n: u32) -> Pair {
    let (points, triangles) = sheet(n, n);
    let height = |p: Vec3| 0.1 * (p.x * 9.0).sin().abs() * (p.y * 7.0).cos().abs();
    let hills: Vec<Vec3> = points.iter().map(|&p| vec3(p.x, p.y, height(p))).collect();
    let exact = hills.iter().map(|p| f64::from(p.z)).fold(0.0, f64::max);
    Pair { name: "hills", a: mesh(hills, &triangles), b: mesh(points, &triangles), exact }
}

/// The unit square in `columns` by `rows` cells.
fn sheet(columns: u32, rows: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let at = |i: u32, j: u32| vec3(i as f32 / columns as f32, j as f32 / rows as f32, 0.0);
    let points = (0..=rows).flat_map(|j| (0..=columns).map(move |i| at(i, j))).collect();
    let cell = |i: u32, j: u32| {
        let a = j * (columns + 1) + i;
        [[a, a + 1, a + columns + 2], [a, a + columns + 2, a + columns + 1]]
    };
    (points, (0..rows).flat_map(|j| (0..columns).flat_map(move |i| cell(i, j))).collect())
}

fn mesh(points: Vec<Vec3>, triangles: &[[u32; 3]]) -> TriangleMesh {
    TriangleMesh::new(points, triangles.to_vec()).expect("the scene is valid")
}
