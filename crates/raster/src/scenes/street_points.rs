//! A laser scanner's point cloud of a street.

use super::check;
use crate::RasterError;
use crate::random::{Random, mix};
use glam::DVec3;

/// A scanned point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScanPoint {
    /// World position in metres, offset included.
    pub position: DVec3,
    /// sRGB colour.
    pub colour: [u8; 3],
}

/// Points on a street with houses, cars and trees as a scanner on a tripod sees them from stations along it.
///
/// Directions are uniform over the sphere, so the density on a surface falls with the square of the distance, and what
/// lies behind something has no points. Points come one by one in order of their stations; nothing is stored, so any number
/// can be had.
///
/// ```
/// use farsight_raster::scenes::StreetPoints;
/// let mut street = StreetPoints::default();
/// street.count = 1000;
/// assert_eq!(street.points()?.count(), 1000);
/// # Ok::<(), farsight_raster::RasterError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct StreetPoints {
    /// Seed of everything random.
    pub seed: u64,
    /// Number of points.
    pub count: u64,
    /// Length of the street in metres: 10 to 100,000.
    pub length: f64,
    /// Metres between stations: 1 to 100.
    pub station_spacing: f64,
    /// Added to all positions: by default UTM coordinates, where `f32` would lose centimetres to decimetres.
    pub offset: DVec3,
    /// Standard deviation of the range in metres.
    pub noise: f64,
}

impl Default for StreetPoints {
    /// A million points along 200 m at UTM 32N (691,000, 5,335,000), 519 m high, 3 mm of noise.
    fn default() -> Self {
        Self {
            seed: 1,
            count: 1_000_000,
            length: 200.0,
            station_spacing: 20.0,
            offset: DVec3::new(691_000.0, 5_335_000.0, 519.0),
            noise: 0.003,
        }
    }
}

/// Height of the scanner.
const TRIPOD: f64 = 1.9;
/// Distance from the street's middle to the fronts.
const FRONT: f64 = 8.0;
/// Longest range of the scanner.
const RANGE: f64 = 120.0;
const HOUSE: f64 = 9.0;
const TREE_SPACING: f64 = 14.0;
const CAR_SPACING: f64 = 7.0;

impl StreetPoints {
    /// The points.
    ///
    /// # Errors
    /// [`RasterError::Option`] when an option is out of its range.
    pub fn points(&self) -> Result<impl Iterator<Item = ScanPoint> + use<>, RasterError> {
        check("length", self.length, "[10, 1e5]", (10.0..=1e5).contains(&self.length))?;
        let spacing = self.station_spacing;
        check("station_spacing", spacing, "[1, 100]", (1.0..=100.0).contains(&spacing))?;
        check("noise", self.noise, "[0, 1]", (0.0..=1.0).contains(&self.noise))?;
        check("offset", self.offset.length(), "finite", self.offset.is_finite())?;
        let street = *self;
        Ok((0..self.count).map(move |i| street.point(i)))
    }

    /// Stations from one end of the street to the other.
    fn stations(&self) -> u64 {
        (self.length / self.station_spacing) as u64 + 1
    }

    fn point(&self, i: u64) -> ScanPoint {
        let station = (u128::from(i) * u128::from(self.stations()) / u128::from(self.count)) as u64;
        let eye = DVec3::new(station as f64 * self.station_spacing, 0.4, TRIPOD);
        let mut random = Random::new(self.seed).fork(i);
        // More than half of all directions hit something; the ground straight below always does.
        for _ in 0..64 {
            let direction = random.direction().as_dvec3();
            if let Some((t, colour)) = self.cast(eye, direction, &mut random) {
                let gauss = (0..4).map(|_| random.unit() - 0.5).sum::<f64>() * 3f64.sqrt();
                let position = eye + direction * (t + self.noise * gauss) + self.offset;
                let tint = random.range(0.9, 1.1);
                let colour = colour.map(|c| (f64::from(c) * tint).min(255.0) as u8);
                return ScanPoint { position, colour };
            }
        }
        ScanPoint { position: eye.with_z(0.0) + self.offset, colour: [90; 3] }
    }

    fn hash(&self, what: u64, index: i64) -> u64 {
        mix(self.seed ^ mix(what ^ mix(index as u64)))
    }

    /// What a ray meets first, and its colour.
    fn cast(&self, eye: DVec3, d: DVec3, random: &mut Random) -> Option<(f64, [u8; 3])> {
        let mut best: Option<(f64, [u8; 3])> = None;
        let mut offer = |t: f64, colour: [u8; 3]| {
            if t > 0.5 && t < RANGE && best.is_none_or(|b| t < b.0) {
                best = Some((t, colour));
            }
        };
        let t = -eye.z / d.z;
        let y = eye.y + d.y * t;
        if d.z < 0.0 && y.abs() <= FRONT {
            offer(t, if y.abs() < 5.0 { [92, 92, 96] } else { [160, 154, 146] });
        }
        for side in [-1.0, 1.0] {
            if let Some((t, colour)) = self.front(eye, d, side) {
                offer(t, colour);
            }
        }
        let reach = |spacing: f64| {
            let (a, b) = (eye.x, eye.x + d.x * FRONT / d.y.abs().max(FRONT / RANGE));
            let cell = |x: f64| (x.clamp(0.0, self.length) / spacing).floor() as i64;
            cell(a.min(b)) - 1..=cell(a.max(b)) + 1
        };
        for n in reach(CAR_SPACING) {
            if let Some((t, colour)) = self.car(eye, d, n) {
                offer(t, colour);
            }
        }
        for n in reach(TREE_SPACING) {
            if let Some((t, colour)) = self.tree(eye, d, n, random) {
                offer(t, colour);
            }
        }
        best
    }

    /// A house front with windows set back.
    fn front(&self, eye: DVec3, d: DVec3, side: f64) -> Option<(f64, [u8; 3])> {
        if d.y * side <= 0.0 {
            return None;
        }
        let at = |depth: f64| {
            let t = (side * (FRONT + depth) - eye.y) / d.y;
            (t, eye + d * t)
        };
        let (t, p) = at(0.0);
        if p.x < 0.0 || p.x > self.length {
            return None;
        }
        let h = self.hash(if side > 0.0 { 1 } else { 2 }, (p.x / HOUSE) as i64);
        let floors = 3 + h % 3;
        if !(0.0..=3.0 * floors as f64 + 0.6).contains(&p.z) {
            return None;
        }
        let window = |p: DVec3| {
            let (u, v) = ((p.x.rem_euclid(HOUSE)).rem_euclid(HOUSE / 4.0), p.z.rem_euclid(3.0));
            (0.6..1.65).contains(&u) && (0.95..2.4).contains(&v) && p.z < 3.0 * floors as f64
        };
        if window(p) {
            let (t, inner) = at(0.2);
            // Rays that pass the frame's edge hit the reveal, at about the same distance.
            return Some((t, if window(inner) { [58, 68, 78] } else { [190, 180, 165] }));
        }
        const WALLS: [[u8; 3]; 6] = [
            [214, 190, 150],
            [186, 110, 86],
            [226, 216, 198],
            [198, 168, 128],
            [170, 176, 172],
            [222, 194, 128],
        ];
        Some((t, WALLS[(h >> 8) as usize % WALLS.len()]))
    }

    /// A parked car: two boxes.
    fn car(&self, eye: DVec3, d: DVec3, n: i64) -> Option<(f64, [u8; 3])> {
        let h = self.hash(3, n);
        let x = n as f64 * CAR_SPACING;
        if h.is_multiple_of(3) || x < 0.0 || x + 4.4 > self.length {
            return None;
        }
        let y = if h & 16 == 0 { 3.0 } else { -4.8 };
        const PAINTS: [[u8; 3]; 5] =
            [[40, 44, 52], [176, 178, 182], [150, 36, 34], [42, 72, 128], [228, 228, 226]];
        let paint = PAINTS[(h >> 8) as usize % PAINTS.len()];
        let body = slab(eye, d, DVec3::new(x, y, 0.35), DVec3::new(x + 4.2, y + 1.75, 0.95));
        let cabin = slab(eye, d, DVec3::new(x + 0.9, y + 0.15, 0.95), DVec3::new(x + 3.4, y + 1.6, 1.45));
        match (body, cabin) {
            (Some(b), Some(c)) if c < b => Some((c, [52, 58, 64])),
            (Some(b), _) => Some((b, paint)),
            (None, c) => c.map(|c| (c, [52, 58, 64])),
        }
    }

    /// A tree: a trunk, and leaves that let some rays through.
    fn tree(&self, eye: DVec3, d: DVec3, n: i64, random: &mut Random) -> Option<(f64, [u8; 3])> {
        let x = (n as f64 + 0.5) * TREE_SPACING;
        if x < 0.0 || x > self.length {
            return None;
        }
        let foot = DVec3::new(x, if n % 2 == 0 { 6.0 } else { -6.0 }, 0.0);
        let trunk = slab(eye, d, foot - DVec3::new(0.12, 0.12, 0.0), foot + DVec3::new(0.12, 0.12, 3.4));
        let (center, radius) = (foot + DVec3::Z * 4.6, 1.8);
        let along = (center - eye).dot(d);
        let half_sq = radius * radius - (center - eye).length_squared() + along * along;
        let leaves = (half_sq > 0.0).then(|| {
            let half = half_sq.sqrt();
            // Leaves stop a ray after 0.9 m on average.
            (along - half - 0.9 * (1.0 - random.unit()).ln(), along + half)
        });
        let leaf = leaves.filter(|(t, end)| t < end).map(|(t, _)| (t, [84, 116, 52]));
        let bark = trunk.map(|t| (t, [100, 82, 62]));
        match (leaf, bark) {
            (Some(l), Some(b)) => Some(if l.0 < b.0 { l } else { b }),
            (l, b) => l.or(b),
        }
    }
}

/// Distance at which a ray enters a box.
fn slab(eye: DVec3, d: DVec3, min: DVec3, max: DVec3) -> Option<f64> {
    let (a, b) = ((min - eye) / d, (max - eye) / d);
    let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
    (enter > 0.0 && enter <= leave).then_some(enter)
}
