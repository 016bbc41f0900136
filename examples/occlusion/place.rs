//! Scenes from files: z made the way up, meshes cut into objects, and where to look from.

#[path = "../tour/inside.rs"]
mod inside;

use farsight_geometry::glam::{DAffine3, DQuat, DVec3};
use farsight_geometry::ray::SceneCaster;
use farsight_geometry::scene::Instance;
use farsight_geometry::{Camera, Scene, TriangleMesh, io};
use serde::Deserialize;
use std::collections::HashMap;
use std::error::Error;
use std::path::Path;

/// Most triangles of an object that is cut from a larger mesh.
const OBJECT_TRIANGLES: usize = 256;
/// Places that are looked around from, and frames of a turn.
const MOST_PLACES: usize = 12;
const TURN: usize = 24;

/// Positions that a level's authors placed things at, in a file beside it.
#[derive(Deserialize)]
struct Stations {
    stations: Vec<Station>,
}

#[derive(Deserialize)]
struct Station {
    position: [f64; 3],
}

/// A loaded scene with z up, and cameras in it.
pub fn load(path: &Path, size: [u32; 2]) -> Result<(Scene, Vec<Camera>), Box<dyn Error>> {
    let loaded = io::load(path)?.into_scene().ok_or("the file holds points, no triangles")?;
    let scene = in_objects(&loaded, DAffine3::from_quat(upright()))?;
    let places = places(&scene, path)?;
    let bounds = scene.bounds();
    let far = 2.0 * bounds.diagonal().max(1e-3);
    let mut cameras = Vec::new();
    for place in &places {
        for i in 0..TURN {
            let (sin, cos) = (std::f64::consts::TAU * i as f64 / TURN as f64).sin_cos();
            let camera = Camera::look_at(*place, *place + DVec3::new(cos, sin, -0.05), DVec3::Z)?;
            cameras.push(camera.with_range(far * 1e-4, far)?.with_image(size[0], size[1])?);
        }
    }
    Ok((scene, cameras))
}

/// From y up to z up.
fn upright() -> DQuat {
    DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2)
}

/// Where the authors put things; else along a walk inside; else around the middle.
fn places(scene: &Scene, path: &Path) -> Result<Vec<DVec3>, Box<dyn Error>> {
    let beside = path.with_extension("stations.json");
    if beside.exists() {
        let file: Stations = serde_json::from_slice(&std::fs::read(&beside)?)?;
        let step = file.stations.len().div_ceil(MOST_PLACES).max(1);
        let place = |s: &Station| upright() * DVec3::from_array(s.position);
        return Ok(file.stations.iter().step_by(step).map(place).collect());
    }
    let bounds = scene.bounds();
    if let Some([from, to]) = inside::walkway(&SceneCaster::new(scene)?, &bounds, DVec3::Z) {
        return Ok((0..4).map(|i| from.lerp(to, f64::from(i) / 4.0)).collect());
    }
    let around = |i: u32| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / 4.0).sin_cos();
        bounds.center() + DVec3::new(0.3 * cos, 0.3 * sin, 0.1) * bounds.extent()
    };
    Ok((0..4).map(around).collect())
}

/// The scene moved by `world_from_loaded`, with large meshes that stand only once cut into objects.
fn in_objects(loaded: &Scene, world_from_loaded: DAffine3) -> Result<Scene, Box<dyn Error>> {
    let mut uses = vec![0; loaded.meshes().len()];
    loaded.instances().iter().for_each(|i| uses[i.mesh.0 as usize] += 1);
    let mut scene = Scene::new();
    let mut whole = HashMap::new();
    for instance in loaded.instances() {
        let mesh = loaded.mesh_of(instance);
        let cut = uses[instance.mesh.0 as usize] == 1 && mesh.triangles().len() > OBJECT_TRIANGLES;
        let ids = if cut {
            let mut order: Vec<u32> = (0..mesh.triangles().len() as u32).collect();
            let mut parts = Vec::new();
            halve(mesh, &mut order, &mut |part| parts.push(part_of(mesh, part)));
            parts
                .into_iter()
                .map(|part| Ok(scene.add_mesh(part?)))
                .collect::<Result<Vec<_>, Box<dyn Error>>>()?
        } else {
            vec![*whole.entry(instance.mesh.0).or_insert_with(|| scene.add_mesh(mesh.clone()))]
        };
        for mesh in ids {
            let world_from_mesh = world_from_loaded * instance.world_from_mesh;
            scene.add_instance(Instance { mesh, world_from_mesh, material: None, name: String::new() })?;
        }
    }
    Ok(scene)
}

/// Halves a set of triangles across its longest extent until the parts are small.
fn halve(mesh: &TriangleMesh, triangles: &mut [u32], done: &mut impl FnMut(&[u32])) {
    if triangles.len() <= OBJECT_TRIANGLES {
        return done(triangles);
    }
    let middle = |t: u32| mesh.corners(t as usize).into_iter().sum::<farsight_geometry::glam::Vec3>();
    let points = triangles.iter().map(|&t| middle(t).as_dvec3());
    let extent = farsight_geometry::DAabb::from_points(points).extent();
    let axis = (0..3).fold(0, |best, i| if extent[i] > extent[best] { i } else { best });
    let half = triangles.len() / 2;
    triangles
        .select_nth_unstable_by(half, |&a, &b| middle(a)[axis].total_cmp(&middle(b)[axis]).then(a.cmp(&b)));
    let (low, high) = triangles.split_at_mut(half);
    halve(mesh, low, done);
    halve(mesh, high, done);
}

/// Some of a mesh's triangles with the corners that they use.
fn part_of(mesh: &TriangleMesh, triangles: &[u32]) -> Result<TriangleMesh, farsight_geometry::MeshError> {
    let mut index = HashMap::new();
    let mut positions = Vec::new();
    let triangles = triangles
        .iter()
        .map(|&t| {
            mesh.triangles()[t as usize].map(|i| {
                *index.entry(i).or_insert_with(|| {
                    positions.push(mesh.positions()[i as usize]);
                    positions.len() as u32 - 1
                })
            })
        })
        .collect();
    TriangleMesh::new(positions, triangles)?.with_origin(mesh.origin())
}
