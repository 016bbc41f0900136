//! How sets and errors grow and shrink with rays, for each method: figure 5.8 of the paper in our terms.

use super::Ask;
use super::judge::Judge;
use super::reference;
use super::scenes::Case;
use farsight_visibility::{Budget, Occluders, Options, Reverse, Sampler};
use std::error::Error;

/// Rays after which errors are compared.
const CHECKS: [u64; 8] = [200_000, 300_000, 450_000, 700_000, 1_000_000, 1_500_000, 2_500_000, 4_000_000];

/// A method's name and options.
pub fn methods() -> Vec<(&'static str, Options)> {
    let with = |change: fn(&mut Options)| {
        let mut options = Options::default();
        change(&mut options);
        options
    };
    vec![
        ("default", Options::default()),
        ("no flood", with(|o| o.flood = false)),
        ("no mutation", with(|o| (o.mutation, o.revisit) = (false, false))),
        ("no reverse", with(|o| o.reverse = Reverse::Off)),
        ("paper", Options::paper()),
        ("random", Options::random()),
    ]
}

pub fn report(case: &Case, ask: &Ask) -> Result<(), Box<dyn Error>> {
    let judge = Judge::new(case, if ask.quick { 1_000_000 } else { 10_000_000 });
    let most = if ask.quick { 1_000_000 } else { 4_000_000 };
    let known = if ask.quick { None } else { reference::members(case.name) };
    let triangles = case.triangles();
    let mut table: Vec<(&str, Vec<f64>)> = Vec::new();
    println!("{:<12} {:>30}   false pixels of a million after Mrays", "", "Mrays to 50, 90, 95 % (at end)");
    println!("{:<43}{}", "", CHECKS.map(|c| format!("{:>9.2}", c as f64 * 1e-6)).concat());
    for (name, options) in methods() {
        let mut sampler = Sampler::new(&triangles, Occluders::opaque(&case.caster), &case.cell, options)?;
        let (mut errors, mut reached) = (Vec::new(), [None; 3]);
        let checks = CHECKS.into_iter().filter(|&c| c <= most);
        // Random rays alone go on until they have half.
        let last = if name == "random" && known.is_some() { 30_000_000 } else { most };
        let more = (1..).map(|i| most + i * 500_000).take_while(|&at| at <= last);
        for at in checks.chain(more) {
            while sampler.rays() < at {
                sampler.run(&Budget::rays(at.min(sampler.rays() + 2_000)));
                let share = f64::from(sampler.len()) / known.map_or(f64::INFINITY, f64::from);
                for (goal, reached) in [0.5, 0.9, 0.95].into_iter().zip(&mut reached) {
                    if share >= goal && reached.is_none() {
                        *reached = Some(sampler.rays());
                    }
                }
            }
            if at <= most {
                errors.push(judge.false_per_million(&sampler.pvs()));
            } else if reached[0].is_some() {
                break;
            }
        }
        let goals = reached.map(|r| r.map_or("      -".into(), |r| format!("{:>7.2}", r as f64 * 1e-6)));
        let end = known
            .map_or(String::new(), |k| format!("{:.1} %", 100.0 * f64::from(sampler.len()) / f64::from(k)));
        let row: String = errors.iter().map(|e| format!("{e:>9.1}")).collect();
        println!("{name:<12} {} {end:>8} {row}", goals.concat());
        table.push((name, errors));
    }
    if let (Some(own), Some(random)) = (table.first(), table.last()) {
        let worst = own.1.iter().zip(&random.1).map(|(a, b)| a / b).fold(0.0, f64::max);
        println!("error over that of random rays at the same budget: at most {worst:.2} (floor 2)");
    }
    let mut at_end = Vec::new();
    for seed in 2..if ask.quick { 3 } else { 7 } {
        let mut options = Options::default();
        options.seed = seed;
        let mut sampler = Sampler::new(&triangles, Occluders::opaque(&case.caster), &case.cell, options)?;
        sampler.run(&Budget::rays(most));
        at_end.push(judge.false_per_million(&sampler.pvs()));
    }
    let mean = at_end.iter().sum::<f64>() / at_end.len() as f64;
    println!("default with other seeds, at the end: mean {mean:.2} of {at_end:.1?}");
    let floor = match case.name {
        "city" => "floor: 50 % at 0.7, 90 % at 1.2, 95 % at 3.4 Mrays, 4 false pixels after 4 Mrays",
        "igea" => "floor: 95 % at 0.9 Mrays, 0.5 false pixels after 3 Mrays",
        _ => "floor: 1 false pixel after 4 Mrays",
    };
    println!("{floor}");
    Ok(())
}
