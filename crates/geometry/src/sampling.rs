//! Samples: scrambled Halton points, a small random generator, and what unit numbers become.
//!
//! A [`Halton`] sequence fills the unit cube evenly and can be asked for any point by its index. Directions come from a
//! named [`Directions`] measure, which also tells its density; points come from triangles and boxes.
//!
//! ```
//! use farsight_geometry::sampling::{Directions, Halton};
//!
//! // Irradiance under a sky of radiance 1 is π; cosine-weighted directions get it exactly.
//! let halton = Halton::new(7);
//! let sum: f64 = (0..64)
//!     .map(|i| {
//!         let direction = Directions::Cosine.sample(halton.point(i));
//!         direction.z / Directions::Cosine.density(direction.z)
//!     })
//!     .sum();
//! assert!((sum / 64.0 - std::f64::consts::PI).abs() < 1e-9);
//! ```

use crate::bounds::DAabb;
use glam::DVec3;
use std::f64::consts::{FRAC_1_PI, FRAC_PI_2, TAU};

/// Number of dimensions of a [`Halton`] sequence.
pub const HALTON_DIMENSIONS: usize = 12;

/// The largest number below one.
const BELOW_ONE: f64 = 1.0 - f64::EPSILON / 2.0;

/// The finaliser of SplitMix64: every bit of the input reaches every bit of the output.
const fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Step of SplitMix64: 2⁶⁴ over the golden ratio.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// The upper 53 bits as a number in [0, 1).
fn to_unit(bits: u64) -> f64 {
    (bits >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
}

/// A small random generator (SplitMix64): any seed will do, period 2⁶⁴, not for secrets.
///
/// # References
/// [Steele, Lea, Flood 2014] *Fast splittable pseudorandom number generators*.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Random {
    state: u64,
}

impl Random {
    /// A generator; the same seed gives the same numbers on every machine.
    pub fn new(seed: u64) -> Self {
        Self { state: seed }
    }

    /// 64 random bits.
    #[inline]
    pub fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(GOLDEN);
        mix(self.state)
    }

    /// A number in [0, 1), a multiple of 2⁻⁵³.
    #[inline]
    pub fn unit(&mut self) -> f64 {
        to_unit(self.bits())
    }

    /// `N` numbers in [0, 1).
    pub fn units<const N: usize>(&mut self) -> [f64; N] {
        std::array::from_fn(|_| self.unit())
    }

    /// A whole number below `n`; zero when `n` is zero. The bias is below n / 2⁶⁴.
    #[inline]
    pub fn below(&mut self, n: u64) -> u64 {
        ((u128::from(self.bits()) * u128::from(n)) >> 64) as u64
    }

    /// The generator number `index` of a family, for example one per object: what it gives does not depend on the others, nor
    /// on how far this one has gone when all are taken from a fresh one.
    #[must_use]
    pub fn stream(&self, index: u64) -> Self {
        // Two rounds of mixing keep neighbouring indices apart.
        let mixed = |n: u64| mix(n.wrapping_add(GOLDEN));
        Self { state: mixed(self.state ^ mixed(index ^ 0x5bf0_3635)) }
    }

    /// Another generator, whose numbers have nothing to do with those that this one goes on to give.
    #[must_use]
    pub fn fork(&mut self) -> Self {
        Self { state: mix(self.bits() ^ GOLDEN) }
    }
}

/// The Halton sequence in bases 2, 3, 5, ..., 37 with Owen scrambling.
///
/// Dimension d of the points 0..bᵏ has exactly one point in each of the bᵏ equal intervals, b being its base, and so
/// for every later run of bᵏ that begins at a multiple of bᵏ. The scrambling keeps that, breaks the patterns that the plain sequence has in
/// its larger bases, and makes every point uniform, so that means over seeds are unbiased.
///
/// # Cost
/// A dozen operations in base 2; else one multiplication and two divisions by a constant for each of 21 (base 3) to 7
/// (base 37) digits. No state, no tables; points can be asked for in any order.
///
/// # References
/// [Halton 1960], [Owen 1995] nested scrambling, [Laine, Karras 2011] with the constants of [Vegdahl 2021] in base 2.
/// Differs: in the other bases the permutation of a digit is drawn from the maps
/// a·x + c (mod b) only, which treat every pair of digits as all permutations do, and only pairs matter for the variance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Halton {
    seed: u64,
}

impl Halton {
    /// A sequence; different seeds give independent scramblings.
    pub fn new(seed: u64) -> Self {
        Self { seed: mix(seed.wrapping_add(GOLDEN)) }
    }

    /// Coordinate `dimension` of point `index`, in [0, 1).
    ///
    /// # Panics
    /// When `dimension` is not below [`HALTON_DIMENSIONS`].
    pub fn sample(&self, index: u32, dimension: usize) -> f64 {
        // The base is a constant in each arm, so that digits are found by multiplication.
        match dimension {
            0 => self.scrambled_bits(index),
            1 => self.scrambled::<3>(index),
            2 => self.scrambled::<5>(index),
            3 => self.scrambled::<7>(index),
            4 => self.scrambled::<11>(index),
            5 => self.scrambled::<13>(index),
            6 => self.scrambled::<17>(index),
            7 => self.scrambled::<19>(index),
            8 => self.scrambled::<23>(index),
            9 => self.scrambled::<29>(index),
            10 => self.scrambled::<31>(index),
            11 => self.scrambled::<37>(index),
            _ => panic!("dimension {dimension} of a Halton sequence with {HALTON_DIMENSIONS}"),
        }
    }

    /// The first `N` coordinates of point `index`.
    ///
    /// # Panics
    /// When `N` is above [`HALTON_DIMENSIONS`].
    pub fn point<const N: usize>(&self, index: u32) -> [f64; N] {
        std::array::from_fn(|dimension| self.sample(index, dimension))
    }

    /// Base 2: a product carries only upwards, so a hash made of products lets every bit flip by those below it alone.
    fn scrambled_bits(&self, index: u32) -> f64 {
        let (high, low) = ((self.seed >> 32) as u32, self.seed as u32);
        let mut x = index;
        x ^= x.wrapping_mul(0x3d20_adea);
        x = x.wrapping_add(low);
        x = x.wrapping_mul(high | 1);
        x ^= x.wrapping_mul(0x0552_6c56);
        x ^= x.wrapping_mul(0x53a2_2864);
        in_interval(x.reverse_bits().into(), 1 << 32, mix(self.seed ^ u64::from(index)))
    }

    fn scrambled<const B: u32>(&self, mut index: u32) -> f64 {
        // What the digits so far select: the node of the scrambling tree.
        let mut node = mix(self.seed ^ u64::from(B).wrapping_mul(GOLDEN));
        let (mut digits, mut intervals) = (0u64, 1u64);
        // Leading zeros are digits as well: they are scrambled together with those of larger indices.
        while intervals < 1 << 32 {
            let digit = index % B;
            index /= B;
            digits = digits * u64::from(B) + u64::from(permuted::<B>(digit, node));
            intervals *= u64::from(B);
            node = (node ^ u64::from(digit + 1)).wrapping_mul(0xd6e8_feb8_6659_fd93);
            node ^= node >> 32;
        }
        in_interval(digits, intervals, mix(node))
    }
}

/// A number in the given one of `count` equal intervals of [0, 1).
fn in_interval(interval: u64, count: u64, bits: u64) -> f64 {
    let (interval, count) = (interval as f64, count as f64);
    let value = (interval + to_unit(bits)) / count;
    // Rounding must not lift it into the next interval.
    if value < (interval + 1.0) / count { value.min(BELOW_ONE) } else { interval / count }
}

/// The digit under the permutation of a node.
fn permuted<const B: u32>(digit: u32, node: u64) -> u32 {
    let (high, low) = ((node >> 32) as u32, node as u32);
    let below = |bits: u32, n: u32| ((u64::from(bits) * u64::from(n)) >> 32) as u32;
    let factor = 1 + below(high, B - 1);
    (digit * factor + below(low, B)) % B
}

/// A measure of directions around +z.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Directions {
    /// Uniform over the sphere.
    Sphere,
    /// Uniform over the hemisphere z ≥ 0.
    Hemisphere,
    /// Density proportional to cos θ over the hemisphere: how much a surface receives.
    Cosine,
    /// The angle θ to the axis uniform in 0..π/2, hence dense around the axis.
    Polar,
}

impl Directions {
    /// A unit direction from two numbers in [0, 1); its length is 1 to within 4 ulp.
    pub fn sample(self, [u, v]: [f64; 2]) -> DVec3 {
        let (cos, sin) = match self {
            Directions::Sphere => with_sin(1.0 - 2.0 * u),
            Directions::Hemisphere => with_sin(1.0 - u),
            Directions::Cosine => ((1.0 - u).sqrt(), u.sqrt()),
            Directions::Polar => {
                let (sin, cos) = (u * FRAC_PI_2).sin_cos();
                (cos, sin)
            }
        };
        let (y, x) = (v * TAU).sin_cos();
        DVec3::new(sin * x, sin * y, cos)
    }

    /// Density per steradian at a direction whose angle to the axis has the given cosine.
    ///
    /// That of [`Polar`](Self::Polar) is infinite on the axis.
    pub fn density(self, cos: f64) -> f64 {
        match self {
            Directions::Sphere => 0.25 * FRAC_1_PI,
            _ if cos < 0.0 => 0.0,
            Directions::Hemisphere => 0.5 * FRAC_1_PI,
            Directions::Cosine => cos * FRAC_1_PI,
            Directions::Polar => FRAC_1_PI * FRAC_1_PI / ((1.0 - cos) * (1.0 + cos)).max(0.0).sqrt(),
        }
    }
}

fn with_sin(cos: f64) -> (f64, f64) {
    (cos, ((1.0 - cos) * (1.0 + cos)).max(0.0).sqrt())
}

/// `local`, a direction around +z, turned to be around the unit vector `axis`.
///
/// # References
/// [Duff et al. 2017] *Building an Orthonormal Basis, Revisited*.
#[inline]
pub fn around(axis: DVec3, local: DVec3) -> DVec3 {
    let sign = 1f64.copysign(axis.z);
    let a = -1.0 / (sign + axis.z);
    let b = axis.x * axis.y * a;
    let x = DVec3::new(1.0 + sign * axis.x * axis.x * a, sign * b, -sign * axis.x);
    let y = DVec3::new(b, sign + axis.y * axis.y * a, -axis.y);
    x * local.x + y * local.y + axis * local.z
}

/// A point of a triangle, uniform by area, from two numbers in [0, 1).
#[inline]
pub fn on_triangle([a, b, c]: [DVec3; 3], [u, v]: [f64; 2]) -> DVec3 {
    let root = u.sqrt();
    a + (b - a) * (root * (1.0 - v)) + (c - a) * (root * v)
}

/// A point in a box, uniform by volume, from three numbers in [0, 1). Flat boxes are fine; of an empty one the result is
/// meaningless.
pub fn in_box(b: &DAabb, u: [f64; 3]) -> DVec3 {
    (b.min + (b.max - b.min) * DVec3::from_array(u)).clamp(b.min, b.max)
}

/// A point on the faces of a box, uniform by area, from three numbers in [0, 1); and the outward normal there.
///
/// A box without area (a line or a point) gives points in it. Of an empty box the result is meaningless.
pub fn on_box(b: &DAabb, [face, u, v]: [f64; 3]) -> (DVec3, DVec3) {
    let size = b.max - b.min;
    let areas = [size.y * size.z, size.z * size.x, size.x * size.y];
    let total = 2.0 * (areas[0] + areas[1] + areas[2]);
    let mut rest = face * total;
    for axis in 0..3 {
        for side in [0.0, 1.0] {
            let last = axis == 2 && side == 1.0;
            if rest < areas[axis] || last {
                let mut unit = [0.0; 3];
                unit[axis] = side;
                (unit[(axis + 1) % 3], unit[(axis + 2) % 3]) = (u, v);
                if total == 0.0 {
                    unit = [u; 3];
                }
                let mut normal = DVec3::ZERO;
                normal[axis] = 2.0 * side - 1.0;
                return (in_box(b, unit), normal);
            }
            rest -= areas[axis];
        }
    }
    unreachable!("the last face takes what is left")
}

#[cfg(test)]
mod tests {
    use super::*;

    const BASES: [u32; HALTON_DIMENSIONS] = [2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37];

    #[test]
    fn every_elementary_interval_has_one_point() {
        for seed in 0..4 {
            let halton = Halton::new(seed);
            for (dimension, base) in BASES.into_iter().enumerate() {
                let mut count = base;
                while count <= 2000 {
                    for start in [0, count, 5 * count, (u32::MAX / count - 1) * count] {
                        let mut hit = vec![0; count as usize];
                        for i in 0..count {
                            let x = halton.sample(start + i, dimension);
                            assert!((0.0..1.0).contains(&x));
                            hit[(x * f64::from(count)) as usize] += 1;
                        }
                        assert!(hit.iter().all(|h| *h == 1), "base {base}, {count} from {start}");
                    }
                    count *= base;
                }
            }
        }
    }

    #[test]
    fn pairs_of_dimensions_are_stratified_too() {
        // 2³ · 3² boxes hold one point each of any aligned run of 72.
        let halton = Halton::new(11);
        for run in 0..5 {
            let mut hit = [0; 72];
            for i in 0..72 {
                let [x, y] = halton.point(run * 72 + i);
                hit[(x * 8.0) as usize * 9 + (y * 9.0) as usize] += 1;
            }
            assert!(hit.iter().all(|h| *h == 1));
        }
    }

    #[test]
    fn single_points_are_uniform_over_seeds() {
        for index in [0, 1, 2, 1000, u32::MAX] {
            for dimension in 0..HALTON_DIMENSIONS {
                let samples = (0..4000).map(|seed| Halton::new(seed).sample(index, dimension));
                assert!(chi_square(samples, 20) < LIMIT_19, "point {index}, dimension {dimension}");
            }
        }
    }

    /// Of χ² with 19 degrees of freedom, exceeded with probability 1e-6.
    const LIMIT_19: f64 = 64.0;

    /// χ² of samples in [0, 1) against equal shares.
    fn chi_square(samples: impl Iterator<Item = f64>, bins: usize) -> f64 {
        let mut counts = vec![0.0; bins];
        let mut total = 0.0;
        for x in samples {
            counts[(x * bins as f64) as usize] += 1.0;
            total += 1.0;
        }
        let expected = total / bins as f64;
        counts.iter().map(|c: &f64| (c - expected).powi(2) / expected).sum()
    }

    /// Root mean square error of the mean of `f` over 64 seeds.
    fn error(f: impl Fn([f64; 4]) -> f64, truth: f64, point: impl Fn(u64, u32) -> [f64; 4], n: u32) -> f64 {
        let mean = |seed| (0..n).map(|i| f(point(seed, i))).sum::<f64>() / f64::from(n);
        ((0..64).map(|seed| (mean(seed) - truth).powi(2)).sum::<f64>() / 64.0).sqrt()
    }

    #[test]
    fn integrals_converge_faster_than_at_random() {
        type F = fn([f64; 4]) -> f64;
        let smooth: F = |x| x.iter().product::<f64>() * 16.0;
        let disk: F = |[x, y, ..]| if x * x + y * y < 1.0 { 4.0 } else { 0.0 };
        let random = |seed: u64, i: u32| Random::new(mix(seed) ^ u64::from(i) << 32).units();
        let halton = |seed: u64, i: u32| Halton::new(seed).point(i);
        for (f, truth, factor) in [(smooth, 1.0, 8.0), (disk, std::f64::consts::PI, 3.0)] {
            let (by_chance, by_halton) = (error(f, truth, random, 1024), error(f, truth, halton, 1024));
            assert!(by_halton * factor < by_chance, "{by_halton} against {by_chance}");
            // Four times the points: half the error at random, a third or less here.
            assert!(error(f, truth, halton, 4096) < 0.42 * by_halton);
        }
    }

    #[test]
    fn sequences_are_what_they_were() {
        // Fixed numbers: a change of the generator changes every result that was made with it.
        let mut random = Random::new(1);
        assert_eq!(random.bits(), 0x910a_2dec_8902_5cc1);
        assert_eq!(Halton::new(1).sample(12345, 3), Halton::new(1).sample(12345, 3));
        assert_ne!(Halton::new(1).sample(12345, 3), Halton::new(2).sample(12345, 3));
        let mut fork = random.fork();
        assert_ne!(fork.bits(), random.bits());
        assert!((0..1000).all(|_| random.below(7) < 7) && random.below(0) == 0);
    }

    #[test]
    fn random_bits_are_even() {
        let mut random = Random::new(42);
        assert!(chi_square((0..100_000).map(|_| random.unit()), 20) < LIMIT_19);
        let mut seen = [0.0; 20];
        (0..100_000).for_each(|_| seen[random.below(20) as usize] += 1.0);
        assert!(seen.iter().map(|c: &f64| (c - 5000.0).powi(2) / 5000.0).sum::<f64>() < LIMIT_19);
    }

    #[test]
    fn directions_follow_their_densities() {
        let n = 40_000;
        for measure in [Directions::Sphere, Directions::Hemisphere, Directions::Cosine, Directions::Polar] {
            // Share of directions with cos θ above c, by the midpoint rule over the density.
            let share_above = |c: f64| {
                let steps = 20_000;
                let (low, width) = (c.acos(), c.acos() / f64::from(steps));
                let angle = |i: i32| low * (f64::from(i) + 0.5) / f64::from(steps);
                (0..steps)
                    .map(|i| measure.density(angle(i).cos()) * TAU * angle(i).sin() * width)
                    .sum::<f64>()
            };
            let mut random = Random::new(5);
            let directions: Vec<DVec3> = (0..n).map(|_| measure.sample(random.units())).collect();
            assert!(directions.iter().all(|d| (d.length() - 1.0).abs() < 1e-15 * 4.0));
            for c in [-0.5, 0.0, 0.3, 0.7, 0.95] {
                let share = directions.iter().filter(|d| d.z > c).count() as f64 / f64::from(n);
                let truth = share_above(c);
                let deviation = (truth * (1.0 - truth) / f64::from(n)).max(0.0).sqrt();
                assert!((share - truth).abs() < 5.0 * deviation + 1e-4, "{measure:?} {c}: {share} {truth}");
            }
            let azimuth = directions.iter().map(|d| (d.y.atan2(d.x) / TAU).rem_euclid(1.0).min(BELOW_ONE));
            assert!(chi_square(azimuth, 20) < LIMIT_19);
        }
    }

    #[test]
    fn frames_keep_angles_and_lengths() {
        let mut random = Random::new(3);
        let mut axes: Vec<DVec3> = (0..1000).map(|_| Directions::Sphere.sample(random.units())).collect();
        axes.extend([DVec3::Z, DVec3::NEG_Z, DVec3::X, DVec3::new(0.0, 1e-9, -1.0).normalize()]);
        for axis in axes {
            let local = Directions::Sphere.sample(random.units());
            let turned = around(axis, local);
            assert!((turned.length() - 1.0).abs() < 1e-14 && (turned.dot(axis) - local.z).abs() < 1e-14);
        }
    }

    #[test]
    fn points_on_triangles_are_uniform() {
        let corners = [DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 0.0, 1.0), DVec3::new(-2.0, 1.0, 0.0)];
        let [a, b, c] = corners;
        let area = |p: DVec3, q: DVec3, r: DVec3| (q - p).cross(r - p).length();
        let mut random = Random::new(8);
        let points: Vec<DVec3> = (0..20_000).map(|_| on_triangle(corners, random.units())).collect();
        for (p, q, r) in [(a, b, c), (b, c, a), (c, a, b)] {
            // The barycentric weight t of a corner has P(weight < t) = 1 − (1 − t)².
            let weight = |x: &DVec3| area(*x, q, r) / area(p, q, r);
            let uniform = points.iter().map(|x| (1.0 - (1.0 - weight(x)).powi(2)).clamp(0.0, BELOW_ONE));
            assert!(chi_square(uniform, 20) < LIMIT_19);
        }
        assert_eq!(on_triangle([a; 3], [0.3, 0.9]), a);
    }

    #[test]
    fn points_on_boxes_are_shared_by_area() {
        let b = DAabb::new(DVec3::new(1.0, 2.0, 3.0), DVec3::new(2.0, 4.0, 7.0));
        let mut random = Random::new(2);
        let (n, mut counts) = (60_000, [0.0; 6]);
        for _ in 0..n {
            let (point, normal) = on_box(&b, random.units());
            let axis = (0..3).find(|&i| normal[i] != 0.0).unwrap();
            let side = usize::from(normal[axis] > 0.0);
            assert_eq!(point[axis], if side == 1 { b.max[axis] } else { b.min[axis] });
            assert!(b.contains(point));
            counts[2 * axis + side] += 1.0;
        }
        for (count, area) in counts.iter().zip([8.0, 8.0, 4.0, 4.0, 2.0, 2.0]) {
            let expected = f64::from(n) * area / 28.0;
            assert!((count - expected).abs() < 5.0 * expected.sqrt(), "{counts:?}");
        }
        let line = DAabb::new(DVec3::ZERO, DVec3::X);
        assert!((0..100).all(|_| line.contains(on_box(&line, random.units()).0)));
        let mean = (0..n).map(|_| in_box(&b, random.units())).sum::<DVec3>() / f64::from(n);
        assert!(mean.distance(b.center()) < 0.03);
    }
}
