//! Maps whose texels stay on the same points of the world while the camera moves.

use crate::focus::Focus;
use crate::warp::{MapOptions, ShadowView, Window, light_only};
use farsight_geometry::accuracy::{ErrorBound, Unit};
use glam::DVec3;

impl Focus {
    /// A map around the sphere of the view, snapped to whole texels of a grid that is fixed in the world.
    ///
    /// Neither a move nor a turn of the camera changes the size of a texel or its place; what changes is which texels are
    /// in the map. The price is the sphere: the map also covers what the camera does not see.
    pub(crate) fn stable(&self, options: &MapOptions) -> ShadowView {
        let direction = self.light.expect("the focus is filled").direction().normalize();
        let (axes, space) = light_only(direction);
        let (center, radius) = self.view_sphere;
        // One texel more than the sphere needs lets the grid slide under it.
        let usable = (f64::from(options.side) - 2.0 * options.border.max(0.0) - 1.0).max(1.0);
        let texel = (2.0 * radius).max(self.footprint.extent().max_element().min(radius)) / usable;
        let snapped = |axis: DVec3| {
            let (eye, at) = (axis.dot(self.origin), axis.dot(self.origin + center));
            (at / texel).round() * texel - eye
        };
        let side = f64::from(options.side) * texel;
        let (depth_top, depth_span) = self.depth_span(0.0);
        let window = Window {
            space,
            near: snapped(axes.z) - 0.5 * side,
            along: side,
            low: snapped(axes.x) - 0.5 * side,
            across: side,
            kappa: 0.0,
            inside: 1.0,
            depth: (depth_top, depth_span),
        };
        let largest = self.receivers.iter().fold(0.0, |m: f64, c| m.max(c.scale));
        let bound = ErrorBound::proven(texel * largest * self.pixels_per_unit * (1.0 + 1e-9), Unit::Pixels);
        self.view(window.matrix(options.convention), 0.0, [bound; 2], options)
    }
}
