//! The tour: takes a scene through everything that Farsight does and writes a page about it.
//!
//! ```text
//! cargo run --release --example tour                   a generated town
//! cargo run --release --example tour -- house.glb      your own .obj, .gltf, .glb
//! cargo run --release --example tour -- scan.laz       or point clouds: .las, .laz, .ply
//! ```
//!
//! You should see progress bars, a short table, and then `out/tour/index.html` with the frames of a camera path, a summary
//! of the scene and plots of what each frame took. The frames also lie there as PNG, the last one's depth as EXR.

mod cloud;
mod cull;
mod frames;
mod input;
mod inside;
mod page;
mod predict;
mod walk;

use clap::Parser;
use farsight_geometry::glam::Vec3;
use farsight_geometry::io::exr::FloatImage;
use farsight_raster::{Image, RenderOptions, Target};
use frames::{FrameReport, Renderer};
use indicatif::{ProgressBar, ProgressStyle};
use input::Input;
use page::Page;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use walk::Up;

#[derive(Parser)]
#[command(about = "Takes a scene through everything that Farsight does and writes a page about it")]
struct Options {
    /// Scenes (.obj, .gltf, .glb) or point clouds (.las, .laz, .ply) to load; without any, a town is generated.
    paths: Vec<PathBuf>,
    /// Folder for the page and the frames.
    #[arg(long, default_value = "out/tour")]
    out: PathBuf,
    /// A small town and few frames.
    #[arg(long)]
    quick: bool,
    /// Number of frames.
    #[arg(long)]
    frames: Option<usize>,
    /// Width of a frame in pixels; the height is 9/16 of it.
    #[arg(long)]
    width: Option<u32>,
    /// The axis of loaded files that points away from the ground; without, y for scenes and z for point clouds.
    #[arg(long, value_enum)]
    up: Option<Up>,
}

impl Options {
    /// Number of frames.
    fn count(&self) -> usize {
        self.frames.unwrap_or(if self.quick { 3 } else { 12 }).max(1)
    }

    /// Width and height of a frame.
    fn size(&self) -> [u32; 2] {
        let width = self.width.unwrap_or(if self.quick { 480 } else { 1280 }).max(16);
        [width, (width * 9 / 16).max(1)]
    }
}

/// A frame as the page shows it.
struct Shown {
    png: Vec<u8>,
    report: FrameReport,
}

fn main() -> ExitCode {
    match run(&Options::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("tour: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(options: &Options) -> Result<(), Box<dyn Error>> {
    let folder = &options.out;
    std::fs::create_dir_all(folder).map_err(|e| format!("cannot write to {}: {e}", folder.display()))?;
    if !options.paths.is_empty() && options.paths.iter().all(|p| cloud::is_cloud(p)) {
        let up = options.up.unwrap_or(Up::Z);
        return cloud::tour(&options.paths, up, options.size(), options.count(), folder);
    }
    let spinner = spinner("loading");
    let input = if options.paths.is_empty() {
        input::generate(options.quick)?
    } else {
        input::load(&options.paths, options.up.unwrap_or(Up::Y))?
    };
    spinner.finish_with_message(format!("{}: {} triangles", input.title, input.scene.placed_triangles()));
    let report = input::report(&input.scene);
    for warning in &input.warnings {
        eprintln!("warning: {warning}");
    }

    let frames = walk_through(options, &input)?;

    let page = write_page(&input, &report.to_string(), &frames)?;
    let index = folder.join("index.html");
    std::fs::write(&index, page).map_err(|e| format!("cannot write {}: {e}", index.display()))?;
    for row in frame_table(&frames) {
        println!("{}", row.iter().map(|cell| format!("{cell:>11}")).collect::<String>());
    }
    println!("{}", index.display());
    Ok(())
}

/// Draws all frames and writes them as they come.
fn walk_through(options: &Options, input: &Input) -> Result<Vec<Shown>, Box<dyn Error>> {
    let (count, [width, height]) = (options.count(), options.size());
    let map_side = if options.quick { 1024 } else { 4096 };
    let mut look = RenderOptions::default();
    look.up = input.up.axis();
    if !options.paths.is_empty() {
        // Loaded scenes have rooms without lamps and sides that no sun reaches.
        look.ambient = [Vec3::new(0.16, 0.19, 0.25), Vec3::new(0.11, 0.10, 0.08)];
        look.headlight = 0.22;
    }
    look.supersampling = if options.quick { 1 } else { 2 };
    let bounds = input.scene.instance_bounds();
    let mut renderer = Renderer::new(&input.scene, &bounds, [width, height], look, map_side)?;
    let bar = ProgressBar::new(count as u64)
        .with_style(ProgressStyle::with_template("{msg:>10} [{bar:40}] {pos}/{len}")?);
    bar.set_message("frames");
    let mut frames = Vec::with_capacity(count);
    for i in 0..count {
        let camera = input.walk.camera(i, count, width, height)?;
        let (target, report) = renderer.frame(&camera)?;
        let png = Image::from_colour(&target).to_png()?;
        let path = options.out.join(format!("frame_{i:03}.png"));
        std::fs::write(&path, &png).map_err(|e| format!("cannot write {}: {e}", path.display()))?;
        if i + 1 == count {
            write_depth(&options.out.join("depth.exr"), &target, camera.near())?;
        }
        frames.push(Shown { png, report });
        bar.inc(1);
    }
    bar.finish();
    Ok(frames)
}

/// Writes the distance ahead of the eye, in world units; infinite where nothing is.
fn write_depth(path: &Path, target: &Target, near: f64) -> Result<(), Box<dyn Error>> {
    // With reversed depth and an infinite far plane, depth is near / distance.
    let distance = |depth: &f32| near as f32 / depth;
    let samples = target.depth_rows().flatten().map(distance).collect();
    let image = FloatImage::depth(target.width() as usize, target.height() as usize, samples)?;
    std::fs::write(path, image.to_bytes()?).map_err(|e| format!("cannot write {}: {e}", path.display()))?;
    Ok(())
}

fn spinner(message: &'static str) -> ProgressBar {
    let spinner = ProgressBar::new_spinner().with_message(message);
    spinner.enable_steady_tick(std::time::Duration::from_millis(100));
    spinner
}

fn write_page(input: &Input, report: &str, frames: &[Shown]) -> Result<String, Box<dyn Error>> {
    let scene = &input.scene;
    let mut page = Page::new(&format!("A tour of {}", input.title), report);
    page.heading("The scene");
    let size = scene.bounds().extent();
    page.table(&[
        ["triangles placed", "triangles stored", "instances", "lights", "size", "memory"]
            .map(String::from)
            .to_vec(),
        vec![
            scene.placed_triangles().to_string(),
            scene.stored_triangles().to_string(),
            scene.instances().len().to_string(),
            scene.lights().len().to_string(),
            [size.x, size.y, size.z].map(short).join(" × "),
            format!("{:.1} MB", scene.bytes() as f64 * 1e-6),
        ],
    ]);
    input.warnings.iter().for_each(|w| page.paragraph(w));
    page.heading("Frames");
    let captions = frames.iter().enumerate().map(|(i, shown)| (shown.png.clone(), caption(i, &shown.report)));
    page.pictures(&captions.collect::<Vec<_>>());
    page.heading("What each frame took");
    page.table(&frame_table(frames));
    let series =
        |value: fn(&FrameReport) -> f64| frames.iter().map(|f| value(&f.report)).collect::<Vec<f64>>();
    let shadow_ms = |f: &FrameReport| match &f.shadow {
        Some(Ok(s)) => s.time.as_secs_f64() * 1e3,
        _ => 0.0,
    };
    page.plot(
        "Time per frame",
        "ms",
        &[("frame", series(|f| f.time.as_secs_f64() * 1e3)), ("of it the shadow map", series(shadow_ms))],
    )?;
    page.paragraph(
        "What drawing took, and what was foretold before each frame; the model learns from every frame.",
    );
    page.plot(
        "Drawing, foretold and measured",
        "processor ms",
        &[("foretold", series(|f| f.predicted.0)), ("measured", series(|f| f.drawing.0))],
    )?;
    page.paragraph("Objects that the view volume holds, and those that nothing hides: only they are drawn.");
    page.plot(
        "Objects",
        "objects",
        &[("in view", series(|f| f.in_view as f64)), ("not hidden", series(|f| f.visible as f64))],
    )?;
    let texel = |warped: bool| {
        let value = |f: &FrameReport| match &f.shadow {
            Some(Ok(s)) if warped => s.view.texel.value,
            Some(Ok(s)) => s.view.texel_uniform.value,
            _ => 0.0,
        };
        frames.iter().map(|f| value(&f.report)).collect::<Vec<f64>>()
    };
    page.paragraph(
        "How coarse the shadow map is where it is coarsest: pixels on the screen that one texel covers.",
    );
    page.plot("Worst shadow texel", "px", &[("as drawn", texel(true)), ("without a warp", texel(false))])?;
    Ok(page.finish())
}

/// A length with four digits that mean something.
fn short(x: f64) -> String {
    let decimals = (3.0 - x.abs().max(1e-9).log10().floor()).clamp(0.0, 12.0) as usize;
    format!("{x:.decimals$}")
}

fn caption(i: usize, frame: &FrameReport) -> String {
    let shadow = match &frame.shadow {
        None => "no sun".into(),
        Some(Err(skip)) => format!("no shadow map needed: {skip:?}"),
        Some(Ok(s)) => {
            format!("shadow texel at most {:.1} px, warp gains {:.1}×", s.view.texel.value, s.view.gain())
        }
    };
    format!("Frame {i}: {} objects in view, {} of them not hidden; {shadow}", frame.in_view, frame.visible)
}

/// Frame by frame, the head first.
fn frame_table(frames: &[Shown]) -> Vec<Vec<String>> {
    let head = [
        "frame",
        "in view",
        "drawn",
        "triangles",
        "cull ms",
        "casters",
        "texel px",
        "gain",
        "drawing ms",
        "foretold",
        "frame ms",
    ];
    let mut rows = vec![head.map(String::from).to_vec()];
    for (i, Shown { report: f, .. }) in frames.iter().enumerate() {
        let (casters, texel, gain) = match &f.shadow {
            Some(Ok(s)) => (
                s.casters_drawn.to_string(),
                format!("{:.2}", s.view.texel.value),
                format!("{:.2}", s.view.gain()),
            ),
            _ => ("-".into(), "-".into(), "-".into()),
        };
        rows.push(vec![
            i.to_string(),
            f.in_view.to_string(),
            f.visible.to_string(),
            f.counters.triangles.to_string(),
            format!("{:.1}", f.culling.as_secs_f64() * 1e3),
            casters,
            texel,
            gain,
            format!("{:.0}", f.drawing.0),
            format!("{:.0}", f.predicted.0),
            format!("{:.0}", f.time.as_secs_f64() * 1e3),
        ]);
    }
    rows
}
