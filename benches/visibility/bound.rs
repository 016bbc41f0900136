//! How often the stated bound holds.

use super::Ask;
use super::judge::Judge;
use super::scenes::Case;
use farsight_visibility::{Budget, Occluders, Options, Sampler};
use std::error::Error;

pub fn report(cases: &[Case], ask: &Ask) -> Result<(), Box<dyn Error>> {
    println!("\nthe bound on missed pixels, at 95 %");
    let runs = if ask.quick { 40 } else { 200 };
    for case in cases.iter().filter(|c| c.name != "igea") {
        let judge = Judge::new(case, 4_000_000);
        let triangles = case.triangles();
        let (mut held, mut over) = (0, 0.0);
        for seed in 0..runs {
            let mut options = Options::default();
            (options.seed, options.first_random) = (seed, 30_000);
            let mut sampler = Sampler::new(&triangles, Occluders::opaque(&case.caster), &case.cell, options)?;
            sampler.run(&Budget::rays(60_000));
            let truth = judge.false_per_million(&sampler.pvs());
            let bound = sampler.validate(50_000, 0.95)?.per_million();
            held += i32::from(truth <= bound);
            over += bound / truth / runs as f64;
        }
        println!(
            "{}: covers the truth in {held} of {runs} runs (floor 95 %), {over:.2} times the truth on average",
            case.name
        );
    }
    for case in cases {
        let judge = Judge::new(case, if ask.quick { 1_000_000 } else { 10_000_000 });
        let triangles = case.triangles();
        for share in [1e-4, 2e-5, 5e-6] {
            if ask.quick && share < 1e-4 {
                continue;
            }
            let mut sampler =
                Sampler::new(&triangles, Occluders::opaque(&case.caster), &case.cell, Options::default())?;
            sampler.run(&Budget::missed(share, 0.95, 30_000_000)?);
            let cost = sampler.cost();
            println!(
                "{}: {:.0} of a million asked for: bound {:.2}, true {:.2}, {:.2} Mrays and {:.2} M to prove it",
                case.name,
                share * 1e6,
                sampler.missed().map_or(f64::NAN, |m| m.per_million()),
                judge.false_per_million(&sampler.pvs()),
                sampler.rays() as f64 * 1e-6,
                cost.counters.get("validation") as f64 * 1e-6
            );
        }
    }
    Ok(())
}
