//! The cube that an octree divides, in integers.

/// The cube: from the least coordinate of the points on, `2^bits` grid steps long.
///
/// Levels of the octree run from 0 (the whole cube) to `bits` (cells of one grid step), and one more for equal positions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Frame {
    /// Least coordinate on each axis.
    pub lo: [i32; 3],
    /// Bit length of the largest extent: 0 to 32.
    pub bits: u32,
}

impl Frame {
    /// The cube around a box.
    pub fn around(lo: [i32; 3], hi: [i32; 3]) -> Self {
        let extent = (0..3).map(|k| hi[k].wrapping_sub(lo[k]) as u32).fold(0, |a, b| a | b);
        Self { lo, bits: 32 - extent.leading_zeros() }
    }

    /// Coordinates from the cube's corner on.
    #[inline]
    pub fn local(&self, p: [i32; 3]) -> [u32; 3] {
        [0, 1, 2].map(|k| p[k].wrapping_sub(self.lo[k]) as u32)
    }

    /// The inverse of [`local`](Self::local).
    #[inline]
    pub fn global(&self, p: [u32; 3]) -> [i32; 3] {
        [0, 1, 2].map(|k| self.lo[k].wrapping_add(p[k] as i32))
    }

    /// Edge of the cells of a level in grid steps; 1 below the last one.
    pub fn edge(&self, level: u32) -> u64 {
        1 << self.bits.saturating_sub(level)
    }
}

/// A cell of the octree.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Cell {
    /// Local coordinates of its least corner.
    pub min: [u32; 3],
    /// Its level.
    pub level: u32,
}

impl Cell {
    /// The cell of a level that holds a point.
    pub fn around(p: [u32; 3], level: u32, bits: u32) -> Self {
        let below = bits.saturating_sub(level);
        Self { min: p.map(|v| ((u64::from(v) >> below) << below) as u32), level }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_cover_the_whole_range_of_32_bits() {
        let frame = Frame::around([i32::MIN; 3], [i32::MAX, 0, 5]);
        assert_eq!(frame.bits, 32);
        for p in [[i32::MIN; 3], [i32::MAX, 0, 5], [-1, 7, 3]] {
            assert_eq!(frame.global(frame.local(p)), p);
        }
        assert_eq!(frame.edge(0), 1 << 32);
        assert_eq!((frame.edge(32), frame.edge(33)), (1, 1));
        let point = Frame::around([7; 3], [7; 3]);
        assert_eq!((point.bits, point.edge(0)), (0, 1));
        assert_eq!(Cell::around([u32::MAX; 3], 0, 32).min, [0; 3]);
        assert_eq!(Cell::around([9, 8, 7], 2, 4).min, [8, 8, 4]);
    }
}
