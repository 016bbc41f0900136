//! Sums of squared distances to planes, in `f64`.

use glam::DVec3;

/// xᵀAx + 2bᵀx + c: a weighted sum of squared distances from x to planes, with the sum of the weights.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Quadric {
    /// xx, yy, zz, xy, xz, yz.
    a: [f64; 6],
    b: DVec3,
    c: f64,
    pub weight: f64,
}

impl Quadric {
    /// The plane through `point` with the unit `normal`.
    pub(crate) fn plane(normal: DVec3, point: DVec3, weight: f64) -> Self {
        let (n, d) = (normal, -normal.dot(point));
        let w = n * weight;
        Self {
            a: [w.x * n.x, w.y * n.y, w.z * n.z, w.x * n.y, w.x * n.z, w.y * n.z],
            b: w * d,
            c: weight * d * d,
            weight,
        }
    }

    pub(crate) fn add(&mut self, q: &Self) {
        for i in 0..6 {
            self.a[i] += q.a[i];
        }
        self.b += q.b;
        self.c += q.c;
        self.weight += q.weight;
    }

    /// Adds squared distances to a point, without weight: a pull that keeps minima unique.
    pub(crate) fn pull(&mut self, to: DVec3, strength: f64) {
        for i in 0..3 {
            self.a[i] += strength;
        }
        self.b -= to * strength;
        self.c += strength * to.length_squared();
    }

    pub(crate) fn trace(&self) -> f64 {
        self.a[0] + self.a[1] + self.a[2]
    }

    /// The value at `x`; not below zero.
    pub(crate) fn at(&self, x: DVec3) -> f64 {
        let [xx, yy, zz, xy, xz, yz] = self.a;
        let ax = DVec3::new(
            xx * x.x + xy * x.y + xz * x.z,
            xy * x.x + yy * x.y + yz * x.z,
            xz * x.x + yz * x.y + zz * x.z,
        );
        (x.dot(ax) + 2.0 * self.b.dot(x) + self.c).max(0.0)
    }

    /// Where the value is least; `None` when that is not one well-defined point.
    pub(crate) fn minimum(&self) -> Option<DVec3> {
        let [xx, yy, zz, xy, xz, yz] = self.a;
        // Cramer's rule by cofactors of the symmetric matrix.
        let (cx, cy, cz) = (yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy);
        let determinant = xx * cx + xy * cy + xz * cz;
        let scale = self.trace() / 3.0;
        if determinant.is_nan() || determinant <= 1e-9 * scale * scale * scale {
            return None;
        }
        let (dy, dz, ez) = (xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy);
        let r = -self.b / determinant;
        Some(DVec3::new(
            cx * r.x + cy * r.y + cz * r.z,
            cy * r.x + dy * r.y + dz * r.z,
            cz * r.x + dz * r.y + ez * r.z,
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;

    #[test]
    fn three_planes_meet_where_the_value_is_least() {
        let corner = dvec3(0.3, -0.2, 0.1);
        let mut q = Quadric::default();
        for n in [dvec3(1.0, 2.0, 0.5), dvec3(-1.0, 0.3, 0.7), dvec3(0.1, -0.4, 2.0)] {
            q.add(&Quadric::plane(n.normalize(), corner, 2.0));
        }
        assert!(q.minimum().unwrap().distance(corner) < 1e-12 && q.at(corner) < 1e-15);
        assert_eq!(q.weight, 6.0);
        let n = dvec3(1.0, 1.0, 0.0).normalize();
        let one = Quadric::plane(n, corner, 3.0);
        assert!(one.minimum().is_none());
        assert!((one.at(corner + n * 0.5) - 0.75).abs() < 1e-12);
        let mut pulled = one;
        pulled.pull(DVec3::ZERO, 0.1);
        let x = pulled.minimum().unwrap();
        assert!(x.length() < corner.length() && pulled.at(x) <= pulled.at(x + dvec3(1e-3, 0.0, 0.0)));
    }
}
