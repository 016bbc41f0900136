//! The vertex hierarchy beside meshoptimizer, at equal numbers of triangles.
//!
//! An eye orbits a surface at four radii. For each tolerance the cut's triangles are counted in the last frame, and meshoptimizer simplifies the surface to as many. Deviations
//! from the surface, both ways, are given in pixels at the distance of the surface's middle; pictures are compared lit, with flat shading.

use crate::simplification::surfaces;
use farsight_geometry::distance::deviation;
use farsight_geometry::glam::{DMat4, DVec3, Vec4};
use farsight_geometry::{Camera, ClipConvention, TriangleMesh};
use farsight_lod::{Cut, Observer, Tolerance, VertexHierarchy};
use farsight_raster::{Draw, Fragment, Image, Outputs, Rasteriser, State, Target, thread_cpu_time};
use meshopt::{SimplifyOptions, VertexDataAdapter};
use std::time::Duration;

const FRAMES: u32 = 60;
const PX: [f64; 4] = [32.0, 16.0, 8.0, 4.0];

/// Prints the comparison on generated surfaces, and on collected ones where `FARSIGHT_DATA` names their folder.
pub fn report(arguments: &[String]) {
    let quick = arguments.iter().any(|a| a == "--quick");
    let wanted: Vec<&String> = arguments.iter().filter(|a| !a.starts_with("--")).collect();
    let mut all = surfaces::generated(if quick { 24 } else { 72 });
    all.extend(surfaces::collected());
    all.retain(|(name, _)| wanted.is_empty() || wanted.contains(&name));
    println!(
        "{:<20} {:>4} {:>10} | {:>8} {:>8} {:>8} {:>9} | {:>8} {:>8} {:>8} {:>9}",
        "surface, whole",
        "px",
        "triangles",
        "mean px",
        "max px",
        "RMSE",
        "ms",
        "mean px",
        "max px",
        "RMSE",
        "ms"
    );
    println!(
        "{:<20} {:>4} {:>10} | {:^36} | {:^36}",
        "", "", "", "cut: ms a frame", "meshoptimizer: ms once"
    );
    let (mut better, mut closer, mut rows) = (0, 0, 0);
    for (name, mesh) in &all {
        let mesh = &mesh.welded().mesh;
        let Ok(hierarchy) = VertexHierarchy::build(mesh) else { continue };
        for px in PX {
            let (cut, camera, frame) = orbit(mesh, &hierarchy, px);
            let own = mesh_of(mesh, cut.indices());
            let (peer, once) = simplified(mesh, own.triangles().len());
            let [a, b] = [&own, &peer].map(|m| quality(mesh, m, &camera));
            println!(
                "{:<20} {px:>4} {:>10} | {:>8.3} {:>8.2} {:>8.2} {:>9.3} | {:>8.3} {:>8.2} {:>8.2} {:>9.2}",
                format!("{name}, {}", mesh.triangles().len()),
                own.triangles().len(),
                a.mean_px,
                a.max_px,
                a.rmse,
                frame.as_secs_f64() * 1e3,
                b.mean_px,
                b.max_px,
                b.rmse,
                once.as_secs_f64() * 1e3
            );
            if own.triangles().len() == mesh.triangles().len() {
                continue;
            }
            rows += 1;
            better += u32::from(a.rmse < b.rmse);
            closer += u32::from(a.mean_px < b.mean_px);
        }
    }
    println!(
        "of {rows} rows with fewer triangles the cut is closer on average in {closer}, and looks more like the surface in {better}"
    );
}

/// A cut that has followed the orbit, the last camera, and the median time of a frame.
fn orbit(mesh: &TriangleMesh, hierarchy: &VertexHierarchy, px: f64) -> (Cut, Camera, Duration) {
    let center = mesh.world_bounds().center();
    let mut cut = Cut::new(hierarchy);
    let mut times = Vec::new();
    let mut last = None;
    for i in 0..FRAMES {
        let (sin, cos) = (f64::from(i) * 0.5f64.to_radians()).sin_cos();
        let eye = center + DVec3::new(cos, 0.1, sin) * (4.0 * hierarchy.radius());
        let camera = Camera::look_at(eye, center, DVec3::Y).and_then(|c| c.with_image(1920, 1080));
        let camera = camera.expect("the camera is valid");
        let tolerance = Tolerance::pixels(px, &camera).expect("some pixels");
        let observer = Observer::in_object(eye - mesh.origin());
        let start = thread_cpu_time();
        cut.update_kinetic(hierarchy, &observer, &tolerance).expect("valid");
        times.push(thread_cpu_time() - start);
        last = Some(camera);
    }
    times.sort_unstable();
    (cut, last.expect("some frames"), times[times.len() / 2])
}

fn mesh_of(mesh: &TriangleMesh, indices: &[u32]) -> TriangleMesh {
    let simple = TriangleMesh::from_slices(mesh.positions(), indices).expect("indices of the input");
    simple.with_origin(mesh.origin()).expect("the input's origin")
}

/// meshoptimizer's simplification to a number of triangles, whatever the error.
fn simplified(mesh: &TriangleMesh, triangles: usize) -> (TriangleMesh, Duration) {
    let indices = mesh.triangles().as_flattened();
    let vertices = VertexDataAdapter::new(meshopt::typed_to_bytes(mesh.positions()), 12, 0)
        .expect("a list of positions");
    let start = thread_cpu_time();
    let kept = meshopt::simplify(indices, &vertices, 3 * triangles, f32::MAX, SimplifyOptions::None, None);
    (mesh_of(mesh, &kept), thread_cpu_time() - start)
}

struct Quality {
    mean_px: f64,
    max_px: f64,
    rmse: f64,
}

fn quality(mesh: &TriangleMesh, simple: &TriangleMesh, camera: &Camera) -> Quality {
    let to_px = camera.pixels_per_unit() / camera.eye().distance(mesh.world_bounds().center());
    let both = [(mesh, simple), (simple, mesh)].map(|(a, b)| deviation(a, b, 20_000, 0.0));
    let worst = |of: fn(&farsight_geometry::distance::Deviation) -> f64| {
        both.iter().map(|d| d.as_ref().map_or(f64::INFINITY, of)).fold(0.0, f64::max) * to_px
    };
    let difference = picture(mesh, camera).compare(&picture(simple, camera)).expect("of one size");
    Quality { mean_px: worst(|d| d.mean.value), max_px: worst(|d| d.max.value), rmse: difference.rmse }
}

/// Flat shading under a light from above the eye's right.
fn picture(mesh: &TriangleMesh, camera: &Camera) -> Image {
    let outputs = Outputs { colour: true, depth: true, id: false };
    let mut target = Target::new(camera.width(), camera.height(), outputs).expect("a usual size");
    let relative = DMat4::from_translation(mesh.origin() - camera.eye());
    let clip = camera.clip_from_relative_f64(ClipConvention::REVERSED, camera.eye()) * relative;
    let towards = (camera.up() + camera.right() - camera.forward()).normalize();
    let draw = Draw {
        positions: mesh.positions(),
        triangles: mesh.triangles(),
        clip_from_local: clip,
        state: State::default(),
    };
    Rasteriser::new().draw_shaded(&mut target, &draw, &|f: &Fragment| {
        let [a, b, c] = mesh.corners(f.triangle as usize).map(|p| p.as_dvec3());
        let light = 0.2 + 0.8 * (b - a).cross(c - a).normalize_or_zero().dot(towards).abs() as f32;
        Some(Vec4::new(light, light, light, 1.0))
    });
    Image::from_colour(&target)
}
