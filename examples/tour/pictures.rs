//! Pictures that stand for objects: made when the plan asks for one and none serves, kept as long as they do.

use crate::frames::PictureReport;
use farsight_geometry::glam::{DMat4, DVec3};
use farsight_geometry::scene::Instance;
use farsight_geometry::{Camera, ClipConvention, Scene};
use farsight_lod::{Cache, ImpostorOptions, ImpostorView, Key, LightKey, LodError, Placement};
use farsight_plan::ObjectView;
use farsight_raster::{QuadDraw, QuadImage, Rasteriser, RenderOptions, State, render_picture};
use std::error::Error;
use std::rc::Rc;

/// Memory for pictures, and bytes of a texel: colour and height in floats.
const BUDGET: u64 = 256 << 20;
const TEXEL: u64 = 20;
/// By how much the light may turn around an object before its picture is made anew, in radians.
const LIGHT: f64 = 0.05;
/// A picture serves while its texels are at most so many times as large, and at most so many times as small, as the image's samples.
const MAGNIFIED: f64 = 1.25;
const MINIFIED: f64 = 2.0;
/// Pictures that would serve for so many frames are as good as for ever.
const FOR_EVER: f64 = 1e6;

/// Clip space of the renderer.
const CONVENTION: ClipConvention = ClipConvention::REVERSED;

/// Pictures, and where the objects and the eye were.
pub struct Pictures {
    cache: Cache<Picture>,
    options: ImpostorOptions,
    /// Direction in which the first light shines.
    light: Option<DVec3>,
    /// `None` for what is flat, of which there are no pictures.
    placements: Vec<Option<Placement>>,
    before: Option<(Camera, Vec<Option<Placement>>)>,
    report: PictureReport,
}

#[derive(Clone)]
struct Picture {
    view: ImpostorView,
    image: Rc<QuadImage>,
}

/// A picture to draw in a frame.
pub struct Drawn {
    corners: [DVec3; 3],
    image: Rc<QuadImage>,
}

impl Pictures {
    /// For a scene of which nothing was drawn yet, with so many samples to a pixel along each axis.
    pub fn new(scene: &Scene, light: Option<DVec3>, samples: u32) -> Self {
        let mut options = ImpostorOptions::default();
        options.texels_per_px = f64::from(samples);
        options.depth = true;
        Self {
            cache: Cache::new(BUDGET),
            options,
            light,
            placements: placements(scene, 0).collect(),
            before: None,
            report: PictureReport::default(),
        }
    }

    /// What was done in this frame, but for the time it took.
    pub fn report(&self) -> PictureReport {
        self.report
    }

    /// Where the objects are.
    pub fn placements(&self) -> &[Option<Placement>] {
        &self.placements
    }

    /// A new frame begins, in which the instances from `first` on have moved.
    pub fn begin(&mut self, scene: &Scene, first: u32) {
        self.report = PictureReport::default();
        self.cache.next_frame();
        self.placements.truncate(first as usize);
        self.placements.extend(placements(scene, first));
    }

    /// Tells the planner for how many frames a picture of each object would serve: as much parallax as the last step of eye and object gave each frame.
    pub fn forecast(&self, scene: &Scene, camera: &Camera, seen: &mut [ObjectView]) {
        let Some((then, before)) = &self.before else { return };
        for (i, view) in seen.iter_mut().enumerate().filter(|(_, view)| view.in_view) {
            let (Some(before), Some(now)) = (&before[i], &self.placements[i]) else { continue };
            let bounds = before.bounds(&scene.mesh_of(&scene.instances()[i]).bounds());
            // An object too near, or in part behind the eye, has no picture.
            let picture = ImpostorView::new(before, &bounds, &bounds.corners(), then, &self.options);
            let step = picture.map_or(f64::INFINITY, |p| p.parallax(now, camera).value);
            view.impostor_frames = (1.0 / step).min(FOR_EVER);
        }
    }

    /// Notes where the eye and the objects were in this frame.
    pub fn end(&mut self, camera: &Camera) {
        let (then, before) = self.before.get_or_insert_with(|| (*camera, Vec::new()));
        *then = *camera;
        before.clone_from(&self.placements);
    }

    /// A picture of an object from before, if one is at most `error_px` off.
    pub fn kept(&mut self, camera: &Camera, object: u32, error_px: f64) -> Result<Option<Drawn>, LodError> {
        let Some(placement) = self.placements[object as usize] else { return Ok(None) };
        let eye = placement.to_rigid(camera.eye());
        let serves = |_: &Key, picture: &Picture| {
            let texel = picture.view.texel_px(eye, camera) * self.options.texels_per_px;
            let px = picture.view.parallax(&placement, camera).value;
            (px <= error_px && texel <= MAGNIFIED && texel * MINIFIED >= 1.0).then_some(px)
        };
        let key = self.key(object, &placement)?;
        let Some((picture, px)) = self.cache.best(&[key], serves) else { return Ok(None) };
        self.report.kept += 1;
        self.report.parallax = self.report.parallax.max(px);
        Ok(Some(picture.drawn(&placement)))
    }

    /// A new picture of an object, drawn in these triangles; `None` where it has none, being too near or flat.
    pub fn make(
        &mut self,
        rasteriser: &mut Rasteriser,
        scene: &Scene,
        camera: &Camera,
        object: u32,
        triangles: &[[u32; 3]],
        look: &RenderOptions,
    ) -> Result<Option<Drawn>, Box<dyn Error>> {
        let Some(placement) = self.placements[object as usize] else { return Ok(None) };
        let mesh = scene.mesh_of(&scene.instances()[object as usize]);
        let bounds = placement.bounds(&mesh.bounds());
        let point = |v: &u32| *placement.stretch() * mesh.positions()[*v as usize].as_dvec3();
        let points: Vec<DVec3> = triangles.as_flattened().iter().map(point).collect();
        let view = match ImpostorView::new(&placement, &bounds, &points, camera, &self.options) {
            Ok(view) => view,
            Err(LodError::TooNear | LodError::Texture { .. } | LodError::Placement) => return Ok(None),
            Err(other) => return Err(other.into()),
        };
        // From around the eye into the object's rigid frame, and from there into the picture.
        let rigid = DMat4::from_mat3(placement.rotation().transpose())
            * DMat4::from_translation(camera.eye() - placement.anchor());
        let clip = view.clip_from_rigid(CONVENTION) * rigid;
        let target =
            render_picture(rasteriser, scene, object, triangles, camera.eye(), clip, view.size(), look)?;
        let height = |depth: f32| view.height_of_depth(depth.into(), CONVENTION) as f32;
        let picture = Picture { view, image: Rc::new(QuadImage::with_relief(&target, height)) };
        let drawn = picture.drawn(&placement);
        self.report.made += 1;
        let key = self.key(object, &placement)?;
        // What finds no room is made again in the next frame.
        let bytes = TEXEL * view.size().map(u64::from).iter().product::<u64>();
        let _ = self.cache.insert(key, picture, bytes);
        Ok(Some(drawn))
    }

    fn key(&self, object: u32, placement: &Placement) -> Result<Key, LodError> {
        let light = self.light.map_or(Ok(LightKey::NONE), |direction| {
            LightKey::direction(placement.direction_to_rigid(direction), LIGHT)
        })?;
        Ok(Key { object, version: 0, view: 0, light })
    }

    /// What the cache holds, in words.
    pub fn text(&self) -> String {
        let stats = self.cache.stats();
        format!(
            "{} pictures made, {} times drawn again, {:.1} MB at most",
            stats.inserted + stats.refused,
            stats.hits,
            stats.most_bytes as f64 * 1e-6
        )
    }
}

impl Picture {
    fn drawn(&self, placement: &Placement) -> Drawn {
        let [a, b, _, d] = self.view.corners();
        Drawn { corners: [a, b, d].map(|c| placement.to_world(c)), image: self.image.clone() }
    }
}

impl Drawn {
    /// As the renderer takes it.
    pub fn quad(&self, camera: &Camera) -> QuadDraw<'_> {
        QuadDraw {
            corners: self.corners.map(|c| (c - camera.eye()).as_vec3()),
            image: &self.image,
            cutoff: 0.5,
            clip_from_local: camera.clip_from_relative_f64(CONVENTION, camera.eye()),
            state: State::default(),
        }
    }
}

/// Placements of the instances from `first` on.
fn placements(scene: &Scene, first: u32) -> impl Iterator<Item = Option<Placement>> + '_ {
    let place = |i: &Instance| Placement::new(&i.world_from_mesh, scene.mesh_of(i).origin()).ok();
    scene.instances()[first as usize..].iter().map(place)
}
