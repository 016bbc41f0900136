//! Where points come from.
//!
//! All parts of an input share one integer grid. Integer coordinates come out of a build exactly as they went in.

mod cloud;
#[cfg(feature = "las")]
mod las;
mod positions;

#[cfg(feature = "las")]
pub use las::LasOptions;
pub use positions::{NonFinite, Positions};

use crate::layout::{Colour, Layout};
use crate::{Grid, Point, PointsError};
use farsight_geometry::accuracy::{ErrorBound, Unit};
use std::path::PathBuf;

/// Points on their way in, and their attributes.
#[derive(Clone, Debug, Default)]
pub struct Batch {
    /// Positions and colours.
    pub points: Vec<Point>,
    /// As many attribute bytes per point as the input was declared with.
    pub attributes: Vec<u8>,
}

impl Batch {
    /// Empties the batch.
    pub fn clear(&mut self) {
        self.points.clear();
        self.attributes.clear();
    }
}

/// A source that is read once, batch by batch.
///
/// ```
/// use farsight_points::{Batch, Point, PointReader, PointsError};
///
/// /// A diagonal row of points.
/// struct Row(i32);
///
/// impl PointReader for Row {
///     fn read(&mut self, batch: &mut Batch) -> Result<bool, PointsError> {
///         let end = (self.0 + 1000).min(5000);
///         batch.points.extend((self.0..end).map(|i| Point::new([i; 3], [200, 90, 30])));
///         self.0 = end;
///         Ok(self.0 < 5000)
///     }
/// }
/// ```
pub trait PointReader {
    /// Adds the next points to an empty batch, some 10,000 to 1,000,000 at a time; says whether there may be more.
    ///
    /// # Errors
    /// Whatever went wrong; it ends the build.
    fn read(&mut self, batch: &mut Batch) -> Result<bool, PointsError>;
}

impl<F: FnMut(&mut Batch) -> Result<bool, PointsError>> PointReader for F {
    fn read(&mut self, batch: &mut Batch) -> Result<bool, PointsError> {
        self(batch)
    }
}

/// Points to build from: files, arrays, readers.
///
/// ```
/// use farsight_points::{Grid, Input, Point, glam::DVec3};
///
/// let points = [Point::new([1, 2, 3], [255, 0, 0]), Point::new([4, 5, 6], [0, 255, 0])];
/// let input = Input::from_points(Grid::new(DVec3::splat(0.001), DVec3::ZERO)?, &points);
/// assert_eq!(input.grid().world(points[0].position), DVec3::new(0.001, 0.002, 0.003));
/// # Ok::<(), farsight_points::PointsError>(())
/// ```
pub struct Input<'a> {
    grid: Grid,
    attributes: String,
    rounding: f64,
    pub(crate) parts: Vec<Part<'a>>,
}

/// Most bytes of what the attributes are called: their number is a byte in the file.
pub(crate) const LONGEST_NAME: usize = u8::MAX as usize;

/// One file, array or reader.
pub(crate) struct Part<'a> {
    /// For messages.
    pub name: PathBuf,
    pub source: Source<'a>,
    pub layout: Layout,
    /// Points in it; unknown for a reader.
    pub count: u64,
    /// What to add to its integers.
    pub shift: [i64; 3],
    /// A box that may or may not be right, in integers of the part.
    pub guess: Option<([i32; 3], [i32; 3])>,
}

// Only LAS files come in some of these ways.
#[cfg_attr(not(feature = "las"), allow(dead_code))]
pub(crate) enum Source<'a> {
    Bytes(&'a [u8]),
    File { path: PathBuf, offset: u64 },
    Reader(Box<dyn PointReader + 'a>),
    Raw(Box<dyn RawReader + 'a>),
}

/// As [`PointReader`], for records in the part's layout.
pub(crate) trait RawReader {
    fn read(&mut self, bytes: &mut Vec<u8>) -> Result<bool, PointsError>;
}

impl std::fmt::Debug for Input<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let names: Vec<_> = self.parts.iter().map(|p| (&p.name, p.count)).collect();
        f.debug_struct("Input").field("grid", &self.grid).field("parts", &names).finish_non_exhaustive()
    }
}

impl<'a> Input<'a> {
    /// Points in memory.
    pub fn from_points(grid: Grid, points: &'a [Point]) -> Self {
        let part = Part {
            name: "points".into(),
            source: Source::Bytes(bytemuck::cast_slice(points)),
            layout: Layout::staged(0),
            count: points.len() as u64,
            shift: [0; 3],
            guess: None,
        };
        Self::of_part(grid, String::new(), part)
    }

    /// Points that are read once. They are kept in memory or, beyond the memory limit, on disk while their box is not
    /// known.
    ///
    /// `attributes` names what the attribute bytes mean, in up to 255 bytes; it is stored as it is.
    ///
    /// # Errors
    /// [`PointsError::Attributes`] for more than 64 bytes a point, [`PointsError::Option`] for a longer name.
    pub fn from_reader(
        grid: Grid,
        attributes: &str,
        attribute_bytes: usize,
        reader: impl PointReader + 'a,
    ) -> Result<Self, PointsError> {
        let layout = Layout::staged(attribute_bytes);
        layout.check()?;
        if attributes.len() > LONGEST_NAME {
            let (value, range) = (attributes.len() as f64, "a name of 255 bytes at most");
            return Err(PointsError::Option { option: "attributes", value, range });
        }
        let source = Source::Reader(Box::new(reader));
        let part = Part { name: "reader".into(), source, layout, count: 0, shift: [0; 3], guess: None };
        Ok(Self::of_part(grid, attributes.to_owned(), part))
    }

    pub(crate) fn of_part(grid: Grid, attributes: String, part: Part<'a>) -> Self {
        Self { grid, attributes, rounding: 0.0, parts: vec![part] }
    }

    /// The common grid.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// What the attribute bytes mean, as the source named it; empty without attributes.
    pub fn attributes(&self) -> &str {
        &self.attributes
    }

    /// Attribute bytes of a point.
    pub fn attribute_bytes(&self) -> usize {
        self.parts.first().map_or(0, |p| p.layout.attribute_bytes())
    }

    /// Number of points as far as it is known before reading: readers count as none.
    pub fn known_points(&self) -> u64 {
        self.parts.iter().map(|p| p.count).sum()
    }

    /// How far a position may be from the one that was given: zero for integers, rounding to the grid for floating point.
    pub fn rounding(&self) -> ErrorBound {
        ErrorBound::proven(self.rounding, Unit::Metres)
    }

    pub(crate) fn with_rounding(self, rounding: f64) -> Self {
        Self { rounding, ..self }
    }

    /// Adds another input.
    ///
    /// Its grid may be shifted by whole steps; nothing is rounded.
    ///
    /// # Errors
    /// [`PointsError::GridsDiffer`], [`PointsError::AttributesDiffer`].
    pub fn join(mut self, other: Self) -> Result<Self, PointsError> {
        let steps = (other.grid.offset - self.grid.offset) / self.grid.scale;
        // A whole number of steps up to the rounding of the offsets themselves.
        let slack = (self.grid.offset.abs() + other.grid.offset.abs()) / self.grid.scale * f64::EPSILON;
        let whole = (steps - steps.round()).abs().cmple(slack.max(glam::DVec3::splat(1e-9))).all();
        let near = steps.abs().cmplt(glam::DVec3::splat(2f64.powi(33))).all();
        for mut part in other.parts {
            let what = || part.name.display().to_string();
            if other.grid.scale != self.grid.scale || !whole || !near {
                let (scale, offset) = (other.grid.scale.to_array(), other.grid.offset.to_array());
                return Err(PointsError::GridsDiffer { what: what(), scale, offset });
            }
            let (bytes, expected) = (part.layout.attribute_bytes(), self.attribute_bytes());
            if bytes != expected || other.attributes != self.attributes {
                return Err(PointsError::AttributesDiffer { what: what(), bytes, expected });
            }
            (0..3).for_each(|k| part.shift[k] += steps[k].round() as i64);
            self.parts.push(part);
        }
        self.rounding = self.rounding.max(other.rounding);
        Ok(self)
    }
}

impl Part<'_> {
    /// Whether colour channels have 16 bits.
    pub fn wide_colours(&self) -> bool {
        matches!(self.layout.colour, Colour::Words(_))
    }
}
