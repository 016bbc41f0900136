//! What the timing crate knows of costs.

use crate::work::{CostModel, Work};
use farsight_geometry::Millis;
use farsight_timing::{Features, Model, Refit};

/// Vertices, triangles, pixels and draw calls of some work; a point counts as a vertex and a pixel, a tap as a hundredth of a pixel, a
/// texel as a fiftieth.
impl From<&Work> for Features {
    fn from(w: &Work) -> Self {
        Features {
            triangles: w.triangles,
            vertices: w.vertices + w.points,
            pixels: w.pixels + w.points + w.taps * 0.01 + w.texels * 0.02,
            draws: w.draws,
            ..Features::default()
        }
    }
}

impl CostModel for Model {
    fn time(&self, work: &Work) -> Millis {
        self.predict(&work.into())
    }
}

impl CostModel for Refit {
    fn time(&self, work: &Work) -> Millis {
        self.predict_object(&work.into())
    }
}
