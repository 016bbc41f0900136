//! What was decided for a frame, and why.

use crate::candidate::Candidate;
use crate::choice::{Choice, Class, Decision, Effect, Reason, Rejected};
use crate::pass::Pass;
use crate::work::Work;
use farsight_geometry::Millis;
use std::fmt;

/// What a frame does, and why.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Plan {
    /// One decision for each effect: shadows of lights, occlusion, clouds, frame rate, objects.
    pub decisions: Vec<Decision>,
    /// What to run, in this order. Every pass is read by a later one, or is what the frame is drawn for.
    pub passes: Vec<Pass>,
    /// Work of the image, before hidden objects are left out.
    pub work: Work,
    /// Work of shadow maps, samples taken from them included.
    pub shadow_work: Work,
    /// What it takes, by the cost model: the sum over the decisions, less what hidden objects save.
    pub cost: Millis,
    /// Largest error in tolerances; above one where time is short or nothing finer can be had.
    pub strain: f64,
    /// Tolerances that were allowed: one unless time is short.
    pub allowed: f64,
    pub(crate) rejected: Vec<Rejected>,
}

impl Plan {
    /// The alternatives to a decision of this plan that came closest, and what was against them.
    pub fn rejected(&self, decision: &Decision) -> &[Rejected] {
        let (from, to) = decision.rejected;
        self.rejected.get(from as usize..to as usize).unwrap_or(&[])
    }

    /// The decision about an effect.
    pub fn decision(&self, effect: Effect) -> Option<&Decision> {
        self.decisions.iter().find(|d| d.effect == effect)
    }

    /// The decisions about objects, in the scene's order.
    pub fn objects(&self) -> &[Decision] {
        let is_object = |d: &Decision| matches!(d.effect, Effect::Object { .. });
        let first = self.decisions.iter().position(is_object).unwrap_or(self.decisions.len());
        &self.decisions[first..]
    }

    pub(crate) fn clear(&mut self) {
        self.decisions.clear();
        self.passes.clear();
        self.rejected.clear();
        (self.work, self.shadow_work, self.cost) = (Work::default(), Work::default(), Millis::ZERO);
        (self.strain, self.allowed) = (0.0, 1.0);
    }

    #[inline]
    pub(crate) fn push(
        &mut self,
        effect: Effect,
        chosen: &Candidate,
        because: Reason,
        first_rejected: usize,
    ) {
        let shadow = matches!(effect, Effect::Shadow { .. });
        *(if shadow { &mut self.shadow_work } else { &mut self.work }) += chosen.work;
        self.cost += chosen.cost;
        self.strain = self.strain.max(chosen.strain);
        self.decisions.push(Decision {
            effect,
            choice: chosen.choice,
            because,
            cost: chosen.cost,
            error: chosen.error,
            strain: chosen.strain,
            rejected: (first_rejected as u32, self.rejected.len() as u32),
        });
    }
}

impl fmt::Display for Plan {
    /// A line for each decision, those about objects counted by choice.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let objects = self.objects();
        for decision in &self.decisions[..self.decisions.len() - objects.len()] {
            writeln!(f, "{decision}")?;
            for r in self.rejected(decision) {
                writeln!(f, "    not {}: {}", r.choice, r.because)?;
            }
        }
        type Is = fn(&Decision) -> bool;
        let kinds: [(&str, Is); 5] = [
            ("all of it", |d| d.choice == Choice::Full),
            ("a coarser form", |d| matches!(d.choice, Choice::Detail { .. })),
            ("an impostor", |d| matches!(d.choice, Choice::Impostor { .. })),
            ("too small to show", |d| d.choice == Choice::Nothing && d.because.class != Class::Void),
            ("out of view", |d| d.because.class == Class::Void),
        ];
        for (name, is) in kinds {
            let mine = objects.iter().filter(|d| is(d));
            let (count, cost) = mine.fold((0, Millis::ZERO), |(n, c), d| (n + 1, c + d.cost));
            if count > 0 {
                writeln!(f, "{count} objects: {name}; {:.3} ms", cost.0)?;
            }
        }
        write!(
            f,
            "{:.3} ms in all, error {:.2} tolerances, {:.2} allowed",
            self.cost.0, self.strain, self.allowed
        )
    }
}
