//! How many points of a cloud.

use crate::candidate::{Candidate, strain};
use crate::choice::Choice;
use crate::summary::{CloudSummary, CloudView, Tolerances};
use crate::work::{CostModel, Work};
use farsight_geometry::accuracy::{ErrorBound, Unit};

/// As many points as `allowed` tolerances take.
pub fn points(
    cloud: &CloudSummary,
    view: &CloudView,
    tolerances: &Tolerances,
    allowed: f64,
    costs: &(impl CostModel + ?Sized),
) -> Candidate {
    let error_px = tolerances.position_px * allowed;
    let wanted = view.points_at_one_px / (error_px * error_px);
    let (points, error_px) = if wanted < cloud.points { (wanted, error_px) } else { (cloud.points, 0.0) };
    let work = Work { draws: 1.0, points, ..Work::default() };
    Candidate {
        choice: Choice::Points { error_px, points },
        strain: strain(error_px, tolerances.position_px),
        error: ErrorBound::proven(error_px, Unit::Pixels),
        work,
        cost: costs.time(&work),
    }
}
