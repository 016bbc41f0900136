//! Hierarchies: how fast they are built, how much memory and disk that takes, how fast nodes are decoded, what a camera path draws.
//!
//! ```text
//! cargo bench --bench hlod                      everything; 20 M triangles where memory is measured
//! cargo bench --bench hlod -- --quick           small surfaces
//! cargo bench --bench hlod -- --only build      one part: build, resolution, certify, threads, levels, points, memory, path
//! ```
//!
//! With `FARSIGHT_DATA` set, scanned surfaces are built as well.

mod path;
mod points;
mod resolution;
mod shadows;

use farsight_geometry::glam::Vec3;
use farsight_geometry::{TriangleMesh, hard_cases, io};
use farsight_hlod::{
    BuildOptions, BuildReport, HlodError, Mesh, NodeMesh, SimplifyOptions, Splats, Store, Tier, build,
    certify, no_progress, simplify,
};
use farsight_raster::thread_cpu_time;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;

type Outcome = Result<(), Box<dyn Error>>;

fn main() -> Outcome {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if arguments.first().is_some_and(|a| a == "--child") {
        return child(arguments[1].parse()?, &arguments[2]);
    }
    let quick = arguments.iter().any(|a| a == "--quick");
    let only = arguments.iter().position(|a| a == "--only").and_then(|i| arguments.get(i + 1));
    let wanted = |part: &str| only.is_none_or(|o| o == part);
    if wanted("build") {
        rates(quick)?;
    }
    if wanted("resolution") {
        resolution::table(quick)?;
    }
    if wanted("certify") {
        certification(quick)?;
    }
    if wanted("threads") {
        threads(quick)?;
    }
    if wanted("levels") {
        shape_of_levels(quick)?;
    }
    if wanted("points") {
        points_on_disk(quick)?;
    }
    if wanted("memory") {
        memory(if quick { &[200_000] } else { &[2_000_000, 20_000_000] })?;
    }
    if wanted("path") {
        path::tables(quick)?;
    }
    Ok(())
}

fn temp(name: &str) -> PathBuf {
    std::env::temp_dir().join(format!("farsight-bench-{}-{name}.hlod", std::process::id()))
}

/// A ball with wrinkles of several sizes, `12 n²` triangles, with normals.
fn generated(n: u32) -> TriangleMesh {
    let ball = hard_cases::bumpy_ball(n);
    let wrinkled = |p: &Vec3| {
        let fine = 0.02 * (23.0 * p.x + 9.0 * p.y).sin() * (19.0 * p.z).cos();
        *p * (1.0 + fine + 0.004 * (61.0 * p.y).sin() * (57.0 * p.x).cos())
    };
    let p = ball.positions().iter().map(wrinkled).collect();
    with_normals(&TriangleMesh::new(p, ball.triangles().to_vec()).expect("a ball"))
}

fn with_normals(mesh: &TriangleMesh) -> TriangleMesh {
    let welded = mesh.welded().mesh;
    let mut sums = vec![Vec3::ZERO; welded.positions().len()];
    for (t, [a, b, c]) in welded.triangles().iter().zip(welded.corner_iter()) {
        t.iter().for_each(|&v| sums[v as usize] += (b - a).cross(c - a));
    }
    let normals = sums.iter().map(|n| n.normalize_or_zero()).collect();
    welded.with_normals(normals).expect("finite normals")
}

fn surfaces(quick: bool) -> Result<Vec<(String, TriangleMesh)>, Box<dyn Error>> {
    let mut all = vec![("wrinkled ball".to_owned(), generated(if quick { 30 } else { 120 }))];
    all.extend(scanned(
        quick,
        &["stanford_bunny.obj", "igea.glb", "armadillo.obj", "lucy.glb", "lion_statue.obj"],
    )?);
    Ok(all)
}

/// Surfaces from the data folder, with normals.
fn scanned(quick: bool, names: &[&str]) -> Result<Vec<(String, TriangleMesh)>, Box<dyn Error>> {
    let mut all = Vec::new();
    let Some(folder) = std::env::var_os("FARSIGHT_DATA").filter(|_| !quick) else { return Ok(all) };
    for name in names {
        let path = Path::new(&folder).join(name);
        if path.exists() {
            let scene = io::load(&path)?.into_scene().ok_or("no triangles")?;
            all.push((name.split('.').next().unwrap_or(name).into(), with_normals(&scene.flattened()?)));
        }
    }
    Ok(all)
}

fn built(mesh: &TriangleMesh, path: &Path, options: &BuildOptions) -> Result<BuildReport, HlodError> {
    build([Ok::<_, HlodError>(mesh)], path, options, &no_progress)
}

/// Rates, bytes, levels.
fn rates(quick: bool) -> Outcome {
    println!(
        "build on one thread (CPU time), bytes a triangle of the input over all levels, decoding with and without attributes"
    );
    println!(
        "floors: 50 ktri/s guaranteed, 200 fast; 2.0 B geometric, 4.0 with appearance; 50 Mtri/s decoded\n"
    );
    println!(
        "{:<16} {:>9} {:<22} {:>8} {:>8} {:>7} {:>9} {:>7}",
        "surface", "triangles", "meshes", "ktri/s", "B/tri", "nodes", "Mtri/s", "joined"
    );
    let path = temp("rates");
    for (name, mesh) in surfaces(quick)? {
        for (what, tier, appearance) in [
            ("shape, guaranteed", Tier::Guaranteed, false),
            ("shape, verified", Tier::Verified, false),
            ("shape, fast", Tier::Fast, false),
            ("looks, guaranteed", Tier::Guaranteed, true),
        ] {
            let options = BuildOptions::default().with_threads(1).with_tier(tier).with_appearance(appearance);
            let start = thread_cpu_time();
            let report = built(&mesh, &path, &options)?;
            let seconds = (thread_cpu_time() - start).as_secs_f64();
            let store = Store::open(&path)?;
            println!(
                "{name:<16} {:>9} {what:<22} {:>8.1} {:>8.2} {:>7} {:>9.1} {:>7}",
                report.triangles,
                report.triangles as f64 / seconds / 1e3,
                report.bytes as f64 / report.triangles as f64,
                store.tree().ids().len(),
                decode_rate(&store)?,
                report.joined
            );
            if tier == Tier::Guaranteed {
                levels(&report, &store)?;
            }
        }
    }
    std::fs::remove_file(&path)?;
    Ok(())
}

/// Triangles per node by level, as in table 2 of the paper.
fn levels(report: &BuildReport, store: &Store) -> Outcome {
    let tree = store.tree();
    for (level, l) in report.levels.iter().enumerate() {
        let (mut points, mut left, mut splats, mut mesh) = (0, 0, Splats::default(), NodeMesh::default());
        for n in tree.ids().filter(|&n| tree.level(n) as usize == level) {
            store.read(n, Mesh::Full, &mut mesh)?;
            splats.fill(&mesh, tree.error(n, Mesh::Full).value);
            points += splats.positions.len() as u64;
            left += splats.indices.len() as u64 / 3;
        }
        println!(
            "    level {level}: {:>5} nodes ({} leaves), a node: {:>6} triangles, as {:>6} and {:>6} points; shape {:>6}",
            l.nodes,
            l.leaves,
            l.triangles / l.nodes,
            left / l.nodes,
            points / l.nodes,
            l.shape_triangles / l.nodes
        );
    }
    Ok(())
}

/// Triangles decoded in a second of CPU time, in millions: reading from the page cache included.
fn decode_rate(store: &Store) -> Result<f64, Box<dyn Error>> {
    let mut mesh = NodeMesh::default();
    let mut best = 0.0f64;
    for _ in 0..5 {
        let (start, mut triangles) = (thread_cpu_time(), 0);
        for node in store.tree().ids() {
            store.read(node, Mesh::Full, &mut mesh)?;
            triangles += mesh.indices.len() / 3;
        }
        best = best.max(triangles as f64 / (thread_cpu_time() - start).as_secs_f64() / 1e6);
    }
    Ok(best)
}

/// Triangles of the original per second of CPU time, for given pairs; nothing else is in it.
fn certification(quick: bool) -> Outcome {
    println!(
        "\ncertifying a given pair, both directions, at 1/512 of the diagonal (floor 1 M triangles/s); prepared: sorted, neighbours found"
    );
    println!(
        "{:<16} {:>9} {:>9} {:>10} {:>9} {:>9} {:>12}",
        "surface", "triangles", "faces", "Mtri/s", "measured", "visits", "bound/asked"
    );
    for (name, mesh) in surfaces(quick)? {
        let tolerance = mesh.world_bounds().diagonal() / 512.0;
        let options = SimplifyOptions::default().with_tier(Tier::Verified).with_appearance(false);
        let simple = simplify(&mesh, tolerance, &options)?.mesh;
        let (mut best, mut found) = (f64::INFINITY, None);
        for _ in 0..5 {
            let start = thread_cpu_time();
            found = Some(certify(&mesh, &simple, tolerance)?);
            best = best.min((thread_cpu_time() - start).as_secs_f64());
        }
        let found = found.ok_or("no run")?;
        println!(
            "{name:<16} {:>9} {:>9} {:>10.2} {:>9} {:>9} {:>12.3}",
            mesh.triangles().len(),
            simple.triangles().len(),
            mesh.triangles().len() as f64 / best / 1e6,
            found.measured,
            found.cost.counters.get("visits"),
            found.bound.value / tolerance
        );
    }
    Ok(())
}

fn threads(quick: bool) -> Outcome {
    let mesh = generated(if quick { 40 } else { 140 });
    let path = temp("threads");
    let mut seconds = [0.0; 2];
    for (i, s) in seconds.iter_mut().enumerate() {
        let options = BuildOptions::default().with_appearance(false).with_threads(i + 1);
        let start = Instant::now();
        built(&mesh, &path, &options)?;
        *s = start.elapsed().as_secs_f64();
    }
    println!(
        "\ntwo threads: {:.2} s instead of {:.2} s, {:.2} times as fast (floor 1.7)",
        seconds[1],
        seconds[0],
        seconds[0] / seconds[1]
    );
    std::fs::remove_file(&path)?;
    Ok(())
}

/// Height of a square kilometre.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Ground {
    /// Waves of three lengths.
    Smooth,
    /// Waves down to 16 triangles long, each half as high as those twice as long: alike at all sizes, as scanned surfaces are, and oversampled as they are.
    Alike,
}

impl Ground {
    fn height(self, x: f32, y: f32, spacing: f32) -> f32 {
        match self {
            Self::Smooth => {
                20.0 * (0.011 * x).sin() * (0.013 * y).cos()
                    + 2.0 * (0.09 * x + 0.05 * y).sin()
                    + 0.05 * (0.9 * x).sin() * (1.1 * y).cos()
            }
            Self::Alike => {
                let lengths = (0..).map(|k| 600.0 / (1u32 << k) as f32).take_while(|l| *l > 16.0 * spacing);
                let wave = |(k, length): (u32, f32)| {
                    let turn = (2.4 * k as f32).sin_cos();
                    let (u, v) = (x * turn.0 + y * turn.1, y * turn.0 - x * turn.1);
                    let f = std::f32::consts::TAU / length;
                    0.05 * length * (f * u + k as f32).sin() * (f * v).cos()
                };
                (0..).zip(lengths).map(wave).sum()
            }
        }
    }
}

/// Strips of a square kilometre with normals, made one after the other.
fn strips(count: u64, ground: Ground) -> impl Iterator<Item = Result<TriangleMesh, HlodError>> {
    let n = (count as f64 / 2.0).sqrt() as u32;
    let rows = (30_000 / n).max(1);
    let spacing = 1000.0 / n as f32;
    (0..n.div_ceil(rows)).map(move |strip| {
        let (first, last) = (strip * rows, ((strip + 1) * rows).min(n));
        let at = |i: u32| i as f32 * spacing;
        let height = |x: f32, y: f32| ground.height(x, y, spacing);
        let p = || (first..=last).flat_map(|j| (0..=n).map(move |i| (at(i), at(j))));
        let slope = |x: f32, y: f32| {
            let across =
                |dx: f32, dy: f32| (height(x + dx, y + dy) - height(x - dx, y - dy)) / (2.0 * spacing);
            Vec3::new(-across(spacing, 0.0), -across(0.0, spacing), 1.0).normalize()
        };
        let normals = p().map(|(x, y)| slope(x, y)).collect();
        let p = p().map(|(x, y)| Vec3::new(x, y, height(x, y))).collect();
        let row = n + 1;
        let quads = (0..last - first).flat_map(|j| (0..n).map(move |i| j * row + i));
        let t = quads.flat_map(|a| [[a, a + 1, a + row + 1], [a, a + row + 1, a + row]]).collect();
        Ok(TriangleMesh::new(p, t)?.with_normals(normals)?)
    })
}

/// Table 2: levels of surfaces that are alike at all sizes.
fn shape_of_levels(quick: bool) -> Outcome {
    println!(
        "\ntable 2: triangles and points a node by level, verified, generated ground that is alike at all sizes"
    );
    let path = temp("levels");
    let counts: [(u64, bool); 2] =
        if quick { [(60_000, false), (20_000, true)] } else { [(2_000_000, false), (400_000, true)] };
    for (count, appearance) in counts {
        let options = BuildOptions::default().with_tier(Tier::Verified).with_appearance(appearance);
        let report = build(strips(count, Ground::Alike), &path, &options, &no_progress)?;
        println!("{} triangles, {}", report.triangles, if appearance { "with normals" } else { "shape" });
        levels(&report, &Store::open(&path)?)?;
    }
    std::fs::remove_file(&path)?;
    Ok(())
}

fn child(count: u64, tier: &str) -> Outcome {
    let tier = if tier == "guaranteed" { Tier::Guaranteed } else { Tier::Verified };
    let path = temp("memory");
    let options = BuildOptions::default().with_appearance(false).with_tier(tier).with_threads(1);
    let start = thread_cpu_time();
    let report = build(strips(count, Ground::Smooth), &path, &options, &no_progress)?;
    let seconds = (thread_cpu_time() - start).as_secs_f64();
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak =
        status.lines().find_map(|l| l.strip_prefix("VmHWM:")?.split_whitespace().next()?.parse::<f64>().ok());
    println!(
        "{:>11} triangles: {:>6.0} MB at most, {:>6.1} ktri/s, {:.2} B/tri, {} levels, root {} triangles",
        report.triangles,
        peak.unwrap_or(f64::NAN) / 1024.0,
        report.triangles as f64 / seconds / 1e3,
        report.bytes as f64 / report.triangles as f64,
        report.levels.len(),
        report.levels[0].triangles
    );
    std::fs::remove_file(&path)?;
    Ok(())
}

/// Points in place of small triangles: made when a node is loaded, or stored instead of those triangles?
fn points_on_disk(quick: bool) -> Outcome {
    println!(
        "\npoints of all inner nodes: made of decoded triangles, or stored in place of them (an octree's occupancy and differences of normals, at their entropy)"
    );
    println!(
        "{:<16} {:>9} {:>9} {:>9} {:>12} {:>12} {:>13} {:>13}",
        "surface",
        "triangles",
        "replaced",
        "points",
        "made, ns/tri",
        "read, ns/tri",
        "replaced, kB",
        "points, kB"
    );
    let path = temp("points");
    for (name, mesh) in
        surfaces(quick)?.into_iter().filter(|(name, _)| !matches!(&name[..], "lucy" | "lion_statue"))
    {
        built(&mesh, &path, &BuildOptions::default().with_tier(Tier::Verified))?;
        let store = Store::open(&path)?;
        let tree = store.tree();
        let (mut triangles, mut replaced, mut made, mut replaced_bytes, mut bits) = (0, 0, 0, 0.0, 0.0);
        let (mut reading, mut making) = (0.0, 0.0);
        let (mut node, mut splats) = (NodeMesh::default(), Splats::default());
        for n in tree.ids().filter(|&n| !tree.is_leaf(n)) {
            let start = thread_cpu_time();
            store.read(n, Mesh::Full, &mut node)?;
            reading += (thread_cpu_time() - start).as_secs_f64();
            let reach = tree.error(n, Mesh::Full).value;
            let start = thread_cpu_time();
            splats.fill(&node, reach);
            making += (thread_cpu_time() - start).as_secs_f64();
            let (all, left) = (node.indices.len() / 3, splats.indices.len() / 3);
            (triangles, replaced, made) =
                (triangles + all, replaced + all - left, made + splats.positions.len());
            replaced_bytes += tree.disk_bytes(n, Mesh::Full) as f64 * (all - left) as f64 / all.max(1) as f64;
            bits += points::stored_bits(&splats.positions, &splats.normals, (0.5 * reach) as f32);
        }
        let each = |seconds: f64| 1e9 * seconds / triangles as f64;
        println!(
            "{name:<16} {triangles:>9} {replaced:>9} {made:>9} {:>12.0} {:>12.0} {:>13.1} {:>13.1}",
            each(making),
            each(reading),
            replaced_bytes / 1e3,
            bits / 8e3
        );
    }
    std::fs::remove_file(&path)?;
    Ok(())
}

/// Peak memory in processes of their own.
fn memory(counts: &[u64]) -> Outcome {
    println!(
        "\npeak memory (of the whole process), verified tier, generated terrain; floors: 256 MB for 2 M, 512 MB for 20 M"
    );
    for count in counts {
        std::process::Command::new(std::env::current_exe()?)
            .args(["--child", &count.to_string(), "verified"])
            .status()?;
    }
    Ok(())
}
