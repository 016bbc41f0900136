//! Single objects that stand or move in other scenes: smooth surfaces of as many triangles as wanted.

use super::check;
use crate::RasterError;
use farsight_geometry::TriangleMesh;
use glam::{Vec3, vec2, vec3};
use std::f32::consts::{PI, TAU};

/// Surfaces on their way to one mesh.
#[derive(Default)]
struct Builder {
    positions: Vec<Vec3>,
    colours: Vec<[u8; 4]>,
    triangles: Vec<[u32; 3]>,
}

impl Builder {
    /// A closed surface over a grid of `n` by `m` squares; the second parameter goes round.
    fn surface(
        &mut self,
        n: u32,
        m: u32,
        at: impl Fn(f32, f32) -> Vec3,
        colour: impl Fn(f32, f32) -> [u8; 3],
    ) {
        let base = self.positions.len() as u32;
        for i in 0..=n {
            for j in 0..m {
                let (s, t) = (i as f32 / n as f32, j as f32 / m as f32);
                self.positions.push(at(s, t));
                let [r, g, b] = colour(s, t);
                self.colours.push([r, g, b, 255]);
            }
        }
        for i in 0..n {
            for j in 0..m {
                let at = |i: u32, j: u32| base + i * m + j % m;
                self.triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
                self.triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        }
    }

    fn mesh(self) -> Result<TriangleMesh, RasterError> {
        let mesh = TriangleMesh::new(self.positions, self.triangles)?.with_colours(self.colours)?;
        let normals = vertex_normals(&mesh);
        Ok(mesh.with_normals(normals)?)
    }
}

/// A twin-engined aeroplane on the ground, nose along x, 9 m long; `n` sets its triangles: 13 n².
///
/// # Errors
/// [`RasterError::Option`] when `n` is not in 2 to 1000.
pub fn aeroplane(n: u32) -> Result<TriangleMesh, RasterError> {
    check("n", n.into(), "2..=1000", (2..=1000).contains(&n))?;
    let mut b = Builder::default();
    let round = |t: f32| vec2((TAU * t).cos(), (TAU * t).sin());
    let white = [225, 228, 232];
    // Fuselage: blunt in front, lifted and pointed behind.
    let radius = |s: f32| {
        0.6 * (1.0 - (1.0 - (s * 5.0).min(1.0)).powi(2)).max(0.0).sqrt()
            * (1.0 - ((s - 0.55) / 0.45).max(0.0).powi(2)).max(0.0)
    };
    b.surface(
        2 * n,
        n,
        |s, t| {
            let r = round(t) * radius(s);
            vec3(4.5 - 9.0 * s, r.x, 1.8 + r.y + 0.5 * (s - 0.55).max(0.0))
        },
        |s, t| {
            let window = (0.12..0.75).contains(&s)
                && (s * 40.0).fract() < 0.5
                && (t - 0.05).abs().min((t - 0.45).abs()) < 0.025;
            let nose = s < 0.05 || (0.22..0.28).contains(&t) && s < 0.1;
            if window || nose {
                [40, 50, 70]
            } else if (0.02..0.48).contains(&t) {
                white
            } else {
                [60, 90, 160]
            }
        },
    );
    // A wing: from tip to tip, swept and tapered. `span` is half its width.
    let mut wing = |n: u32, root: Vec3, span: f32, chord: f32, up: Vec3, side: Vec3, colour: [u8; 3]| {
        b.surface(
            n,
            n,
            |s, t| {
                let along = 2.0 * s - 1.0;
                let taper =
                    chord * (1.0 - 0.65 * along.abs()) * if s == 0.0 || s == 1.0 { 0.02 } else { 1.0 };
                let r = round(t);
                let sweep = -0.9 * span * 0.35 * along.abs();
                root + side * (span * along)
                    + Vec3::X * (r.x * 0.5 * taper + sweep)
                    + up * (r.y * 0.06 * taper + 0.06 * span * along.abs())
            },
            |s, _| if (s - 0.5).abs() > 0.46 { [190, 60, 50] } else { colour },
        );
    };
    wing(n, vec3(0.6, 0.0, 1.6), 4.6, 1.9, Vec3::Z, Vec3::Y, [190, 196, 205]);
    wing(n, vec3(-3.9, 0.0, 2.1), 1.7, 1.0, Vec3::Z, Vec3::Y, [190, 196, 205]);
    wing(n, vec3(-3.8, 0.0, 2.0), 1.6, 1.3, Vec3::Y, Vec3::Z, [190, 60, 50]);
    for y in [-1.7f32, 1.7] {
        b.surface(
            n,
            n,
            |s, t| {
                let r = round(t) * 0.32 * (PI * s.clamp(0.02, 0.98)).sin().powf(0.35);
                vec3(1.4 - 1.5 * s, y + r.x, 1.25 + r.y)
            },
            |s, _| if s < 0.12 { [50, 50, 55] } else { [170, 176, 186] },
        );
        // Wheels and legs.
        b.surface(
            n / 2,
            n / 2,
            |s, t| {
                let r = round(t) * 0.28 * (PI * s).sin().max(0.0).powf(0.4);
                vec3(0.3 + r.x, y + 0.2 * (s - 0.5), 0.28 + r.y)
            },
            |_, _| [35, 35, 38],
        );
        b.surface(
            4,
            n / 2,
            |s, t| vec3(0.3, y, 0.3 + s) + (round(t) * 0.05).extend(0.0),
            |_, _| [120, 120, 125],
        );
    }
    b.mesh()
}

/// A figure in a cloak on a column, 3.4 m tall; `n` sets its triangles: 22 n².
///
/// # Errors
/// [`RasterError::Option`] when `n` is not in 2 to 1000.
pub fn statue(n: u32) -> Result<TriangleMesh, RasterError> {
    check("n", n.into(), "2..=1000", (2..=1000).contains(&n))?;
    let mut b = Builder::default();
    let round = |t: f32| vec2((TAU * t).cos(), (TAU * t).sin());
    let stone = |s: f32, t: f32| {
        let grain = 9.0 * ((s * 31.0).sin() * (TAU * 3.0 * t).cos() + 0.5 * (s * 57.0 + TAU * 5.0 * t).sin());
        [196.0, 186.0, 166.0].map(|c| (c + grain) as u8)
    };
    let column = |s: f32| match s {
        s if s < 0.12 => 0.75 - 0.6 * s,
        s if s > 0.9 => 0.5 + 1.6 * (s - 0.9),
        _ => 0.55 - 0.08 * s,
    };
    b.surface(
        n,
        2 * n,
        |s, t| {
            let flutes = 1.0 - 0.035 * (TAU * 10.0 * t).cos().abs();
            (round(t) * column(s) * flutes * if s == 1.0 { 0.01 } else { 1.0 }).extend(1.4 * s)
        },
        stone,
    );
    // Cloak: folds that deepen downwards.
    b.surface(
        3 * n,
        2 * n,
        |s, t| {
            let body = 0.48 * (1.0 - 0.72 * s) * (1.0 + 0.25 * (PI * s).sin());
            let folds = 1.0
                + 0.16 * (1.0 - s) * (TAU * 9.0 * t + 3.0 * s).sin()
                + 0.05 * (TAU * 23.0 * t + 7.0 * s).sin();
            let lean = vec2(0.10 * (2.5 * s).sin(), 0.05 * s);
            let end = if s == 0.0 || s == 1.0 { 0.01 } else { 1.0 };
            (round(t) * body * folds * end * vec2(1.0, 0.8) + lean).extend(1.4 + 1.55 * s)
        },
        stone,
    );
    b.surface(
        n,
        n,
        |s, t| {
            let r = (PI * s).sin().max(0.01);
            let face =
                1.0 + 0.08 * (TAU * t).cos() * (6.0 * s).sin() + 0.03 * (TAU * 7.0 * t).sin() * (1.0 - s);
            (round(t) * (0.2 * r * face) + vec2(0.06, 0.05)).extend(3.12 - 0.24 * (PI * s).cos())
        },
        stone,
    );
    for side in [-1.0f32, 1.0] {
        b.surface(
            n,
            n,
            |s, t| {
                let bend = vec3(
                    0.28 * (2.2 * s).sin(),
                    side * (0.28 + 0.18 * (PI * s).sin()),
                    2.6 - 0.75 * s + 0.35 * s * s,
                );
                let r = round(t) * (0.11 - 0.05 * s) * if s == 0.0 || s == 1.0 { 0.01 } else { 1.0 };
                bend + vec3(r.x, side * 0.2 * r.y, r.y)
            },
            stone,
        );
    }
    b.mesh()
}

/// Normals at a mesh's vertices, weighted by the areas of the triangles around.
pub fn vertex_normals(mesh: &TriangleMesh) -> Vec<Vec3> {
    let mut sums = vec![Vec3::ZERO; mesh.positions().len()];
    for (t, [a, b, c]) in mesh.triangles().iter().zip(mesh.corner_iter()) {
        let normal = (b - a).cross(c - a);
        t.iter().for_each(|&v| sums[v as usize] += normal);
    }
    sums.iter().map(|n| n.normalize_or(Vec3::Z)).collect()
}
