//! Inner nodes of a build that may be killed: whole ones are read back by the next build, which has cut the same leaves.

use super::node::Made;
use super::scratch::Scratch;
use crate::HlodError;
use crate::cell::Cell;
use crate::codec::Encoded;
use crate::tree::{Cone, LatticeBox};
use glam::Vec3;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom, Write};
use std::path::PathBuf;

/// Name of the file in the scratch folder.
pub(super) const NAME: &str = "inner";

/// A made node.
pub(super) struct Entry {
    pub cell: Cell,
    pub meshes: Vec<Made>,
}

/// The file: what identifies the build, then nodes in the order that they are made in.
pub(super) struct Journal {
    file: File,
    path: PathBuf,
    reader: Option<BufReader<File>>,
    /// Bytes that were read and make sense.
    good: u64,
}

impl Journal {
    /// Opens what a killed build of the same leaves left, or begins anew.
    pub(super) fn open(scratch: &Scratch, identity: [u64; 4]) -> Result<Self, HlodError> {
        let path = scratch.path(NAME);
        let file = File::options().read(true).write(true).create(true).truncate(false).open(&path);
        let mut file = file.map_err(HlodError::io(&path))?;
        let mut found = [0u64; 4];
        let is_ours = file.read_exact(bytemuck::bytes_of_mut(&mut found)).is_ok() && found == identity;
        let good = size_of_val(&identity) as u64;
        if is_ours {
            let reader = file.try_clone().map_err(HlodError::io(&path))?;
            return Ok(Self { file, path, reader: Some(BufReader::new(reader)), good });
        }
        let begin = |file: &mut File| {
            file.set_len(0)?;
            file.seek(SeekFrom::Start(0))?;
            file.write_all(bytemuck::bytes_of(&identity))
        };
        begin(&mut file).map_err(HlodError::io(&path))?;
        Ok(Self { file, path, reader: None, good })
    }

    /// The next node, if it is there whole and is that of a cell. After the first that is not, nodes are added.
    pub(super) fn next(&mut self, cell: Cell, meshes: usize) -> Result<Option<Entry>, HlodError> {
        let Some(reader) = &mut self.reader else { return Ok(None) };
        if let Some((entry, size)) = read(reader).filter(|(e, _)| e.cell == cell && e.meshes.len() == meshes)
        {
            self.good += size;
            return Ok(Some(entry));
        }
        self.reader = None;
        let mut cut = || {
            self.file.set_len(self.good)?;
            self.file.seek(SeekFrom::Start(self.good))
        };
        cut().map_err(HlodError::io(&self.path))?;
        Ok(None)
    }

    pub(super) fn add(&mut self, entry: &Entry) -> Result<(), HlodError> {
        let mut bytes = Vec::new();
        let cell = [entry.cell.level, entry.cell.at[0], entry.cell.at[1], entry.cell.at[2]];
        put(&mut bytes, &cell);
        put(&mut bytes, &[entry.meshes.len() as u32]);
        for m in &entry.meshes {
            let c = &m.coded;
            put(
                &mut bytes,
                &[c.positions, c.vertices, c.triangles, c.shape.len() as u32, c.looks.len() as u32],
            );
            bytes.extend(m.error.to_le_bytes());
            bytes.extend(m.look_error.to_le_bytes());
            bytes.extend(m.joined.to_le_bytes());
            put(&mut bytes, &m.bounds.min.map(|x| x as u32));
            put(&mut bytes, &m.bounds.max.map(|x| x as u32));
            put(&mut bytes, &m.cone.axis.to_array().map(f32::to_bits));
            put(&mut bytes, &[m.cone.angle.to_bits()]);
            bytes.extend(&c.shape);
            bytes.extend(&c.looks);
        }
        let mut whole = Vec::with_capacity(bytes.len() + 8);
        put(&mut whole, &[bytes.len() as u32, crc32fast::hash(&bytes)]);
        whole.extend(bytes);
        self.file.write_all(&whole).map_err(HlodError::io(&self.path))
    }
}

fn put(bytes: &mut Vec<u8>, values: &[u32]) {
    values.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
}

/// A node and its bytes; `None` at the end, and for what was cut off.
fn read(reader: &mut impl Read) -> Option<(Entry, u64)> {
    let mut head = [0u32; 2];
    reader.read_exact(bytemuck::bytes_of_mut(&mut head)).ok()?;
    let mut bytes = Vec::new();
    reader.take(u64::from(head[0])).read_to_end(&mut bytes).ok()?;
    if bytes.len() != head[0] as usize || crc32fast::hash(&bytes) != head[1] {
        return None;
    }
    let size = 8 + bytes.len() as u64;
    let mut rest = &bytes[..];
    let [level, x, y, z, count] = take(&mut rest)?;
    let mut meshes = Vec::new();
    for _ in 0..count.min(2) {
        let [positions, vertices, triangles, shape, looks] = take(&mut rest)?;
        let mut double = || take_double(&mut rest);
        let (error, look_error, joined) = (f64::from_bits(double()?), f64::from_bits(double()?), double()?);
        let min = take(&mut rest)?.map(|x: u32| x as i32);
        let max = take(&mut rest)?.map(|x: u32| x as i32);
        let axis = Vec3::from_array(take(&mut rest)?.map(f32::from_bits));
        let [angle] = take(&mut rest)?;
        let (shape, after) = rest.split_at_checked(shape as usize)?;
        let (looks, after) = after.split_at_checked(looks as usize)?;
        rest = after;
        let coded = Encoded { shape: shape.to_vec(), looks: looks.to_vec(), positions, vertices, triangles };
        let cone = Cone { axis, angle: f32::from_bits(angle) };
        let bounds = LatticeBox { min, max };
        meshes.push(Made { coded, error, look_error, bounds, cone, joined });
    }
    Some((Entry { cell: Cell { level, at: [x, y, z] }, meshes }, size))
}

fn take<const N: usize>(bytes: &mut &[u8]) -> Option<[u32; N]> {
    let mut out = [0; N];
    for v in &mut out {
        let (now, later) = bytes.split_first_chunk::<4>()?;
        (*v, *bytes) = (u32::from_le_bytes(*now), later);
    }
    Some(out)
}

fn take_double(bytes: &mut &[u8]) -> Option<u64> {
    let (now, later) = bytes.split_first_chunk::<8>()?;
    *bytes = later;
    Some(u64::from_le_bytes(*now))
}
