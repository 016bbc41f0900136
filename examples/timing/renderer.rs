//! The software renderer as a card whose time is to be predicted.

use farsight_geometry::frustum::Containment;
use farsight_geometry::glam::{DMat4, Vec4};
use farsight_geometry::{Camera, CameraError, ClipConvention, DAabb, Frustum, Scene};
use farsight_raster::{Draw, Fragment, Outputs, Rasteriser, State, Target};
use farsight_raster::{relative_from_mesh, thread_cpu_time};
use farsight_timing::{Faces, Features, Millis, Sample};

pub struct Renderer {
    scene: Scene,
    bounds: Vec<DAabb>,
    /// What of each object's features does not depend on the view.
    fixed: Vec<Features>,
    rasteriser: Rasteriser,
    target: Target,
}

impl Renderer {
    pub fn new(scene: Scene) -> Result<Self, Box<dyn std::error::Error>> {
        let mut fixed = Vec::with_capacity(scene.instances().len());
        for instance in scene.instances() {
            let mesh = scene.mesh_of(instance);
            // This renderer transforms every vertex once: its cache holds them all.
            fixed.push(Features { vertices: mesh.positions().len() as f64, ..Features::of_mesh(mesh, 16)? });
        }
        let target = Target::new(480, 270, Outputs { colour: true, depth: true, id: false })?;
        Ok(Self { bounds: scene.instance_bounds(), scene, fixed, rasteriser: Rasteriser::new(), target })
    }

    /// The camera with the renderer's image.
    pub fn lens(&self, camera: Camera) -> Result<Camera, CameraError> {
        camera.with_image(self.target.width(), self.target.height())
    }

    /// Objects in view, near ones first.
    pub fn visible(&self, camera: &Camera) -> Vec<usize> {
        let frustum = Frustum::from_camera(camera);
        let inside = |&i: &usize| frustum.classify(&self.bounds[i]) != Containment::Outside;
        let mut seen: Vec<usize> = (0..self.bounds.len()).filter(inside).collect();
        let distance = |i: usize| camera.distance_to_box(&self.bounds[i]);
        seen.sort_by(|&a, &b| distance(a).total_cmp(&distance(b)).then(a.cmp(&b)));
        seen
    }

    /// Features of a frame.
    pub fn features(&self, visible: &[usize], camera: &Camera) -> Features {
        let of = |&i: &usize| {
            let instance = &self.scene.instances()[i];
            self.fixed[i].seen(self.scene.mesh_of(instance), &instance.world_from_mesh, camera, Faces::Both)
        };
        visible.iter().map(of).fold(Features::default(), |a, b| a + b)
    }

    /// One object alone, features and time.
    pub fn time_alone(&mut self, object: usize, camera: &Camera) -> Sample {
        Sample { features: self.features(&[object], camera), time: self.time_frame(&[object], camera) }
    }

    /// A frame; the least of three, since other programs share this machine's caches.
    pub fn time_frame(&mut self, visible: &[usize], camera: &Camera) -> Millis {
        let times: [Millis; 3] = std::array::from_fn(|_| {
            self.target.clear();
            let start = thread_cpu_time();
            visible.iter().for_each(|&i| self.draw(i, camera));
            Millis::from(thread_cpu_time() - start)
        });
        times[0].min(times[1]).min(times[2])
    }

    fn draw(&mut self, object: usize, camera: &Camera) {
        let instance = &self.scene.instances()[object];
        let mesh = self.scene.mesh_of(instance);
        let relative = relative_from_mesh(instance, mesh, camera.eye());
        let clip = camera.clip_from_relative_f64(ClipConvention::REVERSED, camera.eye());
        let clip_from_local = clip * DMat4::from(relative);
        let draw = Draw {
            positions: mesh.positions(),
            triangles: mesh.triangles(),
            clip_from_local,
            state: State::default(),
        };
        let shader = |f: &Fragment| -> Option<Vec4> { Some(f.weights().extend(1.0)) };
        self.rasteriser.draw_shaded(&mut self.target, &draw, &shader);
    }
}
