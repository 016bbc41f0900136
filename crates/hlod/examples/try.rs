use farsight_geometry::distance::{HausdorffOptions, hausdorff};
use farsight_hlod::*;
use farsight_hlod::glam;
fn main() {
    let dir = std::env::var("FARSIGHT_DATA").unwrap();
    let tier = match std::env::var("TIER").as_deref() { Ok("v") => Tier::Verified, Ok("f") => Tier::Fast, _ => Tier::Guaranteed };
    let look = std::env::var("LOOK").is_ok();
    let check = std::env::var("CHECK").is_ok();
    let eps: Vec<f64> = std::env::var("EPS").unwrap_or("128,512,2048".into()).split(',').map(|s| s.parse().unwrap()).collect();
    for name in std::env::args().skip(1) {
        let loaded = farsight_geometry::io::load(format!("{dir}/{name}")).unwrap();
        let mesh = loaded.into_scene().unwrap().flattened().unwrap();
        let diag = mesh.world_bounds().diagonal();
        for e in &eps {
            let tol = diag / e;
            let mesh = if look && mesh.normals().is_none() { normals(&mesh) } else { mesh.clone() };
            let cpu = || std::fs::read_to_string("/proc/thread-self/schedstat").unwrap().split(' ').next().unwrap().parse::<f64>().unwrap() * 1e-9;
            let start = cpu();
            let s = simplify(&mesh, tol, &SimplifyOptions::default().with_tier(tier).with_appearance(look)).unwrap();
            let t = cpu() - start;
            print!("{name:20} 1/{e:<5} {:6} -> {:6}  claim/eps {:.4}  {:6.1} ktri/s  ", mesh.triangles().len(), s.mesh.triangles().len(), s.geometric.value / tol, mesh.triangles().len() as f64 / t / 1e3);
            if check {
                let h = hausdorff(&mesh, &s.mesh, &HausdorffOptions::new(tol * 1e-3).with_max_splits(3_000_000));
                print!("true/eps [{:.4} {:.4}] fwd {:.4} back {:.4} {}", h.lower / tol, h.upper / tol, h.forward.lower / tol, h.backward.lower / tol, if h.lower > s.geometric.value { "VIOLATION" } else { "ok" });
            }
            println!();
            if std::env::var("REPORT").is_ok() { println!("   {} look {:?}", s.mesh.report(), s.appearance.map(|a| a.value / tol)); }
            if std::env::var("COUNTS").is_ok() { println!("   {}", s.cost.counters); }
        }
    }
}

fn normals(mesh: &farsight_geometry::TriangleMesh) -> farsight_geometry::TriangleMesh {
    let w = mesh.welded();
    let mut n = vec![glam::Vec3::ZERO; w.mesh.positions().len()];
    for (t, c) in w.mesh.triangles().iter().zip(w.mesh.corner_iter()) {
        let x = (c[1] - c[0]).cross(c[2] - c[0]);
        for &v in t { n[v as usize] += x; }
    }
    w.mesh.with_normals(n.into_iter().map(|n| n.normalize_or_zero()).collect()).unwrap()
}
