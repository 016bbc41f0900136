//! Lines.

use crate::Target;
use crate::clip::Viewport;
use crate::draw::{Rasteriser, State, passes};
use crate::point::put;
use glam::{DMat4, DVec2, DVec4, Vec3, Vec4, swizzles::Vec2Swizzles as _};

/// Line segments and how they appear.
#[derive(Clone, Copy, Debug)]
pub struct LineDraw<'a> {
    /// Ends of each segment.
    pub segments: &'a [[Vec3; 2]],
    /// Linear premultiplied colour.
    pub colour: Vec4,
    /// Pixels drawn side by side across the line's longer axis; at least one.
    pub width_px: u32,
    /// As in [`Draw`](crate::Draw).
    pub clip_from_local: DMat4,
    /// State; "triangle" ids count segments.
    pub state: State,
}

/// A segment on the screen, its first end left of or above the other.
struct Segment {
    index: u32,
    /// Ends in pixels: along the longer axis, and across it.
    ends: [DVec2; 2],
    steep: bool,
    depths: [f64; 2],
    /// 1/w of the ends, and the place along the whole segment times that.
    inverse_w: [f64; 2],
    along: [f64; 2],
}

impl Segment {
    fn new(index: u32, ends: [DVec4; 2], along: [f64; 2], viewport: &Viewport) -> Option<Self> {
        let px = ends.map(|p| (viewport.homogeneous_px(p) / p.w).truncate());
        let delta = px[1] - px[0];
        let depths = ends.map(|p| p.z / p.w);
        if !(delta.is_finite() && depths[0].is_finite() && depths[1].is_finite()) {
            return None;
        }
        let steep = delta.y.abs() > delta.x.abs();
        let inverse_w = ends.map(|p| 1.0 / p.w);
        let along = [0, 1].map(|i| along[i] * inverse_w[i]);
        let ends = px.map(|p| if steep { p.yx() } else { p });
        let mut segment = Self { index, ends, steep, depths, inverse_w, along };
        if segment.ends[0].x > segment.ends[1].x {
            segment.ends.reverse();
            segment.depths.reverse();
            segment.inverse_w.reverse();
            segment.along.reverse();
        }
        Some(segment)
    }

    /// Where on the whole segment a share of the way on the screen is.
    fn place(&self, t: f64) -> f64 {
        let mix = |[a, b]: [f64; 2]| a + (b - a) * t;
        mix(self.along) / mix(self.inverse_w)
    }
}

impl Rasteriser {
    /// Draws line segments into all buffers of `target`: one pixel (times the width) per step along the longer axis.
    pub fn draw_lines(&mut self, target: &mut Target, draw: &LineDraw) {
        self.draw_lines_shaded(target, draw, |_, _, _| Some(draw.colour));
    }

    /// Draws line segments in the colours that `shader` computes from a segment's number, the place along it (0 to 1, as in space) and how much of the
    /// segment a pixel covers there; `None` leaves the pixel as it is.
    pub fn draw_lines_shaded(
        &mut self,
        target: &mut Target,
        draw: &LineDraw,
        shader: impl Fn(u32, f32, f32) -> Option<Vec4>,
    ) {
        let viewport = Viewport::new(target.width(), target.height(), draw.state.depth_clamp);
        self.counters.draws += 1;
        self.counters.vertices += 2 * draw.segments.len() as u64;
        for (i, ends) in draw.segments.iter().enumerate() {
            let clip = ends.map(|p| draw.clip_from_local * p.as_dvec3().extend(1.0));
            let Some((ends, along)) = viewport.clip_segment(clip) else {
                self.counters.outside += 1;
                continue;
            };
            self.counters.lines += 1;
            if let Some(segment) = Segment::new(i as u32, ends, along, &viewport) {
                self.step(target, draw, &segment, &shader);
            }
        }
    }

    fn step(
        &mut self,
        target: &mut Target,
        draw: &LineDraw,
        segment: &Segment,
        shader: &impl Fn(u32, f32, f32) -> Option<Vec4>,
    ) {
        let Segment { index, ends: [a, b], steep, depths: [from, to], .. } = *segment;
        let id = draw.state.ids.of(index);
        let size = [f64::from(target.width()), f64::from(target.height())];
        let [long, across] = if steep { [size[1], size[0]] } else { size };
        // Pixel centres in [a, b): segments that continue each other share no pixel along the way.
        let first = (a.x - 0.5).ceil().max(0.0) as i64;
        let end = (b.x - 0.5).ceil().min(long) as i64;
        let (mut tested, mut written) = (0, 0);
        for i in first..end {
            let t = (i as f64 + 0.5 - a.x) / (b.x - a.x);
            let middle = a.y + (b.y - a.y) * t;
            let depth = (from + (to - from) * t).clamp(0.0, 1.0) as f32;
            let mut colour = None;
            let low = (middle - 0.5 * f64::from(draw.width_px.max(1))).round() as i64;
            for j in low..low + i64::from(draw.width_px.max(1)) {
                if j < 0 || j as f64 >= across {
                    continue;
                }
                let [x, y] = if steep { [j as usize, i as usize] } else { [i as usize, j as usize] };
                tested += 1;
                if !passes(draw.state.depth_test, depth, target.depth.get(y * target.stride() + x).copied()) {
                    continue;
                }
                // Shaded once for all pixels across, and only where it shows.
                let shade = || {
                    let (here, next) = (segment.place(t), segment.place(t + 1.0 / (b.x - a.x)));
                    shader(index, here as f32, (next - here) as f32)
                };
                if let Some(colour) = *colour.get_or_insert_with(shade) {
                    written += u64::from(put(target, &draw.state, x, y, depth, colour, id));
                }
            }
        }
        self.count(tested, written);
    }
}
