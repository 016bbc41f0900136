//! A walk along the avenue: what is shown in each frame, for what reason, and what that costs.

use crate::engine::{Object, Renderer};
use crate::picture;
use farsight_geometry::glam::DVec3;
use farsight_geometry::{Camera, ClipConvention, Containment, Frustum, TriangleMesh};
use farsight_lod::{Approximation, Approximations, Cut, Decision, Kind, LightKey, Subject, VertexHierarchy};
use farsight_raster::{Image, Outputs, QuadImage, Target, thread_cpu_time};
use std::error::Error;
use std::rc::Rc;
use std::time::Duration;

/// What an object was shown as.
#[derive(Clone, Debug)]
pub struct Row {
    pub object: usize,
    pub kind: Kind,
    pub distance: f64,
    /// Triangles, or texels of the picture.
    pub size: String,
    pub error_px: f64,
    pub made: usize,
    pub predicted: f64,
    pub decision: Option<Decision>,
}

/// A frame.
pub struct Frame {
    pub rows: Vec<Row>,
    pub triangles: usize,
    pub pictures: usize,
    pub made: usize,
    /// Deciding, making and drawing.
    pub time: Duration,
    pub image: Option<Image>,
}

pub struct Walk<'a> {
    pub meshes: &'a [TriangleMesh],
    pub hierarchies: &'a [VertexHierarchy],
    pub objects: &'a [Object],
    cuts: Vec<Cut>,
    /// What was decided last for each object, and in which frame it was made.
    last: Vec<(Option<Decision>, usize, f64)>,
    frame: usize,
}

impl<'a> Walk<'a> {
    pub fn new(
        meshes: &'a [TriangleMesh],
        hierarchies: &'a [VertexHierarchy],
        objects: &'a [Object],
    ) -> Self {
        let cuts = objects.iter().map(|o| Cut::new(&hierarchies[o.model])).collect();
        Self { meshes, hierarchies, objects, cuts, last: vec![(None, 0, f64::NAN); objects.len()], frame: 0 }
    }

    /// Draws a frame of approximations; with a picture and the triangles in its corner if `pictured`.
    pub fn frame(
        &mut self,
        approximations: &mut Approximations<Rc<QuadImage>>,
        renderer: &mut Renderer,
        camera: &Camera,
        pictured: bool,
    ) -> Result<Frame, Box<dyn Error>> {
        let outputs = Outputs { colour: true, depth: true, id: false };
        let mut target = Target::new(camera.width(), camera.height(), outputs)?;
        picture::ground(&mut renderer.rasteriser, &mut target, camera);
        let mut wires = picture::Wires::new(camera)?;
        let mut frame =
            Frame { rows: vec![], triangles: 0, pictures: 0, made: 0, time: Duration::ZERO, image: None };
        approximations.next_frame();
        for object in visible(self.objects, camera) {
            let Object { model, placement, bounds } = &self.objects[object];
            let start = thread_cpu_time();
            let light = LightKey::direction(placement.direction_to_rigid(renderer.sun), 0.02)?;
            let mut subject = Subject {
                object: object as u32,
                version: 0,
                view: 0,
                light,
                mesh: &self.meshes[*model],
                hierarchy: &self.hierarchies[*model],
                cut: &mut self.cuts[object],
                placement,
            };
            let shown = approximations.approximate(&mut subject, camera, renderer)?;
            if shown.fresh {
                frame.made += 1;
                self.last[object] = (shown.decision, self.frame, shown.predicted_frames);
            } else if shown.decision.is_some() {
                self.last[object].0 = shown.decision;
            }
            renderer.draw(&mut target, camera, object, shown.approximation);
            frame.time += thread_cpu_time() - start;
            let size = match shown.approximation {
                Approximation::Geometry { triangles, .. } => {
                    frame.triangles += triangles.len();
                    format!("{} of {} triangles", triangles.len(), self.meshes[*model].triangles().len())
                }
                Approximation::Impostor { view, .. } => {
                    frame.pictures += 1;
                    let [width, height] = view.size();
                    format!("{width} × {height} texels")
                }
            };
            if pictured {
                wires.add(renderer, &self.objects[object], &self.meshes[*model], shown.approximation, camera);
            }
            let (decision, made, predicted) = self.last[object];
            frame.rows.push(Row {
                object,
                kind: shown.approximation.kind(),
                distance: bounds.closest_point(camera.eye()).distance(camera.eye()),
                size,
                error_px: shown.error.value,
                made: self.frame - made,
                predicted,
                decision,
            });
        }
        if pictured {
            frame.image = Some(wires.inset(picture::finished(target))?);
        }
        self.frame += 1;
        Ok(frame)
    }
}

/// All objects drawn whole: the picture, and what that takes.
pub struct Whole {
    pub image: Image,
    pub time: Duration,
    pub triangles: usize,
}

/// Draws all objects whole.
pub fn whole(
    renderer: &mut Renderer,
    meshes: &[TriangleMesh],
    objects: &[Object],
    camera: &Camera,
) -> Result<Whole, Box<dyn Error>> {
    let mut target =
        Target::new(camera.width(), camera.height(), Outputs { colour: true, depth: true, id: false })?;
    picture::ground(&mut renderer.rasteriser, &mut target, camera);
    let start = thread_cpu_time();
    let mut triangles = 0;
    for object in visible(objects, camera) {
        let all = meshes[objects[object].model].triangles();
        triangles += all.len();
        renderer.draw_triangles(&mut target, camera, object, all);
    }
    let time = thread_cpu_time() - start;
    Ok(Whole { image: picture::finished(target), time, triangles })
}

/// Objects in view, near ones first.
pub fn visible(objects: &[Object], camera: &Camera) -> Vec<usize> {
    let frustum = Frustum::from_camera(camera);
    let mut seen: Vec<usize> = (0..objects.len())
        .filter(|&i| frustum.classify(&objects[i].bounds) != Containment::Outside)
        .collect();
    let distance = |i: usize| camera.distance_to_box(&objects[i].bounds);
    seen.sort_by(|&a, &b| distance(a).total_cmp(&distance(b)).then(a.cmp(&b)));
    seen
}

/// Where the eye is in a frame of a walk of `frames`.
pub fn camera(frame: usize, size: [u32; 2]) -> Result<Camera, Box<dyn Error>> {
    let along = 0.05 * frame as f64;
    let eye = DVec3::new(-9.0 + along, 0.6 + 0.25 * (0.02 * frame as f64).sin(), 2.1);
    let camera = Camera::look_at(eye, eye + DVec3::new(10.0, -0.6, -0.35), DVec3::Z)?;
    Ok(camera.with_image(size[0], size[1])?.with_range(0.1, 500.0)?)
}

/// Clip space, relative to the eye.
pub fn clip(camera: &Camera) -> farsight_geometry::glam::DMat4 {
    camera.clip_from_relative_f64(ClipConvention::REVERSED, camera.eye())
}
