//! A planned frame beside the same without a plan.

use crate::frames::FrameReport;
use farsight_raster::{Image, RasterError, Target};

/// Steps of 255 by which a colour may differ before a pixel counts as changed.
const UNSEEN: u8 = 4;
/// Factor on the differences that the page shows.
const GAIN: u8 = 4;

/// What the plan changed and saved.
pub struct Comparison {
    /// Share of pixels with a colour that differs by more than four steps of 255.
    pub changed: f64,
    /// Root of the mean squared difference of a channel, in steps of 255.
    pub rmse: f64,
    /// The frame without a plan.
    pub full: FrameReport,
    /// Four times the difference, as PNG.
    pub difference: Vec<u8>,
}

impl Comparison {
    /// Compares two images of the same size.
    pub fn new(planned: &Target, full: &Target, report: FrameReport) -> Result<Self, RasterError> {
        let (a, b) = (Image::from_colour(planned), Image::from_colour(full));
        let difference = a.compare(&b)?;
        let changed = difference.pixels.iter().filter(|d| d.iter().any(|&c| c > UNSEEN)).count();
        Ok(Self {
            changed: changed as f64 / difference.pixels.len().max(1) as f64,
            rmse: difference.rmse,
            full: report,
            difference: difference.to_image(a.width(), a.height(), GAIN)?.to_png()?,
        })
    }
}
