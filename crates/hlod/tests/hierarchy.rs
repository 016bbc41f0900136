//! Built hierarchies against independent measurements.

mod common;

use farsight_geometry::distance::{HausdorffOptions, Surface, hausdorff, one_sided};
use farsight_geometry::glam::DVec3;
use farsight_geometry::{TriangleMesh, hard_cases};
use farsight_hlod::{BuildOptions, HlodError, Mesh, NodeId, NodeMesh, Store, Tier, Tree, build, no_progress};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, Ordering};

struct TempPath(PathBuf);

impl TempPath {
    fn new(name: &str) -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let file = format!("farsight-hlod-{}-{number}-{name}.hlod", std::process::id());
        Self(std::env::temp_dir().join(file))
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

/// The drawn surface of a level, and the largest error that its nodes claim.
fn surface(store: &Store, nodes: &[NodeId], mesh: Mesh) -> (TriangleMesh, f64) {
    let meshes: Vec<TriangleMesh> = nodes.iter().map(|&n| decoded(store, n, mesh)).collect();
    let claim = nodes.iter().map(|&n| store.tree().error(n, mesh).value).fold(0.0, f64::max);
    (joined(&meshes), claim)
}

fn check_levels(name: &str, mesh: &TriangleMesh, store: &Store, which: Mesh, resolution: f64) {
    let tree = store.tree();
    let deepest = tree.ids().map(|n| tree.level(n)).max().unwrap_or(0);
    let size = mesh.world_bounds().diagonal();
    for l in 0..=deepest {
        let nodes = level(tree, l);
        let (whole, claim) = surface(store, &nodes, which);
        let measure = HausdorffOptions::new(0.02 * claim.max(1e-9 * size)).with_max_splits(12_000);
        let d = hausdorff(mesh, &whole, &measure);
        assert!(d.lower <= claim, "{name} level {l} {which:?}: {d:?} above {claim}");
        for &n in nodes.iter().filter(|&&n| !tree.is_leaf(n)) {
            assert!(tree.error(n, which).value <= tree.edge(n) / resolution, "{name} {n:?}");
        }
    }
}

#[test]
fn every_level_is_as_near_as_its_nodes_say() {
    for tier in [Tier::Guaranteed, Tier::Verified] {
        let options = shape_only().with_most_triangles(500).with_tier(tier);
        for (name, mesh) in common::meshes() {
            check_levels(name, &mesh, &built(name, &mesh, &options), Mesh::Full, 256.0);
        }
    }
}

#[test]
fn every_node_lies_on_the_input_and_the_input_of_its_cell_on_it() {
    let mesh = hard_cases::bumpy_ball(30);
    let store = built("nodes", &mesh, &shape_only().with_most_triangles(500));
    let tree = store.tree();
    for n in tree.ids() {
        let error = tree.error(n, Mesh::Full).value;
        let part = decoded(&store, n, Mesh::Full);
        let options = HausdorffOptions::new(0.05 * error).with_max_splits(20_000);
        assert!(one_sided(&part, &Surface::new(&mesh), &options).lower <= error);
        // What of the input is in the cell: the leaves below it, which differ from it by their own errors.
        let mut below = vec![n];
        let mut leaves = Vec::new();
        while let Some(n) = below.pop() {
            below.extend(tree.children(n));
            if tree.is_leaf(n) {
                leaves.push(n);
            }
        }
        let (input, slack) = surface(&store, &leaves, Mesh::Full);
        let d = one_sided(&input, &Surface::new(&part), &options);
        assert!(d.lower <= error + slack, "{n:?}: {d:?} above {error}");
        assert!(tree.bounds(n).contains_box(&part.world_bounds()));
        assert!(tree.children(n).all(|c| tree.bounds(n).contains_box(&tree.bounds(c))));
    }
}

#[test]
fn closed_surfaces_have_closed_roots() {
    for (name, mesh) in [("ball", hard_cases::bumpy_ball(40)), ("rod", common::rod(48, 60))] {
        for tier in [Tier::Guaranteed, Tier::Verified] {
            let store = built(name, &mesh, &shape_only().with_most_triangles(600).with_tier(tier));
            let tree = store.tree();
            assert!(tree.ids().len() > 9);
            let root = decoded(&store, NodeId(0), Mesh::Full);
            let open = root.report().border_edges;
            println!("{name} {tier:?}: {open} open sides of {} triangles", root.triangles().len());
            // A crack may stay here and there rather than move a triangle too far.
            assert!(
                open * 50 <= 3 * root.triangles().len(),
                "{name} {tier:?}: {open} of {}",
                root.triangles().len()
            );
            assert!(root.triangles().len() * 2 < mesh.triangles().len());
        }
    }
}

#[test]
fn leaves_have_the_area_of_the_input_and_can_be_as_exact_as_wanted() {
    for (name, mesh) in common::meshes() {
        let size = mesh.world_bounds().diagonal();
        let options = shape_only().with_most_triangles(500).with_precision(1e-6 * size);
        let store = built(name, &mesh, &options);
        let tree = store.tree();
        let leaves: Vec<NodeId> = tree.ids().filter(|&n| tree.is_leaf(n)).collect();
        let (whole, claim) = surface(&store, &leaves, Mesh::Full);
        assert!(claim <= 1.2e-6 * size, "{name}: {claim}");
        assert!((whole.area() / mesh.area() - 1.0).abs() < 1e-3, "{name}");
    }
}

#[test]
fn clouds_of_leaves_are_thinned_within_the_bound_and_keep_their_area() {
    let mesh = common::leaves(8000, 0.006);
    let options = shape_only().with_most_triangles(2000).with_resolution(16.0);
    for tier in [Tier::Guaranteed, Tier::Fast] {
        let store = built("leaves", &mesh, &options.with_tier(tier));
        if tier == Tier::Guaranteed {
            check_levels("leaves", &mesh, &store, Mesh::Full, 16.0);
        }
        let root = decoded(&store, NodeId(0), Mesh::Full);
        assert!(root.triangles().len() * 3 < mesh.triangles().len(), "{}", root.triangles().len());
        let area = root.area() / mesh.area();
        assert!((0.75..1.25).contains(&area), "{area}");
    }
}

#[test]
fn shapes_cost_less_than_looks_and_both_hold() {
    let ball = hard_cases::bumpy_ball(24);
    let normals = ball.positions().iter().map(|p| p.normalize()).collect();
    let colours =
        ball.positions().iter().map(|p| if p.x > 0.1 { [200, 30, 30, 255] } else { [20, 90, 200, 255] });
    let mesh = ball.clone().with_colours(colours.collect()).unwrap().with_normals(normals).unwrap();
    let options = BuildOptions::default().with_most_triangles(1000);
    let usual = built("usual", &mesh, &options);
    assert_eq!(usual.tree().resolution(), 128.0);
    check_levels("usual", &mesh, &usual, Mesh::Full, 128.0);
    let store = built("looks", &mesh, &options.with_resolution(256.0));
    let tree = store.tree();
    for which in [Mesh::Full, Mesh::Shape] {
        check_levels("looks", &mesh, &store, which, 256.0);
    }
    for n in tree.ids() {
        assert!(tree.triangles(n, Mesh::Shape) <= tree.triangles(n, Mesh::Full));
        assert!(tree.is_leaf(n) || tree.look_error(n).unwrap().value <= tree.edge(n) / 256.0);
        let part = decoded(&store, n, Mesh::Full);
        for (p, (n, c)) in
            part.positions().iter().zip(part.normals().unwrap().iter().zip(part.colours().unwrap()))
        {
            let p = (part.origin() + p.as_dvec3()).as_vec3();
            assert!(n.angle_between(p.normalize()) < 0.15, "{n} at {p}");
            assert!((p.x - 0.1).abs() < 0.15 || (c[0] > 100) == (p.x > 0.1), "{c:?} at {p}");
        }
        assert!(decoded(&store, n, Mesh::Shape).normals().is_none());
    }
}
