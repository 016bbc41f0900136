//! Convex bodies: polyhedra, and what becomes of them when they are cut down to a polygon, a segment, a point or nothing.
//!
//! Degenerate bodies are values, not errors: a frustum that only touches a box leaves a polygon, and code that asks for
//! its extent or its vertices works on that polygon as on any other body.

mod hull;

pub use hull::hull_2d;

use crate::bounds::DAabb;
use crate::camera::{Camera, Projection};
use crate::frustum::{Frustum, Plane};
use glam::{DMat4, DVec3};

/// An edge between two vertices, with the two faces that meet there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Edge {
    /// Its ends, in [`ConvexBody::vertices`].
    pub vertices: [u32; 2],
    /// The faces that meet there, in [`ConvexBody::planes`].
    pub faces: [u32; 2],
}

/// A convex body by its vertices, edges and face planes.
///
/// Clipping decides once per vertex on which side of the plane it lies and derives everything else from that, so the
/// result is a consistent body whatever the rounding. New vertices carry the rounding of one interpolation.
///
/// ```
/// use farsight_geometry::{Camera, ConvexBody, DAabb, Frustum, glam::{DVec3, dvec3}};
///
/// // What a camera with an infinite far plane can see of a town.
/// let camera = Camera::look_at(dvec3(0.0, 2.0, 0.0), dvec3(10.0, 2.0, 0.0), DVec3::Y)?;
/// let town = DAabb::new(dvec3(-50.0, 0.0, -50.0), dvec3(50.0, 10.0, 50.0));
/// let mut seen = ConvexBody::from_box(&town);
/// seen.clip_to_frustum(&Frustum::from_camera(&camera), DVec3::ZERO);
/// assert!(!seen.is_empty() && town.inflated(1e-9).contains_box(&seen.bounds()));
/// # Ok::<(), farsight_geometry::CameraError>(())
/// ```
///
/// # Cost
/// One clip by a plane: about 100 ns for a dozen vertices; no allocation once the body's buffers have grown.
#[derive(Clone, Debug, Default)]
pub struct ConvexBody {
    vertices: Vec<DVec3>,
    edges: Vec<Edge>,
    planes: Vec<Plane>,
    /// Largest coordinates that the body ever had: its vertices carry the rounding of cuts at that size.
    reach: DVec3,
    scratch: Scratch,
}

/// Buffers of a clip, kept so that clipping does not allocate.
#[derive(Clone, Debug, Default)]
struct Scratch {
    distances: Vec<f64>,
    new_vertices: Vec<DVec3>,
    new_edges: Vec<Edge>,
    /// New index of each surviving vertex.
    kept: Vec<u32>,
    /// First cut point found on each face.
    cut_of_face: Vec<u32>,
}

const NONE: u32 = u32::MAX;

/// Corner indices of a box's edges (see [`DAabb::corners`]) and the faces −x +x −y +y −z +z that they separate.
const BOX_EDGES: [([u32; 2], [u32; 2]); 12] = [
    ([0, 1], [2, 4]),
    ([2, 3], [3, 4]),
    ([4, 5], [2, 5]),
    ([6, 7], [3, 5]),
    ([0, 2], [0, 4]),
    ([1, 3], [1, 4]),
    ([4, 6], [0, 5]),
    ([5, 7], [1, 5]),
    ([0, 4], [0, 2]),
    ([1, 5], [1, 2]),
    ([2, 6], [0, 3]),
    ([3, 7], [1, 3]),
];

impl ConvexBody {
    /// The body without points.
    pub fn empty() -> Self {
        Self::default()
    }

    /// A box; flat boxes give flat bodies, an empty box the empty body.
    pub fn from_box(b: &DAabb) -> Self {
        let mut body = Self::empty();
        body.set_box(b);
        body
    }

    /// Becomes a box, keeping its buffers.
    pub fn set_box(&mut self, b: &DAabb) {
        self.clear();
        if b.is_empty() {
            return;
        }
        for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
            self.planes.push(Plane::through(b.min, axis));
            self.planes.push(Plane::through(b.max, -axis));
        }
        self.set_corners(b.corners());
    }

    /// The part of a camera's view between its near plane and `far`, relative to `origin`.
    ///
    /// `far` is cut to the camera's own far distance; it must be given since a body is bounded. A `far` before the near
    /// plane gives the empty body.
    pub fn from_camera(camera: &Camera, far: f64, origin: DVec3) -> Self {
        let mut body = Self::empty();
        body.set_camera(camera, far, origin);
        body
    }

    /// Becomes [`from_camera`](Self::from_camera), keeping its buffers.
    pub fn set_camera(&mut self, camera: &Camera, far: f64, origin: DVec3) {
        self.clear();
        let (near, far) = (camera.near(), camera.far().min(far));
        if !(near <= far && far.is_finite()) {
            return;
        }
        let half = camera.half_extent();
        let eye = camera.eye() - origin;
        let corner = |i: usize| {
            let ahead = if i & 4 == 0 { near } else { far };
            let scale = match camera.projection() {
                Projection::Perspective { .. } => ahead,
                Projection::Orthographic { .. } => 1.0,
            };
            let x = if i & 1 == 0 { -half.x } else { half.x } * scale;
            let y = if i & 2 == 0 { -half.y } else { half.y } * scale;
            eye + camera.world_from_view() * DVec3::new(x, y, -ahead)
        };
        let corners: [DVec3; 8] = std::array::from_fn(corner);
        // The frustum's sides come in the order left, right, bottom, top, as those of a box.
        let shift = |p: &Plane| Plane { offset: p.offset - p.normal.dot(eye), ..*p };
        self.planes.extend(Frustum::from_camera(camera).planes()[..4].iter().map(shift));
        self.planes.push(Plane::through(corners[0], camera.forward()));
        self.planes.push(Plane::through(corners[4], -camera.forward()));
        self.set_corners(corners);
    }

    /// The convex hull of points; exact in which points are on it and which are not.
    ///
    /// Faces with exactly coplanar triangles are merged. Points that are not finite are ignored.
    ///
    /// # Cost
    /// O(n · faces): meant for up to some hundred points.
    pub fn hull(points: &[DVec3]) -> Self {
        let body = hull::hull(points);
        let reach = body.vertices.iter().fold(DVec3::ZERO, |reach, v| reach.max(v.abs()));
        Self { reach, ..body }
    }

    /// The hull of this body and a point, such as a light.
    #[must_use]
    pub fn with_point(&self, point: DVec3) -> Self {
        let mut points = self.vertices.clone();
        points.push(point);
        Self::hull(&points)
    }

    /// The body swept along `offset`: the hull of it and its translate.
    #[must_use]
    pub fn swept(&self, offset: DVec3) -> Self {
        let moved = self.vertices.iter().map(|&v| v + offset);
        let points: Vec<DVec3> = self.vertices.iter().copied().chain(moved).collect();
        Self::hull(&points)
    }

    fn clear(&mut self) {
        self.vertices.clear();
        self.edges.clear();
        self.planes.clear();
        self.reach = DVec3::ZERO;
    }

    /// Vertices and edges of a (possibly degenerate) hexahedron whose planes are set.
    fn set_corners(&mut self, corners: [DVec3; 8]) {
        self.reach = corners.iter().fold(DVec3::ZERO, |reach, c| reach.max(c.abs()));
        let differ = |([a, b], _): &([u32; 2], _)| corners[*a as usize] != corners[*b as usize];
        if BOX_EDGES.iter().all(differ) {
            self.vertices.extend_from_slice(&corners);
            self.edges.extend(BOX_EDGES.iter().map(|&(vertices, faces)| Edge { vertices, faces }));
        } else {
            self.set_flat_corners(corners);
        }
    }

    fn set_flat_corners(&mut self, corners: [DVec3; 8]) {
        // Equal corners of flat boxes become one vertex, so that edges have length and vertices are distinct.
        let mut index = [0; 8];
        for (i, corner) in corners.iter().enumerate() {
            index[i] = match self.vertices.iter().position(|v| v == corner) {
                Some(known) => known as u32,
                None => {
                    self.vertices.push(*corner);
                    self.vertices.len() as u32 - 1
                }
            };
        }
        for (ends, faces) in BOX_EDGES {
            let vertices = ends.map(|i| index[i as usize]);
            let known = self.edges.iter().any(|e| e.vertices == vertices);
            if vertices[0] != vertices[1] && !known {
                self.edges.push(Edge { vertices, faces });
            }
        }
        // In a flat box, an edge must separate the two faces that are left: those across the flat axis.
        if let Some(flat) = self.flat_axis_of_box() {
            self.edges.iter_mut().for_each(|e| e.faces = [2 * flat, 2 * flat + 1]);
        }
    }

    fn flat_axis_of_box(&self) -> Option<u32> {
        (self.vertices.len() < 8).then(|| {
            let b = self.bounds();
            (0..3).find(|&axis| b.extent()[axis] == 0.0).unwrap_or(0) as u32
        })
    }

    /// Whether the body has no points.
    pub fn is_empty(&self) -> bool {
        self.vertices.is_empty()
    }

    /// The vertices; distinct when made from a box or a hull.
    pub fn vertices(&self) -> &[DVec3] {
        &self.vertices
    }

    /// The edges.
    pub fn edges(&self) -> &[Edge] {
        &self.edges
    }

    /// Planes of the faces, inside positive. Some may touch the body in less than a face.
    pub fn planes(&self) -> &[Plane] {
        &self.planes
    }

    /// The box around the body.
    pub fn bounds(&self) -> DAabb {
        DAabb::from_points(self.vertices.iter().copied())
    }

    /// Smallest and largest value of `direction · x` over the body; `None` for the empty body.
    pub fn extent_along(&self, direction: DVec3) -> Option<(f64, f64)> {
        let along = |range: Option<(f64, f64)>, v: &DVec3| {
            let x = direction.dot(*v);
            Some(range.map_or((x, x), |(lo, hi): (f64, f64)| (lo.min(x), hi.max(x))))
        };
        self.vertices.iter().fold(None, along)
    }

    /// Whether a point lies in the body or within `tolerance` of its planes; never true for the empty body.
    pub fn contains(&self, point: DVec3, tolerance: f64) -> bool {
        match self.vertices.as_slice() {
            [] => false,
            [only] => only.distance(point) <= tolerance,
            _ => {
                self.bounds().inflated(tolerance).contains(point)
                    && self.planes.iter().all(|p| p.distance(point) >= -tolerance)
            }
        }
    }

    /// Box of the body's image under a projective matrix, after division by w.
    ///
    /// `None` for the empty body and when a vertex does not lie strictly ahead (w > 0): clip first.
    pub fn projected_bounds(&self, matrix: &DMat4) -> Option<DAabb> {
        let mut bounds = DAabb::EMPTY;
        for v in &self.vertices {
            let h = *matrix * v.extend(1.0);
            if h.w <= 0.0 {
                return None;
            }
            bounds = bounds.with_point(h.truncate() / h.w);
        }
        (!bounds.is_empty()).then_some(bounds)
    }

    /// Keeps what lies inside a plane, its border included, and what lies outside by no more than rounding.
    pub fn clip(&mut self, plane: &Plane) {
        let distances = &mut self.scratch.distances;
        distances.clear();
        // Cutting by a plane and then by its opposite, as a flat box does, must leave the polygon between them, so what is
        // within the rounding of the cuts so far counts as on the plane.
        let rounding = 8.0 * f64::EPSILON * (plane.normal.abs().dot(self.reach) + plane.offset.abs());
        let distance = |v: &DVec3| {
            let d = plane.distance(*v);
            if d.abs() <= rounding { 0.0 } else { d }
        };
        let mut outside = 0;
        distances.extend(self.vertices.iter().map(distance).inspect(|&d| outside += usize::from(d < 0.0)));
        if outside == self.vertices.len() {
            self.clear();
        } else if outside > 0 {
            self.keep_inside(plane);
        }
    }

    /// The clip proper, with vertices on both sides.
    fn keep_inside(&mut self, plane: &Plane) {
        let Scratch { distances, new_vertices, new_edges, kept, cut_of_face } = &mut self.scratch;
        new_vertices.clear();
        new_edges.clear();
        kept.clear();
        for (&v, &d) in self.vertices.iter().zip(distances.iter()) {
            kept.push(if d >= 0.0 { new_vertices.len() as u32 } else { NONE });
            if d >= 0.0 {
                new_vertices.push(v);
            }
        }
        let new_face = self.planes.len() as u32;
        cut_of_face.clear();
        cut_of_face.resize(self.planes.len(), NONE);
        for edge in &self.edges {
            let [a, b] = edge.vertices.map(|i| i as usize);
            let (inside, outside) = match (kept[a] != NONE, kept[b] != NONE) {
                (true, true) => {
                    new_edges.push(Edge { vertices: [kept[a], kept[b]], faces: edge.faces });
                    continue;
                }
                (false, false) => continue,
                (true, false) => (a, b),
                (false, true) => (b, a),
            };
            // A vertex on the plane is the cut itself; otherwise the edge gets a new end.
            let cut = if distances[inside] == 0.0 {
                kept[inside]
            } else {
                let t = distances[inside] / (distances[inside] - distances[outside]);
                new_vertices.push(self.vertices[inside].lerp(self.vertices[outside], t));
                let cut = new_vertices.len() as u32 - 1;
                new_edges.push(Edge { vertices: [kept[inside], cut], faces: edge.faces });
                cut
            };
            // The plane cuts the border of a convex face in two places; the new edge joins them.
            for face in edge.faces {
                let first = &mut cut_of_face[face as usize];
                if *first == NONE {
                    *first = cut;
                } else if *first != cut {
                    new_edges.push(Edge { vertices: [*first, cut], faces: [face, new_face] });
                }
            }
        }
        std::mem::swap(&mut self.vertices, new_vertices);
        std::mem::swap(&mut self.edges, new_edges);
        self.planes.push(*plane);
    }

    /// Keeps what lies inside a box.
    pub fn clip_to_box(&mut self, b: &DAabb) {
        if b.is_empty() {
            self.clear();
            return;
        }
        // Most sides of a scene's boxes lie far outside of a view; its bounds tell without asking every vertex again.
        let own = self.bounds();
        for (i, axis) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().enumerate() {
            if own.min[i] < b.min[i] {
                self.clip(&Plane::through(b.min, axis));
            }
            if own.max[i] > b.max[i] {
                self.clip(&Plane::through(b.max, -axis));
            }
        }
    }

    /// Keeps what lies inside a frustum; the body's coordinates are relative to `origin`.
    pub fn clip_to_frustum(&mut self, frustum: &Frustum, origin: DVec3) {
        let shift = frustum.anchor() - origin;
        for plane in frustum.planes() {
            self.clip(&Plane { offset: plane.offset - plane.normal.dot(shift), ..*plane });
        }
    }

    /// Volume; zero for flat bodies.
    pub fn volume(&self) -> f64 {
        // Sum of pyramids from one vertex over the edges, each edge spanning a triangle with a point of its face.
        let Some(&apex) = self.vertices.first() else { return 0.0 };
        let mut point_of_face = vec![None; self.planes.len()];
        let mut volume = 0.0;
        for edge in &self.edges {
            let [a, b] = edge.vertices.map(|i| self.vertices[i as usize] - apex);
            for face in edge.faces {
                let p = *point_of_face[face as usize].get_or_insert(a);
                volume += (a - p).cross(b - p).dot(p).abs() / 6.0;
            }
        }
        volume
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;

    fn unit() -> ConvexBody {
        ConvexBody::from_box(&DAabb::new(DVec3::ZERO, DVec3::ONE))
    }

    /// Euler's formula over the faces that edges name.
    fn is_closed(body: &ConvexBody) -> bool {
        let mut faces: Vec<u32> = body.edges().iter().flat_map(|e| e.faces).collect();
        faces.sort_unstable();
        faces.dedup();
        body.vertices().len() + faces.len() == body.edges().len() + 2
    }

    struct Random(u64);

    impl Random {
        fn unit(&mut self) -> f64 {
            self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (self.0 >> 11) as f64 / (1u64 << 53) as f64
        }

        fn vector(&mut self) -> DVec3 {
            DVec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
        }
    }

    #[test]
    fn a_corner_cut_off_has_the_volume_of_geometry() {
        let mut body = unit();
        body.clip(&Plane::through(dvec3(0.5, 0.0, 0.0), dvec3(-1.0, -1.0, -1.0).normalize()));
        assert_eq!((body.vertices().len(), body.edges().len()), (4, 6));
        assert!((body.volume() - 0.5f64.powi(3) / 6.0).abs() < 1e-15);
        assert!((unit().volume() - 1.0).abs() < 1e-15);
    }

    #[test]
    fn random_cuts_keep_just_the_inside() {
        let mut random = Random(3);
        for _ in 0..300 {
            let mut body = ConvexBody::from_box(&DAabb::new(DVec3::NEG_ONE, DVec3::ONE));
            let mut planes = Vec::new();
            for _ in 0..8 {
                let plane = Plane::through(random.vector() * 0.8, random.vector().normalize());
                planes.push(plane);
                body.clip(&plane);
                assert!(body.is_empty() || is_closed(&body));
            }
            let mut inside = 0;
            for _ in 0..500 {
                let p = random.vector();
                let expected = planes.iter().all(|q| q.distance(p) >= 0.0);
                let margin = planes.iter().map(|q| q.distance(p).abs()).fold(1.0, f64::min);
                assert!(margin < 1e-12 || body.contains(p, 1e-13) == expected);
                inside += i32::from(expected);
            }
            // Monte Carlo volume: 500 samples of a box of 8.
            let share = f64::from(inside) / 500.0;
            assert!((body.volume() / 8.0 - share).abs() < 0.1, "{} {share}", body.volume());
        }
    }

    #[test]
    fn cuts_through_vertices_edges_and_faces_leave_flat_bodies() {
        let diagonal = Plane::through(DVec3::ZERO, dvec3(1.0, -1.0, 0.0).normalize());
        let mut prism = unit();
        prism.clip(&diagonal);
        assert!(is_closed(&prism) && (prism.volume() - 0.5).abs() < 1e-15 && prism.vertices().len() == 6);

        let mut polygon = unit();
        polygon.clip(&Plane::through(DVec3::ONE, DVec3::X));
        assert_eq!((polygon.vertices().len(), polygon.volume()), (4, 0.0));
        let mut segment = polygon.clone();
        segment.clip(&Plane::through(DVec3::ONE, DVec3::Y));
        assert_eq!(segment.vertices().len(), 2);
        let mut point = segment.clone();
        point.clip(&Plane::through(DVec3::ONE, DVec3::Z));
        assert_eq!(point.vertices(), &[DVec3::ONE]);
        assert!(point.contains(DVec3::ONE, 0.0) && !point.contains(DVec3::ZERO, 0.1));
        point.clip(&Plane::through(DVec3::splat(2.0), DVec3::Z));
        assert!(point.is_empty() && point.extent_along(DVec3::X).is_none());
    }

    #[test]
    fn flat_boxes_are_flat_bodies_and_can_be_cut() {
        for (extent, vertices, edges) in
            [(dvec3(1.0, 0.0, 2.0), 4, 4), (dvec3(0.0, 3.0, 0.0), 2, 1), (DVec3::ZERO, 1, 0)]
        {
            let body = ConvexBody::from_box(&DAabb::new(DVec3::ONE, DVec3::ONE + extent));
            assert_eq!((body.vertices().len(), body.edges().len()), (vertices, edges), "{extent}");
        }
        let mut flat = ConvexBody::from_box(&DAabb::new(DVec3::ZERO, dvec3(1.0, 0.0, 2.0)));
        flat.clip(&Plane::through(dvec3(0.5, 0.0, 0.0), DVec3::NEG_X));
        assert_eq!(flat.bounds(), DAabb::new(DVec3::ZERO, dvec3(0.5, 0.0, 2.0)));
        assert_eq!(flat.vertices().len(), 4);
        assert!(ConvexBody::from_box(&DAabb::EMPTY).is_empty());
    }

    #[test]
    fn a_flat_box_cuts_a_polygon_out_of_a_frustum() {
        for eye in [dvec3(0.3, 0.7, 0.1), dvec3(1e5, -3e4, 777.7)] {
            let camera = Camera::look_at(eye, eye + dvec3(1.0, -0.7, 0.3), DVec3::Y).unwrap();
            let ground = DAabb::new(eye - dvec3(50.0, 2.1, 50.0), eye + dvec3(50.0, -2.1, 50.0));
            let mut seen = ConvexBody::from_camera(&camera, 80.0, DVec3::ZERO);
            seen.clip_to_box(&ground);
            let mut other = ConvexBody::from_box(&ground);
            other.clip_to_frustum(&Frustum::from_camera(&camera), DVec3::ZERO);
            assert!(seen.vertices().len() >= 4);
            let (a, b) = (seen.bounds(), other.bounds());
            assert!(a.min.abs_diff_eq(b.min, 1e-8) && a.max.abs_diff_eq(b.max, 1e-8), "{a:?} {b:?}");
        }
    }

    #[test]
    fn a_camera_s_body_is_its_frustum() {
        let eye = dvec3(10.0, 20.0, 30.0);
        let camera = Camera::look_at(eye, DVec3::ZERO, DVec3::Y).unwrap();
        let body = ConvexBody::from_camera(&camera, 50.0, eye);
        assert!(is_closed(&body) && body.vertices().len() == 8);
        let mut random = Random(5);
        let frustum = Frustum::from_camera(&camera.with_range(camera.near(), 50.0).unwrap());
        for _ in 0..2000 {
            let p = random.vector() * 50.0;
            assert_eq!(body.contains(p, 0.0), frustum.contains(p + eye));
        }
        assert!(ConvexBody::from_camera(&camera, f64::INFINITY, eye).is_empty());
        assert!(ConvexBody::from_camera(&camera, 0.05, eye).is_empty());
    }

    #[test]
    fn clipping_reuses_its_buffers() {
        let planes: Vec<Plane> = (0..6)
            .map(|i| {
                Plane::through(DVec3::splat(0.4), dvec3((i as f64).cos(), (i as f64).sin(), 0.1).normalize())
            })
            .collect();
        let mut body = unit();
        let run = |body: &mut ConvexBody| {
            body.set_box(&DAabb::new(DVec3::ZERO, DVec3::ONE));
            planes.iter().for_each(|p| body.clip(p));
            (body.vertices.capacity(), body.edges.capacity(), body.planes.capacity())
        };
        run(&mut body);
        run(&mut body);
        let capacity = run(&mut body);
        assert_eq!((0..5).map(|_| run(&mut body)).next_back(), Some(capacity));
    }
}
