//! The least worst texel: how large texels are over the receivers for a given strength of the warp, and which strength is best.

use crate::focus::{Corner, Focus};

/// The receivers' corners as the warp sees them.
pub(crate) struct Fit<'a> {
    corners: &'a [Corner],
    near: f64,
    /// Extent along the warp axis.
    pub d: f64,
    /// Least extent of x/w, over what its rounding is relative to.
    grain: f64,
    /// Strongest warp.
    most: f64,
}

/// The largest terms over the corners for one κ.
struct Largest {
    low: f64,
    high: f64,
    /// Of w·scale.
    across: f64,
    /// Of (w·scale)²·(w² + κ²x²).
    along_sq: f64,
    /// Of the terms that add up to a corner's place across.
    reach: f64,
}

impl<'a> Fit<'a> {
    pub fn new(focus: &'a Focus) -> Self {
        let extent = focus.footprint.extent();
        Self {
            corners: &focus.receivers,
            near: focus.footprint.min.z,
            d: extent.z,
            grain: focus.grain,
            most: focus.kappa_most,
        }
    }

    fn largest(&self, kappa: f64) -> Largest {
        let start =
            Largest { low: f64::INFINITY, high: f64::NEG_INFINITY, across: 0.0, along_sq: 0.0, reach: 0.0 };
        let kappa_sq = kappa * kappa;
        self.corners.iter().fold(start, |m, c| {
            let w = 1.0 + kappa * (c.q.z - self.near);
            let inverse = 1.0 / w;
            let (t, reach) = (c.q.x * inverse, c.reach * inverse);
            let across = w * c.scale;
            let along_sq = across * across * (w * w + kappa_sq * c.q.x * c.q.x);
            Largest {
                low: if t < m.low { t } else { m.low },
                high: if t > m.high { t } else { m.high },
                across: if across > m.across { across } else { m.across },
                along_sq: if along_sq > m.along_sq { along_sq } else { m.along_sq },
                reach: if reach > m.reach { reach } else { m.reach },
            }
        })
    }

    /// What x/w lacks in extent, so that texels are not finer than `f32`.
    fn missing(&self, m: &Largest) -> f64 {
        (self.grain * (m.reach + m.low.abs().max(m.high.abs())) - (m.high - m.low)).max(0.0)
    }

    /// Least x/w and the extent of x/w.
    pub fn across(&self, kappa: f64) -> (f64, f64) {
        let m = self.largest(kappa);
        let missing = self.missing(&m);
        (m.low - 0.5 * missing, m.high - m.low + missing)
    }

    /// Largest extent of a unit of the map on the image plane, over all corners and both directions.
    pub fn worst_texel(&self, kappa: f64) -> f64 {
        let m = self.largest(kappa);
        let across = m.high - m.low + self.missing(&m);
        let along = self.d / (1.0 + kappa * self.d);
        (along * m.along_sq.sqrt()).max(across * m.across)
    }

    /// Whether the worst texel over the whole body is certainly at a corner: |κ·x| ≤ √2·w at all of them.
    pub fn corners_decide(&self, kappa: f64) -> bool {
        // A little less than √2, for rounding.
        let most = std::f64::consts::SQRT_2 * (1.0 - 1e-6);
        self.corners.iter().all(|c| (kappa * c.q.x).abs() <= most * (1.0 + kappa * (c.q.z - self.near)))
    }

    /// The κ with the least worst texel, and that texel; κ = 0 when no warp is better.
    ///
    /// The worst texel is a maximum of few smooth functions of log κ, with few minima: a scan brackets the lowest, golden
    /// section refines it. When the minimum next to `before` is as good within half a per cent, it is taken.
    pub fn least_worst(&self, before: f64) -> (f64, f64) {
        const COARSE: usize = 20;
        // From where w differs by 1 % across the receivers to where the near end is a million times finer.
        const FIRST: f64 = -6.0;
        const STEP: f64 = 26.0 / COARSE as f64;
        let kappa = |log: f64| (log.exp2() / self.d).min(self.most);
        let value = |log: f64| self.worst_texel(kappa(log));
        let scan: [f64; COARSE + 1] = std::array::from_fn(|i| value(FIRST + STEP * i as f64));
        let lowest = (0..=COARSE).fold(0, |best, i| if scan[i] < scan[best] { i } else { best });
        let refine = |i: usize| {
            let middle = FIRST + STEP * i as f64;
            let log = golden_section(middle - STEP, middle + STEP, value);
            let refined = value(log);
            let (log, refined) = if refined < scan[i] { (log, refined) } else { (middle, scan[i]) };
            (kappa(log), refined)
        };
        let mut best = refine(lowest);
        if before > 0.0 {
            let mut i =
                (((before * self.d).log2() - FIRST) / STEP).round().clamp(0.0, COARSE as f64) as usize;
            // Downhill from where the previous map was.
            while let Some(next) =
                [i.wrapping_sub(1), i + 1].into_iter().filter(|&j| j <= COARSE).find(|&j| scan[j] < scan[i])
            {
                i = next;
            }
            if i.abs_diff(lowest) > 1 {
                let near = refine(i);
                best = if near.1 <= 1.005 * best.1 { near } else { best };
            }
        }
        let uniform = self.worst_texel(0.0);
        if best.1 < uniform { best } else { (0.0, uniform) }
    }
}

/// Where a function with one minimum in [a, b] is least, to 1e-5 of the interval: finer, its flat bottom drowns in rounding;
/// coarser, the answer would jump when its input moves a little.
fn golden_section(mut a: f64, mut b: f64, f: impl Fn(f64) -> f64) -> f64 {
    const RATIO: f64 = 0.618_033_988_749_894_9;
    const STEPS: u32 = 24;
    let (mut x, mut y) = (b - RATIO * (b - a), a + RATIO * (b - a));
    let (mut fx, mut fy) = (f(x), f(y));
    for _ in 0..STEPS {
        if fx < fy {
            (b, y, fy) = (y, x, fx);
            x = b - RATIO * (b - a);
            fx = f(x);
        } else {
            (a, x, fx) = (x, y, fy);
            y = a + RATIO * (b - a);
            fy = f(y);
        }
    }
    if fx < fy { x } else { y }
}
