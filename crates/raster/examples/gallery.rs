//! Renders one picture of each generated scene.
//!
//! `cargo run --release -p farsight-raster --example gallery -- out/gallery` writes PNG files into that folder and
//! prints what was drawn.

use farsight_geometry::{Camera, Scene};
use farsight_raster::scenes::{City, Path};
use farsight_raster::{Image, Rasteriser, RenderOptions, ShadowMap, ShadowOptions, render_scene};
use std::error::Error;
use std::path::PathBuf;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| "out/gallery".into()));
    std::fs::create_dir_all(&folder)?;
    let wanted = std::env::args().nth(2);
    let mut gallery = Gallery { folder, wanted, rasteriser: Rasteriser::new() };
    let city = City::default();
    if gallery.wants("city") {
        let scene = city.build()?;
        let bounds = scene.bounds();
        println!(
            "city: {} triangles, {} instances, {:?}",
            scene.placed_triangles(),
            scene.instances().len(),
            bounds.extent()
        );
        gallery.show("city_street", &scene, Path::street_walk(&city).camera(2, 12)?)?;
        gallery.show("city_corner", &scene, Path::street_walk(&city).camera(6, 12)?)?;
        gallery.show("city_rise", &scene, Path::rise(&city).camera(3, 4)?)?;
        gallery.show("city_flyover", &scene, Path::flyover(city.side(), 60.0).camera(3, 12)?)?;
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

    fn show(&mut self, name: &str, scene: &Scene, camera: Camera) -> Result<(), Box<dyn Error>> {
        let start = Instant::now();
        let shadows = ShadowMap::for_scene(&mut self.rasteriser, scene, 8192, ShadowOptions::default())?;
        let shadow_time = start.elapsed();
        let start = Instant::now();
        let mut options = RenderOptions::default();
        options.shadows = &shadows;
        options.supersampling = 2;
        options.haze = Some(1500.0);
        let (target, counters) = render_scene(&mut self.rasteriser, scene, &camera, &options)?;
        println!("{name}: shadow map {shadow_time:.2?}, image {:.2?}, {counters:?}", start.elapsed());
        Image::from_colour(&target).write_png(self.folder.join(format!("{name}.png")))?;
        Ok(())
    }
}
