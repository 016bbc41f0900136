//! Visibility from a region: rays and methods against the share of pixels that show something missing.

use super::row::{Row, timed};
use farsight_geometry::accuracy::{Counters, ErrorBound, Norm, Unit};
use farsight_geometry::glam::DVec3;
use farsight_geometry::ray::Bvh8;
use farsight_geometry::sampling::Random;
use farsight_geometry::{DAabb, Ray, RayCaster, TriangleMesh};
use farsight_raster::scenes::{City, Cubes};
use farsight_visibility::{Budget, Occluders, Options, Sampler, Triangles, ViewCell};

pub fn rows(quick: bool) -> Vec<Row> {
    let city = if quick { City::small() } else { City::default() };
    let street = city.street(city.blocks / 2);
    let town = city.build().and_then(|s| Ok(s.flattened()?)).expect("a valid town");
    let cubes = Cubes::default().build().and_then(|s| Ok(s.flattened()?)).expect("valid cubes");
    let around = |center: DVec3, size: DVec3| DAabb::new(center - size * 0.5, center + size * 0.5);
    let in_street = around(DVec3::new(street - 25.0, street, 1.7), DVec3::new(15.0, 2.2, 0.8));
    let among_cubes = around(DVec3::splat(50.0), DVec3::splat(1.5));
    [("city", &town, in_street), ("cubes", &cubes, among_cubes)]
        .into_iter()
        .flat_map(|(name, mesh, cell)| of_scene(name, mesh, &cell, quick))
        .collect()
}

fn of_scene(name: &str, mesh: &TriangleMesh, bounds: &DAabb, quick: bool) -> Vec<Row> {
    let (triangles, caster) = (Triangles::of_mesh(mesh), Bvh8::new(mesh));
    let cell = ViewCell::from_box(bounds).expect("a box");
    let truth = pixels(&caster, bounds, if quick { 400_000 } else { 4_000_000 });
    let mut without = Options::default();
    (without.mutation, without.revisit) = (false, false);
    let methods = [
        ("random", Options::random()),
        ("paper", Options::paper()),
        ("unmutated", without),
        ("guided", Options::default()),
    ];
    let budgets: &[u64] =
        if quick { &[100_000, 300_000] } else { &[100_000, 200_000, 400_000, 800_000, 1_600_000, 3_200_000] };
    let mut rows = Vec::new();
    for (method, options) in methods {
        for &rays in budgets {
            let (sampler, times) = timed(if quick { 1 } else { 3 }, || {
                let mut sampler = Sampler::new(&triangles, Occluders::opaque(&caster), &cell, options)
                    .expect("valid options");
                sampler.run(&Budget::rays(rays));
                sampler
            });
            let (set, cost) = (sampler.pvs(), sampler.cost());
            let missed = truth.iter().flatten().filter(|&&t| !set.contains(t)).count();
            let mut sampler = sampler;
            let claimed = sampler.validate(rays, 0.95).expect("a confidence").bound;
            let mut counters = Counters::new();
            for counter in ["rays", "waves", "self_hits"] {
                counters.add(counter, cost.counters.get(counter));
            }
            rows.push(Row {
                krate: "visibility",
                scene: name.into(),
                knob: format!("{method} rays"),
                value: rays as f64,
                claimed: ErrorBound::measured(claimed.value, Unit::Fraction).with_norm(Norm::Mean),
                measured: missed as f64 / truth.len() as f64,
                times,
                bytes: (set.runs().len() * 8) as u64,
                counters,
            });
        }
    }
    rows
}

/// What random pixels of random viewpoints show, drawn without the sampler.
fn pixels(caster: &Bvh8, b: &DAabb, count: usize) -> Vec<Option<u32>> {
    let mut random = Random::new(0xface);
    let mut ray = || loop {
        let d = DVec3::from_array(random.units()) * 2.0 - DVec3::ONE;
        let eye = b.min + (b.max - b.min) * DVec3::from_array(random.units());
        if (0.01..1.0).contains(&d.length_squared()) {
            return Ray::new(eye, d).expect("a direction");
        }
    };
    let rays: Vec<Ray> = (0..count).map(|_| ray()).collect();
    let mut hits = vec![None; count];
    caster.closest_batch(&rays, &mut hits);
    hits.into_iter().map(|h| h.map(|h| h.triangle)).collect()
}
