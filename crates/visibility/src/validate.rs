//! How much a set misses at most: an independent sample of pixels, and what follows from it.

use crate::bits::Bits;
use crate::occluders::Occluders;
use crate::random::view_ray;
use crate::sight::Sight;
use crate::wave::{Scratch, Space};
use farsight_geometry::RayCaster;
use farsight_geometry::accuracy::{ErrorBound, Norm, Unit};
use farsight_geometry::sampling::Random;

/// View rays that one unit of a look traces.
pub(crate) const RAYS_PER_LOOK_UNIT: u64 = 2048;

/// What an independent sample says about the pixels that show something which the set lacks.
///
/// A pixel is a ray from an eye uniform in the view cell (by volume) in a direction uniform over the sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Missed {
    /// Rays that met something which is not in the set.
    pub misses: u64,
    /// Rays shot.
    pub rays: u64,
    /// Probability that the bound holds, at least.
    pub confidence: f64,
    /// Share of pixels that show something missing, at most: measured, as a mean over all pixels of all viewpoints.
    pub bound: ErrorBound,
}

impl Missed {
    pub(crate) fn new(misses: u64, rays: u64, confidence: f64) -> Self {
        let share = upper_bound(misses, rays, confidence);
        let bound = ErrorBound::measured(share, Unit::Fraction).with_norm(Norm::Mean);
        Self { misses, rays, confidence, bound }
    }

    /// The bound in pixels of a million.
    pub fn per_million(&self) -> f64 {
        self.bound.value * 1e6
    }
}

/// The largest probability of a miss with which `misses` or fewer in `rays` would still happen in 1 − `confidence` of all
/// cases: the one-sided bound of Clopper and Pearson, rounded up.
///
/// It holds for any true probability, without approximation. Without a ray, or where everything missed, it is 1.
///
/// ```
/// use farsight_visibility::upper_bound;
///
/// // The rule of three: none in n means below 3 / n.
/// assert!((upper_bound(0, 1_000_000, 0.95) - 2.9957e-6).abs() < 1e-9);
/// ```
pub fn upper_bound(misses: u64, rays: u64, confidence: f64) -> f64 {
    if misses >= rays {
        return 1.0;
    }
    let tail = (1.0 - confidence).max(0.0);
    if tail == 0.0 {
        return 1.0;
    }
    let (n, k) = (rays as f64, misses as f64);
    // ln of the binomial coefficient n over k.
    let choose: f64 = (1..=misses).map(|j| ((n - k + j as f64) / j as f64).ln()).sum();
    let at_most_k = |p: f64| {
        // From the largest of the k + 1 terms downwards; their ratio only falls.
        let (mut term, mut sum, mut scale) = (1.0f64, 1.0f64, k);
        while scale > 0.0 && term > 1e-18 * sum {
            term *= scale * (1.0 - p) / ((n - scale + 1.0) * p);
            sum += term;
            scale -= 1.0;
        }
        (choose + k * p.ln() + (n - k) * (-p).ln_1p()).exp() * sum
    };
    let (mut low, mut high) = (k / n, 1.0);
    while high - low > 1e-12 * high {
        let middle = if low > 0.0 { (low * high).sqrt() } else { high * 1e-3 };
        if middle <= low || middle >= high {
            break;
        }
        if at_most_k(middle) > tail {
            low = middle
        } else {
            high = middle
        }
        if high < 1e-15 {
            break;
        }
    }
    high * (1.0 + 1e-9)
}

/// Confidence of look number `look` (from 1 on) such that all of them together hold with `confidence`: the shares of
/// 1 − confidence, 6 / (π² look²), add up to one.
pub(crate) fn confidence_of_look(confidence: f64, look: u32) -> f64 {
    let share = 6.0 / (std::f64::consts::PI * f64::from(look)).powi(2);
    1.0 - (1.0 - confidence) * share
}

/// Rays without a miss that prove a share at a confidence, and as many again, so that some misses are forgiven.
pub(crate) fn rays_to_prove(share: f64, confidence: f64) -> u64 {
    (2.0 * -(1.0 - confidence).ln() / share).ceil() as u64
}

/// Looks along the rays of one unit; sights of triangles that are missing are left in the scratch. Returns how many rays met a member that is missing: a known object
/// is not missed for want of one of its triangles.
pub(crate) fn look<C: RayCaster>(
    space: &Space<C>,
    members: &Bits,
    stream: u64,
    rays: u64,
    scratch: &mut Scratch,
) -> u64 {
    let mut random = Random::new(space.options.seed ^ 0x7a11_da7e).stream(stream);
    let Scratch { rays: buffer, hits, out, owners, .. } = scratch;
    out.sights.clear();
    buffer.clear();
    buffer.extend((0..rays).filter_map(|_| view_ray(space.cell, &mut random)));
    owners.clear();
    let occluders: &Occluders<C> = &space.occluders;
    let sight =
        |i: usize, triangle| Sight { triangle, origin: buffer[i].origin(), direction: buffer[i].direction() };
    let mut missed = |i: usize, triangle: u32| {
        if !space.seen.contains(triangle) {
            out.sights.push(sight(i, triangle));
        }
        if !members.contains(space.triangles.member(triangle)) {
            owners.push(i as u32);
        }
    };
    occluders.batch(space.triangles, buffer, hits, &mut missed);
    for (i, hit) in hits.iter().enumerate() {
        if let Some(hit) = hit {
            missed(i, space.triangles.of_hit(hit));
        }
    }
    // What is seen through may have missed several times on one ray.
    owners.sort_unstable();
    owners.dedup();
    owners.len() as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// P(X ≤ k) added up term by term, independent of how the bound does it.
    fn at_most(k: u64, n: u64, p: f64) -> f64 {
        let mut term = (n as f64 * (1.0 - p).ln()).exp();
        let mut sum = term;
        for i in 0..k {
            term *= (n - i) as f64 / (i + 1) as f64 * p / (1.0 - p);
            sum += term;
        }
        sum
    }

    #[test]
    fn the_bound_is_where_the_tail_is_used_up() {
        for (k, n) in [(0, 1), (0, 50), (1, 50), (3, 1000), (40, 5000), (49, 50), (200, 300)] {
            for confidence in [0.5, 0.9, 0.95, 0.999] {
                let p = upper_bound(k, n, confidence);
                let tail = at_most(k, n, p);
                assert!(tail <= (1.0 - confidence) * (1.0 + 1e-9), "{k} of {n}: {tail}");
                assert!(tail > (1.0 - confidence) * (1.0 - 1e-4), "{k} of {n}: {tail}");
            }
        }
        assert_eq!(upper_bound(5, 5, 0.95), 1.0);
        assert_eq!(upper_bound(0, 0, 0.95), 1.0);
        assert_eq!(upper_bound(0, 10, 1.0), 1.0);
        let large = upper_bound(100_000, 10_000_000, 0.95);
        assert!((large - 0.01 - 1.645 * (0.01f64 * 0.99 / 1e7).sqrt()).abs() < 1e-6, "{large}");
    }

    #[test]
    fn looks_share_one_confidence() {
        let spent: f64 = (1..100_000).map(|look| 1.0 - confidence_of_look(0.95, look)).sum();
        assert!(spent < 0.05 && spent > 0.0499);
        let rays = rays_to_prove(1e-5, 0.95);
        assert!(upper_bound(0, rays / 2 + 1, 0.95) <= 1.001e-5 && upper_bound(2, rays, 0.95) < 1.1e-5);
    }
}
