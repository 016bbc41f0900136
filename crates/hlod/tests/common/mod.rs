//! Generated surfaces, and a measurement that shares nothing with the crate.
#![allow(dead_code)] // Every test file uses a part of it.

use farsight_geometry::distance::{Hausdorff, HausdorffOptions, hausdorff};
use farsight_geometry::glam::{DVec3, Vec3, vec3};
use farsight_geometry::sampling::Random;
use farsight_geometry::{TriangleMesh, hard_cases};
use farsight_hlod::{Simplified, Tier};

/// A height field of `n` × `n` squares over the unit square: an open, rough surface.
pub fn terrain(n: u32, height: impl Fn(f32, f32) -> f32) -> TriangleMesh {
    let at = |i: u32| i as f32 / n as f32;
    let p = (0..=n).flat_map(|j| (0..=n).map(move |i| (at(i), at(j))));
    let p = p.map(|(x, y)| vec3(x, y, height(x, y))).collect();
    let row = n + 1;
    let t = (0..n).flat_map(|j| (0..n).map(move |i| j * row + i));
    let t = t.flat_map(|a| [[a, a + 1, a + row + 1], [a, a + row + 1, a + row]]).collect();
    TriangleMesh::new(p, t).unwrap()
}

pub fn hills(x: f32, y: f32) -> f32 {
    0.08 * (7.0 * x).sin() * (5.0 * y).cos() + 0.03 * (23.0 * x + 11.0 * y).sin() + 0.01 * (71.0 * y).cos()
}

/// A closed part with sharp edges, acute ones too, and flat and round faces: a star-shaped rod, finely divided.
pub fn rod(around: u32, along: u32) -> TriangleMesh {
    let radius = |k: u32| match 8 * k / around % 4 {
        0 => 1.0,
        1 => 0.45,
        2 => 0.9,
        _ => 0.5,
    };
    let mut p: Vec<Vec3> = Vec::new();
    for j in 0..=along {
        for i in 0..around {
            // Corners at eighths of the circle, straight between them.
            let eighth = around / 8;
            let (k, f) = (i / eighth, (i % eighth) as f32 / eighth as f32);
            let corner = |k: u32| {
                let a = k as f32 * std::f32::consts::TAU / 8.0;
                vec3(a.cos(), a.sin(), 0.0) * radius(k * eighth)
            };
            let bend = 0.3 * (3.0 * j as f32 / along as f32).sin();
            p.push(corner(k).lerp(corner((k + 1) % 8), f) + vec3(bend, 0.0, 3.0 * j as f32 / along as f32));
        }
    }
    let mut t = Vec::new();
    for j in 0..along {
        for i in 0..around {
            let (a, b) = (j * around + i, j * around + (i + 1) % around);
            t.extend([[a, b, b + around], [a, b + around, a + around]]);
        }
    }
    for (j, up) in [(0, false), (along, true)] {
        let centre = p.len() as u32;
        let bend = 0.3 * (3.0 * j as f32 / along as f32).sin();
        p.push(vec3(bend, 0.0, 3.0 * j as f32 / along as f32));
        for i in 0..around {
            let (a, b) = (j * around + i, j * around + (i + 1) % around);
            t.push(if up { [centre, a, b] } else { [centre, b, a] });
        }
    }
    TriangleMesh::new(p, t).unwrap()
}

/// A ball of loose leaves, two triangles each, around a smaller closed one.
pub fn leaves(count: u32, size: f64) -> TriangleMesh {
    let mut random = Random::new(12);
    let ball = hard_cases::bumpy_ball(12);
    let mut p: Vec<Vec3> = ball.positions().iter().map(|p| *p * 0.3).collect();
    let mut t = ball.triangles().to_vec();
    while t.len() < ball.triangles().len() + 2 * count as usize {
        let mut v = || DVec3::from_array(random.units()) * 2.0 - 1.0;
        let (at, u, w) = (v(), v(), v());
        if at.length() > 1.0 || u.length() < 0.1 {
            continue;
        }
        let (u, w) = (u.normalize() * size, u.cross(w).normalize_or(DVec3::Z) * 0.5 * size);
        let first = p.len() as u32;
        p.extend([at - u, at + w, at + u, at - w].map(|p| p.as_vec3()));
        t.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
    TriangleMesh::new(p, t).unwrap()
}

/// Three sheets that meet along one curved edge.
pub fn three_sheets(n: u32) -> TriangleMesh {
    let sheet = terrain(n, |x, y| 0.1 * (3.0 * x).sin() * y);
    let mut p = Vec::new();
    let mut t = Vec::new();
    for turn in 0..3 {
        let (s, c) = (turn as f32 * 2.0).sin_cos();
        let base = p.len() as u32;
        p.extend(sheet.positions().iter().map(|q| vec3(q.x, q.y * c - q.z * s, q.y * s + q.z * c)));
        t.extend(sheet.triangles().iter().map(|t| t.map(|i| i + base)));
    }
    TriangleMesh::new(p, t).unwrap()
}

/// A ball in separate strips whose rims do not quite meet: cracks and T-junctions.
pub fn cracked_ball() -> TriangleMesh {
    let ball = hard_cases::bumpy_ball(12);
    let mut p = Vec::new();
    let mut t = Vec::new();
    for corners in ball.corner_iter() {
        let part = (corners[0].z * 3.0).floor();
        let base = p.len() as u32;
        p.extend(corners.map(|q| q + vec3(0.0, 0.0, 0.002 * part)));
        t.push([base, base + 1, base + 2]);
    }
    TriangleMesh::new(p, t).unwrap()
}

/// The generated surfaces, by name.
pub fn meshes() -> Vec<(&'static str, TriangleMesh)> {
    let leaves = hard_cases::meshes().into_iter().find(|m| m.name.starts_with("leaves")).unwrap().mesh;
    let ball = hard_cases::bumpy_ball(24);
    let flat = TriangleMesh::new(
        ball.positions().iter().map(|&p| p * vec3(1.0, 1.0, 0.01)).collect(),
        ball.triangles().to_vec(),
    );
    vec![
        ("ball", ball),
        ("hills", terrain(60, hills)),
        ("rod", rod(48, 40)),
        ("three sheets", three_sheets(24)),
        ("cracked ball", cracked_ball()),
        ("leaves", leaves),
        ("thin disc", flat.unwrap()),
        ("noise", terrain(40, |x, y| 0.02 * ((x * 1234.5).sin() * (y * 987.6).cos() * 43.7).fract())),
        ("plateaus", terrain(48, |x, y| 0.2 * ((x * 4.0).floor() % 2.0) + 0.1 * ((y * 3.0).floor() % 2.0))),
        ("far away", far_away()),
    ]
}

fn far_away() -> TriangleMesh {
    terrain(40, hills).with_origin(DVec3::new(480_000.3, 5_400_000.7, 120.1)).unwrap()
}

pub const TIERS: [Tier; 3] = [Tier::Guaranteed, Tier::Verified, Tier::Fast];

/// The distance between input and result, by code that the crate does not use for these tiers.
pub fn measure(mesh: &TriangleMesh, simple: &Simplified, tolerance: f64) -> Hausdorff {
    hausdorff(mesh, &simple.mesh, &HausdorffOptions::new(1e-3 * tolerance).with_max_splits(40_000))
}
