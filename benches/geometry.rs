//! What the small operations of the geometry crate cost, in nanoseconds; best of many runs on one thread.
//!
//! `cargo bench --bench geometry` prints the table that the documentation quotes.

use farsight_geometry::distance::{HausdorffOptions, Surface, hausdorff};
use farsight_geometry::glam::{DVec2, DVec3, dvec3};
use farsight_geometry::hard_cases::bumpy_ball;
use farsight_geometry::predicates::{orient2d, orient3d};
use farsight_geometry::{Camera, ConvexBody, DAabb, Frustum, Sphere, TriangleMesh};
use std::hint::black_box;
use std::time::Instant;

fn main() {
    println!("{:<58} {:>12}", "operation", "ns");
    predicates();
    bodies();
    cameras();
    distances();
}

/// Least time of one call, over batches.
fn best_ns(calls: u32, mut call: impl FnMut(u32)) -> f64 {
    let batch = |call: &mut dyn FnMut(u32)| {
        let start = Instant::now();
        (0..calls).for_each(call);
        start.elapsed().as_nanos() as f64 / f64::from(calls)
    };
    (0..15).map(|_| batch(&mut call)).fold(f64::INFINITY, f64::min)
}

fn print(what: &str, ns: f64) {
    println!("{what:<58} {ns:>12.1}");
}

fn points(count: u32) -> Vec<DVec3> {
    (0..count).map(f64::from).map(|t| dvec3((t * 1.1).sin(), (t * 1.7).cos(), (t * 2.3).sin())).collect()
}

fn predicates() {
    let p = points(1024);
    let at = |i: u32, k: u32| p[((i * 7 + k * 13) % 1024) as usize];
    let general = best_ns(100_000, |i| {
        black_box(orient3d(at(i, 0), at(i, 1), at(i, 2), at(i, 3)));
    });
    print("orient3d, points in general position", general);
    let flat = |i: u32, k: u32| at(i, k).with_z(at(i, k).x * 0.3 + 0.1);
    let coplanar = best_ns(10_000, |i| {
        black_box(orient3d(flat(i, 0), flat(i, 1), flat(i, 2), flat(i, 3)));
    });
    print("orient3d, coplanar up to rounding", coplanar);
    let general = best_ns(100_000, |i| {
        black_box(orient2d(at(i, 0).truncate(), at(i, 1).truncate(), at(i, 2).truncate()));
    });
    print("orient2d, points in general position", general);
    let line = |i: u32, k: u32| DVec2::new(at(i, k).x, at(i, k).x * 0.3 + 0.1);
    let collinear = best_ns(10_000, |i| {
        black_box(orient2d(line(i, 0), line(i, 1), line(i, 2)));
    });
    print("orient2d, collinear up to rounding", collinear);
}

fn bodies() {
    let camera = Camera::look_at(dvec3(0.0, 2.0, 0.0), dvec3(30.0, 1.0, 4.0), DVec3::Y).expect("valid");
    let frustum = Frustum::from_camera(&camera);
    let town = DAabb::new(dvec3(-50.0, 0.0, -50.0), dvec3(50.0, 10.0, 50.0));
    let mut body = ConvexBody::empty();
    print(
        "box cut by a frustum of 5 planes",
        best_ns(10_000, |_| {
            body.set_box(black_box(&town));
            body.clip_to_frustum(&frustum, DVec3::ZERO);
        }),
    );
    let boxes: Vec<DAabb> =
        points(1024).iter().map(|&p| DAabb::from_points([p * 40.0]).inflated(1.0)).collect();
    print(
        "box against a frustum of 5 planes",
        best_ns(100_000, |i| {
            black_box(frustum.classify(&boxes[(i % 1024) as usize]));
        }),
    );
}

fn cameras() {
    let camera = Camera::look_at(DVec3::ZERO, dvec3(0.0, 0.0, -1.0), DVec3::Y).expect("valid");
    let spheres: Vec<Sphere> =
        points(1024).iter().map(|&p| Sphere { center: p * 5.0 - DVec3::Z * 9.0, radius: 0.5 }).collect();
    print(
        "exact size of a sphere in pixels",
        best_ns(100_000, |i| {
            black_box(camera.sphere_px(&spheres[(i % 1024) as usize]));
        }),
    );
    print(
        "exact size of a box in pixels",
        best_ns(20_000, |i| {
            let s = &spheres[(i % 1024) as usize];
            black_box(camera.box_px(&DAabb::from_points([s.center]).inflated(s.radius)));
        }),
    );
    print(
        "bound on pixels moved, for a box",
        best_ns(100_000, |i| {
            let s = &spheres[(i % 1024) as usize];
            black_box(camera.box_error_px(0.01, &DAabb::from_points([s.center]).inflated(s.radius)));
        }),
    );
}

fn distances() {
    let ball = bumpy_ball(90);
    let surface = Surface::new(&ball);
    let p = points(4096);
    print(
        &format!("nearest point, {} triangles, 1 % off the surface", ball.triangles().len()),
        best_ns(4096, |i| {
            let on = ball.positions()[(i * 7 % ball.positions().len() as u32) as usize].as_dvec3();
            black_box(surface.nearest(on * 1.01));
        }),
    );
    print(
        "nearest point, anywhere around",
        best_ns(1024, |i| {
            black_box(surface.nearest(p[i as usize] * 3.0));
        }),
    );
    let moved: Vec<_> = ball.positions().iter().map(|&v| v * 1.01).collect();
    let moved = TriangleMesh::new(moved, ball.triangles().to_vec()).expect("valid");
    let options = HausdorffOptions::new(1e-4);
    let start = Instant::now();
    let d = hausdorff(&ball, &moved, &options);
    let rate = 2.0 * ball.triangles().len() as f64 / start.elapsed().as_secs_f64();
    println!(
        "two-sided Hausdorff to 1e-4 of the radius: {:.0} triangles/s, [{:.6}, {:.6}]",
        rate, d.lower, d.upper
    );
}
