//! Light and shadow against closed forms and ray casting.

use farsight_geometry::scene::{Instance, Light, Texture};
use farsight_geometry::{Camera, ClipConvention, Hit, Ray, RayCaster, Scene, TriangleMesh};
use farsight_raster::scenes::statue;
use farsight_raster::{
    Image, MipMap, Outputs, QuadDraw, QuadImage, Rasteriser, RenderOptions, ShadowMap, ShadowOptions, State,
    irradiance_from, linear_of, render_picture, render_scene, srgb_byte,
};
use glam::{DAffine3, DVec2, DVec3, Vec2, Vec3};

/// Möller and Trumbore's test over every triangle, in f64.
struct BruteForce(Vec<[DVec3; 3]>);

impl BruteForce {
    fn new(scene: &Scene) -> Self {
        let world = |i: &Instance| {
            let mesh = scene.mesh_of(i).clone();
            let (at, origin) = (i.world_from_mesh, mesh.origin());
            let corners: Vec<_> = mesh.corner_iter().collect();
            corners.into_iter().map(move |c| c.map(|p| at.transform_point3(origin + p.as_dvec3())))
        };
        Self(scene.instances().iter().flat_map(world).collect())
    }
}

impl RayCaster for BruteForce {
    fn closest(&self, ray: &Ray) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        for (i, [a, b, c]) in self.0.iter().enumerate() {
            let (e1, e2) = (*b - *a, *c - *a);
            let p = ray.direction().cross(e2);
            let det = e1.dot(p);
            if det == 0.0 {
                continue;
            }
            let s = ray.origin() - *a;
            let q = s.cross(e1);
            let (u, v, t) = (s.dot(p) / det, ray.direction().dot(q) / det, e2.dot(q) / det);
            let inside = u >= 0.0 && v >= 0.0 && u + v <= 1.0 && (ray.t_min()..=ray.t_max()).contains(&t);
            if inside && best.is_none_or(|h| t < h.t) {
                let barycentrics = [u as f32, v as f32];
                best = Some(Hit { t, instance: 0, triangle: i as u32, barycentrics, back_face: det < 0.0 });
            }
        }
        best
    }
}

fn quad(corner: Vec3, u: Vec3, v: Vec3) -> TriangleMesh {
    let p = [corner, corner + u, corner + u + v, corner + v];
    TriangleMesh::from_slices(&p, &[0, 1, 2, 0, 2, 3]).unwrap()
}

fn add(scene: &mut Scene, mesh: TriangleMesh) {
    let mesh = scene.add_mesh(mesh);
    let world_from_mesh = DAffine3::IDENTITY;
    scene.add_instance(Instance { name: String::new(), mesh, world_from_mesh, material: None }).unwrap();
}

/// Ground with a roof above a part of it.
fn ground_and_roof(direction: DVec3) -> Scene {
    let mut scene = Scene::new();
    add(&mut scene, quad(Vec3::new(-10.0, -10.0, 0.0), Vec3::X * 20.0, Vec3::Y * 20.0));
    add(&mut scene, quad(Vec3::new(-3.0, -2.0, 2.0), Vec3::X * 4.0, Vec3::Y * 5.0));
    let irradiance = Vec3::splat(std::f32::consts::PI);
    scene.add_light(Light::Directional { direction, irradiance, angular_radius: 0.0 }).unwrap();
    scene
}

#[test]
fn shadows_fall_where_rays_say() {
    for direction in [DVec3::new(0.3, 0.2, -1.0), DVec3::new(-0.9, 0.4, -0.5), DVec3::NEG_Z] {
        let direction = direction.normalize();
        let scene = ground_and_roof(direction);
        let caster = BruteForce::new(&scene);
        let camera = Camera::look_at(DVec3::new(0.5, -14.0, 9.0), DVec3::new(0.0, 0.0, 0.5), DVec3::Z)
            .unwrap()
            .with_image(120, 90)
            .unwrap();
        let mut rasteriser = Rasteriser::new();
        let size = 1024;
        let shadows = ShadowMap::for_scene(&mut rasteriser, &scene, size, ShadowOptions::default()).unwrap();
        let mut options = RenderOptions::default();
        options.shadows = &shadows;
        options.sky = None;
        options.ambient = [Vec3::ZERO; 2];
        let (target, _) = render_scene(&mut rasteriser, &scene, &camera, &options).unwrap();
        // Filter (2 texels) and normal offset (3 texels), each stretched by the slant of the light.
        let texel = scene.bounds().diagonal() / f64::from(size);
        let blur = 6.0 * texel / -direction.z;
        let (mut lit, mut dark) = (0, 0);
        for y in 0..90 {
            for x in 0..120 {
                let ray = camera.ray(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
                let Some(hit) = caster.closest(&ray).filter(|h| h.triangle < 2) else { continue };
                let at = |dx: f64, dy: f64| {
                    let p = ray.at(hit.t) + DVec3::new(dx, dy, 0.0);
                    caster.occluded(&Ray::new(p, -direction).unwrap().with_range(1e-9, f64::INFINITY))
                };
                let mut around = vec![(0.0, 0.0)];
                for k in 0..8 {
                    let (sin, cos) = (std::f64::consts::FRAC_PI_4 * f64::from(k)).sin_cos();
                    around.push((blur * cos, blur * sin));
                }
                let dark_count = around.iter().filter(|&&(dx, dy)| at(dx, dy)).count();
                // White ground of the default material: radiance = 0.75 · cosine.
                let full = 0.75 * -direction.z;
                let got = f64::from(target.colour(x, y)[0]);
                match dark_count {
                    0 => {
                        assert!(
                            (got - full).abs() < 1e-5,
                            "acne at ({x}, {y}), {}: {got} of {full}",
                            ray.at(hit.t)
                        );
                        lit += 1;
                    }
                    9 => {
                        assert!(got < 1e-6, "leak at ({x}, {y}): {got}");
                        dark += 1;
                    }
                    _ => assert!((-1e-6..=full + 1e-5).contains(&got)),
                }
            }
        }
        assert!(lit > 1000 && dark > 100, "{lit} {dark}");
    }
}

#[test]
fn a_map_with_another_beyond_it_covers_both() {
    let direction = DVec3::new(0.3, 0.2, -1.0).normalize();
    let scene = ground_and_roof(direction);
    let mut rasteriser = Rasteriser::new();
    let camera = Camera::look_at(DVec3::new(0.0, -1.0, 1.0), DVec3::new(0.0, 2.0, 0.0), DVec3::Z).unwrap();
    let map = &ShadowMap::for_view(&mut rasteriser, &scene, &camera, 3.0, 256, ShadowOptions::default())
        .unwrap()[0];
    let caster = BruteForce::new(&scene);
    let mut seen = [0; 2];
    for j in -9..=9 {
        for i in -9..=9 {
            let p = DVec3::new(f64::from(i) + 0.37, f64::from(j) + 0.21, 0.0);
            let ray = Ray::new(p, -direction).unwrap().with_range(1e-9, f64::INFINITY);
            let lit = map.lit_relative((p - map.origin()).as_vec3(), Vec3::Z);
            let expected = if caster.occluded(&ray) { 0.0 } else { 1.0 };
            let blurred = lit > 0.0 && lit < 1.0;
            assert!(lit == expected || blurred, "{p}: {lit} {expected}");
            seen[usize::from(blurred)] += 1;
        }
    }
    assert!(seen[0] > 300, "{seen:?}");
}

/// Up to its end a map without casters leaves everything lit, whatever the origin; behind it the other map is asked.
#[test]
fn a_map_ends_where_it_is_told_to() {
    let direction = DVec3::new(0.3, 0.2, -1.0).normalize();
    let scene = ground_and_roof(direction);
    let mut rasteriser = Rasteriser::new();
    let options = ShadowOptions::default();
    let full = ShadowMap::for_scene(&mut rasteriser, &scene, 512, options).unwrap().remove(0);
    let empty =
        ShadowMap::directional(&mut rasteriser, &Scene::new(), direction, DVec3::ZERO, 30.0, 64, options)
            .unwrap();
    let (eye, forward) = (DVec3::new(0.0, -5.0, 1.0), DVec3::Y);
    let map = empty.until(eye, forward, 4.5).with_beyond(full.clone());
    let mut shadowed = [0; 2];
    for origin in [DVec3::ZERO, DVec3::new(40.0, -7.0, 3.0)] {
        let (map, full) = (map.relative_to(origin), full.relative_to(origin));
        for j in -20..=20 {
            for i in -20..=20 {
                let p = DVec3::new(f64::from(i) * 0.31, f64::from(j) * 0.29, 0.0);
                let (lit, other) = (
                    map.lit_relative((p - origin).as_vec3(), Vec3::Z),
                    full.lit_relative((p - origin).as_vec3(), Vec3::Z),
                );
                let before = (p - eye).dot(forward) < 4.5;
                let expected = if before { 1.0 } else { other };
                assert!((lit - expected).abs() < 1e-5, "{p}: {lit} instead of {expected}");
                shadowed[usize::from(before)] += i32::from(other == 0.0);
            }
        }
    }
    assert!(shadowed[0] > 50 && shadowed[1] > 50, "{shadowed:?}");
}

#[test]
fn area_lights_have_their_closed_forms() {
    let nothing = BruteForce(Vec::new());
    let at = |light: &Light, n| irradiance_from(light, &nothing, DVec3::ZERO, DVec3::Z, 1e-9, n, 1);
    // A disk overhead: E = π L r² / (r² + h²).
    let (h, r) = (2.0, 0.7);
    let disk = Light::Disk { center: DVec3::Z * h, normal: DVec3::NEG_Z, radius: r, radiance: Vec3::ONE };
    let expected = std::f64::consts::PI * r * r / (r * r + h * h);
    assert!((at(&disk, 64).irradiance.x / expected - 1.0).abs() < 1e-3);
    // A sphere overhead: E = π L (r / h)².
    let sphere = Light::Sphere { center: DVec3::Z * h, radius: r, radiance: Vec3::ONE };
    let expected = std::f64::consts::PI * (r / h).powi(2);
    assert!((at(&sphere, 64).irradiance.x / expected - 1.0).abs() < 1e-3);
    // A square overhead, half side a: four times the form factor of a quarter with a corner overhead.
    let a: f64 = 0.8;
    let (half_u, half_v) = (DVec3::Y * a, DVec3::X * a);
    let square = Light::Rectangle { center: DVec3::Z * h, half_u, half_v, radiance: Vec3::ONE };
    assert!(half_u.cross(half_v).z < 0.0);
    let k = (h * h + a * a).sqrt();
    let expected = 4.0 * (a / k) * (a / k).atan();
    assert!(
        (at(&square, 64).irradiance.x / expected - 1.0).abs() < 1e-3,
        "{} {expected}",
        at(&square, 64).irradiance.x
    );
    // The other side of a disk or rectangle is dark.
    let turned = Light::Disk { center: DVec3::Z * h, normal: DVec3::Z, radius: r, radiance: Vec3::ONE };
    assert_eq!(at(&turned, 8).irradiance, DVec3::ZERO);
    let point = Light::Point { position: DVec3::new(0.0, 3.0, 4.0), intensity: Vec3::splat(50.0) };
    assert!((at(&point, 4).irradiance.x - 50.0 / 25.0 * 0.8).abs() < 1e-12);
}

#[test]
fn half_of_a_light_behind_an_edge_lights_half() {
    let mut scene = Scene::new();
    // Occludes everything with x < 0 at height 1, seen from the ground at the origin.
    add(&mut scene, quad(Vec3::new(-50.0, -50.0, 1.0), Vec3::X * 50.0, Vec3::Y * 100.0));
    let caster = BruteForce::new(&scene);
    let sun = Light::Directional { direction: DVec3::NEG_Z, irradiance: Vec3::ONE, angular_radius: 0.05 };
    let at = |x: f64| irradiance_from(&sun, &caster, DVec3::new(x, 0.0, 0.0), DVec3::Z, 1e-6, 48, 3).visible;
    assert!((at(0.0) - 0.5).abs() < 0.01);
    assert_eq!(at(0.06), 1.0);
    assert_eq!(at(-0.06), 0.0);
    // Share of a disk beyond a chord at d radii: (acos d − d·√(1 − d²)) / π.
    for d in [-0.8f64, -0.3, 0.4, 0.7] {
        let expected = (d.acos() - d * (1.0 - d * d).sqrt()) / std::f64::consts::PI;
        assert!((at(-d * 0.05f64.tan()) - expected).abs() < 0.01, "{d}");
    }
}

#[test]
fn supersampling_averages_in_linear_light() {
    let mut scene = Scene::new();
    add(&mut scene, quad(Vec3::new(0.0, -50.0, 0.0), Vec3::X * 100.0, Vec3::Y * 100.0));
    let camera = Camera::look_at(DVec3::Z * 10.0, DVec3::ZERO, DVec3::Y).unwrap().with_image(9, 3).unwrap();
    let mut options = RenderOptions::default();
    options.supersampling = 4;
    options.sky = None;
    options.ambient = [Vec3::ONE; 2];
    let (target, _) = render_scene(&mut Rasteriser::new(), &scene, &camera, &options).unwrap();
    assert_eq!(target.width(), 9);
    let row: Vec<f32> = (0..9).map(|x| target.colour(x, 1)[0]).collect();
    // The edge runs through the middle of pixel 4.
    assert!(row[..4].iter().all(|&c| c == 0.0) && row[5..].iter().all(|&c| (c - 0.75).abs() < 1e-6));
    assert!((row[4] - 0.375).abs() < 1e-6, "{row:?}");
    options.supersampling = 0;
    assert!(render_scene(&mut Rasteriser::new(), &scene, &camera, &options).is_err());
}

#[test]
fn mip_maps_keep_the_mean_and_repeat() {
    let texels: Vec<[u8; 4]> = (0..16 * 8)
        .map(|i| if (i / 4 + i / 32) % 2 == 0 { [255, 0, 0, 255] } else { [0, 0, 255, 255] })
        .collect();
    let map = MipMap::new(&Texture::new(16, 8, texels).unwrap());
    assert_eq!(map.levels(), 5);
    let mean = map.sample(Vec2::new(0.3, 0.7), 4.0);
    assert!((mean.x - 0.5).abs() < 1e-6 && (mean.z - 0.5).abs() < 1e-6 && mean.y == 0.0);
    let uv = Vec2::new(0.13, 0.4);
    for level in [0.0, 0.5, 2.25] {
        let a = map.sample(uv, level);
        let b = map.sample(uv + Vec2::new(3.0, -5.0), level);
        assert!(a.abs_diff_eq(b, 1e-4));
    }
    // One texel is 1/16 of u: moving that much per pixel is level 0, four times that is level 2.
    assert_eq!(map.level_of(Vec2::new(1.0 / 16.0, 0.0), Vec2::ZERO), 0.0);
    assert!((map.level_of(Vec2::ZERO, Vec2::new(4.0 / 16.0, 0.0)) - 2.0).abs() < 1e-6);
    // Texel centres give the texel.
    assert_eq!(map.sample(Vec2::new(0.5 / 16.0, 0.5 / 8.0), 0.0).x, 1.0);
    for odd in [Vec2::NAN, Vec2::INFINITY, Vec2::splat(1e30)] {
        let _ = map.sample(odd, 0.0);
    }
}

#[test]
fn images_survive_png_and_report_differences() {
    for byte in 0..=255 {
        assert_eq!(srgb_byte(linear_of(byte)), byte);
    }
    let pixels: Vec<[u8; 3]> = (0..35u8).map(|i| [i, 7 * i, 255 - i]).collect();
    let image = Image::new(7, 5, pixels.clone()).unwrap();
    let bytes = image.to_png().unwrap();
    let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
    let mut decoded = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut decoded).unwrap();
    assert_eq!(decoded, pixels.as_flattened());
    let mut other = pixels;
    other[3][1] += 6;
    other[8][0] += 1;
    let difference = image.compare(&Image::new(7, 5, other).unwrap()).unwrap();
    assert_eq!((difference.differing, difference.largest), (2, 6));
    assert!((difference.rmse - (37.0f64 / 105.0).sqrt()).abs() < 1e-12);
    assert!(Image::new(7, 4, image.pixels().to_vec()).is_err());
    assert!(image.write_png("/nonexistent/folder/x.png").is_err());
}

#[test]
fn only_wanted_buffers_exist() {
    let scene = ground_and_roof(DVec3::NEG_Z);
    let camera = Camera::look_at(DVec3::new(0.0, -9.0, 9.0), DVec3::ZERO, DVec3::Z).unwrap();
    let mut options = RenderOptions::default();
    options.outputs = Outputs::DEPTH;
    let (target, _) = render_scene(&mut Rasteriser::new(), &scene, &camera, &options).unwrap();
    assert_eq!(target.colour_rows().count() + target.id_rows().count(), 0);
    assert!(target.depth_rows().flatten().any(|&d| d > 0.0));
}

#[cfg(feature = "exr")]
#[test]
fn exr_files_hold_every_buffer() {
    use exr::prelude::{FlatSamples, read_first_flat_layer_from_file};
    let scene = ground_and_roof(DVec3::NEG_Z);
    let camera = Camera::look_at(DVec3::new(0.0, -9.0, 9.0), DVec3::ZERO, DVec3::Z).unwrap();
    let camera = camera.with_image(37, 23).unwrap();
    let options = RenderOptions::default();
    let (target, _) = render_scene(&mut Rasteriser::new(), &scene, &camera, &options).unwrap();
    let path = std::env::temp_dir().join(format!("farsight-raster-{}.exr", std::process::id()));
    farsight_raster::write_exr(&target, &path).unwrap();
    let image = read_first_flat_layer_from_file(&path).unwrap();
    std::fs::remove_file(&path).unwrap();
    let channels = &image.layer_data.channel_data.list;
    assert_eq!(channels.len(), 6);
    for channel in channels {
        match (channel.name.to_string().as_str(), &channel.sample_data) {
            ("Z", FlatSamples::F32(z)) => assert!(z.iter().eq(target.depth_rows().flatten())),
            ("I", FlatSamples::U32(i)) => assert!(i.iter().copied().eq(target.ids())),
            ("G", FlatSamples::F32(g)) => {
                assert!(g.iter().copied().eq(target.colour_rows().flatten().map(|c| c[1])));
            }
            (_, FlatSamples::F32(_)) => {}
            other => panic!("{other:?}"),
        }
    }
}

/// A picture of an object, drawn as a quad where the object is, looks like the object, is hidden by what is before it and hides what is behind.
#[test]
fn a_picture_stands_for_its_object() {
    let mut scene = Scene::new();
    add(&mut scene, statue(12).unwrap());
    add(&mut scene, quad(Vec3::new(-9.0, -9.0, 0.0), Vec3::X * 18.0, Vec3::Y * 18.0));
    add(&mut scene, quad(Vec3::new(1.5, 0.3, 0.0), Vec3::Y * 0.8, Vec3::Z * 3.0));
    let direction = DVec3::new(-0.4, 0.5, -0.7).normalize();
    let light = Light::Directional { direction, irradiance: Vec3::splat(2.0), angular_radius: 0.0 };
    scene.add_light(light).unwrap();
    let size = [300, 240];
    let middle = DVec3::new(0.0, 0.0, 1.6);
    let camera = Camera::look_at(DVec3::new(5.0, 1.0, 2.5), middle, DVec3::Z)
        .and_then(|c| c.with_image(size[0], size[1]))
        .unwrap();
    let (eye, clip) = (camera.eye(), camera.clip_from_relative_f64(ClipConvention::REVERSED, camera.eye()));
    let mut rasteriser = Rasteriser::new();
    let mut options = RenderOptions::default();
    options.outputs = Outputs { colour: true, depth: true, id: false };
    let (whole, _) = render_scene(&mut rasteriser, &scene, &camera, &options).unwrap();

    // The picture has the samples of the image: its quad is all that is seen at the statue's distance.
    let triangles = scene.meshes()[0].triangles();
    let picture = render_picture(&mut rasteriser, &scene, 0, triangles, eye, clip, size, &options).unwrap();
    let away = eye.distance(middle);
    // Depth is the near plane's distance over the distance ahead.
    let image = QuadImage::with_relief(&picture, |depth| (away - camera.near() / f64::from(depth)) as f32);
    let corner = |x: u32, y: u32| {
        let ray = camera.ray(DVec2::new(f64::from(x), f64::from(y))).direction();
        (ray * (away / ray.dot(camera.forward()))).as_vec3()
    };
    let quads = [QuadDraw {
        corners: [corner(0, 0), corner(size[0], 0), corner(0, size[1])],
        image: &image,
        cutoff: 0.5,
        clip_from_local: clip,
        state: State::default(),
    }];
    options.only = Some(&[1, 2]);
    let (without, _) = render_scene(&mut rasteriser, &scene, &camera, &options).unwrap();
    options.quads = &quads;
    let (pictured, _) = render_scene(&mut rasteriser, &scene, &camera, &options).unwrap();
    let [whole, pictured, without] = [&whole, &pictured, &without].map(Image::from_colour);
    let changed = |other: &Image| {
        let difference = other.compare(&whole).unwrap();
        difference.pixels.iter().filter(|d| d.iter().any(|&step| step > 8)).count()
    };
    let (all, left) = (changed(&without), changed(&pictured));
    // Where statue and ground or wall meet, depth is that of the nearest texel.
    assert!(all > 2000 && left * 50 < all, "{left} of {all} pixels");
}

#[test]
fn alpha_makes_holes_and_blends() {
    use farsight_geometry::scene::{AlphaMode, Material};
    let camera = Camera::look_at(DVec3::Z * 10.0, DVec3::ZERO, DVec3::Y).unwrap().with_image(32, 32).unwrap();
    // The left half of the texture is solid, the right half has alpha 64 / 255.
    let texels = (0..64).map(|i| [255, 255, 255, if i % 8 < 4 { 255 } else { 64 }]).collect();
    let shown = |alpha: AlphaMode| {
        let mut scene = Scene::new();
        add(&mut scene, quad(Vec3::new(-50.0, -50.0, -1.0), Vec3::X * 100.0, Vec3::Y * 100.0));
        let texture = Some(scene.add_texture(Texture::new(8, 8, Vec::clone(&texels)).unwrap()));
        let base_colour = [1.0, 0.0, 0.0, 1.0];
        let material = Material { texture, alpha, base_colour, ..Material::default() };
        let material = Some(scene.add_material(material).unwrap());
        let uvs = [(0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0)].map(|(u, v)| Vec2::new(u, v));
        let front = quad(Vec3::new(-8.0, -8.0, 0.0), Vec3::X * 16.0, Vec3::Y * 16.0);
        let mesh = scene.add_mesh(front.with_uvs(uvs.to_vec()).unwrap());
        let world_from_mesh = DAffine3::IDENTITY;
        scene.add_instance(Instance { name: String::new(), mesh, world_from_mesh, material }).unwrap();
        let mut options = RenderOptions::default();
        options.ambient = [Vec3::ONE; 2];
        options.haze = None;
        let (target, _) = render_scene(&mut Rasteriser::new(), &scene, &camera, &options).unwrap();
        [target.colour(8, 16), target.colour(24, 16)].map(|c| [c[0], c[1]])
    };
    let a = 64.0 / 255.0;
    let near = |got: [f32; 2], expected: [f32; 2]| {
        assert!(
            (got[0] - expected[0]).abs() < 1e-4 && (got[1] - expected[1]).abs() < 1e-4,
            "{got:?} {expected:?}"
        );
    };
    let [left, right] = shown(AlphaMode::Opaque);
    near(left, [1.0, 0.0]);
    near(right, [1.0, 0.0]);
    let [left, right] = shown(AlphaMode::Mask { cutoff: 0.5 });
    near(left, [1.0, 0.0]);
    near(right, [0.75, 0.75]);
    let [left, right] = shown(AlphaMode::Blend);
    near(left, [1.0, 0.0]);
    near(right, [a + 0.75 * (1.0 - a), 0.75 * (1.0 - a)]);
}
