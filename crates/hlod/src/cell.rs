//! Cells of an octree and the lattice that all coordinates lie on.
//!
//! The root cube is 2³⁰ units wide. Walls of cells are at whole units, and every node rounds its vertices to a multiple of units that belongs to its
//! level, so that what is equal on both sides of a wall stays equal.

use farsight_geometry::DAabb;
use glam::{DVec3, Vec3};

/// Binary digits of a coordinate in the root cube.
pub(crate) const BITS: u32 = 30;

/// Deepest level of a cell.
pub(crate) const DEEPEST: u32 = 16;

/// Units that input, cuts and `f64` may displace a point by: the input is rounded once, each cut rounds what lies between points that were rounded
/// before, and there are at most three cuts a level.
pub(crate) const LATTICE_SLACK: f64 = 64.0;

/// A position in units.
pub(crate) type Lattice = [i32; 3];

/// The same in `f64`, which holds it exactly.
pub(crate) fn place(p: Lattice) -> DVec3 {
    DVec3::from_array(p.map(f64::from))
}

/// The root cube: a world position, and the world length of a unit, which is a power of two.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Cube {
    pub min: DVec3,
    pub unit: f64,
}

impl Cube {
    /// The smallest cube whose inside, a 2⁻¹⁰ from the sides, holds a box.
    pub(crate) fn around(b: &DAabb) -> Self {
        if b.is_empty() {
            return Self { min: DVec3::ZERO, unit: (-f64::from(BITS)).exp2() };
        }
        // A box without extent gets a cube that its coordinates can still be told apart in.
        let largest = b.min.abs().max(b.max.abs()).max_element();
        let extent = b.extent().max_element().max(largest * 1e-9).max(1e-30);
        let edge = (extent * (1.0 + 1.0 / 256.0)).log2().ceil().exp2();
        let unit = edge * (-f64::from(BITS)).exp2();
        // On a multiple of the unit: as exact in f64 as anything can be.
        let min = ((b.center() - 0.5 * edge) / unit).floor() * unit;
        Self { min, unit }
    }

    /// The nearest lattice point.
    pub(crate) fn enter(&self, p: DVec3) -> Lattice {
        ((p - self.min) / self.unit).round().to_array().map(|x| x.clamp(0.0, f64::from(1u32 << BITS)) as i32)
    }

    pub(crate) fn leave(&self, p: Lattice) -> DVec3 {
        self.min + place(p) * self.unit
    }

    /// What rounding to the lattice, cuts and sums in `f64` may displace a point by, in world units.
    pub(crate) fn slack(&self) -> f64 {
        let far = self.min.abs().max_element() + self.unit * f64::from(1u32 << BITS);
        LATTICE_SLACK * self.unit + 8.0 * f64::EPSILON * far
    }
}

/// A cell: its level, and which one of its level.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct Cell {
    pub level: u32,
    pub at: [u32; 3],
}

impl Cell {
    pub(crate) const ROOT: Self = Self { level: 0, at: [0; 3] };

    /// Edge in units.
    pub(crate) fn edge(&self) -> i32 {
        1 << (BITS - self.level)
    }

    pub(crate) fn corner(&self) -> Lattice {
        self.at.map(|a| (a << (BITS - self.level)) as i32)
    }

    /// The walls between the children.
    pub(crate) fn middle(&self) -> Lattice {
        self.corner().map(|m| m + self.edge() / 2)
    }

    pub(crate) fn child(&self, octant: u32) -> Self {
        let mut at = self.at.map(|a| a << 1);
        (0..3).for_each(|k| at[k] |= octant >> k & 1);
        Self { level: self.level + 1, at }
    }

    /// Which child of its parent it is.
    pub(crate) fn octant(&self) -> u32 {
        (0..3).map(|k| (self.at[k] & 1) << k).sum()
    }
}

/// Coordinates of a cell's mesh: relative to the cell's middle, in world lengths.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LocalFrame {
    middle: Lattice,
    unit: f64,
}

impl LocalFrame {
    pub(crate) fn of(cell: &Cell, cube: &Cube) -> Self {
        Self { middle: cell.middle(), unit: cube.unit }
    }

    /// Exact if the position is a multiple of 2⁻²³ of a few cells' edge.
    pub(crate) fn local(&self, p: Lattice) -> Vec3 {
        let relative = [0, 1, 2].map(|k| (f64::from(p[k] - self.middle[k]) * self.unit) as f32);
        Vec3::from_array(relative)
    }

    /// The nearest multiple of `step` units.
    pub(crate) fn lattice(&self, p: Vec3, step: i32) -> Lattice {
        let p = p.to_array();
        [0, 1, 2].map(|k| {
            let units = f64::from(p[k]) / self.unit + f64::from(self.middle[k]);
            (units / f64::from(step)).round() as i32 * step
        })
    }
}

/// The nearest multiple of a power of two, halves up.
pub(crate) fn rounded(p: Lattice, step: i32) -> Lattice {
    p.map(|x| (x + step / 2) & !(step - 1))
}

/// Half the diagonal of a lattice cell.
pub(crate) fn rounding(step: i32) -> f64 {
    if step <= 1 { 0.0 } else { f64::from(step) * 0.866_025_403_784_439 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cubes_hold_their_boxes_and_come_back() {
        for (min, size) in [(0.0, 1.0), (4.8e5, 300.0), (-1e-18, 2e-18), (1e18, 1e17), (5.0, 0.0)] {
            let b = DAabb { min: DVec3::splat(min), max: DVec3::splat(min + size) };
            let cube = Cube::around(&b);
            for p in [b.min, b.max, b.center()] {
                let l = cube.enter(p);
                assert!(l.iter().all(|&x| x > 0 && x < 1 << BITS), "{min} {size} {l:?}");
                assert!(cube.leave(l).distance(p) <= cube.slack(), "{min} {size}");
            }
        }
    }

    #[test]
    fn children_tile_their_parent() {
        let cell = Cell::ROOT.child(5).child(3);
        assert_eq!((cell.octant(), cell.level, cell.at), (3, 2, [3, 1, 2]));
        let c = cell.child(7);
        assert_eq!(c.corner(), cell.middle());
        assert_eq!(c.corner().map(|m| m + c.edge()), cell.corner().map(|m| m + cell.edge()));
        assert_eq!(rounded([7, 8, -5], 16), [0, 16, 0]);
    }
}
