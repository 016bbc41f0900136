//! Camera paths.

use super::City;
use super::city::street_middle;
use crate::RasterError;
use farsight_geometry::Camera;
use glam::DVec3;

/// A camera path: eye and target at a few stops, smooth in between.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    stops: Vec<(DVec3, DVec3)>,
}

impl Path {
    /// A path through stops of (eye, target), passed at equal times: Catmull-Rom splines of both.
    ///
    /// # Errors
    /// [`RasterError::Option`] when there is no stop or a coordinate is not finite.
    pub fn through(stops: Vec<(DVec3, DVec3)>) -> Result<Self, RasterError> {
        let usable = !stops.is_empty() && stops.iter().all(|(e, t)| e.is_finite() && t.is_finite());
        if !usable {
            let (value, range) = (stops.len() as f64, "at least one stop of finite coordinates");
            return Err(RasterError::Option { option: "stops", value, range });
        }
        Ok(Self { stops })
    }

    /// A walk along a street at eye height with a turn into a side street at half way.
    pub fn street_walk(city: &City) -> Self {
        let side = city.side();
        let (x, y) = (middle_street(city), middle_street(city));
        let at = |x: f64, y: f64| DVec3::new(x, y, 1.8);
        let ahead = |x: f64, y: f64| DVec3::new(x, y, 2.3);
        Self {
            stops: vec![
                (at(14.0, y), ahead(54.0, y)),
                (at(0.3 * x, y), ahead(0.3 * x + 40.0, y)),
                (at(x - 14.0, y), ahead(x + 20.0, y + 4.0)),
                (at(x, y), ahead(x + 24.0, y + 24.0)),
                (at(x, y + 14.0), ahead(x - 2.0, y + 50.0)),
                (at(x, 0.5 * (y + side)), ahead(x, 0.5 * (y + side) + 40.0)),
                (at(x, side - 40.0), ahead(x, side + 10.0)),
            ],
        }
    }

    /// From eye height in a street straight up to 35 m, the view tilting over the roofs.
    pub fn rise(city: &City) -> Self {
        let x = middle_street(city);
        let target = DVec3::new(x + 30.0, city.side() * 0.8, 4.0);
        let at = |z: f64| (DVec3::new(x, 24.0, z), target);
        Self { stops: vec![at(1.8), at(6.0), at(12.0), at(22.0), at(35.0)] }
    }

    /// A full turn at a crossing, at eye height.
    pub fn turn(city: &City) -> Self {
        let c = middle_street(city);
        let eye = DVec3::new(c, c, 1.8);
        let target = |n: i32| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(n) / 16.0).sin_cos();
            eye + DVec3::new(10.0 * cos, 10.0 * sin, 0.4)
        };
        Self { stops: (0..=16).map(|n| (eye, target(n))).collect() }
    }

    /// A flight across a square of the given side (in metres, a corner at the origin), descending towards its middle.
    pub fn flyover(side: f64, height: f64) -> Self {
        let p = |x: f64, y: f64, z: f64| DVec3::new(x * side, y * side, z * height);
        Self {
            stops: vec![
                (p(-0.1, -0.15, 1.4), p(0.5, 0.45, 0.0)),
                (p(0.15, 0.05, 1.1), p(0.6, 0.6, 0.0)),
                (p(0.4, 0.35, 0.7), p(0.8, 0.9, 0.0)),
                (p(0.6, 0.65, 0.8), p(0.4, 1.1, 0.0)),
                (p(0.65, 0.95, 1.2), p(0.4, 0.3, 0.0)),
            ],
        }
    }

    /// The camera of a frame: the first frame is at the first stop, the last at the last.
    ///
    /// # Errors
    /// When eye and target coincide there, or the view is vertical.
    pub fn camera(&self, frame: usize, frames: usize) -> Result<Camera, RasterError> {
        let t = if frames > 1 { frame.min(frames - 1) as f64 / (frames - 1) as f64 } else { 0.0 };
        let (eye, target) = self.at(t);
        Ok(Camera::look_at(eye, target, DVec3::Z)?)
    }

    /// Eye and target at `t` from 0 to 1.
    pub fn at(&self, t: f64) -> (DVec3, DVec3) {
        let last = self.stops.len() - 1;
        let u = t.clamp(0.0, 1.0) * last as f64;
        let i = (u as usize).min(last.saturating_sub(1));
        let stop = |k: isize| self.stops[(i as isize + k).clamp(0, last as isize) as usize];
        let (a, b, c, d) = (stop(-1), stop(0), stop(1), stop(2));
        let f = u - i as f64;
        (catmull_rom(a.0, b.0, c.0, d.0, f), catmull_rom(a.1, b.1, c.1, d.1, f))
    }
}

/// Where the street nearest to the town's middle runs, along x as along y.
fn middle_street(city: &City) -> f64 {
    street_middle((f64::from(city.blocks * city.repeat) * 0.5).floor())
}

fn catmull_rom(a: DVec3, b: DVec3, c: DVec3, d: DVec3, t: f64) -> DVec3 {
    let (t2, t3) = (t * t, t * t * t);
    0.5 * (2.0 * b + (c - a) * t + (2.0 * a - 5.0 * b + 4.0 * c - d) * t2 + (3.0 * (b - c) + d - a) * t3)
}
