//! Memory-optimised sequential point trees: the points themselves, in an order whose prefixes are levels of detail.

use crate::build::sequential;
use crate::frame::Frame;
use crate::select::{Lens, reach};
use crate::{Grid, Point, PointsError};
use farsight_geometry::accuracy::{ErrorBound, Unit};
use farsight_geometry::{Camera, DAabb};

/// What to do with points that cells of the deepest level do not tell apart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LeafStrategy {
    /// Keep them all, as one more level at the end.
    #[default]
    Add,
    /// Keep one per cell and drop the others.
    Reject,
}

/// How a tree is built.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct MosptOptions {
    /// Deepest level, in halvings of the cube; `None` tells all positions apart.
    pub depth: Option<u32>,
    /// What happens below it.
    pub leaves: LeafStrategy,
    /// Threads; 0 for as many as there are processors.
    pub threads: usize,
}

/// A memory-optimised sequential point tree.
///
/// Level L has one point per occupied cell of 2⁻ᴸ of the cube, and is a prefix of [`points`](Self::points): whoever draws the
/// first `prefix[L]` points draws level L. There is no other data; 16 bytes a point and a few per level.
///
/// ```
/// use farsight_geometry::Camera;
/// use farsight_points::{Grid, Mospt, MosptOptions, Point, glam::DVec3};
///
/// let grid = Grid::new(DVec3::splat(0.001), DVec3::ZERO)?;
/// let points: Vec<Point> = (0..100_000).map(|i| Point::new([i % 317 * 30, i / 317 * 30, i % 13], [90, 120, 60])).collect();
/// let tree = Mospt::build(grid, &points, &MosptOptions::default())?;
/// assert_eq!(tree.points().len(), points.len());
///
/// let eye = DVec3::new(5.0, -200.0, 60.0);
/// let camera = Camera::look_at(eye, DVec3::new(5.0, 5.0, 0.0), DVec3::Z).unwrap();
/// let level = tree.select(&camera, 1.0);
/// assert!(level.error.value <= 1.0 && level.points < tree.points().len());
/// let to_draw = &tree.points()[..level.points];
/// # assert!(!to_draw.is_empty());
/// # Ok::<(), farsight_points::PointsError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Mospt {
    grid: Grid,
    frame: Frame,
    hi: [i32; 3],
    points: Vec<Point>,
    prefix: Vec<usize>,
    dropped: usize,
}

/// A level of a tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// Which.
    pub level: u32,
    /// Length of its prefix.
    pub points: usize,
    /// How many pixels a visible point may be from one in the prefix. Proven.
    pub error: ErrorBound,
}

impl Mospt {
    /// Orders points.
    ///
    /// # Accuracy
    /// Positions are not touched. The order depends on the set of points alone, not on the order of the input or on threads.
    ///
    /// # Cost
    /// About 60 ns a point on one thread; at most 48 bytes a point beside the input.
    ///
    /// # Errors
    /// [`PointsError::Grid`] when the grid is not usable.
    ///
    /// # References
    /// Wimmer 2007, section 6.4.6. Differs: sorted bottom-up; a cell is represented by the colour nearest to the mean of *all* points
    /// below.
    pub fn build(grid: Grid, points: &[Point], options: &MosptOptions) -> Result<Self, PointsError> {
        grid.check("grid")?;
        let keep = options.leaves == LeafStrategy::Add;
        let built = sequential(grid, points, options.depth, keep, options.threads)?;
        let mut sum = 0;
        let prefix = built.levels.iter().map(|&n| {
            sum += n as usize;
            sum
        });
        let prefix = prefix.collect();
        let start = points.first().map_or([0; 3], |p| p.position);
        let hi = points.iter().fold(start, |hi, p| [0, 1, 2].map(|k| hi[k].max(p.position[k])));
        let dropped = points.len() - built.points.len();
        Ok(Self { grid, frame: built.frame, hi, points: built.points, prefix, dropped })
    }

    /// The points in their order; within a level in Morton order.
    pub fn points(&self) -> &[Point] {
        &self.points
    }

    /// Number of points in the levels up to each.
    pub fn prefix(&self) -> &[usize] {
        &self.prefix
    }

    /// Points that were dropped ([`LeafStrategy::Reject`]).
    pub fn dropped(&self) -> usize {
        self.dropped
    }

    /// The grid of the positions.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// World box of all points.
    pub fn world_bounds(&self) -> DAabb {
        if self.points.is_empty() {
            return DAabb::EMPTY;
        }
        DAabb::new(self.grid.world(self.frame.lo), self.grid.world(self.hi))
    }

    /// Diagonal in the world of the cells of a level: how far a point may be from the one that represents it.
    pub fn cell_diagonal(&self, level: u32) -> f64 {
        let steps = (self.frame.edge(level) - 1) as f64;
        (self.grid.scale * steps).length() * (1.0 + 4.0 * f64::EPSILON)
    }

    /// The coarsest level that a camera cannot tell from all points by more than `error_px` pixels.
    ///
    /// # Accuracy
    /// The stretch of a perspective towards the corners of the image is accounted for. With the eye so near that no level is fine
    /// enough, the finest is chosen and its error says so.
    ///
    /// # References
    /// Wimmer 2007, section 6.4.5: smallest i with dᵢ ≤ ε·min(r). Differs: dᵢ is the diagonal; min(r) comes from the box, along
    /// the view, and ends at the near plane.
    pub fn select(&self, camera: &Camera, error_px: f64) -> Level {
        let Some(finest) = self.prefix.len().checked_sub(1) else {
            return Level { level: 0, points: 0, error: ErrorBound::proven(0.0, Unit::Pixels) };
        };
        let lens = Lens::new(camera);
        let (least, farthest) = reach(camera, &self.world_bounds());
        let error = |level: u32| {
            // The last level of a tree holds every point, unless some were dropped.
            let whole = level as usize == finest && self.dropped == 0;
            if whole { 0.0 } else { lens.error_px(self.cell_diagonal(level), least, farthest) }
        };
        let level = (0..finest as u32).find(|&l| error(l) <= error_px).unwrap_or(finest as u32);
        Level {
            level,
            points: self.prefix[level as usize],
            error: ErrorBound::proven(error(level), Unit::Pixels),
        }
    }
}

/// Shuffles points in batches, which draws faster on cards that give neighbouring points to one unit and gets stuck on shared
/// pixels. Levels stay where they are: `levels` are their lengths.
///
/// # References
/// Schütz, Kerbl & Wimmer 2021: Morton order, shuffled in batches of 128.
pub fn shuffle_batches(points: &mut [Point], levels: &[u32], batch: usize, seed: u64) {
    let batch = batch.max(1);
    let mut rest = points;
    let mut state = seed;
    for &count in levels {
        let (level, later) = rest.split_at_mut((count as usize).min(rest.len()));
        rest = later;
        // What does not fill a batch stays at the end.
        let batches = level.len() / batch;
        for i in (1..batches).rev() {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let j = ((u128::from(state) * (i as u128 + 1)) >> 64) as usize;
            if i != j {
                let (low, high) = level.split_at_mut(i * batch);
                low[j * batch..][..batch].swap_with_slice(&mut high[..batch]);
            }
        }
    }
}
