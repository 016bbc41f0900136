//! Simplification by meshoptimizer, its tolerance tuned in hindsight until the true error holds.

use farsight_geometry::TriangleMesh;
use farsight_geometry::distance::{HausdorffOptions, hausdorff};
use meshopt::{SimplifyOptions, VertexDataAdapter};

/// Factors that the tolerance is tightened by.
const FACTORS: [f64; 12] = [0.7, 1.0, 1.25, 1.5, 1.75, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0];

/// The fewest triangles of all runs whose true error holds; `None` when none does.
pub fn oracle(mesh: &TriangleMesh, tolerance: f64) -> Option<usize> {
    let welded = mesh.welded().mesh;
    // Looser tolerances come first and leave fewer triangles; the first that holds is the best.
    FACTORS.iter().find_map(|f| {
        let simple = run(&welded, tolerance / f);
        // Whether the error holds: the interval need not be narrow where that is clear.
        let options = HausdorffOptions::new(0.05 * tolerance).with_max_splits(60_000);
        let d = hausdorff(mesh, &simple, &options);
        (d.lower <= tolerance).then_some(simple.triangles().len())
    })
}

/// One run with a tolerance in the units of the mesh.
pub fn run(mesh: &TriangleMesh, tolerance: f64) -> TriangleMesh {
    let indices: Vec<u32> = mesh.triangles().iter().flatten().copied().collect();
    let vertices = VertexDataAdapter::new(meshopt::typed_to_bytes(mesh.positions()), 12, 0)
        .expect("a list of positions");
    let options = SimplifyOptions::ErrorAbsolute;
    let kept = meshopt::simplify(&indices, &vertices, 0, tolerance as f32, options, None);
    let simple = TriangleMesh::from_slices(mesh.positions(), &kept).expect("indices of the input");
    simple.with_origin(mesh.origin()).expect("the input's origin")
}
