//! One sequential tree in memory, from the same parts as the nested octree: a root that holds all levels.

use super::abort::Abort;
use super::count::count;
use super::no_progress;
use super::partition::{Bucket, Held, Limits, partition, split_large};
use super::source::Blocks;
use super::thread_count;
use crate::frame::Frame;
use crate::input::Input;
use crate::morton;
use crate::point::Point;
use crate::record::{Compact, Record, Whole, Wide, sort, unpack};
use crate::tree::{Assembler, Member, Shape, Sink, push_sorted};
use crate::{Grid, PointsError};
use std::sync::Mutex;

/// All points level by level, with their number per level.
pub(crate) struct Sequential {
    pub frame: Frame,
    pub points: Vec<Point>,
    pub levels: Vec<u64>,
}

/// A single node holds everything, so that nodes are never closed.
struct NoNodes;

impl<T> Sink<T> for NoNodes {
    fn store(&mut self, _: usize, _: usize, _: &[Vec<T>]) {
        debug_assert!(false, "the only node stays open");
    }
}

/// The points of a bucket level by level, still packed.
enum Lists {
    Compact(Vec<Vec<Compact<0>>>),
    Wide(Vec<Vec<Wide<0>>>),
}

/// A bucket that was sorted into levels.
struct Sorted {
    min: [u32; 3],
    representative: Member<Whole<0>>,
    lists: Lists,
}

/// Sorts points into levels. Those that cells of the deepest level do not tell apart form one more level, if they are kept.
pub(crate) fn sequential(
    grid: Grid,
    points: &[Point],
    depth: Option<u32>,
    keep: bool,
    threads: usize,
) -> Result<Sequential, PointsError> {
    let threads = thread_count(threads);
    let abort = Abort::new(&no_progress);
    let blocks = Blocks::open(Input::from_points(grid, points), usize::MAX, None, &abort)?;
    let counted = count(&blocks, threads, &abort)?;
    let frame = counted.frame;
    let bucket_points = (points.len() as u64 / (8 * threads as u64)).max(16 << 10);
    let held = Held::default();
    let limits = Limits { threads, resident: usize::MAX, bucket_points };
    let buckets = partition::<0>(&blocks, &counted, limits, None, &held, &abort)?;
    let buckets = split_large::<0>(buckets, frame.bits, limits, None, &held, &abort)?;
    drop((blocks, counted));
    let deepest = depth.map_or(frame.bits, |d| d.min(frame.bits));
    let shape = Shape { bits: frame.bits, deepest, inner: u32::MAX, merge: 0 };
    let sorted = sort_buckets(buckets, frame, shape, threads, &held, &abort)?;
    let mut joined = Joined::new(&sorted, shape);
    if !keep {
        joined.drop_last(shape);
    }
    let points = joined.points(&sorted, frame, threads, &abort)?;
    let mut levels = joined.levels;
    levels.truncate(levels.iter().rposition(|&c| c > 0).map_or(0, |i| i + 1));
    Ok(Sequential { frame, points, levels })
}

/// Sorts all buckets on all threads; the result is in Morton order.
fn sort_buckets(
    mut buckets: Vec<Bucket>,
    frame: Frame,
    shape: Shape,
    threads: usize,
    held: &Held,
    abort: &Abort<'_>,
) -> Result<Vec<Sorted>, PointsError> {
    buckets.reverse();
    let waiting = Mutex::new(buckets);
    let done: Mutex<Vec<(usize, Sorted)>> = Mutex::new(Vec::new());
    let lock = |m: &'_ Mutex<Vec<Bucket>>| {
        let mut waiting = m.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        waiting.pop().map(|b| (waiting.len(), b))
    };
    abort.on_threads(threads, || {
        let (mut compact, mut wide) = ((Vec::new(), Vec::new()), (Vec::new(), Vec::new()));
        while let Some((left, mut bucket)) = lock(&waiting) {
            let sorted = if bucket.compact {
                let (representative, lists) = levels(&mut bucket, frame, shape, held, &mut compact)?;
                Sorted { min: bucket.cell.min, representative, lists: Lists::Compact(lists) }
            } else {
                let (representative, lists) = levels(&mut bucket, frame, shape, held, &mut wide)?;
                Sorted { min: bucket.cell.min, representative, lists: Lists::Wide(lists) }
            };
            done.lock().unwrap_or_else(std::sync::PoisonError::into_inner).push((left, sorted));
            abort.check()?;
        }
        Ok(())
    })?;
    let mut done = done.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    done.sort_unstable_by_key(|(left, _)| std::cmp::Reverse(*left));
    Ok(done.into_iter().map(|(_, sorted)| sorted).collect())
}

fn decode<R: Record<0>>(record: &R, min: [u32; 3], frame: Frame) -> Whole<0> {
    let inside = record.local();
    let local = [0, 1, 2].map(|k| min[k] + inside[k]);
    Whole { point: Point::new(frame.global(local), unpack(record.rgb())), attributes: [] }
}

/// A bucket's representative, and its other points by level.
type Levels<R> = (Member<Whole<0>>, Vec<Vec<R>>);

fn levels<R: Record<0>>(
    bucket: &mut Bucket,
    frame: Frame,
    shape: Shape,
    held: &Held,
    (records, spare): &mut (Vec<R>, Vec<R>),
) -> Result<Levels<R>, PointsError> {
    bucket.read(held, records)?;
    sort(records, spare, shape.bits - bucket.cell.level);
    let mut assembler = Assembler::new(shape);
    push_sorted(&mut assembler, shape, records, bucket.cell.level, &mut NoNodes);
    let Member { item, sums, count } = assembler.representative().expect("a bucket has a point");
    let representative = Member { item: decode(&item, bucket.cell.min, frame), sums, count };
    Ok((representative, assembler.take_root()))
}

/// Where every bucket's points of every level go.
struct Joined {
    /// Points that were told apart across buckets, by level.
    across: Vec<Vec<Whole<0>>>,
    /// For each bucket and level, how many of those come before.
    before: Vec<Vec<usize>>,
    levels: Vec<u64>,
}

impl Joined {
    fn new(sorted: &[Sorted], shape: Shape) -> Self {
        let mut assembler = Assembler::new(shape);
        let mut before = Vec::with_capacity(sorted.len());
        let mut last = None;
        for bucket in sorted {
            let division = last.map_or(0, |last| shape.division(morton::height(last, bucket.min)));
            last = Some(bucket.min);
            assembler.push_member(division, bucket.representative, &mut NoNodes);
            before.push(assembler.root().iter().map(Vec::len).collect());
        }
        if let Some(root) = assembler.representative() {
            assembler.emit(0, root.item);
        }
        let across = assembler.take_root();
        let mut levels: Vec<u64> = across.iter().map(|l| l.len() as u64).collect();
        for bucket in sorted {
            levels.iter_mut().enumerate().for_each(|(level, n)| *n += bucket.len(level) as u64);
        }
        Self { across, before, levels }
    }

    /// Leaves out what the deepest level does not tell apart.
    fn drop_last(&mut self, shape: Shape) {
        self.levels.truncate(shape.deepest as usize + 1);
    }

    /// Unpacks everything to its place.
    fn points(
        &self,
        sorted: &[Sorted],
        frame: Frame,
        threads: usize,
        abort: &Abort<'_>,
    ) -> Result<Vec<Point>, PointsError> {
        let total: u64 = self.levels.iter().sum();
        let mut points = vec![Point::default(); total as usize];
        let mut jobs: Vec<Vec<(usize, &mut [Point])>> = sorted.iter().map(|_| Vec::new()).collect();
        let mut rest = &mut points[..];
        for level in 0..self.levels.len() {
            let across = &self.across[level];
            let mut copied = 0;
            for (b, bucket) in sorted.iter().enumerate() {
                let end = self.before[b][level];
                copy(&across[copied..end], &mut rest);
                copied = end;
                let slice = take(&mut rest, bucket.len(level));
                if !slice.is_empty() {
                    jobs[b].push((level, slice));
                }
            }
            copy(&across[copied..], &mut rest);
        }
        let jobs = Mutex::new(jobs.into_iter().zip(sorted).collect::<Vec<_>>());
        abort.on_threads(threads, || {
            let next = || jobs.lock().unwrap_or_else(std::sync::PoisonError::into_inner).pop();
            while let Some((slices, bucket)) = next() {
                for (level, slice) in slices {
                    bucket.unpack(level, frame, slice);
                }
            }
            Ok(())
        })?;
        Ok(points)
    }
}

/// Cuts the first elements off.
fn take<'a>(rest: &mut &'a mut [Point], count: usize) -> &'a mut [Point] {
    let (now, later) = std::mem::take(rest).split_at_mut(count);
    *rest = later;
    now
}

fn copy(from: &[Whole<0>], rest: &mut &mut [Point]) {
    take(rest, from.len()).iter_mut().zip(from).for_each(|(to, whole)| *to = whole.point);
}

impl Sorted {
    fn len(&self, level: usize) -> usize {
        match &self.lists {
            Lists::Compact(lists) => lists.get(level).map_or(0, Vec::len),
            Lists::Wide(lists) => lists.get(level).map_or(0, Vec::len),
        }
    }

    fn unpack(&self, level: usize, frame: Frame, into: &mut [Point]) {
        fn all<R: Record<0>>(list: &[R], min: [u32; 3], frame: Frame, into: &mut [Point]) {
            into.iter_mut().zip(list).for_each(|(to, r)| *to = decode(r, min, frame).point);
        }
        match &self.lists {
            Lists::Compact(lists) => all(&lists[level], self.min, frame, into),
            Lists::Wide(lists) => all(&lists[level], self.min, frame, into),
        }
    }
}
