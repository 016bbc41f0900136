//! Bounds on accumulated rounding, so that what is promised holds with rounding included.
//!
//! Evaluating an expression with `n` roundings in IEEE 754 arithmetic gives the exact value times (1 + θ) per
//! term, with |θ| ≤ γ(n) = n·u / (1 − n·u), where u is half the machine epsilon (Higham, *Accuracy and Stability of
//! Numerical Algorithms*, lemma 3.1).
//!
//! ```
//! use farsight_geometry::rounding::gamma;
//!
//! let terms = [1e8_f64, 1.0, -1e8, 3.0e-9];
//! let sum: f64 = terms.iter().sum();
//! let bound = gamma(3) * terms.iter().map(|t| t.abs()).sum::<f64>();
//! assert!((sum - 1.000_000_003).abs() <= bound);
//! ```

/// Unit roundoff of `f64`: half the distance from 1 to the next number.
pub const UNIT_F64: f64 = f64::EPSILON / 2.0;

/// Unit roundoff of `f32`, as `f64`.
pub const UNIT_F32: f64 = f32::EPSILON as f64 / 2.0;

/// Relative error bound of `n` roundings in `f64`, itself rounded up. Infinite for absurd `n`.
pub fn gamma(n: u32) -> f64 {
    gamma_of(n, UNIT_F64)
}

/// Relative error bound of `n` roundings in `f32`, itself rounded up. Infinite for absurd `n`.
pub fn gamma_f32(n: u32) -> f64 {
    gamma_of(n, UNIT_F32)
}

fn gamma_of(n: u32, unit: f64) -> f64 {
    let nu = f64::from(n) * unit;
    if nu < 1.0 { (nu / (1.0 - nu)).next_up() } else { f64::INFINITY }
}

/// `a + b`, rounded up.
pub fn add_up(a: f64, b: f64) -> f64 {
    up(a + b)
}

/// `a - b`, rounded down.
pub fn sub_down(a: f64, b: f64) -> f64 {
    down(a - b)
}

/// `a * b`, rounded up.
pub fn mul_up(a: f64, b: f64) -> f64 {
    up(a * b)
}

/// `√a`, rounded up; zero for negative `a`.
pub fn sqrt_up(a: f64) -> f64 {
    if a <= 0.0 { 0.0 } else { up(a.sqrt()) }
}

/// `√a`, rounded down; zero for negative `a`.
pub fn sqrt_down(a: f64) -> f64 {
    if a <= 0.0 { 0.0 } else { down(a.sqrt()) }
}

/// The next number above, so that a rounded-to-nearest result becomes an upper bound.
#[inline]
pub fn up(x: f64) -> f64 {
    x.next_up()
}

/// The next number below, so that a rounded-to-nearest result becomes a lower bound.
#[inline]
pub fn down(x: f64) -> f64 {
    x.next_down()
}

/// The smallest `f32` that is not below `x`.
#[inline]
pub fn f32_up(x: f64) -> f32 {
    let r = x as f32;
    if f64::from(r) < x { r.next_up() } else { r }
}

/// The largest `f32` that is not above `x`.
#[inline]
pub fn f32_down(x: f64) -> f32 {
    let r = x as f32;
    if f64::from(r) > x { r.next_down() } else { r }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gamma_grows_and_saturates() {
        assert!(gamma(1) > UNIT_F64 && gamma(10) > 10.0 * UNIT_F64 && gamma(10) < 10.1 * UNIT_F64);
        assert!(gamma_f32(u32::MAX).is_infinite());
    }

    #[test]
    fn narrowing_is_outward() {
        for x in [0.1, -0.1, 1e-40, 3.0, 1.0 / 3.0, 1e300, -1e300] {
            assert!(f64::from(f32_up(x)) >= x && f64::from(f32_down(x)) <= x, "{x}");
        }
        assert_eq!((f32_up(0.5), f32_down(0.5)), (0.5, 0.5));
    }

    #[test]
    fn square_roots_enclose() {
        for x in [2.0, 3.0, 1e-300, 1e300] {
            let (lo, hi) = (sqrt_down(x), sqrt_up(x));
            assert!(lo < hi && lo * lo < x && hi * hi > x);
        }
    }
}
