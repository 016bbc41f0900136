//! Guided samples a second, and where the time goes.
//!
//! A guided sample is one ray that a guided strategy aims: flood, border, reverse, mutation, revisit. The random rays that the
//! schedule mixes in do not count, their time does; the first random rays are left out on both sides.

use super::Ask;
use super::scenes::Case;
use farsight_geometry::glam::DVec3;
use farsight_geometry::{Hit, Ray, RayCaster};
use farsight_raster::thread_cpu_time;
use farsight_visibility::{Budget, Occluders, Options, Sampler};
use std::error::Error;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Instant;

pub fn report(case: &Case, ask: &Ask) -> Result<(), Box<dyn Error>> {
    let rays = if ask.quick { 500_000 } else { 2_000_000 };
    let triangles = case.triangles();
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let (one, two) = (pool(1)?, pool(2)?);
    // Samples a second: guided ones, and all.
    let sampled = |options: Options| -> Result<[f64; 2], Box<dyn Error>> {
        let mut best = [0.0f64; 2];
        for _ in 0..5 {
            let mut sampler = Sampler::new(&triangles, Occluders::opaque(&case.caster), &case.cell, options)?;
            sampler.run(&Budget::rays(options.first_random.max(1)));
            let random = |s: &Sampler<_>| s.cost().counters.get("random");
            let (rays_before, random_before) = (sampler.rays(), random(&sampler));
            let seconds = one.install(|| {
                let start = thread_cpu_time();
                sampler.run(&Budget::rays(rays));
                (thread_cpu_time() - start).as_secs_f64()
            });
            let all = sampler.rays() - rays_before;
            let guided = all - (random(&sampler) - random_before);
            let now = [guided, all].map(|n| n as f64 * 1e-6 / seconds);
            best = [best[0].max(now[0]), best[1].max(now[1])];
        }
        Ok(best)
    };
    for (name, options) in
        [("default", Options::default()), ("the paper's", Options::paper()), ("random", Options::random())]
    {
        let [guided, all] = sampled(options)?;
        println!("{name}: {guided:.2} M guided samples a second and thread, {all:.2} M with the random ones");
    }
    println!("floor: 2.5 M guided in the town");
    let timed = Timed { caster: &case.caster, nanoseconds: AtomicU64::new(0) };
    let mut sampler = Sampler::new(&triangles, Occluders::opaque(&timed), &case.cell, Options::default())?;
    let total = one.install(|| {
        let start = Instant::now();
        sampler.run(&Budget::rays(rays));
        start.elapsed().as_secs_f64()
    });
    let casting = timed.nanoseconds.load(Relaxed) as f64 * 1e-9;
    println!("sampling logic: {:.1} % of the time (floor 15)", 100.0 * (1.0 - casting / total));
    let mut wall = [f64::INFINITY; 2];
    for _ in 0..3 {
        for (pool, wall) in [&one, &two].into_iter().zip(&mut wall) {
            let mut sampler =
                Sampler::new(&triangles, Occluders::opaque(&case.caster), &case.cell, Options::default())?;
            let start = Instant::now();
            pool.install(|| sampler.run(&Budget::rays(rays)));
            *wall = wall.min(start.elapsed().as_secs_f64());
        }
    }
    println!("two threads over one: {:.2} (floor 1.9; needs idle cores)", wall[0] / wall[1]);
    Ok(())
}

/// A caster that measures its time.
struct Timed<'a, C> {
    caster: &'a C,
    nanoseconds: AtomicU64,
}

impl<C> Timed<'_, C> {
    fn time<T>(&self, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let answer = work();
        self.nanoseconds.fetch_add(start.elapsed().as_nanos() as u64, Relaxed);
        answer
    }
}

impl<C: RayCaster> RayCaster for Timed<'_, C> {
    fn closest(&self, ray: &Ray) -> Option<Hit> {
        self.time(|| self.caster.closest(ray))
    }

    fn closest_batch(&self, rays: &[Ray], hits: &mut [Option<Hit>]) {
        self.time(|| self.caster.closest_batch(rays, hits));
    }

    fn closest_bundle(&self, origin: DVec3, directions: &[DVec3], hits: &mut [Option<Hit>]) {
        self.time(|| self.caster.closest_bundle(origin, directions, hits));
    }
}
