//! From the lists of an OBJ to meshes with one index per vertex.

use super::{Channel, NONE, Parser, material};
use crate::io::{ImportError, Siblings};
use crate::mesh::TriangleMesh;
use crate::scene::{Instance, MaterialId, Scene};
use glam::{DAffine3, DVec3, Vec2, Vec3};
use std::collections::HashMap;

/// What all parts share.
struct Shared {
    origin: DVec3,
    positions: Vec<Vec3>,
    colours: Vec<[u8; 4]>,
    uvs: Vec<Vec2>,
    normals: Vec<Vec3>,
}

/// Corners of one part.
struct Corners {
    triangles: Vec<[u32; 3]>,
    uvs: Channel,
    normals: Channel,
}

pub(super) fn scene(
    mut parser: Parser,
    siblings: Siblings<'_>,
    warnings: &mut Vec<String>,
) -> Result<Scene, ImportError> {
    let mut scene = Scene::new();
    let materials = material::add_all(&mut scene, &parser, siblings, warnings)?;
    let shared = Shared {
        origin: parser.origin.unwrap_or_default(),
        positions: parser.positions.values,
        colours: parser.colours,
        uvs: parser.uvs.values,
        normals: parser.normals.values,
    };
    let mut corners =
        Corners { triangles: parser.triangles, uvs: parser.tri_uvs, normals: parser.tri_normals };
    let parts = std::mem::take(&mut parser.parts);
    let mut meshes = Vec::new();
    if parts.len() == 1 {
        meshes.push(whole(shared, corners).map_err(|error| named(&parts[0].0, error))?);
    } else {
        let starts = sort_by_part(&mut corners, &parser.runs, parts.len());
        let mut split = Splitter::new(shared);
        // From the end, so that what was converted can be given back.
        for (part, start) in starts.iter().enumerate().rev() {
            let tail = corners.split_off(*start);
            meshes.push(split.mesh(tail).map_err(|error| named(&parts[part].0, error))?);
        }
        meshes.reverse();
        let unused = split.unused();
        if unused > 0 {
            warnings.push(format!("{unused} vertices that no face uses left out"));
        }
    }
    for (mesh, (name, used)) in meshes.into_iter().zip(parts) {
        let mesh = scene.add_mesh(mesh);
        let material: Option<MaterialId> = used.and_then(|m| materials.get(m as usize).copied());
        scene.add_instance(Instance { name, mesh, world_from_mesh: DAffine3::IDENTITY, material })?;
    }
    Ok(scene)
}

fn named(part: &str, error: crate::mesh::MeshError) -> ImportError {
    ImportError::Mesh { part: part.to_owned(), error }
}

/// Brings the triangles of each part together, in order, and returns where each part starts.
fn sort_by_part(corners: &mut Corners, runs: &[(u32, u32)], parts: usize) -> Vec<usize> {
    let total = corners.triangles.len();
    let ends = runs.iter().skip(1).map(|r| r.0 as usize).chain([total]);
    let ranges: Vec<_> =
        runs.iter().zip(ends).map(|(&(start, part), end)| (part, start as usize..end)).collect();
    let mut starts = vec![0; parts];
    for (part, range) in &ranges {
        starts[*part as usize] += range.len();
    }
    let mut sum = 0;
    for start in &mut starts {
        (sum, *start) = (sum + *start, sum);
    }
    if ranges.is_sorted_by_key(|r| r.0) {
        return starts;
    }
    let mut order = ranges;
    order.sort_by_key(|r| r.0);
    let permute = |list: &mut Vec<[u32; 3]>| {
        let mut sorted = Vec::with_capacity(list.len());
        order.iter().for_each(|(_, range)| sorted.extend_from_slice(&list[range.clone()]));
        *list = sorted;
    };
    permute(&mut corners.triangles);
    for channel in [&mut corners.uvs, &mut corners.normals] {
        if let Channel::Own(list) = channel {
            permute(list);
        }
    }
    starts
}

impl Corners {
    fn split_off(&mut self, start: usize) -> Self {
        let tail = |channel: &mut Channel| match channel {
            Channel::Absent => Channel::Absent,
            Channel::Same => Channel::Same,
            Channel::Own(list) => Channel::Own(cut(list, start)),
        };
        Self {
            uvs: tail(&mut self.uvs),
            normals: tail(&mut self.normals),
            triangles: cut(&mut self.triangles, start),
        }
    }
}

/// Takes the tail of a list and gives memory back when half of it is free.
fn cut(list: &mut Vec<[u32; 3]>, start: usize) -> Vec<[u32; 3]> {
    let tail = list[start..].to_vec();
    list.truncate(start);
    if list.capacity() > 2 * list.len() + 4096 {
        list.shrink_to_fit();
    }
    tail
}

/// A file of one part: vertices keep their order and those that no face uses stay.
fn whole(shared: Shared, corners: Corners) -> Result<TriangleMesh, crate::mesh::MeshError> {
    let count = shared.positions.len();
    let Shared { origin, positions, colours, mut uvs, mut normals } = shared;
    let has_own = matches!(corners.uvs, Channel::Own(_)) || matches!(corners.normals, Channel::Own(_));
    if has_own {
        let sources: Vec<u32> = (0..count as u32).collect();
        let shared = Shared { origin, positions: vec![], colours: vec![], uvs, normals };
        return Attributes { shared: &shared, sources: &sources }.attach(positions, colours, corners);
    }
    let mut mesh = TriangleMesh::new(positions, corners.triangles)?.with_origin(origin)?;
    if matches!(corners.uvs, Channel::Same) {
        uvs.resize(count, Vec2::ZERO);
        mesh = mesh.with_uvs(uvs)?;
    }
    if matches!(corners.normals, Channel::Same) {
        normals.resize(count, Vec3::ZERO);
        mesh = mesh.with_normals(normals)?;
    }
    if colours.is_empty() { Ok(mesh) } else { mesh.with_colours(colours) }
}

/// Cuts meshes out of the shared lists, each with the vertices that it uses.
struct Splitter {
    shared: Shared,
    local_of: Vec<u32>,
    used: Vec<bool>,
}

impl Splitter {
    fn new(shared: Shared) -> Self {
        let count = shared.positions.len();
        Self { shared, local_of: vec![NONE; count], used: vec![false; count] }
    }

    fn unused(&self) -> usize {
        self.used.iter().filter(|u| !**u).count()
    }

    fn mesh(&mut self, mut corners: Corners) -> Result<TriangleMesh, crate::mesh::MeshError> {
        let mut sources = Vec::new();
        for index in corners.triangles.as_flattened_mut() {
            let local = &mut self.local_of[*index as usize];
            if *local == NONE {
                *local = sources.len() as u32;
                sources.push(*index);
                self.used[*index as usize] = true;
            }
            *index = *local;
        }
        sources.iter().for_each(|&s| self.local_of[s as usize] = NONE);
        let positions = sources.iter().map(|&s| self.shared.positions[s as usize]).collect();
        let colours = if self.shared.colours.is_empty() {
            vec![]
        } else {
            sources.iter().map(|&s| self.shared.colours[s as usize]).collect()
        };
        Attributes { shared: &self.shared, sources: &sources }.attach(positions, colours, corners)
    }
}

/// Gives vertices their normals and texture coordinates, splitting those whose corners disagree.
struct Attributes<'a> {
    shared: &'a Shared,
    /// Index in the file of every vertex.
    sources: &'a [u32],
}

/// Of a vertex that no corner has used yet.
const FRESH: u32 = u32::MAX - 1;

impl Attributes<'_> {
    fn attach(
        &self,
        mut positions: Vec<Vec3>,
        mut colours: Vec<[u8; 4]>,
        mut corners: Corners,
    ) -> Result<TriangleMesh, crate::mesh::MeshError> {
        let own = |channel: &mut Channel| match std::mem::take(channel) {
            Channel::Own(list) => (Some(list), false),
            Channel::Same => (None, true),
            Channel::Absent => (None, false),
        };
        let (own_uvs, same_uvs) = own(&mut corners.uvs);
        let (own_normals, same_normals) = own(&mut corners.normals);
        let keys = if own_uvs.is_some() || own_normals.is_some() {
            split(
                &mut corners.triangles,
                &mut positions,
                &mut colours,
                own_uvs.as_deref(),
                own_normals.as_deref(),
            )
        } else {
            Split::default()
        };
        let (has_own_uvs, has_own_normals) = (own_uvs.is_some(), own_normals.is_some());
        drop((own_uvs, own_normals));
        // Vertices that were split off come after the others and repeat the index of the one they left.
        let total = positions.len();
        let source = |vertex: usize| -> u32 {
            let first = if vertex < self.sources.len() {
                vertex
            } else {
                keys.parent[vertex - self.sources.len()] as usize
            };
            self.sources[first]
        };
        let uvs = if has_own_uvs {
            Some(gather(&self.shared.uvs, keys.uvs.iter().copied()))
        } else {
            same_uvs.then(|| gather(&self.shared.uvs, (0..total).map(source)))
        };
        let normals = if has_own_normals {
            Some(gather(&self.shared.normals, keys.normals.iter().copied()))
        } else {
            same_normals.then(|| gather(&self.shared.normals, (0..total).map(source)))
        };
        let mut mesh = TriangleMesh::new(positions, corners.triangles)?.with_origin(self.shared.origin)?;
        if let Some(uvs) = uvs {
            mesh = mesh.with_uvs(uvs)?;
        }
        if let Some(normals) = normals {
            mesh = mesh.with_normals(normals)?;
        }
        if colours.is_empty() { Ok(mesh) } else { mesh.with_colours(colours) }
    }
}

/// Values by index; zero for the vertices without one.
fn gather<T: Copy + Default>(pool: &[T], indices: impl Iterator<Item = u32>) -> Vec<T> {
    indices.map(|i| pool.get(i as usize).copied().unwrap_or_default()).collect()
}

/// Attribute indices per vertex, and the vertex that each added one was split from.
#[derive(Default)]
struct Split {
    uvs: Vec<u32>,
    normals: Vec<u32>,
    parent: Vec<u32>,
}

fn split(
    triangles: &mut [[u32; 3]],
    positions: &mut Vec<Vec3>,
    colours: &mut Vec<[u8; 4]>,
    uvs: Option<&[[u32; 3]]>,
    normals: Option<&[[u32; 3]]>,
) -> Split {
    let first = |list: Option<&[[u32; 3]]>| list.map_or(vec![], |_| vec![FRESH; positions.len()]);
    let mut out = Split { uvs: first(uvs), normals: first(normals), parent: vec![] };
    // Only what does not fit a vertex's first use is looked up, so that smooth meshes stay out of the map.
    let mut extra: HashMap<[u32; 3], u32> = HashMap::new();
    for (t, triangle) in triangles.iter_mut().enumerate() {
        for (corner, index) in triangle.iter_mut().enumerate() {
            let vertex = *index as usize;
            let vt = uvs.map_or(NONE, |list| list[t][corner]);
            let vn = normals.map_or(NONE, |list| list[t][corner]);
            let vt_now = out.uvs.get(vertex).copied().unwrap_or(NONE);
            let vn_now = out.normals.get(vertex).copied().unwrap_or(NONE);
            if (vt_now, vn_now) == (vt, vn) {
                continue;
            }
            if vt_now == FRESH || vn_now == FRESH {
                if uvs.is_some() {
                    out.uvs[vertex] = vt;
                }
                if normals.is_some() {
                    out.normals[vertex] = vn;
                }
                continue;
            }
            let next = positions.len() as u32;
            *index = *extra.entry([*index, vt, vn]).or_insert(next);
            if *index == next {
                positions.push(positions[vertex]);
                if !colours.is_empty() {
                    colours.push(colours[vertex]);
                }
                if uvs.is_some() {
                    out.uvs.push(vt);
                }
                if normals.is_some() {
                    out.normals.push(vn);
                }
                out.parent.push(vertex as u32);
            }
        }
    }
    out
}
