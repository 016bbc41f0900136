//! One frame: planned, its shadow map where the sun can be seen to matter, then the picture.

use crate::built::Built;
use crate::cells::Cells;
use crate::compare::Comparison;
use crate::cull::Visibility;
use crate::forms::Forms;
use crate::movers::Movers;
use crate::nodes::{Nodes, NodesReport};
use crate::pictures::Pictures;
use crate::planning::Planning;
use crate::shaping::Shaping;
use crate::sun::{ShadowReport, Stage, Sun};
use farsight_geometry::bvh::Bvh;
use farsight_geometry::{Camera, DAabb, Frustum, Scene};
use farsight_plan::{Budget, Choice, Effect, Layout, Plan, Tolerances};
use farsight_raster::{
    Counters, MipMap, Rasteriser, RenderOptions, ShadowMap, Target, mip_maps, render_scene, thread_cpu_time,
};
use farsight_timing::Millis;
use std::error::Error;
use std::time::Duration;

/// What a frame took.
pub struct FrameReport {
    /// Objects in the view volume.
    pub in_view: usize,
    /// Objects that were drawn.
    pub drawn: usize,
    /// What was decided; `None` where everything runs.
    pub plan: Option<Plan>,
    pub counters: Counters,
    /// The sun's maps, if any were drawn.
    pub shadow: Option<ShadowReport>,
    /// Pictures that stood for objects.
    pub pictures: PictureReport,
    /// Nodes of hierarchies that stood for large surfaces.
    pub nodes: NodesReport,
    /// Nodes of the movers' hierarchies that were looked at.
    pub tests: u64,
    /// Processor time as foretold, and as it was.
    pub predicted: Millis,
    pub time: Millis,
    /// Of this, the time that looking for hidden objects took.
    pub culling: Millis,
}

/// Pictures in a frame: made for it, drawn again, and their largest parallax in pixels.
#[derive(Clone, Copy, Default)]
pub struct PictureReport {
    pub made: usize,
    pub kept: usize,
    pub parallax: f64,
    pub time: Millis,
}

/// Share of a frame's time that may go into pictures for frames to come.
const MAKING: f64 = 0.15;

/// Processor time of this thread since a moment of its [`thread_cpu_time`].
pub fn took(since: Duration) -> Millis {
    Millis::from(thread_cpu_time() - since)
}

/// How a frame follows the one before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// Some time later, on the same way.
    Walk,
    /// From somewhere else.
    Jump,
    /// A moment later: nothing may wait.
    Flow,
}

/// How shadows may be at most: the side of their maps, and half of the angle that the sun spans.
#[derive(Clone, Copy)]
pub struct Shadows {
    pub map_side: u32,
    pub sun_radius: f64,
}

/// Draws frames of a scene, keeping what can be kept from one to the next.
pub struct Renderer<'a> {
    scene: &'a mut Scene,
    forms: &'a Forms,
    cells: &'a Cells,
    movers: Option<Movers>,
    pictures: Pictures,
    bounds: Vec<DAabb>,
    stretch: Vec<f64>,
    hierarchy: Bvh,
    visibility: Visibility,
    planning: Planning<'a>,
    textures: Vec<MipMap>,
    rasteriser: Rasteriser,
    sun: Option<Sun>,
    nodes: Nodes,
    receivers: Vec<DAabb>,
    options: RenderOptions<'a>,
    map_side: u32,
    tolerances: Tolerances,
    /// Instances from here on move.
    first_mover: u32,
}

/// The scene as the sun sees it, from some of the renderer's fields.
macro_rules! stage {
    ($renderer:ident) => {
        Stage {
            scene: &*$renderer.scene,
            hierarchy: &$renderer.hierarchy,
            bounds: &$renderer.bounds,
            stretch: &$renderer.stretch,
            forms: $renderer.forms,
            first_mover: $renderer.first_mover,
        }
    };
}

impl<'a> Renderer<'a> {
    /// Prepares a scene for which something was built; `options` must not name shadows, textures, forms or quads.
    pub fn new(
        scene: &'a mut Scene,
        built: &'a Built,
        movers: Option<Movers>,
        size: [u32; 2],
        options: RenderOptions<'a>,
        shadows: Shadows,
        budget: Budget,
    ) -> Result<Self, Box<dyn Error>> {
        let [width, height] = size.map(|side| side * options.supersampling);
        let bounds = scene.instance_bounds();
        let Shadows { map_side, sun_radius } = shadows;
        let sun = Sun::of(scene, map_side, sun_radius, built.caster_stores());
        let planning =
            Planning::new(scene, &built.forms, sun.as_ref().map(Sun::light), width * height, budget)?;
        Ok(Self {
            forms: &built.forms,
            cells: &built.cells,
            pictures: Pictures::new(scene, sun.as_ref().map(|s| s.direction), options.supersampling),
            hierarchy: Bvh::build(&bounds)?,
            stretch: (0..bounds.len() as u32).map(|o| planning.stretch(o)).collect(),
            first_mover: movers.as_ref().map_or(bounds.len() as u32, |m| m.instances().start),
            movers,
            bounds,
            visibility: Visibility::new(scene, width, height)?,
            planning,
            textures: mip_maps(scene),
            rasteriser: Rasteriser::new(),
            sun,
            nodes: Nodes::new(&built.surfaces)?,
            receivers: Vec::new(),
            options,
            map_side,
            tolerances: budget.tolerances,
            scene,
        })
    }

    /// Moves what moves to where it is at a time in seconds.
    pub fn fly(&mut self, time: f64) -> Result<(), Box<dyn Error>> {
        if let Some(movers) = &self.movers {
            movers.fly(self.scene, time)?;
            for object in movers.instances() {
                let instance = &self.scene.instances()[object as usize];
                let bounds =
                    self.scene.mesh_of(instance).world_bounds().transformed(&instance.world_from_mesh);
                self.bounds[object as usize] = bounds;
                self.hierarchy.set_bounds(object, bounds)?;
            }
        }
        self.pictures.begin(self.scene, self.first_mover);
        Ok(())
    }

    /// Draws what the plan for this view asks for.
    pub fn planned(&mut self, camera: &Camera, pace: Pace) -> Result<(Target, FrameReport), Box<dyn Error>> {
        let start = thread_cpu_time();
        let plan = self.plan(camera, pace == Pace::Jump)?;
        let predicted = plan.cost + self.planning.constant();
        let map = match choice(&plan, Effect::Shadow { light: 0 }) {
            Choice::Map { layout, side, taps, .. } => self.draw_map(camera, side, layout, taps, true)?,
            _ => None,
        };
        let (map, shadow) = map.unzip();

        let allowed_px = self.tolerances.position_px * plan.allowed;
        self.follow_movers(&plan, camera, allowed_px)?;
        let of_detail = |object: u32| match plan.objects()[object as usize].choice {
            Choice::Detail { detail, .. } => Some(detail),
            _ => None,
        };
        let drawn_nodes = self.nodes.choose(camera, of_detail, pace != Pace::Flow)?;
        let fine = self.fine(camera)?;
        let first_mover = self.first_mover;
        let Self { scene, forms, cells, movers, nodes, pictures, visibility, planning, rasteriser, .. } =
            self;
        let (movers, seen) = (movers.as_ref(), planning.seen());
        let shaping = Shaping { scene, forms, movers, nodes, seen, plan: &plan, allowed_px };
        let mut shapes = shaping.shapes();

        let before = thread_cpu_time();
        let occlusion = choice(&plan, Effect::Occlusion);
        let with_sets = matches!(occlusion, Choice::Cells | Choice::CellsAndQueries);
        let set = cells.at(camera.eye()).filter(|_| with_sets).map(|c| &c.set);
        // The sets know of nothing that moves.
        let in_set = |o: u32| o >= first_mover || set.is_none_or(|s| s.contains(o));
        let wanted = |o: &u32| plan.objects()[*o as usize].choice != Choice::Nothing && in_set(*o);
        let culls = matches!(occlusion, Choice::Queries | Choice::CellsAndQueries);
        let objects: Vec<u32> = if culls {
            visibility.cull(scene, &self.hierarchy, &fine, &shapes).iter().copied().filter(wanted).collect()
        } else {
            (0..plan.objects().len() as u32).filter(wanted).collect()
        };
        let culling = took(before);

        let before = thread_cpu_time();
        let mut look = self.options;
        look.shadows = map.as_slice();
        look.textures = &self.textures;
        let limit = predicted * MAKING;
        let (drawn, making) =
            shaping.stand_ins(pictures, rasteriser, camera, &objects, &look, limit, &mut shapes)?;
        let quads: Vec<_> = drawn.iter().map(|d| d.quad(camera)).collect();
        look.quads = &quads;
        look.only = Some(&objects);
        look.forms = &shapes;
        let parts = nodes.parts(look.supersampling);
        look.parts = &parts;
        let (target, counters) = render_scene(rasteriser, scene, camera, &look)?;
        let drawing = took(before);
        pictures.end(camera);
        let time = took(start);

        let all: Millis = plan.objects().iter().map(|d| d.cost).sum();
        let unhidden: Millis = objects.iter().map(|&o| plan.objects()[o as usize].cost).sum();
        let share = if all.0 > 0.0 { unhidden / all } else { 1.0 };
        let in_view = seen.iter().filter(|s| s.in_view).count();
        planning.learn(share, drawing - making, shadow.as_ref().map(|s| s.time))?;
        if culls {
            planning.learn_culling(all - unhidden, culling);
        }
        let report = FrameReport {
            in_view,
            drawn: objects.len(),
            plan: Some(plan),
            counters,
            shadow,
            pictures: PictureReport { time: making, ..pictures.report() },
            nodes: drawn_nodes,
            tests: movers.map_or(0, |m| m.tests),
            predicted,
            time,
            culling,
        };
        Ok((target, report))
    }

    /// Brings the cuts of what moves up to date, where coarser forms or pictures are drawn of it.
    fn follow_movers(&mut self, plan: &Plan, camera: &Camera, allowed_px: f64) -> Result<(), Box<dyn Error>> {
        let Some(movers) = &mut self.movers else { return Ok(()) };
        let coarser = |o: u32| {
            matches!(plan.objects()[o as usize].choice, Choice::Detail { .. } | Choice::Impostor { .. })
        };
        Ok(movers.follow(self.pictures.placements(), camera, allowed_px, coarser)?)
    }

    /// Looks at the scene and decides.
    fn plan(&mut self, camera: &Camera, jumped: bool) -> Result<Plan, Box<dyn Error>> {
        self.fit(camera)?;
        let samples = f64::from(self.options.supersampling).powi(2);
        let all = f64::from(camera.width()) * f64::from(camera.height()) * samples;
        let stage = stage!(self);
        let seen = self.planning.look(camera, &self.bounds, samples);
        let shaded = seen.iter().map(|s| s.pixels).sum::<f64>().min(all);
        let light = self.sun.as_mut().map(|sun| sun.summary(camera, &stage, &self.receivers, shaded));
        if !jumped {
            self.pictures.forecast(self.scene, camera, seen);
        }
        let details = |object: u32| self.forms.details(self.scene.instances()[object as usize].mesh.0);
        self.nodes.look(camera, self.tolerances.position_px, self.planning.seen(), details);
        let cell = self.cells.at(camera.eye()).map(|c| c.view());
        Ok(self.planning.plan(all, light, cell, jumped, self.nodes.offers())?.clone())
    }

    /// Draws without a plan: all triangles of everything in view, the finest shadow maps, as soft as can be.
    pub fn everything(&mut self, camera: &Camera) -> Result<(Target, FrameReport), Box<dyn Error>> {
        let start = thread_cpu_time();
        self.fit(camera)?;
        let finest = self.sun.as_ref().map_or(Layout::Warped, Sun::finest);
        let taps = self.sun.as_ref().map_or(0, Sun::most_taps).max(1);
        let (map, shadow) = self.draw_map(camera, self.map_side, finest, taps, false)?.unzip();
        let mut objects = Vec::with_capacity(self.receivers.len());
        self.hierarchy.frustum(&Frustum::from_camera(camera), |object, _| objects.push(object));
        let mut look = self.options;
        look.shadows = map.as_slice();
        look.textures = &self.textures;
        look.only = Some(&objects);
        let (target, counters) = render_scene(&mut self.rasteriser, self.scene, camera, &look)?;
        let report = FrameReport {
            in_view: self.receivers.len(),
            drawn: objects.len(),
            plan: None,
            counters,
            shadow,
            pictures: PictureReport::default(),
            nodes: NodesReport::default(),
            tests: 0,
            predicted: Millis::ZERO,
            time: took(start),
            culling: Millis::ZERO,
        };
        Ok((target, report))
    }

    /// A planned image beside the same without a plan.
    pub fn compared(&mut self, camera: &Camera, planned: &Target) -> Result<Comparison, Box<dyn Error>> {
        let (full, report) = self.everything(camera)?;
        Ok(Comparison::new(planned, &full, report)?)
    }

    /// The camera of the samples: hidden is what no sample shows.
    fn fine(&self, camera: &Camera) -> Result<Camera, Box<dyn Error>> {
        let n = self.options.supersampling;
        Ok(camera.with_image(camera.width() * n, camera.height() * n)?)
    }

    /// Finds what is in view, and fits the sun's maps to it.
    fn fit(&mut self, camera: &Camera) -> Result<(), Box<dyn Error>> {
        self.receivers.clear();
        let seen = Frustum::from_camera(camera);
        self.hierarchy.frustum(&seen, |object, _| self.receivers.push(self.bounds[object as usize]));
        let stage = stage!(self);
        let texel_px = self.tolerances.texel_px;
        self.sun.as_mut().map_or(Ok(()), |sun| sun.fit(camera, &stage, &self.receivers, texel_px))
    }

    /// Draws the sun's maps, where there is need of any; with casters as coarse as their shadows may be, or in full.
    fn draw_map(
        &mut self,
        camera: &Camera,
        side: u32,
        layout: Layout,
        taps: u32,
        coarse: bool,
    ) -> Result<Option<(ShadowMap, ShadowReport)>, Box<dyn Error>> {
        let stage = stage!(self);
        let Some(sun) = &mut self.sun else { return Ok(None) };
        let views = sun.views(camera, &stage, &self.receivers, side, layout)?;
        sun.draw(&mut self.rasteriser, &views, &stage, camera, taps, coarse)
    }

    /// What became of the pictures so far, in words.
    pub fn pictures_text(&self) -> String {
        self.pictures.text()
    }
}

/// What a plan has chosen for an effect; nothing where it does not speak of it.
fn choice(plan: &Plan, effect: Effect) -> Choice {
    plan.decision(effect).map_or(Choice::Nothing, |d| d.choice)
}
