//! What point clouds look like when only some of the points are drawn: lost pixels, hard cases of views, streaming.

#[path = "../benches/points/pixels.rs"]
mod pixels;

use farsight_geometry::glam::DVec3;
use farsight_geometry::hard_cases::{meshes, views};
use farsight_geometry::{Camera, DAabb};
use farsight_points::{
    BuildOptions, Grid, Input, NonFinite, Point, Positions, Selection, Store, Traversal, ViewOptions, build,
    no_progress,
};
use farsight_raster::scenes::StreetPoints;
use pixels::{Plain, hausdorff_px, lost};

fn built(input: Input<'_>, name: &str) -> Store {
    let path = std::env::temp_dir().join(format!("farsight-images-{name}-{}.points", std::process::id()));
    build(input, &path, &BuildOptions::default(), &no_progress).unwrap();
    let store = Store::from_bytes(std::fs::read(&path).unwrap()).unwrap();
    std::fs::remove_file(path).unwrap();
    store
}

fn street(count: u64) -> Store {
    let mut street = StreetPoints::default();
    street.count = count;
    let grid = Grid::new(DVec3::splat(0.001), street.offset).unwrap();
    let points: Vec<Point> =
        street.points().unwrap().map(|p| Point::new(grid.nearest(p.position).unwrap(), p.colour)).collect();
    built(Input::from_points(grid, &points), "street")
}

fn select(store: &Store, camera: &Camera, px: f64) -> Selection {
    let mut selection = Selection::default();
    Traversal::new().select(store.octree(), camera, &ViewOptions::error(px), |_| true, &mut selection);
    selection
}

#[test]
fn few_pixels_are_lost_and_none_are_made_up() {
    let store = street(1_500_000);
    let ground = store.octree().grid().offset;
    for (name, eye, target) in [
        ("street", DVec3::new(70.0, -1.0, 1.7), DVec3::new(110.0, 0.5, 3.0)),
        ("aerial", DVec3::new(60.0, -60.0, 50.0), DVec3::new(100.0, 0.0, 5.0)),
        ("far", DVec3::new(100.0, -420.0, 180.0), DVec3::new(100.0, 0.0, 5.0)),
    ] {
        let camera =
            Camera::look_at(ground + eye, ground + target, DVec3::Z).unwrap().with_image(640, 360).unwrap();
        let all = Plain::all(&store, camera).unwrap();
        for (px, most) in [(1.0, 0.01), (0.5, 0.001), (0.25, 0.0002)] {
            let selection = select(&store, &camera, px);
            let some = Plain::some(&store, camera, selection.drawn.iter().map(|d| d.node)).unwrap();
            let (lost, extra) = lost(&all, &some);
            println!("{name} {px} px: {} points, {:.5} % lost", selection.points, 100.0 * lost);
            assert_eq!(extra, 0, "{name}");
            assert!(lost <= most, "{name} {px} px: {lost}");
            let claimed = selection.error.unwrap().value;
            let measured = hausdorff_px(&store, &camera, &selection, claimed).unwrap();
            assert!(measured <= claimed && claimed <= px, "{name} {px} px: {measured}, {claimed} claimed");
        }
    }
}

/// Vertices of every hard mesh, from every hard view.
#[test]
fn hard_clouds_from_hard_views_keep_their_bound() {
    for hard in meshes() {
        let mesh = &hard.mesh;
        // Of all vertices, whether a triangle uses them or not.
        let bounds = DAabb::from_points(mesh.positions().iter().map(|p| mesh.origin() + p.as_dvec3()));
        let size = bounds.extent().max_element().max(1e-3 * bounds.center().abs().max_element());
        let scale = if bounds.is_empty() || size == 0.0 { 1e-3 } else { size * 2f64.powi(-24) };
        let center = if bounds.is_empty() { DVec3::ZERO } else { bounds.center() };
        let grid = Grid::new(DVec3::splat(scale), center).unwrap();
        let world = mesh.positions().iter().map(|p| (mesh.origin() + p.as_dvec3(), [200, 100, 50]));
        let input = Input::from_reader(grid, "", 0, Positions::new(grid, world, NonFinite::Refuse)).unwrap();
        let store = built(input, "hard");
        assert_eq!(store.octree().points(), mesh.positions().len() as u64, "{}", hard.name);
        for view in views(&bounds) {
            for px in [8.0, 1.0] {
                let selection = select(&store, &view.camera, px);
                let claimed = selection.error.unwrap().value;
                assert!(claimed <= px, "{} / {}", hard.name, view.name);
                let measured = hausdorff_px(&store, &view.camera, &selection, claimed).unwrap();
                assert!(measured <= claimed, "{} / {}: {measured} > {claimed}", hard.name, view.name);
            }
        }
    }
}
