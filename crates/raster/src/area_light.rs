//! What really arrives from a light: ray casting, for penumbrae to be compared with.

use crate::Random;
use farsight_geometry::scene::Light;
use farsight_geometry::{Ray, RayCaster};
use glam::{DVec2, DVec3};
use std::f64::consts::{PI, TAU};

/// Light that arrives at a surface point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Arriving {
    /// Irradiance per colour.
    pub irradiance: DVec3,
    /// Irradiance over that without any occluder, from 0 (umbra) to 1; 1 where nothing would arrive anyway.
    pub visible: f64,
}

/// Integrates a light over its surface (or solid angle) by `samples_per_side`² jittered rays, stratified and seeded.
///
/// `point` and unit `normal` are in the world; occluders closer than `clearance` do not count, so that the surface
/// does not shadow itself.
///
/// # Accuracy
/// The error of `visible` falls like n^-1.5 in the number n of strata along a side where one shadow edge crosses the light;
/// points, spots and sharp parallel light take one ray and are exact.
pub fn irradiance_from(
    light: &Light,
    caster: &dyn RayCaster,
    point: DVec3,
    normal: DVec3,
    clearance: f64,
    samples_per_side: u32,
    seed: u64,
) -> Arriving {
    let n = if is_delta(light) { 1 } else { samples_per_side.max(1) };
    let mut random = Random::new(seed);
    let (mut lit, mut all) = (DVec3::ZERO, DVec3::ZERO);
    for j in 0..n {
        for i in 0..n {
            let jitter = DVec2::new(random.unit(), random.unit());
            let uv = (DVec2::new(f64::from(i), f64::from(j)) + jitter) / f64::from(n);
            let Some((direction, distance, arriving)) = sample(light, point, uv) else { continue };
            let arriving = arriving * normal.dot(direction).max(0.0);
            all += arriving;
            let free = |ray: Ray| !caster.occluded(&ray.with_range(clearance, distance - clearance));
            if arriving != DVec3::ZERO && Ray::new(point, direction).is_some_and(free) {
                lit += arriving;
            }
        }
    }
    let (got, possible) = (lit.element_sum(), all.element_sum());
    let visible = if possible > 0.0 { got / possible } else { 1.0 };
    Arriving { irradiance: lit / f64::from(n * n), visible }
}

fn is_delta(light: &Light) -> bool {
    match light {
        Light::Directional { angular_radius, .. } => *angular_radius == 0.0,
        Light::Point { .. } | Light::Spot { .. } => true,
        _ => false,
    }
}

/// Direction to a point of the light, its distance, and the irradiance on a facing surface that its stratum stands for
/// (times the number of strata).
fn sample(light: &Light, point: DVec3, uv: DVec2) -> Option<(DVec3, f64, DVec3)> {
    let towards = |at: DVec3| {
        let to = at - point;
        let distance = to.length();
        (distance > 0.0).then(|| (to / distance, distance))
    };
    match *light {
        Light::Directional { direction, irradiance, angular_radius } => {
            let d = cone(-direction, angular_radius.cos(), uv);
            Some((d, f64::INFINITY, irradiance.as_dvec3()))
        }
        Light::Point { position, intensity } => {
            let (d, r) = towards(position)?;
            Some((d, r, intensity.as_dvec3() / (r * r)))
        }
        Light::Spot { position, direction, half_angle, intensity } => {
            let (d, r) = towards(position)?;
            let inside = -d.dot(direction) > half_angle.cos();
            Some((d, r, if inside { intensity.as_dvec3() / (r * r) } else { DVec3::ZERO }))
        }
        Light::Sphere { center, radius, radiance } => {
            let (axis, r) = towards(center)?;
            if r <= radius {
                return None;
            }
            // Uniform in the cone that the sphere fills: constant radiance times its solid angle.
            let cosine = (1.0 - (radius / r).powi(2)).sqrt();
            let d = cone(axis, cosine, uv);
            let along = d.dot(axis) * r;
            let reach = along - (along * along - r * r + radius * radius).max(0.0).sqrt();
            Some((d, reach, radiance.as_dvec3() * (TAU * (1.0 - cosine))))
        }
        Light::Disk { center, normal, radius, radiance } => {
            let (u, v) = normal.any_orthonormal_pair();
            let (sin, cos) = (TAU * uv.y).sin_cos();
            let at = center + (u * cos + v * sin) * (radius * uv.x.sqrt());
            let (d, r) = towards(at)?;
            let cosine = -d.dot(normal);
            Some((d, r, radiance.as_dvec3() * (PI * radius * radius * cosine.max(0.0) / (r * r))))
        }
        Light::Rectangle { center, half_u, half_v, radiance } => {
            let at = center + half_u * (2.0 * uv.x - 1.0) + half_v * (2.0 * uv.y - 1.0);
            let (d, r) = towards(at)?;
            let area = 4.0 * half_u.cross(half_v);
            Some((d, r, radiance.as_dvec3() * ((-d.dot(area)).max(0.0) / (r * r))))
        }
        _ => None,
    }
}

/// Uniform in the cone around `axis` with the given cosine of its half angle.
fn cone(axis: DVec3, cosine: f64, uv: DVec2) -> DVec3 {
    let z = 1.0 - uv.x * (1.0 - cosine);
    let (sin, cos) = (TAU * uv.y).sin_cos();
    let (u, v) = axis.any_orthonormal_pair();
    axis * z + (u * cos + v * sin) * (1.0 - z * z).max(0.0).sqrt()
}
