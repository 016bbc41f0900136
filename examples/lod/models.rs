//! What stands along the avenue: an aeroplane, a statue, or meshes from files.

use farsight_geometry::glam::{Vec3, vec3};
use farsight_geometry::{TriangleMesh, io};
use farsight_raster::scenes::vertex_normals;
use std::error::Error;
use std::path::Path;

/// A mesh that stands on the ground, z up, about two to ten metres long, and its name.
pub struct Model {
    pub name: String,
    pub mesh: TriangleMesh,
}

/// A mesh from a file (y up), as tall as a statue.
pub fn load(path: &Path) -> Result<Model, Box<dyn Error>> {
    let name = path.file_stem().map_or_else(|| "mesh".into(), |n| n.to_string_lossy().into_owned());
    let scene = io::load(path)?.into_scene().ok_or("the file holds points, no triangles")?;
    let mesh = scene.flattened()?.welded().mesh;
    let b = mesh.bounds();
    if mesh.is_empty() || b.diagonal() == 0.0 {
        return Err(format!("{}: there is nothing to see", path.display()).into());
    }
    let scale = 3.4 / b.extent().max_element();
    let middle = b.center();
    let place = |p: &Vec3| vec3(p.x - middle.x, middle.z - p.z, p.y - b.min.y) * scale;
    let placed = TriangleMesh::new(mesh.positions().iter().map(place).collect(), mesh.triangles().to_vec())?;
    let stone = vec![[200, 192, 178, 255]; placed.positions().len()];
    let normals = vertex_normals(&placed);
    Ok(Model { name, mesh: placed.with_colours(stone)?.with_normals(normals)? })
}
