//! How far tolerances are stretched where time is short.
//!
//! Tolerances stand on a ladder, a step being 4 %: the plan for a time limit is the plan for the lowest step that fits. The ladder is the
//! same for all limits and tolerances, so that more time and tighter tolerances can only lead down, looser ones only up.

use farsight_geometry::Millis;

/// Steps for a factor of two.
const PER_OCTAVE: f64 = 16.0;
/// Steps by which errors may rise without driving the plan back up, a fifth.
const MARGIN: u32 = 4;
/// Share of the time that must be to spare before errors are lowered.
const SPARE: f64 = 0.15;
/// How far tolerances may be stretched: 2¹⁶-fold.
const OCTAVES: u32 = 16;
/// Rung of one pixel. Rungs below belong to tolerances down to 2⁻⁶⁴.
const ONE: f64 = 64.0 * PER_OCTAVE;

/// What a frame takes.
#[derive(Clone, Copy, Debug)]
pub struct Load {
    /// All that is added up: what is uncertain.
    pub gross: Millis,
    /// Less what is saved.
    pub net: Millis,
}

/// A ladder that begins at given tolerances.
#[derive(Clone, Copy, Debug)]
pub struct Ladder {
    /// What stands for one tolerance, in units of the ladder.
    tolerance: f64,
    base: u32,
}

impl Ladder {
    /// Begins at the highest rung that is not above `tolerance`; where that is zero, rungs are multiples of whatever tolerances there are.
    pub fn new(tolerance: f64) -> Self {
        let tolerance = if tolerance > 0.0 { tolerance } else { 1.0 };
        let mut base = (tolerance.log2() * PER_OCTAVE + ONE).clamp(0.0, 2.0 * ONE).floor();
        // A logarithm that rounding lifted must not lift the tolerance.
        while base > 0.0 && height(base) > tolerance {
            base -= 1.0;
        }
        Self { tolerance, base: base as u32 }
    }

    /// The lowest rung.
    pub fn base(&self) -> u32 {
        self.base
    }

    /// Tolerances that are allowed on a rung; at the base between 0.957 and one.
    pub fn allowed(&self, rung: u32) -> f64 {
        height(f64::from(rung)) / self.tolerance
    }

    /// The lowest rung whose cost fits, the highest where none does. `cost` must not rise with the rung.
    ///
    /// The last frame's rung stays as long as it fits and none below would fit well: with time to spare even where errors were a band larger. When it must
    /// be left for a higher one, some steps more are taken, for the same reason.
    pub fn climb(&self, limit: Millis, last: Option<u32>, cost: impl Fn(u32) -> Load) -> u32 {
        self.climb_to(self.base + OCTAVES * PER_OCTAVE as u32, limit, last, cost)
    }

    /// As [`climb`](Self::climb), up to `top` at most.
    pub fn climb_to(&self, top: u32, limit: Millis, last: Option<u32>, cost: impl Fn(u32) -> Load) -> u32 {
        let Some(last) = last.map(|l| l.clamp(self.base, top)) else {
            return lowest(self.base, top, |r| cost(r).net <= limit);
        };
        if cost(last).net > limit {
            return (lowest(last, top, |r| cost(r).net <= limit) + MARGIN).min(top);
        }
        let well = |rung: u32| {
            let load = cost(rung.saturating_sub(MARGIN));
            load.net + load.gross * SPARE <= limit
        };
        if last == self.base || !well(last - 1) { last } else { lowest(self.base, last - 1, well) }
    }
}

/// Height of a rung.
fn height(rung: f64) -> f64 {
    ((rung - ONE) / PER_OCTAVE).exp2()
}

/// The lowest rung that is good, the highest where none is; whatever is above a good one is good.
fn lowest(mut low: u32, mut high: u32, good: impl Fn(u32) -> bool) -> u32 {
    if good(low) {
        return low;
    }
    while high - low > 1 {
        let middle = low + (high - low) / 2;
        if good(middle) { high = middle } else { low = middle }
    }
    high
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base_is_just_below_the_tolerance() {
        for tolerance in [0.5, 1.0, 0.7, 1e-3, 123.0, f64::MIN_POSITIVE, 1e300] {
            let ladder = Ladder::new(tolerance);
            let allowed = ladder.allowed(ladder.base());
            if (1e-18..1e18).contains(&tolerance) {
                assert!(allowed <= 1.0 && allowed > 0.957, "{tolerance}: {allowed}");
            }
        }
        assert_eq!(Ladder::new(0.5).allowed(Ladder::new(0.5).base()), 1.0);
        assert_eq!(Ladder::new(0.0).allowed(Ladder::new(0.0).base()), 1.0);
    }

    fn load(time: f64) -> Load {
        Load { gross: Millis(time), net: Millis(time) }
    }

    #[test]
    fn climbs_as_far_as_needed() {
        let ladder = Ladder::new(1.0);
        let cost = |rung: u32| load(100.0 / ladder.allowed(rung));
        let rung = ladder.climb(Millis(10.0), None, cost);
        assert!(cost(rung).net <= Millis(10.0) && cost(rung - 1).net > Millis(10.0));
        assert_eq!(ladder.climb(Millis(100.0), None, cost), ladder.base());
        // Nothing fits: the top.
        assert_eq!(ladder.climb(Millis(0.0), None, cost), ladder.base() + 256);
    }

    #[test]
    fn stays_while_the_last_rung_fits() {
        let ladder = Ladder::new(1.0);
        let cost = |factor: f64| move |rung: u32| load(factor * 100.0 / ladder.allowed(rung));
        let rung = ladder.climb(Millis(10.0), None, cost(1.0));
        for noise in [1.0, 0.97, 0.95, 0.9] {
            assert_eq!(ladder.climb(Millis(10.0), Some(rung), cost(noise)), rung);
        }
        assert!(ladder.climb(Millis(10.0), Some(rung), cost(0.5)) < rung);
        assert!(ladder.climb(Millis(10.0), Some(rung), cost(1.1)) > rung);
    }
}
