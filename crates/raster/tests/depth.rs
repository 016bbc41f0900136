//! Depth, ids and interpolation against ray casting and closed forms.

use farsight_geometry::{Camera, ClipConvention, Projection, Ray, Scene, TriangleMesh};
use farsight_raster::scenes::Cubes;
use farsight_raster::{
    DepthTest, Draw, Fragment, Outputs, Rasteriser, RenderOptions, SceneIds, State, Target, native_from,
    relative_from_mesh, render_scene,
};
use glam::{DAffine3, DMat4, DVec2, DVec3, Mat4, Vec3, Vec4};
use std::cell::RefCell;

/// The closest triangle by the textbook: plane, then three side tests, all in f64.
fn brute_force(scene: &Scene, ray: &Ray) -> Option<(f64, u32, f64)> {
    let mut best: Option<(f64, u32, f64)> = None;
    let mut id = 0;
    for instance in scene.instances() {
        let mesh = scene.mesh_of(instance);
        let placed = relative_from_mesh(instance, mesh, ray.origin());
        for corners in mesh.corner_iter() {
            id += 1;
            let [a, b, c] = corners.map(|p| placed.transform_point3(p.as_dvec3()));
            let normal = (b - a).cross(c - a);
            let t = a.dot(normal) / ray.direction().dot(normal);
            if t.is_nan() || t <= 0.0 || best.is_some_and(|(s, ..)| t >= s) {
                continue;
            }
            let p = ray.direction() * t;
            let sides = [(a, b), (b, c), (c, a)].map(|(u, v)| (v - u).cross(p - u).dot(normal));
            if sides.iter().all(|&s| s >= 0.0) {
                let slack = sides.iter().fold(f64::INFINITY, |m, &s| m.min(s)) / normal.length_squared();
                best = Some((t, id, slack));
            }
        }
    }
    best
}

fn pixel_centre(x: u32, y: u32) -> DVec2 {
    DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)
}

/// Compares depth and id of every pixel with a ray; returns pixels hit and pixels whose id differs.
fn compare(scene: &Scene, camera: &Camera) -> (u32, u32) {
    let mut options = RenderOptions::default();
    options.outputs = Outputs::DEPTH_ID;
    options.ids = SceneIds::Triangles;
    let (target, _) = render_scene(&mut Rasteriser::new(), scene, camera, &options).unwrap();
    let (mut hits, mut differ) = (0, 0);
    for y in 0..camera.height() {
        for x in 0..camera.width() {
            let ray = camera.ray(pixel_centre(x, y));
            let truth = brute_force(scene, &ray);
            let id = target.id(x, y);
            hits += u32::from(truth.is_some());
            if truth.map_or(0, |t| t.1) != id {
                differ += 1;
                continue;
            }
            let Some((t, ..)) = truth else { continue };
            let ahead = t * ray.direction().dot(camera.forward());
            let expected = match camera.projection() {
                Projection::Perspective { .. } => camera.near() / ahead,
                Projection::Orthographic { .. } => {
                    (camera.far() - camera.near() - ahead) / (camera.far() - camera.near())
                }
            };
            let depth = f64::from(target.depth(x, y));
            assert!((depth - expected).abs() <= 3e-7 * expected.max(1e-3), "({x}, {y}): {depth} {expected}");
        }
    }
    (hits, differ)
}

fn cubes(count: u32) -> Scene {
    let mut cubes = Cubes::default();
    cubes.count = count;
    cubes.build().unwrap()
}

#[test]
fn every_pixel_agrees_with_a_ray() {
    let scene = cubes(60);
    let camera = Camera::look_at(DVec3::new(110.0, 120.0, 70.0), DVec3::splat(50.0), DVec3::Z).unwrap();
    for camera in [
        camera.with_image(97, 71).unwrap(),
        // In the middle of it, the eye among and inside cubes.
        Camera::look_at(DVec3::splat(50.0), DVec3::new(50.0, 90.0, 55.0), DVec3::Z)
            .unwrap()
            .with_range(0.01, f64::INFINITY)
            .unwrap()
            .with_image(97, 71)
            .unwrap(),
        camera
            .with_projection(Projection::Orthographic { height: 150.0 })
            .unwrap()
            .with_range(0.0, 400.0)
            .unwrap()
            .with_image(97, 71)
            .unwrap(),
    ] {
        let (hits, differ) = compare(&scene, &camera);
        assert!(hits > 200, "{hits}");
        // Snapping to 1/256 px moves an edge across a pixel's centre in about one of a hundred border pixels.
        assert!(f64::from(differ) <= 0.005 * f64::from(hits), "{differ} of {hits}");
    }
}

#[test]
fn an_offset_of_a_million_metres_changes_next_to_nothing() {
    let near = cubes(40);
    let offset = DVec3::new(1e6, -2e6, 3e5);
    let mut far = Scene::new();
    for instance in near.instances() {
        let mesh = near.mesh_of(instance).clone();
        let origin = mesh.origin() + offset;
        let mesh = far.add_mesh(mesh.with_origin(origin).unwrap());
        let world_from_mesh = DAffine3::from_translation(offset)
            * instance.world_from_mesh
            * DAffine3::from_translation(-offset);
        let instance =
            farsight_geometry::scene::Instance { mesh, world_from_mesh, material: None, ..instance.clone() };
        far.add_instance(instance).unwrap();
    }
    let at = |offset: DVec3| {
        Camera::look_at(DVec3::splat(50.0) + offset, DVec3::new(50.0, 90.0, 55.0) + offset, DVec3::Z)
            .unwrap()
            .with_image(97, 71)
            .unwrap()
    };
    let (hits, differ) = compare(&far, &at(offset));
    assert!(hits > 200 && f64::from(differ) <= 0.005 * f64::from(hits), "{differ} of {hits}");
}

fn ground() -> TriangleMesh {
    let p = [(-1e3, -1e3), (1e3, -1e3), (1e3, 1e3), (-1e3, 1e3)].map(|(x, y)| Vec3::new(x, y, 0.0));
    TriangleMesh::from_slices(&p, &[0, 1, 2, 0, 2, 3]).unwrap()
}

#[test]
fn a_plane_under_the_eye_has_its_closed_form_depth_and_attributes() {
    let mesh = ground();
    for range in [(0.1, f64::INFINITY), (0.5, 800.0)] {
        let camera = Camera::look_at(DVec3::new(3.0, -2.0, 1.5), DVec3::new(20.0, 9.0, 0.0), DVec3::Z)
            .unwrap()
            .with_image(120, 80)
            .unwrap()
            .with_range(range.0, range.1)
            .unwrap();
        let mut target = Target::new(120, 80, Outputs::ALL).unwrap();
        let clip_from_local = camera.clip_from_relative_f64(ClipConvention::REVERSED, DVec3::ZERO);
        let draw = Draw {
            positions: mesh.positions(),
            triangles: mesh.triangles(),
            clip_from_local,
            state: State::default(),
        };
        let seen = RefCell::new(Vec::new());
        let shader = |f: &Fragment| {
            let w = f.weights();
            let corners = mesh.corners(f.triangle as usize);
            let at = |w: Vec3| corners[0] * w.x + corners[1] * w.y + corners[2] * w.z;
            let [dx, dy] = f.weight_gradients();
            seen.borrow_mut().push((f.x, f.y, at(w), at(dx), at(dy)));
            Some(Vec4::ONE)
        };
        let mut rasteriser = Rasteriser::new();
        rasteriser.draw_shaded(&mut target, &draw, &shader);
        assert!(rasteriser.counters.clipped > 0);
        let on_ground = |px: DVec2| {
            let ray = camera.ray(px);
            ray.at(-1.5 / ray.direction().z)
        };
        let (near, far) = range;
        for &(x, y, at, dx, dy) in seen.borrow().iter() {
            let truth = on_ground(pixel_centre(x, y));
            let distance = truth.distance(camera.eye());
            assert!(at.as_dvec3().distance(truth) < 1e-6 * (1000.0 + distance), "{at} {truth}");
            let d = (truth - camera.eye()).dot(camera.forward());
            let expected = if far.is_finite() { near * (far / d - 1.0) / (far - near) } else { near / d };
            assert!((f64::from(target.depth(x, y)) - expected).abs() < 3e-7 * expected.max(1e-3));
            let h = 1e-3;
            for (gradient, step) in [(dx, DVec2::new(h, 0.0)), (dy, DVec2::new(0.0, h))] {
                let p = pixel_centre(x, y);
                let slope = (on_ground(p + step) - on_ground(p - step)) / (2.0 * h);
                assert!(
                    gradient.as_dvec3().distance(slope) < 1e-3 * slope.length() + 1e-4,
                    "{gradient} {slope}"
                );
            }
        }
        assert!(seen.borrow().len() > 3000);
    }
}

#[test]
fn all_clip_conventions_give_the_same_image() {
    let scene = cubes(30);
    let camera = Camera::look_at(DVec3::splat(120.0), DVec3::splat(50.0), DVec3::Z)
        .unwrap()
        .with_image(64, 48)
        .unwrap()
        .with_range(1.0, 500.0)
        .unwrap();
    let draw_all = |matrix: DMat4| {
        let mut target = Target::new(64, 48, Outputs::DEPTH_ID).unwrap();
        let mut rasteriser = Rasteriser::new();
        for instance in scene.instances() {
            let mesh = scene.mesh_of(instance);
            let relative = relative_from_mesh(instance, mesh, camera.eye());
            let clip_from_local = matrix * DMat4::from(relative);
            let mut state = State::default();
            state.cull = farsight_raster::Cull::Back;
            let draw =
                Draw { positions: mesh.positions(), triangles: mesh.triangles(), clip_from_local, state };
            rasteriser.draw(&mut target, &draw);
        }
        target
    };
    let expected = draw_all(camera.clip_from_relative_f64(ClipConvention::REVERSED, camera.eye()));
    assert!(expected.ids().any(|id| id != 0));
    for convention in ClipConvention::all() {
        let matrix = native_from(convention) * camera.clip_from_relative_f64(convention, camera.eye());
        let target = draw_all(matrix);
        let differ = target.ids().zip(expected.ids()).filter(|(a, b)| a != b).count();
        assert_eq!(differ, 0, "{convention:?}");
        for (a, b) in target.depth_rows().flatten().zip(expected.depth_rows().flatten()) {
            assert!((a - b).abs() < 1e-6, "{convention:?}");
        }
    }
}

#[test]
fn a_second_pass_with_equal_depth_finds_the_same_pixels() {
    let scene = cubes(30);
    let mesh = scene.mesh_of(&scene.instances()[0]);
    let camera = Camera::look_at(DVec3::new(1.1, 1.3, 0.9), DVec3::ZERO, DVec3::Z).unwrap();
    let single: Mat4 = camera.clip_from_relative(ClipConvention::REVERSED, DVec3::ZERO);
    let mut draw = Draw {
        positions: mesh.positions(),
        triangles: mesh.triangles(),
        clip_from_local: single.as_dmat4(),
        state: State::default(),
    };
    let mut target = Target::new(200, 150, Outputs::ALL).unwrap();
    let mut rasteriser = Rasteriser::new();
    rasteriser.draw(&mut target, &draw);
    let visible = target.ids().filter(|&id| id != 0).count() as u64;
    assert!(visible > 1000);
    draw.state.depth_test = DepthTest::Equal;
    let before = rasteriser.counters.pixels_written;
    rasteriser.draw_shaded(&mut target, &draw, &|_: &Fragment| Some(Vec4::ONE));
    // Pixels on an edge shared by two faces of equal depth may be written twice, never less than once.
    assert!(rasteriser.counters.pixels_written - before >= visible);
    assert!(target.colour_rows().flatten().filter(|c| c[3] == 1.0).count() as u64 == visible);
}
