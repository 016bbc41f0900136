//! The input on disk: read once, in whatever batches it comes, and handed on in small ones.

use super::scratch::Scratch;
use crate::HlodError;
use crate::appearance::Look;
use crate::cell::Cube;
use crate::cut::Polygons;
use crate::piece::Attributes;
use farsight_geometry::mesh::triangle_area;
use farsight_geometry::{DAabb, TriangleMesh};
use glam::{DVec3, Vec2, Vec3};
use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::PathBuf;

/// Most triangles of a block.
const BLOCK: usize = 1 << 15;

/// All input, in a file.
pub(super) struct Spool {
    file: File,
    path: PathBuf,
    pub bounds: DAabb,
    pub attributes: Attributes,
    pub triangles: u64,
    /// Of all triangles, in world units.
    pub area: f64,
}

/// Writes batches to a file.
pub(super) struct Spooler {
    writer: BufWriter<File>,
    path: PathBuf,
    bounds: DAabb,
    attributes: Attributes,
    triangles: u64,
    area: f64,
    new_id: Vec<u32>,
}

impl Spooler {
    pub(super) fn new(scratch: &Scratch) -> Result<Self, HlodError> {
        let (file, path) = scratch.create("input")?;
        Ok(Self {
            writer: BufWriter::with_capacity(1 << 20, file),
            path,
            bounds: DAabb::EMPTY,
            attributes: Attributes::default(),
            triangles: 0,
            area: 0.0,
            new_id: Vec::new(),
        })
    }

    pub(super) fn add(&mut self, mesh: &TriangleMesh) -> Result<(), HlodError> {
        if mesh.is_empty() {
            return Ok(());
        }
        self.bounds = self.bounds.union(mesh.world_bounds());
        self.attributes = self.attributes.union(Attributes::of(mesh));
        self.triangles += mesh.triangles().len() as u64;
        // Summed triangle by triangle, so that batches do not matter.
        mesh.corner_iter().for_each(|c| self.area += triangle_area(c));
        self.new_id.clear();
        self.new_id.resize(mesh.positions().len(), u32::MAX);
        for block in mesh.triangles().chunks(BLOCK) {
            let mut used: Vec<u32> = Vec::new();
            let mut indices: Vec<[u32; 3]> = Vec::with_capacity(block.len());
            for t in block {
                indices.push(t.map(|v| {
                    let id = &mut self.new_id[v as usize];
                    if *id == u32::MAX {
                        *id = used.len() as u32;
                        used.push(v);
                    }
                    *id
                }));
            }
            self.write(mesh, &used, &indices).map_err(HlodError::io(&self.path))?;
            used.iter().for_each(|&v| self.new_id[v as usize] = u32::MAX);
        }
        Ok(())
    }

    fn write(&mut self, mesh: &TriangleMesh, used: &[u32], indices: &[[u32; 3]]) -> std::io::Result<()> {
        let w = &mut self.writer;
        w.write_all(bytemuck::bytes_of(&mesh.origin().to_array()))?;
        let attributes = u32::from(Attributes::of(mesh).bits());
        w.write_all(bytemuck::bytes_of(&[attributes, used.len() as u32, indices.len() as u32]))?;
        let pick = |v: &u32| *v as usize;
        let positions: Vec<Vec3> = used.iter().map(|v| mesh.positions()[pick(v)]).collect();
        w.write_all(bytemuck::cast_slice(&positions))?;
        if let Some(normals) = mesh.normals() {
            let normals: Vec<Vec3> = used.iter().map(|v| normals[pick(v)]).collect();
            w.write_all(bytemuck::cast_slice(&normals))?;
        }
        if let Some(uvs) = mesh.uvs() {
            let uvs: Vec<Vec2> = used.iter().map(|v| uvs[pick(v)]).collect();
            w.write_all(bytemuck::cast_slice(&uvs))?;
        }
        if let Some(colours) = mesh.colours() {
            let colours: Vec<[u8; 4]> = used.iter().map(|v| colours[pick(v)]).collect();
            w.write_all(bytemuck::cast_slice(&colours))?;
        }
        w.write_all(bytemuck::cast_slice(indices))
    }

    pub(super) fn finish(self) -> Result<Spool, HlodError> {
        let Self { writer, path, bounds, attributes, triangles, area, .. } = self;
        let file = writer.into_inner().map_err(|e| HlodError::io(&path)(e.into_error()))?;
        Ok(Spool { file, path, bounds, attributes, triangles, area })
    }
}

impl Spool {
    /// Hands the input on, on the lattice, block by block.
    pub(super) fn read(
        &mut self,
        cube: &Cube,
        with_looks: bool,
        block: &mut dyn FnMut(Polygons) -> Result<(), HlodError>,
    ) -> Result<(), HlodError> {
        let io = |path: &PathBuf| HlodError::io(path.clone());
        self.file.seek(SeekFrom::Start(0)).map_err(io(&self.path))?;
        let mut reader = BufReader::with_capacity(1 << 20, &self.file);
        let mut left = self.triangles;
        while left > 0 {
            let mesh = read_block(&mut reader).map_err(io(&self.path))??;
            left = left.saturating_sub(mesh.triangles().len() as u64);
            let mut polygons = Polygons::default();
            let at: Vec<[i32; 3]> =
                mesh.positions().iter().map(|p| cube.enter(mesh.origin() + p.as_dvec3())).collect();
            for t in mesh.triangles() {
                let looks = with_looks.then(|| t.map(|v| Look::of_mesh(&mesh, v as usize)));
                polygons.push_triangle(t.map(|v| at[v as usize]), looks);
            }
            block(polygons)?;
        }
        Ok(())
    }
}

fn read_block(reader: &mut impl Read) -> std::io::Result<Result<TriangleMesh, HlodError>> {
    let mut origin = [0f64; 3];
    reader.read_exact(bytemuck::bytes_of_mut(&mut origin))?;
    let mut counts = [0u32; 3];
    reader.read_exact(bytemuck::bytes_of_mut(&mut counts))?;
    let [attributes, vertices, triangles] = counts;
    let mut positions = vec![Vec3::ZERO; vertices as usize];
    reader.read_exact(bytemuck::cast_slice_mut(&mut positions))?;
    let attributes = Attributes::from_bits(attributes as u8).unwrap_or_default();
    let (mut normals, mut uvs, mut colours) = (Vec::new(), Vec::new(), Vec::new());
    if attributes.normals {
        normals = vec![Vec3::ZERO; vertices as usize];
        reader.read_exact(bytemuck::cast_slice_mut(&mut normals))?;
    }
    if attributes.uvs {
        uvs = vec![Vec2::ZERO; vertices as usize];
        reader.read_exact(bytemuck::cast_slice_mut(&mut uvs))?;
    }
    if attributes.colours {
        colours = vec![[0u8; 4]; vertices as usize];
        reader.read_exact(bytemuck::cast_slice_mut(&mut colours))?;
    }
    let mut indices = vec![[0u32; 3]; triangles as usize];
    reader.read_exact(bytemuck::cast_slice_mut(&mut indices))?;
    let mesh = || -> Result<TriangleMesh, HlodError> {
        let mut mesh = TriangleMesh::new(positions, indices)?.with_origin(DVec3::from_array(origin))?;
        if attributes.normals {
            mesh = mesh.with_normals(normals)?;
        }
        if attributes.uvs {
            mesh = mesh.with_uvs(uvs)?;
        }
        if attributes.colours {
            mesh = mesh.with_colours(colours)?;
        }
        Ok(mesh)
    };
    Ok(mesh())
}
