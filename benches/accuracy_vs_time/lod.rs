//! The vertex hierarchy: tolerance in pixels against what points really move on the image, and what vanishes from it. Impostors: parallax against how long they serve.

mod impostor;

use super::row::{Row, timed};
use farsight_geometry::accuracy::{Counters, ErrorBound, Norm, Unit};
use farsight_geometry::glam::{DMat4, DVec3};
use farsight_geometry::{Camera, ClipConvention, TriangleMesh, hard_cases};
use farsight_lod::{Cut, Observer, Tolerance, VertexHierarchy};
use farsight_raster::scenes::Terrain;
use farsight_raster::{Draw, Outputs, Rasteriser, State, Target};

const PX: [f64; 5] = [16.0, 8.0, 4.0, 2.0, 1.0];

pub fn rows(quick: bool) -> Vec<Row> {
    let size = if quick { [480, 270] } else { [1920, 1080] };
    let ball = hard_cases::bumpy_ball(if quick { 24 } else { 91 });
    let terrain = terrain(quick);
    let meshes = [("ball", ball), ("terrain", terrain)];
    let cuts = meshes.iter().flat_map(|(name, mesh)| of_mesh(name, mesh, size));
    cuts.chain(impostor::rows(quick, size)).collect()
}

fn terrain(quick: bool) -> TriangleMesh {
    let mut scene = Terrain::default();
    scene.points = if quick { 4_000 } else { 60_000 };
    let built = scene.build().expect("the scene is valid");
    built.flattened().expect("a small scene fits one mesh")
}

/// Eyes near and far, some of them close to the surface.
fn cameras(mesh: &TriangleMesh, [width, height]: [u32; 2]) -> Vec<Camera> {
    let b = mesh.world_bounds();
    let at = |i: u32| {
        let (sin, cos) = (1.1 * f64::from(i)).sin_cos();
        let distance = 0.45 + 0.35 * f64::from(i % 4);
        let eye = b.center() + DVec3::new(cos, sin, 0.5) * (b.diagonal() * distance);
        let camera = Camera::look_at(eye, b.center() + b.extent() * 0.1, DVec3::Z);
        camera.and_then(|c| c.with_image(width, height)).expect("the camera is valid")
    };
    (0..6).map(at).collect()
}

fn of_mesh(name: &str, mesh: &TriangleMesh, size: [u32; 2]) -> Vec<Row> {
    let hierarchy = VertexHierarchy::build(mesh).expect("the mesh has triangles");
    let cameras = cameras(mesh, size);
    let whole: Vec<Target> = cameras.iter().map(|c| picture(mesh, mesh.triangles(), c)).collect();
    let (mut moved, mut vanished) = (Vec::new(), Vec::new());
    for px in PX {
        let mut cut = Cut::new(&hierarchy);
        let update = |cut: &mut Cut, camera: &Camera| {
            let tolerance = Tolerance::pixels(px, camera).expect("some pixels of a perspective camera");
            cut.update(&hierarchy, &Observer::in_object(camera.eye() - mesh.origin()), &tolerance)
                .expect("valid")
        };
        let ((), times) = timed(3, || cameras.iter().for_each(|c| _ = update(&mut cut, c)));
        let mut counters = Counters::new();
        let (mut most, mut gone) = (0.0f64, 0.0);
        for (camera, whole) in cameras.iter().zip(&whole) {
            let stats = update(&mut cut, camera);
            counters.add("triangles", cut.triangles().len() as u64);
            counters.add("tested", stats.tested);
            most = most.max(displacement(mesh, &hierarchy, &cut, camera));
            gone += lost(whole, &picture(mesh, cut.triangles(), camera), px) / cameras.len() as f64;
        }
        let row = |knob: &str, claimed, measured| Row {
            krate: "lod",
            scene: name.into(),
            knob: knob.into(),
            value: px,
            claimed,
            measured,
            times: times.clone(),
            bytes: (hierarchy.bytes() + cut.bytes()) as u64,
            counters,
        };
        moved.push(row("tolerance px", ErrorBound::proven(px, Unit::Pixels), most));
        let claimed = ErrorBound::estimated(2e-4, Unit::Fraction).with_norm(Norm::Mean);
        vanished.push(row("vanished; tolerance px", claimed, gone));
    }
    moved.into_iter().chain(vanished).collect()
}

/// Largest distance in the image between points of the mesh that are in it and where drawn triangles put them.
fn displacement(mesh: &TriangleMesh, hierarchy: &VertexHierarchy, cut: &Cut, camera: &Camera) -> f64 {
    let world = |v: u32| mesh.origin() + mesh.positions()[v as usize].as_dvec3();
    let mut most = 0.0f64;
    for (original, drawn) in cut.originals(hierarchy).zip(cut.triangles()) {
        let own = mesh.triangles()[original as usize].map(world);
        let now = drawn.map(world);
        for [a, b, c] in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.34, 0.33, 0.33]] {
            let mix = |p: [DVec3; 3]| camera.project(p[0] * a + p[1] * b + p[2] * c);
            let (Some((p, _)), Some((q, _))) = (mix(own), mix(now)) else { continue };
            let inside = p.cmpge(farsight_geometry::glam::DVec2::ZERO).all()
                && p.x <= f64::from(camera.width())
                && p.y <= f64::from(camera.height());
            if inside {
                most = most.max(p.distance(q));
            }
        }
    }
    most
}

fn picture(mesh: &TriangleMesh, triangles: &[[u32; 3]], camera: &Camera) -> Target {
    let outputs = Outputs { colour: false, depth: true, id: false };
    let mut target = Target::new(camera.width(), camera.height(), outputs).expect("a usual size");
    let relative = DMat4::from_translation(mesh.origin() - camera.eye());
    let clip = camera.clip_from_relative_f64(ClipConvention::REVERSED, camera.eye()) * relative;
    let draw =
        Draw { positions: mesh.positions(), triangles, clip_from_local: clip, state: State::default() };
    Rasteriser::new().draw(&mut target, &draw);
    target
}

/// Share of the image's pixels that the whole mesh covers and nothing drawn comes within the tolerance of.
fn lost(whole: &Target, drawn: &Target, px: f64) -> f64 {
    let (width, height) = (whole.width() as i64, whole.height() as i64);
    let reach = px.ceil() as i64 + 1;
    let covered = |t: &Target, x: i64, y: i64| {
        x >= 0 && y >= 0 && x < width && y < height && t.depth(x as u32, y as u32) > 0.0
    };
    let near =
        |x: i64, y: i64| (-reach..=reach).any(|dy| (-reach..=reach).any(|dx| covered(drawn, x + dx, y + dy)));
    let count = (0..height)
        .flat_map(|y| (0..width).map(move |x| (x, y)))
        .filter(|&(x, y)| covered(whole, x, y) && !covered(drawn, x, y) && !near(x, y))
        .count();
    count as f64 / (width * height) as f64
}
