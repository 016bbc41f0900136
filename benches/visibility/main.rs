//! How well view cells are sampled, and what that costs. Every figure is printed beside the floor it is held to.
//!
//! `cargo bench --bench visibility` runs everything; `-- --quick` smaller scenes; `-- --only NAME` one part.

mod judge;
mod scenes;

use farsight_visibility::{Budget, Occluders, Options, Sampler};
use judge::Judge;
use scenes::Case;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let case = match std::env::args().skip_while(|a| a != "--scene").nth(1).as_deref() {
        Some("igea") => Case::igea()?.unwrap(),
        Some("cubes") => Case::cubes()?,
        _ => Case::city(false)?,
    };
    let triangles = case.triangles();
    let judge = Judge::new(&case, 4_000_000);
    println!("{} {}", case.name, case.mesh.triangles().len());
    let max: u64 =
        std::env::args().skip_while(|a| a != "--rays").nth(1).map_or(4_000_000, |a| a.parse().unwrap());
    let arg =
        |n: &str, d: f64| std::env::args().skip_while(|a| *a != n).nth(1).map_or(d, |a| a.parse().unwrap());
    let mut o = match std::env::args().skip_while(|a| a != "--preset").nth(1).as_deref() {
        Some("paper") => Options::paper(),
        Some("random") => Options::random(),
        _ => Options::default(),
    };
    o.tolerance = [arg("--t0", o.tolerance[0]), arg("--t1", o.tolerance[1])];
    o.least_share = arg("--least", o.least_share);
    o.first_random = arg("--first", o.first_random as f64) as u64;
    o.seed = arg("--seed", 1.0) as u64;
    o.mutation = arg("--mut", f64::from(u8::from(o.mutation))) > 0.0;
    o.revisit = arg("--rev", f64::from(u8::from(o.revisit))) > 0.0;
    let mut sampler = Sampler::new(&triangles, Occluders::opaque(&case.caster), &case.cell, o)?;
    let mut at = 200_000;
    while at <= max {
        sampler.run(&Budget::rays(at));
        let c = sampler.cost();
        println!(
            "{:>9} rays  set {:>6}  false {:>8.1}/M   {:.2} Ms/s {}",
            sampler.rays(),
            sampler.len(),
            judge.false_per_million(&sampler.pvs()),
            sampler.rays() as f64 * 1e-6 / c.time.as_secs_f64(),
            c.counters
        );
        at = at * 3 / 2;
    }
    Ok(())
}
