//! Which strategy gets how many rays: by what each found lately.

/// Ways of sampling.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Strategy {
    Flood,
    Border,
    Random,
    Mutation,
    Revisit,
}

pub(crate) const STRATEGIES: [Strategy; COUNT] =
    [Strategy::Flood, Strategy::Border, Strategy::Random, Strategy::Mutation, Strategy::Revisit];

pub(crate) const COUNT: usize = 5;

/// How slowly yields are forgotten, per wave.
const MEMORY: f64 = 0.8;

/// Yield of what was not tried yet.
const UNKNOWN: f64 = 1.0;

/// Recent yields.
#[derive(Clone, Debug)]
pub(crate) struct Schedule {
    /// New members per ray; one, which is promising, until something is known.
    yields: [f64; COUNT],
}

impl Default for Schedule {
    fn default() -> Self {
        Self { yields: [UNKNOWN; COUNT] }
    }
}

impl Schedule {
    /// Takes in what a strategy found in a wave.
    pub(crate) fn record(&mut self, strategy: Strategy, found: u64, rays: u64) {
        if rays > 0 {
            let now = found as f64 / rays as f64;
            let y = &mut self.yields[strategy as usize];
            *y = if *y == UNKNOWN { now } else { MEMORY * *y + (1.0 - MEMORY) * now };
        }
    }

    /// Divides `units` among the strategies that can be used, none below `least` of them, the rest by the squares of yields: what
    /// finds half as much waits until the better has run dry.
    pub(crate) fn divide(&self, units: usize, usable: [bool; COUNT], least: f64) -> [usize; COUNT] {
        let usable_yield = |i: usize| if usable[i] { self.yields[i].max(1e-9).powi(2) } else { 0.0 };
        let sum: f64 = (0..COUNT).map(usable_yield).sum();
        let count = usable.iter().filter(|u| **u).count() as f64;
        let mut given = [0; COUNT];
        if count == 0.0 {
            return given;
        }
        let share = |i: usize| match usable[i] {
            true => least + (1.0 - least * count) * usable_yield(i) / sum,
            false => 0.0,
        };
        // Largest remainders get what rounding down leaves.
        let exact: [f64; COUNT] = std::array::from_fn(|i| share(i) * units as f64);
        let mut order: [usize; COUNT] = std::array::from_fn(|i| i);
        order.sort_by(|&a, &b| exact[b].fract().total_cmp(&exact[a].fract()).then(a.cmp(&b)));
        for i in 0..COUNT {
            given[i] = exact[i] as usize;
        }
        let rest = units - given.iter().sum::<usize>().min(units);
        for i in order.into_iter().filter(|&i| usable[i]).cycle().take(rest) {
            given[i] += 1;
        }
        given
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_follow_yields_down_to_the_least() {
        let mut schedule = Schedule::default();
        for _ in 0..100 {
            schedule.record(Strategy::Border, 90, 1000);
            schedule.record(Strategy::Random, 0, 1000);
            schedule.record(Strategy::Mutation, 10, 1000);
            schedule.record(Strategy::Revisit, 0, 1000);
        }
        assert_eq!(schedule.divide(40, [false, true, true, true, true], 0.1), [0, 28, 4, 4, 4]);
        assert_eq!(schedule.divide(40, [false, false, true, false, false], 0.1), [0, 0, 40, 0, 0]);
        assert_eq!(schedule.divide(40, [false; COUNT], 0.1), [0; COUNT]);
        assert_eq!(schedule.divide(7, [true, true, false, false, false], 0.2).iter().sum::<usize>(), 7);
        assert_eq!(schedule.divide(32, [true; COUNT], 0.2).iter().sum::<usize>(), 32);
    }
}
