//! The triangles that are known to be seen, in the order of their directions.

use glam::{DVec3, UVec2};

/// Share of unsorted triangles, as a divisor, from which on all are sorted again.
const UNSORTED: usize = 4;

/// Numbers of triangles such that neighbours in the list are neighbours in the picture, but for the last few: rays past
/// neighbours go through the tree together, and find their corners side by side.
#[derive(Clone, Debug)]
pub(crate) struct Known {
    /// Place in the picture above the number.
    entries: Vec<u64>,
    sorted: usize,
    centre: DVec3,
}

impl Known {
    /// None yet, for a picture around `centre`.
    pub(crate) fn new(centre: DVec3) -> Self {
        Self { entries: Vec::new(), sorted: 0, centre }
    }

    pub(crate) fn len(&self) -> usize {
        self.entries.len()
    }

    pub(crate) fn bytes(&self) -> usize {
        self.entries.len() * size_of::<u64>()
    }

    pub(crate) fn push(&mut self, triangle: u32, [a, b, c]: [DVec3; 3]) {
        let direction = (a - self.centre) + (b - self.centre) + (c - self.centre);
        self.entries.push(u64::from(place(direction)) << 32 | u64::from(triangle));
    }

    /// Sorts, when enough is new.
    pub(crate) fn settle(&mut self) {
        if self.len() - self.sorted > self.sorted / UNSORTED {
            self.entries[self.sorted..].sort_unstable();
            // Two sorted runs, which this sort merges.
            self.entries.sort();
            self.sorted = self.len();
        }
    }

    /// Up to `count` neighbours from the given one on, going round and round; there must be some.
    pub(crate) fn from(&self, first: usize, count: usize) -> impl Iterator<Item = u32> {
        let (before, after) = self.entries.split_at(first % self.len());
        after.iter().chain(before).take(count).map(|&entry| entry as u32)
    }
}

/// Where a direction lies in the picture of all directions (an octahedron, unfolded), along a curve that keeps neighbours
/// together.
fn place(direction: DVec3) -> u32 {
    let sum = direction.abs().element_sum();
    let [x, y, z] = (direction / sum).to_array();
    let sign = |v: f64| if v < 0.0 { -1.0 } else { 1.0 };
    let (x, y) = if z < 0.0 { ((1.0 - y.abs()) * sign(x), (1.0 - x.abs()) * sign(y)) } else { (x, y) };
    // A direction without length is NaN here, which becomes zero.
    let grid = |v: f64| ((v + 1.0) * 32767.5) as u32;
    let cell = UVec2::new(grid(x), grid(y));
    spread(cell.x) | spread(cell.y) << 1
}

/// The lower 16 bits on the even places.
fn spread(mut x: u32) -> u32 {
    x &= 0xffff;
    x = (x | x << 8) & 0x00ff_00ff;
    x = (x | x << 4) & 0x0f0f_0f0f;
    x = (x | x << 2) & 0x3333_3333;
    (x | x << 1) & 0x5555_5555
}

#[cfg(test)]
mod tests {
    use super::*;
    use farsight_geometry::sampling::Random;

    #[test]
    fn neighbours_in_the_list_look_alike() {
        let mut random = Random::new(3);
        let mut known = Known::new(DVec3::ONE);
        let directions: Vec<DVec3> =
            (0..4096).map(|_| (DVec3::from_array(random.units()) * 2.0 - DVec3::ONE).normalize()).collect();
        for (i, &d) in directions.iter().enumerate() {
            known.push(i as u32, [DVec3::ONE + d * 7.0; 3]);
        }
        known.settle();
        let order: Vec<u32> = known.from(10, 4096).collect();
        assert!(order[4086..] == known.from(0, 10).collect::<Vec<_>>());
        let mut all = order.clone();
        all.sort_unstable();
        assert!(all.iter().copied().eq(0..4096));
        let step = |pair: &[u32]| directions[pair[0] as usize].angle_between(directions[pair[1] as usize]);
        let mean = order.windows(2).map(step).sum::<f64>() / 4095.0;
        // Random pairs are a right angle apart; each of 4,096 directions has a square of 0.055 rad to itself.
        assert!(mean < 0.1, "{mean}");
    }

    #[test]
    fn nothing_is_sorted_for_little_and_any_direction_has_a_place() {
        let mut known = Known::new(DVec3::ZERO);
        for (i, d) in [DVec3::Z, DVec3::NEG_Z, DVec3::ZERO, DVec3::X * 1e-300, DVec3::Y].iter().enumerate() {
            known.push(i as u32, [*d; 3]);
        }
        known.settle();
        assert_eq!(known.sorted, 5);
        known.push(5, [DVec3::X; 3]);
        known.settle();
        assert_eq!((known.sorted, known.len()), (5, 6));
        assert_eq!(known.from(5, 9).count(), 6);
    }
}
