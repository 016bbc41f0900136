//! A wave: units of work that know nothing of one another, so that any number of threads gives the same result.

use crate::bits::Bits;
use crate::border::{self, Job, Sample};
use crate::cell::ViewCell;
use crate::mutation;
use crate::occluders::Occluders;
use crate::options::Options;
use crate::random;
use crate::sight::Sight;
use crate::triangles::Triangles;
use farsight_geometry::sampling::{Halton, Random};
use farsight_geometry::{Hit, Ray, RayCaster};
use glam::DVec3;

/// Single rays in a unit.
pub(crate) const RAYS_PER_UNIT: usize = 512;

/// Border jobs in a unit.
pub(crate) const JOBS_PER_UNIT: usize = 16;

/// Floods in a unit.
pub(crate) const FLOODS_PER_UNIT: usize = 128;

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
    /// Floods from the jobs of the wave from `first` on.
    Flood { first: usize },
    /// Borders of the jobs of the wave from `first` on.
    Border { first: usize },
    /// Random rays from this index on.
    Random { first: u32 },
    /// Mutations, with this stream of random numbers.
    Mutation { stream: u64 },
    /// Borders of known triangles from new viewpoints.
    Revisit { stream: u64 },
}

/// Rays by strategy.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Rays {
    pub(crate) random: u64,
    pub(crate) border: u64,
    pub(crate) reverse: u64,
    pub(crate) mutation: u64,
}

impl Rays {
    pub(crate) fn all(&self) -> u64 {
        self.random + self.border + self.reverse + self.mutation
    }

    pub(crate) fn add(&mut self, other: &Self) {
        self.random += other.random;
        self.border += other.border;
        self.reverse += other.reverse;
        self.mutation += other.mutation;
    }
}

/// What a unit found.
#[derive(Clone, Debug, Default)]
pub(crate) struct Out {
    /// Sights of triangles that were not seen before the wave, in order.
    pub(crate) sights: Vec<Sight>,
    /// Triangles to be sampled all around.
    pub(crate) later: Vec<Job>,
    pub(crate) rays: Rays,
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
    pub(crate) next_aims: Vec<DVec3>,
    pub(crate) hits: Vec<Option<Hit>>,
    pub(crate) rays: Vec<Ray>,
    pub(crate) samples: Vec<Sample>,
    pub(crate) edges: Vec<[u32; 2]>,
    pub(crate) next_edges: Vec<[u32; 2]>,
    pub(crate) stoppers: Vec<u32>,
    pub(crate) owners: Vec<u32>,
}

/// What a wave works on, besides the space.
pub(crate) struct Wave<'a> {
    pub(crate) jobs: &'a [Job],
    pub(crate) known: &'a [u32],
    pub(crate) halton: Halton,
}

impl Wave<'_> {
    pub(crate) fn run<C: RayCaster>(&self, space: &Space<C>, unit: Unit, scratch: &mut Scratch) {
        scratch.out.sights.clear();
        scratch.out.later.clear();
        scratch.out.rays = Rays::default();
        scratch.out.self_hits = 0;
        match unit {
            Unit::Flood { first } => {
                let last = (first + FLOODS_PER_UNIT).min(self.jobs.len());
                border::flood(space, &self.jobs[first..last], scratch);
            }
            Unit::Border { first } => {
                let last = (first + JOBS_PER_UNIT).min(self.jobs.len());
                self.jobs[first..last].iter().for_each(|job| border::sample(space, job, scratch));
            }
            Unit::Random { first } => {
                scratch.rays.clear();
                let indices = (0..RAYS_PER_UNIT as u32).map(|i| first.wrapping_add(i));
                let directions = space.options.directions;
                let ray = |i| random::border_ray(space.cell, &self.halton, directions, i);
                scratch.rays.extend(indices.filter_map(ray));
                scratch.out.rays.random += self.shoot(space, scratch);
            }
            Unit::Mutation { stream } => {
                let mut random = Random::new(space.options.seed).stream(stream);
                mutation::sample(space, self.known, &mut random, RAYS_PER_UNIT, scratch);
            }
            Unit::Revisit { stream } => self.revisit(space, stream, scratch),
        }
    }

    /// Traces the rays of the scratch.
    fn shoot<C: RayCaster>(&self, space: &Space<C>, scratch: &mut Scratch) -> u64 {
        let Scratch { rays, hits, out, .. } = scratch;
        let sight =
            |ray: &Ray, triangle| Sight { triangle, origin: ray.origin(), direction: ray.direction() };
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

    /// Samples borders of known triangles from new viewpoints, as finely as is allowed.
    fn revisit<C: RayCaster>(&self, space: &Space<C>, stream: u64, scratch: &mut Scratch) {
        let mut random = Random::new(space.options.seed).stream(stream);
        for _ in 0..JOBS_PER_UNIT {
            let triangle = self.known[random.below(self.known.len() as u64) as usize];
            let origin = random::border_point(space.cell, &mut random);
            let [a, b, c] = space.triangles.corners(triangle);
            let direction = (a + b + c) / 3.0 - origin;
            let tolerance = space.options.tolerance[1];
            border::sample(space, &Job { sight: Sight { triangle, origin, direction }, tolerance }, scratch);
        }
    }
}
