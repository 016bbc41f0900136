//! The first light's shadows, if that is a sun: where the map lies, who casts, and the map itself.

use crate::casters::{CasterStore, tolerance};
use crate::forms::Forms;
use farsight_geometry::bvh::Bvh;
use farsight_geometry::glam::{DMat4, DVec3};
use farsight_geometry::scene::Light;
use farsight_geometry::{Camera, DAabb, Frustum, Scene};
use farsight_plan::{LightView, TexelSpread};
use farsight_raster::{Rasteriser, ShadowMap, ShadowOptions, relative_from_mesh, thread_cpu_time};
use farsight_shadow::{Focus, MapOptions, Scope, ShadowLight, ShadowView, Skip, Warp};
use farsight_timing::Millis;
use std::cell::RefCell;
use std::error::Error;

/// Pixels that the edge of a shadow may be off since its caster is a coarser form.
const CASTER_PX: f64 = 1.0;

/// The shadow pass of a frame.
pub struct ShadowReport {
    pub view: ShadowView,
    pub casters_drawn: usize,
    /// Triangles of these.
    pub triangles: u64,
    pub time: Millis,
}

/// A sun and what its shadows need from one frame to the next.
pub struct Sun<'a> {
    pub direction: DVec3,
    coarse: Option<&'a RefCell<CasterStore>>,
    map_side: u32,
    focus: Focus,
    previous: Option<ShadowView>,
    /// The best map of the largest side for this frame, or why none is needed.
    fitted: Result<ShadowView, Skip>,
    casters: Vec<u32>,
    /// Whether the hierarchy has fewer triangles to draw than the objects' own forms.
    hierarchical: bool,
}

/// The scene as a frame has it.
pub struct Stage<'s> {
    pub scene: &'s Scene,
    pub hierarchy: &'s Bvh,
    pub bounds: &'s [DAabb],
    /// By how much each instance stretches its mesh.
    pub stretch: &'s [f64],
    pub forms: &'s Forms,
    /// Instances from here on move.
    pub first_mover: u32,
}

impl<'a> Sun<'a> {
    /// The first light of a scene, if it is a sun. Its maps have sides of `map_side` texels at most.
    pub fn of(scene: &Scene, map_side: u32, coarse: Option<&'a RefCell<CasterStore>>) -> Option<Self> {
        let Some(&Light::Directional { direction, .. }) = scene.lights().first() else { return None };
        let (focus, casters) = (Focus::new(), Vec::new());
        let fitted = Err(Skip::NothingSeen);
        let (previous, hierarchical) = (None, false);
        Some(Self { direction, coarse, map_side, focus, previous, fitted, casters, hierarchical })
    }

    /// Fits a map to what the camera sees, the receivers.
    pub fn fit(&mut self, camera: &Camera, stage: &Stage, receivers: &[DAabb]) -> Result<(), Box<dyn Error>> {
        let scene_box = stage.bounds.iter().fold(DAabb::EMPTY, |b, i| b.union(*i));
        // Beyond the far side of the scene there is nothing to shade.
        let farthest =
            scene_box.corners().iter().map(|c| c.distance(camera.eye())).fold(camera.near(), f64::max);
        let casters = [scene_box];
        let scope = Scope::new(camera, farthest * 1.001, receivers, &casters, self.map_side);
        self.fitted = match self.focus.fit(&ShadowLight::directional(self.direction), &scope)? {
            Some(skip) => Err(skip),
            None => {
                let view = self.focus.map(&MapOptions::new(self.map_side), self.previous.as_ref());
                self.find_casters(&view, stage);
                Ok(view)
            }
        };
        Ok(())
    }

    /// The map that [`fit`](Self::fit) found, with another side or warp if that is asked for.
    pub fn view(&self, side: u32, warped: bool) -> Option<ShadowView> {
        let best = self.fitted.as_ref().ok()?;
        if side == self.map_side && warped {
            return Some(*best);
        }
        let options = MapOptions::new(side);
        let warp = if warped { options.warp } else { Warp::Uniform };
        Some(self.focus.map(&options.with_warp(warp), self.previous.as_ref()))
    }

    fn find_casters(&mut self, view: &ShadowView, stage: &Stage) {
        let lit = Frustum::from_matrix(&view.clip_from_relative, view.origin, 0.0);
        self.casters.clear();
        stage.hierarchy.frustum(&lit, |object, _| self.casters.push(object));
    }

    /// A caster's triangles: as coarse as its shadow may be.
    fn form<'s>(&self, camera: &Camera, stage: &Stage<'s>, object: u32) -> &'s [[u32; 3]] {
        let index = object as usize;
        let instance = &stage.scene.instances()[index];
        let error = tolerance(camera, &stage.bounds[index], self.direction, CASTER_PX) / stage.stretch[index];
        let whole = || stage.scene.mesh_of(instance).triangles();
        stage.forms.within(instance.mesh.0, error).unwrap_or_else(whole)
    }

    /// What the planner is told, for an image of so many samples.
    pub fn summary(
        &mut self,
        camera: &Camera,
        stage: &Stage,
        receivers: &[DAabb],
        samples: f64,
    ) -> LightView {
        let view = match &self.fitted {
            Err(skip) => return LightView::skipped(*skip),
            Ok(view) => view,
        };
        let formed = |moving: bool| {
            let which = self.casters.iter().filter(|&&o| (o >= stage.first_mover) == moving);
            which.map(|&o| self.form(camera, stage, o).len() as u64).sum::<u64>()
        };
        let mut still = formed(false);
        let moving = formed(true);
        self.hierarchical = false;
        if let Some(store) = self.coarse {
            let nodes = store.borrow_mut().choose(camera, self.direction, receivers, CASTER_PX);
            self.hierarchical = nodes < still;
            still = still.min(nodes);
        }
        LightView {
            receiver_pixels: samples,
            caster_triangles: (still + moving) as f64,
            caster_draws: self.casters.len() as f64,
            contribution: 1.0,
            texels: TexelSpread::of_map(view),
            penumbra_px: 0.0,
            unchanged: false,
        }
    }

    /// Draws a map, with casters as coarse as their shadows may be for a camera; without one all of every caster.
    pub fn draw(
        &mut self,
        rasteriser: &mut Rasteriser,
        view: ShadowView,
        stage: &Stage,
        camera: Option<&Camera>,
    ) -> Result<(ShadowMap, ShadowReport), Box<dyn Error>> {
        let before = thread_cpu_time();
        let triangles = rasteriser.counters.triangles;
        self.previous = Some(view);
        let options = ShadowOptions::default();
        let mut map =
            ShadowMap::new(view.side, view.clip_from_relative, view.origin, -self.direction, options)?;
        let mut casters_drawn = 0;
        let mut first = 0;
        if let (Some(store), Some(_), true) = (self.coarse, camera, self.hierarchical) {
            casters_drawn += store.borrow_mut().draw(rasteriser, &mut map, view.origin)?;
            first = stage.first_mover;
        }
        self.find_casters(&view, stage);
        for &object in self.casters.iter().filter(|&&o| o >= first) {
            let instance = &stage.scene.instances()[object as usize];
            let mesh = stage.scene.mesh_of(instance);
            let relative = DMat4::from(relative_from_mesh(instance, mesh, view.origin));
            let triangles = camera.map_or(mesh.triangles(), |camera| self.form(camera, stage, object));
            map.draw(rasteriser, mesh.positions(), triangles, relative);
            casters_drawn += 1;
        }
        let time = Millis::from(thread_cpu_time() - before);
        let triangles = rasteriser.counters.triangles - triangles;
        Ok((map, ShadowReport { view, casters_drawn, triangles, time }))
    }
}
