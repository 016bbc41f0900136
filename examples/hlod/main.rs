//! A surface as a hierarchy on disk: built, opened, and drawn at several tolerances beside the original.
//!
//! ```text
//! cargo run --release --example hlod                    a generated surface
//! cargo run --release --example hlod -- bunny.obj       your own .obj, .gltf, .glb (y up)
//! cargo run --release --example hlod -- --looks x.glb   normals, texture coordinates and colours count too
//! ```
//!
//! You should see the levels of the hierarchy, then a line for each tolerance (nodes and triangles drawn, the error in pixels that is claimed, the one measured by
//! other code), and `out/hlod/comparison.png`: a column for each tolerance from the original on, shaded above, every node in a tint of its own in the
//! middle, and four times the difference to the original below. `out/hlod/index.html` shows all together, `out/hlod/surface.hlod` is the hierarchy.

mod page;
mod picture;
mod surface;

use clap::Parser;
use farsight_geometry::{Camera, TriangleMesh};
use farsight_hlod::{
    BuildOptions, BuildReport, HlodError, Mesh, NodeMesh, Selection, Selector, Store, Tier, ViewOptions,
    build, no_progress,
};
use picture::{Part, Views};
use std::error::Error;
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(Parser)]
#[command(about = "Builds a hierarchy of a surface and draws it at several tolerances")]
struct Options {
    /// A scene to load (.obj, .gltf, .glb); without, a surface is generated.
    path: Option<PathBuf>,
    /// Folder for the hierarchy and the pictures.
    #[arg(long, default_value = "out/hlod")]
    out: PathBuf,
    /// A small surface, small pictures.
    #[arg(long)]
    quick: bool,
    /// Attributes are kept and count in the tolerance. Takes ten times as long to build.
    #[arg(long)]
    looks: bool,
    /// Builds quickly, with more triangles for the same error.
    #[arg(long)]
    verified: bool,
    /// Tolerances in pixels of the view.
    #[arg(long, value_delimiter = ',', default_values_t = [0.5, 2.0, 8.0])]
    px: Vec<f64>,
}

/// The surface at a tolerance.
struct Level {
    px: f64,
    nodes: usize,
    triangles: u64,
    claimed: f64,
    measured: f64,
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
    // Without attributes everything is shaded by its triangles, the original too.
    let mesh = if options.looks { mesh } else { surface::bare(&mesh)? };
    let side = if options.quick { 200 } else { 480 };
    let camera = surface::camera(&mesh, side)?;
    let path = options.out.join("surface.hlod");
    let tier = if options.verified || options.quick { Tier::Verified } else { Tier::Guaranteed };
    let settings = BuildOptions::default()
        .with_tier(tier)
        .with_appearance(options.looks)
        .with_most_triangles(if options.quick { 1000 } else { 4000 });
    let report = build([Ok::<_, HlodError>(&mesh)], &path, &settings, &no_progress)?;
    print_levels(&report);
    println!("{}", path.display());

    let store = Store::open(&path)?;
    let original = picture::views(&[Part::whole(&mesh)], &camera, None)?;
    let mut selector = Selector::new();
    let mut levels = Vec::new();
    println!(
        "{:>6} {:>6} {:>10} {:>11} {:>11} {:>9}",
        "px", "nodes", "triangles", "claimed px", "measured px", "RMSE/255"
    );
    for &px in &options.px {
        levels.push(level(&store, &mut selector, &mesh, &camera, &original, px)?);
    }
    let path = options.out.join("comparison.png");
    let columns: Vec<&Views> = std::iter::once(&original).chain(levels.iter().map(|l| &l.views)).collect();
    picture::comparison(&columns)?.write_png(&path)?;
    println!("{}", path.display());
    let path = options.out.join("index.html");
    std::fs::write(&path, page::page(&report, &levels))?;
    println!("{}", path.display());
    Ok(())
}

fn print_levels(report: &BuildReport) {
    println!(
        "{} triangles in {:.2} s, {} bytes on disk ({:.2} a triangle)",
        report.triangles,
        report.cost.time.as_secs_f64(),
        report.bytes,
        report.bytes as f64 / report.triangles.max(1) as f64
    );
    println!("{:>6} {:>6} {:>7} {:>10} {:>10}", "level", "nodes", "leaves", "triangles", "error");
    for (i, l) in report.levels.iter().enumerate() {
        println!("{i:>6} {:>6} {:>7} {:>10} {:>10.3e}", l.nodes, l.leaves, l.triangles, l.error);
    }
}

fn level(
    store: &Store,
    selector: &mut Selector,
    mesh: &TriangleMesh,
    camera: &Camera,
    original: &Views,
    px: f64,
) -> Result<Level, Box<dyn Error>> {
    let mut selection = Selection::default();
    selector.select(store.tree(), camera, &ViewOptions::error(px), |_| true, &mut selection);
    let mut parts = Vec::new();
    for drawn in &selection.drawn {
        let mut node = NodeMesh::default();
        store.read(drawn.node, Mesh::Full, &mut node)?;
        parts.push(Part { mesh: node.to_mesh()?, rims: node.rims.clone() });
    }
    let claimed = selection.geometric.map_or(0.0, |e| e.value);
    let measured = surface::measured_px(mesh, &parts, camera)?;
    let views = picture::views(&parts, camera, Some(original))?;
    let (nodes, triangles) = (parts.len(), selection.triangles);
    println!("{px:>6} {nodes:>6} {triangles:>10} {claimed:>11.3} {measured:>11.3} {:>9.2}", views.rmse);
    Ok(Level { px, nodes, triangles, claimed, measured, views })
}
