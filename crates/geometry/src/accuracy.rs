//! The vocabulary of accuracy: what an answer promises and what it cost.
//!
//! Every Farsight algorithm has one accuracy knob with a unit. Its answer carries an [`ErrorBound`] (what was
//! reached) and a [`Cost`] (what it took).
//!
//! ```
//! use farsight_geometry::accuracy::{ErrorBound, Kind, Unit};
//!
//! let simplified = ErrorBound::proven(0.012, Unit::Metres);
//! let quantised = ErrorBound::proven(0.001, Unit::Metres);
//! let total = simplified.plus(quantised)?;
//! assert!(total.value >= 0.013 && total.kind == Kind::Proven);
//!
//! // A sampled figure is not a proof, and the sum says so.
//! let sampled = ErrorBound::measured(0.002, Unit::Metres);
//! assert_eq!(total.plus(sampled)?.kind, Kind::Measured);
//! # Ok::<(), farsight_geometry::accuracy::UnitMismatch>(())
//! ```

use std::fmt;
use std::time::Duration;

/// The unit of an [`ErrorBound`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum Unit {
    /// Pixels of the stated view.
    Pixels,
    /// World units; metres by convention.
    Metres,
    /// Radians.
    Radians,
    /// A share of a whole, 0 to 1.
    Fraction,
    /// Milliseconds of rendering time.
    Milliseconds,
}

/// How single errors were condensed into one number, from the weakest statement to the strongest.
///
/// mean ≤ RMS ≤ maximum for any set of errors, so a maximum also bounds the other two.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Norm {
    /// Arithmetic mean.
    Mean,
    /// Root of the mean square.
    Rms,
    /// Maximum.
    Max,
}

/// What stands behind a number, from the weakest to the strongest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Kind {
    /// Follows from a model; may be wrong in either direction.
    Estimated,
    /// Observed on samples; the true value may be larger.
    Measured,
    /// Never exceeded, rounding included.
    Proven,
}

/// An error that an answer has, and how far it can be trusted.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ErrorBound {
    /// The error, in `unit`; never negative, may be infinite ("no bound").
    pub value: f64,
    /// Unit of `value`.
    pub unit: Unit,
    /// How single errors were condensed.
    pub norm: Norm,
    /// What stands behind the value.
    pub kind: Kind,
}

/// Two errors in different units were added.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cannot add an error in {left} to one in {right}")]
pub struct UnitMismatch {
    /// Unit of the left operand.
    pub left: Unit,
    /// Unit of the right operand.
    pub right: Unit,
}

impl ErrorBound {
    /// A maximum that is never exceeded.
    pub fn proven(value: f64, unit: Unit) -> Self {
        Self { value, unit, norm: Norm::Max, kind: Kind::Proven }
    }

    /// A maximum over samples.
    pub fn measured(value: f64, unit: Unit) -> Self {
        Self { kind: Kind::Measured, ..Self::proven(value, unit) }
    }

    /// A maximum that follows from a model.
    pub fn estimated(value: f64, unit: Unit) -> Self {
        Self { kind: Kind::Estimated, ..Self::proven(value, unit) }
    }

    /// The same value under another norm.
    #[must_use]
    pub fn with_norm(self, norm: Norm) -> Self {
        Self { norm, ..self }
    }

    /// The error of two steps taken one after the other (triangle inequality), rounded up.
    ///
    /// Kind and norm of the sum are the weaker ones of the two parts. Mixing norms keeps the sum valid, since a
    /// maximum bounds the RMS and the mean as well.
    ///
    /// # Errors
    /// [`UnitMismatch`] when the units differ.
    pub fn plus(self, other: Self) -> Result<Self, UnitMismatch> {
        self.combine(other, |a, b| if a == 0.0 || b == 0.0 { a + b } else { (a + b).next_up() })
    }

    /// The error of two parts side by side: the larger value, with the weaker norm and kind.
    ///
    /// # Errors
    /// [`UnitMismatch`] when the units differ.
    pub fn worst_of(self, other: Self) -> Result<Self, UnitMismatch> {
        self.combine(other, f64::max)
    }

    fn combine(self, other: Self, value: impl Fn(f64, f64) -> f64) -> Result<Self, UnitMismatch> {
        if self.unit != other.unit {
            return Err(UnitMismatch { left: self.unit, right: other.unit });
        }
        Ok(Self {
            value: value(self.value, other.value),
            unit: self.unit,
            norm: self.norm.min(other.norm),
            kind: self.kind.min(other.kind),
        })
    }
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Unit::Pixels => "px",
            Unit::Metres => "m",
            Unit::Radians => "rad",
            Unit::Fraction => "1",
            Unit::Milliseconds => "ms",
        })
    }
}

impl fmt::Display for Norm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Norm::Mean => "mean",
            Norm::Rms => "rms",
            Norm::Max => "max",
        })
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Kind::Estimated => "estimated",
            Kind::Measured => "measured",
            Kind::Proven => "proven",
        })
    }
}

impl fmt::Display for ErrorBound {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.4e} {} ({}, {})", self.value, self.unit, self.norm, self.kind)
    }
}

/// Most counters that one [`Counters`] holds.
const MAX_COUNTERS: usize = 12;

/// A small fixed set of named work counters (rays, nodes, triangles, ...).
///
/// Counts are deterministic, so tests compare them where times could not be compared. Adding never allocates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    entries: [(&'static str, u64); MAX_COUNTERS],
    len: usize,
}

impl Counters {
    /// No counters.
    pub const fn new() -> Self {
        Self { entries: [("", 0); MAX_COUNTERS], len: 0 }
    }

    /// Adds `count` to the counter `name`, which starts at zero.
    ///
    /// # Panics
    /// When more than 12 different names are used: the set is meant to be small and fixed.
    pub fn add(&mut self, name: &'static str, count: u64) {
        if let Some((_, value)) = self.entries[..self.len].iter_mut().find(|(n, _)| *n == name) {
            *value += count;
            return;
        }
        assert!(self.len < MAX_COUNTERS, "more than {MAX_COUNTERS} counters; '{name}' does not fit");
        self.entries[self.len] = (name, count);
        self.len += 1;
    }

    /// The counter `name`; zero when nothing was counted.
    pub fn get(&self, name: &str) -> u64 {
        self.iter().find(|(n, _)| *n == name).map_or(0, |(_, value)| value)
    }

    /// Name and count of every counter, in order of first use.
    pub fn iter(&self) -> impl Iterator<Item = (&'static str, u64)> + '_ {
        self.entries[..self.len].iter().copied()
    }
}

impl fmt::Display for Counters {
    /// `name=count` pairs separated by blanks.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, (name, count)) in self.iter().enumerate() {
            write!(f, "{}{name}={count}", if i == 0 { "" } else { " " })?;
        }
        Ok(())
    }
}

/// What an answer took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cost {
    /// Time spent; reported, never asserted in tests.
    pub time: Duration,
    /// Memory that the result holds, in bytes.
    pub bytes: u64,
    /// Work done; deterministic.
    pub counters: Counters,
}

impl Cost {
    /// The cost of both: times, bytes and counters add.
    ///
    /// # Panics
    /// As [`Counters::add`], when both together have more than 12 different names.
    #[must_use]
    pub fn plus(mut self, other: &Cost) -> Cost {
        self.time += other.time;
        self.bytes += other.bytes;
        for (name, count) in other.counters.iter() {
            self.counters.add(name, count);
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_and_norms_degrade_to_the_weakest_part() {
        let proven = ErrorBound::proven(1.0, Unit::Pixels);
        let measured = ErrorBound::measured(1.0, Unit::Pixels).with_norm(Norm::Rms);
        let estimated = ErrorBound::estimated(1.0, Unit::Pixels);
        for combine in [ErrorBound::plus, ErrorBound::worst_of] {
            assert_eq!(combine(proven, proven).unwrap().kind, Kind::Proven);
            let mixed = combine(proven, measured).unwrap();
            assert_eq!((mixed.kind, mixed.norm), (Kind::Measured, Norm::Rms));
            assert_eq!(combine(measured, proven).unwrap().kind, Kind::Measured);
            assert_eq!(combine(measured, estimated).unwrap().kind, Kind::Estimated);
        }
    }

    #[test]
    fn sums_round_up_and_zero_adds_nothing() {
        let a = ErrorBound::proven(0.1, Unit::Metres);
        let b = ErrorBound::proven(0.2, Unit::Metres);
        assert!(a.plus(b).unwrap().value > 0.1 + 0.2);
        assert_eq!(a.plus(ErrorBound::proven(0.0, Unit::Metres)).unwrap(), a);
    }

    #[test]
    fn units_do_not_mix() {
        let error = ErrorBound::proven(1.0, Unit::Metres).plus(ErrorBound::proven(1.0, Unit::Pixels));
        assert_eq!(error.unwrap_err().to_string(), "cannot add an error in m to one in px");
    }

    #[test]
    fn counters_add_by_name() {
        let mut cost = Cost::default();
        cost.counters.add("rays", 2);
        cost.counters.add("nodes", 5);
        let sum = cost.plus(&cost);
        assert_eq!(
            (sum.counters.get("rays"), sum.counters.get("nodes"), sum.counters.get("none")),
            (4, 10, 0)
        );
        assert_eq!(sum.counters.to_string(), "rays=4 nodes=10");
    }
}
