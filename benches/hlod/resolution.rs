//! What the resolution costs: nodes of a coarser tolerance take fewer bytes and less time, and leave views between two levels with more triangles.

use crate::path::{FRAMES, camera};
use crate::{Outcome, built, surfaces, temp};
use farsight_hlod::{BuildOptions, Mesh, Selection, Selector, Store, Tier, ViewOptions};
use farsight_raster::thread_cpu_time;

const RESOLUTIONS: [f64; 4] = [64.0, 128.0, 256.0, 512.0];

/// Builds, and the views of [`path`](crate::path) at half a pixel.
pub fn table(quick: bool) -> Outcome {
    println!(
        "\nresolution, verified tier on one thread; {FRAMES} views from 1.3 to 40 radii at half a pixel, per frame"
    );
    println!(
        "{:<16} {:<6} {:>6} {:>8} {:>7} {:>6} {:>10} {:>6} {:>8}",
        "surface", "meshes", "res", "ktri/s", "B/tri", "nodes", "triangles", "drawn", "kB"
    );
    for (name, mesh) in surfaces(quick)? {
        for (what, appearance) in [("shape", false), ("looks", true)] {
            for resolution in RESOLUTIONS {
                let file = temp("resolution");
                let options = BuildOptions::default().with_threads(1).with_tier(Tier::Verified);
                let options = options.with_appearance(appearance).with_resolution(resolution);
                let start = thread_cpu_time();
                let report = built(&mesh, &file, &options)?;
                let seconds = (thread_cpu_time() - start).as_secs_f64();
                let store = Store::open(&file)?;
                let tree = store.tree();
                let (mut selector, mut selection) = (Selector::new(), Selection::default());
                let (mut triangles, mut drawn, mut bytes) = (0, 0, 0);
                for frame in 0..FRAMES {
                    let options = ViewOptions::error(0.5);
                    selector.select(tree, &camera(&mesh, frame)?, &options, |_| true, &mut selection);
                    triangles += selection.triangles;
                    drawn += selection.drawn.len();
                    bytes += selection.drawn.iter().map(|d| tree.disk_bytes(d.node, Mesh::Full)).sum::<u64>();
                }
                println!(
                    "{name:<16} {what:<6} {resolution:>6} {:>8.1} {:>7.2} {:>6} {:>10} {:>6} {:>8.1}",
                    report.triangles as f64 / seconds / 1e3,
                    report.bytes as f64 / report.triangles as f64,
                    tree.ids().len(),
                    triangles / u64::from(FRAMES),
                    drawn / FRAMES as usize,
                    bytes as f64 / f64::from(FRAMES) / 1e3,
                );
                drop(store);
                std::fs::remove_file(&file)?;
            }
        }
    }
    Ok(())
}
