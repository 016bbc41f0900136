//! A frame rate held on the simulated card: predict, choose levels, draw against the clock, learn.

use super::{Frame, SimObject, SimScene, Simulator};
use crate::{
    Budget, Controller, ControllerOptions, Deadline, Features, Heuristic, Level, Millis, Model, Refit,
};
use crate::{RefitOptions, Taken, TimingError};
use farsight_geometry::Camera;

/// What is held, and with which means.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct HoldOptions {
    /// Time that a frame may take.
    pub target: Millis,
    /// Frames of one round of the path.
    pub frames: usize,
    /// Whether levels are chosen to fit; without, everything is drawn at its finest.
    pub solver: bool,
    /// Whether the clock is asked again before each object.
    pub branch: bool,
    /// Share of the target that is never planned for.
    pub headroom: f64,
    /// Frame from which on everything takes 1.5 times as long.
    pub slower_from: Option<usize>,
}

impl Default for HoldOptions {
    /// 120 frames a second over 600 frames by all means, with a tenth of head room.
    fn default() -> Self {
        Self {
            target: Millis(1e3 / 120.0),
            frames: 600,
            solver: true,
            branch: true,
            headroom: 0.1,
            slower_from: None,
        }
    }
}

/// What came of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Held {
    /// What each frame took.
    pub times: Vec<Millis>,
    /// Frames that took longer than the target.
    pub over: usize,
    /// Benefit drawn, as a share of everything at its finest.
    pub benefit: f64,
    /// Objects that the clock gave another level than planned, or none.
    pub changed: usize,
}

/// Worth of each level as a share of the finest one's.
const WORTH: [f64; 5] = [1.0, 0.9, 0.75, 0.55, 0.3];
/// Share of the target at which the clock wants to be done: an object under way cannot be stopped.
const DONE: f64 = 0.98;

/// Draws a round of path 0 within the target as far as the options' means allow.
///
/// # Errors
/// None with the simulated card, whose features and times are possible.
pub fn hold(scene: &SimScene, card: &mut Simulator, options: &HoldOptions) -> Result<Held, TimingError> {
    // A guess of the costs that a calibration would give; the first frames put it right.
    let guess = Model { heuristic: Heuristic::Sum, costs: [7e-5, 7e-6, 0.0, 0.0] };
    let mut refit = Refit::new(guess, Millis(0.6), RefitOptions::default())?;
    let control = ControllerOptions { headroom: options.headroom, ..ControllerOptions::default() };
    let mut controller = Controller::new(options.target, control);
    let mut budget = Budget::new();
    let mut held = Held::default();
    let (mut worth, mut finest) = (0.0, 0.0);
    for i in 0..options.frames {
        if options.slower_from == Some(i) {
            card.slow_down(1.5);
        }
        let camera = scene.camera(0, i as f64 / options.frames as f64);
        let seen = scene.visible(&camera);
        let plan = Plan::new(scene, &seen, &camera, &refit);
        let setup = refit.constant() * (1.0 + refit.bias());
        let choice = budget.choose(&plan.levels, &plan.first, controller.budget() - setup)?;
        let mut frame = card.begin(&camera);
        let cheapest = (0..seen.len()).map(|k| plan.own(k)[WORTH.len() - 1].cost);
        let mut deadline = Deadline::new(options.target * DONE, cheapest);
        let mut drawn = Features::default();
        for (k, &object) in seen.iter().enumerate() {
            let planned = if options.solver { budget.chosen()[k] as usize } else { 0 };
            let level =
                if options.branch { ask(&mut deadline, &frame, plan.own(k), planned) } else { Some(planned) };
            held.changed += usize::from(level != Some(planned));
            finest += plan.own(k)[0].benefit;
            if let Some(level) = level {
                frame.draw(&scene.objects[object], level);
                drawn += plan.features[k * WORTH.len() + level];
                worth += plan.own(k)[level].benefit;
            }
        }
        let measured = frame.elapsed();
        held.over += usize::from(measured > options.target);
        held.times.push(measured);
        refit.observe(&drawn, measured)?;
        controller.observe(choice.cost + setup, measured);
    }
    held.benefit = if finest > 0.0 { worth / finest } else { 1.0 };
    Ok(held)
}

/// The level that the clock allows, `planned` or a coarser one.
fn ask(deadline: &mut Deadline, frame: &Frame, own: &[Level], planned: usize) -> Option<usize> {
    let costs: [Millis; WORTH.len()] = std::array::from_fn(|l| own[l].cost);
    match deadline.take(frame.elapsed(), &costs[planned..]) {
        Taken::Variant(coarser) => Some(planned + coarser),
        Taken::Skipped => None,
    }
}

/// What every level of every object in view asks, takes and is worth.
struct Plan {
    features: Vec<Features>,
    levels: Vec<Level>,
    first: Vec<u32>,
}

impl Plan {
    fn new(scene: &SimScene, seen: &[usize], camera: &Camera, refit: &Refit) -> Self {
        let mut plan = Self { features: Vec::new(), levels: Vec::new(), first: vec![0] };
        for &i in seen {
            let object: &SimObject = &scene.objects[i];
            for (level, worth) in object.levels.iter().zip(WORTH) {
                // All levels look alike; a coarse soup covers fewer pixels.
                let index = plan.features.len() % WORTH.len();
                let f = if index == 0 || scene.name == "forest" {
                    object.features(index, camera)
                } else {
                    level.features.with_pixels(plan.features[plan.features.len() - index].pixels)
                };
                plan.features.push(f);
                let size = plan.features[plan.features.len() - 1 - index].pixels.sqrt();
                plan.levels.push(Level { cost: refit.predict_object(&f), benefit: size * worth });
            }
            plan.first.push(plan.levels.len() as u32);
        }
        plan
    }

    fn own(&self, k: usize) -> &[Level] {
        &self.levels[self.first[k] as usize..self.first[k + 1] as usize]
    }
}
