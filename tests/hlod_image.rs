//! Hierarchies drawn beside their input: nothing moves by more than it may, and there are no holes.

use farsight_geometry::distance::closest_on_triangle;
use farsight_geometry::glam::{DVec3, Vec3, dvec3};
use farsight_geometry::scene::{Light, Material, Scene};
use farsight_geometry::{Camera, ClipConvention, TriangleMesh, hard_cases};
use farsight_hlod::{
    BuildOptions, HlodError, NodeMesh, Selection, Selector, Store, Tier, ViewOptions, build, no_progress,
};
use farsight_raster::scenes::vertex_normals;
use farsight_raster::{
    Draw, LineDraw, Outputs, Part, Rasteriser, RenderOptions, Side, State, Target, render_scene,
};

/// Side of the pictures.
const SIDE: u32 = 800;
/// Pixels of a picture along a side of a pixel that errors are counted in: coverage is sampled more finely than it is promised.
const FINE: u32 = 4;

/// A ball with bumps and wrinkles.
fn ball(n: u32) -> TriangleMesh {
    let ball = hard_cases::bumpy_ball(n);
    let wrinkled = |p: &Vec3| *p * (1.0 + 0.02 * (23.0 * p.x + 9.0 * p.y).sin() * (19.0 * p.z).cos());
    TriangleMesh::new(ball.positions().iter().map(wrinkled).collect(), ball.triangles().to_vec()).unwrap()
}

/// An open, uneven sheet.
fn terrain(n: u32) -> TriangleMesh {
    let at = |i: u32| i as f32 / n as f32 * 2.0 - 1.0;
    let height =
        |x: f32, y: f32| 0.1 * (5.0 * x).sin() * (4.0 * y).cos() + 0.02 * (31.0 * x + 17.0 * y).sin();
    let p = (0..=n).flat_map(|j| (0..=n).map(move |i| (at(i), at(j))));
    let p = p.map(|(x, y)| Vec3::new(x, y, height(x, y))).collect();
    let row = n + 1;
    let t = (0..n).flat_map(|j| (0..n).map(move |i| j * row + i));
    let t = t.flat_map(|a| [[a, a + 1, a + row + 1], [a, a + row + 1, a + row]]).collect();
    TriangleMesh::new(p, t).unwrap()
}

fn with_normals(mesh: TriangleMesh) -> TriangleMesh {
    let normals = vertex_normals(&mesh);
    mesh.with_normals(normals).unwrap()
}

fn store(name: &str, mesh: &TriangleMesh, tier: Tier) -> Store {
    let path = std::env::temp_dir().join(format!("farsight-hlod-image-{}-{name}.hlod", std::process::id()));
    let options = BuildOptions::default().with_most_triangles(1000).with_tier(tier);
    build([Ok::<_, HlodError>(mesh)], &path, &options, &no_progress).unwrap();
    let store = Store::from_bytes(std::fs::read(&path).unwrap()).unwrap();
    std::fs::remove_file(&path).unwrap();
    store
}

fn draw(target: &mut Target, camera: &Camera, mesh: &TriangleMesh, rims: Option<&[[u32; 2]]>) {
    let clip = camera.clip_from_relative_f64(ClipConvention::REVERSED, mesh.origin());
    let state = State::default();
    let (positions, triangles) = (mesh.positions(), mesh.triangles());
    let mut r = Rasteriser::new();
    r.draw(target, &Draw { positions, triangles, clip_from_local: clip, state });
    if let Some(rims) = rims {
        let segments: Vec<[Vec3; 2]> = rims.iter().map(|r| r.map(|v| positions[v as usize])).collect();
        let colour = farsight_geometry::glam::Vec4::ONE;
        r.draw_lines(
            target,
            &LineDraw { segments: &segments, colour, width_px: FINE, clip_from_local: clip, state },
        );
    }
}

fn covered(t: &Target) -> Vec<bool> {
    t.ids().map(|id| id != 0).collect()
}

/// Distance of a pixel's centre to the picture of some triangles.
fn distance_px(camera: &Camera, meshes: &[TriangleMesh], pixel: i32) -> f64 {
    let at = dvec3(f64::from(pixel % SIDE as i32) + 0.5, f64::from(pixel / SIDE as i32) + 0.5, 0.0);
    let mut best = f64::INFINITY;
    for m in meshes {
        for corners in m.corner_iter() {
            let px = corners.map(|p| camera.project(m.origin() + p.as_dvec3()).unwrap().0.extend(0.0));
            best = best.min(closest_on_triangle(px, at).distance(at));
        }
    }
    best
}

/// Pixels of `a` without a pixel of `b` within a distance (that of their centres).
fn farther_than(a: &[bool], b: &[bool], px: f64) -> Vec<i32> {
    let reach = px.ceil() as i32;
    let side = SIDE as i32;
    let near = |x: i32, y: i32| {
        (-reach..=reach).any(|dy| {
            (-reach..=reach).any(|dx| {
                let (x, y) = (x + dx, y + dy);
                f64::from(dx * dx + dy * dy).sqrt() <= px
                    && (0..side).contains(&x)
                    && (0..side).contains(&y)
                    && b[(y * side + x) as usize]
            })
        })
    };
    (0..side * side).filter(|&i| a[i as usize] && !near(i % side, i / side)).collect()
}

/// Pixels of a fine picture that an outline may have moved by, for an error in pixels.
fn margin(claim: f64) -> i32 {
    6.max((claim * f64::from(FINE)).ceil() as i32 + 1)
}

/// Uncovered pixels of `b` farther inside what `a` covers than its outline may have moved.
fn holes(a: &[bool], b: &[bool], margin: i32) -> usize {
    let side = SIDE as i32;
    let inside = |x: i32, y: i32| {
        (-margin..=margin).all(|dy| {
            (-margin..=margin).all(|dx| {
                let (x, y) = (x + dx, y + dy);
                !(0..side).contains(&x) || !(0..side).contains(&y) || a[(y * side + x) as usize]
            })
        })
    };
    (0..side * side).filter(|&i| !b[i as usize] && inside(i % side, i / side)).count()
}

fn cameras() -> Vec<Camera> {
    let eyes = [
        dvec3(0.3, -4.0, 1.0),
        dvec3(2.0, 1.5, 1.6),
        dvec3(-1.1, -0.9, 0.9),
        dvec3(-8.0, 14.0, 6.0),
        dvec3(0.1, -1.6, 0.5),
    ];
    let at = |eye| Camera::look_at(eye, DVec3::ZERO, DVec3::Z).unwrap();
    eyes.map(|eye| at(eye).with_range(0.05, 100.0).unwrap().with_image(SIDE / FINE, SIDE / FINE).unwrap())
        .into()
}

#[test]
fn nothing_moves_too_far_and_nothing_is_left_open() {
    for (name, mesh, tier) in [
        ("ball", ball(48), Tier::Guaranteed),
        ("verified ball", ball(48), Tier::Verified),
        ("terrain", terrain(140), Tier::Guaranteed),
        ("terrain with normals", with_normals(terrain(100)), Tier::Verified),
    ] {
        let store = store(name, &mesh, tier);
        let (mut selector, mut selection) = (Selector::new(), Selection::default());
        for (view, camera) in cameras().iter().enumerate() {
            let fine = camera.with_image(SIDE, SIDE).unwrap();
            let mut full = Target::new(SIDE, SIDE, Outputs::DEPTH_ID).unwrap();
            draw(&mut full, &fine, &mesh, None);
            let full = covered(&full);
            for error_px in [0.5, 2.0, 6.0] {
                selector.select(
                    store.tree(),
                    camera,
                    &ViewOptions::error(error_px),
                    |_| true,
                    &mut selection,
                );
                let claim = selection.geometric.unwrap().value;
                let mut target = Target::new(SIDE, SIDE, Outputs::DEPTH_ID).unwrap();
                let mut bare = Target::new(SIDE, SIDE, Outputs::DEPTH_ID).unwrap();
                let mut parts = Vec::new();
                for d in &selection.drawn {
                    let mut node = NodeMesh::default();
                    store.read(d.node, farsight_hlod::Mesh::Full, &mut node).unwrap();
                    let part = node.to_mesh().unwrap();
                    draw(&mut target, &fine, &part, Some(&node.rims));
                    draw(&mut bare, &fine, &part, None);
                    parts.push(part);
                }
                let (simple, bare) = (covered(&target), covered(&bare));
                let case = format!(
                    "{name} view {view} at {error_px} px: {} triangles in {} nodes, claim {claim:.3}",
                    selection.triangles,
                    selection.drawn.len()
                );
                let [left, without] = [&simple, &bare].map(|drawn| holes(&full, drawn, margin(claim)));
                println!("{case}, holes {left} without rims {without}");
                // A pixel is covered when its centre is: either picture may round by half a diagonal, twice that at a thin part.
                let reach = claim * f64::from(FINE) + 1.5 * std::f64::consts::SQRT_2;
                for (seen, other, drawn) in
                    [(&full, &simple, &parts[..]), (&bare, &full, std::slice::from_ref(&mesh))]
                {
                    // What no pixel near by covers may be a tip too thin for pixels: measured exactly.
                    for pixel in farther_than(seen, other, reach) {
                        let off = distance_px(&fine, drawn, pixel);
                        assert!(off <= claim * f64::from(FINE) + 0.75, "{case}: pixel {pixel} is {off} off");
                    }
                }
                assert_eq!(left, 0, "{case}: holes");
            }
        }
    }
}

#[test]
fn parts_of_a_scene_leave_no_holes_and_no_specks() {
    let mesh = ball(48);
    let store = store("parts", &mesh, Tier::Verified);
    let mut scene = Scene::of_mesh(mesh.clone());
    let direction = dvec3(0.4, 0.5, -0.8).normalize();
    scene
        .add_light(Light::Directional { direction, irradiance: Vec3::splat(2.5), angular_radius: 0.0 })
        .unwrap();
    assert!(scene.materials().is_empty() && Material::default().two_sided);
    let (mut selector, mut selection) = (Selector::new(), Selection::default());
    for (view, camera) in cameras().iter().enumerate() {
        let draw = |parts: &[Part], forms: &[Option<&[[u32; 3]]>], outputs: Outputs| {
            let mut options = RenderOptions::default();
            (options.supersampling, options.sky, options.parts, options.forms) = (1, None, parts, forms);
            options.outputs = outputs;
            let fine = camera.with_image(SIDE, SIDE).unwrap();
            render_scene(&mut Rasteriser::new(), &scene, &fine, &options).unwrap().0
        };
        let whole = draw(&[], &[], Outputs::ALL);
        for error_px in [0.5, 2.0] {
            selector.select(store.tree(), camera, &ViewOptions::error(error_px), |_| true, &mut selection);
            let nodes: Vec<(TriangleMesh, Vec<Side>)> = selection
                .drawn
                .iter()
                .map(|d| {
                    let mut node = NodeMesh::default();
                    store.read(d.node, farsight_hlod::Mesh::Full, &mut node).unwrap();
                    let mesh = node.to_mesh().unwrap();
                    let sides = Side::between(&mesh, &node.rims);
                    assert_eq!(sides.len(), node.rims.len());
                    (mesh, sides)
                })
                .collect();
            for cull_backs in [false, true] {
                let part = |(mesh, sides)| Part { instance: 0, mesh, sides, width_px: FINE, cull_backs };
                let parts: Vec<Part> = nodes.iter().map(|(m, s)| part((m, &s[..]))).collect();
                let nothing: [Option<&[[u32; 3]]>; 1] = [Some(&[])];
                let drawn = draw(&parts, &nothing, Outputs::ALL);
                let case = format!("view {view} at {error_px} px, backs culled: {cull_backs}");
                let margin = margin(selection.geometric.unwrap().value);
                assert_eq!(holes(&covered(&whole), &covered(&drawn), margin), 0, "{case}");
                // What is far from an edge of the picture has about the colour it had: flat triangles a little larger, and no slivers that catch the light.
                let grey = |t: &Target, i: usize| {
                    t.colour((i % SIDE as usize) as u32, (i / SIDE as usize) as u32)[1]
                };
                let (a, b) = (covered(&whole), covered(&drawn));
                let both: Vec<usize> = (0..a.len()).filter(|&i| a[i] && b[i]).collect();
                let off = both.iter().filter(|&&i| (grey(&whole, i) - grey(&drawn, i)).abs() > 0.2).count();
                let share = off as f64 / both.len().max(1) as f64;
                println!(
                    "{case}: {} nodes, {:.3} % of {} pixels off",
                    parts.len(),
                    100.0 * share,
                    both.len()
                );
                assert!(share < 0.02, "{case}: {share}");
            }
        }
    }
}
