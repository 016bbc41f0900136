//! Times looked up instead of computed: per object over the angles it is seen under, and per view cell over directions.
//!
//! An object's time is sampled over α, the angle its bounding sphere appears under, and over the direction it is seen from (γ around, φ
//! up). Small objects are limited by their geometry, whose time does not depend on the view: there nothing is measured.

use crate::appearance::largest_appearance;
use crate::{Millis, TimingError, sphere_pixels};
use farsight_geometry::sampling::Random;
use farsight_geometry::{Camera, DAabb, Sphere};
use glam::{DVec2, DVec3};
use std::f64::consts::{PI, TAU};

/// How densely an object is sampled.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct SampleOptions {
    /// Apparent sizes, evenly spread in the logarithm of tan(α/2).
    pub sizes: usize,
    /// Directions around (γ).
    pub around: usize,
    /// Directions from below to above (φ).
    pub up: usize,
    /// Smallest apparent size in radians; what appears smaller takes as long.
    pub least_angle: f64,
    /// Sizes that take at most this much longer, as a share, than the smallest one are not measured.
    pub prune: f64,
}

impl Default for SampleOptions {
    /// Twelve sizes from 0.01 rad on, eight directions around, three up; pruned within 3 %.
    fn default() -> Self {
        Self { sizes: 12, around: 8, up: 3, least_angle: 0.01, prune: 0.03 }
    }
}

/// Largest apparent half-angle: the eye is 1 % of the radius outside of the sphere.
const NEAREST: f64 = 1.01;

/// Times of one object at one level of detail.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjectSamples {
    sphere: Sphere,
    options: SampleOptions,
    /// By size, then elevation, then azimuth; smallest size first.
    times: Vec<Millis>,
    measured: usize,
    fov_y: f64,
}

impl ObjectSamples {
    /// Measures an object: `measure` draws it from an eye that looks at its centre, with the camera's projection.
    ///
    /// # Cost
    /// At most sizes · around · up measurements, far fewer for an object of small triangles; 8 bytes each.
    ///
    /// # Errors
    /// [`TimingError::Time`] when a measurement is negative or not finite, [`TimingError::Samples`] when an option is zero.
    pub fn measure(
        sphere: Sphere,
        lens: &Camera,
        options: SampleOptions,
        mut measure: impl FnMut(&Camera) -> Millis,
    ) -> Result<Self, TimingError> {
        let per_size = options.around * options.up;
        if options.sizes == 0 || per_size == 0 {
            return Err(TimingError::Samples { count: options.sizes.min(per_size), needed: 1 });
        }
        let fov_y = 2.0 * lens.half_extent().y.atan();
        let empty = vec![Millis::ZERO; options.sizes * per_size];
        let mut samples = Self { sphere, options, times: empty, measured: 0, fov_y };
        let mut take = |samples: &mut Self, size: usize, direction: usize| {
            let time = measure(&samples.view(lens, size, direction));
            crate::calibrate::check_time(time)?;
            samples.times[size * per_size + direction] = time;
            samples.measured += 1;
            Ok(())
        };
        // The smallest size from everywhere: what the geometry takes.
        (0..per_size).try_for_each(|d| take(&mut samples, 0, d))?;
        let limit = |m: Millis| m * (1.0 + samples.options.prune);
        let floor: Vec<Millis> = samples.times[..per_size].to_vec();
        let limits: Vec<Millis> = floor.iter().map(|&m| limit(m)).collect();
        for direction in 0..per_size {
            for size in (1..options.sizes).rev() {
                take(&mut samples, size, direction)?;
                if samples.times[size * per_size + direction] <= limits[direction] {
                    (1..size).for_each(|s| samples.times[s * per_size + direction] = floor[direction]);
                    break;
                }
            }
        }
        Ok(samples)
    }

    /// Measurements that were made.
    pub fn measured(&self) -> usize {
        self.measured
    }

    /// Times that pruning made up instead.
    pub fn pruned(&self) -> usize {
        self.times.len() - self.measured
    }

    /// What the object takes from a view: zero out of view. Where the image's edge cuts the sphere, α shrinks to the part in view.
    ///
    /// # Cost
    /// About 100 ns.
    pub fn look_up(&self, camera: &Camera) -> Millis {
        let visible = sphere_pixels(&self.sphere, camera);
        if visible <= 0.0 {
            return Millis::ZERO;
        }
        let from = camera.eye() - self.sphere.center;
        let distance = from.length();
        let sine = (self.sphere.radius / distance.max(NEAREST * self.sphere.radius)).min(1.0 / NEAREST);
        let tangent = sine / (1.0 - sine * sine).sqrt() * self.zoom(camera);
        // Seen at the centre of the image it would show this much.
        let centred = PI * (tangent * camera.pixels_per_unit() / self.zoom(camera)).powi(2);
        let screen = f64::from(camera.width()) * f64::from(camera.height());
        let share = (visible / centred.min(screen)).clamp(0.0, 1.0);
        self.at(tangent * share.sqrt(), if distance > 0.0 { from / distance } else { DVec3::X })
    }

    /// The largest time of any direction at the angle the sphere has from `eye`.
    fn largest_from(&self, eye: DVec3) -> Millis {
        let distance = eye.distance(self.sphere.center).max(NEAREST * self.sphere.radius);
        let sine = self.sphere.radius / distance;
        let level = self.place(sine / (1.0 - sine * sine).sqrt()).ceil() as usize;
        let per_size = self.options.around * self.options.up;
        // Conservative: of all directions and the next larger size.
        let row = &self.times[level * per_size..(level + 1) * per_size];
        row.iter().copied().fold(Millis::ZERO, Millis::max)
    }

    /// How much larger things appear than through the lens that was sampled.
    fn zoom(&self, camera: &Camera) -> f64 {
        (0.5 * self.fov_y).tan() / camera.half_extent().y
    }

    /// Fractional index of an apparent size, by tan(α/2).
    fn place(&self, tangent: f64) -> f64 {
        let [low, high] = self.tangents().map(f64::ln);
        let last = (self.options.sizes - 1) as f64;
        if last == 0.0 { 0.0 } else { ((tangent.ln() - low) / (high - low) * last).clamp(0.0, last) }
    }

    fn tangents(&self) -> [f64; 2] {
        let least = (0.5 * self.options.least_angle).tan().clamp(1e-6, 1.0);
        [least, 1.0 / (NEAREST * NEAREST - 1.0).sqrt()]
    }

    /// The camera of a sample.
    fn view(&self, lens: &Camera, size: usize, direction: usize) -> Camera {
        let [low, high] = self.tangents();
        let t = size as f64 / (self.options.sizes - 1).max(1) as f64;
        let tangent = low * (high / low).powf(t);
        let distance = self.sphere.radius.max(f64::MIN_POSITIVE) * (1.0 + 1.0 / (tangent * tangent)).sqrt();
        let (j, i) = (direction / self.options.around, direction % self.options.around);
        let up = ((j as f64 + 0.5) / self.options.up as f64 - 0.5) * PI;
        let around = i as f64 / self.options.around as f64 * TAU;
        let out = DVec3::new(up.cos() * around.cos(), up.cos() * around.sin(), up.sin());
        let camera = Camera::look_at(
            self.sphere.center + out * distance,
            self.sphere.center,
            out.any_orthogonal_vector(),
        );
        camera
            .and_then(|c| c.with_projection(lens.projection()))
            .and_then(|c| c.with_image(lens.width(), lens.height()))
            .and_then(|c| c.with_range(lens.near(), lens.far()))
            .unwrap_or(*lens)
    }

    /// Interpolated over size and both angles.
    fn at(&self, tangent: f64, from: DVec3) -> Millis {
        let o = &self.options;
        let split = |x: f64| (x.floor() as usize, x - x.floor());
        let (size, fs) = split(self.place(tangent));
        let up = (from.z.clamp(-1.0, 1.0).asin() / PI + 0.5) * o.up as f64 - 0.5;
        let (row, fr) = split(up.clamp(0.0, (o.up - 1) as f64));
        let (column, fc) = split((from.y.atan2(from.x) / TAU).rem_euclid(1.0) * o.around as f64);
        let mut sum = 0.0;
        for (s, ws) in [(size, 1.0 - fs), ((size + 1).min(o.sizes - 1), fs)] {
            for (r, wr) in [(row, 1.0 - fr), ((row + 1).min(o.up - 1), fr)] {
                for (c, wc) in [(column % o.around, 1.0 - fc), ((column + 1) % o.around, fc)] {
                    sum += ws * wr * wc * self.times[(s * o.up + r) * o.around + c].0;
                }
            }
        }
        Millis(sum)
    }
}

/// Directions that a view cell is sampled in: `count` around the horizon.
fn horizon(count: usize) -> impl Iterator<Item = DVec3> {
    (0..count).map(move |i| {
        let (sin, cos) = (i as f64 / count as f64 * TAU).sin_cos();
        DVec3::new(cos, sin, 0.0)
    })
}

/// Frame times of a view cell by direction: the largest of a few random views each (Wimmer 2007, 2.5.1).
#[derive(Clone, Debug, PartialEq)]
pub struct ViewCellSamples {
    times: Vec<Millis>,
}

impl ViewCellSamples {
    /// Measures frames from `views` random eyes in `cell` for each of `directions` around the horizon, jittered within their sector.
    ///
    /// # Errors
    /// [`TimingError::Samples`] without directions or views, [`TimingError::Time`] for an impossible measurement.
    pub fn measure(
        cell: &DAabb,
        directions: usize,
        views: usize,
        seed: u64,
        mut measure: impl FnMut(DVec3, DVec3) -> Millis,
    ) -> Result<Self, TimingError> {
        if directions == 0 || views == 0 || cell.is_empty() {
            return Err(TimingError::Samples { count: 0, needed: 1 });
        }
        let mut random = Random::new(seed);
        let sector = TAU / directions as f64;
        let mut times = Vec::with_capacity(directions);
        for ahead in horizon(directions) {
            let mut largest = Millis::ZERO;
            for _ in 0..views {
                let eye = cell.min + cell.extent() * DVec3::from_array(random.units());
                let turned = DVec2::from_angle((random.unit() - 0.5) * sector).rotate(ahead.truncate());
                let time = measure(eye, turned.extend(0.0));
                crate::calibrate::check_time(time)?;
                largest = largest.max(time);
            }
            times.push(largest);
        }
        Ok(Self { times })
    }

    /// The largest time that was seen in the direction of `ahead`.
    pub fn look_up(&self, ahead: DVec3) -> Millis {
        let count = self.times.len();
        let sector = ahead.y.atan2(ahead.x) / TAU * count as f64;
        self.times[sector.round().rem_euclid(count as f64) as usize % count]
    }

    /// The largest time of all directions.
    pub fn largest(&self) -> Millis {
        self.times.iter().copied().fold(Millis::ZERO, Millis::max)
    }
}

/// What any view from `cell` takes at most, from the objects' samples: for each of `directions` around the horizon the sum over objects
/// of their time from where they appear largest; then the largest direction (Wimmer 2007, 2.5.2).
///
/// `lens` gives field of view and range. Differs: the point of largest appearance may lie on an edge of the cell as well.
///
/// # Errors
/// [`TimingError::Samples`] without directions, or for an empty cell.
pub fn view_cell_estimate(
    objects: &[ObjectSamples],
    cell: &DAabb,
    lens: &Camera,
    directions: usize,
) -> Result<Millis, TimingError> {
    if directions == 0 || cell.is_empty() {
        return Err(TimingError::Samples { count: 0, needed: 1 });
    }
    // Views between two directions see a little more on either side.
    let widening = (PI / directions as f64).min(1.5);
    let sum = |ahead: DVec3| -> Millis {
        let of = |o: &ObjectSamples| {
            largest_appearance(cell, &o.sphere, ahead, lens, widening).map(|eye| o.largest_from(eye))
        };
        objects.iter().filter_map(of).sum()
    };
    Ok(horizon(directions).map(sum).fold(Millis::ZERO, Millis::max))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lens() -> Camera {
        let c = Camera::look_at(DVec3::ZERO, DVec3::X, DVec3::Z).unwrap();
        c.with_image(400, 300).unwrap().with_range(0.01, 1e4).unwrap()
    }

    const BALL: Sphere = Sphere { center: DVec3::new(3.0, -2.0, 1.0), radius: 2.0 };

    /// Geometry takes 0.5 ms, pixels 10 ns each, and the object takes more from the north.
    fn law(camera: &Camera) -> Millis {
        let from = (camera.eye() - BALL.center).normalize();
        let north = 1.0 + 0.2 * from.y;
        Millis(0.5f64.max(1e-5 * sphere_pixels(&BALL, camera)) * north)
    }

    fn samples(options: SampleOptions) -> ObjectSamples {
        ObjectSamples::measure(BALL, &lens(), options, law).unwrap()
    }

    #[test]
    fn denser_samples_are_closer_and_pruning_loses_little() {
        let options =
            |sizes, around| SampleOptions { sizes, around, up: around / 2, ..SampleOptions::default() };
        let error = |s: &ObjectSamples| {
            let mut worst: f64 = 0.0;
            for i in 0..200 {
                let t = f64::from(i);
                let eye = BALL.center
                    + DVec3::new((t * 0.7).cos(), (t * 0.7).sin(), 0.5 * (t * 1.1).sin()) * (2.5 + 0.2 * t);
                let c = Camera::look_at(eye, BALL.center, DVec3::Z).unwrap();
                let camera = c.with_projection(lens().projection()).unwrap().with_image(400, 300).unwrap();
                worst = worst.max((s.look_up(&camera).0 / law(&camera).0 - 1.0).abs());
            }
            worst
        };
        let (coarse, fine) = (samples(options(6, 4)), samples(options(24, 16)));
        let (a, b) = (error(&coarse), error(&fine));
        assert!(b < 0.6 * a && b < 0.15, "{a} {b}");
        assert!(fine.pruned() > fine.measured() / 4, "{} {}", fine.pruned(), fine.measured());
        let all = samples(SampleOptions { prune: -1.0, ..options(24, 16) });
        assert!(all.pruned() == 0 && error(&all) > b - 0.03);
    }

    #[test]
    fn an_object_out_of_view_takes_nothing_and_half_in_view_less() {
        let s = samples(SampleOptions::default());
        let look = |target: DVec3| {
            let c = Camera::look_at(BALL.center + DVec3::X * 6.0, target, DVec3::Z).unwrap();
            s.look_up(&c.with_image(400, 300).unwrap())
        };
        let ahead = look(BALL.center);
        let edge = look(BALL.center + DVec3::new(0.0, 4.4, 0.0));
        assert!(edge < ahead && edge > Millis::ZERO, "{edge:?} {ahead:?}");
        assert_eq!(look(BALL.center + DVec3::X * 60.0), Millis::ZERO);
        // From the middle of the object, as long as from its surface.
        let inside = Camera::look_at(BALL.center, BALL.center + DVec3::X, DVec3::Z).unwrap();
        assert!(s.look_up(&inside.with_image(400, 300).unwrap()) >= ahead);
    }

    #[test]
    fn bad_options_and_measurements_are_refused() {
        let none = SampleOptions { around: 0, ..SampleOptions::default() };
        assert!(ObjectSamples::measure(BALL, &lens(), none, law).is_err());
        assert!(
            ObjectSamples::measure(BALL, &lens(), SampleOptions::default(), |_| Millis(f64::NAN)).is_err()
        );
        let point = Sphere { radius: 0.0, ..BALL };
        let s = ObjectSamples::measure(point, &lens(), SampleOptions::default(), |_| Millis(1.0)).unwrap();
        assert_eq!(s.look_up(&lens()), Millis::ZERO);
        let cell = DAabb::new(DVec3::ZERO, DVec3::ONE);
        assert!(ViewCellSamples::measure(&cell, 0, 3, 1, |_, _| Millis(1.0)).is_err());
        assert!(view_cell_estimate(&[], &DAabb::EMPTY, &lens(), 4).is_err());
        assert_eq!(view_cell_estimate(&[], &cell, &lens(), 4).unwrap(), Millis::ZERO);
    }

    #[test]
    fn a_cell_remembers_its_largest_views_by_direction() {
        let cell = DAabb::new(DVec3::ZERO, DVec3::ONE);
        let time = |_: DVec3, ahead: DVec3| Millis(2.0 + ahead.x);
        let s = ViewCellSamples::measure(&cell, 8, 20, 3, time).unwrap();
        assert!(s.look_up(DVec3::X).0 > 2.9 && s.look_up(DVec3::NEG_X).0 < 1.2);
        assert!(s.largest() == s.look_up(DVec3::X));
        assert!(s.look_up(DVec3::new(-1.0, -1e-9, 0.0)).0 < 1.2 && s.look_up(DVec3::ZERO).0 > 2.9);
    }
}
