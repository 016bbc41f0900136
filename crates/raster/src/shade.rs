//! Lighting: what colour a surface has under the lights of a scene.

use crate::shadow_map::ShadowMap;
use farsight_geometry::scene::Light;
use glam::{DVec3, Vec3};

/// Everything that lights a surface, relative to one origin (the eye).
pub struct Lighting<'a> {
    lights: Vec<LocalLight<'a>>,
    /// Radiance from above and below.
    ambient: [Vec3; 2],
    up: Vec3,
    /// Radiance of a surface that faces the origin.
    headlight: f32,
}

struct LocalLight<'a> {
    light: Light,
    /// Position relative to the origin; unused for parallel light.
    position: Vec3,
    shadow: Option<&'a ShadowMap>,
}

impl<'a> Lighting<'a> {
    /// Light sources and hemispheric ambient light (`ambient`: from `up` and from below) around `origin`.
    ///
    /// `shadows` belong to the lights in order; missing ones cast no shadow.
    pub fn new(
        lights: &[Light],
        shadows: &'a [ShadowMap],
        ambient: [Vec3; 2],
        up: Vec3,
        origin: DVec3,
    ) -> Self {
        let local = |(i, &light): (usize, &Light)| {
            let position = match light {
                Light::Point { position, .. } | Light::Spot { position, .. } => position,
                Light::Sphere { center, .. }
                | Light::Disk { center, .. }
                | Light::Rectangle { center, .. } => center,
                _ => origin,
            };
            LocalLight { light, position: (position - origin).as_vec3(), shadow: shadows.get(i) }
        };
        Self { lights: lights.iter().enumerate().map(local).collect(), ambient, up, headlight: 0.0 }
    }

    /// Adds light from the origin that does not fade: what faces it has this radiance. It shows shapes where no other
    /// light comes.
    #[must_use]
    pub fn with_headlight(self, radiance: f32) -> Self {
        Self { headlight: radiance, ..self }
    }

    /// Radiance that leaves a diffuse surface of albedo 1 at `point` (relative to the origin) with unit `normal`.
    ///
    /// `face` is the unit normal of the flat triangle there: what shadow maps hold, whatever the shading normal pretends.
    /// Area lights are taken as points at their centre.
    pub fn radiance(&self, point: Vec3, normal: Vec3, face: Vec3) -> Vec3 {
        let up = 0.5 + 0.5 * normal.dot(self.up);
        let facing = normal.dot(-point.normalize_or_zero()).max(0.0);
        let mut sum = self.ambient[1].lerp(self.ambient[0], up) + self.headlight * facing;
        for light in &self.lights {
            let (towards, irradiance) = light.arriving(point);
            let cosine = normal.dot(towards);
            if cosine > 0.0 && irradiance != Vec3::ZERO {
                let lit = light.shadow.map_or(1.0, |s| s.lit_relative(point, face));
                sum += irradiance * (cosine * lit * std::f32::consts::FRAC_1_PI);
            }
        }
        sum
    }
}

impl LocalLight<'_> {
    /// Direction to the light, and irradiance on a surface that faces it.
    fn arriving(&self, point: Vec3) -> (Vec3, Vec3) {
        use std::f32::consts::PI;
        let to = self.position - point;
        let distance_sq = to.length_squared().max(f32::MIN_POSITIVE);
        let towards = to / distance_sq.sqrt();
        match self.light {
            Light::Directional { direction, irradiance, .. } => (-direction.as_vec3(), irradiance),
            Light::Point { intensity, .. } => (towards, intensity / distance_sq),
            Light::Spot { direction, half_angle, intensity, .. } => {
                let cosine = -direction.as_vec3().dot(towards);
                let inside = cosine > (half_angle as f32).cos();
                (towards, if inside { intensity / distance_sq } else { Vec3::ZERO })
            }
            Light::Sphere { radius, radiance, .. } => {
                let r = radius as f32;
                (towards, radiance * (PI * r * r / distance_sq.max(r * r)))
            }
            Light::Disk { normal, radius, radiance, .. } => {
                let r_sq = (radius * radius) as f32;
                let cosine = (-normal.as_vec3().dot(towards)).max(0.0);
                (towards, radiance * (PI * r_sq * cosine / (distance_sq + r_sq)))
            }
            Light::Rectangle { half_u, half_v, radiance, .. } => {
                let cross = half_u.cross(half_v);
                let area = 4.0 * cross.length() as f32;
                let cosine = (-cross.normalize().as_vec3().dot(towards)).max(0.0);
                (towards, radiance * (area * cosine / (distance_sq + area / PI)))
            }
            _ => (towards, Vec3::ZERO),
        }
    }
}
