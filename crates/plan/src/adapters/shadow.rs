//! What the shadow crate knows of a light.

use crate::summary::{LightView, TexelSpread};
use farsight_shadow::{CascadePlan, ShadowView, Skip};

impl TexelSpread {
    /// From a fitted map: with its warp, and without.
    pub fn of_map(view: &ShadowView) -> Self {
        let side = f64::from(view.side);
        Self {
            uniform: view.texel_uniform.value * side,
            warped: view.texel.value * side,
            cascades: [f64::INFINITY; 3],
        }
    }

    /// With what cascades reach; plans of other than 2, 3 or 4 maps are ignored.
    #[must_use]
    pub fn with_cascades(mut self, plan: &CascadePlan) -> Self {
        let side = plan.cascades.iter().map(|c| c.view.side).min().unwrap_or(0);
        if let 2..=4 = plan.cascades.len() {
            self.cascades[plan.cascades.len() - 2] = plan.texel.value * f64::from(side);
        }
        self
    }
}

impl LightView {
    /// A light whose shadows need not be drawn, as [`Focus::fit`](farsight_shadow::Focus::fit) found.
    pub fn skipped(skip: Skip) -> Self {
        let none = TexelSpread { uniform: 0.0, warped: 0.0, cascades: [f64::INFINITY; 3] };
        // Something is lit unless there are no receivers; nothing throws a shadow on it.
        let receiver_pixels = if skip == Skip::NothingSeen { 0.0 } else { 1.0 };
        Self {
            receiver_pixels,
            caster_triangles: 0.0,
            caster_draws: 0.0,
            contribution: 1.0,
            texels: none,
            penumbra_px: 0.0,
            unchanged: false,
        }
    }
}
