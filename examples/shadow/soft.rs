//! A pillar and a bar under an area light: how much of the light each point of the ground sees, by several methods.

use super::posts::block;
use farsight_geometry::glam::{DVec2, DVec3, Vec3, dvec3};
use farsight_geometry::ray::Bvh8;
use farsight_geometry::scene::Light;
use farsight_geometry::{Ray, RayCaster, TriangleMesh};
use farsight_raster::irradiance_from;
use farsight_shadow::penumbra::coverage::disk_behind_edge;
use farsight_shadow::penumbra::quads::{EdgeList, Penumbra, Shape, Wedge};
use farsight_shadow::penumbra::width;

/// Points of the ground along a side of the picture.
pub struct Soft {
    pub side: u32,
    light: Light,
    caster: Bvh8,
    edges: EdgeList,
    wedges: Vec<Wedge>,
}

const RADIUS: f64 = 0.5;
const HEIGHT: f64 = 6.0;

impl Soft {
    pub fn new(side: u32) -> Self {
        let light = Light::Disk {
            center: dvec3(-1.5, -1.0, HEIGHT),
            normal: dvec3(0.2, 0.15, -1.0).normalize(),
            radius: RADIUS,
            radiance: Vec3::ONE,
        };
        let blocks = [
            block(dvec3(-0.3, -0.3, 0.0), dvec3(0.3, 0.3, 2.0)),
            block(dvec3(-1.6, 1.0, 1.0), dvec3(1.2, 1.25, 1.2)),
        ];
        let mesh = joined(&blocks);
        let shape = Shape::of_light(&light).expect("an area light");
        let wedge = |e| match Penumbra::new(&e, &shape) {
            Some(Penumbra::Wedge(w)) => Some(w),
            _ => None,
        };
        let edges = EdgeList::new(&mesh);
        let wedges = edges.silhouette(&shape).filter_map(wedge).collect();
        Self { side, light, caster: Bvh8::new(&mesh), edges, wedges }
    }

    /// The ground point of a pixel.
    fn point(&self, i: u32) -> DVec3 {
        let at = |k: u32| (f64::from(k) + 0.5) / f64::from(self.side);
        dvec3(at(i % self.side) * 4.0 - 1.6, 3.2 - at(i / self.side) * 4.0, 0.0)
    }

    fn each(&self, visible: impl FnMut(DVec3) -> f64) -> Vec<f64> {
        (0..self.side * self.side).map(|i| self.point(i)).map(visible).collect()
    }

    /// `n`² rays to the light from each point.
    pub fn sampled(&self, n: u32) -> Vec<f64> {
        let mut seed = 0;
        self.each(|p| {
            seed += 1;
            irradiance_from(&self.light, &self.caster, p, DVec3::Z, 1e-6, n, seed).visible
        })
    }

    fn sees_center(&self, p: DVec3) -> bool {
        let to = Shape::of_light(&self.light).map_or(DVec3::Z, |s| s.center()) - p;
        Ray::new(p, to).is_some_and(|r| !self.caster.occluded(&r.with_range(1e-6, to.length())))
    }

    /// One ray to the light's centre: a hard shadow.
    pub fn hard(&self) -> Vec<f64> {
        self.each(|p| f64::from(u8::from(self.sees_center(p))))
    }

    /// What the occluders' outlines, seen from each point, hide of the disk: no rays. Exact but where outlines overlap.
    pub fn outlines(&self) -> Vec<f64> {
        let Light::Disk { center, normal, radius, .. } = self.light else {
            unreachable!("the light is a disk")
        };
        let (u, v) = normal.any_orthonormal_pair();
        self.each(|p| {
            // Behind no wedge, all edges are off the light; the hard shadow says which side.
            if !self.wedges.iter().any(|w| w.contains(p)) {
                return f64::from(u8::from(self.sees_center(p)));
            }
            let depth = (center - p).dot(normal);
            // Corners level with the point are lifted a little: their image lies far off the light, but not at infinity.
            let project = |e: DVec3| {
                let share = (e - p).dot(normal) / depth;
                let e = if share < 1e-3 { e + normal * ((1e-3 - share) * depth) } else { e };
                let q = p + (e - p) * (depth / (e - p).dot(normal)) - center;
                DVec2::new(u.dot(q), v.dot(q)) / radius
            };
            let from_here = Shape::Sphere { center: p, radius: 0.0 };
            let hidden: f64 = self
                .edges
                .silhouette(&from_here)
                .filter(|e| e.from_center)
                .map(|e| {
                    let [a, b] = e.ends.map(project);
                    disk_behind_edge(a, b) * (b - a).perp_dot(project(e.beside) - a).signum()
                })
                .sum();
            (1.0 - hidden).clamp(0.0, 1.0)
        })
    }

    /// The hard shadow blurred by the width that a caster 1 m above the ground would have: percentage-closer filtering with one width for all.
    pub fn blurred(&self) -> Vec<f64> {
        let hard = self.hard();
        let reach = 0.5 * width::planar(2.0 * RADIUS, 1.0, HEIGHT - 1.0) / 4.0 * f64::from(self.side);
        let n = reach.ceil() as i64;
        let side = i64::from(self.side);
        let at = |i: i64| {
            let (x, y) = (i % side, i / side);
            let (mut sum, mut count) = (0.0, 0.0);
            for dy in -n..=n {
                for dx in -n..=n {
                    let (px, py) = (x + dx, y + dy);
                    let inside = px >= 0 && py >= 0 && px < side && py < side;
                    if inside && ((dx * dx + dy * dy) as f64) <= reach * reach {
                        sum += hard[(py * side + px) as usize];
                        count += 1.0;
                    }
                }
            }
            sum / f64::max(count, 1.0)
        };
        (0..side * side).map(at).collect()
    }
}

/// Root of the mean squared difference.
pub fn rms(a: &[f64], b: &[f64]) -> f64 {
    (a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum::<f64>() / a.len() as f64).sqrt()
}

fn joined(parts: &[TriangleMesh]) -> TriangleMesh {
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for part in parts {
        let base = positions.len() as u32;
        positions.extend_from_slice(part.positions());
        triangles.extend(part.triangles().iter().map(|t| t.map(|i| i + base)));
    }
    TriangleMesh::new(positions, triangles).expect("the parts are valid")
}
