//! Reference sets: the union of long runs of several seeds and methods, kept as count and hash.

use super::scenes::Case;
use farsight_visibility::{Budget, Occluders, Options, Pvs, Sampler};
use std::error::Error;

/// Name, members, hash: printed by `--make-reference`.
const KNOWN: &str = include_str!("reference.csv");

/// Runs of a reference: method, seed, rays.
fn runs() -> Vec<(Options, u64)> {
    let seeded = |options: Options, seed: u64, rays: u64| {
        let mut options = options;
        options.seed = seed;
        (options, rays)
    };
    let mut fine = Options::default();
    fine.tolerance = [1e-3, 1e-4];
    let mut whole = Options::default();
    whole.flood = false;
    vec![
        seeded(Options::default(), 101, 24_000_000),
        seeded(fine, 102, 24_000_000),
        seeded(whole, 103, 24_000_000),
        seeded(Options::paper(), 104, 12_000_000),
        seeded(Options::random(), 105, 24_000_000),
    ]
}

/// The union of the reference's runs.
pub fn set(case: &Case) -> Result<Pvs, Box<dyn Error>> {
    let triangles = case.triangles();
    let mut all = Pvs::new();
    for (options, rays) in runs() {
        let mut sampler = Sampler::new(&triangles, Occluders::opaque(&case.caster), &case.cell, options)?;
        sampler.run(&Budget::rays(rays));
        all = all.union(&sampler.pvs());
    }
    Ok(all)
}

/// Prints the lines of the file of references.
pub fn make(cases: &[Case]) -> Result<(), Box<dyn Error>> {
    println!("scene,members,hash");
    for case in cases {
        let set = set(case)?;
        println!("{},{},{:016x}", case.name, set.len(), hash(&set));
    }
    Ok(())
}

/// Members of a scene's reference set; `None` for a scene without one.
pub fn members(name: &str) -> Option<u32> {
    let line = KNOWN.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(','))?;
    line.split(',').next()?.parse().ok()
}

/// FNV-1a over the numbers in order.
fn hash(set: &Pvs) -> u64 {
    let bytes = set.iter().flat_map(u32::to_le_bytes);
    bytes.fold(0xcbf2_9ce4_8422_2325, |sum, byte| (sum ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}
