//! Tiles of 32 x 8 pixels, a vector each: lane = sub-tile of 8 x 4 pixels, four beside each other, two above each other.

use fearless_simd::{Simd, f32x8, i32x8, mask32x8, prelude::*};

pub(super) const TILE_WIDTH: usize = 32;
pub(super) const TILE_HEIGHT: usize = 8;

/// Depth of a working layer that holds no pixel: farther ones always win.
const NO_LAYER: f32 = f32::MAX;

/// The buffer: what all pixels of a sub-tile hide, and what some of them hide.
#[derive(Clone, Debug)]
pub(super) struct Bins {
    pub(super) columns: usize,
    /// Hidden by every pixel.
    pub(super) base: Vec<[f32; 8]>,
    /// Hidden by the pixels of `mask`; at least `base`.
    layer: Vec<[f32; 8]>,
    /// Bit 8 r + c for row r and column c.
    mask: Vec<[i32; 8]>,
    /// At most the least of `base` in the tile. Lags behind, which is safe, as `base` only grows.
    pub(super) coarse: Vec<f32>,
    /// Tile rows whose coarse depths lag behind: half-open.
    dirty: [usize; 2],
}

impl Bins {
    pub(super) fn new(width: u32, height: u32) -> Self {
        let (columns, rows) =
            ((width as usize).div_ceil(TILE_WIDTH), (height as usize).div_ceil(TILE_HEIGHT));
        let tiles = columns * rows;
        Self {
            columns,
            base: vec![[0.0; 8]; tiles],
            layer: vec![[NO_LAYER; 8]; tiles],
            mask: vec![[0; 8]; tiles],
            coarse: vec![0.0; tiles],
            dirty: [usize::MAX, 0],
        }
    }

    pub(super) fn bytes(&self) -> usize {
        self.base.len() * (3 * 32 + 4)
    }

    pub(super) fn clear(&mut self) {
        self.base.fill([0.0; 8]);
        self.layer.fill([NO_LAYER; 8]);
        self.mask.fill([0; 8]);
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
            let tiles = first * self.columns..(end * self.columns).min(self.base.len());
            for (coarse, base) in self.coarse[tiles.clone()].iter_mut().zip(&self.base[tiles]) {
                *coarse = base.iter().copied().fold(f32::MAX, f32::min);
            }
            self.dirty = [usize::MAX, 0];
        }
    }

    pub(super) fn depth(&self, x: usize, y: usize) -> f32 {
        let tile = y / TILE_HEIGHT * self.columns + x / TILE_WIDTH;
        let lane = y % TILE_HEIGHT / 4 * 4 + x % TILE_WIDTH / 8;
        let bit = y % 4 * 8 + x % 8;
        let in_layer = self.mask[tile][lane] >> bit & 1 != 0;
        if in_layer { self.layer[tile][lane] } else { self.base[tile][lane] }
    }

    /// Adds `depth` at the pixels of `covered` to a tile.
    ///
    /// The layer keeps the farthest of what went into it. It is dropped when the new depth is nearer to it than it is to the
    /// base: then it would hold back what is being drawn now.
    #[inline(always)]
    pub(super) fn merge<S: Simd>(&mut self, simd: S, tile: usize, covered: i32x8<S>, depth: f32x8<S>) {
        let (Some(base_at), Some(layer_at), Some(mask_at)) =
            (self.base.get_mut(tile), self.layer.get_mut(tile), self.mask.get_mut(tile))
        else {
            return;
        };
        let base = f32x8::simd_from(simd, *base_at);
        let layer = f32x8::simd_from(simd, *layer_at);
        let mask = i32x8::simd_from(simd, *mask_at);
        let none = i32x8::splat(simd, 0);
        let useful: mask32x8<S> = depth.simd_gt(base) & !covered.simd_eq(none);
        // Twice the layer overflows for the empty one, which then is kept and minimised away.
        let drops = (depth + base).simd_gt(layer + layer) & useful;
        let joined = useful.select(drops.select(depth, layer.min(depth)), layer);
        let bits = useful.select(drops.select(covered, mask | covered), mask);
        let full = bits.simd_eq(i32x8::splat(simd, -1));
        *base_at = full.select(joined, base).into();
        *layer_at = full.select(f32x8::splat(simd, NO_LAYER), joined).into();
        *mask_at = full.select(none, bits).into();
    }
}
