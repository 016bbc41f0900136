//! Attacks on what an impostor claims, in world coordinates and by other means: lines through the corners of its quad.

use super::*;
use farsight_geometry::sampling::{Random, on_triangle};
use farsight_geometry::{TriangleMesh, hard_cases};
use glam::Vec3;

fn unit(random: &mut Random) -> DVec3 {
    loop {
        let v = DVec3::from_array(random.units()) * 2.0 - 1.0;
        if v.length() > 0.1 && v.length() < 1.0 {
            return v.normalize();
        }
    }
}

/// A mesh somewhere in the world, seen from one eye to make an impostor and by a camera at another.
struct Pose {
    place: DAffine3,
    placement: Placement,
    eye: DVec3,
    camera: Camera,
    view: ImpostorView,
}

fn place_of(random: &mut Random, mesh: &TriangleMesh, size: f64, i: usize) -> DAffine3 {
    let turn = DMat3::from_quat(DQuat::from_axis_angle(unit(random), 6.0 * random.unit()));
    let uneven = DVec3::from_array(random.units()) * 2.0 + 0.05;
    let shape = match i % 4 {
        0 => DMat3::IDENTITY,
        1 => DMat3::from_diagonal(uneven),
        2 => DMat3::from_diagonal(uneven * DVec3::new(1.0, -1.0, 1.0)),
        // Stretched along no axis of its own.
        _ => {
            let lean = DMat3::from_quat(DQuat::from_axis_angle(unit(random), 3.0 * random.unit()));
            lean * DMat3::from_diagonal(uneven) * lean.transpose()
        }
    };
    let at = unit(random) * size * [0.0, 1.0, 1e3, 1e6][i / 4 % 4];
    DAffine3 { matrix3: turn * shape, translation: at - turn * shape * mesh.origin() }
}

/// Corners of a mesh's triangles as the impostor takes them.
fn rigid_points(mesh: &TriangleMesh, placement: &Placement) -> Vec<DVec3> {
    mesh.corner_iter().flatten().map(|p| *placement.stretch() * p.as_dvec3()).collect()
}

fn pose(random: &mut Random, mesh: &TriangleMesh, i: usize) -> Option<Pose> {
    let size = f64::from(mesh.bounds().diagonal()).max(1e-30);
    let place = place_of(random, mesh, size, i);
    let placement = Placement::new(&place, mesh.origin()).ok()?;
    let bounds = placement.bounds(&mesh.bounds());
    let reach = bounds.diagonal().max(1e-30);
    let center = placement.to_world(bounds.center());
    let eye = center + unit(random) * reach * (0.5 + 20.0 * random.unit().powi(3));
    let step = unit(random) * reach * 10f64.powf(-4.0 * random.unit());
    let target = center + unit(random) * reach * 2.0 * random.unit();
    let camera = Camera::look_at(eye + step, target, unit(random)).ok()?;
    let fov_y = 0.2 + 1.5 * random.unit();
    let camera =
        camera.with_projection(Projection::Perspective { fov_y }).ok()?.with_image(1920, 1080).ok()?;
    let points = rigid_points(mesh, &placement);
    let options = ImpostorOptions { max_side: u32::MAX, ..ImpostorOptions::default() };
    let first =
        Camera::new(eye, camera.world_from_view()).and_then(|c| c.with_projection(camera.projection()));
    let first = first.and_then(|c| c.with_image(1920, 1080)).ok()?;
    let view = ImpostorView::new(&placement, &bounds, &points, &first, &options).ok()?;
    Some(Pose { place, placement, eye, camera, view })
}

/// The quad's plane by its corners in the world, met by the line from the eye through a point.
fn on_quad(quad: &[DVec3; 4], eye: DVec3, point: DVec3) -> DVec3 {
    let normal = (quad[1] - quad[0]).cross(quad[3] - quad[0]).normalize();
    let ray = point - eye;
    let middle = 0.5 * (quad[0] + quad[2]);
    eye + ray * (normal.dot(middle - eye) / normal.dot(ray))
}

/// The first point of a mesh on a ray: every triangle in turn, in the mesh's own coordinates.
fn first_hit(mesh: &TriangleMesh, pose: &Pose, towards: DVec3) -> Option<DVec3> {
    let inverse = pose.place.inverse();
    let local = |p: DVec3| inverse.transform_point3(p) - mesh.origin();
    let origin = local(pose.eye);
    let direction = local(towards) - origin;
    let hit = |c: [Vec3; 3]| {
        let [a, b, c] = c.map(|p| p.as_dvec3());
        let (ab, ac) = (b - a, c - a);
        let p = direction.cross(ac);
        let det = ab.dot(p);
        let s = origin - a;
        let (u, q) = (s.dot(p) / det, s.cross(ab));
        let v = direction.dot(q) / det;
        let t = ac.dot(q) / det;
        (det != 0.0 && u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0).then(|| (t, a + ab * u + ac * v))
    };
    let first = mesh.corner_iter().filter_map(hit).min_by(|a, b| a.0.total_cmp(&b.0));
    first.map(|(_, p)| pose.place.transform_point3(mesh.origin() + p))
}

fn in_image(camera: &Camera, p: DVec2) -> bool {
    p.x >= 0.0 && p.y >= 0.0 && p.x <= f64::from(camera.width()) && p.y <= f64::from(camera.height())
}

/// Where the camera sees a point and where it sees its image, if either is in the picture: their distance.
fn shift(camera: &Camera, point: DVec3, image: DVec3) -> Option<f64> {
    let (a, _) = camera.project(point)?;
    let (b, _) = camera.project(image)?;
    (in_image(camera, a) || in_image(camera, b)).then(|| a.distance(b))
}

#[test]
fn nothing_shown_is_farther_off_than_claimed() {
    let mut random = Random::new(41);
    let meshes: Vec<_> = hard_cases::meshes().into_iter().filter(|m| !m.mesh.is_empty()).collect();
    let (mut poses, mut samples, mut texels, mut bounded) = (0, 0, 0, 0);
    let mut tightness = Vec::new();
    for i in 0.. {
        if bounded >= 100_000 {
            break;
        }
        let hard = &meshes[i % meshes.len()];
        let mesh = &hard.mesh;
        let Some(pose) = pose(&mut random, mesh, i / meshes.len()) else { continue };
        poses += 1;
        let claimed = pose.view.parallax(&pose.placement, &pose.camera).value;
        if claimed.is_infinite() {
            continue;
        }
        bounded += 1;
        let quad = pose.view.corners().map(|c| pose.placement.to_world(c));
        let mut most = 0.0f64;
        let mut check = |point: DVec3, image: DVec3| {
            if let Some(shift) = shift(&pose.camera, point, image) {
                samples += 1;
                most = most.max(shift);
                assert!(shift <= claimed, "{}, pose {i}: {shift:e} px, claimed {claimed:e}", hard.name);
            }
        };
        for _ in 0..4 {
            // Points of the surface, corners among them.
            let t = random.below(mesh.triangles().len() as u64) as usize;
            let corners = mesh.corners(t).map(|p| pose.place.transform_point3(mesh.origin() + p.as_dvec3()));
            let point = match random.below(2) {
                0 => corners[random.below(3) as usize],
                _ => on_triangle(corners, random.units()),
            };
            check(point, on_quad(&quad, pose.eye, point));
        }
        if i % 4 == 0 {
            // What a texel shows.
            let [width, height] = pose.view.size();
            let at = [random.below(width.into()) as u32, random.below(height.into()) as u32];
            let texel = pose.placement.to_world(pose.view.texel_center(at[0], at[1]));
            if let Some(point) = first_hit(mesh, &pose, texel) {
                texels += 1;
                check(point, texel);
            }
        }
        // Where rounding far from the origin is most of the claim, tightness says nothing.
        if claimed > 1e-3 && most > 0.0 {
            tightness.push(most / claimed);
        }
    }
    tightness.sort_by(f64::total_cmp);
    let median = tightness[tightness.len() / 2];
    println!(
        "{poses} poses, {bounded} with a bound, {samples} points, {texels} texels; median of measured over claimed {median:.3}"
    );
    assert!(samples > 300_000 && texels > 10_000);
    assert!(median > 0.2 && tightness[tightness.len() - 1] > 0.8);
}

#[test]
fn pictures_hold_all_that_is_drawn_and_are_the_smallest() {
    let mut random = Random::new(42);
    let meshes: Vec<_> = hard_cases::meshes().into_iter().filter(|m| !m.mesh.is_empty()).collect();
    let mut tried = 0;
    for i in 0..6000 {
        let mesh = &meshes[i % meshes.len()].mesh;
        let Some(pose) = pose(&mut random, mesh, i / meshes.len()) else { continue };
        tried += 1;
        let view = &pose.view;
        let [width, height] = view.size().map(f64::from);
        for convention in ClipConvention::all() {
            let clip = view.clip_from_mesh(&pose.placement, convention);
            for p in mesh.corner_iter().flatten().take(30) {
                let c = clip * p.as_dvec3().extend(1.0);
                let y = if convention.y_down { c.y } else { -c.y };
                let at = DVec2::new((c.x / c.w + 1.0) * 0.5 * width, (y / c.w + 1.0) * 0.5 * height);
                // The gutter stays empty.
                let gutter = DVec2::ONE * (1.0 - 1e-3);
                let inside = at.cmpge(gutter).all() && at.cmple(DVec2::new(width, height) - gutter).all();
                assert!(
                    inside && c.w > 0.0,
                    "{}: {at} of {width} x {height} {view:?}",
                    meshes[i % meshes.len()].name
                );
                let (near, far) = convention.near_far_depth();
                let depth = c.z / c.w;
                assert!(depth >= near.min(far) && depth <= near.max(far));
                // Depth gives back where the point is.
                let rigid = *pose.placement.stretch() * p.as_dvec3();
                let height_above = view.normal().dot(rigid - view.texel_center(0, 0));
                let found = view.height_of_depth(depth, convention);
                let size = view.bounds().diagonal() + view.eye().length();
                assert!((found - height_above).abs() <= 1e-8 * size, "{found} {height_above}");
            }
        }
        if i % 20 == 0 {
            let corners = view.corners();
            let texel = 0.5 * view.texel;
            let area = (view.max - view.min - 2.0 * texel).max(DVec2::ZERO).element_product();
            let flat = rigid_points(mesh, &pose.placement).into_iter().map(|p| {
                let q = on_quad(&corners, view.eye(), p) - view.bounds().center();
                DVec2::new(q.dot(view.axes.x_axis), q.dot(view.axes.y_axis))
            });
            let flat: Vec<DVec2> = flat.collect();
            for k in 0..180 {
                let d = DVec2::from_angle(f64::from(k).to_radians());
                let start = (DVec2::INFINITY, DVec2::NEG_INFINITY);
                let (min, max) = flat.iter().fold(start, |(min, max), p| {
                    let q = DVec2::new(d.dot(*p), d.perp_dot(*p));
                    (min.min(q), max.max(q))
                });
                assert!((max - min).element_product() >= area * (1.0 - 1e-9));
            }
        }
    }
    assert!(tried > 3000);
}

#[test]
fn a_static_eye_sees_no_parallax_and_the_texels_asked_for() {
    let mesh = hard_cases::bumpy_ball(6);
    let placement = Placement::new(&DAffine3::IDENTITY, mesh.origin()).unwrap();
    let bounds = placement.bounds(&mesh.bounds());
    let camera = |x: f64| Camera::look_at(DVec3::X * x, DVec3::ZERO, DVec3::Z).unwrap();
    let options = ImpostorOptions { texels_per_px: 2.0, depth: true, ..ImpostorOptions::default() };
    let points = rigid_points(&mesh, &placement);
    let made = |x: f64, options: &ImpostorOptions| {
        ImpostorView::new(&placement, &bounds, &points, &camera(x), options)
    };
    let view = made(9.0, &options).unwrap();
    assert!(view.parallax(&placement, &camera(9.0)).value < 1e-9);
    assert!((view.texel_px(DVec3::X * 9.0, &camera(9.0)) - 0.5).abs() < 1e-12);
    // Half as far: twice as coarse, though hardly any line of sight has turned.
    let near = view.texel_px(DVec3::X * 4.5, &camera(4.5));
    assert!(
        (near - 1.0).abs() < 0.05 && crate::corner_angle(&bounds, DVec3::X * 9.0, DVec3::X * 4.5) < 0.3,
        "{near}"
    );
    // A zoom turns nothing at all, and is seen.
    let zoomed = camera(9.0).with_projection(Projection::Perspective { fov_y: 0.1 }).unwrap();
    assert!(view.texel_px(DVec3::X * 9.0, &zoomed) > 5.0 && view.parallax(&placement, &zoomed).value < 1e-8);
    let other = Placement::new(&DAffine3::from_scale(DVec3::splat(1.01)), mesh.origin()).unwrap();
    assert!(view.parallax(&other, &camera(9.0)).value.is_infinite(), "another shape");
    let [w, h] = view.size();
    assert_eq!(view.bytes(), u64::from(w) * u64::from(h) * 8);
    assert!((view.resolution_ratio(&camera(9.0)) - f64::from(h) / 720.0).abs() < 1e-12 || w > h);

    let wide = ImpostorOptions { max_side: 1 << 20, ..options };
    assert_eq!(made(1.0, &wide), Err(LodError::TooNear));
    let small = ImpostorOptions { max_side: 16, ..options };
    assert!(matches!(made(9.0, &small), Err(LodError::Texture { most: 16, .. })));
    for bad in [
        ImpostorOptions { texels_per_px: f64::NAN, ..options },
        ImpostorOptions { gutter: 0, ..options },
        ImpostorOptions { max_side: 0, ..options },
    ] {
        assert!(matches!(made(9.0, &bad), Err(LodError::Option { .. })));
    }
    let flat = camera(9.0).with_projection(Projection::Orthographic { height: 4.0 }).unwrap();
    assert_eq!(ImpostorView::new(&placement, &bounds, &points, &flat, &options), Err(LodError::Parallel));
    assert_eq!(ImpostorView::new(&placement, &bounds, &[], &camera(9.0), &options), Err(LodError::Placement));
}
