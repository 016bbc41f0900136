//! From points to a finished nested octree on disk.

mod abort;
mod commit;
mod count;
mod cut;
mod in_core;
mod partition;
mod resume;
mod source;
mod temp;
mod writer;

pub(crate) use in_core::sequential;

use crate::PointsError;
use crate::frame::Frame;
use crate::input::{Input, Source};
use crate::store::{self, Head};
use crate::tree::Shape;
use abort::Abort;
use commit::{Index, Means};
use farsight_geometry::Cost;
use farsight_geometry::streaming::{folder_of, sync_folder};
use partition::{Bucket, Held, Limits};
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;
use temp::Scratch;
use writer::{WRITER_BYTES, Writer};

/// How a nested octree is built. Neither threads nor memory change a byte of the result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct BuildOptions {
    /// Threads; 0 for as many as there are processors.
    pub threads: usize,
    /// Most memory in bytes that the process should take, at least 64 MiB. What does not fit goes to disk in between.
    pub memory: u64,
    /// Levels that a node adds below its cell (D): 1 to 12. A node of outer level k shows cells of 2⁻⁽ᵏ⁺ᴰ⁾ of the cube.
    pub inner_depth: u32,
    /// Nodes with fewer points, and nothing below, join their parent.
    pub merge_below: usize,
    /// Writes everything that was read and distributed to scratch files, so that the next build of the same files to the same
    /// output goes on from there if this one is killed. Has no effect on arrays and readers, which cannot be recognised.
    pub resume: bool,
}

impl Default for BuildOptions {
    /// All processors, 512 MiB, depth 7, 500 points, no resuming.
    fn default() -> Self {
        Self { threads: 0, memory: 512 << 20, inner_depth: 7, merge_below: 500, resume: false }
    }
}

/// What a build is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Stage {
    /// Reading what can be read only once.
    Read,
    /// Taking the box and counting where points lie.
    Count,
    /// Sending points to the buckets of their cells.
    Partition,
    /// Sorting buckets and writing nodes.
    Build,
}

/// How far a build is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Progress {
    /// The stage.
    pub stage: Stage,
    /// Points that the stage has dealt with.
    pub done: u64,
    /// Points that it has to deal with; 0 when not known.
    pub total: u64,
}

/// What was built.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct BuildReport {
    /// Points stored: all that came in.
    pub points: u64,
    /// Nodes of the outer octree.
    pub nodes: u64,
    /// Points per level, from the one point of level 0 on.
    pub levels: Vec<u64>,
    /// Bytes of points and attributes.
    pub payload_bytes: u64,
    /// Bytes of everything else in the file.
    pub structure_bytes: u64,
    /// Time; bytes of the file; counters `points`, `nodes`, `buckets`, and `resumed`: 1 when what a killed
    /// build had distributed was used.
    pub cost: Cost,
}

/// Lets a build run to its end in silence.
pub fn no_progress(_: Progress) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// Builds the nested octree of some points and writes it to one file.
///
/// The file appears under its name only when it is complete and on the disk; until then an older one stays. Scratch files lie
/// beside it, and are removed when the build ends in any way; those of a killed process by the next build of the
/// same file. `progress` is called from all threads, and may cancel.
///
/// # Accuracy
/// Every point is stored once, with the integers that it came with. The result is the same, byte for byte, for any number of
/// threads, any memory limit and any order of the points.
///
/// # Cost
/// Two readings of files, one of readers; see the book for seconds and bytes. Memory stays below
/// [`BuildOptions::memory`].
///
/// # Errors
/// Anything in [`PointsError`].
///
/// # References
/// Wimmer 2007, section 6.5.2. Differs: levels belong to the whole set, so that no cell is shown by two nodes; sorted, not inserted
/// point by point.
///
/// ```
/// use farsight_points::{BuildOptions, Grid, Input, Point, Store, build, glam::DVec3, no_progress};
///
/// let points: Vec<Point> = (0..10_000).map(|i| Point::new([i * 7 % 1000, i * 13 % 997, i % 10], [i as u8; 3])).collect();
/// let path = std::env::temp_dir().join(format!("doc-{}.points", std::process::id()));
/// let input = Input::from_points(Grid::new(DVec3::splat(0.01), DVec3::ZERO)?, &points);
/// let report = build(input, &path, &BuildOptions::default(), &no_progress)?;
/// assert_eq!(report.points, 10_000);
/// assert_eq!(Store::open(&path)?.octree().points(), 10_000);
/// # std::fs::remove_file(path).unwrap();
/// # Ok::<(), farsight_points::PointsError>(())
/// ```
pub fn build(
    input: Input<'_>,
    out: impl AsRef<Path>,
    options: &BuildOptions,
    progress: &(dyn Fn(Progress) -> ControlFlow<()> + Sync),
) -> Result<BuildReport, PointsError> {
    options.check()?;
    for part in &input.parts {
        part.layout.check()?;
    }
    // Attributes travel in whole words.
    let run = match input.attribute_bytes().div_ceil(8) {
        0 => run::<0>,
        1 => run::<1>,
        2 | 3 => run::<3>,
        _ => run::<8>,
    };
    run(input, out.as_ref(), options, progress)
}

/// Least memory to work with.
const LEAST_MEMORY: u64 = 64 << 20;

impl BuildOptions {
    fn check(&self) -> Result<(), PointsError> {
        let bad = |option, value: f64, range| Err(PointsError::Option { option, value, range });
        if !(1..=12).contains(&self.inner_depth) {
            return bad("inner_depth", f64::from(self.inner_depth), "1 to 12");
        }
        if self.memory < LEAST_MEMORY {
            return bad("memory", self.memory as f64, "at least 64 MiB");
        }
        Ok(())
    }

    fn thread_count(&self) -> usize {
        thread_count(self.threads)
    }

    /// Splits the memory among the stages.
    fn plan(&self, words: usize, points: u64, staged: bool) -> Plan {
        let threads = self.thread_count() as u64;
        // The program itself, the writer's blocks, histograms and read buffers.
        let fixed = (20 << 20) + WRITER_BYTES as u64 + (16 << 20) + threads * (12 << 20);
        let free = self.memory.saturating_sub(fixed).max(LEAST_MEMORY / 4);
        // Records in memory and buckets in work have a third each; the last one is for what no account knows.
        let share = free / 3;
        let extra = 8 * words as u64;
        let point_bytes = [56 + 5 * extra, 96 + 5 * extra];
        // Several buckets per thread, for balance, but none so small that its overhead shows.
        let balanced = (points / (8 * threads)).max(16 << 10);
        let bucket_points = (share / (3 * threads * point_bytes[1])).clamp(1, balanced);
        Plan {
            staged: if staged { share / 2 } else { 0 } as usize,
            limits: Limits {
                threads: threads as usize,
                resident: (if staged { share / 2 } else { share } / 8) as usize,
                bucket_points,
            },
            means: Means { threads: threads as usize, memory: share, resident: share, point_bytes },
        }
    }
}

/// A number of threads; 0 stands for as many as there are processors.
fn thread_count(wanted: usize) -> usize {
    match wanted {
        0 => std::thread::available_parallelism().map_or(1, usize::from),
        n => n.min(256),
    }
}

struct Plan {
    /// Bytes of input that may be staged in memory.
    staged: usize,
    limits: Limits,
    means: Means,
}

fn run<const W: usize>(
    input: Input<'_>,
    out: &Path,
    options: &BuildOptions,
    progress: &(dyn Fn(Progress) -> ControlFlow<()> + Sync),
) -> Result<BuildReport, PointsError> {
    let start = Instant::now();
    let (grid, attributes, rounding) = (*input.grid(), input.attributes().to_owned(), input.rounding().value);
    let attribute_bytes = input.attribute_bytes();
    let staged = input.parts.iter().any(|p| matches!(p.source, Source::Reader(_) | Source::Raw(_)));
    let abort = Abort::new(progress);
    let identity = if options.resume { resume::identity(&input) } else { None };
    let (mut scratch, adopted) =
        Scratch::new(out, |folder| identity.is_some_and(|i| resume::is_saved(folder, i)))?;
    let saved = if adopted { resume::load(&scratch) } else { None };
    if adopted && saved.is_none() {
        // Something is missing that the manifest names: all is done anew.
        drop(scratch);
        scratch = Scratch::new(out, |_| false)?.0;
    }
    let held = Held::default();
    let resumed = saved.is_some();
    let Distributed { frame, hi, buckets } = match saved {
        Some(saved) => saved,
        None => distribute::<W>(input, options, staged, identity, &scratch, &held, &abort)?,
    };
    // What a killed build had begun to write.
    let _ = std::fs::remove_file(scratch.path("points"));
    let plan = options.plan(W, buckets.iter().map(|b| b.points).sum(), staged);
    // Resumed with less memory than before, buckets may be too large.
    let buckets =
        partition::split_large::<W>(buckets, frame.bits, plan.limits, Some(&scratch), &held, &abort)?;
    let shape = Shape {
        bits: frame.bits,
        deepest: frame.bits,
        inner: options.inner_depth,
        merge: options.merge_below,
    };
    let path = scratch.path("points");
    let mut writer = Writer::create(&path)?;
    writer.write(store::MAGIC)?;
    let bucket_count = buckets.len() as u64;
    let (mut writer, index) =
        commit::commit::<W>(buckets, frame, shape, attribute_bytes, plan.means, writer, &held, &abort)?;
    let head = Head { grid, frame, hi, inner: options.inner_depth, attribute_bytes, attributes, rounding };
    let payload_bytes = writer.length() - store::MAGIC.len() as u64;
    writer.write(&store::tail(&head, &index.nodes, &index.counts, writer.length()))?;
    let length = writer.length();
    writer.finish()?;
    std::fs::rename(&path, out).map_err(PointsError::io(out))?;
    sync_folder(folder_of(out)).map_err(PointsError::io(folder_of(out)))?;
    Ok(report(&index, frame.bits, payload_bytes, length, bucket_count, resumed, start))
}

/// All points in the buckets of their cells.
struct Distributed {
    frame: Frame,
    hi: [i32; 3],
    buckets: Vec<Bucket>,
}

/// Reads the input; with an identity, keeps the result for a later build.
fn distribute<const W: usize>(
    input: Input<'_>,
    options: &BuildOptions,
    staged: bool,
    identity: Option<u64>,
    scratch: &Scratch,
    held: &Held,
    abort: &Abort<'_>,
) -> Result<Distributed, PointsError> {
    let staging = options.plan(W, 0, staged).staged;
    let blocks = source::Blocks::open(input, staging, Some(scratch), abort)?;
    let limits = options.plan(W, blocks.points(), staged).limits;
    let counted = count::count(&blocks, limits.threads, abort)?;
    let (frame, hi) = (counted.frame, counted.hi);
    let mut buckets = partition::partition::<W>(&blocks, &counted, limits, Some(scratch), held, abort)?;
    if let Some(identity) = identity {
        resume::save(&mut buckets, frame, hi, identity, scratch, held)?;
    }
    Ok(Distributed { frame, hi, buckets })
}

fn report(
    index: &Index,
    bits: u32,
    payload_bytes: u64,
    length: u64,
    buckets: u64,
    resumed: bool,
    start: Instant,
) -> BuildReport {
    let mut levels = vec![0u64; bits as usize + 2];
    for node in &index.nodes {
        for (i, &count) in index.counts[node.counts.clone()].iter().enumerate() {
            levels[node.first as usize + i] += u64::from(count);
        }
    }
    levels.truncate(levels.iter().rposition(|&c| c > 0).map_or(0, |i| i + 1));
    let points = levels.iter().sum();
    let mut cost = Cost { time: start.elapsed(), bytes: length, ..Cost::default() };
    cost.counters.add("points", points);
    cost.counters.add("nodes", index.nodes.len() as u64);
    cost.counters.add("buckets", buckets);
    cost.counters.add("resumed", resumed.into());
    BuildReport {
        points,
        nodes: index.nodes.len() as u64,
        levels,
        payload_bytes,
        structure_bytes: length - payload_bytes,
        cost,
    }
}
