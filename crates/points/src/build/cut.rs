//! Which cells become buckets: an octree over the histogram, split from the top while a cell holds too much.

use super::count::cell_index;
use crate::frame::Cell;
use crate::morton;

/// More buckets than this would leave their memory in part-filled chunks.
pub(super) const MOST_BUCKETS: usize = 4096;

/// What a cut should look like.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wish {
    /// Most points in a bucket, where the histogram is fine enough.
    pub points: u64,
    /// Level from which on records are short; reached wherever that takes no more than [`MOST_BUCKETS`].
    pub short_from: u32,
}

/// Cells that cover all points, in Morton order, and the way from a point to its bucket.
#[derive(Debug)]
pub(super) struct Cut {
    pub cells: Vec<Cell>,
    /// Bucket of each cell of `level`.
    pub bucket_of: Vec<u32>,
    /// Level below `base` of the smallest buckets: no finer than that, since points in no order look up a small table several times
    /// as fast as one of the histogram's size.
    pub level: u32,
    /// Cell that was cut.
    pub base: Cell,
    pub bits: u32,
}

impl Cut {
    /// Cuts a cell by a histogram of `level` levels below it.
    pub fn new(base: Cell, bits: u32, histogram: &[u32], level: u32, wish: Wish) -> Self {
        let pyramid = pyramid(histogram, level);
        let short = wish.short_from.saturating_sub(base.level).min(level);
        let occupied = |l: u32| pyramid[l as usize].iter().filter(|&&c| c > 0).count();
        let least =
            if occupied(short) <= MOST_BUCKETS && base.level + short >= wish.short_from { short } else { 0 };
        let mut taken = Vec::new();
        let mut open = vec![(0u32, 0usize)];
        while let Some((l, code)) = open.pop() {
            let count = pyramid[l as usize][code];
            if count == 0 {
                continue;
            }
            if l < level && (l < least || count > wish.points) {
                // The last one pushed is the next one taken.
                open.extend((0..8).rev().map(|octant| (l + 1, code << 3 | octant)));
            } else {
                taken.push((l, code));
            }
        }
        let level = taken.iter().map(|t| t.0).max().unwrap_or(0);
        let mut cut =
            Self { cells: Vec::new(), bucket_of: vec![u32::MAX; 1 << (3 * level)], level, base, bits };
        taken.into_iter().for_each(|(l, code)| cut.add(l, code));
        cut
    }

    fn add(&mut self, l: u32, code: usize) {
        let bucket = self.cells.len() as u32;
        let below = self.level - l;
        let first = code << (3 * below);
        for fine in first..first + (1 << (3 * below)) {
            self.bucket_of[index_of_code(fine, self.level)] = bucket;
        }
        let edge = self.bits - self.base.level - l;
        let corner = morton::coordinates39(code as u64);
        let min = [0, 1, 2].map(|k| self.base.min[k] + corner[k].checked_shl(edge).unwrap_or(0));
        self.cells.push(Cell { min, level: self.base.level + l });
    }

    /// Bucket of each cell of `level` by its Morton code.
    pub fn bucket_of_code(&self) -> Vec<u32> {
        (0..self.bucket_of.len()).map(|code| self.bucket_of[index_of_code(code, self.level)]).collect()
    }

    /// Bits below a cell of `level`.
    #[inline]
    pub fn below(&self) -> u32 {
        self.bits - self.base.level - self.level
    }
}

/// Index of the cell of a histogram with a Morton code.
pub(super) fn index_of_code(code: usize, level: u32) -> usize {
    cell_index(morton::coordinates39(code as u64), 0, level)
}

/// Counts of all levels, in Morton order.
fn pyramid(histogram: &[u32], level: u32) -> Vec<Vec<u64>> {
    let finest = (0..histogram.len())
        .map(|code| u64::from(histogram[index_of_code(code, level)]))
        .collect::<Vec<u64>>();
    let mut levels = vec![finest];
    for _ in 0..level {
        let coarser = levels[levels.len() - 1].chunks_exact(8).map(|c| c.iter().sum()).collect();
        levels.push(coarser);
    }
    levels.reverse();
    levels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_come_in_morton_order_and_cover_every_point_once() {
        let (bits, level) = (10, 3);
        let mut histogram = vec![0u32; 512];
        let points: Vec<[u32; 3]> = (0..3000u32)
            .map(|i| {
                [i.wrapping_mul(2_654_435_761) >> 22, (i * i) % 1024, if i % 3 == 0 { 5 } else { i % 1024 }]
            })
            .collect();
        for &p in &points {
            histogram[cell_index(p, bits - level, level)] += 1;
        }
        for (most, short_from) in [(100, 0), (1, 0), (u64::MAX, 0), (u64::MAX, 2), (50, 3), (50, 9)] {
            let cut = Cut::new(Cell::default(), bits, &histogram, level, Wish { points: most, short_from });
            let mut counts = vec![0u64; cut.cells.len()];
            for &p in &points {
                let b = cut.bucket_of[cell_index(p, cut.below(), cut.level)] as usize;
                assert_eq!(Cell::around(p, cut.cells[b].level, bits), cut.cells[b]);
                counts[b] += 1;
            }
            assert!(counts.iter().all(|&c| c > 0));
            assert!(counts.iter().zip(&cut.cells).all(|(&c, cell)| c <= most || cell.level == level));
            let keys: Vec<u128> = cut.cells.iter().map(|c| morton::key96(c.min)).collect();
            assert!(keys.windows(2).all(|k| k[0] < k[1]));
            if short_from == 2 {
                assert!(cut.cells.iter().all(|c| c.level == 2));
            }
        }
    }
}
