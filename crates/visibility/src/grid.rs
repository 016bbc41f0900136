//! A box of space divided into equal view cells.

use crate::VisibilityError;
use crate::cell::ViewCell;
use farsight_geometry::DAabb;
use glam::{DVec3, UVec3};

/// View cells side by side: a box divided into equal boxes, numbered along x, then y, then z.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellGrid {
    bounds: DAabb,
    counts: UVec3,
}

impl CellGrid {
    /// Most cells of a grid.
    pub const MOST_CELLS: u64 = 1 << 28;

    /// Divides `bounds` into `counts` cells along each axis.
    ///
    /// # Errors
    /// [`VisibilityError::EmptyCell`] for an empty box, [`VisibilityError::CellCoordinate`] for one that is not finite,
    /// [`VisibilityError::Cells`] for a count of zero or more than [`MOST_CELLS`](Self::MOST_CELLS) in all.
    pub fn new(bounds: DAabb, counts: UVec3) -> Result<Self, VisibilityError> {
        // Checks the corners as well.
        ViewCell::from_box(&bounds)?;
        let product = counts.to_array().iter().try_fold(1u64, |n, &c| n.checked_mul(c.into()));
        match product {
            Some(n) if (1..=Self::MOST_CELLS).contains(&n) => Ok(Self { bounds, counts }),
            _ => Err(VisibilityError::Cells { counts: counts.to_array() }),
        }
    }

    /// The box that is divided.
    pub fn bounds(&self) -> &DAabb {
        &self.bounds
    }

    /// Cells along each axis.
    pub fn counts(&self) -> UVec3 {
        self.counts
    }

    /// Cells in all.
    pub fn len(&self) -> u32 {
        self.counts.element_product()
    }

    /// Never: a grid has at least one cell.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// The box of a cell. Neighbours share their faces to the bit.
    ///
    /// # Panics
    /// When there is no such cell.
    pub fn cell_box(&self, cell: u32) -> DAabb {
        let at = self.place(cell);
        let corner = |at: UVec3| {
            let t = at.as_dvec3() / self.counts.as_dvec3();
            self.bounds.min * (DVec3::ONE - t) + self.bounds.max * t
        };
        DAabb::new(corner(at), corner(at + UVec3::ONE))
    }

    /// The cell of a viewpoint; `None` outside the grid. On a common face it is the one with the larger number.
    pub fn cell_at(&self, viewpoint: DVec3) -> Option<u32> {
        if !self.bounds.contains(viewpoint) {
            return None;
        }
        let mut at = UVec3::ZERO;
        for axis in 0..3 {
            let (size, count) = (self.bounds.extent()[axis], self.counts[axis]);
            let t = if size > 0.0 { (viewpoint[axis] - self.bounds.min[axis]) / size } else { 0.0 };
            at[axis] = ((t * f64::from(count)) as u32).min(count - 1);
        }
        let cell = self.number(at);
        // Rounding may have gone one too far or too short.
        let holds = |cell: &u32| self.cell_box(*cell).contains(viewpoint);
        self.around(cell, 1).filter(holds).max().or(Some(cell))
    }

    /// The cells at most `radius` steps away on every axis, the cell itself included, in order.
    ///
    /// # Panics
    /// When there is no such cell.
    pub fn around(&self, cell: u32, radius: u32) -> impl Iterator<Item = u32> {
        let (at, grid) = (self.place(cell), *self);
        let low = at.saturating_sub(UVec3::splat(radius));
        let high = at.saturating_add(UVec3::splat(radius)).min(self.counts - UVec3::ONE);
        (low.z..=high.z).flat_map(move |z| {
            (low.y..=high.y)
                .flat_map(move |y| (low.x..=high.x).map(move |x| grid.number(UVec3::new(x, y, z))))
        })
    }

    fn place(&self, cell: u32) -> UVec3 {
        assert!(cell < self.len(), "cell {cell} of {}", self.len());
        let [x, y, _] = self.counts.to_array();
        UVec3::new(cell % x, cell / x % y, cell / x / y)
    }

    fn number(&self, at: UVec3) -> u32 {
        (at.z * self.counts.y + at.y) * self.counts.x + at.x
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use farsight_geometry::sampling::Random;

    #[test]
    fn every_viewpoint_lies_in_its_cell() {
        let bounds = DAabb::new(DVec3::new(-1e6, 0.1, 7.0), DVec3::new(-1e6 + 3.3, 9.7, 7.0));
        let grid = CellGrid::new(bounds, UVec3::new(7, 11, 1)).unwrap();
        assert_eq!(grid.len(), 77);
        let mut random = Random::new(6);
        for _ in 0..2000 {
            let p = farsight_geometry::sampling::in_box(&bounds, random.units());
            let cell = grid.cell_at(p).unwrap();
            assert!(grid.cell_box(cell).contains(p));
        }
        for cell in 0..grid.len() {
            let b = grid.cell_box(cell);
            assert_eq!(grid.cell_at(b.center()), Some(cell));
            assert_eq!(grid.cell_at(b.min), Some(cell), "the lower faces are a cell's own");
        }
        assert_eq!(grid.cell_at(bounds.max), Some(76));
        assert_eq!(grid.cell_at(bounds.max + DVec3::X), None);
        assert_eq!(grid.cell_at(DVec3::NAN), None);
        assert_eq!(grid.around(0, 1).collect::<Vec<_>>(), [0, 1, 7, 8]);
        assert_eq!(grid.around(40, u32::MAX).count(), 77);
    }

    #[test]
    fn impossible_grids_are_refused() {
        let unit = DAabb::new(DVec3::ZERO, DVec3::ONE);
        for counts in [UVec3::ZERO, UVec3::new(1, 0, 1), UVec3::MAX, UVec3::splat(1 << 20)] {
            assert!(matches!(CellGrid::new(unit, counts), Err(VisibilityError::Cells { .. })));
        }
        assert!(CellGrid::new(DAabb::EMPTY, UVec3::ONE).is_err());
        assert!(CellGrid::new(DAabb::new(DVec3::ZERO, DVec3::INFINITY), UVec3::ONE).is_err());
    }
}
