//! What the planner promises, on scenes drawn by lot.

use crate::*;
use proptest::prelude::*;

/// A small generator of numbers, so that a seed is a scene.
struct Lot(u64);

impl Lot {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Between two positive numbers, evenly in their logarithm.
    fn log(&mut self, from: f64, to: f64) -> f64 {
        from * (to / from).powf(self.next())
    }

    fn chance(&mut self, share: f64) -> bool {
        self.next() < share
    }
}

/// A scene with a view of it, owning its lists.
#[derive(Clone)]
struct World {
    details: Vec<Vec<Detail>>,
    objects: Vec<(f64, f64, bool)>,
    seen: Vec<ObjectView>,
    lights: Vec<LightSummary>,
    lit: Vec<LightView>,
    clouds: Vec<CloudSummary>,
    cloud_views: Vec<CloudView>,
    cell: Option<CellView>,
}

impl World {
    fn new(seed: u64) -> Self {
        let mut lot = Lot(seed);
        let count = lot.log(1.0, 60.0) as usize;
        let mut world = World {
            details: Vec::new(),
            objects: Vec::new(),
            seen: Vec::new(),
            lights: Vec::new(),
            lit: Vec::new(),
            clouds: Vec::new(),
            cloud_views: Vec::new(),
            cell: lot.chance(0.3).then(|| CellView { missed: lot.log(1e-6, 1e-2), kind: Kind::Measured }),
        };
        for _ in 0..count {
            let triangles = lot.log(10.0, 1e6);
            world.details.push(details(&mut lot, triangles));
            world.objects.push((lot.log(1.0, 5.0), triangles, lot.chance(0.5)));
            let size_px = lot.log(0.01, 2000.0);
            world.seen.push(ObjectView {
                in_view: lot.chance(0.8),
                size_px,
                pixels: size_px * size_px * lot.next(),
                px_per_unit: lot.log(0.1, 1000.0),
                impostor_frames: lot.log(0.5, 1000.0),
            });
        }
        for _ in 0..(lot.next() * 4.0) as usize {
            world.lights.push(LightSummary { most_side: 4096, most_cascades: 4, most_taps: 64 });
            world.lit.push(light(&mut lot));
        }
        for _ in 0..(lot.next() * 3.0) as usize {
            world.clouds.push(CloudSummary { points: lot.log(1e3, 1e9) });
            world.cloud_views.push(CloudView { points_at_one_px: lot.log(1e3, 1e7) });
        }
        world
    }

    fn plan_with(&self, budget: &Budget, outputs: Outputs, planner: &mut Planner) -> Plan {
        let objects: Vec<ObjectSummary> = self
            .objects
            .iter()
            .zip(&self.details)
            .map(|(&(draws, triangles, impostor), details)| ObjectSummary {
                draws,
                vertices: 0.6 * triangles,
                triangles,
                details,
                impostor,
            })
            .collect();
        let scene = SceneSummary { objects: &objects, lights: &self.lights, clouds: &self.clouds };
        let view = ViewSummary {
            pixels: 1e6,
            outputs,
            objects: &self.seen,
            lights: &self.lit,
            clouds: &self.cloud_views,
            cell: self.cell,
            jumped: false,
        };
        planner.plan(&scene, &view, budget, &Costs::default()).unwrap().clone()
    }

    fn plan(&self, budget: &Budget) -> Plan {
        self.plan_with(budget, Outputs::PICTURE, &mut Planner::new())
    }

    /// The same with every number of the view off by up to `share`.
    fn shaken(&self, lot: &mut Lot, share: f64) -> Self {
        let mut other = self.clone();
        let mut shake = |x: &mut f64| *x *= 1.0 + share * (2.0 * lot.next() - 1.0);
        for o in &mut other.seen {
            let numbers = [&mut o.size_px, &mut o.pixels, &mut o.px_per_unit, &mut o.impostor_frames];
            numbers.into_iter().for_each(&mut shake);
        }
        for l in &mut other.lit {
            let numbers = [
                &mut l.receiver_pixels,
                &mut l.caster_triangles,
                &mut l.contribution,
                &mut l.penumbra_px,
                &mut l.texels.uniform,
                &mut l.texels.warped,
            ];
            numbers.into_iter().for_each(&mut shake);
            l.texels.cascades.iter_mut().for_each(&mut shake);
            // What shakes does not stand still.
            l.unchanged = false;
        }
        other
    }
}

fn details(lot: &mut Lot, triangles: f64) -> Vec<Detail> {
    let (mut error, mut elements) = (lot.log(1e-4, 1e-2), triangles);
    (0..(lot.next() * 7.0) as usize)
        .map(|i| {
            error *= lot.log(1.2, 5.0);
            elements *= lot.next();
            let form = [Form::Mesh, Form::Cut, Form::Points][i % 3];
            Detail { form, error, kind: Kind::Proven, elements }
        })
        .collect()
}

fn light(lot: &mut Lot) -> LightView {
    let uniform = lot.log(100.0, 1e6);
    let warped = uniform / lot.log(1.0, 50.0);
    let cascades = [warped / lot.log(1.0, 2.0), warped / lot.log(2.0, 3.0), warped / lot.log(3.0, 4.0)];
    LightView {
        receiver_pixels: if lot.chance(0.1) { 0.0 } else { lot.log(1.0, 1e6) },
        caster_triangles: if lot.chance(0.2) { 0.0 } else { lot.log(10.0, 1e7) },
        caster_draws: lot.log(1.0, 1000.0),
        contribution: lot.log(1e-4, 1.0),
        texels: TexelSpread { uniform, warped, cascades },
        penumbra_px: if lot.chance(0.5) { 0.0 } else { lot.log(0.01, 50.0) },
        unchanged: lot.chance(0.2),
    }
}

fn limits() -> impl Strategy<Value = Option<f64>> {
    prop_oneof![Just(None), (-4.0..3.0f64).prop_map(|x| Some(10f64.powf(x)))]
}

fn budget(limit: Option<f64>, factor: f64) -> Budget {
    Budget { limit: limit.map(Millis), tolerances: Tolerances::default().times(factor) }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn equal_numbers_give_equal_plans(seed: u64, limit in limits()) {
        let world = World::new(seed);
        prop_assert_eq!(world.plan(&budget(limit, 1.0)), world.plan(&budget(limit, 1.0)));
    }

    #[test]
    fn more_time_never_raises_an_error(seed: u64, limit in 1e-4..1e3f64, more in 1.0..100.0f64) {
        let world = World::new(seed);
        let (short, long) = (world.plan(&budget(Some(limit), 1.0)), world.plan(&budget(Some(limit * more), 1.0)));
        // Shadows may take the time that shapes were given, or the other way round, but the largest error falls.
        prop_assert!(long.strain <= short.strain.max(short.allowed), "{} {}", long.strain, short.strain);
    }

    #[test]
    fn looser_tolerances_never_raise_the_cost(seed: u64, limit in limits(), factor in 0.01..100.0f64, more in 1.0..100.0f64) {
        let world = World::new(seed);
        let (tight, loose) = (world.plan(&budget(limit, factor)), world.plan(&budget(limit, factor * more)));
        let rounding = 1e-12 * tight.cost.0.abs();
        prop_assert!(loose.cost.0 <= tight.cost.0 + rounding, "{} against {}", loose.cost.0, tight.cost.0);
    }

    #[test]
    fn any_looser_tolerance_saves_where_tolerances_can_be_kept(seed: u64, which in 0..4usize, more in 1.0..100.0f64) {
        let world = World::new(seed);
        let tight = Tolerances::default();
        let mut loose = tight;
        *[&mut loose.position_px, &mut loose.texel_px, &mut loose.edge_shade, &mut loose.area_shade][which] *= more;
        let plan = |tolerances| world.plan(&Budget::unlimited(tolerances));
        let tight = plan(tight);
        // Where they cannot, the least error is taken, whatever it costs.
        let kept = tight.strain <= 1.0;
        prop_assert!(!kept || plan(loose).cost.0 <= tight.cost.0 + 1e-12 * tight.cost.0.abs());
    }

    #[test]
    fn a_limit_is_kept_if_anything_keeps_it(seed: u64, limit in 1e-4..1e3f64) {
        let world = World::new(seed);
        let plan = world.plan(&budget(Some(limit), 1.0));
        let cheapest = world.plan(&budget(Some(0.0), 1.0));
        prop_assert!(plan.cost.0 <= limit.max(cheapest.cost.0) * (1.0 + 1e-12));
    }

    #[test]
    fn within_tolerances_unless_time_is_short_or_nothing_finer_exists(seed: u64, factor in 0.1..10.0f64) {
        let world = World::new(seed);
        let plan = world.plan(&budget(None, factor));
        prop_assert_eq!(plan.decisions.iter().filter(|d| d.because.class == Class::Budgeted).count(), 0);
        for d in plan.decisions.iter().filter(|d| !matches!(d.effect, Effect::Shadow { .. })) {
            prop_assert!(d.strain <= 1.0 + 1e-12, "{d}");
        }
        for d in plan.decisions.iter().filter(|d| d.strain > 1.0) {
            let finer = plan.rejected(d).iter().filter(|r| r.because.rule == Rule::Dearer);
            prop_assert_eq!(finer.filter(|r| r.because.value.is_nan()).count(), 0);
        }
    }

    #[test]
    fn costs_add_up_and_every_pass_is_read(seed: u64, limit in limits(), colour: bool, depth: bool) {
        let world = World::new(seed);
        let outputs = Outputs { colour, depth };
        let plan = world.plan_with(&budget(limit, 1.0), outputs, &mut Planner::new());
        let sum: f64 = plan.decisions.iter().map(|d| d.cost.0).sum();
        prop_assert!((plan.cost.0 - sum).abs() <= 1e-9 * sum.abs());
        let resources = [Resource::Visible, Resource::Pictures, Resource::Colour, Resource::Depth]
            .into_iter().chain((0..world.lights.len() as u32).map(Resource::Map));
        for (i, pass) in plan.passes.iter().enumerate() {
            let read = resources.clone().filter(|&r| pass.makes(r)).any(|r| {
                is_output(r, outputs) || plan.passes[i + 1..].iter().any(|p| p.reads(r, outputs))
            });
            prop_assert!(read, "{pass:?} of {:?}", plan.passes);
        }
        if !colour {
            let maps = plan.passes.iter().filter(|p| matches!(p, Pass::ShadowMap { .. })).count();
            prop_assert_eq!(maps, 0);
        }
    }

    #[test]
    fn taking_something_away_adds_no_pass(seed: u64, which in 0..1000usize, kind in 0..3u8) {
        let world = World::new(seed);
        let mut less = world.clone();
        let mut light_gone = None;
        match kind {
            0 => {
                let i = which % less.objects.len();
                less.objects.remove(i);
                less.details.remove(i);
                less.seen.remove(i);
            }
            1 if !less.lights.is_empty() => {
                let i = which % less.lights.len();
                less.lights.remove(i);
                less.lit.remove(i);
                light_gone = Some(i as u32);
            }
            2 if !less.clouds.is_empty() => {
                let i = which % less.clouds.len();
                less.clouds.remove(i);
                less.cloud_views.remove(i);
            }
            _ => return Ok(()),
        }
        let (all, fewer) = (world.plan(&budget(None, 1.0)), less.plan(&budget(None, 1.0)));
        for pass in &fewer.passes {
            let before = match *pass {
                Pass::ShadowMap { light } if light_gone.is_some_and(|gone| light >= gone) => Pass::ShadowMap { light: light + 1 },
                other => other,
            };
            prop_assert!(all.passes.contains(&before), "{pass:?} is new");
        }
    }

    #[test]
    fn noise_flips_no_decision(seed: u64) {
        prop_assert_eq!(most_returns(seed, None), 0);
    }
}

/// Under a limit, decisions hang together: nearly all settle after going back once.
#[test]
fn decisions_settle_under_a_limit() {
    let restless = |seed: &u64| most_returns(*seed, Some(Lot(*seed).log(1e-2, 10.0))) > 2;
    let count = (0..1000).filter(restless).count();
    assert!(count <= 2, "{count} of 1000");
}

/// How often the most restless decision returns to a choice that it had left while all numbers of the view shake by 2 %, the first frames
/// left out.
fn most_returns(seed: u64, limit: Option<f64>) -> usize {
    let world = World::new(seed);
    let (mut planner, mut lot) = (Planner::new(), Lot(seed ^ 1));
    planner.state_mut().observe_culling(Millis(1.0), Millis(0.1));
    let mut past: Vec<(Vec<Choice>, usize)> = Vec::new();
    for frame in 0..80 {
        let shaken = world.shaken(&mut lot, 0.02);
        let plan = shaken.plan_with(&budget(limit, 1.0), Outputs::PICTURE, &mut planner);
        planner.state_mut().observe_culling(Millis(1.0), Millis(0.1));
        past.resize(plan.decisions.len(), (Vec::new(), 0));
        // The first frames may find out how much time there is.
        if frame < 10 {
            continue;
        }
        for (d, (had, returns)) in plan.decisions.iter().zip(&mut past) {
            let choice = steady(d.choice);
            if had.last() != Some(&choice) {
                *returns += usize::from(had.contains(&choice));
                had.push(choice);
            }
        }
    }
    past.iter().map(|(_, returns)| *returns).max().unwrap_or(0)
}

/// A choice without the numbers that follow the view by nature.
fn steady(choice: Choice) -> Choice {
    match choice {
        Choice::Map { layout, side, taps, .. } => Choice::Map { layout, side, taps, caster_px: 0.0 },
        Choice::Points { .. } => Choice::Points { error_px: 0.0, points: 0.0 },
        Choice::Impostor { .. } => Choice::Impostor { error_px: 0.0 },
        other => other,
    }
}

/// An object that covers a tenth of the view, before a plain view.
fn simple() -> (ObjectSummary<'static>, ObjectView) {
    let object = ObjectSummary { draws: 1.0, vertices: 600.0, triangles: 1000.0, ..ObjectSummary::default() };
    let view =
        ObjectView { in_view: true, size_px: 300.0, pixels: 9e4, px_per_unit: 10.0, impostor_frames: 0.0 };
    (object, view)
}

fn one_light(change: impl FnOnce(&mut LightView)) -> Decision {
    let (object, seen) = simple();
    let mut view = LightView {
        receiver_pixels: 5e4,
        caster_triangles: 1e4,
        caster_draws: 10.0,
        contribution: 0.8,
        texels: TexelSpread { uniform: 20_000.0, warped: 1000.0, cascades: [600.0, 500.0, 450.0] },
        penumbra_px: 0.0,
        unchanged: false,
    };
    change(&mut view);
    let scene = SceneSummary {
        objects: &[object],
        lights: &[LightSummary { most_side: 4096, most_cascades: 4, most_taps: 64 }],
        clouds: &[],
    };
    let view = ViewSummary {
        pixels: 1e6,
        outputs: Outputs::PICTURE,
        objects: &[seen],
        lights: &[view],
        clouds: &[],
        cell: None,
        jumped: false,
    };
    let (plan, _) = plan(&scene, &view, &Budget::default(), &Costs::default(), &PlanState::new()).unwrap();
    *plan.decision(Effect::Shadow { light: 0 }).unwrap()
}

#[test]
fn shadows_by_hand() {
    // 1000 texels do with a warp, so 1024 it is: the least power of two, hard since the light has no extent.
    let d = one_light(|_| {});
    assert!(matches!(d.choice, Choice::Map { layout: Layout::Warped, side: 1024, taps: 1, .. }), "{d}");
    assert!((d.error.value - 1000.0 / 1024.0).abs() < 1e-12 && d.error.kind == Kind::Proven);
    for (rule, change) in [
        (Rule::NoReceiver, (|v| v.receiver_pixels = 0.0) as fn(&mut LightView)),
        (Rule::NoCaster, |v| v.caster_triangles = 0.0),
        (Rule::TooDim, |v| v.contribution = 0.0),
    ] {
        let d = one_light(change);
        assert_eq!((d.choice, d.because.rule, d.because.class), (Choice::Nothing, rule, Class::Void));
    }
    // Half a step of the display is seen by nobody, but it is not nothing.
    let d = one_light(|v| v.contribution = 0.4 / 255.0);
    assert_eq!(
        (d.choice, d.because.rule, d.because.class),
        (Choice::Nothing, Rule::TooDim, Class::Dominated)
    );
    // A quarter of a pixel of penumbra is 1/32 of the light at most; a pixel is four times that.
    let taps = |s: f64| match one_light(|v| (v.penumbra_px, v.contribution) = (s, 1.0)).choice {
        Choice::Map { taps, .. } => taps,
        other => panic!("{other}"),
    };
    assert_eq!((taps(0.25), taps(0.26), taps(10.0)), (1, 18, 18));
    // A warp that gains a tenth is not worth a map that cannot be kept still.
    let d =
        one_light(|v| v.texels = TexelSpread { uniform: 1100.0, cascades: [f64::INFINITY; 3], ..v.texels });
    assert!(matches!(d.choice, Choice::Map { layout: Layout::Uniform, side: 2048, .. }), "{d}");
    // More texels than a map may have: the least error that can be had.
    let d = one_light(|v| v.texels = TexelSpread { uniform: 9e6, warped: 9e5, cascades: [9e4, 4e4, 3e4] });
    assert!(matches!(d.choice, Choice::Map { layout: Layout::Cascades(4), side: 4096, .. }), "{d}");
    assert!(d.strain > 1.0);
}

#[test]
fn a_still_light_keeps_its_map() {
    let world = {
        let mut world = World::new(3);
        world.lights = vec![LightSummary { most_side: 2048, most_cascades: 1, most_taps: 1 }];
        let mut still = light(&mut Lot(5));
        (still.receiver_pixels, still.caster_triangles, still.contribution) = (1e5, 1e5, 1.0);
        still.texels = TexelSpread { uniform: 2000.0, warped: 2000.0, cascades: [f64::INFINITY; 3] };
        (still.unchanged, still.penumbra_px) = (true, 0.0);
        world.lit = vec![still];
        world
    };
    let mut planner = Planner::new();
    let shadow = |planner: &mut Planner, world: &World| {
        let plan = world.plan_with(&Budget::default(), Outputs::PICTURE, planner);
        *plan.decision(Effect::Shadow { light: 0 }).unwrap()
    };
    let first = shadow(&mut planner, &world);
    assert!(matches!(first.choice, Choice::Map { .. }), "{first}");
    for _ in 0..3 {
        let next = shadow(&mut planner, &world);
        assert_eq!((next.choice, next.because.rule), (Choice::Reuse, Rule::Unchanged));
        assert!(next.cost < first.cost && next.error == first.error);
    }
    let mut moved = world.clone();
    moved.lit[0].unchanged = false;
    assert!(matches!(shadow(&mut planner, &moved).choice, Choice::Map { .. }));
}

#[test]
fn culling_pauses_longer_and_longer_where_it_is_useless() {
    let mut world = World::new(1);
    let (_, seen) = simple();
    world.cell = None;
    world.objects = vec![(1.0, 1000.0, false); 40];
    world.details = vec![Vec::new(); 40];
    world.seen = vec![ObjectView { pixels: 1e5, ..seen }; 40];
    let mut planner = Planner::new();
    let mut tried = Vec::new();
    for frame in 0..400 {
        let plan = world.plan_with(&Budget::default(), Outputs::PICTURE, &mut planner);
        if plan.decision(Effect::Occlusion).unwrap().choice == Choice::Queries {
            tried.push(frame);
            planner.state_mut().observe_culling(Millis(0.1), Millis(0.2));
        }
    }
    let pauses: Vec<i32> = tried.windows(2).map(|w| w[1] - w[0]).collect();
    assert_eq!(pauses, [17, 33, 65, 129]);
    // Where it saves, it stays on; the saving shows in the cost.
    for _ in 0..300 {
        let plan = world.plan_with(&Budget::default(), Outputs::PICTURE, &mut planner);
        if plan.decision(Effect::Occlusion).unwrap().choice == Choice::Queries {
            planner.state_mut().observe_culling(Millis(0.9), Millis(0.2));
        }
    }
    let plan = world.plan_with(&Budget::default(), Outputs::PICTURE, &mut planner);
    let d = plan.decision(Effect::Occlusion).unwrap();
    assert_eq!((d.choice, d.because.rule), (Choice::Queries, Rule::Saves));
    assert!(d.cost < Millis(-0.5), "{d}");
}

#[test]
fn sets_that_miss_too_much_are_not_used() {
    let mut world = World::new(1);
    let (_, seen) = simple();
    world.objects = vec![(1.0, 1000.0, false); 40];
    world.details = vec![Vec::new(); 40];
    world.seen = vec![ObjectView { pixels: 1e5, ..seen }; 40];
    let mut choice = |missed: f64| {
        world.cell = Some(CellView { missed, kind: Kind::Measured });
        let mut planner = Planner::new();
        // Queries were measured to be useless.
        planner.state_mut().observe_culling(Millis(0.0), Millis(1.0));
        let plan = world.plan_with(&Budget::default(), Outputs::PICTURE, &mut planner);
        *plan.decision(Effect::Occlusion).unwrap()
    };
    let good = choice(1e-4);
    assert_eq!((good.choice, good.because.rule, good.error.value), (Choice::Cells, Rule::InCell, 1e-4));
    assert_eq!(choice(1e-2).choice, Choice::Nothing);
}

#[test]
fn few_or_side_by_side_objects_are_not_asked_about() {
    let mut world = World::new(1);
    let (_, seen) = simple();
    world.objects = vec![(1.0, 1000.0, false); 10];
    world.details = vec![Vec::new(); 10];
    world.seen = vec![seen; 10];
    let rule = |world: &World| world.plan(&Budget::default()).decision(Effect::Occlusion).unwrap().because;
    assert_eq!((rule(&world).class, rule(&world).rule), (Class::Void, Rule::NothingHidden));
    world.seen[3].pixels = 9e5;
    assert_eq!(rule(&world).rule, Rule::Probe);
    world.seen[4..].iter_mut().for_each(|o| o.in_view = false);
    assert_eq!((rule(&world).class, rule(&world).rule), (Class::Void, Rule::FewObjects));
}

#[test]
fn meaningless_numbers_are_refused_by_name() {
    let (object, seen) = simple();
    let light = LightSummary { most_side: 4096, most_cascades: 4, most_taps: 64 };
    let try_it = |object: ObjectSummary, seen: ObjectView, lit: LightView, pixels: f64, budget: Budget| {
        let scene = SceneSummary { objects: &[object], lights: &[light], clouds: &[] };
        let view = ViewSummary {
            pixels,
            outputs: Outputs::PICTURE,
            objects: &[seen],
            lights: &[lit],
            clouds: &[],
            cell: None,
            jumped: false,
        };
        plan(&scene, &view, &budget, &Costs::default(), &PlanState::new()).unwrap_err().to_string()
    };
    let lit = super::tests::light(&mut Lot(1));
    let fine = Budget::default();
    let nan = f64::NAN;
    assert_eq!(
        try_it(object, ObjectView { size_px: nan, ..seen }, lit, 1.0, fine),
        "size_px of number 0 cannot be NaN"
    );
    assert_eq!(
        try_it(ObjectSummary { triangles: -1.0, ..object }, seen, lit, 1.0, fine),
        "triangles of number 0 cannot be -1"
    );
    assert_eq!(
        try_it(object, seen, lit, f64::INFINITY, fine),
        "pixels of the image of number 0 cannot be inf"
    );
    let dim = LightView { contribution: nan, ..lit };
    assert_eq!(try_it(object, seen, dim, 1.0, fine), "contribution of number 0 cannot be NaN");
    let never = Budget::within(Millis(-1.0), Tolerances::default());
    assert_eq!(try_it(object, seen, lit, 1.0, never), "limit of number 0 cannot be -1");
    let details =
        [1.0, 0.5].map(|error| Detail { form: Form::Cut, error, kind: Kind::Proven, elements: 1.0 });
    let disordered = ObjectSummary { details: &details, ..object };
    assert_eq!(
        try_it(disordered, seen, lit, 1.0, fine),
        "object 0: errors of its details must not fall, their elements not rise"
    );
    let scene = SceneSummary { objects: &[object], ..SceneSummary::default() };
    let view = ViewSummary {
        pixels: 1.0,
        outputs: Outputs::PICTURE,
        objects: &[],
        lights: &[],
        clouds: &[],
        cell: None,
        jumped: false,
    };
    let error = plan(&scene, &view, &fine, &Costs::default(), &PlanState::new()).unwrap_err();
    assert_eq!(error.to_string(), "the scene has 1 objects, the view 0");
}

#[test]
fn extreme_numbers_plan_all_the_same() {
    for seed in 0..50 {
        let mut world = World::new(seed);
        for (i, o) in world.seen.iter_mut().enumerate() {
            let huge = [1e-300, 1e300, 0.0, f64::MIN_POSITIVE][i % 4];
            (o.px_per_unit, o.size_px) = (huge, huge.min(1e150));
        }
        for tolerance in [0.0, 1e-300, 1e300] {
            for limit in [None, Some(0.0), Some(1e300)] {
                let plan = world.plan(&budget(limit, tolerance));
                assert!(
                    plan.decisions.iter().all(|d| !d.cost.0.is_nan() && !d.strain.is_nan()),
                    "seed {seed}"
                );
            }
        }
    }
}

#[cfg(feature = "serde")]
#[test]
fn plans_can_be_written_and_read() {
    let plan = World::new(7).plan(&budget(Some(1.0), 1.0));
    let text = serde_json::to_string(&plan).unwrap();
    assert_eq!(serde_json::from_str::<Plan>(&text).unwrap(), plan);
}

#[test]
fn plans_can_be_read_by_people() {
    let text = World::new(7).plan(&budget(None, 1.0)).to_string();
    assert!(text.contains("occlusion: ") && text.contains("ms in all"), "{text}");
}
