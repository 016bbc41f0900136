//! One frame: planned, its shadow map where the sun can be seen to matter, then the picture.

use crate::built::Built;
use crate::casters::CasterStore;
use crate::cells::Cells;
use crate::cull::Visibility;
use crate::forms::Forms;
use crate::planning::{Planning, form};
use farsight_geometry::bvh::Bvh;
use farsight_geometry::glam::{DMat4, DVec3};
use farsight_geometry::scene::Light;
use farsight_geometry::{Camera, DAabb, Frustum, Scene};
use farsight_plan::{Budget, Choice, Effect, Layout, LightView, Plan, TexelSpread};
use farsight_raster::thread_cpu_time;
use farsight_raster::{
    Counters, MipMap, Rasteriser, RenderOptions, ShadowMap, ShadowOptions, Target, mip_maps,
    relative_from_mesh, render_scene,
};
use farsight_shadow::{Focus, MapOptions, Scope, ShadowLight, ShadowView, Skip, Warp};
use farsight_timing::Millis;
use std::cell::RefCell;
use std::error::Error;

/// What a frame took.
pub struct FrameReport {
    /// Objects in the view volume.
    pub in_view: usize,
    /// Objects that were drawn.
    pub drawn: usize,
    /// What was decided; `None` where everything runs.
    pub plan: Option<Plan>,
    pub counters: Counters,
    /// The sun's map, if one was drawn.
    pub shadow: Option<ShadowReport>,
    /// Processor time: as told before, and as it was, of all and of its parts.
    pub predicted: Millis,
    pub time: Millis,
    pub culling: Millis,
}

/// The shadow pass of a frame.
pub struct ShadowReport {
    pub view: ShadowView,
    pub casters_drawn: usize,
    pub time: Millis,
}

/// Pixels that the edge of a shadow may be off since its caster is a coarser form.
const CASTER_PX: f64 = 1.0;

/// A sun's shadows, as far as they are known before they are decided upon.
struct Sun {
    direction: DVec3,
    /// The best map of the largest side, or why none is needed.
    fitted: Result<ShadowView, Skip>,
}

/// Draws frames of a scene, keeping what can be kept from one to the next.
pub struct Renderer<'a> {
    scene: &'a Scene,
    forms: &'a Forms,
    cells: &'a Cells,
    coarse: Option<&'a RefCell<CasterStore>>,
    bounds: &'a [DAabb],
    hierarchy: Bvh,
    visibility: Visibility<'a>,
    planning: Planning<'a>,
    textures: Vec<MipMap>,
    rasteriser: Rasteriser,
    focus: Focus,
    previous: Option<ShadowView>,
    receivers: Vec<DAabb>,
    casters: Vec<u32>,
    options: RenderOptions<'a>,
    map_side: u32,
}

impl<'a> Renderer<'a> {
    /// Prepares a scene for which something was built; `options` must not name shadows, textures or forms.
    pub fn new(
        scene: &'a Scene,
        built: &'a Built,
        bounds: &'a [DAabb],
        size: [u32; 2],
        options: RenderOptions<'a>,
        map_side: u32,
        budget: Budget,
    ) -> Result<Self, Box<dyn Error>> {
        let [width, height] = size.map(|side| side * options.supersampling);
        let sun = matches!(scene.lights().first(), Some(Light::Directional { .. }));
        Ok(Self {
            scene,
            forms: &built.forms,
            cells: &built.cells,
            coarse: built.casters.as_ref(),
            bounds,
            hierarchy: Bvh::build(bounds)?,
            visibility: Visibility::new(scene, bounds, width, height)?,
            planning: Planning::new(scene, &built.forms, sun.then_some(map_side), width * height, budget)?,
            textures: mip_maps(scene),
            rasteriser: Rasteriser::new(),
            focus: Focus::new(),
            previous: None,
            receivers: Vec::new(),
            casters: Vec::new(),
            options,
            map_side,
        })
    }

    /// Draws what the plan for this view asks for.
    pub fn planned(&mut self, camera: &Camera) -> Result<(Target, FrameReport), Box<dyn Error>> {
        let start = thread_cpu_time();
        let sun = self.fit(camera)?;
        let light = sun.as_ref().map(|sun| self.light(sun, camera));
        let samples = f64::from(self.options.supersampling).powi(2);
        let cell = self.cells.at(camera.eye());
        let plan = self.planning.plan(camera, self.bounds, light, cell.map(|c| c.view()), samples)?.clone();
        let predicted = plan.cost + self.planning.constant();
        let choice = |effect| plan.decision(effect).map_or(Choice::Nothing, |d| d.choice);
        let forms: Vec<Option<&[[u32; 3]]>> = plan
            .objects()
            .iter()
            .zip(self.scene.instances())
            .map(|(d, instance)| Some(self.forms.triangles(instance.mesh.0, form(&d.choice)?)))
            .collect();

        let map = match (&sun, choice(Effect::Shadow { light: 0 })) {
            (Some(Sun { direction, fitted: Ok(view) }), Choice::Map { layout, side, .. }) => {
                let options = MapOptions::new(side);
                let warp = if layout == Layout::Uniform { Warp::Uniform } else { options.warp };
                let view = if side == self.map_side && layout == Layout::Warped {
                    *view
                } else {
                    self.focus.map(&options.with_warp(warp), self.previous.as_ref())
                };
                Some(self.draw_map(view, *direction, &forms, self.coarse)?)
            }
            _ => None,
        };

        let occlusion = choice(Effect::Occlusion);
        let set =
            cell.filter(|_| matches!(occlusion, Choice::Cells | Choice::CellsAndQueries)).map(|c| &c.set);
        let wanted = |object: &u32| {
            plan.objects()[*object as usize].choice != Choice::Nothing
                && set.is_none_or(|s| s.contains(*object))
        };
        let before = thread_cpu_time();
        let culls = matches!(occlusion, Choice::Queries | Choice::CellsAndQueries);
        let objects: Vec<u32> = if culls {
            let visible = self.visibility.cull(&self.hierarchy, &self.fine(camera)?, &forms);
            visible.iter().copied().filter(wanted).collect()
        } else {
            (0..self.bounds.len() as u32).filter(wanted).collect()
        };
        let culling = Millis::from(thread_cpu_time() - before);

        let total: Millis = plan.objects().iter().map(|d| d.cost).sum();
        let drawn: Millis = objects.iter().map(|&o| plan.objects()[o as usize].cost).sum();
        let (target, counters, drawing) = self.draw(camera, map.as_ref().map(|m| &m.0), &objects, &forms)?;
        let time = Millis::from(thread_cpu_time() - start);
        let share = if total.0 > 0.0 { drawn / total } else { 1.0 };
        self.planning.learn(share, drawing, map.as_ref().map(|m| m.1.time))?;
        if culls {
            self.planning.learn_culling(total - drawn, culling);
        }
        let in_view = self.planning.seen().iter().filter(|s| s.in_view).count();
        let report = FrameReport {
            in_view,
            drawn: objects.len(),
            plan: Some(plan),
            counters,
            shadow: map.map(|m| m.1),
            predicted,
            time,
            culling,
        };
        Ok((target, report))
    }

    /// Draws without a plan: all triangles of everything in view, the largest shadow map.
    pub fn everything(&mut self, camera: &Camera) -> Result<(Target, FrameReport), Box<dyn Error>> {
        let start = thread_cpu_time();
        let sun = self.fit(camera)?;
        let map = match &sun {
            Some(Sun { direction, fitted: Ok(view) }) => Some(self.draw_map(*view, *direction, &[], None)?),
            _ => None,
        };
        let mut objects = Vec::with_capacity(self.receivers.len());
        self.hierarchy.frustum(&Frustum::from_camera(camera), |object, _| objects.push(object));
        let (target, counters, _) = self.draw(camera, map.as_ref().map(|m| &m.0), &objects, &[])?;
        let report = FrameReport {
            in_view: self.receivers.len(),
            drawn: objects.len(),
            plan: None,
            counters,
            shadow: map.map(|m| m.1),
            predicted: Millis::ZERO,
            time: Millis::from(thread_cpu_time() - start),
            culling: Millis::ZERO,
        };
        Ok((target, report))
    }

    fn draw(
        &mut self,
        camera: &Camera,
        map: Option<&ShadowMap>,
        objects: &[u32],
        forms: &[Option<&[[u32; 3]]>],
    ) -> Result<(Target, Counters, Millis), Box<dyn Error>> {
        let before = thread_cpu_time();
        let mut options: RenderOptions = self.options;
        options.shadows = map.map_or(&[], std::slice::from_ref);
        options.textures = &self.textures;
        options.only = Some(objects);
        options.forms = forms;
        let (target, counters) = render_scene(&mut self.rasteriser, self.scene, camera, &options)?;
        Ok((target, counters, Millis::from(thread_cpu_time() - before)))
    }

    /// The camera of the samples: hidden is what no sample shows.
    fn fine(&self, camera: &Camera) -> Result<Camera, Box<dyn Error>> {
        let n = self.options.supersampling;
        Ok(camera.with_image(camera.width() * n, camera.height() * n)?)
    }

    /// Fits a map to what the camera sees, if the first light is a sun.
    fn fit(&mut self, camera: &Camera) -> Result<Option<Sun>, Box<dyn Error>> {
        self.receivers.clear();
        let seen = Frustum::from_camera(camera);
        self.hierarchy.frustum(&seen, |object, _| self.receivers.push(self.bounds[object as usize]));
        let Some(&Light::Directional { direction, .. }) = self.scene.lights().first() else {
            return Ok(None);
        };
        let scene_box = self.bounds.iter().fold(DAabb::EMPTY, |b, i| b.union(*i));
        // Beyond the far side of the scene there is nothing to shade.
        let farthest =
            scene_box.corners().iter().map(|c| c.distance(camera.eye())).fold(camera.near(), f64::max);
        let casters = [scene_box];
        let scope = Scope::new(camera, farthest * 1.001, &self.receivers, &casters, self.map_side);
        let fitted = match self.focus.fit(&ShadowLight::directional(direction), &scope)? {
            Some(skip) => Err(skip),
            None => {
                let view = self.focus.map(&MapOptions::new(self.map_side), self.previous.as_ref());
                self.find_casters(&view);
                Ok(view)
            }
        };
        Ok(Some(Sun { direction, fitted }))
    }

    fn find_casters(&mut self, view: &ShadowView) {
        let lit = Frustum::from_matrix(&view.clip_from_relative, view.origin, 0.0);
        self.casters.clear();
        self.hierarchy.frustum(&lit, |object, _| self.casters.push(object));
    }

    /// What the planner is told of the sun.
    fn light(&self, sun: &Sun, camera: &Camera) -> LightView {
        let view = match &sun.fitted {
            Err(skip) => return LightView::skipped(*skip),
            Ok(view) => view,
        };
        let triangles =
            |&o: &u32| self.scene.mesh_of(&self.scene.instances()[o as usize]).triangles().len() as u64;
        let full = self.casters.iter().map(triangles).sum::<u64>();
        let coarse = self
            .coarse
            .map(|store| store.borrow_mut().choose(camera, sun.direction, &self.receivers, CASTER_PX));
        let samples = f64::from(self.options.supersampling).powi(2);
        LightView {
            receiver_pixels: f64::from(camera.width()) * f64::from(camera.height()) * samples,
            caster_triangles: coarse.unwrap_or(full) as f64,
            caster_draws: self.casters.len() as f64,
            contribution: 1.0,
            texels: TexelSpread::of_map(view),
            penumbra_px: 0.0,
            unchanged: false,
        }
    }

    fn draw_map(
        &mut self,
        view: ShadowView,
        direction: DVec3,
        forms: &[Option<&[[u32; 3]]>],
        coarse: Option<&RefCell<CasterStore>>,
    ) -> Result<(ShadowMap, ShadowReport), Box<dyn Error>> {
        let before = thread_cpu_time();
        self.previous = Some(view);
        let options = ShadowOptions::default();
        let mut map = ShadowMap::new(view.side, view.clip_from_relative, view.origin, -direction, options)?;
        if let Some(store) = coarse {
            let casters_drawn = store.borrow_mut().draw(&mut self.rasteriser, &mut map, view.origin)?;
            let time = Millis::from(thread_cpu_time() - before);
            return Ok((map, ShadowReport { view, casters_drawn, time }));
        }
        self.find_casters(&view);
        for &object in &self.casters {
            let instance = &self.scene.instances()[object as usize];
            let mesh = self.scene.mesh_of(instance);
            let relative = DMat4::from(relative_from_mesh(instance, mesh, view.origin));
            // What is seen casts the shadow of the form that is seen.
            let triangles = forms.get(object as usize).copied().flatten().unwrap_or(mesh.triangles());
            map.draw(&mut self.rasteriser, mesh.positions(), triangles, relative);
        }
        let time = Millis::from(thread_cpu_time() - before);
        Ok((map, ShadowReport { view, casters_drawn: self.casters.len(), time }))
    }
}
