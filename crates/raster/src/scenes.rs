//! Seeded scene generators and camera paths.
//!
//! World z points up. The same seed and options give the same bytes on every machine: nothing but arithmetic, square
//! roots and (for shapes) sines whose results are rounded to `f32`.

mod builder;
mod canyon;
mod city;
mod cubes;
mod forest;
mod house;
mod models;
mod path;
mod rooms;
mod street_points;
mod terrain;
mod tree;

pub use canyon::StreetCanyon;
pub use city::City;
pub use cubes::Cubes;
pub use forest::Forest;
pub use models::{aeroplane, statue, vertex_normals};
pub use path::Path;
pub use rooms::Rooms;
pub use street_points::{ScanPoint, StreetPoints};
pub use terrain::Terrain;

use crate::RasterError;

/// Refuses an option that is not in its range.
fn check(option: &'static str, value: f64, range: &'static str, ok: bool) -> Result<(), RasterError> {
    if ok { Ok(()) } else { Err(RasterError::Option { option, value, range }) }
}
