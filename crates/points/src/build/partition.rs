//! The second reading: every point to the bucket of its cell, as a record ready to be sorted.
//!
//! Each thread fills chunks of its own, so that nothing is shared but a count of the memory held. Beyond the limit a thread
//! writes its fullest buckets to a file of its own.

use super::Stage;
use super::abort::Abort;
use super::count::{Counted, cell_index, histogram_level};
use super::cut::{Cut, Wish, index_of_code};
use super::source::Blocks;
use super::temp::Scratch;
use crate::PointsError;
use crate::frame::Cell;
use crate::layout::Layout;
use crate::record::{COMPACT_BITS, Compact, Record, Wide};
use farsight_geometry::streaming::read_exact_at;
use std::fs::File;
use std::io::Write;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

/// A cell, and its points as records relative to it.
#[derive(Debug, Default)]
pub(super) struct Bucket {
    pub cell: Cell,
    pub points: u64,
    /// Whether its records are short.
    pub compact: bool,
    pub pieces: Vec<Piece>,
}

/// Some records of a bucket.
#[derive(Debug)]
pub(super) enum Piece {
    Memory(Vec<u64>),
    Spilled { file: Arc<SpillFile>, offset: u64, words: usize },
}

/// Records on disk.
#[derive(Debug)]
pub(super) struct SpillFile {
    pub file: File,
    pub path: PathBuf,
}

/// Words, about, that are read back at once.
const PIECE_WORDS: usize = 1 << 17;

/// Words that are held in memory, by all threads.
#[derive(Debug, Default)]
pub(super) struct Held(AtomicUsize);

impl Held {
    fn words(&self) -> usize {
        self.0.load(Ordering::Relaxed)
    }

    /// The same in bytes.
    pub fn bytes(&self) -> u64 {
        8 * self.words() as u64
    }

    fn add(&self, words: usize) -> usize {
        self.0.fetch_add(words, Ordering::Relaxed) + words
    }

    fn remove(&self, words: usize) {
        self.0.fetch_sub(words, Ordering::Relaxed);
    }
}

/// Limits of a partition.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    pub threads: usize,
    /// Words that records may hold in memory.
    pub resident: usize,
    /// Most points in a bucket.
    pub bucket_points: u64,
}

impl Bucket {
    /// Moves the records out: those in memory are freed piece by piece.
    pub fn read<const W: usize, R: Record<W>>(
        &mut self,
        held: &Held,
        out: &mut Vec<R>,
    ) -> Result<(), PointsError> {
        out.clear();
        out.reserve(self.points as usize);
        let mut buffer = Vec::new();
        for piece in std::mem::take(&mut self.pieces) {
            let words = piece.words(held, &mut buffer)?;
            out.extend(words.chunks_exact(R::WORDS).map(R::from_words));
        }
        Ok(())
    }
}

impl Piece {
    /// Words in it.
    fn len(&self) -> usize {
        match self {
            Self::Memory(words) => words.len(),
            Self::Spilled { words, .. } => *words,
        }
    }

    /// Moves what is in memory to the end of a file.
    pub fn spill_to(&mut self, file: &Arc<SpillFile>, end: &mut u64, held: &Held) -> Result<(), PointsError> {
        if let Self::Memory(chunk) = self {
            (&file.file).write_all(bytemuck::cast_slice(chunk)).map_err(PointsError::io(&file.path))?;
            held.remove(chunk.capacity());
            let (offset, words) = (*end, chunk.len());
            *end += 8 * words as u64;
            *self = Self::Spilled { file: Arc::clone(file), offset, words };
        }
        Ok(())
    }

    /// The records as words. What lay in memory is the caller's from now on.
    fn words<'a>(self, held: &Held, buffer: &'a mut Vec<u64>) -> Result<&'a [u64], PointsError> {
        if let Self::Memory(words) = self {
            held.remove(words.capacity());
            *buffer = words;
            return Ok(buffer);
        }
        self.read(buffer)?;
        Ok(buffer)
    }

    /// The records as words, which the piece keeps.
    fn peek<'a>(&'a self, buffer: &'a mut Vec<u64>) -> Result<&'a [u64], PointsError> {
        if let Self::Memory(words) = self {
            return Ok(words);
        }
        self.read(buffer)?;
        Ok(buffer)
    }

    fn read(&self, buffer: &mut Vec<u64>) -> Result<(), PointsError> {
        if let Self::Spilled { file, offset, words } = self {
            buffer.resize(*words, 0);
            let bytes = bytemuck::cast_slice_mut(buffer);
            read_exact_at(&file.file, bytes, *offset).map_err(PointsError::io(&file.path))?;
        }
        Ok(())
    }
}

/// What has to be known of a bucket to send a point there.
#[derive(Clone, Copy, Debug)]
struct Target {
    compact: bool,
    /// Bits of a coordinate inside the bucket's cell, as a mask and as a number.
    mask: u32,
    below: u32,
    /// Words of a record.
    words: usize,
}

impl Target {
    fn new<const W: usize>(cell: &Cell, bits: u32) -> Self {
        let below = bits - cell.level;
        let compact = below <= COMPACT_BITS;
        let words = if compact { Compact::<W>::WORDS } else { Wide::<W>::WORDS };
        Self { compact, mask: ((1u64 << below) - 1) as u32, below, words }
    }
}

/// What one thread collects.
struct Lane<'a> {
    cut: &'a Cut,
    targets: &'a [Target],
    /// Bits below the cut's smallest buckets.
    below: u32,
    scratch: Option<&'a Scratch>,
    held: &'a Held,
    limits: Limits,
    /// Words of a chunk of short and of long records.
    chunk: [usize; 2],
    open: Vec<Vec<u64>>,
    full: Vec<Vec<Vec<u64>>>,
    spilled: Vec<Vec<Piece>>,
    free: [Vec<Vec<u64>>; 2],
    file: Option<(Arc<SpillFile>, u64)>,
}

impl<'a> Lane<'a> {
    fn new<const W: usize>(
        cut: &'a Cut,
        targets: &'a [Target],
        scratch: Option<&'a Scratch>,
        held: &'a Held,
        limits: Limits,
    ) -> Self {
        let buckets = cut.cells.len();
        // All part-filled chunks together take a quarter of the memory at most.
        let words = (limits.resident / (4 * limits.threads * buckets.max(1))).clamp(32 + 4 * W, 8192);
        let whole = |record: usize| words / record * record;
        Self {
            cut,
            targets,
            below: cut.below(),
            scratch,
            held,
            limits,
            chunk: [whole(Wide::<W>::WORDS), whole(Compact::<W>::WORDS)],
            open: vec![Vec::new(); buckets],
            full: vec![Vec::new(); buckets],
            spilled: (0..buckets).map(|_| Vec::new()).collect(),
            free: [Vec::new(), Vec::new()],
            file: None,
        }
    }

    /// The bucket of a point by its coordinates from the corner of the cell that is cut; `None` where no point was counted.
    #[inline(always)]
    fn bucket(&self, inside: [u32; 3]) -> Option<usize> {
        let bucket = self.cut.bucket_of[cell_index(inside, self.below, self.cut.level)] as usize;
        (bucket < self.targets.len()).then_some(bucket)
    }

    /// Adds a point to a bucket by its coordinates from the corner of the cell that is cut.
    #[inline(always)]
    fn push<const W: usize>(
        &mut self,
        bucket: usize,
        inside: [u32; 3],
        rgb: u32,
        attributes: [u64; W],
    ) -> Result<(), PointsError> {
        let Target { compact, mask, .. } = self.targets[bucket];
        let own = inside.map(|v| v & mask);
        let chunk = self.room::<W>(bucket, compact)?;
        if compact {
            Compact::pack(own, rgb, attributes).to_words(chunk);
        } else {
            Wide::pack(own, rgb, attributes).to_words(chunk);
        }
        Ok(())
    }

    /// Moves a record of the cell that is cut to a bucket: its key there is the lower part of what it was, so nothing is unpacked.
    #[inline(always)]
    fn push_record<const W: usize, R: Record<W>>(&mut self, bucket: usize, r: &R) -> Result<(), PointsError> {
        let Target { compact, below, .. } = self.targets[bucket];
        let key = r.key() & ((1 << (3 * below)) - 1);
        let chunk = self.room::<W>(bucket, compact)?;
        if compact {
            Compact::from_key(key, r.rgb(), r.attributes()).to_words(chunk);
        } else {
            Wide::from_key(key, r.rgb(), r.attributes()).to_words(chunk);
        }
        Ok(())
    }

    /// The open chunk of a bucket, with room for a record.
    #[inline(always)]
    fn room<const W: usize>(&mut self, bucket: usize, compact: bool) -> Result<&mut Vec<u64>, PointsError> {
        let record = if compact { Compact::<W>::WORDS } else { Wide::<W>::WORDS };
        let chunk = &self.open[bucket];
        if chunk.capacity() - chunk.len() < record {
            self.next_chunk(bucket)?;
        }
        Ok(&mut self.open[bucket])
    }

    #[cold]
    fn next_chunk(&mut self, bucket: usize) -> Result<(), PointsError> {
        let kind = usize::from(self.targets[bucket].compact);
        let words = self.chunk[kind];
        let next = self.free[kind].pop().unwrap_or_else(|| Vec::with_capacity(words));
        let before = std::mem::replace(&mut self.open[bucket], next);
        if !before.is_empty() {
            self.full[bucket].push(before);
        }
        let all = self.held.add(self.open[bucket].capacity());
        if let Some(scratch) = self.scratch.filter(|_| all > self.limits.resident) {
            self.evict(scratch)?;
        }
        Ok(())
    }

    /// Writes the fullest buckets of this thread until it holds three quarters of its share.
    fn evict(&mut self, scratch: &Scratch) -> Result<(), PointsError> {
        let share = self.limits.resident / self.limits.threads;
        let size = |chunks: &Vec<Vec<u64>>| chunks.iter().map(Vec::capacity).sum::<usize>();
        let mut order: Vec<(usize, usize)> =
            self.full.iter().enumerate().map(|(b, chunks)| (size(chunks), b)).filter(|o| o.0 > 0).collect();
        order.sort_unstable_by(|a, b| b.cmp(a));
        let mut mine: usize =
            order.iter().map(|o| o.0).sum::<usize>() + self.open.iter().map(Vec::capacity).sum::<usize>();
        for (words, bucket) in order {
            if mine <= share / 4 * 3 {
                break;
            }
            self.spill(bucket, scratch)?;
            self.held.remove(words);
            mine -= words;
        }
        Ok(())
    }

    fn spill(&mut self, bucket: usize, scratch: &Scratch) -> Result<(), PointsError> {
        if self.file.is_none() {
            self.file = Some(spill_file(scratch)?);
        }
        let (file, end) = self.file.as_mut().expect("just made");
        let mut pieces = Vec::new();
        // Chunks are small; they go to the disk together.
        let mut together: Vec<u64> = Vec::with_capacity(PIECE_WORDS);
        let mut write = |together: &mut Vec<u64>| {
            if !together.is_empty() {
                (&file.file)
                    .write_all(bytemuck::cast_slice(together))
                    .map_err(PointsError::io(&file.path))?;
                let (file, offset, words) = (Arc::clone(file), *end, together.len());
                pieces.push(Piece::Spilled { file, offset, words });
                *end += 8 * words as u64;
                together.clear();
            }
            Ok::<(), PointsError>(())
        };
        // The list goes with its chunks: in a scan every bucket is the fullest once, and all their lists would not be small.
        for mut chunk in std::mem::take(&mut self.full[bucket]) {
            if together.len() + chunk.len() > PIECE_WORDS {
                write(&mut together)?;
            }
            together.extend_from_slice(&chunk);
            chunk.clear();
            // A few are kept for the next chunks; the allocator has the rest.
            let free = &mut self.free[usize::from(self.targets[bucket].compact)];
            if free.len() < 16 {
                free.push(chunk);
            }
        }
        write(&mut together)?;
        self.spilled[bucket].extend(pieces);
        Ok(())
    }

    /// Hands everything over.
    fn finish(self, buckets: &Mutex<Vec<Bucket>>) {
        let mut buckets = buckets.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let parts = self.open.into_iter().zip(self.full).zip(self.spilled).zip(self.targets);
        for (bucket, (((open, full), spilled), target)) in buckets.iter_mut().zip(parts) {
            let before = bucket.pieces.len();
            bucket.pieces.extend(spilled);
            bucket.pieces.extend(full.into_iter().map(Piece::Memory));
            bucket.pieces.extend((!open.is_empty()).then_some(Piece::Memory(open)));
            let words: usize = bucket.pieces[before..].iter().map(Piece::len).sum();
            bucket.points += (words / target.words) as u64;
        }
    }
}

/// A new spill file, and where it ends.
fn spill_file(scratch: &Scratch) -> Result<(Arc<SpillFile>, u64), PointsError> {
    let (file, path) = scratch.create(&free_name(scratch))?;
    Ok((Arc::new(SpillFile { file, path }), 0))
}

/// A name for a spill file that is not taken, not even by an earlier process.
fn free_name(scratch: &Scratch) -> String {
    static NUMBER: AtomicUsize = AtomicUsize::new(0);
    loop {
        let name = format!("spill-{}", NUMBER.fetch_add(1, Ordering::Relaxed));
        if !scratch.path(&name).exists() {
            return name;
        }
    }
}

/// Distributes all points of the input. Without scratch files everything stays in memory.
pub(super) fn partition<const W: usize>(
    blocks: &Blocks<'_>,
    counted: &Counted,
    limits: Limits,
    scratch: Option<&Scratch>,
    held: &Held,
    abort: &Abort<'_>,
) -> Result<Vec<Bucket>, PointsError> {
    let (frame, total) = (counted.frame, blocks.points());
    let cut =
        Cut::new(Cell::default(), frame.bits, &counted.histogram, counted.level, wish(frame.bits, limits));
    let next = AtomicUsize::new(0);
    let buckets = distribute::<W>(&cut, limits, scratch, held, abort, |lane| {
        let i = next.fetch_add(1, Ordering::Relaxed);
        let Some(block) = blocks.blocks.get(i) else { return Ok(false) };
        let (part, colour_shift) = (&blocks.parts[block.part], counted.shifts[block.part]);
        let shift = part.shift.map(|s| s as i32);
        let mut buffer = Vec::new();
        for record in blocks.read(i, &mut buffer)?.chunks_exact(part.layout.stride) {
            let p = Layout::position(record);
            let local = frame.local([0, 1, 2].map(|k| p[k].wrapping_add(shift[k])));
            if frame.bits < 32 && (local[0] | local[1] | local[2]) >> frame.bits != 0 {
                return Err(changed(&part.name));
            }
            let bucket = lane.bucket(local).ok_or_else(|| changed(&part.name))?;
            let (rgb, attributes) = (part.layout.rgb(record, colour_shift), part.layout.words::<W>(record));
            lane.push(bucket, local, rgb, attributes)?;
        }
        abort.advance(Stage::Partition, block.points as u64, total)?;
        Ok(true)
    })?;
    Ok(buckets)
}

/// A point that was not there when the box was taken.
fn changed(path: &std::path::Path) -> PointsError {
    PointsError::Input { path: path.to_owned(), problem: "changed while it was read".into() }
}

fn wish(bits: u32, limits: Limits) -> Wish {
    Wish { points: limits.bucket_points, short_from: bits.saturating_sub(COMPACT_BITS) }
}

/// Lets threads fill lanes until `work` says that there is no more.
fn distribute<const W: usize>(
    cut: &Cut,
    limits: Limits,
    scratch: Option<&Scratch>,
    held: &Held,
    abort: &Abort<'_>,
    work: impl Fn(&mut Lane<'_>) -> Result<bool, PointsError> + Sync,
) -> Result<Vec<Bucket>, PointsError> {
    let targets: Vec<Target> = cut.cells.iter().map(|c| Target::new::<W>(c, cut.bits)).collect();
    let empty = |(&cell, t): (&Cell, &Target)| Bucket { cell, compact: t.compact, ..Bucket::default() };
    let buckets = Mutex::new(cut.cells.iter().zip(&targets).map(empty).collect());
    abort.begin();
    abort.on_threads(limits.threads, || {
        let mut lane = Lane::new::<W>(cut, &targets, scratch, held, limits);
        while work(&mut lane)? {}
        lane.finish(&buckets);
        Ok(())
    })?;
    Ok(buckets.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner))
}

/// Cuts buckets again that hold too much, until they do not or are a single position.
pub(super) fn split_large<const W: usize>(
    mut buckets: Vec<Bucket>,
    bits: u32,
    limits: Limits,
    scratch: Option<&Scratch>,
    held: &Held,
    abort: &Abort<'_>,
) -> Result<Vec<Bucket>, PointsError> {
    let mut done = Vec::with_capacity(buckets.len());
    let mut overflow = None;
    buckets.reverse();
    while let Some(bucket) = buckets.pop() {
        if bucket.points <= limits.bucket_points || bucket.cell.level == bits {
            done.push(bucket);
            continue;
        }
        let mut parts = split::<W>(bucket, bits, limits, scratch, held, abort)?;
        // Lanes end with each split, and what they hand over is nobody's to evict any more.
        if let Some(scratch) = scratch.filter(|_| held.words() > limits.resident) {
            let (file, end) = match &mut overflow {
                Some(file) => file,
                none => none.insert(spill_file(scratch)?),
            };
            let mut pieces = parts.iter_mut().flat_map(|p| &mut p.pieces);
            pieces.try_for_each(|piece| piece.spill_to(file, end, held))?;
        }
        buckets.extend(parts.into_iter().rev());
    }
    Ok(done)
}

fn split<const W: usize>(
    bucket: Bucket,
    bits: u32,
    limits: Limits,
    scratch: Option<&Scratch>,
    held: &Held,
    abort: &Abort<'_>,
) -> Result<Vec<Bucket>, PointsError> {
    if bucket.compact {
        split_records::<W, Compact<W>>(bucket, bits, limits, scratch, held, abort)
    } else {
        split_records::<W, Wide<W>>(bucket, bits, limits, scratch, held, abort)
    }
}

/// Counts and moves by keys alone, whose upper bits are the codes of cells.
fn split_records<const W: usize, R: Record<W>>(
    mut bucket: Bucket,
    bits: u32,
    limits: Limits,
    scratch: Option<&Scratch>,
    held: &Held,
    abort: &Abort<'_>,
) -> Result<Vec<Bucket>, PointsError> {
    let base = bucket.cell;
    let level = histogram_level(bucket.points, bits - base.level);
    let below = bits - base.level - level;
    let histogram = Mutex::new(vec![0u32; 1 << (3 * level)]);
    // Pieces are looked at once to count and once to move; only the second time they are given up.
    let next = AtomicUsize::new(0);
    abort.on_threads(limits.threads, || {
        let mut mine = vec![0u32; 1 << (3 * level)];
        let mut buffer = Vec::new();
        while let Some(piece) = bucket.pieces.get(next.fetch_add(1, Ordering::Relaxed)) {
            for words in piece.peek(&mut buffer)?.chunks_exact(R::WORDS) {
                let count = &mut mine[R::from_words(words).key_bits(3 * below) as usize];
                *count = count.saturating_add(1);
            }
            abort.check()?;
        }
        let mut all = histogram.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        for (code, &count) in mine.iter().enumerate().filter(|(_, count)| **count > 0) {
            let cell = &mut all[index_of_code(code, level)];
            *cell = cell.saturating_add(count);
        }
        Ok(())
    })?;
    let histogram = histogram.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    let cut = Cut::new(base, bits, &histogram, level, wish(bits, limits));
    let (bucket_of, shift) = (cut.bucket_of_code(), 3 * cut.below());
    let pieces = Mutex::new(std::mem::take(&mut bucket.pieces));
    distribute::<W>(&cut, limits, scratch, held, abort, |lane| {
        let piece = pieces.lock().unwrap_or_else(std::sync::PoisonError::into_inner).pop();
        let Some(piece) = piece else { return Ok(false) };
        let mut buffer = Vec::new();
        for words in piece.words(held, &mut buffer)?.chunks_exact(R::WORDS) {
            let record = R::from_words(words);
            lane.push_record::<W, R>(bucket_of[record.key_bits(shift) as usize] as usize, &record)?;
        }
        abort.check()?;
        Ok(true)
    })
}
