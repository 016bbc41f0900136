//! What the planner remembers, so that decisions stay.

use crate::candidate::Candidate;
use crate::rules::object::Had;
use farsight_geometry::Millis;

/// Frames without queries before they are tried again, at first and at most.
const FIRST_PAUSE: u32 = 8;
const LONGEST_PAUSE: u32 = 256;
/// Weight of a new measurement.
const WEIGHT: f64 = 0.25;

/// What earlier frames decided and what culling did in them. A new one knows nothing.
///
/// All hysteresis is here: plans from equal summaries and equal states are equal.
#[derive(Clone, Debug, Default)]
pub struct PlanState {
    pub(crate) objects: Vec<Had>,
    pub(crate) lights: Vec<LightState>,
    pub(crate) culling: Culling,
    /// Tolerances that the last frame was given, as steps of the ladder: all together, objects and clouds, lights.
    pub(crate) rungs: Option<[u32; 3]>,
    pub(crate) controlled: bool,
}

/// What is remembered of a light.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LightState {
    /// What the last frame had.
    pub last: Option<Candidate>,
    /// The last map that was drawn.
    pub map: Option<Candidate>,
}

/// What is remembered of culling.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Culling {
    /// Time saved and spent, smoothed; `None` before the first measurement.
    pub measured: Option<(Millis, Millis)>,
    /// Frames in a row that queried, up to the last one.
    pub run: u32,
    /// Frames since queries were last tried.
    pub idle: u32,
    /// Frames to wait before they are tried again.
    pub pause: u32,
}

impl Default for Culling {
    fn default() -> Self {
        Self { measured: None, run: 0, idle: 0, pause: FIRST_PAUSE }
    }
}

impl PlanState {
    /// Knows nothing.
    pub fn new() -> Self {
        Self::default()
    }

    /// Tells what occlusion queries did in the last frame: the drawing time of the objects that they found hidden, and the time
    /// for asking. Times that are not finite are ignored.
    pub fn observe_culling(&mut self, saved: Millis, spent: Millis) {
        if saved.0.is_finite() && spent.0.is_finite() {
            self.culling.observe(saved, spent);
        }
    }
}

impl Culling {
    fn observe(&mut self, saved: Millis, spent: Millis) {
        let mix = |old: Millis, new: Millis| old * (1.0 - WEIGHT) + new * WEIGHT;
        // After a pause old measurements are worth nothing.
        let measured = match self.measured.filter(|_| self.run > 1) {
            Some((old_saved, old_spent)) => (mix(old_saved, saved), mix(old_spent, spent)),
            None => (saved, spent),
        };
        self.pause = if measured.0 > measured.1 { FIRST_PAUSE } else { (self.pause * 2).min(LONGEST_PAUSE) };
        self.measured = Some(measured);
    }

    /// Goes on to the next frame, in which queries ran or not.
    pub fn advance(&mut self, queried: bool, jumped: bool) {
        if jumped {
            self.pause = FIRST_PAUSE;
        }
        self.idle = if queried { 0 } else { self.idle.saturating_add(1) };
        self.run = if queried { self.run.saturating_add(1) } else { 0 };
    }
}
