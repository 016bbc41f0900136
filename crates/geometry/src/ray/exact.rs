//! The ray–triangle test that decides: Woop's sheared test in `f64`.
//!
//! Every fast path of this module only sorts out what certainly misses; what is left comes here. So all paths (single
//! rays, bundles, any instruction set, any tree) give the same answer, bit for bit.

use glam::DVec3;

/// A ray made ready for the sheared test.
///
/// The shear maps the ray onto the z axis of permuted coordinates. A vertex is mapped in the same way for all its
/// triangles and the edge functions of neighbours are exact negatives of one another, so no ray passes between two
/// triangles that share an edge or a vertex.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sheared {
    /// Axes: two across, then the main one.
    pub(super) axes: [usize; 3],
    /// Origin in permuted axes.
    pub(super) origin: [f64; 3],
    /// x and y per unit of z, and the ray parameter per unit of z.
    pub(super) shear: [f64; 3],
    pub(super) t_min: f64,
    pub(super) t_max: f64,
    pub(super) faces: Faces,
}

/// Which sides of triangles count, by the sign of the area that the ray sees.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Faces {
    /// Times that sign, above zero for what does not count.
    unwanted: f64,
}

impl Faces {
    pub(super) const BOTH: Self = Self { unwanted: 0.0 };
    pub(super) const FRONT: Self = Self { unwanted: -1.0 };

    /// The same sides seen in a mirror.
    pub(super) fn mirrored(self, mirrored: bool) -> Self {
        if mirrored { Self { unwanted: -self.unwanted } } else { self }
    }

    #[inline(always)]
    pub(super) fn unwanted(self) -> f64 {
        self.unwanted
    }

    #[inline(always)]
    fn count(self, det: f64) -> bool {
        det * self.unwanted <= 0.0
    }
}

/// A hit of one triangle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Crossing {
    pub(super) t: f64,
    /// Twice the signed areas opposite the second and third corner, and of the whole triangle; negative for back
    /// faces.
    pub(super) areas: [f64; 3],
}

impl Sheared {
    /// `direction` must have a component that is not zero; its length scales `t`.
    #[inline(always)]
    pub(super) fn new(origin: DVec3, direction: DVec3, t_min: f64, t_max: f64) -> Self {
        let axes = axes(direction);
        let d = each(|i| direction[axes[i]]);
        let shear = [d[0] / d[2], d[1] / d[2], 1.0 / d[2]];
        Self { axes, origin: each(|i| origin[axes[i]]), shear, t_min, t_max, faces: Faces::BOTH }
    }

    /// The same ray for some sides only.
    #[inline(always)]
    pub(super) fn with_faces(self, faces: Faces) -> Self {
        Self { faces, ..self }
    }

    /// Tests a triangle whose corners are given in permuted axes.
    #[inline(always)]
    pub(super) fn cross(&self, corners: [[f32; 3]; 3]) -> Option<Crossing> {
        let [[ax, ay, az], [bx, by, bz], [cx, cy, cz]] = each(|i| self.sheared(corners[i]));
        let (u, v, w) = (cx * by - cy * bx, ax * cy - ay * cx, bx * ay - by * ax);
        // A zero is neither sign: edges and vertices belong to all their triangles.
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let det = sum(u, v, w);
        let t = sum(u * az, v * bz, w * cz) / det * self.shear[2];
        // Also false when det is zero (0/0): the ray lies in the triangle's plane or the triangle has no area.
        (t >= self.t_min && t <= self.t_max && det != 0.0 && self.faces.count(det))
            .then_some(Crossing { t, areas: [v, w, det] })
    }

    #[inline(always)]
    fn sheared(&self, p: [f32; 3]) -> [f64; 3] {
        let z = f64::from(p[2]) - self.origin[2];
        let x = (f64::from(p[0]) - self.origin[0]) - self.shear[0] * z;
        let y = (f64::from(p[1]) - self.origin[1]) - self.shear[1] * z;
        [x, y, z]
    }
}

/// An array by index. Unlike `map` of the standard library it is inlined into code for other instruction sets.
#[inline(always)]
pub(super) fn each<T>(f: impl Fn(usize) -> T) -> [T; 3] {
    [f(0), f(1), f(2)]
}

/// The largest component last, the others before it so that the handedness stays.
#[inline(always)]
pub(super) fn axes(d: DVec3) -> [usize; 3] {
    let a = d.abs();
    let z = if a.x >= a.y && a.x >= a.z {
        0
    } else if a.y >= a.z {
        1
    } else {
        2
    };
    const NEXT: [[usize; 2]; 3] = [[1, 2], [2, 0], [0, 1]];
    let [x, y] = NEXT[z];
    if d[z] < 0.0 { [y, x, z] } else { [x, y, z] }
}

/// A sum that does not depend on the order of its terms, so that coincident triangles tie exactly whatever corner
/// they begin with and whichever way round they go.
#[inline(always)]
pub(super) fn sum(a: f64, b: f64, c: f64) -> f64 {
    let (lo, hi) = (min(a, b), max(a, b));
    let (least, most, middle) = (min(lo, c), max(hi, c), max(lo, min(hi, c)));
    (least + most) + middle
}

// One instruction each; the values are never NaN.
#[inline(always)]
fn min(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

#[inline(always)]
fn max(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRIANGLE: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

    fn cross(ray: &Sheared, corners: [[f32; 3]; 3]) -> Option<Crossing> {
        ray.cross(corners.map(|p| ray.axes.map(|a| p[a])))
    }

    #[test]
    fn distance_side_and_weights_of_a_simple_hit() {
        let down = Sheared::new(DVec3::new(0.25, 0.5, 3.0), DVec3::NEG_Z, 0.0, f64::INFINITY);
        let hit = cross(&down, TRIANGLE).unwrap();
        assert_eq!((hit.t, hit.areas), (3.0, [0.25, 0.5, 1.0]));
        let up = Sheared::new(DVec3::new(0.25, 0.5, -3.0), DVec3::Z * 2.0, 0.0, f64::INFINITY);
        let hit = cross(&up, TRIANGLE).unwrap();
        assert!(hit.t == 1.5 && hit.areas[2] < 0.0);
        assert!(cross(&Sheared { t_max: 1.4, ..up }, TRIANGLE).is_none());
        assert!(cross(&Sheared { t_min: 1.6, ..up }, TRIANGLE).is_none());
    }

    #[test]
    fn degenerate_triangles_and_rays_in_the_plane_miss() {
        let ray = Sheared::new(DVec3::new(-1.0, 0.25, 0.0), DVec3::X, 0.0, f64::INFINITY);
        assert!(cross(&ray, TRIANGLE).is_none());
        let [a, b, _] = TRIANGLE;
        for flat in [[a, a, b], [a, b, b], [a, b, a], [a, a, a]] {
            let through = Sheared::new(DVec3::new(0.5, 0.0, 1.0), DVec3::NEG_Z, 0.0, f64::INFINITY);
            assert!(cross(&through, flat).is_none());
        }
    }

    #[test]
    fn the_order_of_corners_does_not_change_the_distance() {
        let corners = [[0.1, 0.2, 0.3], [0.9, 0.15, 0.41], [0.2, 0.83, -0.37]];
        let d = DVec3::new(0.11, -0.01, -4.89);
        let ray = Sheared::new(DVec3::new(0.3, 0.4, 5.0), d, 0.0, f64::INFINITY);
        let [a, b, c] = corners;
        let t = cross(&ray, corners).unwrap().t;
        for order in [[b, c, a], [c, a, b], [a, c, b], [c, b, a], [b, a, c]] {
            assert_eq!(cross(&ray, order).unwrap().t, t);
        }
    }
}
