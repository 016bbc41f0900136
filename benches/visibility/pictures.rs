//! Table 5.2: guided and random rays against the adaptive hemicubes, by what pictures from the cell show wrong.

use super::Ask;
use super::item_buffer::Pictures;
use super::judge::direction;
use super::scenes::Case;
use farsight_geometry::Camera;
use farsight_geometry::camera::Projection;
use farsight_geometry::glam::DVec3;
use farsight_geometry::sampling::Random;
use farsight_visibility::{Budget, ItemBuffer, NirOptions, Occluders, Options, Pvs, Sampler, nir};
use std::error::Error;
use std::time::Instant;

pub fn report(ask: &Ask) -> Result<(), Box<dyn Error>> {
    println!("\npictures from the cell, false pixels of 1000 x 1000 (table 5.2)");
    println!("{:<12} {:<10} {:>8} {:>8} {:>9} {:>9}", "", "", "mean", "most", "seconds", "set %");
    let mut cases = vec![Case::city(true)?, Case::cubes()?];
    if !ask.quick {
        cases.insert(0, Case::city(false)?);
    }
    for case in cases {
        let mut pictures = Pictures::of_mesh(case.mesh.clone());
        let views = views(&case, &mut pictures, if ask.quick { 6 } else { 40 })?;
        let total = f64::from(case.triangles().count());
        let name = if total < 2e5 && case.name == "city" { "small city" } else { case.name };
        let row = |method: &str, set: &Pvs, seconds: f64| {
            let wrong: Vec<f64> = views
                .iter()
                .map(|ids| ids.iter().filter(|&&id| id != 0 && !set.contains(id - 1)).count() as f64)
                .collect();
            let (mean, most) =
                (wrong.iter().sum::<f64>() / wrong.len() as f64, wrong.iter().copied().fold(0.0, f64::max));
            let share = 100.0 * f64::from(set.len()) / total;
            println!("{name:<12} {method:<10} {mean:>8.1} {most:>8.0} {seconds:>9.1} {share:>9.2}");
        };
        let triangles = case.triangles();
        let guided = if ask.quick { 300_000 } else { 4_000_000 };
        for (method, options, rays) in [
            ("GVS", Options::default(), guided),
            ("paper", Options::paper(), guided),
            ("RAND", Options::random(), 5 * guided),
        ] {
            let start = Instant::now();
            let mut sampler = Sampler::new(&triangles, Occluders::opaque(&case.caster), &case.cell, options)?;
            sampler.run(&Budget::rays(rays));
            row(method, &sampler.pvs(), start.elapsed().as_secs_f64());
        }
        for side in [512, 1024] {
            let mut options = NirOptions::default();
            options.side = side;
            options.most_cubes = if ask.quick { 8 } else { 40 };
            let start = Instant::now();
            let found = nir(case.cell.bounds(), &options, &mut pictures)?;
            row(&format!("NIR{side}"), &found.set, start.elapsed().as_secs_f64());
        }
    }
    Ok(())
}

/// Pictures of 60 degrees from random viewpoints in the cell, level or nearly so.
fn views(case: &Case, pictures: &mut Pictures, count: usize) -> Result<Vec<Vec<u32>>, Box<dyn Error>> {
    let mut random = Random::new(31);
    let b = case.cell.bounds();
    (0..count)
        .map(|_| {
            let eye = b.min + (b.max - b.min) * DVec3::from_array(random.units());
            let ahead = direction(&mut random) * DVec3::new(1.0, 1.0, 0.2);
            let camera = Camera::look_at(eye, eye + ahead, DVec3::Z)?
                .with_projection(Projection::Perspective { fov_y: 1.05 })?
                .with_image(1000, 1000)?
                .with_range(1e-3, f64::INFINITY)?;
            let mut ids = Vec::new();
            pictures.draw(&camera, &mut ids);
            Ok(ids)
        })
        .collect()
}
