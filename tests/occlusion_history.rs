//! What culling remembers, how long, and what makes it forget.

#[path = "../benches/occlusion/sim.rs"]
#[allow(dead_code)]
mod sim;
#[path = "../benches/occlusion/town.rs"]
#[allow(dead_code)]
mod town;

use farsight_geometry::glam::DVec3;
use farsight_geometry::{Camera, ClipConvention, Frustum, Projection};
use farsight_occlusion::*;
use farsight_raster::{OcclusionQueries, Rasteriser};
use sim::{Arrival, Costs, Machine, everything, wrong_pixels};
use std::collections::BTreeSet;
use town::{Object, Walk, World, town as build_town};

const PX: [u32; 2] = [160, 120];

fn options(change: impl Fn(&mut Options)) -> Options {
    let mut options = Options::default();
    change(&mut options);
    options
}

/// Leaves whose boxes are seen with everything drawn, and the highest nodes whose boxes are not, found by trying all.
fn brute_force_cut(world: &World, camera: &Camera) -> (BTreeSet<u32>, BTreeSet<u32>) {
    let mut rasteriser = Rasteriser::new();
    let mut machine = Machine::new(world, Costs::with_latency(0.0), PX);
    let mut all = Culler::new(Options::baseline(Algorithm::FrustumOnly), Backend::Boolean).unwrap();
    machine.frame(&mut all, &world.bvh, camera);
    let clip = camera.clip_from_relative_f64(ClipConvention::REVERSED, camera.eye());
    let frustum = Frustum::from_camera(camera);
    let (mut leaves, mut boundary) = (BTreeSet::new(), BTreeSet::new());
    let mut open = vec![world.bvh.root().unwrap()];
    while let Some(node) = open.pop() {
        let b = world.bvh.bounds(node);
        if frustum.classify(b) == farsight_geometry::Containment::Outside {
            continue;
        }
        let before_near =
            b.corners().iter().any(|c| (*c - camera.eye()).dot(camera.forward()) <= camera.near());
        let mut queries = OcclusionQueries::new(0);
        queries.issue_box(&mut rasteriser, &machine.target, clip, camera.eye(), &b.inflated(0.02));
        let visible = before_near || queries.poll().unwrap().samples > 0;
        match (visible, world.bvh.children(node)) {
            (false, _) => {
                boundary.insert(node.0);
            }
            (true, None) => {
                leaves.insert(node.0);
            }
            (true, Some(children)) => open.extend(children),
        }
    }
    (leaves, boundary)
}

#[test]
fn a_still_camera_asks_about_the_cut_and_nothing_else() {
    let side = 10;
    let world = build_town(side, 3);
    for schedule in [Schedule::Polling, Schedule::Waves] {
        for walk in [Walk::Static, Walk::Street, Walk::Turn] {
            let camera = walk.camera(side, 0, 1, PX);
            let (leaves, boundary) = brute_force_cut(&world, &camera);
            let mut options = if schedule == Schedule::Waves { Options::waves() } else { Options::default() };
            options.adaptive = None;
            let mut culler = Culler::new(options, Backend::Boolean).unwrap();
            let mut machine = Machine::new(&world, Costs::with_latency(20.0), PX);
            let mut sets = Vec::new();
            for frame in 1..=40 {
                machine.idle(1000.0);
                let f = machine.frame(&mut culler, &world.bvh, &camera);
                if frame >= 3 {
                    assert_eq!(f.stats.discoveries, 0, "{schedule:?} {walk:?} frame {frame}");
                    let bound = leaves.len() + boundary.len();
                    assert!(f.stats.must_resolve as usize <= boundary.len() + 2, "waits beyond the boundary");
                    if f.stats.retests == 0 {
                        sets.push((f.queried.clone(), bound));
                    }
                }
            }
            let first = sets[0].0.clone();
            assert!(sets.len() >= 30, "few frames look again whether open nodes can be closed");
            assert!(sets.iter().all(|s| s.0 == first), "{schedule:?} {walk:?}: the same queries each frame");
            assert!(first.len() <= sets[0].1 + 2, "{} queries for a cut of {}", first.len(), sets[0].1);
        }
    }
}

#[test]
fn without_keeping_nodes_open_a_still_camera_oscillates() {
    // The defect of the pseudocode that `keep_open_frames` is for; were it gone, the option could go too.
    let world = build_town(10, 3);
    let mut culler = Culler::new(Options::pseudocode(), Backend::Boolean).unwrap();
    let mut machine = Machine::new(&world, Costs::with_latency(20.0), PX);
    let camera = Walk::Static.camera(10, 0, 1, PX);
    let late: Vec<u64> =
        (0..9).map(|_| machine.frame(&mut culler, &world.bvh, &camera).stats.discoveries).collect();
    assert!(late[3..].iter().any(|&n| n > 0), "{late:?}");
}

#[test]
fn waves_draw_the_same_whatever_the_latency_and_order() {
    let side = 8;
    let world = build_town(side, 9);
    let run = |latency: f64, arrival: Arrival| {
        let mut culler = Culler::new(Options::waves(), Backend::Boolean).unwrap();
        let mut machine = Machine::new(&world, Costs::with_latency(latency), PX);
        machine.arrival = arrival;
        let mut drawn = Vec::new();
        for i in 0..8 {
            machine.idle(1e5);
            machine.frame(&mut culler, &world.bvh, &Walk::Street.camera(side, i, 8, PX));
            drawn.push(culler.rendered().to_vec());
        }
        drawn
    };
    let reference = run(0.0, Arrival::InOrder);
    for latency in [0.0, 10.0, 1000.0] {
        for arrival in [Arrival::InOrder, Arrival::Reversed] {
            assert_eq!(run(latency, arrival), reference, "{latency} {arrival:?}");
        }
    }
}

/// A wall that hides a grid of boxes until it is taken away.
fn hidden_grid() -> World {
    let wall = Object::cuboid(DVec3::new(-50.0, 10.0, -50.0), DVec3::new(100.0, 1.0, 100.0), 10);
    let grid = (0..64).map(|i| {
        let at = DVec3::new(f64::from(i % 8) * 2.0 - 8.0, 20.0, f64::from(i / 8) * 2.0 - 8.0);
        Object::cuboid(at, DVec3::splat(1.0), 10)
    });
    World::new(std::iter::once(wall).chain(grid).collect())
}

fn ahead() -> Camera {
    Camera::look_at(DVec3::ZERO, DVec3::Y, DVec3::Z).unwrap().with_image(PX[0], PX[1]).unwrap()
}

#[test]
fn bounded_never_waits_and_shows_everything_in_time() {
    for frames in [1, 2, 3, 6] {
        for latency in [1.0, 400.0, 3000.0] {
            let mut world = hidden_grid();
            let mut culler = Culler::new(Options::bounded(frames), Backend::Boolean).unwrap();
            let camera = ahead();
            let mut missing = 0;
            for i in 0..30 {
                if i == 15 {
                    world.objects[0].positions.iter_mut().for_each(|p| p.x += 1000.0);
                    let moved = world.objects[0].bounds();
                    world.bvh.set_bounds(0, moved).unwrap();
                }
                let mut machine = Machine::new(&world, Costs::with_latency(latency), PX);
                machine.idle(100.0);
                let f = machine.frame(&mut culler, &world.bvh, &camera);
                assert_eq!(f.stalls, 0);
                let wrong = wrong_pixels(&machine.image(), &everything(&world, &camera));
                missing = if wrong > 0 { missing + 1 } else { 0 };
                assert!(missing <= frames, "bound {frames}, latency {latency}, frame {i}");
                // The machine ends here: answers that have not come never will.
                machine.idle(latency);
                machine.hand_over(&mut culler);
            }
        }
    }
}

#[test]
fn bounded_culls_once_answers_have_come() {
    let world = hidden_grid();
    let mut culler = Culler::new(Options::bounded(3), Backend::Boolean).unwrap();
    let mut machine = Machine::new(&world, Costs::with_latency(50.0), PX);
    let drawn: Vec<u64> = (0..6)
        .map(|_| {
            machine.idle(1000.0);
            machine.frame(&mut culler, &world.bvh, &ahead()).draws
        })
        .collect();
    assert!(drawn[0] == 65 && drawn[5] == 1, "{drawn:?}");
}

#[test]
fn answers_from_before_a_reset_revive_nothing() {
    let world = hidden_grid();
    let mut culler = Culler::new(Options::default(), Backend::Boolean).unwrap();
    culler.begin_frame(View::from_camera(&ahead()));
    let Command::Query { id, .. } = culler.next(&world.bvh) else { panic!("the root is asked about") };
    culler.reset();
    assert!(!culler.resolve(id, Answer::OCCLUDED));
    culler.begin_frame(View::from_camera(&ahead()));
    let Command::Query { id: again, .. } = culler.next(&world.bvh) else { panic!("the root is asked about") };
    assert_ne!(id, again);
    assert!(!culler.resolve(id, Answer::OCCLUDED), "a slot used again is not the old query");
    assert!(culler.resolve(again, Answer::VISIBLE) && !culler.resolve(again, Answer::VISIBLE));
}

#[test]
fn changing_trees_stay_exact() {
    let side = 6;
    for base in [Options::default(), Options::waves(), options(|o| o.query_leaves_every = 4)] {
        let mut world = build_town(side, 21);
        let mut random = farsight_raster::Random::new(5);
        let mut culler = Culler::new(base, Backend::Boolean).unwrap();
        let mut pending_moves = 0;
        for i in 0..40 {
            // Props move, go and come back; now and then the tree is built anew.
            for _ in 0..20 {
                let id = random.below(world.objects.len());
                let shift =
                    DVec3::new(random.range(-9.0, 9.0), random.range(-9.0, 9.0), random.range(0.0, 2.0));
                world.objects[id].origin += shift;
                let b = world.objects[id].bounds();
                if random.chance(0.3) {
                    world.bvh.remove(id as u32).unwrap();
                    assert_eq!(world.bvh.insert(b).unwrap(), id as u32);
                } else {
                    world.bvh.set_bounds(id as u32, b).unwrap();
                }
                pending_moves += 1;
            }
            if i % 13 == 12 {
                world.bvh.rebuild();
            }
            let camera = Walk::Street.camera(side, i, 40, PX);
            let mut machine = Machine::new(&world, Costs::with_latency(20.0), PX);
            machine.frame(&mut culler, &world.bvh, &camera);
            assert_eq!(wrong_pixels(&machine.image(), &everything(&world, &camera)), 0, "frame {i}");
            machine.idle(1e3);
            machine.hand_over(&mut culler);
        }
        assert!(pending_moves > 0);
    }
}

#[test]
fn cuts_teleports_and_other_projections_stay_exact() {
    let side = 6;
    let world = build_town(side, 4);
    let mut culler = Culler::new(Options::default(), Backend::Boolean).unwrap();
    let mut machine = Machine::new(&world, Costs::with_latency(200.0), PX);
    let mut random = farsight_raster::Random::new(8);
    for i in 0..60 {
        let extent = f64::from(side) * town::PITCH;
        let p = |r: &mut farsight_raster::Random| {
            DVec3::new(r.range(0.0, extent), r.range(0.0, extent), r.range(0.5, 20.0))
        };
        let camera = Camera::look_at(p(&mut random), p(&mut random), DVec3::Z).unwrap();
        let camera = match i % 3 {
            0 => camera,
            1 => camera.with_range(1.0, 200.0).unwrap(),
            _ => {
                let parallel = camera.with_projection(Projection::Orthographic { height: 60.0 }).unwrap();
                parallel.with_range(-50.0, 300.0).unwrap()
            }
        };
        let camera = camera.with_image(PX[0], PX[1]).unwrap();
        machine.frame(&mut culler, &world.bvh, &camera);
        assert_eq!(wrong_pixels(&machine.image(), &everything(&world, &camera)), 0, "frame {i}");
    }
}

#[test]
fn views_over_one_tree_do_not_meddle() {
    let side = 6;
    let world = build_town(side, 4);
    let mut cullers =
        [Options::default(), Options::waves()].map(|o| Culler::new(o, Backend::Boolean).unwrap());
    for i in 0..10 {
        for (culler, walk) in cullers.iter_mut().zip([Walk::Street, Walk::Turn]) {
            let camera = walk.camera(side, i, 10, PX);
            let mut machine = Machine::new(&world, Costs::with_latency(10.0), PX);
            machine.frame(culler, &world.bvh, &camera);
            assert_eq!(wrong_pixels(&machine.image(), &everything(&world, &camera)), 0);
            machine.idle(100.0);
            machine.hand_over(culler);
        }
    }
}

#[test]
fn later_passes_draw_what_the_first_found_visible() {
    let side = 8;
    let world = build_town(side, 3);
    let mut culler = Culler::new(options(|o| o.defer = false), Backend::Boolean).unwrap();
    let mut machine = Machine::new(&world, Costs::with_latency(20.0), PX);
    for i in 0..6 {
        let camera = Walk::Street.camera(side, i, 6, PX);
        machine.frame(&mut culler, &world.bvh, &camera);
        let visible: BTreeSet<u32> = culler.visible().map(|n| world.bvh.object(n).unwrap() + 1).collect();
        let seen: BTreeSet<u32> = machine.target.ids().filter(|&id| id != 0).collect();
        assert!(seen.is_subset(&visible) && visible.len() <= culler.rendered().len());
    }
}

#[test]
fn a_threshold_is_lossy_and_needs_counts() {
    let lossy = options(|o| o.lossy_threshold = 20);
    assert_eq!(
        Culler::new(lossy, Backend::Boolean).unwrap_err(),
        OptionsError::NeedsCounts { threshold: 20 }
    );
    let geometry = options(|o| (o.lossy_threshold, o.query_with_geometry) = (20, true));
    assert!(matches!(Culler::new(geometry, Backend::Counts), Err(OptionsError::TwoMeasures { .. })));
    assert!(Culler::new(Options::bounded(0), Backend::Boolean).is_err());
    assert!(Culler::new(options(|o| o.inflate_px = f64::NAN), Backend::Boolean).is_err());

    let world = build_town(8, 3);
    let draws = |threshold: u64| {
        let mut culler = Culler::new(options(|o| o.lossy_threshold = threshold), Backend::Counts).unwrap();
        let mut machine = Machine::new(&world, Costs::with_latency(20.0), PX);
        (0..8)
            .map(|i| machine.frame(&mut culler, &world.bvh, &Walk::Rise.camera(8, i, 8, PX)).draws)
            .sum::<u64>()
    };
    assert!(draws(40) < draws(0));
}

#[test]
fn odd_boxes_are_safe() {
    use farsight_geometry::DAabb;
    struct Row(Vec<DAabb>);
    impl Hierarchy for Row {
        fn root(&self) -> Option<NodeId> {
            Some(NodeId(0))
        }
        fn bounds(&self, node: NodeId) -> DAabb {
            if node.0 == 0 {
                DAabb::new(DVec3::splat(-90.0), DVec3::splat(90.0))
            } else {
                self.0[node.0 as usize - 1]
            }
        }
        fn child(&self, node: NodeId, index: u32) -> Option<NodeId> {
            (node.0 == 0 && (index as usize) < self.0.len()).then(|| NodeId(index + 1))
        }
    }
    let at = DVec3::new(0.0, 10.0, 0.0);
    let row = Row(vec![
        DAabb::new(DVec3::NAN, at),
        DAabb::new(-DVec3::INFINITY, DVec3::INFINITY),
        DAabb::EMPTY,
        DAabb::new(at, at),
        DAabb::new(at, at + DVec3::X),
    ]);
    let mut culler = Culler::new(Options::default(), Backend::Boolean).unwrap();
    let (mut drawn, mut asked) = (vec![], vec![]);
    culler.begin_frame(View::from_camera(&ahead()));
    loop {
        match culler.next(&row) {
            Command::Render(node) => drawn.push(node.0),
            Command::Query { id, node, proxy, .. } => {
                let Proxy::Box(b) = proxy else { panic!("a box") };
                assert!(b.extent().min_element() > 0.0, "points and lines are grown to boxes");
                asked.push(node.0);
                culler.resolve(id, Answer::OCCLUDED);
            }
            Command::Flush => {}
            Command::Done => break,
        }
    }
    drawn.sort_unstable();
    asked.sort_unstable();
    assert_eq!((drawn, asked), (vec![1, 2], vec![4, 5]));
}

#[test]
fn a_walk_repeated_allocates_nothing() {
    let side = 8;
    let world = build_town(side, 3);
    for base in [Options::default(), Options::waves(), options(|o| o.nodes_per_query = 8)] {
        let mut culler = Culler::new(base, Backend::Boolean).unwrap();
        let mut machine = Machine::new(&world, Costs::with_latency(20.0), PX);
        let mut walk = |culler: &mut Culler| {
            for i in 0..12 {
                machine.idle(1000.0);
                machine.frame(culler, &world.bvh, &Walk::Street.camera(side, i, 12, PX));
            }
            culler.bytes()
        };
        walk(&mut culler);
        walk(&mut culler);
        let before = walk(&mut culler);
        assert_eq!(walk(&mut culler), before);
        assert!(before < 1 << 20, "{before} bytes for {} nodes", world.bvh.node_capacity());
    }
}
