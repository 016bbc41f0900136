//! Levels of detail under a time limit: the multiple-choice knapsack problem.
//!
//! Every object takes one of its levels; a level has a cost and a benefit. Cheaper levels that are also better make others pointless;
//! what remains per object is its convex hull, along which each step up has a falling benefit per cost. The greedy answer
//! takes the best steps of all objects until the next one does not fit (Funkhouser & Séquin 1993).
//!
//! Differs: levels that do not fit even alone are left out before the hulls are made. Only then is any step on a hull affordable by itself, and
//! the better of the greedy answer and the best single level worth half of the optimum.

use crate::{Millis, TimingError};

/// A level of detail of an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// What drawing it takes.
    pub cost: Millis,
    /// What it is worth; any unit, the same for all objects.
    pub benefit: f64,
}

/// Largest cost and benefit, so that sums over any number of objects and their products stay finite.
const LARGEST: f64 = 1e100;

/// A step up along an object's hull.
#[derive(Clone, Copy, Debug)]
struct Step {
    /// Benefit gained per millisecond; never rises along an object.
    efficiency: f64,
    cost: f64,
    benefit: f64,
    object: u32,
    /// Level reached.
    level: u32,
    /// Place along the object's hull.
    rank: u32,
}

/// What was chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Choice {
    /// Time of all chosen levels.
    pub cost: Millis,
    /// Worth of all chosen levels.
    pub benefit: f64,
    /// No choice within the limit is worth more: the optimum of the relaxed problem.
    pub bound: f64,
    /// Whether even the cheapest levels exceed the limit; those are chosen then.
    pub over: bool,
}

/// One level alone above the cheapest ones: what it gains.
#[derive(Clone, Copy, Debug)]
struct Single {
    gain: f64,
    object: u32,
    level: u32,
}

/// Chooses levels; keeps its buffers from frame to frame.
#[derive(Clone, Debug, Default)]
pub struct Budget {
    steps: Vec<Step>,
    buckets: Vec<Bucket>,
    /// The steps about where time runs out.
    near: Vec<Step>,
    hull: Vec<(u32, Level)>,
    order: Vec<u32>,
    cheapest: Vec<u32>,
    chosen: Vec<u32>,
    /// Rank of each chosen level along its hull.
    ranks: Vec<u32>,
}

/// Steps of about the same efficiency.
#[derive(Clone, Copy, Debug, Default)]
struct Bucket {
    cost: f64,
    steps: usize,
}

/// Number of buckets that steps are counted in: their costs and counts stay in the nearest cache.
const BUCKETS: usize = 1024;

/// How many steps after the break are tried for the room that is left: what lies farther gains almost nothing.
const LOOK: usize = 256;

impl Budget {
    /// An empty chooser.
    pub fn new() -> Self {
        Self::default()
    }

    /// Chooses a level for each object. `first[i]..first[i + 1]` are object i's levels in `levels`, in any order.
    ///
    /// # Accuracy
    /// What is gained over the cheapest levels is at least half of what can be, and with many objects far closer;
    /// [`Choice::bound`] says how close at least. The answer does not depend on earlier frames.
    ///
    /// # Cost
    /// Expected linear in the objects (counting and selection, not sorting), n log n in the levels of one object: about 0.8 ms for 10,000
    /// objects of five levels. No allocation in steady state.
    ///
    /// # Errors
    /// [`TimingError::Level`] for a cost that is negative, a number that is not finite or beyond 10¹⁰⁰, [`TimingError::NoLevel`] for an
    /// object without levels. Nothing is chosen then.
    pub fn choose(&mut self, levels: &[Level], first: &[u32], limit: Millis) -> Result<Choice, TimingError> {
        self.chosen.clear();
        let base = self.choose_cheapest(levels, first)?;
        self.chosen.extend_from_slice(&self.cheapest);
        let room = limit.0 - base.cost.0;
        // A limit that is not a number leaves no room either.
        if room < 0.0 || room.is_nan() {
            return Ok(Choice { over: true, bound: base.benefit, ..base });
        }
        let single = self.collect_steps(levels, first, room);
        Ok(self.take_best(levels, first, base, room, single))
    }

    /// The level of each object, as an index among its own levels.
    pub fn chosen(&self) -> &[u32] {
        &self.chosen
    }

    /// Checks all levels and finds every object's cheapest one; of equally cheap ones the best.
    fn choose_cheapest(&mut self, levels: &[Level], first: &[u32]) -> Result<Choice, TimingError> {
        self.cheapest.clear();
        let mut base = Choice::default();
        for (object, range) in first.windows(2).enumerate() {
            let own = levels.get(range[0] as usize..range[1] as usize).unwrap_or(&[]);
            let Some(lowest) = (0..own.len()).min_by(|&a, &b| cheaper(&own[a], &own[b])) else {
                return Err(TimingError::NoLevel { object });
            };
            let usable = |l: &Level| (0.0..=LARGEST).contains(&l.cost.0) && l.benefit.abs() <= LARGEST;
            if let Some(level) = own.iter().position(|l| !usable(l)) {
                return Err(TimingError::Level { object, level });
            }
            self.cheapest.push(lowest as u32);
            base.cost += own[lowest].cost;
            base.benefit += own[lowest].benefit;
        }
        Ok(base)
    }

    /// Collects the steps of all objects' hulls; returns the single level that gains most.
    fn collect_steps(&mut self, levels: &[Level], first: &[u32], room: f64) -> Option<Single> {
        self.steps.clear();
        self.ranks.clear();
        let mut best: Option<Single> = None;
        for (object, range) in first.windows(2).enumerate() {
            self.ranks.push(0);
            let own = &levels[range[0] as usize..range[1] as usize];
            self.hull_of(own, self.cheapest[object], room);
            let mut least = f64::MAX;
            for (rank, pair) in self.hull.windows(2).enumerate() {
                let (from, to) = (pair[0].1, pair[1].1);
                let (cost, benefit) = ((to.cost - from.cost).0, to.benefit - from.benefit);
                // Rounding must not put a step before the one that it builds on.
                least = least.min(benefit / cost);
                let (object, level) = (object as u32, pair[1].0);
                self.steps.push(Step {
                    efficiency: least,
                    cost,
                    benefit,
                    object,
                    level,
                    rank: rank as u32 + 1,
                });
            }
            // Benefit rises along a hull, so its last level is the object's best affordable one.
            if let [(_, lowest), .., (level, top)] = self.hull[..] {
                let gain = top.benefit - lowest.benefit;
                if best.is_none_or(|b| gain > b.gain) {
                    best = Some(Single { gain, object: object as u32, level });
                }
            }
        }
        best
    }

    /// The affordable levels of one object that lie on the upper hull of benefit over cost, cheapest first.
    fn hull_of(&mut self, own: &[Level], cheapest: u32, room: f64) {
        let Self { hull, order, .. } = self;
        hull.clear();
        order.clear();
        let at = |i: u32| own[i as usize];
        let affordable = |&i: &u32| (at(i).cost - at(cheapest).cost).0 <= room;
        order.extend((0..own.len() as u32).filter(affordable));
        order.sort_unstable_by(|&a, &b| cheaper(&at(a), &at(b)).then(a.cmp(&b)));
        for &i in order.iter() {
            let level = at(i);
            if hull.last().is_some_and(|(_, top)| level.benefit <= top.benefit) {
                continue;
            }
            // A middle level under the line between its neighbours is never worth its cost.
            while let [.., (_, a), (_, b)] = hull[..] {
                let before = (b.benefit - a.benefit) * (level.cost - b.cost).0;
                let after = (level.benefit - b.benefit) * (b.cost - a.cost).0;
                if before > after {
                    break;
                }
                hull.pop();
            }
            hull.push((i, level));
        }
    }

    fn take_best(
        &mut self,
        levels: &[Level],
        first: &[u32],
        base: Choice,
        room: f64,
        single: Option<Single>,
    ) -> Choice {
        let (mut choice, mut left) = (base, room);
        self.take_surely_affordable(&mut left, &mut choice);
        let mut near = std::mem::take(&mut self.near);
        let taken = partition_by_room(&mut near, left);
        near[..taken].iter().for_each(|s| self.take(s, &mut left, &mut choice));
        let next = near[taken..].iter().min_by(|a, b| order(a, b));
        choice.bound = choice.benefit + next.map_or(0.0, |s| s.efficiency * left.max(0.0));
        self.fill(&mut near[taken..], &mut left, &mut choice);
        self.near = near;
        if let Some(s) = single.filter(|s| base.benefit + s.gain > choice.benefit) {
            self.chosen.copy_from_slice(&self.cheapest);
            self.chosen[s.object as usize] = s.level;
            choice.benefit = base.benefit + s.gain;
        }
        choice.cost =
            self.chosen.iter().zip(first).map(|(&level, &f)| levels[(f + level) as usize].cost).sum();
        choice
    }

    /// Counts the steps by efficiency; takes those whose whole bucket fits with all better ones. `near` gets the
    /// bucket in which time runs out, and as many below it as [`Self::fill`] looks at.
    fn take_surely_affordable(&mut self, left: &mut f64, choice: &mut Choice) {
        let bucket_of = bucketing(&self.steps);
        self.buckets.clear();
        self.buckets.resize(BUCKETS, Bucket::default());
        for s in &self.steps {
            let bucket = &mut self.buckets[bucket_of(s)];
            bucket.cost += s.cost;
            bucket.steps += 1;
        }
        let (mut best, mut cost) = (0, 0.0);
        while best < BUCKETS && cost + self.buckets[best].cost <= *left {
            cost += self.buckets[best].cost;
            best += 1;
        }
        let (mut last, mut steps) = (best, 0);
        while last < BUCKETS && (last == best || steps < LOOK) {
            steps += if last == best { 0 } else { self.buckets[last].steps };
            last += 1;
        }
        self.near.clear();
        let all = std::mem::take(&mut self.steps);
        for s in &all {
            match bucket_of(s) {
                bucket if bucket < best => self.take(s, left, choice),
                bucket if bucket < last => self.near.push(*s),
                _ => {}
            }
        }
        self.steps = all;
    }

    /// Takes a step that is affordable together with those that it builds on, in any order of the two.
    fn take(&mut self, step: &Step, left: &mut f64, choice: &mut Choice) {
        *left -= step.cost;
        choice.benefit += step.benefit;
        let object = step.object as usize;
        if step.rank > self.ranks[object] {
            (self.ranks[object], self.chosen[object]) = (step.rank, step.level);
        }
    }

    /// Takes further steps that still fit, the most efficient first.
    fn fill(&mut self, rest: &mut [Step], left: &mut f64, choice: &mut Choice) {
        let looked = rest.len().min(LOOK);
        if looked < rest.len() {
            rest.select_nth_unstable_by(looked, order);
        }
        rest[..looked].sort_unstable_by(order);
        for s in &rest[..looked] {
            // A step builds on the one before it; where that did not fit, this one is out of reach.
            if s.cost <= *left && self.ranks[s.object as usize] + 1 == s.rank {
                self.take(s, left, choice);
            }
        }
    }
}

/// The bucket of a step, the most efficient ones first. The bits of positive numbers are in the order of the numbers,
/// so buckets are as fine relative to the efficiency as the spread of all steps allows.
fn bucketing(steps: &[Step]) -> impl Fn(&Step) -> usize + use<> {
    let bits = |s: &Step| s.efficiency.to_bits();
    let (least, most) = steps.iter().map(bits).fold((u64::MAX, 0), |(a, b), x| (a.min(x), b.max(x)));
    let spread = u64::BITS - most.saturating_sub(least).leading_zeros();
    let shift = spread.saturating_sub(BUCKETS.ilog2());
    move |s| ((most - bits(s)) >> shift) as usize
}

/// Cheapest first; of equally cheap ones the best first.
fn cheaper(a: &Level, b: &Level) -> std::cmp::Ordering {
    a.cost.0.total_cmp(&b.cost.0).then(b.benefit.total_cmp(&a.benefit))
}

/// Most efficient first; ties in the order of the objects and up their hulls, so that results do not depend on selection.
fn order(a: &Step, b: &Step) -> std::cmp::Ordering {
    b.efficiency.total_cmp(&a.efficiency).then(a.object.cmp(&b.object)).then(a.rank.cmp(&b.rank))
}

/// Brings the most efficient steps that fit together to the front and counts them: a weighted selection in expected linear time.
fn partition_by_room(steps: &mut [Step], mut room: f64) -> usize {
    let (mut low, mut high) = (0, steps.len());
    while high - low > 1 {
        let middle = low + (high - low) / 2;
        steps[low..high].select_nth_unstable_by(middle - low, order);
        let cost: f64 = steps[low..middle].iter().map(|s| s.cost).sum();
        if cost <= room {
            room -= cost;
            low = middle;
        } else {
            high = middle;
        }
    }
    if low < high && steps[low].cost <= room { low + 1 } else { low }
}

/// The largest benefit within `limit`, by dynamic programming over whole cost units: for tests and small problems.
///
/// `levels` are (cost, benefit), `first` as in [`Budget::choose`]. `None` when even the cheapest levels exceed the limit.
///
/// # Cost
/// O(levels · limit) time, O(objects · limit) memory.
pub fn exact(levels: &[(u32, f64)], first: &[u32], limit: u32) -> Option<f64> {
    let mut best = vec![f64::NEG_INFINITY; limit as usize + 1];
    best[0] = 0.0;
    for range in first.windows(2) {
        let mut next = vec![f64::NEG_INFINITY; best.len()];
        for &(cost, benefit) in &levels[range[0] as usize..range[1] as usize] {
            for spent in 0..best.len().saturating_sub(cost as usize) {
                let total = best[spent] + benefit;
                let at = &mut next[spent + cost as usize];
                *at = at.max(total);
            }
        }
        best = next;
    }
    best.into_iter().reduce(f64::max).filter(|b| b.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Random(u64);

    impl Random {
        fn below(&mut self, n: u32) -> u32 {
            self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            ((self.0 >> 33) as u32) % n
        }
    }

    type Problem = (Vec<(u32, f64)>, Vec<u32>);

    fn problem(random: &mut Random, objects: u32) -> Problem {
        let (mut levels, mut first) = (Vec::new(), vec![0]);
        for _ in 0..objects {
            for k in 0..1 + random.below(5) {
                levels
                    .push((1 + random.below(20) + 7 * k, f64::from(random.below(100)) + 30.0 * f64::from(k)));
            }
            first.push(levels.len() as u32);
        }
        (levels, first)
    }

    fn solve(problem: &Problem, limit: u32) -> (Choice, Vec<u32>) {
        let levels: Vec<Level> =
            problem.0.iter().map(|&(c, benefit)| Level { cost: Millis(f64::from(c)), benefit }).collect();
        let mut budget = Budget::new();
        let choice = budget.choose(&levels, &problem.1, Millis(f64::from(limit))).unwrap();
        (choice, budget.chosen().to_vec())
    }

    #[test]
    fn never_over_the_limit_never_below_half_and_close_on_average() {
        let mut random = Random(5);
        let (mut shares, mut solved) = (0.0, 0);
        for round in 0..600 {
            let objects = 1 + random.below(if round % 2 == 0 { 6 } else { 30 });
            let p = problem(&mut random, objects);
            let limit = random.below(30 * objects);
            let (choice, chosen) = solve(&p, limit);
            let optimum = exact(&p.0, &p.1, limit);
            assert_eq!(choice.over, optimum.is_none(), "round {round}");
            let own = |i: usize| p.0[(p.1[i] + chosen[i]) as usize];
            let cost: u32 = (0..objects as usize).map(|i| own(i).0).sum();
            let benefit: f64 = (0..objects as usize).map(|i| own(i).1).sum();
            assert!(
                (choice.cost.0 - f64::from(cost)).abs() < 1e-9 && (choice.benefit - benefit).abs() < 1e-6,
                "round {round}"
            );
            let Some(optimum) = optimum else { continue };
            assert!(cost <= limit && benefit >= 0.5 * optimum, "round {round}: {benefit} of {optimum}");
            assert!(optimum <= choice.bound + 1e-6, "round {round}: {optimum} above {}", choice.bound);
            shares += if optimum > 0.0 { benefit / optimum } else { 1.0 };
            solved += 1;
        }
        assert!(solved > 200 && shares / f64::from(solved) >= 0.98, "{}", shares / f64::from(solved));
    }

    #[test]
    fn more_time_is_never_worth_less_than_the_bound_allows_and_input_order_does_not_matter() {
        let mut random = Random(8);
        let p = problem(&mut random, 200);
        let (a, _) = solve(&p, 3000);
        let (b, _) = solve(&p, 6000);
        assert!(b.benefit >= a.benefit);
        // The same objects in reverse.
        let mut reversed: Problem = (Vec::new(), vec![0]);
        for range in p.1.windows(2).rev() {
            reversed.0.extend(p.0[range[0] as usize..range[1] as usize].iter().rev());
            reversed.1.push(reversed.0.len() as u32);
        }
        let (c, _) = solve(&reversed, 3000);
        assert!((a.benefit - c.benefit).abs() <= 0.01 * a.benefit);
    }

    #[test]
    fn bad_levels_are_named() {
        let level = |cost, benefit| Level { cost: Millis(cost), benefit };
        let mut budget = Budget::new();
        let error =
            budget.choose(&[level(1.0, 1.0), level(f64::NAN, 1.0)], &[0, 1, 2], Millis(5.0)).unwrap_err();
        assert_eq!(
            error.to_string(),
            "level 0 of object 1: a cost must lie in 0..=1e100, a benefit in -1e100..=1e100"
        );
        assert!(budget.choose(&[level(-1.0, 1.0)], &[0, 1], Millis(5.0)).is_err());
        assert!(budget.choose(&[level(1.0, 1.0)], &[0, 1, 1], Millis(5.0)).is_err());
        assert_eq!(budget.choose(&[], &[0], Millis(5.0)).unwrap().benefit, 0.0);
        assert_eq!(budget.choose(&[], &[], Millis(5.0)).unwrap().benefit, 0.0);
    }

    /// Best gain over the cheapest levels, by trying every combination.
    fn best_gain(levels: &[Level], first: &[u32], room: f64) -> f64 {
        let Some((&[from, to], _)) =
            first.split_at_checked(2).map(|(a, b)| (<&[u32; 2]>::try_from(a).unwrap(), b))
        else {
            return 0.0;
        };
        let own = &levels[from as usize..to as usize];
        let cheapest = own.iter().min_by(|a, b| cheaper(a, b)).unwrap();
        let with = |l: &Level| {
            let left = room - (l.cost - cheapest.cost).0;
            if left < 0.0 { 0.0 } else { l.benefit - cheapest.benefit + best_gain(levels, &first[1..], left) }
        };
        own.iter().map(with).fold(0.0, f64::max)
    }

    #[test]
    fn levels_that_never_fit_do_not_hide_those_that_do() {
        // The dearest level is the most efficient one of every object, and fits nowhere.
        let levels: Vec<Level> = (0..4)
            .flat_map(|_| [(0.0, 0.0), (25.0, 20.0), (101.0, 101.0)])
            .map(|(c, benefit)| Level { cost: Millis(c), benefit })
            .collect();
        let first: Vec<u32> = (0..=4).map(|i| 3 * i).collect();
        let mut budget = Budget::new();
        let choice = budget.choose(&levels, &first, Millis(100.0)).unwrap();
        assert_eq!((choice.benefit, choice.cost.0, choice.bound), (80.0, 100.0, 80.0));
    }

    #[test]
    fn equal_efficiencies_and_shuffled_extremes_keep_half_and_the_limit() {
        let mut random = Random(77);
        let mut budget = Budget::new();
        for round in 0..3000 {
            let objects = 1 + random.below(5);
            let (mut levels, mut first) = (Vec::new(), vec![0u32]);
            for _ in 0..objects {
                for _ in 0..1 + random.below(4) {
                    let huge = if random.below(6) == 0 { 40.0 } else { 1.0 };
                    let cost = 0.1 * f64::from(random.below(9)) * huge;
                    // Every third round all steps are worth the same per cost, up to rounding.
                    let benefit =
                        if round % 3 == 0 { 3.0 * cost } else { f64::from(random.below(60)) * huge - 9.0 };
                    levels.push(Level { cost: Millis(cost), benefit });
                }
                first.push(levels.len() as u32);
            }
            let limit = 0.1 * f64::from(random.below(60));
            let choice = budget.choose(&levels, &first, Millis(limit)).unwrap();
            let own = |i: usize| levels[(first[i] + budget.chosen()[i]) as usize];
            let cost: f64 = (0..objects as usize).map(|i| own(i).cost.0).sum();
            let benefit: f64 = (0..objects as usize).map(|i| own(i).benefit).sum();
            assert!(
                (choice.benefit - benefit).abs() < 1e-9 && (choice.cost.0 - cost).abs() < 1e-9,
                "round {round}"
            );
            let cheapest = |i: usize| {
                let own = &levels[first[i] as usize..first[i + 1] as usize];
                *own.iter().min_by(|a, b| cheaper(a, b)).unwrap()
            };
            let base: f64 = (0..objects as usize).map(|i| cheapest(i).cost.0).sum();
            let worth: f64 = (0..objects as usize).map(|i| cheapest(i).benefit).sum();
            assert_eq!(choice.over, base > limit, "round {round}");
            if !choice.over {
                let optimum = best_gain(&levels, &first, limit - base);
                assert!(cost <= limit + 1e-9 && benefit - worth >= 0.5 * optimum - 1e-9, "round {round}");
                assert!(worth + optimum <= choice.bound + 1e-9, "round {round}");
            }
        }
    }

    #[test]
    fn one_huge_level_is_taken_when_it_is_worth_more_than_all_others() {
        let mut levels =
            vec![Level { cost: Millis(0.0), benefit: 0.0 }, Level { cost: Millis(100.0), benefit: 99.0 }];
        let mut first = vec![0, 2];
        for _ in 0..10 {
            levels.extend([(0.0, 0.0), (0.1, 0.2)].map(|(c, benefit)| Level { cost: Millis(c), benefit }));
            first.push(levels.len() as u32);
        }
        let mut budget = Budget::new();
        let choice = budget.choose(&levels, &first, Millis(100.0)).unwrap();
        assert!(choice.benefit == 99.0 && choice.cost.0 == 100.0);
    }

    #[test]
    fn earlier_frames_change_nothing() {
        let mut random = Random(21);
        let mut kept = Budget::new();
        for frame in 0..40 {
            let p = problem(&mut random, 300);
            let limit = 2000.0 + 90.0 * f64::from(frame % 17);
            let levels: Vec<Level> =
                p.0.iter().map(|&(c, benefit)| Level { cost: Millis(f64::from(c)), benefit }).collect();
            let warm = kept.choose(&levels, &p.1, Millis(limit)).unwrap();
            let mut fresh = Budget::new();
            let cold = fresh.choose(&levels, &p.1, Millis(limit)).unwrap();
            assert_eq!(kept.chosen(), fresh.chosen(), "frame {frame}");
            assert!((warm.benefit - cold.benefit).abs() < 1e-9 && (warm.bound - cold.bound).abs() < 1e-9);
        }
    }

    #[test]
    fn thousands_of_levels_and_a_million_objects_are_fine() {
        let many: Vec<Level> =
            (0..50_000).map(|i| Level { cost: Millis(f64::from(i)), benefit: f64::from(i).sqrt() }).collect();
        let mut budget = Budget::new();
        let choice = budget.choose(&many, &[0, 50_000], Millis(40_000.0)).unwrap();
        assert_eq!((choice.cost.0, budget.chosen()[0]), (40_000.0, 40_000));
        let levels: Vec<Level> = (0..2_000_000u32)
            .map(|i| Level {
                cost: Millis(f64::from(i % 2)),
                benefit: f64::from(i % 2) * f64::from(1 + i % 97),
            })
            .collect();
        let first: Vec<u32> = (0..=1_000_000).map(|i| 2 * i).collect();
        let choice = budget.choose(&levels, &first, Millis(400_000.0)).unwrap();
        assert!(choice.cost.0 == 400_000.0 && choice.benefit == choice.bound);
        let over = budget.choose(&levels, &first, Millis(f64::NAN)).unwrap();
        assert!(over.over && over.cost.0 == 0.0);
        assert!(budget.choose(&levels, &first, Millis(f64::INFINITY)).unwrap().cost.0 == 1e6);
    }
}
