//! Impostors and textured cuts drawn by the reference renderer, beside what they stand for.

#[path = "../examples/lod/engine.rs"]
#[allow(dead_code)]
mod engine;

use engine::{Object, Renderer};
use farsight_geometry::bvh::Bvh;
use farsight_geometry::glam::{DAffine3, DMat4, DQuat, DVec3, Vec2, Vec3, Vec4};
use farsight_geometry::sampling::Random;
use farsight_geometry::scene::Texture;
use farsight_geometry::{Camera, ClipConvention, TriangleMesh, hard_cases};
use farsight_lod::{
    Cut, ImpostorOptions, ImpostorRenderer, ImpostorView, Observer, Placement, Tolerance, VertexHierarchy,
};
use farsight_raster::scenes::aeroplane;
use farsight_raster::{Draw, Fragment, MipMap, Outputs, Rasteriser, State, Target};

const SIZE: [u32; 2] = [320, 240];

fn blank() -> Target {
    Target::new(SIZE[0], SIZE[1], Outputs { colour: true, depth: true, id: false }).unwrap()
}

fn object(mesh: &TriangleMesh, place: &DAffine3) -> Object {
    let placement = Placement::new(place, mesh.origin()).unwrap();
    Object { model: 0, placement, bounds: mesh.world_bounds().transformed(place) }
}

fn camera(eye: DVec3, target: DVec3) -> Camera {
    Camera::look_at(eye, target, DVec3::Z).and_then(|c| c.with_image(SIZE[0], SIZE[1])).unwrap()
}

fn points(mesh: &TriangleMesh, placement: &Placement) -> Vec<DVec3> {
    mesh.corner_iter().flatten().map(|p| *placement.stretch() * p.as_dvec3()).collect()
}

/// Whether anything covers some sample of each pixel; the target has `samples` by `samples` to a pixel.
fn coverage(target: &Target, samples: u32) -> Vec<bool> {
    let covered = |x: u32, y: u32| target.colour(x, y)[3] > 0.0;
    let any = |x: u32, y: u32| {
        (0..samples).any(|j| (0..samples).any(|i| covered(x * samples + i, y * samples + j)))
    };
    (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| (x, y))).map(|(x, y)| any(x, y)).collect()
}

/// Covered pixels of one image that have no covered pixel of the other within `reach`, and all.
fn uncovered(of: &[bool], by: &[bool], reach: i64) -> (usize, usize) {
    let [width, height] = SIZE.map(i64::from);
    let covered = |t: &[bool], x: i64, y: i64| {
        x >= 0 && y >= 0 && x < width && y < height && t[(y * width + x) as usize]
    };
    let near =
        |x: i64, y: i64| (-reach..=reach).any(|dy| (-reach..=reach).any(|dx| covered(by, x + dx, y + dy)));
    let missed = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let missed = missed.filter(|&(x, y)| covered(of, x, y) && !near(x, y)).count();
    (missed, of.iter().filter(|c| **c).count())
}

/// Mean difference of colour where both images are covered.
fn difference(a: &Target, b: &Target) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for (p, q) in a.colour_rows().flatten().zip(b.colour_rows().flatten()) {
        if p[3] > 0.0 && q[3] > 0.0 {
            sum += (0..3).map(|i| f64::from((p[i] - q[i]).abs())).sum::<f64>() / 3.0;
            count += 1;
        }
    }
    sum / f64::from(count.max(1))
}

#[test]
fn pictures_show_the_object_where_it_is_within_the_claimed_parallax() {
    let meshes = [aeroplane(16).unwrap()];
    let mut random = Random::new(91);
    let (mut drawn, mut worst) = (0, 0.0f64);
    for i in 0..24 {
        let uneven = if i % 3 == 0 { DVec3::new(1.0, 0.4, 2.5) } else { DVec3::ONE };
        let turn = DQuat::from_rotation_z(0.7 * f64::from(i)) * DQuat::from_rotation_x(0.2);
        let place = DAffine3::from_scale_rotation_translation(uneven, turn, DVec3::new(1e5, 2e4, 0.0));
        let objects = [object(&meshes[0], &place)];
        let bvh = Bvh::build(&[objects[0].bounds]).unwrap();
        let mut renderer = Renderer::new(&meshes, &objects, &bvh, DVec3::new(0.5, 0.6, -0.6).normalize());
        let Object { placement, bounds, .. } = &objects[0];
        let away = DVec3::new(1.0, random.unit() - 0.5, 0.3).normalize() * bounds.diagonal() * 1.6;
        let first = camera(bounds.center() + away, bounds.center());
        let mut options = ImpostorOptions::default();
        (options.depth, options.texels_per_px) = (i % 2 == 0, 2.0);
        let in_frame = placement.bounds(&meshes[0].bounds());
        let view = ImpostorView::new(placement, &in_frame, &points(&meshes[0], placement), &first, &options)
            .unwrap();
        let image = renderer.render(0, &view, placement, meshes[0].triangles()).unwrap();
        let step = (DVec3::from_array(random.units()) * 2.0 - 1.0) * bounds.diagonal() * 0.05;
        for (eye, still) in [(first.eye(), true), (first.eye() + step, false)] {
            let now = camera(eye, bounds.center());
            let claimed = view.parallax(placement, &now).value;
            assert!(!still || claimed < 1e-3);
            let (mut whole, mut picture) = (blank(), blank());
            renderer.draw_triangles(&mut whole, &now, 0, meshes[0].triangles());
            renderer.draw_picture(&mut picture, &now, 0, &view, &image);
            // A texel of two to the pixel, a pixel of rasterising on either side.
            let reach = claimed.ceil() as i64 + 1;
            let fine = now.with_image(4 * SIZE[0], 4 * SIZE[1]).unwrap();
            let mut finer =
                Target::new(4 * SIZE[0], 4 * SIZE[1], Outputs { id: false, ..Outputs::ALL }).unwrap();
            renderer.draw_triangles(&mut finer, &fine, 0, meshes[0].triangles());
            let (shown, seen) = (coverage(&picture, 1), coverage(&finer, 4));
            let (false_px, all) = uncovered(&shown, &seen, reach);
            assert_eq!(false_px, 0, "{i}: {false_px} of {all} pixels are beyond {claimed:.2} px");
            // Of what is thinner than a texel, the picture may have holes; of what is not seen from the old eye, too.
            let (lost, all) = uncovered(&coverage(&whole, 1), &shown, reach + 1);
            assert!(lost * 100 <= all, "{i}: {lost} of {all} lost, {claimed:.2} px");
            if still {
                let off = difference(&whole, &picture);
                worst = worst.max(off);
                assert!(off < 0.04, "{i}: {off}");
            }
            drawn += all;
        }
    }
    println!("{drawn} pixels; mean difference of colour from the same eye at most {worst:.4}");
    assert!(drawn > 30_000);
}

#[test]
fn pictures_with_depth_let_others_stand_between() {
    // A ring lies flat; a post stands in it, beyond its middle: behind the near half, before the far half.
    let ring = {
        let (n, m) = (48u32, 12u32);
        let at = |i: u32, j: u32| {
            let (a, b) =
                (std::f32::consts::TAU * i as f32 / n as f32, std::f32::consts::TAU * j as f32 / m as f32);
            Vec3::new((2.0 + 0.3 * b.cos()) * a.cos(), (2.0 + 0.3 * b.cos()) * a.sin(), 0.3 * b.sin())
        };
        let positions = (0..n).flat_map(|i| (0..m).map(move |j| at(i, j))).collect();
        let index = |i: u32, j: u32| (i % n) * m + j % m;
        let squares = (0..n).flat_map(|i| {
            (0..m).flat_map(move |j| {
                [
                    [index(i, j), index(i + 1, j), index(i + 1, j + 1)],
                    [index(i, j), index(i + 1, j + 1), index(i, j + 1)],
                ]
            })
        });
        TriangleMesh::new(positions, squares.collect()).unwrap()
    };
    let post = TriangleMesh::new(
        vec![
            Vec3::new(0.0, -0.3, -3.0),
            Vec3::new(0.0, 0.3, -3.0),
            Vec3::new(0.0, 0.3, 3.0),
            Vec3::new(0.0, -0.3, 3.0),
        ],
        vec![[0, 1, 2], [0, 2, 3]],
    )
    .unwrap();
    let red = vec![[255, 0, 0, 255]; 4];
    let meshes = [ring, post.with_colours(red).unwrap()];
    let aside = DAffine3::from_translation(DVec3::X * -1.2);
    let mut objects = [object(&meshes[0], &DAffine3::IDENTITY), object(&meshes[1], &aside)];
    objects[1].model = 1;
    let bvh = Bvh::build(&objects.each_ref().map(|o| o.bounds)).unwrap();
    let mut renderer = Renderer::new(&meshes, &objects, &bvh, DVec3::NEG_Z);
    let camera = camera(DVec3::new(9.0, 0.0, 2.5), DVec3::ZERO);
    let placement = &objects[0].placement;
    let bounds = placement.bounds(&meshes[0].bounds());
    let mut wrong = [0; 2];
    for (with_depth, wrong) in [false, true].into_iter().zip(&mut wrong) {
        let mut options = ImpostorOptions::default();
        options.depth = with_depth;
        let view =
            ImpostorView::new(placement, &bounds, &points(&meshes[0], placement), &camera, &options).unwrap();
        let separable = farsight_lod::is_separable(&bvh, &view.slab(placement), 0, |_| false);
        assert!(!separable, "the post is in the way");
        let image = renderer.render(0, &view, placement, meshes[0].triangles()).unwrap();
        let (mut whole, mut pictures) = (blank(), blank());
        for target in [&mut whole, &mut pictures] {
            renderer.draw_triangles(target, &camera, 1, meshes[1].triangles());
        }
        let post_only = pictures.clone();
        renderer.draw_triangles(&mut whole, &camera, 0, meshes[0].triangles());
        renderer.draw_picture(&mut pictures, &camera, 0, &view, &image);
        let is_post = |t: &Target, x: u32, y: u32| {
            t.colour(x, y) == post_only.colour(x, y) && post_only.colour(x, y)[3] > 0.0
        };
        for y in 0..SIZE[1] {
            *wrong += (0..SIZE[0]).filter(|&x| is_post(&whole, x, y) != is_post(&pictures, x, y)).count();
        }
    }
    println!("pixels with the wrong one in front: {} without depth, {} with", wrong[0], wrong[1]);
    assert!(wrong[0] > 60 && wrong[1] * 5 < wrong[0], "{wrong:?}");
}

/// A texture of six patches, each its own colour with fine stripes.
fn patches() -> MipMap {
    let side = 192;
    let texel = |x: u32, y: u32| {
        let patch = x * 3 / side + 3 * (y * 2 / side);
        let base =
            [[220, 60, 50], [60, 180, 75], [60, 90, 220], [230, 200, 40], [150, 60, 190], [40, 190, 200]];
        let [r, g, b] = base[patch as usize];
        let shade = |c: u8| if (x / 4 + y / 4).is_multiple_of(2) { c } else { c / 4 * 3 };
        [shade(r), shade(g), shade(b), 255]
    };
    let texels = (0..side).flat_map(|y| (0..side).map(move |x| (x, y))).map(|(x, y)| texel(x, y)).collect();
    MipMap::new(&Texture::new(side, side, texels).unwrap())
}

/// A ball whose cube's faces are charts in a 3 x 2 atlas.
fn atlas(n: u32) -> TriangleMesh {
    let ball = hard_cases::bumpy_ball(n);
    let (mut positions, mut uvs, mut triangles) = (vec![], vec![], vec![]);
    let mut known = std::collections::HashMap::new();
    for t in ball.triangles() {
        let center: Vec3 = t.iter().map(|&v| ball.positions()[v as usize].normalize()).sum();
        let axis = center.abs().max_position();
        let face = 2 * axis + usize::from(center[axis] < 0.0);
        let mut corner = |v: u32| {
            *known.entry((face, v)).or_insert_with(|| {
                let p = ball.positions()[v as usize];
                let on_cube = p / p[axis].abs();
                let local = Vec2::new(on_cube[(axis + 1) % 3], on_cube[(axis + 2) % 3]) * 0.48 + 0.5;
                positions.push(p);
                uvs.push((local + Vec2::new((face % 3) as f32, (face / 3) as f32)) / Vec2::new(3.0, 2.0));
                positions.len() as u32 - 1
            })
        };
        triangles.push([corner(t[0]), corner(t[1]), corner(t[2])]);
    }
    TriangleMesh::new(positions, triangles).unwrap().with_uvs(uvs).unwrap()
}

fn textured(mesh: &TriangleMesh, triangles: &[[u32; 3]], texture: &MipMap, camera: &Camera) -> Target {
    let mut target = blank();
    let uvs = mesh.uvs().unwrap();
    let clip = camera.clip_from_relative_f64(ClipConvention::REVERSED, camera.eye())
        * DMat4::from_translation(-camera.eye());
    let draw =
        Draw { positions: mesh.positions(), triangles, clip_from_local: clip, state: State::default() };
    Rasteriser::new().draw_shaded(&mut target, &draw, &|f: &Fragment| -> Option<Vec4> {
        let w = f.weights();
        let [a, b, c] = triangles[f.triangle as usize].map(|v| uvs[v as usize]);
        Some(texture.sample(a * w.x + b * w.y + c * w.z, 0.0).truncate().extend(1.0))
    });
    target
}

#[test]
fn textures_stay_in_their_charts_on_reduced_meshes() {
    let (mesh, texture) = (atlas(24), patches());
    let plain = VertexHierarchy::build(&mesh).unwrap();
    let hierarchy = VertexHierarchy::build_textured(&mesh).unwrap();
    let extended = hierarchy.with_seam_vertices(&mesh).unwrap();
    let (mut naive, mut kept) = (0.0, 0.0);
    for i in 0..6 {
        let (sin, cos) = (1.1 * f64::from(i)).sin_cos();
        let camera = camera(DVec3::new(cos, sin, 0.4) * 3.0, DVec3::ZERO);
        let whole = textured(&mesh, mesh.triangles(), &texture, &camera);
        let observer = Observer::in_object(camera.eye());
        let tolerance = Tolerance::uniform(0.1);
        let (mut a, mut b) = (Cut::new(&plain), Cut::new(&hierarchy));
        a.update(&plain, &observer, &tolerance).unwrap();
        b.update(&hierarchy, &observer, &tolerance).unwrap();
        assert!(b.triangles().len() * 3 < mesh.triangles().len());
        naive += difference(&whole, &textured(&mesh, a.triangles(), &texture, &camera)) / 6.0;
        kept += difference(&whole, &textured(&extended, b.triangles(), &texture, &camera)) / 6.0;
    }
    println!(
        "mean difference of colour: own coordinates of the vertices {naive:.4}, those of the charts {kept:.4}"
    );
    assert!(kept < 0.8 * naive, "{kept} {naive}");
}
