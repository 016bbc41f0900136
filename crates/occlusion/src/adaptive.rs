//! Pauses while occlusion culling does not pay.

use crate::policy::Adaptive;

/// What a frame does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Mode {
    /// Culls.
    Culling,
    /// Draws what is in the view volume.
    Paused,
    /// Draws the same, and queries one leaf in some.
    Probing,
}

/// Answers since the last judgement.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Yield {
    pub(crate) answers: u64,
    pub(crate) occluded: u64,
}

/// Frames of culling before its yield is judged: the first ones after a pause only learn.
const TRIAL: u32 = 3;
/// Queries that make a judgement worth something.
const FEW: u64 = 16;

#[derive(Clone, Copy, Debug)]
pub(crate) struct Switch {
    mode: Mode,
    /// Frames in this mode.
    age: u32,
    pause: u32,
}

impl Default for Switch {
    fn default() -> Self {
        Self { mode: Mode::Culling, age: 0, pause: 0 }
    }
}

impl Switch {
    pub(crate) fn mode(&self) -> Mode {
        self.mode
    }

    /// The mode of the next frame, from what the last one's queries found.
    pub(crate) fn advance(&mut self, options: &Adaptive, last: &Yield) {
        self.age += 1;
        let pays = last.occluded as f64 >= options.least_occluded * last.answers as f64;
        match self.mode {
            Mode::Culling if pays || last.answers < FEW => {
                // Culling that has paid for long earns a short first pause.
                self.pause = if self.age > options.longest_pause { 0 } else { self.pause };
            }
            Mode::Culling if self.age > TRIAL => {
                self.pause = (2 * self.pause).clamp(options.shortest_pause, options.longest_pause);
                self.enter(Mode::Paused);
            }
            Mode::Culling => {}
            Mode::Paused if self.age >= self.pause => self.enter(Mode::Probing),
            Mode::Paused => {}
            // The answers of a probe come while it lasts or in the frame after it.
            Mode::Probing if last.answers > 0 && pays => self.enter(Mode::Culling),
            Mode::Probing if self.age > 1 => {
                self.pause = (2 * self.pause).clamp(options.shortest_pause, options.longest_pause);
                self.enter(Mode::Paused);
            }
            Mode::Probing => {}
        }
    }

    /// Whether a probing frame issues queries: the first one does, the second only listens.
    pub(crate) fn asks(&self) -> bool {
        self.age == 0
    }

    fn enter(&mut self, mode: Mode) {
        (self.mode, self.age) = (mode, 0);
    }
}
