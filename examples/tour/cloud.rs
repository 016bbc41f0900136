//! Point clouds on the tour: built into an octree on disk once, then walked around at a pixel's accuracy.

#[path = "../points/draw.rs"]
mod draw;
#[path = "../points/input.rs"]
mod source;

use crate::page::Page;
use crate::walk::{Up, Walk};
use draw::{ByHeight, Painter, by_height};
use farsight_geometry::Camera;
use farsight_points::{BuildOptions, NodeData, Selection, Store, Traversal, ViewOptions};
use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Accuracy of the frames, and the largest splat, both in pixels.
const ERROR_PX: f64 = 1.0;
const MOST_PX: f32 = 12.0;

/// What a frame of points shows and took.
struct Frame {
    png: Vec<u8>,
    nodes: usize,
    points: u64,
    error_px: f64,
    choosing: Duration,
    time: Duration,
}

/// Whether a file holds points. Files that cannot be read do not: whoever loads them as a scene says why.
pub fn is_cloud(path: &Path) -> bool {
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    match extension.as_deref() {
        Some("las" | "laz") => true,
        // A PLY file may hold either, and only reading it tells.
        Some("ply") => farsight_geometry::io::load(path).is_ok_and(|l| l.into_points().is_some()),
        _ => false,
    }
}

/// Builds, walks, and writes the page into `folder`; prints a short table.
pub fn tour(
    paths: &[PathBuf],
    up: Up,
    size: [u32; 2],
    count: usize,
    folder: &Path,
) -> Result<(), Box<dyn Error>> {
    let file = folder.join("cloud.points");
    let start = Instant::now();
    let report = source::build_files(paths, &file, &BuildOptions::default(), false)?;
    let building = start.elapsed();
    let store = Store::open(&file)?;
    let octree = store.octree();
    if octree.is_empty() {
        return Err("the files hold no points".into());
    }
    let bounds = octree.world_bounds();
    let walk = Walk::Around { bounds, up, inside: None };
    let colours = by_height(&store)?;
    let (mut traversal, mut selection) = (Traversal::new(), Selection::default());
    let mut frames = Vec::with_capacity(count);
    for i in 0..count {
        let camera = walk.camera_at(Walk::time(i, count), size[0], size[1])?;
        frames.push(frame(&store, &camera, colours, &mut traversal, &mut selection)?);
        crate::write(&folder.join(format!("frame_{i:03}.png")), &frames[i].png)?;
    }
    println!(
        "{:>6} {:>8} {:>11} {:>8} {:>11} {:>9}",
        "frame", "nodes", "points", "px", "choosing ms", "frame ms"
    );
    for (i, f) in frames.iter().enumerate() {
        println!(
            "{i:>6} {:>8} {:>11} {:>8.2} {:>11.3} {:>9.1}",
            f.nodes,
            f.points,
            f.error_px,
            ms(f.choosing),
            ms(f.time)
        );
    }
    let size = bounds.extent();
    let summary = format!("{} points, {:.1} × {:.1} × {:.1}", report.points, size.x, size.y, size.z);
    let page = page(paths, &summary, building, &report, &frames)?;
    let index = folder.join("index.html");
    crate::write(&index, page)?;
    println!("{}", index.display());
    Ok(())
}

fn frame(
    store: &Store,
    camera: &Camera,
    colours: Option<ByHeight>,
    traversal: &mut Traversal,
    selection: &mut Selection,
) -> Result<Frame, Box<dyn Error>> {
    let start = Instant::now();
    traversal.select(store.octree(), camera, &ViewOptions::error(ERROR_PX), |_| true, selection);
    let choosing = start.elapsed();
    let mut painter = Painter::new(*camera, colours)?;
    let mut data = NodeData::default();
    for drawn in &selection.drawn {
        store.read(drawn.node, &mut data)?;
        painter.draw(store.octree().grid(), &data.points, drawn.splat, MOST_PX);
    }
    let time = start.elapsed();
    Ok(Frame {
        png: painter.image()?.to_png()?,
        nodes: selection.drawn.len(),
        points: selection.points,
        error_px: selection.error.map_or(0.0, |e| e.value),
        choosing,
        time,
    })
}

fn page(
    paths: &[PathBuf],
    summary: &str,
    building: Duration,
    report: &farsight_points::BuildReport,
    frames: &[Frame],
) -> Result<String, Box<dyn Error>> {
    let names: Vec<String> =
        paths.iter().map(|p| p.file_name().map_or(String::new(), |n| n.to_string_lossy().into())).collect();
    let mut page = Page::new(&format!("A tour of {}", names.join(", ")), summary);
    page.heading("The octree");
    page.table(&[
        ["points", "nodes", "levels", "built in", "bytes a point"].map(String::from).to_vec(),
        vec![
            report.points.to_string(),
            report.nodes.to_string(),
            report.levels.len().to_string(),
            format!("{:.2} s", building.as_secs_f64()),
            format!("{:.1}", report.payload_bytes as f64 / report.points.max(1) as f64),
        ],
    ]);
    page.paragraph("Built out of core, whatever the number of points; every position is kept bit for bit.");
    page.heading("Frames");
    let caption = |(i, f): (usize, &Frame)| {
        let text = format!(
            "Frame {i}: {} points of {} nodes; none farther than {:.2} px from a drawn one",
            f.points, f.nodes, f.error_px
        );
        (f.png.clone(), text)
    };
    page.pictures(&frames.iter().enumerate().map(caption).collect::<Vec<_>>());
    page.heading("What each frame took");
    let series = |value: fn(&Frame) -> f64| frames.iter().map(value).collect::<Vec<f64>>();
    page.plot(
        "Time per frame",
        "ms",
        &[("frame", series(|f| ms(f.time))), ("of it choosing nodes", series(|f| ms(f.choosing)))],
    )?;
    page.plot("Points drawn", "points", &[("points", series(|f| f.points as f64))])?;
    Ok(page.finish())
}

fn ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}
