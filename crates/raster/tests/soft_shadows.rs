//! Soft shadows of a map against rays to all of the light.

use farsight_geometry::ray::BruteForce;
use farsight_geometry::scene::{Instance, Light};
use farsight_geometry::{Scene, TriangleMesh};
use farsight_raster::{Penumbra, Rasteriser, ShadowMap, ShadowOptions, irradiance_from};
use glam::{DAffine3, DMat4, DVec3, DVec4, Vec3};

/// A parallelogram.
fn quad(corner: Vec3, a: Vec3, b: Vec3) -> TriangleMesh {
    let corners = vec![corner, corner + a, corner + a + b, corner + b];
    TriangleMesh::new(corners, vec![[0, 1, 2], [0, 2, 3]]).unwrap()
}

fn add(scene: &mut Scene, mesh: TriangleMesh) {
    let mesh = scene.add_mesh(mesh);
    let world_from_mesh = DAffine3::IDENTITY;
    scene.add_instance(Instance { name: String::new(), mesh, world_from_mesh, material: None }).unwrap();
}

/// Maps of the same casters: one even, one warped across the light so that texels shrink along an axis.
fn maps(scene: &Scene, direction: DVec3, size: u32, penumbra: Option<Penumbra>) -> [ShadowMap; 2] {
    let (right, up) = direction.any_orthonormal_pair();
    let radius = 4.0;
    let row = |axis: DVec3, w: f64| DVec4::new(axis.x, axis.y, axis.z, w);
    let even = DMat4::from_cols(
        row(right / radius, 0.0),
        row(up / radius, 0.0),
        row(-direction * (0.5 / radius), 0.5),
        DVec4::W,
    )
    .transpose();
    // y becomes (2y + 1)/(y + 2), which leaves −1 and 1 where they are; depth is shared by the same w.
    let warp = DMat4::from_cols(
        DVec4::new(1.0, 0.0, 0.0, 0.0),
        DVec4::new(0.0, 2.0, 0.0, 1.0),
        DVec4::new(0.0, 0.0, 1.0, 0.0),
        DVec4::new(0.0, 1.0, 0.0, 2.0),
    );
    let mut options = ShadowOptions::default();
    options.penumbra = penumbra;
    [even, warp * even].map(|matrix| {
        let mut map = ShadowMap::new(size, matrix, DVec3::ZERO, -direction, options).unwrap();
        map.draw_scene(&mut Rasteriser::new(), scene);
        map
    })
}

#[test]
fn penumbrae_are_those_of_rays() {
    let direction = DVec3::new(0.5, 0.2, -1.0).normalize();
    for (height, angular_radius) in [(0.5f32, 0.05f64), (2.0, 0.03), (1.0, 0.12), (3.0, 0.00465)] {
        let mut scene = Scene::new();
        add(&mut scene, quad(Vec3::new(-3.0, -3.0, 0.0), Vec3::X * 6.0, Vec3::Y * 6.0));
        add(&mut scene, quad(Vec3::new(-3.0, -3.0, height), Vec3::X * 2.2, Vec3::Y * 6.0));
        let caster = BruteForce::new(&scene.flattened().unwrap());
        let sun = Light::Directional { direction, irradiance: Vec3::ONE, angular_radius };
        for taps in [9, 18, 64] {
            let penumbra = Penumbra { angular_radius: angular_radius as f32, taps };
            for (which, map) in maps(&scene, direction, 2048, Some(penumbra)).iter().enumerate() {
                let (mut worst, mut sum, mut count) = (0.0f64, 0.0, 0);
                for i in 0..240 {
                    // Along the ground, across the edge's shadow.
                    let middle = f64::from(-0.8 + 0.5 * height);
                    let x = middle + (f64::from(i) / 120.0 - 1.0) * 2.0 * f64::from(height) * angular_radius;
                    let point = DVec3::new(x, 0.137, 0.0);
                    let want = irradiance_from(&sun, &caster, point, DVec3::Z, 1e-6, 24, 1).visible;
                    let got = f64::from(map.lit_relative(point.as_vec3(), Vec3::Z));
                    worst = worst.max((got - want).abs());
                    (sum, count) = (sum + (got - want).abs(), count + 1);
                }
                let mean = sum / f64::from(count);
                println!(
                    "height {height}, radius {angular_radius}, {taps} taps, map {which}: worst {worst:.3}, mean {mean:.4}"
                );
                // A texel is 4 mm: that much of a penumbra is not resolved, nor what rays sample.
                let width = 2.0 * angular_radius * f64::from(height);
                let unresolved = 0.012 / width + 0.02;
                assert!(worst <= 1.0 / f64::from(taps) + unresolved, "{worst}");
                assert!(mean <= 0.5 / f64::from(taps) + 0.5 * unresolved, "{mean}");
            }
        }
    }
}

#[test]
fn surfaces_do_not_shadow_themselves_however_wide_the_light() {
    let direction = DVec3::new(0.6, 0.1, -0.7).normalize();
    for tilt in [-0.5f32, 0.0, 0.5, 1.2] {
        let mut scene = Scene::new();
        let along = Vec3::new(1.0, 0.0, tilt).normalize();
        let normal = Vec3::new(-tilt, 0.0, 1.0).normalize();
        add(&mut scene, quad(-2.0 * along - 2.0 * Vec3::Y, 4.0 * along, 4.0 * Vec3::Y));
        for taps in [4, 16, 36] {
            let penumbra = Penumbra { angular_radius: 0.2, taps };
            for map in maps(&scene, direction, 256, Some(penumbra)) {
                for i in 0..500 {
                    let (a, b) =
                        (f32::from(i as u16 % 25) / 12.5 - 1.0, f32::from(i as u16 / 25) / 10.0 - 1.0);
                    let lit = map.lit_relative(along * (1.7 * a) + Vec3::Y * (1.7 * b), normal);
                    assert!(lit > 0.999_999, "tilt {tilt}, {taps} taps at {a}, {b}: {lit}");
                }
            }
        }
    }
}
