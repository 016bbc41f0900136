use farsight_geometry::glam::*;
use farsight_geometry::{TriangleMesh, io};
use farsight_hlod::*;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let mut mesh = if a[1].starts_with("ball") {
        farsight_geometry::hard_cases::bumpy_ball(a[1][4..].parse().unwrap())
    } else {
        io::load(std::path::Path::new(&a[1])).unwrap().into_scene().unwrap().flattened().unwrap()
    };
    let w = mesh.welded();
    let looks = a[2].contains('a');
    let mut sums = vec![Vec3::ZERO; w.mesh.positions().len()];
    for (t, [x, y, z]) in w.mesh.triangles().iter().zip(w.mesh.corner_iter()) {
        let n = (y - x).cross(z - x);
        t.iter().for_each(|&v| sums[v as usize] += n);
    }
    mesh = w.mesh.with_normals(sums.iter().map(|n| n.normalize_or_zero()).collect()).unwrap();
    let tier = if a[2].contains('v') {
        Tier::Verified
    } else if a[2].contains('f') {
        Tier::Fast
    } else {
        Tier::Guaranteed
    };
    let res: f64 = a.get(3).map_or(256.0, |s| s.parse().unwrap());
    let threads = a.get(4).map_or(1, |s| s.parse().unwrap());
    let o = BuildOptions::default()
        .with_appearance(looks)
        .with_tier(tier)
        .with_resolution(res)
        .with_threads(threads);
    let path = std::env::temp_dir().join("probe.hlod");
    let t0 = std::time::Instant::now();
    let r = build([Ok::<_, HlodError>(&mesh)], &path, &o, &no_progress).unwrap();
    let s = t0.elapsed().as_secs_f64();
    println!(
        "{} tris {:.2} s {:.1} ktri/s; {} bytes {:.2} B/tri (shape twin {:.2}) joined {}",
        r.triangles,
        s,
        r.triangles as f64 / s / 1e3,
        r.bytes,
        r.bytes as f64 / r.triangles as f64,
        r.shape_bytes as f64 / r.triangles as f64,
        r.joined
    );
    for (i, l) in r.levels.iter().enumerate() {
        println!(
            "  {i}: nodes {} leaves {} tris {} ({}/node, shape {}/node) {:.2} B/tri err {:.2e}",
            l.nodes,
            l.leaves,
            l.triangles,
            l.triangles / l.nodes,
            l.shape_triangles / l.nodes,
            l.bytes as f64 / l.triangles as f64,
            l.error
        );
    }
    let store = Store::open(&path).unwrap();
    let tree = store.tree();
    for lev in 0..r.levels.len() as u32 {
        let mut p: Vec<DVec3> = vec![];
        let mut t: Vec<[u32; 3]> = vec![];
        let mut m = NodeMesh::default();
        let mut rims = 0;
        for n in tree.ids().filter(|&n| tree.level(n) == lev || tree.level(n) < lev && tree.is_leaf(n)) {
            store.read(n, Mesh::Full, &mut m).unwrap();
            rims += m.rims.len();
            let b = p.len() as u32;
            p.extend(m.positions.iter().map(|q| m.origin + q.as_dvec3()));
            t.extend(m.indices.as_chunks::<3>().0.iter().map(|t| t.map(|v| v + b)));
        }
        let mm = TriangleMesh::from_world(&p, t).unwrap();
        let rep = mm.report();
        println!(
            "  level {lev}: {} tris, open {} rims {} (input border {})",
            mm.triangles().len(),
            rep.border_edges,
            rims,
            mesh.report().border_edges
        );
    }
    // decode speed
    let mut m = NodeMesh::default();
    let mut n = 0u64;
    let t0 = std::time::Instant::now();
    for _ in 0..5 {
        for id in tree.ids() {
            store.read(id, Mesh::Full, &mut m).unwrap();
            n += m.indices.len() as u64 / 3;
        }
    }
    println!("  decode {:.1} Mtri/s", n as f64 / t0.elapsed().as_secs_f64() / 1e6);
}
