//! What must never happen: borders that meet their own triangle, leaks, members without proof.

use super::Ask;
use super::scenes::Case;
use farsight_geometry::glam::DVec3;
use farsight_geometry::hard_cases::bumpy_ball;
use farsight_geometry::ray::{BruteForce, Bvh8, ObvhsCaster, ObvhsTree};
use farsight_geometry::{DAabb, Ray, RayCaster, TriangleMesh};
use farsight_raster::scenes::Cubes;
use farsight_visibility::{Bisector, Budget, Occluders, Options, Sampler, Triangles, ViewCell, Witness};
use std::error::Error;

pub fn report(cases: &[Case], ask: &Ask) -> Result<(), Box<dyn Error>> {
    println!("\ncorrectness");
    self_hits(ask)?;
    leaks(cases, ask)?;
    for case in cases {
        witnesses(case, ask)?;
    }
    Ok(())
}

/// The scene of cubes moved away from the origin, in `f32` coordinates as they would come from a file.
fn self_hits(ask: &Ask) -> Result<(), Box<dyn Error>> {
    let mesh = Cubes::default().build()?.flattened()?;
    let rays = if ask.quick { 300_000 } else { 1_500_000 };
    for offset in [0.0, 1e4, 1e5, 1e6] {
        // Rounded to f32 at its place, and the same with an exact origin.
        let positions = mesh.positions().iter().map(|p| *p + offset as f32).collect();
        let rounded = TriangleMesh::new(positions, mesh.triangles().to_vec())?;
        let moved = mesh.clone().with_origin(DVec3::splat(offset))?;
        for (what, mesh) in [("f32", rounded), ("f64 origin", moved)] {
            let (triangles, caster) = (Triangles::of_mesh(&mesh), Bvh8::new(&mesh));
            let center = DVec3::splat(50.0 + offset);
            let cell = ViewCell::from_box(&DAabb::new(center - 0.75, center + 0.75))?;
            for epsilon in [1e-5, 5e-5] {
                let mut options = Options::default();
                options.epsilon = epsilon;
                let mut sampler = Sampler::new(&triangles, Occluders::opaque(&caster), &cell, options)?;
                sampler.run(&Budget::rays(rays));
                let counters = sampler.cost().counters;
                println!(
                    "self-hits at {offset:.0e} m ({what}), epsilon {epsilon:.0e}: {} of {} border rays (floor 0)",
                    counters.get("self_hits"),
                    ["flood", "border", "revisit"].map(|name| counters.get(name)).iter().sum::<u64>()
                );
            }
        }
    }
    let (triangles, caster) = (Triangles::of_mesh(&mesh), Bvh8::new(&mesh));
    let cell = ViewCell::from_box(&DAabb::new(DVec3::splat(49.25), DVec3::splat(50.75)))?;
    let mut options = Options::paper();
    options.bisector = Bisector::Printed;
    let mut sampler = Sampler::new(&triangles, Occluders::opaque(&caster), &cell, options)?;
    sampler.run(&Budget::rays(rays));
    let own = sampler.cost().counters.get("self_hits");
    println!(
        "with the printed bisector: {own} self-hits, {:.2} per triangle",
        own as f64 / f64::from(sampler.len())
    );
    Ok(())
}

/// Rays at a closed mesh from outside: none may meet a back before a front.
fn leaks(cases: &[Case], ask: &Ask) -> Result<(), Box<dyn Error>> {
    let ball;
    let (name, mesh) = match cases.iter().find(|c| c.name == "igea") {
        Some(case) => (case.name, &case.mesh),
        None => {
            ball = bumpy_ball(100);
            ("ball", &ball)
        }
    };
    let caster = Bvh8::new(mesh);
    let fronts = caster.clone().front_faces_only();
    let mut random = farsight_geometry::sampling::Random::new(5);
    let (center, size) = (mesh.world_bounds().center(), mesh.world_bounds().diagonal());
    let count = if ask.quick { 200_000 } else { 2_000_000 };
    let (mut hit, mut leaks) = (0, 0);
    while hit < count {
        let unit =
            |r: &mut farsight_geometry::sampling::Random| DVec3::from_array(r.units()) * 2.0 - DVec3::ONE;
        let from = center + unit(&mut random).normalize_or(DVec3::X) * size;
        // Half of the rays at vertices, where leaks are.
        let to = match hit % 2 {
            0 => mesh.corners(random.below(mesh.triangles().len() as u64) as usize)[0].as_dvec3(),
            _ => center + unit(&mut random) * size * 0.3,
        };
        let ray = Ray::new(from, to - from);
        if let Some(h) = ray.and_then(|ray| caster.closest(&ray)) {
            hit += 1;
            // At a vertex of the outline, fronts and backs meet at one distance.
            let front = || ray.and_then(|ray| fronts.closest(&ray)).map_or(f64::INFINITY, |f| f.t);
            leaks += i32::from(h.back_face && front() > h.t * (1.0 + 1e-12));
        }
    }
    println!("back faces met before any front in {count} rays at the closed {name}: {leaks} (floor 0)");
    Ok(())
}

/// Witnesses against another tree, and some of them against brute force.
fn witnesses(case: &Case, ask: &Ask) -> Result<(), Box<dyn Error>> {
    let triangles = case.triangles();
    let mut options = Options::default();
    options.witnesses = true;
    let mut sampler = Sampler::new(&triangles, Occluders::opaque(&case.caster), &case.cell, options)?;
    sampler.run(&Budget::rays(if ask.quick { 300_000 } else { 2_000_000 }));
    let other = ObvhsCaster::new(&case.mesh, ObvhsTree::Binary);
    let brute = BruteForce::new(&case.mesh);
    let by_brute_force = 100_000_000 / case.mesh.triangles().len();
    let (mut failed, mut checked) = ([0, 0], [0, 0]);
    let step = sampler.witnesses().len().div_ceil(by_brute_force).max(1);
    for (index, &(member, witness)) in sampler.witnesses().iter().enumerate() {
        let Witness::Ray(sight) = witness else { continue };
        let ray = Ray::new(sight.origin, sight.direction).ok_or("a witness without direction")?;
        checked[0] += 1;
        let met = other.closest(&ray).map(|h| triangles.member(h.triangle));
        failed[0] += i32::from(met != Some(member) || !case.cell.contains(sight.origin));
        if index % step == 0 {
            checked[1] += 1;
            let own = brute.all(&ray).find(|h| h.triangle == member);
            let first = brute.closest(&ray);
            let holds = own.zip(first).is_some_and(|(own, first)| first.t >= own.t * (1.0 - 1e-12));
            failed[1] += i32::from(!holds);
        }
    }
    println!(
        "{}: {} witnesses of {} members; refuted by another tree {}, by brute force {} of {} (floor 0)",
        case.name,
        sampler.witnesses().len(),
        sampler.len(),
        failed[0],
        failed[1],
        checked[1]
    );
    Ok(())
}
