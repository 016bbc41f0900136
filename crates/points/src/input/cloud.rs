//! Clouds of the geometry crate.

use super::{Batch, Input};
use crate::{Grid, Point, PointsError};
use farsight_geometry::PointCloud;
use glam::DVec3;

impl<'a> Input<'a> {
    /// A point cloud in memory, as the geometry crate's importers return it (PLY among them).
    ///
    /// # Accuracy
    /// Coordinates go to a grid whose step is a power of two and divides the largest extent into 2³⁰ to 2³¹ steps. Those with an
    /// ulp of at least a step stay exact; the others move by less than half a step ([`Input::rounding`]).
    ///
    /// # Errors
    /// [`PointsError::Grid`] when the cloud is too far from its origin for a grid in `f64`.
    pub fn from_cloud(cloud: &'a PointCloud) -> Result<Self, PointsError> {
        let bounds = cloud.bounds();
        let (lo, hi) = if bounds.is_empty() {
            (DVec3::ZERO, DVec3::ZERO)
        } else {
            (bounds.min.as_dvec3(), bounds.max.as_dvec3())
        };
        let extent = (hi - lo).max_element();
        let step = if extent > 0.0 { power_above(extent) * 2f64.powi(-31) } else { step_of_single(lo) };
        // The middle on the grid, so that the grid holds the same multiples of the step as `f32` does.
        let middle = ((lo + hi) * 0.5 / step).round() * step;
        let grid = Grid::new(DVec3::splat(step), cloud.origin() + middle)?;
        let colours = cloud.colours();
        let mut next = 0;
        let reader = move |batch: &mut Batch| {
            let end = cloud.len().min(next + (1 << 16));
            for (i, p) in cloud.positions()[next..end].iter().enumerate() {
                let steps = ((p.as_dvec3() - middle) / step).round();
                let colour = colours.map_or([255; 3], |c| c[next + i]);
                batch.points.push(Point::new(steps.to_array().map(|v| v as i32), colour));
            }
            next = end;
            Ok(next < cloud.len())
        };
        let rounding = 0.5 * 3f64.sqrt() * step * (1.0 + 1e-9);
        Ok(Input::from_reader(grid, "", 0, reader)?.with_rounding(rounding))
    }
}

/// The least power of two that is at least `v`.
fn power_above(v: f64) -> f64 {
    let power = 2f64.powi(v.log2().ceil() as i32);
    if power < v { 2.0 * power } else { power }
}

/// A step that divides one `f32` position exactly.
fn step_of_single(p: DVec3) -> f64 {
    let largest = p.abs().max_element();
    if largest > 0.0 { power_above(largest) * 2f64.powi(-24) } else { 2f64.powi(-20) }
}
