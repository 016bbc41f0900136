//! The conditional branch of Wimmer 2007, 2.6.4: what a graphics card would need in order to keep a deadline by itself, in software.
//!
//! Objects come with a list of ways to draw them, best first. Before each is drawn, the time left is compared with what remains: the object's
//! best variant whose time, plus the least time of everything after it, still fits is taken. So an estimate that failed costs detail at the
//! end of the frame instead of the frame.

use crate::Millis;

/// What the clock decided for an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Taken {
    /// This variant, 0 being the best.
    Variant(usize),
    /// Nothing: not even the cheapest variant fits.
    Skipped,
}

/// A frame under way.
#[derive(Clone, Debug)]
pub struct Deadline {
    /// Least time of everything not yet decided.
    remaining: Millis,
    limit: Millis,
    /// When the first object was asked for.
    started: Option<Millis>,
    /// What the objects taken so far were expected to take.
    expected: Millis,
}

/// Share of the limit that must be drawn before its pace says something of the rest.
const LEAST_EVIDENCE: f64 = 0.1;

impl Deadline {
    /// A frame that must end within `limit`, for objects whose cheapest variants take `cheapest`.
    pub fn new(limit: Millis, cheapest: impl IntoIterator<Item = Millis>) -> Self {
        Self { remaining: cheapest.into_iter().sum(), limit, started: None, expected: Millis::ZERO }
    }

    /// Decides for the next object at `elapsed` since the frame's start.
    ///
    /// Expected times are stretched by how much longer than expected the frame took so far; they are never shortened. `variants` are the expected times of its ways to be drawn, best first; the last one must be the cheapest, as given to [`new`](Self::new).
    pub fn take(&mut self, elapsed: Millis, variants: &[Millis]) -> Taken {
        let cheapest = variants.last().copied().unwrap_or(Millis::ZERO);
        // Rounding must not leave a remainder that keeps later objects out.
        self.remaining = (self.remaining - cheapest).max(Millis::ZERO);
        let pace = self.pace(elapsed);
        let ends = |t: Millis, rest: Millis| elapsed + (t + rest) * pace;
        let best = variants.iter().position(|&t| ends(t, self.remaining) <= self.limit);
        // Even the rest at its cheapest is too long: this object gets what it can have without pushing past the limit.
        let last = variants.len().checked_sub(1).filter(|&l| ends(variants[l], Millis::ZERO) <= self.limit);
        match best.or(last) {
            Some(variant) => {
                self.expected += variants[variant];
                Taken::Variant(variant)
            }
            None => Taken::Skipped,
        }
    }

    /// How many times longer than expected the frame took so far; at least 1.
    fn pace(&mut self, elapsed: Millis) -> f64 {
        let started = *self.started.get_or_insert(elapsed);
        let evidence = self.expected > self.limit * LEAST_EVIDENCE;
        if evidence { ((elapsed - started) / self.expected).max(1.0) } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn detail_falls_when_time_runs_short_and_the_frame_ends_in_time() {
        let variants = [Millis(2.0), Millis(1.0), Millis(0.2)];
        // The estimates are right: all fit at their best.
        let mut frame = Deadline::new(Millis(20.0), vec![Millis(0.2); 10]);
        let mut elapsed = Millis::ZERO;
        for _ in 0..10 {
            assert_eq!(frame.take(elapsed, &variants), Taken::Variant(0));
            elapsed += Millis(2.0);
        }
        // Everything takes 1.8 times as long: the end gets cheaper variants.
        let mut frame = Deadline::new(Millis(20.0), vec![Millis(0.2); 10]);
        let (mut elapsed, mut taken) = (Millis::ZERO, Vec::new());
        for _ in 0..10 {
            if let Taken::Variant(i) = frame.take(elapsed, &variants) {
                elapsed += variants[i] * 1.8;
                taken.push(i);
            }
        }
        assert!(elapsed.0 <= 20.0 && taken[0] == 0 && *taken.last().unwrap() > 0, "{elapsed:?} {taken:?}");
    }

    #[test]
    fn nothing_fits_after_the_deadline() {
        let mut frame = Deadline::new(Millis(1.0), vec![Millis(0.5); 2]);
        assert_eq!(frame.take(Millis(3.0), &[Millis(2.0), Millis(0.5)]), Taken::Skipped);
        assert_eq!(frame.take(Millis(0.4), &[]), Taken::Skipped);
    }
}
