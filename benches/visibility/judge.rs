//! The judge of errors: random pixels with the triangles that they show, found without the sampler.

use super::scenes::Case;
use farsight_geometry::glam::DVec3;
use farsight_geometry::sampling::Random;
use farsight_geometry::{Ray, RayCaster};
use farsight_visibility::Pvs;

/// Triangles of random pixels: an eye anywhere in the cell, looking anywhere.
pub struct Judge {
    /// What each pixel shows; pixels of the sky are left out.
    shown: Vec<u32>,
    pixels: usize,
}

impl Judge {
    pub fn new(case: &Case, pixels: usize) -> Self {
        let mut random = Random::new(0x9e11);
        let b = case.cell.bounds();
        let mut shown = Vec::new();
        let (mut rays, mut hits) = (Vec::new(), Vec::new());
        for first in (0..pixels).step_by(1 << 16) {
            rays.clear();
            rays.extend((first..(first + (1 << 16)).min(pixels)).map(|_| {
                let eye = b.min + (b.max - b.min) * DVec3::from_array(random.units());
                Ray::new(eye, direction(&mut random)).expect("a direction")
            }));
            hits.clear();
            hits.resize(rays.len(), None);
            case.caster.closest_batch(&rays, &mut hits);
            shown.extend(hits.iter().flatten().map(|h| h.triangle));
        }
        Self { shown, pixels }
    }

    /// Pixels that show something which is not in the set, of a million.
    pub fn false_per_million(&self, set: &Pvs) -> f64 {
        let missed = self.shown.iter().filter(|&&t| !set.contains(t)).count();
        missed as f64 * 1e6 / self.pixels as f64
    }
}

/// Uniform over the sphere, by rejection.
pub fn direction(random: &mut Random) -> DVec3 {
    loop {
        let d = DVec3::from_array(random.units()) * 2.0 - DVec3::ONE;
        if (0.01..1.0).contains(&d.length_squared()) {
            return d;
        }
    }
}
