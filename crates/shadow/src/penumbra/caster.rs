//! How coarse a caster may be drawn before its shadow shows it (Guthe 2004, 4.1, corrected).
//!
//! A caster displaced by ε across the light shifts its shadow on a receiver d_p behind it by ε·(d_l + d_p)/d_l. A penumbra of width s_p whose
//! brightness rises at most K times as steeply as a straight ramp changes by K·shift/s_p. Allowing a shift of ε_r *and then* a change of
//! intensity of γ gives
//!
//! ```text
//! ε_c = (ε_r·d_l + γ·s_l·d_p / K) / (d_l + d_p)
//! ```
//!
//! What differs from the paper: K (the paper's 1 holds for a rectangle with the edge along a side; a disk has 4/π, and 2 bounds every
//! convex light), and the distance d_p. ε_c is monotone in d_p, rising or falling with the sign of γ·s_l/K − ε_r, so the least over an
//! interval is at one of its ends; the paper takes the distance of the caster to the view, which for hard shadows is the wrong end.

use super::width::Profile;

/// What may be seen of a caster's coarseness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// Shift of a shadow's edge on the receiver, in world units: half a pixel there, say. The least over the receivers that the caster's
    /// shadow meets.
    pub edge: f64,
    /// Change of intensity after that, as a share of the light; 0 to 1.
    pub intensity: f64,
}

/// The light as a caster sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Source {
    /// Extent of the light across the edge, in world units; 0 for a point. For parallel light, where sizes and distances are infinite, see
    /// [`sun`](Self::sun).
    pub size: f64,
    /// Least and largest distance from the caster to the light.
    pub d_l: [f64; 2],
    /// How its brightness is distributed.
    pub profile: Profile,
}

impl Source {
    /// Parallel light that fills the angle `diameter` (radians): a disk of that size at distance 1, as it were infinitely far.
    pub fn sun(diameter: f64) -> Self {
        // Large enough for d_p/d_l to vanish in f64, small enough for products not to overflow.
        const FAR: f64 = 1e30;
        Self { size: 2.0 * (0.5 * diameter).tan() * FAR, d_l: [FAR, FAR], profile: Profile::Disk }
    }
}

/// ε_h: displacement of a caster that shifts a hard shadow by at most `edge` on a receiver `d_p` behind it.
pub fn hard(edge: f64, d_l: f64, d_p: f64) -> f64 {
    edge * d_l / (d_l + d_p)
}

/// ε_i: displacement that changes the intensity anywhere in a penumbra by at most `intensity`.
pub fn intensity(intensity: f64, source_size: f64, profile: Profile, d_l: f64, d_p: f64) -> f64 {
    intensity * source_size * d_p / (profile.steepest() * (d_l + d_p))
}

/// ε_c at one distance: both tolerances used up, one after the other.
pub fn at_distance(tolerance: &Tolerance, source_size: f64, profile: Profile, d_l: f64, d_p: f64) -> f64 {
    hard(tolerance.edge, d_l, d_p) + intensity(tolerance.intensity, source_size, profile, d_l, d_p)
}

/// ε_c for a caster whose receivers lie between `d_p[0]` and `d_p[1]` behind it: the least over the intervals of both distances.
///
/// # Accuracy
/// No caster within it breaks the paired tolerance: its shadow is the exact one, shifted by at most `tolerance.edge`, and then off by at most
/// `tolerance.intensity`. It does not promise either of the two alone.
pub fn tolerance(tolerance: &Tolerance, source: &Source, d_p: [f64; 2]) -> f64 {
    // Monotone in each distance, the other fixed, so the least is at a corner of the rectangle of both.
    let at = |d_l, d_p| at_distance(tolerance, source.size, source.profile, d_l, d_p);
    let ends = [
        at(source.d_l[0], d_p[0]),
        at(source.d_l[0], d_p[1]),
        at(source.d_l[1], d_p[0]),
        at(source.d_l[1], d_p[1]),
    ];
    ends.into_iter().fold(f64::INFINITY, f64::min)
}

/// The paper's own rule, for comparison: K = 1, and d_p the distance from the caster to the view (0 when it is in view). Exceeds its tolerance up to
/// tenfold for point lights whose receivers are far behind the caster.
pub fn paper_rule(tolerance: &Tolerance, source_size: f64, d_l: f64, distance_to_view: f64) -> f64 {
    at_distance(tolerance, source_size, Profile::Rectangle, d_l, distance_to_view)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::penumbra::coverage::disk_past_half_plane;
    use farsight_geometry::sampling::Random;

    /// How much of the light is seen at `x` on the receiver past an edge at 0, by the geometry of the scene: the ray from x through the edge
    /// meets the light's plane at −x·d_l/d_p.
    fn seen(profile: Profile, size: f64, d_l: f64, d_p: f64, edge: f64, x: f64) -> f64 {
        // Where the line from the receiver's point through the edge passes the light.
        let at = x + (edge - x) * (d_l + d_p) / d_p;
        if size == 0.0 {
            return f64::from(u8::from(at < 0.0));
        }
        let h = at / (0.5 * size);
        match profile {
            Profile::Rectangle => (0.5 - 0.5 * h).clamp(0.0, 1.0),
            Profile::Disk => f64::from(disk_past_half_plane(h as f32)),
            Profile::Diamond if h > 0.0 => 0.5 * (1.0 - h.min(1.0)).powi(2),
            Profile::Diamond => 1.0 - 0.5 * (1.0 + h.max(-1.0)).powi(2),
        }
    }

    /// Whether the shadow of the displaced edge is the exact one, shifted by at most `edge` and then off by at most `intensity`.
    fn holds(t: &Tolerance, profile: Profile, size: f64, d_l: f64, d_p: f64, epsilon: f64) -> bool {
        let spread = size * d_p / d_l + epsilon * (d_l + d_p) / d_l;
        // The allowed shift that brings the curves closest is the largest one: both are the same curve at two places.
        (-40..=40).all(|i| {
            let x = spread * f64::from(i) / 40.0;
            let coarse = seen(profile, size, d_l, d_p, epsilon, x);
            let exact = seen(profile, size, d_l, d_p, 0.0, x - t.edge * (1.0 + 1e-9));
            let least = seen(profile, size, d_l, d_p, 0.0, x + t.edge * (1.0 + 1e-9));
            // Between the curves shifted by ± the edge's tolerance, widened by the intensity's.
            let (lo, hi) = (exact.min(least), exact.max(least));
            coarse >= lo - t.intensity - 1e-6 && coarse <= hi + t.intensity + 1e-6
        })
    }

    #[test]
    fn the_corrected_rule_holds_where_the_paper_s_breaks() {
        let mut random = Random::new(21);
        let (mut broken, mut by_paper, mut worst) = (0, 0, 0.0f64);
        let (mut tight, count) = (0, 100_000);
        for _ in 0..count {
            let u: [f64; 8] = random.units();
            let d_l = 0.5 * 100f64.powf(u[0]);
            let near = 10f64.powf(3.0 * u[1] - 2.0);
            let far = near * 100f64.powf(u[2]);
            let size = if u[3] < 0.3 { 0.0 } else { 0.5 * d_l * u[3] };
            let profile = [Profile::Rectangle, Profile::Disk, Profile::Diamond][(u[4] * 3.0) as usize];
            let t = Tolerance { edge: 0.1 * u[5], intensity: 0.2 * u[6] };
            let source = Source { size, d_l: [d_l, d_l * (1.0 + u[7])], profile };
            let epsilon = tolerance(&t, &source, [near, far]);
            // The receiver may be anywhere in the interval.
            let d_ps = [near, far, near + (far - near) * u[6]];
            broken += u32::from(!d_ps.iter().all(|&d_p| holds(&t, profile, size, d_l, d_p, epsilon)));
            tight += u32::from(!d_ps.iter().all(|&d_p| holds(&t, profile, size, d_l, d_p, 2.5 * epsilon)));
            let paper = paper_rule(&t, size, d_l, 0.0);
            by_paper += u32::from(!d_ps.iter().all(|&d_p| holds(&t, profile, size, d_l, d_p, paper)));
            worst = worst.max(paper / epsilon);
        }
        println!(
            "of {count} configurations the corrected rule breaks {broken}, the paper's {by_paper}; it allows up to {worst:.0} times as much"
        );
        assert_eq!(broken, 0);
        assert!(by_paper > count / 4 && tight > count / 2, "{by_paper} {tight}");
        // The note's example: a light 1 away, the receiver 9 behind the caster, hard shadows.
        let t = Tolerance { edge: 0.01, intensity: 0.0 };
        let shift = paper_rule(&t, 0.0, 1.0, 0.0) * 10.0;
        assert!((shift / t.edge - 10.0).abs() < 1e-12);
    }

    #[test]
    fn special_lights() {
        let t = Tolerance { edge: 0.02, intensity: 0.1 };
        // A point light has no penumbra; parallel light shifts shadows as far as casters.
        let point = Source { size: 0.0, d_l: [5.0, 5.0], profile: Profile::Disk };
        assert_eq!(tolerance(&t, &point, [0.0, 5.0]), hard(0.02, 5.0, 5.0));
        let sun = Source::sun(0.0093);
        assert!((tolerance(&t, &Source::sun(0.0), [0.0, 1e6]) - 0.02).abs() < 1e-12);
        let soft = tolerance(&t, &sun, [10.0, 20.0]) - 0.02;
        assert!((soft - 0.1 * 0.0093 * 10.0 * std::f64::consts::FRAC_PI_4).abs() < 1e-6, "{soft}");
        assert_eq!(intensity(0.5, 0.0, Profile::Disk, 3.0, 4.0), 0.0);
    }
}
