//! Visible sets as runs of numbers, and their algebra.

use crate::VisibilityError;

/// A set of members, as runs of consecutive numbers: small, sorted, quick to draw from.
///
/// ```
/// use farsight_visibility::Pvs;
///
/// let here = Pvs::from_sorted([1, 2, 3, 7]);
/// let there = Pvs::from_sorted([3, 4, 7]);
/// assert_eq!(here.union(&there).iter().collect::<Vec<_>>(), [1, 2, 3, 4, 7]);
/// assert_eq!(here.intersection(&there).len(), 2);
/// assert_eq!(here.runs(), [[1, 4], [7, 8]]);
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub struct Pvs {
    /// First number and the one after the last, ascending, with gaps between runs.
    runs: Vec<[u32; 2]>,
    len: u32,
}

impl Pvs {
    /// The empty set.
    pub fn new() -> Self {
        Self::default()
    }

    /// The set of ascending numbers below 2³² − 1. Numbers that do not ascend are left out.
    pub fn from_sorted(numbers: impl IntoIterator<Item = u32>) -> Self {
        let mut set = Self::new();
        for n in numbers {
            match set.runs.last_mut() {
                _ if n == u32::MAX => continue,
                Some(run) if run[1] > n => continue,
                Some(run) if run[1] == n => run[1] = n + 1,
                _ => set.runs.push([n, n + 1]),
            }
            set.len += 1;
        }
        set
    }

    /// The set of runs, each the first number and the one after the last.
    ///
    /// # Errors
    /// [`VisibilityError::Runs`] names the first run that is empty or does not leave a gap to the one before.
    pub fn from_runs(runs: Vec<[u32; 2]>) -> Result<Self, VisibilityError> {
        let (mut end, mut len) = (None, 0u32);
        for (index, &[first, last]) in runs.iter().enumerate() {
            if first >= last || end.is_some_and(|end| first <= end) {
                return Err(VisibilityError::Runs { index });
            }
            (end, len) = (Some(last), len + (last - first));
        }
        Ok(Self { runs, len })
    }

    /// The runs: first number, and the one after the last. What a renderer draws from one index list with one call each.
    pub fn runs(&self) -> &[[u32; 2]] {
        &self.runs
    }

    /// How many numbers are in it.
    pub fn len(&self) -> u32 {
        self.len
    }

    /// Whether no number is in it.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// One above the largest number; zero for the empty set.
    pub fn bound(&self) -> u32 {
        self.runs.last().map_or(0, |run| run[1])
    }

    /// Whether a number is in it: O(log runs).
    pub fn contains(&self, n: u32) -> bool {
        let at = self.runs.partition_point(|run| run[1] <= n);
        self.runs.get(at).is_some_and(|run| run[0] <= n)
    }

    /// The numbers in ascending order.
    pub fn iter(&self) -> impl Iterator<Item = u32> {
        self.runs.iter().flat_map(|&[first, last]| first..last)
    }

    /// What is in either.
    #[must_use]
    pub fn union(&self, other: &Self) -> Self {
        self.combined(other, |a, b| a || b)
    }

    /// What is in both.
    #[must_use]
    pub fn intersection(&self, other: &Self) -> Self {
        self.combined(other, |a, b| a && b)
    }

    /// What is in this one only.
    #[must_use]
    pub fn difference(&self, other: &Self) -> Self {
        self.combined(other, |a, b| a && !b)
    }

    /// What is in one of the two and not in the other.
    #[must_use]
    pub fn symmetric_difference(&self, other: &Self) -> Self {
        self.combined(other, |a, b| a != b)
    }

    /// Whether all of it is in the other.
    pub fn is_subset(&self, other: &Self) -> bool {
        self.difference(other).is_empty()
    }

    /// Walks along the ends of both sets' runs: O(runs).
    fn combined(&self, other: &Self, keep: impl Fn(bool, bool) -> bool) -> Self {
        let (mut a, mut b) = (Ends::of(&self.runs), Ends::of(&other.runs));
        let mut set = Self::new();
        let mut start = None;
        loop {
            let at = match (a.next(), b.next()) {
                (None, None) => return set,
                (Some(a), Some(b)) => a.min(b),
                (a, b) => a.or(b).unwrap_or(u32::MAX),
            };
            a.pass(at);
            b.pass(at);
            match (start, keep(a.is_inside(), b.is_inside())) {
                (None, true) => start = Some(at),
                (Some(first), false) => {
                    set.runs.push([first, at]);
                    set.len += at - first;
                    start = None;
                }
                _ => {}
            }
        }
    }
}

impl FromIterator<u32> for Pvs {
    /// The set of numbers in any order.
    fn from_iter<I: IntoIterator<Item = u32>>(numbers: I) -> Self {
        let mut sorted: Vec<u32> = numbers.into_iter().collect();
        sorted.sort_unstable();
        sorted.dedup();
        Self::from_sorted(sorted)
    }
}

/// Ends of runs in order: where membership changes.
struct Ends<'a> {
    ends: &'a [u32],
    passed: usize,
}

impl<'a> Ends<'a> {
    fn of(runs: &'a [[u32; 2]]) -> Self {
        Self { ends: runs.as_flattened(), passed: 0 }
    }

    fn next(&self) -> Option<u32> {
        self.ends.get(self.passed).copied()
    }

    fn pass(&mut self, at: u32) {
        self.passed += usize::from(self.next() == Some(at));
    }

    fn is_inside(&self) -> bool {
        self.passed % 2 == 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use farsight_geometry::sampling::Random;
    use std::collections::BTreeSet;

    #[test]
    fn algebra_is_that_of_ordinary_sets() {
        let mut random = Random::new(8);
        for round in 0..400 {
            let mut draw = || -> BTreeSet<u32> {
                let (count, bound) =
                    (random.below(60), 1 + random.below(if round % 2 == 0 { 40 } else { 400 }));
                (0..count).map(|_| random.below(bound) as u32).collect()
            };
            let (a, b) = (draw(), draw());
            let set = |s: &BTreeSet<u32>| Pvs::from_sorted(s.iter().copied());
            let (pa, pb) = (set(&a), set(&b));
            assert_eq!(pa.union(&pb), set(&(&a | &b)));
            assert_eq!(pa.intersection(&pb), set(&(&a & &b)));
            assert_eq!(pa.difference(&pb), set(&(&a - &b)));
            assert_eq!(pa.symmetric_difference(&pb), set(&(&a ^ &b)));
            assert_eq!(pa.is_subset(&pb), a.is_subset(&b));
            assert_eq!(pa.len() as usize, a.len());
            assert!((0..450).all(|n| pa.contains(n) == a.contains(&n)));
            assert_eq!(pa.iter().collect::<Vec<_>>(), a.iter().copied().collect::<Vec<_>>());
            assert_eq!(Pvs::from_runs(pa.runs().to_vec()).unwrap(), pa);
        }
    }

    #[test]
    fn ends_of_the_range_and_bad_runs() {
        let top = Pvs::from_sorted([0, u32::MAX - 1, u32::MAX]);
        assert_eq!((top.len(), top.bound()), (2, u32::MAX));
        assert_eq!(top.union(&Pvs::new()), top);
        assert_eq!(Pvs::from_runs(vec![[0, 2], [2, 3]]), Err(VisibilityError::Runs { index: 1 }));
        assert_eq!(Pvs::from_runs(vec![[3, 3]]), Err(VisibilityError::Runs { index: 0 }));
        assert_eq!([5, 1, 5, 2].into_iter().collect::<Pvs>().runs(), [[1, 3], [5, 6]]);
        assert_eq!(Pvs::from_sorted([4, 3, 5]).iter().collect::<Vec<_>>(), [4, 5]);
    }
}
