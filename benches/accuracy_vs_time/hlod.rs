//! Simplification: tolerance and tier against true error, triangles and time. Hierarchies: pixels against true pixels, triangles and the time to choose and decode.

use super::row::{Row, timed};
use farsight_geometry::accuracy::Counters;
use farsight_geometry::distance::{HausdorffOptions, Surface, hausdorff};
use farsight_geometry::glam::{DVec3, dvec3};
use farsight_geometry::{Camera, Frustum, TriangleMesh};
use farsight_hlod::{
    BuildOptions, HlodError, Mesh, NodeMesh, Selection, Selector, SimplifyOptions, Store, Tier, ViewOptions,
    build, no_progress, simplify,
};

#[path = "../peers/src/simplification/surfaces.rs"]
#[allow(dead_code)] // The sweep needs nothing but the repository.
mod surfaces;

pub fn rows(quick: bool) -> Vec<Row> {
    let n = if quick { 16 } else { 48 };
    let surfaces = surfaces::generated(n);
    let mut rows: Vec<Row> = surfaces.iter().flat_map(|(name, mesh)| of_surface(name, mesh, quick)).collect();
    for (name, mesh) in &surfaces[..2] {
        rows.extend(of_hierarchy(name, mesh, quick));
    }
    rows
}

/// A view of a hierarchy, from coarse to fine.
fn of_hierarchy(name: &str, mesh: &TriangleMesh, quick: bool) -> Vec<Row> {
    let path = std::env::temp_dir().join(format!("farsight-sweep-{}.hlod", std::process::id()));
    let options = BuildOptions::default().with_appearance(false).with_most_triangles(1000).with_threads(1);
    build([Ok::<_, HlodError>(mesh)], &path, &options, &no_progress).expect("a surface");
    let store = Store::open(&path).expect("just built");
    let bounds = mesh.world_bounds();
    let eye = bounds.center() + dvec3(0.3, -0.9, 0.5).normalize() * 0.8 * bounds.diagonal();
    let camera = Camera::look_at(eye, bounds.center(), DVec3::Z).expect("a view");
    let mut rows = Vec::new();
    for px in [16.0, 8.0, 4.0, 2.0, 1.0] {
        let frame = || {
            let mut selection = Selection::default();
            Selector::new().select(store.tree(), &camera, &ViewOptions::error(px), |_| true, &mut selection);
            let mut node = NodeMesh::default();
            for d in &selection.drawn {
                store.read(d.node, Mesh::Full, &mut node).expect("just built");
            }
            selection
        };
        let (selection, times) = timed(if quick { 3 } else { 9 }, frame);
        let mut counters = Counters::new();
        counters.add("nodes", selection.drawn.len() as u64);
        counters.add("drawn", selection.triangles);
        rows.push(Row {
            krate: "hlod",
            scene: format!("{name} on disk"),
            knob: "view".into(),
            value: px,
            claimed: selection.geometric.expect("a selection"),
            measured: true_pixels(mesh, &store, &selection, &camera),
            times,
            bytes: selection.bytes,
            counters,
        });
    }
    std::fs::remove_file(&path).expect("a file");
    rows
}

/// How many pixels a vertex of the input in view is from the nearest drawn point, at most.
fn true_pixels(mesh: &TriangleMesh, store: &Store, selection: &Selection, camera: &Camera) -> f64 {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    let mut node = NodeMesh::default();
    for d in &selection.drawn {
        store.read(d.node, Mesh::Full, &mut node).expect("just built");
        let base = positions.len() as u32;
        positions.extend(node.positions.iter().map(|p| node.origin + p.as_dvec3()));
        triangles.extend(node.indices.as_chunks::<3>().0.iter().map(|t| t.map(|v| v + base)));
    }
    let drawn = Surface::new(&TriangleMesh::from_world(&positions, triangles).expect("drawn nodes"));
    let frustum = Frustum::from_camera(camera);
    let vertices = mesh.positions().iter().map(|p| mesh.origin() + p.as_dvec3());
    let off = |p: DVec3| {
        let to = drawn.nearest(p)?.point;
        Some(camera.project(p)?.0.distance(camera.project(to)?.0))
    };
    vertices.filter(|&p| frustum.contains(p)).filter_map(off).fold(0.0, f64::max)
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
