//! Impostors: pixels of parallax allowed, against how long a picture serves and what a frame then costs.

use super::super::row::Row;
use engine::{Object, Renderer};
use farsight_geometry::accuracy::{Counters, ErrorBound, Unit};
use farsight_geometry::bvh::Bvh;
use farsight_geometry::glam::{DAffine3, DVec2, DVec3};
use farsight_geometry::{Camera, TriangleMesh, hard_cases};
use farsight_lod::{ImpostorOptions, ImpostorRenderer, ImpostorView, Placement};
use farsight_raster::{Outputs, QuadImage, Target, thread_cpu_time};
use std::rc::Rc;
use std::time::Duration;

#[path = "../../../examples/lod/engine.rs"]
#[allow(dead_code)]
mod engine;

const PX: [f64; 5] = [4.0, 2.0, 1.0, 0.5, 0.25];
/// Size of the ball on the image, in pixels.
const SIZE_PX: f64 = 64.0;
/// Metres a frame: a brisk walk at 60 frames a second.
const STEP: f64 = 1.5 / 60.0;

/// A ball of radius 1 m is passed sideways, and approached.
pub fn rows(quick: bool, size: [u32; 2]) -> Vec<Row> {
    let mesh = hard_cases::bumpy_ball(if quick { 16 } else { 40 });
    let frames = if quick { 120 } else { 600 };
    let away = |c: &Camera| 2.0 * c.pixels_per_unit() / SIZE_PX;
    let start = Camera::look_at(DVec3::X, DVec3::ZERO, DVec3::Z).and_then(|c| c.with_image(size[0], size[1]));
    let distance = away(&start.expect("the camera is valid"));
    [("64 px, passed", DVec3::Y), ("64 px, approached", -DVec3::X * 0.5)]
        .iter()
        .flat_map(|&(name, direction)| {
            let eye =
                |i: u32| DVec3::X * distance + direction * STEP * (f64::from(i) - 0.5 * f64::from(frames));
            let cameras: Vec<Camera> = (0..frames).map(|i| camera(eye(i), size)).collect();
            PX.map(|px| row(name, &mesh, &cameras, px))
        })
        .collect()
}

fn camera(eye: DVec3, [width, height]: [u32; 2]) -> Camera {
    let camera = Camera::look_at(eye, DVec3::ZERO, DVec3::Z);
    camera.and_then(|c| c.with_image(width, height)).expect("the camera is valid")
}

fn row(scene: &str, mesh: &TriangleMesh, cameras: &[Camera], px: f64) -> Row {
    let meshes = std::slice::from_ref(mesh);
    let placement = Placement::new(&DAffine3::IDENTITY, mesh.origin()).expect("no placement");
    let bounds = placement.bounds(&mesh.bounds());
    let objects = [Object { model: 0, placement, bounds: mesh.world_bounds() }];
    let bvh = Bvh::build(&[mesh.world_bounds()]).expect("a box");
    let mut renderer = Renderer::new(meshes, &objects, &bvh, DVec3::new(0.5, 0.6, -0.6).normalize());
    let points: Vec<DVec3> = mesh.corner_iter().flatten().map(|p| p.as_dvec3()).collect();
    let [width, height] = [cameras[0].width(), cameras[0].height()];
    let mut target = Target::new(width, height, Outputs { id: false, ..Outputs::ALL }).expect("a usual size");
    let mut picture: Option<(ImpostorView, Rc<QuadImage>)> = None;
    let (mut pictures, mut bytes, mut most) = (0u64, 0, 0.0f64);
    let mut times = Vec::new();
    for camera in cameras {
        let start = thread_cpu_time();
        let fits = |(view, _): &(ImpostorView, _)| view.parallax(&placement, camera).value <= px;
        if !picture.as_ref().is_some_and(fits) {
            let options = ImpostorOptions::default();
            let view = ImpostorView::new(&placement, &bounds, &points, camera, &options).expect("far enough");
            let image = renderer.render(0, &view, &placement, mesh.triangles()).expect("a small picture");
            (pictures, bytes) = (pictures + 1, view.bytes());
            picture = Some((view, image));
        }
        let (view, image) = picture.as_ref().expect("just made");
        renderer.draw_picture(&mut target, camera, 0, view, image);
        times.push(thread_cpu_time() - start);
        most = most.max(measured(mesh, view, camera));
    }
    let total: Duration = times.iter().sum();
    let mut counters = Counters::new();
    counters.add("pictures", pictures);
    counters.add("frames", cameras.len() as u64);
    Row {
        krate: "lod",
        scene: scene.into(),
        knob: "parallax px".into(),
        value: px,
        claimed: ErrorBound::proven(px, Unit::Pixels),
        measured: most,
        times: vec![total / cameras.len() as u32],
        bytes,
        counters,
    }
}

/// Largest distance on the image between vertices and where lines through them from the old eye meet the quad.
fn measured(mesh: &TriangleMesh, view: &ImpostorView, camera: &Camera) -> f64 {
    let quad = view.corners();
    let normal = (quad[1] - quad[0]).cross(quad[3] - quad[0]);
    let mut most = 0.0f64;
    for p in mesh.positions() {
        let p = p.as_dvec3();
        let ray = p - view.eye();
        let image = view.eye() + ray * (normal.dot(quad[0] - view.eye()) / normal.dot(ray));
        let px = |p: DVec3| camera.project(p).map_or(DVec2::ZERO, |c| c.0);
        most = most.max(px(p).distance(px(image)));
    }
    most
}
