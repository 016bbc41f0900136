//! OpenEXR images: depth, shadow maps, any single channel, and linear colour.

use super::ImportError;
use crate::streaming::replace_file;
use ::exr::image::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer};
use ::exr::meta::MetaData;
use ::exr::meta::attribute::{LineOrder, Text};
use ::exr::prelude::{Blocks, Compression, LayerAttributes, ReadChannels, ReadLayers, WritableImage};
use std::io::Cursor;
use std::path::Path;

/// Longest side, in pixels.
const MAX_SIDE: usize = 65_536;
/// Most sample bytes that a byte of the file can stand for: deflate reaches 1032, and no other method more.
const MAX_EXPANSION: usize = 1_100;
/// Sample bytes that any file may have; headers alone are some hundred bytes.
const FLOOR: usize = 1 << 16;

/// A float image: named channels, each row by row from the top.
///
/// ```
/// use farsight_geometry::io::exr::FloatImage;
///
/// let depth = FloatImage::depth(2, 1, vec![1.5, f32::INFINITY])?;
/// let back = FloatImage::from_bytes(&depth.to_bytes()?)?;
/// assert_eq!(back.channel("Z"), Some(&[1.5, f32::INFINITY][..]));
/// # Ok::<(), farsight_geometry::io::ImportError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct FloatImage {
    width: usize,
    height: usize,
    channels: Vec<(String, Vec<f32>)>,
}

impl FloatImage {
    /// An image of the given channels; names are kept in alphabetical order, as the format wants.
    ///
    /// # Errors
    /// When a side is zero or above 65,536, a channel has another size, or a name is empty or doubled.
    pub fn new(
        width: usize,
        height: usize,
        mut channels: Vec<(String, Vec<f32>)>,
    ) -> Result<Self, ImportError> {
        let side = width.max(height);
        if side > MAX_SIDE {
            let (count, limit) = (side as u64, MAX_SIDE as u64);
            return Err(ImportError::Limit { what: "pixels on a side", count, limit });
        }
        if width == 0 || height == 0 || channels.is_empty() {
            return Err(ImportError::syntax(
                "image",
                format!("{width} x {height} in {} channels", channels.len()),
            ));
        }
        for (name, samples) in &channels {
            if samples.len() != width * height {
                let problem = format!("{} samples for {width} x {height}", samples.len());
                return Err(ImportError::syntax(format!("channel '{name}'"), problem));
            }
        }
        channels.sort_by(|a, b| a.0.cmp(&b.0));
        if channels[0].0.is_empty() || channels.windows(2).any(|pair| pair[0].0 == pair[1].0) {
            return Err(ImportError::syntax("image", "channel names must be there and differ"));
        }
        Ok(Self { width, height, channels })
    }

    /// A depth or distance image: one channel, `Z`.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn depth(width: usize, height: usize, samples: Vec<f32>) -> Result<Self, ImportError> {
        Self::new(width, height, vec![("Z".into(), samples)])
    }

    /// A linear colour image: channels `R`, `G`, `B`.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn rgb(width: usize, height: usize, pixels: &[[f32; 3]]) -> Result<Self, ImportError> {
        Self::of_pixels(width, height, ["R", "G", "B"], pixels)
    }

    /// A linear colour image with coverage: channels `R`, `G`, `B`, `A`.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn rgba(width: usize, height: usize, pixels: &[[f32; 4]]) -> Result<Self, ImportError> {
        Self::of_pixels(width, height, ["R", "G", "B", "A"], pixels)
    }

    fn of_pixels<const N: usize>(
        width: usize,
        height: usize,
        names: [&str; N],
        pixels: &[[f32; N]],
    ) -> Result<Self, ImportError> {
        let channel = |(i, name): (usize, &str)| (name.to_owned(), pixels.iter().map(|p| p[i]).collect());
        Self::new(width, height, names.into_iter().enumerate().map(channel).collect())
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Names of the channels, in alphabetical order.
    pub fn channel_names(&self) -> impl Iterator<Item = &str> {
        self.channels.iter().map(|(name, _)| name.as_str())
    }

    /// The samples of a channel, row by row from the top.
    pub fn channel(&self, name: &str) -> Option<&[f32]> {
        self.channels.iter().find(|(n, _)| n == name).map(|(_, samples)| samples.as_slice())
    }

    /// Red, green, blue, alpha of every pixel; alpha is 1 where there is no such channel. `None` without colours.
    pub fn pixels(&self) -> Option<Vec<[f32; 4]>> {
        let (r, g, b) = (self.channel("R")?, self.channel("G")?, self.channel("B")?);
        let a = self.channel("A");
        Some((0..r.len()).map(|i| [r[i], g[i], b[i], a.map_or(1.0, |a| a[i])]).collect())
    }

    /// Encodes 32-bit floats without loss (ZIP, 16 lines a block). Same image, same bytes.
    ///
    /// # Errors
    /// [`ImportError::Syntax`] when the encoder refuses, for instance a channel name that is not ASCII.
    pub fn to_bytes(&self) -> Result<Vec<u8>, ImportError> {
        let mut list = Vec::new();
        for (name, samples) in &self.channels {
            let name = Text::new_or_none(name)
                .ok_or_else(|| ImportError::syntax("image", format!("channel name '{name}'")))?;
            list.push(AnyChannel::new(name, FlatSamples::F32(samples.clone())));
        }
        let encoding = Encoding {
            compression: Compression::ZIP16,
            blocks: Blocks::ScanLines,
            line_order: LineOrder::Increasing,
        };
        let channels = AnyChannels::sort(list.into_iter().collect());
        let layer = Layer::new((self.width, self.height), LayerAttributes::default(), encoding, channels);
        let mut bytes = Cursor::new(Vec::new());
        Image::from_layer(layer).write().non_parallel().to_buffered(&mut bytes).map_err(bad)?;
        Ok(bytes.into_inner())
    }

    /// Decodes the first layer; half and integer samples become `f32`.
    ///
    /// # Errors
    /// [`ImportError`] for damaged files, deep data, subsampled channels, and sizes that the bytes cannot hold.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, ImportError> {
        check_headers(bytes)?;
        let image = ::exr::prelude::read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes()
            .non_parallel()
            .from_buffered(Cursor::new(bytes))
            .map_err(bad)?;
        let layer = image.layer_data;
        let channel = |channel: &AnyChannel<FlatSamples>| -> (String, Vec<f32>) {
            (channel.name.to_string(), channel.sample_data.values_as_f32().collect())
        };
        let channels = layer.channel_data.list.iter().map(channel).collect();
        Self::new(layer.size.width(), layer.size.height(), channels)
    }

    /// Writes a file, under a temporary name first, so that a broken run leaves no broken image.
    ///
    /// # Errors
    /// [`ImportError::Io`], and those of [`to_bytes`](Self::to_bytes).
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), ImportError> {
        Ok(replace_file(path.as_ref(), &self.to_bytes()?)?)
    }

    /// Reads a file.
    ///
    /// # Errors
    /// As [`from_bytes`](Self::from_bytes), and [`ImportError::Io`].
    pub fn load(path: impl AsRef<Path>) -> Result<Self, ImportError> {
        Self::from_bytes(&super::read_file(path.as_ref())?)
    }
}

fn bad(error: ::exr::error::Error) -> ImportError {
    ImportError::syntax("EXR", error.to_string())
}

/// Refuses what the decoder would allocate for without looking at the bytes.
fn check_headers(bytes: &[u8]) -> Result<(), ImportError> {
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(bad)?;
    let limit = bytes.len().saturating_mul(MAX_EXPANSION).saturating_add(FLOOR);
    for header in &meta.headers {
        if header.deep {
            return Err(ImportError::Unsupported { what: "deep data".into() });
        }
        if header.channels.list.iter().any(|c| (c.sampling.x(), c.sampling.y()) != (1, 1)) {
            return Err(ImportError::Unsupported { what: "a subsampled channel".into() });
        }
        let (width, height) = (header.layer_size.x(), header.layer_size.y());
        let side = width.max(height);
        if side > MAX_SIDE {
            let (count, limit) = (side as u64, MAX_SIDE as u64);
            return Err(ImportError::Limit { what: "pixels on a side", count, limit });
        }
        let samples = (width * height).saturating_mul(header.channels.list.len().saturating_mul(4));
        if samples > limit {
            let (count, limit) = (samples as u64, limit as u64);
            return Err(ImportError::Limit { what: "bytes of samples in a file of this size", count, limit });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_survive_bit_for_bit() {
        let samples: Vec<f32> = (0..35).map(|i| (i as f32 * 0.37).exp() * 1e-6).collect();
        let depth = FloatImage::depth(7, 5, samples).unwrap();
        let bytes = depth.to_bytes().unwrap();
        assert_eq!(FloatImage::from_bytes(&bytes).unwrap(), depth);
        assert_eq!(bytes, depth.to_bytes().unwrap());
        let pixels = [[0.5, 2.0, -1.0, 0.25], [1e30, 1e-30, 0.0, 1.0]];
        let colour = FloatImage::rgba(1, 2, &pixels).unwrap();
        assert_eq!(FloatImage::from_bytes(&colour.to_bytes().unwrap()).unwrap().pixels().unwrap(), pixels);
        let rgb = FloatImage::rgb(2, 1, &[[1.0, 2.0, 3.0]; 2]).unwrap();
        assert_eq!(rgb.pixels().unwrap()[1], [1.0, 2.0, 3.0, 1.0]);
        assert!(rgb.channel("Z").is_none() && depth.pixels().is_none());
    }

    #[test]
    fn sizes_that_disagree_are_refused() {
        assert!(FloatImage::depth(0, 1, vec![]).is_err());
        assert!(FloatImage::depth(2, 2, vec![0.0; 3]).is_err());
        let twice = vec![("A".into(), vec![0.0]), ("A".into(), vec![0.0])];
        assert!(FloatImage::new(1, 1, twice).is_err());
    }

    #[test]
    fn files_are_replaced_whole() {
        let path = std::env::temp_dir().join(format!("farsight-exr-{}.exr", std::process::id()));
        let image = FloatImage::depth(3, 1, vec![0.0, 1.0, 2.0]).unwrap();
        image.save(&path).unwrap();
        image.save(&path).unwrap();
        assert_eq!(FloatImage::load(&path).unwrap(), image);
        std::fs::remove_file(&path).unwrap();
        assert!(FloatImage::load(&path).is_err());
        assert!(image.save(std::env::temp_dir().join("no/such/folder/x.exr")).is_err());
    }
}
