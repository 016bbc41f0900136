//! Where the camera goes.

use crate::inside::walkway;
use farsight_geometry::glam::DVec3;
use farsight_geometry::{Camera, CameraError, DAabb, RayCaster, Scene};
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
    pub fn ground(self) -> (DVec3, DVec3) {
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
    /// Around whatever was loaded: all of it in view first, then closer, at last inside where there is an inside.
    Around { bounds: DAabb, up: Up, inside: Option<[DVec3; 2]> },
}

/// Share of the frames in the town's streets.
const STREET: f64 = 0.7;
/// Share of the frames that look from outside where there is an inside to see.
const OUTSIDE: f64 = 0.5;
/// Full vertical opening angle.
const FOV_Y: f64 = 1.0;

impl Walk {
    /// Streets and roofs.
    pub fn town(city: &City) -> Self {
        Walk::Town { street: Path::street_walk(city), rise: Path::rise(city) }
    }

    /// Around a scene.
    pub fn around(scene: &Scene, caster: &impl RayCaster, up: Up) -> Self {
        let bounds = scene.bounds();
        Walk::Around { bounds, up, inside: walkway(caster, &bounds, up.axis()) }
    }

    /// The viewpoints of those of `n` frames that lie between walls, where much is hidden.
    pub fn enclosed(&self, n: usize) -> Vec<DVec3> {
        let between = |t: f64| match self {
            Walk::Town { .. } => t < STREET,
            Walk::Around { inside, .. } => inside.is_some() && t > OUTSIDE,
        };
        let times = (0..n).map(|i| Self::time(i, n)).filter(|&t| between(t));
        times.filter_map(|t| self.camera_at(t, 16, 9).ok()).map(|c| c.eye()).collect()
    }

    /// Time along the walk, from 0 to 1, of frame `i` of `n`.
    pub fn time(i: usize, n: usize) -> f64 {
        if n > 1 { i as f64 / (n - 1) as f64 } else { 0.0 }
    }

    /// The camera at a time along the walk.
    pub fn camera_at(&self, t: f64, width: u32, height: u32) -> Result<Camera, CameraError> {
        let (eye, target, up, scale) = match self {
            Walk::Town { street, rise } => {
                let (eye, target) =
                    if t < STREET { street.at(t / STREET) } else { rise.at((t - STREET) / (1.0 - STREET)) };
                (eye, target, DVec3::Z, 100.0)
            }
            Walk::Around { bounds, up, inside: Some([from, to]) } if t > OUTSIDE => {
                let along = (t - OUTSIDE) / (1.0 - OUTSIDE);
                let ahead = (*to - *from).normalize();
                // Looking a little to both sides while walking.
                let turn = 0.5 * (along * std::f64::consts::TAU).sin();
                let view = ahead * turn.cos() + ahead.cross(up.axis()) * turn.sin();
                let eye = from.lerp(*to, along);
                (eye, eye + view, up.axis(), 0.1 * bounds.diagonal())
            }
            Walk::Around { bounds, up, inside } => {
                let t = if inside.is_some() { t / OUTSIDE } else { t };
                let (a, b) = up.ground();
                // The first frame has the sun over the left shoulder.
                let angle = 4.9 + 4.5 * t;
                let elevation = 0.45 - 0.25 * t;
                let level = a * angle.cos() + b * angle.sin();
                let out = level * f64::cos(elevation) + up.axis() * f64::sin(elevation);
                let aspect = f64::from(width) / f64::from(height);
                // All of the scene fills the first frame; later ones come closer.
                let distance = fitting_distance(bounds, out, up.axis(), aspect) * (1.04 - 0.25 * t);
                (bounds.center() + out * distance, bounds.center(), up.axis(), 0.5 * bounds.diagonal())
            }
        };
        Camera::look_at(eye, target, up)?
            .with_projection(farsight_geometry::Projection::Perspective { fov_y: FOV_Y })?
            .with_range(1e-3 * scale, f64::INFINITY)?
            .with_image(width, height)
    }
}

/// How far from the centre of a box, in direction `out`, all of it is just in view.
fn fitting_distance(bounds: &DAabb, out: DVec3, up: DVec3, aspect: f64) -> f64 {
    let right = up.cross(out).normalize();
    let top = out.cross(right);
    let tan = (0.5 * FOV_Y).tan();
    let needed = |corner: DVec3| {
        let c = corner - bounds.center();
        c.dot(out) + (c.dot(right).abs() / (tan * aspect)).max(c.dot(top).abs() / tan)
    };
    bounds.corners().into_iter().map(needed).fold(1e-9, f64::max)
}
