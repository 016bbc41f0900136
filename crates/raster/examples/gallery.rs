//! Renders pictures of the generated scenes.
//!
//! `cargo run --release -p farsight-raster --example gallery -- out/gallery` writes PNG files into that folder and
//! prints what was drawn. A second argument picks scenes by a part of their name.

use farsight_geometry::{Camera, ClipConvention, Scene};
use farsight_raster::scenes::{City, Cubes, Forest, Path, Rooms, StreetCanyon, StreetPoints, Terrain};
use farsight_raster::{
    Image, Outputs, PointDraw, Rasteriser, RenderOptions, ShadowMap, ShadowOptions, Splat,
};
use farsight_raster::{State, Target, render_scene};
use glam::{DVec3, Vec3};
use std::error::Error;
use std::path::PathBuf;
use std::time::Instant;

type Outcome = Result<(), Box<dyn Error>>;

fn main() -> Outcome {
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| "out/gallery".into()));
    std::fs::create_dir_all(&folder)?;
    let wanted = std::env::args().nth(2);
    let mut gallery = Gallery { folder, wanted, rasteriser: Rasteriser::new() };
    let city = City::default();
    gallery.scene(
        "city",
        || Ok(city.build()?),
        &[
            ("street", Path::street_walk(&city).camera(2, 12)?),
            ("corner", Path::street_walk(&city).camera(6, 12)?),
            ("rise", Path::rise(&city).camera(3, 4)?),
            ("flyover", Path::flyover(city.side(), 60.0).camera(3, 12)?),
        ],
    )?;
    gallery.scene(
        "canyon",
        || Ok(StreetCanyon::default().build()?),
        &[("street", Camera::look_at(DVec3::new(8.0, -1.0, 1.8), DVec3::new(60.0, 0.5, 6.0), DVec3::Z)?)],
    )?;
    let terrain = Terrain::default();
    gallery.scene(
        "terrain",
        || Ok(terrain.build()?),
        &[
            ("flyover", Path::flyover(terrain.side, 900.0).camera(2, 12)?),
            (
                "valley",
                Camera::look_at(
                    DVec3::new(900.0, 700.0, terrain.height(900.0, 700.0) + 190.0),
                    DVec3::new(2200.0, 2300.0, 150.0),
                    DVec3::Z,
                )?,
            ),
        ],
    )?;
    let forest = Forest::default();
    gallery.scene(
        "forest",
        || Ok(forest.build()?),
        &[
            ("edge", Camera::look_at(DVec3::new(-22.0, -14.0, 9.0), DVec3::new(60.0, 50.0, 3.0), DVec3::Z)?),
            ("inside", Camera::look_at(DVec3::new(38.5, 44.5, 2.2), DVec3::new(90.0, 70.0, 4.0), DVec3::Z)?),
        ],
    )?;
    let rooms = Rooms::default();
    gallery.scene(
        "rooms",
        || Ok(rooms.build()?),
        &[
            (
                "inside",
                Camera::look_at(
                    rooms.eye(0, 0) + DVec3::new(1.9, 1.7, 0.0),
                    rooms.eye(0, 0) - DVec3::new(1.2, 1.5, 0.6),
                    DVec3::Z,
                )?,
            ),
            (
                "lamp",
                Camera::look_at(
                    rooms.eye(3, 2) + DVec3::new(2.0, -2.0, 0.2),
                    rooms.eye(3, 2) + DVec3::new(-1.0, 1.2, -0.6),
                    DVec3::Z,
                )?,
            ),
        ],
    )?;
    gallery.scene(
        "cubes",
        || Ok(Cubes::default().build()?),
        &[("outside", Camera::look_at(DVec3::new(-60.0, -40.0, 110.0), DVec3::splat(48.0), DVec3::Z)?)],
    )?;
    if gallery.wants("points") {
        gallery.points()?;
    }
    Ok(())
}

struct Gallery {
    folder: PathBuf,
    wanted: Option<String>,
    rasteriser: Rasteriser,
}

impl Gallery {
    fn wants(&self, name: &str) -> bool {
        self.wanted.as_ref().is_none_or(|w| name.contains(w.as_str()))
    }

    fn scene(
        &mut self,
        name: &str,
        build: impl Fn() -> Result<Scene, Box<dyn Error>>,
        views: &[(&str, Camera)],
    ) -> Outcome {
        if !self.wants(name) {
            return Ok(());
        }
        let start = Instant::now();
        let scene = build()?;
        println!(
            "{name}: {} triangles in {} instances, {:.1} m, built in {:.2?}",
            scene.placed_triangles(),
            scene.instances().len(),
            scene.bounds().extent(),
            start.elapsed()
        );
        for (view, camera) in views {
            let start = Instant::now();
            let reach = (0.5 * scene.bounds().diagonal()).min(if name == "terrain" { 1500.0 } else { 90.0 });
            let options = ShadowOptions::default();
            let shadows = ShadowMap::for_view(&mut self.rasteriser, &scene, camera, reach, 4096, options)?;
            let mut options = RenderOptions::default();
            options.shadows = &shadows;
            options.supersampling = 2;
            options.haze = Some(12.0 * scene.bounds().diagonal() as f32);
            if name == "rooms" {
                options.ambient = [Vec3::new(0.46, 0.47, 0.50), Vec3::new(0.44, 0.40, 0.35)];
            }
            let (target, counters) = render_scene(&mut self.rasteriser, &scene, camera, &options)?;
            println!("  {view}: {:.2?}, {} triangles drawn", start.elapsed(), counters.drawn);
            Image::from_colour(&target).write_png(self.folder.join(format!("{name}_{view}.png")))?;
        }
        Ok(())
    }

    fn points(&mut self) -> Outcome {
        let mut street = StreetPoints::default();
        street.count = 3_000_000;
        let eye = street.offset + DVec3::new(45.0, -1.5, 2.6);
        let camera = Camera::look_at(eye, eye + DVec3::new(30.0, 3.0, 0.6), DVec3::Z)?;
        let points: Vec<_> = street.points()?.collect();
        let positions: Vec<Vec3> = points.iter().map(|p| (p.position - eye).as_vec3()).collect();
        let colours: Vec<[u8; 4]> =
            points.iter().map(|p| [p.colour[0], p.colour[1], p.colour[2], 255]).collect();
        let mut target = Target::new(1280, 720, Outputs::ALL)?;
        self.rasteriser.draw_points(
            &mut target,
            &PointDraw {
                positions: &positions,
                colours: &colours,
                sizes_px: &[2.0],
                splat: Splat::Round,
                clip_from_local: camera.clip_from_relative_f64(ClipConvention::REVERSED, eye),
                state: State::default(),
            },
        );
        Ok(Image::from_colour(&target).write_png(self.folder.join("points_street.png"))?)
    }
}
