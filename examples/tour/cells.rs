//! What can be seen from around the walk's viewpoints, computed beforehand: sets of visible objects with a bound on what they miss.

use crate::walk::Walk;
use farsight_geometry::glam::DVec3;
use farsight_geometry::ray::SceneCaster;
use farsight_geometry::scene::AlphaMode;
use farsight_geometry::{DAabb, Scene};
use farsight_plan::CellView;
use farsight_visibility::{Budget, Missed, Occluders, Options, Pvs, Sampler, Triangles, ViewCell};
use rayon::prelude::*;
use std::error::Error;

/// Most triangles in the world that are sampled: beyond, a tour would wait too long.
const MOST_TRIANGLES: u64 = 4_000_000;
/// Half the side of the cells, as a share of the scene's diagonal: room for a step in every direction.
const STEP: f64 = 1e-3;
/// Rays that find what is seen, rays that then look for what was missed, and the confidence of the bound on that.
const RAYS: u64 = 300_000;
const LOOKS: u64 = 20_000;
const CONFIDENCE: f64 = 0.95;

/// Sets along a walk.
#[derive(Default)]
pub struct Cells {
    cells: Vec<Cell>,
}

/// A region around a viewpoint of the walk, and what is seen from anywhere in it.
pub struct Cell {
    region: DAabb,
    pub set: Pvs,
    pub missed: Missed,
    pub rays: u64,
}

impl Cells {
    /// Samples around the viewpoints of a walk from which much is hidden; none where objects have holes in them.
    pub fn bake(
        scene: &Scene,
        caster: &SceneCaster,
        walk: &Walk,
        frames: usize,
    ) -> Result<Self, Box<dyn Error>> {
        let solid = scene.materials().iter().all(|m| m.alpha == AlphaMode::Opaque);
        if !solid || scene.placed_triangles() > MOST_TRIANGLES || scene.instances().len() < 2 {
            return Ok(Self::default());
        }
        let triangles = Triangles::of_scene(scene)?.by_instance();
        let step = STEP * scene.bounds().diagonal();
        let regions: Vec<DAabb> =
            walk.enclosed(frames).into_iter().map(|eye| DAabb::new(eye - step, eye + step)).collect();
        let bake = |region: &DAabb| -> Result<Cell, farsight_visibility::VisibilityError> {
            let cell = ViewCell::from_box(region)?;
            let mut sampler = Sampler::new(&triangles, Occluders::opaque(caster), &cell, Options::default())?;
            sampler.run(&Budget::rays(RAYS));
            let missed = sampler.validate(LOOKS, CONFIDENCE)?;
            Ok(Cell { region: *region, set: sampler.pvs(), missed, rays: sampler.rays() })
        };
        Ok(Self { cells: regions.par_iter().map(bake).collect::<Result<_, _>>()? })
    }

    /// The cell of a viewpoint.
    pub fn at(&self, eye: DVec3) -> Option<&Cell> {
        self.cells.iter().find(|c| c.region.contains(eye))
    }

    /// All cells.
    pub fn iter(&self) -> impl Iterator<Item = &Cell> {
        self.cells.iter()
    }
}

impl Cell {
    /// What the planner is told.
    pub fn view(&self) -> CellView {
        CellView { missed: self.missed.bound.value, kind: self.missed.bound.kind }
    }
}
