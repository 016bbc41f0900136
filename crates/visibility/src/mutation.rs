//! Border mutation: a new viewpoint, and directions just past the edges of what is known.

use crate::border::Outline;
use crate::known::Known;
use crate::random::viewpoint;
use crate::sight::Sight;
use crate::wave::{RAYS_PER_UNIT, Scratch, Space};
use farsight_geometry::RayCaster;
use farsight_geometry::sampling::Random;

/// Rays past one triangle. Four cost a third less than one past each of four triangles, and find as much.
const EACH: usize = 4;

/// Triangles, side by side in the picture, that rays of one viewpoint go past.
const TOGETHER: usize = 8;

/// Farthest past an edge, in radians. As far as gaps are wide: a twentieth of it leaves several times as many false pixels among
/// loose cubes, half of it a third more. Half as much again finds no more, and bundles that wide cost a tenth of the speed on scans.
const FARTHEST: f64 = 0.2;

/// About 2ˣ for x from 0 to 1023: exact for whole numbers, straight between them.
fn power_of_two(x: f64) -> f64 {
    let whole = x as u64;
    f64::from_bits((1023 + whole) << 52) * (1.0 + (x - whole as f64))
}

/// Triangles of a unit.
pub(crate) const TRIANGLES: usize = RAYS_PER_UNIT / EACH;

/// Shoots rays past the edges of [`TRIANGLES`] known triangles, from the given one on.
pub(crate) fn sample<C: RayCaster>(
    space: &Space<C>,
    known: &Known,
    first: usize,
    random: &mut Random,
    scratch: &mut Scratch,
) {
    // All magnitudes alike: neighbours are small and large.
    let low = space.options.epsilon;
    let octaves = (FARTHEST / low).log2();
    let Scratch { aims, corners, hits, out, .. } = scratch;
    corners.clear();
    space.triangles.gather(known.from(first, TRIANGLES), corners);
    for together in corners.chunks(TOGETHER) {
        let origin = viewpoint(space.cell, random);
        aims.clear();
        for corners in together {
            let outline = Outline::new(corners.map(|p| p - origin), space.rounding());
            aims.extend((0..EACH).filter_map(|_| {
                let [along, octave] = random.units();
                let (side, reach) = (random.below(9) as usize, low * power_of_two(octave * octaves));
                outline.point_on(side, along, reach)
            }));
        }
        space.occluders.bundle(space.triangles, origin, aims, hits, |i, triangle| {
            out.see(space, Sight { triangle, origin, direction: aims[i] });
        });
        out.rays += aims.len() as u64;
        for (&direction, hit) in aims.iter().zip(hits.iter()) {
            if let Some(hit) = hit {
                out.see(space, Sight { triangle: space.triangles.of_hit(hit), origin, direction });
            }
        }
    }
}
