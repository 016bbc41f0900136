//! From the whole input to leaves, whatever its size: what does not fit in memory is cut into files first.

use super::Watch;
use super::scratch::Scratch;
use super::spool::Spool;
use crate::HlodError;
use crate::appearance::Look;
use crate::cell::{Cell, Cube, DEEPEST};
use crate::cut::{Polygons, SplitCounts, cut};
use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::PathBuf;

/// Triangles that a leaf may have when cutting does not help.
const MOST_IN_LEAF: usize = 1 << 22;

/// What is to be cut.
pub(super) struct Cutter<'a> {
    pub cube: &'a Cube,
    pub scratch: &'a Scratch,
    pub with_looks: bool,
    /// Triangles of a leaf.
    pub most: usize,
    /// Triangles that may be in memory.
    pub resident: usize,
    pub watch: &'a Watch<'a>,
}

/// Leaves that were cut together, in order.
pub(super) type Leaves = Vec<(Cell, Polygons)>;

impl Cutter<'_> {
    /// Cuts the input into leaves; `leaves` gets them in the order of a Z curve, some at a time.
    pub(super) fn run(
        &self,
        spool: &mut Spool,
        leaves: &mut dyn FnMut(Leaves) -> Result<(), HlodError>,
    ) -> Result<(), HlodError> {
        if spool.triangles as usize <= self.resident {
            let mut all = Polygons::default();
            spool.read(self.cube, self.with_looks, &mut |p| {
                all.append(&p);
                Ok(())
            })?;
            return self.in_memory(Cell::ROOT, all, leaves);
        }
        let mut parts = Parts::create(self, Cell::ROOT)?;
        spool.read(self.cube, self.with_looks, &mut |p| {
            self.watch.check()?;
            parts.add(p)
        })?;
        let whole = spool.triangles as usize;
        match parts.finish(whole)? {
            Some(files) => self.children(Cell::ROOT, files, leaves),
            None => {
                let mut all = Polygons::default();
                self.fits(whole)?;
                spool.read(self.cube, self.with_looks, &mut |p| {
                    all.append(&p);
                    Ok(())
                })?;
                leaves(vec![(Cell::ROOT, all)])
            }
        }
    }

    fn fits(&self, triangles: usize) -> Result<(), HlodError> {
        if triangles > MOST_IN_LEAF {
            return Err(HlodError::TooLarge { triangles, limit: MOST_IN_LEAF });
        }
        Ok(())
    }

    fn in_memory(
        &self,
        cell: Cell,
        polygons: Polygons,
        leaves: &mut dyn FnMut(Leaves) -> Result<(), HlodError>,
    ) -> Result<(), HlodError> {
        let mut all = Leaves::new();
        cut(cell, polygons, self.most, &mut |cell, p| all.push((cell, p)));
        for (_, p) in &all {
            self.fits(p.triangles())?;
        }
        leaves(all)
    }

    fn children(
        &self,
        cell: Cell,
        files: [Option<Part>; 8],
        leaves: &mut dyn FnMut(Leaves) -> Result<(), HlodError>,
    ) -> Result<(), HlodError> {
        for (octant, part) in files.into_iter().enumerate() {
            let Some(mut part) = part else { continue };
            self.watch.check()?;
            let child = cell.child(octant as u32);
            if part.triangles <= self.resident {
                let all = part.read_all()?;
                part.remove();
                self.in_memory(child, all, leaves)?;
                continue;
            }
            if child.level == DEEPEST {
                self.fits(part.triangles)?;
                leaves(vec![(child, part.read_all()?)])?;
                part.remove();
                continue;
            }
            let mut parts = Parts::create(self, child)?;
            part.read(&mut |p| {
                self.watch.check()?;
                parts.add(p)
            })?;
            match parts.finish(part.triangles)? {
                Some(files) => {
                    part.remove();
                    self.children(child, files, leaves)?;
                }
                None => {
                    self.fits(part.triangles)?;
                    leaves(vec![(child, part.read_all()?)])?;
                    part.remove();
                }
            }
        }
        Ok(())
    }
}

/// The eight children of a cell, being written.
struct Parts {
    cell: Cell,
    files: [Option<(BufWriter<File>, PathBuf)>; 8],
    triangles: [usize; 8],
    names: [PathBuf; 8],
}

/// Polygons in a file.
struct Part {
    file: File,
    path: PathBuf,
    triangles: usize,
}

impl Parts {
    fn create(cutter: &Cutter<'_>, cell: Cell) -> Result<Self, HlodError> {
        let [x, y, z] = cell.at;
        let name = |octant: usize| cutter.scratch.path(&format!("cell-{}-{x}-{y}-{z}-{octant}", cell.level));
        Ok(Self { cell, files: Default::default(), triangles: [0; 8], names: std::array::from_fn(name) })
    }

    fn add(&mut self, polygons: Polygons) -> Result<(), HlodError> {
        for (octant, part) in polygons.split(&self.cell).into_iter().enumerate() {
            if part.len() == 0 {
                continue;
            }
            self.triangles[octant] += part.triangles();
            let path = &self.names[octant];
            if self.files[octant].is_none() {
                let file = File::options().read(true).write(true).create(true).truncate(true).open(path);
                let writer = BufWriter::with_capacity(1 << 18, file.map_err(HlodError::io(path))?);
                self.files[octant] = Some((writer, path.clone()));
            }
            if let Some((writer, path)) = &mut self.files[octant] {
                part.write(writer).map_err(HlodError::io(&*path))?;
            }
        }
        Ok(())
    }

    /// The files, or `None` when cutting was of no use.
    fn finish(self, whole: usize) -> Result<Option<[Option<Part>; 8]>, HlodError> {
        let progress = SplitCounts::of(self.triangles).made_progress(whole);
        let mut parts: [Option<Part>; 8] = Default::default();
        for ((slot, file), triangles) in parts.iter_mut().zip(self.files).zip(self.triangles) {
            let Some((writer, path)) = file else { continue };
            let file = writer.into_inner().map_err(|e| HlodError::io(&path)(e.into_error()))?;
            let part = Part { file, path, triangles };
            if progress {
                *slot = Some(part);
            } else {
                part.remove();
            }
        }
        Ok(progress.then_some(parts))
    }
}

impl Part {
    fn read(&mut self, block: &mut dyn FnMut(Polygons) -> Result<(), HlodError>) -> Result<(), HlodError> {
        let io = |path: &PathBuf| HlodError::io(path.clone());
        self.file.seek(SeekFrom::Start(0)).map_err(io(&self.path))?;
        let mut reader = BufReader::with_capacity(1 << 18, &self.file);
        let mut left = self.triangles;
        while left > 0 {
            let polygons = Polygons::read(&mut reader).map_err(io(&self.path))?;
            left = left.saturating_sub(polygons.triangles());
            block(polygons)?;
        }
        Ok(())
    }

    fn read_all(&mut self) -> Result<Polygons, HlodError> {
        let mut all = Polygons::default();
        self.read(&mut |p| {
            all.append(&p);
            Ok(())
        })?;
        Ok(all)
    }

    fn remove(&self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

impl Polygons {
    fn append(&mut self, other: &Self) {
        let base = self.at.len() as u32;
        self.at.extend_from_slice(&other.at);
        self.looks.extend_from_slice(&other.looks);
        self.ends.extend(other.ends.iter().map(|e| e + base));
    }

    fn write(&self, w: &mut impl Write) -> std::io::Result<()> {
        w.write_all(bytemuck::bytes_of(&[
            self.ends.len() as u32,
            self.at.len() as u32,
            self.looks.len() as u32,
        ]))?;
        w.write_all(bytemuck::cast_slice(&self.ends))?;
        w.write_all(bytemuck::cast_slice(&self.at))?;
        let looks: Vec<[f32; 9]> = self.looks.iter().map(|l| l.to_array()).collect();
        w.write_all(bytemuck::cast_slice(&looks))
    }

    fn read(r: &mut impl Read) -> std::io::Result<Self> {
        let mut counts = [0u32; 3];
        r.read_exact(bytemuck::bytes_of_mut(&mut counts))?;
        let mut ends = vec![0u32; counts[0] as usize];
        r.read_exact(bytemuck::cast_slice_mut(&mut ends))?;
        let mut at = vec![[0i32; 3]; counts[1] as usize];
        r.read_exact(bytemuck::cast_slice_mut(&mut at))?;
        let mut looks = vec![[0f32; 9]; counts[2] as usize];
        r.read_exact(bytemuck::cast_slice_mut(&mut looks))?;
        Ok(Self { at, looks: looks.into_iter().map(Look::from_array).collect(), ends })
    }
}
