//! Milliseconds.

use std::iter::Sum;
use std::ops::{Add, AddAssign, Div, Mul, Sub};
use std::time::Duration;

/// A time in milliseconds, finite and possibly negative (a difference).
///
/// Rendering times are a few milliseconds, so `f64` milliseconds lose nothing and can be added and scaled; [`Duration`] stands at
/// the edges.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Millis(pub f64);

impl Millis {
    /// No time.
    pub const ZERO: Self = Self(0.0);

    /// The larger of two times.
    #[must_use]
    pub fn max(self, other: Self) -> Self {
        Self(self.0.max(other.0))
    }

    /// The smaller of two times.
    #[must_use]
    pub fn min(self, other: Self) -> Self {
        Self(self.0.min(other.0))
    }
}

impl From<Duration> for Millis {
    fn from(d: Duration) -> Self {
        Self(d.as_secs_f64() * 1e3)
    }
}

impl From<Millis> for Duration {
    /// Negative times become zero, times beyond what a duration holds its maximum.
    fn from(m: Millis) -> Self {
        Duration::try_from_secs_f64((m.0 * 1e-3).max(0.0)).unwrap_or(Duration::MAX)
    }
}

impl Add for Millis {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self(self.0 + other.0)
    }
}

impl AddAssign for Millis {
    fn add_assign(&mut self, other: Self) {
        self.0 += other.0;
    }
}

impl Sub for Millis {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self(self.0 - other.0)
    }
}

impl Mul<f64> for Millis {
    type Output = Self;
    fn mul(self, factor: f64) -> Self {
        Self(self.0 * factor)
    }
}

impl Div for Millis {
    type Output = f64;
    fn div(self, other: Self) -> f64 {
        self.0 / other.0
    }
}

impl Sum for Millis {
    fn sum<I: Iterator<Item = Self>>(times: I) -> Self {
        times.fold(Self::ZERO, Add::add)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_go_there_and_back() {
        let m = Millis::from(Duration::from_micros(16_667));
        assert!((m.0 - 16.667).abs() < 1e-12);
        assert_eq!(Duration::from(m), Duration::from_micros(16_667));
        assert_eq!(Duration::from(Millis(-1.0)), Duration::ZERO);
        assert_eq!(Duration::from(Millis(f64::INFINITY)), Duration::MAX);
    }
}
