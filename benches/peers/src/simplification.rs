//! Simplification: triangles kept, true error and rate beside meshoptimizer's. Every figure is printed beside the floor it is held to.
//!
//! `… -- simplification` runs on generated surfaces, and on collected ones where `FARSIGHT_DATA` names their folder. `-- --quick` takes
//! smaller ones; a file's name takes that one only. `-- --plot FOLDER` draws triangles and time against true error instead.

mod peer;
mod plot;
pub mod surfaces;

use farsight_geometry::TriangleMesh;
use farsight_geometry::distance::{HausdorffOptions, hausdorff};
use farsight_hlod::{Simplified, SimplifyOptions, Tier, simplify};
use farsight_raster::thread_cpu_time;
use std::time::Duration;

/// Tolerances as shares of the diagonal.
const SHARES: [f64; 3] = [128.0, 512.0, 2048.0];

/// Runs what the arguments ask for.
pub fn report(arguments: &[String]) {
    let quick = arguments.iter().any(|a| a == "--quick");
    if let Some(i) = arguments.iter().position(|a| a == "--plot") {
        let folder = arguments.get(i + 1).map_or(".", String::as_str);
        draw(std::path::Path::new(folder), quick);
        return;
    }
    let wanted: Vec<&String> = arguments.iter().filter(|a| !a.starts_with("--")).collect();
    let mut surfaces = surfaces::generated(if quick { 24 } else { 72 });
    surfaces.extend(surfaces::collected());
    surfaces.retain(|(name, _)| wanted.is_empty() || wanted.contains(&name));
    println!(
        "{:<20} {:>9} {:>7} {:>9} | {:>8} {:>6} {:>6} | {:>8} {:>6} | {:>8} {:>6} {:>6} | {:>8} {:>6} {:>6}",
        "surface",
        "triangles",
        "1/tol",
        "meshopt",
        "kept",
        "ratio",
        "true",
        "ktri/s",
        "B/tri",
        "verified",
        "true",
        "ktri/s",
        "fast",
        "true",
        "ktri/s"
    );
    let mut rows = Vec::new();
    for (name, mesh) in &surfaces {
        for share in SHARES {
            rows.push(row(name, mesh, share, quick));
        }
    }
    summary(&rows);
}

/// What one surface at one tolerance gave.
struct Row {
    name: String,
    share: f64,
    ratio: Option<f64>,
    /// True error over the tolerance; over the claim for the fast tier.
    tightness: f64,
    violations: usize,
    /// Thousands of triangles a second, by tier.
    rates: [f64; 3],
}

fn row(name: &str, mesh: &TriangleMesh, share: f64, quick: bool) -> Row {
    let tolerance = mesh.world_bounds().diagonal() / share;
    let triangles = mesh.triangles().len();
    let runs = if quick { 1 } else { 3 };
    let tiers = [Tier::Guaranteed, Tier::Verified, Tier::Fast].map(|tier| {
        let (simple, time) =
            timed(runs, || simplify(mesh, tolerance, &SimplifyOptions::default().with_tier(tier)));
        let simple = simple.expect("the tolerance is usable");
        let truth = true_error(mesh, &simple.mesh, tolerance);
        let asked = if tier == Tier::Fast { f64::INFINITY } else { tolerance };
        let claim = simple.geometric.value;
        let violated = truth > claim || claim > asked;
        (simple, triangles as f64 / time.as_secs_f64() * 1e-3, truth, violated)
    });
    let peer = peer::oracle(mesh, tolerance);
    let kept = |s: &Simplified| s.mesh.triangles().len();
    let ratio = peer.map(|p| kept(&tiers[0].0) as f64 / p as f64);
    let [g, v, f] = &tiers;
    println!(
        "{name:<20} {triangles:>9} {share:>7} {:>9} | {:>8} {:>6} {:>6.3} | {:>8.1} {:>6} | {:>8} {:>6.3} {:>6.0} | {:>8} {:>6.2} {:>6.0}{}",
        peer.map_or("none".into(), |p| p.to_string()),
        kept(&g.0),
        ratio.map_or("-".into(), |r| format!("{r:.2}")),
        g.2 / tolerance,
        g.1,
        g.0.working_bytes / triangles.max(1) as u64,
        kept(&v.0),
        v.2 / tolerance,
        v.1,
        kept(&f.0),
        f.2 / tolerance,
        f.1,
        if tiers.iter().any(|t| t.3) { "  VIOLATED" } else { "" }
    );
    Row {
        name: name.to_owned(),
        share,
        ratio,
        tightness: tolerance / g.2,
        violations: tiers.iter().filter(|t| t.3).count(),
        rates: [g.1, v.1, f.1],
    }
}

/// Draws what each tier and the peer need for the error that they really have.
fn draw(folder: &std::path::Path, quick: bool) {
    let surfaces = surfaces::generated(if quick { 24 } else { 72 });
    let (name, mesh) = surfaces.last().expect("there are some");
    let (size, welded) = (mesh.world_bounds().diagonal(), mesh.welded().mesh);
    let shares = [64.0, 128.0, 256.0, 512.0, 1024.0, 2048.0];
    // Triangles, milliseconds and true error of each tolerance.
    let points = |simplified: &dyn Fn(f64) -> TriangleMesh| {
        shares.map(|share| {
            let (simple, time) = timed(3, || simplified(size / share));
            let error = true_error(mesh, &simple, size / share) / size;
            (simple.triangles().len() as f64, time.as_secs_f64() * 1e3, error)
        })
    };
    let tier = |tier: Tier| {
        points(&|tolerance| {
            let options = SimplifyOptions::default().with_tier(tier);
            simplify(mesh, tolerance, &options).expect("the tolerance is usable").mesh
        })
    };
    let all = [
        ("guaranteed", tier(Tier::Guaranteed)),
        ("verified", tier(Tier::Verified)),
        ("fast", tier(Tier::Fast)),
        ("meshoptimizer", points(&|tolerance| peer::run(&welded, tolerance))),
    ];
    let surface = format!("{name}, {} triangles", mesh.triangles().len());
    let lines = |pick: fn(&(f64, f64, f64)) -> (f64, f64)| {
        all.each_ref().map(|(name, points)| (*name, points.iter().map(pick).collect::<Vec<_>>()))
    };
    for (file, what, lines) in [
        ("hlod-kept.svg", "triangles kept", lines(|p| (p.0, p.2))),
        ("hlod-time.svg", "CPU time, ms", lines(|p| (p.1, p.2))),
    ] {
        plot::cost(&folder.join(file), &surface, what, &lines).expect("a place to write");
    }
}

/// A certain lower bound of the two-sided distance, within 1/100 of the tolerance where halvings suffice.
pub fn true_error(a: &TriangleMesh, b: &TriangleMesh, tolerance: f64) -> f64 {
    hausdorff(a, b, &HausdorffOptions::new(0.01 * tolerance).with_max_splits(150_000)).lower
}

/// The last answer and the least CPU time of some runs.
fn timed<T>(runs: u32, work: impl Fn() -> T) -> (T, Duration) {
    let mut best = Duration::MAX;
    for _ in 1..runs {
        let start = thread_cpu_time();
        work();
        best = best.min(thread_cpu_time() - start);
    }
    let start = thread_cpu_time();
    let answer = work();
    (answer, best.min(thread_cpu_time() - start))
}

fn summary(rows: &[Row]) {
    let median = |mut v: Vec<f64>| {
        v.sort_by(f64::total_cmp);
        v.get(v.len() / 2).copied().unwrap_or(f64::NAN)
    };
    let violations: usize = rows.iter().map(|r| r.violations).sum();
    println!(
        "\nclaims above the request or below the true error: {violations} of {} (floor 0)",
        3 * rows.len()
    );
    println!(
        "requested over true error, median: {:.3} (floor 1.05, stretch 1.02)",
        median(rows.iter().map(|r| r.tightness).collect())
    );
    let ratios: Vec<f64> = rows.iter().filter_map(|r| r.ratio).collect();
    println!(
        "kept over meshoptimizer tuned in hindsight, median of {}: {:.3} (floor 0.40, stretch 0.25)",
        ratios.len(),
        median(ratios.clone())
    );
    let slowest = rows.iter().min_by(|a, b| a.rates[0].total_cmp(&b.rates[0]));
    if let Some(slowest) = slowest {
        println!(
            "guaranteed, ktri/s: median {:.0} (floor 100, stretch 250), slowest {:.0}: {} 1/{} (floor 40, stretch 100)",
            median(rows.iter().map(|r| r.rates[0]).collect()),
            slowest.rates[0],
            slowest.name,
            slowest.share
        );
    }
    for (i, (tier, floor)) in [("verified", 400), ("fast", 500)].into_iter().enumerate() {
        let rates: Vec<f64> = rows.iter().map(|r| r.rates[i + 1]).collect();
        println!("{tier}, ktri/s: median {:.0} (floor {floor})", median(rates));
    }
}
