//! A budget for the next frame, so that a wanted frame rate holds.
//!
//! Prediction does the work; the controller only decides how much of the frame's time the prediction may fill. It leaves head room, gives way at once
//! when a frame was late, comes back slowly, and does not move inside a dead band: so it cannot swing between two levels.

use crate::Millis;

/// How a controller behaves.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct ControllerOptions {
    /// Share of the frame's time that is never planned for.
    pub headroom: f64,
    /// Share of the way down that is taken at once after a late frame.
    pub fall: f64,
    /// Largest growth of the budget per frame, as a share of it.
    pub rise: f64,
    /// Relative differences between used and planned time below which nothing changes.
    pub dead_band: f64,
}

impl Default for ControllerOptions {
    /// A tenth of head room, down at once, up by 1 % a frame, nothing within 3 %.
    fn default() -> Self {
        Self { headroom: 0.1, fall: 1.0, rise: 0.01, dead_band: 0.03 }
    }
}

/// Keeps a frame rate.
#[derive(Clone, Copy, Debug)]
pub struct Controller {
    target: Millis,
    options: ControllerOptions,
    /// What the next frame may plan for.
    budget: Millis,
}

impl Controller {
    /// A controller for frames of `target`.
    pub fn new(target: Millis, options: ControllerOptions) -> Self {
        Self { target, options, budget: target * (1.0 - options.headroom) }
    }

    /// What the next frame may plan for.
    pub fn budget(&self) -> Millis {
        self.budget
    }

    /// Learns what a frame planned and what it took.
    pub fn observe(&mut self, planned: Millis, measured: Millis) {
        if !(measured.0.is_finite() && measured.0 > 0.0 && planned.0 > 0.0) {
            return;
        }
        let full = self.target * (1.0 - self.options.headroom);
        let wanted = if measured > self.target {
            // The plan was too optimistic by this factor; what would have ended in time is the goal.
            (full * (planned.0 / measured.0).min(1.0)).max(self.target * 0.05)
        } else {
            full
        };
        if wanted < self.budget {
            self.budget = self.budget + (wanted - self.budget) * self.options.fall;
        } else if (wanted.0 / self.budget.0 - 1.0) > self.options.dead_band {
            self.budget = (self.budget * (1.0 + self.options.rise)).min(wanted);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_good_prediction_leaves_the_budget_alone() {
        let mut controller = Controller::new(Millis(16.0), ControllerOptions::default());
        for i in 0..500 {
            let planned = controller.budget();
            controller.observe(planned, planned * (1.0 + 0.04 * f64::from(i).sin()));
        }
        assert_eq!(controller.budget(), Millis(14.4));
    }

    #[test]
    fn a_late_frame_gives_way_at_once_and_comes_back_slowly_without_a_cycle() {
        let mut controller = Controller::new(Millis(16.0), ControllerOptions::default());
        controller.observe(controller.budget(), Millis(24.0));
        let low = controller.budget();
        assert!(low.0 < 10.0);
        let mut last = low;
        for _ in 0..400 {
            controller.observe(controller.budget(), controller.budget());
            assert!(controller.budget() >= last && controller.budget().0 <= last.0 * 1.011);
            last = controller.budget();
        }
        assert!(last.0 > 13.9);
    }

    #[test]
    fn nonsense_changes_nothing() {
        let mut controller = Controller::new(Millis(16.0), ControllerOptions::default());
        for t in [f64::NAN, 0.0, -5.0, f64::INFINITY] {
            controller.observe(Millis(14.0), Millis(t));
        }
        assert_eq!(controller.budget(), Millis(14.4));
    }
}
