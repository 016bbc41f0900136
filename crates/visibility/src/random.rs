//! Rays that know nothing: a point of the cell's border, and a direction.

use crate::cell::ViewCell;
use farsight_geometry::Ray;
use farsight_geometry::sampling::{Directions, Halton, Random, around};
use glam::DVec3;

/// The random ray number `index`: a border point uniform by area, a direction around the outward normal there by the given
/// measure. Where the cell has no area, the direction is uniform over the sphere.
pub(crate) fn border_ray(
    cell: &ViewCell,
    halton: &Halton,
    directions: Directions,
    index: u32,
) -> Option<Ray> {
    let [u, v, w, p, q] = halton.point(index);
    let (origin, normal) = cell.on_border([u, v, w]);
    let direction = match normal {
        Some(normal) => around(normal, directions.sample([p, q])),
        None => Directions::Sphere.sample([p, q]),
    };
    Ray::new(origin, direction)
}

/// An eye anywhere in the cell, looking anywhere: a random pixel of all that could be displayed.
pub(crate) fn view_ray(cell: &ViewCell, random: &mut Random) -> Option<Ray> {
    Ray::new(cell.inside(random.units()), Directions::Sphere.sample(random.units()))
}

/// A border point uniform by area.
pub(crate) fn border_point(cell: &ViewCell, random: &mut Random) -> DVec3 {
    cell.on_border(random.units()).0
}
