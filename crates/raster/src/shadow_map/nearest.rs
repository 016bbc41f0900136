//! What lies nearest to the light anywhere in a region of a map.

use crate::Target;

/// Texels along a side of the smallest regions.
const TILE: usize = 8;

/// The largest depth of every tile of 8 x 8 texels, of 16 x 16, and so on.
#[derive(Clone, Debug)]
pub struct Nearest {
    levels: Vec<Level>,
}

#[derive(Clone, Debug)]
struct Level {
    side: usize,
    depths: Vec<f32>,
}

impl Nearest {
    /// Of a square map.
    pub fn of(map: &Target) -> Self {
        let side = (map.width() as usize).div_ceil(TILE);
        let mut depths = vec![0.0f32; side * side];
        for (j, row) in map.depth.chunks(map.stride()).enumerate() {
            let into = &mut depths[j / TILE * side..][..side];
            for (most, tile) in into.iter_mut().zip(row.as_chunks::<TILE>().0) {
                *most = tile.iter().fold(*most, |m, &d| if d > m { d } else { m });
            }
        }
        let mut levels = vec![Level { side, depths }];
        while let Some(coarser) = levels.last().filter(|l| l.side > 1).map(Level::coarser) {
            levels.push(coarser);
        }
        Self { levels }
    }

    /// The largest depth within `reach` texels of a place, along each axis; that of a somewhat larger region.
    #[inline]
    pub fn around(&self, [x, y]: [f32; 2], reach: [f32; 2]) -> f32 {
        // Casts from negative numbers give zero.
        let tiles = |c: f32, reach: f32| [((c - reach) as usize) / TILE, ((c + reach) as usize) / TILE];
        let (columns, rows) = (tiles(x, reach[0]), tiles(y, reach[1]));
        // At most three tiles on a side.
        let span = (columns[1] - columns[0]).max(rows[1] - rows[0]);
        let level = (usize::BITS - (span / 2).leading_zeros()).min(self.levels.len() as u32 - 1);
        let Level { side, depths } = &self.levels[level as usize];
        let at = |tile: usize| (tile >> level).min(side - 1);
        let [left, right] = columns.map(at);
        let mut most = 0.0;
        for j in at(rows[0])..=at(rows[1]) {
            for &depth in &depths[j * side + left..=j * side + right] {
                most = if depth > most { depth } else { most };
            }
        }
        most
    }
}

impl Level {
    fn coarser(&self) -> Self {
        let side = self.side.div_ceil(2);
        let mut depths = vec![0.0f32; side * side];
        for (i, &depth) in self.depths.iter().enumerate() {
            let slot = &mut depths[i / self.side / 2 * side + i % self.side / 2];
            *slot = slot.max(depth);
        }
        Self { side, depths }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Outputs, Random};

    #[test]
    fn nothing_in_a_region_is_nearer() {
        for side in [1u32, 7, 8, 9, 60, 129] {
            let mut map = Target::new(side, side, Outputs::DEPTH).unwrap();
            let mut random = Random::new(u64::from(side));
            for depth in map.depth.iter_mut() {
                *depth = random.unit() as f32;
            }
            // What pads the rows is not part of the map.
            let stride = map.stride();
            map.depth.chunks_mut(stride).for_each(|row| row[side as usize..].fill(0.0));
            let nearest = Nearest::of(&map);
            for _ in 0..200 {
                let at = [0, 1].map(|_| random.range(-3.0, f64::from(side) + 3.0) as f32);
                let reach = [0, 1].map(|_| random.range(0.0, f64::from(side)) as f32);
                let inside = |x: u32, y: u32| {
                    let near = |t: u32, k: usize| (t as f32 - at[k]).abs() <= reach[k];
                    near(x, 0) && near(y, 1)
                };
                let all = (0..side).flat_map(|y| (0..side).map(move |x| (x, y)));
                let most = all.filter(|&(x, y)| inside(x, y)).map(|(x, y)| map.depth(x, y));
                assert!(nearest.around(at, reach) >= most.fold(0.0, f32::max));
            }
        }
    }
}
