//! The scenes and their view cells.

use farsight_geometry::glam::{DVec3, Vec3};
use farsight_geometry::io;
use farsight_geometry::ray::Bvh8;
use farsight_geometry::{DAabb, TriangleMesh};
use farsight_raster::scenes::{City, Cubes};
use farsight_visibility::{Triangles, ViewCell};
use std::error::Error;

/// A scene with a view cell in it.
pub struct Case {
    pub name: &'static str,
    pub mesh: TriangleMesh,
    pub caster: Bvh8,
    pub cell: ViewCell,
}

impl Case {
    fn new(
        name: &'static str,
        mesh: TriangleMesh,
        center: DVec3,
        size: DVec3,
    ) -> Result<Self, Box<dyn Error>> {
        let caster = Bvh8::new(&mesh);
        let cell = ViewCell::from_box(&DAabb::new(center - size * 0.5, center + size * 0.5))?;
        Ok(Self { name, mesh, caster, cell })
    }

    /// A street of the generated town; its size is that of the paper's cells.
    pub fn city(small: bool) -> Result<Self, Box<dyn Error>> {
        let city = if small { City::small() } else { City::default() };
        let street = city.street(city.blocks / 2);
        let center = DVec3::new(street - 25.0, street, 1.7);
        Self::new("city", city.build()?.flattened()?, center, DVec3::new(15.0, 2.2, 0.8))
    }

    /// Loose cubes, the cell in their midst.
    pub fn cubes() -> Result<Self, Box<dyn Error>> {
        let mesh = Cubes::default().build()?.flattened()?;
        Self::new("cubes", mesh, DVec3::splat(50.0), DVec3::splat(1.5))
    }

    /// The scanned head, ten units tall, with the cell in front of the face; `None` without the collected data.
    pub fn igea() -> Result<Option<Self>, Box<dyn Error>> {
        let Some(folder) = std::env::var_os("FARSIGHT_DATA") else { return Ok(None) };
        let path = std::path::Path::new(&folder).join("igea.glb");
        let mesh = io::load(&path)?.into_scene().ok_or("no triangles")?.flattened()?;
        let b = mesh.bounds();
        let scale = 10.0 / b.extent().max_element();
        let moved: Vec<Vec3> = mesh.positions().iter().map(|&p| (p - b.center()) * scale).collect();
        let mesh = TriangleMesh::new(moved, mesh.triangles().to_vec())?;
        let ahead = f64::from(mesh.bounds().max.z);
        Ok(Some(Self::new("igea", mesh, DVec3::new(0.0, 0.0, ahead + 2.0), DVec3::new(1.5, 1.5, 0.8))?))
    }

    pub fn triangles(&self) -> Triangles<'_> {
        Triangles::of_mesh(&self.mesh)
    }
}
