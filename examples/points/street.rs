//! A generated scan of a street.

use crate::input::with_bar;
use farsight_geometry::glam::DVec3;
use farsight_points::{BuildOptions, BuildReport, Grid, Input, NonFinite, Positions};
use farsight_raster::scenes::StreetPoints;
use std::error::Error;
use std::path::Path;

/// The generated street, scanned from stations along it.
pub fn street(count: u64) -> StreetPoints {
    let mut street = StreetPoints::default();
    street.count = count;
    street
}

/// Builds `out` from the generated street.
pub fn build_street(count: u64, out: &Path, options: &BuildOptions) -> Result<BuildReport, Box<dyn Error>> {
    let street = street(count);
    let grid = Grid::new(DVec3::splat(0.001), street.offset)?;
    let points = street.points()?.map(|p| (p.position, p.colour));
    let input = Input::from_reader(grid, "", 0, Positions::new(grid, points, NonFinite::Refuse))?;
    Ok(with_bar(input, out, options)?)
}
