//! Buckets become nodes: each bucket by itself, then in order across buckets.

use super::Stage;
use super::abort::Abort;
use super::partition::{Bucket, Held};
use super::writer::Writer;
use crate::PointsError;
use crate::frame::{Cell, Frame};
use crate::morton;
use crate::node::{Block, Encoder, Node, Output};
use crate::point::Point;
use crate::record::{Compact, Record, Whole, Wide, sort, unpack};
use crate::tree::{Assembler, Member, OpenList, Shape, push_sorted};
use std::collections::BTreeMap;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// What a bucket leaves to its neighbours and to the cells above.
pub(super) struct Outcome<const W: usize> {
    pub cell: Cell,
    pub representative: Member<Whole<W>>,
    /// Points for nodes above the bucket's cell.
    pub open: Vec<OpenList<Whole<W>>>,
    /// Whether a node right below those was stored.
    pub stored: bool,
    /// Nodes in the bucket's cell.
    pub block: Block,
}

/// Buffers that a thread uses again for each bucket.
pub(super) struct Worker<const W: usize> {
    frame: Frame,
    shape: Shape,
    attribute_bytes: usize,
    compact: Work<Compact<W>>,
    wide: Work<Wide<W>>,
}

struct Work<R> {
    records: Vec<R>,
    spare: Vec<R>,
    assembler: Assembler<R>,
}

impl<R: crate::record::Item> Work<R> {
    fn new(shape: Shape) -> Self {
        Self { records: Vec::new(), spare: Vec::new(), assembler: Assembler::new(shape) }
    }
}

impl<const W: usize> Worker<W> {
    pub fn new(frame: Frame, shape: Shape, attribute_bytes: usize) -> Self {
        Self { frame, shape, attribute_bytes, compact: Work::new(shape), wide: Work::new(shape) }
    }

    /// Sorts a bucket's points and builds the nodes inside its cell, into `block`.
    pub fn process(
        &mut self,
        bucket: &mut Bucket,
        held: &Held,
        block: Block,
    ) -> Result<Outcome<W>, PointsError> {
        let (frame, shape, bytes) = (self.frame, self.shape, self.attribute_bytes);
        if bucket.compact {
            self.compact.run(bucket, held, frame, shape, bytes, block)
        } else {
            self.wide.run(bucket, held, frame, shape, bytes, block)
        }
    }
}

impl<R> Work<R> {
    fn run<const W: usize>(
        &mut self,
        bucket: &mut Bucket,
        held: &Held,
        frame: Frame,
        shape: Shape,
        attribute_bytes: usize,
        mut block: Block,
    ) -> Result<Outcome<W>, PointsError>
    where
        R: Record<W>,
    {
        let cell = bucket.cell;
        bucket.read(held, &mut self.records)?;
        sort(&mut self.records, &mut self.spare, shape.bits - cell.level);
        let decode = |record: &R| {
            let (inside, min) = (record.local(), cell.min);
            let local = [0, 1, 2].map(|k| min[k] + inside[k]);
            Point::new(frame.global(local), unpack(record.rgb()))
        };
        let whole = |record: &R| Whole { point: decode(record), attributes: record.attributes() };
        let attributes = R::attributes;
        let Block { payload, nodes, counts } = &mut block;
        let mut encoder =
            Encoder { output: payload, nodes, counts, frame, attribute_bytes, decode, attributes };
        push_sorted(&mut self.assembler, shape, &self.records, cell.level, &mut encoder);
        let representative = self.assembler.representative().expect("a bucket has a point");
        // The root waits for its own representative, even where the bucket is everything.
        let above = (cell.level as usize).max(1);
        self.assembler.close_nodes(above, &mut encoder);
        let (open, stored) = self.assembler.take_open(above, whole);
        let Member { item, sums, count } = representative;
        let representative = Member { item: whole(&item), sums, count };
        Ok(Outcome { cell, representative, open, stored, block })
    }
}

/// Writes points that are whole already straight to the file.
type WholeEncoder<'a, 'w, const W: usize> =
    Encoder<'a, ToFile<'w>, fn(&Whole<W>) -> Point, fn(&Whole<W>) -> [u64; W]>;

/// Keeps the first error of a writer until someone can take it.
struct ToFile<'a> {
    writer: &'a mut Writer,
    outcome: Result<(), PointsError>,
}

impl Output for ToFile<'_> {
    fn put(&mut self, bytes: &[u8]) {
        if self.outcome.is_ok() {
            self.outcome = self.writer.write(bytes);
        }
    }
}

/// Puts buckets together in order and writes them.
struct Committer<const W: usize> {
    frame: Frame,
    attribute_bytes: usize,
    assembler: Assembler<Whole<W>>,
    before: Option<Cell>,
    writer: Writer,
    index: Index,
}

/// Nodes in the order of the file.
#[derive(Debug, Default)]
pub(super) struct Index {
    pub nodes: Vec<Node>,
    pub counts: Vec<u32>,
}

impl Index {
    fn append(&mut self, block: &Block) {
        let shift = self.counts.len();
        self.counts.extend(&block.counts);
        self.nodes.extend(block.nodes.iter().map(|node| {
            let counts = node.counts.start + shift..node.counts.end + shift;
            Node { counts, ..node.clone() }
        }));
    }
}

impl<const W: usize> Committer<W> {
    /// The next bucket in Morton order.
    fn commit(&mut self, outcome: &Outcome<W>) -> Result<(), PointsError> {
        // The level at which this cell and the one before lie in different cells.
        let division = self
            .before
            .map_or(0, |before| self.frame.bits + 1 - morton::height(before.min, outcome.cell.min));
        self.before = Some(outcome.cell);
        self.step(|assembler, encoder| assembler.push_member(division, outcome.representative, encoder))?;
        for list in &outcome.open {
            self.assembler.append(list, |&whole| whole);
        }
        if outcome.stored {
            self.assembler.note_stored_below((outcome.cell.level as usize).max(1) - 1);
        }
        self.index.append(&outcome.block);
        self.writer.write(&outcome.block.payload)
    }

    /// Lets the assembler finish nodes, and writes them.
    fn step(
        &mut self,
        work: impl FnOnce(&mut Assembler<Whole<W>>, &mut WholeEncoder<'_, '_, W>),
    ) -> Result<(), PointsError> {
        let (frame, attribute_bytes) = (self.frame, self.attribute_bytes);
        let decode: fn(&Whole<W>) -> Point = |whole| whole.point;
        let attributes: fn(&Whole<W>) -> [u64; W] = |whole| whole.attributes;
        let mut output = ToFile { writer: &mut self.writer, outcome: Ok(()) };
        let Index { nodes, counts } = &mut self.index;
        let mut encoder =
            Encoder { output: &mut output, nodes, counts, frame, attribute_bytes, decode, attributes };
        work(&mut self.assembler, &mut encoder);
        output.outcome
    }

    fn finish(mut self) -> Result<(Writer, Index), PointsError> {
        self.step(|assembler, encoder| {
            if let Some(root) = assembler.representative() {
                assembler.emit(0, root.item);
            }
            assembler.close_nodes(0, encoder);
        })?;
        Ok((self.writer, self.index))
    }
}

/// What threads share while they work on buckets.
struct Shared<const W: usize> {
    /// Buckets not yet taken, last one first.
    waiting: Vec<Bucket>,
    taken: usize,
    /// Memory given to buckets that are being worked on or wait for their turn to be written.
    granted: u64,
    /// Memory of points that wait in open nodes above the buckets.
    open: u64,
    /// Finished before their turn.
    finished: BTreeMap<usize, (Outcome<W>, u64)>,
    /// The next one to write. Taken out while someone writes.
    committer: Option<Committer<W>>,
    committed: usize,
    blocks: Vec<Block>,
}

/// The stage's memory and threads.
#[derive(Clone, Copy, Debug)]
pub(super) struct Means {
    pub threads: usize,
    /// Bytes for all buckets in work.
    pub memory: u64,
    /// Bytes for records that wait in memory. What they do not take any more, a single large bucket may have.
    pub resident: u64,
    /// Bytes that a point needs while its bucket is worked on, for short and for long records.
    pub point_bytes: [u64; 2],
}

/// Builds all nodes and writes them.
pub(super) fn commit<const W: usize>(
    mut buckets: Vec<Bucket>,
    frame: Frame,
    shape: Shape,
    attribute_bytes: usize,
    means: Means,
    writer: Writer,
    held: &Held,
    abort: &Abort<'_>,
) -> Result<(Writer, Index), PointsError> {
    let assembler = Assembler::new(shape);
    let index = Index::default();
    let committer = Committer { frame, attribute_bytes, assembler, before: None, writer, index };
    let total = buckets.iter().map(|b| b.points).sum();
    let count = buckets.len();
    buckets.reverse();
    let shared = Mutex::new(Shared {
        waiting: buckets,
        taken: 0,
        granted: 0,
        open: 0,
        finished: BTreeMap::new(),
        committer: Some(committer),
        committed: 0,
        blocks: Vec::new(),
    });
    let changed = Condvar::new();
    let lock = || shared.lock().unwrap_or_else(PoisonError::into_inner);
    abort.begin();
    abort.on_threads(means.threads.min(count.max(1)), || {
        let mut worker = Worker::<W>::new(frame, shape, attribute_bytes);
        // Whoever leaves, for whatever reason, wakes those who wait.
        let _wake = Wake(&changed);
        while let Some((number, mut bucket, block, bytes)) =
            next_bucket(lock(), &changed, means, held, abort)?
        {
            let outcome = worker.process(&mut bucket, held, block)?;
            abort.advance(Stage::Build, bucket.points, total)?;
            lock().finished.insert(number, (outcome, bytes));
            write_finished(&lock, &changed)?;
        }
        Ok(())
    })?;
    let shared = shared.into_inner().unwrap_or_else(PoisonError::into_inner);
    shared.committer.ok_or(PointsError::Cancelled)?.finish()
}

struct Wake<'a>(&'a Condvar);

impl Drop for Wake<'_> {
    fn drop(&mut self) {
        self.0.notify_all();
    }
}

/// A bucket with its number, a block to build into, and the memory it was granted.
type Taken = (usize, Bucket, Block, u64);

/// Waits until there is memory for the next bucket. Buckets are taken in order, so that the one everyone waits for always
/// has its memory.
fn next_bucket<const W: usize>(
    mut shared: MutexGuard<'_, Shared<W>>,
    changed: &Condvar,
    means: Means,
    held: &Held,
    abort: &Abort<'_>,
) -> Result<Option<Taken>, PointsError> {
    loop {
        abort.check()?;
        let Some(bucket) = shared.waiting.last() else { return Ok(None) };
        let needed = bucket.points * means.point_bytes[usize::from(!bucket.compact)];
        let alone = shared.granted == 0;
        let limit = means.memory + if alone { means.resident.saturating_sub(held.bytes()) } else { 0 };
        if alone && needed > limit {
            return Err(PointsError::Memory { what: "the points of one position", needed, limit });
        }
        if alone || shared.granted + shared.open + needed <= limit {
            let bucket = shared.waiting.pop().expect("just seen");
            let number = shared.taken;
            shared.taken += 1;
            shared.granted += needed;
            let block = shared.blocks.pop().unwrap_or_default();
            return Ok(Some((number, bucket, block, needed)));
        }
        shared = changed.wait_timeout(shared, POLL).unwrap_or_else(PoisonError::into_inner).0;
    }
}

/// How often a waiting thread looks whether the work has failed elsewhere.
const POLL: std::time::Duration = std::time::Duration::from_millis(100);

/// Writes what is finished and has its turn, unless another thread is at it.
fn write_finished<'a, const W: usize>(
    lock: &impl Fn() -> MutexGuard<'a, Shared<W>>,
    changed: &Condvar,
) -> Result<(), PointsError> {
    let mut shared = lock();
    let Some(mut committer) = shared.committer.take() else { return Ok(()) };
    loop {
        let number = shared.committed;
        let Some((mut outcome, bytes)) = shared.finished.remove(&number) else { break };
        drop(shared);
        let written = committer.commit(&outcome);
        let open = committer.assembler.bytes();
        outcome.block.clear();
        shared = lock();
        shared.granted -= bytes;
        shared.open = open;
        shared.committed += 1;
        // Large ones are given back to the allocator: the next large one may come much later.
        if outcome.block.payload.capacity() <= LARGE_BLOCK {
            shared.blocks.push(outcome.block);
        }
        changed.notify_all();
        if let Err(error) = written {
            shared.committer = None;
            return Err(error);
        }
    }
    shared.committer = Some(committer);
    Ok(())
}

const LARGE_BLOCK: usize = 1 << 20;
