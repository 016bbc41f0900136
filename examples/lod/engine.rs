//! The reference renderer as the engine behind approximations: draws triangles and pictures, makes pictures, knows what that costs.

use farsight_geometry::bvh::Bvh;
use farsight_geometry::glam::{DMat4, DVec3, Mat3, Vec3, Vec4};
use farsight_geometry::{Camera, ClipConvention, DAabb, Frustum, TriangleMesh};
use farsight_lod::{
    Approximation, Costs, Engine, ImpostorOptions, ImpostorRenderer, ImpostorView, Placement, Work,
    is_separable,
};
use farsight_raster::{
    Draw, Fragment, Outputs, QuadDraw, QuadImage, RasterError, Rasteriser, State, Target, linear_of,
    thread_cpu_time,
};
use std::error::Error;
use std::rc::Rc;
use std::time::Duration;

/// An object: its mesh, where it is.
pub struct Object {
    pub model: usize,
    pub placement: Placement,
    pub bounds: DAabb,
}

/// What drawing takes per unit, measured when the program starts.
#[derive(Clone, Copy, Debug)]
pub struct Rates {
    pub triangle: Duration,
    /// A pixel of a mesh, lit.
    pub pixel: Duration,
    /// A pixel of a picture.
    pub texel: Duration,
    /// Pixels of a mesh over those of its picture: less than one for the gaps, more for what covers itself.
    pub fill: f64,
}

pub struct Renderer<'a> {
    pub meshes: &'a [TriangleMesh],
    pub objects: &'a [Object],
    pub bvh: &'a Bvh,
    /// Direction in which the light travels.
    pub sun: DVec3,
    pub rates: Rates,
    pub rasteriser: Rasteriser,
    /// Time spent on pictures.
    pub making: Duration,
}

impl<'a> Renderer<'a> {
    pub fn new(meshes: &'a [TriangleMesh], objects: &'a [Object], bvh: &'a Bvh, sun: DVec3) -> Self {
        let zero = Duration::ZERO;
        let rates = Rates { triangle: zero, pixel: zero, texel: zero, fill: 1.0 };
        Self { meshes, objects, bvh, sun, rates, rasteriser: Rasteriser::new(), making: Duration::ZERO }
    }

    /// Draws triangles of an object's mesh.
    pub fn draw_triangles(
        &mut self,
        target: &mut Target,
        camera: &Camera,
        object: usize,
        triangles: &[[u32; 3]],
    ) {
        let Object { model, placement, .. } = &self.objects[object];
        let relative = DMat4::from_translation(placement.anchor() - camera.eye())
            * DMat4::from_mat3(*placement.rotation() * *placement.stretch());
        let clip = camera.clip_from_relative_f64(ClipConvention::REVERSED, camera.eye()) * relative;
        self.draw_lit(target, *model, &placement.clone(), triangles, clip);
    }

    fn draw_lit(
        &mut self,
        target: &mut Target,
        model: usize,
        placement: &Placement,
        triangles: &[[u32; 3]],
        clip: DMat4,
    ) {
        let mesh = &self.meshes[model];
        let matrix = (*placement.rotation() * *placement.stretch()).inverse().transpose().as_mat3();
        let surface = Surface { mesh, triangles, normal_matrix: matrix, to_sun: -self.sun.as_vec3() };
        let draw =
            Draw { positions: mesh.positions(), triangles, clip_from_local: clip, state: State::default() };
        self.rasteriser.draw_shaded(target, &draw, &|f: &Fragment| Some(surface.colour(f)));
    }

    /// Draws a picture where it belongs.
    pub fn draw_picture(
        &mut self,
        target: &mut Target,
        camera: &Camera,
        object: usize,
        view: &ImpostorView,
        image: &QuadImage,
    ) {
        let placement = &self.objects[object].placement;
        let corners = view.corners().map(|c| (placement.to_world(c) - camera.eye()).as_vec3());
        let draw = QuadDraw {
            corners: [corners[0], corners[1], corners[3]],
            image,
            cutoff: 0.5,
            clip_from_local: camera.clip_from_relative_f64(ClipConvention::REVERSED, camera.eye()),
            state: State::default(),
        };
        self.rasteriser.draw_quad(target, &draw);
    }

    /// Draws whatever stands for an object.
    pub fn draw(
        &mut self,
        target: &mut Target,
        camera: &Camera,
        object: usize,
        shown: &Approximation<Rc<QuadImage>>,
    ) {
        match shown {
            Approximation::Geometry { triangles, .. } => {
                self.draw_triangles(target, camera, object, triangles)
            }
            Approximation::Impostor { view, image, .. } => {
                self.draw_picture(target, camera, object, view, image)
            }
        }
    }

    /// Measures what triangles, pixels and texels take: the first object so small that its pixels do not matter, then large, and a picture.
    pub fn calibrate(&mut self) -> Result<(), Box<dyn Error>> {
        let Object { model, placement, bounds } = &self.objects[0];
        let mesh = &self.meshes[*model];
        let triangles = mesh.triangles();
        let side = 512;
        let mut target = Target::new(side, side, Outputs { colour: true, depth: true, id: false })?;
        let camera = |away: f64| {
            let eye = bounds.center() + DVec3::new(1.0, 0.3, 0.2) * bounds.diagonal() * away;
            Camera::look_at(eye, bounds.center(), DVec3::Z).and_then(|c| c.with_image(side, side))
        };
        let (far, near) = (camera(60.0)?, camera(0.9)?);
        let small = least(&mut || self.draw_triangles(&mut target, &far, 0, triangles));
        self.rates.triangle = small / triangles.len().max(1) as u32;
        target.clear();
        let before = self.rasteriser.counters.pixels_written;
        self.draw_triangles(&mut target, &near, 0, triangles);
        let pixels = self.rasteriser.counters.pixels_written - before;
        let large = least(&mut || {
            target.clear();
            self.draw_triangles(&mut target, &near, 0, triangles);
        });
        self.rates.pixel = large.saturating_sub(small) / pixels.max(1) as u32;

        let mut options = ImpostorOptions::default();
        options.depth = true;
        let points: Vec<DVec3> =
            mesh.corner_iter().flatten().map(|p| *placement.stretch() * p.as_dvec3()).collect();
        let box_in_frame = placement.bounds(&mesh.bounds());
        let view = ImpostorView::new(placement, &box_in_frame, &points, &near, &options)?;
        let [width, height] = view.size();
        let texels = width * height;
        self.rates.fill = pixels as f64 / f64::from(texels);
        let image = self.render(0, &view, placement, triangles)?;
        let drawn = least(&mut || {
            target.clear();
            self.draw_picture(&mut target, &near, 0, &view, &image);
        });
        self.rates.texel = drawn / texels;
        Ok(())
    }
}

/// The least time of five runs.
fn least(work: &mut dyn FnMut()) -> Duration {
    let times = (0..5).map(|_| {
        let start = thread_cpu_time();
        work();
        thread_cpu_time() - start
    });
    times.min().unwrap_or_default()
}

/// Light on a mesh's surface.
struct Surface<'a> {
    mesh: &'a TriangleMesh,
    triangles: &'a [[u32; 3]],
    normal_matrix: Mat3,
    to_sun: Vec3,
}

impl Surface<'_> {
    fn colour(&self, fragment: &Fragment) -> Vec4 {
        let corners = self.triangles[fragment.triangle as usize].map(|v| v as usize);
        let w = fragment.weights().to_array();
        let mix = |of: &dyn Fn(usize) -> Vec3| -> Vec3 { (0..3).map(|k| of(corners[k]) * w[k]).sum() };
        let normal = self.mesh.normals().map_or(Vec3::Z, |n| mix(&|v| n[v]));
        let normal = (self.normal_matrix * normal).normalize_or(Vec3::Z);
        let albedo = self.mesh.colours().map_or(Vec3::splat(0.6), |c| {
            mix(&|v| Vec3::new(linear_of(c[v][0]), linear_of(c[v][1]), linear_of(c[v][2])))
        });
        let light = 0.9 * normal.dot(self.to_sun).max(0.0) + 0.3 + 0.12 * normal.z;
        (albedo * light).extend(1.0)
    }
}

impl ImpostorRenderer for Renderer<'_> {
    type Image = Rc<QuadImage>;
    type Error = RasterError;

    fn render(
        &mut self,
        object: u32,
        view: &ImpostorView,
        placement: &Placement,
        triangles: &[[u32; 3]],
    ) -> Result<Rc<QuadImage>, RasterError> {
        let start = thread_cpu_time();
        let [width, height] = view.size();
        let mut target = Target::new(width, height, Outputs { colour: true, depth: true, id: false })?;
        let clip = view.clip_from_mesh(placement, ClipConvention::REVERSED);
        self.draw_lit(&mut target, self.objects[object as usize].model, placement, triangles, clip);
        let image = if view.options().depth {
            QuadImage::with_relief(&target, |depth| {
                view.height_of_depth(depth.into(), ClipConvention::REVERSED) as f32
            })
        } else {
            QuadImage::from_target(&target)
        };
        self.making += thread_cpu_time() - start;
        Ok(Rc::new(image))
    }
}

impl Engine for Renderer<'_> {
    fn costs(&mut self, _: u32, work: &Work) -> Costs {
        let rates = &self.rates;
        let triangles = rates.triangle * work.triangles as u32;
        let pixels = rates.pixel.mul_f64(rates.fill * work.texels as f64);
        let texels = rates.texel * work.texels as u32;
        let call = Duration::from_micros(2);
        Costs {
            extract: Duration::from_micros(20) + triangles / 4,
            draw_geometry: call + triangles + pixels,
            // Clearing and taking the texels out cost about as much as drawing them.
            create_impostor: 10 * call + triangles + pixels + texels,
            draw_impostor: call + texels,
        }
    }

    fn is_separable(&mut self, object: u32, slab: &Frustum) -> bool {
        is_separable(self.bvh, slab, object, |_| false)
    }
}
