//! From summaries to a plan, frame after frame.

use crate::PlanError;
use crate::candidate::{self, Candidate};
use crate::choice::{Choice, Class, Decision, Effect, Layout, Reason, Rejected, Rule};
use crate::ladder::{Ladder, Load};
use crate::pass::Pass;
use crate::plan::Plan;
use crate::rules::object::{Had, Seen};
use crate::rules::occlusion::Occlusion;
use crate::rules::{cloud, occlusion, shadow};
use crate::state::{LightState, PlanState};
use crate::summary::{Budget, SceneSummary, ViewSummary, check};
use crate::work::{CostModel, Work};
use farsight_geometry::Millis;

/// Plans frame after frame, keeping its memory and its buffers.
#[derive(Clone, Debug, Default)]
pub struct Planner {
    state: PlanState,
    plan: Plan,
    scratch: Scratch,
}

impl Planner {
    /// Knows nothing yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Plans the next frame. Allocates nothing once it has seen as many objects and lights.
    ///
    /// # Errors
    /// As [`plan`].
    pub fn plan(
        &mut self,
        scene: &SceneSummary,
        view: &ViewSummary,
        budget: &Budget,
        costs: &(impl CostModel + ?Sized),
    ) -> Result<&Plan, PlanError> {
        check(scene, view, budget)?;
        self.state.fit(scene);
        let frame = Frame { scene, view, budget, costs };
        frame.plan(&self.state, &mut self.scratch, &mut self.plan);
        self.state.remember(&self.plan, view, &self.scratch);
        Ok(&self.plan)
    }

    /// The last plan.
    pub fn last(&self) -> &Plan {
        &self.plan
    }

    /// What is remembered; tell it what culling saved.
    pub fn state_mut(&mut self) -> &mut PlanState {
        &mut self.state
    }
}

/// Plans a frame: the plan, and what to remember for the next. Depends on its arguments only.
///
/// Without a limit, every effect gets the cheapest variant within the tolerances. With one, tolerances are stretched until the time suffices (steps of 4 %):
/// all together first, then shadows and shapes each only as far as the other leaves them to.
///
/// # Guarantees
/// From equal states: more time never raises the tolerances that are needed. Tolerances that are looser by a common factor never raise the cost.
/// The plan's cost is the sum of its decisions' costs, each as the cost model says.
///
/// # Cost
/// Linear in objects and lights: about 45 ns an object and 3 µs a light; twice that under a limit that binds, six times in the first frame of it.
///
/// # Errors
/// When lists do not match or a number means nothing; the error names it.
pub fn plan(
    scene: &SceneSummary,
    view: &ViewSummary,
    budget: &Budget,
    costs: &(impl CostModel + ?Sized),
    state: &PlanState,
) -> Result<(Plan, PlanState), PlanError> {
    let mut planner = Planner { state: state.clone(), ..Planner::default() };
    planner.plan(scene, view, budget, costs)?;
    Ok((planner.plan, planner.state))
}

/// Buffers.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    /// Candidates of all lights, one after the other.
    candidates: Vec<Candidate>,
    one: Vec<Candidate>,
    /// Where each light's candidates end; as the one before for a light that is void.
    ends: Vec<usize>,
    /// Where the ladder ended, if there is a limit: for all together, for objects and clouds, for lights.
    pub rungs: Option<[u32; 3]>,
}

impl Scratch {
    fn of_light(&self, light: usize) -> &[Candidate] {
        let from = if light == 0 { 0 } else { self.ends[light - 1] };
        &self.candidates[from..self.ends[light]]
    }
}

/// A frame to plan.
struct Frame<'a, C: ?Sized> {
    scene: &'a SceneSummary<'a>,
    view: &'a ViewSummary<'a>,
    budget: &'a Budget,
    costs: &'a C,
}

impl<C: CostModel + ?Sized> Frame<'_, C> {
    fn plan(&self, state: &PlanState, scratch: &mut Scratch, plan: &mut Plan) {
        plan.clear();
        self.collect(state, scratch);
        let occlusion = occlusion::decide(self.view, &state.culling, &self.budget.tolerances);
        let ladder = Ladder::new(self.budget.tolerances.position_px);
        let (unhurried, lights, allowed) = match self.budget.limit {
            None => {
                scratch.rungs = None;
                (1.0, 1.0, 1.0)
            }
            Some(limit) => {
                let cost = |lights, rest| {
                    self.cost(ladder.allowed(lights), ladder.allowed(rest), state, scratch, &occlusion)
                };
                let last = |i: usize| state.rungs.map(|r| r[i]);
                let most = ladder.climb(limit, last(0), |r| cost(r, r));
                // One of the two needs as much; the other may need less. A shadow that had to go must not take all shapes with it.
                let rest = ladder.climb_to(most, limit, last(1), |r| cost(most, r));
                let lights = ladder.climb_to(most, limit, last(2), |r| cost(r, rest));
                scratch.rungs = Some([most, rest, lights]);
                (ladder.allowed(ladder.base()), ladder.allowed(lights), ladder.allowed(rest))
            }
        };
        plan.allowed = lights.max(allowed);
        self.lights(state, scratch, unhurried, lights, plan);
        let place = plan.decisions.len();
        self.clouds(unhurried, allowed, plan);
        let objects = self.objects(state, unhurried, allowed, plan);
        let place = place..plan.decisions.len();
        self.insert_occlusion(&occlusion, objects, plan, place.start);
        self.frame_rate(state.controlled, plan, place.start + 1 + self.scene.clouds.len());
        self.passes(plan);
    }

    /// Lists what each light may have.
    fn collect(&self, state: &PlanState, scratch: &mut Scratch) {
        scratch.candidates.clear();
        scratch.ends.clear();
        for (i, (light, view)) in self.scene.lights.iter().zip(self.view.lights).enumerate() {
            if self.void_light(i).is_none() {
                let t = &self.budget.tolerances;
                shadow::candidates(light, view, t, &state.lights[i], self.costs, &mut scratch.one);
                scratch.candidates.extend_from_slice(&scratch.one);
            }
            scratch.ends.push(scratch.candidates.len());
        }
    }

    fn void_light(&self, light: usize) -> Option<Reason> {
        if !self.view.outputs.colour {
            return Some(Reason::new(Class::Void, Rule::NobodyReads, 0.0, 0.0));
        }
        shadow::void(&self.view.lights[light])
    }

    fn nobody_looks(&self) -> bool {
        !self.view.outputs.colour && !self.view.outputs.depth
    }

    /// The frame's time where lights are allowed `lights` tolerances and everything else `allowed`.
    fn cost(
        &self,
        lights: f64,
        allowed: f64,
        state: &PlanState,
        scratch: &Scratch,
        occlusion: &Occlusion,
    ) -> Load {
        if self.nobody_looks() {
            return Load { gross: Millis::ZERO, net: Millis::ZERO };
        }
        let lights: Millis = (0..self.scene.lights.len())
            .filter_map(|i| self.pick_light(i, lights, state, scratch))
            .map(|c| c.cost)
            .sum();
        let clouds: Millis = (0..self.scene.clouds.len()).map(|i| self.pick_cloud(i, allowed).cost).sum();
        let objects: Millis = (0..self.scene.objects.len())
            .filter_map(|i| self.seen(i, state))
            .map(|object| object.cost(allowed, self.costs))
            .sum();
        let gross = lights + clouds + objects;
        Load { gross, net: gross + occlusion.cost(objects) }
    }

    fn pick_light<'s>(
        &self,
        light: usize,
        allowed: f64,
        state: &PlanState,
        scratch: &'s Scratch,
    ) -> Option<&'s Candidate> {
        let previous = state.lights[light].previous();
        // A map that may be used again is the one that there was.
        let same = |c: &Choice| *c == Choice::Reuse || previous.is_some_and(|p| same_kind(&p, c));
        candidate::pick(scratch.of_light(light).iter(), allowed, same, previous.is_none())
    }

    fn lights(&self, state: &PlanState, scratch: &Scratch, unhurried: f64, allowed: f64, plan: &mut Plan) {
        for i in 0..self.scene.lights.len() {
            let effect = Effect::Shadow { light: i as u32 };
            let first = plan.rejected.len();
            let Some(chosen) = self.pick_light(i, allowed, state, scratch) else {
                let because = self.void_light(i).expect("only void lights have no candidates");
                plan.push(effect, &Candidate::nothing(), because, first);
                continue;
            };
            let all = scratch.of_light(i);
            let other =
                (allowed > unhurried).then(|| self.pick_light(i, unhurried, state, scratch)).flatten();
            let wished = other.unwrap_or(chosen);
            let because = match chosen.choice {
                Choice::Reuse => Reason::new(Class::Dominated, Rule::Unchanged, 0.0, 0.0),
                Choice::Nothing => Reason { rule: Rule::TooDim, ..self.dim(i, chosen, wished, allowed) },
                _ => candidate::reason(all, chosen, wished, allowed),
            };
            alternatives(all, chosen, allowed, &mut plan.rejected);
            let gain = shadow::gain(&self.view.lights[i]);
            let wanted = shadow::wanted_gain(&state.lights[i]);
            if gain < wanted {
                let because = Reason::new(Class::Kept, Rule::Gain, gain, wanted);
                let layout = Layout::Warped;
                if let Choice::Map { side, taps, caster_px, .. } = chosen.choice {
                    let choice = Choice::Map { layout, side, taps, caster_px };
                    plan.rejected.push(Rejected { choice, because });
                }
            }
            let mut chosen = *chosen;
            if let Choice::Map { caster_px, .. } = &mut chosen.choice {
                *caster_px *= allowed;
            }
            plan.push(effect, &chosen, because, first);
        }
    }

    /// Why a light has no shadow although it might have.
    fn dim(&self, light: usize, chosen: &Candidate, wished: &Candidate, allowed: f64) -> Reason {
        let class = if chosen.cost < wished.cost { Class::Budgeted } else { Class::Dominated };
        let limit = self.budget.tolerances.area_shade * allowed;
        Reason::new(class, Rule::TooDim, self.view.lights[light].contribution, limit)
    }

    fn pick_cloud(&self, cloud: usize, allowed: f64) -> Candidate {
        let (scene, view) = (&self.scene.clouds[cloud], &self.view.clouds[cloud]);
        if view.points_at_one_px == 0.0 || self.nobody_looks() {
            return Candidate::nothing();
        }
        cloud::points(scene, view, &self.budget.tolerances, allowed, self.costs)
    }

    fn clouds(&self, unhurried: f64, allowed: f64, plan: &mut Plan) {
        for i in 0..self.scene.clouds.len() {
            let (chosen, wished) = (self.pick_cloud(i, allowed), self.pick_cloud(i, unhurried));
            let first = plan.rejected.len();
            let because = if chosen.choice == Choice::Nothing {
                Reason::new(Class::Void, self.unseen(), 0.0, 0.0)
            } else if chosen.cost < wished.cost {
                Reason::new(Class::Budgeted, Rule::Tolerance, chosen.strain, allowed)
            } else if chosen.strain > 0.0 {
                Reason::new(Class::Dominated, Rule::Tolerance, chosen.strain, allowed)
            } else {
                Reason::new(Class::Kept, Rule::OnlyOne, 0.0, 0.0)
            };
            if chosen.cost < wished.cost {
                plan.rejected.push(candidate::against(&wished, &chosen, allowed));
            }
            plan.push(Effect::Cloud { cloud: i as u32 }, &chosen, because, first);
        }
    }

    fn unseen(&self) -> Rule {
        if self.nobody_looks() { Rule::NobodyReads } else { Rule::OutOfView }
    }

    #[inline]
    fn seen<'s>(&'s self, object: usize, state: &PlanState) -> Option<Seen<'s>> {
        let view = &self.view.objects[object];
        let seen = view.in_view && !self.nobody_looks();
        seen.then(|| Seen {
            object: &self.scene.objects[object],
            view,
            tolerances: &self.budget.tolerances,
            had: state.objects[object],
        })
    }

    /// Decides about all objects; what they take.
    fn objects(&self, state: &PlanState, unhurried: f64, allowed: f64, plan: &mut Plan) -> Millis {
        let mut total = Millis::ZERO;
        plan.decisions.reserve(self.scene.objects.len() + 2);
        plan.rejected.reserve(2 * self.scene.objects.len());
        for i in 0..self.scene.objects.len() {
            let first = plan.rejected.len();
            let effect = Effect::Object { object: i as u32 };
            let Some(seen) = self.seen(i, state) else {
                let because = Reason::new(Class::Void, self.unseen(), 0.0, 0.0);
                plan.push(effect, &Candidate::nothing(), because, first);
                continue;
            };
            let chosen = seen.pick(allowed, self.costs);
            let wished = if allowed > unhurried { seen.cost(unhurried, self.costs) } else { chosen.cost };
            let because = seen.reason(&chosen, wished, allowed);
            seen.rejected(&chosen, allowed, self.costs, &mut plan.rejected);
            total += chosen.cost;
            plan.push(effect, &chosen, because, first);
        }
        total
    }

    /// Enters what was decided about hidden objects, before the decisions from `place` on.
    fn insert_occlusion(&self, occlusion: &Occlusion, objects: Millis, plan: &mut Plan, place: usize) {
        let first = plan.rejected.len();
        let (chosen, because) = if self.nobody_looks() {
            (Candidate::nothing(), Reason::new(Class::Void, Rule::NobodyReads, 0.0, 0.0))
        } else {
            plan.rejected.extend(occlusion.rejected);
            let chosen = Candidate::exact(occlusion.choice, Work::default(), occlusion.cost(objects));
            let (strain, error) = (occlusion.strain, occlusion.error);
            (Candidate { strain, error, ..chosen }, occlusion.because)
        };
        plan.push(Effect::Occlusion, &chosen, because, first);
        plan.decisions[place..].rotate_right(1);
    }

    /// Decides whether frames need watching, before the decisions from `place` on.
    fn frame_rate(&self, controlled: bool, plan: &mut Plan, place: usize) {
        let first = plan.rejected.len();
        let (choice, because) = match self.budget.limit {
            None => (Choice::Nothing, Reason::new(Class::Void, Rule::NoLimit, 0.0, 0.0)),
            Some(limit) => {
                let safe = limit * if controlled { SAFE_AGAIN } else { SAFE };
                if plan.cost <= safe {
                    let because = Reason::new(Class::Dominated, Rule::Limit, plan.cost.0, safe.0);
                    (Choice::Nothing, because)
                } else {
                    (Choice::Control, Reason::new(Class::Kept, Rule::Limit, plan.cost.0, safe.0))
                }
            }
        };
        plan.push(
            Effect::FrameRate,
            &Candidate::exact(choice, Work::default(), Millis::ZERO),
            because,
            first,
        );
        plan.decisions[place..].rotate_right(1);
    }

    fn passes(&self, plan: &mut Plan) {
        let objects = plan.objects();
        let drawn = objects.iter().any(|d| d.choice != Choice::Nothing);
        let impostors = objects.iter().any(|d| matches!(d.choice, Choice::Impostor { .. }));
        let clouds = plan
            .decisions
            .iter()
            .any(|d| matches!(d.effect, Effect::Cloud { .. }) && d.choice != Choice::Nothing);
        let mut passes = std::mem::take(&mut plan.passes);
        let culls = |d: &Decision| d.effect == Effect::Occlusion && d.choice != Choice::Nothing;
        if drawn && plan.decisions.iter().any(culls) {
            passes.push(Pass::Cull);
        }
        for decision in &plan.decisions {
            if let (Effect::Shadow { light }, Choice::Map { .. }) = (decision.effect, decision.choice)
                && (drawn || clouds)
            {
                passes.push(Pass::ShadowMap { light });
            }
        }
        if impostors {
            passes.push(Pass::Impostors);
        }
        if drawn {
            passes.push(Pass::Objects);
        }
        if clouds {
            passes.push(Pass::Clouds);
        }
        plan.passes = passes;
    }
}

/// Share of the limit below which frames need no watching, and no more of it once they were watched.
const SAFE: f64 = 0.7;
const SAFE_AGAIN: f64 = 0.5;

/// The best of each other kind, of candidates that lie kind by kind.
fn alternatives(all: &[Candidate], chosen: &Candidate, allowed: f64, out: &mut Vec<Rejected>) {
    for alike in all.chunk_by(|a, b| Kind::of(&a.choice) == Kind::of(&b.choice)) {
        if Kind::of(&alike[0].choice) != Kind::of(&chosen.choice) {
            let best = candidate::pick(alike.iter(), allowed, |_| false, true);
            out.extend(best.map(|b| candidate::against(b, chosen, allowed)));
        }
    }
}

/// What a light may have, sides and samples aside.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Nothing,
    Reuse,
    Map(Layout, bool),
}

impl Kind {
    fn of(choice: &Choice) -> Self {
        match choice {
            Choice::Map { layout, taps, .. } => Kind::Map(*layout, *taps > 1),
            Choice::Reuse => Kind::Reuse,
            _ => Kind::Nothing,
        }
    }
}

/// Whether two choices are the same but for numbers that follow the view.
pub fn same_kind(a: &Choice, b: &Choice) -> bool {
    match (a, b) {
        (
            Choice::Map { layout, side, taps, .. },
            Choice::Map { layout: other, side: other_side, taps: other_taps, .. },
        ) => (layout, side, taps) == (other, other_side, other_taps),
        _ => std::mem::discriminant(a) == std::mem::discriminant(b),
    }
}

impl PlanState {
    /// Makes room for a scene; lights and objects that are new are not known.
    fn fit(&mut self, scene: &SceneSummary) {
        self.objects.resize(scene.objects.len(), Had::UNKNOWN);
        self.lights.resize(scene.lights.len(), LightState::default());
    }

    fn remember(&mut self, plan: &Plan, view: &ViewSummary, scratch: &Scratch) {
        self.rungs = scratch.rungs;
        for decision in &plan.decisions {
            let candidate = Candidate {
                choice: decision.choice,
                strain: decision.strain,
                error: decision.error,
                work: Work::default(),
                cost: decision.cost,
            };
            match decision.effect {
                Effect::Shadow { light } => {
                    let state = &mut self.lights[light as usize];
                    let void = decision.because.class == Class::Void;
                    state.last = (!void).then_some(candidate);
                    match decision.choice {
                        Choice::Map { .. } => state.map = Some(candidate),
                        Choice::Reuse => {}
                        _ => state.map = None,
                    }
                }
                Effect::Occlusion => {
                    let queried = matches!(decision.choice, Choice::Queries | Choice::CellsAndQueries);
                    self.culling.advance(queried, view.jumped);
                }
                Effect::FrameRate => self.controlled = decision.choice == Choice::Control,
                Effect::Object { object } => {
                    let void = decision.because.class == Class::Void;
                    self.objects[object as usize] =
                        if void { Had::UNKNOWN } else { Had::of(&decision.choice) };
                }
                Effect::Cloud { .. } => {}
            }
        }
    }
}

impl LightState {
    /// What was chosen last, a reused map being what it was when drawn.
    fn previous(&self) -> Option<Choice> {
        let last = self.last?;
        Some(if last.choice == Choice::Reuse { self.map.unwrap_or(last).choice } else { last.choice })
    }
}
