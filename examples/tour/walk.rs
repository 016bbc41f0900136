//! Where the camera goes.

use farsight::geometry::glam::DVec3;
use farsight::geometry::{Camera, CameraError, DAabb};
use farsight_raster::scenes::{City, Path};

/// Which axis points away from the ground.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Up {
    /// +y, as in glTF.
    Y,
    /// +z, as in maps and CAD.
    Z,
}

impl Up {
    /// The axis.
    pub fn axis(self) -> DVec3 {
        match self {
            Up::Y => DVec3::Y,
            Up::Z => DVec3::Z,
        }
    }

    /// Two horizontal axes that complete a right-handed frame.
    fn ground(self) -> (DVec3, DVec3) {
        match self {
            Up::Y => (DVec3::Z, DVec3::X),
            Up::Z => (DVec3::X, DVec3::Y),
        }
    }
}

/// A camera path for a scene.
pub enum Walk {
    /// Through the streets of the generated town, then up over its roofs.
    Town { street: Path, rise: Path },
    /// Around whatever was loaded: all of it in view first, then closer.
    Around { center: DVec3, radius: f64, up: Up },
}

/// Full vertical opening angle.
const FOV_Y: f64 = 1.0;

impl Walk {
    /// Streets and roofs.
    pub fn town(city: &City) -> Self {
        Walk::Town { street: Path::street_walk(city), rise: Path::rise(city) }
    }

    /// Around a box.
    pub fn around(bounds: &DAabb, up: Up) -> Self {
        Walk::Around { center: bounds.center(), radius: 0.5 * bounds.diagonal(), up }
    }

    /// The camera of frame `i` of `n`.
    pub fn camera(&self, i: usize, n: usize, width: u32, height: u32) -> Result<Camera, CameraError> {
        let t = if n > 1 { i as f64 / (n - 1) as f64 } else { 0.0 };
        let (eye, target, up, scale) = match self {
            Walk::Town { street, rise } => {
                let (eye, target) = if t < 0.7 { street.at(t / 0.7) } else { rise.at((t - 0.7) / 0.3) };
                (eye, target, DVec3::Z, 100.0)
            }
            Walk::Around { center, radius, up } => {
                let (a, b) = up.ground();
                let angle = 0.7 + 4.5 * t;
                // The sphere around the scene fills the image's height at the first frame.
                let fitting = radius / (0.5 * FOV_Y).sin();
                let distance = fitting * (1.0 - 0.45 * t);
                let elevation = 0.45 - 0.25 * t;
                let level = a * angle.cos() + b * angle.sin();
                let eye = *center + (level * f64::cos(elevation) + up.axis() * f64::sin(elevation)) * distance;
                (eye, *center, up.axis(), *radius)
            }
        };
        Camera::look_at(eye, target, up)?
            .with_projection(farsight::geometry::Projection::Perspective { fov_y: FOV_Y })?
            .with_range(1e-3 * scale, f64::INFINITY)?
            .with_image(width, height)
    }
}
