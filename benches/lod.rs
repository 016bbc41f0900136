//! The vertex hierarchy: what building and following it costs, each figure beside the one that was asked for.
//!
//! ```text
//! cargo bench --bench lod                                    a generated ball of 99,372 triangles
//! FARSIGHT_DATA=folder cargo bench --bench lod               nefertiti.obj from there as well
//! ```
//!
//! The eye orbits at four radii by half a degree a frame, as in 120 frames of 1920 x 1080 pixels with 60° from top to bottom. Times are thread
//! CPU time.

use farsight_geometry::glam::DVec3;
use farsight_geometry::{Camera, TriangleMesh, hard_cases, io};
use farsight_lod::{Cut, Observer, Tolerance, VertexHierarchy};
use farsight_raster::thread_cpu_time;
use std::time::Duration;

const FRAMES: u32 = 120;

fn main() {
    report("ball", &hard_cases::bumpy_ball(91));
    let file = std::env::var_os("FARSIGHT_DATA").map(|d| std::path::Path::new(&d).join("nefertiti.obj"));
    if let Some(path) = file.filter(|p| p.exists()) {
        let scene = io::load(&path).expect("the file loads").into_scene().expect("the file holds triangles");
        let whole = scene.flattened().expect("the scene fits one mesh");
        report("nefertiti", &whole.welded().mesh);
    }
}

fn timed<T>(work: impl FnOnce() -> T) -> (T, Duration) {
    let start = thread_cpu_time();
    let answer = work();
    (answer, thread_cpu_time() - start)
}

fn ms(d: Duration) -> f64 {
    d.as_secs_f64() * 1e3
}

fn median(mut times: Vec<Duration>) -> Duration {
    times.sort_unstable();
    times[times.len() / 2]
}

fn report(name: &str, mesh: &TriangleMesh) {
    let triangles = mesh.triangles().len();
    let build = |_| timed(|| VertexHierarchy::build(mesh).expect("the mesh has triangles"));
    let (hierarchy, time) = (0..5).map(build).min_by_key(|b| b.1).expect("five runs");
    println!("{name}: {triangles} triangles, {} nodes", hierarchy.node_count());
    println!(
        "  build {:.1} ms, {:.2} M triangles/s (asked 3)",
        ms(time),
        triangles as f64 / time.as_secs_f64() * 1e-6
    );
    println!(
        "  {:>4} {:>9} {:>22} {:>9} {:>9} {:>17} {:>9} {:>8} {:>9}",
        "px",
        "triangles",
        "kinetic ms (asked)",
        "full ms",
        "fresh ms",
        "tests",
        "times fewer",
        "cheaper",
        "B/tri"
    );
    for (px, asked) in [(16.0, 0.05), (8.0, 0.12), (4.0, 0.20), (2.0, 0.26)] {
        orbit(mesh, &hierarchy, px, asked);
    }
}

fn orbit(mesh: &TriangleMesh, hierarchy: &VertexHierarchy, px: f64, asked: f64) {
    let center = mesh.bounds().center().as_dvec3();
    let radius = hierarchy.radius();
    let (mut kinetic, mut full) = (Cut::new(hierarchy), Cut::new(hierarchy));
    let (mut times, mut full_times, mut fresh_times) = (Vec::new(), Vec::new(), Vec::new());
    let (mut few, mut many, mut turned, mut written) = (0, 0, 0, 0);
    for i in 0..FRAMES {
        let (sin, cos) = (f64::from(i) * 0.5f64.to_radians()).sin_cos();
        let eye = center + DVec3::new(cos, 0.1, sin) * (4.0 * radius);
        let camera = Camera::look_at(eye, center, DVec3::Y).and_then(|c| c.with_image(1920, 1080));
        let tolerance = Tolerance::pixels(px, &camera.expect("the camera is valid")).expect("some pixels");
        let observer = Observer::in_object(eye);
        let (k, time) = timed(|| kinetic.update_kinetic(hierarchy, &observer, &tolerance).expect("valid"));
        let (f, full_time) = timed(|| full.update(hierarchy, &observer, &tolerance).expect("valid"));
        let ((), fresh_time) = timed(|| {
            let mut fresh = Cut::new(hierarchy);
            fresh.update(hierarchy, &observer, &tolerance).expect("valid");
        });
        assert_eq!(kinetic.triangles().len(), full.triangles().len(), "identical cuts");
        if i > 0 {
            (few, many) = (few + k.tested, many + f.tested);
            (turned, written) = (turned + k.unfolded + k.folded, written + k.written);
            times.push(time);
            full_times.push(full_time);
            fresh_times.push(fresh_time);
        }
    }
    let frames = f64::from(FRAMES - 1);
    let (time, fresh) = (median(times), median(fresh_times));
    println!(
        "  {px:>4} {:>9} {:>13.3} ({asked:.2}) {:>12.3} {:>9.3} {:>7.0} -> {:>5.0} {:>11.1} {:>8.1} {:>9.1} {:>6.1} {:>8.0}",
        kinetic.triangles().len(),
        ms(time),
        ms(median(full_times)),
        ms(fresh),
        many as f64 / frames,
        few as f64 / frames,
        many as f64 / few as f64,
        fresh.as_secs_f64() / time.as_secs_f64(),
        (hierarchy.bytes() + kinetic.bytes()) as f64 / hierarchy.triangle_count() as f64,
        turned as f64 / frames,
        written as f64 / frames,
    );
}
