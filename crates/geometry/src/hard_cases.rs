//! The catalogue of hard inputs. Every crate runs every preset over all of it.
//!
//! Meshes here are valid (anything else is refused by [`TriangleMesh`]) but unpleasant: degenerate, folded, doubled,
//! tiny, huge, far away. [`bad_meshes`] holds what must be refused. Views and light directions are made for
//! a given box, so that a crate can put each mesh under each of them.

use crate::bounds::DAabb;
use crate::camera::{Camera, Projection};
use crate::mesh::TriangleMesh;
use glam::{DQuat, DVec3, Vec3, vec3};

/// A valid but unpleasant mesh.
#[derive(Clone, Debug)]
pub struct HardMesh {
    /// What is hard about it.
    pub name: &'static str,
    /// The mesh.
    pub mesh: TriangleMesh,
}

/// Input that must be refused with an error.
#[derive(Clone, Debug)]
pub struct BadMesh {
    /// What is wrong with it.
    pub name: &'static str,
    /// Positions.
    pub positions: Vec<Vec3>,
    /// Triangles.
    pub triangles: Vec<[u32; 3]>,
}

/// A camera that makes something difficult.
#[derive(Clone, Copy, Debug)]
pub struct HardView {
    /// What is hard about it.
    pub name: &'static str,
    /// The camera.
    pub camera: Camera,
}

/// A flat `n` x `n` grid of unit squares, two triangles each, spanned by `u` and `v`.
fn grid(n: u32, u: Vec3, v: Vec3) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let positions = (0..=n).flat_map(|j| (0..=n).map(move |i| u * i as f32 + v * j as f32)).collect();
    let cell = |i: u32, j: u32| {
        let a = j * (n + 1) + i;
        [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]
    };
    (positions, (0..n).flat_map(|j| (0..n).flat_map(move |i| cell(i, j))).collect())
}

/// A closed bumpy ball of `12 · n²` triangles around the origin, radius about 1: a subdivided cube, pushed out.
pub fn bumpy_ball(n: u32) -> TriangleMesh {
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    let faces = [
        (Vec3::X, Vec3::Y, Vec3::Z),
        (Vec3::Y, Vec3::Z, Vec3::X),
        (Vec3::Z, Vec3::X, Vec3::Y),
        (Vec3::Y, Vec3::X, -Vec3::Z),
        (Vec3::Z, Vec3::Y, -Vec3::X),
        (Vec3::X, Vec3::Z, -Vec3::Y),
    ];
    for (u, v, w) in faces {
        let (points, cells) = grid(n, u, v);
        let base = positions.len() as u32;
        // Coordinates on the cube are exact multiples of 1/n, so that neighbouring faces agree bit for bit.
        positions.extend(points.iter().map(|&p| {
            let on_cube = (2.0 * p - (u + v) * n as f32 + w * n as f32) / n as f32;
            let d = on_cube.as_dvec3().normalize();
            let bump = 1.0 + 0.1 * (5.0 * d.x).sin() * (7.0 * d.y).cos() + 0.05 * (11.0 * d.z).sin();
            (d * bump).as_vec3()
        }));
        triangles.extend(cells.iter().map(|t| t.map(|i| i + base)));
    }
    let mesh = TriangleMesh::new(positions, triangles).expect("the ball is valid");
    mesh.welded().mesh
}

/// Valid but unpleasant meshes, from nothing at all to a ball at UTM coordinates.
pub fn meshes() -> Vec<HardMesh> {
    let mut list = Vec::new();
    let mut add = |name, positions: Vec<Vec3>, triangles: Vec<[u32; 3]>| {
        let mesh = TriangleMesh::new(positions, triangles).expect(name);
        list.push(HardMesh { name, mesh });
    };
    let corner = || vec![Vec3::ZERO, Vec3::X, Vec3::Y];
    add("empty", vec![], vec![]);
    add("vertices without triangles", corner(), vec![]);
    add("one triangle", corner(), vec![[0, 1, 2]]);
    add("one corner three times", corner(), vec![[1, 1, 1]]);
    add("zero area, two equal corners", corner(), vec![[0, 1, 1], [0, 1, 2]]);
    add("zero area, corners on a line", vec![Vec3::ZERO, Vec3::X, Vec3::X * 3.0], vec![[0, 1, 2]]);
    add("all vertices coincident", vec![Vec3::ONE; 9], vec![[0, 1, 2], [3, 4, 5], [6, 7, 8]]);
    add("sliver 1e6:1", vec![Vec3::ZERO, Vec3::X * 1e6, vec3(5e5, 1.0, 0.0)], vec![[0, 1, 2]]);
    add("needles", needles().0, needles().1);
    add("duplicate triangles", corner(), vec![[0, 1, 2]; 4]);
    add("a triangle and its back", corner(), vec![[0, 1, 2], [0, 2, 1]]);
    add("coincident vertices, unwelded", corner().repeat(3), vec![[0, 4, 8], [3, 7, 2], [6, 1, 5]]);
    let fan = vec![Vec3::ZERO, Vec3::Z, Vec3::X, Vec3::Y, -Vec3::X, -Vec3::Y];
    add("non-manifold fan on one edge", fan, vec![[0, 1, 2], [0, 1, 3], [0, 1, 4], [0, 1, 5]]);
    let bow = vec![vec3(-1., -1., 0.), vec3(-1., 1., 0.), Vec3::ZERO, vec3(1., -1., 0.), vec3(1., 1., 0.)];
    add("bow-tie at one vertex", bow, vec![[0, 2, 1], [2, 3, 4]]);
    let t =
        vec![Vec3::ZERO, vec3(2., 0., 0.), vec3(1., -1., 0.), vec3(0., 1., 0.), vec3(2., 1., 0.), Vec3::X];
    add("t-junction", t, vec![[0, 2, 1], [0, 5, 3], [5, 4, 3], [5, 1, 4]]);
    let crossing = vec![-Vec3::X, Vec3::X, Vec3::Y, -Vec3::Z, Vec3::Z, vec3(0., 0.5, 0.)];
    add("triangles through each other", crossing, vec![[0, 1, 2], [3, 4, 5]]);
    let (p, t) = grid(12, Vec3::X, Vec3::Y);
    add("coplanar grid", p, t);
    // No coordinate of this plane is a sum of few powers of two, so coplanarity does not survive rounding.
    let (p, t) = grid(12, vec3(0.1, 0.03, 0.07), vec3(-0.03, 0.11, 0.013));
    let far = vec3(1234.5, -987.6, 555.5);
    add("coplanar grid, tilted and far away", p.iter().map(|&q| q + far).collect(), t);
    let (p, t) = grid(8, Vec3::X, Vec3::Y);
    let folded = p.iter().map(|&q| vec3(if q.x > 4.0 { 8.0 - q.x } else { q.x }, q.y, 0.0)).collect();
    add("sheet folded onto itself", folded, t);
    add("leaves without a common vertex", leaves(200).0, leaves(200).1);
    for (name, scale) in
        [("extent 1e-18", 1e-18), ("extent 1e-6", 1e-6), ("extent 1e6", 1e6), ("extent 1e18", 8e17)]
    {
        let ball = bumpy_ball(4);
        add(name, ball.positions().iter().map(|&p| p * scale).collect(), ball.triangles().to_vec());
    }
    let thin = bumpy_ball(4);
    add(
        "flattened 1e9:1",
        thin.positions().iter().map(|&p| p * vec3(1.0, 1.0, 1e-9)).collect(),
        thin.triangles().to_vec(),
    );
    let offset = vec3(148_376.0, 1234.0, -223_423.0);
    let moved = bumpy_ball(4);
    add(
        "coordinates around 2e5 in f32",
        moved.positions().iter().map(|&p| p + offset).collect(),
        moved.triangles().to_vec(),
    );
    for (name, origin) in [
        ("origin 1e4", DVec3::new(1e4, -1e4, 1e4)),
        ("origin at UTM coordinates", DVec3::new(480_000.3, 5_400_000.7, 120.1)),
        ("origin 1e7", DVec3::new(-1e7, 1e7, 1e7)),
    ] {
        let mesh = bumpy_ball(4).with_origin(origin).expect(name);
        list.push(HardMesh { name, mesh });
    }
    list
}

/// Long thin triangles around one point, some below the spacing of `f32` at their far end.
fn needles() -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut positions = vec![Vec3::ZERO];
    for i in 0..16 {
        let angle = i as f32 * 0.39;
        let tip = vec3(angle.cos(), angle.sin(), 0.1 * i as f32) * 1000.0;
        positions.extend([tip, tip + Vec3::Z * 10f32.powi(-(i % 8))]);
    }
    (positions, (0..16).map(|i| [0, 2 * i + 1, 2 * i + 2]).collect())
}

fn leaves(count: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let positions = (0..count).flat_map(|i| {
        let t = i as f32;
        let at = vec3((t * 1.3).sin() * 5.0, (t * 0.7).cos() * 5.0, (t * 2.9).sin() * 5.0);
        [at, at + vec3(0.1, 0.02, 0.0), at + vec3(0.0, 0.1, 0.03 * (t * 5.0).sin())]
    });
    (positions.collect(), (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect())
}

/// Input that every constructor must refuse.
pub fn bad_meshes() -> Vec<BadMesh> {
    let bad = |name, last: Vec3, index: u32| BadMesh {
        name,
        positions: vec![Vec3::ZERO, Vec3::X, last],
        triangles: vec![[0, 1, index]],
    };
    vec![
        bad("NaN", vec3(0.0, f32::NAN, 0.0), 2),
        bad("infinity", vec3(0.0, f32::INFINITY, 0.0), 2),
        bad("extent 1e20", vec3(0.0, 1e20, 0.0), 2),
        bad("index past the end", Vec3::Y, 3),
        bad("largest index", Vec3::Y, u32::MAX),
    ]
}

/// Views of a box that make something difficult: eye on a face, inside, straight up or down, reversed extremes of range.
///
/// An empty or point-sized box is viewed as if it were a unit cube.
pub fn views(bounds: &DAabb) -> Vec<HardView> {
    let size = if bounds.diagonal() > 0.0 { bounds.diagonal() } else { 1.0 };
    let center = if bounds.is_empty() { DVec3::ZERO } else { bounds.center() };
    let half = bounds.extent() * 0.5;
    let look = |offset: DVec3, up: DVec3| {
        let range = |camera: Camera| camera.with_range(1e-4 * size, 1e2 * size);
        let direction = if offset == DVec3::ZERO { DVec3::X } else { -offset.normalize() };
        let basis = up.cross(-direction).normalize();
        let rotation = glam::DMat3::from_cols(basis, (-direction).cross(basis), -direction);
        Camera::new(center + offset, DQuat::from_mat3(&rotation)).and_then(range).expect("views are valid")
    };
    let ahead = look(DVec3::Z * 1.5 * size, DVec3::Y);
    let view = |name, camera| HardView { name, camera };
    let valid = "views are valid";
    vec![
        view("ahead", ahead),
        view("eye in the centre", look(DVec3::ZERO, DVec3::Y)),
        view("eye on a face's plane", look(DVec3::new(half.x, 0.0, size), DVec3::Y)),
        view("eye at a corner", look(half + DVec3::Z * 1e-9 * size, DVec3::Y)),
        view("straight down", look(DVec3::Y * 1.5 * size, DVec3::Z)),
        view("straight up", look(DVec3::NEG_Y * 1.5 * size, DVec3::X)),
        view("from afar", look(DVec3::new(0.6, 0.2, 0.75) * 50.0 * size, DVec3::Y)),
        view("infinite far", ahead.with_range(1e-6 * size, f64::INFINITY).expect(valid)),
        view("near and far almost equal", ahead.with_range(1.5 * size, 1.5001 * size).expect(valid)),
        view("orthographic", ahead.with_projection(Projection::Orthographic { height: size }).expect(valid)),
        view("very wide", ahead.with_projection(Projection::Perspective { fov_y: 3.0 }).expect(valid)),
        view("very narrow", ahead.with_projection(Projection::Perspective { fov_y: 1e-3 }).expect(valid)),
        view("one pixel", ahead.with_image(1, 1).expect(valid)),
        view("one row", ahead.with_image(4096, 1).expect(valid)),
        view("looking away", look(DVec3::Z * 1.5 * size, DVec3::Y).turned_around()),
    ]
}

impl Camera {
    /// The same eye, looking the other way.
    fn turned_around(self) -> Self {
        let half_turn = DQuat::from_rotation_y(std::f64::consts::PI);
        let turned = Camera::new(self.eye(), self.world_from_view() * half_turn).expect("still valid");
        turned.with_range(self.near(), self.far()).expect("still valid")
    }
}

/// Directions of light that stand in a difficult relation to a camera: along it, against it, nearly so, across.
pub fn light_directions(camera: &Camera) -> Vec<(&'static str, DVec3)> {
    let (ahead, up, right) = (camera.forward(), camera.up(), camera.right());
    vec![
        ("with the view", ahead),
        ("against the view", -ahead),
        ("nearly with the view", (ahead + 1e-9 * up).normalize()),
        ("one microradian off the view", (ahead + 1e-6 * right).normalize()),
        ("across", -up),
        ("from below", up),
        ("from the side", right),
        ("slanted", (ahead * 0.3 - up + right * 0.4).normalize()),
        ("along the world's −y", DVec3::NEG_Y),
        ("grazing", (right - 1e-7 * up).normalize()),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_the_ball_is_closed() {
        let list = meshes();
        let mut names: Vec<_> = list.iter().map(|m| m.name).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), list.len());
        assert!(bumpy_ball(5).report().is_closed());
        assert_eq!(bumpy_ball(5).triangles().len(), 12 * 25);
    }

    #[test]
    fn bad_meshes_are_refused() {
        for bad in bad_meshes() {
            assert!(TriangleMesh::new(bad.positions, bad.triangles).is_err(), "{}", bad.name);
        }
    }

    #[test]
    fn every_mesh_has_every_view() {
        for hard in meshes() {
            let bounds = hard.mesh.world_bounds();
            for view in views(&bounds) {
                let px = view.camera.box_px(&bounds);
                assert!(px >= 0.0 && !px.is_nan(), "{} / {}", hard.name, view.name);
                for (name, direction) in light_directions(&view.camera) {
                    assert!((direction.length() - 1.0).abs() < 1e-12, "{name}");
                }
            }
        }
    }
}
