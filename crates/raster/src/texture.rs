//! Textures with mip maps.

use crate::image::linear_of;
use farsight_geometry::scene::Texture;
use glam::{Vec2, Vec4};

/// A texture in linear colour with all its mip levels, repeated in both directions.
#[derive(Clone, Debug)]
pub struct MipMap {
    levels: Vec<Level>,
}

#[derive(Clone, Debug)]
struct Level {
    width: usize,
    height: usize,
    /// Linear colour, not multiplied by alpha.
    texels: Vec<Vec4>,
}

impl MipMap {
    /// Decodes a texture and averages it down to one texel.
    ///
    /// # Cost
    /// 21 bytes a texel.
    pub fn new(texture: &Texture) -> Self {
        let table: Vec<f32> = (0..=255).map(linear_of).collect();
        let decode = |t: &[u8; 4]| {
            let [r, g, b] = [t[0], t[1], t[2]].map(|c| table[c as usize]);
            Vec4::new(r, g, b, f32::from(t[3]) / 255.0)
        };
        let (width, height) = (texture.width() as usize, texture.height() as usize);
        let texels = texture.texels().iter().map(decode).collect();
        let mut levels = vec![Level { width, height, texels }];
        while let Some(next) = levels.last().and_then(Level::halved) {
            levels.push(next);
        }
        Self { levels }
    }

    /// Number of levels.
    pub fn levels(&self) -> usize {
        self.levels.len()
    }

    /// The level whose texels are as large as a pixel that moves by `dx` (to the right) and `dy` (down) in uv.
    pub fn level_of(&self, dx: Vec2, dy: Vec2) -> f32 {
        let size = Vec2::new(self.levels[0].width as f32, self.levels[0].height as f32);
        let longest_sq = (dx * size).length_squared().max((dy * size).length_squared());
        (0.5 * longest_sq.log2()).clamp(0.0, (self.levels.len() - 1) as f32)
    }

    /// Trilinear lookup: linear colour, not multiplied by alpha. The first row of texels lies at v = 0.
    pub fn sample(&self, uv: Vec2, level: f32) -> Vec4 {
        let level = level.clamp(0.0, (self.levels.len() - 1) as f32);
        let (fine, t) = (level as usize, level.fract());
        let a = self.levels[fine].bilinear(uv);
        if t == 0.0 { a } else { a.lerp(self.levels[fine + 1].bilinear(uv), t) }
    }
}

impl Level {
    fn bilinear(&self, uv: Vec2) -> Vec4 {
        let (x, fx) = wrap(uv.x, self.width);
        let (y, fy) = wrap(uv.y, self.height);
        let next = |i: usize, count: usize| if i + 1 == count { 0 } else { i + 1 };
        let (x1, y1) = (next(x, self.width), next(y, self.height));
        let at = |x: usize, y: usize| self.texels[y * self.width + x];
        at(x, y).lerp(at(x1, y), fx).lerp(at(x, y1).lerp(at(x1, y1), fx), fy)
    }

    /// The next level; colours are weighted by alpha so that what cannot be seen does not bleed in.
    fn halved(&self) -> Option<Self> {
        if self.width == 1 && self.height == 1 {
            return None;
        }
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let mut texels = Vec::with_capacity(width * height);
        for y in 0..height {
            for x in 0..width {
                let mut sum = Vec4::ZERO;
                let mut plain = Vec4::ZERO;
                for (i, j) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    let (px, py) = ((2 * x + i).min(self.width - 1), (2 * y + j).min(self.height - 1));
                    let t = self.texels[py * self.width + px];
                    sum += t.truncate().extend(1.0) * t.w;
                    plain += t;
                }
                let alpha = 0.25 * sum.w;
                let colour = if sum.w > 0.0 { sum.truncate() / sum.w } else { plain.truncate() * 0.25 };
                texels.push(colour.extend(alpha));
            }
        }
        Some(Self { width, height, texels })
    }
}

/// Texel left of a repeating coordinate, and how far it lies towards the next.
fn wrap(coordinate: f32, count: usize) -> (usize, f32) {
    let t = (coordinate - coordinate.floor()) * count as f32 - 0.5;
    let t = if t < 0.0 { t + count as f32 } else { t };
    // NaN and infinite coordinates become texel 0; rounding may reach `count`.
    let i = (t as usize).min(count - 1);
    (i, (t - i as f32).clamp(0.0, 1.0))
}
