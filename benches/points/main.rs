//! Point clouds: how fast they are built, how much memory that takes, what a view costs, what it loses.
//!
//! ```text
//! cargo bench --bench points                    everything but 100 M points
//! cargo bench --bench points -- --quick         small clouds
//! cargo bench --bench points -- --huge          100 M points instead of 20 M where memory is measured (16 GB of disk)
//! cargo bench --bench points -- --only build    one part: build, memory, core, select, lost, exact, picture
//! ```
//!
//! Clouds are made once and kept in `target/points-bench`.

mod child;
mod core;
mod data;
mod pixels;
mod view;

use child::{Job, Usage};
use data::Cloud;
use stats_alloc::{INSTRUMENTED_SYSTEM, StatsAlloc};
use std::alloc::System;
use std::error::Error;

/// Counts allocations, to show where there are none.
#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.first().map(String::as_str) {
        Some("--child") => return child::main(&arguments[1..]),
        Some("--core") => return core::child(arguments[1].parse()?),
        _ => {}
    }
    let has = |flag: &str| arguments.iter().any(|a| a == flag);
    let only = arguments.iter().position(|a| a == "--only").and_then(|i| arguments.get(i + 1));
    let wanted = |part: &str| only.is_none_or(|o| o == part);
    let quick = has("--quick");
    let count = if quick { 1_000_000 } else { 20_000_000 };
    if wanted("build") {
        build(count)?;
    }
    if wanted("memory") {
        memory(if has("--huge") { 100_000_000 } else { count })?;
    }
    if wanted("core") {
        core::report(quick)?;
    }
    if wanted("select") {
        view::selection(count)?;
    }
    if wanted("lost") {
        view::report(count, if quick { [960, 540] } else { [1920, 1080] })?;
    }
    if wanted("exact") {
        core::exactness(quick)?;
    }
    if wanted("picture") {
        core::first_picture()?;
    }
    Ok(())
}

/// Middle of some runs by wall time and by CPU time.
fn median(runs: &[Usage]) -> Usage {
    let middle = |f: fn(&Usage) -> f64| {
        let mut values: Vec<f64> = runs.iter().map(f).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let most = runs.iter().map(|r| r.peak).fold(0.0, f64::max);
    Usage { wall: middle(|r| r.wall), cpu: middle(|r| r.cpu), peak: most, ..runs[0] }
}

/// LAS to a finished file, in processes of their own.
fn build(count: u64) -> Result<(), Box<dyn Error>> {
    let input = data::las_file(Cloud::Street, count)?;
    let out = data::folder().join("out.points");
    println!("LAS to a finished file, street of {count} points, input in the page cache, median of 5");
    println!("floors for 20 M: 2.5 CPU-s and 2.2 s with two threads, 3.5 CPU-s with all attributes");
    for (name, threads, attributes) in
        [("two threads", 2, false), ("one thread", 1, false), ("two threads, all attributes", 2, true)]
    {
        let job = Job { input: &input, out: &out, threads, memory_mib: 512, attributes };
        let runs = (0..5).map(|_| child::run(&job)).collect::<Result<Vec<_>, _>>()?;
        let u = median(&runs);
        println!(
            "  {name:<28} {:.2} CPU-s, {:.2} s, peak {:.0} MiB; {} nodes, {:.2} bytes a point, structure {:.4} %",
            u.cpu,
            u.wall,
            u.peak,
            u.nodes,
            u.payload / count as f64,
            100.0 * u.structure / u.payload
        );
    }
    Ok(())
}

/// Peak memory against the limit, for distributions that make it hard.
fn memory(count: u64) -> Result<(), Box<dyn Error>> {
    println!("\npeak resident memory, {count} points (floor: at most the limit; 13 CPU-s for 100 M)");
    for cloud in Cloud::ALL {
        let input = data::las_file(cloud, count)?;
        let out = data::folder().join("out.points");
        for memory_mib in [256, 512] {
            let u = child::run(&Job { input: &input, out: &out, threads: 2, memory_mib, attributes: false })?;
            println!(
                "  {:<9} limit {memory_mib} MiB: peak {:>4.0} MiB, {:.2} CPU-s, {:.2} s, {} nodes{}",
                cloud.name(),
                u.peak,
                u.cpu,
                u.wall,
                u.nodes,
                if u.peak > memory_mib as f64 { "  ABOVE THE LIMIT" } else { "" }
            );
        }
        if count > 20_000_000 {
            // Disk is for the next one.
            std::fs::remove_file(input)?;
            std::fs::remove_file(out)?;
        }
    }
    Ok(())
}
