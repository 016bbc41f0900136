//! Rays that know nothing: a point of the cell's border, and a direction.

use crate::cell::ViewCell;
use farsight_geometry::Ray;
use farsight_geometry::sampling::{Directions, Random, around};
use glam::DVec3;

/// A random ray: a border point uniform by area, a direction around the outward normal there by the given
/// measure. Where the cell has no area, the direction is uniform over the sphere.
pub(crate) fn border_ray(cell: &ViewCell, directions: Directions, random: &mut Random) -> Option<Ray> {
    let [u, v, w, p, q] = random.units();
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

/// A viewpoint from which something may show that does not from elsewhere: a border point uniform by area, or in turn one of
/// an edge or a corner of the cell, since what shows only just does so from there.
pub(crate) fn viewpoint(cell: &ViewCell, random: &mut Random) -> DVec3 {
    match random.below(4) {
        0 => cell.on_rim(random.unit(), 0.0),
        1 => cell.on_rim(random.unit(), random.unit()),
        _ => cell.on_border(random.units()).0,
    }
}
