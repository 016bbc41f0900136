//! The vertex hierarchy: what building and following it costs, each figure beside the one that was asked for. Impostors: what asking them costs.
//!
//! ```text
//! cargo bench --bench lod                                    a generated ball of 99,372 triangles
//! FARSIGHT_DATA=folder cargo bench --bench lod               nefertiti.obj from there as well
//! ```
//!
//! The eye orbits at four radii by half a degree a frame, as in 120 frames of 1920 x 1080 pixels with 60° from top to bottom. Times are thread
//! CPU time.

use farsight_geometry::bvh::Bvh;
use farsight_geometry::glam::{DAffine3, DVec3};
use farsight_geometry::{Camera, DAabb, Frustum, TriangleMesh, hard_cases, io};
use farsight_lod::{
    ApproximationOptions, Approximations, Costs, Cut, Engine, ImpostorOptions, ImpostorRenderer,
    ImpostorView, LightKey, Observer, Placement, Subject, Tolerance, VertexHierarchy, Work, is_separable,
    view_angle,
};
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
    impostors(&hard_cases::bumpy_ball(40));
}

/// An engine that draws nothing.
struct Nothing;

impl ImpostorRenderer for Nothing {
    type Image = ();
    type Error = std::convert::Infallible;
    fn render(&mut self, _: u32, _: &ImpostorView, _: &Placement, _: &[[u32; 3]]) -> Result<(), Self::Error> {
        Ok(())
    }
}

impl Engine for Nothing {
    fn costs(&mut self, _: u32, work: &Work) -> Costs {
        let draw_geometry = Duration::from_nanos(20) * work.triangles as u32;
        Costs { draw_geometry, ..Costs::default() }
    }
    fn is_separable(&mut self, _: u32, _: &Frustum) -> bool {
        true
    }
}

/// Nanoseconds of one of many runs.
fn each(count: u32, mut work: impl FnMut(u32)) -> f64 {
    let ((), time) = timed(|| (0..count).for_each(&mut work));
    time.as_secs_f64() * 1e9 / f64::from(count)
}

fn impostors(mesh: &TriangleMesh) {
    let hierarchy = VertexHierarchy::build(mesh).expect("the mesh has triangles");
    let placement = Placement::new(&DAffine3::IDENTITY, mesh.origin()).expect("no placement");
    let bounds = placement.bounds(&mesh.bounds());
    let camera = |i: u32| {
        let eye = DVec3::new(30.0, 1e-4 * f64::from(i), 2.0);
        Camera::look_at(eye, DVec3::ZERO, DVec3::Z).and_then(|c| c.with_image(1920, 1080)).expect("valid")
    };
    let points: Vec<DVec3> = mesh.corner_iter().flatten().map(|p| p.as_dvec3()).collect();
    let options = ImpostorOptions::default();
    let (now, then) = (camera(0), camera(1000));
    let view = ImpostorView::new(&placement, &bounds, &points, &now, &options).expect("far enough");
    let mut sum = 0.0;
    println!("impostors of a ball of {} triangles, nanoseconds:", mesh.triangles().len());
    println!(
        "  angle of a box             {:8.0}",
        each(100_000, |i| {
            sum += view_angle(&bounds, now.eye(), then.eye() + DVec3::X * f64::from(i) * 1e-6);
        })
    );
    println!(
        "  parallax                   {:8.0}",
        each(100_000, |_| sum += view.parallax(&placement, &then).value)
    );
    println!(
        "  view, a drawn corner       {:8.1}",
        each(50, |_| {
            let view = ImpostorView::new(&placement, &bounds, &points, &now, &options);
            sum += view.map_or(0.0, |v| v.eye().x);
        }) / points.len() as f64
    );
    let boxes: Vec<DAabb> = (0..10_000)
        .map(|i| {
            let at = DVec3::new(f64::from(i % 100), f64::from(i / 100), 0.0) * 4.0;
            DAabb::new(at - 1.0, at + 1.0)
        })
        .collect();
    let bvh = Bvh::build(&boxes).expect("boxes");
    let slab = view.slab(&placement);
    println!(
        "  separable in 10,000 boxes  {:8.0}",
        each(10_000, |_| {
            sum += f64::from(u8::from(is_separable(&bvh, &slab, 0, |_| false)));
        })
    );
    let mut approximations = Approximations::new(1 << 24, ApproximationOptions::default()).expect("options");
    let mut cut = Cut::new(&hierarchy);
    let mut fresh = 0;
    let time = each(20_000, |i| {
        approximations.next_frame();
        let mut subject = Subject {
            object: 0,
            version: 0,
            view: 0,
            light: LightKey::custom(0),
            mesh,
            hierarchy: &hierarchy,
            cut: &mut cut,
            placement: &placement,
        };
        let camera = camera(i / 4);
        let shown = approximations.approximate(&mut subject, &camera, &mut Nothing).expect("valid");
        fresh += u32::from(shown.fresh);
    });
    println!("  what serves an object      {time:8.0} a frame, {fresh} of 20,000 made anew ({sum:.0})");
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
