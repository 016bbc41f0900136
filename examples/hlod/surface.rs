//! The surface to draw, where it is seen from, and how far off something is.

use crate::picture::{self, Part};
use farsight_geometry::distance::Surface;
use farsight_geometry::glam::{DVec3, Vec3, dvec3};
use farsight_geometry::{Camera, TriangleMesh, hard_cases, io};
use std::error::Error;
use std::path::Path;

/// All triangles of a scene's file.
pub fn load(path: &Path) -> Result<TriangleMesh, Box<dyn Error>> {
    let scene = io::load(path)?.into_scene().ok_or("the file holds points, no triangles")?;
    let mesh = scene.flattened()?;
    Ok(if mesh.normals().is_some() { mesh } else { with_normals(mesh)? })
}

/// A bumpy ball with wrinkles of several sizes, `12 n²` triangles.
pub fn generated(n: u32) -> TriangleMesh {
    let ball = hard_cases::bumpy_ball(n);
    let wrinkled = |p: &Vec3| {
        let fine = 0.02 * (23.0 * p.x + 9.0 * p.y).sin() * (19.0 * p.z).cos();
        *p * (1.0 + fine + 0.004 * (61.0 * p.y).sin() * (57.0 * p.x).cos())
    };
    let positions = ball.positions().iter().map(wrinkled).collect();
    let mesh = TriangleMesh::new(positions, ball.triangles().to_vec()).expect("a ball");
    with_normals(mesh).expect("a ball")
}

/// The same without attributes.
pub fn bare(mesh: &TriangleMesh) -> Result<TriangleMesh, Box<dyn Error>> {
    let bare = TriangleMesh::new(mesh.positions().to_vec(), mesh.triangles().to_vec())?;
    Ok(bare.with_origin(mesh.origin())?)
}

/// Normals weighted by area at vertices of equal position.
fn with_normals(mesh: TriangleMesh) -> Result<TriangleMesh, Box<dyn Error>> {
    let welded = mesh.welded();
    let mut sums = vec![Vec3::ZERO; welded.mesh.positions().len()];
    for (t, [a, b, c]) in welded.mesh.triangles().iter().zip(welded.mesh.corner_iter()) {
        let normal = (b - a).cross(c - a);
        t.iter().for_each(|&v| sums[v as usize] += normal);
    }
    let normals = welded.new_from_old.iter().map(|&v| sums[v as usize].normalize_or_zero()).collect();
    Ok(mesh.with_normals(normals)?)
}

/// A view of the whole from the front, a little from above and from the side.
pub fn camera(mesh: &TriangleMesh, side: u32) -> Result<Camera, Box<dyn Error>> {
    let bounds = mesh.world_bounds();
    if bounds.is_empty() || bounds.diagonal() == 0.0 {
        return Err("there is nothing to see".into());
    }
    let size = bounds.diagonal();
    let eye = bounds.center() + dvec3(0.4, 0.3, 1.0).normalize() * 0.75 * size;
    let camera = Camera::look_at(eye, bounds.center(), DVec3::Y)?;
    Ok(camera.with_range(0.01 * size, 10.0 * size)?.with_image(side, side)?)
}

/// How many pixels a visible point of a surface is from the nearest point of its parts, at most, measured at some thousand points.
pub fn measured_px(mesh: &TriangleMesh, parts: &[Part], camera: &Camera) -> Result<f64, Box<dyn Error>> {
    let mut positions: Vec<DVec3> = Vec::new();
    let mut triangles = Vec::new();
    for Part { mesh, .. } in parts {
        let base = positions.len() as u32;
        positions.extend(mesh.positions().iter().map(|p| mesh.origin() + p.as_dvec3()));
        triangles.extend(mesh.triangles().iter().map(|t| t.map(|v| v + base)));
    }
    let drawn = Surface::new(&TriangleMesh::from_world(&positions, triangles)?);
    let off = |p: &DVec3| {
        let to = drawn.nearest(*p)?.point;
        Some(camera.project(*p)?.0.distance(camera.project(to)?.0))
    };
    Ok(picture::visible_points(mesh, camera)?.iter().filter_map(off).fold(0.0, f64::max))
}
