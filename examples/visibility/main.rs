//! What can be seen from a piece of a street, sampled in three ways.
//!
//! ```text
//! cargo run --release --example visibility
//! cargo run --release --example visibility -- level.glb --eye 816,192,600 --size 64,32,64
//! ```
//!
//! You should see a table of sets and errors as they grow and shrink with the rays, and in `out/visibility` a picture from the cell for each
//! method with what it missed in red (`missed-*.png`), the set from above with all that is hidden left out (`kept.png`), and the growth of the sets as
//! a plot (`growth.svg`).

mod input;
mod pictures;
mod plot;

use clap::Parser;
use farsight_geometry::ray::Bvh8;
use farsight_visibility::{Budget, Occluders, Options, Pvs, Sampler, Triangles, ViewCell};
use input::Input;
use std::error::Error;
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(Parser)]
#[command(about = "Samples what can be seen from a view cell")]
struct Arguments {
    /// A scene; without it a town is made.
    scene: Option<PathBuf>,
    /// Middle of the cell as x,y,z in the scene's units.
    #[arg(long, value_delimiter = ',')]
    eye: Vec<f64>,
    /// Size of the cell as x,y,z.
    #[arg(long, value_delimiter = ',')]
    size: Vec<f64>,
    /// A file of stations beside a game level; the cell is put at the one with this number.
    #[arg(long)]
    station: Option<usize>,
    /// Rays for each method.
    #[arg(long, default_value_t = 2_000_000)]
    rays: u64,
    /// Folder for the pictures.
    #[arg(long, default_value = "out/visibility")]
    out: PathBuf,
    /// A small town and few rays.
    #[arg(long)]
    quick: bool,
}

/// A method, its set, and how many members it had after how many rays.
pub struct Sampled {
    name: &'static str,
    set: Pvs,
    growth: Vec<(u64, u32)>,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("visibility: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), Box<dyn Error>> {
    std::fs::create_dir_all(&arguments.out)?;
    let input = Input::new(arguments)?;
    let mesh = input.scene.flattened()?;
    println!(
        "{} triangles, cell of {:.1} at {:.1}",
        mesh.triangles().len(),
        input.cell.extent(),
        input.cell.center()
    );
    let (triangles, caster) = (Triangles::of_mesh(&mesh), Bvh8::new(&mesh));
    let cell = ViewCell::from_box(&input.cell)?;
    let rays = if arguments.quick { arguments.rays.min(300_000) } else { arguments.rays };
    let mut all = Vec::new();
    for (name, options) in
        [("guided", Options::default()), ("paper", Options::paper()), ("random", Options::random())]
    {
        let mut sampler = Sampler::new(&triangles, Occluders::opaque(&caster), &cell, options)?;
        let mut growth = Vec::new();
        for i in 1..=40 {
            sampler.run(&Budget::rays(rays * i / 40));
            growth.push((sampler.rays(), sampler.len()));
        }
        let set = sampler.pvs();
        let missed = sampler.validate(if arguments.quick { 200_000 } else { 2_000_000 }, 0.95)?;
        println!(
            "{name:<8} {:>8} visible ({:.2} %) after {:.2} Mrays; at most {:.1} of a million pixels are false (95 %)",
            set.len(),
            100.0 * f64::from(set.len()) / f64::from(triangles.count().max(1)),
            sampler.rays() as f64 * 1e-6,
            missed.per_million()
        );
        all.push(Sampled { name, set, growth });
    }
    for path in pictures::write(&input, &mesh, &all, arguments)? {
        println!("{}", path.display());
    }
    let path = arguments.out.join("growth.svg");
    plot::growth(&path, &all)?;
    println!("{}", path.display());
    Ok(())
}
