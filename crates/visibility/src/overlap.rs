//! Which triangles touch the view cell: decided exactly.
//!
//! A convex region and a triangle meet when a corner of the triangle lies in the region, when an edge of the triangle meets
//! the region's border, or when an edge of the region meets the triangle. All of it is signs of orientations of given points.

use crate::cell::ViewCell;
use farsight_geometry::predicates::{Sign, collinear, orient2d, orient3d};
use glam::{DVec2, DVec3};

/// Whether the closed triangle and the closed region have a point in common.
///
/// Exact for the coordinates given. Faces of a region that are not quite flat are what their fans of triangles are.
pub(crate) fn touches(cell: &ViewCell, triangle: [DVec3; 3]) -> bool {
    let bounds = cell.bounds();
    let low = triangle[0].min(triangle[1]).min(triangle[2]);
    let high = triangle[0].max(triangle[1]).max(triangle[2]);
    if low.cmpgt(bounds.max).any() || high.cmplt(bounds.min).any() {
        return false;
    }
    let edges = |[a, b, c]: [DVec3; 3]| [[a, b], [b, c], [c, a]];
    if is_solid(cell) && triangle.iter().any(|&p| inside(cell, p)) {
        return true;
    }
    let meets = |[a, b]: [DVec3; 2], t: [DVec3; 3]| segment_meets_triangle(a, b, t);
    if cell.facets().iter().any(|f| edges(triangle).into_iter().any(|e| meets(e, f.corners))) {
        return true;
    }
    let vertices = cell.body().vertices();
    let mut own = cell.body().edges().iter().map(|e| e.vertices.map(|v| vertices[v as usize]));
    own.any(|e| meets(e, triangle)) || (vertices.len() == 1 && meets([vertices[0]; 2], triangle))
}

/// Whether the region has facets that enclose it; flat ones are covered by their facets alone.
fn is_solid(cell: &ViewCell) -> bool {
    let facets = cell.facets();
    facets.first().is_some_and(|f| {
        let [a, b, c] = f.corners;
        cell.body().vertices().iter().any(|&v| orient3d(a, b, c, v) != Sign::Zero)
    })
}

/// In front of no facet.
fn inside(cell: &ViewCell, p: DVec3) -> bool {
    cell.facets().iter().all(|f| {
        let [a, b, c] = f.corners;
        orient3d(a, b, c, p) != Sign::Positive
    })
}

/// Whether a closed segment (or point) meets a closed triangle (or what is left of a degenerate one).
fn segment_meets_triangle(s: DVec3, t: DVec3, [a, b, c]: [DVec3; 3]) -> bool {
    if collinear(a, b, c) {
        return [[a, b], [b, c], [c, a]].into_iter().any(|e| segments_meet([s, t], e));
    }
    let (from, to) = (orient3d(a, b, c, s), orient3d(a, b, c, t));
    match (from, to) {
        (Sign::Zero, Sign::Zero) => coplanar_meet([s, t], [a, b, c]),
        _ if from == to => false,
        _ => {
            // The line passes all edges on the same side, or through one.
            let sides = [[a, b], [b, c], [c, a]].map(|[p, q]| orient3d(s, t, p, q));
            !(sides.contains(&Sign::Positive) && sides.contains(&Sign::Negative))
        }
    }
}

/// A segment in the plane of a triangle with area.
fn coplanar_meet([s, t]: [DVec3; 2], [a, b, c]: [DVec3; 3]) -> bool {
    // Leaving out an axis is exact; one of the three leaves the triangle its area.
    let Some(axis) = (0..3).find(|&axis| {
        let [a, b, c] = [a, b, c].map(|p| flat(p, axis));
        orient2d(a, b, c) != Sign::Zero
    }) else {
        return false;
    };
    let [s2, t2, a2, b2, c2] = [s, t, a, b, c].map(|p| flat(p, axis));
    let edges = [[a2, b2], [b2, c2], [c2, a2]];
    let signs = edges.map(|[p, q]| orient2d(p, q, s2));
    let within = !(signs.contains(&Sign::Positive) && signs.contains(&Sign::Negative));
    within || edges.into_iter().any(|e| flat_segments_meet([s2, t2], e))
}

/// Two closed segments in space, either of which may be a point.
fn segments_meet([s, t]: [DVec3; 2], [p, q]: [DVec3; 2]) -> bool {
    if orient3d(s, t, p, q) != Sign::Zero {
        return false;
    }
    // Coplanar segments meet when they do in the projections along all axes: in the one that keeps their plane apart this is
    // the whole truth, in the others it is necessary.
    (0..3).all(|axis| flat_segments_meet([s, t].map(|x| flat(x, axis)), [p, q].map(|x| flat(x, axis))))
}

fn flat(p: DVec3, axis: usize) -> DVec2 {
    DVec2::new(p[(axis + 1) % 3], p[(axis + 2) % 3])
}

fn flat_segments_meet([s, t]: [DVec2; 2], [p, q]: [DVec2; 2]) -> bool {
    let overlap = (0..2).all(|i| s[i].max(t[i]) >= p[i].min(q[i]) && p[i].max(q[i]) >= s[i].min(t[i]));
    let apart = |a: Sign, b: Sign| a == b && a != Sign::Zero;
    overlap && !apart(orient2d(s, t, p), orient2d(s, t, q)) && !apart(orient2d(p, q, s), orient2d(p, q, t))
}

#[cfg(test)]
mod tests {
    use super::*;
    use farsight_geometry::DAabb;
    use farsight_geometry::sampling::Random;
    use glam::dvec3;

    fn unit() -> ViewCell {
        ViewCell::from_box(&DAabb::new(DVec3::ZERO, DVec3::ONE)).unwrap()
    }

    #[test]
    fn touching_counts_and_one_ulp_off_does_not() {
        let up = |z: f64| [dvec3(-5.0, -5.0, z), dvec3(9.0, -5.0, z), dvec3(0.0, 9.0, z)];
        assert!(touches(&unit(), up(1.0)), "a plane on a face");
        assert!(!touches(&unit(), up(1.0f64.next_up())));
        assert!(touches(&unit(), up(0.5)), "a plane through the middle");
        let corner = |x: f64| [dvec3(x, 1.0, 1.0), dvec3(x + 1.0, 1.0, 1.0), dvec3(x, 2.0, 2.0)];
        assert!(touches(&unit(), corner(1.0)), "a corner on a corner");
        assert!(!touches(&unit(), corner(1.0f64.next_up())));
        let inside = [dvec3(0.4, 0.4, 0.4), dvec3(0.5, 0.4, 0.4), dvec3(0.4, 0.5, 0.45)];
        assert!(touches(&unit(), inside));
        // The plane x + y + z = 3 − 2⁻⁵⁰ cuts the corner off, one further out does not.
        let cut = |s: f64| [dvec3(s, 0.0, 0.0), dvec3(0.0, s, 0.0), dvec3(0.0, 0.0, s)].map(|p| p * 1.0);
        let far = |s: f64| {
            let c = DVec3::splat(s / 3.0);
            cut(s).map(|p| c + (p - c) * 4.0)
        };
        assert!(touches(&unit(), far(2.999)) && !touches(&unit(), far(3.001)));
    }

    #[test]
    fn edges_past_edges_are_told_apart() {
        // Edge against edge: no vertex of either inside the other.
        let near = |s: f64| [dvec3(s, -1.0, 0.5), dvec3(-1.0, s, 0.5), dvec3(5.0, 5.0, 0.5)];
        // The line x + y = s − 1 passes the corner (0, 0) of the box seen from above.
        assert!(touches(&unit(), near(1.0)));
        let beyond = [dvec3(1.5, 3.0, 0.2), dvec3(3.0, 1.5, 0.7), dvec3(3.0, 3.0, 0.5)];
        assert!(!touches(&unit(), beyond));
        let skew = |d: f64| [dvec3(2.0 + d, 0.0, 2.0), dvec3(d, 2.0, 2.0), dvec3(1.0 + d, 1.0, -5.0)];
        assert!(touches(&unit(), skew(0.0)) && !touches(&unit(), skew(1e-15)));
    }

    #[test]
    fn degenerate_triangles_and_cells() {
        let segment = |z: f64| [dvec3(-1.0, 0.5, z), dvec3(2.0, 0.5, z), dvec3(0.5, 0.5, z)];
        assert!(touches(&unit(), segment(1.0)) && !touches(&unit(), segment(1.5)));
        assert!(touches(&unit(), [DVec3::ONE; 3]) && !touches(&unit(), [DVec3::ONE * 1.5; 3]));
        let triangle = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let point = |p: DVec3| ViewCell::from_box(&DAabb::new(p, p)).unwrap();
        assert!(touches(&point(dvec3(0.25, 0.25, 0.0)), triangle));
        assert!(!touches(&point(dvec3(0.25, 0.25, 1e-50)), triangle));
        assert!(!touches(&point(dvec3(0.75, 0.75, 0.0)), triangle));
        assert!(touches(&point(DVec3::ONE), [DVec3::ONE; 3]));
        let flat = ViewCell::from_box(&DAabb::new(dvec3(0.1, 0.1, 0.0), dvec3(0.2, 0.2, 0.0))).unwrap();
        assert!(touches(&flat, triangle), "a flat cell within a triangle");
        assert!(touches(&flat, [dvec3(0.15, 0.15, -1.0), dvec3(0.15, 0.15, 1.0), dvec3(9.0, 9.0, 0.0)]));
        assert!(!touches(&flat, triangle.map(|p| p + DVec3::Z * 1e-12)));
    }

    #[test]
    fn agrees_with_dense_points_of_random_triangles() {
        let cell = ViewCell::hull(&[
            DVec3::ZERO,
            dvec3(2.0, 0.0, 0.3),
            dvec3(0.0, 2.0, 0.1),
            dvec3(0.2, 0.3, 2.0),
            dvec3(1.4, 1.2, 1.0),
        ])
        .unwrap();
        let mut random = Random::new(5);
        let (mut yes, mut unclear) = (0, 0);
        for _ in 0..400 {
            let mut corner = || DVec3::from_array(random.units()) * 4.0 - DVec3::ONE;
            let t = [corner(), corner(), corner()];
            // The deepest of many points of the triangle decides, unless it is close to the border.
            let mut deepest = f64::NEG_INFINITY;
            for i in 0..=150 {
                for j in 0..=150 - i {
                    let (u, v) = (f64::from(i) / 150.0, f64::from(j) / 150.0);
                    let p = t[0] + (t[1] - t[0]) * u + (t[2] - t[0]) * v;
                    let depth =
                        cell.body().planes().iter().map(|q| q.distance(p)).fold(f64::INFINITY, f64::min);
                    deepest = deepest.max(depth);
                }
            }
            if deepest.abs() < 0.04 {
                unclear += 1;
                continue;
            }
            assert_eq!(touches(&cell, t), deepest > 0.0, "{t:?}");
            yes += i32::from(deepest > 0.0);
        }
        assert!(yes > 50 && unclear < 80, "{yes} {unclear}");
    }
}
