//! What a decision asks the machine to do, and what that takes.

use farsight_geometry::Millis;
use std::ops::{Add, AddAssign, Mul};

/// Work as plain counts, all of them zero or more.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Work {
    /// Draw calls.
    pub draws: f64,
    /// Vertices to transform.
    pub vertices: f64,
    /// Triangles.
    pub triangles: f64,
    /// Pixels to shade, hidden ones included.
    pub pixels: f64,
    /// Points, each drawn as a splat.
    pub points: f64,
    /// Texels of shadow maps and impostors to clear and keep.
    pub texels: f64,
    /// Samples taken from shadow maps.
    pub taps: f64,
}

impl Work {
    #[inline]
    fn combine(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        Self {
            draws: f(self.draws, other.draws),
            vertices: f(self.vertices, other.vertices),
            triangles: f(self.triangles, other.triangles),
            pixels: f(self.pixels, other.pixels),
            points: f(self.points, other.points),
            texels: f(self.texels, other.texels),
            taps: f(self.taps, other.taps),
        }
    }
}

impl Add for Work {
    type Output = Self;
    #[inline]
    fn add(self, other: Self) -> Self {
        self.combine(other, |a, b| a + b)
    }
}

impl AddAssign for Work {
    #[inline]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Mul<f64> for Work {
    type Output = Self;
    #[inline]
    fn mul(self, factor: f64) -> Self {
        self.combine(self, |a, _| a * factor)
    }
}

/// Tells what work takes.
///
/// More work must not take less time: what the planner promises about costs rests on that.
///
/// ```
/// use farsight_plan::{CostModel, Millis, Work};
///
/// /// A machine on which only triangles count.
/// struct Triangles;
/// impl CostModel for Triangles {
///     fn time(&self, work: &Work) -> Millis {
///         Millis(work.triangles * 1e-5)
///     }
/// }
/// assert_eq!(Triangles.time(&Work { triangles: 2e5, ..Work::default() }), Millis(2.0));
/// ```
pub trait CostModel {
    /// The time that some work takes.
    fn time(&self, work: &Work) -> Millis;
}

/// A machine on which each kind of work takes its time, one after the other. Nanoseconds each.
///
/// The defaults are rough figures of a graphics card of the middle class; measure your own.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Costs {
    /// A draw call.
    pub draw: f64,
    /// A vertex.
    pub vertex: f64,
    /// A triangle.
    pub triangle: f64,
    /// A shaded pixel.
    pub pixel: f64,
    /// A point.
    pub point: f64,
    /// A texel.
    pub texel: f64,
    /// A sample of a shadow map.
    pub tap: f64,
}

impl Default for Costs {
    fn default() -> Self {
        Self { draw: 1500.0, vertex: 0.3, triangle: 0.3, pixel: 0.4, point: 0.5, texel: 0.02, tap: 0.02 }
    }
}

impl CostModel for Costs {
    #[inline]
    fn time(&self, w: &Work) -> Millis {
        let geometry = w.draws * self.draw + w.vertices * self.vertex + w.triangles * self.triangle;
        let samples = w.pixels * self.pixel + w.points * self.point;
        let shadows = w.texels * self.texel + w.taps * self.tap;
        Millis((geometry + samples + shadows) * 1e-6)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_of_work_has_its_price() {
        let one =
            Costs { draw: 1.0, vertex: 2.0, triangle: 4.0, pixel: 8.0, point: 16.0, texel: 32.0, tap: 64.0 };
        let all = Work {
            draws: 1.0,
            vertices: 1.0,
            triangles: 1.0,
            pixels: 1.0,
            points: 1.0,
            texels: 1.0,
            taps: 1.0,
        };
        assert_eq!(one.time(&all), Millis(127e-6));
        assert_eq!(one.time(&(all * 2.0 + all)), Millis(381e-6));
    }
}
