//! The adaptive hemicubes of Nirenstein and Blake, to compare with: pictures with ids instead of rays.
//!
//! The cell's faces are divided where the pictures at their corners show different things, until they agree or the picture budget is used
//! up. Whatever shows in fewer pixels than a picture has between its samples is missed for good.

use crate::VisibilityError;
use crate::cell::ViewCell;
use crate::pvs::Pvs;
use farsight_geometry::camera::Projection;
use farsight_geometry::{Camera, DAabb};
use glam::DVec3;
use std::collections::{HashMap, VecDeque};

/// Draws a picture of what each pixel shows: a graphics card, or a software renderer.
pub trait ItemBuffer {
    /// Fills `ids`, a number a pixel: zero for nothing, else that of the triangle plus one.
    fn draw(&mut self, camera: &Camera, ids: &mut Vec<u32>);
}

/// How view cells are looked at with pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct NirOptions {
    /// Pixels along a side of each of a cube's six pictures: 2 to 16384.
    pub side: u32,
    /// Triangles by which the corners of a patch may differ before it is divided, as a share of what they see.
    pub threshold: f64,
    /// Most cubes: at least 8, the corners of the cell.
    pub most_cubes: u32,
}

impl Default for NirOptions {
    /// 512 pixels, one in a hundred, 200 cubes.
    fn default() -> Self {
        Self { side: 512, threshold: 0.01, most_cubes: 200 }
    }
}

/// What pictures found.
#[derive(Clone, Debug, PartialEq)]
pub struct NirSet {
    /// Triangles seen.
    pub set: Pvs,
    /// Cubes of six pictures that were drawn.
    pub cubes: u32,
}

/// Samples a box with pictures of cubes at points of its faces. Every cube looks all around.
///
/// # Errors
/// [`VisibilityError::EmptyCell`] for an empty box and [`VisibilityError::Option`] for an option out of its range.
pub fn nir<B: ItemBuffer>(
    cell: &DAabb,
    options: &NirOptions,
    buffer: &mut B,
) -> Result<NirSet, VisibilityError> {
    ViewCell::from_box(cell)?;
    let refuse = |option, value, range| Err(VisibilityError::Option { option, value, range });
    if !(2..=16384).contains(&options.side) {
        return refuse("side", options.side.into(), "2 to 16384");
    }
    if !(options.threshold >= 0.0 && options.threshold <= 1.0) {
        return refuse("threshold", options.threshold, "0 to 1");
    }
    if options.most_cubes < 8 {
        return refuse("most_cubes", options.most_cubes.into(), "at least 8");
    }
    let mut cubes = Cubes { buffer, side: options.side, seen: HashMap::new(), ids: Vec::new() };
    let mut patches: VecDeque<Patch> = (0..3)
        .flat_map(|axis| [0.0, 1.0].map(|side| Patch { axis, side, low: [0.0; 2], high: [1.0; 2] }))
        .collect();
    // Breadth first, so that a small budget is spread over all faces.
    while let Some(patch) = patches.pop_front() {
        let corners = patch.corners(cell);
        let missing = corners.iter().filter(|c| !cubes.seen.contains_key(&key(**c))).count() as u32;
        if cubes.seen.len() as u32 + missing > options.most_cubes {
            break;
        }
        let views = corners.map(|corner| cubes.look(corner).clone());
        let all = views.iter().fold(Pvs::new(), |all, view| all.union(view));
        let common = views.iter().fold(all.clone(), |common, view| common.intersection(view));
        let differ = f64::from(all.len() - common.len());
        let flat = corners[0] == corners[3];
        if differ > options.threshold * f64::from(all.len()) && !flat {
            patches.extend(patch.quarters());
        }
    }
    let set = cubes.seen.values().fold(Pvs::new(), |all, view| all.union(view));
    Ok(NirSet { set, cubes: cubes.seen.len() as u32 })
}

/// A rectangle of a face of the cell, in shares of the face.
#[derive(Clone, Copy, Debug)]
struct Patch {
    axis: usize,
    side: f64,
    low: [f64; 2],
    high: [f64; 2],
}

impl Patch {
    fn corners(&self, cell: &DAabb) -> [DVec3; 4] {
        [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| {
            let ends = [self.low, self.high];
            let mut t = DVec3::ZERO;
            t[self.axis] = self.side;
            t[(self.axis + 1) % 3] = ends[i][0];
            t[(self.axis + 2) % 3] = ends[j][1];
            cell.min * (DVec3::ONE - t) + cell.max * t
        })
    }

    fn quarters(&self) -> [Self; 4] {
        let middle = [0, 1].map(|i| 0.5 * (self.low[i] + self.high[i]));
        [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| {
            let (u, v) = ([self.low[0], middle[0], self.high[0]], [self.low[1], middle[1], self.high[1]]);
            Self { low: [u[i], v[j]], high: [u[i + 1], v[j + 1]], ..*self }
        })
    }
}

fn key(point: DVec3) -> [u64; 3] {
    point.to_array().map(f64::to_bits)
}

/// Cubes that were drawn, by their centres.
struct Cubes<'a, B> {
    buffer: &'a mut B,
    side: u32,
    seen: HashMap<[u64; 3], Pvs>,
    ids: Vec<u32>,
}

impl<B: ItemBuffer> Cubes<'_, B> {
    fn look(&mut self, eye: DVec3) -> &Pvs {
        let Self { buffer, side, seen, ids } = self;
        seen.entry(key(eye)).or_insert_with(|| {
            let mut all = Pvs::new();
            for camera in cube(eye, *side) {
                ids.clear();
                buffer.draw(&camera, ids);
                let shown: Pvs = ids.iter().filter(|&&id| id != 0).map(|id| id - 1).collect();
                all = all.union(&shown);
            }
            all
        })
    }
}

/// Six square views of 90 degrees that show everything around an eye.
pub fn cube(eye: DVec3, side: u32) -> [Camera; 6] {
    [0, 1, 2, 3, 4, 5].map(|face| {
        let axis = [DVec3::X, DVec3::Y, DVec3::Z][face / 2];
        let ahead = if face % 2 == 0 { axis } else { -axis };
        let up = if face / 2 == 2 { DVec3::Y } else { DVec3::Z };
        let projection = Projection::Perspective { fov_y: std::f64::consts::FRAC_PI_2 };
        // Nothing of a cell's eye is refused: it is finite, and the view is neither empty nor vertical.
        let scale = 1.0 + eye.abs().max_element();
        Camera::look_at(eye, eye + ahead * scale, up)
            .and_then(|c| c.with_projection(projection))
            .and_then(|c| c.with_image(side, side))
            .and_then(|c| c.with_range(1e-3, f64::INFINITY))
            .expect("a plain view of a finite eye")
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use farsight_geometry::ray::Bvh8;
    use farsight_geometry::{RayCaster, TriangleMesh};
    use glam::{DVec2, Vec3};

    /// An item buffer by rays.
    struct Rays(Bvh8);

    impl ItemBuffer for Rays {
        fn draw(&mut self, camera: &Camera, ids: &mut Vec<u32>) {
            for y in 0..camera.height() {
                for x in 0..camera.width() {
                    let px = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                    ids.push(self.0.closest(&camera.ray(px)).map_or(0, |h| h.triangle + 1));
                }
            }
        }
    }

    /// Screens behind a wall with a gap: a target behind it shows from one end of the cell only.
    fn scene() -> TriangleMesh {
        let mut p = Vec::new();
        let mut quad = |x: f32, y: [f32; 2]| {
            let [a, b, c, d] =
                [[y[0], -9.0], [y[1], -9.0], [y[1], 9.0], [y[0], 9.0]].map(|[y, z]| Vec3::new(x, y, z));
            p.extend([a, b, c, a, c, d]);
        };
        quad(2.0, [-9.0, -0.5]);
        quad(2.0, [0.5, 9.0]);
        quad(4.0, [2.0, 2.4]);
        quad(4.0, [-16.0, -12.0]);
        let triangles = (0..p.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        TriangleMesh::new(p, triangles).unwrap()
    }

    #[test]
    fn patches_are_divided_where_views_differ_and_budgets_hold() {
        let mesh = scene();
        let cell = DAabb::new(DVec3::new(0.0, -1.0, -0.1), DVec3::new(0.2, 1.0, 0.1));
        let run = |most_cubes: u32, threshold: f64| {
            let options = NirOptions { side: 32, most_cubes, threshold };
            nir(&cell, &options, &mut Rays(Bvh8::new(&mesh))).unwrap()
        };
        // From y = −1 the gap shows y up to 2.1 and more: triangles 4 and 5 are seen; 6 and 7 never.
        let found = run(200, 0.01);
        assert!(found.set.contains(4) || found.set.contains(5), "{:?}", found.set);
        assert!(!found.set.contains(6) && !found.set.contains(7));
        assert!(found.cubes > 8 && found.cubes <= 200);
        assert_eq!(run(200, 1.0).cubes, 8, "the corners are enough");
        assert!(run(20, 0.0).cubes <= 20);
        let point = DAabb::new(DVec3::ZERO, DVec3::ZERO);
        assert_eq!(nir(&point, &NirOptions::default(), &mut Rays(Bvh8::new(&mesh))).unwrap().cubes, 1);
    }

    #[test]
    fn six_views_see_all_directions() {
        let views = cube(DVec3::new(1e6, -3.0, 2.0), 4);
        let sum: DVec3 = views.iter().map(Camera::forward).sum();
        assert!(sum.length() < 1e-9);
        assert!(views.iter().all(|c| c.width() == 4 && (c.half_extent() - DVec2::ONE).length() < 1e-12));
        let mesh = scene();
        let unit = DAabb::new(DVec3::ZERO, DVec3::ONE);
        let default = NirOptions::default();
        for bad in [NirOptions { side: 1, ..default }, NirOptions { most_cubes: 7, ..default }] {
            assert!(nir(&unit, &bad, &mut Rays(Bvh8::new(&mesh))).is_err());
        }
    }
}
