//! Primitives to meshes.

use super::Reader;
use crate::io::{ImportError, short_name};
use crate::mesh::{MeshError, TriangleMesh};
use ::gltf::json::mesh::{Mode, Primitive, Semantic};
use ::gltf::json::validation::Checked;
use glam::{Vec2, Vec3};
use std::collections::HashMap;

fn attribute(primitive: &Primitive, semantic: Semantic) -> Option<usize> {
    primitive.attributes.get(&Checked::Valid(semantic)).map(|index| index.value())
}

/// How many primitives use each accessor as positions.
pub(super) fn position_users(root: &::gltf::json::Root) -> HashMap<usize, u32> {
    let mut users = HashMap::new();
    for primitive in root.meshes.iter().flat_map(|mesh| &mesh.primitives) {
        if let Some(index) = attribute(primitive, Semantic::Positions) {
            *users.entry(index).or_insert(0) += 1;
        }
    }
    users
}

impl Reader<'_> {
    /// The mesh of a primitive; `None`, with a warning, when it has no triangles.
    pub(super) fn primitive(
        &mut self,
        name: &str,
        primitive: &Primitive,
        users: &HashMap<usize, u32>,
    ) -> Result<Option<TriangleMesh>, ImportError> {
        let mode = match primitive.mode {
            Checked::Valid(mode @ (Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)) => mode,
            _ => {
                self.warnings.push(format!("mesh '{}': points and lines are left out", short_name(name)));
                return Ok(None);
            }
        };
        let Some(positions) = attribute(primitive, Semantic::Positions) else {
            self.warnings
                .push(format!("mesh '{}': a primitive without positions is left out", short_name(name)));
            return Ok(None);
        };
        let mut vertices = Vertices {
            positions: self.vectors::<3, Vec3>(positions, Vec3::from)?,
            normals: match attribute(primitive, Semantic::Normals) {
                Some(index) => Some(self.vectors::<3, Vec3>(index, Vec3::from)?),
                None => None,
            },
            uvs: match attribute(primitive, Semantic::TexCoords(self.uv_set(primitive))) {
                Some(index) => Some(self.vectors::<2, Vec2>(index, Vec2::from)?),
                None => None,
            },
            colours: self.colours(primitive)?,
        };
        self.stored_vertices += vertices.positions.len() as u64;
        let mut triangles = self.triangles(primitive, mode, vertices.positions.len())?;
        let shared = users.get(&positions).is_some_and(|&users| users > 1);
        if shared && primitive.indices.is_some() {
            vertices.keep_used(&mut triangles);
        }
        let mesh = vertices.mesh(triangles);
        mesh.map(Some).map_err(|error| ImportError::Mesh { part: short_name(name), error })
    }

    /// The set of texture coordinates that the base colour uses.
    fn uv_set(&self, primitive: &Primitive) -> u32 {
        let material = primitive.material.and_then(|m| self.root.materials.get(m.value()));
        let texture = material.and_then(|m| m.pbr_metallic_roughness.base_color_texture.as_ref());
        texture.map_or(0, |t| t.tex_coord)
    }

    fn colours(&mut self, primitive: &Primitive) -> Result<Option<Vec<[u8; 4]>>, ImportError> {
        let Some(index) = attribute(primitive, Semantic::Colors(0)) else { return Ok(None) };
        if self.arity(index)? == 4 {
            let colour = |[r, g, b, a]: [f32; 4]| [srgb(r), srgb(g), srgb(b), byte(a)];
            self.vectors::<4, _>(index, colour).map(Some)
        } else {
            self.vectors::<3, _>(index, |[r, g, b]| [srgb(r), srgb(g), srgb(b), 255]).map(Some)
        }
    }

    fn triangles(
        &mut self,
        primitive: &Primitive,
        mode: Mode,
        vertices: usize,
    ) -> Result<Vec<[u32; 3]>, ImportError> {
        let list = match primitive.indices {
            Some(index) => self.indices(index.value())?,
            None => {
                self.budget.take(vertices as u64 * 4)?;
                (0..vertices as u32).collect()
            }
        };
        match mode {
            Mode::TriangleStrip => {
                self.budget.take(list.len() as u64 * 12)?;
                let flip = |(i, t): (usize, &[u32])| {
                    if i % 2 == 0 { [t[0], t[1], t[2]] } else { [t[1], t[0], t[2]] }
                };
                Ok(list.windows(3).enumerate().map(flip).collect())
            }
            Mode::TriangleFan => {
                self.budget.take(list.len() as u64 * 12)?;
                let Some((&centre, rim)) = list.split_first() else { return Ok(vec![]) };
                Ok(rim.windows(2).map(|t| [centre, t[0], t[1]]).collect())
            }
            _ => {
                let count = list.len();
                if count % 3 != 0 {
                    let error = MeshError::IndexCount { count };
                    return Err(ImportError::Mesh { part: "primitive".into(), error });
                }
                // The same allocation, seen as triples.
                bytemuck::allocation::try_cast_vec(list)
                    .or_else(|(_, list): (_, Vec<u32>)| Ok(list.as_chunks::<3>().0.to_vec()))
            }
        }
    }
}

struct Vertices {
    positions: Vec<Vec3>,
    normals: Option<Vec<Vec3>>,
    uvs: Option<Vec<Vec2>>,
    colours: Option<Vec<[u8; 4]>>,
}

impl Vertices {
    /// Drops the vertices that `triangles` do not use: the list serves other primitives too.
    fn keep_used(&mut self, triangles: &mut [[u32; 3]]) {
        const UNUSED: u32 = u32::MAX;
        let mut new = vec![UNUSED; self.positions.len()];
        for &index in triangles.as_flattened() {
            if let Some(slot) = new.get_mut(index as usize) {
                *slot = 0;
            }
        }
        for (kept, slot) in new.iter_mut().filter(|slot| **slot != UNUSED).enumerate() {
            *slot = kept as u32;
        }
        // An index out of range stays so, and the mesh is refused.
        for index in triangles.as_flattened_mut() {
            *index = new.get(*index as usize).copied().unwrap_or(UNUSED);
        }
        fn keep<T>(list: &mut Vec<T>, new: &[u32]) {
            let mut flags = new.iter().map(|&n| n != UNUSED);
            list.retain(|_| flags.next().unwrap_or(false));
            list.shrink_to_fit();
        }
        keep(&mut self.positions, &new);
        self.normals.as_mut().into_iter().for_each(|list| keep(list, &new));
        self.uvs.as_mut().into_iter().for_each(|list| keep(list, &new));
        self.colours.as_mut().into_iter().for_each(|list| keep(list, &new));
    }

    fn mesh(self, triangles: Vec<[u32; 3]>) -> Result<TriangleMesh, MeshError> {
        let mut mesh = TriangleMesh::new(self.positions, triangles)?;
        if let Some(normals) = self.normals {
            mesh = mesh.with_normals(normals)?;
        }
        if let Some(uvs) = self.uvs {
            mesh = mesh.with_uvs(uvs)?;
        }
        if let Some(colours) = self.colours {
            mesh = mesh.with_colours(colours)?;
        }
        Ok(mesh)
    }
}

fn byte(unit: f32) -> u8 {
    (unit.clamp(0.0, 1.0) * 255.0).round() as u8
}

/// A linear channel, sRGB-encoded.
fn srgb(linear: f32) -> u8 {
    let encoded = if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
    byte(encoded)
}
