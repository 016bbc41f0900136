//! Pictures: ground and sky, and in a corner the triangles and pictures that were drawn.

use crate::engine::{Object, Renderer};
use crate::walk::clip;
use farsight_geometry::glam::{DMat4, DVec2, Vec3, Vec4, vec3};
use farsight_geometry::{Camera, TriangleMesh};
use farsight_lod::Approximation;
use farsight_raster::{
    DepthTest, Draw, Fragment, Image, LineDraw, Outputs, QuadImage, RasterError, Rasteriser, State, Target,
};
use std::rc::Rc;

/// Share of the shown image's side that the inset takes, in percent.
const INSET: u32 = 42;

/// Paving between lawns, and the sky above.
pub fn ground(rasteriser: &mut Rasteriser, target: &mut Target, camera: &Camera) {
    let far = 400.0;
    let eye = camera.eye().as_vec3();
    let corners = [(-far, -far), (far, -far), (far, far), (-far, far)].map(|(x, y)| vec3(x, y, -eye.z));
    let draw = Draw {
        positions: &corners,
        triangles: &[[0, 1, 2], [0, 2, 3]],
        clip_from_local: clip(camera),
        state: State::default(),
    };
    rasteriser.draw_shaded(target, &draw, &|f: &Fragment| {
        let w = f.weights();
        let t = if f.triangle == 0 { [0, 1, 2] } else { [0, 2, 3] };
        let p = corners[t[0]] * w.x + corners[t[1]] * w.y + corners[t[2]] * w.z;
        let (x, y) = (p.x + eye.x, p.y + eye.y);
        let slab = (((x / 2.0).floor() + (y / 2.0).floor()).rem_euclid(2.0)) * 0.03;
        let colour = if y.abs() < 3.0 {
            Vec3::splat(0.40 + slab)
        } else {
            vec3(0.16, 0.24, 0.09) + 0.02 * (x * 0.9).sin()
        };
        let haze = 1.0 - (-p.length() / 180.0).exp();
        Some(colour.lerp(vec3(0.66, 0.74, 0.84), haze).extend(1.0))
    });
    for y in 0..target.height() {
        for x in 0..target.width() {
            let drawn = target.colour(x, y);
            if drawn[3] < 1.0 {
                let up = camera.ray(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)).direction().z as f32;
                let sky = vec3(0.66, 0.74, 0.84).lerp(vec3(0.25, 0.45, 0.78), (2.5 * up).clamp(0.0, 1.0));
                target.set_colour(x, y, sky.extend(1.0).to_array());
            }
        }
    }
}

/// The picture at half its size: four samples a pixel.
pub fn finished(target: Target) -> Image {
    Image::from_colour(&target.downsampled(2))
}

/// The edges of what was drawn.
pub struct Wires {
    target: Target,
    camera: Camera,
}

impl Wires {
    pub fn new(camera: &Camera) -> Result<Self, Box<dyn std::error::Error>> {
        let small = camera.with_image(camera.width() / 2 * INSET / 100, camera.height() / 2 * INSET / 100)?;
        let outputs = Outputs { colour: true, depth: true, id: false };
        let mut target = Target::new(small.width(), small.height(), outputs)?;
        for y in 0..small.height() {
            (0..small.width()).for_each(|x| target.set_colour(x, y, [0.93, 0.93, 0.92, 1.0]));
        }
        Ok(Self { target, camera: small })
    }

    /// Triangles in dark blue, the outline of a picture in orange.
    pub fn add(
        &mut self,
        renderer: &mut Renderer,
        object: &Object,
        mesh: &TriangleMesh,
        shown: &Approximation<Rc<QuadImage>>,
        camera: &Camera,
    ) {
        let place = &object.placement;
        let local = DMat4::from_translation(place.anchor() - camera.eye())
            * DMat4::from_mat3(*place.rotation() * *place.stretch());
        let (segments, colour, matrix): (Vec<[Vec3; 2]>, _, _) = match shown {
            Approximation::Geometry { triangles, .. } => {
                let corner = |v: u32| mesh.positions()[v as usize];
                let sides = |t: &[u32; 3]| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
                let edges = triangles.iter().flat_map(sides).filter(|e| e[0] < e[1]);
                (edges.map(|e| e.map(corner)).collect(), Vec4::new(0.02, 0.05, 0.25, 1.0), local)
            }
            Approximation::Impostor { view, .. } => {
                let c = view.corners().map(|c| (place.to_world(c) - camera.eye()).as_vec3());
                let outline = (0..4).map(|i| [c[i], c[(i + 1) % 4]]).collect();
                (outline, Vec4::new(0.85, 0.25, 0.0, 1.0), DMat4::IDENTITY)
            }
        };
        let mut state = State::default();
        state.depth_test = DepthTest::Always;
        let draw = LineDraw {
            segments: &segments,
            colour,
            width_px: 1,
            clip_from_local: clip(&self.camera) * matrix,
            state,
        };
        renderer.rasteriser.draw_lines(&mut self.target, &draw);
    }

    /// The picture with the edges in its lower right corner.
    pub fn inset(&self, image: Image) -> Result<Image, RasterError> {
        let small = Image::from_colour(&self.target);
        let (width, height) = (image.width() as usize, image.height() as usize);
        let (w, h) = (small.width() as usize, small.height() as usize);
        let mut pixels = image.pixels().to_vec();
        for y in 0..h {
            let row = (height - h + y) * width + width - w;
            pixels[row..row + w].copy_from_slice(&small.pixels()[y * w..(y + 1) * w]);
            pixels[row] = [60; 3];
            if y == 0 {
                pixels[row..row + w].fill([60; 3]);
            }
        }
        Image::new(image.width(), image.height(), pixels)
    }
}
