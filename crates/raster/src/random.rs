//! The generators' random numbers: seeded, the same on every machine.

use farsight_geometry::sampling;
use glam::Vec3;

/// A stream of pseudo-random numbers, in the forms that scene generators want.
#[derive(Clone, Debug)]
pub struct Random {
    bits: sampling::Random,
}

/// Scrambles a number; neighbours give unrelated results.
pub(crate) fn mix(n: u64) -> u64 {
    sampling::Random::new(n).bits()
}

impl Random {
    /// The stream of a seed.
    pub fn new(seed: u64) -> Self {
        Self { bits: sampling::Random::new(mix(seed)) }
    }

    /// An independent stream, for example one per building: what it gives does not depend on its siblings.
    #[must_use]
    pub fn fork(&self, index: u64) -> Self {
        Self { bits: self.bits.stream(index) }
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.bits.bits()
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        self.bits.unit()
    }

    /// Uniform in [low, high).
    pub fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Uniform in [low, high) as `f32`.
    pub fn range_f32(&mut self, low: f32, high: f32) -> f32 {
        self.range(f64::from(low), f64::from(high)) as f32
    }

    /// Uniform in 0..count; 0 when `count` is 0.
    pub fn below(&mut self, count: usize) -> usize {
        ((self.unit() * count as f64) as usize).min(count.saturating_sub(1))
    }

    /// True with the given probability.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }

    /// Uniform on the unit sphere.
    pub fn direction(&mut self) -> Vec3 {
        let z = self.range(-1.0, 1.0);
        let (sin, cos) = self.range(0.0, std::f64::consts::TAU).sin_cos();
        let r = (1.0 - z * z).max(0.0).sqrt();
        Vec3::new((r * cos) as f32, (r * sin) as f32, z as f32)
    }
}
