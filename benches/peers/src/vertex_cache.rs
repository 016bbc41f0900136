//! Transformed vertices as meshoptimizer counts them.

use farsight_raster::scenes::{City, Cubes, Forest, Terrain};
use farsight_timing::transformed_vertices;
use std::collections::BTreeMap;

/// Counts every mesh of the generated scenes, as it is and in meshoptimizer's best order; whether all counts agree.
pub fn report() -> bool {
    let scenes = [
        ("town", City::small().build()),
        ("forest", Forest::default().build()),
        ("cubes", Cubes::default().build()),
        ("terrain", Terrain::default().build()),
    ];
    let (mut compared, mut different) = (0, BTreeMap::new());
    for (name, scene) in scenes {
        for mesh in scene.expect("default scenes are valid").meshes() {
            let vertices = mesh.positions().len();
            let own = mesh.triangles().as_flattened().to_vec();
            let best = meshopt::optimize_vertex_cache(&own, vertices);
            for indices in [own, best] {
                for size in [16, 24, 32] {
                    let ours = transformed_vertices(&indices, vertices, size).expect("indices of a mesh");
                    let theirs =
                        meshopt::analyze_vertex_cache(&indices, vertices, size, 0, 0).vertices_transformed;
                    compared += 1;
                    if ours != u64::from(theirs) {
                        *different.entry((name, size)).or_insert(0) += 1;
                    }
                }
            }
        }
    }
    println!(
        "vertex cache of 16, 24 and 32 entries: {compared} counts compared with meshoptimizer, different: {different:?}"
    );
    different.is_empty()
}
