//! Cuts through the tree: complete, fine enough, no finer than needed, steady, and never waiting.

mod common;

use farsight_geometry::glam::{DVec3, dvec3};
use farsight_geometry::{Camera, Containment, Frustum, Projection, TriangleMesh, hard_cases};
use farsight_hlod::{
    BuildOptions, CasterLight, Casters, HlodError, Mesh, NodeId, NodeMesh, PrefetchOptions, Selection,
    Selector, Store, Stream, StreamOptions, Tier, Tree, ViewOptions, build, movement_until_needed,
    no_progress, prefetch, select_casters,
};
use std::collections::HashSet;

fn store_of(mesh: &TriangleMesh) -> Store {
    let path = std::env::temp_dir().join(format!(
        "farsight-hlod-select-{}-{:?}.hlod",
        std::process::id(),
        std::thread::current().id()
    ));
    let options =
        BuildOptions::default().with_appearance(false).with_most_triangles(500).with_tier(Tier::Verified);
    build([Ok::<_, HlodError>(mesh)], &path, &options, &no_progress).unwrap();
    let store = Store::from_bytes(std::fs::read(&path).unwrap()).unwrap();
    std::fs::remove_file(&path).unwrap();
    store
}

fn store() -> Store {
    store_of(&hard_cases::bumpy_ball(48))
}

fn camera(eye: DVec3) -> Camera {
    Camera::look_at(eye, DVec3::ZERO, DVec3::Z).unwrap().with_range(0.01, 1e4).unwrap()
}

fn select(tree: &Tree, camera: &Camera, options: &ViewOptions) -> Selection {
    let mut selection = Selection::default();
    Selector::new().select(tree, camera, options, |_| true, &mut selection);
    selection
}

/// Every leaf in view has exactly one drawn node above it or is drawn.
fn is_a_cut(tree: &Tree, drawn: &HashSet<NodeId>, visible: impl Fn(NodeId) -> bool) {
    for leaf in tree.ids().filter(|&n| tree.is_leaf(n)) {
        let mut above = 0;
        let mut at = Some(leaf);
        while let Some(n) = at {
            above += usize::from(drawn.contains(&n));
            at = tree.parent(n);
        }
        assert!(above <= 1, "{leaf:?} is drawn {above} times");
        assert!(above == 1 || !visible(leaf), "{leaf:?} is in view and not drawn");
    }
}

fn views() -> Vec<Camera> {
    let mut all: Vec<Camera> = [2.0, 3.5, 8.0, 40.0, 300.0].map(|d| camera(dvec3(0.4, -0.8, 0.5) * d)).into();
    all.push(camera(dvec3(0.02, 0.01, 0.0)));
    let flat = Projection::Orthographic { height: 3.0 };
    all.push(camera(dvec3(3.0, 1.0, 2.0)).with_projection(flat).unwrap().with_range(0.0, 50.0).unwrap());
    all
}

#[test]
fn cuts_are_whole_fine_enough_and_no_finer() {
    let store = store();
    let tree = store.tree();
    for camera in views() {
        let frustum = Frustum::from_camera(&camera);
        let mut last = u64::MAX;
        for px in [0.1, 0.5, 2.0, 20.0] {
            let selection = select(tree, &camera, &ViewOptions::error(px));
            let drawn: HashSet<NodeId> = selection.drawn.iter().map(|d| d.node).collect();
            is_a_cut(tree, &drawn, |n| frustum.classify(&tree.bounds(n)) != Containment::Outside);
            let triangles: u64 = drawn.iter().map(|&n| u64::from(tree.triangles(n, Mesh::Full))).sum();
            assert_eq!(triangles, selection.triangles);
            assert!(triangles <= last);
            last = triangles;
            let worst = selection.drawn.iter().map(|d| d.error_px).fold(0.0, f64::max);
            assert_eq!(selection.geometric.unwrap().value, worst);
            for d in &selection.drawn {
                assert!(d.error_px <= px || tree.is_leaf(d.node));
                // The node above would have been too coarse.
                if let Some(parent) = tree.parent(d.node) {
                    let error = tree.error(parent, Mesh::Full).value;
                    assert!(camera.box_error_px(error, &tree.bounds(parent)) > px);
                }
            }
        }
    }
    // From afar the root is enough.
    assert_eq!(select(tree, &camera(dvec3(0.0, -900.0, 0.0)), &ViewOptions::error(1.0)).drawn.len(), 1);
}

#[test]
fn budgets_are_kept_and_the_error_says_so() {
    let store = store();
    let tree = store.tree();
    let camera = camera(dvec3(0.5, -1.6, 0.4));
    let full = select(tree, &camera, &ViewOptions::error(0.05));
    let mut last = f64::INFINITY;
    for share in [16, 8, 4, 2, 1] {
        let most = full.triangles / share;
        let by_triangles = select(tree, &camera, &ViewOptions::error(0.05).with_most_triangles(most));
        assert!(by_triangles.triangles <= most.max(u64::from(tree.triangles(NodeId(0), Mesh::Full))));
        let error = by_triangles.geometric.unwrap().value;
        assert!(error <= last, "{error} after {last}");
        last = error;
        let bytes = full.bytes / share;
        let by_bytes = select(tree, &camera, &ViewOptions::error(0.05).with_most_bytes(bytes));
        assert!(by_bytes.bytes <= bytes.max(tree.memory_bytes(NodeId(0), Mesh::Full)));
    }
    assert_eq!(last, full.geometric.unwrap().value);
}

#[test]
fn cuts_do_not_flicker() {
    let store = store();
    let tree = store.tree();
    // Where the cut changes: back and forth over that place by less than the hysteresis.
    let at = |d: f64| camera(dvec3(0.0, -d, 0.0));
    let options = ViewOptions::error(1.0);
    let count = |d: f64| select(tree, &at(d), &options).drawn.len();
    let (mut near, mut far) = (3.0, 60.0);
    assert!(count(near) > 1 && count(far) == 1);
    for _ in 0..60 {
        let middle = 0.5 * (near + far);
        if count(middle) > 1 { near = middle } else { far = middle }
    }
    let mut selector = Selector::new();
    let mut selection = Selection::default();
    let mut changes = 0;
    let mut before = 0;
    for i in 0..40 {
        let d = near + if i % 2 == 0 { -0.02 } else { 0.02 } * near;
        selector.select(tree, &at(d), &options, |_| true, &mut selection);
        changes += usize::from(i > 0 && selection.drawn.len() != before);
        before = selection.drawn.len();
        assert!(selection.geometric.unwrap().value <= 1.0);
    }
    assert_eq!(changes, 0);
    // Far enough away, the coarser one comes back.
    selector.select(tree, &at(2.0 * near), &options, |_| true, &mut selection);
    assert_eq!(selection.drawn.len(), 1);
}

#[test]
fn backs_are_left_out_only_where_they_are_all_that_is_seen() {
    let store = store();
    let tree = store.tree();
    for camera in views().into_iter().filter(|c| c.eye().length() > 1.5) {
        let options = ViewOptions::error(0.3);
        let all = select(tree, &camera, &options);
        let fronts = select(tree, &camera, &options.with_backs_culled(true));
        let kept: HashSet<NodeId> = fronts.drawn.iter().map(|d| d.node).collect();
        let mut culled = 0;
        for d in all.drawn.iter().filter(|d| !kept.contains(&d.node)) {
            let mut mesh = NodeMesh::default();
            store.read(d.node, Mesh::Full, &mut mesh).unwrap();
            // An ancestor or descendant may be drawn instead; a node that is gone shows nothing but backs.
            culled += 1;
            for t in mesh.indices.as_chunks::<3>().0 {
                let [a, b, c] = t.map(|v| mesh.origin + mesh.positions[v as usize].as_dvec3());
                let to = match camera.projection() {
                    Projection::Orthographic { .. } => camera.forward(),
                    Projection::Perspective { .. } => a - camera.eye(),
                };
                assert!((b - a).cross(c - a).dot(to) >= -1e-12);
            }
        }
        if camera.eye().length() > 5.0 && all.drawn.len() > 40 {
            assert!(culled > 4, "{culled} of {}", all.drawn.len());
        }
    }
}

#[test]
fn what_is_not_there_is_wanted_and_nothing_is_drawn_in_part() {
    let store = store();
    let tree = store.tree();
    let camera = camera(dvec3(0.5, -2.0, 0.4));
    let options = ViewOptions::error(0.4);
    let mut there: HashSet<NodeId> = HashSet::new();
    let mut selector = Selector::new();
    let mut selection = Selection::default();
    selector.select(tree, &camera, &options, |n| there.contains(&n), &mut selection);
    assert!(selection.drawn.is_empty() && selection.geometric.unwrap().value == f64::INFINITY);
    assert_eq!(selection.wanted, [NodeId(0)]);
    let frustum = Frustum::from_camera(&camera);
    let mut last = f64::INFINITY;
    while let Some(&next) = selection.wanted.first() {
        there.insert(next);
        selector.select(tree, &camera, &options, |n| there.contains(&n), &mut selection);
        let drawn: HashSet<NodeId> = selection.drawn.iter().map(|d| d.node).collect();
        assert!(drawn.iter().all(|n| there.contains(n)));
        is_a_cut(tree, &drawn, |n| frustum.classify(&tree.bounds(n)) != Containment::Outside);
        let error = selection.geometric.unwrap().value;
        assert!(error <= last);
        last = error;
    }
    assert_eq!(last, select(tree, &camera, &options).geometric.unwrap().value);
}

#[test]
fn shadows_come_from_what_lies_towards_the_light() {
    // A small ball above a wide sheet, of which the camera sees a part under the ball.
    let ball = hard_cases::bumpy_ball(24);
    let sheet = common::terrain(70, |_, _| 0.0);
    let mut p: Vec<_> =
        ball.positions().iter().map(|&q| q * 0.2 + farsight_geometry::glam::vec3(0.0, 0.0, 2.0)).collect();
    let base = p.len() as u32;
    p.extend(sheet.positions().iter().map(|&q| q * 8.0 - farsight_geometry::glam::vec3(4.0, 4.0, 0.0)));
    let mut t = ball.triangles().to_vec();
    t.extend(sheet.triangles().iter().map(|t| t.map(|v| v + base)));
    let store = store_of(&TriangleMesh::new(p, t).unwrap());
    let tree = store.tree();
    let camera =
        Camera::look_at(dvec3(0.0, -0.5, 0.8), DVec3::ZERO, DVec3::Z).unwrap().with_range(0.05, 9.0).unwrap();
    let seen = select(tree, &camera, &ViewOptions::error(1.0));
    let receivers = seen.receiver_boxes(tree, &camera);
    assert!(!receivers.is_empty());
    let above_ball = |n: NodeId| tree.bounds(n).min.z > 1.5;
    for (light, has_ball) in [
        (CasterLight::Directional(dvec3(0.0, 0.0, -1.0)), true),
        (CasterLight::Point(dvec3(0.0, 0.0, 20.0)), true),
        (CasterLight::Directional(dvec3(1.0, 0.0, -0.05)), false),
        (CasterLight::Point(dvec3(0.0, 0.0, 0.4)), false),
    ] {
        let mut casters = Casters::default();
        select_casters(tree, light, &receivers, |_, _| 1e-9, |_| true, &mut casters);
        assert_eq!(casters.drawn.iter().any(|&n| above_ball(n)), has_ball, "{light:?}");
        // As fine as can be, which is not fine enough.
        assert!(casters.drawn.iter().all(|&n| tree.is_leaf(n)) && casters.excess > 1.0);
        assert!(casters.drawn.len() < tree.ids().filter(|&n| tree.is_leaf(n)).count());
        let fine = casters.triangles;
        select_casters(tree, light, &receivers, |_, _| 1e9, |_| true, &mut casters);
        assert!(casters.drawn == [NodeId(0)] && casters.triangles < fine && casters.excess <= 1.0);
        select_casters(tree, light, &receivers, |_, _| 0.01, |n| n == NodeId(0), &mut casters);
        assert!(casters.drawn == [NodeId(0)] && !casters.wanted.is_empty());
    }
}

#[test]
fn movement_bounds_when_nodes_are_needed() {
    let store = store();
    let tree = store.tree();
    let options = ViewOptions::error(1.0);
    let start = camera(dvec3(1.0, -6.0, 1.0));
    let now: HashSet<NodeId> = select(tree, &start, &options).drawn.iter().map(|d| d.node).collect();
    // Any straight movement, without turning: what is newly drawn was not said to be farther away.
    for (i, step) in
        [dvec3(0.0, 1.0, 0.0), dvec3(-0.3, 0.9, 0.1), dvec3(1.0, 0.2, 0.0), dvec3(0.0, 0.0, -1.0)]
            .iter()
            .enumerate()
    {
        for length in [0.2, 0.7, 1.5, 3.0] {
            let eye = start.eye() + step.normalize() * length;
            let moved = Camera::new(eye, start.world_from_view()).unwrap().with_range(0.01, 1e4).unwrap();
            for d in select(tree, &moved, &options).drawn.iter().filter(|d| !now.contains(&d.node)) {
                let parent_drawn = {
                    let mut at = tree.parent(d.node);
                    std::iter::from_fn(|| {
                        let n = at?;
                        at = tree.parent(n);
                        Some(n)
                    })
                    .any(|n| now.contains(&n))
                };
                let visible_before =
                    Frustum::from_camera(&start).classify(&tree.bounds(d.node)) != Containment::Outside;
                if parent_drawn || !visible_before {
                    let said = movement_until_needed(tree, d.node, &start, &options, f64::INFINITY);
                    assert!(said <= length + 1e-9, "{i} {length}: {:?} said {said}", d.node);
                }
            }
        }
    }
    let mut ahead = Vec::new();
    prefetch(tree, &start, &options, &PrefetchOptions::within(2.0), |n| now.contains(&n), &mut ahead);
    assert!(!ahead.is_empty() && ahead.iter().all(|n| !now.contains(n)));
    let said = |n: &NodeId| movement_until_needed(tree, *n, &start, &options, 2.0);
    assert!(ahead.iter().all(|n| said(n) <= 2.0));
}

#[test]
fn frames_never_wait_and_end_with_what_was_asked_for() {
    let store = store();
    let expected = {
        let camera = camera(dvec3(0.5, -2.0, 0.4));
        select(store.tree(), &camera, &ViewOptions::error(0.4))
    };
    let options =
        StreamOptions::default().with_frame_bytes(200_000).with_prefetch(PrefetchOptions::within(0.5));
    let mut stream = Stream::new(store, Mesh::Full, options).unwrap();
    let camera = camera(dvec3(0.5, -2.0, 0.4));
    let view = ViewOptions::error(0.4);
    let first = stream.frame(&camera, &view);
    assert_eq!(first.selection.drawn.len(), 1);
    assert!(first.selection.geometric.unwrap().value > 0.4);
    // Who goes by what came and went has all that is drawn, from the first frame on.
    let mut uploaded: HashSet<NodeId> = first.came.iter().copied().collect();
    assert!(first.selection.drawn.iter().all(|d| uploaded.contains(&d.node)));
    let mut frames = 0;
    loop {
        let frame = stream.frame(&camera, &view);
        assert_eq!(frame.draws().count(), frame.selection.drawn.len());
        frame.went.iter().for_each(|n| assert!(uploaded.remove(n)));
        frame.came.iter().for_each(|&n| assert!(uploaded.insert(n)));
        assert!(frame.selection.drawn.iter().all(|d| uploaded.contains(&d.node)));
        let came: u64 = frame.came.iter().map(|&n| frame.mesh(n).map_or(0, NodeMesh::bytes)).sum();
        assert!(came <= 200_000 || frame.came.len() == 1);
        frames += 1;
        if frame.selection.wanted.is_empty() {
            break;
        }
        assert!(frames < 20_000);
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    let last = stream.frame(&camera, &view).selection.clone();
    assert_eq!(last.drawn, expected.drawn);
    assert!(frames > 2 && stream.take_failures().is_empty());
    // Little memory: the frame is coarser, says so, and stays within it.
    let budget = last.bytes / 3;
    let small = StreamOptions::default().with_memory_bytes(budget);
    let store = self::store();
    let root = store.tree().memory_bytes(NodeId(0), Mesh::Full);
    let mut stream = Stream::new(store, Mesh::Full, small).unwrap();
    for _ in 0..60 {
        let frame = stream.frame(&camera, &view);
        assert!(!frame.selection.drawn.is_empty());
        assert!(stream.cached_bytes() <= budget.max(root));
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    assert!(stream.frame(&camera, &view).selection.geometric.unwrap().value > 0.4);
    // Nothing is read over and over that there is no room for, neither what is needed nor what may be.
    let ahead = small.with_memory_bytes(2 * last.bytes).with_prefetch(PrefetchOptions::within(9.0));
    for mut stream in [stream, Stream::new(self::store(), Mesh::Full, ahead).unwrap()] {
        let (mut quiet, mut frames) = (0, 0);
        while quiet < 20 {
            let came = !stream.frame(&camera, &view).came.is_empty();
            quiet = if came || !stream.is_idle() { 0 } else { quiet + 1 };
            frames += 1;
            assert!(frames < 5000);
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
    }
}
