//! What a prediction may be off by, from what it was off by.
//!
//! Times of a busy system have several peaks and long tails, so nothing is assumed of their distribution: quantiles are
//! ranks among the last ratios of measured to predicted time.

use crate::Millis;

/// The last ratios of measured to predicted time.
///
/// # Accuracy
/// For ratios drawn independently from any one distribution, the next one exceeds the `q`-quantile with a probability of at most
/// 1 − q (exchangeability; the bound of split conformal prediction). Drift breaks that; a shorter memory follows it faster.
///
/// # Cost
/// O(log n + n) to record (a move of a part of the memory, about 0.1 µs for 1000), O(1) to ask; no allocation after the first.
#[derive(Clone, Debug)]
pub struct Residuals {
    /// In the order of arrival, a ring.
    recent: Vec<f64>,
    next: usize,
    sorted: Vec<f64>,
    capacity: usize,
}

impl Residuals {
    /// Remembers `capacity` ratios (at least one). The 99.9 % quantile needs a thousand.
    pub fn new(capacity: usize) -> Self {
        let capacity = capacity.max(1);
        Self { recent: Vec::with_capacity(capacity), next: 0, sorted: Vec::with_capacity(capacity), capacity }
    }

    /// Records a frame. Impossible or zero times are ignored.
    pub fn record(&mut self, predicted: Millis, measured: Millis) {
        let ratio = measured.0 / predicted.0;
        if !(ratio.is_finite() && ratio >= 0.0 && predicted.0 > 0.0) {
            return;
        }
        if self.recent.len() < self.capacity {
            self.recent.push(ratio);
        } else {
            let oldest = std::mem::replace(&mut self.recent[self.next], ratio);
            let at = self.sorted.partition_point(|&r| r < oldest);
            self.sorted.remove(at);
        }
        self.next = (self.next + 1) % self.capacity;
        let at = self.sorted.partition_point(|&r| r < ratio);
        self.sorted.insert(at, ratio);
    }

    /// Number of ratios remembered.
    pub fn len(&self) -> usize {
        self.sorted.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.sorted.is_empty()
    }

    /// The time that a share `q` of drawings with this prediction does not exceed.
    ///
    /// `None` when too few frames were seen to say: the `q`-quantile of n ratios needs q·(n + 1) ≤ n.
    pub fn quantile(&self, predicted: Millis, q: f64) -> Option<Millis> {
        let rank = (q.clamp(0.0, 1.0) * (self.len() + 1) as f64).ceil() as usize;
        (1..=self.len()).contains(&rank).then(|| predicted * self.sorted[rank - 1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Random(u64);

    impl Random {
        fn unit(&mut self) -> f64 {
            self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (self.0 >> 11) as f64 / (1u64 << 53) as f64
        }

        /// Two peaks and a tail, as a system makes them.
        fn ratio(&mut self) -> f64 {
            let base = if self.unit() < 0.8 { 1.0 } else { 1.15 };
            base + 0.02 * self.unit() + if self.unit() < 0.004 { 2.0 * self.unit() } else { 0.0 }
        }
    }

    #[test]
    fn quantiles_cover_what_they_say_on_two_peaks_with_a_tail() {
        let mut random = Random(11);
        let mut residuals = Residuals::new(2000);
        for _ in 0..2000 {
            residuals.record(Millis(2.0), Millis(2.0 * random.ratio()));
        }
        let (n, mut above) = (20_000, [0u32; 3]);
        for _ in 0..n {
            let predicted = Millis(1.0 + random.unit());
            let measured = predicted * random.ratio();
            for (count, q) in above.iter_mut().zip([0.5, 0.95, 0.999]) {
                *count += u32::from(measured > residuals.quantile(predicted, q).unwrap());
            }
            residuals.record(predicted, measured);
        }
        let share = above.map(|c| f64::from(c) / f64::from(n));
        assert!(
            (share[0] - 0.5).abs() < 0.02 && (0.03..=0.07).contains(&share[1]) && share[2] <= 2e-3,
            "{share:?}"
        );
    }

    #[test]
    fn too_few_frames_say_nothing_of_rare_events() {
        let mut residuals = Residuals::new(100);
        assert!(residuals.quantile(Millis(1.0), 0.5).is_none());
        (0..50).for_each(|_| residuals.record(Millis(1.0), Millis(1.0)));
        assert!(
            residuals.quantile(Millis(1.0), 0.95).is_some()
                && residuals.quantile(Millis(1.0), 0.999).is_none()
        );
    }

    #[test]
    fn the_memory_is_a_ring_and_ignores_nonsense() {
        let mut residuals = Residuals::new(3);
        for measured in [9.0, 1.0, 2.0, 3.0, f64::NAN, -1.0, f64::INFINITY] {
            residuals.record(Millis(1.0), Millis(measured));
        }
        residuals.record(Millis(0.0), Millis(1.0));
        assert_eq!((residuals.len(), residuals.quantile(Millis(2.0), 0.5)), (3, Some(Millis(4.0))));
    }
}
