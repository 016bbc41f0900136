//! Point clouds: accuracy, budget and depth of the inner trees against how far visible points are from drawn ones, the points
//! drawn and the pixels lost. The frame is selected and drawn by the reference renderer.

#[path = "../points/pixels.rs"]
mod pixels;

use super::row::{Row, timed};
use farsight_geometry::Camera;
use farsight_geometry::accuracy::Counters;
use farsight_geometry::glam::DVec3;
use farsight_points::{
    BuildOptions, Grid, Input, NodeData, Point, Selection, Store, Traversal, ViewOptions, build, no_progress,
};
use farsight_raster::scenes::StreetPoints;
use pixels::{Plain, hausdorff_px, lost};

pub fn rows(quick: bool) -> Vec<Row> {
    let (count, size) = if quick { (150_000, [480, 270]) } else { (2_000_000, [1280, 720]) };
    let points = street(count);
    let mut rows = Vec::new();
    let store = stored(&points, 7);
    for (scene, camera) in views(&store, size) {
        let all = Plain::all(&store, camera).expect("a picture");
        let row = |store: &Store, knob: &str, value: f64, options: ViewOptions| {
            frame(store, &all, &camera, scene, knob, value, &options)
        };
        for px in [8.0, 4.0, 2.0, 1.0, 0.5, 0.25] {
            rows.push(row(&store, "error px", px, ViewOptions::error(px)));
        }
        for share in [0.02, 0.05, 0.1, 0.3, 0.6] {
            let budget = (count as f64 * share) as u64;
            rows.push(row(&store, "budget", share, ViewOptions::error(0.25).with_budget(budget)));
        }
    }
    // The same error by other depths: fewer, larger nodes or more, smaller ones.
    for depth in [5, 6, 7, 8, 9] {
        let store = stored(&points, depth);
        let (scene, camera) = views(&store, size).swap_remove(1);
        let all = Plain::all(&store, camera).expect("a picture");
        let options = ViewOptions::error(1.0);
        rows.push(frame(&store, &all, &camera, scene, "inner depth at 1 px", depth.into(), &options));
    }
    rows
}

fn grid() -> Grid {
    Grid::new(DVec3::splat(0.001), StreetPoints::default().offset).expect("a usable grid")
}

fn street(count: u64) -> Vec<Point> {
    let mut street = StreetPoints::default();
    street.count = count;
    let point =
        |p: farsight_raster::scenes::ScanPoint| Some(Point::new(grid().nearest(p.position)?, p.colour));
    street.points().expect("a street").filter_map(point).collect()
}

fn stored(points: &[Point], depth: u32) -> Store {
    let path = std::env::temp_dir().join(format!("farsight-sweep-{}.points", std::process::id()));
    let mut options = BuildOptions::default();
    options.inner_depth = depth;
    build(Input::from_points(grid(), points), &path, &options, &no_progress).expect("a file");
    let bytes = std::fs::read(&path).expect("the file");
    std::fs::remove_file(&path).expect("ours");
    Store::from_bytes(bytes).expect("a sound file")
}

fn views(store: &Store, size: [u32; 2]) -> Vec<(&'static str, Camera)> {
    let ground = store.octree().grid().offset;
    let look = |eye: DVec3, target: DVec3| {
        let camera = Camera::look_at(ground + eye, ground + target, DVec3::Z).expect("a view");
        camera.with_image(size[0], size[1]).expect("a size")
    };
    vec![
        ("on the street", look(DVec3::new(70.0, -1.0, 1.7), DVec3::new(110.0, 0.5, 3.0))),
        ("from afar", look(DVec3::new(100.0, -420.0, 180.0), DVec3::new(100.0, 0.0, 5.0))),
    ]
}

fn frame(
    store: &Store,
    all: &Plain,
    camera: &Camera,
    scene: &str,
    knob: &str,
    value: f64,
    options: &ViewOptions,
) -> Row {
    let (mut traversal, mut selection) = (Traversal::new(), Selection::default());
    // What a frame draws lies in memory: reading is no part of its time.
    traversal.select(store.octree(), camera, options, |_| true, &mut selection);
    let nodes: Vec<NodeData> = selection
        .drawn
        .iter()
        .map(|d| {
            let mut data = NodeData::default();
            store.read(d.node, &mut data).expect("a sound node");
            data
        })
        .collect();
    let mut picture = Plain::new(*camera).expect("a picture");
    let ((), times) = timed(3, || {
        traversal.select(store.octree(), camera, options, |_| true, &mut selection);
        picture.target.clear();
        nodes.iter().for_each(|data| picture.draw(store, data));
    });
    let claimed = selection.error.expect("selected");
    let measured = hausdorff_px(store, camera, &selection, claimed.value.min(1e4)).expect("readable");
    let (lost, extra) = lost(all, &picture);
    assert_eq!(extra, 0, "some of the points cannot cover more than all");
    let mut counters = Counters::new();
    counters.add("points", selection.points);
    counters.add("nodes", selection.drawn.len() as u64);
    counters.add("visited", selection.counters.get("visited"));
    counters.add("lost_per_million", (lost * 1e6).round() as u64);
    let bytes = nodes.iter().map(|d| d.bytes() as u64).sum();
    Row {
        krate: "points",
        scene: scene.to_owned(),
        knob: knob.to_owned(),
        value,
        claimed,
        measured,
        times,
        bytes,
        counters,
    }
}
