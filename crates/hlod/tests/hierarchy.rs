//! Built hierarchies against independent measurements.

mod common;

use farsight_geometry::TriangleMesh;
use farsight_geometry::distance::{HausdorffOptions, hausdorff};
use farsight_geometry::glam::DVec3;
use farsight_hlod::{BuildOptions, HlodError, Mesh, NodeId, NodeMesh, Store, Tree, build, no_progress};
use std::path::PathBuf;

struct TempPath(PathBuf);

impl TempPath {
    fn new(name: &str) -> Self {
        Self(std::env::temp_dir().join(format!("farsight-hlod-{}-{name}.hlod", std::process::id())))
    }
}

impl Drop for TempPath {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

fn shape_only() -> BuildOptions {
    BuildOptions::default().with_appearance(false)
}

fn built(name: &str, mesh: &TriangleMesh, options: &BuildOptions) -> Store {
    let path = TempPath::new(name);
    build([Ok::<_, HlodError>(mesh)], &path.0, options, &no_progress).unwrap();
    Store::from_bytes(std::fs::read(&path.0).unwrap()).unwrap()
}

fn decoded(store: &Store, node: NodeId, mesh: Mesh) -> TriangleMesh {
    let mut out = NodeMesh::default();
    store.read(node, mesh, &mut out).unwrap();
    out.to_mesh().unwrap()
}

/// The nodes that a level consists of: those on it, and leaves above it.
fn level(tree: &Tree, level: u32) -> Vec<NodeId> {
    tree.ids().filter(|&n| tree.level(n) == level || (tree.level(n) < level && tree.is_leaf(n))).collect()
}

/// Several meshes in one.
fn joined(meshes: &[TriangleMesh]) -> TriangleMesh {
    let mut p: Vec<DVec3> = Vec::new();
    let mut t = Vec::new();
    for m in meshes {
        let base = p.len() as u32;
        p.extend(m.positions().iter().map(|q| m.origin() + q.as_dvec3()));
        t.extend(m.triangles().iter().map(|t| t.map(|v| v + base)));
    }
    TriangleMesh::from_world(&p, t).unwrap()
}

#[test]
fn every_level_is_as_near_as_its_nodes_say() {
    let options = shape_only().with_most_triangles(500);
    for (name, mesh) in common::meshes() {
        let store = built(name, &mesh, &options);
        let tree = store.tree();
        let deepest = tree.ids().map(|n| tree.level(n)).max().unwrap();
        for l in 0..=deepest {
            let nodes = level(tree, l);
            let meshes: Vec<TriangleMesh> = nodes.iter().map(|&n| decoded(&store, n, Mesh::Full)).collect();
            let claim = nodes.iter().map(|&n| tree.error(n, Mesh::Full).value).fold(0.0, f64::max);
            let whole = joined(&meshes);
            let size = mesh.world_bounds().diagonal();
            let d = hausdorff(
                &mesh,
                &whole,
                &HausdorffOptions::new(0.02 * claim.max(1e-9 * size)).with_max_splits(30_000),
            );
            let open = whole.report().border_edges;
            println!(
                "{name} {l}: {} nodes {} triangles, claim {claim:.2e}, true {:.2e}, open {open} of {}",
                nodes.len(),
                whole.triangles().len(),
                d.lower,
                mesh.report().border_edges
            );
            assert!(d.lower <= claim, "{name} level {l}: {d:?} above {claim}");
            for &n in &nodes {
                let limit = if tree.is_leaf(n) { f64::INFINITY } else { tree.edge(n) / 256.0 };
                assert!(tree.error(n, Mesh::Full).value <= limit, "{name} {n:?}");
            }
        }
    }
}
