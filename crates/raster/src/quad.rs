//! Textured quads, as impostors need them: premultiplied colour and, optionally, relief (heights above the quad that change depth).

use crate::draw::{Blend, Draw, Fragment, PixelShader, Rasteriser, State};
use crate::{RasterError, Target};
use glam::{DMat4, Vec2, Vec3, Vec4};

/// A picture for a quad: linear colour premultiplied by alpha, row by row from the top.
#[derive(Clone, Debug)]
pub struct QuadImage {
    width: usize,
    height: usize,
    texels: Vec<[f32; 4]>,
    relief: Option<Vec<f32>>,
}

impl QuadImage {
    /// Takes texels, and the height of each above the quad in local units, if it has relief.
    ///
    /// # Errors
    /// [`RasterError::ImageSize`] when a side is zero or a count is not `width · height`.
    pub fn new(
        width: u32,
        height: u32,
        texels: Vec<[f32; 4]>,
        relief: Option<Vec<f32>>,
    ) -> Result<Self, RasterError> {
        let count = u64::from(width) * u64::from(height);
        let bad = |n: usize| n as u64 != count || count == 0;
        if bad(texels.len()) || relief.as_ref().is_some_and(|r| bad(r.len())) {
            let pixels = relief.as_ref().map_or(texels.len(), Vec::len);
            return Err(RasterError::ImageSize { width, height, pixels });
        }
        Ok(Self { width: width as usize, height: height as usize, texels, relief })
    }

    /// The colours of a target: what was drawn there becomes the picture.
    ///
    /// # Panics
    /// Without a colour buffer.
    pub fn from_target(target: &Target) -> Self {
        assert!(target.outputs().colour, "the target has no colour");
        let texels = target.colour_rows().flatten().copied().collect();
        Self { width: target.width() as usize, height: target.height() as usize, texels, relief: None }
    }

    /// As [`from_target`](Self::from_target), with relief: `height` above the quad, in local units, by the target's depth.
    ///
    /// # Panics
    /// Without a colour or a depth buffer.
    pub fn with_relief(target: &Target, height: impl Fn(f32) -> f32) -> Self {
        assert!(target.outputs().depth, "the target has no depth");
        // Where nothing was drawn there is no height.
        let height_at = |&depth: &f32| if depth == 0.0 { 0.0 } else { height(depth) };
        let relief = target.depth_rows().flatten().map(height_at).collect();
        Self { relief: Some(relief), ..Self::from_target(target) }
    }

    /// Bilinear colour; beyond the border there is nothing.
    fn sample(&self, uv: Vec2) -> Vec4 {
        let p = uv * Vec2::new(self.width as f32, self.height as f32) - 0.5;
        let (floor, f) = (p.floor(), p - p.floor());
        let texel = |dx: i64, dy: i64| {
            let (x, y) = (floor.x as i64 + dx, floor.y as i64 + dy);
            let inside = x >= 0 && y >= 0 && x < self.width as i64 && y < self.height as i64;
            if inside {
                Vec4::from_array(self.texels[y as usize * self.width + x as usize])
            } else {
                Vec4::ZERO
            }
        };
        texel(0, 0).lerp(texel(1, 0), f.x).lerp(texel(0, 1).lerp(texel(1, 1), f.x), f.y)
    }

    /// Height of the nearest texel.
    fn height_at(&self, uv: Vec2) -> f32 {
        let at = |t: f32, count: usize| ((t * count as f32) as usize).min(count - 1);
        let index = at(uv.y, self.height) * self.width + at(uv.x, self.width);
        self.relief.as_ref().map_or(0.0, |r| r[index])
    }
}

/// A parallelogram with a picture.
#[derive(Clone, Copy, Debug)]
pub struct QuadDraw<'a> {
    /// Top left, top right and bottom left corner.
    pub corners: [Vec3; 3],
    /// The picture.
    pub image: &'a QuadImage,
    /// Texels with less alpha are holes; 0 draws every pixel.
    pub cutoff: f32,
    /// As in [`Draw`].
    pub clip_from_local: DMat4,
    /// State; blending is always premultiplied "over".
    pub state: State,
}

impl Rasteriser {
    /// Draws a textured quad. Where the picture has relief, depth is that of the raised point.
    ///
    /// Relief changes depth only: the pixel stays where the quad covers it.
    pub fn draw_quad(&mut self, target: &mut Target, draw: &QuadDraw) {
        let [a, b, c] = draw.corners;
        let positions = [a, b, b + (c - a), c];
        let normal = (c - a).cross(b - a).normalize_or_zero();
        let call = Draw {
            positions: &positions,
            triangles: &[[0, 3, 2], [0, 2, 1]],
            clip_from_local: draw.clip_from_local,
            state: State { blend: Blend::Over, ..draw.state },
        };
        if draw.image.relief.is_some() {
            self.draw_shaded(target, &call, &QuadShader::<true> { draw, normal });
        } else {
            self.draw_shaded(target, &call, &QuadShader::<false> { draw, normal });
        }
    }
}

struct QuadShader<'a, const RELIEF: bool> {
    draw: &'a QuadDraw<'a>,
    normal: Vec3,
}

impl<const RELIEF: bool> QuadShader<'_, RELIEF> {
    fn uv(&self, fragment: &Fragment) -> Vec2 {
        let w = fragment.weights();
        // Corners (0, 3, 2) and (0, 2, 1) of the unit square with v down.
        if fragment.triangle == 0 { Vec2::new(w.z, w.y + w.z) } else { Vec2::new(w.y + w.z, w.y) }
    }
}

impl<const RELIEF: bool> PixelShader for QuadShader<'_, RELIEF> {
    const REPLACES_DEPTH: bool = RELIEF;

    fn shade(&self, fragment: &Fragment) -> Option<Vec4> {
        let colour = self.draw.image.sample(self.uv(fragment));
        (colour.w >= self.draw.cutoff).then_some(colour)
    }

    fn depth(&self, fragment: &Fragment) -> f32 {
        let uv = self.uv(fragment);
        let [a, b, c] = self.draw.corners;
        let point = a + (b - a) * uv.x + (c - a) * uv.y + self.normal * self.draw.image.height_at(uv);
        let clip = self.draw.clip_from_local * point.as_dvec3().extend(1.0);
        (clip.z / clip.w) as f32
    }
}
