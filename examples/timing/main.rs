//! Predicting rendering times, and holding a frame rate with the predictions.
//!
//! ```text
//! cargo run --release --example timing
//! ```
//!
//! You should see a short table, and two plots in `out/timing`: `predicted.svg`, what frames of a walk through a town were predicted to take
//! (with the band that nine in ten frames stay in) and what the software renderer really took; and `held.svg`, a frame rate on the simulated
//! card, with and without choosing levels of detail.

mod plot;
mod renderer;

use clap::Parser;
use farsight_raster::scenes::{City, Path};
use farsight_timing::simulator::{HoldOptions, Law, SimScene, Simulator, hold};
use farsight_timing::{
    Collinear, Heuristic, Millis, Refit, RefitOptions, Residuals, Sample, best_model, calibrate,
};
use plot::Predicted;
use renderer::Renderer;
use std::error::Error;
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(Parser)]
#[command(about = "Predicts rendering times and holds a frame rate")]
struct Options {
    /// Folder for the plots.
    #[arg(long, default_value = "out/timing")]
    out: PathBuf,
    /// Short paths.
    #[arg(long)]
    quick: bool,
}

fn main() -> ExitCode {
    match run(&Options::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("timing: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(options: &Options) -> Result<(), Box<dyn Error>> {
    std::fs::create_dir_all(&options.out)?;
    let frames = if options.quick { 120 } else { 600 };
    let path = options.out.join("predicted.svg");
    plot::predicted(&path, &predict(frames)?)?;
    println!("{}", path.display());
    let path = options.out.join("held.svg");
    plot::held(&path, TARGET, &hold_a_rate(frames)?)?;
    println!("{}", path.display());
    Ok(())
}

/// Calibrates on single objects, then predicts a walk frame by frame and learns from it.
fn predict(frames: usize) -> Result<Vec<Predicted>, Box<dyn Error>> {
    let city = City::small();
    let mut renderer = Renderer::new(city.build()?)?;
    let turn = Path::turn(&city);
    let mut samples: Vec<Sample> = Vec::new();
    for i in 0..24 {
        let camera = renderer.lens(turn.camera(i, 24)?)?;
        samples.extend(
            renderer.visible(&camera).iter().step_by(5).map(|&object| renderer.time_alone(object, &camera)),
        );
    }
    // Every other drawing is kept back to judge by.
    let (known, unseen): (Vec<_>, Vec<_>) = samples.iter().enumerate().partition(|(i, _)| i % 2 == 0);
    let [known, unseen] = [known, unseen].map(|s| s.into_iter().map(|(_, s)| *s).collect::<Vec<Sample>>());
    let best = best_model(&known, &unseen, false)?;
    println!(
        "{} single drawings; best on those unseen: {}, off by {:.3} ms (RMS)",
        samples.len(),
        best.model.heuristic,
        best.rms.0
    );

    let start = calibrate(Heuristic::Sum, &known, false, Collinear::Accept)?;
    let mut refit = Refit::new(start.model, Millis::ZERO, RefitOptions::default())?;
    let mut residuals = Residuals::new(300);
    let walk = Path::street_walk(&city);
    let mut seen = Vec::with_capacity(frames);
    for i in 0..frames {
        let camera = renderer.lens(walk.camera(i, frames)?)?;
        let visible = renderer.visible(&camera);
        let features = renderer.features(&visible, &camera);
        let predicted = refit.predict(&features);
        let band = [0.05, 0.95].map(|q| residuals.quantile(predicted, q).unwrap_or(predicted));
        let alone = start.model.predict(&features);
        let measured = renderer.time_frame(&visible, &camera);
        residuals.record(predicted, measured);
        refit.observe(&features, measured)?;
        seen.push(Predicted { alone, predicted, band, measured });
    }
    let mut errors: Vec<f64> =
        seen[frames / 4..].iter().map(|s| (s.predicted / s.measured - 1.0).abs()).collect();
    errors.sort_by(f64::total_cmp);
    let within = errors.iter().filter(|&&e| e <= 0.1).count() as f64 / errors.len() as f64;
    println!(
        "{frames} frames refitted: half within {:.1} %, 95 of 100 within {:.1} %, {:.1} % of frames within 10 %",
        100.0 * errors[errors.len() / 2],
        100.0 * errors[errors.len() * 95 / 100],
        100.0 * within
    );
    Ok(seen)
}

/// Time that a frame may take.
const TARGET: Millis = Millis(10.0);

/// A line of a plot: its name, and the frames' times.
type Line = (&'static str, Vec<Millis>);

/// The same path over the simulated forest with more and more means.
fn hold_a_rate(frames: usize) -> Result<Vec<Line>, Box<dyn Error>> {
    let scene = SimScene::forest(1);
    let means = [
        ("all at its finest", false, false),
        ("levels chosen", true, false),
        ("levels chosen, clock asked", true, true),
    ];
    let mut lines = Vec::new();
    for (name, solver, branch) in means {
        let mut options = HoldOptions::default();
        (options.target, options.frames, options.solver, options.branch) = (TARGET, frames, solver, branch);
        options.slower_from = Some(frames * 2 / 3);
        let held = hold(&scene, &mut Simulator::new(Law::default(), 4), &options)?;
        println!(
            "{name}: {} of {frames} frames later than {} ms, {:.0} % of full detail",
            held.over,
            TARGET.0,
            100.0 * held.benefit
        );
        lines.push((name, held.times));
    }
    Ok(lines)
}
