//! What is timed: the simulated card and the software renderer, behind one face.

use farsight_geometry::frustum::Containment;
use farsight_geometry::glam::{DAffine3, DMat4, DVec3, Vec4};
use farsight_geometry::{Camera, ClipConvention, DAabb, Frustum, Scene, Sphere};
use farsight_raster::scenes::{City, Forest, Path};
use farsight_raster::{Draw, Fragment, Outputs, Rasteriser, State, Target};
use farsight_raster::{RasterError, relative_from_mesh, thread_cpu_time};
use farsight_timing::simulator::{Law, SimScene, Simulator};
use farsight_timing::{Faces, Features, Millis, sphere_pixels};

/// Something whose frames can be timed.
pub trait Backend {
    fn name(&self) -> String;
    fn objects(&self) -> usize;
    /// A camera of path 0 (the one to be predicted) or of others (to calibrate on).
    fn camera(&self, path: u32, t: f64) -> Camera;
    fn visible(&self, camera: &Camera) -> Vec<usize>;
    fn features(&self, object: usize, camera: &Camera) -> Features;
    fn sphere(&self, object: usize) -> Sphere;
    fn time_alone(&mut self, object: usize, camera: &Camera) -> Millis;
    fn time_frame(&mut self, visible: &[usize], camera: &Camera) -> Millis;
    /// Makes everything take twice as long from now on.
    fn double_the_cost(&mut self);

    /// The same with the pixels of the bounding sphere.
    fn round_features(&self, object: usize, camera: &Camera) -> Features {
        self.features(object, camera).with_pixels(sphere_pixels(&self.sphere(object), camera))
    }
}

/// The simulated card.
pub struct Simulated {
    pub scene: SimScene,
    pub card: Simulator,
}

impl Simulated {
    pub fn new(scene: SimScene, seed: u64) -> Self {
        Self { scene, card: Simulator::new(Law::default(), seed) }
    }
}

impl Backend for Simulated {
    fn name(&self) -> String {
        format!("{}, simulator", self.scene.name)
    }

    fn objects(&self) -> usize {
        self.scene.objects.len()
    }

    fn camera(&self, path: u32, t: f64) -> Camera {
        self.scene.camera(path, t)
    }

    fn visible(&self, camera: &Camera) -> Vec<usize> {
        self.scene.visible(camera)
    }

    fn features(&self, object: usize, camera: &Camera) -> Features {
        self.scene.objects[object].features(0, camera)
    }

    fn sphere(&self, object: usize) -> Sphere {
        self.scene.objects[object].sphere
    }

    fn time_alone(&mut self, object: usize, camera: &Camera) -> Millis {
        self.card.time_alone(&self.scene.objects[object], 0, camera)
    }

    fn time_frame(&mut self, visible: &[usize], camera: &Camera) -> Millis {
        self.card.time_frame(visible.iter().map(|&i| (&self.scene.objects[i], 0)), camera)
    }

    fn double_the_cost(&mut self) {
        self.card.slow_down(2.0);
    }
}

/// The software renderer, one thread, by its CPU time.
pub struct Raster {
    name: &'static str,
    scene: Scene,
    bounds: Vec<DAabb>,
    fixed: Vec<Features>,
    paths: [Path; 2],
    rasteriser: Rasteriser,
    target: Target,
    repeat: u32,
}

const SIZE: [u32; 2] = [512, 384];

impl Raster {
    pub fn city() -> Result<Self, RasterError> {
        let mut city = City::small();
        city.roof_columns_per_metre = 4.0;
        let side = city.side();
        let training = Path::through(vec![
            (DVec3::new(0.1 * side, 0.1 * side, 9.0), DVec3::new(0.6 * side, 0.5 * side, 2.0)),
            (DVec3::new(56.5, 30.0, 2.0), DVec3::new(58.0, 90.0, 4.0)),
            (DVec3::new(56.5, 0.7 * side, 2.5), DVec3::new(0.1 * side, 0.72 * side, 5.0)),
            (DVec3::new(0.8 * side, 0.9 * side, 14.0), DVec3::new(0.4 * side, 0.3 * side, 0.0)),
        ])?;
        Self::new("city", city.build()?, [Path::street_walk(&city), training])
    }

    pub fn forest() -> Result<Self, RasterError> {
        let mut forest = Forest::default();
        (forest.trees, forest.leaves) = (64, 900);
        let side = forest.side();
        let p = |x: f64, y: f64, z: f64| DVec3::new(x * side, y * side, z);
        let walk = Path::through(vec![
            (p(0.05, 0.1, 2.0), p(0.6, 0.5, 3.0)),
            (p(0.35, 0.3, 2.0), p(0.9, 0.7, 4.0)),
            (p(0.6, 0.6, 6.0), p(0.2, 1.0, 3.0)),
            (p(0.4, 0.8, 12.0), p(0.5, 0.2, 2.0)),
            (p(0.2, 0.4, 3.0), p(0.9, 0.1, 3.0)),
        ])?;
        let training = Path::through(vec![
            (p(0.9, 0.9, 2.0), p(0.3, 0.3, 3.0)),
            (p(0.6, 0.75, 3.0), p(0.2, 0.2, 4.0)),
            (p(0.3, 0.5, 9.0), p(0.9, 0.4, 1.0)),
            (p(0.6, 0.2, 2.0), p(0.3, 0.9, 5.0)),
        ])?;
        Self::new("forest", forest.build()?, [walk, training])
    }

    fn new(name: &'static str, scene: Scene, paths: [Path; 2]) -> Result<Self, RasterError> {
        // The renderer transforms every vertex of a draw once: a cache that holds them all.
        let fixed = scene.instances().iter().map(|i| {
            let mesh = scene.mesh_of(i);
            Features {
                vertices: mesh.positions().len() as f64,
                ..Features::of_mesh(mesh, 32).expect("valid meshes")
            }
        });
        let fixed = fixed.collect();
        let target = Target::new(SIZE[0], SIZE[1], Outputs { colour: true, depth: true, id: false })?;
        let bounds = scene.instance_bounds();
        Ok(Self { name, scene, bounds, fixed, paths, rasteriser: Rasteriser::new(), target, repeat: 1 })
    }

    fn draw(&mut self, object: usize, camera: &Camera) {
        let instance = &self.scene.instances()[object];
        let mesh = self.scene.mesh_of(instance);
        let relative: DAffine3 = relative_from_mesh(instance, mesh, camera.eye());
        let clip =
            camera.clip_from_relative_f64(ClipConvention::REVERSED, camera.eye()) * DMat4::from(relative);
        let (positions, triangles) = (mesh.positions(), mesh.triangles());
        let draw = Draw { positions, triangles, clip_from_local: clip, state: State::default() };
        let shader = |f: &Fragment| -> Option<Vec4> {
            let w = f.weights();
            Some(Vec4::new(w.x.sqrt(), w.y.sqrt(), w.z.sqrt(), 1.0))
        };
        self.rasteriser.draw_shaded(&mut self.target, &draw, &shader);
    }
}

impl Backend for Raster {
    fn name(&self) -> String {
        format!("{}, renderer", self.name)
    }

    fn objects(&self) -> usize {
        self.bounds.len()
    }

    fn camera(&self, path: u32, t: f64) -> Camera {
        let path = &self.paths[path.min(1) as usize];
        let (eye, target) = path.at(t);
        let camera = Camera::look_at(eye, target, DVec3::Z).and_then(|c| c.with_image(SIZE[0], SIZE[1]));
        camera.expect("paths never look straight up")
    }

    fn visible(&self, camera: &Camera) -> Vec<usize> {
        let frustum = Frustum::from_camera(camera);
        let inside = |&i: &usize| frustum.classify(&self.bounds[i]) != Containment::Outside;
        let mut seen: Vec<usize> = (0..self.bounds.len()).filter(inside).collect();
        let distance = |i: usize| camera.distance_to_box(&self.bounds[i]);
        seen.sort_by(|&a, &b| distance(a).total_cmp(&distance(b)).then(a.cmp(&b)));
        seen
    }

    fn features(&self, object: usize, camera: &Camera) -> Features {
        let instance = &self.scene.instances()[object];
        self.fixed[object].seen(self.scene.mesh_of(instance), &instance.world_from_mesh, camera, Faces::Both)
    }

    fn sphere(&self, object: usize) -> Sphere {
        Sphere::around_box(&self.bounds[object])
    }

    fn time_alone(&mut self, object: usize, camera: &Camera) -> Millis {
        let once = |this: &mut Self| {
            this.target.clear();
            let start = thread_cpu_time();
            this.draw(object, camera);
            thread_cpu_time() - start
        };
        Millis::from(once(self).min(once(self)))
    }

    fn time_frame(&mut self, visible: &[usize], camera: &Camera) -> Millis {
        let once = |this: &mut Self| {
            let start = thread_cpu_time();
            for _ in 0..this.repeat {
                this.target.clear();
                visible.iter().for_each(|&i| this.draw(i, camera));
            }
            thread_cpu_time() - start
        };
        // Other programs share caches and cores with this one; the least of three is closest to what the drawing itself takes.
        Millis::from(once(self).min(once(self)).min(once(self)))
    }

    fn double_the_cost(&mut self) {
        self.repeat *= 2;
    }
}
