//! Whether looking for what is hidden is worth it: by measurement, with longer and longer pauses where it is not.

use crate::candidate::BAND;
use crate::choice::{Choice, Class, Reason, Rejected, Rule};
use crate::state::Culling;
use crate::summary::ViewSummary;
use farsight_geometry::Millis;

/// Fewer objects are drawn sooner than asked about.
const FEW: f64 = 8.0;
/// Most of the drawing time that is believed to be saved, since what is seen must still be drawn.
const MOST_SAVED: f64 = 0.9;

/// What was decided.
pub struct Occlusion {
    pub choice: Choice,
    pub because: Reason,
    pub rejected: Option<Rejected>,
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
pub fn decide(view: &ViewSummary, culling: &Culling) -> Occlusion {
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
    let choice = match (view.in_cell, queries) {
        (false, false) => Choice::Nothing,
        (false, true) => Choice::Queries,
        (true, false) => Choice::Cells,
        (true, true) => Choice::CellsAndQueries,
    };
    let other = if queries { Choice::Nothing } else { Choice::Queries };
    if choice == Choice::Cells {
        let known = Reason::new(Class::Dominated, Rule::InCell, 0.0, 0.0);
        let rejected = Some(Rejected { choice: Choice::CellsAndQueries, because });
        return Occlusion { choice, because: known, rejected, spent, saved };
    }
    let rejected = Some(Rejected { choice: other, because });
    Occlusion { choice, because, rejected, spent, saved }
}

fn without(because: Reason) -> Occlusion {
    let none = Millis::ZERO;
    Occlusion { choice: Choice::Nothing, because, rejected: None, spent: none, saved: none }
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
