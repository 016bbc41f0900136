//! Distances between surfaces, with bounds that hold.
//!
//! [`hausdorff`] returns an interval that certainly contains the Hausdorff distance, as narrow as asked for.
//! [`deviation`] adds what a maximum does not tell: mean, RMS, percentiles and how much normals differ.
//!
//! The module is the yardstick that other crates' claims are measured with, and shares no code with them: it has its
//! own tree and its own point-triangle distance.

mod deviation;
mod hausdorff;
mod surface;
mod triangle;

pub use deviation::{Deviation, deviation};
pub use hausdorff::{Hausdorff, HausdorffOptions, OneSided, hausdorff, one_sided};
pub use surface::{Nearest, Surface};
pub use triangle::{closest_on_segment, closest_on_triangle};
