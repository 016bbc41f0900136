//! What a picture lost, and where to look at a whole cloud from.

use farsight_geometry::Camera;
use farsight_geometry::glam::DVec3;
use farsight_raster::Target;

/// Pixels that one target covers and another does not.
pub fn lost_pixels(all: &Target, some: &Target) -> (u64, u64) {
    let depths = |t: &Target| -> Vec<bool> { t.depth_rows().flatten().map(|&d| d > 0.0).collect() };
    let (a, b) = (depths(all), depths(some));
    let covered = a.iter().filter(|&&c| c).count() as u64;
    (a.iter().zip(&b).filter(|&(&a, &b)| a && !b).count() as u64, covered)
}

/// A camera from the south-west above that sees a whole box, z up.
pub fn overview(
    bounds: &farsight_geometry::DAabb,
    size: [u32; 2],
) -> Result<Camera, farsight_geometry::CameraError> {
    let (center, diagonal) = (bounds.center(), bounds.diagonal().max(1e-6));
    let eye = center + DVec3::new(-0.28, -0.5, 0.38) * diagonal;
    Camera::look_at(eye, center - DVec3::Z * 0.02 * diagonal, DVec3::Z)?
        .with_range(1e-4 * diagonal, f64::INFINITY)?
        .with_image(size[0], size[1])
}
