//! Lines.

use crate::Target;
use crate::clip::Viewport;
use crate::draw::{Rasteriser, State};
use crate::point::put;
use glam::{DMat4, DVec2, Vec3, Vec4, swizzles::Vec2Swizzles as _};

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

impl Rasteriser {
    /// Draws line segments into all buffers of `target`: one pixel (times the width) per step along the longer axis.
    pub fn draw_lines(&mut self, target: &mut Target, draw: &LineDraw) {
        let viewport = Viewport::new(target.width(), target.height(), draw.state.depth_clamp);
        self.counters.draws += 1;
        self.counters.vertices += 2 * draw.segments.len() as u64;
        for (i, ends) in draw.segments.iter().enumerate() {
            let clip = ends.map(|p| draw.clip_from_local * p.as_dvec3().extend(1.0));
            let Some(ends) = viewport.clip_segment(clip) else {
                self.counters.outside += 1;
                continue;
            };
            let id = draw.state.ids.of(i as u32);
            self.counters.lines += 1;
            let px = ends.map(|p| viewport.homogeneous_px(p) / p.w);
            let depth = ends.map(|p| p.z / p.w);
            self.step(target, draw, px.map(|p| p.truncate()), depth, id);
        }
    }

    fn step(&mut self, target: &mut Target, draw: &LineDraw, px: [DVec2; 2], depth: [f64; 2], id: u32) {
        let delta = px[1] - px[0];
        if !(delta.is_finite() && depth[0].is_finite() && depth[1].is_finite()) {
            return;
        }
        let steep = delta.y.abs() > delta.x.abs();
        let swap = |p: DVec2| if steep { p.yx() } else { p };
        let (a, b) = (swap(px[0]), swap(px[1]));
        let (a, b, from, to) =
            if a.x <= b.x { (a, b, depth[0], depth[1]) } else { (b, a, depth[1], depth[0]) };
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
            let low = (middle - 0.5 * f64::from(draw.width_px.max(1))).round() as i64;
            for j in low..low + i64::from(draw.width_px.max(1)) {
                if j < 0 || j as f64 >= across {
                    continue;
                }
                let (x, y) = if steep { (j, i) } else { (i, j) };
                tested += 1;
                let at = [x as usize, y as usize];
                written += u64::from(put(target, &draw.state, at[0], at[1], depth, draw.colour, id));
            }
        }
        self.count(tested, written);
    }
}
