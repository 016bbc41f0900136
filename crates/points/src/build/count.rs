//! The first reading: the true box, and how many points lie where.

use super::Stage;
use super::abort::Abort;
use super::source::Blocks;
use crate::PointsError;
use crate::frame::Frame;
use crate::layout::Layout;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Finest level of the histogram: 128 cells along each axis.
pub(super) const FINEST: u32 = 7;

/// What the first reading found.
#[derive(Debug)]
pub(super) struct Counted {
    pub frame: Frame,
    /// Greatest coordinates.
    pub hi: [i32; 3],
    /// Points per cell of a level, x fastest.
    pub histogram: Vec<u32>,
    pub level: u32,
    /// Low bits that 16-bit colours lose, per part.
    pub shifts: Vec<u32>,
}

/// Level of the histogram for a number of points.
pub(super) fn histogram_level(points: u64, bits: u32) -> u32 {
    let useful = (64 - points.leading_zeros()).div_ceil(3) + 1;
    FINEST.min(bits).min(useful)
}

/// Index of the cell of a histogram.
#[inline]
pub(super) fn cell_index(local: [u32; 3], below: u32, level: u32) -> usize {
    // A shift by all 32 bits happens for the whole cube only, where the index is 0.
    let cell = local.map(|v| v.checked_shr(below).unwrap_or(0) as usize);
    (cell[2] << level | cell[1]) << level | cell[0]
}

/// Box and colours of a part.
#[derive(Clone, Copy)]
struct Extent {
    lo: [i32; 3],
    hi: [i32; 3],
    colour_bits: u16,
}

const NOTHING: Extent = Extent { lo: [i32::MAX; 3], hi: [i32::MIN; 3], colour_bits: 0 };

/// Reads everything once or, where the guessed box is not the true one, twice.
pub(super) fn count(blocks: &Blocks<'_>, threads: usize, abort: &Abort<'_>) -> Result<Counted, PointsError> {
    let points = blocks.points();
    let guess = guessed(blocks);
    let (extents, histogram) = pass(blocks, guess, threads, abort)?;
    let (lo, hi) = whole_box(blocks, &extents)?;
    let frame = Frame::around(lo, hi);
    let level = histogram_level(points, frame.bits);
    let histogram = match guess {
        Some(g) if g == frame => histogram,
        _ => pass(blocks, Some(frame), threads, abort)?.1,
    };
    // Channels that never exceed 255 are taken for bytes in 16-bit clothes.
    let shifts = extents.iter().map(|e| if e.colour_bits > 255 { 8 } else { 0 }).collect();
    Ok(Counted { frame, hi, histogram, level, shifts })
}

/// The frame that the parts' own words would give.
fn guessed(blocks: &Blocks<'_>) -> Option<Frame> {
    let mut extents = Vec::with_capacity(blocks.parts.len());
    for part in &blocks.parts {
        let (lo, hi) = part.guess?;
        extents.push(Extent { lo, hi, colour_bits: 0 });
    }
    whole_box(blocks, &extents).ok().map(|(lo, hi)| Frame::around(lo, hi))
}

fn whole_box(blocks: &Blocks<'_>, extents: &[Extent]) -> Result<([i32; 3], [i32; 3]), PointsError> {
    let (mut lo, mut hi) = ([i64::MAX; 3], [i64::MIN; 3]);
    for (part, e) in blocks.parts.iter().zip(extents) {
        if e.lo[0] > e.hi[0] {
            continue;
        }
        for k in 0..3 {
            lo[k] = lo[k].min(i64::from(e.lo[k]) + part.shift[k]);
            hi[k] = hi[k].max(i64::from(e.hi[k]) + part.shift[k]);
        }
    }
    if lo[0] > hi[0] {
        return Ok(([0; 3], [0; 3]));
    }
    let narrow = |v: [i64; 3]| -> Result<[i32; 3], PointsError> {
        let mut out = [0; 3];
        for axis in 0..3 {
            out[axis] = i32::try_from(v[axis]).map_err(|_| PointsError::Range { axis, value: v[axis] })?;
        }
        Ok(out)
    };
    Ok((narrow(lo)?, narrow(hi)?))
}

/// One reading: extents of the parts, and the histogram over a frame if there is one.
fn pass(
    blocks: &Blocks<'_>,
    frame: Option<Frame>,
    threads: usize,
    abort: &Abort<'_>,
) -> Result<(Vec<Extent>, Vec<u32>), PointsError> {
    let total = blocks.points();
    let next = AtomicUsize::new(0);
    let level = frame.map_or(0, |f| histogram_level(total, f.bits));
    let merged = Mutex::new((vec![NOTHING; blocks.parts.len()], Vec::<u32>::new()));
    abort.begin();
    abort.on_threads(threads, || {
        let mut extents = vec![NOTHING; blocks.parts.len()];
        let mut histogram = vec![0u32; if frame.is_some() { 1 << (3 * level) } else { 0 }];
        let mut buffer = Vec::new();
        loop {
            let i = next.fetch_add(1, Ordering::Relaxed);
            let Some(block) = blocks.blocks.get(i) else { break };
            let part = &blocks.parts[block.part];
            let bytes = blocks.read(i, &mut buffer)?;
            let extent = &mut extents[block.part];
            let shift = part.shift.map(|s| s as i32);
            let below = frame.map_or(0, |f| f.bits - level);
            // Kept apart from the array, so that they stay in registers.
            let (mut lo, mut hi) = (extent.lo, extent.hi);
            for record in bytes.chunks_exact(part.layout.stride) {
                let p = Layout::position(record);
                for k in 0..3 {
                    lo[k] = lo[k].min(p[k]);
                    hi[k] = hi[k].max(p[k]);
                }
                if let Some(frame) = frame {
                    let local = frame.local([0, 1, 2].map(|k| p[k].wrapping_add(shift[k])));
                    // Outside a guessed frame the histogram is void anyway.
                    if let Some(count) = histogram.get_mut(cell_index(local, below, level)) {
                        *count = count.saturating_add(1);
                    }
                }
            }
            (extent.lo, extent.hi) = (lo, hi);
            if part.wide_colours && extent.colour_bits <= 255 {
                extent.colour_bits |= bytes
                    .chunks_exact(part.layout.stride)
                    .fold(0, |bits, r| bits | part.layout.colour_bits(r));
            }
            abort.advance(Stage::Count, block.points as u64, total)?;
        }
        let mut merged = merged.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        for (all, mine) in merged.0.iter_mut().zip(&extents) {
            for k in 0..3 {
                all.lo[k] = all.lo[k].min(mine.lo[k]);
                all.hi[k] = all.hi[k].max(mine.hi[k]);
            }
            all.colour_bits |= mine.colour_bits;
        }
        if merged.1.is_empty() {
            merged.1 = histogram;
        } else {
            merged.1.iter_mut().zip(&histogram).for_each(|(a, b)| *a = a.saturating_add(*b));
        }
        Ok(())
    })?;
    Ok(merged.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner))
}
