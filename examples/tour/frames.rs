//! One frame: shadow map where the sun can be seen to matter, then the picture.

use crate::cull::Visibility;
use crate::predict::Prediction;
use farsight_geometry::bvh::Bvh;
use farsight_geometry::glam::DMat4;
use farsight_geometry::scene::Light;
use farsight_geometry::{Camera, DAabb, Frustum, Scene};
use farsight_raster::thread_cpu_time;
use farsight_raster::{
    Counters, MipMap, Rasteriser, RenderOptions, ShadowMap, ShadowOptions, Target, mip_maps,
    relative_from_mesh, render_scene,
};
use farsight_shadow::{Focus, MapOptions, Scope, ShadowLight, ShadowView, Skip};
use farsight_timing::Millis;
use std::error::Error;
use std::time::{Duration, Instant};

/// What a frame took.
pub struct FrameReport {
    /// Objects in the view volume.
    pub in_view: usize,
    /// Objects that are not hidden either.
    pub visible: usize,
    pub culling: Duration,
    /// Processor time of drawing, as told before and as it was.
    pub predicted: Millis,
    pub drawing: Millis,
    pub counters: Counters,
    /// The sun's map, or why there was none; `None` without a sun.
    pub shadow: Option<Result<ShadowReport, Skip>>,
    pub time: Duration,
}

/// The shadow pass of a frame.
pub struct ShadowReport {
    pub view: ShadowView,
    pub casters_drawn: usize,
    pub time: Duration,
}

/// A shadow pass: what it took, and the map.
type ShadowPass = (ShadowReport, ShadowMap);

/// Draws frames of a scene, keeping what can be kept from one to the next.
pub struct Renderer<'a> {
    scene: &'a Scene,
    bounds: &'a [DAabb],
    visibility: Visibility<'a>,
    prediction: Prediction,
    hierarchy: Bvh,
    receivers: Vec<DAabb>,
    casters: Vec<u32>,
    textures: Vec<MipMap>,
    rasteriser: Rasteriser,
    focus: Focus,
    previous: Option<ShadowView>,
    options: RenderOptions<'a>,
    map_side: u32,
}

impl<'a> Renderer<'a> {
    /// Prepares a scene; `options` must not name shadows or textures.
    pub fn new(
        scene: &'a Scene,
        bounds: &'a [DAabb],
        size: [u32; 2],
        options: RenderOptions<'a>,
        map_side: u32,
    ) -> Result<Self, Box<dyn Error>> {
        let [width, height] = size.map(|side| side * options.supersampling);
        Ok(Self {
            scene,
            visibility: Visibility::new(scene, bounds, width, height)?,
            prediction: Prediction::new()?,
            hierarchy: Bvh::build(bounds)?,
            receivers: Vec::new(),
            casters: Vec::new(),
            bounds,
            textures: mip_maps(scene),
            rasteriser: Rasteriser::new(),
            focus: Focus::new(),
            previous: None,
            options,
            map_side,
        })
    }

    /// Draws a frame.
    pub fn frame(&mut self, camera: &Camera) -> Result<(Target, FrameReport), Box<dyn Error>> {
        let start = Instant::now();
        self.look(camera);
        let mut maps = Vec::new();
        let shadow = match self.shadow(camera)? {
            None => None,
            Some(Err(skip)) => Some(Err(skip)),
            Some(Ok((report, map))) => {
                maps.push(map);
                Some(Ok(report))
            }
        };
        // Hidden is what no sample shows, so culling looks at the samples, not at the pixels.
        let n = self.options.supersampling;
        let fine = camera.with_image(camera.width() * n, camera.height() * n)?;
        let (visible, culling) = self.visibility.cull(&self.hierarchy, &fine);
        let predicted = self.prediction.predict(self.scene, visible, self.bounds, &fine);
        let mut options = self.options;
        options.shadows = &maps;
        options.textures = &self.textures;
        options.only = Some(visible);
        let before = thread_cpu_time();
        let (target, counters) = render_scene(&mut self.rasteriser, self.scene, camera, &options)?;
        let drawing = Millis::from(thread_cpu_time() - before);
        let (visible, in_view) = (visible.len(), self.receivers.len());
        self.prediction.learn(drawing)?;
        let report = FrameReport {
            in_view,
            visible,
            culling,
            predicted,
            drawing,
            counters,
            shadow,
            time: start.elapsed(),
        };
        Ok((target, report))
    }

    /// Finds what is in view.
    fn look(&mut self, camera: &Camera) {
        self.receivers.clear();
        let seen = Frustum::from_camera(camera);
        self.hierarchy.frustum(&seen, |object, _| self.receivers.push(self.bounds[object as usize]));
    }

    /// The map of the first light, if it is a sun.
    fn shadow(&mut self, camera: &Camera) -> Result<Option<Result<ShadowPass, Skip>>, Box<dyn Error>> {
        let Some(&Light::Directional { direction, .. }) = self.scene.lights().first() else {
            return Ok(None);
        };
        let start = Instant::now();
        let scene_box = self.bounds.iter().fold(DAabb::EMPTY, |b, i| b.union(*i));
        // Beyond the far side of the scene there is nothing to shade.
        let farthest =
            scene_box.corners().iter().map(|c| c.distance(camera.eye())).fold(camera.near(), f64::max);
        let casters = [scene_box];
        let scope = Scope::new(camera, farthest * 1.001, &self.receivers, &casters, self.map_side);
        let skip = self.focus.fit(&ShadowLight::directional(direction), &scope)?;
        if let Some(skip) = skip {
            return Ok(Some(Err(skip)));
        }
        let view = self.focus.map(&MapOptions::new(self.map_side), self.previous.as_ref());
        self.previous = Some(view);
        let mut map = ShadowMap::new(
            self.map_side,
            view.clip_from_relative,
            view.origin,
            -direction,
            ShadowOptions::default(),
        )?;
        let lit = Frustum::from_matrix(&view.clip_from_relative, view.origin, 0.0);
        self.casters.clear();
        self.hierarchy.frustum(&lit, |object, _| self.casters.push(object));
        for &object in &self.casters {
            let instance = &self.scene.instances()[object as usize];
            let mesh = self.scene.mesh_of(instance);
            let relative = DMat4::from(relative_from_mesh(instance, mesh, view.origin));
            map.draw(&mut self.rasteriser, mesh.positions(), mesh.triangles(), relative);
        }
        Ok(Some(Ok((ShadowReport { view, casters_drawn: self.casters.len(), time: start.elapsed() }, map))))
    }
}
