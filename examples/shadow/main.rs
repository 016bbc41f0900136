//! Shadow maps side by side: where their edges lie near, in the middle and far away, how large their texels are along the view, and a soft
//! shadow against the sampled light.
//!
//! ```text
//! cargo run --release --example shadow                  a plain with posts
//! cargo run --release --example shadow -- house.glb     your own .obj, .gltf, .glb (y up)
//! ```
//!
//! You should see a table of edge offsets in pixels, and in `out/shadow` three figures: `comparison.png` (rows: rays, uniform, LiSPSM, PSM,
//! minimax, logarithmic; columns: near, medium, far; false shadow in dark red, missing shadow in light red), `curves.svg` (dp/ds along the view) and `soft.png`
//! (sampled light; silhouettes and what they get wrong, four times enlarged; a hard shadow blurred by one width, and likewise).

mod figure;
mod logarithmic;
mod offset;
mod posts;
mod soft;

use clap::Parser;
use farsight_geometry::glam::{DQuat, DVec3, Vec3, dvec3};
use farsight_geometry::ray::SceneCaster;
use farsight_geometry::scene::{Light, Scene};
use farsight_geometry::{Camera, io};
use farsight_raster::{Image, Rasteriser, ShadowMap, ShadowOptions};
use farsight_shadow::{Focus, MapOptions, Scope, ShadowLight, ShadowView, Warp};
use logarithmic::Logarithmic;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

#[derive(Parser)]
#[command(about = "Shadow maps side by side, with their errors")]
struct Options {
    /// A scene to load (.obj, .gltf, .glb); without, a plain with posts is generated.
    path: Option<PathBuf>,
    /// Folder for the figures.
    #[arg(long, default_value = "out/shadow")]
    out: PathBuf,
    /// Small pictures.
    #[arg(long)]
    quick: bool,
    /// Texels on a side of the shadow maps.
    #[arg(long, default_value_t = 1024)]
    side: u32,
}

fn main() -> ExitCode {
    match run(&Options::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("shadow: {error}");
            ExitCode::FAILURE
        }
    }
}

/// A shadow map of a scene for a camera.
struct Drawn {
    view: ShadowView,
    map: ShadowMap,
}

fn run(options: &Options) -> Result<(), Box<dyn Error>> {
    std::fs::create_dir_all(&options.out)?;
    let (width, height) = if options.quick { (480, 270) } else { (1280, 720) };
    let (scene, camera) = match &options.path {
        Some(path) => loaded(path, width, height)?,
        None => (posts::scene(35.0, 70.0), posts::camera(width, height)?),
    };
    compare(&scene, &camera, options)?;
    figure::curves(&options.out.join("curves.svg"))?;
    soft_figure(options)?;
    println!("figures in {}", options.out.display());
    Ok(())
}

/// The scene of a file with a sun, seen from a corner of its box.
fn loaded(path: &Path, width: u32, height: u32) -> Result<(Scene, Camera), Box<dyn Error>> {
    let mut scene = io::load(path)?.into_scene().ok_or("the file holds points, no triangles")?;
    let b = scene.bounds();
    let size = b.extent();
    let eye = b.center() + dvec3(0.45 * size.x, 0.1 * size.y, 0.45 * size.z);
    let camera = Camera::new(eye, DQuat::IDENTITY)?;
    let target = b.center() - dvec3(0.3 * size.x, 0.2 * size.y, 0.3 * size.z);
    let camera = if size.length() > 0.0 { Camera::look_at(eye, target, DVec3::Y)? } else { camera };
    let far = 2.0 * size.length().max(1e-3);
    if !matches!(scene.lights().first(), Some(Light::Directional { .. })) {
        let direction = dvec3(-0.4, -0.8, 0.3).normalize();
        let mut fresh = Scene::of_mesh(scene.flattened()?);
        fresh.add_light(Light::Directional {
            direction,
            irradiance: Vec3::splat(2.4),
            angular_radius: 0.0,
        })?;
        scene = fresh;
    }
    Ok((scene, camera.with_range(far * 5e-4, far)?.with_image(width, height)?))
}

fn draw(
    scene: &Scene,
    focus: &Focus,
    direction: DVec3,
    side: u32,
    warp: Warp,
) -> Result<Drawn, Box<dyn Error>> {
    let view = focus.map(&MapOptions::new(side).with_warp(warp), None);
    let mut map =
        ShadowMap::new(side, view.clip_from_relative, view.origin, -direction, ShadowOptions::default())?;
    map.draw_scene(&mut Rasteriser::new(), scene);
    Ok(Drawn { view, map })
}

fn compare(scene: &Scene, camera: &Camera, options: &Options) -> Result<(), Box<dyn Error>> {
    let Some(&Light::Directional { direction, .. }) = scene.lights().first() else {
        return Err("the scene has no sun".into());
    };
    let caster = SceneCaster::new(scene)?;
    let truth = offset::truth(scene, &caster, camera, direction);
    let by_rays: Vec<Option<bool>> = truth.pixels.iter().map(|p| p.map(|(_, lit)| lit)).collect();
    let mut rows = vec![figure::Row { lit: by_rays.clone() }];
    println!("{} texels: edges off by, px       all    near  medium     far   worst texel, px", options.side);
    let boxes = scene.instance_bounds();
    let mut focus = Focus::new();
    let scope = Scope::new(camera, camera.far(), &boxes, &boxes, options.side);
    if let Some(skip) = focus.fit(&ShadowLight::directional(direction), &scope)? {
        println!("no shadow map is needed: {skip:?}");
        return Ok(());
    }
    let mut add = |name: &str, lit: &dyn Fn(&offset::Seen) -> bool, texel_px: f64, kind: &str| {
        let (o, lit) = offset::compare(&truth, lit);
        let [near, medium, far] = o.bands_px;
        println!("{name:28} {:7.2} {near:7.2} {medium:7.2} {far:7.2}   {texel_px:7.2} ({kind})", o.mean_px);
        rows.push(figure::Row { lit });
    };
    let warps = [
        ("uniform", Warp::Uniform),
        ("LiSPSM", Warp::Paper),
        ("PSM", Warp::Perspective),
        ("minimax", Warp::Minimax),
    ];
    for (name, warp) in warps {
        let drawn = draw(scene, &focus, direction, options.side, warp)?;
        let texel = drawn.view.texel;
        let lit = |seen: &offset::Seen| offset::lit(&drawn.map, &drawn.view, seen);
        add(name, &lit, texel.value, &texel.kind.to_string());
    }
    let map = Logarithmic::new(scene, camera, &focus, options.side)?;
    add("logarithmic", &|seen| map.lit(seen), map.texel_px, "estimated");
    println!("the logarithmic map was drawn from {} triangles", map.triangles);
    figure::comparison(&truth, &by_rays, &rows)?.write_png(options.out.join("comparison.png"))?;
    Ok(())
}

fn soft_figure(options: &Options) -> Result<(), Box<dyn Error>> {
    let (side, rays) = if options.quick { (96, 12) } else { (256, 32) };
    let soft = soft::Soft::new(side);
    let exact = soft.sampled(rays);
    let panels = [exact.clone(), soft.outlines(), soft.blurred(), soft.hard()];
    for (name, panel) in ["silhouettes", "one blur for all", "hard"].iter().zip(&panels[1..]) {
        println!("soft shadow, {name}: rms {:.4} of the light from {rays}² rays", soft::rms(panel, &exact));
    }
    let error = |p: &[f64]| p.iter().zip(&exact).map(|(a, b)| 1.0 - 4.0 * (a - b).abs()).collect::<Vec<_>>();
    let errors = [error(&panels[1]), error(&panels[2])];
    let all = [&panels[0], &panels[1], &errors[0], &panels[2], &errors[1]];
    let image: Image = figure::strip(side, &all.map(|p| p.as_slice()))?;
    image.write_png(options.out.join("soft.png"))?;
    Ok(())
}
