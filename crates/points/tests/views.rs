//! What is selected for a view, against brute force over all nodes, levels and points.

mod common;

use common::{Folder, Random, build_points, grid, shuffled, surface};
use farsight_geometry::hard_cases::views;
use farsight_geometry::{Camera, Containment, Frustum};
use farsight_points::glam::{DVec2, DVec3};
use farsight_points::{
    BuildOptions, GpuBuffers, LeafStrategy, Mospt, MosptOptions, NodeData, NodeId, Octree, Point,
    PointsError, Selection, Spt, Store, Stream, StreamOptions, Traversal, ViewOptions, shuffle_batches,
};
use std::collections::HashSet;

fn small_nodes() -> BuildOptions {
    let mut options = BuildOptions::default();
    (options.inner_depth, options.merge_below) = (4, 60);
    options
}

fn stored(folder: &Folder, points: &[Point]) -> Store {
    let path = folder.path("a.points");
    build_points(points, &path, &small_nodes()).unwrap();
    Store::open(path).unwrap()
}

fn select(octree: &Octree, camera: &Camera, options: &ViewOptions) -> Selection {
    let mut selection = Selection::default();
    Traversal::new().select(octree, camera, options, |_| true, &mut selection);
    selection
}

/// A visible point, in pixels.
fn visible(camera: &Camera, p: DVec3) -> Option<DVec2> {
    let (px, depth) = camera.project(p)?;
    let inside = px.x >= 0.0 && px.y >= 0.0 && px.x < camera.width().into() && px.y < camera.height().into();
    (inside && depth >= camera.near() && depth <= camera.far()).then_some(px)
}

/// Largest distance in pixels from a visible point to the nearest drawn one; no further than `claim` is looked.
fn one_sided_hausdorff(camera: &Camera, all: &[DVec3], drawn: &[DVec3], claim: f64) -> f64 {
    let cell = claim.max(1e-6);
    let key = |px: DVec2| ((px.x / cell).floor() as i64, (px.y / cell).floor() as i64);
    let mut map: std::collections::HashMap<(i64, i64), Vec<DVec2>> = std::collections::HashMap::new();
    for px in drawn.iter().filter_map(|&p| camera.project(p)).map(|(px, _)| px) {
        map.entry(key(px)).or_default().push(px);
    }
    let nearest = |px: DVec2| {
        let (x, y) = key(px);
        let around = (-1..=1).flat_map(|i| (-1..=1).map(move |j| (x + i, y + j)));
        around.filter_map(|k| map.get(&k)).flatten().map(|q| q.distance(px)).fold(f64::INFINITY, f64::min)
    };
    all.iter().filter_map(|&p| visible(camera, p)).map(nearest).fold(0.0, f64::max)
}

fn cameras(octree: &Octree) -> Vec<(&'static str, Camera)> {
    let bounds = octree.world_bounds();
    views(&bounds).into_iter().map(|v| (v.name, v.camera)).collect()
}

#[test]
fn no_visible_point_is_further_from_a_drawn_one_than_claimed() {
    let folder = Folder::new("bound");
    let points = surface(60_000, 3);
    let store = stored(&folder, &points);
    let octree = store.octree();
    let all: Vec<DVec3> = points.iter().map(|p| octree.grid().world(p.position)).collect();
    let mut data = NodeData::default();
    let (mut fewer, mut tightest) = (0, 0.0f64);
    for (name, camera) in cameras(octree) {
        for (error, budget) in [(8.0, u64::MAX), (1.0, u64::MAX), (0.25, u64::MAX), (1.0, 9000)] {
            let options = ViewOptions::error(error).with_budget(budget);
            let selection = select(octree, &camera, &options);
            let claim = selection.error.unwrap().value;
            assert!(selection.points <= budget, "{name}");
            assert!(claim <= error || budget < u64::MAX, "{name}: {claim}");
            let mut drawn = Vec::new();
            for d in &selection.drawn {
                store.read(d.node, &mut data).unwrap();
                drawn.extend(data.points.iter().map(|p| octree.grid().world(p.position)));
            }
            assert_eq!(drawn.len() as u64, selection.points);
            if claim.is_finite() && claim < 2000.0 {
                let measured = one_sided_hausdorff(&camera, &all, &drawn, claim);
                assert!(measured <= claim * (1.0 + 1e-12) + 1e-9, "{name}, {error} px: {measured} > {claim}");
                if claim > 0.0 {
                    tightest = tightest.max(measured / claim);
                }
            }
            fewer += usize::from(drawn.len() < points.len());
        }
    }
    assert!(fewer > 20 && tightest > 0.5, "the bound should be worth something: {fewer} {tightest}");
}

#[test]
fn the_chosen_nodes_are_those_of_brute_force() {
    let folder = Folder::new("brute");
    let points = surface(60_000, 4);
    let store = stored(&folder, &points);
    let octree = store.octree();
    for (name, camera) in cameras(octree) {
        let frustum = Frustum::from_camera(&camera);
        for error in [4.0, 0.5] {
            let chosen = select(octree, &camera, &ViewOptions::error(error));
            let set: HashSet<NodeId> = chosen.drawn.iter().map(|d| d.node).collect();
            for id in octree.ids() {
                let Some(parent) = octree.parent(id) else { continue };
                if set.contains(&id) {
                    assert!(set.contains(&parent), "{name}: a child without its parent");
                    // Conservative in one direction only: what is certainly outside is never drawn.
                    let slack = 1e-5 * octree.world_bounds().diagonal();
                    assert_ne!(
                        frustum.classify(&octree.bounds(id).inflated(slack)),
                        Containment::Outside,
                        "{name}"
                    );
                }
                // By the geometry crate's own bound, which shares nothing with the traversal's.
                let cell = octree.cell_diagonal(octree.level(id) + octree.inner_depth() - 1);
                let seen = frustum.classify(&octree.bounds(id)) != Containment::Outside;
                let loose = camera.box_error_px(cell, &octree.bounds(id));
                if seen && loose > error * 3.0 && set.contains(&parent) {
                    let in_view = octree.bounds(id).corners().iter().any(|&c| visible(&camera, c).is_some());
                    assert!(
                        set.contains(&id) || !in_view || {
                            // Farther than the near plane, the traversal's bound is the smaller one.
                            camera.distance_to_box(&octree.bounds(id)) < camera.near() * 2.0
                        },
                        "{name}: {loose} px left out"
                    );
                }
            }
        }
    }
}

#[test]
fn budgets_are_kept_and_a_second_frame_allocates_nothing_new() {
    let folder = Folder::new("budget");
    let store = stored(&folder, &surface(60_000, 5));
    let (_, camera) = cameras(store.octree()).swap_remove(0);
    let mut traversal = Traversal::new();
    let mut selection = Selection::default();
    let mut errors = Vec::new();
    for budget in [0, 100, 5000, 20_000, 60_000, u64::MAX] {
        traversal.select(
            store.octree(),
            &camera,
            &ViewOptions::error(0.3).with_budget(budget),
            |_| true,
            &mut selection,
        );
        assert!(selection.points <= budget);
        errors.push(selection.error.unwrap().value);
    }
    assert!(errors[0].is_infinite() && errors.windows(2).all(|e| e[1] <= e[0]), "{errors:?}");
    assert!(*errors.last().unwrap() <= 0.3);
    let capacity = (selection.drawn.capacity(), selection.missing.capacity());
    traversal.select(store.octree(), &camera, &ViewOptions::error(0.3), |_| true, &mut selection);
    assert_eq!(capacity, (selection.drawn.capacity(), selection.missing.capacity()));
}

#[test]
fn sequential_trees_choose_the_coarsest_level_that_is_fine_enough() {
    let points = surface(60_000, 6);
    let tree = Mospt::build(grid(), &points, &MosptOptions::default()).unwrap();
    let all: Vec<DVec3> = points.iter().map(|p| grid().world(p.position)).collect();
    for view in views(&tree.world_bounds()) {
        let mut before = usize::MAX;
        for error in [0.1, 1.0, 10.0, 100.0] {
            let level = tree.select(&view.camera, error);
            assert!(level.points <= before, "{}: a looser error needs no more points", view.name);
            before = level.points;
            assert!(level.error.value <= error || level.points == points.len(), "{}", view.name);
            let drawn: Vec<DVec3> =
                tree.points()[..level.points].iter().map(|p| grid().world(p.position)).collect();
            if level.error.value < 2000.0 {
                let measured = one_sided_hausdorff(&view.camera, &all, &drawn, level.error.value);
                assert!(measured <= level.error.value * (1.0 + 1e-12) + 1e-9, "{}: {measured}", view.name);
            }
        }
    }
}

#[test]
fn sequential_trees_are_the_levels_of_the_nested_octree() {
    let folder = Folder::new("levels");
    let points = surface(200_000, 8);
    let report = build_points(&points, &folder.path("a.points"), &BuildOptions::default()).unwrap();
    let mut trees = Vec::new();
    for (points, threads) in [(&points, 1), (&points, 2), (&shuffled(points.clone(), 9), 2)] {
        let mut options = MosptOptions::default();
        options.threads = threads;
        trees.push(Mospt::build(grid(), points, &options).unwrap());
    }
    assert!(trees[0].points() == trees[1].points() && trees[0].points() == trees[2].points());
    let mut sum = 0;
    let prefix: Vec<usize> = report
        .levels
        .iter()
        .map(|&n| {
            sum += n as usize;
            sum
        })
        .collect();
    assert_eq!(trees[0].prefix(), prefix);
    assert_eq!(common::sorted(trees[0].points()), common::sorted(&points));

    // At most so deep: what is left is one level more, or dropped.
    for leaves in [LeafStrategy::Add, LeafStrategy::Reject] {
        let mut options = MosptOptions::default();
        (options.depth, options.leaves) = (Some(9), leaves);
        let tree = Mospt::build(grid(), &points, &options).unwrap();
        let (kept, dropped) = (tree.points().len(), tree.dropped());
        assert_eq!(kept + dropped, points.len());
        assert_eq!(tree.prefix()[..10], prefix[..10]);
        match leaves {
            LeafStrategy::Add => assert_eq!((dropped, tree.prefix().len()), (0, 11)),
            LeafStrategy::Reject => assert_eq!((kept, tree.prefix().len()), (prefix[9], 10)),
        }
    }
}

#[test]
fn edge_sets_of_sequential_trees() {
    let p = |x: i32| Point::new([x, 0, 0], [x as u8; 3]);
    let tree = |points: &[Point]| Mospt::build(grid(), points, &MosptOptions::default()).unwrap();
    assert!(tree(&[]).prefix().is_empty() && tree(&[]).world_bounds().is_empty());
    assert_eq!(tree(&[p(5)]).prefix(), [1]);
    assert_eq!(tree(&[p(5), p(5)]).prefix(), [1, 2]);
    assert_eq!(tree(&[p(0), p(1)]).prefix(), [1, 2]);
    let mut reject = MosptOptions::default();
    reject.leaves = LeafStrategy::Reject;
    let rejected = Mospt::build(grid(), &[p(5), p(5)], &reject).unwrap();
    assert_eq!((rejected.points().len(), rejected.dropped()), (1, 1));
}

#[test]
fn published_trees_draw_one_cut_at_any_tolerance_and_cost_more() {
    let points = surface(20_000, 10);
    let tree = Spt::build(&grid(), &points);
    assert_eq!(std::mem::size_of_val(&tree.nodes()[0]), 24);
    // Points on a surface: between 1.3 and 2 nodes a point.
    let ratio = tree.nodes().len() as f64 / points.len() as f64;
    assert!((1.3..2.0).contains(&ratio), "{ratio}");
    let unique: HashSet<[i32; 3]> = points.iter().map(|p| p.position).collect();
    let all = tree.drawn(0.0).count();
    assert!(all >= unique.len() && all <= points.len(), "{all}");
    let mut before = 0;
    for exponent in (-6..8).rev() {
        let tolerance = 2f32.powi(exponent);
        let drawn = tree.drawn(tolerance).count();
        assert!(drawn >= before && drawn <= tree.prefix(tolerance));
        before = drawn;
    }
}

#[test]
fn batches_are_shuffled_within_their_levels() {
    let mut points: Vec<Point> = (0..1000).map(|i| Point::new([i, 0, 0], [0; 3])).collect();
    let before = points.clone();
    shuffle_batches(&mut points, &[100, 900], 16, 1);
    assert_ne!(points, before);
    for range in [0..100, 100..1000] {
        let mut level = points[range.clone()].to_vec();
        level.sort_by_key(|p| p.position);
        assert_eq!(level, before[range]);
    }
}

/// Keeps account of what is on the card.
#[derive(Default)]
struct Card {
    held: HashSet<u32>,
    bytes: u64,
    most: u64,
    uploads: usize,
}

impl GpuBuffers for Card {
    type Buffer = (NodeId, u64);
    fn upload(&mut self, node: NodeId, data: &NodeData) -> Self::Buffer {
        assert!(self.held.insert(node.0), "uploaded twice");
        self.uploads += 1;
        self.bytes += data.bytes() as u64;
        self.most = self.most.max(self.bytes);
        (node, data.bytes() as u64)
    }
    fn release(&mut self, (node, bytes): Self::Buffer) {
        assert!(self.held.remove(&node.0));
        self.bytes -= bytes;
    }
}

#[test]
fn loading_in_the_background_ends_with_the_whole_picture_and_keeps_its_budgets() {
    let folder = Folder::new("stream");
    let store = stored(&folder, &surface(60_000, 11));
    let views = cameras(store.octree());
    let mut options = StreamOptions::default();
    (options.card_bytes, options.memory_bytes, options.upload_bytes) = (400_000, 500_000, 50_000);
    options.requests = 5;
    let mut stream = Stream::new(store, Card::default(), options).unwrap();
    for (name, camera) in views.iter().take(8) {
        let wanted = ViewOptions::error(2.0).with_budget(15_000);
        let mut expected = Selection::default();
        Traversal::new().select(stream.store().octree(), camera, &wanted, |_| true, &mut expected);
        let mut last = f64::INFINITY;
        for frame in 0.. {
            let shown = stream.frame(camera, &wanted);
            for (buffer, drawn) in shown.draws() {
                assert_eq!(buffer.0, drawn.node);
            }
            assert_eq!(shown.draws().count(), shown.selection.drawn.len());
            last = shown.selection.error.unwrap().value;
            let done = shown.selection.missing.is_empty();
            let (card, memory) = stream.cached_bytes();
            assert!(card <= 400_000 && memory <= 500_000 && stream.gpu().bytes == card);
            if done {
                break;
            }
            assert!(frame < 20_000, "{name}: never complete");
            std::thread::sleep(std::time::Duration::from_micros(200));
        }
        assert!(last <= expected.error.unwrap().value, "{name}");
    }
    assert!(stream.gpu().most <= 400_000 && stream.take_failures().is_empty());
}

/// Frames of a view that stays, until nothing is loaded any more; then some more. What each of these drew.
fn settle(stream: &mut Stream<Card>, camera: &Camera, view: &ViewOptions) -> Vec<Vec<u32>> {
    let mut quiet = 0;
    let mut last = Vec::new();
    for frame in 0.. {
        let before = stream.gpu().uploads;
        let shown = stream.frame(camera, view);
        last.push(shown.selection.drawn.iter().map(|d| d.node.0).collect());
        quiet = if stream.is_idle() && stream.gpu().uploads == before { quiet + 1 } else { 0 };
        if quiet == 20 {
            break;
        }
        assert!(frame < 5000, "loading never ends");
        std::thread::sleep(std::time::Duration::from_micros(100));
    }
    last
}

#[test]
fn a_memory_too_small_keeps_what_the_last_frame_used_and_reads_nothing_in_vain() {
    let folder = Folder::new("small-memory");
    let store = stored(&folder, &surface(60_000, 13));
    let camera = cameras(store.octree()).swap_remove(0).1;
    let mut options = StreamOptions::default();
    // The card too is small, so that nothing is hidden by what it holds.
    (options.card_bytes, options.memory_bytes, options.requests) = (300_000, 250_000, 7);
    let mut stream = Stream::new(store, Card::default(), options).unwrap();
    let view = ViewOptions::error(1e-6);
    let frames = settle(&mut stream, &camera, &view);
    for pair in frames.windows(2) {
        assert!(pair[0].iter().all(|node| pair[1].contains(node)), "lost what was drawn");
    }
    let (card, memory) = stream.cached_bytes();
    assert!(memory <= 250_000 && memory > 200_000 && card <= memory, "{card} {memory}");
    // Another view takes its place.
    let away = cameras(stream.store().octree()).swap_remove(3).1;
    let mut first = Selection::default();
    Traversal::new().select(stream.store().octree(), &away, &view.with_budget(5_000), |_| true, &mut first);
    let frames = settle(&mut stream, &away, &view.with_budget(5_000));
    assert!(first.drawn.iter().all(|d| frames.last().unwrap().contains(&d.node.0)));
}

#[test]
fn a_card_too_small_ends_with_the_most_important() {
    let folder = Folder::new("small-card");
    let store = stored(&folder, &surface(60_000, 14));
    let views = cameras(store.octree());
    let mut options = StreamOptions::default();
    (options.card_bytes, options.upload_bytes, options.requests) = (100_000, 20_000, 7);
    let mut stream = Stream::new(store, Card::default(), options).unwrap();
    let view = ViewOptions::error(1e-6);
    let mut full = 0;
    for (name, camera) in views.iter().take(6) {
        let frames = settle(&mut stream, camera, &view);
        // The more important first, while there is room.
        let octree = stream.store().octree();
        let (mut left, mut expected) = (100_000, Selection::default());
        let fits = |node: NodeId| {
            let bytes = octree.node_bytes(node);
            let fits = bytes <= left;
            left -= if fits { bytes } else { 0 };
            fits
        };
        Traversal::new().select(octree, camera, &view, fits, &mut expected);
        full += usize::from(!expected.missing.is_empty());
        let expected: Vec<u32> = expected.drawn.iter().map(|d| d.node.0).collect();
        assert_eq!(frames.last().unwrap(), &expected, "{name}");
    }
    assert!(full > 2, "all fits");
}

#[test]
fn damaged_nodes_are_reported_once_and_the_rest_is_drawn() {
    let folder = Folder::new("damaged");
    let path = folder.path("a.points");
    build_points(&surface(60_000, 12), &path, &small_nodes()).unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[100] ^= 1;
    let store = Store::from_bytes(bytes).unwrap();
    let camera = cameras(store.octree()).swap_remove(0).1;
    let mut stream = Stream::new(store, Card::default(), StreamOptions::default()).unwrap();
    let mut failures = Vec::new();
    for _ in 0..2000 {
        stream.frame(&camera, &ViewOptions::error(0.01));
        failures.extend(stream.take_failures());
        if !failures.is_empty() && stream.is_idle() {
            break;
        }
        std::thread::sleep(std::time::Duration::from_micros(200));
    }
    assert_eq!(failures.len(), 1);
    assert!(matches!(failures[0].1, PointsError::Damaged { .. }));
    let left = stream.frame(&camera, &ViewOptions::error(0.01)).selection;
    assert_eq!(left.missing.len(), 1);
}

#[test]
fn random_cameras_never_panic() {
    let folder = Folder::new("random");
    let store = stored(&folder, &surface(5000, 13));
    let mut random = Random(1);
    let bounds = store.octree().world_bounds();
    for _ in 0..3000 {
        let far = 10f64.powf(random.unit() * 12.0 - 4.0);
        let mut direction = || DVec3::new(random.unit() - 0.5, random.unit() - 0.5, random.unit() - 0.5);
        let (eye, target) = (bounds.center() + direction() * far, bounds.center() + direction());
        let Ok(camera) = Camera::look_at(eye, target, direction()) else { continue };
        let selection = select(store.octree(), &camera, &ViewOptions::error(1.0));
        assert!(selection.error.unwrap().value <= 1.0);
    }
}
