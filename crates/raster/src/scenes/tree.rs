//! Trees.

use super::builder::{Builder, shaded};
use crate::random::Random;
use glam::Vec3;

/// A street tree about 6 m high: a tapering trunk and a lumpy crown, closed.
pub(crate) fn round_tree(random: &mut Random, out: &mut Builder) {
    trunk(2.4, 0.16, out);
    let green = shaded([84, 112, 48], random.range_f32(0.85, 1.15));
    let phases: [f32; 6] = std::array::from_fn(|_| random.range_f32(0.0, std::f32::consts::TAU));
    let center = Vec3::new(0.0, 0.0, 3.9);
    let (columns, rows) = (20u32, 10u32);
    let radius = |d: Vec3| {
        let lumps = (5.0 * d.x + phases[0]).sin() * (4.0 * d.y + phases[1]).sin()
            + (6.0 * d.z + phases[2]).sin() * (5.0 * d.x + phases[3]).cos()
            + 0.5 * (9.0 * d.y + phases[4]).sin() * (8.0 * d.z + phases[5]).sin();
        1.55 + 0.16 * lumps
    };
    let direction = |i: u32, j: u32| {
        let (sin, cos) = (std::f32::consts::TAU * (i % columns) as f32 / columns as f32).sin_cos();
        let (rho, z) = (std::f32::consts::PI * (j as f32 / rows as f32 - 0.5)).sin_cos();
        Vec3::new(z * cos, z * sin, rho)
    };
    let vertex = |d: Vec3| {
        let p = center + d * radius(d) * Vec3::new(1.0, 1.0, 1.15);
        // The gradient of the radius is left out: a soft normal looks more like leaves than the surface's own.
        (p, d, shaded(green, 0.75 + 0.25 * (d.z + 1.0) * 0.5 + 0.4 * (radius(d) - 1.55)))
    };
    let first = out.vertices();
    out.patch(columns, rows - 2, |i, j| vertex(direction(i, j + 1)));
    for pole in [Vec3::NEG_Z, Vec3::Z] {
        let (p, normal, colour) = vertex(pole);
        let tip = out.vertex(p, normal, colour);
        let ring = if pole.z < 0.0 { first } else { first + (rows - 2) * (columns + 1) };
        for i in 0..columns {
            let (a, b) = (ring + i, ring + i + 1);
            out.triangle(if pole.z < 0.0 { [tip, b, a] } else { [a, b, tip] });
        }
    }
}

/// A trunk from the ground to `height`.
pub(crate) fn trunk(height: f32, radius: f32, out: &mut Builder) {
    let sides = 8u32;
    out.patch(sides, 2, |i, j| {
        let (sin, cos) = (std::f32::consts::TAU * (i % sides) as f32 / sides as f32).sin_cos();
        let r = radius * (1.0 - 0.15 * j as f32);
        let normal = Vec3::new(cos, sin, 0.0);
        (normal * r + Vec3::Z * (height * j as f32 / 2.0), normal, [96, 76, 56])
    });
}
