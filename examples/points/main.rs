//! Point clouds of any size: built once, drawn while they load.
//!
//! ```text
//! cargo run --release --example points                                    a generated scan of a street
//! cargo run --release --example points -- build scan.laz more.laz out.points
//! cargo run --release --example points -- render out.points               an overview, at three accuracies
//! ```
//!
//! Without arguments you should see how long building took, then a table of accuracies with the points drawn and the pixels lost
//! against drawing all points, then pictures in `out/points`: `street-*.png` at 4, 1 and 0.25 pixels, `loading-*.png` frames while
//! nodes arrive (coarse, but without holes), and what occlusion culling over the same octree saves.

mod culling;
mod draw;
mod input;
mod judge;
mod street;

use clap::{Parser, Subcommand};
use draw::{Painter, by_height};
use farsight_geometry::Camera;
use farsight_geometry::glam::DVec3;
use farsight_points::{
    BuildOptions, BuildReport, GpuBuffers, NodeData, NodeId, Selection, Store, Stream, StreamOptions,
    Traversal, ViewOptions,
};
use judge::{lost_pixels, overview};
use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

#[derive(Parser)]
#[command(about = "Builds and draws point clouds of any size")]
struct Arguments {
    #[command(subcommand)]
    command: Option<Task>,
    /// Folder for pictures.
    #[arg(long, default_value = "out/points", global = true)]
    out: PathBuf,
    /// Few points, small pictures.
    #[arg(long, global = true)]
    quick: bool,
}

#[derive(Subcommand)]
enum Task {
    /// Builds one file from .las, .laz and .ply files; the last path is the result.
    Build {
        /// Inputs, then the file to write.
        #[arg(required = true, num_args = 2..)]
        paths: Vec<PathBuf>,
        /// Most memory in MiB.
        #[arg(long, default_value_t = 512)]
        memory: u64,
        /// Threads; 0 for all processors.
        #[arg(long, default_value_t = 0)]
        threads: usize,
        /// Keep all attributes of LAS points.
        #[arg(long)]
        attributes: bool,
    },
    /// Draws an overview of a built file.
    Render {
        /// The file.
        file: PathBuf,
        /// Accuracies in pixels.
        #[arg(long, value_delimiter = ',', default_value = "4,1,0.25")]
        pixels: Vec<f64>,
        /// Most points a frame.
        #[arg(long)]
        budget: Option<u64>,
    },
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("points: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), Box<dyn Error>> {
    let size = if arguments.quick { [320, 180] } else { [1280, 720] };
    match &arguments.command {
        None => street(arguments, size),
        Some(Task::Build { paths, memory, threads, attributes }) => {
            let (out, inputs) = paths.split_last().expect("two at least");
            let mut options = BuildOptions::default();
            (options.memory, options.threads) = (memory << 20, *threads);
            print(&input::build_files(inputs, out, &options, *attributes)?);
            Ok(())
        }
        Some(Task::Render { file, pixels, budget }) => {
            std::fs::create_dir_all(&arguments.out)?;
            let store = Store::open(file)?;
            let camera = overview(&store.octree().world_bounds(), size)?;
            let name = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            table(&store, &camera, pixels, budget.unwrap_or(u64::MAX), &arguments.out, &name)
        }
    }
}

fn print(report: &BuildReport) {
    let seconds = report.cost.time.as_secs_f64();
    println!(
        "{} points in {seconds:.2} s ({:.1} M/s): {} nodes, {} levels, {:.1} bytes a point and {:.3} % for structure",
        report.points,
        report.points as f64 / seconds * 1e-6,
        report.nodes,
        report.levels.len(),
        report.payload_bytes as f64 / report.points.max(1) as f64,
        100.0 * report.structure_bytes as f64 / report.payload_bytes.max(1) as f64
    );
}

/// The run without arguments.
fn street(arguments: &Arguments, size: [u32; 2]) -> Result<(), Box<dyn Error>> {
    std::fs::create_dir_all(&arguments.out)?;
    let count = if arguments.quick { 200_000 } else { 3_000_000 };
    let file = arguments.out.join("street.points");
    print(&street::build_street(count, &file, &BuildOptions::default())?);
    let store = Store::open(&file)?;
    let origin = store.octree().grid().offset;
    let camera =
        Camera::look_at(origin + DVec3::new(22.0, -1.0, 2.6), origin + DVec3::new(60.0, 1.5, 3.6), DVec3::Z)?
            .with_image(size[0], size[1])?;
    table(&store, &camera, &[4.0, 1.0, 0.25], u64::MAX, &arguments.out, "street")?;
    // From outside, where the fronts of one side hide the street behind.
    let outside = Camera::look_at(
        origin + DVec3::new(90.0, -26.0, 4.0),
        origin + DVec3::new(100.0, 0.0, 5.0),
        DVec3::Z,
    )?
    .with_image(size[0], size[1])?;
    culled(&store, &outside, &arguments.out)?;
    loading(store, &camera, &arguments.out)
}

/// Largest splat in pixels: near the eye a cloud shows its gaps rather than blobs.
const MOST_PX: f32 = 12.0;

fn paint(store: &Store, camera: &Camera, selection: &Selection) -> Result<Painter, Box<dyn Error>> {
    let mut painter = Painter::new(*camera, by_height(store)?)?;
    let mut data = NodeData::default();
    for drawn in &selection.drawn {
        store.read(drawn.node, &mut data)?;
        painter.draw(store.octree().grid(), &data.points, drawn.splat, MOST_PX);
    }
    Ok(painter)
}

/// Accuracies side by side: a line and a picture each.
fn table(
    store: &Store,
    camera: &Camera,
    pixels: &[f64],
    budget: u64,
    out: &Path,
    name: &str,
) -> Result<(), Box<dyn Error>> {
    let octree = store.octree();
    let mut all = Painter::new(*camera, None)?;
    let mut data = NodeData::default();
    for node in octree.ids() {
        store.read(node, &mut data)?;
        all.draw(octree.grid(), &data.points, 0.0, 1.0);
    }
    println!(
        "{:>6} {:>9} {:>7} {:>11} {:>7} {:>10} {:>8}",
        "px", "proven", "nodes", "points", "share", "select ms", "lost"
    );
    let (mut traversal, mut selection) = (Traversal::new(), Selection::default());
    for &px in pixels {
        let options = ViewOptions::error(px).with_budget(budget);
        traversal.select(octree, camera, &options, |_| true, &mut selection);
        let start = Instant::now();
        traversal.select(octree, camera, &options, |_| true, &mut selection);
        let time = start.elapsed();
        let mut plain = Painter::new(*camera, None)?;
        for drawn in &selection.drawn {
            store.read(drawn.node, &mut data)?;
            plain.draw(octree.grid(), &data.points, 0.0, 1.0);
        }
        let (lost, covered) = lost_pixels(&all.target, &plain.target);
        println!(
            "{px:>6} {:>9.3} {:>7} {:>11} {:>6.1}% {:>10.4} {:>7.4}%",
            selection.error.map_or(0.0, |e| e.value),
            selection.drawn.len(),
            selection.points,
            100.0 * selection.points as f64 / octree.points().max(1) as f64,
            time.as_secs_f64() * 1e3,
            100.0 * lost as f64 / covered.max(1) as f64
        );
        let path = out.join(format!("{name}-{px}px.png"));
        paint(store, camera, &selection)?.image()?.write_png(&path)?;
    }
    println!("{}", out.join(format!("{name}-*px.png")).display());
    Ok(())
}

/// The same view with and without occlusion culling over the octree.
fn culled(store: &Store, camera: &Camera, out: &Path) -> Result<(), Box<dyn Error>> {
    let mut selection = Selection::default();
    Traversal::new().select(store.octree(), camera, &ViewOptions::error(1.0), |_| true, &mut selection);
    let reference = paint(store, camera, &selection)?;
    let mut painter = Painter::new(*camera, by_height(store)?)?;
    let saved = culling::draw(&mut painter, store, &selection, camera, MOST_PX)?;
    // Depths, since of two points at the same depth the first one drawn gives the colour.
    let depths = painter.target.depth_rows().flatten().zip(reference.target.depth_rows().flatten());
    let different = depths.filter(|(a, b)| a != b).count();
    println!(
        "occlusion culling over the octree: {} of {} nodes and {} of {} points hidden, {} queries, {different} depths differ",
        saved.nodes,
        selection.drawn.len(),
        saved.points,
        selection.points,
        saved.queries
    );
    painter.image()?.write_png(out.join("culled.png"))?;
    Ok(())
}

/// A "card" whose buffers lie in main memory.
struct Card;

impl GpuBuffers for Card {
    type Buffer = NodeData;
    fn upload(&mut self, _: NodeId, data: &NodeData) -> NodeData {
        data.clone()
    }
    fn release(&mut self, _: NodeData) {}
}

/// Frames while nodes arrive.
fn loading(store: Store, camera: &Camera, out: &Path) -> Result<(), Box<dyn Error>> {
    let grid = *store.octree().grid();
    let heights = by_height(&store)?;
    let start = Instant::now();
    let mut options = StreamOptions::default();
    options.upload_bytes = 4 << 20;
    let mut stream = Stream::new(store, Card, options)?;
    let mut shown = Vec::new();
    for number in 0.. {
        let frame = stream.frame(camera, &ViewOptions::error(1.0));
        let error = frame.selection.error.map_or(0.0, |e| e.value);
        let missing = frame.selection.missing.len();
        // The first, one on the way, the last.
        if number == 0 || missing == 0 || (shown.len() == 1 && error < 12.0) {
            let mut painter = Painter::new(*camera, heights)?;
            for (data, drawn) in frame.draws() {
                painter.draw(&grid, &data.points, drawn.splat, 1024.0);
            }
            let path = out.join(format!("loading-{}.png", shown.len()));
            painter.image()?.write_png(&path)?;
            println!(
                "frame {number} after {:.1} ms: {} points, {missing} nodes missing, within {error:.2} px: {}",
                start.elapsed().as_secs_f64() * 1e3,
                frame.selection.points,
                path.display()
            );
            shown.push(path);
        }
        if missing == 0 {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    Ok(())
}
