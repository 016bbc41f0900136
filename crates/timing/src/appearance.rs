//! Where a view cell sees an object largest.

use farsight_geometry::{Camera, DAabb, Projection, Sphere};
use glam::DVec3;

/// A half-space n·x ≤ d.
#[derive(Clone, Copy)]
struct Half {
    normal: DVec3,
    offset: f64,
}

/// The eye in `cell` from which `sphere` appears largest in a view ahead, or `None` when none sees it.
///
/// Eyes that see the sphere fill a convex body: the cell cut by one half-space per side of the view. The nearest of them to the sphere's
/// centre lies inside, on a face, an edge or a corner of that body; all are tried. `widening` (radians) opens the view on all sides.
pub(crate) fn largest_appearance(
    cell: &DAabb,
    sphere: &Sphere,
    ahead: DVec3,
    lens: &Camera,
    widening: f64,
) -> Option<DVec3> {
    let mut body = Vec::with_capacity(11);
    for (axis, min, max) in [
        (DVec3::X, cell.min.x, cell.max.x),
        (DVec3::Y, cell.min.y, cell.max.y),
        (DVec3::Z, cell.min.z, cell.max.z),
    ] {
        body.push(Half { normal: axis, offset: max });
        body.push(Half { normal: -axis, offset: -min });
    }
    // A sphere is in view of an eye when inward·(centre − eye) ≥ −radius for each side.
    let c = sphere.center;
    for inward in sides(ahead, lens, widening) {
        body.push(Half { normal: inward, offset: inward.dot(c) + sphere.radius });
    }
    nearest(&body, c)
}

/// Inward normals of the sides of a view and of the plane of its eye.
fn sides(ahead: DVec3, lens: &Camera, widening: f64) -> impl Iterator<Item = DVec3> {
    let ahead = ahead.normalize_or(DVec3::X);
    let right = ahead.cross(DVec3::Z).try_normalize().unwrap_or(DVec3::Y);
    let up = right.cross(ahead);
    let half = lens.half_extent();
    let angle = |half: f64| match lens.projection() {
        Projection::Perspective { .. } => (half.atan() + widening).min(std::f64::consts::FRAC_PI_2),
        // A parallel view's sides are where its eye is not; only the plane of the eye bounds.
        Projection::Orthographic { .. } => std::f64::consts::FRAC_PI_2,
    };
    let (x, y) = (angle(half.x), angle(half.y));
    let side = move |axis: DVec3, angle: f64| axis * angle.cos() + ahead * angle.sin();
    // Turned sideways by more than a right angle, the view reaches behind the eye.
    let behind = (x.max(y) + widening > std::f64::consts::FRAC_PI_2).then_some(());
    let plane = if behind.is_some() { None } else { Some(ahead) };
    [side(right, x), side(-right, x), side(up, y), side(-up, y)].into_iter().chain(plane)
}

/// The point of an intersection of half-spaces nearest to `p`: the projection onto some of the planes that is inside of all.
fn nearest(body: &[Half], p: DVec3) -> Option<DVec3> {
    let size = body.iter().fold(1.0f64, |m, h| m.max(h.offset.abs())).max(p.abs().max_element());
    let inside = |x: DVec3| x.is_finite() && body.iter().all(|h| h.normal.dot(x) <= h.offset + 1e-9 * size);
    let mut best: Option<DVec3> = None;
    let mut consider = |x: DVec3| {
        if inside(x) && best.is_none_or(|b| x.distance_squared(p) < b.distance_squared(p)) {
            best = Some(x);
        }
    };
    consider(p);
    for (i, a) in body.iter().enumerate() {
        consider(p + a.normal * (a.offset - a.normal.dot(p)));
        for (j, b) in body[i + 1..].iter().enumerate() {
            let along = a.normal.cross(b.normal);
            if along.length_squared() < 1e-18 {
                continue;
            }
            let on_line = meet(*a, *b, Half { normal: along, offset: along.dot(p) });
            consider(on_line);
            body[i + j + 2..].iter().for_each(|c| consider(meet(*a, *b, *c)));
        }
    }
    best
}

/// The point of three planes; not finite where they have none.
fn meet(a: Half, b: Half, c: Half) -> DVec3 {
    let bc = b.normal.cross(c.normal);
    let sum = bc * a.offset + c.normal.cross(a.normal) * b.offset + a.normal.cross(b.normal) * c.offset;
    sum / a.normal.dot(bc)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_eye_of_the_cell_sees_the_sphere_larger() {
        let lens = Camera::look_at(DVec3::ZERO, DVec3::X, DVec3::Z).unwrap().with_image(400, 300).unwrap();
        let cell = DAabb::new(DVec3::new(-1.0, -2.0, 0.0), DVec3::new(1.0, 3.0, 2.0));
        let half = lens.half_extent();
        let (mut seen, mut unseen) = (0, 0);
        for i in 0..300 {
            let t = f64::from(i);
            let center = DVec3::new((t * 1.7).sin() * 8.0, (t * 2.9).sin() * 8.0, (t * 0.9).sin() * 4.0);
            let sphere = Sphere { center, radius: 0.3 + 0.5 * (t * 3.3).sin().abs() };
            let best = largest_appearance(&cell, &sphere, DVec3::X, &lens, 0.0);
            // Brute force over a grid of eyes, each with its own plain test.
            let mut nearest = f64::INFINITY;
            for k in 0..17 * 17 * 17 {
                let f = DVec3::new(f64::from(k % 17), f64::from(k / 17 % 17), f64::from(k / 289)) / 16.0;
                let eye = cell.min + cell.extent() * f;
                let v = center - eye;
                let beyond = |across: f64, half: f64| {
                    (across.abs() - half * v.x) / (1.0 + half * half).sqrt() > sphere.radius
                };
                if v.x >= -sphere.radius && !beyond(v.y, half.x) && !beyond(v.z, half.y) {
                    nearest = nearest.min(v.length());
                }
            }
            match best {
                Some(eye) => {
                    let distance = eye.distance(center);
                    assert!(distance <= nearest + 1e-6 && cell.inflated(1e-6).contains(eye), "{i}");
                    if nearest.is_finite() {
                        assert!(distance > nearest - 0.5, "{i}: {distance} {nearest}");
                        seen += 1;
                    }
                }
                None => {
                    assert!(nearest.is_infinite(), "{i}");
                    unseen += 1;
                }
            }
        }
        assert!(seen > 50 && unseen > 50, "{seen} {unseen}");
    }
}
