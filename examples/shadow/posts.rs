//! A plain with posts, bars and a wall at all distances, so that shadow edges are there to be judged near, in the middle and far away.

use farsight_geometry::glam::{DAffine3, DVec3, Vec3, dvec3};
use farsight_geometry::scene::{Instance, Light, Scene};
use farsight_geometry::{Camera, CameraError, DAabb, TriangleMesh};

/// Distances of the groups from the camera.
pub const GROUPS: [f64; 7] = [3.0, 8.0, 20.0, 45.0, 90.0, 180.0, 320.0];

/// The scene. The sun is `elevation` degrees high and shines towards `azimuth` degrees from the view (0: along it).
pub fn scene(elevation: f64, azimuth: f64) -> Scene {
    let mut scene = Scene::new();
    add(&mut scene, &plain(600.0, 24));
    for (i, x) in GROUPS.into_iter().enumerate() {
        // Each group looks about as large as the one before.
        let size = 0.12 * x;
        let y = if i % 2 == 0 { 0.22 * x } else { -0.22 * x };
        for k in 0..4 {
            let at = y + (f64::from(k) - 1.5) * 0.35 * size;
            let half = dvec3(0.04, 0.04, 0.0) * size;
            add(&mut scene, &block(dvec3(x, at, 0.0) - half, dvec3(x, at, size) + half));
        }
        let bar = dvec3(0.03, 0.7, 0.04) * size;
        add(&mut scene, &block(dvec3(x, y, 0.8 * size) - bar, dvec3(x, y, 0.8 * size) + bar));
    }
    let (e, a) = (elevation.to_radians(), azimuth.to_radians());
    let direction = dvec3(e.cos() * a.cos(), e.cos() * a.sin(), -e.sin()).normalize();
    let light = Light::Directional { direction, irradiance: Vec3::splat(2.4), angular_radius: 0.0 };
    scene.add_light(light).expect("the sun is valid");
    scene
}

/// The camera that looks along the groups.
pub fn camera(width: u32, height: u32) -> Result<Camera, CameraError> {
    Camera::look_at(dvec3(0.0, 0.0, 1.7), dvec3(10.0, 0.0, 0.4), DVec3::Z)?
        .with_image(width, height)?
        .with_range(0.5, 600.0)
}

fn add(scene: &mut Scene, mesh: &TriangleMesh) {
    let mesh = scene.add_mesh(mesh.clone());
    let instance =
        Instance { mesh, world_from_mesh: DAffine3::IDENTITY, material: None, name: String::new() };
    scene.add_instance(instance).expect("the instance is valid");
}

fn plain(side: f64, cells: u32) -> TriangleMesh {
    let at = |i: u32| (f64::from(i) / f64::from(cells) - 0.2) * side;
    let points = (0..=cells).flat_map(|j| {
        (0..=cells).map(move |i| dvec3(at(i), (f64::from(j) / f64::from(cells) - 0.5) * side, 0.0).as_vec3())
    });
    let cell = |i: u32, j: u32| {
        let a = j * (cells + 1) + i;
        [[a, a + 1, a + cells + 2], [a, a + cells + 2, a + cells + 1]]
    };
    let triangles = (0..cells).flat_map(|j| (0..cells).flat_map(move |i| cell(i, j))).collect();
    TriangleMesh::new(points.collect(), triangles).expect("the plain is valid")
}

/// A closed box with its faces outward.
pub fn block(min: DVec3, max: DVec3) -> TriangleMesh {
    let corners = DAabb::new(min, max).corners().map(|c| c.as_vec3());
    let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    TriangleMesh::new(corners.to_vec(), triangles).expect("the block is valid")
}
