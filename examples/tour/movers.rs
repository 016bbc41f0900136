//! What moves: aeroplanes that circle over the scene, drawn as cuts through a vertex hierarchy that follow the eye.

use crate::forms::Forms;
use crate::walk::Up;
use farsight_geometry::glam::{DAffine3, DMat3, DVec3};
use farsight_geometry::scene::{Instance, Material};
use farsight_geometry::{Camera, DAabb, Scene};
use farsight_lod::{Cut, LodError, Placement, Tolerance, VertexHierarchy};
use farsight_raster::Random;
use farsight_raster::scenes::aeroplane;
use std::error::Error;
use std::f64::consts::TAU;

/// Squares around an aeroplane's fuselage: 13 n² triangles.
const FINENESS: u32 = 24;
/// Length of the model in its own units, and of an aeroplane as a share of the scene's width.
const LENGTH: f64 = 9.0;
const SHARE: f64 = 0.028;
/// Seconds for a round, from the fastest to the slowest.
const ROUND: [f64; 2] = [25.0, 60.0];

/// Aeroplanes among the instances of a scene: the last ones.
pub struct Movers {
    first: u32,
    hierarchy: VertexHierarchy,
    flights: Vec<Flight>,
    cuts: Vec<Cut>,
    /// Tests of nodes in the last frame.
    pub tests: u64,
}

/// A circle in the air.
struct Flight {
    center: DVec3,
    /// Two horizontal axes and the way up.
    axes: DMat3,
    radius: f64,
    scale: f64,
    /// Rounds per second, where it starts, and whether it goes the other way round.
    pace: f64,
    phase: f64,
    turn: f64,
}

impl Movers {
    /// Adds so many aeroplanes to a scene and their coarser forms to its forms.
    pub fn over(scene: &mut Scene, forms: &mut Forms, up: Up, count: u32) -> Result<Self, Box<dyn Error>> {
        let bounds = scene.bounds();
        let mesh = aeroplane(FINENESS)?;
        let hierarchy = VertexHierarchy::build(&mesh)?;
        forms.add(&mesh)?;
        let mesh = scene.add_mesh(mesh);
        let material = scene.add_material(Material { name: "aeroplane".into(), ..Material::default() })?;
        let mut random = Random::new(77);
        let flights: Vec<Flight> = (0..count).map(|_| Flight::random(&mut random, &bounds, up)).collect();
        let first = scene.instances().len() as u32;
        for (i, flight) in flights.iter().enumerate() {
            scene.add_instance(Instance {
                name: format!("aeroplane {i}"),
                mesh,
                world_from_mesh: flight.at(0.0),
                material: Some(material),
            })?;
        }
        let cuts = flights.iter().map(|_| Cut::new(&hierarchy)).collect();
        Ok(Self { first, hierarchy, flights, cuts, tests: 0 })
    }

    /// The instances that move.
    pub fn instances(&self) -> std::ops::Range<u32> {
        self.first..self.first + self.flights.len() as u32
    }

    /// Moves all to where they are at a time in seconds.
    pub fn fly(&self, scene: &mut Scene, time: f64) -> Result<(), farsight_geometry::scene::SceneError> {
        self.flights.iter().zip(self.first..).try_for_each(|(flight, i)| scene.place(i, flight.at(time)))
    }

    /// Brings the cuts of those that are `wanted` up to date for an eye, each within `px` pixels of its mesh.
    pub fn follow(
        &mut self,
        placements: &[Option<Placement>],
        camera: &Camera,
        px: f64,
        wanted: impl Fn(u32) -> bool,
    ) -> Result<(), LodError> {
        let tolerance = Tolerance::pixels(px, camera)?;
        self.tests = 0;
        for (cut, object) in self.cuts.iter_mut().zip(self.first..).filter(|(_, object)| wanted(*object)) {
            let placement = placements[object as usize].ok_or(LodError::Placement)?;
            let observer = placement.observer(camera.eye())?;
            let stats = cut.update_kinetic(&self.hierarchy, &observer, &tolerance)?;
            self.tests += stats.tested;
        }
        Ok(())
    }

    /// What is drawn of an instance, if that is one of these.
    pub fn triangles(&self, instance: u32) -> Option<&[[u32; 3]]> {
        let cut = self.cuts.get(instance.checked_sub(self.first)? as usize)?;
        Some(cut.triangles())
    }
}

impl Flight {
    fn random(random: &mut Random, bounds: &DAabb, up: Up) -> Self {
        let (a, b) = up.ground();
        let axes = DMat3::from_cols(a, b, up.axis());
        let width = bounds.extent().dot((a + b).abs()) * 0.5;
        let top = bounds.center() + up.axis() * (0.5 * bounds.extent().dot(up.axis().abs()));
        let aside = (a * random.range(-0.2, 0.2) + b * random.range(-0.2, 0.2)) * width;
        Self {
            center: top + aside + up.axis() * (width * random.range(0.05, 0.25)),
            axes,
            radius: width * random.range(0.15, 0.5),
            scale: SHARE * width / LENGTH,
            pace: 1.0 / random.range(ROUND[0], ROUND[1]),
            phase: random.unit(),
            turn: if random.chance(0.5) { 1.0 } else { -1.0 },
        }
    }

    /// The placement at a time: nose ahead, leaning into the turn.
    fn at(&self, time: f64) -> DAffine3 {
        const LEAN: f64 = 0.35;
        let angle = self.turn * TAU * (self.phase + self.pace * time);
        let (sine, cosine) = angle.sin_cos();
        let [a, b, up] = [self.axes.x_axis, self.axes.y_axis, self.axes.z_axis];
        let outward = a * cosine + b * sine;
        let ahead = (b * cosine - a * sine) * self.turn;
        // From above the model's left is its second axis.
        let left = up.cross(ahead);
        let inward = -outward.dot(left).signum();
        let lean = -inward * LEAN;
        let turned = DMat3::from_cols(
            ahead,
            left * f64::cos(lean) + up * f64::sin(lean),
            up * f64::cos(lean) - left * f64::sin(lean),
        );
        DAffine3::from_mat3_translation(turned * self.scale, self.center + outward * self.radius)
    }
}
