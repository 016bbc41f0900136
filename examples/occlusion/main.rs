//! Occlusion culling on a walk through a town, without a graphics card: the software depth buffer answers the queries.
//!
//! ```text
//! cargo run --release --example occlusion                 a town of 1.4 M triangles
//! cargo run --release --example occlusion -- --quick      a small one
//! cargo run --release --example occlusion -- level.glb    your own .obj, .gltf, .glb (y up), looked around from the positions in
//!                                                         level.stations.json where there is one
//! ```
//!
//! You should see a table of all algorithms (mean work per frame, CPU time with the culling's own cost included, pixels that differ
//! from drawing everything: none), then `out/occlusion/view.png`, what the camera sees, and `out/occlusion/above.png`, the town
//! from above with what became of each node: green drawn, yellow drawn though hidden, red culled, grey never looked at.

mod above;
mod place;
mod walk;

use clap::Parser;
use farsight_geometry::{Camera, Scene};
use farsight_occlusion::{Algorithm, Options, Order, Schedule};
use farsight_raster::scenes::{City, Path};
use farsight_raster::{Image, Rasteriser, RenderOptions, render_scene};
use std::error::Error;
use std::path::PathBuf;
use std::process::ExitCode;
use walk::{Report, Town};

#[derive(Parser)]
#[command(about = "Walks through a town with every culling algorithm")]
struct Arguments {
    /// A scene to load; without, a town is generated.
    path: Option<PathBuf>,
    /// A small town, a small image, few frames.
    #[arg(long)]
    quick: bool,
    /// Folder for the pictures.
    #[arg(long, default_value = "out/occlusion")]
    out: PathBuf,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("occlusion: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), Box<dyn Error>> {
    let size = if arguments.quick { [320, 180] } else { [1280, 720] };
    let (scene, cameras) = match &arguments.path {
        Some(path) => place::load(path, size)?,
        None => generated(arguments.quick, size)?,
    };
    let frames = cameras.len();
    let town = Town::new(&scene)?;
    println!("{} objects, {} triangles, {frames} frames", scene.instances().len(), scene.placed_triangles());
    println!(
        "{:<24} {:>8} {:>9} {:>8} {:>8} {:>7} {:>9} {:>8}",
        "per frame", "drawn", "triangles", "visited", "queries", "late", "CPU ms", "wrong px"
    );
    let mut reference: Option<Report> = None;
    for (name, options) in algorithms() {
        let (report, _) = town.walk(options, &cameras)?;
        report.print(name, reference.as_ref());
        reference.get_or_insert(report);
    }
    // A frame early in the walk, where most of the town lies ahead.
    let shown = frames / 5;
    let (_, culler) = town.walk(Options::default(), &cameras[..=shown])?;
    std::fs::create_dir_all(&arguments.out)
        .map_err(|e| format!("cannot write to {}: {e}", arguments.out.display()))?;
    let camera = cameras[shown];
    let (target, _) = render_scene(&mut Rasteriser::new(), &scene, &camera, &RenderOptions::default())?;
    Image::from_colour(&target).write_png(arguments.out.join("view.png"))?;
    above::picture(&town.bvh, &culler, &camera, 900)?.write_png(arguments.out.join("above.png"))?;
    println!("{}", arguments.out.join("above.png").display());
    Ok(())
}

/// A walk along a street of a generated town.
fn generated(quick: bool, size: [u32; 2]) -> Result<(Scene, Vec<Camera>), Box<dyn Error>> {
    let city = if quick { City::small() } else { City::default() };
    let frames = if quick { 8 } else { 40 };
    let path = Path::street_walk(&city);
    let camera = |i: usize| Ok::<_, Box<dyn Error>>(path.camera(i, frames)?.with_image(size[0], size[1])?);
    Ok((city.build()?, (0..frames).map(camera).collect::<Result<Vec<_>, _>>()?))
}

/// The baseline first, what to use last.
fn algorithms() -> Vec<(&'static str, Options)> {
    let with = |change: fn(&mut Options)| {
        let mut options = Options::default();
        change(&mut options);
        options
    };
    vec![
        ("frustum only", Options::baseline(Algorithm::FrustumOnly)),
        ("naive", Options::baseline(Algorithm::Naive)),
        ("stop and wait", Options::baseline(Algorithm::StopAndWait)),
        ("pseudocode", Options::pseudocode()),
        ("stack", with(|o| o.order = Order::Stack)),
        ("leaves every 5 frames", with(|o| o.query_leaves_every = 5)),
        ("16 nodes per query", with(|o| o.nodes_per_query = 16)),
        ("waves", with(|o| o.schedule = Schedule::Waves)),
        ("coherent", Options::default()),
    ]
}
