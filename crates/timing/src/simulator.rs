//! A deterministic graphics card whose law none of the estimators knows.
//!
//! Its frames are made of what Wimmer 2007, 2.4.5, describes: every triangle is limited either by its vertices and setup or by its pixels
//! (a pipeline that holds one triangle at a time), pixels come in tiles, hidden pixels are turned away early, caches are cold at each
//! change of object and warm for an object timed alone, and a system of two moods adds its time.

mod hold;
mod scene;

#[cfg(test)]
mod tests;

pub use hold::{Held, HoldOptions, hold};
pub use scene::{SimLevel, SimObject, SimScene};

use crate::pixels::PixelArea;
use crate::{Faces, Millis, sphere_pixels};
use farsight_geometry::sampling::Random;
use farsight_geometry::{Camera, Sphere};
use glam::{DAffine3, DVec2};

/// What the simulated card takes, in nanoseconds unless said otherwise.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Law {
    /// A vertex that misses the vertex cache.
    pub vertex: f64,
    /// Setting a triangle up.
    pub setup: f64,
    /// Shading a visible pixel.
    pub pixel: f64,
    /// A pixel that the depth test turns away early.
    pub hidden_pixel: f64,
    /// A tile of 8 x 8 pixels that a triangle touches.
    pub tile: f64,
    /// A draw call.
    pub draw: f64,
    /// Bringing a vertex in when the object before was another one.
    pub cold_vertex: f64,
    /// Clearing and presenting a frame.
    pub frame: f64,
    /// Standard unit of the system's noise, relative to a frame.
    pub jitter: f64,
    /// What the system takes in its slower mood, which it is in for a fifth of all frames.
    pub slow_mood: f64,
    /// Resolution of the stopwatch for single objects.
    pub clock: f64,
}

impl Default for Law {
    fn default() -> Self {
        Self {
            vertex: 45.0,
            setup: 20.0,
            pixel: 5.0,
            hidden_pixel: 1.2,
            tile: 14.0,
            draw: 4_000.0,
            cold_vertex: 12.0,
            frame: 600_000.0,
            jitter: 0.006,
            slow_mood: 150_000.0,
            clock: 10_000.0,
        }
    }
}

/// The card.
#[derive(Clone, Debug)]
pub struct Simulator {
    law: Law,
    random: Random,
    slowdown: f64,
}

impl Simulator {
    /// A card; the same seed gives the same noise.
    pub fn new(law: Law, seed: u64) -> Self {
        Self { law, random: Random::new(seed), slowdown: 1.0 }
    }

    /// Makes everything take `factor` times as long from now on: another process, a lower clock.
    pub fn slow_down(&mut self, factor: f64) {
        self.slowdown *= factor;
    }

    /// What a stopwatch says of an object drawn alone, as calibrations measure it: with warm caches and coarse ticks.
    pub fn time_alone(&mut self, object: &SimObject, level: usize, camera: &Camera) -> Millis {
        let work = self.law.work(object, level, camera, 0.0) * self.slowdown;
        let noise = 1.0 + 0.01 * (self.random.unit() - 0.5);
        let ticks = (work * noise / self.law.clock + self.random.unit()).floor();
        Millis(ticks * self.law.clock * 1e-6)
    }

    /// Begins a frame.
    pub fn begin(&mut self, camera: &Camera) -> Frame {
        let slow = if self.random.unit() < 0.2 { self.law.slow_mood } else { 0.0 };
        // A sum of uniform numbers: a smooth peak of unit deviation around zero.
        let smooth: f64 = (0..12).map(|_| self.random.unit() - 0.5).sum();
        let pace = (1.0 + self.law.jitter * smooth).max(0.1) * self.slowdown;
        let work = self.law.frame + slow;
        Frame { law: self.law, camera: *camera, pace, work, layers: [0.0; CELLS] }
    }

    /// Draws the given levels of the given objects and says how long the frame took.
    pub fn time_frame<'a>(
        &mut self,
        drawn: impl IntoIterator<Item = (&'a SimObject, usize)>,
        camera: &Camera,
    ) -> Millis {
        let mut frame = self.begin(camera);
        drawn.into_iter().for_each(|(object, level)| frame.draw(object, level));
        frame.elapsed()
    }
}

impl Law {
    /// Nanoseconds for an object of which a share is hidden.
    fn work(&self, object: &SimObject, level: usize, camera: &Camera, hidden: f64) -> f64 {
        let level = &object.levels[level];
        let pixel = self.pixel + (self.hidden_pixel - self.pixel) * hidden;
        let areas = PixelArea::new(&level.mesh, &DAffine3::IDENTITY, camera, Faces::Both);
        let triangle = |(area, &misses): (f64, &u8)| {
            let geometry = self.setup + self.vertex * f64::from(misses);
            // A triangle touches the tiles that it covers and those along its outline.
            let tiles = if area > 0.0 { 1.0 + area / 64.0 + 0.55 * area.sqrt() } else { 0.0 };
            // One triangle at a time: the faster half of the pipeline waits for the slower one.
            geometry.max(area * pixel + tiles * self.tile)
        };
        self.draw + areas.zip(&level.misses).map(triangle).sum::<f64>()
    }
}

/// Cells of the coarse depth buffer: columns times rows.
const CELLS: usize = COLUMNS * ROWS;
const COLUMNS: usize = 20;
const ROWS: usize = 15;

/// A frame under way.
#[derive(Clone, Debug)]
pub struct Frame {
    law: Law,
    camera: Camera,
    pace: f64,
    work: f64,
    /// Layers of pixels drawn so far in each cell.
    layers: [f64; CELLS],
}

impl Frame {
    /// Draws a level of an object; near ones should come first.
    pub fn draw(&mut self, object: &SimObject, level: usize) {
        let cells = self.cells(&object.sphere);
        let count = cells.clone().count().max(1) as f64;
        // Of what lies behind n layers of random holes, e⁻ⁿ shows.
        let hidden = cells.clone().map(|c| 1.0 - (-self.layers[c]).exp()).sum::<f64>() / count;
        let cold = self.law.cold_vertex * object.levels[level].mesh.positions().len() as f64;
        self.work += self.law.work(object, level, &self.camera, hidden) + cold;
        let cell_px = f64::from(self.camera.width()) * f64::from(self.camera.height()) / CELLS as f64;
        let per_cell = sphere_pixels(&object.sphere, &self.camera) / (cell_px * count);
        cells.for_each(|c| self.layers[c] += 0.5 * per_cell);
    }

    /// Time since the frame began.
    pub fn elapsed(&self) -> Millis {
        Millis(self.work * self.pace * 1e-6)
    }

    /// Cells around a sphere's image.
    fn cells(&self, sphere: &Sphere) -> impl Iterator<Item = usize> + Clone + use<> {
        let size = DVec2::new(f64::from(self.camera.width()), f64::from(self.camera.height()));
        let grid = DVec2::new(COLUMNS as f64, ROWS as f64);
        let (low, high) = match self.camera.project(sphere.center) {
            Some((px, ahead)) if ahead > sphere.radius => {
                let half = DVec2::splat(sphere.radius / ahead * self.camera.pixels_per_unit());
                ((px - half) / size * grid, (px + half) / size * grid)
            }
            _ => (DVec2::ZERO, grid),
        };
        let clamp = |v: f64, n: usize| (v.max(0.0) as usize).min(n - 1);
        let (x, y) =
            (clamp(low.x, COLUMNS)..=clamp(high.x, COLUMNS), clamp(low.y, ROWS)..=clamp(high.y, ROWS));
        y.flat_map(move |row| x.clone().map(move |column| row * COLUMNS + column))
    }
}
