//! What is drawn into: linear colour, reversed depth, ids.

use crate::RasterError;

/// Longest side of a [`Target`]. Edge functions of triangles within the guard band stay exact up to here.
pub const MAX_SIDE: u32 = 16_384;

/// Pixels are processed in aligned groups of this many; rows are padded to whole groups.
pub(crate) const GROUP: usize = 8;

/// Which buffers a [`Target`] has. A buffer that is off takes no memory and no time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outputs {
    /// Linear red, green, blue, coverage; 16 bytes a pixel.
    pub colour: bool,
    /// Depth; 4 bytes a pixel. Without it every depth test passes.
    pub depth: bool,
    /// Ids; 4 bytes a pixel.
    pub id: bool,
}

impl Outputs {
    /// Everything.
    pub const ALL: Self = Self { colour: true, depth: true, id: true };
    /// Depth only: shadow maps, occluders.
    pub const DEPTH: Self = Self { colour: false, depth: true, id: false };
    /// Depth and ids: what is visible where.
    pub const DEPTH_ID: Self = Self { colour: false, depth: true, id: true };
}

/// An image under construction: colour, depth and id per pixel, rows from the top.
///
/// Depth is reversed: 1 at the near plane, 0 at the far plane (or infinitely far), larger is nearer. Id 0 is "nothing".
#[derive(Clone, Debug)]
pub struct Target {
    width: usize,
    height: usize,
    stride: usize,
    outputs: Outputs,
    pub(crate) colour: Vec<[f32; 4]>,
    pub(crate) depth: Vec<f32>,
    pub(crate) id: Vec<u32>,
}

impl Target {
    /// A cleared target.
    ///
    /// # Errors
    /// [`RasterError::TargetSize`] when a side is zero or exceeds [`MAX_SIDE`].
    pub fn new(width: u32, height: u32, outputs: Outputs) -> Result<Self, RasterError> {
        if !(1..=MAX_SIDE).contains(&width) || !(1..=MAX_SIDE).contains(&height) {
            return Err(RasterError::TargetSize { width, height });
        }
        let (width, height) = (width as usize, height as usize);
        let stride = width.next_multiple_of(GROUP);
        let pixels = |on: bool| if on { stride * height } else { 0 };
        Ok(Self {
            width,
            height,
            stride,
            outputs,
            colour: vec![[0.0; 4]; pixels(outputs.colour)],
            depth: vec![0.0; pixels(outputs.depth)],
            id: vec![0; pixels(outputs.id)],
        })
    }

    /// Sets every pixel to black without coverage, far, nothing.
    pub fn clear(&mut self) {
        self.colour.fill([0.0; 4]);
        self.depth.fill(0.0);
        self.id.fill(0);
    }

    /// Width in pixels.
    pub fn width(&self) -> u32 {
        self.width as u32
    }

    /// Height in pixels.
    pub fn height(&self) -> u32 {
        self.height as u32
    }

    /// Which buffers there are.
    pub fn outputs(&self) -> Outputs {
        self.outputs
    }

    /// Pixels from one row's start to the next; rows are padded.
    pub(crate) fn stride(&self) -> usize {
        self.stride
    }

    /// Linear colour of a pixel, premultiplied by its coverage.
    ///
    /// # Panics
    /// Outside the image, or without a colour buffer.
    pub fn colour(&self, x: u32, y: u32) -> [f32; 4] {
        self.colour[self.index(x, y)]
    }

    /// Overwrites the colour of a pixel.
    ///
    /// # Panics
    /// Outside the image, or without a colour buffer.
    pub fn set_colour(&mut self, x: u32, y: u32, colour: [f32; 4]) {
        let index = self.index(x, y);
        self.colour[index] = colour;
    }

    /// Depth of a pixel.
    ///
    /// # Panics
    /// Outside the image, or without a depth buffer.
    pub fn depth(&self, x: u32, y: u32) -> f32 {
        self.depth[self.index(x, y)]
    }

    /// Id of a pixel.
    ///
    /// # Panics
    /// Outside the image, or without an id buffer.
    pub fn id(&self, x: u32, y: u32) -> u32 {
        self.id[self.index(x, y)]
    }

    fn index(&self, x: u32, y: u32) -> usize {
        let (x, y) = (x as usize, y as usize);
        assert!(x < self.width && y < self.height, "pixel ({x}, {y}) of {} x {}", self.width, self.height);
        y * self.stride + x
    }

    /// Colours row by row.
    pub fn colour_rows(&self) -> impl Iterator<Item = &[[f32; 4]]> {
        self.colour.chunks_exact(self.stride).map(|row| &row[..self.width])
    }

    /// Depths row by row.
    pub fn depth_rows(&self) -> impl Iterator<Item = &[f32]> {
        self.depth.chunks_exact(self.stride).map(|row| &row[..self.width])
    }

    /// Ids row by row.
    pub fn id_rows(&self) -> impl Iterator<Item = &[u32]> {
        self.id.chunks_exact(self.stride).map(|row| &row[..self.width])
    }

    /// All ids, row by row.
    pub fn ids(&self) -> impl Iterator<Item = u32> + '_ {
        self.id_rows().flatten().copied()
    }

    /// The image at `1/factor` of the resolution: colours are averaged in linear light over `factor²` pixels, depth and
    /// id are those of the block's nearest pixel. What does not fill a block at the right and bottom is dropped.
    ///
    /// # Panics
    /// When `factor` is zero or larger than a side.
    #[must_use]
    pub fn downsampled(&self, factor: u32) -> Self {
        let size = |side: usize| (side as u32).checked_div(factor).filter(|&s| s > 0);
        let (width, height) = size(self.width).zip(size(self.height)).expect("factor between 1 and a side");
        let mut small = Self::new(width, height, self.outputs).expect("smaller than a valid target");
        for y in 0..height {
            for x in 0..width {
                self.resolve_block(x, y, factor, &mut small);
            }
        }
        small
    }

    fn resolve_block(&self, x: u32, y: u32, factor: u32, small: &mut Self) {
        let at = small.index(x, y);
        let block =
            (0..factor * factor).map(|i| self.index(x * factor + i % factor, y * factor + i / factor));
        if self.outputs.colour {
            let mut sum = [0.0f32; 4];
            for i in block.clone() {
                (0..4).for_each(|k| sum[k] += self.colour[i][k]);
            }
            small.colour[at] = sum.map(|s| s / (factor * factor) as f32);
        }
        let first = self.index(x * factor, y * factor);
        let nearest = if self.outputs.depth {
            block.fold(first, |best, i| if self.depth[i] > self.depth[best] { i } else { best })
        } else {
            first
        };
        if self.outputs.depth {
            small.depth[at] = self.depth[nearest];
        }
        if self.outputs.id {
            small.id[at] = self.id[nearest];
        }
    }
}
