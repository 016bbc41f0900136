//! What accuracy costs in time: sweeps every crate's knob, measures the true error with code that shares nothing with
//! the claim, and writes one table and one plot per crate.
//!
//! ```text
//! cargo bench --bench accuracy_vs_time                     everything, to target/accuracy
//! cargo bench --bench accuracy_vs_time -- --quick --check  small scenes; fails when a promise is broken
//! cargo bench --bench accuracy_vs_time -- --bless          accepts the work counters as the new baseline
//! ```

mod check;
mod geometry;
mod hlod;
mod lod;
mod occlusion;
mod plan;
mod plot;
mod points;
mod row;
mod shadow;
mod timing;
mod visibility;

use clap::Parser;
use row::Row;
use std::path::{Path, PathBuf};

#[derive(Parser)]
#[command(about = "Sweeps every accuracy knob and measures what it costs")]
struct Options {
    /// Small scenes, under two minutes in all.
    #[arg(long)]
    quick: bool,
    /// Fails when a proven claim is exceeded, a finer knob is slower and worse, or a counter grew by more than 5 %.
    #[arg(long)]
    check: bool,
    /// Writes the counters as the new baseline.
    #[arg(long)]
    bless: bool,
    /// Only this crate.
    #[arg(long)]
    only: Option<String>,
    /// Where tables and plots go.
    #[arg(long, default_value = "target/accuracy")]
    out: PathBuf,
    /// Passed by cargo; means nothing here.
    #[arg(long, hide = true)]
    bench: bool,
}

/// A crate's sweep: its name, the caption of its plot, and the rows for small or full scenes.
struct Sweep {
    name: &'static str,
    caption: &'static str,
    rows: fn(quick: bool) -> Vec<Row>,
}

const SWEEPS: &[Sweep] = &[
    Sweep { name: "geometry", caption: "Hausdorff distance: tolerance against time", rows: geometry::rows },
    Sweep { name: "hlod", caption: "Simplification: tolerance and tier against time", rows: hlod::rows },
    Sweep {
        name: "lod",
        caption: "Vertex hierarchy: tolerance in pixels against update time",
        rows: lod::rows,
    },
    Sweep {
        name: "occlusion",
        caption: "Occlusion culling: lost pixels against frame time",
        rows: occlusion::rows,
    },
    Sweep {
        name: "plan",
        caption: "Plans: tolerance and time limit against the time of drawing",
        rows: plan::rows,
    },
    Sweep {
        name: "points",
        caption: "Point clouds: pixels between a point and the drawn one, against the time of a frame",
        rows: points::rows,
    },
    Sweep {
        name: "shadow",
        caption: "Shadows: map side, cascades and methods against time",
        rows: shadow::rows,
    },
    Sweep {
        name: "timing",
        caption: "Rendering-time estimates: estimator and samples against time per frame estimated",
        rows: timing::rows,
    },
    Sweep {
        name: "visibility",
        caption: "Visibility from a region: rays and methods, missed pixels against time",
        rows: visibility::rows,
    },
];

fn main() -> std::process::ExitCode {
    let options = Options::parse();
    match run(&options) {
        Ok(0) => std::process::ExitCode::SUCCESS,
        Ok(broken) => {
            eprintln!("{broken} broken promises");
            std::process::ExitCode::FAILURE
        }
        Err(error) => {
            eprintln!("accuracy_vs_time: {error}");
            std::process::ExitCode::FAILURE
        }
    }
}

/// Runs the sweeps; returns how many promises were broken.
fn run(options: &Options) -> Result<usize, Box<dyn std::error::Error>> {
    std::fs::create_dir_all(&options.out)?;
    let wanted = |s: &&Sweep| options.only.as_ref().is_none_or(|name| name == s.name);
    let mut broken = 0;
    for sweep in SWEEPS.iter().filter(wanted) {
        let start = std::time::Instant::now();
        let rows = (sweep.rows)(options.quick);
        println!("\n{} ({:.1} s)", sweep.caption, start.elapsed().as_secs_f64());
        row::print_table(&rows);
        std::fs::write(options.out.join(format!("{}.csv", sweep.name)), row::to_csv(&rows))?;
        plot::pareto(&options.out.join(format!("{}.svg", sweep.name)), sweep.caption, &rows)?;
        let baseline = baseline_path(sweep.name, options.quick);
        if options.bless {
            std::fs::write(&baseline, row::to_baseline(&rows))?;
        }
        if options.check {
            let expected = std::fs::read_to_string(&baseline)
                .map_err(|e| format!("{}: {e}; make it with --bless", baseline.display()))?;
            let complaints = check::broken_promises(&rows, &expected);
            complaints.iter().for_each(|c| eprintln!("{}: {c}", sweep.name));
            broken += complaints.len();
        }
    }
    Ok(broken)
}

fn baseline_path(name: &str, quick: bool) -> PathBuf {
    let size = if quick { "quick" } else { "full" };
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("benches/accuracy_vs_time/baseline/{name}-{size}.csv"))
}
