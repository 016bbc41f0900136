//! Sampling of one view cell, wave by wave.

use crate::VisibilityError;
use crate::bits::Bits;
use crate::border::Job;
use crate::cell::ViewCell;
use crate::flood::Crossed;
use crate::known::Known;
use crate::mutation;
use crate::occluders::Occluders;
use crate::options::{Budget, MissedLimit, Options};
use crate::overlap::touches;
use crate::pvs::Pvs;
use crate::schedule::{COUNT, STRATEGIES, Schedule, Strategy};
use crate::sight::{Sight, Witness};
use crate::triangles::Triangles;
use crate::validate::{Missed, RAYS_PER_LOOK_UNIT, confidence_of_look, look, rays_to_prove, upper_bound};
use crate::wave::{FLOODS_PER_UNIT, JOBS_PER_UNIT, RAYS_PER_UNIT, Scratch, Space, Unit, Wave};
use farsight_geometry::accuracy::Counters;
use farsight_geometry::{Cost, RayCaster};
use std::collections::VecDeque;
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

/// Units in a wave: some for every thread, and few enough that what a wave finds is soon followed.
const UNITS: usize = 64;

/// Border jobs that wait at most; what comes later is found again or not at all, instead of filling the memory.
const MOST_WAITING: usize = 1 << 22;

/// Samples what can be seen from a view cell.
///
/// Work goes in waves of 64 units that do not depend on one another and are merged in order, so the set is the same for any
/// number of threads (feature `rayon`) and however a run is cut into pieces.
///
/// # Accuracy
/// Every member of the set can be seen: by a ray that reached it, or by touching the cell. What is missing has no proven
/// bound; [`validate`](Self::validate) bounds it statistically.
///
/// # Cost
/// Rays are nearly all of it. Memory: two bits a triangle, some 40 bytes a visible one (100 with witnesses), 72 a waiting job.
///
/// # References
/// [Wimmer 2007] 5.3. Differs: see `docs/visibility.md`.
pub struct Sampler<'a, C> {
    space: Space<'a, C>,
    members: Bits,
    /// Triangles whose borders were queued or that touch the cell.
    known: Known,
    witnesses: Vec<(u32, Witness)>,
    /// Triangles to flood from, edges that need no more crossing, and triangles to sample all around.
    floods: VecDeque<Job>,
    crossed: Crossed,
    queue: VecDeque<Job>,
    /// Border jobs so far of each member of several triangles.
    jobs_of: Vec<u32>,
    schedule: Schedule,
    next_stream: u64,
    /// Known triangles whose turn is next.
    turns: [usize; 2],
    /// Rays of each strategy, and reverse rays.
    rays: [u64; COUNT],
    reverse: u64,
    validation_rays: u64,
    /// Looks at independent pixels so far, the last bound, and the rays at the last look of a run.
    looks: u32,
    missed: Option<Missed>,
    looked_at: u64,
    next_look: u64,
    self_hits: u64,
    dropped: u64,
    waves: u64,
    /// Members after each of the last waves, with the rays until then.
    history: VecDeque<(u64, u32)>,
    time: Duration,
    /// Buffers.
    found: Vec<Sight>,
    units: Vec<(Strategy, Unit)>,
    jobs: Vec<Job>,
    scratch: Vec<Scratch>,
}

impl<'a, C: RayCaster> Sampler<'a, C> {
    /// Begins a set with the triangles that touch the cell.
    ///
    /// `occluders` cast rays at the scene that `triangles` numbers.
    ///
    /// # Cost
    /// A look at the corners of all triangles whose instance is near the cell.
    ///
    /// # Errors
    /// [`VisibilityError::Option`] names an option that is out of its range.
    pub fn new(
        triangles: &'a Triangles<'a>,
        occluders: Occluders<'a, C>,
        cell: &'a ViewCell,
        options: Options,
    ) -> Result<Self, VisibilityError> {
        options.check()?;
        let all = triangles.bounds().union(*cell.bounds());
        let largest = all.min.abs().max(all.max.abs()).max_element();
        let seen = Bits::new(triangles.count());
        let mut sampler = Self {
            space: Space { triangles, occluders, cell, options, seen, largest },
            members: Bits::new(triangles.members()),
            known: Known::new(cell.bounds().center()),
            witnesses: Vec::new(),
            floods: VecDeque::new(),
            crossed: Crossed::default(),
            queue: VecDeque::new(),
            jobs_of: vec![0; if triangles.is_grouped() { triangles.members() as usize } else { 0 }],
            schedule: Schedule::default(),
            next_stream: 0,
            turns: [0; 2],
            rays: [0; COUNT],
            reverse: 0,
            validation_rays: 0,
            looks: 0,
            missed: None,
            looked_at: 0,
            next_look: 0,
            self_hits: 0,
            dropped: 0,
            waves: 0,
            history: VecDeque::new(),
            time: Duration::ZERO,
            found: Vec::new(),
            units: Vec::with_capacity(UNITS),
            jobs: Vec::new(),
            scratch: vec![Scratch::default(); UNITS],
        };
        for (triangle, corners) in triangles.near(cell.bounds()) {
            if touches(cell, corners) {
                sampler.space.seen.insert(triangle);
                sampler.known.push(triangle, corners);
                sampler.add_member(triangle, Witness::Touches(triangle));
            }
        }
        Ok(sampler)
    }

    /// Samples until the budget is used up. Going on later with a larger budget gives what one run would have given.
    pub fn run(&mut self, budget: &Budget) {
        let _ = self.run_with(budget, |_| ControlFlow::Continue(()));
    }

    /// As [`run`](Self::run), telling `progress` after every wave, which may break off. What was found stays, and the run
    /// can go on.
    pub fn run_with(
        &mut self,
        budget: &Budget,
        mut progress: impl FnMut(&Self) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        let start = Instant::now();
        while !self.is_done(budget, start.elapsed()) {
            self.wave();
            if let Some(limit) = budget.missed {
                self.look_for(limit);
            }
            progress(self)?;
        }
        ControlFlow::Continue(())
    }

    fn is_done(&self, budget: &Budget, elapsed: Duration) -> bool {
        let settled =
            budget.new_per_million.is_some_and(|limit| self.new_per_million().is_some_and(|new| new < limit));
        // Without triangles there is nothing to be seen.
        self.space.triangles.count() == 0
            || self.rays() >= budget.rays
            || settled
            || budget.missed.is_some_and(|limit| self.holds(limit))
            || budget.time.is_some_and(|limit| elapsed >= limit)
    }

    /// New members in the last million rays, once there were as many.
    pub fn new_per_million(&self) -> Option<f64> {
        let (first, last) = (self.history.front()?, self.history.back()?);
        let rays = last.0 - first.0;
        (rays >= 1_000_000).then(|| f64::from(last.1 - first.1) * 1e6 / rays as f64)
    }

    fn wave(&mut self) {
        let start = Instant::now();
        self.known.settle();
        self.plan();
        let wave = Wave { jobs: &self.jobs, known: &self.known };
        let space = &self.space;
        let work = self.units.iter().zip(&mut self.scratch);
        #[cfg(feature = "rayon")]
        {
            use rayon::prelude::*;
            let work: Vec<_> = work.collect();
            // One by one: a thread that is done takes single units from the other until none is left.
            work.into_par_iter()
                .with_max_len(1)
                .for_each(|(&(_, unit), scratch)| wave.run(space, unit, scratch));
        }
        #[cfg(not(feature = "rayon"))]
        work.for_each(|(&(_, unit), scratch)| wave.run(space, unit, scratch));
        self.merge();
        self.waves += 1;
        self.history.push_back((self.rays(), self.members.len()));
        while self.history.get(1).is_some_and(|next| self.rays() - next.0 >= 1_000_000) {
            self.history.pop_front();
        }
        self.time += start.elapsed();
    }

    /// Chooses the units of the next wave.
    fn plan(&mut self) {
        let options = self.space.options;
        self.units.clear();
        self.jobs.clear();
        if self.rays() < options.first_random {
            let missing = (options.first_random - self.rays()).div_ceil(RAYS_PER_UNIT as u64);
            self.push(Strategy::Random, missing.min(UNITS as u64) as usize);
            return;
        }
        let (floods, waiting, any_known) = (self.floods.len(), self.queue.len(), self.known.len() > 0);
        let borders_first = options.least_share == 0.0 && options.border;
        if borders_first {
            match (floods, waiting) {
                // A few seeds at a time, so that most of the set is found by following them.
                (0, 0) => self.push(Strategy::Random, 1),
                (0, _) => self.push(Strategy::Border, UNITS),
                _ => self.push(Strategy::Flood, UNITS),
            }
            return;
        }
        let revisit = options.revisit && options.border && any_known;
        let usable = [floods > 0, waiting > 0, true, options.mutation && any_known, revisit];
        let given = self.schedule.divide(UNITS, usable, options.least_share);
        // What short queues cannot use goes to the others.
        let most = [floods.div_ceil(FLOODS_PER_UNIT), waiting.div_ceil(JOBS_PER_UNIT)];
        let queued = [given[0].min(most[0]), given[1].min(most[1])];
        let rest = given[0] + given[1] - queued[0] - queued[1];
        let others = [false, false, usable[2], usable[3], usable[4]];
        let others = self.schedule.divide(rest, others, options.least_share);
        let given = [queued[0], queued[1], given[2] + others[2], given[3] + others[3], given[4] + others[4]];
        for (strategy, units) in STRATEGIES.into_iter().zip(given) {
            self.push(strategy, units);
        }
    }

    /// Appends units of a strategy to the wave.
    fn push(&mut self, strategy: Strategy, units: usize) {
        for _ in 0..units {
            let unit = match strategy {
                Strategy::Flood => {
                    let first = self.jobs.len();
                    while self.jobs.len() < first + FLOODS_PER_UNIT {
                        let Some(mut job) = self.floods.pop_front() else { break };
                        let corners = self.space.triangles.corners(job.sight.triangle);
                        job.edges = self.crossed.cross(corners);
                        if job.edges != 0 {
                            self.jobs.push(job);
                        }
                    }
                    if self.jobs.len() == first {
                        return;
                    }
                    Unit::Flood { first, last: self.jobs.len() }
                }
                Strategy::Border => {
                    let (first, count) = (self.jobs.len(), self.queue.len().min(JOBS_PER_UNIT));
                    if count == 0 {
                        return;
                    }
                    self.jobs.extend(self.queue.drain(..count));
                    Unit::Border { first, last: self.jobs.len() }
                }
                Strategy::Random => Unit::Random { stream: self.stream() },
                Strategy::Mutation => {
                    Unit::Mutation { stream: self.stream(), first: self.turn(0, mutation::TRIANGLES) }
                }
                Strategy::Revisit => {
                    Unit::Revisit { stream: self.stream(), first: self.turn(1, JOBS_PER_UNIT) }
                }
            };
            self.units.push((strategy, unit));
        }
    }

    /// Whose turn it is to be mutated or revisited: each strategy goes round the picture, so that what is sampled together
    /// lies together, and nothing is left out.
    fn turn(&mut self, which: usize, count: usize) -> usize {
        let turn = &mut self.turns[which];
        let first = *turn;
        *turn = (first + count) % self.known.len().max(1);
        first
    }

    fn stream(&mut self) -> u64 {
        self.next_stream += 1;
        self.next_stream
    }

    /// Takes in what the units found, in their order.
    fn merge(&mut self) {
        // Out of the way while the rest of the sampler changes.
        let (units, scratch) = (std::mem::take(&mut self.units), std::mem::take(&mut self.scratch));
        let (mut found, mut rays) = ([0u64; COUNT], [0u64; COUNT]);
        for (&(strategy, _), scratch) in units.iter().zip(&scratch) {
            let before = self.members.len();
            scratch.out.sights.iter().for_each(|sight| self.see(sight));
            scratch.out.later.iter().for_each(|job| self.wait(false, *job));
            found[strategy as usize] += u64::from(self.members.len() - before);
            rays[strategy as usize] += scratch.out.rays + scratch.out.reverse;
            self.rays[strategy as usize] += scratch.out.rays;
            self.reverse += scratch.out.reverse;
            self.self_hits += scratch.out.self_hits;
        }
        (self.units, self.scratch) = (units, scratch);
        for strategy in STRATEGIES {
            self.schedule.record(strategy, found[strategy as usize], rays[strategy as usize]);
        }
    }

    /// Takes in a line of sight; that to a new triangle is followed to its neighbours.
    fn see(&mut self, sight: &Sight) {
        if !self.space.seen.insert(sight.triangle) {
            return;
        }
        self.add_member(sight.triangle, Witness::Ray(*sight));
        if self.space.triangles.is_grouped() {
            let jobs = &mut self.jobs_of[self.space.triangles.member(sight.triangle) as usize];
            if *jobs >= self.space.options.jobs_per_member {
                return;
            }
            *jobs += 1;
        }
        self.known.push(sight.triangle, self.space.triangles.corners(sight.triangle));
        if !self.space.options.border {
            return;
        }
        let tolerance = self.space.options.tolerance[0];
        self.wait(self.space.options.flood, Job { sight: *sight, tolerance, edges: 0 });
    }

    /// Puts a job into the queue of floods or of borders.
    fn wait(&mut self, flood: bool, job: Job) {
        let queue = if flood { &mut self.floods } else { &mut self.queue };
        if queue.len() < MOST_WAITING {
            queue.push_back(job);
        } else {
            self.dropped += 1;
        }
    }

    fn add_member(&mut self, triangle: u32, witness: Witness) {
        let member = self.space.triangles.member(triangle);
        if self.members.insert(member) && self.space.options.witnesses {
            self.witnesses.push((member, witness));
        }
    }

    /// The members seen so far.
    pub fn pvs(&self) -> Pvs {
        Pvs::from_sorted(self.members.iter())
    }

    /// Looks at `rays` random pixels from viewpoints in the cell, none of which had any part in making the set, and bounds the share of
    /// pixels that show something missing. What was missing is then added, so the bound holds for the set as it is
    /// afterwards all the more.
    ///
    /// `confidence` is that of this look alone. [`Budget::missed`] has many looks hold together.
    ///
    /// # Errors
    /// [`VisibilityError::Option`] when `confidence` is not above 0 and below 1.
    pub fn validate(&mut self, rays: u64, confidence: f64) -> Result<Missed, VisibilityError> {
        check_confidence(confidence)?;
        let (misses, rays) = self.look(rays, u64::MAX);
        let missed = Missed::new(misses, rays, confidence);
        self.missed = Some(missed);
        Ok(missed)
    }

    /// The last bound on what is missing.
    pub fn missed(&self) -> Option<Missed> {
        self.missed
    }

    fn holds(&self, limit: MissedLimit) -> bool {
        self.missed.is_some_and(|m| m.bound.value <= limit.share && m.confidence >= limit.confidence)
    }

    /// Looks whether a limit is kept, when there was time for the set to grow since the last look.
    fn look_for(&mut self, limit: MissedLimit) {
        let needed = |look| rays_to_prove(limit.share, confidence_of_look(limit.confidence, look));
        // A third more rays than last time, and as many as the look costs.
        let due = (self.looked_at + self.looked_at / 3).max(self.looked_at + needed(self.looks + 1) / 2);
        if self.rays() < due.max(self.space.options.first_random) || self.holds(limit) {
            return;
        }
        self.looked_at = self.rays();
        self.looks += 1;
        let confidence = confidence_of_look(limit.confidence, self.looks);
        let rays = rays_to_prove(limit.share, confidence);
        let forgiven = (0..).find(|&k| upper_bound(k + 1, rays, confidence) > limit.share).unwrap_or(0);
        let (misses, shot) = self.look(rays, forgiven);
        if shot == rays {
            let missed = Missed::new(misses, rays, confidence);
            self.missed = Some(Missed { confidence: limit.confidence, ..missed });
        }
    }

    /// Shoots view rays, all of them unless more than `most` miss, and adds what was missing.
    fn look(&mut self, rays: u64, most: u64) -> (u64, u64) {
        let (mut misses, mut shot) = (0, 0);
        let mut scratch = std::mem::take(&mut self.scratch);
        while shot < rays && misses <= most {
            let first = self.next_look;
            let left = rays - shot;
            let (space, members) = (&self.space, &self.members);
            let units = left.div_ceil(RAYS_PER_LOOK_UNIT).min(UNITS as u64);
            let run = |(i, scratch): (usize, &mut Scratch)| {
                let done = i as u64 * RAYS_PER_LOOK_UNIT;
                look(space, members, first + i as u64, (left - done).min(RAYS_PER_LOOK_UNIT), scratch)
            };
            let work = scratch[..units as usize].iter_mut().enumerate();
            #[cfg(feature = "rayon")]
            let missed: u64 = {
                use rayon::prelude::*;
                let work: Vec<_> = work.collect();
                work.into_par_iter().with_max_len(1).map(run).sum()
            };
            #[cfg(not(feature = "rayon"))]
            let missed: u64 = work.map(run).sum();
            self.next_look += units;
            misses += missed;
            shot += left.min(units * RAYS_PER_LOOK_UNIT);
            // Only now: within one look the set must stay as it is. What this batch missed may be missed again by the next,
            // which counts twice, as it should.
            self.found.extend(scratch[..units as usize].iter().flat_map(|s| s.out.sights.iter().copied()));
        }
        self.scratch = scratch;
        let mut found = std::mem::take(&mut self.found);
        found.drain(..).for_each(|sight| self.see(&sight));
        self.found = found;
        self.validation_rays += shot;
        (misses, shot)
    }

    /// Whether a member was seen so far.
    ///
    /// # Panics
    /// When there is no such member.
    pub fn contains(&self, member: u32) -> bool {
        assert!(member < self.space.triangles.members(), "no member {member}");
        self.members.contains(member)
    }

    /// How many members were seen so far.
    pub fn len(&self) -> u32 {
        self.members.len()
    }

    /// Whether nothing was seen so far.
    pub fn is_empty(&self) -> bool {
        self.members.len() == 0
    }

    /// Every member seen so far with the reason, in order of discovery; empty unless
    /// [`Options::witnesses`] asks for them.
    pub fn witnesses(&self) -> &[(u32, Witness)] {
        &self.witnesses
    }

    /// Rays shot for the set so far.
    pub fn rays(&self) -> u64 {
        self.rays.iter().sum::<u64>() + self.reverse
    }

    /// Time and work so far. Counters: rays by strategy, waves, border rays that met their own triangle, waiting jobs.
    pub fn cost(&self) -> Cost {
        let mut counters = Counters::new();
        for (name, count) in [
            ("rays", self.rays()),
            ("random", self.rays[Strategy::Random as usize]),
            ("flood", self.rays[Strategy::Flood as usize]),
            ("border", self.rays[Strategy::Border as usize]),
            ("reverse", self.reverse),
            ("mutation", self.rays[Strategy::Mutation as usize]),
            ("revisit", self.rays[Strategy::Revisit as usize]),
            ("validation", self.validation_rays),
            ("waves", self.waves),
            ("self_hits", self.self_hits),
            ("waiting", (self.floods.len() + self.queue.len()) as u64),
            ("dropped", self.dropped),
        ] {
            counters.add(name, count);
        }
        let jobs =
            (self.floods.len() + self.queue.len()) * size_of::<Job>() + self.jobs_of.len() * size_of::<u32>();
        let bits = self.members.bytes() + self.space.seen.bytes();
        let witnesses = self.witnesses.len() * size_of::<(u32, Witness)>();
        let bytes = self.known.bytes() + self.crossed.bytes() + jobs + bits + witnesses;
        Cost { time: self.time, bytes: bytes as u64, counters }
    }
}

pub(crate) fn check_confidence(confidence: f64) -> Result<(), VisibilityError> {
    let (option, value, range) = ("confidence", confidence, "above 0 and below 1");
    if confidence > 0.0 && confidence < 1.0 {
        Ok(())
    } else {
        Err(VisibilityError::Option { option, value, range })
    }
}
