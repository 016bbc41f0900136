//! What only shows when crates meet: every hard mesh under every hard view and light, through rendering, ray casting and
//! shadow fitting. Nothing may panic, and the crates must agree about what is there.

use farsight_geometry::glam::{DVec2, Vec3};
use farsight_geometry::hard_cases::{light_directions, meshes, views};
use farsight_geometry::ray::SceneCaster;
use farsight_geometry::{DAabb, RayCaster, Scene};
use farsight_raster::{Outputs, Rasteriser, RenderOptions, render_scene};
use farsight_shadow::{Focus, MapOptions, Scope, ShadowLight};

#[test]
fn every_hard_mesh_renders_under_every_hard_view() {
    for hard in meshes() {
        let scene = Scene::of_mesh(hard.mesh.clone());
        let bounds = hard.mesh.world_bounds();
        for view in views(&bounds) {
            let (w, h) = (view.camera.width().min(64), view.camera.height().min(36));
            let camera = view.camera.with_image(w, h).unwrap();
            let (target, _) =
                render_scene(&mut Rasteriser::new(), &scene, &camera, &RenderOptions::default()).unwrap();
            let finite = target.colour_rows().flatten().flatten().all(|c| c.is_finite());
            let in_range = target.depth_rows().flatten().all(|d| (0.0..=1.0).contains(d));
            assert!(finite && in_range, "{} / {}", hard.name, view.name);
        }
    }
}

#[test]
fn pictures_show_what_rays_meet() {
    // Pixels whose centre lies within this distance of an edge may be decided either way: vertices are snapped.
    const SNAP_PX: f64 = 0.02;
    let mut compared = 0;
    for hard in meshes() {
        let scene = Scene::of_mesh(hard.mesh.clone());
        let caster = SceneCaster::new(&scene).unwrap();
        for view in views(&hard.mesh.world_bounds()) {
            // Geometry across the near plane of a very wide view is a matter of rounding in the renderer.
            if view.name != "ahead" && view.name != "straight down" && view.name != "infinite far" {
                continue;
            }
            let camera = view.camera.with_image(80, 45).unwrap();
            let mut options = RenderOptions::default();
            options.outputs = Outputs::DEPTH_ID;
            let (target, _) = render_scene(&mut Rasteriser::new(), &scene, &camera, &options).unwrap();
            for y in 0..45 {
                for x in 0..80 {
                    let centre = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                    let meets =
                        |dx: f64, dy: f64| caster.closest(&camera.ray(centre + DVec2::new(dx, dy))).is_some();
                    let around = [(SNAP_PX, 0.0), (-SNAP_PX, 0.0), (0.0, SNAP_PX), (0.0, -SNAP_PX)];
                    let expected = meets(0.0, 0.0);
                    if around.iter().any(|&(dx, dy)| meets(dx, dy) != expected) {
                        continue;
                    }
                    compared += usize::from(expected);
                    assert_eq!(target.id(x, y) != 0, expected, "{} / {} at ({x}, {y})", hard.name, view.name);
                }
            }
        }
    }
    assert!(compared > 5_000, "only {compared} covered pixels were compared");
}

#[test]
fn shadow_maps_of_every_hard_mesh_view_and_light_hold_their_receivers() {
    let mut fitted = 0;
    let mut focus = Focus::new();
    for hard in meshes() {
        let bounds = hard.mesh.world_bounds();
        if bounds.is_empty() {
            continue;
        }
        for view in views(&bounds) {
            for (light_name, direction) in light_directions(&view.camera) {
                let far = view.camera.near().abs().max(1e-30) * 1e6;
                let far = if view.camera.far().is_finite() { view.camera.far() } else { far };
                let name = format!("{} / {} / {light_name}", hard.name, view.name);
                let boxes = [bounds];
                let scope = Scope::new(&view.camera, far, &boxes, &boxes, 1024);
                match focus.fit(&ShadowLight::directional(direction), &scope) {
                    Ok(None) => {}
                    Ok(Some(_)) => continue,
                    // The crate's domain ends at coordinates of 1e15, and it says so.
                    Err(_) if far > 1e15 => continue,
                    Err(error) => panic!("{name}: {error}"),
                }
                fitted += 1;
                let map = focus.map(&MapOptions::new(1024), None);
                assert!(map.clip_from_relative.is_finite(), "{name}");
                assert_receivers_inside(&map, &view.camera, &bounds, far, &name);
            }
        }
    }
    assert!(fitted > 1_000, "{fitted}");
}

/// Points of the box that the camera sees must land in the map, in `f32` as a graphics card computes.
fn assert_receivers_inside(
    map: &farsight_shadow::ShadowView,
    camera: &farsight_geometry::Camera,
    bounds: &DAabb,
    far: f64,
    name: &str,
) {
    let matrix = map.matrix();
    if !matrix.is_finite() {
        panic!("{name}: the matrix does not fit f32");
    }
    for i in 0..27u32 {
        let share = Vec3::new((i % 3) as f32, (i / 3 % 3) as f32, (i / 9) as f32) * 0.5;
        let point = bounds.min + bounds.extent() * share.as_dvec3();
        let Some((px, depth)) = camera.project(point) else { continue };
        let seen = px.x > 0.0
            && px.y > 0.0
            && px.x < f64::from(camera.width())
            && px.y < f64::from(camera.height())
            && depth >= camera.near()
            && depth <= far;
        if !seen {
            continue;
        }
        let clip = matrix * (point - map.origin).as_vec3().extend(1.0);
        let tolerance = 1e-3 * clip.w.abs();
        let inside = clip.w > 0.0 && clip.x.abs() <= clip.w + tolerance && clip.y.abs() <= clip.w + tolerance;
        assert!(inside, "{name}: {point} lands at {clip}");
    }
}
