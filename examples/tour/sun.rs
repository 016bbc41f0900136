//! The first light's shadows, if that is a sun: where the map lies, who casts, and the map itself.

use crate::casters::{CasterStore, aside, tolerance};
use crate::forms::Forms;
use crate::frames::took;
use crate::penumbra;
use farsight_geometry::bvh::Bvh;
use farsight_geometry::glam::{DMat4, DVec3};
use farsight_geometry::scene::Light;
use farsight_geometry::{Camera, DAabb, Frustum, Scene};
use farsight_plan::{Layout, LightSummary, LightView, TexelSpread};
use farsight_raster::{Penumbra, Rasteriser, ShadowMap, ShadowOptions, relative_from_mesh, thread_cpu_time};
use farsight_shadow::{
    Focus, MapOptions, Scope, ShadowError, ShadowLight, ShadowView, Skip, Warp, plan_cascades,
};
use farsight_timing::Millis;
use std::error::Error;

/// Pixels by which the edge of a shadow may be off because its caster is a coarser form.
const CASTER_PX: f64 = 1.0;

/// Cascades there may be at most.
const MOST_CASCADES: u32 = 4;
/// Samples of a soft shadow there may be at most: shades are then off by 1.4 % of the light.
const MOST_TAPS: u32 = 36;

/// The shadow pass of a frame.
pub struct ShadowReport {
    /// Maps, and the side of each.
    pub maps: usize,
    pub side: u32,
    /// Pixels that the coarsest texel covers, and that it would cover in a single map of the same side without a warp.
    pub texel: f64,
    pub uniform: f64,
    /// Samples for a point, one for hard shadows; and the pixels that a penumbra covers at most.
    pub taps: u32,
    pub penumbra_px: f64,
    /// Points that were taken to be shaded.
    pub samples: f64,
    pub casters_drawn: usize,
    /// Triangles of these.
    pub triangles: u64,
    pub time: Millis,
}

/// A sun and what its shadows need from one frame to the next.
pub struct Sun {
    pub direction: DVec3,
    /// Half of the angle that it spans.
    angular_radius: f64,
    hierarchies: Vec<CasterStore>,
    map_side: u32,
    focus: Focus,
    previous: Option<ShadowView>,
    /// The best map of the largest side for this frame, or why none is needed.
    fitted: Result<ShadowView, Skip>,
    /// For two, three and four maps: the number of splits of the distances that leaves so many, and the pixels that their coarsest texel covers, times
    /// their side. `None` where no number of splits does.
    cascades: [Option<(u32, f64)>; 3],
    casters: Vec<u32>,
    /// Widest penumbra in view, in pixels.
    penumbra_px: f64,
    /// Points that are shaded.
    samples: f64,
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

impl Stage<'_> {
    fn all(&self) -> DAabb {
        self.bounds.iter().fold(DAabb::EMPTY, |b, i| b.union(*i))
    }

    /// Beyond the far side of the scene there is nothing to shade.
    fn farthest(&self, camera: &Camera) -> f64 {
        let corners = self.all().corners();
        1.001 * corners.iter().map(|c| c.distance(camera.eye())).fold(camera.near(), f64::max)
    }

    /// What maps of a side are fitted to.
    fn scope<'a>(
        &self,
        camera: &'a Camera,
        receivers: &'a [DAabb],
        casters: &'a [DAabb],
        side: u32,
    ) -> Scope<'a> {
        Scope::new(camera, self.farthest(camera), receivers, casters, side)
    }
}

impl Sun {
    /// The first light of a scene, if it is a sun; taken to span twice `angular_radius`. Its maps have sides of `map_side` texels at most.
    pub fn of(
        scene: &Scene,
        map_side: u32,
        angular_radius: f64,
        hierarchies: Vec<CasterStore>,
    ) -> Option<Self> {
        let Some(&Light::Directional { direction, .. }) = scene.lights().first() else { return None };
        Some(Self {
            direction,
            angular_radius,
            hierarchies,
            map_side,
            focus: Focus::new(),
            previous: None,
            fitted: Err(Skip::NothingSeen),
            cascades: [None; 3],
            casters: Vec::new(),
            penumbra_px: 0.0,
            samples: 0.0,
        })
    }

    /// Samples of a soft shadow there may be; 0 for a sun without size.
    pub fn most_taps(&self) -> u32 {
        if self.angular_radius > 0.0 { MOST_TAPS } else { 0 }
    }

    /// What the planner may choose from.
    pub fn light(&self) -> LightSummary {
        let (most_side, most_taps) = (self.map_side, self.most_taps());
        LightSummary { most_side, most_cascades: MOST_CASCADES, most_taps }
    }

    /// Fits maps to what the camera sees, the receivers: one, and cascades where the coarsest texel of that covers more than `texel_px` pixels.
    pub fn fit(
        &mut self,
        camera: &Camera,
        stage: &Stage,
        receivers: &[DAabb],
        texel_px: f64,
    ) -> Result<(), Box<dyn Error>> {
        let casters = [stage.all()];
        let scope = stage.scope(camera, receivers, &casters, self.map_side);
        let light = ShadowLight::directional(self.direction);
        (self.cascades, self.penumbra_px) = ([None; 3], 0.0);
        self.fitted = match self.focus.fit(&light, &scope)? {
            Some(skip) => Err(skip),
            None => {
                let view = self.focus.map(&MapOptions::new(self.map_side), self.previous.as_ref());
                self.find_casters(&view, stage);
                let casters = self.casters.iter().map(|&o| stage.bounds[o as usize]);
                self.penumbra_px =
                    penumbra::widest(camera, self.direction, self.angular_radius, casters, receivers);
                if view.texel.value > texel_px {
                    self.split(&light, &scope)?;
                }
                Ok(view)
            }
        };
        Ok(())
    }

    /// Finds out what cascades would reach.
    fn split(&mut self, light: &ShadowLight, scope: &Scope) -> Result<(), ShadowError> {
        for splits in 2..=MOST_CASCADES {
            let Ok(plan) = plan_cascades(light, scope, &MapOptions::new(self.map_side), 0.0, splits)? else {
                break;
            };
            // Ranges without receivers or casters have no map, and fewer than two maps are no cascades.
            if let Some(maps @ 0..) = plan.cascades.len().checked_sub(2) {
                let spread = plan.texel.value * f64::from(self.map_side);
                if self.cascades[maps].is_none_or(|(_, known)| spread < known) {
                    self.cascades[maps] = Some((plan.splits, spread));
                }
            }
        }
        Ok(())
    }

    /// The maps of a layout that [`fit`](Self::fit) found to be possible, near to far, with the distance where each ends; none where nothing needs one.
    pub fn views(
        &self,
        camera: &Camera,
        stage: &Stage,
        receivers: &[DAabb],
        side: u32,
        layout: Layout,
    ) -> Result<Vec<(ShadowView, f64)>, ShadowError> {
        let Ok(best) = &self.fitted else { return Ok(Vec::new()) };
        let options = MapOptions::new(side);
        let single = |view| Ok(vec![(view, f64::INFINITY)]);
        match layout {
            Layout::Cascades(maps) => {
                let (splits, _) = self.cascades[maps as usize - 2].expect("only what was found is offered");
                let casters = [stage.all()];
                let scope = stage.scope(camera, receivers, &casters, side);
                let light = ShadowLight::directional(self.direction);
                let plan = plan_cascades(&light, &scope, &options, 0.0, splits)?;
                Ok(plan.map_or(Vec::new(), |p| p.cascades.iter().map(|c| (c.view, c.far)).collect()))
            }
            Layout::Warped if side == self.map_side => single(*best),
            Layout::Warped => single(self.focus.map(&options, self.previous.as_ref())),
            _ => single(self.focus.map(&options.with_warp(Warp::Uniform), self.previous.as_ref())),
        }
    }

    /// The finest layout there is.
    pub fn finest(&self) -> Layout {
        let Ok(best) = &self.fitted else { return Layout::Warped };
        let single = (Layout::Warped, best.texel.value * f64::from(self.map_side));
        let cascades =
            self.cascades.iter().zip(2..).filter_map(|(c, n)| Some((Layout::Cascades(n), (*c)?.1)));
        cascades.fold(single, |finest, c| if c.1 < finest.1 { c } else { finest }).0
    }

    fn find_casters(&mut self, view: &ShadowView, stage: &Stage) {
        let lit = Frustum::from_matrix(&view.clip_from_relative, view.origin, 0.0);
        self.casters.clear();
        stage.hierarchy.frustum(&lit, |object, _| self.casters.push(object));
    }

    /// A caster's triangles, as coarse as its shadow may be, and how far these are off in the world.
    fn form<'s>(&self, camera: &Camera, stage: &Stage<'s>, object: u32) -> (&'s [[u32; 3]], f64) {
        let index = object as usize;
        let instance = &stage.scene.instances()[index];
        let error = tolerance(camera, &stage.bounds[index], self.direction, CASTER_PX) / stage.stretch[index];
        let whole = || (stage.scene.mesh_of(instance).triangles(), 0.0);
        let (triangles, error) = stage.forms.within(instance.mesh.0, error).unwrap_or_else(whole);
        (triangles, error * stage.stretch[index])
    }

    /// What the planner is told, where so many samples are shaded.
    pub fn summary(
        &mut self,
        camera: &Camera,
        stage: &Stage,
        receivers: &[DAabb],
        samples: f64,
    ) -> LightView {
        self.samples = samples;
        let view = match &self.fitted {
            Err(skip) => return LightView::skipped(*skip),
            Ok(view) => view,
        };
        let mut texels = TexelSpread::of_map(view);
        texels.cascades = self.cascades.map(|c| c.map_or(f64::INFINITY, |(_, spread)| spread));
        let triangles = self.count_casters(camera, stage, receivers);
        LightView {
            receiver_pixels: samples,
            caster_triangles: triangles as f64,
            caster_draws: self.casters.len() as f64,
            contribution: 1.0,
            texels,
            penumbra_px: self.penumbra_px,
            unchanged: false,
        }
    }

    /// Chooses what casts: hierarchies where they have fewer triangles to draw than the objects' own forms; returns the number of triangles.
    fn count_casters(&mut self, camera: &Camera, stage: &Stage, receivers: &[DAabb]) -> u64 {
        let triangles = |object: u32| self.form(camera, stage, object).0.len() as u64;
        let forms: Vec<(u32, u64)> = self.casters.iter().map(|&o| (o, triangles(o))).collect();
        let mut sum = forms.iter().map(|f| f.1).sum();
        for hierarchy in &mut self.hierarchies {
            let covered = forms.iter().filter(|f| hierarchy.covers(f.0, stage.first_mover));
            let own: u64 = covered.map(|f| f.1).sum();
            hierarchy.used = false;
            if own > 0 {
                let nodes = hierarchy.choose(camera, self.direction, receivers, CASTER_PX);
                hierarchy.used = nodes < own;
                sum -= own - nodes.min(own);
            }
        }
        sum
    }

    /// Draws maps, near to far, for so many samples a point. Casters are as coarse as their shadows may be if that is wanted, or all of them in full; only
    /// the former is what the next frame goes on from.
    pub fn draw(
        &mut self,
        rasteriser: &mut Rasteriser,
        views: &[(ShadowView, f64)],
        stage: &Stage,
        camera: &Camera,
        taps: u32,
        coarse: bool,
    ) -> Result<Option<(ShadowMap, ShadowReport)>, Box<dyn Error>> {
        let before = thread_cpu_time();
        let triangles = rasteriser.counters.triangles;
        let mut casters_drawn = 0;
        let mut chain: Option<ShadowMap> = None;
        for (view, end) in views.iter().rev() {
            let (map, casters) = self.draw_one(rasteriser, view, stage, camera, taps, coarse)?;
            casters_drawn += casters;
            chain = Some(match chain {
                None => map,
                Some(beyond) => map.until(camera.eye(), camera.forward(), *end).with_beyond(beyond),
            });
        }
        let (Some(map), Ok(single)) = (chain, &self.fitted) else { return Ok(None) };
        if let ([(view, _)], true) = (views, coarse) {
            self.previous = Some(*view);
        }
        let report = ShadowReport {
            maps: views.len(),
            side: views[0].0.side,
            texel: views.iter().map(|v| v.0.texel.value).fold(0.0, f64::max),
            uniform: single.texel_uniform.value * f64::from(single.side) / f64::from(views[0].0.side),
            taps,
            penumbra_px: self.penumbra_px,
            samples: self.samples,
            casters_drawn,
            triangles: rasteriser.counters.triangles - triangles,
            time: took(before),
        };
        Ok(Some((map, report)))
    }

    /// Draws a map; returns how many casters are in it.
    fn draw_one(
        &mut self,
        rasteriser: &mut Rasteriser,
        view: &ShadowView,
        stage: &Stage,
        camera: &Camera,
        taps: u32,
        coarse: bool,
    ) -> Result<(ShadowMap, usize), Box<dyn Error>> {
        let mut options = ShadowOptions::default();
        let angular_radius = self.angular_radius as f32;
        options.penumbra = (taps > 1).then_some(Penumbra { angular_radius, taps });
        let mut map =
            ShadowMap::new(view.side, view.clip_from_relative, view.origin, -self.direction, options)?;
        let mut casters_drawn = 0;
        for hierarchy in self.hierarchies.iter_mut().filter(|h| coarse && h.used) {
            casters_drawn += hierarchy.draw(rasteriser, &mut map, view.origin, self.direction)?;
        }
        self.find_casters(view, stage);
        let drawn = |object: u32| {
            coarse && self.hierarchies.iter().any(|h| h.used && h.covers(object, stage.first_mover))
        };
        for &object in self.casters.iter().filter(|&&o| !drawn(o)) {
            let instance = &stage.scene.instances()[object as usize];
            let mesh = stage.scene.mesh_of(instance);
            let (triangles, error) =
                if coarse { self.form(camera, stage, object) } else { (mesh.triangles(), 0.0) };
            let moved = DMat4::from_translation(self.direction * aside(error));
            let relative = moved * DMat4::from(relative_from_mesh(instance, mesh, view.origin));
            map.draw(rasteriser, mesh.positions(), triangles, relative);
            casters_drawn += 1;
        }
        Ok((map, casters_drawn))
    }
}
