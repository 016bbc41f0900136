//! Points in a picture, by the reference renderer.

use farsight_geometry::glam::{Vec3, Vec4};
use farsight_geometry::{Camera, ClipConvention};
use farsight_points::{Grid, NodeData, NodeId, Point, Store};
use farsight_raster::{Image, Outputs, PointDraw, Rasteriser, Splat, State, Target, srgb_byte};

/// Colours of a cloud that has none: by height.
#[derive(Clone, Copy, Debug)]
pub struct ByHeight {
    pub low: i32,
    pub high: i32,
}

impl ByHeight {
    fn colour(&self, z: i32) -> [u8; 4] {
        const STEPS: [[f32; 3]; 5] = [
            [0.10, 0.19, 0.35],
            [0.14, 0.40, 0.42],
            [0.42, 0.58, 0.36],
            [0.86, 0.76, 0.48],
            [0.96, 0.93, 0.88],
        ];
        let range = (self.high as f32 - self.low as f32).max(1.0);
        let t = ((z as f32 - self.low as f32) / range).clamp(0.0, 1.0) * 3.999;
        let (i, f) = (t as usize, t.fract());
        let mix = |k: usize| STEPS[i][k] + (STEPS[i + 1][k] - STEPS[i][k]) * f;
        let [r, g, b] = [mix(0), mix(1), mix(2)].map(|c| (c * 255.0) as u8);
        [r, g, b, 255]
    }
}

/// Draws points of one camera into a target.
pub struct Painter {
    pub target: Target,
    pub rasteriser: Rasteriser,
    camera: Camera,
    by_height: Option<ByHeight>,
    positions: Vec<Vec3>,
    colours: Vec<[u8; 4]>,
    sizes: Vec<f32>,
}

impl Painter {
    pub fn new(camera: Camera, by_height: Option<ByHeight>) -> Result<Self, farsight_raster::RasterError> {
        Ok(Self {
            target: Target::new(camera.width(), camera.height(), Outputs { id: false, ..Outputs::ALL })?,
            rasteriser: Rasteriser::new(),
            camera,
            by_height,
            positions: Vec::new(),
            colours: Vec::new(),
            sizes: Vec::new(),
        })
    }

    /// Draws points as splats of a diameter in the world, at least a pixel and at most `most_px`.
    pub fn draw(&mut self, grid: &Grid, points: &[Point], splat: f32, most_px: f32) {
        let (eye, ahead) = (self.camera.eye(), self.camera.forward().as_vec3());
        let scale = self.camera.pixels_per_unit() as f32 * splat;
        self.positions.clear();
        self.colours.clear();
        self.sizes.clear();
        for p in points {
            let relative = grid.relative(p.position, eye);
            self.positions.push(relative);
            self.sizes.push((scale / relative.dot(ahead).max(1e-6)).clamp(1.0, most_px));
            self.colours.push(self.by_height.map_or(p.colour, |h| h.colour(p.position[2])));
        }
        let clip_from_local = self.camera.clip_from_relative_f64(ClipConvention::REVERSED, eye);
        let draw = PointDraw {
            positions: &self.positions,
            colours: &self.colours,
            sizes_px: &self.sizes,
            splat: Splat::Round,
            clip_from_local,
            state: State::default(),
        };
        self.rasteriser.draw_points(&mut self.target, &draw);
    }

    /// The picture over a dark sky, with edges darkened where the depth jumps: points have no normals to shade by.
    pub fn image(&self) -> Result<Image, farsight_raster::RasterError> {
        let (width, height) = (self.target.width(), self.target.height());
        let mut pixels = Vec::with_capacity((width * height) as usize);
        for y in 0..height {
            for x in 0..width {
                let colour = Vec4::from_array(self.target.colour(x, y));
                let shade = if colour.w > 0.0 { self.shade(x, y) } else { 1.0 };
                let t = y as f32 / height as f32;
                let sky = Vec3::new(0.018, 0.024, 0.036).lerp(Vec3::new(0.05, 0.06, 0.075), t);
                let lit = colour.truncate() * shade + sky * (1.0 - colour.w);
                pixels.push(lit.to_array().map(srgb_byte));
            }
        }
        Image::new(width, height, pixels)
    }

    fn shade(&self, x: u32, y: u32) -> f32 {
        let here = self.target.depth(x, y).log2();
        let (w, h) = (self.target.width() as i32, self.target.height() as i32);
        let mut sum = 0.0;
        for (dx, dy) in [(-1, 0), (1, 0), (0, -1), (0, 1), (-2, 0), (2, 0), (0, -2), (0, 2)] {
            let (i, j) = (x as i32 + dx, y as i32 + dy);
            if (0..w).contains(&i) && (0..h).contains(&j) {
                let depth = self.target.depth(i as u32, j as u32);
                // Reversed depth is near / distance: a larger one is nearer. Nothing behind hides nothing.
                if depth > 0.0 {
                    sum += (depth.log2() - here).clamp(0.0, 0.4);
                }
            }
        }
        (-1.6 * sum).exp()
    }
}

/// Heights to colour by, where the cloud has no colours.
pub fn by_height(store: &Store) -> Result<Option<ByHeight>, farsight_points::PointsError> {
    let mut root = NodeData::default();
    if store.octree().is_empty() {
        return Ok(None);
    }
    store.read(NodeId(0), &mut root)?;
    let mut heights: Vec<i32> = root.points.iter().map(|p| p.position[2]).collect();
    heights.sort_unstable();
    // A few outliers should not take all the colours.
    let at = |share: f64| heights[(share * (heights.len() - 1) as f64) as usize];
    Ok(is_white(&root.points).then(|| ByHeight { low: at(0.02), high: at(0.98) }))
}

/// Whether points have no colour.
fn is_white(points: &[Point]) -> bool {
    points.iter().all(|p| p.colour == [255; 4])
}
