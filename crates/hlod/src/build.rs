//! From triangles to a finished hierarchy on disk.

mod journal;
mod levels;
mod node;
mod partition;
mod scratch;
mod spool;
mod thin;

use crate::cell::{BITS, Cube};
use crate::piece::Attributes;
use crate::store::{Head, MAGIC, tail};
use crate::tree::Steps;
use crate::{HlodError, SimplifyOptions, Tier};
use farsight_geometry::TriangleMesh;
use farsight_geometry::accuracy::Cost;
use farsight_geometry::streaming::{folder_of, sync_folder};
use journal::Journal;
use levels::Levels;
use partition::Cutter;
use scratch::Scratch;
use spool::{Spool, Spooler};
use std::borrow::Borrow;
use std::error::Error;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// How a hierarchy is built. Neither threads nor memory change a byte of the result.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct BuildOptions {
    /// A node's mesh is no farther from the input than its cell's edge over this (`Tier::Fast`: may be); 16 to 65536. More means larger
    /// nodes that are good for more of the screen, more bytes and longer builds. `None` for what was found to pay: 128 where attributes count, 256 for
    /// shape alone; see the book.
    pub resolution: Option<f64>,
    /// Triangles of a leaf; at least 500. Cutting a surface into small pieces multiplies it: see the book.
    pub most_triangles: usize,
    /// How much work the bound is worth.
    pub tier: Tier,
    /// Whether normals, texture coordinates and colours are kept, and count. Inner nodes then have a second mesh, for shape alone.
    pub appearance: bool,
    /// Most that rounding may move a vertex of a leaf, in world units; `None` for a fraction of the leaf's tolerance.
    pub precision: Option<f64>,
    /// Memory in bytes to stay around, at least 64 MiB: what does not fit goes to disk in between.
    pub memory: u64,
    /// Threads; 0 for as many as there are processors. More than one needs the feature `rayon`.
    pub threads: usize,
    /// Keeps simplified nodes beside the output, so that the next build of the same input to the same output goes on from there if this one is killed.
    pub resume: bool,
}

impl Default for BuildOptions {
    /// The usual resolution, 4000 triangles, every contraction certified, with appearance, 256 MiB, all processors, no resuming.
    fn default() -> Self {
        Self {
            resolution: None,
            most_triangles: 4000,
            tier: Tier::Guaranteed,
            appearance: true,
            precision: None,
            memory: 256 << 20,
            threads: 0,
            resume: false,
        }
    }
}

impl BuildOptions {
    /// The options with another resolution.
    #[must_use]
    pub fn with_resolution(self, resolution: f64) -> Self {
        Self { resolution: Some(resolution), ..self }
    }

    /// The options with another size of leaves.
    #[must_use]
    pub fn with_most_triangles(self, most_triangles: usize) -> Self {
        Self { most_triangles, ..self }
    }

    /// The options with another tier.
    #[must_use]
    pub fn with_tier(self, tier: Tier) -> Self {
        Self { tier, ..self }
    }

    /// The options with attributes kept, or not.
    #[must_use]
    pub fn with_appearance(self, appearance: bool) -> Self {
        Self { appearance, ..self }
    }

    /// The options with another precision of leaves.
    #[must_use]
    pub fn with_precision(self, precision: f64) -> Self {
        Self { precision: Some(precision), ..self }
    }

    /// The options with another number of threads.
    #[must_use]
    pub fn with_threads(self, threads: usize) -> Self {
        Self { threads, ..self }
    }

    /// The options with another limit of memory.
    #[must_use]
    pub fn with_memory(self, memory: u64) -> Self {
        Self { memory, ..self }
    }

    /// The options with resuming, or not.
    #[must_use]
    pub fn with_resume(self, resume: bool) -> Self {
        Self { resume, ..self }
    }

    fn check(&self) -> Result<(), HlodError> {
        let bad = |option, value: f64, range| Err(HlodError::Option { option, value, range });
        if let Some(resolution) = self.resolution.filter(|r| !(16.0..=65536.0).contains(r)) {
            return bad("resolution", resolution, "16 to 65536");
        }
        if self.most_triangles < 500 {
            return bad("most_triangles", self.most_triangles as f64, "at least 500");
        }
        if self.memory < 64 << 20 {
            return bad("memory", self.memory as f64, "at least 64 MiB");
        }
        match self.precision {
            Some(p) if !(p > 0.0 && p.is_finite()) => bad("precision", p, "finite and above zero"),
            _ => Ok(()),
        }
    }
}

/// What a build is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Stage {
    /// Reading the input.
    Read,
    /// Cutting it into leaves.
    Cut,
    /// Making coarser nodes.
    Simplify,
}

/// How far a build is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Progress {
    /// The stage.
    pub stage: Stage,
    /// What the stage has dealt with: triangles, in the last stage nodes.
    pub done: u64,
    /// What it has to deal with; 0 when not known.
    pub total: u64,
}

/// Lets a build run to its end in silence.
pub fn no_progress(_: Progress) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// What was built of a level.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct LevelReport {
    /// Nodes, leaves included.
    pub nodes: u64,
    /// Leaves.
    pub leaves: u64,
    /// Triangles of all its meshes with attributes.
    pub triangles: u64,
    /// Triangles of all its meshes for shape alone.
    pub shape_triangles: u64,
    /// Bytes of both.
    pub bytes: u64,
    /// The largest geometric error.
    pub error: f64,
}

/// What was built.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct BuildReport {
    /// Triangles that came in.
    pub triangles: u64,
    /// What became of them, from the root down.
    pub levels: Vec<LevelReport>,
    /// Bytes of the file.
    pub bytes: u64,
    /// Bytes of the meshes for shape alone, where there is another one.
    pub shape_bytes: u64,
    /// Vertices that were moved to close cracks between nodes.
    pub joined: u64,
    /// Nodes that a killed build had made.
    pub resumed: u64,
    /// Time; bytes of the file; counters `triangles`, `nodes`, `leaves`, `joined`.
    pub cost: Cost,
}

/// Where progress goes, and whether to stop.
pub(crate) struct Watch<'a> {
    progress: &'a (dyn Fn(Progress) -> ControlFlow<()> + Sync),
    done: AtomicU64,
}

impl Watch<'_> {
    fn begin(&self) {
        self.done.store(0, Ordering::Relaxed);
    }

    fn advance(&self, stage: Stage, count: u64, total: u64) -> Result<(), HlodError> {
        let done = self.done.fetch_add(count, Ordering::Relaxed) + count;
        match (self.progress)(Progress { stage, done, total }) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(HlodError::Cancelled),
        }
    }

    fn check(&self) -> Result<(), HlodError> {
        self.advance(Stage::Cut, 0, 0)
    }
}

/// What all nodes have in common.
pub(crate) struct Plan {
    pub cube: Cube,
    pub attributes: Attributes,
    pub resolution: f64,
    pub steps: Steps,
    pub tier: Tier,
    pub threads: Threads,
}

impl Plan {
    fn simplify(&self, attributes: Attributes) -> SimplifyOptions {
        SimplifyOptions::default().with_tier(self.tier).with_appearance(attributes.any())
    }
}

/// Steps of the lattice in a node's tolerance: rounding then takes at most an eighth of it.
const STEPS_IN_TOLERANCE: f64 = 8.0;

/// Steps of the lattice in a side of an average triangle of the input.
const STEPS_IN_SIDE: f64 = 24.0;

/// Builds the hierarchy of all triangles of some batches and writes it to one file.
///
/// The file appears under its name only when it is complete and on the disk; until then an older one stays. A folder of scratch files lies
/// beside it, and is removed when the build ends in any way. `progress` may cancel.
///
/// Cells with more than [`BuildOptions::most_triangles`] are cut into eight. Leaves hold the input as it is; an inner node holds what lies two levels
/// below it, simplified until the errors of all steps together reach its edge over [`BuildOptions::resolution`].
///
/// # Accuracy
/// The error that a node has in the end, rounding of coordinates included, is stored with it: [`Tree::error`](crate::Tree::error). The result is the same, byte for byte, for any
/// number of threads, any memory limit and any division of the input into batches.
///
/// # Cost
/// Every triangle is simplified two to three times; see the book for seconds and bytes. Disk for the input twice, uncompressed, while it runs.
///
/// # Errors
/// [`HlodError::Option`], [`HlodError::Input`] with the error of a batch, [`HlodError::Cancelled`], [`HlodError::Io`], and
/// [`HlodError::TooLarge`] when millions of triangles share one place, so that cutting cannot separate them, or are so loose that simplification leaves them all.
///
/// # References
/// [Guthe 2004], section 3. Differs: the error is proven and that which was achieved; both sides of a wall keep the same rim.
///
/// ```
/// use farsight_geometry::hard_cases::bumpy_ball;
/// use farsight_hlod::{BuildOptions, HlodError, Mesh, Store, build, no_progress};
///
/// let path = std::env::temp_dir().join(format!("doc-{}.hlod", std::process::id()));
/// let ball = bumpy_ball(30); // 10,800 triangles; could come in any number of batches
/// let options = BuildOptions::default().with_appearance(false);
/// build([Ok::<_, HlodError>(&ball)], &path, &options, &no_progress)?;
///
/// let store = Store::open(&path)?;
/// let root = store.tree().root().unwrap();
/// assert!(store.tree().triangles(root, Mesh::Full) < 5000);
/// assert!(store.tree().error(root, Mesh::Full).value <= store.tree().edge(root) / 256.0);
/// # std::fs::remove_file(path).unwrap();
/// # Ok::<(), HlodError>(())
/// ```
pub fn build<M: Borrow<TriangleMesh>, E: Into<Box<dyn Error + Send + Sync>>>(
    batches: impl IntoIterator<Item = Result<M, E>>,
    out: impl AsRef<Path>,
    options: &BuildOptions,
    progress: &(dyn Fn(Progress) -> ControlFlow<()> + Sync),
) -> Result<BuildReport, HlodError> {
    options.check()?;
    let (start, out) = (Instant::now(), out.as_ref());
    let watch = Watch { progress, done: AtomicU64::new(0) };
    let scratch = Scratch::new(out, |name| options.resume && name == journal::NAME)?;
    let mut spooler = Spooler::new(&scratch)?;
    for (batch, mesh) in batches.into_iter().enumerate() {
        let mesh = mesh.map_err(|e| HlodError::Input { batch, source: e.into() })?;
        spooler.add(mesh.borrow())?;
        watch.advance(Stage::Read, mesh.borrow().triangles().len() as u64, 0)?;
    }
    let spool = spooler.finish()?;
    let plan = plan(&spool, options);
    let report = construct(spool, &plan, out, options, &scratch, &watch)?;
    sync_folder(folder_of(out)).map_err(HlodError::io(folder_of(out)))?;
    let mut cost = report.cost;
    cost.time = start.elapsed();
    Ok(BuildReport { cost, ..report })
}

/// Resolution where shape alone counts. Half of it takes a fifth off the bytes and leaves views with 1.4 to 1.9 times the triangles, since a level holds half of the one below.
const USUAL: f64 = 256.0;

/// The same where attributes count. Levels hold most of the triangles of the ones below, so that twice as fine a one saves views nothing, and costs a fifth more bytes.
const USUAL_WITH_LOOKS: f64 = 128.0;

fn plan(spool: &Spool, options: &BuildOptions) -> Plan {
    let cube = Cube::around(&spool.bounds);
    let attributes = if options.appearance { spool.attributes } else { Attributes::default() };
    let resolution = options.resolution.unwrap_or(if attributes.any() { USUAL_WITH_LOOKS } else { USUAL });
    let inner = (resolution * STEPS_IN_TOLERANCE).log2().ceil() as u32;
    // Neighbouring leaves of different levels should round alike, so that their rims stay equal: by the size of triangles if that is
    // finer than what the level asks for.
    let side = (spool.area / spool.triangles.max(1) as f64 * 2.3).sqrt();
    let finest = options.precision.map_or(side / STEPS_IN_SIDE, |p| p / 0.87);
    // A power of two: the next one, but never above a precision that was asked for.
    let power = (finest / cube.unit).log2();
    let power = if options.precision.is_some() { power.floor() } else { power.round() };
    let leaf_most = (power.max(0.0) as u32).min(BITS);
    let steps = Steps { inner, leaf_most };
    Plan { cube, attributes, resolution, steps, tier: options.tier, threads: Threads::new(options.threads) }
}

/// Cuts, simplifies, writes and publishes.
fn construct(
    mut spool: Spool,
    plan: &Plan,
    out: &Path,
    options: &BuildOptions,
    scratch: &Scratch,
    watch: &Watch<'_>,
) -> Result<BuildReport, HlodError> {
    let triangles = spool.triangles;
    let (file, path) = scratch.create("store")?;
    let mut levels = Levels::new(plan, file, path.clone());
    levels.write(MAGIC)?;
    let with_looks = plan.attributes.any();
    // Polygons of a part exist up to four times while they are cut.
    let bytes = if with_looks { 4 * 152 } else { 4 * 44 };
    let resident = (options.memory as usize / 4 / bytes).max(2 * options.most_triangles);
    let cutter =
        Cutter { cube: &plan.cube, scratch, with_looks, most: options.most_triangles, resident, watch };
    watch.begin();
    cutter.run(&mut spool, &mut |leaves| levels.add_leaves(leaves, watch, triangles))?;
    let spool_path = scratch.path("input");
    drop(spool);
    let _ = std::fs::remove_file(spool_path);
    let journal = if options.resume { Some(Journal::open(scratch, levels.identity())?) } else { None };
    let (nodes, counts) = levels.simplify(journal, watch)?;
    let head = Head {
        cube: plan.cube,
        attributes: plan.attributes,
        resolution: plan.resolution,
        steps: plan.steps,
        input_triangles: triangles,
    };
    let end = levels.length();
    levels.write(&tail(&head, &nodes, end))?;
    let bytes = levels.length();
    levels.sync()?;
    std::fs::rename(&path, out).map_err(HlodError::io(out))?;
    let mut report = levels::report(&nodes, triangles, bytes, &counts);
    report.cost.bytes = bytes;
    Ok(report)
}

/// Runs independent work on several threads, if there are any.
pub(crate) struct Threads {
    #[cfg(feature = "rayon")]
    pool: Option<rayon::ThreadPool>,
    pub count: usize,
}

impl Threads {
    fn new(wanted: usize) -> Self {
        #[cfg(feature = "rayon")]
        {
            let count = match wanted {
                0 => std::thread::available_parallelism().map_or(1, usize::from),
                n => n.min(256),
            };
            let pool = (count > 1).then(|| rayon::ThreadPoolBuilder::new().num_threads(count).build());
            let pool = pool.and_then(Result::ok);
            Self { count: if pool.is_some() { count } else { 1 }, pool }
        }
        #[cfg(not(feature = "rayon"))]
        {
            let _ = wanted;
            Self { count: 1 }
        }
    }

    /// Results in the order of the items.
    pub(crate) fn map<T: Send, R: Send>(&self, items: Vec<T>, work: impl Fn(T) -> R + Sync + Send) -> Vec<R> {
        #[cfg(feature = "rayon")]
        if let Some(pool) = &self.pool {
            use rayon::iter::{IndexedParallelIterator, IntoParallelIterator, ParallelIterator};
            return pool.install(|| items.into_par_iter().with_max_len(1).map(work).collect());
        }
        items.into_iter().map(work).collect()
    }
}
