//! Twenty cubes against brute force: segments from the cell to every triangle, each against all others in `f64`, by code that
//! shares nothing with the sampler or its ray casters.

use super::Ask;
use farsight_geometry::glam::DVec3;
use farsight_geometry::ray::{BruteForce, Bvh8};
use farsight_geometry::sampling::Random;
use farsight_geometry::{DAabb, Ray, RayCaster};
use farsight_raster::scenes::Cubes;
use farsight_visibility::{Budget, Occluders, Options, Pvs, Sampler, Triangles, ViewCell, Witness};
use rayon::prelude::*;
use std::error::Error;

pub fn report(ask: &Ask) -> Result<(), Box<dyn Error>> {
    println!("\ntwenty cubes, 240 triangles, against brute force");
    let (scenes, segments) = if ask.quick { (2, 20_000) } else { (3, 1_000_000) };
    for seed in 1..=scenes {
        let mut cubes = Cubes::default();
        (cubes.seed, cubes.count, cubes.edge, cubes.side) = (seed, 20, [1.0, 4.0], 30.0);
        let mesh = cubes.build()?.flattened()?;
        let triangles = Triangles::of_mesh(&mesh);
        let b = DAabb::new(DVec3::splat(14.5), DVec3::splat(15.5));
        let all: Vec<[DVec3; 3]> = (0..triangles.count()).map(|t| triangles.corners(t)).collect();
        let found: Pvs = (0..triangles.count())
            .into_par_iter()
            .map(|t| (t, is_seen(&all, t as usize, &b, segments)))
            .filter(|(_, seen)| *seen)
            .map(|(t, _)| t)
            .collect::<Vec<_>>()
            .into_iter()
            .collect();
        let (caster, cell, mut options) = (Bvh8::new(&mesh), ViewCell::from_box(&b)?, Options::default());
        options.witnesses = true;
        let mut sampler = Sampler::new(&triangles, Occluders::opaque(&caster), &cell, options)?;
        sampler.run(&Budget::rays(if ask.quick { 500_000 } else { 4_000_000 }));
        let (set, oracle) = (sampler.pvs(), BruteForce::new(&mesh));
        let (more, lacking) = (set.difference(&found), found.difference(&set));
        let proven = |&&(member, witness): &&(u32, Witness)| match witness {
            Witness::Ray(sight) if more.contains(member) => {
                let hit = Ray::new(sight.origin, sight.direction).and_then(|ray| oracle.closest(&ray));
                hit.is_some_and(|hit| hit.triangle == member)
            }
            witness => more.contains(member) && matches!(witness, Witness::Touches(_)),
        };
        println!(
            "seed {seed}: brute force finds {} ({segments} segments a triangle), guided {}; guided alone {}, of which brute force confirms {} along their witnesses; brute force alone {} (floor: equal)",
            found.len(),
            set.len(),
            more.len(),
            sampler.witnesses().iter().filter(proven).count(),
            lacking.len()
        );
    }
    Ok(())
}

/// Whether one of many random segments to a triangle is free. Half of them go from corners and edges of the cell to
/// near corners and edges of the triangle, where slivers show.
fn is_seen(all: &[[DVec3; 3]], own: usize, cell: &DAabb, segments: u32) -> bool {
    let mut random = Random::new(99).stream(own as u64);
    let [p, q, r] = all[own];
    let mut last = own;
    (0..segments).any(|i| {
        let (mut eye, [mut u, mut v]) = (DVec3::from_array(random.units()), random.units());
        if i % 2 == 0 {
            let near_end = |x: f64, side: bool| {
                let small = x * x * x;
                if side { small } else { 1.0 - small }
            };
            u = near_end(u, random.bits() & 1 != 0);
            v = near_end(v, random.bits() & 1 != 0);
            for axis in 0..3 {
                eye[axis] = match random.below(3) {
                    0 => 0.0,
                    1 => 1.0,
                    _ => eye[axis],
                };
            }
        }
        let eye = cell.min + (cell.max - cell.min) * eye;
        // Folded into the triangle.
        let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
        let to = p + (q - p) * u + (r - p) * v - eye;
        let blocks = |t: usize| t != own && crosses(all[t], eye, to);
        if blocks(last) {
            return false;
        }
        match (0..all.len()).find(|&t| blocks(t)) {
            Some(t) => last = t,
            None => return true,
        }
        false
    })
}

/// Whether a segment meets a triangle up to its end, by signed volumes.
fn crosses([a, b, c]: [DVec3; 3], from: DVec3, to: DVec3) -> bool {
    let (ab, ac, normal_to) = (b - a, c - a, to.cross(c - a));
    let det = ab.dot(normal_to);
    if det == 0.0 {
        return false;
    }
    let at = from - a;
    let u = at.dot(normal_to) / det;
    let across = at.cross(ab);
    let v = to.dot(across) / det;
    let t = ac.dot(across) / det;
    // A billionth wide and long: segments that graze an edge, or end on one that another triangle shares, count as blocked.
    const WIDE: f64 = 1e-9;
    u >= -WIDE && v >= -WIDE && u + v <= 1.0 + WIDE && (0.0..1.0 + WIDE).contains(&t)
}
