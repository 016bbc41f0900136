//! Whether a caster's shadow can meet what is seen: outlines seen from the light, and planes that part the two.

use crate::light::ShadowLight;
use farsight_geometry::{DAabb, Plane};
use glam::{DVec2, DVec3};

/// How light travels, relative to the eye.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Rays {
    /// In one direction.
    Parallel(DVec3),
    /// Away from a point.
    From(DVec3),
}

impl Rays {
    pub fn of(light: &ShadowLight, origin: DVec3) -> Self {
        match *light {
            ShadowLight::Directional { direction } => Self::Parallel(direction),
            ShadowLight::Spot { position, .. } => Self::From(position - origin),
        }
    }

    /// The direction of light at a point.
    fn at(&self, p: DVec3) -> DVec3 {
        match *self {
            Self::Parallel(direction) => direction,
            Self::From(light) => p - light,
        }
    }
}

/// Planes around what is seen.
#[derive(Clone, Debug, Default)]
pub(crate) struct ShadowTest {
    planes: Vec<Plane>,
    bounds: DAabb,
}

impl ShadowTest {
    /// Takes the planes of the view.
    pub fn set_view(&mut self, planes: &[Plane]) {
        self.planes.clear();
        self.planes.extend_from_slice(planes);
    }

    /// Takes the corners of the receivers in view.
    pub fn set_receivers(&mut self, points: &[DVec3]) {
        self.bounds = DAabb::from_points(points.iter().copied());
    }

    /// Whether a plane of the receivers or of the caster's box parts the caster's shadow volume from the receivers.
    ///
    /// `vertices` are those of the caster's part before the light. Never true when the shadow meets a receiver.
    pub fn misses(&self, caster: &DAabb, vertices: &[DVec3], points: &[DVec3], rays: Rays) -> bool {
        if vertices.is_empty() {
            return true;
        }
        let b = &self.bounds;
        let largest = |b: &DAabb| b.min.abs().max(b.max.abs()).max_element();
        let slack = 1e-12 * (largest(b) + largest(caster) + 1.0);
        // Beyond a plane of the receivers, and light leads farther away from it.
        let beyond = |normal: DVec3, offset: f64| {
            vertices.iter().all(|&v| normal.dot(v) + offset < -slack && normal.dot(rays.at(v)) <= 0.0)
        };
        if self.planes.iter().any(|p| beyond(p.normal, p.offset)) {
            return true;
        }
        let axes = [DVec3::X, DVec3::Y, DVec3::Z];
        let of_bounds = |i: usize| beyond(axes[i], -b.min[i]) || beyond(-axes[i], b.max[i]);
        // All receivers on the outer side of a face of the caster from which light leads inwards.
        let behind = |normal: DVec3, at: f64| {
            vertices.iter().all(|&v| normal.dot(rays.at(v)) <= 0.0)
                && points.iter().all(|&p| normal.dot(p) - at > slack)
        };
        let of_caster = |i: usize| behind(axes[i], caster.max[i]) || behind(-axes[i], -caster.min[i]);
        (0..3).any(|i| of_bounds(i) || of_caster(i))
    }
}

/// Buffers of the test.
#[derive(Clone, Debug, Default)]
pub(crate) struct Scratch {
    order: Vec<DVec2>,
    receivers: Vec<DVec2>,
    caster: Vec<DVec2>,
}

impl Scratch {
    /// Takes the points whose hull casters are compared with.
    pub fn set_receivers(&mut self, points: impl Iterator<Item = DVec2>) {
        hull(points, &mut self.order, &mut self.receivers);
    }

    /// Whether the hull of `points` meets that of the receivers. Outlines that touch, within rounding, meet.
    pub fn meets(&mut self, points: impl Iterator<Item = DVec2>) -> bool {
        hull(points, &mut self.order, &mut self.caster);
        if self.caster.is_empty() || self.receivers.is_empty() {
            return false;
        }
        !(separated(&self.receivers, &self.caster) || separated(&self.caster, &self.receivers))
    }
}

/// Whether the normal of an edge of `a` separates the outlines (separating axis theorem). A segment has two edges here, a
/// point none, whose axes are then left to `b`; two points are told apart by neither and count as meeting.
fn separated(a: &[DVec2], b: &[DVec2]) -> bool {
    let largest = a.iter().chain(b).fold(0.0, |m: f64, p| m.max(p.abs().max_element()));
    (0..a.len()).any(|i| {
        let (p, q) = (a[i], a[(i + 1) % a.len()]);
        let edge = q - p;
        // Counter-clockwise: the inside lies to the left. Rounding of the products decides in favour of meeting.
        let slack = 1e-14 * largest * edge.abs().element_sum();
        edge != DVec2::ZERO && b.iter().all(|&v| edge.perp_dot(v - p) < -slack)
    })
}

/// Andrew's monotone chain in rounded arithmetic: an error of rounding moves the outline by no more than itself.
fn hull(points: impl Iterator<Item = DVec2>, order: &mut Vec<DVec2>, out: &mut Vec<DVec2>) {
    order.clear();
    out.clear();
    order.extend(points);
    order.sort_unstable_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    order.dedup();
    if order.len() < 3 {
        out.extend_from_slice(order);
        return;
    }
    let mut chain = |points: &mut dyn Iterator<Item = &DVec2>| {
        let start = out.len();
        for &p in points {
            while out.len() >= start + 2 {
                let (a, b) = (out[out.len() - 2], out[out.len() - 1]);
                if (b - a).perp_dot(p - a) > 0.0 {
                    break;
                }
                out.pop();
            }
            out.push(p);
        }
        out.pop();
    };
    chain(&mut order.iter());
    chain(&mut order.iter().rev());
}

#[cfg(test)]
mod tests {
    use super::*;
    use farsight_geometry::sampling::Random;

    fn meets(a: &[DVec2], b: &[DVec2]) -> bool {
        let mut scratch = Scratch::default();
        scratch.set_receivers(a.iter().copied());
        scratch.meets(b.iter().copied())
    }

    #[test]
    fn triangles_meet_when_a_sampled_point_lies_in_both() {
        let mut random = Random::new(1);
        let (mut apart, mut together) = (0, 0);
        for _ in 0..2000 {
            let mut triangle = || -> [DVec2; 3] {
                let [x, y] = random.units();
                std::array::from_fn(|_| DVec2::new(x, y) * 2.0 + DVec2::from_array(random.units()))
            };
            let (a, b) = (triangle(), triangle());
            let inside = |t: &[DVec2; 3], p: DVec2| {
                let side = |i: usize| (t[(i + 1) % 3] - t[i]).perp_dot(p - t[i]);
                (side(0) > 0.0) == (side(1) > 0.0) && (side(1) > 0.0) == (side(2) > 0.0)
            };
            let common = (0..400).any(|_| {
                let [u, v] = random.units::<2>();
                let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
                inside(&b, a[0] + (a[1] - a[0]) * u + (a[2] - a[0]) * v)
            });
            let answer = meets(&a, &b);
            assert!(answer || !common);
            together += i32::from(common);
            apart += i32::from(!answer);
        }
        assert!(apart > 500 && together > 100, "{apart} {together}");
    }

    #[test]
    fn degenerate_outlines_are_told_apart() {
        let (o, x, y) = (DVec2::ZERO, DVec2::X, DVec2::Y);
        assert!(meets(&[o, x, y], &[DVec2::splat(0.2)]) && !meets(&[o, x, y], &[DVec2::splat(0.6)]));
        assert!(meets(&[o, x + y], &[x, y]) && !meets(&[o, x], &[y, x + y]));
        assert!(meets(&[o, x], &[x, x * 2.0]) && !meets(&[], &[o]) && !meets(&[o], &[]));
    }
}
