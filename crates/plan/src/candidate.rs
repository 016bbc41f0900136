//! A way to do something, and picking among several.

use crate::choice::{Choice, Class, Reason, Rejected, Rule};
use crate::work::Work;
use farsight_geometry::Millis;
use farsight_geometry::accuracy::{ErrorBound, Unit};

/// Band in which a choice, once made, stays: an alternative must be this much better.
pub const BAND: f64 = 0.1;

/// A way to do something.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    pub choice: Choice,
    /// Error in tolerances.
    pub strain: f64,
    pub error: ErrorBound,
    pub work: Work,
    pub cost: Millis,
}

impl Candidate {
    /// Something that is exact.
    #[inline]
    pub fn exact(choice: Choice, work: Work, cost: Millis) -> Self {
        Self { choice, strain: 0.0, error: ErrorBound::proven(0.0, Unit::Pixels), work, cost }
    }

    /// Nothing, where nothing is missed.
    #[inline]
    pub fn nothing() -> Self {
        Self::exact(Choice::Nothing, Work::default(), Millis::ZERO)
    }
}

/// An error in tolerances; a tolerance of zero admits no error.
#[inline]
pub fn strain(error: f64, tolerance: f64) -> f64 {
    if error == 0.0 { 0.0 } else { error / tolerance }
}

/// Whether `candidate` may be taken where `allowed` tolerances are: once another choice was made, only well below.
#[inline]
pub fn admits(allowed: f64, strain: f64, is_previous: bool, fresh: bool) -> bool {
    strain <= if is_previous || fresh { allowed } else { allowed * (1.0 - BAND) }
}

/// The cheapest of those within `allowed` tolerances, the most exact where none is.
///
/// What was chosen before stays until something else is clearly better. `same` tells whether a choice is the previous one.
pub fn pick<'c>(
    candidates: impl Iterator<Item = &'c Candidate> + Clone,
    allowed: f64,
    same: impl Fn(&Choice) -> bool,
    fresh: bool,
) -> Option<&'c Candidate> {
    let within = |c: &&Candidate| admits(allowed, c.strain, same(&c.choice), fresh);
    let by_cost =
        |a: &&Candidate, b: &&Candidate| a.cost.0.total_cmp(&b.cost.0).then(a.strain.total_cmp(&b.strain));
    let by_strain =
        |a: &&Candidate, b: &&Candidate| a.strain.total_cmp(&b.strain).then(a.cost.0.total_cmp(&b.cost.0));
    if let Some(cheapest) = candidates.clone().filter(within).min_by(by_cost) {
        let mut previous = candidates.clone().filter(within).filter(|c| same(&c.choice));
        return previous.find(|p| cheapest.cost.0 > p.cost.0 * (1.0 - BAND)).or(Some(cheapest));
    }
    let most_exact = candidates.clone().min_by(by_strain)?;
    // Nothing cheaper stays, or a tighter tolerance might cost less.
    let mut previous = candidates.filter(|c| same(&c.choice) && c.cost >= most_exact.cost);
    previous.find(|p| most_exact.strain > p.strain * (1.0 - BAND)).or(Some(most_exact))
}

/// Why `chosen` was chosen of `candidates`; `unhurried` is what would be with time enough.
pub fn reason(candidates: &[Candidate], chosen: &Candidate, unhurried: &Candidate, allowed: f64) -> Reason {
    let tolerance = |class| Reason::new(class, Rule::Tolerance, chosen.strain, allowed);
    if chosen.cost < unhurried.cost {
        return tolerance(Class::Budgeted);
    }
    if candidates.iter().any(|c| c.strain < chosen.strain && c.cost > chosen.cost) {
        return tolerance(Class::Dominated);
    }
    match candidates.iter().filter(|c| c.cost < chosen.cost).min_by(|a, b| a.strain.total_cmp(&b.strain)) {
        Some(next) => Reason::new(Class::Kept, Rule::Tolerance, next.strain, allowed),
        None => Reason::new(Class::Kept, Rule::OnlyOne, 0.0, 0.0),
    }
}

/// What speaks against a candidate that was not chosen.
pub fn against(candidate: &Candidate, chosen: &Candidate, allowed: f64) -> Rejected {
    let because = if candidate.strain > allowed && candidate.strain > chosen.strain {
        Reason::new(Class::Kept, Rule::Tolerance, candidate.strain, allowed)
    } else {
        Reason::new(Class::Dominated, Rule::Dearer, candidate.cost.0, chosen.cost.0)
    };
    Rejected { choice: candidate.choice, because }
}
