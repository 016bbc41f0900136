//! Surfaces to simplify.

use farsight_geometry::glam::{Vec3, vec3};
use farsight_geometry::{TriangleMesh, hard_cases, io};
use farsight_raster::Random;

/// Generated ones: smooth and closed, rough and open, a part with flat faces and sharp edges, a noisy scan.
/// `n` sets their size: 12 n² triangles in the largest but one.
pub fn generated(n: u32) -> Vec<(String, TriangleMesh)> {
    let mut random = Random::new(7);
    let ball = hard_cases::bumpy_ball(n);
    let mut noisy: Vec<Vec3> = ball.positions().to_vec();
    for p in &mut noisy {
        *p *= 1.0 + 0.002 * (random.unit() as f32 - 0.5);
    }
    let scan = TriangleMesh::new(noisy, ball.triangles().to_vec()).expect("a ball");
    vec![
        ("ball".into(), ball),
        (
            "hills".into(),
            terrain(3 * n, |x, y| {
                0.05 * (9.0 * x).sin() * (7.0 * y).cos() + 0.01 * (41.0 * x + 17.0 * y).sin()
            }),
        ),
        (
            "steps".into(),
            terrain(2 * n, |x, y| 0.2 * ((x * 4.0).floor() % 2.0) + 0.1 * ((y * 3.0).floor() % 2.0)),
        ),
        ("noisy scan".into(), scan),
    ]
}

fn terrain(n: u32, height: impl Fn(f32, f32) -> f32) -> TriangleMesh {
    let at = |i: u32| i as f32 / n as f32;
    let p = (0..=n).flat_map(|j| (0..=n).map(move |i| (at(i), at(j))));
    let p = p.map(|(x, y)| vec3(x, y, height(x, y))).collect();
    let row = n + 1;
    let t = (0..n).flat_map(|j| (0..n).map(move |i| j * row + i));
    let t = t.flat_map(|a| [[a, a + 1, a + row + 1], [a, a + row + 1, a + row]]).collect();
    TriangleMesh::new(p, t).expect("a grid")
}

/// The collected ones, if their folder is known.
pub fn collected() -> Vec<(String, TriangleMesh)> {
    const NAMES: [&str; 14] = [
        "fandisk.obj",
        "stanford_bunny.obj",
        "igea.glb",
        "armadillo.obj",
        "nefertiti.obj",
        "lucy.glb",
        "lion_statue.obj",
        "mech_holes_shark.obj",
        "boat.obj",
        "diplodocus.obj",
        "cycloidal.glb",
        "teapot.obj",
        "beetle.obj",
        "bunny_nonmanifold.glb",
    ];
    let Ok(folder) = std::env::var("FARSIGHT_DATA") else { return vec![] };
    NAMES
        .iter()
        .filter_map(|&name| {
            let path = std::path::Path::new(&folder).join(name);
            let mesh = io::load(&path).ok()?.into_scene()?.flattened().ok()?;
            Some((name.to_owned(), mesh))
        })
        .collect()
}
