//! Images on disk, and how far two images differ.

use crate::{RasterError, Target};
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

/// sRGB bytes, row by row from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    width: u32,
    height: u32,
    pixels: Vec<[u8; 3]>,
}

impl Image {
    /// Takes pixels row by row.
    ///
    /// # Errors
    /// [`RasterError::ImageSize`] when a side is zero or the number of pixels is not `width · height`.
    pub fn new(width: u32, height: u32, pixels: Vec<[u8; 3]>) -> Result<Self, RasterError> {
        if width == 0 || height == 0 || pixels.len() as u64 != u64::from(width) * u64::from(height) {
            return Err(RasterError::ImageSize { width, height, pixels: pixels.len() });
        }
        Ok(Self { width, height, pixels })
    }

    /// The colours of a target, encoded; values beyond 1 saturate.
    ///
    /// # Panics
    /// Without a colour buffer.
    pub fn from_colour(target: &Target) -> Self {
        assert!(target.outputs().colour, "the target has no colour");
        let encode = |c: &[f32; 4]| [srgb_byte(c[0]), srgb_byte(c[1]), srgb_byte(c[2])];
        let pixels = target.colour_rows().flatten().map(encode).collect();
        Self { width: target.width(), height: target.height(), pixels }
    }

    /// A target's ids as distinguishable colours; nothing is black.
    ///
    /// # Panics
    /// Without an id buffer.
    pub fn from_ids(target: &Target) -> Self {
        assert!(target.outputs().id, "the target has no ids");
        let colour = |id: u32| {
            let h = crate::random::mix(u64::from(id));
            let bytes = [h as u8, (h >> 8) as u8, (h >> 16) as u8];
            if id == 0 { [0; 3] } else { bytes.map(|b| 64 + (b >> 2) * 3) }
        };
        Self { width: target.width(), height: target.height(), pixels: target.ids().map(colour).collect() }
    }

    /// A target's depth as grey: the inverse distance to a power that shows both near and far.
    ///
    /// # Panics
    /// Without a depth buffer.
    pub fn from_depth(target: &Target) -> Self {
        assert!(target.outputs().depth, "the target has no depth");
        let grey = |d: &f32| [(255.0 * d.max(0.0).powf(0.25)).min(255.0) as u8; 3];
        let pixels = target.depth_rows().flatten().map(grey).collect();
        Self { width: target.width(), height: target.height(), pixels }
    }

    /// Width in pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Pixels row by row.
    pub fn pixels(&self) -> &[[u8; 3]] {
        &self.pixels
    }

    /// The file's bytes as PNG.
    ///
    /// # Errors
    /// [`RasterError::Png`] when the encoder refuses.
    pub fn to_png(&self) -> Result<Vec<u8>, RasterError> {
        let mut bytes = Vec::new();
        self.encode(&mut bytes)?;
        Ok(bytes)
    }

    /// Writes a PNG file.
    ///
    /// # Errors
    /// [`RasterError::Io`] when the file cannot be written, [`RasterError::Png`] when the encoder refuses.
    pub fn write_png(&self, path: impl AsRef<Path>) -> Result<(), RasterError> {
        let path = path.as_ref();
        let file =
            File::create(path).map_err(|source| RasterError::Io { path: path.to_path_buf(), source })?;
        self.encode(BufWriter::new(file))
    }

    fn encode(&self, writer: impl std::io::Write) -> Result<(), RasterError> {
        let mut encoder = png::Encoder::new(writer, self.width, self.height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(bytemuck::cast_slice(&self.pixels))?;
        Ok(writer.finish()?)
    }

    /// Compares with an image of the same size.
    ///
    /// # Errors
    /// [`RasterError::SizesDiffer`] when the sizes differ.
    pub fn compare(&self, other: &Self) -> Result<Difference, RasterError> {
        let (a, b) = ([self.width, self.height], [other.width, other.height]);
        if a != b {
            return Err(RasterError::SizesDiffer { a, b });
        }
        let mut difference = Difference { rmse: 0.0, largest: 0, differing: 0, pixels: Vec::new() };
        let mut squares = 0.0;
        for (p, q) in self.pixels.iter().zip(&other.pixels) {
            let d: [u8; 3] = std::array::from_fn(|k| p[k].abs_diff(q[k]));
            squares += d.iter().map(|&v| f64::from(v).powi(2)).sum::<f64>();
            difference.largest = d.into_iter().fold(difference.largest, u8::max);
            difference.differing += u64::from(d != [0; 3]);
            difference.pixels.push(d);
        }
        difference.rmse = (squares / (3 * self.pixels.len()) as f64).sqrt();
        Ok(difference)
    }
}

/// Writes the buffers of a target as OpenEXR: colour as R, G, B, A, depth as Z (reversed, 1 nearest) and ids as I.
///
/// # Errors
/// [`RasterError::Exr`] when the file cannot be written.
#[cfg(feature = "exr")]
pub fn write_exr(target: &Target, path: impl AsRef<Path>) -> Result<(), RasterError> {
    use exr::prelude::{
        AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, WritableImage,
    };
    let outputs = target.outputs();
    let mut channels = Vec::new();
    if outputs.colour {
        for (k, name) in ["R", "G", "B", "A"].into_iter().enumerate() {
            let values = target.colour_rows().flatten().map(|c| c[k]).collect();
            channels.push(AnyChannel::new(name, FlatSamples::F32(values)));
        }
    }
    if outputs.depth {
        let values = target.depth_rows().flatten().copied().collect();
        channels.push(AnyChannel::new("Z", FlatSamples::F32(values)));
    }
    if outputs.id {
        channels.push(AnyChannel::new("I", FlatSamples::U32(target.ids().collect())));
    }
    let size = (target.width() as usize, target.height() as usize);
    let channels = AnyChannels::sort(channels.into_iter().collect());
    let layer = Layer::new(size, LayerAttributes::default(), Encoding::FAST_LOSSLESS, channels);
    Ok(Image::from_layer(layer).write().to_file(path)?)
}

/// How two images differ.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    /// Root of the mean squared difference of a channel, in steps of 1/255.
    pub rmse: f64,
    /// Largest difference of a channel.
    pub largest: u8,
    /// Pixels with any difference.
    pub differing: u64,
    /// Absolute differences per channel, row by row.
    pub pixels: Vec<[u8; 3]>,
}

impl Difference {
    /// The differences multiplied by `gain` as an image of the given size.
    ///
    /// # Errors
    /// [`RasterError::ImageSize`] when the size is not that of the compared images.
    pub fn to_image(&self, width: u32, height: u32, gain: u8) -> Result<Image, RasterError> {
        Image::new(width, height, self.pixels.iter().map(|p| p.map(|v| v.saturating_mul(gain))).collect())
    }
}

/// sRGB transfer function (IEC 61966-2-1) of a linear value, as a byte.
pub fn srgb_byte(linear: f32) -> u8 {
    let c = linear.clamp(0.0, 1.0);
    let encoded = if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 };
    (255.0 * encoded + 0.5) as u8
}

/// Linear value of an sRGB byte.
pub fn linear_of(byte: u8) -> f32 {
    let c = f32::from(byte) / 255.0;
    if c <= 0.040_45 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}
