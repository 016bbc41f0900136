//! Floating-point positions.

use super::{Batch, PointReader};
use crate::{Grid, Point, PointsError};
use glam::DVec3;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// What to do with a position that is NaN or infinite.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NonFinite {
    /// End with [`PointsError::NotFinite`].
    #[default]
    Refuse,
    /// Leave the point out and count it.
    Skip,
}

/// Turns world positions into integers of a grid, a reader for [`Input::from_reader`](crate::Input::from_reader).
///
/// Each coordinate is rounded to the nearest step.
///
/// ```
/// use farsight_points::{Grid, Input, NonFinite, Positions, glam::DVec3};
///
/// let grid = Grid::new(DVec3::splat(0.001), DVec3::ZERO)?;
/// let world = (0..100).map(|i| (DVec3::splat(f64::from(i) * 0.01), [200; 3]));
/// let positions = Positions::new(grid, world, NonFinite::Refuse);
/// let input = Input::from_reader(grid, "", 0, positions)?;
/// # Ok::<(), farsight_points::PointsError>(())
/// ```
#[derive(Debug)]
pub struct Positions<I> {
    grid: Grid,
    points: I,
    policy: NonFinite,
    read: u64,
    skipped: Arc<AtomicU64>,
}

impl<I: Iterator<Item = (DVec3, [u8; 3])>> Positions<I> {
    /// Positions with colours.
    pub fn new(grid: Grid, points: I, policy: NonFinite) -> Self {
        Self { grid, points, policy, read: 0, skipped: Arc::default() }
    }

    /// The number of points left out so far; can be read after the build.
    pub fn skipped(&self) -> Arc<AtomicU64> {
        Arc::clone(&self.skipped)
    }
}

impl<I: Iterator<Item = (DVec3, [u8; 3])>> PointReader for Positions<I> {
    fn read(&mut self, batch: &mut Batch) -> Result<bool, PointsError> {
        const SOME: usize = 1 << 16;
        for _ in 0..SOME {
            let Some((world, colour)) = self.points.next() else { return Ok(false) };
            let point = self.read;
            self.read += 1;
            if world.is_finite() {
                let integer = self.grid.nearest(world).ok_or_else(|| self.out_of_range(world))?;
                batch.points.push(Point::new(integer, colour));
            } else if self.policy == NonFinite::Skip {
                self.skipped.fetch_add(1, Ordering::Relaxed);
            } else {
                return Err(PointsError::NotFinite { point, x: world.x, y: world.y, z: world.z });
            }
        }
        Ok(true)
    }
}

impl<I> Positions<I> {
    fn out_of_range(&self, world: DVec3) -> PointsError {
        let steps = (world - self.grid.offset) / self.grid.scale;
        let axis = (0..3).find(|&k| steps[k].abs() > f64::from(i32::MAX)).unwrap_or(0);
        PointsError::Range { axis, value: steps[axis] as i64 }
    }
}
