//! What the tour goes through: files, or a generated town.

use crate::walk::{Up, Walk};
use farsight_geometry::glam::{DAffine3, DQuat, DVec3, Vec3};
use farsight_geometry::io::{self, Content};
use farsight_geometry::ray::SceneCaster;
use farsight_geometry::scene::{Instance, Light, Material};
use farsight_geometry::{MeshReport, Scene, TriangleMesh};
use farsight_raster::scenes::{City, Path, statue};
use std::error::Error;
use std::path::PathBuf;

/// A scene with a way through it.
pub struct Input {
    pub title: String,
    pub scene: Scene,
    pub walk: Walk,
    pub up: Up,
    /// What importers complained about.
    pub warnings: Vec<String>,
}

/// Squares around the statue's column: 22 n² triangles.
const FINENESS: u32 = 50;
const FINENESS_QUICK: u32 = 32;
/// Where it stands from the crossing at which the walk turns, in metres, and how much larger than the model it is.
const ASIDE: DVec3 = DVec3::new(10.0, 0.0, 0.0);
const LARGER: f64 = 1.8;
const STONE: [f32; 4] = [0.55, 0.49, 0.38, 1.0];

/// Generates the town with a statue in it; a smaller one for quick runs.
pub fn generate(quick: bool) -> Result<Input, Box<dyn Error>> {
    let city = if quick { City::small() } else { City::default() };
    let mut scene = city.build()?;
    // As a scanner would have it: a surface and nothing else.
    let model = statue(if quick { FINENESS_QUICK } else { FINENESS })?;
    let bare = TriangleMesh::new(model.positions().to_vec(), model.triangles().to_vec())?;
    let mesh = scene.add_mesh(bare);
    let stone = Material { name: "stone".into(), base_colour: STONE, ..Material::default() };
    let material = Some(scene.add_material(stone)?);
    let crossing = Path::street_walk(&city).at(0.5).0.with_z(0.0);
    // It faces who comes along the street.
    let turn = DQuat::from_rotation_z(std::f64::consts::PI);
    let place = DAffine3::from_scale_rotation_translation(DVec3::splat(LARGER), turn, crossing + ASIDE);
    scene.add_instance(Instance { name: "statue".into(), mesh, world_from_mesh: place, material })?;
    Ok(Input {
        title: "a generated town".into(),
        scene,
        walk: Walk::town(&city),
        up: Up::Z,
        warnings: Vec::new(),
    })
}

/// Loads files into one scene.
pub fn load(paths: &[PathBuf], up: Up) -> Result<Input, Box<dyn Error>> {
    let mut scene = Scene::new();
    let mut warnings = Vec::new();
    for path in paths {
        let loaded = io::load(path)?;
        warnings.extend(loaded.warnings.iter().map(|w| format!("{}: {w}", path.display())));
        match loaded.content {
            Content::Scene(part) => scene.append(part),
            Content::Points(points) => {
                return Err(format!("{}: {} points and no triangles", path.display(), points.len()).into());
            }
        }
    }
    if scene.placed_triangles() == 0 {
        return Err("the scene is empty: no instance has a triangle".into());
    }
    if scene.lights().is_empty() {
        scene.add_light(sun(up))?;
    }
    let names: Vec<String> =
        paths.iter().map(|p| p.file_name().map_or(String::new(), |n| n.to_string_lossy().into())).collect();
    Ok(Input {
        title: names.join(", "),
        walk: Walk::around(&scene, &SceneCaster::new(&scene)?, up),
        scene,
        up,
        warnings,
    })
}

/// Late morning sun for scenes that bring no light.
fn sun(up: Up) -> Light {
    let across = if up == Up::Y { DVec3::new(0.45, 0.0, 0.25) } else { DVec3::new(0.45, 0.25, 0.0) };
    Light::Directional {
        direction: (across - up.axis()).normalize(),
        irradiance: Vec3::new(2.3, 2.15, 1.95),
        angular_radius: 0.0,
    }
}

/// The defects of all meshes together.
pub fn defects(scene: &Scene) -> MeshReport {
    scene.meshes().iter().map(|m| m.report()).fold(MeshReport::default(), MeshReport::plus)
}
