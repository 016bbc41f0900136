//! Levels of detail under a time limit: the multiple-choice knapsack problem.
//!
//! Every object takes one of its levels; a level has a cost and a benefit. Cheaper levels that are also better make others pointless;
//! what remains per object is its convex hull, along which each step up has a falling benefit per cost. The greedy answer
//! takes the best steps of all objects until the next one does not fit (Funkhouser & Séquin 1993 as corrected by Wimmer 2007, 2.6).

use crate::{Millis, TimingError};

/// A level of detail of an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// What drawing it takes.
    pub cost: Millis,
    /// What it is worth; any unit, the same for all objects.
    pub benefit: f64,
}

/// A step up along an object's hull.
#[derive(Clone, Copy, Debug)]
struct Step {
    /// Benefit gained per millisecond; falls along an object.
    efficiency: f64,
    cost: f64,
    benefit: f64,
    object: u32,
    /// Level reached.
    level: u32,
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
    /// Whether even the cheapest levels exceed the limit.
    pub over: bool,
}

/// Chooses levels; keeps its buffers from frame to frame.
#[derive(Clone, Debug, Default)]
pub struct Budget {
    steps: Vec<Step>,
    hull: Vec<(u32, Level)>,
    chosen: Vec<u32>,
}

impl Budget {
    /// An empty chooser.
    pub fn new() -> Self {
        Self::default()
    }

    /// Chooses a level for each object. `first[i]..first[i + 1]` are object i's levels in `levels`, in any order.
    ///
    /// # Accuracy
    /// The benefit is at least half of the optimum (of what can be gained over the cheapest levels), and with many objects far closer;
    /// [`Choice::bound`] says how close at least.
    ///
    /// # Cost
    /// About 0.5 ms for 10,000 objects of five levels; linear in the levels (selection, not sorting); no allocation in steady state.
    ///
    /// # Errors
    /// [`TimingError::Level`] for a cost that is negative or not finite or a benefit that is not finite, [`TimingError::NoLevel`] for an
    /// object without levels.
    pub fn choose(&mut self, levels: &[Level], first: &[u32], limit: Millis) -> Result<Choice, TimingError> {
        let base = self.gather(levels, first)?;
        let room = limit.0 - base.cost.0;
        if room < 0.0 {
            return Ok(Choice { over: true, bound: base.benefit, ..base });
        }
        Ok(self.take_best(levels, first, base, room))
    }

    /// The level of each object, as an index among its own levels.
    pub fn chosen(&self) -> &[u32] {
        &self.chosen
    }

    /// Collects the steps of all objects' hulls, and chooses their cheapest levels.
    fn gather(&mut self, levels: &[Level], first: &[u32]) -> Result<Choice, TimingError> {
        self.steps.clear();
        self.chosen.clear();
        let mut base = Choice::default();
        for (object, range) in first.windows(2).enumerate() {
            let own = levels.get(range[0] as usize..range[1] as usize).unwrap_or(&[]);
            if own.is_empty() {
                return Err(TimingError::NoLevel { object });
            }
            if let Some(level) =
                own.iter().position(|l| !(l.cost.0.is_finite() && l.cost.0 >= 0.0 && l.benefit.is_finite()))
            {
                return Err(TimingError::Level { object, level });
            }
            self.hull_of(own);
            let (cheapest, lowest) = self.hull[0];
            self.chosen.push(cheapest);
            base.cost += lowest.cost;
            base.benefit += lowest.benefit;
            for pair in self.hull.windows(2) {
                let (cost, benefit) =
                    ((pair[1].1.cost - pair[0].1.cost).0, pair[1].1.benefit - pair[0].1.benefit);
                let step = Step {
                    efficiency: benefit / cost,
                    cost,
                    benefit,
                    object: object as u32,
                    level: pair[1].0,
                };
                self.steps.push(step);
            }
        }
        Ok(base)
    }

    /// The levels of one object that lie on the upper hull of benefit over cost, cheapest first.
    fn hull_of(&mut self, own: &[Level]) {
        let hull = &mut self.hull;
        hull.clear();
        let mut order: [u32; 16] = std::array::from_fn(|i| i as u32);
        let mut long: Vec<u32>;
        let order: &mut [u32] = if own.len() <= 16 {
            &mut order[..own.len()]
        } else {
            long = (0..own.len() as u32).collect();
            &mut long
        };
        let at = |i: u32| own[i as usize];
        order.sort_unstable_by(|&a, &b| {
            at(a)
                .cost
                .0
                .total_cmp(&at(b).cost.0)
                .then(at(b).benefit.total_cmp(&at(a).benefit))
                .then(a.cmp(&b))
        });
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

    fn take_best(&mut self, levels: &[Level], first: &[u32], base: Choice, room: f64) -> Choice {
        let taken = partition_by_room(&mut self.steps, room);
        let mut choice = base;
        let mut left = room;
        for s in &self.steps[..taken] {
            left -= s.cost;
            choice.benefit += s.benefit;
        }
        self.settle(levels, first, taken);
        let rest = &self.steps[taken..];
        let next = rest.iter().min_by(|a, b| order(a, b));
        choice.bound = choice.benefit + next.map_or(0.0, |s| s.efficiency * left.max(0.0));
        self.fill(taken, &mut left, &mut choice);
        self.or_single_best(levels, first, base, room, &mut choice);
        choice.cost = self.cost(levels, first);
        choice
    }

    /// Each object's level is that of the farthest step taken.
    fn settle(&mut self, levels: &[Level], first: &[u32], taken: usize) {
        for s in &self.steps[..taken] {
            let own = &levels[first[s.object as usize] as usize..];
            let (now, reached) = (self.chosen[s.object as usize], s.level);
            if own[reached as usize].cost > own[now as usize].cost {
                self.chosen[s.object as usize] = reached;
            }
        }
    }

    /// Takes further steps that still fit, the most efficient first.
    fn fill(&mut self, taken: usize, left: &mut f64, choice: &mut Choice) {
        // Near the break is where something may fit; looking farther gains almost nothing.
        const LOOK: usize = 256;
        let rest = &mut self.steps[taken..];
        let near = rest.len().min(LOOK);
        if near < rest.len() {
            rest.select_nth_unstable_by(near, order);
        }
        rest[..near].sort_unstable_by(order);
        let mut blocked: [u32; LOOK] = [u32::MAX; LOOK];
        let mut count = 0;
        for s in &rest[..near] {
            if blocked[..count].contains(&s.object) {
                continue;
            }
            if s.cost <= *left {
                *left -= s.cost;
                choice.benefit += s.benefit;
                self.chosen[s.object as usize] = s.level;
            } else {
                // Later steps of this object build on this one.
                blocked[count] = s.object;
                count += 1;
            }
        }
    }

    /// One expensive level alone may be worth more than all that the greedy choice fits: this makes the bound of one half hold.
    fn or_single_best(
        &mut self,
        levels: &[Level],
        first: &[u32],
        base: Choice,
        room: f64,
        choice: &mut Choice,
    ) {
        let mut best = (choice.benefit, None);
        for (object, range) in first.windows(2).enumerate() {
            let own = &levels[range[0] as usize..range[1] as usize];
            self.hull_of(own);
            let cheapest = self.hull[0].1;
            for (i, level) in own.iter().enumerate() {
                let gained = base.benefit + level.benefit - cheapest.benefit;
                if (level.cost - cheapest.cost).0 <= room && gained > best.0 {
                    best = (gained, Some((object, i as u32)));
                }
            }
        }
        if let Some((object, level)) = best.1 {
            for (o, range) in first.windows(2).enumerate() {
                self.hull_of(&levels[range[0] as usize..range[1] as usize]);
                self.chosen[o] = self.hull[0].0;
            }
            self.chosen[object] = level;
            choice.benefit = best.0;
        }
    }

    fn cost(&self, levels: &[Level], first: &[u32]) -> Millis {
        self.chosen.iter().zip(first).map(|(&level, &f)| levels[(f + level) as usize].cost).sum()
    }
}

/// Most efficient first; ties in the order of the objects and up their hulls, so that results do not depend on selection.
fn order(a: &Step, b: &Step) -> std::cmp::Ordering {
    b.efficiency
        .total_cmp(&a.efficiency)
        .then(a.object.cmp(&b.object))
        .then(a.cost.total_cmp(&b.cost))
        .then(a.level.cmp(&b.level))
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

/// The best choice by dynamic programming over whole cost units: for tests and small problems.
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
        assert_eq!(error.to_string(), "level 0 of object 1 has an impossible cost or benefit");
        assert!(budget.choose(&[level(-1.0, 1.0)], &[0, 1], Millis(5.0)).is_err());
        assert!(budget.choose(&[level(1.0, 1.0)], &[0, 1, 1], Millis(5.0)).is_err());
        assert_eq!(budget.choose(&[], &[0], Millis(5.0)).unwrap().benefit, 0.0);
        assert_eq!(budget.choose(&[], &[], Millis(5.0)).unwrap().benefit, 0.0);
    }
}
