//! Which objects are worth drawing into the depth buffer.

/// Chooses occluders as objects come by from front to back: large on the screen, few triangles, within a budget.
///
/// ```
/// use farsight_occlusion::Occluders;
///
/// let mut occluders = Occluders::new(10_000, 50.0);
/// assert!(occluders.admits(400.0, 2_000), "a house");
/// assert!(!occluders.admits(20.0, 12), "too small to hide much");
/// assert!(!occluders.admits(400.0, 9_000), "the budget would be exceeded");
/// occluders.clear();
/// assert!(occluders.admits(400.0, 9_000));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Occluders {
    budget: u64,
    least_px: f64,
    spent: u64,
}

impl Occluders {
    /// At most `triangles` per frame, from objects whose images are at least `least_px` pixels long
    /// ([`Camera::box_px`](farsight_geometry::Camera::box_px)).
    pub fn new(triangles: u64, least_px: f64) -> Self {
        Self { budget: triangles, least_px, spent: 0 }
    }

    /// Starts the next frame.
    pub fn clear(&mut self) {
        self.spent = 0;
    }

    /// Whether to draw an object; if so, its triangles are taken off the budget.
    pub fn admits(&mut self, size_px: f64, triangles: u64) -> bool {
        let fits = size_px >= self.least_px && self.spent.saturating_add(triangles) <= self.budget;
        if fits {
            self.spent += triangles;
        }
        fits
    }

    /// Triangles taken so far.
    pub fn spent(&self) -> u64 {
        self.spent
    }
}
