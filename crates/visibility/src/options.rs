//! How sampling goes about it, and when it stops.

use crate::VisibilityError;
use farsight_geometry::sampling::Directions;
use std::time::Duration;

/// Which points past an occluding triangle reverse sampling looks through.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reverse {
    /// None: no reverse sampling.
    Off,
    /// The one on the side of what was seen before.
    Near,
    /// Both ends of the occluder.
    Both,
}

/// The direction in which the border of a triangle is moved out at sharp corners.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bisector {
    /// Away from the triangle.
    Outward,
    /// As printed in the paper, where it leads into triangles that face the viewpoint. For comparisons.
    Printed,
}

/// How a view cell is sampled.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Options {
    /// Seed of everything random.
    pub seed: u64,
    /// How far outside a triangle its border is sampled, in radians: 1e-9 to 1e-2. Raised by itself where coordinates are
    /// too coarse for it.
    pub epsilon: f64,
    /// Angles between neighbouring border rays below which no further one goes between them, in radians, at first and when
    /// triangles are visited again: 1e-7 to 1, the second not above the first.
    pub tolerance: [f64; 2],
    /// How random directions are spread around the outward normal.
    pub directions: Directions,
    /// Random rays before anything else.
    pub first_random: u64,
    /// Adaptive border sampling: follow what was seen to its neighbours.
    pub border: bool,
    /// Flood to neighbours with one ray an edge first, and sample all around only where the surface breaks off.
    pub flood: bool,
    /// Reverse sampling: look past what hides a neighbour.
    pub reverse: Reverse,
    /// Border mutation: look past the edges of what is known, from elsewhere in the cell.
    pub mutation: bool,
    /// Visiting the borders of what is known again, more finely and from elsewhere in the cell.
    pub revisit: bool,
    /// Share of rays that each strategy gets at least while it can be used: 0 to 0.2. The rest goes by recent yield.
    /// With 0 borders come first and the others wait for them, as in the paper.
    pub least_share: f64,
    /// Border jobs for one member of several triangles; later triangles of it are not followed. At least 1.
    pub jobs_per_member: u32,
    /// Whether a witness is kept for every member: 56 bytes each.
    pub witnesses: bool,
    /// Direction at sharp corners.
    pub bisector: Bisector,
}

impl Default for Options {
    /// What was found to work best over towns, loose cubes, scans and game levels.
    fn default() -> Self {
        Self {
            seed: 1,
            epsilon: 5e-5,
            tolerance: [1e-2, 1e-3],
            directions: Directions::Hemisphere,
            first_random: 1 << 14,
            border: true,
            flood: true,
            reverse: Reverse::Near,
            mutation: true,
            revisit: true,
            least_share: 0.06,
            jobs_per_member: 16,
            witnesses: false,
            bisector: Bisector::Outward,
        }
    }
}

impl Options {
    /// The paper's algorithm with its own settings (and the corrected bisector): one random ray, then borders and reverse
    /// samples until none is left, and so on; tolerance and ε both 5·10⁻⁵.
    pub fn paper() -> Self {
        Self {
            tolerance: [5e-5; 2],
            first_random: 0,
            flood: false,
            mutation: false,
            revisit: false,
            least_share: 0.0,
            ..Self::default()
        }
    }

    /// Random rays alone.
    pub fn random() -> Self {
        Self { border: false, reverse: Reverse::Off, mutation: false, revisit: false, ..Self::default() }
    }

    pub(crate) fn check(&self) -> Result<(), VisibilityError> {
        let refuse = |option, value, range| Err(VisibilityError::Option { option, value, range });
        let [coarse, fine] = self.tolerance;
        if !(1e-9..=1e-2).contains(&self.epsilon) {
            return refuse("epsilon", self.epsilon, "1e-9 to 1e-2");
        }
        if !(1e-7..=1.0).contains(&coarse) {
            return refuse("tolerance[0]", coarse, "1e-7 to 1");
        }
        if !(1e-7..=coarse).contains(&fine) {
            return refuse("tolerance[1]", fine, "1e-7 to tolerance[0]");
        }
        if !(0.0..=0.2).contains(&self.least_share) {
            return refuse("least_share", self.least_share, "0 to 0.2");
        }
        if self.jobs_per_member == 0 {
            return refuse("jobs_per_member", 0.0, "at least 1");
        }
        Ok(())
    }
}

/// When sampling stops: at the first limit reached. Limits are looked at between waves of some ten thousand rays.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Budget {
    /// Rays in all, those of earlier runs included.
    pub rays: u64,
    /// Fewer new members than this in the last million rays: the paper's criterion, with 50.
    pub new_per_million: Option<f64>,
    /// Missed pixels proven rare enough, at a confidence that all looks of the sampler share. Looks take rays of their own.
    pub missed: Option<MissedLimit>,
    /// Time of this run. The only limit that makes results depend on the machine.
    pub time: Option<Duration>,
}

/// When missed pixels are rare enough: made by [`Budget::missed`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MissedLimit {
    /// Share of pixels that may show something missing: 1e-9 to 1. Five of a million are 5e-6.
    pub(crate) share: f64,
    /// Probability with which that is to hold, above 0 and below 1.
    pub(crate) confidence: f64,
}

impl Budget {
    /// Stops when the share of missed pixels is proven at the confidence, or after `rays`.
    ///
    /// # Errors
    /// [`VisibilityError::Option`] when the share or the confidence is out of its range.
    pub fn missed(share: f64, confidence: f64, rays: u64) -> Result<Self, VisibilityError> {
        crate::sampler::check_confidence(confidence)?;
        if !(1e-9..=1.0).contains(&share) {
            return Err(VisibilityError::Option { option: "share", value: share, range: "1e-9 to 1" });
        }
        Ok(Self { missed: Some(MissedLimit { share, confidence }), ..Self::rays(rays) })
    }

    /// Stops after this many rays in all.
    pub fn rays(rays: u64) -> Self {
        Self { rays, new_per_million: None, missed: None, time: None }
    }
}
