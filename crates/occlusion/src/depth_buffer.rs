//! A depth buffer in software that errs on one side only: it never hides what would be seen.
//!
//! Depth is that of [`ClipConvention::REVERSED`](farsight_geometry::ClipConvention::REVERSED): z/w, 1 at the near plane, 0 at
//! the far plane or infinitely far, larger is nearer. It is affine in the image for central and parallel projections.

mod bins;
mod clip;
mod occluders;
mod query;
mod raster;
mod vertex;

pub use farsight_geometry::clip::Faces;
pub use occluders::Occluders;
pub use query::{Projected, ScreenBox};

use bins::Bins;
use farsight_geometry::ray::SimdLevel;
use fearless_simd::{Level, dispatch};
use glam::{DMat4, Vec3};
use vertex::Vertex;

/// Longest side of a [`DepthBuffer`]. Coordinates up to here and in the guard band around stay exact.
pub const MAX_SIDE: u32 = 8190;

/// Why a depth buffer was refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DepthBufferError {
    /// A side is zero or too long.
    #[error("a depth buffer of {width} x {height} pixels; sides are 1 to {MAX_SIDE}")]
    Size {
        /// Width.
        width: u32,
        /// Height.
        height: u32,
    },
}

/// Which pixels a triangle of an occluder covers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Coverage {
    /// Those whose centres it covers after snapping its corners to 1/256 px, by the top-left rule: what a renderer
    /// of the same resolution does. Triangles that share an edge leave no gap between them.
    #[default]
    Centres,
    /// Those that it covers wholly, less 1/64 px: for other sample positions (MSAA, jitter) and other snapping. Edges
    /// shared by triangles are left open, so finely tessellated occluders lose most of their effect.
    Whole,
    /// As [`Centres`](Self::Centres), with crossings of edges and rows rounded in `f32` and not put right: a pixel whose
    /// centre lies within rounding of an edge may count as covered though it is not. **Not proven**, and only a little faster;
    /// to see what exactness costs.
    Rounded,
}

/// Work since the last [`clear`](DepthBuffer::clear).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct DepthBufferStats {
    /// Triangles given.
    pub triangles: u64,
    /// Of these, clipped at the near plane or the guard band.
    pub clipped: u64,
    /// Of these, rasterised.
    pub drawn: u64,
}

/// A masked, hierarchical depth buffer of one depth for each 8 x 4 pixels, and a second one for a subset of them on the way to
/// covering all.
///
/// # Accuracy
/// At every pixel centre the depth kept is never nearer than that of the true surface there (clamped to the range of its
/// triangle's corners), for any order of drawing; proof in docs/occlusion.md. So nothing that is in front of or beside what
/// was drawn is ever reported as occluded. In the other direction it is loose: of
/// boxes hidden in scattered triangles a good third is found, behind closed surfaces more.
///
/// # Cost
/// 12.5 bytes for each 32 pixels. No allocation after the first frames.
///
/// # References
/// Masked software occlusion culling, Hasselgren, Andersson & Akenine-Möller 2016. Differs: coverage is exact, depth has
/// proven error bounds, larger is nearer.
///
/// ```
/// use farsight_geometry::glam::{DVec3, Vec3};
/// use farsight_geometry::{Camera, ClipConvention, DAabb};
/// use farsight_occlusion::{DepthBuffer, Faces};
///
/// let camera = Camera::look_at(DVec3::ZERO, DVec3::Y, DVec3::Z)?.with_image(320, 180)?;
/// let clip_from_relative = camera.clip_from_relative_f64(ClipConvention::REVERSED, camera.eye());
/// let mut buffer = DepthBuffer::new(320, 180)?;
/// // A wall of 8 m at 10 m.
/// let wall = [[-4.0, -4.0], [4.0, -4.0], [4.0, 4.0], [-4.0, 4.0]].map(|[x, z]| Vec3::new(x, 10.0, z));
/// buffer.draw(&clip_from_relative, &wall, &[[0, 1, 2], [0, 2, 3]], Faces::Both);
///
/// let unit = |y: f64| DAabb::from_points([DVec3::Y * y]).inflated(0.5);
/// assert!(buffer.is_occluded(&clip_from_relative, camera.eye(), &unit(15.0)));
/// assert!(!buffer.is_occluded(&clip_from_relative, camera.eye(), &unit(8.0)));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct DepthBuffer {
    width: u32,
    height: u32,
    level: Level,
    coverage: Coverage,
    bins: Bins,
    vertices: Vec<Vertex>,
    stats: DepthBufferStats,
}

impl DepthBuffer {
    /// An empty buffer: nothing is occluded.
    ///
    /// # Errors
    /// [`DepthBufferError::Size`] when a side is zero or above [`MAX_SIDE`].
    pub fn new(width: u32, height: u32) -> Result<Self, DepthBufferError> {
        if !(1..=MAX_SIDE).contains(&width) || !(1..=MAX_SIDE).contains(&height) {
            return Err(DepthBufferError::Size { width, height });
        }
        let level = level_of(SimdLevel::Detect);
        let bins = Bins::new(width, height);
        let stats = DepthBufferStats::default();
        Ok(Self { width, height, level, coverage: Coverage::Centres, bins, vertices: Vec::new(), stats })
    }

    /// The buffer with another instruction set. Coverage does not depend on it.
    #[must_use]
    pub fn with_simd(self, simd: SimdLevel) -> Self {
        Self { level: level_of(simd), ..self }
    }

    /// The buffer with another rule of which pixels are covered.
    #[must_use]
    pub fn with_coverage(self, coverage: Coverage) -> Self {
        Self { coverage, ..self }
    }

    /// Width in pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Memory of the buffer, in bytes.
    pub fn bytes(&self) -> usize {
        self.bins.bytes() + self.vertices.capacity() * size_of::<Vertex>()
    }

    /// Work since the last clear.
    pub fn stats(&self) -> &DepthBufferStats {
        &self.stats
    }

    /// Removes all occluders.
    pub fn clear(&mut self) {
        self.bins.clear();
        self.stats = DepthBufferStats::default();
    }

    /// Adds opaque triangles as occluders. `clip_from_local` leads into the clip space of
    /// [`ClipConvention::REVERSED`](farsight_geometry::ClipConvention::REVERSED).
    ///
    /// What cannot be drawn with certainty is left out: slivers beyond 10⁶:1, what is behind the near plane.
    ///
    /// # Panics
    /// When an index leads nowhere.
    pub fn draw(
        &mut self,
        clip_from_local: &DMat4,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        faces: Faces,
    ) {
        let level = self.level;
        self.stats.triangles += triangles.len() as u64;
        let this = &mut *self;
        dispatch!(level, simd => {
            vertex::transform(simd, clip_from_local, positions, this.width, this.height, &mut this.vertices);
            match this.coverage {
                Coverage::Rounded => {
                    raster::draw::<_, false>(simd, this, clip_from_local, positions, triangles, faces);
                }
                _ => raster::draw::<_, true>(simd, this, clip_from_local, positions, triangles, faces),
            }
        });
    }

    /// The largest depth that is certainly hidden at a pixel: 0 where nothing is known.
    ///
    /// # Panics
    /// Outside the image.
    pub fn depth(&self, x: u32, y: u32) -> f32 {
        assert!(x < self.width && y < self.height, "pixel ({x}, {y}) of {} x {}", self.width, self.height);
        self.bins.depth(x as usize, y as usize)
    }
}

fn level_of(simd: SimdLevel) -> Level {
    match simd {
        SimdLevel::Baseline => Level::baseline(),
        _ => Level::new(),
    }
}
