//! A walk with culling by the software depth buffer.

use farsight_geometry::bvh::Bvh;
use farsight_geometry::glam::DMat4;
use farsight_geometry::{Camera, ClipConvention, DAabb, Scene};
use farsight_occlusion::{
    Answer, Backend, Command, Culler, DepthBuffer, Faces, NodeId, Occluders, Options, Proxy, View,
};
use farsight_raster::{Draw, Ids, Outputs, Rasteriser, State, Target, relative_from_mesh, thread_cpu_time};
use std::error::Error;
use std::time::Duration;

/// A scene and the tree over its objects.
pub struct Town<'a> {
    scene: &'a Scene,
    boxes: Vec<DAabb>,
    pub bvh: Bvh,
}

/// Sums over a walk.
#[derive(Clone, Debug, Default)]
pub struct Report {
    frames: u64,
    drawn: u64,
    triangles: u64,
    visited: u64,
    queries: u64,
    late: u64,
    time: Duration,
    /// Depths of every frame.
    depths: Vec<Vec<u32>>,
}

impl Report {
    /// One line; differences are to `reference`.
    pub fn print(&self, name: &str, reference: Option<&Report>) {
        let per_frame = |n: u64| n as f64 / self.frames as f64;
        let differing = |r: &Report| {
            let pairs = r.depths.iter().flatten().zip(self.depths.iter().flatten());
            pairs.filter(|(a, b)| a != b).count()
        };
        println!(
            "{name:<24} {:>8.1} {:>9.0} {:>8.1} {:>8.1} {:>7.1} {:>9.2} {:>8}",
            per_frame(self.drawn),
            per_frame(self.triangles),
            per_frame(self.visited),
            per_frame(self.queries),
            per_frame(self.late),
            self.time.as_secs_f64() * 1e3 / self.frames as f64,
            reference.map_or(0, differing),
        );
    }
}

/// Who draws and who answers.
struct Frame<'a> {
    town: &'a Town<'a>,
    camera: &'a Camera,
    clip_from_relative: DMat4,
    target: &'a mut Target,
    rasteriser: &'a mut Rasteriser,
    buffer: &'a mut DepthBuffer,
    occluders: &'a mut Occluders,
    triangles: u64,
}

impl<'a> Town<'a> {
    pub fn new(scene: &'a Scene) -> Result<Self, Box<dyn Error>> {
        let boxes = scene.instance_bounds();
        let bvh = Bvh::build(&boxes)?;
        Ok(Self { scene, boxes, bvh })
    }

    /// Draws all frames; times include the culling and exclude clearing and comparing images.
    pub fn walk(&self, options: Options, cameras: &[Camera]) -> Result<(Report, Culler), Box<dyn Error>> {
        let mut culler = Culler::new(options, Backend::Boolean)?;
        let mut report = Report::default();
        let (width, height) = (cameras[0].width(), cameras[0].height());
        let mut target = Target::new(width, height, Outputs::DEPTH_ID)?;
        let mut buffer = DepthBuffer::new(width, height)?;
        let mut rasteriser = Rasteriser::new();
        let mut occluders = Occluders::new(150_000, 24.0);
        // Where nothing asks, occluders would be drawn for nobody.
        let asks = options.algorithm != farsight_occlusion::Algorithm::FrustumOnly;
        for camera in cameras {
            target.clear();
            let start = thread_cpu_time();
            buffer.clear();
            occluders.clear();
            let clip_from_relative = camera.clip_from_relative_f64(ClipConvention::REVERSED, camera.eye());
            let mut frame = Frame {
                town: self,
                camera,
                clip_from_relative,
                target: &mut target,
                rasteriser: &mut rasteriser,
                buffer: &mut buffer,
                occluders: &mut occluders,
                triangles: 0,
            };
            culler.begin_frame(View::from_camera(camera));
            loop {
                match culler.next(&self.bvh) {
                    Command::Render(leaf) => frame.draw(leaf, asks),
                    Command::Query { id, proxy, .. } => {
                        let answer = frame.answer(&proxy, culler.boxes());
                        culler.resolve(id, answer);
                    }
                    Command::Flush => {}
                    Command::Done => break,
                }
            }
            report.time += thread_cpu_time() - start;
            report.triangles += frame.triangles;
            let stats = culler.stats();
            report.frames += 1;
            report.drawn += stats.rendered;
            report.visited += stats.visited;
            report.queries += stats.queries;
            report.late += stats.discoveries;
            report.depths.push(target.depth_rows().flatten().map(|d| d.to_bits()).collect());
        }
        Ok((report, culler))
    }
}

impl Frame<'_> {
    fn draw(&mut self, leaf: NodeId, may_occlude: bool) {
        let Some(object) = self.town.bvh.object(leaf) else { return };
        let scene = self.town.scene;
        let instance = &scene.instances()[object as usize];
        let mesh = scene.mesh_of(instance);
        let relative = relative_from_mesh(instance, mesh, self.camera.eye());
        let clip_from_local = self.clip_from_relative * DMat4::from(relative);
        let (positions, triangles) = (mesh.positions(), mesh.triangles());
        let mut state = State::default();
        state.ids = Ids::Constant(object + 1);
        self.rasteriser.draw(self.target, &Draw { positions, triangles, clip_from_local, state });
        self.triangles += triangles.len() as u64;
        let size = self.camera.box_px(&self.town.boxes[object as usize]);
        if may_occlude && self.occluders.admits(size, triangles.len() as u64) {
            self.buffer.draw(&clip_from_local, positions, triangles, Faces::Both);
        }
    }

    fn answer(&mut self, proxy: &Proxy, boxes: &[DAabb]) -> Answer {
        let (clip, eye) = (self.clip_from_relative, self.camera.eye());
        let hidden = match proxy {
            Proxy::Box(b) => self.buffer.is_occluded(&clip, eye, b),
            Proxy::Boxes => boxes.iter().all(|b| self.buffer.is_occluded(&clip, eye, b)),
            Proxy::Geometry => false,
        };
        if hidden { Answer::OCCLUDED } else { Answer::VISIBLE }
    }
}
