//! A surface simplified to several tolerances: what is left of it, how it looks, and how far it really is off.
//!
//! ```text
//! cargo run --release --example hlod                    a generated surface
//! cargo run --release --example hlod -- bunny.obj       your own .obj, .gltf, .glb (y up)
//! cargo run --release --example hlod -- --looks x.glb   normals, texture coordinates and colours count too
//! ```
//!
//! You should see a table (triangles, the bound that is claimed, the true distance measured by other code, pixels that differ) and
//! `out/hlod/comparison.png`: a column for each tolerance from the original on, shaded above, with every triangle in its own grey in
//! the middle, and four times the difference to the original below. `out/hlod/index.html` shows both together.

mod page;
mod picture;
mod surface;

use clap::Parser;
use farsight_geometry::distance::{HausdorffOptions, hausdorff};
use farsight_geometry::{Camera, TriangleMesh};
use farsight_hlod::{SimplifyOptions, Tier, simplify};
use picture::Views;
use std::error::Error;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

#[derive(Parser)]
#[command(about = "Simplifies a surface to several tolerances and shows what that does")]
struct Options {
    /// A scene to load (.obj, .gltf, .glb); without, a surface is generated.
    path: Option<PathBuf>,
    /// Folder for the pictures.
    #[arg(long, default_value = "out/hlod")]
    out: PathBuf,
    /// A small surface, small pictures.
    #[arg(long)]
    quick: bool,
    /// Attributes are kept and count in the tolerance.
    #[arg(long)]
    looks: bool,
    /// Tolerances in pixels of the view.
    #[arg(long, value_delimiter = ',', default_values_t = [0.5, 2.0, 8.0])]
    px: Vec<f64>,
}

/// A simplified surface, and what is known of it.
struct Level {
    px: f64,
    tolerance: f64,
    mesh: TriangleMesh,
    claimed: f64,
    measured: f64,
    time: Duration,
    views: Views,
}

fn main() -> ExitCode {
    match run(&Options::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("hlod: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(options: &Options) -> Result<(), Box<dyn Error>> {
    std::fs::create_dir_all(&options.out)
        .map_err(|e| format!("cannot write to {}: {e}", options.out.display()))?;
    let mesh = match &options.path {
        Some(path) => surface::load(path)?,
        None => surface::generated(if options.quick { 24 } else { 80 }),
    };
    let side = if options.quick { 200 } else { 480 };
    let camera = surface::camera(&mesh, side)?;
    let distance = camera.distance_to_box(&mesh.world_bounds());
    let original = picture::views(&mesh, &camera, None)?;
    println!("{} triangles", mesh.triangles().len());
    println!(
        "{:>6} {:>10} {:>10} {:>10} {:>10} {:>10} {:>9} {:>9}",
        "px", "tolerance", "triangles", "claimed", "measured", "looks", "time ms", "RMSE/255"
    );
    let mut levels = Vec::new();
    for &px in &options.px {
        let tolerance = camera.world_error(px, distance);
        levels.push(level(&mesh, &camera, &original, px, tolerance, options.looks)?);
    }
    let path = options.out.join("comparison.png");
    let columns: Vec<&Views> = std::iter::once(&original).chain(levels.iter().map(|l| &l.views)).collect();
    picture::comparison(&columns)?.write_png(&path)?;
    println!("{}", path.display());
    let path = options.out.join("index.html");
    std::fs::write(&path, page::page(mesh.triangles().len(), &levels))?;
    println!("{}", path.display());
    Ok(())
}

fn level(
    mesh: &TriangleMesh,
    camera: &Camera,
    original: &Views,
    px: f64,
    tolerance: f64,
    looks: bool,
) -> Result<Level, Box<dyn Error>> {
    let start = Instant::now();
    let settings = SimplifyOptions::default().with_tier(Tier::Guaranteed).with_appearance(looks);
    let simple = simplify(mesh, tolerance, &settings)?;
    let time = start.elapsed();
    let measure = HausdorffOptions::new(0.02 * tolerance).with_max_splits(100_000);
    let measured = hausdorff(mesh, &simple.mesh, &measure).lower;
    let views = picture::views(&simple.mesh, camera, Some(original))?;
    println!(
        "{px:>6} {tolerance:>10.3e} {:>10} {:>10.3e} {measured:>10.3e} {:>10} {:>9.1} {:>9.2}",
        simple.mesh.triangles().len(),
        simple.geometric.value,
        simple.appearance.map_or("-".into(), |a| format!("{:.3e}", a.value)),
        time.as_secs_f64() * 1e3,
        views.rmse
    );
    Ok(Level { px, tolerance, claimed: simple.geometric.value, mesh: simple.mesh, measured, time, views })
}
