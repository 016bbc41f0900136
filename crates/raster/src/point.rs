//! Points as square or round splats.

use crate::clip::{SIDES, Viewport};
use crate::draw::{Rasteriser, State, blended, passes};
use crate::{Target, linear_of};
use glam::{DMat4, Vec3, Vec4};

/// Outline of a splat.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Splat {
    /// Square: a splat of whole size n covers exactly n² pixels.
    #[default]
    Square,
    /// Round: pixels whose centre is closer than half the size. Below one pixel it is square, so as not to vanish.
    Round,
}

/// Points and how they appear.
#[derive(Clone, Copy, Debug)]
pub struct PointDraw<'a> {
    /// Positions.
    pub positions: &'a [Vec3],
    /// sRGB colour and linear alpha per point; white when empty.
    pub colours: &'a [[u8; 4]],
    /// Diameter or side in pixels per point; one value for all is allowed, and empty means one pixel.
    pub sizes_px: &'a [f32],
    /// Outline.
    pub splat: Splat,
    /// As in [`Draw`](crate::Draw).
    pub clip_from_local: DMat4,
    /// State; culling has no meaning for points, depth is constant over a splat, "triangle" ids count points.
    pub state: State,
}

/// Largest splat in pixels; larger ones are drawn this large.
pub const MAX_SPLAT_PX: f32 = 1024.0;

impl Rasteriser {
    /// Draws points into all buffers of `target`. Points whose centre is outside the view volume are dropped.
    pub fn draw_points(&mut self, target: &mut Target, draw: &PointDraw) {
        let viewport = Viewport::new(target.width(), target.height(), draw.state.depth_clamp);
        let table: [f32; 256] = std::array::from_fn(|i| linear_of(i as u8));
        self.counters.draws += 1;
        self.counters.vertices += draw.positions.len() as u64;
        for (i, p) in draw.positions.iter().enumerate() {
            let clip = draw.clip_from_local * p.as_dvec3().extend(1.0);
            if viewport.outcode(clip) & SIDES != 0 || clip.w <= 0.0 {
                self.counters.outside += 1;
                continue;
            }
            let px = viewport.homogeneous_px(clip) / clip.w;
            let depth = (clip.z / clip.w).clamp(0.0, 1.0) as f32;
            let size = draw.sizes_px.get(i).or(draw.sizes_px.first()).copied().unwrap_or(1.0);
            let colour = draw.colours.get(i).map_or(Vec4::ONE, |c| {
                let alpha = f32::from(c[3]) / 255.0;
                Vec3::from_array([c[0], c[1], c[2]].map(|b| table[b as usize])).extend(1.0) * alpha
            });
            let id = draw.state.ids.of(i as u32);
            self.counters.points += 1;
            let at = [px.x as f32, px.y as f32];
            self.splat(target, &draw.state, draw.splat, at, size.clamp(0.0, MAX_SPLAT_PX), depth, colour, id);
        }
    }

    fn splat(
        &mut self,
        target: &mut Target,
        state: &State,
        splat: Splat,
        [cx, cy]: [f32; 2],
        size: f32,
        depth: f32,
        colour: Vec4,
        id: u32,
    ) {
        let half = 0.5 * size.max(1.0);
        let first = |c: f32| (c - half - 0.5).ceil().max(0.0) as usize;
        let end = |c: f32, limit: u32| (c + half - 0.5).ceil().clamp(0.0, limit as f32) as usize;
        let (mut tested, mut written) = (0, 0);
        for y in first(cy)..end(cy, target.height()) {
            for x in first(cx)..end(cx, target.width()) {
                let (dx, dy) = (x as f32 + 0.5 - cx, y as f32 + 0.5 - cy);
                if splat == Splat::Round && size > 1.0 && dx * dx + dy * dy >= half * half {
                    continue;
                }
                tested += 1;
                written += u64::from(put(target, state, x, y, depth, colour, id));
            }
        }
        self.count(tested, written);
    }
}

/// Tests and writes one pixel of all buffers.
pub(crate) fn put(
    target: &mut Target,
    state: &State,
    x: usize,
    y: usize,
    depth: f32,
    colour: Vec4,
    id: u32,
) -> bool {
    let at = y * target.stride() + x;
    if !passes(state.depth_test, depth, target.depth.get(at).copied()) {
        return false;
    }
    if let Some(slot) = target.depth.get_mut(at).filter(|_| state.depth_write) {
        *slot = depth;
    }
    if let Some(slot) = target.id.get_mut(at) {
        *slot = id;
    }
    if let Some(slot) = target.colour.get_mut(at) {
        *slot = blended(state.blend, colour, *slot);
    }
    true
}
