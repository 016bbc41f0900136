//! Shadow maps drawn by the reference renderer against rays: where edges lie, and whether skipped passes were needless.

#[path = "../examples/shadow/offset.rs"]
mod offset;
#[path = "../examples/shadow/posts.rs"]
mod posts;

use farsight_geometry::glam::{DVec2, DVec3, dvec3, vec3};
use farsight_geometry::ray::SceneCaster;
use farsight_geometry::sampling::{Random, in_box};
use farsight_geometry::scene::{Light, Scene};
use farsight_geometry::{Camera, DAabb, Frustum, Ray, RayCaster};
use farsight_raster::{Rasteriser, ShadowMap, ShadowOptions};
use farsight_shadow::{Focus, MapOptions, Scope, ShadowLight, ShadowView, Warp};
use offset::{Offsets, Truth};

fn sun_of(scene: &Scene) -> DVec3 {
    let Light::Directional { direction, .. } = scene.lights()[0] else { panic!("the light is the sun") };
    direction
}

fn view_of(scene: &Scene, camera: &Camera, side: u32, warp: Warp) -> ShadowView {
    let boxes = scene.instance_bounds();
    let mut focus = Focus::new();
    let scope = Scope::new(camera, camera.far(), &boxes, &boxes, side);
    assert_eq!(focus.fit(&ShadowLight::directional(sun_of(scene)), &scope), Ok(None));
    focus.map(&MapOptions::new(side).with_warp(warp), None)
}

fn offsets(scene: &Scene, camera: &Camera, truth: &Truth, side: u32, warp: Warp) -> (Offsets, ShadowView) {
    let view = view_of(scene, camera, side, warp);
    let options = ShadowOptions::default();
    let mut map =
        ShadowMap::new(side, view.clip_from_relative, view.origin, -sun_of(scene), options).unwrap();
    map.draw_scene(&mut Rasteriser::new(), scene);
    (offset::compare(truth, |seen| offset::lit(&map, &view, seen)).0, view)
}

#[test]
fn warps_bring_shadow_edges_to_where_rays_put_them() {
    let side = 1024;
    // Suns from the side, from behind, low and high.
    for (elevation, azimuth) in [(35.0, 70.0), (20.0, 0.0), (60.0, 160.0)] {
        let scene = posts::scene(elevation, azimuth);
        let camera = posts::camera(480, 270).unwrap();
        let caster = SceneCaster::new(&scene).unwrap();
        let truth = offset::truth(&scene, &caster, &camera, sun_of(&scene));
        let of = |warp| offsets(&scene, &camera, &truth, side, warp);
        let (uniform, uniform_view) = of(Warp::Uniform);
        let (paper, _) = of(Warp::Paper);
        let (perspective, _) = of(Warp::Perspective);
        let (minimax, view) = of(Warp::Minimax);
        println!(
            "sun {elevation}° high, {azimuth}° aside, {side} texels; mean edge offset px: all, near, medium, far"
        );
        for (name, o) in [("uniform", uniform), ("LiSPSM", paper), ("PSM", perspective), ("minimax", minimax)]
        {
            let [near, medium, far] = o.bands_px;
            println!("{name:8} {:.2}  {near:.2} {medium:.2} {far:.2}", o.mean_px);
        }
        println!("claimed texel {:.2} px, uniform {:.2} px", view.texel.value, uniform_view.texel.value);
        assert!(uniform.edge > 200, "there are shadows to see: {uniform:?}");
        assert!(minimax.mean_px < 0.6 * uniform.mean_px, "{minimax:?} {uniform:?}");
        assert!(minimax.bands_px[0] < 0.6 * uniform.bands_px[0], "{minimax:?} {uniform:?}");
        // A texel, stretched where light falls obliquely on the ground, bounds the mean offset of an edge.
        let stretch = 1.0 / f64::to_radians(elevation).sin();
        assert!(minimax.mean_px <= stretch * view.texel.value, "{minimax:?} {}", view.texel);
        // Twice the side, half the offset: the error is that of the map.
        let (finer, _) = offsets(&scene, &camera, &truth, 4 * side, Warp::Minimax);
        assert!(finer.mean_px < 0.6 * minimax.mean_px, "{finer:?} {minimax:?}");
    }
}

/// Random boxes, suns and cameras: where a pass is skipped, no ray from what the camera sees may be blocked.
#[test]
fn skipped_passes_would_have_shown_nothing() {
    let mut random = Random::new(17);
    let (mut skipped, mut needless, mut apart, mut tried) = (0, 0, 0, 0);
    let mut focus = Focus::new();
    for _ in 0..1500 {
        let mut v = || DVec3::from_array(random.units()) * 2.0 - 1.0;
        let eye = v() * 6.0;
        let camera = Camera::look_at(eye, eye + v() * 0.6 + dvec3(1.0, 0.0, 0.0), DVec3::Z)
            .and_then(|c| c.with_image(64, 48))
            .unwrap();
        let travel = (v() - DVec3::Z * 0.5).normalize();
        let mut a_box = |scale: f64, at: DVec3| {
            let c = at + v() * DVec3::new(6.0, 9.0, 3.0);
            let half = (v().abs() + 0.1) * scale;
            DAabb::new(c - half, c + half)
        };
        let receiver = a_box(8.0, DVec3::X * 12.0);
        let caster = a_box(3.0, DVec3::X * 12.0 - travel * 15.0);
        let mut scene = Scene::new();
        for b in [receiver, caster] {
            let mesh = scene.add_mesh(posts::block(b.min, b.max));
            let instance = farsight_geometry::scene::Instance {
                mesh,
                world_from_mesh: farsight_geometry::glam::DAffine3::IDENTITY,
                material: None,
                name: String::new(),
            };
            scene.add_instance(instance).unwrap();
        }
        let tree = SceneCaster::new(&scene).unwrap();
        // Rays see the receiver alone; the caster may stand in the way without being a receiver.
        let alone = Scene::of_mesh(posts::block(receiver.min, receiver.max));
        let receiver_tree = SceneCaster::new(&alone).unwrap();
        let scope =
            Scope::new(&camera, 60.0, std::slice::from_ref(&receiver), std::slice::from_ref(&caster), 512);
        let skip = focus.fit(&ShadowLight::directional(travel), &scope).unwrap();
        let mut shadowed = 0;
        for i in 0..64 * 48 {
            let px = DVec2::new(f64::from(i % 64) + 0.5, f64::from(i / 64) + 0.5);
            let Some(hit) = receiver_tree.closest(&camera.ray(px)) else { continue };
            let point = camera.ray(px).at(hit.t);
            if camera.forward().dot(point - eye) > 60.0 {
                continue;
            }
            let blocked =
                Ray::new(point, -travel).and_then(|r| tree.closest(&r.with_range(1e-6, f64::INFINITY)));
            shadowed += i32::from(blocked.is_some_and(|h| h.instance == 1));
        }
        // The box is all that the decision knows: does the shadow meet any part of it in view?
        let seen = Frustum::from_camera(&camera.with_range(camera.near(), 60.0).unwrap());
        let meets = (0..3000).any(|_| {
            let p = in_box(&receiver, random.units());
            let up = |t: f64| caster.contains(p - travel * t);
            seen.contains(p) && (0..400).any(|k| up(0.1 * f64::from(k)))
        });
        apart += i32::from(!meets && shadowed == 0);
        tried += 1;
        skipped += i32::from(skip.is_some());
        needless += i32::from(shadowed == 0);
        assert!(skip.is_none() || shadowed == 0, "{skip:?} but {shadowed} pixels are in shadow");
    }
    let recall = f64::from(skipped) / f64::from(apart);
    println!(
        "{tried} scenes: {needless} show no shadow, in {apart} the caster's shadow misses the receiver's box; {skipped} skipped \
         (recall {recall:.3} of the latter, {:.3} of the former), false skips 0",
        f64::from(skipped) / f64::from(needless)
    );
    assert!(apart > 300 && tried - needless > 200 && recall > 0.9, "{recall}");
}

/// Warped maps have depths that change across the light too; an offset made for uniform maps leaves stripes on the ground before the eye.
#[test]
fn a_plane_does_not_shadow_itself_under_any_warp() {
    let ground = [(-80.0, -80.0), (80.0, -80.0), (80.0, 80.0), (-80.0, 80.0)];
    let ground = ground.map(|(x, y)| vec3(x, y, 0.0)).to_vec();
    let mesh = farsight_geometry::TriangleMesh::new(ground, vec![[0, 1, 2], [0, 2, 3]]).unwrap();
    let scene = Scene::of_mesh(mesh);
    let boxes = scene.instance_bounds();
    for (elevation, azimuth) in [(60.0f64, 20.0f64), (35.0, 75.0), (15.0, 130.0)] {
        let (up, around) = (elevation.to_radians(), azimuth.to_radians());
        let sun = -dvec3(around.cos() * up.cos(), around.sin() * up.cos(), up.sin());
        let camera = Camera::look_at(dvec3(0.0, 0.0, 1.2), dvec3(30.0, 4.0, 0.0), DVec3::Z)
            .and_then(|c| c.with_range(0.02, 400.0))
            .and_then(|c| c.with_image(160, 90))
            .unwrap();
        let caster = SceneCaster::new(&scene).unwrap();
        for warp in [Warp::Uniform, Warp::Paper, Warp::Minimax, Warp::Perspective] {
            let mut focus = Focus::new();
            let scope = Scope::new(&camera, 200.0, &boxes, &boxes, 512);
            assert_eq!(focus.fit(&ShadowLight::directional(sun), &scope), Ok(None));
            let view = focus.map(&MapOptions::new(512).with_warp(warp), None);
            let mut map =
                ShadowMap::new(512, view.clip_from_relative, view.origin, -sun, ShadowOptions::default())
                    .unwrap();
            map.draw_scene(&mut Rasteriser::new(), &scene);
            let mut seen = 0;
            for y in 0..90 {
                for x in 0..160 {
                    let ray = camera.ray(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
                    let Some(hit) = caster.closest(&ray) else { continue };
                    let point = (ray.at(hit.t) - view.origin).as_vec3();
                    let lit = map.lit_relative(point, DVec3::Z.as_vec3());
                    assert!(lit > 0.999, "{warp:?}, sun {elevation}° high: {lit} at pixel {x}, {y}");
                    seen += 1;
                }
            }
            assert!(seen > 3000, "{seen}");
        }
    }
}
