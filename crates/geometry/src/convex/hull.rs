//! Convex hulls with exact decisions: incremental in space, monotone chains in the plane.

use super::{ConvexBody, Edge};
use crate::frustum::Plane;
use crate::predicates::{Sign, collinear, orient2d, orient3d};
use glam::{DVec2, DVec3};

/// Indices of the hull's corners, counter-clockwise from the lowest x (then y); no three of them on a line.
///
/// Fewer than three come out when the points lie on a line. Exact, by Andrew's monotone chains (1979).
pub fn hull_2d(points: &[DVec2]) -> Vec<u32> {
    let mut order: Vec<u32> = (0..points.len() as u32).collect();
    let at = |i: u32| points[i as usize];
    order.sort_by(|&a, &b| at(a).x.total_cmp(&at(b).x).then(at(a).y.total_cmp(&at(b).y)));
    order.dedup_by(|a, b| at(*a) == at(*b));
    if order.len() < 3 {
        return order;
    }
    let half = |order: &mut dyn Iterator<Item = u32>| {
        let mut chain: Vec<u32> = Vec::new();
        for i in order {
            while let [.., a, b] = chain[..] {
                if orient2d(at(a), at(b), at(i)) == Sign::Positive {
                    break;
                }
                chain.pop();
            }
            chain.push(i);
        }
        chain.pop();
        chain
    };
    let mut lower = half(&mut order.iter().copied());
    lower.append(&mut half(&mut order.iter().rev().copied()));
    lower
}

pub(super) fn hull(points: &[DVec3]) -> ConvexBody {
    let mut points: Vec<DVec3> =
        points.iter().copied().filter(|p| p.is_finite()).map(|p| p + DVec3::ZERO).collect();
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z)));
    points.dedup();
    match first_simplex(&points) {
        Simplex::Points => ConvexBody { vertices: points, ..ConvexBody::default() },
        Simplex::Line => segment(points[0], points[points.len() - 1]),
        Simplex::Plane([a, b, c]) => polygon(&points, (points[b] - points[a]).cross(points[c] - points[a])),
        Simplex::Space(corners) => polyhedron(&points, corners),
    }
}

/// The first points that span the dimension of the whole set.
enum Simplex {
    Points,
    Line,
    Plane([usize; 3]),
    Space([usize; 4]),
}

fn first_simplex(p: &[DVec3]) -> Simplex {
    if p.len() < 2 {
        return Simplex::Points;
    }
    let Some(c) = (2..p.len()).find(|&i| !collinear(p[0], p[1], p[i])) else { return Simplex::Line };
    let off_plane = |&i: &usize| orient3d(p[0], p[1], p[c], p[i]) != Sign::Zero;
    match (2..p.len()).find(off_plane) {
        None => Simplex::Plane([0, 1, c]),
        // All faces of the simplex look outward when its fourth corner is behind the first three.
        Some(d) if orient3d(p[0], p[1], p[c], p[d]) == Sign::Negative => Simplex::Space([0, 1, c, d]),
        Some(d) => Simplex::Space([1, 0, c, d]),
    }
}

/// Sorted points on a line have the ends of their hull first and last.
fn segment(a: DVec3, b: DVec3) -> ConvexBody {
    let along = (b - a).normalize();
    let planes = vec![Plane::through(a, along), Plane::through(b, -along)];
    let edges = vec![Edge { vertices: [0, 1], faces: [0, 1] }];
    ConvexBody { vertices: vec![a, b], edges, planes, ..ConvexBody::default() }
}

/// Coplanar points, by projecting them along the largest component of their normal.
fn polygon(points: &[DVec3], normal: DVec3) -> ConvexBody {
    let axis = normal.abs().max_position();
    let flat: Vec<DVec2> = points.iter().map(|p| DVec2::new(p[(axis + 1) % 3], p[(axis + 2) % 3])).collect();
    let vertices: Vec<DVec3> = hull_2d(&flat).iter().map(|&i| points[i as usize]).collect();
    let n = vertices.len() as u32;
    let edges = (0..n).map(|i| Edge { vertices: [i, (i + 1) % n], faces: [0, 1] }).collect();
    let normal = normal.normalize();
    let planes = vec![Plane::through(vertices[0], normal), Plane::through(vertices[0], -normal)];
    ConvexBody { vertices, edges, planes, ..ConvexBody::default() }
}

/// Points that span space: a tetrahedron that grows by one point after another.
fn polyhedron(points: &[DVec3], [a, b, c, d]: [usize; 4]) -> ConvexBody {
    // Triangles of the hull so far, corners counter-clockwise from outside.
    let mut faces: Vec<[usize; 3]> = vec![[a, b, c], [a, d, b], [b, d, c], [c, d, a]];
    let sees = |f: &[usize; 3], p: usize| {
        orient3d(points[f[0]], points[f[1]], points[f[2]], points[p]) == Sign::Positive
    };
    let mut horizon: Vec<[usize; 2]> = Vec::new();
    for p in 0..points.len() {
        let (visible, hidden): (Vec<_>, Vec<_>) = faces.iter().partition(|f| sees(f, p));
        if visible.is_empty() {
            continue;
        }
        let edges = |f: &[usize; 3]| [[f[0], f[1]], [f[1], f[2]], [f[2], f[0]]];
        horizon.clear();
        horizon.extend(visible.iter().flat_map(edges));
        // An edge between two visible faces occurs in both directions.
        let border: Vec<[usize; 2]> =
            horizon.iter().copied().filter(|&[s, t]| !horizon.contains(&[t, s])).collect();
        faces = hidden;
        faces.extend(border.into_iter().map(|[s, t]| [s, t, p]));
    }
    merge_coplanar(points, &faces)
}

/// Joins triangles that lie exactly in one plane and drops the edges between them.
fn merge_coplanar(points: &[DVec3], faces: &[[usize; 3]]) -> ConvexBody {
    let plane_of = |f: &[usize; 3]| {
        let [a, b, c] = f.map(|i| points[i]);
        Plane::through(a, -(b - a).cross(c - a).normalize())
    };
    let mut group: Vec<u32> = vec![u32::MAX; faces.len()];
    let mut planes = Vec::new();
    let coplanar = |f: &[usize; 3], g: &[usize; 3]| {
        g.iter().all(|&i| orient3d(points[f[0]], points[f[1]], points[f[2]], points[i]) == Sign::Zero)
    };
    for i in 0..faces.len() {
        if group[i] == u32::MAX {
            (i..faces.len())
                .filter(|&j| coplanar(&faces[i], &faces[j]))
                .for_each(|j| group[j] = planes.len() as u32);
            planes.push(plane_of(&faces[i]));
        }
    }
    corners_and_edges(points, faces, &group, planes)
}

/// Vertices are the points where three or more faces meet; others lie inside a face or an edge.
fn corners_and_edges(
    points: &[DVec3],
    faces: &[[usize; 3]],
    group: &[u32],
    planes: Vec<Plane>,
) -> ConvexBody {
    let mut faces_of: Vec<Vec<u32>> = vec![Vec::new(); points.len()];
    for (f, &g) in faces.iter().zip(group) {
        for &v in f {
            if !faces_of[v].contains(&g) {
                faces_of[v].push(g);
            }
        }
    }
    let corners: Vec<usize> = (0..points.len()).filter(|&v| faces_of[v].len() >= 3).collect();
    let mut edges = Vec::new();
    for (i, &s) in corners.iter().enumerate() {
        for (j, &t) in corners.iter().enumerate().skip(i + 1) {
            // Two corners with two faces in common are the ends of the edge where these meet.
            let mut common = faces_of[s].iter().filter(|g| faces_of[t].contains(g));
            if let (Some(&f), Some(&g)) = (common.next(), common.next()) {
                edges.push(Edge { vertices: [i as u32, j as u32], faces: [f, g] });
            }
        }
    }
    let vertices = corners.iter().map(|&v| points[v]).collect();
    ConvexBody { vertices, edges, planes, ..ConvexBody::default() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::DAabb;
    use glam::dvec3;

    fn random_points(n: usize, mut seed: u64) -> Vec<DVec3> {
        let mut unit = || {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (seed >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..n).map(|_| DVec3::new(unit(), unit(), unit())).collect()
    }

    #[test]
    fn a_grid_has_the_hull_of_its_box() {
        let points: Vec<DVec3> =
            (0..64).map(|i| dvec3((i % 4).into(), (i / 4 % 4).into(), (i / 16).into())).collect();
        let hull = hull(&points);
        assert_eq!((hull.vertices().len(), hull.edges().len(), hull.planes().len()), (8, 12, 6));
        assert!((hull.volume() - 27.0).abs() < 1e-12);
    }

    #[test]
    fn every_point_is_inside_and_every_vertex_is_a_point() {
        for seed in 0..20 {
            let points = random_points(60, seed);
            let hull = hull(&points);
            assert!(points.iter().all(|&p| hull.contains(p, 1e-14)));
            assert!(hull.vertices().iter().all(|v| points.contains(v)));
            assert_eq!(hull.vertices().len() + hull.planes().len(), hull.edges().len() + 2);
        }
    }

    #[test]
    fn degenerate_sets_give_degenerate_bodies() {
        assert!(hull(&[]).is_empty());
        assert_eq!(hull(&[DVec3::ONE, DVec3::ONE]).vertices(), &[DVec3::ONE]);
        let line: Vec<DVec3> = (0..9).map(|i| dvec3(1.0, 2.0, 3.0) * f64::from(i % 5)).collect();
        assert_eq!(hull(&line).vertices(), &[DVec3::ZERO, dvec3(4.0, 8.0, 12.0)]);
        let plane: Vec<DVec3> =
            (0..25).map(|i| dvec3((i % 5).into(), (i / 5).into(), (i % 5 + i / 5).into())).collect();
        let flat = hull(&plane);
        assert_eq!((flat.vertices().len(), flat.edges().len(), flat.volume()), (4, 4, 0.0));
        assert!(hull(&[DVec3::NAN]).is_empty());
    }

    #[test]
    fn a_light_above_a_box_makes_a_tent() {
        let b = ConvexBody::from_box(&DAabb::new(DVec3::ZERO, DVec3::ONE));
        let tent = b.with_point(dvec3(0.5, 2.0, 0.5));
        assert!((tent.volume() - (1.0 + 1.0 / 3.0)).abs() < 1e-12);
        assert_eq!(tent.vertices().len(), 9);
        let swept = b.swept(dvec3(0.0, 3.0, 0.0));
        assert!((swept.volume() - 4.0).abs() < 1e-12 && swept.vertices().len() == 8);
        assert!((b.swept(dvec3(1.0, 1.0, 0.0)).volume() - 3.0).abs() < 1e-12);
    }

    #[test]
    fn hulls_in_the_plane_leave_out_points_on_edges() {
        let points: Vec<DVec2> = (0..16).map(|i| DVec2::new((i % 4).into(), (i / 4).into())).collect();
        let corners: Vec<DVec2> = hull_2d(&points).iter().map(|&i| points[i as usize]).collect();
        assert_eq!(corners, [(0.0, 0.0), (3.0, 0.0), (3.0, 3.0), (0.0, 3.0)].map(DVec2::from));
        assert_eq!(hull_2d(&points[..4]), vec![0, 3]);
    }
}
