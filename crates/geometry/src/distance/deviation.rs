//! Mean, RMS, percentiles and normal deviation between surfaces, by sampling.

use super::surface::Surface;
use crate::accuracy::{ErrorBound, Norm, Unit};
use crate::mesh::{TriangleMesh, triangle_area};
use glam::DVec3;

/// Statistics of the distance from samples of one surface to another. All of kind `Measured`.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Deviation {
    /// Mean distance.
    pub mean: ErrorBound,
    /// Root of the mean squared distance.
    pub rms: ErrorBound,
    /// Largest distance of a sample.
    pub max: ErrorBound,
    /// Mean angle between the normals, in radians; `None` when no sample has a same-facing counterpart.
    pub normal_mean: Option<ErrorBound>,
    /// Largest angle between the normals, in radians.
    pub normal_max: Option<ErrorBound>,
    /// Samples without a counterpart that faces the same way: their normals were not compared.
    pub unmatched: usize,
    /// All distances in ascending order.
    distances: Vec<f64>,
}

impl Deviation {
    /// The distance that a share `q` (0 to 1) of the surface does not exceed.
    pub fn percentile(&self, q: f64) -> f64 {
        let last = self.distances.len().saturating_sub(1);
        self.distances.get((q.clamp(0.0, 1.0) * last as f64).round() as usize).copied().unwrap_or(0.0)
    }

    /// Number of samples.
    pub fn samples(&self) -> usize {
        self.distances.len()
    }
}

/// Measures how far `from` lies from `to` at about `samples` points, spread evenly over the area.
///
/// Normals are compared with the nearest triangle that faces the same way (angle below 90°) within twice the distance
/// to the nearest one plus `sheet` (in the units of the meshes): so the two sides of a thin wall are not compared with each other. `None` when a
/// surface is empty.
///
/// # Accuracy
/// The standard error of the mean falls at least with 1/√samples; maxima are lower bounds of the truth.
pub fn deviation(from: &TriangleMesh, to: &TriangleMesh, samples: usize, sheet: f64) -> Option<Deviation> {
    let surface = Surface::new(to);
    if from.is_empty() || surface.is_empty() {
        return None;
    }
    let normals: Vec<DVec3> = to.corner_iter().map(|c| unit_normal(c.map(|v| v.as_dvec3()))).collect();
    let points = sample_points(from, samples);
    let mut distances = Vec::with_capacity(points.len());
    let (mut angle_sum, mut angle_max, mut angles, mut unmatched) = (0.0, 0.0f64, 0usize, 0usize);
    for (n, p) in points {
        let distance = surface.nearest(p)?.distance;
        distances.push(distance);
        if n == DVec3::ZERO {
            continue;
        }
        let same_side = |t: u32| normals[t as usize].dot(n) > 0.0;
        match surface.nearest_where(p, 2.0 * distance + sheet, same_side) {
            Some(matching) => {
                let angle = angle_between(n, normals[matching.triangle as usize]);
                angle_sum += angle;
                angle_max = angle_max.max(angle);
                angles += 1;
            }
            None => unmatched += 1,
        }
    }
    distances.sort_by(f64::total_cmp);
    let n = distances.len() as f64;
    let mean = distances.iter().sum::<f64>() / n;
    let rms = (distances.iter().map(|d| d * d).sum::<f64>() / n).sqrt();
    let measured = |value, unit, norm| ErrorBound::measured(value, unit).with_norm(norm);
    Some(Deviation {
        mean: measured(mean, Unit::Metres, Norm::Mean),
        rms: measured(rms, Unit::Metres, Norm::Rms),
        max: measured(distances[distances.len() - 1], Unit::Metres, Norm::Max),
        normal_mean: (angles > 0).then(|| measured(angle_sum / angles as f64, Unit::Radians, Norm::Mean)),
        normal_max: (angles > 0).then(|| measured(angle_max, Unit::Radians, Norm::Max)),
        unmatched,
        distances,
    })
}

/// Normals and positions of about `samples` points, at least one, in the order of the triangles.
fn sample_points(mesh: &TriangleMesh, samples: usize) -> Vec<(DVec3, DVec3)> {
    let total = mesh.area();
    let world = |local: [glam::Vec3; 3]| local.map(|v| mesh.origin() + v.as_dvec3());
    let mut points = Vec::with_capacity(samples + 1);
    let mut carried = 0.0;
    for local in mesh.corner_iter() {
        let corners = world(local);
        // Every triangle gets its share of the samples; what is left over is carried to the next.
        carried += if total > 0.0 { triangle_area(local) / total * samples as f64 } else { 1.0 };
        while carried >= 1.0 {
            carried -= 1.0;
            points.push((unit_normal(corners), spread(corners, points.len() as u32)));
        }
    }
    if points.is_empty() {
        let first = world(mesh.corners(0));
        points.push((unit_normal(first), first[0]));
    }
    points
}

/// The point number `serial` of an additive sequence that covers a triangle evenly (Roberts' R₂, folded).
fn spread([a, b, c]: [DVec3; 3], serial: u32) -> DVec3 {
    const PLASTIC: f64 = 1.324_717_957_244_746;
    let (mut v, mut w) =
        ((f64::from(serial) / PLASTIC).fract(), (f64::from(serial) / (PLASTIC * PLASTIC)).fract());
    if v + w > 1.0 {
        (v, w) = (1.0 - v, 1.0 - w);
    }
    a + (b - a) * v + (c - a) * w
}

fn unit_normal([a, b, c]: [DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a).normalize_or_zero()
}

/// Angle between unit vectors, accurate for small angles too (Kahan).
fn angle_between(a: DVec3, b: DVec3) -> f64 {
    2.0 * (a - b).length().atan2((a + b).length())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hard_cases;
    use glam::{Vec3, vec3};

    fn square(z: [f32; 4]) -> TriangleMesh {
        let p = [vec3(0., 0., z[0]), vec3(1., 0., z[1]), vec3(1., 1., z[2]), vec3(0., 1., z[3])];
        TriangleMesh::from_slices(&p, &[0, 1, 2, 0, 2, 3]).unwrap()
    }

    #[test]
    fn a_tilted_square_has_the_statistics_of_a_ramp() {
        // Heights rise from 0 to 0.1 over a large ground: distances are evenly spread over 0..0.1.
        let ground: Vec<Vec3> =
            [(-9., -9.), (9., -9.), (9., 9.), (-9., 9.)].map(|(x, y)| vec3(x, y, 0.)).to_vec();
        let ground = TriangleMesh::from_slices(&ground, &[0, 1, 2, 0, 2, 3]).unwrap();
        let d = deviation(&square([0.0, 0.1, 0.1, 0.0]), &ground, 20_000, 0.0).unwrap();
        assert!((d.mean.value - 0.05).abs() < 1e-4 && (d.rms.value - 0.1 / 3f64.sqrt()).abs() < 1e-4);
        assert!((d.percentile(0.9) - 0.09).abs() < 1e-3 && d.percentile(1.0) <= 0.1 + 1e-9);
        let tilt = 0.1f64.atan();
        assert!((d.normal_mean.unwrap().value - tilt).abs() < 1e-6 && d.unmatched == 0);
        assert_eq!((d.mean.norm, d.mean.kind), (Norm::Mean, crate::accuracy::Kind::Measured));
    }

    #[test]
    fn the_two_sides_of_a_thin_wall_are_not_compared() {
        let front = square([0.0; 4]);
        let back = TriangleMesh::new(
            front.positions().iter().map(|&p| p + Vec3::Z * 1e-3).collect(),
            front.triangles().iter().map(|&[a, b, c]| [a, c, b]).collect(),
        )
        .unwrap();
        let d = deviation(&front, &back, 100, 1.0).unwrap();
        assert_eq!((d.unmatched, d.normal_max), (d.samples(), None));
    }

    #[test]
    fn every_hard_mesh_lies_on_itself() {
        for hard in hard_cases::meshes() {
            let Some(d) = deviation(&hard.mesh, &hard.mesh, 500, 0.0) else {
                assert!(hard.mesh.is_empty());
                continue;
            };
            let b = hard.mesh.world_bounds();
            let size = b.diagonal() + b.center().length();
            // Needles are as thin as 1e-10 of their length, and half of that is what may be missed.
            assert!(d.max.value <= 1e-10 * size, "{} {}", hard.name, d.max);
        }
    }
}
