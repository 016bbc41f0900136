//! Wavefront OBJ.
//!
//! Geometry is read by our own parser, in one pass and without holding the text; material libraries go through the
//! `tobj` crate. `tobj` alone does not fit large or damaged files: it drops vertices that no face uses, needs about
//! a hundred bytes a face while it runs, mislays attributes that only some corners have, and panics on short
//! material lines.
//!
//! Faces of any size are cut into fans. Groups, objects and materials become meshes with an instance each. Corners of
//! one vertex with different normals or texture coordinates become vertices of their own, after those of the file.

mod build;
mod material;

use super::{Content, FAR, ImportError, Loaded, Siblings, short_name};
use crate::points::PointCloud;
use glam::{DVec3, Vec2, Vec3};
use std::collections::HashMap;
use std::io::{BufRead, BufReader};
use std::path::Path;

/// Most groups with faces, counted by name and material.
const MAX_PARTS: usize = 1 << 18;
/// "No index" in corner lists.
const NONE: u32 = u32::MAX;

/// Loads an .obj file; material libraries and pictures are looked for beside it.
///
/// # Errors
/// [`ImportError`]; missing libraries and pictures are only warnings.
pub fn load(path: &Path) -> Result<Loaded, ImportError> {
    let reader = BufReader::with_capacity(1 << 18, super::open(path)?);
    read(reader, &|name| super::read_sibling(path, name))
}

/// Reads an OBJ without material libraries.
///
/// # Errors
/// [`ImportError`] naming the line.
pub fn from_bytes(bytes: &[u8]) -> Result<Loaded, ImportError> {
    read(bytes, &super::no_siblings)
}

/// Reads an OBJ; `siblings` finds the libraries and pictures that it names.
///
/// # Accuracy
/// Coordinates are rounded to `f32` once; where the first vertex is beyond ±65,536 they are kept relative to it.
///
/// # Cost
/// O(bytes). Peak memory is at most about 2.5 times the result's; the text is not kept.
///
/// # Errors
/// [`ImportError`] naming the line.
pub fn read(reader: impl BufRead, siblings: Siblings<'_>) -> Result<Loaded, ImportError> {
    let mut parser = Parser::default();
    parser.lines(reader)?;
    parser.finish(siblings)
}

/// Corner indices of one kind (vt or vn), three for each triangle.
#[derive(Default)]
enum Channel {
    /// No corner has one.
    #[default]
    Absent,
    /// Every corner's is that of its position: nothing has to be stored.
    Same,
    /// One per corner, `NONE` where there is none.
    Own(Vec<[u32; 3]>),
}

impl Channel {
    fn push(&mut self, corners: [u32; 3], positions: &[[u32; 3]]) {
        // `positions` does not hold this triangle yet.
        let before = positions.len();
        match self {
            Channel::Absent if corners == [NONE; 3] => {}
            Channel::Own(list) => list.push(corners),
            _ => {
                let mut list = match self {
                    Channel::Same => positions.to_vec(),
                    _ => vec![[NONE; 3]; before],
                };
                list.push(corners);
                *self = Channel::Own(list);
            }
        }
    }

    fn push_triangle(&mut self, corners: [u32; 3], triangle: [u32; 3], positions: &[[u32; 3]]) {
        match self {
            Channel::Same if corners == triangle => {}
            Channel::Absent if positions.is_empty() && corners == triangle => *self = Channel::Same,
            _ => self.push(corners, positions),
        }
    }
}

/// Values of one kind and the largest index that asked for one.
struct Pool<T> {
    values: Vec<T>,
    /// Zero-based index and line.
    largest: Option<(u32, u64)>,
}

impl<T> Default for Pool<T> {
    fn default() -> Self {
        Self { values: Vec::new(), largest: None }
    }
}

impl<T> Pool<T> {
    /// Turns a file's index (from 1, or negative from the end) into one from 0.
    fn index(&mut self, text: &[u8], line: u64, what: &str) -> Result<u32, ImportError> {
        let bad = |problem: String| ImportError::syntax(format!("line {line}"), problem);
        let index = parse_index(text).ok_or_else(|| bad(format!("'{}' is not an index", show(text))))?;
        let resolved = match index {
            0 => return Err(bad(format!("{what} index 0; indices begin at 1"))),
            1.. => index - 1,
            _ => self.values.len() as i64 + index,
        };
        let index = u32::try_from(resolved).ok().filter(|&i| i < NONE);
        let index = index.ok_or_else(|| bad(format!("{what} index {} leads nowhere", show(text))))?;
        if self.largest.is_none_or(|(largest, _)| index > largest) {
            self.largest = Some((index, line));
        }
        Ok(index)
    }

    fn check(&self, what: &str) -> Result<(), ImportError> {
        match self.largest {
            Some((index, line)) if index as usize >= self.values.len() => Err(ImportError::syntax(
                format!("line {line}"),
                format!("{what} index {}, but there are {}", u64::from(index) + 1, self.values.len()),
            )),
            _ => Ok(()),
        }
    }
}

#[derive(Default)]
struct Parser {
    line: u64,
    /// Set by the first vertex; not zero only far from the world's origin.
    origin: Option<DVec3>,
    positions: Pool<Vec3>,
    colours: Vec<[u8; 4]>,
    uvs: Pool<Vec2>,
    normals: Pool<Vec3>,
    triangles: Vec<[u32; 3]>,
    tri_uvs: Channel,
    tri_normals: Channel,
    /// Corners of the face being read.
    face: Vec<[u32; 3]>,
    group: String,
    material: Option<u32>,
    /// Name and material of every part, and its number.
    parts: Vec<(String, Option<u32>)>,
    part_of: HashMap<(String, Option<u32>), u32>,
    /// First triangle and part of every run of faces.
    runs: Vec<(u32, u32)>,
    run_open: bool,
    material_names: Vec<String>,
    material_of: HashMap<String, u32>,
    libraries: Vec<String>,
    skipped_lines_and_points: u64,
    skipped_faces: u64,
}

impl Parser {
    fn lines(&mut self, mut reader: impl BufRead) -> Result<(), ImportError> {
        let mut line = Vec::new();
        loop {
            line.clear();
            if reader.read_until(b'\n', &mut line)? == 0 {
                return Ok(());
            }
            self.line += 1;
            // A backslash at the end of a line joins it with the next.
            while let Some(end) = line.trim_ascii_end().strip_suffix(b"\\").map(<[u8]>::len) {
                line.truncate(end);
                line.push(b' ');
                if reader.read_until(b'\n', &mut line)? == 0 {
                    break;
                }
                self.line += 1;
            }
            self.one_line(line.trim_ascii())?;
        }
    }

    fn one_line(&mut self, line: &[u8]) -> Result<(), ImportError> {
        let mut words = Words(line);
        match words.next() {
            Some(b"v") => self.vertex(words),
            Some(b"f") => self.read_face(words),
            Some(b"vt") => {
                let u = self.number(words.next())?;
                let v = words.next().map_or(Ok(0.0), |w| self.number(Some(w)))?;
                self.uvs.values.push(Vec2::new(u, 1.0 - v));
                self.limit_pool(self.uvs.values.len(), "texture coordinates")
            }
            Some(b"vn") => {
                let n = [self.number(words.next())?, self.number(words.next())?, self.number(words.next())?];
                self.normals.values.push(n.into());
                self.limit_pool(self.normals.values.len(), "normals")
            }
            Some(b"o" | b"g") => {
                self.group = short_name(&String::from_utf8_lossy(words.0.trim_ascii()));
                self.run_open = false;
                Ok(())
            }
            Some(b"usemtl") => {
                self.use_material(short_name(&String::from_utf8_lossy(words.0.trim_ascii())));
                Ok(())
            }
            Some(b"mtllib") => {
                let name = String::from_utf8_lossy(words.0.trim_ascii()).into_owned();
                if !self.libraries.contains(&name) && self.libraries.len() < 64 {
                    self.libraries.push(name);
                }
                Ok(())
            }
            Some(b"l" | b"p") => {
                self.skipped_lines_and_points += 1;
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn limit_pool(&self, count: usize, what: &'static str) -> Result<(), ImportError> {
        if count as u64 >= u64::from(NONE) {
            return Err(ImportError::Limit { what, count: count as u64, limit: u64::from(NONE) - 1 });
        }
        Ok(())
    }

    fn use_material(&mut self, name: String) {
        let next = self.material_names.len() as u32;
        let id = *self.material_of.entry(name.clone()).or_insert(next);
        if id == next {
            self.material_names.push(name);
        }
        self.material = Some(id);
        self.run_open = false;
    }

    fn number(&self, word: Option<&[u8]>) -> Result<f32, ImportError> {
        self.number_as::<f32>(word)
    }

    /// A finite number.
    fn number_as<T: std::str::FromStr + Into<f64> + Copy>(
        &self,
        word: Option<&[u8]>,
    ) -> Result<T, ImportError> {
        let Some(word) = word else {
            return Err(ImportError::syntax(format!("line {}", self.line), "a number is missing"));
        };
        match std::str::from_utf8(word).ok().and_then(|text| text.parse::<T>().ok()) {
            Some(value) if value.into().is_finite() => Ok(value),
            _ => {
                let problem = format!("'{}' is not a finite number", show(word));
                Err(ImportError::syntax(format!("line {}", self.line), problem))
            }
        }
    }

    /// Three numbers in full precision.
    fn point(&self, text: &[Option<&[u8]>; 3]) -> Result<DVec3, ImportError> {
        let wide = |i: usize| self.number_as::<f64>(text[i]);
        Ok(DVec3::new(wide(0)?, wide(1)?, wide(2)?))
    }

    fn vertex(&mut self, mut words: Words<'_>) -> Result<(), ImportError> {
        let text = [words.next(), words.next(), words.next()];
        let origin = match self.origin {
            Some(origin) => origin,
            None => {
                let first = self.point(&text)?;
                let origin =
                    if FAR.contains(&first.abs().max_element()) { first.round() } else { DVec3::ZERO };
                *self.origin.insert(origin)
            }
        };
        let position = if origin == DVec3::ZERO {
            Vec3::new(self.number(text[0])?, self.number(text[1])?, self.number(text[2])?)
        } else {
            (self.point(&text)? - origin).as_vec3()
        };
        // x y z, x y z w, x y z r g b or x y z w r g b.
        let mut rest = [0.0; 4];
        let mut count = 0;
        for word in words.take(4) {
            rest[count] = self.number(Some(word))?;
            count += 1;
        }
        if count >= 3 {
            let white = [255; 4];
            self.colours.resize(self.positions.values.len(), white);
            let channel = |c: f32| (c.clamp(0.0, 1.0) * 255.0).round() as u8;
            let rgb = &rest[count - 3..count];
            self.colours.push([channel(rgb[0]), channel(rgb[1]), channel(rgb[2]), 255]);
        }
        self.positions.values.push(position);
        self.limit_pool(self.positions.values.len(), "vertices")
    }

    fn read_face(&mut self, words: Words<'_>) -> Result<(), ImportError> {
        self.face.clear();
        for word in words {
            let corner = self.corner(word)?;
            self.face.push(corner);
        }
        if self.face.len() < 3 {
            self.skipped_faces += 1;
            return Ok(());
        }
        if !self.run_open {
            self.open_run()?;
        }
        self.limit_pool(self.triangles.len() + self.face.len(), "triangles")?;
        for i in 2..self.face.len() {
            let fan = [self.face[0], self.face[i - 1], self.face[i]];
            let [v, vt, vn] = [0, 1, 2].map(|channel| fan.map(|corner| corner[channel]));
            self.tri_uvs.push_triangle(vt, v, &self.triangles);
            self.tri_normals.push_triangle(vn, v, &self.triangles);
            self.triangles.push(v);
        }
        Ok(())
    }

    /// v, v/vt, v//vn or v/vt/vn.
    fn corner(&mut self, word: &[u8]) -> Result<[u32; 3], ImportError> {
        let line = self.line;
        let mut fields = word.split(|&b| b == b'/');
        let v = self.positions.index(fields.next().unwrap_or_default(), line, "vertex")?;
        let vt = match fields.next() {
            None | Some(b"") => NONE,
            Some(text) => self.uvs.index(text, line, "texture coordinate")?,
        };
        let vn = match fields.next() {
            None | Some(b"") => NONE,
            Some(text) => self.normals.index(text, line, "normal")?,
        };
        Ok([v, vt, vn])
    }

    fn open_run(&mut self) -> Result<(), ImportError> {
        let next = self.parts.len() as u32;
        let key = (self.group.clone(), self.material);
        let part = *self.part_of.entry(key.clone()).or_insert(next);
        if part == next {
            if self.parts.len() == MAX_PARTS {
                let count = MAX_PARTS as u64 + 1;
                return Err(ImportError::Limit { what: "groups with faces", count, limit: MAX_PARTS as u64 });
            }
            self.parts.push(key);
        }
        self.runs.push((self.triangles.len() as u32, part));
        self.run_open = true;
        Ok(())
    }

    fn finish(mut self, siblings: Siblings<'_>) -> Result<Loaded, ImportError> {
        self.positions.check("vertex")?;
        self.uvs.check("texture coordinate")?;
        self.normals.check("normal")?;
        let stored_vertices = self.positions.values.len() as u64;
        let mut warnings = Vec::new();
        for (count, what) in [
            (self.skipped_lines_and_points, "line and point elements left out"),
            (self.skipped_faces, "faces with fewer than three corners left out"),
        ] {
            if count > 0 {
                warnings.push(format!("{count} {what}"));
            }
        }
        if !self.colours.is_empty() {
            self.colours.resize(self.positions.values.len(), [255; 4]);
        }
        let content = if self.triangles.is_empty() && stored_vertices > 0 {
            Content::Points(self.into_points()?)
        } else {
            Content::Scene(build::scene(self, siblings, &mut warnings)?)
        };
        Ok(Loaded { content, stored_vertices, warnings })
    }

    fn into_points(self) -> Result<PointCloud, ImportError> {
        let cloud = PointCloud::new(self.origin.unwrap_or_default(), self.positions.values)?;
        if self.colours.is_empty() {
            return Ok(cloud);
        }
        Ok(cloud.with_colours(self.colours.iter().map(|&[r, g, b, _]| [r, g, b]).collect())?)
    }
}

/// Words between blanks; what is left is in the field.
struct Words<'a>(&'a [u8]);

impl<'a> Iterator for Words<'a> {
    type Item = &'a [u8];

    fn next(&mut self) -> Option<&'a [u8]> {
        let text = self.0.trim_ascii_start();
        if text.is_empty() {
            self.0 = text;
            return None;
        }
        let end = text.iter().position(u8::is_ascii_whitespace).unwrap_or(text.len());
        let (word, rest) = text.split_at(end);
        self.0 = rest;
        Some(word)
    }
}

fn parse_index(text: &[u8]) -> Option<i64> {
    let (negative, digits) = match text {
        [b'-', digits @ ..] => (true, digits),
        [b'+', digits @ ..] | digits => (false, digits),
    };
    // Ten digits hold every 32-bit index and cannot overflow.
    if digits.is_empty() || digits.len() > 10 || !digits.iter().all(u8::is_ascii_digit) {
        return None;
    }
    let value = digits.iter().fold(0i64, |value, d| value * 10 + i64::from(d - b'0'));
    Some(if negative { -value } else { value })
}

/// The beginning of a word, for messages.
fn show(word: &[u8]) -> String {
    String::from_utf8_lossy(&word[..word.len().min(40)]).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_and_indices() {
        let words: Vec<&[u8]> = Words(b" f  1/2 -3\t").collect();
        assert_eq!(words, [&b"f"[..], b"1/2", b"-3"]);
        assert_eq!(parse_index(b"-12"), Some(-12));
        assert_eq!(parse_index(b"4294967296"), Some(4_294_967_296));
        for bad in [&b""[..], b"-", b"1e3", b"99999999999", b"1.0"] {
            assert_eq!(parse_index(bad), None);
        }
    }

    #[test]
    fn channels_store_only_what_differs() {
        let mut channel = Channel::default();
        let mut triangles: Vec<[u32; 3]> = vec![];
        channel.push_triangle([0, 1, 2], [0, 1, 2], &triangles);
        triangles.push([0, 1, 2]);
        assert!(matches!(channel, Channel::Same));
        channel.push_triangle([5, 1, 2], [0, 1, 2], &triangles);
        assert!(matches!(&channel, Channel::Own(list) if list == &[[0, 1, 2], [5, 1, 2]]));
    }
}
