//! The tour: takes a scene through everything that Farsight does and writes a page about it.
//!
//! ```text
//! cargo run --release --example tour                   a generated town
//! cargo run --release --example tour -- house.glb      your own .obj, .gltf, .glb
//! cargo run --release --example tour -- scan.laz       or point clouds: .las, .laz, .ply
//! ```
//!
//! You should see progress bars, a short table, and then `out/tour/index.html`: a summary of the scene, the frames of a camera path, what each was
//! planned to leave out and what it took, and a moment at full rate, in which what one frame knows serves the next. The frames also lie there
//! as PNG, the last one's depth as EXR.

mod built;
mod casters;
mod cells;
mod cloud;
mod compare;
mod cull;
mod effects;
mod forms;
mod frames;
mod input;
mod inside;
mod movers;
mod nodes;
mod page;
mod penumbra;
mod pictures;
mod planning;
mod report;
mod shaping;
mod sun;
mod surfaces;
mod walk;

use built::Built;
use clap::Parser;
use compare::Comparison;
use farsight_geometry::glam::Vec3;
use farsight_geometry::io::exr::FloatImage;
use farsight_plan::{Budget, Tolerances};
use farsight_raster::{Image, RenderOptions, Target};
use farsight_timing::Millis;
use frames::{FrameReport, Pace, Renderer, Shadows};
use indicatif::{ProgressBar, ProgressStyle};
use input::Input;
use movers::Movers;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use walk::{Up, Walk};

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
    /// How far a surface may appear from where it is, in pixels.
    #[arg(long, default_value_t = 0.5, value_parser = positive)]
    tolerance: f64,
    /// Processor time in milliseconds that a frame may take; without, as long as the tolerances ask for.
    #[arg(long, value_parser = positive)]
    limit: Option<f64>,
    /// Half of the angle that the sun spans, in degrees; 0 for hard shadows.
    #[arg(long, default_value_t = 0.27, value_parser = acute)]
    sun_radius: f64,
    /// Aeroplanes that circle over the scene; without, a dozen over the town and none over loaded scenes.
    #[arg(long)]
    movers: Option<u32>,
    /// Runs everything, wanted or not: all objects in view in full, the largest shadow map.
    #[arg(long)]
    no_plan: bool,
    /// The axis of loaded files that points away from the ground; without, y for scenes and z for point clouds.
    #[arg(long, value_enum)]
    up: Option<Up>,
}

impl Options {
    /// Number of frames.
    fn count(&self) -> usize {
        self.frames.unwrap_or(if self.quick { 3 } else { 12 }).max(1)
    }

    /// Frames of the moment at full rate.
    fn moment(&self) -> usize {
        if self.quick { 4 } else { 12 }
    }

    /// Width and height of a frame.
    fn size(&self) -> [u32; 2] {
        let width = self.width.unwrap_or(if self.quick { 480 } else { 1280 }).max(16);
        [width, (width * 9 / 16).max(1)]
    }
}

/// A number above zero.
fn positive(text: &str) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| format!("{text} is no number"))?;
    if number.is_finite() && number > 0.0 { Ok(number) } else { Err(format!("{text} is not above zero")) }
}

/// An angle in degrees that a sun may have.
fn acute(text: &str) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| format!("{text} is no number"))?;
    if (0.0..=20.0).contains(&number) { Ok(number) } else { Err(format!("{text} is not within 0 and 20")) }
}

/// Seconds that the walk lasts, and when the moment at full rate begins, as a share of it.
const WALK: f64 = 60.0;
const MOMENT: f64 = 0.8;

/// A frame as the page shows it.
struct Shown {
    png: Vec<u8>,
    report: FrameReport,
    /// What it would have been without a plan, for some of the frames.
    comparison: Option<Comparison>,
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
    let mut input = if options.paths.is_empty() {
        input::generate(options.quick)?
    } else {
        input::load(&options.paths, options.up.unwrap_or(Up::Y))?
    };
    spinner.finish_with_message(format!("{}: {} triangles", input.title, input.scene.placed_triangles()));
    let defects = input::defects(&input.scene).to_string();
    for warning in &input.warnings {
        eprintln!("warning: {warning}");
    }

    let mut built = if options.no_plan {
        Built::nothing(&input)?
    } else {
        let spinner = self::spinner("building");
        let built = Built::build(&input, options.count(), folder, |what| spinner.set_message(what))?;
        spinner.finish_and_clear();
        built
    };
    let aeroplanes = options.movers.unwrap_or(if options.paths.is_empty() { 12 } else { 0 });
    let movers = match aeroplanes {
        0 => None,
        _ => Some(Movers::over(&mut input.scene, &mut built.forms, input.up, aeroplanes)?),
    };
    let told = report::Told::of(&input, defects);
    let walked = walk_through(options, &mut input, &built, movers)?;

    let frames = &walked.frames;
    let page = report::page(&told, &built.steps, &walked)?;
    let index = folder.join("index.html");
    write(&index, page)?;
    for row in report::frame_table(frames) {
        println!("{}", row.iter().map(|cell| format!("{cell:>11}")).collect::<String>());
    }
    println!("{}", index.display());
    Ok(())
}

/// Frames along the walk, and a moment of it at full rate.
struct Walked {
    frames: Vec<Shown>,
    moment: Vec<FrameReport>,
    /// The last frame of the moment.
    last: Option<Shown>,
    /// What became of the pictures, in words.
    pictures: String,
}

/// Draws all frames and writes them as they come.
fn walk_through(
    options: &Options,
    input: &mut Input,
    built: &Built,
    movers: Option<Movers>,
) -> Result<Walked, Box<dyn Error>> {
    let (count, [width, height]) = (options.count(), options.size());
    let map_side = if options.quick { 1024 } else { 4096 };
    let shadows = Shadows { map_side, sun_radius: options.sun_radius.to_radians() };
    let mut look = RenderOptions::default();
    look.up = input.up.axis();
    if !options.paths.is_empty() {
        // Loaded scenes have rooms without lamps and sides that no sun reaches.
        look.ambient = [Vec3::new(0.16, 0.19, 0.25), Vec3::new(0.11, 0.10, 0.08)];
        look.headlight = 0.22;
    }
    look.supersampling = if options.quick { 1 } else { 2 };
    let tolerances = Tolerances::default().with_position_px(options.tolerance);
    let budget = options
        .limit
        .map_or(Budget::unlimited(tolerances), |limit| Budget::within(Millis(limit), tolerances));
    let Input { scene, walk, .. } = input;
    let mut renderer = Renderer::new(scene, built, movers, [width, height], look, shadows, budget)?;
    let bar = ProgressBar::new(count as u64)
        .with_style(ProgressStyle::with_template("{msg:>10} [{bar:40}] {pos}/{len}")?);
    bar.set_message("frames");
    let mut frames = Vec::with_capacity(count);
    for i in 0..count {
        let time = Walk::time(i, count);
        let camera = walk.camera_at(time, width, height)?;
        renderer.fly(time * WALK)?;
        let (target, report) = if options.no_plan {
            renderer.everything(&camera)?
        } else {
            renderer.planned(&camera, Pace::Walk)?
        };
        // The first frame, one on the way and the last are drawn in full as well.
        let compared = !options.no_plan && [0, count / 2, count - 1].contains(&i);
        let comparison = compared.then(|| renderer.compared(&camera, &target)).transpose()?;
        let png = Image::from_colour(&target).to_png()?;
        write(&options.out.join(format!("frame_{i:03}.png")), &png)?;
        if i + 1 == count {
            write_depth(&options.out.join("depth.exr"), &target, camera.near())?;
        }
        frames.push(Shown { png, report, comparison });
        bar.inc(1);
    }
    bar.finish();
    let (moment, last) =
        if options.no_plan { (Vec::new(), None) } else { moment(options, walk, &mut renderer)? };
    Ok(Walked { frames, moment, last, pictures: renderer.pictures_text() })
}

/// Frames a sixtieth of a second apart, as a user sees them: what was known in one serves in the next. The last one is compared.
fn moment(
    options: &Options,
    walk: &Walk,
    renderer: &mut Renderer,
) -> Result<(Vec<FrameReport>, Option<Shown>), Box<dyn Error>> {
    let (count, [width, height]) = (options.moment(), options.size());
    let (mut reports, mut last) = (Vec::new(), None);
    for i in 0..count {
        let time = MOMENT + i as f64 / (60.0 * WALK);
        let camera = walk.camera_at(time, width, height)?;
        renderer.fly(time * WALK)?;
        let (target, report) = renderer.planned(&camera, if i == 0 { Pace::Jump } else { Pace::Flow })?;
        if i + 1 == count {
            let png = Image::from_colour(&target).to_png()?;
            write(&options.out.join("moment.png"), &png)?;
            last = Some(Shown { png, report, comparison: Some(renderer.compared(&camera, &target)?) });
        } else {
            reports.push(report);
        }
    }
    Ok((reports, last))
}

/// Writes the distance ahead of the eye, in world units; infinite where nothing is.
fn write_depth(path: &Path, target: &Target, near: f64) -> Result<(), Box<dyn Error>> {
    // With reversed depth and an infinite far plane, depth is near / distance.
    let distance = |depth: &f32| near as f32 / depth;
    let samples = target.depth_rows().flatten().map(distance).collect();
    let image = FloatImage::depth(target.width() as usize, target.height() as usize, samples)?;
    Ok(write(path, image.to_bytes()?)?)
}

/// Writes a file, or tells which one could not be written.
fn write(path: &Path, bytes: impl AsRef<[u8]>) -> Result<(), String> {
    std::fs::write(path, bytes).map_err(|e| format!("cannot write {}: {e}", path.display()))
}

fn spinner(message: &'static str) -> ProgressBar {
    let spinner = ProgressBar::new_spinner().with_message(message);
    spinner.enable_steady_tick(std::time::Duration::from_millis(100));
    spinner
}
