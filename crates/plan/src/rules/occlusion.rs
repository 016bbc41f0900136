//! Whether looking for what is hidden is worth it: by measurement, with longer and longer pauses where it is not.

use crate::candidate::{BAND, strain};
use crate::choice::{Choice, Class, Reason, Rejected, Rule};
use crate::state::Culling;
use crate::summary::{Tolerances, ViewSummary};
use farsight_geometry::Millis;
use farsight_geometry::accuracy::{ErrorBound, Norm, Unit};

/// Fewer objects are drawn sooner than asked about.
const FEW: f64 = 8.0;
/// Most of the drawing time that is believed to be saved, since what is seen must still be drawn.
const MOST_SAVED: f64 = 0.9;

/// What was decided.
pub struct Occlusion {
    pub choice: Choice,
    pub because: Reason,
    pub rejected: Option<Rejected>,
    /// What sets computed beforehand may miss.
    pub error: ErrorBound,
    pub strain: f64,
    /// Time that it takes, and that is not spent on hidden objects thanks to it.
    pub spent: Millis,
    saved: Millis,
}

impl Occlusion {
    /// What it takes or saves in a frame whose objects take `objects`.
    pub fn cost(&self, objects: Millis) -> Millis {
        self.spent - self.saved.min(objects * MOST_SAVED)
    }
}

/// Decides from what culling did in earlier frames.
pub fn decide(view: &ViewSummary, culling: &Culling, tolerances: &Tolerances) -> Occlusion {
    let in_view = view.objects.iter().filter(|o| o.in_view);
    let (count, pixels) = in_view.fold((0.0, 0.0), |(n, px), o| (n + 1.0, px + o.pixels));
    if count < FEW {
        return without(Reason::new(Class::Void, Rule::FewObjects, count, FEW));
    }
    let beside = view.pixels * if culling.run > 0 { 1.0 - BAND } else { 1.0 };
    if pixels <= beside {
        return without(Reason::new(Class::Void, Rule::NothingHidden, pixels, beside));
    }
    let (queries, because) = queries(culling, view.jumped);
    let (saved, spent) = if queries { culling.measured.unwrap_or_default() } else { Default::default() };
    // Sets that may miss something are used as they are or not at all, whatever the time.
    let cell = view.cell.filter(|c| strain(c.missed, tolerances.area_shade) <= 1.0);
    let choice = match (cell.is_some(), queries) {
        (false, false) => Choice::Nothing,
        (false, true) => Choice::Queries,
        (true, false) => Choice::Cells,
        (true, true) => Choice::CellsAndQueries,
    };
    let other = match choice {
        Choice::Nothing => Choice::Queries,
        Choice::Queries => Choice::Nothing,
        Choice::Cells => Choice::CellsAndQueries,
        _ => Choice::Cells,
    };
    let rejected = Some(Rejected { choice: other, because });
    let Some(cell) = cell else {
        return Occlusion { choice, because, rejected, spent, saved, strain: 0.0, error: exact() };
    };
    let missed = strain(cell.missed, tolerances.area_shade);
    let known = Reason::new(Class::Dominated, Rule::InCell, missed, 1.0);
    let error =
        ErrorBound { kind: cell.kind, norm: Norm::Mean, ..ErrorBound::proven(cell.missed, Unit::Fraction) };
    let because = if queries { because } else { known };
    Occlusion { choice, because, rejected, spent, saved, strain: missed, error }
}

fn exact() -> ErrorBound {
    ErrorBound::proven(0.0, Unit::Pixels)
}

fn without(because: Reason) -> Occlusion {
    let none = Millis::ZERO;
    let choice = Choice::Nothing;
    Occlusion { choice, because, rejected: None, spent: none, saved: none, strain: 0.0, error: exact() }
}

/// Whether to query, and why.
fn queries(culling: &Culling, jumped: bool) -> (bool, Reason) {
    let pause = f64::from(culling.pause);
    let Some((saved, spent)) = culling.measured.filter(|_| !jumped) else {
        return (true, Reason::new(Class::Kept, Rule::Probe, f64::from(culling.idle), pause));
    };
    let needed = spent.0 * if culling.run > 0 { 1.0 } else { 1.0 + BAND };
    if saved.0 > needed {
        return (true, Reason::new(Class::Kept, Rule::Saves, saved.0, spent.0));
    }
    if culling.idle >= culling.pause {
        return (true, Reason::new(Class::Kept, Rule::Probe, f64::from(culling.idle), pause));
    }
    (false, Reason::new(Class::Dominated, Rule::Saves, saved.0, spent.0))
}
