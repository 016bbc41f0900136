//! A wave: units of work that know nothing of one another, so that any number of threads gives the same result.

use crate::bits::Bits;
use crate::border::{self, GROUP, Job, Sample};
use crate::cell::ViewCell;
use crate::flood;
use crate::known::Known;
use crate::mutation;
use crate::occluders::Occluders;
use crate::options::Options;
use crate::random;
use crate::reverse::Plane;
use crate::sight::Sight;
use crate::triangles::Triangles;
use farsight_geometry::sampling::Random;
use farsight_geometry::{Hit, Ray, RayCaster};
use glam::DVec3;

/// Single rays in a unit.
pub(crate) const RAYS_PER_UNIT: usize = 256;

/// Border jobs in a unit.
pub(crate) const JOBS_PER_UNIT: usize = 8;

/// Floods in a unit.
pub(crate) const FLOODS_PER_UNIT: usize = 64;

/// What all units read.
pub(crate) struct Space<'a, C> {
    pub(crate) triangles: &'a Triangles<'a>,
    pub(crate) occluders: Occluders<'a, C>,
    pub(crate) cell: &'a ViewCell,
    pub(crate) options: Options,
    /// Triangles seen before the wave.
    pub(crate) seen: Bits,
    /// Largest coordinate of the scene and the cell.
    pub(crate) largest: f64,
}

impl<C> Space<'_, C> {
    /// What coordinates are rounded to.
    pub(crate) fn rounding(&self) -> f64 {
        self.largest * f64::EPSILON
    }
}

/// A unit of work.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Unit {
    /// Floods from some jobs of the wave.
    Flood { first: usize, last: usize },
    /// Borders of some jobs of the wave.
    Border { first: usize, last: usize },
    /// Random rays, with this stream of random numbers.
    Random { stream: u64 },
    /// Mutations of known triangles from `first` on, with this stream of random numbers.
    Mutation { stream: u64, first: usize },
    /// Borders of known triangles from `first` on, from new viewpoints.
    Revisit { stream: u64, first: usize },
}

/// What a unit found.
#[derive(Clone, Debug, Default)]
pub(crate) struct Out {
    /// Sights of triangles that were not seen before the wave, in order.
    pub(crate) sights: Vec<Sight>,
    /// Triangles to be sampled all around.
    pub(crate) later: Vec<Job>,
    /// Rays of the unit's strategy, and the reverse rays that they led to.
    pub(crate) rays: u64,
    pub(crate) reverse: u64,
    /// Border rays that met the triangle they should pass.
    pub(crate) self_hits: u64,
}

impl Out {
    #[inline]
    pub(crate) fn see<C>(&mut self, space: &Space<C>, sight: Sight) {
        let again = self.sights.last().is_some_and(|last| last.triangle == sight.triangle);
        if !again && !space.seen.contains(sight.triangle) {
            self.sights.push(sight);
        }
    }
}

/// A unit's buffers, kept from wave to wave.
#[derive(Clone, Debug, Default)]
pub(crate) struct Scratch {
    pub(crate) out: Out,
    pub(crate) aims: Vec<DVec3>,
    pub(crate) corners: Vec<[DVec3; 3]>,
    pub(crate) hits: Vec<Option<Hit>>,
    pub(crate) rays: Vec<Ray>,
    pub(crate) samples: Vec<Sample>,
    pub(crate) edges: Vec<[u32; 2]>,
    pub(crate) next_edges: Vec<[u32; 2]>,
    pub(crate) planes: Vec<Plane>,
    /// Owner of a border sample, what stopped it, and which it is.
    pub(crate) stopped: Vec<[u32; 3]>,
    pub(crate) owners: Vec<u32>,
    pub(crate) group: Vec<Job>,
}

/// What a wave works on, besides the space.
pub(crate) struct Wave<'a> {
    pub(crate) jobs: &'a [Job],
    pub(crate) known: &'a Known,
}

impl Wave<'_> {
    pub(crate) fn run<C: RayCaster>(&self, space: &Space<C>, unit: Unit, scratch: &mut Scratch) {
        scratch.out.sights.clear();
        scratch.out.later.clear();
        (scratch.out.rays, scratch.out.reverse) = (0, 0);
        scratch.out.self_hits = 0;
        match unit {
            Unit::Flood { first, last } => flood::flood(space, &self.jobs[first..last], scratch),
            Unit::Border { first, last } => {
                border::groups(&self.jobs[first..last], GROUP)
                    .for_each(|group| border::sample(space, group, scratch));
            }
            Unit::Random { stream } => {
                let mut random = Random::new(space.options.seed).stream(stream);
                let directions = space.options.directions;
                scratch.rays.clear();
                let rays = (0..RAYS_PER_UNIT)
                    .filter_map(|_| random::border_ray(space.cell, directions, &mut random));
                scratch.rays.extend(rays);
                scratch.out.rays += shoot(space, scratch);
            }
            Unit::Mutation { stream, first } => {
                let mut random = Random::new(space.options.seed).stream(stream);
                mutation::sample(space, self.known, first, &mut random, scratch);
            }
            Unit::Revisit { stream, first } => self.revisit(space, stream, first, scratch),
        }
    }

    /// Samples borders of known triangles from new viewpoints, as finely as is allowed.
    fn revisit<C: RayCaster>(&self, space: &Space<C>, stream: u64, first: usize, scratch: &mut Scratch) {
        let mut random = Random::new(space.options.seed).stream(stream);
        let mut group = std::mem::take(&mut scratch.group);
        for first in (first..first + JOBS_PER_UNIT).step_by(GROUP) {
            let origin = random::viewpoint(space.cell, &mut random);
            group.clear();
            group.extend(self.known.from(first, GROUP).map(|triangle| {
                let [a, b, c] = space.triangles.corners(triangle);
                let sight = Sight { triangle, origin, direction: (a + b + c) / 3.0 - origin };
                Job { sight, tolerance: space.options.tolerance[1], edges: 0 }
            }));
            border::sample(space, &group, scratch);
        }
        scratch.group = group;
    }
}

/// Traces the rays of the scratch.
fn shoot<C: RayCaster>(space: &Space<C>, scratch: &mut Scratch) -> u64 {
    let Scratch { rays, hits, out, .. } = scratch;
    let sight = |ray: &Ray, triangle| Sight { triangle, origin: ray.origin(), direction: ray.direction() };
    space
        .occluders
        .batch(space.triangles, rays, hits, |i, triangle| out.see(space, sight(&rays[i], triangle)));
    for (ray, hit) in rays.iter().zip(hits.iter()) {
        if let Some(hit) = hit {
            out.see(space, sight(ray, space.triangles.of_hit(hit)));
        }
    }
    rays.len() as u64
}
