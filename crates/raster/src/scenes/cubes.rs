//! Many small separate objects: cubes turned at random in a box.

use super::builder::Builder;
use super::check;
use crate::RasterError;
use crate::random::Random;
use farsight_geometry::Scene;
use farsight_geometry::scene::{Instance, Material};
use glam::{DAffine3, DQuat, DVec3, Vec3};

/// Cubes of random size, place and orientation; they may overlap.
///
/// By default 2,000 cubes (24,000 triangles) with edges of 1 to 6 m, centred in a box of 100 m from the origin on.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Cubes {
    /// Seed of everything random.
    pub seed: u64,
    /// Number of cubes: up to 100 million.
    pub count: u32,
    /// Shortest and longest edge in metres.
    pub edge: [f64; 2],
    /// Side of the box that holds the centres, in metres.
    pub side: f64,
}

impl Default for Cubes {
    fn default() -> Self {
        Self { seed: 1, count: 2000, edge: [1.0, 6.0], side: 100.0 }
    }
}

const COLOURS: usize = 12;

impl Cubes {
    /// Builds the scene: one cube mesh, an instance per cube.
    ///
    /// # Errors
    /// [`RasterError::Option`] when an option is out of its range.
    pub fn build(&self) -> Result<Scene, RasterError> {
        let [shortest, longest] = self.edge;
        check("count", self.count.into(), "0..=100000000", self.count <= 100_000_000)?;
        let edges = shortest > 0.0 && longest >= shortest && longest <= 1e6;
        let culprit = if shortest > 0.0 { longest } else { shortest };
        check("edge", culprit, "0 < shortest <= longest <= 1e6", edges)?;
        check("side", self.side, "(0, 1e9]", self.side > 0.0 && self.side <= 1e9)?;
        let mut scene = Scene::new();
        let mut builder = Builder::default();
        builder.solid(Vec3::splat(-0.5), Vec3::X, Vec3::Y, Vec3::Z, [255; 3]);
        let mesh = scene.add_mesh(builder.build()?);
        let materials = (0..COLOURS)
            .map(|i| {
                let phase = |k: f32| {
                    let t = std::f32::consts::TAU * (i as f32 / COLOURS as f32 + k / 3.0);
                    0.36 + 0.16 * t.cos()
                };
                scene.add_material(Material {
                    name: format!("cube {i}"),
                    base_colour: [phase(0.0), phase(1.0), phase(2.0), 1.0],
                    two_sided: false,
                    ..Material::default()
                })
            })
            .collect::<Result<Vec<_>, _>>()?;
        let mut random = Random::new(self.seed);
        for i in 0..self.count {
            let mut place = || random.range(0.0, self.side);
            let center = DVec3::new(place(), place(), place());
            let axis = random.direction().as_dvec3();
            let turn = DQuat::from_axis_angle(axis.normalize(), random.range(0.0, std::f64::consts::TAU));
            let scale = DVec3::splat(random.range(shortest, longest));
            scene.add_instance(Instance {
                name: format!("cube {i}"),
                mesh,
                world_from_mesh: DAffine3::from_scale_rotation_translation(scale, turn, center),
                material: Some(materials[random.below(COLOURS)]),
            })?;
        }
        scene.add_light(super::city::sun())?;
        Ok(scene)
    }
}
