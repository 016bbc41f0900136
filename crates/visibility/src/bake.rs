//! Sets for a whole grid: every cell is a job of its own.

use crate::VisibilityError;
use crate::cell::ViewCell;
use crate::grid::CellGrid;
use crate::occluders::Occluders;
use crate::options::{Budget, Options};
use crate::pvs::Pvs;
use crate::sampler::Sampler;
use crate::store::{PvsWriter, checksum};
use crate::triangles::Triangles;
use crate::validate::Missed;
use farsight_geometry::streaming::replace_file;
use farsight_geometry::{Cost, RayCaster};
use std::io::{self, ErrorKind, Seek, SeekFrom, Write};
use std::ops::{ControlFlow, Range};
use std::path::{Path, PathBuf};

/// Cells that are sampled side by side, and after which a file is brought up to date.
const BATCH: u32 = 8;

/// What is baked, and how.
///
/// All that a host program needs: bake once, then ask for the set of the cell that the viewer is in.
///
/// ```
/// use farsight_geometry::ray::SceneCaster;
/// use farsight_geometry::scene::{Instance, Scene};
/// use farsight_geometry::{DAabb, TriangleMesh};
/// use farsight_visibility::glam::{DAffine3, DVec3, UVec3, Vec3};
/// use farsight_visibility::{Bake, Budget, CellGrid, Occluders, Options, PvsStore, Triangles};
/// use std::ops::ControlFlow;
///
/// // A corridor along x with a wall across it at x = 5, and a statue at either end.
/// let mut scene = Scene::new();
/// let slab = [(0.0, -9.0, -9.0), (0.0, 9.0, -9.0), (0.0, 9.0, 9.0), (0.0, -9.0, 9.0)];
/// let corners = slab.map(|(x, y, z)| Vec3::new(x, y, z)).to_vec();
/// let wall = scene.add_mesh(TriangleMesh::new(corners, vec![[0, 1, 2], [0, 2, 3]])?);
/// let statue = scene.add_mesh(TriangleMesh::new(vec![Vec3::ZERO, Vec3::Y, Vec3::Z], vec![[0, 1, 2]])?);
/// for (name, mesh, x) in [("wall", wall, 5.0), ("left", statue, -1.0), ("right", statue, 11.0)] {
///     let world_from_mesh = DAffine3::from_translation(DVec3::X * x);
///     scene.add_instance(Instance { name: name.into(), mesh, world_from_mesh, material: None })?;
/// }
///
/// // Bake: cells of a metre where viewers go, sets of whole instances.
/// let triangles = Triangles::of_scene(&scene)?.by_instance();
/// let caster = SceneCaster::new(&scene)?;
/// let walkable = DAabb::new(DVec3::new(0.0, -0.5, 0.0), DVec3::new(10.0, 0.5, 1.0));
/// let bake = Bake {
///     triangles: &triangles,
///     occluders: Occluders::opaque(&caster),
///     grid: CellGrid::new(walkable, UVec3::new(10, 1, 1))?,
///     options: Options::default(),
///     // Until fewer than a thousandth of all pixels can be wrong, at 95 %.
///     budget: Budget::missed(1e-3, 0.95, 1_000_000)?,
/// };
/// let path = std::env::temp_dir().join(format!("farsight-corridor-{}.pvs", std::process::id()));
/// bake.to_file(&path, 0..bake.grid.len(), |cell| {
///     println!("cell {}: {} of {} instances", cell.cell, cell.set.len(), triangles.members());
///     ControlFlow::Continue(())
/// })?;
///
/// // At run time: the set changes when the viewer enters another cell.
/// let store = PvsStore::read(&std::fs::read(&path)?)?;
/// let (mut here, mut set) = (None, None);
/// let mut drawn = Vec::new();
/// for x in [1.0, 1.2, 8.5, 30.0] {
///     let eye = DVec3::new(x, 0.0, 0.5);
///     let cell = store.grid().cell_at(eye);
///     if cell != here {
///         (here, set) = (cell, cell.and_then(|cell| store.get(cell)));
///     }
///     // Outside of all cells everything is drawn.
///     let visible = |instance: &u32| set.as_ref().is_none_or(|set| set.contains(*instance));
///     drawn.push((0..3).filter(visible).collect::<Vec<u32>>());
/// }
/// assert_eq!(drawn, [vec![0, 1], vec![0, 1], vec![0, 2], vec![0, 1, 2]]);
/// # std::fs::remove_file(&path)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Bake<'a, C> {
    /// What is looked at.
    pub triangles: &'a Triangles<'a>,
    /// What hides it.
    pub occluders: Occluders<'a, C>,
    /// From where.
    pub grid: CellGrid,
    /// How each cell is sampled; its seed is mixed with the cell's number.
    pub options: Options,
    /// When each cell is done.
    pub budget: Budget,
}

/// A cell's set, and what stands behind it.
#[derive(Clone, Debug)]
pub struct BakedCell {
    /// The cell.
    pub cell: u32,
    /// What is seen from it.
    pub set: Pvs,
    /// Bound on what is missing, when the budget asks for one and it was reached or tried.
    pub missed: Option<Missed>,
    /// Time and work.
    pub cost: Cost,
}

/// The cells of part `part` of `parts`, all but equal in size.
///
/// # Panics
/// When `part` is not below `parts`.
pub fn shard(grid: &CellGrid, part: u32, parts: u32) -> Range<u32> {
    assert!(part < parts, "part {part} of {parts}");
    let end = |part: u32| (u64::from(grid.len()) * u64::from(part) / u64::from(parts)) as u32;
    end(part)..end(part + 1)
}

impl<C: RayCaster> Bake<'_, C> {
    /// The set of one cell. It depends on nothing but the cell, so cells can be baked anywhere in any order.
    ///
    /// # Errors
    /// As [`Sampler::new`].
    ///
    /// # Panics
    /// When the grid has no such cell.
    pub fn cell(&self, cell: u32) -> Result<BakedCell, VisibilityError> {
        let region = ViewCell::from_box(&self.grid.cell_box(cell))?;
        let seed = self.options.seed.wrapping_add(u64::from(cell).wrapping_mul(0x9e37_79b9_7f4a_7c15));
        let options = Options { seed, ..self.options };
        let mut sampler = Sampler::new(self.triangles, self.occluders, &region, options)?;
        sampler.run(&self.budget);
        Ok(BakedCell { cell, set: sampler.pvs(), missed: sampler.missed(), cost: sampler.cost() })
    }

    /// A section with the sets of `cells`. `progress` is told of every cell in order and may break off: then what is done is
    /// returned, and [`to_file`](Self::to_file) shows how to go on with it.
    ///
    /// # Errors
    /// [`VisibilityError::CellRange`] when the grid does not have the cells.
    pub fn section(
        &self,
        cells: Range<u32>,
        progress: impl FnMut(&BakedCell) -> ControlFlow<()>,
    ) -> Result<Vec<u8>, VisibilityError> {
        let mut writer = PvsWriter::new(self.grid, self.triangles.members(), cells)?;
        self.fill(&mut writer, progress, |_| Ok(()))?;
        Ok(writer.bytes().to_vec())
    }

    /// Bakes into a file. Work in progress stands beside it under the name with `.part` added, whole cells only; when it is
    /// broken off, by `progress` or by force, the next call goes on from there, if it is for the same triangles, cells, options and budget (what hides is
    /// taken to be the same). The file itself appears when all cells are in it. Returns whether it did.
    ///
    /// # Errors
    /// As [`section`](Self::section), and [`VisibilityError::File`].
    pub fn to_file(
        &self,
        path: &Path,
        cells: Range<u32>,
        progress: impl FnMut(&BakedCell) -> ControlFlow<()>,
    ) -> Result<bool, VisibilityError> {
        let failed =
            |e: io::Error| VisibilityError::File { path: path.display().to_string(), reason: e.to_string() };
        let mut part = path.as_os_str().to_owned();
        part.push(".part");
        let part = PathBuf::from(part);
        let mark = self.identity().to_le_bytes();
        let fresh = PvsWriter::new(self.grid, self.triangles.members(), cells.clone())?;
        let old = match std::fs::read(&part) {
            Err(e) if e.kind() == ErrorKind::NotFound => Vec::new(),
            read => read.map_err(failed)?,
        };
        // Work on another scene, or with other options, is of no use here.
        let sections = old.strip_prefix(&mark).unwrap_or_default();
        let mut writer = fresh.clone().resume(sections).unwrap_or(fresh);
        let mut written = if sections.starts_with(writer.bytes()) { writer.bytes().len() } else { 0 };
        let mut options = std::fs::OpenOptions::new();
        let mut file = options.write(true).create(true).truncate(false).open(&part).map_err(failed)?;
        if written == 0 {
            // Never this mark before another's work.
            file.set_len(0).and_then(|()| file.write_all(&mark)).map_err(failed)?;
        } else {
            let kept = (mark.len() + written) as u64;
            file.set_len(kept).and_then(|()| file.seek(SeekFrom::Start(kept))).map_err(failed)?;
        }
        let save = |writer: &PvsWriter| {
            file.write_all(&writer.bytes()[written..]).and_then(|()| file.sync_data()).map_err(failed)?;
            written = writer.bytes().len();
            Ok(())
        };
        self.fill(&mut writer, progress, save)?;
        let done = writer.next_cell() == cells.end;
        if done {
            replace_file(path, writer.bytes()).and_then(|()| std::fs::remove_file(&part)).map_err(failed)?;
        }
        Ok(done)
    }

    /// What tells this bake from another.
    fn identity(&self) -> u64 {
        let how = format!("{:?} {:?}", self.options, self.budget);
        checksum(how.as_bytes()) ^ self.triangles.fingerprint()
    }

    /// Bakes what a writer lacks, a batch at a time.
    fn fill(
        &self,
        writer: &mut PvsWriter,
        mut progress: impl FnMut(&BakedCell) -> ControlFlow<()>,
        mut save: impl FnMut(&PvsWriter) -> Result<(), VisibilityError>,
    ) -> Result<(), VisibilityError> {
        save(writer)?;
        loop {
            let first = writer.next_cell();
            let last = first.saturating_add(BATCH).min(writer.last_cell());
            if first == last {
                return Ok(());
            }
            let mut go_on = ControlFlow::Continue(());
            for baked in self.batch(first..last) {
                let baked = baked?;
                writer.add(&baked.set)?;
                go_on = progress(&baked);
                if go_on.is_break() {
                    break;
                }
            }
            save(writer)?;
            if go_on.is_break() {
                return Ok(());
            }
        }
    }

    #[cfg(feature = "rayon")]
    fn batch(&self, cells: Range<u32>) -> Vec<Result<BakedCell, VisibilityError>> {
        use rayon::prelude::*;
        cells.into_par_iter().map(|cell| self.cell(cell)).collect()
    }

    #[cfg(not(feature = "rayon"))]
    fn batch(&self, cells: Range<u32>) -> impl Iterator<Item = Result<BakedCell, VisibilityError>> {
        cells.map(|cell| self.cell(cell))
    }
}
