//! How coarse is fine enough: cells against pixels.

use farsight_geometry::{Camera, DAabb, Projection};

/// Which world error shows as how many pixels, for points of a box seen by a camera.
///
/// A point p at depth z, tangent t off the view axis, that is drawn at p + d with |d| ≤ e, moves on the screen by
/// `f·|d_xy − t·d_z| / (z + d_z)`, which is at most `f·e·√(1+t²) / (z − e)`. That holds for each visible p; so for all of a box with
/// the box's least depth (not before the near plane) and largest √(1+t²) (not beyond the image's corner).
#[derive(Clone, Copy, Debug)]
pub(crate) enum Lens {
    Perspective { pixels: f64, near: f64, corner: f64 },
    Orthographic { pixels: f64 },
}

/// Rounding of the few operations below, in `f64`.
const SLACK: f64 = 1.0 + 1e-12;

impl Lens {
    pub fn new(camera: &Camera) -> Self {
        let pixels = camera.pixels_per_unit();
        match camera.projection() {
            Projection::Orthographic { .. } => Self::Orthographic { pixels },
            Projection::Perspective { .. } => {
                let corner = (1.0 + camera.half_extent().length_squared()).sqrt();
                Self::Perspective { pixels, near: camera.near(), corner }
            }
        }
    }

    /// Pixels for an error of points that lie at `least` depth at least, `farthest` from the eye at most. Infinite when the error
    /// reaches the eye's plane.
    #[inline]
    pub fn error_px(&self, error: f64, least: f64, farthest: f64) -> f64 {
        match *self {
            Self::Orthographic { pixels } => pixels * error * SLACK,
            Self::Perspective { pixels, near, corner } => {
                // By comparisons, since the functions for it cost as much again for the sake of NaN.
                let depth = if least > near { least } else { near };
                let secant = farthest / depth;
                let secant = if secant < corner { secant } else { corner };
                let secant = if secant > 1.0 { secant } else { 1.0 };
                if error >= depth { f64::INFINITY } else { pixels * error / (depth - error) * secant * SLACK }
            }
        }
    }
}

/// Least depth and greatest distance of a box from a camera's eye.
pub(crate) fn reach(camera: &Camera, bounds: &DAabb) -> (f64, f64) {
    let (forward, eye) = (camera.forward(), camera.eye());
    let (center, half) = (bounds.center() - eye, bounds.extent() * 0.5);
    let slack = 8.0 * f64::EPSILON * (bounds.center().abs().max_element() + eye.abs().max_element());
    let least = center.dot(forward) - forward.abs().dot(half) - slack;
    (least, center.length() + half.length() + slack)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec3, dvec3};

    #[test]
    fn no_visible_point_moves_further_than_claimed() {
        let eye = dvec3(691_000.0, 5_335_000.0, 519.0);
        let camera = Camera::look_at(eye, eye + dvec3(1.0, 0.3, -0.2), DVec3::Z).unwrap();
        let mut seed = 3u64;
        let mut random = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1u64 << 53) as f64 * 2.0 - 1.0
        };
        for camera in [camera, camera.with_projection(Projection::Orthographic { height: 30.0 }).unwrap()] {
            let lens = Lens::new(&camera);
            let (mut tightest, mut seen) = (0.0f64, 0);
            for _ in 0..3000 {
                let center = eye
                    + camera.forward() * (random() + 1.3) * 20.0
                    + dvec3(random(), random(), random()) * 12.0;
                let bounds = DAabb::from_points([center]).inflated(random().abs() + 1e-3);
                let (least, farthest) = reach(&camera, &bounds);
                let error = random().abs() * 0.3;
                let claim = lens.error_px(error, least, farthest);
                for _ in 0..20 {
                    let p = bounds.center() + bounds.extent() * 0.5 * dvec3(random(), random(), random());
                    let Some((px, depth)) = camera.project(p) else { continue };
                    let inside = (0.0..1280.0).contains(&px.x) && (0.0..720.0).contains(&px.y);
                    if !inside || depth < camera.near() {
                        continue;
                    }
                    let d = dvec3(random(), random(), random()).normalize() * error;
                    if let Some((moved, _)) = camera.project(p + d) {
                        seen += 1;
                        assert!(moved.distance(px) <= claim, "{} > {claim}", moved.distance(px));
                        tightest = tightest.max(moved.distance(px) / claim);
                    } else {
                        assert!(claim.is_infinite());
                    }
                }
            }
            assert!(seen > 10_000 && tightest > 0.8, "{seen} {tightest}");
        }
    }
}
