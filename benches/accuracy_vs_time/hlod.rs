//! Simplification: tolerance and tier against true error, triangles and time.

use super::row::{Row, timed};
use farsight_geometry::TriangleMesh;
use farsight_geometry::distance::{HausdorffOptions, hausdorff};
use farsight_hlod::{SimplifyOptions, Tier, simplify};

#[path = "../peers/src/simplification/surfaces.rs"]
#[allow(dead_code)] // The sweep needs nothing but the repository.
mod surfaces;

pub fn rows(quick: bool) -> Vec<Row> {
    let n = if quick { 16 } else { 48 };
    surfaces::generated(n).iter().flat_map(|(name, mesh)| of_surface(name, mesh, quick)).collect()
}

fn of_surface(name: &str, mesh: &TriangleMesh, quick: bool) -> Vec<Row> {
    let size = mesh.world_bounds().diagonal();
    let runs = if quick { 1 } else { 3 };
    let shares: &[f64] = if quick { &[64.0, 256.0, 1024.0] } else { &[32.0, 128.0, 512.0, 2048.0] };
    let mut rows = Vec::new();
    for (knob, tier) in [("guaranteed", Tier::Guaranteed), ("verified", Tier::Verified), ("fast", Tier::Fast)]
    {
        for share in shares {
            let tolerance = size / share;
            let options = SimplifyOptions::default().with_tier(tier);
            let (simple, times) =
                timed(runs, || simplify(mesh, tolerance, &options).expect("usable tolerances"));
            let mut counters = simple.cost.counters;
            counters.add("kept", simple.mesh.triangles().len() as u64);
            rows.push(Row {
                krate: "hlod",
                scene: name.into(),
                knob: knob.into(),
                value: tolerance,
                claimed: simple.geometric,
                measured: true_error(mesh, &simple.mesh, tolerance),
                times,
                bytes: simple.cost.bytes,
                counters,
            });
        }
    }
    rows
}

/// A certain lower bound of the true distance, near it where halvings suffice.
fn true_error(a: &TriangleMesh, b: &TriangleMesh, tolerance: f64) -> f64 {
    hausdorff(a, b, &HausdorffOptions::new(0.02 * tolerance).with_max_splits(60_000)).lower
}
