//! What a view costs and what it loses, against drawing all points.

use crate::data;
use crate::pixels::{Plain, hausdorff_px, lost};
use farsight_geometry::Camera;
use farsight_geometry::glam::DVec3;
use farsight_points::{
    BuildOptions, Input, LasOptions, Selection, Store, Traversal, ViewOptions, build, no_progress,
};
use farsight_raster::{Image, Target};
use std::error::Error;
use std::time::Instant;

/// Builds the street with some options.
pub fn street(count: u64, options: &BuildOptions, name: &str) -> Result<Store, Box<dyn Error>> {
    let input = data::las_file(data::Cloud::Street, count)?;
    let out = data::folder().join(name);
    build(Input::las(&[input], &LasOptions::default())?, &out, options, &no_progress)?;
    Ok(Store::open(out)?)
}

/// On the street, above its roofs, and from afar.
pub fn views(store: &Store, size: [u32; 2]) -> Result<Vec<(&'static str, Camera)>, Box<dyn Error>> {
    let ground = store.octree().grid().offset;
    let look = |eye: DVec3, target: DVec3| -> Result<Camera, Box<dyn Error>> {
        Ok(Camera::look_at(ground + eye, ground + target, DVec3::Z)?.with_image(size[0], size[1])?)
    };
    Ok(vec![
        ("street", look(DVec3::new(250.0, -1.0, 1.7), DVec3::new(300.0, 0.5, 3.0))?),
        ("aerial", look(DVec3::new(180.0, -90.0, 80.0), DVec3::new(290.0, 0.0, 5.0))?),
        ("far", look(DVec3::new(290.0, -1200.0, 500.0), DVec3::new(290.0, 0.0, 5.0))?),
    ])
}

/// Root of the mean squared difference from a supersampled picture.
fn rmse(target: &Target, reference: &Image) -> Result<f64, Box<dyn Error>> {
    Ok(Image::from_colour(target).compare(reference)?.rmse)
}

/// The table of lost pixels.
pub fn report(count: u64, size: [u32; 2]) -> Result<(), Box<dyn Error>> {
    let store = street(count, &BuildOptions::default(), "views.points")?;
    println!(
        "\nlost pixels, {count} points, {} x {}, floors: 1 px 1 %, 0.5 px 0.1 %, 0.25 px 0.02 %; RMSE within 3 % of all points'",
        size[0], size[1]
    );
    println!(
        "{:<8} {:>6} {:>9} {:>9} {:>7} {:>11} {:>10} {:>6} {:>9} {:>9}",
        "view", "px", "proven", "measured", "nodes", "points", "lost", "extra", "RMSE/all", "ms"
    );
    for (name, camera) in views(&store, size)? {
        let all = Plain::all(&store, camera)?;
        let fine = camera.with_image(4 * size[0], 4 * size[1])?;
        let reference = Image::from_colour(&Plain::all(&store, fine)?.target.downsampled(4));
        let own = rmse(&all.target, &reference)?;
        let (mut traversal, mut selection) = (Traversal::new(), Selection::default());
        for px in [4.0, 2.0, 1.0, 0.5, 0.25] {
            let options = ViewOptions::error(px);
            traversal.select(store.octree(), &camera, &options, |_| true, &mut selection);
            let start = Instant::now();
            for _ in 0..20 {
                traversal.select(store.octree(), &camera, &options, |_| true, &mut selection);
            }
            let ms = start.elapsed().as_secs_f64() * 50.0;
            let some = Plain::some(&store, camera, selection.drawn.iter().map(|d| d.node))?;
            let (lost, extra) = lost(&all, &some);
            let claimed = selection.error.map_or(0.0, |e| e.value);
            let measured = hausdorff_px(&store, &camera, &selection, claimed)?;
            println!(
                "{name:<8} {px:>6} {:>9.4} {measured:>9.4} {:>7} {:>11} {:>9.4}% {extra:>6} {:>9.4} {ms:>9.4}",
                claimed,
                selection.drawn.len(),
                selection.points,
                100.0 * lost,
                rmse(&some.target, &reference)? / own,
            );
        }
    }
    Ok(())
}

/// Time of selections with all nodes chosen, and with budgets.
pub fn selection(count: u64) -> Result<(), Box<dyn Error>> {
    use stats_alloc::Region;
    println!(
        "\nselection, mean of 200, all nodes chosen / 5 M / 1 M points; floors: 0.12 ms for 4,000, 1.0 ms for 35,000; no allocation"
    );
    for (depth, merge) in [(7, 1800), (5, 260)] {
        let mut build = BuildOptions::default();
        (build.inner_depth, build.merge_below) = (depth, merge);
        let store = street(count, &build, "select.points")?;
        let camera = views(&store, [1920, 1080])?.swap_remove(2).1;
        let (mut traversal, mut selection) = (Traversal::new(), Selection::default());
        let mut line = format!("depth {depth}: {} nodes", store.octree().len());
        for budget in [u64::MAX, 5_000_000, 1_000_000] {
            let options = ViewOptions::error(1e-9).with_budget(budget);
            traversal.select(store.octree(), &camera, &options, |_| true, &mut selection);
            let region = Region::new(crate::ALLOCATOR);
            let start = Instant::now();
            for _ in 0..200 {
                traversal.select(store.octree(), &camera, &options, |_| true, &mut selection);
            }
            let ms = start.elapsed().as_secs_f64() * 5.0;
            let allocations = region.change().allocations + region.change().reallocations;
            line += &format!("  {} chosen {ms:.4} ms, {allocations} allocations", selection.drawn.len());
        }
        println!("{line}");
    }
    Ok(())
}
