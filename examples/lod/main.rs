//! An avenue of aeroplanes and statues, each drawn as triangles of its own level of detail or as a picture made from them, whichever is cheaper.
//!
//! ```text
//! cargo run --release --example lod                           generated models
//! cargo run --release --example lod -- bunny.obj statue.glb   your own among them (y up)
//! cargo run --release --example lod -- --quick                small pictures, few frames
//! ```
//!
//! You should see a table (what the frames of a walk take, whole, as triangles, with pictures), and in `out/lod` some frames with the drawn triangles in a
//! corner: near objects are triangles, farther ones pictures (orange outlines) while their triangles cost more than a picture does.
//! `index.html` tells of each object what it was shown as, and why.

mod engine;
mod models;
mod page;
mod picture;
mod walk;

use clap::Parser;
use engine::{Object, Renderer};
use farsight_geometry::TriangleMesh;
use farsight_geometry::bvh::Bvh;
use farsight_geometry::glam::{DAffine3, DQuat, DVec3};
use farsight_lod::{ApproximationOptions, Approximations, DecisionOptions, Placement, VertexHierarchy};
use farsight_raster::scenes::{aeroplane, statue};
use models::Model;
use std::error::Error;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;
use walk::Walk;

#[derive(Parser)]
#[command(about = "Walks along an avenue of objects in levels of detail and pictures")]
struct Arguments {
    /// Meshes to stand along the avenue besides the generated ones (.obj, .gltf, .glb, .ply).
    paths: Vec<PathBuf>,
    /// Small pictures, few frames.
    #[arg(long)]
    quick: bool,
    /// Folder for the pictures.
    #[arg(long, default_value = "out/lod")]
    out: PathBuf,
    /// Displacement and parallax, in pixels of an image with four samples to a pixel.
    #[arg(long, default_value_t = 4.0)]
    px: f64,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("lod: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), Box<dyn Error>> {
    std::fs::create_dir_all(&arguments.out)
        .map_err(|e| format!("cannot write to {}: {e}", arguments.out.display()))?;
    let detail = if arguments.quick { 12 } else { 30 };
    let model = |name: &str, mesh| Model { name: name.into(), mesh };
    let mut models = vec![model("aeroplane", aeroplane(detail)?), model("statue", statue(detail)?)];
    for path in &arguments.paths {
        models.push(models::load(path)?);
    }
    let meshes: Vec<TriangleMesh> = models.iter().map(|m| m.mesh.clone()).collect();
    let hierarchies: Vec<VertexHierarchy> =
        meshes.iter().map(VertexHierarchy::build).collect::<Result<_, _>>()?;
    let objects = avenue(&models, if arguments.quick { 6 } else { 12 })?;
    let bvh = Bvh::build(&objects.iter().map(|o| o.bounds).collect::<Vec<_>>())?;
    let (frames, size) = if arguments.quick { (12, [640, 360]) } else { (90, [1920, 1080]) };
    let sun = DVec3::new(0.5, 0.65, -0.7).normalize();
    let mut renderer = Renderer::new(&meshes, &objects, &bvh, sun);
    renderer.calibrate()?;
    println!(
        "{} objects; a triangle takes {} ns, a pixel of it {} ns, a pixel of a picture {} ns",
        objects.len(),
        renderer.rates.triangle.as_nanos(),
        renderer.rates.pixel.as_nanos(),
        renderer.rates.texel.as_nanos()
    );

    let mut options = ApproximationOptions::default();
    options.tolerance_px = arguments.px;
    options.parallax = farsight_lod::ParallaxTest::Pixels(arguments.px);
    options.impostor.depth = true;
    let mut only_triangles = options;
    only_triangles.decision = DecisionOptions::default();
    only_triangles.decision.max_ratio = 0.0;

    let shown = [0, frames / 2, frames - 1];
    println!("{:<24} {:>10} {:>10} {:>8} {:>10}", "per frame", "CPU ms", "triangles", "pictures", "made");
    let mut summary = Vec::new();
    let mut walked = Vec::new();
    for (name, options) in [("triangles", only_triangles), ("triangles and pictures", options)] {
        let mut approximations = Approximations::new(64 << 20, options)?;
        let mut walk = Walk::new(&meshes, &hierarchies, &objects);
        let mut all = Vec::new();
        for frame in 0..frames {
            let camera = walk::camera(frame, size)?;
            let pictured = name != "triangles" && shown.contains(&frame);
            all.push(walk.frame(&mut approximations, &mut renderer, &camera, pictured)?);
        }
        summary.push(line(name, &all));
        if name != "triangles" {
            println!("{}", cache_line(&approximations));
        }
        walked = all;
    }
    let mut whole = Vec::new();
    for frame in 0..frames {
        whole.push(walk::whole(&mut renderer, &meshes, &objects, &walk::camera(frame, size)?)?);
    }
    let mean = |of: &dyn Fn(&walk::Whole) -> f64| whole.iter().map(of).sum::<f64>() / whole.len() as f64;
    let (time, triangles) = (mean(&|w| ms(w.time)), mean(&|w| w.triangles as f64));
    println!("{:<24} {time:>10.2} {triangles:>10.0} {:>8} {:>10}", "whole meshes", "-", "-");
    summary.iter().for_each(|l| println!("{l}"));

    let names = |object: usize| models[objects[object].model].name.clone();
    let mut page = page::Page::new(&format!(
        "Each object is drawn as triangles of its level of detail, displaced by {px} pixels at most, or as a picture of them with {px} pixels of parallax at most \
         (in pixels of {} × {}; frames are shown at half that), whichever costs less over the frames that it will serve.",
        size[0],
        size[1],
        px = arguments.px
    ));
    for frame in shown {
        let drawn = &walked[frame];
        page.frame(frame, drawn, &names);
        if let Some(image) = &drawn.image {
            let path = arguments.out.join(format!("frame-{frame:03}.png"));
            image.write_png(&path)?;
            println!("{}", path.display());
        }
    }
    if let Some(last) = whole.last() {
        last.image.write_png(arguments.out.join("whole.png"))?;
        page.image(&last.image, "The last frame with all meshes whole.");
    }
    let path = arguments.out.join("index.html");
    std::fs::write(&path, page.finish())?;
    println!("{}", path.display());
    Ok(())
}

/// Two rows of objects along a way in x.
fn avenue(models: &[Model], rows: usize) -> Result<Vec<Object>, Box<dyn Error>> {
    let mut objects = Vec::new();
    for row in 0..rows {
        for side in [-1.0, 1.0] {
            let model = if side < 0.0 { 0 } else { 1 + row % (models.len() - 1) };
            let x = if model == 0 { 18.0 * row as f64 } else { 7.0 * row as f64 - 2.0 };
            let turn = DQuat::from_rotation_z(if side < 0.0 { 2.3 } else { -1.9 + 0.3 * row as f64 });
            let at = DVec3::new(x, side * if model == 0 { 8.0 } else { 5.0 }, 0.0);
            let mesh = &models[model].mesh;
            let place = DAffine3::from_rotation_translation(turn, at);
            let placement = Placement::new(&place, mesh.origin())?;
            objects.push(Object { model, placement, bounds: mesh.world_bounds().transformed(&place) });
        }
    }
    Ok(objects)
}

fn ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

fn line(name: &str, frames: &[walk::Frame]) -> String {
    let n = frames.len();
    let time: Duration = frames.iter().map(|f| f.time).sum();
    format!(
        "{name:<24} {:>10.2} {:>10} {:>8.1} {:>10.2}",
        ms(time) / n as f64,
        frames.iter().map(|f| f.triangles).sum::<usize>() / n,
        frames.iter().map(|f| f.pictures).sum::<usize>() as f64 / n as f64,
        frames.iter().map(|f| f.made).sum::<usize>() as f64 / n as f64
    )
}

fn cache_line<I>(approximations: &Approximations<I>) -> String {
    let s = approximations.cache_stats();
    format!("cache: {} hits, {} misses, {:.1} MB at most", s.hits, s.misses, s.most_bytes as f64 * 1e-6)
}
