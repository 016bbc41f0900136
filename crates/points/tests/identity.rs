//! The same bytes for any number of threads, memory limit, order and way in; positions bit for bit.

mod common;

use common::{Folder, Random, all_points, build_points, grid, shuffled, sorted, surface};
use farsight_points::glam::DVec3;
use farsight_points::{
    Batch, BuildOptions, Grid, Input, NodeData, NonFinite, Point, PointsError, Positions, Stage, Store,
    build, no_progress,
};
use std::ops::ControlFlow;

fn options(threads: usize, memory_mib: u64) -> BuildOptions {
    let mut options = BuildOptions::default();
    (options.threads, options.memory) = (threads, memory_mib << 20);
    options
}

/// A reader of some points, a few at a time.
fn in_batches(points: &[Point], each: usize) -> impl FnMut(&mut Batch) -> Result<bool, PointsError> + '_ {
    let mut chunks = points.chunks(each);
    move |batch| {
        let next = chunks.next();
        batch.points.extend_from_slice(next.unwrap_or_default());
        Ok(next.is_some())
    }
}

#[test]
fn threads_memory_order_and_source_change_no_byte() {
    let folder = Folder::new("identity");
    // 3.2 M points of 8 bytes do not fit in the least memory: they are spilled.
    let points = surface(3_200_000, 7);
    let path = folder.path("a.points");
    build_points(&points, &path, &options(2, 512)).unwrap();
    let expected = std::fs::read(&path).unwrap();
    assert!(sorted(&all_points(&Store::open(&path).unwrap())) == sorted(&points));
    let mixed = shuffled(points.clone(), 3);
    for (name, points, options) in [
        ("one thread", &points, options(1, 512)),
        ("little memory", &points, options(2, 64)),
        ("three threads, shuffled, little memory", &mixed, options(3, 64)),
    ] {
        build_points(points, &path, &options).unwrap();
        assert!(std::fs::read(&path).unwrap() == expected, "{name}");
    }
    let input = Input::from_reader(grid(), "", 0, in_batches(&mixed, 50_000)).unwrap();
    build(input, &path, &options(2, 64), &no_progress).unwrap();
    assert!(std::fs::read(&path).unwrap() == expected, "from a reader");
    assert_eq!(folder.names(), ["a.points"]);
}

#[test]
fn attributes_stay_with_their_points() {
    let folder = Folder::new("attributes");
    for bytes in [1usize, 8, 11, 24, 64] {
        // Many equal points: attributes break ties, and so do not depend on the order.
        let mut random = Random(bytes as u64);
        let mut all: Vec<(Point, Vec<u8>)> = (0..60_000)
            .map(|i| {
                let p = Point::new(
                    [(i % 300) * 50, random.below(40) as i32 * 1000, i % 3],
                    [random.bits() as u8 & 1; 3],
                );
                (p, (0..bytes).map(|_| random.bits() as u8 & 3).collect())
            })
            .collect();
        let mut files = Vec::new();
        for turn in 0..2 {
            let path = folder.path(&format!("{turn}.points"));
            let mut chunks = all.chunks(10_000);
            let reader = |batch: &mut Batch| {
                let Some(chunk) = chunks.next() else { return Ok(false) };
                for (p, a) in chunk {
                    batch.points.push(*p);
                    batch.attributes.extend(a);
                }
                Ok(true)
            };
            let input = Input::from_reader(grid(), "random", bytes, reader).unwrap();
            build(input, &path, &options(2, 64), &no_progress).unwrap();
            files.push(std::fs::read(&path).unwrap());
            all.reverse();
        }
        assert!(files[0] == files[1]);
        let store = Store::from_bytes(files.remove(0)).unwrap();
        assert_eq!((store.octree().attribute_bytes(), store.octree().attributes()), (bytes, "random"));
        let mut data = NodeData::default();
        let mut found = Vec::new();
        for id in store.octree().ids() {
            store.read(id, &mut data).unwrap();
            found.extend(
                data.points
                    .iter()
                    .zip(data.attributes.chunks(bytes))
                    .map(|(p, a)| (p.position, p.colour, a.to_vec())),
            );
        }
        let mut expected: Vec<_> = all.iter().map(|(p, a)| (p.position, p.colour, a.clone())).collect();
        found.sort();
        expected.sort();
        assert!(found == expected);
    }
}

#[test]
fn the_whole_range_of_integers_and_dense_cells_with_outliers() {
    let folder = Folder::new("range");
    let mut random = Random(2);
    let mut wide: Vec<Point> = (0..100_000)
        .map(|_| Point::new([0; 3].map(|_: i32| random.bits() as i32), random.colour()))
        .collect();
    wide.push(Point::new([i32::MIN; 3], [0; 3]));
    wide.push(Point::new([i32::MAX; 3], [0; 3]));
    // All but two points in one cell of the histogram: the cell is cut again, more than once.
    let mut dense: Vec<Point> = (0..2_000_000)
        .map(|_| Point::new([0; 3].map(|_: i32| random.below(300) as i32), random.colour()))
        .collect();
    dense.push(Point::new([i32::MAX; 3], [1; 3]));
    dense.push(Point::new([i32::MIN; 3], [1; 3]));
    for points in [wide, dense] {
        let path = folder.path("a.points");
        build_points(&points, &path, &options(2, 64)).unwrap();
        let first = std::fs::read(&path).unwrap();
        assert!(sorted(&all_points(&Store::open(&path).unwrap())) == sorted(&points));
        build_points(&shuffled(points, 1), &path, &options(1, 512)).unwrap();
        assert!(std::fs::read(&path).unwrap() == first);
    }
}

#[test]
fn nothing_and_the_same_position_over_and_over() {
    let folder = Folder::new("same");
    let path = folder.path("a.points");
    assert_eq!(build_points(&[], &path, &BuildOptions::default()).unwrap().points, 0);
    let store = Store::open(&path).unwrap();
    assert!(store.octree().is_empty() && store.octree().world_bounds().is_empty());
    let mut random = Random(1);
    let same: Vec<Point> = (0..300_000).map(|_| Point::new([7, 8, 9], random.colour())).collect();
    let report = build_points(&same, &path, &BuildOptions::default()).unwrap();
    assert_eq!(report.levels, [1, 299_999]);
    assert!(sorted(&all_points(&Store::open(&path).unwrap())) == sorted(&same));
}

#[test]
fn world_positions_come_back_to_the_bit_at_utm_coordinates() {
    let folder = Folder::new("utm");
    let path = folder.path("a.points");
    let mut random = Random(4);
    let grid = grid();
    let world: Vec<(DVec3, [u8; 3])> = (0..50_000)
        .map(|_| {
            let p = [0; 3].map(|_: i32| random.below(2_000_000) as i32 - 1_000_000);
            (grid.world(p), random.colour())
        })
        .collect();
    let positions = Positions::new(grid, world.iter().copied(), NonFinite::Refuse);
    build(Input::from_reader(grid, "", 0, positions).unwrap(), &path, &BuildOptions::default(), &no_progress)
        .unwrap();
    let store = Store::open(&path).unwrap();
    let bits = |v: DVec3| v.to_array().map(f64::to_bits);
    let mut found: Vec<_> =
        all_points(&store).iter().map(|p| bits(store.octree().grid().world(p.position))).collect();
    let mut expected: Vec<_> = world.iter().map(|(p, _)| bits(*p)).collect();
    found.sort_unstable();
    expected.sort_unstable();
    assert!(found == expected);
}

#[test]
fn what_is_not_finite_is_refused_or_counted() {
    let folder = Folder::new("finite");
    let path = folder.path("a.points");
    let grid = Grid::new(DVec3::ONE, DVec3::ZERO).unwrap();
    let world = [DVec3::ONE, DVec3::NAN, DVec3::X * f64::INFINITY, DVec3::X].map(|p| (p, [1; 3]));
    let refuse = Positions::new(grid, world.into_iter(), NonFinite::Refuse);
    let error = build(
        Input::from_reader(grid, "", 0, refuse).unwrap(),
        &path,
        &BuildOptions::default(),
        &no_progress,
    );
    assert!(matches!(error, Err(PointsError::NotFinite { point: 1, .. })), "{error:?}");
    let skip = Positions::new(grid, world.into_iter(), NonFinite::Skip);
    let skipped = skip.skipped();
    let report =
        build(Input::from_reader(grid, "", 0, skip).unwrap(), &path, &BuildOptions::default(), &no_progress);
    assert_eq!((report.unwrap().points, skipped.load(std::sync::atomic::Ordering::Relaxed)), (2, 2));
    let far = Positions::new(grid, [(DVec3::X * 1e10, [0; 3])].into_iter(), NonFinite::Skip);
    let error =
        build(Input::from_reader(grid, "", 0, far).unwrap(), &path, &BuildOptions::default(), &no_progress);
    assert!(matches!(error, Err(PointsError::Range { axis: 0, .. })), "{error:?}");
    assert_eq!(folder.names(), ["a.points"]);
}

#[test]
fn clouds_in_single_precision_move_by_less_than_they_say() {
    use farsight_points::glam::Vec3;
    let folder = Folder::new("cloud");
    let path = folder.path("a.points");
    let mut random = Random(8);
    for (scale, offset) in [(1.0f32, 0.0f32), (1e-12, 0.0), (3e5, 2e5), (1e15, 0.0), (0.0, 5.3)] {
        let positions: Vec<Vec3> = (0..5000)
            .map(|_| Vec3::from_array([0; 3].map(|_: i32| random.unit() as f32 * scale + offset)))
            .collect();
        let cloud = farsight_geometry::PointCloud::new(DVec3::splat(1e3), positions.clone()).unwrap();
        let input = Input::from_cloud(&cloud).unwrap();
        let bound = input.rounding().value;
        build(input, &path, &BuildOptions::default(), &no_progress).unwrap();
        let store = Store::open(&path).unwrap();
        assert_eq!(store.octree().rounding().value, bound);
        assert!(bound <= f64::from(scale + offset) * 1e-6);
        // Sorting both along x pairs the points up to rounding.
        let mut found: Vec<f64> =
            all_points(&store).iter().map(|p| store.octree().grid().world(p.position).x).collect();
        let mut expected: Vec<f64> = positions.iter().map(|p| f64::from(p.x) + 1e3).collect();
        found.sort_by(f64::total_cmp);
        expected.sort_by(f64::total_cmp);
        let f64_noise = 1e3 * f64::EPSILON * 4.0 + f64::from(scale) * f64::EPSILON * 4.0;
        for (a, b) in found.iter().zip(&expected) {
            assert!((a - b).abs() <= bound + f64_noise, "{a} {b} {bound}");
        }
    }
}

#[test]
fn inputs_join_on_one_grid_or_not_at_all() {
    let folder = Folder::new("join");
    let path = folder.path("a.points");
    let (a, b) = (surface(2000, 1), surface(2000, 2));
    let first = || Input::from_points(grid(), &a);
    // 1.5 km further east, in whole steps.
    let shifted = Grid { offset: grid().offset + DVec3::X * 1500.0, ..grid() };
    let input = first().join(Input::from_points(shifted, &b)).unwrap();
    build(input, &path, &BuildOptions::default(), &no_progress).unwrap();
    let moved =
        |p: &Point| Point { position: [p.position[0] + 1_500_000, p.position[1], p.position[2]], ..*p };
    let expected: Vec<Point> = a.iter().copied().chain(b.iter().map(moved)).collect();
    assert!(sorted(&all_points(&Store::open(&path).unwrap())) == sorted(&expected));
    let half = Grid { offset: grid().offset + DVec3::X * 0.0005, ..grid() };
    assert!(matches!(first().join(Input::from_points(half, &b)), Err(PointsError::GridsDiffer { .. })));
    let coarse = Grid { scale: DVec3::splat(0.01), ..grid() };
    assert!(matches!(first().join(Input::from_points(coarse, &b)), Err(PointsError::GridsDiffer { .. })));
    // A shift that leaves 32 bits is found when the points are seen.
    let far = Grid { offset: grid().offset + DVec3::X * 2_200_000.0, ..grid() };
    let input = first().join(Input::from_points(far, &b)).unwrap();
    let error = build(input, &path, &BuildOptions::default(), &no_progress);
    assert!(matches!(error, Err(PointsError::Range { axis: 0, .. })), "{error:?}");
}

#[test]
fn cancelled_builds_leave_nothing_and_keep_what_was_there() {
    let folder = Folder::new("cancel");
    let path = folder.path("a.points");
    let points = surface(300_000, 1);
    build_points(&points[..1000], &path, &BuildOptions::default()).unwrap();
    let before = std::fs::read(&path).unwrap();
    for stage in [Stage::Count, Stage::Partition, Stage::Build] {
        let stop = |p: farsight_points::Progress| {
            if p.stage == stage { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let error = build(Input::from_points(grid(), &points), &path, &options(2, 64), &stop);
        assert!(matches!(error, Err(PointsError::Cancelled)), "{stage:?}: {error:?}");
        assert_eq!(folder.names(), ["a.points"]);
        assert!(std::fs::read(&path).unwrap() == before);
    }
}

#[test]
fn options_out_of_range_are_refused() {
    let folder = Folder::new("options");
    let (mut flat, mut starved) = (BuildOptions::default(), BuildOptions::default());
    (flat.inner_depth, starved.memory) = (0, 1000);
    for (name, options) in [("inner_depth", flat), ("memory", starved)] {
        let error = build_points(&[], &folder.path("a.points"), &options).unwrap_err();
        assert!(matches!(error, PointsError::Option { option, .. } if option == name));
    }
    assert!(matches!(
        Input::from_reader(grid(), "", 65, |_: &mut Batch| Ok(false)),
        Err(PointsError::Attributes { bytes: 65, most: 64 })
    ));
    let named = |length: usize| {
        Input::from_reader(grid(), &"é".repeat(length / 2), 1, |_: &mut Batch| Ok(false)).map(|_| ())
    };
    assert!(
        named(254).is_ok() && matches!(named(256), Err(PointsError::Option { option: "attributes", .. }))
    );
    let missing = build_points(&[], &folder.path("no/folder/a.points"), &BuildOptions::default());
    assert!(matches!(missing, Err(PointsError::Io { .. })));
}
