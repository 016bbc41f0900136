//! One tree in memory: how fast, how large, beside the published one; and what happens to odd sets.

use crate::child;
use crate::data;
use farsight_geometry::glam::DVec3;
use farsight_points::{
    BuildOptions, Grid, Input, Mospt, MosptOptions, NodeData, Point, Spt, Store, build, no_progress,
};
use std::collections::HashMap;
use std::error::Error;
use std::time::Instant;

/// The number of points of the chapter's single scan.
pub const SCAN: u64 = 6_609_305;

fn grid() -> Grid {
    let street = data::street(1);
    Grid::new(DVec3::splat(0.001), street.offset).expect("a usable grid")
}

pub fn scan(count: u64) -> Result<Vec<Point>, Box<dyn Error>> {
    let grid = grid();
    let mut street = data::street(count);
    street.station_spacing = 100.0;
    let point = |p: farsight_raster::scenes::ScanPoint| Some(Point::new(grid.nearest(p.position)?, p.colour));
    Ok(street.points()?.filter_map(point).collect())
}

/// Speed and memory of one tree; runs in a process of its own.
pub fn child(count: u64) -> Result<(), Box<dyn Error>> {
    let points = scan(count)?;
    let before = child::peak_mib();
    for threads in [1, 2] {
        let mut options = MosptOptions::default();
        options.threads = threads;
        let mut runs = Vec::new();
        for _ in 0..5 {
            let (cpu, start) = (child::cpu_seconds(), Instant::now());
            let tree = Mospt::build(grid(), &points, &options)?;
            runs.push((start.elapsed().as_secs_f64(), child::cpu_seconds() - cpu, tree.prefix().len()));
        }
        runs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (wall, cpu, levels) = runs[2];
        let rate = |s: f64| count as f64 / s * 1e-6;
        println!(
            "  {threads} threads: {wall:.2} s = {:.1} M/s, {cpu:.2} CPU-s = {:.1} M/CPU-s, {levels} levels (floor: 8 M/s with two)",
            rate(wall),
            rate(cpu)
        );
    }
    let peak = child::peak_mib();
    println!(
        "  peak {:.1} bytes a point, input of 16 included (floor: 64)",
        (peak - before) * 1048576.0 / count as f64 + 16.0
    );
    Ok(())
}

pub fn report(quick: bool) -> Result<(), Box<dyn Error>> {
    let count = if quick { 500_000 } else { SCAN };
    println!("\none tree in memory, {count} points");
    let run =
        std::process::Command::new(std::env::current_exe()?).args(["--core", &count.to_string()]).output()?;
    print!("{}{}", String::from_utf8_lossy(&run.stdout), String::from_utf8_lossy(&run.stderr));
    let points = scan(count)?;
    let tree = Mospt::build(grid(), &points, &MosptOptions::default())?;
    println!("  prefix {:?}", tree.prefix());
    let spt = Spt::build(&grid(), &points);
    let (ours, theirs) = (size_of_val(tree.points()) + size_of_val(tree.prefix()), size_of_val(spt.nodes()));
    println!(
        "  {:.1} MB; published {:.1} MB with {} inner nodes ({:.3} a point): +{:.1} % (floor: +125 to 130 %)",
        ours as f64 * 1e-6,
        theirs as f64 * 1e-6,
        spt.inner_nodes(),
        spt.inner_nodes() as f64 / points.len() as f64,
        100.0 * (theirs as f64 / ours as f64 - 1.0)
    );
    Ok(())
}

/// Permutations and copies.
pub fn exactness(quick: bool) -> Result<(), Box<dyn Error>> {
    println!("\nexactness");
    let count = if quick { 500_000 } else { 5_000_000 };
    let out = data::folder().join("exact.points");
    // Sums of hashes and of their squares tell multisets apart.
    let hash = |p: &Point| {
        let [x, y, z] = p.position.map(|v| v as u32 as u64);
        let c = u64::from(u32::from_le_bytes(p.colour));
        let h = (x | y << 32).wrapping_mul(0x9e37_79b9_7f4a_7c15)
            ^ (z | c << 32).wrapping_mul(0xc2b2_ae3d_27d4_eb4f);
        (h ^ h >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9)
    };
    let sums = |points: &mut dyn Iterator<Item = Point>| {
        points.fold((0u64, 0u64, 0u64), |(n, a, b), p| {
            let h = hash(&p);
            (n + 1, a.wrapping_add(h), b.wrapping_add(h.wrapping_mul(h)))
        })
    };
    let points = scan(count)?;
    build(Input::from_points(grid(), &points), &out, &BuildOptions::default(), &no_progress)?;
    let store = Store::open(&out)?;
    let mut data = NodeData::default();
    let mut found = (0u64, 0u64, 0u64);
    for node in store.octree().ids() {
        store.read(node, &mut data)?;
        let (n, a, b) = sums(&mut data.points.iter().copied());
        found = (found.0 + n, found.1.wrapping_add(a), found.2.wrapping_add(b));
    }
    let same = found == sums(&mut points.iter().copied());
    println!("  {count} points at UTM coordinates: {} stored, the same set to the bit: {same}", found.0);
    let copies = vec![Point::new([5, 6, 7], [1, 2, 3]); count as usize];
    let start = Instant::now();
    Mospt::build(grid(), &copies, &MosptOptions::default())?;
    let in_core = start.elapsed();
    let start = Instant::now();
    // They are one item of the sort, which cannot be spilled in parts: 56 bytes each of the half of the limit that sorting has.
    let mut options = BuildOptions::default();
    options.memory = 1 << 30;
    let report = build(Input::from_points(grid(), &copies), &out, &options, &no_progress)?;
    println!(
        "  {count} copies of one point: {:.2} s in core, {:.2} s to disk, {} stored (floor: 1 s for 5 M)",
        in_core.as_secs_f64(),
        start.elapsed().as_secs_f64(),
        report.points
    );
    let mut per_position: HashMap<u64, u32> = HashMap::new();
    points.iter().step_by(100).for_each(|p| *per_position.entry(hash(p)).or_default() += 1);
    println!("  different hashes among each 100th: {} of {}", per_position.len(), points.len().div_ceil(100));
    Ok(())
}

/// From a LAZ file to a first picture.
pub fn first_picture() -> Result<(), Box<dyn Error>> {
    use farsight_points::{LasOptions, NodeId, Selection, Traversal, ViewOptions};
    let Some(folder) = std::env::var_os("FARSIGHT_DATA") else {
        println!("\nfirst picture: needs FARSIGHT_DATA");
        return Ok(());
    };
    let path = std::path::Path::new(&folder).join("autzen_west.laz");
    // Decoding alone, by the library that the build uses.
    let (cpu, start) = (child::cpu_seconds(), Instant::now());
    let mut reader = las::Reader::from_path(&path)?;
    let mut some = las::PointDataBuilder::new().for_header(reader.header()).build();
    while reader.fill_points(400_000, &mut some)? > 0 {}
    let decoding = (start.elapsed().as_secs_f64(), child::cpu_seconds() - cpu);
    let out = data::folder().join("autzen.points");
    let (cpu, start) = (child::cpu_seconds(), Instant::now());
    let report =
        build(Input::las(&[&path], &LasOptions::default())?, &out, &BuildOptions::default(), &no_progress)?;
    let built = (start.elapsed().as_secs_f64(), child::cpu_seconds() - cpu);
    let store = Store::open(&out)?;
    let bounds = store.octree().world_bounds();
    let d = bounds.diagonal();
    let camera = farsight_geometry::Camera::look_at(
        bounds.center() + DVec3::new(-0.4, -0.6, 0.4) * d,
        bounds.center(),
        DVec3::Z,
    )?;
    let opened = Instant::now();
    let mut first = crate::pixels::Plain::new(camera)?;
    let mut node = NodeData::default();
    store.read(NodeId(0), &mut node)?;
    first.draw(&store, &node);
    let root = opened.elapsed().as_secs_f64();
    let mut selection = Selection::default();
    Traversal::new().select(store.octree(), &camera, &ViewOptions::error(1.0), |_| true, &mut selection);
    crate::pixels::Plain::some(&store, camera, selection.drawn.iter().map(|d| d.node))?;
    let whole = opened.elapsed().as_secs_f64();
    println!("\nautzen_west.laz, {} points", report.points);
    println!(
        "  decoding alone {:.2} s, {:.2} CPU-s; to a finished file {:.2} s, {:.2} CPU-s: {:.2} x (floor: 1.5)",
        decoding.0,
        decoding.1,
        built.0,
        built.1,
        built.0 / decoding.0
    );
    println!(
        "  from the file's name to a picture of the root {:.3} s, to one within a pixel ({} points) {:.3} s; from an opened file {:.1} and {:.1} ms",
        built.0 + root,
        selection.points,
        built.0 + whole,
        root * 1e3,
        whole * 1e3
    );
    Ok(())
}
