//! PLY: ASCII and binary of both byte orders, meshes and point lists.
//!
//! Polygons are cut into fans, triangle strips into triangles. A file without faces is a point cloud. A header line
//! `comment origin x y z` gives the world position that all coordinates are relative to.

mod header;

use super::{Content, FAR, ImportError, Loaded};
use crate::mesh::TriangleMesh;
use crate::points::PointCloud;
use crate::scene::Scene;
use glam::{DVec3, Vec2, Vec3};
use header::{Element, Encoding, Header, Kind, Scalar};
use std::path::Path;

/// Loads a .ply file.
///
/// # Errors
/// [`ImportError`].
pub fn load(path: &Path) -> Result<Loaded, ImportError> {
    from_bytes(&super::read_file(path)?)
}

/// Reads a PLY.
///
/// # Accuracy
/// `float` coordinates are taken as they are. Wider ones are rounded to `f32` once, relative to the header's origin,
/// or else to the first vertex where that is beyond ±65,536.
///
/// # Cost
/// O(bytes); nothing is allocated but the result.
///
/// # Errors
/// [`ImportError`] naming the header line, element or byte.
pub fn from_bytes(bytes: &[u8]) -> Result<Loaded, ImportError> {
    let (header, body) = header::parse(bytes)?;
    let mut input = Input { rest: body, total: bytes.len(), encoding: header.encoding };
    let mut vertices = Vertices::default();
    let mut triangles = Vec::new();
    let mut has_faces = false;
    let mut warnings = Vec::new();
    for element in &header.elements {
        input.check_count(element)?;
        match element.name.as_str() {
            "vertex" if vertices.count == 0 => vertices = Vertices::read(element, &header, &mut input)?,
            "face" => {
                has_faces |= element.count > 0;
                read_faces(element, &mut input, &mut triangles, &mut warnings)?;
            }
            "tristrips" => {
                has_faces |= element.count > 0;
                read_strips(element, &mut input, &mut triangles)?;
            }
            _ => skip(element, &mut input)?,
        }
    }
    let stored_vertices = vertices.count as u64;
    let content = if has_faces {
        Content::Scene(vertices.scene(triangles)?)
    } else {
        Content::Points(vertices.points()?)
    };
    Ok(Loaded { content, stored_vertices, warnings })
}

/// The bytes that are left.
struct Input<'a> {
    rest: &'a [u8],
    total: usize,
    encoding: Encoding,
}

impl Input<'_> {
    fn here(&self) -> String {
        format!("byte {}", self.total - self.rest.len())
    }

    /// Refuses counts that the bytes left cannot hold, before anything is allocated for them.
    fn check_count(&self, element: &Element) -> Result<(), ImportError> {
        let least: u64 = match self.encoding {
            // A digit and a blank; the last blank may be missing.
            Encoding::Ascii => 2 * element.properties.len() as u64,
            _ => element.properties.iter().map(|p| p.least_bytes()).sum(),
        };
        let room = self.rest.len() as u64 + u64::from(self.encoding == Encoding::Ascii);
        if element.count.checked_mul(least.max(1)).is_none_or(|needed| needed > room) {
            let problem =
                format!("{} '{}' elements do not fit in the {room} bytes left", element.count, element.name);
            return Err(ImportError::syntax(self.here(), problem));
        }
        Ok(())
    }

    fn scalar(&mut self, kind: Scalar) -> Result<f64, ImportError> {
        if self.encoding == Encoding::Ascii {
            return self.word(kind);
        }
        let size = kind.bytes();
        let Some((bytes, rest)) = self.rest.split_at_checked(size) else {
            return Err(ImportError::syntax(self.here(), "the file ends in the middle of an element"));
        };
        self.rest = rest;
        Ok(kind.decode(bytes, self.encoding == Encoding::BigEndian))
    }

    fn word(&mut self, kind: Scalar) -> Result<f64, ImportError> {
        let text = self.rest.trim_ascii_start();
        let end = text.iter().position(u8::is_ascii_whitespace).unwrap_or(text.len());
        let (word, rest) = text.split_at(end);
        if word.is_empty() {
            return Err(ImportError::syntax(self.here(), "the file ends in the middle of an element"));
        }
        let parsed = std::str::from_utf8(word).ok().and_then(|word| match kind {
            // Parsed as what it is, so that it is rounded once.
            Scalar::F32 => word.parse::<f32>().ok().map(f64::from),
            _ => word.parse::<f64>().ok(),
        });
        let Some(value) = parsed else {
            let shown = String::from_utf8_lossy(&word[..word.len().min(40)]).into_owned();
            return Err(ImportError::syntax(self.here(), format!("'{shown}' is not a number")));
        };
        self.rest = rest;
        Ok(value)
    }

    /// The length of a list; the values are still to be read.
    fn list_length(&mut self, count: Scalar, item: Scalar) -> Result<usize, ImportError> {
        let place = self.here();
        let length = self.scalar(count)?;
        let least = if self.encoding == Encoding::Ascii { 1 } else { item.bytes() };
        // Any length that passes is at most the number of bytes, so the conversion is exact.
        if !(length >= 0.0 && length.fract() == 0.0 && length * least as f64 <= self.rest.len() as f64) {
            return Err(ImportError::syntax(place, format!("a list of {length} values")));
        }
        Ok(length as usize)
    }
}

fn skip(element: &Element, input: &mut Input<'_>) -> Result<(), ImportError> {
    for _ in 0..element.count {
        for property in &element.properties {
            match property.kind {
                Kind::Scalar(kind) => {
                    input.scalar(kind)?;
                }
                Kind::List { count, item } => {
                    for _ in 0..input.list_length(count, item)? {
                        input.scalar(item)?;
                    }
                }
            }
        }
    }
    Ok(())
}

/// Reads the vertex lists of an element, each with its number; everything else in it is skipped.
fn each_list(
    element: &Element,
    input: &mut Input<'_>,
    mut use_list: impl FnMut(u64, &[i64]) -> Result<(), ImportError>,
) -> Result<(), ImportError> {
    let mut list = Vec::new();
    for number in 0..element.count {
        for property in &element.properties {
            match property.kind {
                Kind::Scalar(kind) => {
                    input.scalar(kind)?;
                }
                Kind::List { count, item } => {
                    let wanted = matches!(property.name.as_str(), "vertex_indices" | "vertex_index");
                    list.clear();
                    for _ in 0..input.list_length(count, item)? {
                        let value = input.scalar(item)?;
                        if wanted {
                            // −1 ends a strip; other negative or broken numbers never pass as an index.
                            let whole = value.fract() == 0.0 && (-1.0..=f64::from(u32::MAX)).contains(&value);
                            let bad = || {
                                let place = format!("{} {number}", element.name);
                                ImportError::syntax(place, format!("{value} is not a vertex index"))
                            };
                            list.push(if whole { value as i64 } else { return Err(bad()) });
                        }
                    }
                    if wanted {
                        use_list(number, &list)?;
                    }
                }
            }
        }
    }
    Ok(())
}

/// An index in the list of a face.
fn index(value: i64, face: u64) -> Result<u32, ImportError> {
    let bad = || ImportError::syntax(format!("face {face}"), format!("{value} is not a vertex index"));
    u32::try_from(value).map_err(|_| bad())
}

fn read_faces(
    element: &Element,
    input: &mut Input<'_>,
    triangles: &mut Vec<[u32; 3]>,
    warnings: &mut Vec<String>,
) -> Result<(), ImportError> {
    let mut short = 0;
    each_list(element, input, |face, list| {
        if list.len() < 3 {
            short += 1;
            return Ok(());
        }
        for pair in list[1..].windows(2) {
            triangles.push([index(list[0], face)?, index(pair[0], face)?, index(pair[1], face)?]);
        }
        Ok(())
    })?;
    if short > 0 {
        warnings.push(format!("{short} faces with fewer than three corners left out"));
    }
    Ok(())
}

fn read_strips(
    element: &Element,
    input: &mut Input<'_>,
    triangles: &mut Vec<[u32; 3]>,
) -> Result<(), ImportError> {
    each_list(element, input, |number, list| {
        for strip in list.split(|&i| i == -1) {
            for (i, t) in strip.windows(3).enumerate() {
                let [a, b, c] = [index(t[0], number)?, index(t[1], number)?, index(t[2], number)?];
                triangles.push(if i % 2 == 0 { [a, b, c] } else { [b, a, c] });
            }
        }
        Ok(())
    })
}

/// What is kept of the vertices.
#[derive(Default)]
struct Vertices {
    count: usize,
    origin: DVec3,
    positions: Vec<Vec3>,
    normals: Option<Vec<Vec3>>,
    uvs: Option<Vec<Vec2>>,
    colours: Option<Vec<[u8; 4]>>,
}

/// Columns of the values that are used.
struct Columns {
    position: [usize; 3],
    normal: Option<[usize; 3]>,
    uv: Option<[usize; 2]>,
    colour: Option<[usize; 3]>,
    alpha: Option<usize>,
}

impl Columns {
    fn of(element: &Element) -> Result<Self, ImportError> {
        let find = |name: &str| element.properties.iter().position(|p| p.name == name && p.is_scalar());
        let all = |names: [&str; 3]| -> Option<[usize; 3]> {
            let [a, b, c] = names.map(find);
            Some([a?, b?, c?])
        };
        let position = all(["x", "y", "z"]);
        let position =
            position.ok_or_else(|| ImportError::syntax("header", "vertices without x, y and z"))?;
        let pair = |[u, v]: [&str; 2]| find(u).zip(find(v)).map(|(u, v)| [u, v]);
        Ok(Self {
            position,
            normal: all(["nx", "ny", "nz"]),
            uv: [["s", "t"], ["u", "v"], ["texture_u", "texture_v"]].into_iter().find_map(pair),
            colour: all(["red", "green", "blue"])
                .or_else(|| all(["diffuse_red", "diffuse_green", "diffuse_blue"])),
            alpha: find("alpha"),
        })
    }
}

impl Vertices {
    fn read(element: &Element, header: &Header, input: &mut Input<'_>) -> Result<Self, ImportError> {
        let columns = Columns::of(element)?;
        let count = element.count as usize;
        let kind = |column: usize| element.properties[column].scalar();
        let wide = columns.position.iter().any(|&c| kind(c) != Some(Scalar::F32));
        let mut out = Self {
            count,
            origin: header.origin.unwrap_or_default(),
            positions: Vec::with_capacity(count),
            normals: columns.normal.map(|_| Vec::with_capacity(count)),
            uvs: columns.uv.map(|_| Vec::with_capacity(count)),
            colours: columns.colour.map(|_| Vec::with_capacity(count)),
        };
        let mut row = vec![0.0; element.properties.len()];
        let mut shift = DVec3::ZERO;
        for number in 0..count {
            read_row(element, input, &mut row)?;
            let p = DVec3::from_array(columns.position.map(|c| row[c]));
            if number == 0 && wide && header.origin.is_none() && FAR.contains(&p.abs().max_element()) {
                shift = p.round();
                out.origin = shift;
            }
            out.positions.push((p - shift).as_vec3());
            if let (Some(list), Some(c)) = (&mut out.normals, columns.normal) {
                list.push(DVec3::from_array(c.map(|c| row[c])).as_vec3());
            }
            if let (Some(list), Some([u, v])) = (&mut out.uvs, columns.uv) {
                list.push(Vec2::new(row[u] as f32, 1.0 - row[v] as f32));
            }
            if let (Some(list), Some(c)) = (&mut out.colours, columns.colour) {
                let channel = |c: usize| kind(c).map_or(0, |kind| kind.to_byte(row[c]));
                list.push([channel(c[0]), channel(c[1]), channel(c[2]), columns.alpha.map_or(255, channel)]);
            }
        }
        Ok(out)
    }

    fn scene(self, triangles: Vec<[u32; 3]>) -> Result<Scene, ImportError> {
        let mesh = || -> Result<TriangleMesh, crate::mesh::MeshError> {
            let mut mesh = TriangleMesh::new(self.positions, triangles)?.with_origin(self.origin)?;
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
        };
        Ok(Scene::of_mesh(mesh().map_err(|error| ImportError::Mesh { part: "mesh".into(), error })?))
    }

    fn points(self) -> Result<PointCloud, ImportError> {
        let cloud = PointCloud::new(self.origin, self.positions)?;
        match self.colours {
            None => Ok(cloud),
            Some(colours) => {
                Ok(cloud.with_colours(colours.into_iter().map(|[r, g, b, _]| [r, g, b]).collect())?)
            }
        }
    }
}

fn read_row(element: &Element, input: &mut Input<'_>, row: &mut [f64]) -> Result<(), ImportError> {
    for (property, value) in element.properties.iter().zip(row) {
        match property.kind {
            Kind::Scalar(kind) => *value = input.scalar(kind)?,
            Kind::List { count, item } => {
                for _ in 0..input.list_length(count, item)? {
                    input.scalar(item)?;
                }
            }
        }
    }
    Ok(())
}
