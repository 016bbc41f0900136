//! Raw bytes of the input, block by block.

use super::abort::Abort;
use super::temp::Scratch;
use crate::PointsError;
use crate::input::{Batch, Input, Part, Source};
use crate::layout::Layout;
use farsight_geometry::streaming::read_exact_at;
use std::fs::File;
use std::path::PathBuf;
use std::sync::Arc;

/// Bytes of a block, about.
const BLOCK: usize = 4 << 20;

/// Some points of a part.
pub(super) struct RawBlock<'a> {
    pub part: usize,
    pub points: usize,
    place: Place<'a>,
}

enum Place<'a> {
    Slice(&'a [u8]),
    Owned(Vec<u8>),
    File { file: Arc<File>, path: PathBuf, offset: u64 },
}

/// What a pass needs to know of a part.
pub(super) struct PartInfo {
    pub layout: Layout,
    pub shift: [i64; 3],
    pub wide_colours: bool,
    pub guess: Option<([i32; 3], [i32; 3])>,
    pub name: PathBuf,
}

/// The input, ready to be read any number of times.
pub(super) struct Blocks<'a> {
    pub parts: Vec<PartInfo>,
    pub blocks: Vec<RawBlock<'a>>,
}

impl<'a> Blocks<'a> {
    /// Opens files and stages what can be read only once: in memory up to `resident` bytes, the rest in `scratch`.
    pub fn open(
        input: Input<'a>,
        resident: usize,
        scratch: Option<&Scratch>,
        abort: &Abort<'_>,
    ) -> Result<Self, PointsError> {
        let mut out = Self { parts: Vec::new(), blocks: Vec::new() };
        let mut stage = Stage { resident, used: 0, file: None };
        for (index, part) in input.parts.into_iter().enumerate() {
            out.parts.push(PartInfo {
                wide_colours: part.wide_colours(),
                layout: part.layout.clone(),
                shift: part.shift,
                guess: part.guess,
                name: part.name.clone(),
            });
            out.add(index, part, &mut stage, scratch, abort)?;
        }
        Ok(out)
    }

    fn add(
        &mut self,
        index: usize,
        part: Part<'a>,
        stage: &mut Stage,
        scratch: Option<&Scratch>,
        abort: &Abort<'_>,
    ) -> Result<(), PointsError> {
        let stride = part.layout.stride;
        let most = (BLOCK / stride).max(1);
        match part.source {
            Source::Bytes(bytes) => {
                for slice in bytes.chunks(most * stride) {
                    let points = slice.len() / stride;
                    self.blocks.push(RawBlock { part: index, points, place: Place::Slice(slice) });
                }
            }
            Source::File { path, offset } => {
                let file = Arc::new(File::open(&path).map_err(PointsError::io(&path))?);
                let mut first = 0;
                while first < part.count {
                    let points = (part.count - first).min(most as u64) as usize;
                    let offset = offset + first * stride as u64;
                    let place = Place::File { file: Arc::clone(&file), path: path.clone(), offset };
                    self.blocks.push(RawBlock { part: index, points, place });
                    first += points as u64;
                }
            }
            Source::Reader(mut reader) => {
                let (mut batch, layout) = (Batch::default(), part.layout);
                self.stage(index, stride, stage, scratch, abort, |bytes| {
                    batch.clear();
                    let more = reader.read(&mut batch)?;
                    encode(&batch, &layout, bytes)?;
                    Ok(more)
                })?;
            }
            Source::Raw(mut reader) => {
                self.stage(index, stride, stage, scratch, abort, |bytes| reader.read(bytes))?
            }
        }
        Ok(())
    }

    /// Keeps what can be read only once.
    fn stage(
        &mut self,
        part: usize,
        stride: usize,
        stage: &mut Stage,
        scratch: Option<&Scratch>,
        abort: &Abort<'_>,
        mut read: impl FnMut(&mut Vec<u8>) -> Result<bool, PointsError>,
    ) -> Result<(), PointsError> {
        let mut bytes = Vec::new();
        loop {
            let before = bytes.len();
            let more = read(&mut bytes)?;
            abort.advance(super::Stage::Read, ((bytes.len() - before) / stride) as u64, 0)?;
            if bytes.len() >= BLOCK || !more {
                if !bytes.is_empty() {
                    let points = bytes.len() / stride;
                    self.blocks.push(RawBlock { part, points, place: stage.place(&mut bytes, scratch)? });
                }
                if !more {
                    return Ok(());
                }
            }
        }
    }

    pub fn points(&self) -> u64 {
        self.blocks.iter().map(|b| b.points as u64).sum()
    }

    /// The records of a block.
    pub fn read<'b>(&'b self, index: usize, buffer: &'b mut Vec<u8>) -> Result<&'b [u8], PointsError> {
        let block = &self.blocks[index];
        match &block.place {
            Place::Slice(bytes) => Ok(bytes),
            Place::Owned(bytes) => Ok(bytes),
            Place::File { file, path, offset } => {
                buffer.resize(block.points * self.parts[block.part].layout.stride, 0);
                read_exact_at(file, buffer, *offset).map_err(PointsError::io(path))?;
                Ok(buffer)
            }
        }
    }
}

/// Where points wait that can be read only once.
struct Stage {
    resident: usize,
    used: usize,
    file: Option<(Arc<File>, PathBuf, u64)>,
}

fn encode(batch: &Batch, layout: &Layout, bytes: &mut Vec<u8>) -> Result<(), PointsError> {
    let each = layout.attribute_bytes();
    if batch.attributes.len() != each * batch.points.len() {
        let (bytes, expected) = (batch.attributes.len() / batch.points.len().max(1), each);
        return Err(PointsError::AttributesDiffer { what: "a batch".into(), bytes, expected });
    }
    if each == 0 {
        bytes.extend_from_slice(bytemuck::cast_slice(&batch.points));
        return Ok(());
    }
    for (point, attributes) in batch.points.iter().zip(batch.attributes.chunks_exact(each)) {
        bytes.extend_from_slice(bytemuck::bytes_of(point));
        bytes.extend_from_slice(attributes);
    }
    Ok(())
}

impl Stage {
    /// Keeps bytes in memory, or on disk once there are too many.
    fn place<'a>(
        &mut self,
        bytes: &mut Vec<u8>,
        scratch: Option<&Scratch>,
    ) -> Result<Place<'a>, PointsError> {
        let Some(scratch) = scratch.filter(|_| self.used + bytes.len() > self.resident) else {
            self.used += bytes.len();
            let kept = bytes.as_slice().to_vec();
            bytes.clear();
            return Ok(Place::Owned(kept));
        };
        if self.file.is_none() {
            let (file, path) = scratch.create("staged")?;
            self.file = Some((Arc::new(file), path, 0));
        }
        let (file, path, end) = self.file.as_mut().expect("just made");
        let offset = *end;
        std::io::Write::write_all(&mut &**file, bytes).map_err(PointsError::io(&*path))?;
        *end += bytes.len() as u64;
        bytes.clear();
        Ok(Place::File { file: Arc::clone(file), path: path.clone(), offset })
    }
}
