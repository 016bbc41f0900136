//! The region that is looked from.

use crate::VisibilityError;
use farsight_geometry::sampling::on_triangle;
use farsight_geometry::{ConvexBody, DAabb};
use glam::DVec3;

/// A convex region of viewpoints: a polyhedron, or what is left of one that is flat in some directions (a polygon, a
/// segment, a point).
///
/// Every line of sight that leaves the region passes its border, so rays start there. Viewpoints on the border belong to the
/// region, also where they lie on a surface: a surface at distance zero hides what is behind it.
#[derive(Clone, Debug)]
pub struct ViewCell {
    body: ConvexBody,
    bounds: DAabb,
    facets: Vec<Facet>,
    pieces: Vec<Piece>,
    /// Relative rounding that points of the border carry, times the largest coordinate.
    rounding: f64,
}

/// A triangle of the border with its outward normal, and the area of all facets up to and with it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Facet {
    pub(crate) corners: [DVec3; 3],
    normal: DVec3,
    area_until: f64,
}

/// A tetrahedron between the centre and a facet, and the volume of all up to and with it.
#[derive(Clone, Copy, Debug)]
struct Piece {
    corners: [DVec3; 4],
    volume_until: f64,
}

impl ViewCell {
    /// The region that a body covers.
    ///
    /// # Errors
    /// [`VisibilityError::EmptyCell`] when it has no point; [`VisibilityError::CellCoordinate`] when one is beyond 1e24, a
    /// million times the largest that a mesh can have.
    pub fn new(body: ConvexBody) -> Result<Self, VisibilityError> {
        if body.is_empty() {
            return Err(VisibilityError::EmptyCell);
        }
        let in_range = |v: &DVec3| v.abs().max_element() <= MAX_COORDINATE;
        if let Some(&point) = body.vertices().iter().find(|v| !in_range(v)) {
            return Err(VisibilityError::CellCoordinate { point });
        }
        let bounds = body.bounds();
        let facets = facets(&body);
        let pieces = pieces(&body, &facets);
        let largest = bounds.min.abs().max(bounds.max.abs()).max_element();
        Ok(Self { bounds, facets, pieces, rounding: 16.0 * f64::EPSILON * largest, body })
    }

    /// A box; flat boxes give rectangles, segments and points.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn from_box(b: &DAabb) -> Result<Self, VisibilityError> {
        Self::new(ConvexBody::from_box(b))
    }

    /// The hull of points.
    ///
    /// # Errors
    /// As [`new`](Self::new), and [`VisibilityError::CellCoordinate`] for a point that is not finite.
    pub fn hull(points: &[DVec3]) -> Result<Self, VisibilityError> {
        if let Some(&point) = points.iter().find(|p| !p.is_finite()) {
            return Err(VisibilityError::CellCoordinate { point });
        }
        Self::new(ConvexBody::hull(points))
    }

    /// The region as a body.
    pub fn body(&self) -> &ConvexBody {
        &self.body
    }

    /// The box around it.
    pub fn bounds(&self) -> &DAabb {
        &self.bounds
    }

    /// Whether a point lies in the region, up to the rounding that points on its border carry.
    pub fn contains(&self, point: DVec3) -> bool {
        self.body.contains(point, self.rounding)
    }

    pub(crate) fn facets(&self) -> &[Facet] {
        &self.facets
    }

    /// A point of the border, uniform by area, with the outward normal there; without a normal where the region has no area.
    pub(crate) fn on_border(&self, [which, u, v]: [f64; 3]) -> (DVec3, Option<DVec3>) {
        let Some(last) = self.facets.last() else { return (self.on_line(u), None) };
        let wanted = which * last.area_until;
        let at = self.facets.partition_point(|f| f.area_until <= wanted).min(self.facets.len() - 1);
        let facet = &self.facets[at];
        (on_triangle(facet.corners, [u, v]), Some(facet.normal))
    }

    /// A point of an edge of the region, all edges alike; one of its ends with `along` zero. Where there is no edge, the point
    /// that the region is.
    pub(crate) fn on_rim(&self, which: f64, along: f64) -> DVec3 {
        let (vertices, edges) = (self.body.vertices(), self.body.edges());
        // Each edge from both of its ends.
        let at = (which * 2.0 * edges.len() as f64) as usize;
        let Some(edge) = edges.get(at / 2) else { return self.on_line(which) };
        let [from, to] = edge.vertices.map(|v| vertices[v as usize]);
        let [from, to] = if at & 1 == 0 { [from, to] } else { [to, from] };
        from + (to - from) * along
    }

    /// A viewpoint, uniform by volume; by area or length where the region has no volume.
    pub(crate) fn inside(&self, [which, u, v, w]: [f64; 4]) -> DVec3 {
        let Some(last) = self.pieces.last() else { return self.on_border([which, u, v]).0 };
        let wanted = which * last.volume_until;
        let at = self.pieces.partition_point(|p| p.volume_until <= wanted).min(self.pieces.len() - 1);
        let [apex, a, b, c] = self.pieces[at].corners;
        // Planes parallel to the facet at distance s from the apex have an area that grows with s².
        apex + (on_triangle([a, b, c], [u, v]) - apex) * w.cbrt()
    }

    fn on_line(&self, u: f64) -> DVec3 {
        let vertices = self.body.vertices();
        let (first, last) = (vertices[0], vertices[vertices.len() - 1]);
        first + (last - first) * u
    }

    /// Where a line from `target`, outside, through `via` leaves the region again on its side towards `target`: the viewpoint
    /// from which `target` is seen past `via`. `None` when the line misses the region or `via` is not between the two.
    pub(crate) fn viewpoint_past(&self, via: DVec3, target: DVec3) -> Option<DVec3> {
        let direction = via - target;
        let (mut enter, mut leave) = (0.0f64, f64::INFINITY);
        for plane in self.body.planes() {
            let (distance, slope) = (plane.distance(target), plane.normal.dot(direction));
            if slope == 0.0 {
                if distance < -self.rounding {
                    return None;
                }
                continue;
            }
            let t = -distance / slope;
            if slope > 0.0 {
                enter = enter.max(t);
            } else {
                leave = leave.min(t);
            }
        }
        let slack = self.rounding / direction.length().max(f64::MIN_POSITIVE);
        let usable = enter <= leave + slack && enter > 1.0 && enter.is_finite();
        let point = target + direction * enter;
        (usable && self.body.bounds().inflated(self.rounding).contains(point)).then_some(point)
    }
}

/// Largest coordinate of a view cell: products of six stay representable.
const MAX_COORDINATE: f64 = 1e24;

/// Fans of triangles over the faces of a body; none for a segment or a point.
fn facets(body: &ConvexBody) -> Vec<Facet> {
    let mut facets: Vec<Facet> = Vec::new();
    let mut total = 0.0;
    let mut rim: Vec<(f64, DVec3)> = Vec::new();
    for (face, plane) in body.planes().iter().enumerate() {
        let edges = body.edges().iter().filter(|e| e.faces.contains(&(face as u32)));
        let mut corners: Vec<DVec3> =
            edges.flat_map(|e| e.vertices).map(|v| body.vertices()[v as usize]).collect();
        if corners.len() < 3 {
            continue;
        }
        let center = corners.iter().sum::<DVec3>() / corners.len() as f64;
        // Around the outward normal, counter-clockwise from outside.
        let normal = -plane.normal;
        let x = normal.any_orthonormal_vector();
        let y = normal.cross(x);
        rim.clear();
        rim.extend(corners.drain(..).map(|p| (y.dot(p - center).atan2(x.dot(p - center)), p)));
        rim.sort_by(|a, b| a.0.total_cmp(&b.0));
        rim.dedup_by(|a, b| a.1 == b.1);
        for i in 1..rim.len().saturating_sub(1) {
            let corners = [rim[0].1, rim[i].1, rim[i + 1].1];
            let area = 0.5 * (corners[1] - corners[0]).cross(corners[2] - corners[0]).length();
            if area > 0.0 {
                total += area;
                facets.push(Facet { corners, normal, area_until: total });
            }
        }
    }
    facets
}

fn pieces(body: &ConvexBody, facets: &[Facet]) -> Vec<Piece> {
    let vertices = body.vertices();
    let apex = vertices.iter().sum::<DVec3>() / vertices.len() as f64;
    let size = body.bounds().extent();
    // Below this, what looks like a volume is the rounding of a flat region.
    let least = 1e-14 * size.max_element().powi(3);
    let mut total = 0.0;
    let mut pieces = Vec::new();
    for facet in facets {
        let [a, b, c] = facet.corners;
        let volume = (a - apex).cross(b - apex).dot(c - apex).abs() / 6.0;
        if volume > least {
            total += volume;
            pieces.push(Piece { corners: [apex, a, b, c], volume_until: total });
        }
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;
    use farsight_geometry::sampling::Random;
    use glam::dvec3;

    fn box_cell() -> ViewCell {
        ViewCell::from_box(&DAabb::new(dvec3(1.0, 2.0, 3.0), dvec3(3.0, 3.0, 3.5))).unwrap()
    }

    #[test]
    fn border_points_are_uniform_by_area() {
        let cell = box_cell();
        let mut random = Random::new(1);
        let areas = [0.5, 0.5, 1.0, 1.0, 2.0, 2.0];
        let mut counts = [0.0; 6];
        for _ in 0..70_000 {
            let (p, normal) = cell.on_border(random.units());
            let normal = normal.unwrap();
            assert!(cell.contains(p));
            let axis = normal.abs().max_position();
            let side = usize::from(normal[axis] > 0.0);
            let face = if side == 0 { cell.bounds().min } else { cell.bounds().max };
            assert!((p[axis] - face[axis]).abs() < 1e-15 * 8.0);
            counts[2 * axis + side] += 1.0;
        }
        let chi: f64 =
            counts.iter().zip(areas).map(|(c, a): (&f64, f64)| (c - a * 1e4).powi(2) / (a * 1e4)).sum();
        assert!(chi < 30.0, "{counts:?}");
    }

    #[test]
    fn inner_points_are_uniform_by_volume() {
        // A tetrahedron: the mean of uniform points is its centroid, and each corner's quarter-size copy holds 1/64.
        let corners = [DVec3::ZERO, DVec3::X * 4.0, DVec3::Y * 4.0, DVec3::Z * 4.0];
        let cell = ViewCell::hull(&corners).unwrap();
        let mut random = Random::new(2);
        let (mut mean, mut near) = (DVec3::ZERO, 0);
        let n = 64_000;
        for _ in 0..n {
            let p = cell.inside(random.units());
            assert!(cell.contains(p));
            mean += p / f64::from(n);
            near += i32::from(p.element_sum() < 1.0);
        }
        assert!((mean - DVec3::ONE).abs().max_element() < 0.02, "{mean}");
        assert!((near - 1000).abs() < 150, "{near}");
    }

    #[test]
    fn flat_cells_look_both_ways_and_points_have_no_normal() {
        let flat = ViewCell::from_box(&DAabb::new(DVec3::ZERO, dvec3(1.0, 2.0, 0.0))).unwrap();
        let mut random = Random::new(3);
        let ups = (0..1000).filter(|_| flat.on_border(random.units()).1 == Some(DVec3::Z)).count();
        assert!((400..600).contains(&ups));
        assert!(flat.contains(flat.inside(random.units())));
        let line = ViewCell::from_box(&DAabb::new(DVec3::ZERO, DVec3::X)).unwrap();
        let (p, normal) = line.on_border([0.3, 0.5, 0.9]);
        assert!(normal.is_none() && p == DVec3::X * 0.5);
        let point = ViewCell::from_box(&DAabb::new(DVec3::ONE, DVec3::ONE)).unwrap();
        assert_eq!(point.on_border([0.9; 3]), (DVec3::ONE, None));
        assert_eq!(point.inside([0.9; 4]), DVec3::ONE);
    }

    #[test]
    fn empty_and_endless_cells_are_refused() {
        assert!(matches!(ViewCell::from_box(&DAabb::EMPTY), Err(VisibilityError::EmptyCell)));
        assert!(matches!(ViewCell::hull(&[]), Err(VisibilityError::EmptyCell)));
        let nan = [DVec3::ZERO, DVec3::NAN];
        assert!(matches!(ViewCell::hull(&nan), Err(VisibilityError::CellCoordinate { .. })));
        let endless = DAabb::new(DVec3::ZERO, DVec3::splat(1e30));
        assert!(matches!(ViewCell::from_box(&endless), Err(VisibilityError::CellCoordinate { .. })));
    }

    #[test]
    fn viewpoints_past_a_point_lie_on_the_near_side() {
        let cell = ViewCell::from_box(&DAabb::new(DVec3::ZERO, DVec3::ONE)).unwrap();
        let seen = cell.viewpoint_past(dvec3(3.0, 0.5, 0.5), dvec3(5.0, 0.5, 0.5)).unwrap();
        assert!((seen - dvec3(1.0, 0.5, 0.5)).length() < 1e-14);
        assert!(cell.viewpoint_past(dvec3(3.0, 2.5, 0.5), dvec3(5.0, 0.5, 0.5)).is_none(), "misses the cell");
        assert!(
            cell.viewpoint_past(dvec3(-3.0, 0.5, 0.5), dvec3(5.0, 0.5, 0.5)).is_none(),
            "behind the cell"
        );
        let flat = ViewCell::from_box(&DAabb::new(dvec3(1.0, 0.0, 0.0), DVec3::ONE)).unwrap();
        assert!(flat.viewpoint_past(dvec3(3.0, 0.6, 0.5), dvec3(5.0, 0.7, 0.5)).is_some());
    }
}
