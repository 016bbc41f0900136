//! Tiles of 32 x 8 pixels, a vector each: lane = sub-tile of 8 x 4 pixels, four beside each other, two above each other.

use fearless_simd::{Simd, f32x8, i32x8, mask32x8, prelude::*};

pub(super) const TILE_WIDTH: usize = 32;
pub(super) const TILE_HEIGHT: usize = 8;

/// Depth of a working layer that holds no pixel: farther ones always win.
const NO_LAYER: f32 = f32::MAX;

/// A tile; together, as all of it is touched at once.
#[derive(Clone, Copy, Debug)]
#[repr(align(32))]
pub(super) struct Tile {
    /// Hidden by every pixel.
    pub(super) base: [f32; 8],
    /// Hidden by the pixels of `mask`; at least `base`.
    layer: [f32; 8],
    /// Bit 8 r + c for row r and column c.
    mask: [i32; 8],
}

impl Tile {
    const EMPTY: Self = Self { base: [0.0; 8], layer: [NO_LAYER; 8], mask: [0; 8] };
}

/// The buffer.
#[derive(Clone, Debug)]
pub(super) struct Bins {
    pub(super) columns: usize,
    pub(super) tiles: Vec<Tile>,
    /// At most the least of `base` in the tile. Lags behind, which is safe, as `base` only grows.
    pub(super) coarse: Vec<f32>,
    /// Tile rows whose coarse depths lag behind: half-open.
    dirty: [usize; 2],
}

impl Bins {
    pub(super) fn new(width: u32, height: u32) -> Self {
        let columns = (width as usize).div_ceil(TILE_WIDTH);
        let tiles = columns * (height as usize).div_ceil(TILE_HEIGHT);
        Self { columns, tiles: vec![Tile::EMPTY; tiles], coarse: vec![0.0; tiles], dirty: [usize::MAX, 0] }
    }

    pub(super) fn bytes(&self) -> usize {
        self.tiles.len() * (size_of::<Tile>() + 4)
    }

    pub(super) fn clear(&mut self) {
        self.tiles.fill(Tile::EMPTY);
        self.coarse.fill(0.0);
        self.dirty = [usize::MAX, 0];
    }

    pub(super) fn touch(&mut self, first_row: usize, end_row: usize) {
        self.dirty = [self.dirty[0].min(first_row), self.dirty[1].max(end_row)];
    }

    /// Brings the coarse depths up to date.
    pub(super) fn refresh(&mut self) {
        let [first, end] = self.dirty;
        if first < end {
            let tiles = first * self.columns..(end * self.columns).min(self.tiles.len());
            for (coarse, tile) in self.coarse[tiles.clone()].iter_mut().zip(&self.tiles[tiles]) {
                *coarse = tile.base.iter().copied().fold(f32::MAX, f32::min);
            }
            self.dirty = [usize::MAX, 0];
        }
    }

    pub(super) fn depth(&self, x: usize, y: usize) -> f32 {
        let tile = y / TILE_HEIGHT * self.columns + x / TILE_WIDTH;
        let lane = y % TILE_HEIGHT / 4 * 4 + x % TILE_WIDTH / 8;
        let bit = y % 4 * 8 + x % 8;
        let tile = &self.tiles[tile];
        if tile.mask[lane] >> bit & 1 != 0 { tile.layer[lane] } else { tile.base[lane] }
    }

    /// Adds `depth` at the pixels of `covered` to a tile.
    ///
    /// The layer keeps the farthest of what went into it. It is dropped when the new depth is nearer to it than it is to the
    /// base: then it would hold back what is being drawn now.
    #[inline(always)]
    pub(super) fn merge<S: Simd>(&mut self, simd: S, tile: usize, covered: i32x8<S>, depth: f32x8<S>) {
        let Some(at) = self.tiles.get_mut(tile) else { return };
        let base = f32x8::simd_from(simd, at.base);
        let layer = f32x8::simd_from(simd, at.layer);
        let mask = i32x8::simd_from(simd, at.mask);
        let none = i32x8::splat(simd, 0);
        let useful: mask32x8<S> = depth.simd_gt(base) & !covered.simd_eq(none);
        // Twice the layer overflows for the empty one, which then is kept and minimised away.
        let drops = (depth + base).simd_gt(layer + layer) & useful;
        let joined = useful.select(drops.select(depth, layer.min(depth)), layer);
        let bits = useful.select(drops.select(covered, mask | covered), mask);
        let full = bits.simd_eq(i32x8::splat(simd, -1));
        at.base = full.select(joined, base).into();
        at.layer = full.select(f32x8::splat(simd, NO_LAYER), joined).into();
        at.mask = full.select(none, bits).into();
    }
}
