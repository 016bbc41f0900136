//! A street between tall houses.

use super::builder::{Builder, shaded};
use super::check;
use super::house::House;
use crate::RasterError;
use crate::random::Random;
use farsight_geometry::Scene;
use farsight_geometry::scene::{Instance, Material};
use glam::{DAffine3, DVec3, Vec3};

/// A straight street along x with closed rows of tall houses on both sides.
///
/// The road's middle is y = 0. By default 240 m long and 12 m wide between houses of 15 to 21 m.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct StreetCanyon {
    /// Seed of everything random.
    pub seed: u64,
    /// Length in metres: 20 to 10,000.
    pub length: f64,
    /// Width between the fronts in metres: 4 to 60.
    pub width: f64,
    /// Fewest and most floors: 1 to 40.
    pub floors: [u32; 2],
    /// Roof columns per metre: 0.5 to 100.
    pub roof_columns_per_metre: f32,
}

impl Default for StreetCanyon {
    fn default() -> Self {
        Self { seed: 1, length: 240.0, width: 12.0, floors: [5, 7], roof_columns_per_metre: 6.0 }
    }
}

impl StreetCanyon {
    /// Builds the scene: an instance per house and per 12 m of ground.
    ///
    /// # Errors
    /// [`RasterError::Option`] when an option is out of its range.
    pub fn build(&self) -> Result<Scene, RasterError> {
        let [fewest, most] = self.floors;
        let roof = self.roof_columns_per_metre;
        check("length", self.length, "20..=10000", (20.0..=10_000.0).contains(&self.length))?;
        check("width", self.width, "4..=60", (4.0..=60.0).contains(&self.width))?;
        check(
            "floors",
            fewest.into(),
            "1 <= fewest <= most <= 40",
            1 <= fewest && fewest <= most && most <= 40,
        )?;
        check("roof_columns_per_metre", roof.into(), "0.5..=100", (0.5..=100.0).contains(&roof))?;
        let mut scene = Scene::new();
        let material = Some(scene.add_material(Material {
            name: "street".into(),
            base_colour: [1.0; 4],
            two_sided: false,
            ..Material::default()
        })?);
        let mut random = Random::new(self.seed);
        for side in [-1.0, 1.0] {
            let mut x = 0.0;
            while x < self.length {
                let width = random.range(9.0, 15.0);
                let mut builder = Builder::default();
                let house = House {
                    width: width as f32,
                    depth: 11.0,
                    floors: fewest + random.below((most - fewest + 1) as usize) as u32,
                    open_left: false,
                    open_right: false,
                    roof_columns_per_metre: roof,
                };
                house.build(&mut random, &mut builder);
                let mesh = scene.add_mesh(builder.build()?);
                // The front (y = 0, facing −y) turns to the street on both sides.
                let at = if side > 0.0 {
                    DAffine3::from_translation(DVec3::new(x, 0.5 * self.width, 0.12))
                } else {
                    DAffine3::from_translation(DVec3::new(
                        x + f64::from(house.width),
                        -0.5 * self.width,
                        0.12,
                    )) * DAffine3::from_rotation_z(std::f64::consts::PI)
                };
                let name = format!("house {x:.0} {}", if side > 0.0 { "north" } else { "south" });
                scene.add_instance(Instance { name, mesh, world_from_mesh: at, material })?;
                x += width;
            }
        }
        let pieces = (self.length / 12.0).ceil() as u32 + 1;
        for piece in 0..pieces {
            let mesh = scene.add_mesh(self.ground(&mut random.fork(u64::from(piece)))?);
            let at = DAffine3::from_translation(DVec3::new(12.0 * f64::from(piece), 0.0, 0.0));
            scene.add_instance(Instance {
                name: format!("ground {piece}"),
                mesh,
                world_from_mesh: at,
                material,
            })?;
        }
        scene.add_light(super::city::sun())?;
        Ok(scene)
    }

    /// Twelve metres of road and pavements, reaching under the houses.
    fn ground(&self, random: &mut Random) -> Result<farsight_geometry::TriangleMesh, RasterError> {
        let mut out = Builder::default();
        let half = 0.5 * self.width as f32;
        let road = 0.65 * half;
        let across = 6;
        let strip = 2.0 * road / across as f32;
        for i in 0..12 {
            for j in 0..across {
                let corner = Vec3::new(i as f32, -road + j as f32 * strip, 0.0);
                let colour = shaded([86, 86, 90], random.range_f32(0.92, 1.06));
                out.parallelogram(corner, Vec3::X, Vec3::Y * strip, colour);
            }
            for side in [-1.0f32, 1.0] {
                let colour = shaded([168, 162, 152], random.range_f32(0.92, 1.06));
                let (low, high) = if side > 0.0 { (road, half + 2.0) } else { (-half - 2.0, -road) };
                let z = Vec3::Z * 0.12;
                out.parallelogram(Vec3::new(i as f32, low, 0.0) + z, Vec3::X, Vec3::Y * (high - low), colour);
                let kerb = Vec3::new(i as f32, side * road, 0.0);
                let (u, v) = if side > 0.0 { (Vec3::X, z) } else { (z, Vec3::X) };
                out.parallelogram(kerb, u, v, shaded(colour, 0.85));
            }
        }
        out.build()
    }
}
